"""The common form of every lower pair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..spec import Link

__all__ = ["Joint", "point_of"]


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One pair as the contour equations see it; plane vectors are complex numbers.

    The point ``a`` of the first link and ``b`` of the second coincide, except that where there is a ``slide`` direction the
    other link's point lies at ``s * slide`` from the guide's, on the guide. If the pair does not ``turn``, the second link's
    angle is the first's plus ``angle``.
    """

    name: str
    kind: str
    links: tuple[str, str]
    a: complex  # in the first link's frame [m]
    b: complex  # in the second link's frame [m]
    turns: bool
    angle: float = 0.0  # [rad], where it does not turn
    slide: complex | None = None  # unit vector in the guide's frame
    guide: Literal[0, 1] = 0

    @property
    def freedoms(self) -> int:
        return int(self.turns) + int(self.slide is not None)

    @property
    def coordinate(self) -> Literal["angle", "slide"]:
        """What a drive on this pair prescribes."""
        return "slide" if self.slide is not None else "angle"


def point_of(link: Link, name: str) -> complex:
    """A named point of a link in its own frame."""
    x, y = link.points[name]
    return x + 1j * y
