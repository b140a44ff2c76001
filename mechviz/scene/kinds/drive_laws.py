"""Drives of a scene -> laws of motion in SI units."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from mechcore.errors import Fault
from mechcore.laws.course import early_end_faults, velocity_jump_faults
from mechcore.laws.program import CurveOverMaster, over_time
from mechcore.laws.signals import SignalSpeed, Step
from mechcore.laws.timed import ConstantSpeed, Law, Oscillation, Rest, TableLaw, moves, zones
from mechviz.scene.convert import SMALLEST_VALUE, Converter
from mechviz.scene.fields import UnknownName
from mechviz.scene.kinds.drives import DriveDocument
from mechviz.scene.kinds.segment_curves import Axes, is_at_rest, segments_curve
from mechviz.scene.kinds.segments import ProgramDocument
from mechviz.scene.kinds.signals import signal_of
from mechviz.scene.units import magnitude


class _Coordinate:
    """Positions, speeds and accelerations of a driven joint: angles of a revolute one, lengths of a prismatic one."""

    def __init__(self, convert: Converter, coordinate_kind: str, path: str):
        self.convert, self.path = convert, path
        self.kinds = (
            (coordinate_kind, "angular speed", "angular acceleration")
            if coordinate_kind == "angle"
            else (coordinate_kind, "linear speed", "linear acceleration")
        )

    def position(self, value: float | str, key: str) -> float:
        return self.convert.si(value, self.kinds[0], f"{self.path}.{key}")

    def distance(self, value: float | str, key: str) -> float:
        """A range of positions. Speeds are divided by it, so that a tiny one is a fault."""
        number = self.position(value, key)
        if number < SMALLEST_VALUE and magnitude(value) != 0.0:
            self.convert.note(f"{self.path}.{key}", f"{number:g} is too short a way.", "Check the number and its unit.")
        return number

    def speed(self, value: float | str, key: str) -> float:
        return self.convert.si(value, self.kinds[1], f"{self.path}.{key}")


def law_of(
    drive: DriveDocument,
    coordinate_kind: str,
    convert: Converter,
    path: str,
    *,
    drawn: float = 0.0,
    cycles: int = 1,
    run_duration: float | None = None,
    masters: Mapping[str, Law | None] | None = None,
    drives: Mapping[str, DriveDocument] | None = None,
) -> Law | None:
    """The law of a drive, None where a fault was noted.

    ``coordinate_kind`` is "angle" or "length"; ``drawn`` is the initial position [rad or m] of a drive that states none;
    ``run_duration`` is the stated duration of the run [s], if any; ``masters`` are the laws of the driven revolute joints that a
    program may follow, ``drives`` all driven joints, from which it may take its knots.
    """
    coordinate = _Coordinate(convert, coordinate_kind, path)
    before = len(convert.faults)
    make = {"speed": _constant, "zones": _zones, "oscillation": _oscillation, "segments": _segments, "table": _table}
    signals = drive.signals if drive.laws == ["speed"] else []
    made = [make[law](drive, coordinate, drawn, cycles) for law in drive.laws if law != "program" and not signals]
    made += [_signalled(drive, key, coordinate, drawn, cycles, run_duration) for key in signals]
    if drive.program is not None:
        made.append(_program(drive, coordinate_kind, convert, path, drawn, masters or {}, drives or {}))
    return made[0] if len(made) == 1 and len(convert.faults) == before else None


def _start(drive: DriveDocument, coordinate: _Coordinate, drawn: float) -> float:
    """The initial position of the drive [rad or m]: stated, the first entry of a stated state, or as drawn."""
    if drive.start is None:
        return drawn
    given = drive.start[:1] if isinstance(drive.start, list) else [drive.start]
    return coordinate.position(given[0], "start") if given else math.nan


def _constant(drive: DriveDocument, coordinate: _Coordinate, drawn: float, cycles: int) -> Law | None:
    assert drive.speed is not None
    speed = coordinate.speed(drive.speed, "speed")
    if isinstance(drive.range, list):
        if drive.start is not None:  # stated twice, which is noted already; its unit is checked, too
            _start(drive, coordinate, drawn)
        if drive.travel is not None:
            coordinate.distance(drive.travel, "travel")
        least, greatest = (coordinate.position(value, f"range[{k}]") for k, value in enumerate(drive.range))
        if least >= greatest:
            coordinate.convert.note(
                f"{coordinate.path}.range",
                "the first value is not the smaller one.",
                "Write [least, greatest]; the sign of the speed is the direction.",
            )
        if cycles > 1:
            coordinate.convert.note(
                "run.cycles", f"{cycles} cycles of a motion that ends at the end of its range.", "Write cycles = 1."
            )
        if any(map(math.isnan, (speed, least, greatest))):
            return None
        return ConstantSpeed(start=least if speed > 0 else greatest, speed=speed, travel=greatest - least, ends=True)
    start = _start(drive, coordinate, drawn)
    if drive.travel is not None:
        travel = coordinate.distance(drive.travel, "travel")
        if any(map(math.isnan, (start, speed, travel))):
            return None
        return ConstantSpeed(start=start, speed=speed, travel=travel) if speed * travel else Rest(start)
    if speed == 0.0 and not math.isnan(start):
        return Rest(start)
    if coordinate.kinds[0] == "length" and drive.range is None:
        coordinate.convert.note(
            coordinate.path,
            "constant speed along a guide without saying how far.",
            'Add travel = ... (a length), range = [least, greatest] or range = "reachable".',
        )
        return None
    return None if math.isnan(start) or math.isnan(speed) else ConstantSpeed(start=start, speed=speed)


def _signalled(
    drive: DriveDocument, key: str, coordinate: _Coordinate, drawn: float, cycles: int, run_duration: float | None
) -> Law | None:
    """A speed that a signal multiplies."""
    assert drive.speed is not None
    convert, path = coordinate.convert, coordinate.path
    speed, start = coordinate.speed(drive.speed, "speed"), _start(drive, coordinate, drawn)
    signal = signal_of(key, getattr(drive, key), convert, f"{path}.{key}")
    stated = None if drive.duration is None else convert.si(drive.duration, "time", f"{path}.duration")
    if signal is None or any(map(math.isnan, (speed, start, 0.0 if stated is None else stated))):
        return None
    own = {"sine": lambda s: 1.0 / s.frequency, "chirp": lambda s: s.duration}.get(key)
    duration = stated if stated is not None else run_duration if run_duration is not None or own is None else own(signal)
    if duration is None:
        why = f"a speed with a {key}, without saying how long a cycle lasts."
        convert.note(path, why, "Add duration = ... (a time).")
        return None
    if cycles > 1 and key != "sine":
        convert.note("run.cycles", f"{cycles} cycles of a {key}, which does not repeat.", f"Write cycles = 1, and {path}.duration.")
    if speed == 0.0:
        return Rest(start, cycle=duration)
    return SignalSpeed(start=start, speed=speed, signal=signal, duration=max(duration, run_duration or 0.0))


def _zones(drive: DriveDocument, coordinate: _Coordinate, drawn: float, cycles: int) -> Law | None:
    assert drive.zones is not None
    run_up, steady, braking = (
        coordinate.distance(value, f"zones.{key}")
        for key, value in (
            ("run_up", drive.zones.run_up),
            ("steady", drive.zones.steady),
            ("braking", drive.zones.braking),
        )
    )
    start = _start(drive, coordinate, drawn)
    speed = math.nan if drive.speed is None else coordinate.speed(drive.speed, "speed")
    if any(map(math.isnan, (run_up, steady, braking, start, speed))) or not any((run_up, steady, braking)):
        return None
    if speed == 0.0:
        return Rest(start)
    if cycles > 1 and (run_up > 0.0) != (braking > 0.0):
        coordinate.convert.note(
            "run.cycles",
            f"{cycles} cycles would make the speed jump between them.",
            "Write cycles = 1, or give both run_up and braking.",
        )
    return zones(start=start, speed=speed, run_up=run_up, steady=steady, braking=braking)


def _oscillation(drive: DriveDocument, coordinate: _Coordinate, drawn: float, cycles: int) -> Law | None:
    given = drive.oscillation
    assert given is not None
    convert, path = coordinate.convert, coordinate.path
    frequency = math.nan
    if given.period is not None:
        frequency = 1.0 / convert.si(given.period, "time", f"{path}.oscillation.period")
    if given.frequency is not None:
        frequency = convert.si(given.frequency, "frequency", f"{path}.oscillation.frequency")
    centre = coordinate.position(given.centre, "oscillation.centre")
    amplitude = coordinate.position(given.amplitude, "oscillation.amplitude")
    phase = convert.si(given.phase, "angle", f"{path}.oscillation.phase")
    if any(map(math.isnan, (frequency, centre, amplitude, phase))):
        return None
    if amplitude == 0.0:
        return Rest(centre, cycle=1.0 / frequency)
    return Oscillation(centre=centre, amplitude=amplitude, frequency=frequency, phase=phase)


def _segments(drive: DriveDocument, coordinate: _Coordinate, drawn: float, cycles: int) -> Law | None:
    assert drive.segments is not None
    convert, path = coordinate.convert, coordinate.path
    durations = [convert.si(segment.duration, "time", f"{path}.segments[{k}].duration") for k, segment in enumerate(drive.segments)]
    axes = Axes(convert, coordinate.kinds[0], "time")
    start = (drawn,) if drive.start is None else axes.state(drive.start, f"{path}.start")
    curve = segments_curve(drive.segments, durations, axes, f"{path}.segments", start, repeats=False)
    if curve is None or not drive.has_valid("segments"):
        return None
    left, right = curve.limits(1)
    if cycles > 1 and abs(left[-1, 1] - right[0, 1]) > 1e-9 * np.abs(np.vstack([left, right])[:, 1]).max():
        convert.note(
            "run.cycles",
            f"{cycles} cycles would make the speed jump between them.",
            f"Write cycles = 1, or end {path} with the speed that it starts with.",
        )
    if is_at_rest(drive.segments, curve):
        return Rest(float(right[0, 0]), cycle=sum(durations))
    return over_time(curve)


def _table(drive: DriveDocument, coordinate: _Coordinate, drawn: float, cycles: int) -> Law | None:
    given = drive.table
    assert given is not None
    convert, path = coordinate.convert, coordinate.path
    times = convert.row(given.time, "time", f"{path}.table.time")
    positions = tuple(coordinate.position(value, f"table.position[{k}]") for k, value in enumerate(given.position))
    if cycles > 1 and not given.periodic:
        convert.note(
            "run.cycles",
            f"{cycles} cycles of a table that does not repeat.",
            "Write cycles = 1, or periodic = true in the table.",
        )
    increasing = convert.increasing(times, f"{path}.table.time")
    if not given.has_valid("time", "position") or any(map(math.isnan, positions)):
        return None
    if not increasing or len(times) != len(positions) or (given.periodic and len(times) < 4):
        return None
    if len(set(positions)) == 1:
        return Rest(positions[0], cycle=times[-1] - times[0])
    try:
        return TableLaw(t=times, q=positions, periodic=given.periodic)
    except ValueError:  # the spline's equations are singular
        convert.note(f"{path}.table.time", "the rows are too close to each other.", "Leave out some of them.")
        return None


def _program(
    drive: DriveDocument,
    coordinate: str,
    convert: Converter,
    path: str,
    drawn: float,
    masters: Mapping[str, Law | None],
    drives: Mapping[str, DriveDocument],
) -> Law | None:
    """The law of a drive with a program, None where a fault was noted. ``coordinate``: "angle" or "length"; ``drawn``: initial
    position of a drive that states none [rad or m]; ``masters``, ``drives``: what a program may follow and take its knots from."""
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
        if given.knots is None and segment.over is None and segment.has_valid("over"):
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
    valid = given.has_valid(*ProgramDocument.model_fields) and not math.isnan(phase)
    if len(convert.faults) > before or master is None or curve is None or not valid:
        return None
    law = over_time(curve) if source is None else CurveOverMaster(curve=curve, master=master, phase=phase)
    if moves(master) and not is_at_rest(given.segments, curve):
        return law
    return Rest(float(law(0.0)[0]), cycle=law.duration if moves(master) else 0.0)


def _other(name: str, drives: Mapping[str, DriveDocument], convert: Converter, path: str) -> DriveDocument | None:
    """The drive whose segments give the knots; None where there is none, which is noted unless its name could not be read."""
    able = {k: d for k, d in drives.items() if d.segments is not None or (d.program is not None and d.program.knots is None)}
    if name not in able and not isinstance(name, UnknownName):
        why = f"'{name}' is no driven joint with segments of its own."
        convert.note(path, why, f"Name one of {', '.join(able)}." if able else "Give speed = ... or master = ... instead.")
    return able.get(name)


def _master(given: ProgramDocument, convert: Converter, path: str, masters: Mapping[str, Law | None]) -> Law | None:
    if given.master is None:
        speed = math.nan if given.speed is None else convert.si(given.speed, "angular speed", f"{path}.program.speed")
        return None if math.isnan(speed) else ConstantSpeed(start=0.0, speed=speed)
    if given.master not in masters and not isinstance(given.master, UnknownName):
        convert.note(
            f"{path}.program.master",
            f"'{given.master}' is no driven revolute joint with a law of its own.",
            f"Name one of {', '.join(masters)}." if masters else "Give speed = ... instead.",
        )
    return masters.get(given.master)  # None also where the master's own law is faulty


def laws_under_forces(laws: Mapping[str, Law], run_duration: float | None) -> Iterator[Fault]:
    """Faults of drives beside free joints: laws whose speed jumps, since the jump would be an impact on these, and laws that end
    before the run. ``run_duration``: duration of the run [s], None where it is not known."""
    others = {}
    for name, law in laws.items():
        if isinstance(law, SignalSpeed) and isinstance(law.signal, Step) and law.breaks:
            why = "the speed jumps: beside free joints it would be an impact."
            yield Fault(f"joints.{name}.drive.step", why, "Write ramp = { begin = ..., end = ... }, however short.")
        else:
            others[f"joints.{name}.drive"] = law
    if run_duration is not None:
        yield from early_end_faults(others, run_duration)
        yield from velocity_jump_faults(others, run_duration)
