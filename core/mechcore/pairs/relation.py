"""The common form of pairs that tie coordinates together instead of points: gears, belts, racks, rolling, cams."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..motion import Motion

__all__ = ["Bearing", "Curve", "Relation"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A nonlinear term: ``function(sum of coefficient * angle + sum of coefficient * displacement + shift)``.

    ``function``: arguments (...) -> value, first and second derivative with respect to the argument, (3, ...), value in metres.
    Angles of groups with a closed form are known within one turn only: the function of an angle must repeat every turn.
    """

    function: Callable[[Any], Any]
    angles: tuple[tuple[str, float], ...] = ()  # (link, coefficient)
    slides: tuple[tuple[str, float], ...] = ()  # (sliding pair, coefficient)
    shift: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Bearing:
    """What a shaft's bearings carry where the force of a relation does not lie in the plane as its torque does.

    The force on the second link acts at the contact, the opposite there on the first; beside it a couple acts on the first link,
    the opposite on the ``carrier``. ``joints``: (revolute pair, +1 where its second link is on the side of the first link of the
    relation) through which the couple passes from the carrier.
    """

    carrier: str
    couple: Callable[[Motion, Any, Any], Any]  # (motion, place, force on the second link) -> couple on the first link [N m]
    joints: tuple[tuple[str, float], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Relation:
    """``sum of coefficient * angle + sum of coefficient * displacement + curve = constant``; no constant: taken from the start.

    It is written so that its rate is the velocity of the first link at the contact minus that of the second, along the unit
    vector that ``contact`` gives together with the contact's place: the force that it transmits is then its Lagrange multiplier.
    """

    name: str
    kind: str
    links: tuple[str, str]
    angles: tuple[tuple[str, float], ...]  # (link, coefficient [m])
    slides: tuple[tuple[str, float], ...]  # (sliding pair, coefficient)
    contact: Callable[[Motion, Any], tuple[Any, Any]]  # (motion, multiplier) -> place [m], force on the second link per multiplier
    curve: Curve | None = None
    constant: float | None = None  # [m], of the links' own angles and of displacements
    bearing: Bearing | None = None
    geometry: Any = None  # what else the pair knows, for those who draw or record it
