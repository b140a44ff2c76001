"""Drives that follow a master angle by a program of rises, dwells and returns: the document and the law."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from mechcore.errors import MechanismError
from mechcore.laws.catalogue import rise
from mechcore.laws.curve import MotionCurve
from mechcore.laws.program import Follow, Segment, program
from mechcore.laws.timed import ConstantSpeed, Law, Rest, moves
from mechviz.scene.fields import Angle, Coordinate, Flag, Number, Quantity, Rate, Table, Text, Unknown, one_of, refuse

if TYPE_CHECKING:
    from mechviz.scene.convert import Converter


Turn = Annotated[float | str, Quantity(("angle",), "above zero")]


class ProgramSegment(Table):
    """A rise, return or dwell over a range of the master angle."""

    over: Turn
    """Range of the master angle."""
    to: Coordinate | None = None
    """Position at its end; without it a dwell."""
    law: Text = "cycloidal"
    """Law of motion, one of those that `mechviz laws` lists."""
    parameters: dict[Text, Number] = Field(default_factory=dict)
    """Parameters of the law, such as { skew = 0.4 }."""
    mirrored: Flag = False
    """Run the law with acceleration and deceleration exchanged."""

    @model_validator(mode="after")
    def _known_law(self) -> ProgramSegment:
        try:
            if self.sound("law", "parameters"):
                self.shape()
        except MechanismError as error:
            refuse([("law" if f.path == "law" else "parameters", f.message, f.remedy) for f in error.faults])
        if self.to is None and "law" in self.model_fields_set:
            refuse([("law", "a law for a dwell, which says no end.", "Add to = ..., or leave out the law.")])
        return self

    def shape(self) -> MotionCurve:
        """The law, 0 -> 1 over 0 -> 1. Raises ``MechanismError`` for an unknown one."""
        return rise(self.law, **self.parameters)


class ProgramDocument(Table):
    """A motion program over a master angle; several drives may follow one master."""

    speed: Rate | None = None
    """Speed of a master shaft of its own. Give this or master."""
    master: Text | None = None
    """The driven revolute pair whose angle is the master. Give this or speed."""
    phase: Angle = 0.0
    """Added to the master angle: the program runs earlier by this much."""
    segments: Annotated[list[ProgramSegment], Field(min_length=1)]
    """Segments one after the other; the program repeats after their total range."""

    @model_validator(mode="after")
    def _one_master(self) -> ProgramDocument:
        refuse(one_of(self, ("speed", "master"), "the program"))
        return self


def program_law(
    given: ProgramDocument,
    start: float,
    position: Callable[[float | str, str], float],
    convert: Converter,
    path: str,
    masters: Mapping[str, Law | None],
) -> Law | None:
    """The law of a drive with a program, None where a fault was noted. ``position`` turns coordinates into SI."""
    before = len(convert.faults)
    master: Law | None
    if given.master is not None:
        master = masters.get(given.master)  # None also where the master's own law is faulty
        if given.master not in masters and not isinstance(given.master, Unknown):
            convert.note(
                f"{path}.program.master",
                f"'{given.master}' is no driven revolute pair with a law of its own.",
                f"Name one of {', '.join(masters)}." if masters else "Give speed = ... instead.",
            )
    else:
        speed = math.nan if given.speed is None else convert.si(given.speed, "angular speed", f"{path}.program.speed")
        master = ConstantSpeed(start=0.0, speed=speed)
    overs = [convert.si(s.over, "angle", f"{path}.program.segments[{k}].over") for k, s in enumerate(given.segments)]
    ends = [None if s.to is None else position(s.to, f"program.segments[{k}].to") for k, s in enumerate(given.segments)]
    phase = convert.si(given.phase, "angle", f"{path}.program.phase")
    known = not any(math.isnan(value) for value in (*overs, *(end or 0.0 for end in ends), phase, start))
    sound = known and given.sound(*ProgramDocument.model_fields) and not any(s.unread for s in given.segments)
    if len(convert.faults) > before or master is None or not sound:
        return None
    rows = zip(given.segments, overs, ends, strict=True)
    try:
        segments = [Segment(over=over, to=end, law=s.shape(), mirrored=s.mirrored) for s, over, end in rows]
    except MechanismError:  # an unknown law, noted where the segment was read
        return None
    law = Follow(curve=program(segments, start), master=master, phase=phase)
    if moves(master) and any(segment.to not in (None, start) for segment in segments):
        return law
    return Rest(float(law(0.0)[0]), lasts=law.duration if moves(master) else 0.0)
