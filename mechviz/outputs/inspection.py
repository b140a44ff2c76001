"""Summary of a recording as text and numbers, read from the file alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import isfinite
from pathlib import Path

import numpy as np

from mechcore.motion.events import Event
from mechcore.numerics.frames import runs
from mechcore.records import dataclass
from mechviz.outputs.rerun.contract import RecordedModel
from mechviz.outputs.rerun.entities import parts_of
from mechviz.outputs.rerun.reader import ComponentRows, Recording
from mechviz.quantities.events import line_of
from mechviz.quantities.items import ERROR_COLUMNS
from mechviz.scene.units import MILLIMETRES, Units

HEALTH_UNITS = (
    ("closure", "m"),
    ("velocity_closure", "m/s"),
    ("acceleration_closure", "m/s²"),
    ("condition", ""),
    ("power_balance", ""),
    ("energy_drift", ""),
)

Spans = tuple[tuple[float, float], ...]

MOMENT_LOADS = ("torque", "drag torque", "viscous torque", "torsion spring", "torsion damper")
"""Kinds of loads that are moments, even if they are zero."""

GUIDE_ENDS = ("behind", "ahead")
"""Ends of the bearing of a guide, relative to its direction."""

STUDY_TABLES = ("systems", "reduced", "shaking", "substitutes", "sections", "evolutes", "inflection", "percussion")

LEAST_PEAK = 1e-9  # of the largest value of the same unit: smaller peaks are shown as zero


@dataclass(frozen=True)
class RecordedJoint:
    """A joint: its name, kind and the links that it joins."""

    name: str
    kind: str
    links: tuple[str, ...]


@dataclass(frozen=True)
class Peak:
    """The largest magnitude of a quantity, its time [s], and the position of the drives at that time, as text."""

    item: str
    value: float
    unit: str
    time: float
    drive: str


@dataclass(frozen=True)
class Inspection:
    """The result of `inspect`."""

    path: Path
    bytes: int
    version: str
    complete: bool
    note: str  # the missing part of the recording
    scene: str
    title: str
    frame: str
    links: tuple[str, ...]
    joints: tuple[RecordedJoint, ...]
    drives: tuple[str, ...]
    loads: tuple[str, ...]
    frames: int
    start: float
    end: float
    drive_range: str
    effects: tuple[str, ...]
    skipped: tuple[str, ...]
    peaks: tuple[Peak, ...]
    motion: tuple[Peak, ...]  # of speeds and accelerations
    studies: tuple[Peak, ...]  # of studies that the scene requests in addition to motion and forces
    losses: tuple[tuple[str, float], ...]  # mean friction power in each joint [W]
    losses_over: Spans  # start and end [s] of the intervals with forces, over which the losses are averaged
    health: tuple[Peak, ...]
    events: tuple[Event, ...]
    units: Units  # display units


def inspect(path: Path | str) -> Inspection:
    """Read a recording, complete or interrupted. Raises `RecordingError`."""
    recording = Recording(path)
    properties, model = recording.parsed_properties, recording.parsed_properties.model
    rows = recording.rows("data", "links", model.frame, "pose", component="Scalars:scalars")
    losses = _losses(recording, model)
    return Inspection(
        path=recording.path,
        bytes=recording.path.stat().st_size,
        version=properties.version,
        complete=properties.complete,
        note=recording.note,
        scene=properties.scene,
        title=properties.title,
        frame=model.frame,
        links=model.links,
        joints=tuple(RecordedJoint(name, j.type, j.links) for name, j in model.joints.items()),
        drives=model.drives,
        loads=tuple(model.loads),
        frames=len(rows.time),
        start=1e-9 * float(rows.time[0]),
        end=1e-9 * float(rows.time[-1]),
        drive_range=_drive_range(rows, properties.units),
        effects=properties.effects,
        skipped=properties.skipped,
        peaks=tuple(_peaks(recording, model)),
        motion=tuple(_motion(recording, model)),
        studies=tuple(_studies(recording)),
        losses=tuple((joint, loss) for joint, loss, _ in losses),
        losses_over=losses[0][2] if losses else (),
        health=tuple(_health(recording)),
        events=recording.events,
        units=properties.units,
    )


def _peaks(recording: Recording, model: RecordedModel) -> list[Peak]:
    """Peaks of drive efforts, joint reactions, friction and applied loads."""
    peaks = []
    for joint in model.drives:
        slides = model.joints[joint].type in ("prismatic", "pin_slot", "rolling")
        what, unit = ("driving force", "N") if slides else ("driving torque", "N m")
        peaks.append(_peak(recording, ("data", "drive", joint), f"{what} {joint}", unit, [3], signed=True))
    for joint in model.joints:
        path = ("data", "joints", joint, "reaction")
        peaks.append(_peak(recording, path, f"reaction {joint}", "N", [0, 1]))
        if model.joints[joint].type in ("prismatic", "weld"):
            peaks.append(_peak(recording, path, f"couple {joint}", "N m", [2], signed=True))
        if model.joints[joint].type == "prismatic":
            ends = ("data", "joints", joint, "bearing")
            peaks += [
                _peak(recording, ends, f"bearing force {end} {joint}", "N", [k], signed=True) for k, end in enumerate(GUIDE_ENDS)
            ]
    for joint in model.joints:
        path = ("data", "joints", joint, "friction")
        rubs = _peak(recording, path, f"friction force {joint}", "N", [0, 1])
        turns = _peak(recording, path, f"friction moment {joint}", "N m", [2], signed=True)
        peaks += [p for p in (rubs, turns) if p is not None and p.value != 0.0]
    for load, about in model.loads.items():
        if about.kind != "gravity":
            force = _peak(recording, ("data", "loads", load), f"load {load}", "N", [0, 1])
            moment = _peak(recording, ("data", "loads", load), f"load {load}", "N m", [2], signed=True)
            is_moment = about.kind in MOMENT_LOADS or (moment is not None and moment.value != 0.0)
            peaks.append(moment if is_moment and force is not None and force.value == 0.0 else force)
    return [p for p in peaks if p is not None]


def _motion(recording: Recording, model: RecordedModel) -> list[Peak]:
    """Peaks of velocities and accelerations of traced points and centres of mass, then of the links that rotate."""
    peaks = []
    points = dict.fromkeys(parts[2] for parts in map(parts_of, recording.entities) if parts[:2] == ("data", "points"))
    for what, unit in (("velocity", "m/s"), ("acceleration", "m/s²")):
        peaks += [_peak(recording, ("data", "points", name, what), f"{what} {name}", unit, [0, 1]) for name in points]
    for what, unit in (("velocity", "rad/s"), ("acceleration", "rad/s²")):
        for link in model.links:
            peaks.append(_peak(recording, ("data", "links", link, what), f"angular {what} {link}", unit, [2], signed=True))
    return [p for p in peaks if p is not None and p.value != 0.0]


def _studies(recording: Recording) -> list[Peak]:
    """Peaks of the results of studies by column; positions are left out."""
    peaks = []
    for path in recording.entities:
        parts = parts_of(path)
        names = recording.static(path, component="SeriesLines:names")
        if names is None or parts[0] != "data" or parts[1] not in STUDY_TABLES or not recording.has(path):
            continue
        for k, header in enumerate(map(str, names)):
            of, _, name = header.removesuffix("]").rpartition(".")
            name, _, unit = name.partition(" [")
            if name == "Fx":
                peaks.append(_peak(recording, parts, f"force {of}", unit, [k, k + 1]))
            elif name != "Fy" and name.split()[-1] not in ("x", "y", "at"):
                peaks.append(_peak(recording, parts, f"{name} {of}", unit, [k], signed=True))
    return [p for p in peaks if p is not None]


def _losses(recording: Recording, model: RecordedModel) -> list[tuple[str, float, Spans]]:
    """Mean friction power [W] of each joint with friction, the largest first, averaged over the frames with forces; with it the
    intervals [s] of these frames: where the mechanism jams there are no forces.
    """
    losses = []
    for joint in model.joints:
        path = ("data", "joints", joint, "friction_loss")
        if recording.has(*path):
            rows = recording.rows(*path, component="Scalars:scalars")
            time, values = 1e-9 * rows.time.astype(float), rows.values.reshape(len(rows.time))
            parts = [slice(first, last + 1) for first, last in runs(np.isfinite(values))]
            spans = tuple((float(time[part][0]), float(time[part][-1])) for part in parts)
            span = sum(end - start for start, end in spans)
            work = sum(float(np.trapezoid(values[part], time[part])) for part in parts)
            if parts:
                losses.append((joint, work / span if span > 0 else float(np.nanmean(values)), spans))
            else:
                losses.append((joint, 0.0, ()))
    return sorted(losses, key=lambda item: -item[1])


def _loss_lines(inspection: Inspection) -> list[str]:
    """Text of the losses, and of the part of the run over which they are averaged."""
    spans = inspection.losses_over
    if not spans:
        return ["Friction losses: it jams over the whole run, there are no forces"]
    begins, ends = spans[0][0] <= inspection.start, spans[-1][1] >= inspection.end
    if len(spans) == 1 and begins:
        over = "of the run" if ends else f"up to {spans[0][1]:.6g} s, where it jams: there are no forces beyond"
    else:
        parts = ", ".join(f"{start:.6g} s to {end:.6g} s" if start < end else f"{start:.6g} s" for start, end in spans)
        over = f"over {parts}: at the other frames it jams and there are no forces"
    total = sum(loss for _, loss in inspection.losses)
    lines = [f"Friction losses, mean {over}"]
    lines += [f"  {joint:<12}  {loss:>12.5g} W  {100.0 * loss / (total or 1.0):5.1f} %" for joint, loss in inspection.losses]
    return [*lines, f"  {'all':<12}  {total:>12.5g} W"]


def _health(recording: Recording) -> list[Peak]:
    peaks = [_peak(recording, ("health", name), name.replace("_", " "), unit, [0]) for name, unit in HEALTH_UNITS]
    path = ("health", "error_estimate")
    peaks += [_peak(recording, path, f"estimated error: {name.replace('_', ' ')}", "", [k]) for k, name in enumerate(ERROR_COLUMNS)]
    return [p for p in peaks if p is not None]


def _peak(
    recording: Recording, path: tuple[str, ...], item: str, unit: str, columns: list[int], *, signed: bool = False
) -> Peak | None:
    """The peak of the norm of some columns, ``signed``: of a single one with its sign; None if they are not recorded or all NaN."""
    if not recording.has(*path):
        return None
    rows = recording.rows(*path, component="Scalars:scalars")
    values = rows.values.reshape(len(rows.time), -1)[:, columns]
    size = np.sqrt((values**2).sum(axis=1))
    if np.isnan(size).all():
        return None
    k = int(np.nanargmax(size))
    value, time = float(values[k, 0] if signed else size[k]), 1e-9 * float(rows.time[k])
    return Peak(item, value, unit, time, _drive_at(rows, k, recording.parsed_properties.units))


def _drive_at(rows: ComponentRows, k: int, units: Units) -> str:
    return ", ".join(_tick_words(name, ticks[k], units) for name, ticks in rows.drives.items())


def _tick_words(timeline: str, tick: int | np.int64, units: Units) -> str:
    """Text of a position of a drive, given as a tick of its timeline: millidegrees or micrometres."""
    si, more = {"drive_mdeg": ("rad", 2), "drive_um": ("m", 1)}[timeline]
    unit, factor = units.display_unit(si)
    value = 1e-3 * int(tick) * factor / MILLIMETRES.display_unit(si)[1]
    return f"{value:.{units.decimals(si) + more}f}{'' if unit == '°' else ' '}{unit}"


def _drive_range(rows: ComponentRows, units: Units) -> str:
    """Text of the first and last position of each drive, and of its least and greatest position if these are different."""
    spans = []
    for name, ticks in rows.drives.items():
        first, last, least, greatest = (_tick_words(name, tick, units) for tick in (ticks[0], ticks[-1], ticks.min(), ticks.max()))
        between = "" if {ticks.min(), ticks.max()} == {ticks[0], ticks[-1]} else f" between {least} and {greatest}"
        spans.append(f"{first} to {last}{between}")
    return ", ".join(spans)


def format_inspection(inspection: Inspection) -> str:
    """An inspection as plain text for a terminal."""
    joints = ", ".join(f"{j.name} ({j.kind}: {' - '.join(j.links)})" for j in inspection.joints)
    span = f"{inspection.start:.6g} s to {inspection.end:.6g} s"
    rows = [
        ("file", f"{inspection.path}, {inspection.bytes / 1e6:.2f} MB, mechviz {inspection.version}"),
        *([("note", inspection.note)] if inspection.note else []),
        ("scene", inspection.scene),
        (
            "links",
            f"{len(inspection.links)}: {', '.join(k + ' (frame)' if k == inspection.frame else k for k in inspection.links)}",
        ),
        ("joints", f"{len(inspection.joints)}: {joints}"),
        ("drives", ", ".join(inspection.drives) or "none"),
        ("loads", ", ".join(inspection.loads) or "none"),
        ("frames", f"{inspection.frames}, {span}" + (f", drive {inspection.drive_range}" if inspection.drive_range else "")),
        ("effects", ", ".join(inspection.effects) or "none: pure kinematics"),
        ("left out", ", ".join(inspection.skipped) or "nothing"),
    ]
    width = max(len(name) for name, _ in rows)
    lines = [inspection.title, *(f"  {name:<{width}}  {text}" for name, text in rows)]
    display_unit = inspection.units.display_unit
    sections = {"Peaks": inspection.peaks, "Peaks of the motion": inspection.motion, "Peaks of the studies": inspection.studies}
    for title, peaks in sections.items():
        if peaks:
            lines += ["", title, *_peak_lines(_without_noise(peaks), display_unit)]
    if inspection.losses:
        lines += ["", *_loss_lines(inspection)]
    if inspection.health:
        lines += ["", "Worst health", *_peak_lines(inspection.health, partial(display_unit, small=True))]
    lines += ["", "Events", *(f"  {e.level:<4}  {line_of(e)}" for e in inspection.events)]
    if not inspection.events:
        lines.append("  none")
    return "\n".join(lines)


def _without_noise(peaks: tuple[Peak, ...]) -> tuple[Peak, ...]:
    """Peaks with zero for round-off relative to the largest finite value of the same unit. Not for health figures, which show
    round-off."""
    largest: dict[str, float] = {}
    for peak in peaks:
        largest[peak.unit] = max(largest.get(peak.unit, 0.0), abs(peak.value) if isfinite(peak.value) else 0.0)
    return tuple(replace(peak, value=0.0) if abs(peak.value) <= LEAST_PEAK * largest[peak.unit] else peak for peak in peaks)


def _peak_lines(peaks: tuple[Peak, ...], display_unit: Callable[[str], tuple[str, float]]) -> list[str]:
    """A line for each peak, in display units."""
    peaks = tuple(replace(p, value=p.value * factor, unit=unit) for p in peaks for unit, factor in (display_unit(p.unit),))
    width, units = max(len(p.item) for p in peaks), max(4, *(len(p.unit) for p in peaks))
    return [
        f"  {p.item:<{width}}  {p.value:>12.5g} {p.unit:<{units}}"
        + (f"  at {p.time:.6g} s" + (f", drive {p.drive}" if p.drive else "") if p.value else "  throughout")
        for p in peaks
    ]
