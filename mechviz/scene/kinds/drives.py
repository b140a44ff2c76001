"""Drives of a scene: their motion laws, and the starts, stops and watched values of what forces move."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Discriminator, Field, PlainValidator, Tag, WithJsonSchema, model_validator

from mechviz.scene.fields import (
    Angle,
    AngularSpeed,
    Coordinate,
    DocumentTable,
    Duration,
    Flag,
    Frequency,
    Length,
    Name,
    QuantityMark,
    Range,
    Rate,
    Speed,
    Text,
    Time,
    describe,
    fault,
    one_of,
    raise_faults,
    value_or_list,
)
from mechviz.scene.kinds.segments import ProgramDocument, StateDocument, TimeSegment
from mechviz.scene.kinds.signals import SIGNALS, ChirpDocument, RampDocument, SineDocument, StepDocument
from mechviz.scene.names import PointName, Reference
from mechviz.scene.units import magnitude

Reach = Annotated[
    Annotated[Literal["reachable"], Tag("<value>")]
    | Annotated[Annotated[list[Coordinate], Field(min_length=2, max_length=2)], Tag("<list>")],
    Discriminator(value_or_list),
]


class ZonesDocument(DocumentTable):
    """Start, steady running and stop, each over a stated range of the coordinate (not of time)."""

    run_up: Range = 0.0
    """Range of uniform acceleration from rest."""
    steady: Range = 0.0
    """Range of constant speed."""
    braking: Range = 0.0
    """Range of uniform deceleration to rest."""

    @model_validator(mode="after")
    def _some_range(self) -> ZonesDocument:
        if not any(magnitude(zone) for zone in (self.run_up, self.steady, self.braking)):
            raise fault("all zones have the range zero: nothing moves.", "Give run_up, steady or braking a range.")
        return self


class OscillationDocument(DocumentTable):
    """centre + amplitude sin(2 pi frequency t + phase)."""

    centre: Coordinate = 0.0
    """Middle position."""
    amplitude: Range
    """Largest distance from the middle."""
    frequency: Frequency | None = None
    """Cycles per time. Give this or period."""
    period: Duration | None = None
    """Time of one cycle. Give this or frequency."""
    phase: Angle = 0.0
    """Phase angle at time zero."""

    @model_validator(mode="after")
    def _one_rate(self) -> OscillationDocument:
        raise_faults(one_of(self, ("frequency", "period"), "the oscillation"))
        return self


class DriveTable(DocumentTable):
    """A motion given point by point, joined by a quintic spline."""

    time: Annotated[list[Time], Field(min_length=2)]
    """Increasing times."""
    position: Annotated[list[Coordinate], Field(min_length=2)]
    """Positions at these times."""
    periodic: Flag = False
    """The last row is the end of the cycle, which continues smoothly into the next."""

    @model_validator(mode="after")
    def _same_length(self) -> DriveTable:
        if not self.has_valid("time", "position"):
            return self
        if len(self.position) != len(self.time):
            raise fault(f"{len(self.time)} times and {len(self.position)} positions.", "Give one position for each time.")
        if self.periodic and len(self.time) < 4:
            raise fault(f"a periodic table of {len(self.time)} rows.", "Give at least four, the last one the end of the cycle.")
        return self


LawKey = Literal["zones", "speed", "oscillation", "segments", "table", "program"]
LAWS: tuple[LawKey, ...] = get_args(LawKey)
"""Keys that decide the motion of a drive: one of them, or zones beside the speed between them."""


class DriveDocument(DocumentTable):
    """A prescribed motion of a joint: exactly one of speed (with or without zones), oscillation, segments, table or program."""

    speed: Rate | None = None
    """Constant speed, the steady speed of zones, or what a signal multiplies; its sign is the direction. 0: the drive holds its
    joint."""
    start: StateDocument | None = None
    """Position at the start; for segments and programs also [position, velocity, acceleration, jerk]."""
    travel: Range | None = None
    """Distance of one cycle at constant speed. Default one turn; sliding joints must give it."""
    range: Reach | None = None
    """Instead of start and travel: [least, greatest] position of one cycle at constant speed. Or "reachable": as far as the
    mechanism can go and back from the start, with this speed in the middle; a full turn where it can."""
    sine: SineDocument | None = None
    """The speed is multiplied by a sine of time."""
    step: StepDocument | None = None
    """The speed is multiplied by a factor that jumps at a time."""
    ramp: RampDocument | None = None
    """The speed is multiplied by a factor that changes linearly between two times."""
    chirp: ChirpDocument | None = None
    """The speed is multiplied by a sine whose frequency changes with time."""
    duration: Duration | None = None
    """Time of one cycle of a speed with a signal. Default: a sine's period, a chirp's duration, or the run's."""
    zones: ZonesDocument | None = None
    """Start, steady running and stop over stated ranges."""
    oscillation: OscillationDocument | None = None
    """Harmonic motion."""
    segments: Annotated[list[TimeSegment], Field(min_length=1)] | None = None
    """Segments over time, one after the other."""
    table: DriveTable | None = None
    """Positions at given times."""
    program: ProgramDocument | None = None
    """Rises, dwells and returns over a master angle."""

    @property
    def signals(self) -> list[str]:
        """The signals by which the speed is multiplied: at most one in a valid drive."""
        return [key for key in SIGNALS if getattr(self, key) is not None]

    @property
    def law(self) -> LawKey:
        """The law that is given."""
        return self.laws[0]

    @property
    def laws(self) -> list[LawKey]:
        """The laws that are given: one in a valid drive."""
        laws = [law for law in LAWS if getattr(self, law) is not None]
        return [law for law in laws if law != "speed"] if "zones" in laws else laws

    @model_validator(mode="after")
    def _one_law(self) -> DriveDocument:
        laws, wrong = self.laws, []
        if not laws:
            if self.signals:
                raise fault(f"{self.signals[0]} without the speed that it multiplies.", "Add the speed, such as speed = '60 rpm'.")
            raise fault("the drive has no law of motion.", "Give speed, oscillation, segments, table or program.")
        if len(laws) > 1:
            wrong.append(("", f"the drive has {' and '.join(laws)} at once.", "Keep one law of motion."))
        if self.zones is not None and self.speed is None:
            wrong.append(("", "zones without a speed.", "Add the steady speed, such as speed = '60 rpm'."))
        if self.speed is not None and magnitude(self.speed) == 0.0 and self.range is not None:
            wrong.append(("range", "a range of a drive that stands still.", "Say where: start = ..., or give it a speed."))
        plain = ("start", *SIGNALS, "duration") if self.signals else ("start", "travel", "range")
        goes_with = {"speed": plain, "oscillation": (), "table": ()}
        allowed = {key for law in laws for key in goes_with.get(law, ("start",))}
        for key in ("start", "travel", "range", *SIGNALS, "duration"):
            if getattr(self, key) is not None and key not in allowed:
                words = " or ".join(self.signals if laws == ["speed"] and self.signals else laws)
                wrong.append((key, f"{key} does not go with {words}.", f"Leave out {key}."))
        if len(self.signals) > 1:
            wrong.append(("", f"the speed has {' and '.join(self.signals)} at once.", "Keep one signal."))
        if laws == ["speed"] and self.range == "reachable" and self.travel is not None:
            wrong.append(("travel", "travel of a drive that goes as far as it can.", "Keep travel or range."))
        if laws == ["speed"] and isinstance(self.range, list) and (self.start is not None or self.travel is not None):
            wrong.append(("range", "range together with start or travel: range says both.", "Keep one of them."))
        if isinstance(self.start, list) and not {"speed", "zones"}.isdisjoint(laws) and not {"segments", "program"} & set(laws):
            wrong.append(
                (
                    "start",
                    "a list: only segments and programs start with a velocity and an acceleration.",
                    "Give the position alone.",
                )
            )
        raise_faults(wrong)
        return self


Method = Literal["auto", "energy", "gauss", "radau"]
TOLERANCE = 1e-9
"""Tolerance of motions under forces where the scene states none."""


def _restitution(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
        remedy = "Give a number from 0 (it stays there) to 1 (it loses nothing)."
        raise fault(f"{describe(value)} is no coefficient of restitution.", remedy)
    return float(value)


def _tolerance(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1e-14 <= value <= 0.1:
        raise fault(f"{describe(value)} is no tolerance.", "Give a number from 1e-14 to 0.1, such as 1e-9.")
    return float(value)


Restitution = Annotated[float, PlainValidator(_restitution), WithJsonSchema({"type": "number", "minimum": 0, "maximum": 1})]
Tolerance = Annotated[float, PlainValidator(_tolerance), WithJsonSchema({"type": "number", "minimum": 1e-14, "maximum": 0.1})]
Level = Annotated[float | str, QuantityMark(("angle", "length", "angular speed", "linear speed"))]


class FreeDocument(DocumentTable):
    """A free coordinate: forces decide its motion. This is its start."""

    position: Coordinate | None = None
    """Position at the start. Default: as drawn, or 0."""
    speed: Rate = 0.0
    """Speed at the start."""
    x: Length | None = None
    """Planar joint: place of the second link's point in the first link's frame at the start. Default: as drawn, or 0."""
    y: Length | None = None
    """Planar joint: the same along y."""
    angle: Angle | None = None
    """Planar joint: angle from the first link's frame to the second's at the start. Default: as drawn, or 0."""
    vx: Speed = 0.0
    """Planar joint: rate of x at the start."""
    vy: Speed = 0.0
    """Planar joint: rate of y at the start."""
    omega: AngularSpeed = 0.0
    """Planar joint: rate of the angle at the start."""

    def foreign_keys(self, planar: bool) -> list[str]:
        """Stated keys that do not belong to the start of this kind of joint: ``planar``, or any other."""
        own = {"x", "y", "angle", "vx", "vy", "omega"}
        return sorted(self.model_fields_set - own if planar else self.model_fields_set & own)


class StopDocument(DocumentTable):
    """An end stop of a joint, which its coordinate cannot pass."""

    at: Coordinate
    """Position of the stop."""
    side: Literal["upper", "lower"]
    """"upper": the coordinate stays below it; "lower": above it."""
    restitution: Restitution = 0.0
    """Newton's coefficient of restitution: speed after the impact over that before. Default 0: it stays there."""
    name: Name | None = None
    """Its name in events and loads. Default: the joint's name and the side."""


class LiftoffDocument(DocumentTable):
    """A follower that is only pressed on its cam may leave it."""

    restitution: Restitution = 0.0
    """Newton's coefficient of restitution when it comes back: speed after the impact over that before. Default 0: it stays."""


class WatchDocument(DocumentTable):
    """A value to watch in a motion under forces: an event where it is passed, and optionally the end of the run."""

    joint: Annotated[Text, Reference("joint")] | None = None
    """The joint whose position or velocity is watched. Give this or point."""
    point: PointName | None = None
    """The point, "link.point", whose x or y is watched."""
    of: Literal["position", "velocity", "x", "y"] | None = None
    """The quantity that is watched: "position" (default) or "velocity" of a joint, "x" (default) or "y" of a point."""
    at: Level = 0.0
    """The value."""
    rising: Flag | None = None
    """true or false: only where it is passed upwards or downwards. Default: both ways."""
    ends: Flag = False
    """Whether the motion ends there."""

    @model_validator(mode="after")
    def _one_thing(self) -> WatchDocument:
        wrong = []
        if (self.joint is None) == (self.point is None):
            what = "neither a joint nor a point" if self.joint is None else "a joint and a point at once"
            wrong.append(("", f"{what} to watch.", 'Give one of them, such as joint = "A".'))
        elif self.of is not None and (self.of in ("x", "y")) != (self.point is not None):
            expected = '"x" or "y"' if self.point is not None else '"position" or "velocity"'
            wrong.append(("of", f"'{self.of}' of a {'point' if self.point is not None else 'joint'}.", f"Write {expected}."))
        raise_faults(wrong)
        return self

    @property
    def what(self) -> Literal["position", "velocity", "x", "y"]:
        return self.of or ("position" if self.point is None else "x")
