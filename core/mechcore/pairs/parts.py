"""What a mechanism's pairs add up to: joints, relations and links that a pair brings along."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from ..errors import Fault, MechanismError
from ..spec import Link, Mechanism, Pair, Revolute
from .joint import Joint
from .relation import Relation

__all__ = ["Builder"]


@dataclass
class Builder:
    """Collects the parts while a mechanism is compiled. ``links`` grows where a pair brings links along."""

    mechanism: Mechanism
    links: dict[str, Link]
    joints: list[Joint] = field(default_factory=list)
    relations: list[Relation] = field(default_factory=list)

    def ends(self, pair: Any) -> tuple[Link, Link]:
        """The two links of a pair."""
        return self.links[pair.links[0]], self.links[pair.links[1]]

    def pin_between(self, pair: Pair, link: str, carrier: str) -> tuple[str, str]:
        """Point of ``carrier`` and point of ``link`` where a revolute pair joins them."""
        for p in self.mechanism.pairs:
            if isinstance(p, Revolute) and set(p.links) == {link, carrier}:
                return p.points if p.links[0] == carrier else (p.points[1], p.points[0])
        raise MechanismError(
            Fault(
                f"pairs.{pair.name}",
                f"'{link}' is not pinned to '{carrier}', which is to carry it.",
                f"Add a revolute pair between them, or name the carrier that '{link}' is pinned to.",
            )
        )

    def add_points(self, link: str, **points: tuple[float, float]) -> None:
        """Give a link more points, for a pair that needs them."""
        self.links[link] = replace(self.links[link], points={**self.links[link].points, **points})
