"""The part of the scene document that prescribes motions: drives."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from mechviz.scene.fields import (
    Angle,
    Coordinate,
    Duration,
    Flag,
    Frequency,
    Range,
    Rate,
    Table,
    Time,
    fault,
    one_of,
    refuse,
    value_or_list,
)
from mechviz.scene.kinds.programs import ProgramDocument
from mechviz.scene.kinds.segments import State, TimeSegment
from mechviz.scene.kinds.signals import SIGNALS, ChirpDocument, RampDocument, SineDocument, StepDocument
from mechviz.scene.units import magnitude

Reach = Annotated[
    Annotated[Literal["reachable"], Tag("<value>")]
    | Annotated[Annotated[list[Coordinate], Field(min_length=2, max_length=2)], Tag("<list>")],
    Discriminator(value_or_list),
]


class ZonesDocument(Table):
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


class OscillationDocument(Table):
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
        refuse(one_of(self, ("frequency", "period"), "the oscillation"))
        return self


class DriveTable(Table):
    """A motion given point by point, joined by a quintic spline."""

    time: Annotated[list[Time], Field(min_length=2)]
    """Increasing times."""
    position: Annotated[list[Coordinate], Field(min_length=2)]
    """Positions at these times."""
    periodic: Flag = False
    """The last row is the end of the cycle, which continues smoothly into the next."""

    @model_validator(mode="after")
    def _same_length(self) -> DriveTable:
        if not self.sound("time", "position"):
            return self
        if len(self.position) != len(self.time):
            raise fault(f"{len(self.time)} times and {len(self.position)} positions.", "Give one position for each time.")
        if self.periodic and len(self.time) < 4:
            raise fault(f"a periodic table of {len(self.time)} rows.", "Give at least four, the last one the end of the cycle.")
        return self


class DriveDocument(Table):
    """A prescribed motion of a joint: exactly one of speed (with or without zones), oscillation, segments, table or program."""

    speed: Rate | None = None
    """Constant speed, the steady speed of zones, or what a signal multiplies; its sign is the direction. 0: the drive holds its
    joint."""
    start: State | None = None
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
    """The speed is multiplied by a factor that changes evenly between two times."""
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
        """The signals by which the speed is multiplied: one at most, in a drive that is not faulty."""
        return [key for key in SIGNALS if getattr(self, key) is not None]

    @property
    def law(self) -> Literal["speed", "zones", "oscillation", "segments", "table", "program"]:
        """The law that is given."""
        return self.laws[0]

    @property
    def laws(self) -> list[Any]:
        """The laws that are given: one, in a drive that is not faulty."""
        laws = [law for law in ("zones", "speed", "oscillation", "segments", "table", "program") if getattr(self, law) is not None]
        return [law for law in laws if law != "speed"] if "zones" in laws else laws

    @model_validator(mode="after")
    def _one_law(self) -> DriveDocument:
        laws, found = self.laws, []
        if not laws:
            if self.signals:
                raise fault(f"{self.signals[0]} without the speed that it multiplies.", "Add the speed, such as speed = '60 rpm'.")
            raise fault("the drive has no law of motion.", "Give speed, oscillation, segments, table or program.")
        if len(laws) > 1:
            found.append(("", f"the drive has {' and '.join(laws)} at once.", "Keep one law of motion."))
        if self.zones is not None and self.speed is None:
            found.append(("", "zones without a speed.", "Add the steady speed, such as speed = '60 rpm'."))
        if self.speed is not None and magnitude(self.speed) == 0.0 and self.range is not None:
            found.append(("range", "a range of a drive that stands still.", "Say where: start = ..., or give it a speed."))
        plain = ("start", *SIGNALS, "duration") if self.signals else ("start", "travel", "range")
        goes_with = {"speed": plain, "oscillation": (), "table": ()}
        allowed = {key for law in laws for key in goes_with.get(law, ("start",))}
        for key in ("start", "travel", "range", *SIGNALS, "duration"):
            if getattr(self, key) is not None and key not in allowed:
                words = " or ".join(self.signals if laws == ["speed"] and self.signals else laws)
                found.append((key, f"{key} does not go with {words}.", f"Leave out {key}."))
        if len(self.signals) > 1:
            found.append(("", f"the speed has {' and '.join(self.signals)} at once.", "Keep one signal."))
        if laws == ["speed"] and self.range == "reachable" and self.travel is not None:
            found.append(("travel", "travel of a drive that goes as far as it can.", "Keep travel or range."))
        if laws == ["speed"] and isinstance(self.range, list) and (self.start is not None or self.travel is not None):
            found.append(("range", "range together with start or travel: range says both.", "Keep one of them."))
        if isinstance(self.start, list) and not {"speed", "zones"}.isdisjoint(laws) and not {"segments", "program"} & set(laws):
            found.append(
                (
                    "start",
                    "a list: only segments and programs start with a velocity and an acceleration.",
                    "Give the position alone.",
                )
            )
        refuse(found)
        return self
