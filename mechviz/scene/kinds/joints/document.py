"""A joint of a scene document: one of the kinds with the keys that go with it, and its conversion to the core.

To add a kind, define its keyword and keys, its conversion to the core and its entry in a module of this folder.
"""

from __future__ import annotations

import cmath
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field, model_validator

from mechcore.errors import Fault
from mechcore.spec.mechanism import Joint
from mechviz.scene.convert import Converter
from mechviz.scene.fields import Direction, OneOrTwoNames, one_of, raise_faults
from mechviz.scene.kinds.drives import DriveDocument, FreeDocument, StopDocument
from mechviz.scene.kinds.friction import FrictionDocument, friction_faults
from mechviz.scene.kinds.joints.cam import CAMS, CamKeys
from mechviz.scene.kinds.joints.lower import LOWER, LowerKeys
from mechviz.scene.kinds.joints.wheels import WHEELS, WheelKeys
from mechviz.scene.kinds.kind import JointKind, JointMaker, KindTable, drawn_angle
from mechviz.scene.names import link_names

if TYPE_CHECKING:
    from mechviz.scene.assembly.links import Placement
    from mechviz.scene.document import SceneDocument
    from mechviz.scene.reading.recovery import Reading


JOINT_KINDS: Mapping[str, JointKind] = {**LOWER, **WHEELS, **CAMS}
"""The kinds of joints by their keywords."""

_MODES = ("side", "assembly", "branch")


class JointKeys(KindTable):
    """The keys of joints of several kinds."""

    at: OneOrTwoNames | None = None
    """Name of the joined point, or [point of the first link, point of the second]. Default: the joint's name.
    Planar: the second link's point whose place x, y is the coordinate. Default: the origin of its frame."""
    along: Direction | None = None
    """Direction of the guide, slot or edge in the frame of its link. Default [1, 0]."""
    side: Literal["left", "right"] | None = None
    """Assembly mode: the pin lies on this side of the line from the first link's other pin to the second link's.
    Rolling, rack: the wheel or pinion lies on this side of the edge or guide, looking along it. Default left."""
    assembly: Literal["open", "crossed"] | None = None
    """Assembly mode of a four-bar, stated at the pin between coupler and rocker."""
    branch: Literal["ahead", "behind"] | None = None
    """Assembly mode of a group with a sliding joint: further along the guide's direction, or further back."""
    friction: FrictionDocument | None = None
    """Dry friction in this joint, where `effects` names friction."""
    drive: DriveDocument | None = None
    """Prescribed motion of this joint."""
    free: FreeDocument | None = None
    """Instead of a drive: forces decide the motion of this joint, which starts as stated."""
    stops: list[StopDocument] = Field(default=[])
    """End stops of this joint, where something is free."""


class JointDocument(JointKeys, CamKeys, WheelKeys, LowerKeys):
    """A kinematic pair between two links."""

    KINDS: ClassVar[Mapping[str, JointKind]] = JOINT_KINDS

    @property
    def traits(self) -> JointKind:
        """Its kind."""
        return JOINT_KINDS[self.kind]

    @property
    def links(self) -> tuple[str, str]:
        """The names of the two links."""
        first, second = getattr(self, self.kind)
        return first, second

    @property
    def driven(self) -> bool:
        """Whether its coordinate decides the configuration: it has a drive, or is free."""
        return self.drive is not None or self.free is not None

    @property
    def coordinate(self) -> Literal["angle", "length"]:
        """The coordinate that a drive on it prescribes."""
        return self.traits.driven or "angle"

    @property
    def mode(self) -> str | None:
        """The assembly mode, by whichever key it is stated; the side of a wheel on its edge is none."""
        return next((mode for key in self.traits.modes if (mode := getattr(self, key)) is not None), None)

    @model_validator(mode="after")
    def _one_joint(self) -> JointDocument:
        wrong: list[tuple[str, str, str]] = one_of(self, tuple(JOINT_KINDS), "the joint")
        raise_faults([*wrong, *self._two_modes(_MODES)] if wrong else [])
        kind = self.traits
        if self.links[0] == self.links[1]:
            wrong.append((self.kind, f"joins '{self.links[0]}' to itself.", "Name two different links."))
        wrong += self.key_faults(f"the {kind.words.removeprefix('a ')}")
        for key in self.free.foreign_keys(kind.is_planar) if self.free is not None else ():
            known = "x, y, angle, vx, vy and omega" if kind.is_planar else "position and speed"
            wrong.append(("free", f"{key} does not go with {kind.words}.", f"Its start has {known}."))
        if self.friction is not None and kind.friction is not None:
            wrong += friction_faults(kind.friction, kind.words, self.friction)
        modes = [key for key in kind.modes if getattr(self, key) is not None]
        wrong += self._two_modes(modes)
        if self.driven and modes and not kind.own_mode:
            what = (
                "a driven joint, whose position the drive" if self.drive is not None else "a free joint, whose position its start"
            )
            wrong.append((modes[0], f"{modes[0]} on {what} decides.", f"Leave out {modes[0]}."))
        if self.drive is not None and self.free is not None:
            wrong.append(("free", "free and drive at once: either forces or the drive decide the motion.", "Keep one of them."))
        raise_faults(wrong)
        return self

    def has_value(self, key: str) -> bool:
        """Whether a key has a value other than its default."""
        return getattr(self, key) not in (None, False, [])

    def remedy_for(self, key: str) -> str:
        """Remedy for a key that does not go with the kind."""
        kind = self.traits
        if key in ("drive", "free"):
            return kind.undriven
        if key in _MODES and "branch" in kind.keys:
            return "Write branch = 'ahead' or 'behind' instead."
        if key in _MODES and "side" in kind.keys:
            return "Write side = 'left' or 'right' instead."
        return kind.remedies.get(key, "Leave it out.")

    def _two_modes(self, keys: Iterable[str]) -> list[tuple[str, str, str]]:
        """The fault of several modes among these keys."""
        modes = [key for key in keys if getattr(self, key) is not None]
        if len(modes) < 2:
            return []
        return [(modes[1], f"{' and '.join(modes)} at once: both choose the assembly mode.", "Keep one of them.")]


def check_joints(reading: Reading) -> Iterator[Fault]:
    """Faults of the names that joints refer to beside their links and points, and of the parts that they generate."""
    taken = {"links": link_names(reading), "joints": list(reading.document.joints)}
    for name, joint in reading.document.joints.items():
        if len(joint.kinds) > 1:
            continue
        if joint.traits.check is not None:
            yield from joint.traits.check(reading, f"joints.{name}", joint)
        for section, parts in joint.traits.parts.items():
            for part in parts:
                if f"{name}.{part}" in taken[section]:
                    yield Fault(
                        f"{section}.{name}.{part}",
                        f"the {joint.kind} '{name}' brings along a part of this name.",
                        f"Rename the {section[:-1]} or the {joint.kind}.",
                    )


def joint_spec(name: str, joint: JointDocument, document: SceneDocument, placement: Placement, convert: Converter) -> Joint | None:
    """The core's joint; faults of its values are noted. None where too much of it is missing."""
    return joint.traits.make(JointMaker(name, joint, document, placement, convert))


def drawn_place(joint: JointDocument, placement: Placement) -> tuple[float, float, float]:
    """The coordinates x, y [m] and angle [rad] of a planar joint as its links are drawn; 0 where they are not."""
    first, second = joint.links
    if not placement.drawn.issuperset(joint.links):
        return 0.0, 0.0, 0.0
    (x1, y1, a1), (x2, y2, _) = placement.poses[first], placement.poses[second]
    turned = drawn_angle(joint, placement)
    point = joint.at if isinstance(joint.at, str) else ""
    own = complex(*placement.points.get(second, {}).get(point, (0.0, 0.0)))
    z = complex(x2 - x1, y2 - y1) * cmath.exp(-1j * a1) + own * cmath.exp(1j * turned)
    return z.real, z.imag, turned


def modes_of(document: SceneDocument) -> dict[str, str]:
    """Assembly modes by the names of the joints in the core.

    The side of a cylinder is that of its eye. A cylinder that nothing drives has a positive length, never the other branch.
    """
    modes = {}
    for name, joint in document.joints.items():
        if joint.traits.own_mode and not joint.driven:
            modes[name] = "ahead"
        if joint.mode is not None:
            modes[f"{name}.eye" if joint.traits.own_mode else name] = joint.mode
    return modes
