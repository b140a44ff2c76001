"""What a mechanism's pairs add up to: joints, relations and links that a pair brings along."""

from __future__ import annotations

import cmath
from dataclasses import dataclass, field, replace
from typing import Any

from ..errors import Fault, MechanismError
from ..spec import Link, Mechanism, Pair, Revolute, Weld
from .joint import Joint, point_of
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

    def axis_between(self, pair: Pair, link: str, carrier: str) -> tuple[complex, complex]:
        """The axis about which ``link`` turns on ``carrier``, in the carrier's frame and in the link's.

        They may be pinned to each other, or to the same place of others (several links on one shaft, a wheel welded to its shaft).
        """
        return self._way_between(pair, link, carrier)[:2]

    def bearings_between(self, pair: Pair, link: str, carrier: str) -> tuple[tuple[str, float], ...]:
        """The revolute pairs about that axis on the way from ``carrier`` to ``link``, +1 where the second is nearer to it."""
        return self._way_between(pair, link, carrier)[2]

    def _way_between(self, pair: Pair, link: str, carrier: str) -> tuple[complex, complex, tuple[tuple[str, float], ...]]:
        reached: list[tuple[str, complex, complex, tuple[tuple[str, float], ...]]] = [(link, z, z, ()) for z in self._axes_of(link)]
        for k, z, own, way in reached:  # grows while it is walked through: nearest first
            if k == carrier:
                return z, own, way
            for other, there, through in self._on_the_same_axis(k, z):
                if not any(other == seen[0] and self._same(other, there, seen[1]) for seen in reached):
                    reached.append((other, there, own, way + through))
        others = sorted({k for p in self.mechanism.pairs if isinstance(p, Revolute) and link in p.links for k in p.links} - {link})
        known = f" It is pinned to {', '.join(repr(k) for k in others)}." if others else ""
        raise MechanismError(
            Fault(
                f"pairs.{pair.name}",
                f"'{link}' is not pinned to '{carrier}', which is to carry it, nor to anything on the same axis.{known}",
                f"Add a revolute pair between them, or name the carrier that '{link}' is pinned to.",
            )
        )

    def _axes_of(self, link: str) -> list[complex]:
        """Where a link, with all that is welded to it, is pinned to others, in the link's frame."""
        rigid = [(link, 0j, 1 + 0j)]  # link, origin and rotation of its frame
        for k, origin, turn in rigid:  # grows while it is walked through
            for p in self.mechanism.pairs:
                if isinstance(p, Weld) and k in p.links:
                    side = p.links.index(k)
                    other = p.links[1 - side]
                    if all(other != seen for seen, _, _ in rigid):
                        here, there = (point_of(self.links[p.links[i]], p.points[i]) for i in (side, 1 - side))
                        way = turn * cmath.exp(1j * (-p.angle if side else p.angle))
                        rigid.append((other, origin + turn * here - way * there, way))
        return [
            origin + turn * point_of(self.links[k], name)
            for k, origin, turn in rigid
            for p in self.mechanism.pairs
            if isinstance(p, Revolute)
            for end, name in zip(p.links, p.points, strict=True)
            if end == k
        ]

    def _on_the_same_axis(self, link: str, z: complex) -> list[tuple[str, complex, tuple[tuple[str, float], ...]]]:
        """Where the axis through ``z`` of a link goes through the links pinned to it there, or welded to it, and the pin."""
        out: list[tuple[str, complex, tuple[tuple[str, float], ...]]] = []
        for p in self.mechanism.pairs:
            if not isinstance(p, Revolute | Weld) or link not in p.links:
                continue
            side = p.links.index(link)
            own, other = (point_of(self.links[p.links[i]], p.points[i]) for i in (side, 1 - side))
            if isinstance(p, Weld):
                turn = cmath.exp(1j * (p.angle if side else -p.angle))
                out.append((p.links[1 - side], other + (z - own) * turn, ()))
            elif self._same(link, z, own):
                out.append((p.links[1 - side], other, ((p.name, 1.0 if side else -1.0),)))
        return out

    def _same(self, link: str, a: complex, b: complex) -> bool:
        """Whether two places of a link are one, up to rounding of its coordinates."""
        return abs(a - b) <= 1e-9 * max(abs(complex(*xy)) for xy in self.links[link].points.values())

    def add_points(self, link: str, **points: tuple[float, float]) -> None:
        """Give a link more points, for a pair that needs them."""
        self.links[link] = replace(self.links[link], points={**self.links[link].points, **points})
