"""Drives that follow a master angle by a program of rises, dwells and returns: the document and the law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from mechcore.laws.program import Follow, over_time
from mechcore.laws.timed import ConstantSpeed, Law, Rest, moves
from mechviz.scene.fields import Angle, Rate, Table, Text, Unknown, one_of, refuse
from mechviz.scene.kinds.segment_curves import Axes, segments_curve, stands_still
from mechviz.scene.kinds.segments import ProgramSegment

if TYPE_CHECKING:
    from mechviz.scene.convert import Converter
    from mechviz.scene.kinds.drives import DriveDocument


class ProgramDocument(Table):
    """A motion program over a master angle; several drives may follow one master."""

    speed: Rate | None = None
    """Speed of a master shaft of its own. Give this, master or knots."""
    master: Text | None = None
    """The driven revolute joint whose angle is the master. Give this, speed or knots."""
    knots: Text | None = None
    """The driven joint whose segments, over time or a master angle, give their ranges to this program too: axes in step."""
    phase: Angle = 0.0
    """Added to the master angle: the program runs earlier by this much."""
    segments: Annotated[list[ProgramSegment], Field(min_length=1)]
    """Segments one after the other; the program repeats after their total range."""

    @model_validator(mode="after")
    def _one_master(self) -> ProgramDocument:
        found = one_of(self, ("speed", "master", "knots"), "the program")
        if not found and self.knots is not None and "phase" in self.model_fields_set:
            found.append(("phase", "a phase beside the knots of another axis.", "Leave it out, or state it there."))
        refuse(found)
        return self


def program_law(
    drive: DriveDocument,
    coordinate: str,
    convert: Converter,
    path: str,
    drawn: float,
    masters: Mapping[str, Law | None],
    drives: Mapping[str, DriveDocument],
) -> Law | None:
    """The law of a drive with a program, None where a fault was noted. ``coordinate``: "angle" or "length"; ``drawn``: where the
    drive starts that does not say it [rad or m]; ``masters``, ``drives``: what a program may follow and take its knots from."""
    given = drive.program
    assert given is not None
    before = len(convert.faults)
    source: ProgramDocument | None = given
    aside = convert
    if given.knots is not None:
        other = _other(given.knots, drives, convert, f"{path}.program.knots")
        if other is None:
            return None
        source, aside = other.program, replace(convert, faults=[])  # what is wrong with the other drive is noted there
        ranges: list[float | str | None] = [s.duration for s in other.segments or ()]
    if source is not None:
        ranges = [s.over for s in source.segments]
    kind = "time" if source is None else "angle"
    where = f"{path}.program.segments"
    for k, segment in enumerate(given.segments):
        if given.knots is None and segment.over is None and segment.sound("over"):
            convert.note(f"{where}[{k}]", "'over' is missing.", "Add over, the range of the master angle.")
        elif given.knots is not None and segment.over is not None:
            convert.note(f"{where}[{k}].over", "a range beside the knots of another axis.", "Leave it out.")
    overs = [math.nan if v is None else aside.si(v, kind, f"{where}[{k}].over") for k, v in enumerate(ranges)]
    if len(overs) != len(given.segments):
        why = f"{len(given.segments)} segments, but {len(overs)} of '{given.knots}'."
        convert.note(where, why, "Give one for each of them.")
        return None
    master = ConstantSpeed(0.0, 1.0) if source is None else _master(source, aside, path, masters)
    phase = 0.0 if source is None else aside.si(source.phase, "angle", f"{path}.program.phase")
    axes = Axes(convert, coordinate, kind)
    start = (drawn,) if drive.start is None else axes.state(drive.start, f"{path}.start")
    curve = segments_curve(given.segments, overs, axes, where, start, repeats=source is not None)
    sound = given.sound(*ProgramDocument.model_fields) and not math.isnan(phase)
    if len(convert.faults) > before or master is None or curve is None or not sound:
        return None
    law = over_time(curve) if source is None else Follow(curve=curve, master=master, phase=phase)
    if moves(master) and not stands_still(given.segments, curve):
        return law
    return Rest(float(law(0.0)[0]), lasts=law.duration if moves(master) else 0.0)


def _other(name: str, drives: Mapping[str, DriveDocument], convert: Converter, path: str) -> DriveDocument | None:
    """The drive whose segments give the knots; None where there is none, which is noted."""
    able = {k: d for k, d in drives.items() if d.segments is not None or (d.program is not None and d.program.knots is None)}
    if name not in able and not isinstance(name, Unknown):
        why = f"'{name}' is no driven joint with segments of its own."
        convert.note(path, why, f"Name one of {', '.join(able)}." if able else "Give speed = ... or master = ... instead.")
    return able.get(name)


def _master(given: ProgramDocument, convert: Converter, path: str, masters: Mapping[str, Law | None]) -> Law | None:
    if given.master is None:
        speed = math.nan if given.speed is None else convert.si(given.speed, "angular speed", f"{path}.program.speed")
        return None if math.isnan(speed) else ConstantSpeed(start=0.0, speed=speed)
    if given.master not in masters and not isinstance(given.master, Unknown):
        convert.note(
            f"{path}.program.master",
            f"'{given.master}' is no driven revolute joint with a law of its own.",
            f"Name one of {', '.join(masters)}." if masters else "Give speed = ... instead.",
        )
    return masters.get(given.master)  # None also where the master's own law is faulty
