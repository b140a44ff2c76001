"""The common forms of joints: points that coincide or slide, and relations of coordinates; the builder that collects them."""

from __future__ import annotations

import cmath
from collections.abc import Callable
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal

from mechcore.arrays import Plane, Real, Values
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechcore.spec.mechanism import Joint, Link, Mechanism, Revolute, Weld

if TYPE_CHECKING:
    from mechcore.motion.motion import Motion


@dataclass(frozen=True, kw_only=True)
class LoopJoint:
    """A joint in the form of the loop equations; plane vectors are complex numbers.

    The point ``a`` of the first link and ``b`` of the second coincide. If there is a ``slide`` direction, the point of the link
    without the guide instead lies on the guide, at ``s * slide`` from the guide's point. If the joint does not allow rotation (not
    ``turns``), the second link's angle is the first's plus ``angle``.
    """

    name: str
    kind: str
    links: tuple[str, str]
    a: complex  # in the first link's frame [m]
    b: complex  # in the second link's frame [m]
    turns: bool
    angle: float = 0.0  # [rad], if it does not turn
    slide: complex | None = None  # unit vector in the guide's frame
    guide: Literal[0, 1] = 0  # which of the links carries the guide

    @property
    def freedoms(self) -> int:
        return int(self.turns) + int(self.slide is not None)

    @property
    def coordinate(self) -> Literal["angle", "slide"]:
        """The coordinate that a drive on this joint prescribes."""
        return "slide" if self.slide is not None else "angle"


def point_of(link: Link, name: str) -> complex:
    """A named point of a link in its own frame [m]."""
    x, y = link.points[name]
    return x + 1j * y


@dataclass(frozen=True, kw_only=True, eq=False)
class CoordinateFunction:
    """A nonlinear term: ``function(sum of coefficient * angle + sum of coefficient * displacement + shift)``.

    ``function``: arguments (...) -> value, first and second derivative with respect to the argument, (3, ...), value in metres.
    Angles of groups with a closed form are known within one turn only: a function of an angle must have the period of one turn.
    """

    function: Callable[[Values], Real]
    angles: tuple[tuple[str, float], ...] = ()  # (link, coefficient)
    slides: tuple[tuple[str, float], ...] = ()  # (sliding joint, coefficient)
    shift: float = 0.0


ContactFunction = Callable[["Motion", Values], tuple[Plane, Plane]]
"""(motion, multiplier) -> contact position [m], force on the second link per unit of the multiplier."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bearing:
    """The couple in a shaft's bearings, for relations whose plane contact force alone gives the wrong torque (axis in the plane).

    The contact force acts on the second link, its opposite on the first. In addition a couple acts on the first link, its opposite
    on the ``carrier``. ``joints``: revolute joints through which the couple passes from the carrier, each with +1 if its second
    link is on the side of the relation's first link, else -1.
    """

    carrier: str
    couple: Callable[[Motion, Plane, Plane], Values]  # (motion, place, force on the second link) -> couple on the first link [N m]
    joints: tuple[tuple[str, float], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Relation:
    """``sum of coefficient * angle + sum of coefficient * displacement + curve = constant``; None: taken from the start position.

    It is scaled so that its rate is the velocity of the first link at the contact minus that of the second, along the vector that
    ``contact`` returns with the contact position. The transmitted force is then its Lagrange multiplier.
    """

    name: str
    kind: str
    links: tuple[str, str]
    angles: tuple[tuple[str, float], ...]  # (link, coefficient [m])
    slides: tuple[tuple[str, float], ...]  # (sliding joint, coefficient)
    contact: ContactFunction
    curve: CoordinateFunction | None = None
    constant: float | None = None  # [m], for the links' own angles and displacements
    bearing: Bearing | None = None
    geometry: Any = None  # the geometry of the joint, for drawing and recording


@dataclass
class Builder:
    """Collects the parts while a mechanism is compiled. Joints may add links of their own to ``links``."""

    mechanism: Mechanism
    links: dict[str, Link]
    joints: list[LoopJoint] = field(default_factory=list)
    relations: list[Relation] = field(default_factory=list)

    def ends(self, joint: Joint) -> tuple[Link, Link]:
        """The two links of a joint."""
        return self.links[joint.links[0]], self.links[joint.links[1]]

    def axis_between(self, joint: Joint, link: str, carrier: str) -> tuple[complex, complex]:
        """The axis about which ``link`` turns on ``carrier``, in the carrier's frame and in the link's.

        They may be pinned to each other, or on the same axis to other links (several links on one shaft, a wheel welded to its
        shaft).
        """
        return self._path_between(joint, link, carrier)[:2]

    def bearings_between(self, joint: Joint, link: str, carrier: str) -> tuple[tuple[str, float], ...]:
        """The revolute joints about that axis on the path from ``carrier`` to ``link``: name, and +1 if its second link is the one
        nearer to ``link``, else -1."""
        return self._path_between(joint, link, carrier)[2]

    def _path_between(self, joint: Joint, link: str, carrier: str) -> tuple[complex, complex, tuple[tuple[str, float], ...]]:
        reached: list[tuple[str, complex, complex, tuple[tuple[str, float], ...]]] = [(link, z, z, ()) for z in self._axes_of(link)]
        for k, z, own, path in reached:  # grows while it is walked through: nearest first
            if k == carrier:
                return z, own, path
            for other, there, through in self._on_the_same_axis(k, z):
                if not any(other == seen[0] and self._same(other, there, seen[1]) for seen in reached):
                    reached.append((other, there, own, path + through))
        others = sorted({k for p in self.mechanism.joints if isinstance(p, Revolute) and link in p.links for k in p.links} - {link})
        known = f" It is pinned to {', '.join(repr(k) for k in others)}." if others else ""
        raise MechanismError(
            Fault(
                f"joints.{joint.name}",
                f"'{link}' is not pinned to '{carrier}', which is to carry it, nor to anything on the same axis.{known}",
                f"Add a revolute joint between them, or name the carrier that '{link}' is pinned to.",
            )
        )

    def rigid_with(self, link: str) -> list[tuple[str, complex, complex]]:
        """The link and all links welded to it: name, origin and rotation of the frame in the axes of ``link``."""
        rigid = [(link, 0j, 1 + 0j)]
        for k, origin, turn in rigid:  # grows while it is walked through
            for p in self.mechanism.joints:
                if isinstance(p, Weld) and k in p.links:
                    side = p.links.index(k)
                    other = p.links[1 - side]
                    if all(other != seen for seen, _, _ in rigid):
                        here, there = (point_of(self.links[p.links[i]], p.points[i]) for i in (side, 1 - side))
                        other_turn = turn * cmath.exp(1j * (-p.angle if side else p.angle))
                        rigid.append((other, origin + turn * here - other_turn * there, other_turn))
        return rigid

    def _axes_of(self, link: str) -> list[complex]:
        """The points, in the link's frame, at which a link or a link welded to it is pinned."""
        return [
            origin + turn * point_of(self.links[k], name)
            for k, origin, turn in self.rigid_with(link)
            for p in self.mechanism.joints
            if isinstance(p, Revolute)
            for end, name in zip(p.links, p.points, strict=True)
            if end == k
        ]

    def _on_the_same_axis(self, link: str, z: complex) -> list[tuple[str, complex, tuple[tuple[str, float], ...]]]:
        """The links pinned to ``link`` at ``z``, or welded to it: name, the point of the axis in their frame, and the pin with its
        sign (none for a weld)."""
        out: list[tuple[str, complex, tuple[tuple[str, float], ...]]] = []
        for p in self.mechanism.joints:
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
        """Whether two points of a link coincide up to rounding of its coordinates."""
        return abs(a - b) <= 1e-9 * max(abs(complex(*xy)) for xy in self.links[link].points.values())
