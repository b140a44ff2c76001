"""Loads that never act over a run, and springs that are squeezed below their solid length."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from mechcore.arrays import Real
from mechcore.laws.timed import Table
from mechcore.motion.events import Event, runs
from mechcore.motion.metrics import peak
from mechcore.motion.motion import Motion
from mechcore.spec.loads import Actuator, Factor, Force, Load, Spring, Torque
from mechcore.spec.mechanism import Mechanism
from mechcore.texts import as_coordinate, as_length, as_quantity

IDLE = 1e-12
"""Factors below this part of a table's largest are zero."""


def load_events(motion: Motion, mechanism: Mechanism | None = None) -> Iterator[Event]:
    """Loads that do nothing over a run as they are stated, and springs whose coils would touch.

    ``mechanism``: what was stated, where the motion under forces is that of another one, whose drives are found.
    """
    mechanism = mechanism or motion.mechanism
    for load in mechanism.loads if motion.frames else ():
        if isinstance(load, Force | Torque | Actuator):
            yield from _idle(motion, load, [drive.joint for drive in mechanism.drives])
        elif isinstance(load, Spring) and load.solid_length is not None:
            yield from _squeezed(motion, load, load.solid_length)


def idle_table(load: Load, rotary: bool, low: float, high: float) -> str:
    """Why a load whose factor is a table does not act as meant where its argument goes from ``low`` to ``high``; "" if it does.

    ``rotary``: whether the argument is an angle or its rate.
    """
    factor = getattr(load, "factor", None)
    if factor is None or not isinstance(factor.function, Table):
        return ""
    table, show, what = factor.function, partial(_shown, factor, rotary), _argument_words(factor)
    moves = high - low > IDLE * max(-low, high)
    taken = f"{what} goes from {show(low)} to {show(high)}" if moves else f"{what} is {show(low)}"
    known = np.array([x for x in table.x if low <= x <= high])
    values = np.abs(table(np.concatenate([np.linspace(low, high, 2001), known])))
    ends = f"its table goes from {show(table.x[0])} to {show(table.x[-1])}"
    covered = ends if table.period is None else "its table is zero there"
    if values.max() <= IDLE * np.abs(table.y).max():
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
    """What a factor depends on over the frames (F,); ``joint``: the one whose coordinate or rate it is."""
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
    """A value of what a factor depends on, as a part of a text."""
    if factor.of == "time":
        return f"{value:.6g} s"
    if factor.of in ("position", "x", "y"):
        return as_coordinate(value, rotary=rotary)
    return as_quantity(value, "angular speed" if rotary else "linear speed")


def _squeezed(motion: Motion, load: Spring, solid: float) -> Iterator[Event]:
    def closeness(m: Motion) -> Real:
        a, b = (m.point(*end) for end in zip(load.links, load.points, strict=True))
        return -np.hypot(*(b - a)[:, :2].T)

    own = -closeness(motion)
    spans = runs(own < solid)
    t, most = peak(motion, closeness)
    if not spans and -most < solid * (1.0 - 1e-9):  # between two frames
        spans = [(int(np.argmin(np.abs(motion.time - t))),) * 2]
    for first, last in spans:
        least = min(float(own[first : last + 1].min()), -most if motion.time[first] <= t <= motion.time[last] else np.inf)
        text = (
            f"squeezed to {as_length(least, 5)}, below its solid length of {as_length(solid)}, from {motion.time[first]:.6g} s to "
            f"{motion.time[last]:.6g} s: its coils touch. The motion goes on as if they did not"
        )
        yield Event(float(motion.time[first]), "WARN", load.name, text, least)
