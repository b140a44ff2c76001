"""Motions that a scene does not prescribe: motions under forces, with starts, stops and watched events in SI units and their
faults; and drives that oscillate between the limits of the mechanism, ``range = "reachable"``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.constants import TURN
from mechcore.dynamics.events import EndStop, EventTrigger, SeparableCam
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.build import build_model
from mechcore.laws.timed import ConstantSpeed, Free, Law, Oscillation, Rest, moves
from mechcore.motion.compiled import Compiled
from mechcore.motion.reach import nearest_range, reachable_ranges
from mechcore.motion.solve import compile_mechanism
from mechcore.records import dataclass
from mechcore.spec.mechanism import Drive, Mechanism
from mechviz.scene.convert import Converter
from mechviz.scene.document import SceneDocument
from mechviz.scene.fields import (
    UnknownName,
)
from mechviz.scene.kinds.drives import TOLERANCE, DriveDocument, FreeDocument, Method, StopDocument
from mechviz.scene.kinds.friction import clearance_faults
from mechviz.scene.reading.recovery import Reading
from mechviz.scene.units import magnitude

if TYPE_CHECKING:
    from mechviz.scene.scene import Scene

_NEEDS_DRIVE = ("velocity_ratio", "mechanical_advantage")
_STUDIES = (
    "polygons", "centrodes", "equivalent", "reduced", "shaking", "instant_centres", "evolutes", "inflection", "percussion",
    "inversion", "systems", "substitutes",
)  # fmt: skip
_ADD_FREE = 'Leave it out, or let forces move a joint: free = { speed = "10 rpm" } instead of its drive.'


@dataclass(frozen=True, eq=False)
class SimulationSpec:
    """Settings of the simulation of the free coordinates, in SI units."""

    duration: float
    tolerance: float
    method: Method
    stops: tuple[EndStop, ...]
    triggers: tuple[EventTrigger, ...]
    separable_cams: tuple[SeparableCam, ...] = ()
    steady: int | None = None  # turns of the steady cycle in which the run starts; then a duration of NaN is one cycle


def stop_name(joint: str, stop: StopDocument) -> str:
    """The name of a stop of a joint in events and loads."""
    return stop.name or f"{joint} {stop.side}"


def _rate_kind(coordinate_kind: str) -> str:
    return "angular speed" if coordinate_kind == "angle" else "linear speed"


def free_law(given: FreeDocument, coordinate_kind: str, convert: Converter, path: str, *, drawn: float) -> Free | None:
    """Start of a free coordinate, None where a fault was noted. ``drawn``: the position where none is stated [rad or m]."""
    start = drawn if given.position is None else convert.si(given.position, coordinate_kind, f"{path}.position")
    speed = convert.si(given.speed, _rate_kind(coordinate_kind), f"{path}.speed")
    return None if math.isnan(start) or math.isnan(speed) else Free(start, speed)


def planar_starts(
    given: FreeDocument, names: tuple[str, str, str], convert: Converter, path: str, *, drawn: tuple[float, float, float]
) -> dict[str, Free]:
    """Starts of the coordinates x, y and angle of a planar joint by their ``names``; ``drawn``: the positions where none are stated
    [m, m, rad]. A coordinate whose values have a fault, which is noted, is missing."""
    starts = {}
    for name, key, rate, place in zip(names, ("x", "y", "angle"), ("vx", "vy", "omega"), drawn, strict=True):
        kind = "angle" if key == "angle" else "length"
        start = place if getattr(given, key) is None else convert.si(getattr(given, key), kind, f"{path}.{key}")
        speed = convert.si(getattr(given, rate), _rate_kind(kind), f"{path}.{rate}")
        if not (math.isnan(start) or math.isnan(speed)):
            starts[name] = Free(start, speed)
    return starts


def simulation_spec(
    document: SceneDocument,
    starts: Mapping[str, Free],
    convert: Converter,
    points: Mapping[str, tuple[str, str]],
) -> SimulationSpec | None:
    """Arguments of `mechcore.dynamics.simulate`; None where no coordinate is free. ``points``: watched texts -> link and point."""
    if not starts and not any(entry.liftoff or entry.clearance for entry in document.joints.values()):
        return None
    separable_cams = tuple(
        SeparableCam(joint=name, restitution=entry.liftoff.restitution)
        for name, entry in document.joints.items()
        if entry.liftoff is not None
    )

    stops, triggers = [], []
    for joint, entry in document.joints.items():
        for k, s in enumerate(entry.stops):
            path = f"joints.{joint}.stops[{k}]"
            at = convert.si(s.at, entry.coordinate, f"{path}.at")
            start = starts.get(joint)
            if start is not None and (start.start > at if s.side == "upper" else start.start < at):
                beyond = "above" if s.side == "upper" else "below"
                why = f"the motion starts {beyond} this {s.side} stop."
                convert.note(f"{path}.at", why, "Start on the other side, or move the stop.")
            stops.append(EndStop(name=stop_name(joint, s), joint=joint, at=at, side=s.side, restitution=s.restitution))
    for name, w in document.watch.items():
        coordinate_kind = "length"
        if w.joint is not None and w.joint in document.joints:
            coordinate_kind = document.joints[w.joint].coordinate
        kind = _rate_kind(coordinate_kind) if w.what == "velocity" else coordinate_kind
        at = convert.si(w.at, kind, f"watch.{name}.at")
        point = None if w.point is None else points.get(w.point)
        triggers.append(EventTrigger(name=name, of=w.what, joint=w.joint, point=point, at=at, rising=w.rising, ends=w.ends))
    run = document.run
    duration = math.nan if run.duration is None else _duration(document, convert)
    tolerance = TOLERANCE if run.tolerance is None else run.tolerance
    return SimulationSpec(duration, tolerance, run.method or "auto", tuple(stops), tuple(triggers), separable_cams, run.steady)


def standstill(document: SceneDocument, laws: Iterable[Law], convert: Converter) -> float:
    """Duration [s] of the run of a mechanism whose prescribed drives all stand still: the stated one, else the longest that their
    laws state, 0 where none does."""
    laws = tuple(laws)
    if document.run.duration is None:
        return max((law.cycle for law in laws if isinstance(law, Rest)), default=0.0)
    if any(map(moves, laws)):
        remedy = "Leave it out: cycles says how long it goes on. Or let forces move a joint, free = ... instead of its drive."
        pressed = [name for name, joint in document.joints.items() if joint.kinds == ["cam"] and joint.closure != "form"]
        if pressed:
            remedy += f" Or let a follower leave its cam: joints.{pressed[0]}.liftoff = {{}}."
        convert.note("run.duration", "nothing is free: the drive decides the motion.", remedy)
    return _duration(document, convert)


def stated_duration(document: SceneDocument, convert: Converter) -> float | None:
    """The stated duration of the run [s]; None where it is missing or invalid."""
    run = document.run
    duration = (
        math.nan if run.duration is None or not run.has_valid("duration") else convert.si(run.duration, "time", "run.duration")
    )
    return None if math.isnan(duration) else duration


def _duration(document: SceneDocument, convert: Converter) -> float:
    run = document.run
    assert run.duration is not None
    duration = convert.si(run.duration, "time", "run.duration")
    if 0.0 < duration < 1e-9 * run.frames:
        why = f"{duration:.6g} s for {run.frames} frames: the clock of a recording counts nanoseconds, one a frame at least."
        convert.note("run.duration", why, f"Give {1e-9 * run.frames:.3g} s or more, or fewer frames.")
    return duration


def simulation_faults(reading: Reading) -> Iterator[Fault]:
    """Faults of free coordinates, in what could be read."""
    document = reading.document
    run, joints = document.run, document.joints
    free = [name for name, joint in joints.items() if joint.free is not None]
    separable = [name for name, joint in joints.items() if joint.liftoff is not None]
    loose = [name for name, joint in joints.items() if joint.clearance is not None]
    yield from clearance_faults(document)
    if not free and not separable and not loose:
        if not reading.kindless_joints and not any("free" in joint.invalid_keys for joint in joints.values()):
            yield from _idle(document)
        return
    what = f"{free[0]} is free" if free else f"{separable[0]} has liftoff" if separable else f"{loose[0]} has clearance"
    if run.duration is None and run.steady is None and run.has_valid("duration") and run.has_valid("steady"):
        why = f"'duration' is missing: how long does {(free or separable or loose)[0]} move?"
        yield Fault("run", why, 'Add duration = "5 s" to [run].')
    if run.cycles != 1:
        remedy = 'Leave out cycles and write duration = "5 s".'
        yield Fault("run.cycles", f"{run.cycles} cycles of a motion that forces decide.", remedy)
    if "inertia" not in document.effects and not any(isinstance(name, UnknownName) for name in document.effects):
        why = f"{what}, motion under forces needs masses, and inertia is not named."
        yield Fault("effects", why, 'Add "inertia" to effects.')
    for k, metric in enumerate(document.metrics):
        if metric in _NEEDS_DRIVE:
            yield Fault(f"metrics[{k}]", f"{metric} is defined per unit speed of a drive, and {what}.", "Leave it out.")
    for key in _STUDIES:
        if getattr(document, key):
            yield Fault(key, f"{what}, and '{key}' is for prescribed motions only.", "Leave it out, or prescribe a drive.")
    for name, joint in joints.items():
        if joint.kinds == ["cam"] and joint.liftoff is None and free:
            why = f"{what}: cams are computed for prescribed motions."
            remedy = "Prescribe a drive instead, or let the follower leave the cam: liftoff = { restitution = 0.3 }."
            yield Fault(f"joints.{name}", why, remedy)
        if joint.liftoff is not None and joint.closure == "form":
            yield Fault(f"joints.{name}.liftoff", "a form-closed follower cannot leave its cam.", 'Write closure = "force".')
    yield from _stops(document)


def _idle(document: SceneDocument) -> Iterator[Fault]:
    """Faults of keys that only a motion under forces uses, in a scene where nothing is free."""
    driven = any(joint.driven for joint in document.joints.values())
    why = f"nothing is free: {'the drive decides the motion' if driven else 'nothing moves'}."
    for key in ("steady", "tolerance", "method"):
        if getattr(document.run, key) is not None:
            yield Fault(f"run.{key}", why, _ADD_FREE if driven else _ADD_FREE.replace(" instead of its drive", ""))
    yield from () if driven else _without_drives(document)
    for name, joint in document.joints.items():
        if joint.stops:
            yield Fault(f"joints.{name}.stops", "nothing is free: a drive goes through stops.", _ADD_FREE)
    for name, load in document.loads.items():
        if load.servo is not None:
            yield Fault(f"loads.{name}.servo", "nothing is free: a servo moves a joint under forces.", _ADD_FREE)
    for name in document.watch:
        yield Fault(f"watch.{name}", "nothing is free: only a motion under forces is watched.", _ADD_FREE)


def _without_drives(document: SceneDocument) -> Iterator[Fault]:
    """Faults of keys that need a drive, in a structure that has none."""
    why = "the scene has no drive"
    for k, metric in enumerate(document.metrics):
        if metric != "transmission_angle":
            yield Fault(f"metrics[{k}]", f"{metric} is defined per unit speed of a drive, and {why}.", "Leave it out.")
    for key in _STUDIES[:-2]:
        if getattr(document, key):
            yield Fault(key, f"{why}: {key} are made for motions.", "Leave it out, or give a joint a drive.")
    for name, load in document.loads.items():
        for key in ("table", "polynomial"):
            factor = getattr(load, key)
            if factor is not None and factor.of in ("position", "velocity") and not (factor.joint or factor.drive):
                remedy = 'Name a joint, joint = "...", or let it be a factor of time.'
                yield Fault(f"loads.{name}.{key}", f"{why} whose {factor.of} the factor could depend on.", remedy)
        if load.gas is not None and load.drive is None:
            yield Fault(f"loads.{name}", f"{why} that decides the strokes of the gas.", "Give a joint a drive, such as speed = 0.")


def _stops(document: SceneDocument) -> Iterator[Fault]:
    names: set[str] = set()
    for joint, entry in document.joints.items():
        for k, stop in enumerate(entry.stops):
            name, path = stop_name(joint, stop), f"joints.{joint}.stops[{k}]"
            if name in names:
                yield Fault(path, f"two stops are called '{name}'.", "Give one of them a name = ...")
            if f"stop {name}" in document.loads:
                yield Fault(path, f"a load is called 'stop {name}' already.", "Give one of them another name.")
            names.add(name)


# -- drives that run to the limits -------------------------------------------------------------------------------------
REACHABLE = "reachable"
RANGE_MARGIN = 0.01
"""Part of the reachable range that is kept as a margin to each limit: a dead point, where efforts grow without bound."""
RANGE_STEPS = 36
"""Number of trial positions of a drive that cannot be assembled at its start."""


def oscillation_changes(document: SceneDocument) -> Mapping[tuple[str | int, ...], Any]:
    """The changes that let the only moving drive of a document oscillate within its reachable range; none where it cannot."""
    driven = [name for name, joint in document.joints.items() if joint.driven and not _stands_still(joint.drive)]
    drive = document.joints[driven[0]].drive if len(driven) == 1 else None
    if drive is None or drive.laws != ["speed"] or drive.signals:
        return {}
    return {("joints", driven[0], "drive", "range"): REACHABLE} if drive.travel is None and drive.range is None else {}


def _stands_still(drive: DriveDocument | None) -> bool:
    """Whether a drive is one that holds its joint by a speed of zero."""
    return drive is not None and drive.laws == ["speed"] and not drive.signals and not magnitude(drive.speed or 0.0)


def oscillating_drives(scene: Scene) -> tuple[str, ...]:
    """The drives of a scene that oscillate between their limits; not those that may, but can turn fully."""
    asked = {name for name, joint in scene.document.joints.items() if joint.drive is not None and joint.drive.range == REACHABLE}
    return tuple(d.joint for d in scene.mechanism.drives if d.joint in asked and isinstance(d.law, Oscillation))


def with_oscillations(mechanism: Mechanism, joints: list[str]) -> tuple[Mechanism, list[Fault]]:
    """The mechanism in which the drives of ``joints``, given as constant speeds, oscillate between their limits; and the faults of
    those that cannot."""
    faults: list[Fault] = []
    for joint in joints:
        path = f"joints.{joint}.drive.range"
        others = [d.law for d in mechanism.drives if d.joint != joint and moves(d.law)]
        cycles = {math.inf if isinstance(law, Free) else law.duration for law in others}
        if len(joints) > 1:
            why = "two drives that run as far as they can leave each other's reach open"
        elif len(cycles) > 1:
            why = "its range beside other drives is computed over their cycle, and theirs differ"
        else:
            why = "" if all(map(math.isfinite, cycles)) else "where the other drives or free joints go has no end in time"
        if why:
            faults.append(Fault(path, f"{why}.", "Give it a range = [least, greatest]."))
            continue
        try:
            laws = {joint: _swing(mechanism, joint, max(cycles, default=0.0))}
        except MechanismError as error:
            faults += [Fault(path, f.message, f.remedy) for f in error.faults if f.path == path]
            continue  # other faults are reported when it is run
        drives = tuple(replace(d, law=laws.get(d.joint, d.law)) for d in mechanism.drives)
        mechanism = replace(mechanism, drives=drives)
    return mechanism, faults


def _assembled(mechanism: Mechanism) -> Compiled:
    """The mechanism with its first drive at its start, or at the nearest of some trial positions at which it can be assembled (not
    where groups are solved by continuation). Raises `MechanismError`."""
    try:
        return compile_mechanism(mechanism)
    except MechanismError as error:
        first, *others = mechanism.drives
        model = build_model(mechanism)
        if any(block.kind == "general" for block in model.blocks):
            raise
        step = TURN / RANGE_STEPS if model.rotary(first.joint) else 10.0 * model.length_scale / RANGE_STEPS
        for k in range(2, RANGE_STEPS + 2):
            law = Rest(float(first.law(0.0)[0]) + step * (k // 2) * (-1.0) ** k)
            with suppress(MechanismError):
                return compile_mechanism(replace(mechanism, drives=(replace(first, law=law), *others)))
        raise error


def _swing(mechanism: Mechanism, joint: str, cycle: float) -> Law:
    """The law of one drive: a harmonic oscillation whose largest speed is the stated one, or that constant speed where it can turn
    fully. ``cycle``: duration [s] of the cycle of other drives that move, throughout which its range has to be reachable. Raises
    `MechanismError`."""
    law = next(d.law for d in mechanism.drives if d.joint == joint)
    assert isinstance(law, ConstantSpeed)
    others = tuple(d for d in mechanism.drives if d.joint != joint)
    held = (Drive(joint=joint, law=Rest(law.start)), *others)
    compiled = _assembled(replace(mechanism, drives=held, loads=(), effects=()))
    rotary, size = compiled.model.rotary(joint), compiled.model.length_scale
    path = f"joints.{joint}.drive.range"
    if cycle:
        beside = nearest_range(compiled, np.array([0.0, cycle]))
        if beside is None:
            why = "at its start it cannot stand while the other drives run through their cycle" + (
                ", as far as that is known: some groups of it have to be followed." if compiled.needs_path else "."
            )
            raise MechanismError(Fault(path, why, "Let it start elsewhere, or give a range = [least, greatest]."))
        ranges = [beside]
    else:
        ranges = reachable_ranges(compiled)
    low, high = ranges[0] if ranges else (law.start, law.start)
    inside = low <= law.start <= high
    if rotary and abs(high - low - TURN) < TURN * (1e-5 if cycle else 1e-9):
        return law
    if not rotary and high - low > 9.0 * size:
        raise MechanismError(Fault(path, "nothing limits how far it can go.", "Give a range = [least, greatest]."))
    if high - low < 1e-6 * (TURN if rotary else size):
        raise MechanismError(Fault(path, "it cannot move from its start.", "Let it start elsewhere, or change a length."))
    margin = RANGE_MARGIN * (high - low)
    low, high = low + margin, high - margin
    if inside:
        low, high = min(low, law.start), max(high, law.start)
    centre, amplitude = 0.5 * (low + high), 0.5 * (high - low)
    phase = math.asin(min(max((law.start - centre) / amplitude, -1.0), 1.0))
    frequency = abs(law.speed) / (TURN * amplitude)
    return Oscillation(centre, amplitude, frequency, phase if law.speed > 0.0 else math.pi - phase)
