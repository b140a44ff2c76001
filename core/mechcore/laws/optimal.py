"""Rises of least peak acceleration, jerk or contact force for given conditions: linear programmes, exact polynomials.

The highest derivative is held constant over equal steps; the states at the steps follow exactly, so that a limit on the derivative
below it holds everywhere, not only at the steps. The result is a ``MotionCurve`` of polynomial pieces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import factorial
from typing import Literal

import numpy as np

from mechcore.arrays import Real
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve, Piece
from mechcore.laws.factors import peak
from mechcore.records import dataclass

Goal = Literal["velocity", "acceleration", "jerk", "snap", "force"]
_ORDER = {"velocity": 1, "acceleration": 2, "jerk": 3, "snap": 4}


@dataclass(frozen=True, eq=False)
class Optimum:
    """The law, the peak that it reaches (of the goal), and the peaks of velocity, acceleration and jerk."""

    curve: MotionCurve
    peak: float
    velocity: float
    acceleration: float
    jerk: float


def least_peak(
    goal: Goal = "acceleration",
    *,
    start: Sequence[float | None] = (0.0, 0.0, 0.0),
    end: Sequence[float | None] = (1.0, 0.0, 0.0),
    over: float = 1.0,
    limits: Mapping[int, float] | None = None,
    smooth: int | None = None,
    mass: float = 1.0,
    stiffness: float = 0.0,
    load: float = 0.0,
    least_force: float | None = None,
    steps: int = 64,
) -> Optimum:
    """The rise over ``over`` between two states with the least peak of the goal.

    ``start``, ``end``: (value, velocity, acceleration, ...) with respect to the master; what is left out, or None, is free.
    ``limits``: {order: largest size} of other derivatives. ``smooth``: the derivative held constant over the steps (all below
    are continuous); default the goal's own (bang-bang), 3 for force. Goal "force": the contact force
    ``mass s'' + stiffness s + load`` (mass in force per unit of s'', that is m w^2), whose largest value is made least while it
    stays above ``least_force`` (contact kept with that margin). Raises where no law satisfies the conditions.
    """
    from scipy.optimize import linprog

    control = smooth if smooth is not None else (3 if goal == "force" else _ORDER[goal])
    order = 2 if goal == "force" else _ORDER[goal]
    limits = dict(limits or {})
    if control < order or control < max(limits, default=1) or control > 6:
        raise MechanismError(
            Fault("law.smooth", f"{control} is below the derivative that is limited.", f"Give {max([order, *limits])} to 6.")
        )
    if len(start) > control or len(end) > control:
        start, end = start[:control], end[:control]
    n = steps
    h = 1.0 / n  # everything is scaled to the unit range
    # states at the steps as linear functions of the controls and of the state at the start
    size = n + control  # unknowns: controls, start state
    state = np.zeros((n + 1, control, size))
    state[0, :, n:] = np.eye(control)
    shift = np.array([[h ** (j - i) / factorial(j - i) if j >= i else 0.0 for j in range(control)] for i in range(control)])
    gain = np.array([h ** (control - i) / factorial(control - i) for i in range(control)])
    for k in range(n):
        state[k + 1] = shift @ state[k]
        state[k + 1, :, k] += gain
    eq, eq_value = [], []
    for k, given in ((0, start), (n, end)):
        for i, value in enumerate(given):
            if value is None:
                continue
            eq.append(np.append(state[k, i], 0.0))
            eq_value.append(value * over**i)
    low: list[Real] = []
    low_value: list[float] = []

    def rows_of(i: int) -> Real:
        if i == control:
            return np.hstack([np.eye(n), np.zeros((n, control))])
        return state[:, i, :]

    def bound(rows: Real, t: float, value: float) -> None:
        """rows @ x + t * peak <= value"""
        low.extend(np.hstack([rows, np.full((len(rows), 1), t)]))
        low_value.extend([value] * len(rows))

    for i, value in limits.items():
        bound(rows_of(i), 0.0, value * over**i)
        bound(-rows_of(i), 0.0, value * over**i)
    if goal == "force":
        if control == 2:  # the acceleration is two-sided at the steps
            value_rows = np.vstack([state[:-1, 0], state[1:, 0]])
            rows = mass / over**2 * np.vstack([rows_of(2), rows_of(2)]) + stiffness * value_rows
        else:
            rows = mass / over**2 * state[:, 2] + stiffness * state[:, 0]
        bound(rows, -1.0, -load)
        if least_force is not None:
            bound(-rows, 0.0, load - least_force)
    else:
        bound(rows_of(order), -1.0, 0.0)
        bound(-rows_of(order), -1.0, 0.0)
    cost = np.zeros(size + 1)
    cost[-1] = 1.0
    answer = linprog(
        cost, A_ub=np.array(low), b_ub=low_value, A_eq=np.array(eq), b_eq=eq_value, bounds=(None, None), method="highs"
    )
    if not answer.success or answer.x is None:
        raise MechanismError(
            Fault("law.limits", f"no law keeps to the limits {limits} between these states.", "Loosen a limit or a condition.")
        )
    x = np.asarray(answer.x)[:size]
    # scaled states come out of the same linear maps, so the pieces join exactly up to rounding
    states = state @ x
    pieces = []
    for k in range(n):
        c = np.array([states[k, i] / factorial(i) for i in range(control)] + [x[k] / factorial(control)])
        pieces.append(Piece(h, c, np.zeros((0, 3))))
    curve = MotionCurve(tuple(pieces)).scaled(0.0, over, float(states[0, 0]), 1.0)
    peaks = [abs(peak(curve, i).value) for i in (1, 2, 3)]
    top = float(np.asarray(answer.x)[-1]) if goal == "force" else abs(peak(curve, order).value)
    return Optimum(curve, top, *peaks)
