"""Where a quantity that depends on forces passes through zero between two frames."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mechcore.arrays import Real
from mechcore.effects.resistance import spans
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.motion.events import Event, at_drive, runs
from mechcore.motion.motion import Motion
from mechcore.spec.loads import BeltTension
from mechcore.spec.mechanism import Belt
from mechcore.texts import as_angle, as_force

ROUNDS = 4  # of searches for the moment between two frames, each to an eighth of the one before
PARTS = 8


def crossing(forces: Forces, values: Callable[[Forces], Real], t0: float, t1: float, n0: float, n1: float) -> float:
    """The time [s] at which ``values`` (F,) turn from ``n0`` >= 0 at ``t0`` to ``n1`` < 0 at ``t1`` (earlier or later)."""
    again = forces.motion.again
    for _ in range(ROUNDS if again is not None else 0):
        assert again is not None
        t = np.sort(np.linspace(t0, t1, PARTS + 1))
        if not np.all(np.diff(t) > 0.0):
            break
        found = values(solve_forces(again(t)))
        if t1 < t0:
            t, found = t[::-1], found[::-1]
        k = int(np.argmax(found < 0.0)) or PARTS
        t0, t1, n0, n1 = float(t[k - 1]), float(t[k]), float(found[k - 1]), float(found[k])
    return t0 if n0 == n1 else t0 + (t1 - t0) * float(np.clip(n0 / (n0 - n1), 0.0, 1.0))


MOST = 700.0
"""Largest exponent: beyond it a belt of any slack tension carries what a double can hold."""


@dataclass(frozen=True)
class BeltGrip:
    """``wraps`` of the two pulleys [rad], and the greatest force [N] that a belt with this tension carries without slipping:
    slack tension times (exp(coefficient times the smaller wrap) - 1)."""

    joint: str
    wraps: tuple[float, float]
    slack: float
    most: float


def belt_grip(motion: Motion, load: BeltTension) -> BeltGrip:
    """The wraps of a belt and what it can carry; without a coefficient (a toothed belt, a chain) without limit."""
    joint = next(p for p in motion.mechanism.joints if p.name == load.joint)
    assert isinstance(joint, Belt)
    lean = spans(motion, next(r for r in motion.model.relations if r.name == load.joint))[2]
    first = 2.0 * math.pi - 2.0 * math.acos(lean)
    wraps = (first, first if joint.crossed else 2.0 * math.pi - first)
    ratio = load.coefficient * min(wraps)
    most = load.slack * math.expm1(ratio) if 0.0 < ratio < MOST else math.inf
    return BeltGrip(load.joint, wraps, load.slack, most)


def belt_events(forces: Forces) -> list[Event]:
    """Where belts with a coefficient would slip, in order of time; their motion goes on as if they did not."""
    motion = forces.motion
    found: list[Event] = []
    for load in motion.mechanism.loads:
        if not isinstance(load, BeltTension) or not load.coefficient or not motion.frames:
            continue
        grip = belt_grip(motion, load)

        def margin(f: Forces, grip: BeltGrip = grip) -> Real:
            return np.asarray(grip.most - np.hypot(*f.reaction(grip.joint)[:, :2].T), float)

        left, time = margin(forces), motion.time
        for first, last in runs(left < -1e-9 * grip.most):
            carried = grip.most - float(left[first : last + 1].min())
            start, end = float(time[first]), float(time[last])
            if first:
                start = crossing(forces, margin, float(time[first - 1]), start, float(left[first - 1]), float(left[first]))
            if last + 1 < len(time):
                end = crossing(forces, margin, float(time[last + 1]), end, float(left[last + 1]), float(left[last]))
            text = (
                f"slips from {at_drive(motion, start)} to {at_drive(motion, end)}: up to {as_force(carried, 5)} is asked for, "
                f"{as_force(grip.most, 5)} is the most that it carries (Euler and Eytelwein: {as_force(grip.slack, 5)} in the "
                f"slack span, coefficient {load.coefficient:g}, wrap {as_angle(min(grip.wraps), 4)}). The motion goes on as if it "
                "held"
            )
            found.append(Event(start, "WARN", load.joint, text, carried))
    return sorted(found, key=lambda e: e.time)
