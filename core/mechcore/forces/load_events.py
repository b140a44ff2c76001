"""Events of loads: those that never act over a run, springs that are squeezed below their solid length, belts that would slip."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.effects.resistance import spans
from mechcore.forces.kinetostatics import Forces
from mechcore.laws.timed import Table
from mechcore.motion.between_frames import Exceedance, exceedances, exceedances_of
from mechcore.motion.events import Event, at_drive
from mechcore.motion.motion import Motion
from mechcore.records import dataclass
from mechcore.spec.loads import Actuator, BeltTension, Factor, Force, Load, Spring, Torque
from mechcore.spec.mechanism import Belt, Mechanism
from mechcore.texts import as_angle, as_coordinate, as_force, as_length, as_quantity

IDLE_PART = 1e-12
"""Factors below this part of a table's largest are zero."""
MOST_ARGUMENT = 700.0
"""Largest exponent: beyond it the capacity of a belt exceeds the range of a double and counts as infinite."""


def load_events(motion: Motion, mechanism: Mechanism | None = None) -> Iterator[Event]:
    """Loads that, as stated, do nothing over a run, and springs whose coils would touch.

    ``mechanism``: the stated one, where the motion is that of another one, whose drives follow a motion found under forces.
    """
    mechanism = mechanism or motion.mechanism
    for load in mechanism.loads if motion.frames else ():
        if isinstance(load, Force | Torque | Actuator):
            yield from _idle(motion, load, [drive.joint for drive in mechanism.drives])
        elif isinstance(load, Spring) and load.solid_length is not None:
            yield from _squeezed(motion, load, load.solid_length)


def idle_table(load: Load, rotary: bool, low: float, high: float) -> str:
    """The reason why a load whose factor is a table does not act as intended for arguments from ``low`` to ``high``; "" if it does.

    ``rotary``: whether the argument is an angle or its rate.
    """
    factor = getattr(load, "factor", None)
    if factor is None or not isinstance(factor.function, Table):
        return ""
    table, show, what = factor.function, partial(_shown, factor, rotary), _argument_words(factor)
    moves = high - low > IDLE_PART * max(-low, high)
    taken = f"{what} goes from {show(low)} to {show(high)}" if moves else f"{what} is {show(low)}"
    known = np.array([x for x in table.x if low <= x <= high])
    values = np.abs(table(np.concatenate([np.linspace(low, high, 2001), known])))
    ends = f"its table goes from {show(table.x[0])} to {show(table.x[-1])}"
    covered = ends if table.period is None else "its table is zero there"
    if values.max() <= IDLE_PART * np.abs(table.y).max():
        return f"never acts: {covered}, {taken}"
    if table.period is None and (high < table.x[0] or low > table.x[-1]) and np.ptp(table.y):
        return f"is constant: {covered}, {taken}; beyond its rows the factor of the nearest one holds, {table(low):.6g}"
    return ""


def _idle(motion: Motion, load: Force | Torque | Actuator, drives: list[str]) -> Iterator[Event]:
    factor = load.factor
    stated = load.vector if isinstance(load, Force) else load.moment if isinstance(load, Torque) else load.force
    if not np.any(stated):
        yield Event(float(motion.time[0]), "INFO", load.name, "never acts: it is zero", 0.0)
    elif factor is not None and isinstance(factor.function, Table):
        joint = factor.joint or next(iter(drives), "")
        argument = _argument(motion, factor, joint)
        if not np.isfinite(argument).all():
            return
        rotary = factor.of in ("position", "velocity") and motion.model.rotary(joint)
        words = idle_table(load, rotary, float(argument.min()), float(argument.max()))
        if words:
            yield Event(float(motion.time[0]), "WARN", load.name, words, 0.0)


def _argument(motion: Motion, factor: Factor, joint: str) -> Real:
    """Argument of a factor over the frames (F,); ``joint``: the one whose coordinate or rate is the argument."""
    if factor.of == "time":
        return motion.time
    if factor.of in ("position", "velocity"):
        return motion.coordinate(joint)[:, int(factor.of == "velocity")]
    assert factor.point is not None
    rows = motion.point(*factor.point, int(factor.of not in ("x", "y")))
    return np.hypot(*rows.T) if factor.of == "speed" else rows[:, int(factor.of.endswith("y"))]


def _argument_words(factor: Factor) -> str:
    if factor.of in ("position", "velocity"):
        return f"the {factor.of} of {factor.joint or 'the first drive'}"
    return "the time" if factor.point is None else f"the {factor.of} of {'.'.join(factor.point)}"


def _shown(factor: Factor, rotary: bool, value: float) -> str:
    """A value of a factor's argument in words."""
    if factor.of == "time":
        return f"{value:.6g} s"
    if factor.of in ("position", "x", "y"):
        return as_coordinate(value, rotary=rotary)
    return as_quantity(value, "angular speed" if rotary else "linear speed")


def _squeezed(motion: Motion, load: Spring, solid: float) -> Iterator[Event]:
    def closeness(m: Motion) -> Real:
        a, b = (m.point(*end) for end in zip(load.links, load.points, strict=True))
        return np.asarray(-np.hypot(*(b - a)[:, :2].T))

    for short in exceedances(motion, closeness, -solid):
        text = (
            f"squeezed to {as_length(-short.value, 5)}, below its solid length of {as_length(solid)}, from {short.start:.6g} s to "
            f"{short.end:.6g} s: its coils touch. The motion goes on as if they did not"
        )
        yield Event(short.start, "WARN", load.name, text, -short.value)


def load_exceedances(
    forces: Forces, quantity: Callable[[Forces], Real], limit: float, within: Flags | None = None
) -> list[Exceedance]:
    """`mechcore.motion.between_frames.exceedances` of a quantity (F,) that depends on forces."""
    return exceedances_of(forces.motion, quantity(forces), limit, lambda t: quantity(forces.at_times(t)), within)


@dataclass(frozen=True)
class BeltGrip:
    """``wraps`` of the two pulleys [rad], and the greatest force [N] that a belt with this tension carries without slipping:
    slack tension times (exp(coefficient times the smaller wrap) - 1)."""

    joint: str
    wraps: tuple[float, float]
    slack: float
    most: float


def belt_grip(motion: Motion, load: BeltTension) -> BeltGrip:
    """The wraps of a belt and the greatest force that it can carry; without a coefficient (a toothed belt, a chain) this is
    infinite."""
    joint = next(p for p in motion.mechanism.joints if p.name == load.joint)
    assert isinstance(joint, Belt)
    (_, part), *_ = motion.parts  # constant over a run
    lean = spans(part, next(r for r in motion.model.relations if r.name == load.joint))[2]
    first = 2.0 * math.pi - 2.0 * math.acos(lean)
    wraps = (first, first if joint.crossed else 2.0 * math.pi - first)
    ratio = load.coefficient * min(wraps)
    most = load.slack * math.expm1(ratio) if 0.0 < ratio < MOST_ARGUMENT else math.inf
    return BeltGrip(load.joint, wraps, load.slack, most)


def belt_events(forces: Forces) -> list[Event]:
    """Slip of belts with a coefficient, in order of time; the motion continues as if they did not slip."""
    motion = forces.motion
    events: list[Event] = []
    for load in motion.mechanism.loads:
        if not isinstance(load, BeltTension) or not load.coefficient or not motion.frames:
            continue
        grip = belt_grip(motion, load)

        def transmitted(f: Forces, joint: str = load.joint) -> Real:
            return np.asarray(np.hypot(*f.reaction(joint)[:, :2].T), float)

        for slip in load_exceedances(forces, transmitted, grip.most):
            text = (
                f"slips from {_moment(motion, slip.start)} to {_moment(motion, slip.end)}: up to {as_force(slip.value, 5)} is "
                f"asked for, {as_force(grip.most, 5)} is the most that it carries (Euler and Eytelwein: {as_force(grip.slack, 5)} "
                f"in the slack span, coefficient {load.coefficient:g}, wrap {as_angle(min(grip.wraps), 4)}). The motion goes on as "
                "if it held"
            )
            events.append(Event(slip.start, "WARN", load.joint, text, slip.value))
    return sorted(events, key=lambda e: e.time)


def _moment(motion: Motion, t: float) -> str:
    """Positions of the drives at a time in words; the time where there are none."""
    return at_drive(motion, t) or f"{t:.5g} s"
