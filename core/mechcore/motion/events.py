"""Events of a motion: limit positions, starts, stops and zone boundaries of drives, near singular positions of groups."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np

from mechcore.arrays import Real
from mechcore.constants import REST, SINGULAR
from mechcore.laws.timed import JUMPS, Law, Table, TableLaw, moves
from mechcore.motion.at_once import indeterminate
from mechcore.motion.between_frames import largest_maximum, zeros
from mechcore.motion.metrics import (
    curvature,
    per_unit_drive_speed,
    ratio_in_time,
    ratio_units,
    transmission_angles,
    velocity_ratios,
)
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import runs
from mechcore.numerics.interpolation import between
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism
from mechcore.texts import QuantityKind, Text, UnitSystem, as_angle, as_coordinate, as_length, as_quantity

MOST_SOLVED = 100_000  # limit positions times links, up to which limit positions are solved exactly
MOST_REPORTED = 12  # distinct limit positions of a joint; if there are more, as in drawing machines, the outermost two are reported
REST_ROUNDS, REST_PARTS = 8, np.linspace(0.0, 1.0, 17)  # of the search for the start or the end of a rest: 16^8 = 4e9 places
STANDSTILL = 1e-15  # speed, of the greatest one, within a rest of a law
MOST_BOUNDARIES = 10_000  # zone boundaries of a drive's law in a run
POOR_TRANSMISSION = 30.0
"""Transmission angle [degrees] below which a linkage transmits poorly (textbooks: 30 to 45)."""

GROWTH = 10.0
"""Growth of a velocity ratio, from a tenth to a thousandth of a frame from a dead point, from which it has no bounds there."""

TOGGLE = 1e-6
"""Velocity ratio, relative to its median, up to which it is zero."""

STRAIGHT = 1e-6
"""Size of a mechanism over the radius of curvature of a path up to which the path is straight: next to places where a point is at
rest, this is rounding."""

SPLINE_OVERSHOOT = 0.05
"""Fraction of a table's range by which a spline may overshoot the two rows around it (sine with ten rows per cycle: 0.02)."""


@dataclass(frozen=True)
class Event:
    """Something that happens at a time [s] to a named item."""

    time: float
    level: Literal["INFO", "WARN"]
    item: str
    text: str
    value: float = float("nan")  # of the quantity named in the text, in SI units, if there is one

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", Text.of(self.text))

    def in_units(self, units: UnitSystem) -> Event:
        """The same event with the quantities of its text in other units."""
        return replace(self, text=Text.of(self.text).in_units(units))


def find_events(motion: Motion) -> list[Event]:
    """All events of a motion, sorted by time."""
    events = [*_limits(motion), *_drive_events(motion), *_singular(motion), *_changes(motion), *_extremes(motion)]
    events += [*_indeterminate(motion), *overshoots(motion.mechanism)]
    return sorted(events, key=lambda e: e.time)


def overshoots(mechanism: Mechanism) -> Iterator[Event]:
    """An event for each spline of a load or drive that overshoots the range of two neighbouring rows, with the size of the
    overshoot."""
    factors = [(load.name, getattr(load, "factor", None)) for load in mechanism.loads]
    tables: list[tuple[str, Any]] = [(name, factor.function) for name, factor in factors if factor is not None]
    for name, table in [*tables, *((drive.joint, drive.law) for drive in mechanism.drives)]:
        if isinstance(table, Table | TableLaw):
            far, row = table.overshoot
            if far > SPLINE_OVERSHOOT:
                what = "give it more rows" if isinstance(table, TableLaw) else "smooth = true stays between them"
                text = f"the spline leaves its rows by {far:.2g} of their whole range, between row {row + 1} and the next; {what}"
                yield Event(0.0, "WARN", name, text, far)


def turning_points(time: Real, speed: Real, acceleration: Real) -> Real:
    """Times (n,) at which a speed (F,) passes through zero and changes its sign, see `turning_places`."""
    return turning_places(time, speed, acceleration)[:, 1]


def turning_places(time: Real, speed: Real, acceleration: Real, *, end: bool = False) -> Real:
    """Where a speed (F,) passes through zero and changes its sign, (n, 3): times of a frame before, of the zero, of a frame behind.

    Between two frames the speed is the Hermite cubic with the given accelerations as slopes; its root is found by bisection, for
    all crossings at once. A reversal after a rest of more than one frame is not a turning point. ``end``: a last frame at which the
    speed is zero and would change its sign is one.
    """
    largest = np.abs(speed).max(initial=0.0)
    moving = np.flatnonzero(np.abs(speed) > REST * largest)
    if largest == 0.0 or len(moving) < 2:
        return np.zeros((0, 3))
    flips = np.flatnonzero((speed[moving][:-1] * speed[moving][1:] < 0) & (np.diff(moving) <= 2))
    i, j = moving[flips], moving[flips + 1]
    h = time[j] - time[i]
    low, high = np.zeros(len(i)), np.ones(len(i))
    for _ in range(50 if len(i) else 0):
        u = 0.5 * (low + high)
        same = np.sign(_cubic(u, speed[i], h * acceleration[i], speed[j], h * acceleration[j])) == np.sign(speed[i])
        low, high = np.where(same, u, low), np.where(same, high, u)
    found = np.where(j - i == 2, time[i + 1], time[i] + 0.5 * (low + high) * h)  # a single frame at rest is the turning point
    places = np.stack([time[i], found, time[j]], axis=1)
    if end and moving[-1] == len(time) - 2 and speed[-2] * acceleration[-1] < 0.0:
        places = np.append(places, [time[[-2, -1, -1]]], axis=0)
    return places


def _cubic(u: Real, v0: Real, d0: Real, v1: Real, d1: Real) -> Real:
    """Hermite cubic on [0, 1] with values v and slopes d at the ends."""
    w = 1.0 - u
    return np.asarray(w * w * ((1.0 + 2.0 * u) * v0 + u * d0) + u * u * ((1.0 + 2.0 * w) * v1 - w * d1))


def _coordinate_at(motion: Motion, rows: Real, t: float) -> float:
    """Estimate of a coordinate between frames by Taylor's formula from the nearest frame's value, speed and acceleration (F, 3)."""
    k = int(np.argmin(np.abs(motion.time - t)))
    d = t - motion.time[k]
    return float(rows[k, 0] + d * (rows[k, 1] + 0.5 * d * rows[k, 2]))


def _words(motion: Motion, joint: str, value: float) -> str:
    if abs(value) < 1e-9 * np.max(np.abs(motion.coordinate(joint)[:, 0]), initial=0.0):  # rounding
        value = 0.0
    rotary = motion.model.rotary(joint)
    return as_coordinate(value, rotary=rotary, digits=4 if rotary else 5)


def _placed(words: str, motion: Motion, t: float) -> str:
    """The text of an event with the positions of the drives at its time, if there are drives."""
    return ", ".join(filter(None, (words, at_drive(motion, t))))


def at_drive(motion: Motion, t: float) -> str:
    """The positions of the drives at a time, as text."""
    places = []
    for d in motion.mechanism.drives:
        by_laws = motion.at_times is not None  # by the laws, which are exact between frames too
        value = float(d.law(t)[0]) if by_laws else _coordinate_at(motion, motion.coordinate(d.joint), t)
        places.append(f"drive {d.joint} at {_words(motion, d.joint, value)}")
    return ", ".join(places)


def limit_positions(motion: Motion) -> Iterator[tuple[str, Real, Real]]:
    """Moving undriven joints at the frame link: name, times [s] of its limit positions, and its coordinates there [rad or m].

    At a limit position the link turns back while the drives do not. If the drives follow laws, the motion is solved again there,
    for all joints together; for large mechanisms the quintic Hermite polynomial between two frames gives the coordinates. Otherwise
    they are estimated from the nearest frame.
    """
    driven = {d.joint for d in motion.mechanism.drives}
    stops: list[Any] = [turning_points(motion.time, q[1], q[2]) for q in motion.drives]
    reversals = np.concatenate([np.zeros(0), *stops])
    near = 1e-6 * max(float(np.ptp(motion.time)), 1e-300) if motion.frames else 0.0
    going = all(abs(q[1][-1]) > REST * np.abs(q[1]).max() for q in motion.drives if np.any(q[1])) if motion.frames else False
    places_of: dict[str, Real] = {}
    for joint in motion.mechanism.joints:
        if joint.name in driven or motion.mechanism.frame not in joint.links:
            continue
        rows = motion.coordinate(joint.name)
        if not np.isfinite(rows).all() or np.abs(rows[:, 1]).max(initial=0.0) <= _rest_speed(motion, joint.name, rows):
            continue
        places = turning_places(motion.time, rows[:, 1], rows[:, 2], end=going)
        turned = np.abs(reversals - places[:, 1:2]) < near
        if _one_moves(motion):  # between two frames in which the only drive reverses, no other joint has a limit of its own
            turned |= np.searchsorted(motion.time, places[:, 1:2]) == np.searchsorted(motion.time, reversals)
        places_of[joint.name] = places[~turned.any(axis=1)]
    every = np.concatenate([np.zeros((0, 3)), *places_of.values()])
    owner = np.repeat(np.arange(len(places_of)), [len(places) for places in places_of.values()])
    times, values = every[:, 1], np.zeros(len(every))
    if motion.at_times is not None and len(every) and len(every) * len(motion.model.links) <= MOST_SOLVED:
        times = zeros(motion, partial(_coordinates, list(places_of), slice(1, 3)), every, owner)
        order = np.argsort(times, kind="stable")
        values[order] = _coordinates(list(places_of), 0, motion.at_times(times[order]))[np.arange(len(order)), owner[order]]
    else:
        for k, name in enumerate(places_of):
            rows = motion.coordinate(name)
            own = times[owner == k]
            if motion.at_times is None:
                values[owner == k] = [_coordinate_at(motion, rows, float(t)) for t in own]
            else:
                values[owner == k] = between(motion.time, rows[:, 0], own, 5, rows[:, 1], rows[:, 2])
    for k, name in enumerate(places_of):
        yield name, times[owner == k], values[owner == k]


def coordinate_range(motion: Motion, joint: str) -> tuple[float, float]:
    """Least and greatest coordinate of a joint over a run, also between frames [rad or m]."""
    rows = motion.coordinate(joint)
    values = rows[:, 0]
    if motion.at_times is not None and np.isfinite(rows).all():
        times = zeros(motion, lambda m: m.coordinate(joint)[:, 1:3], turning_places(motion.time, rows[:, 1], rows[:, 2]))
        if len(times):
            values = np.concatenate([values, motion.at_times(np.sort(times)).coordinate(joint)[:, 0]])
    return float(values.min()), float(values.max())


def _one_moves(motion: Motion) -> bool:
    """Whether exactly one drive moves."""
    return sum(moves(d.law) for d in motion.mechanism.drives) == 1


def _coordinates(joints: Sequence[str], columns: slice | int, m: Motion) -> Real:
    """Columns of the coordinates of joints and their rates (F, joints, ...)."""
    return np.stack([m.coordinate(joint)[:, columns] for joint in joints], axis=1)


def _limits(motion: Motion) -> Iterator[Event]:
    for joint, times, values in limit_positions(motion):
        rows = motion.coordinate(joint)
        moving = np.flatnonzero(np.abs(rows[:, 1]) > REST * np.abs(rows[:, 1]).max(initial=0.0))
        just_before = times - 1e-7 * np.ptp(motion.time)  # the acceleration may jump where two laws meet
        ends = rows[moving[np.searchsorted(motion.time[moving], just_before) - 1], 1] > 0.0
        reported, count = list(range(len(times))), ""
        if len(times) > MOST_REPORTED and len(np.unique(np.round(values / np.ptp(rows[:, 0]), 6))) > MOST_REPORTED:
            reported, count = sorted({int(np.argmin(values)), int(np.argmax(values))}), f" of {len(times)}"
        for k in reported:
            side = "largest" if ends[k] else "smallest"
            words = f"limit position: coordinate {side}{count}, {_words(motion, joint, values[k])}"
            yield Event(float(times[k]), "INFO", joint, _placed(words, motion, float(times[k])), float(values[k]))


def _rest_speed(motion: Motion, joint: str, rows: Real) -> float:
    """The speed below which a coordinate (F, 3) counts as at rest: it moves by no more than ``REST`` of its scale over the run."""
    least = 1.0 if motion.model.rotary(joint) else motion.model.length_scale
    scale = max(least, float(np.abs(rows[:, 0]).max(initial=0.0)))
    return REST * scale / max(float(np.ptp(motion.time)), 1e-300)


def _drive_events(motion: Motion) -> Iterator[Event]:
    """Starts, stops and reversals of drives, and the zone boundaries of their laws."""
    first, last = (float(motion.time[0]), float(motion.time[-1])) if motion.frames else (0.0, 0.0)
    for drive in motion.mechanism.drives:
        rows = motion.coordinate(drive.joint)
        q = rows[:, 0]
        for t in turning_points(motion.time, rows[:, 1], rows[:, 2]):
            where = _words(motion, drive.joint, _coordinate_at(motion, rows, float(t)))
            yield Event(float(t), "INFO", drive.joint, f"drive reverses at {where}")
        followed = np.array_equal(drive.law(motion.time)[0], rows[:, 0])  # else the motion has other drive values than the law's
        most = float(np.abs(rows[:, 1]).max(initial=0.0))
        rests = runs(np.abs(rows[:, 1]) <= REST * most)
        for start, end in rests if len(rests) and (rests[0][1] - rests[0][0] + 1 < motion.frames) else ():
            if start > 0 and (end > start or end == motion.frames - 1):
                stops = float(motion.time[start])
                stops = _rests_from(drive.law, float(motion.time[start - 1]), stops, most) if followed else stops
                yield Event(stops, "INFO", drive.joint, f"drive stops at {_words(motion, drive.joint, q[start])}")
            if end < motion.frames - 1 and (end > start or start == 0):
                starts = float(motion.time[end])
                starts = _rests_from(drive.law, float(motion.time[end + 1]), starts, most) if followed else starts
                yield Event(starts, "INFO", drive.joint, f"drive starts at {_words(motion, drive.joint, q[end])}")
        if not followed or not moves(drive.law):
            continue
        breaks = np.asarray(drive.law.breaks, float)
        count = float(np.floor(last / drive.law.duration)) + 1.0
        if count * max(len(breaks), 1) > MOST_BOUNDARIES:
            words = f"{count * max(len(breaks), 1):.3g} zone boundaries of the drive's law are passed: too many to list"
            yield Event(first, "INFO", drive.joint, words)
            continue
        cycles = np.arange(int(count))
        edges = np.array([motion.time[k] for rest in rests for k in rest])
        step = (last - first) / max(motion.frames - 1, 1)
        shock = getattr(drive.law, "shock", lambda _: "")  # piecewise laws know which derivative jumps there
        for t in np.unique(cycles[:, None] * drive.law.duration + np.append(0.0, breaks)):
            if not first < t < last:
                continue
            what = shock(float(t))
            between = not len(breaks) or np.all(np.abs(np.mod(t, drive.law.duration) - breaks) > 1e-9 * drive.law.duration)
            reported_elsewhere = between or np.any(
                np.abs(edges - t) <= step * (1.0 + 1e-9)
            )  # as a start or a stop, or just the end of a cycle
            if what or not reported_elsewhere:
                where = _words(motion, drive.joint, float(drive.law(t)[0]))
                words = f"zone boundary of the drive's law at {where}" + (f": {what}" if what else "")
                yield Event(float(t), "WARN" if what == JUMPS[0] else "INFO", drive.joint, words)


def _rests_from(law: Law, moving: float, resting: float, most: float) -> float:
    """The time [s] at which a rest of a law begins, or, where it rests before it moves, ends; ``most``: its greatest speed."""
    for _ in range(REST_ROUNDS):
        t = moving + (resting - moving) * REST_PARTS
        still = np.abs(law(t)[1]) <= STANDSTILL * most
        k = int(np.argmax(still))
        if k == 0:
            break
        moving, resting = float(t[k - 1]), float(t[k])
    return resting


def _singular(motion: Motion) -> Iterator[Event]:
    """Ranges of frames in which a group's equations are near singular."""
    bad = ~(motion.condition <= SINGULAR)
    for start, end in runs(bad):
        worst = float(np.max(motion.condition[start : end + 1]))
        t0, t1 = float(motion.time[start]), float(motion.time[end])
        text = _placed(f"near singular position: condition number {worst:.1e} until {t1:.6g} s", motion, t0)
        yield Event(t0, "WARN", "mechanism", text)


def _changes(motion: Motion) -> Iterator[Event]:
    """Singular points at which two assembly modes meet and that the motion passes."""
    for change in motion.singular_points:
        if change.dead:
            text = f"dead point of the drive: the group at {change.name} goes through its limit"
        else:
            text = f"change point: the two assembly modes of {change.name} meet, the motion goes through"
        yield Event(float(change.time), "WARN", change.name, _placed(text, motion, change.time))


def _extremes(motion: Motion) -> Iterator[Event]:
    """Extremes of the metrics that the mechanism requests, between frames too."""
    requested = motion.mechanism.metrics
    if "transmission_angle" in requested:
        for joint in transmission_angles(motion):
            t, flat = largest_maximum(motion, partial(_squared_cosine, joint))
            if np.isfinite(t):
                angle = float(_value_at(motion, partial(_transmission_angle, joint), t))
                level: Literal["INFO", "WARN"] = "WARN" if flat > np.cos(np.radians(POOR_TRANSMISSION)) ** 2 else "INFO"
                text = _placed(f"worst transmission angle of the run, {as_angle(angle, 4)}", motion, t)
                yield Event(t, level, joint, text, angle)
    if "velocity_ratio" in requested or "mechanical_advantage" in requested:
        yield from _ratios(motion, requested)
    if "curvature" in requested:
        for link, point in motion.mechanism.traced:
            t, value = largest_maximum(motion, partial(_curvature, link, point))
            if np.isfinite(t) and value * motion.model.length_scale <= STRAIGHT:
                yield Event(float(motion.time[0]), "INFO", f"{link}.{point}", f"the path of {link}.{point} is a straight line")
            elif np.isfinite(t):
                text = f"sharpest bend of the path of {link}.{point}, radius {as_length(1.0 / value, 5)}"
                yield Event(t, "INFO", f"{link}.{point}", text, value)


def _ratios(motion: Motion, requested: Sequence[str]) -> Iterator[Event]:
    """Extremes of velocity ratios, and of mechanical advantages, the reciprocals of the ratios of joints at the frame link."""
    first = motion.mechanism.drives[0].joint
    at_frame = {c.name for c in motion.model.connections if motion.mechanism.frame in c.links and c.name != first}
    dead = [float(c.time) for c in motion.singular_points if c.dead]
    step = float(np.max(np.diff(motion.time), initial=0.0))
    for joint, ratio in velocity_ratios(motion).items():
        finite = ratio[np.isfinite(ratio)]
        if not len(finite) or np.ptp(finite) <= REST * motion.model.length_scale:
            continue
        units = ratio_units(motion.model, joint)
        t = next((t for t in dead if _unbounded(motion, joint, t, step)), np.nan)
        if np.isfinite(t):
            value = np.inf
            words = "velocity ratio without bound at the drive's dead point"
        else:
            t, _ = largest_maximum(motion, partial(_squared_ratio, joint))
            value = float(_value_at(motion, partial(_ratio, joint), t))
            words = f"largest velocity ratio of the run, {_ratio_words(value, units[0])}"
        if "velocity_ratio" in requested:
            yield Event(t, "INFO", joint, _placed(words, motion, t), value)
        if "mechanical_advantage" in requested and joint in at_frame:
            least = 0.0 if np.isinf(value) else 1.0 / abs(value)
            words = f"smallest mechanical advantage of the run, {_ratio_words(least, units[1])}"
            yield Event(t, "INFO", joint, _placed(words, motion, t), least)
            yield from _toggles(motion, joint)


def _ratio_words(value: float, unit: str) -> str:
    """A ratio [``unit``, see `ratio_units`] as a part of a text."""
    kinds: dict[str, QuantityKind] = {"m": "length", "1/m": "1/m", "m/rad": "m/rad", "rad/m": "rad/m"}
    return as_quantity(value, kinds[unit], 5) if unit in kinds else f"{value:.5g}"


def _unbounded(motion: Motion, joint: str, dead: float, step: float) -> bool:
    """Whether the velocity ratio of a joint grows beyond bounds at a time [s] at which the drive is in a dead point: there it is
    inversely proportional to the time from it. Joints that another group moves have a ratio."""
    if motion.at_times is None:
        return True
    off = step * np.array([0.1, 0.001])
    before = dead - step >= motion.time[0]
    ratio = np.abs(_ratio(joint, motion.at_times(dead - off if before else dead + off[::-1])))
    far, near = ratio if before else ratio[::-1]
    return bool(near >= GROWTH * far)


def _toggles(motion: Motion, joint: str) -> Iterator[Event]:
    """Instants at which the mechanical advantage of a joint is unbounded: its velocity ratio passes through zero. Where the ratio
    changes its sign by a jump, or at a dead point of the drive, where it has no bounds itself, there is none."""
    rows = partial(ratio_in_time, joint=joint)
    ratio, rate = rows(motion).T
    size = np.abs(ratio[np.isfinite(ratio) & (ratio != 0.0)])
    if not len(size):
        return
    usual = float(np.median(size))
    part = usual / (usual + np.abs(ratio))  # keeps zeros, and bounds the ratio next to dead points of the drive
    with np.errstate(invalid="ignore"):
        bounded, slope = (np.nan_to_num(x) for x in (ratio * part / usual, rate * part**2 / usual))
    times = zeros(motion, rows, turning_places(motion.time, bounded, slope, end=True))
    if motion.at_times is not None and len(times):
        times = times[np.abs(rows(motion.at_times(times))[:, 0]) <= TOGGLE * usual]
    for t in times:
        text = _placed("mechanical advantage without bound (toggle)", motion, float(t))
        yield Event(float(t), "INFO", joint, text, np.inf)


def _transmission_angle(joint: str, m: Motion) -> Real:
    return transmission_angles(m)[joint]


def _squared_cosine(joint: str, m: Motion) -> Real:
    """Squared cosine of the transmission angle: largest where the angle is farthest from 90 degrees, and, unlike the angle, smooth
    where the links are collinear."""
    return np.asarray(np.cos(transmission_angles(m)[joint]) ** 2)


def _ratio(joint: str, m: Motion) -> Real:
    return per_unit_drive_speed(m).coordinate(joint)[:, 1]


def _squared_ratio(joint: str, m: Motion) -> Real:
    return np.asarray(_ratio(joint, m) ** 2)


def _curvature(link: str, point: str, m: Motion) -> Real:
    return np.asarray(np.abs(curvature(m, link, point)))


def _value_at(motion: Motion, quantity: Callable[[Motion], Real], t: float) -> float:
    """A quantity at one time."""
    if motion.at_times is None:
        return float(quantity(motion)[int(np.argmin(np.abs(motion.time - t)))])
    return float(quantity(motion.at_times(np.array([t])))[0])


def _indeterminate(motion: Motion) -> Iterator[Event]:
    """An event for redundant constraints, if forces are computed."""
    if motion.model.redundant and (motion.mechanism.effects or motion.mechanism.loads):
        names = ", ".join(indeterminate(motion.parts[0][1]))
        text = f"indeterminate reactions at {names}: constraints are redundant, the smallest reactions that balance are given"
        yield Event(float(motion.time[0]), "WARN", "mechanism", text)


@dataclass(frozen=True)
class Stroke:
    """The range of an output's coordinate over a run [rad or m].

    ``time_ratio``: time of the slower stroke over that of the quicker one, for a motion that repeats and moves once per cycle from
    one limit position to the other and back; else NaN. Source: R. L. Norton, Design of Machinery, "quick-return".
    """

    joint: str
    rotary: bool
    low: float
    high: float
    time_ratio: float

    @property
    def length(self) -> float:
        """The range [rad or m]."""
        return self.high - self.low


def strokes(motion: Motion, cycles: int = 1) -> list[Stroke]:
    """The strokes of all moving undriven joints at the frame link, over a run of ``cycles`` cycles."""
    return [_stroke(motion, joint, times, values, cycles) for joint, times, values in limit_positions(motion)]


def _stroke(motion: Motion, joint: str, times: Real, values: Real, cycles: int) -> Stroke:
    rows = motion.coordinate(joint)
    low, high = float(min([rows[:, 0].min(), *values])), float(max([rows[:, 0].max(), *values]))
    start, period = float(motion.time[0]), float(np.ptp(motion.time)) / cycles
    rests = np.abs(rows[[0, -1], 1]).max() <= REST * np.abs(rows[:, 1]).max()
    repeats = abs(rows[-1, 0] - rows[0, 0]) <= 1e-9 * (high - low)
    ratio = np.nan
    if repeats and _one_moves(motion):
        ends = np.concatenate([times, [start] if rests else []])
        places = np.concatenate([values, [rows[0, 0]] if rests else []])
        once = ends < start + period * (1.0 - 1e-9)
        if once.sum() == 2 and np.ptp(places[once]) > (1.0 - 1e-6) * (high - low):  # from one end to the other
            there = float(np.ptp(ends[once]))
            ratio = max(there, period - there) / min(there, period - there)
    return Stroke(joint, motion.model.rotary(joint), low, high, ratio)
