"""What every kind of joint states of itself, and what it is given to become a joint of the core."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from mechcore.errors import Fault
from mechcore.spec.mechanism import Friction, Joint, Vec2
from mechviz.scene.convert import Converter
from mechviz.scene.kinds.friction import Rubbing, friction_spec
from mechviz.scene.kinds.kind import Kind
from mechviz.scene.names import points_of_joint

if TYPE_CHECKING:
    from mechviz.scene.assembly.placement import Placement
    from mechviz.scene.document import SceneDocument
    from mechviz.scene.kinds.joints.document import JointDocument
    from mechviz.scene.reading.recovery import Reading


@dataclass(frozen=True, kw_only=True)
class JointKind(Kind):
    """A kind of joint: all that is known of its keyword, from the words for it to the joint of the core."""

    make: Callable[[JointMaker], Joint | None]  # the core's joint; None where too little of it is left
    modes: tuple[str, ...] = ()  # those that choose an assembly mode
    driven: Literal["angle", "length", ""] = ""  # what a drive on it prescribes
    undriven: str = ""  # what to drive instead, where a drive makes no sense
    viscous: Literal["damping", "torsional damping", ""] = ""  # of viscous friction in it; none where it does not move
    rubs: Rubbing | None = None  # how it rubs
    joins: bool = True  # it holds points of its links together; the others tie motions of links that joints hold already
    places: bool = True  # it places one of its links by the other
    coincide: bool = False  # the two points are one place
    parallel: bool = False  # the two links keep a constant angle
    pose: bool = False  # free, it has x, y and angle instead of one coordinate
    own_mode: bool = False  # its drive does not decide the assembly mode
    higher: bool = False  # there is an equivalent linkage of lower pairs
    parts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # section -> links and joints that it brings along
    check: Callable[[Reading, str, JointDocument], Iterator[Fault]] | None = None  # faults of the names at a path that it refers to
    core_path: Callable[[JointDocument, str], str] | None = None  # a path inside the core's joint -> inside the scene's


class JointMaker:
    """A joint of a scene with what surrounds it, its values in SI units."""

    def __init__(self, name: str, joint: JointDocument, document: SceneDocument, placement: Placement, convert: Converter):
        self.name, self.joint, self.document, self.placement, self.convert = name, joint, document, placement, convert
        self.path = f"joints.{name}"

    @property
    def points(self) -> tuple[str, str]:
        return points_of_joint(self.name, self.joint)

    @property
    def guide(self) -> Literal[0, 1]:
        return 1 if self.joint.guide == self.joint.links[1] else 0

    @property
    def along(self) -> Vec2:
        """Direction of the guide in the frame of its link."""
        if self.joint.along is None:
            return (1.0, 0.0)
        a, b = self.joint.along
        if not (isinstance(a, str) and isinstance(b, str)):
            return (float(a), float(b))
        places = self.placement.points.get(self.joint.links[self.guide], {})
        pa, pb = places.get(a, (0.0, 0.0)), places.get(b, (1.0, 0.0))
        if a not in places or b not in places:
            return (1.0, 0.0)
        if pa == pb:
            self.convert.note(
                f"{self.path}.along",
                f"'{a}' and '{b}' are at the same place.",
                "Name two different points, or write a direction such as [1, 0].",
            )
        return (pb[0] - pa[0], pb[1] - pa[1])

    @property
    def angle(self) -> float:
        """Constant angle from the first link's frame to the second's: stated, as drawn, or zero [rad]."""
        if self.joint.angle is not None:
            return self.convert.si(self.joint.angle, "angle", f"{self.path}.angle")
        return drawn_angle(self.joint, self.placement)

    @property
    def ends(self) -> Vec2 | None:
        """Least and greatest coordinate [m]; None where none are stated."""
        given, path = self.joint.length, f"{self.path}.length"
        if given is None:
            return None
        if not isinstance(given, list):
            return 0.0, self.convert.si(given, "length", path)
        low, high = self.convert.row(given, "length", path)
        if low >= high and self.convert.certain("length"):
            self.convert.note(path, "it ends where it begins, or before.", "Write [from, to], the greater coordinate last.")
        return low, high

    @property
    def radius(self) -> float:
        if self.joint.radius is None:  # noted where the joint was read
            return math.nan
        return self.convert.si(self.joint.radius, "length", f"{self.path}.radius")

    @property
    def side(self) -> Literal["left", "right"]:
        return self.joint.side or "left"

    @property
    def friction(self) -> Friction | None:
        rubs = self.joint.traits.rubs
        return None if rubs is None else friction_spec(rubs, self.path, self.joint.friction, self.document.friction, self.convert)


def drawn_angle(joint: JointDocument, placement: Placement) -> float:
    """The angle from the first link's frame to the second's as they are drawn [rad]; 0 where they are not."""
    if not placement.drawn.issuperset(joint.links):
        return 0.0
    first, second = (placement.poses[link][2] for link in joint.links)
    return math.remainder(second - first, 2.0 * math.pi)
