"""The pairs of a scene document: every kind with the keys that go with it.

To add a kind: its key in ``PairDocument``, one line in ``KINDS``, and how it becomes a pair of the core in ``pair_specs``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from mechviz.scene.cams.cams import FollowerDocument, ProfileDocument
from mechviz.scene.cams.ratings import GraphicalDocument, RatingDocument
from mechviz.scene.fields import (
    Angle,
    Direction,
    Flag,
    Length,
    OneOrTwoNames,
    Size,
    Table,
    Text,
    TwoNames,
    one_of,
    refuse,
    value_or_list,
)
from mechviz.scene.kinds.drives import DriveDocument
from mechviz.scene.kinds.free_motion import FreeDocument, LiftoffDocument, StopDocument
from mechviz.scene.kinds.friction import ClearanceDocument, FrictionDocument, friction_faults

TwoEnds = Annotated[list[Length], Field(min_length=2, max_length=2)]
Ends = Annotated[Annotated[Size, Tag("<value>")] | Annotated[TwoEnds, Tag("<list>")], Discriminator(value_or_list)]
Teeth = Annotated[int, Field(strict=True, ge=1, le=100_000)]


@dataclass(frozen=True)
class Kind:
    """A kind of pair: how it is called in a sentence, which keys go with it, and what a drive on it prescribes.

    ``joins`` says whether it holds points of its links together; the others tie motions of links that joints hold already.
    """

    words: str
    keys: tuple[str, ...]
    needs: tuple[str, ...] = ()  # keys that have no default
    driven: Literal["angle", "length", ""] = ""
    undriven: str = ""  # what to drive instead, where a drive makes no sense
    joins: bool = True


_WHEELS = "Drive the revolute pair of one of its wheels instead."

KINDS: Mapping[str, Kind] = {
    "revolute": Kind(
        "a revolute pair",
        ("at", "side", "assembly", "branch", "friction", "clearance", "drive", "free", "stops"),
        driven="angle",
    ),
    "prismatic": Kind(
        "a prismatic pair",
        ("at", "along", "guide", "angle", "length", "branch", "friction", "drive", "free", "stops"),
        driven="length",
    ),
    "weld": Kind("a weld", ("at", "angle"), undriven="A weld does not move: leave it out."),
    "pin_slot": Kind(
        "a pin in a slot", ("at", "along", "guide", "length", "branch", "friction", "drive", "free", "stops"), driven="length"
    ),
    "rolling": Kind(
        "a rolling pair",
        ("at", "along", "radius", "side", "branch", "friction", "drive", "free", "stops"),
        needs=("radius",),
        driven="length",
    ),
    "gear": Kind(
        "a gear pair", ("carrier", "teeth", "radii", "internal", "pressure_angle", "friction"), undriven=_WHEELS, joins=False
    ),
    "belt": Kind("a belt", ("carrier", "radii", "crossed"), needs=("radii",), undriven=_WHEELS, joins=False),
    "chain": Kind("a chain", ("carrier", "radii"), needs=("radii",), undriven=_WHEELS, joins=False),
    "rack": Kind(
        "a rack",
        ("slider", "radius", "side", "pressure_angle", "friction"),
        needs=("slider", "radius"),
        undriven="Drive the pinion's revolute pair, or the rack's prismatic one, instead.",
        joins=False,
    ),
    "cylinder": Kind("a cylinder", ("at", "length", "side", "friction", "drive", "free", "stops"), driven="length"),
    "planar": Kind(
        "a planar pair", ("at", "free"), needs=("free",), undriven="Its start is free = { x = ..., vy = ... }.", joins=False
    ),
    "cam": Kind(
        "a cam",
        ("profile", "follower", "closure", "friction", "liftoff", "rating", "graphical"),
        needs=("profile", "follower"),
        undriven="Drive the cam's revolute pair, or its bed, instead.",
        joins=False,
    ),
}

_OTHERWISE = {  # what was probably meant by a key that does not go with a kind
    ("radius", "gear"): "Write radii = [first, second] or teeth = [first, second].",
    ("radius", "belt"): "Write radii = [first, second].",
    ("radius", "chain"): "Write radii = [first, second].",
    ("teeth", "belt"): "Write radii = [first, second].",
    ("teeth", "chain"): "Write radii = [first, second]: the pitch radii of the sprockets.",
    ("radii", "rolling"): "Write radius = ...",
    ("radii", "rack"): "Write radius = ..., the pitch radius of the pinion.",
    ("teeth", "rack"): "Write radius = ..., the pitch radius of the pinion.",
    (
        "friction",
        "belt",
    ): "Give its pins friction; its own drag is a load, viscous, and belt_tension tells where it slips.",
    ("friction", "chain"): "Give its pins friction; its own drag is a load, viscous.",
    ("friction", "cam"): "Give the pairs that guide cam and follower friction; oil between them is a load, viscous.",
    ("crossed", "chain"): "Chains do not cross: leave it out, or write belt = [...].",
    ("at", "gear"): "Leave it out: the pins that hold the wheels say where they are.",
    ("at", "belt"): "Leave it out: the pins that hold the pulleys say where they are.",
    ("at", "chain"): "Leave it out: the pins that hold the sprockets say where they are.",
    ("at", "rack"): "Leave it out: the pinion's pin and the rack's guide say where they are.",
    ("at", "cam"): "Leave it out: follower = { point = ... } names the follower's point.",
    ("radius", "cam"): "Write follower = { roller = ... } and profile = { base = ... }.",
    ("side", "cam"): "Write follower = { side = ... }.",
    ("guide", "cam"): "Write follower = { guide = ... }.",
    ("slider", "cam"): "Write follower = { guide = ... }.",
    ("guide", "rolling"): "Leave it out: the edge is on the link that is named first.",
}
_MODES = ("side", "assembly", "branch")


class PairDocument(Table):
    """A kinematic pair between two links."""

    revolute: TwoNames | None = None
    """The two links that a pin joins."""
    prismatic: TwoNames | None = None
    """The two links of which one slides along the other."""
    weld: TwoNames | None = None
    """The two links that are joined rigidly."""
    pin_slot: TwoNames | None = None
    """The two links of which one has a straight slot for a pin of the other."""
    rolling: TwoNames | None = None
    """[link with a straight edge, wheel that rolls on it without slipping]."""
    gear: TwoNames | None = None
    """The two gear wheels that mesh; with internal = true: [pinion, ring]."""
    belt: TwoNames | None = None
    """The two pulleys that a belt connects."""
    chain: TwoNames | None = None
    """The two sprockets that a chain connects."""
    rack: TwoNames | None = None
    """[pinion, rack]."""
    cylinder: TwoNames | None = None
    """The two links between which a cylinder (hydraulic, electric ...) is pinned."""
    planar: TwoNames | None = None
    """The two links of which the second moves freely in the plane of the first: a free body."""
    cam: TwoNames | None = None
    """[cam, follower], both guided on one link."""
    at: OneOrTwoNames | None = None
    """Name of the joined point, or [point of the first link, point of the second]. Default: the pair's name.
    Planar: the second link's point whose place x, y is told. Default: the origin of its frame."""
    along: Direction | None = None
    """Direction of the guide, slot or edge in the frame of its link. Default [1, 0]."""
    guide: Text | None = None
    """Prismatic, pin in slot: the link that carries the guide or slot. Default: the first."""
    length: Ends | None = None
    """Pin in slot, prismatic: how far the pin or slider can go along the slot or guide from its point, or [from, to]; cylinder: its
    greatest length, or [least, greatest]. Prescribed motion beyond is refused, free motion meets an end stop there. Default: no
    ends."""
    angle: Angle | None = None
    """Prismatic, weld: constant angle from the first link's frame to the second's. Default 0, or as drawn."""
    carrier: Text | None = None
    """Gear, belt, chain: the link to which both wheels are pinned. Default: the fixed link, or the only one in question."""
    teeth: Annotated[list[Teeth], Field(min_length=2, max_length=2)] | None = None
    """Gear: numbers of teeth [first, second]."""
    radii: Annotated[list[Size], Field(min_length=2, max_length=2)] | None = None
    """Gear, belt, chain: pitch radii [first, second]."""
    radius: Size | None = None
    """Rolling: radius of the wheel. Rack: pitch radius of the pinion."""
    internal: Flag = False
    """Gear: the second wheel is a ring with its teeth inside."""
    pressure_angle: Angle | None = None
    """Gear, rack: angle between the force and the tangent of the pitch circles. Default 20 deg."""
    crossed: Flag = False
    """Belt: it crosses between the pulleys and turns them against each other."""
    slider: Text | None = None
    """Rack: the prismatic pair that guides the rack on the link to which the pinion is pinned."""
    side: Literal["left", "right"] | None = None
    """Assembly mode: the pin lies on this side of the line from the first link's other pin to the second link's.
    Rolling, rack: the wheel or pinion lies on this side of the edge or guide, looking along it. Default left."""
    assembly: Literal["open", "crossed"] | None = None
    """Assembly mode of a four-bar, said of the pin between coupler and rocker."""
    branch: Literal["ahead", "behind"] | None = None
    """Assembly mode of a group with a sliding pair: further along the guide's direction, or further back."""
    profile: ProfileDocument | None = None
    """Cam: base circle and lift."""
    follower: FollowerDocument | None = None
    """Cam: what touches it and what guides that."""
    closure: Literal["force", "form"] | None = None
    """Cam: "force", the follower is only pressed on it (by a spring, its weight); "form", a groove or a yoke holds it too.
    Default force."""
    rating: RatingDocument | None = None
    """Cam: by what its contact is judged: Hertz pressure, a margin of the contact force."""
    graphical: GraphicalDocument | None = None
    """Cam: its lift also by the graphical method, with the error of that."""
    liftoff: LiftoffDocument | None = None
    """Cam: the follower may leave it, flies under the forces and lands with an impact; the run then has a duration."""
    friction: FrictionDocument | None = None
    """Dry friction in this pair, where `effects` names friction."""
    clearance: ClearanceDocument | None = None
    """Revolute: clearance between journal and bearing, whose motion forces decide."""
    drive: DriveDocument | None = None
    """Prescribed motion of this pair."""
    free: FreeDocument | None = None
    """Instead of a drive: forces decide the motion of this pair, which starts as stated."""
    stops: list[StopDocument] = Field(default=[])
    """End stops of this pair, where something is free."""

    @property
    def kinds(self) -> list[str]:
        """The kinds that are given: one, in a pair that is not faulty."""
        return [kind for kind in KINDS if getattr(self, kind) is not None]

    @property
    def kind(self) -> str:
        return self.kinds[0]

    @property
    def links(self) -> tuple[str, str]:
        """The names of the two links."""
        first, second = getattr(self, self.kind)
        return first, second

    @property
    def joins(self) -> bool:
        """Whether it holds points of its links together; gears, belts, racks and cams do not."""
        return KINDS[self.kind].joins

    @property
    def connects(self) -> bool:
        """Whether it places one of its links by the other; gears, belts, racks and cams tie links that others place."""
        return self.joins or self.kind == "planar"

    @property
    def led(self) -> bool:
        """Whether its coordinate decides the configuration: it has a drive, or is free."""
        return self.drive is not None or self.free is not None

    @property
    def coincide(self) -> bool:
        """Whether the two points are one place."""
        return self.kind in ("revolute", "weld")

    @property
    def parallel(self) -> bool:
        """Whether the two links keep a constant angle."""
        return self.kind in ("prismatic", "weld")

    @property
    def coordinate(self) -> Literal["angle", "length"]:
        """What a drive on it prescribes."""
        return KINDS[self.kind].driven or "angle"

    @property
    def mode(self) -> str | None:
        """The assembly mode, whichever way it is said; the side of a wheel on its edge is none."""
        return (None if self.kind in ("rolling", "rack") else self.side) or self.assembly or self.branch

    @model_validator(mode="after")
    def _one_pair(self) -> PairDocument:
        found: list[tuple[str, str, str]] = one_of(self, tuple(KINDS), "the pair")
        refuse([*found, *self._two_modes(_MODES)] if found else [])
        kind = KINDS[self.kind]
        if self.links[0] == self.links[1]:
            found.append((self.kind, f"joins '{self.links[0]}' to itself.", "Name two different links."))
        for key in sorted(self.model_fields_set - set(KINDS), key=list(PairDocument.model_fields).index):
            if key not in kind.keys and getattr(self, key) not in (None, False, []):
                found.append((key, f"{key} does not go with {kind.words}.", self._instead(key)))
        for key in kind.needs:
            if getattr(self, key) is None:
                found.append(("", f"'{key}' is missing.", f"Add {key} = {_EXAMPLES[key]}."))
        for key in self.free.strangers(self.kind == "planar") if self.free is not None else ():
            known = "x, y, angle, vx, vy and omega" if self.kind == "planar" else "position and speed"
            found.append(("free", f"{key} does not go with {kind.words}.", f"Its start has {known}."))
        if self.friction is not None:
            found += friction_faults(self.kind, kind.words, self.friction)
        if self.kind == "gear":
            found += one_of(self, ("teeth", "radii"), "the gear pair")
        modes = [key for key in _MODES if getattr(self, key) is not None and key in kind.keys]
        if self.kind == "rolling":
            modes = [key for key in modes if key != "side"]
        if self.kind != "rack":
            found += self._two_modes(modes)
        if self.led and modes and self.kind != "cylinder":
            what = "a driven pair, whose position the drive" if self.drive is not None else "a free pair, whose position its start"
            found.append((modes[0], f"{modes[0]} on {what} decides.", f"Leave out {modes[0]}."))
        if self.drive is not None and self.free is not None:
            found.append(("free", "free and drive at once: either forces or the drive decide the motion.", "Keep one of them."))
        refuse(found)
        return self

    def _two_modes(self, keys: Iterable[str]) -> list[tuple[str, str, str]]:
        """The fault of several modes among these keys."""
        modes = [key for key in keys if getattr(self, key) is not None]
        if len(modes) < 2:
            return []
        return [(modes[1], f"{' and '.join(modes)} at once: both choose the assembly mode.", "Keep one of them.")]

    def _instead(self, key: str) -> str:
        """What to do about a key that does not go with this kind of pair."""
        kind = KINDS[self.kind]
        if key in ("drive", "free"):
            return kind.undriven
        if key in _MODES and "branch" in kind.keys:
            return "Write branch = 'ahead' or 'behind' instead."
        if key in _MODES and "side" in kind.keys:
            return "Write side = 'left' or 'right' instead."
        return _OTHERWISE.get((key, self.kind), "Leave it out.")


_EXAMPLES = {
    "profile": '{ base = "40 mm", lift = [{ over = "120 deg", to = "20 mm" }, { over = "240 deg", to = 0 }] }',
    "follower": '{ roller = "10 mm", guide = "the pair that guides it", point = "the roller\'s centre" }',
    "radius": '"50 mm"',
    "radii": '["50 mm", "100 mm"]',
    "slider": "the name of the rack's prismatic pair",
    "free": '{ y = "1 m", vx = "2 m/s", omega = "60 rpm" }, its start',
}
