"""What one does with values at evenly spaced angles of a turn: rates by differences, values at other angles by splines.

For peers that give positions only, or that are too slow to be asked at every angle. Everything repeats after a turn, so that there
are no ends: the most exact that can be had from so many values.
"""

from __future__ import annotations

from functools import partial

import numpy as np

__all__ = ["DIFFERENCES", "at_any_angle", "from_fewer", "with_rates"]

DIFFERENCES = (2, 4, 6)
"""Orders."""

FEW = (24, 48, 96, 180, 360, 720)
"""Positions of a turn between which is interpolated."""

FIRST = {2: (1 / 2,), 4: (2 / 3, -1 / 12), 6: (3 / 4, -3 / 20, 1 / 60)}
SECOND = {2: (-2.0, 1.0), 4: (-5 / 2, 4 / 3, -1 / 12), 6: (-49 / 18, 3 / 2, -3 / 20, 1 / 90)}
"""Weights of central differences, from the middle outwards."""


def with_rates(solve, order, speed, turn):
    """Positions over a turn, with velocities and accelerations by central differences of an order."""
    solution = solve(turn)
    step = (turn[1] - turn[0]) / speed
    for (point, derivative), x in list(solution.items()):
        if derivative:
            continue
        joints = [(np.roll(x, -k, axis=0), np.roll(x, k, axis=0)) for k in range(1, order // 2 + 1)]
        first = sum(w * (a - b) for w, (a, b) in zip(FIRST[order], joints, strict=True))
        second = SECOND[order][0] * x + sum(w * (a + b) for w, (a, b) in zip(SECOND[order][1:], joints, strict=True))
        solution[point, 1], solution[point, 2] = first / step, second / step**2
    return solution


def at_any_angle(solve, turn, speed, wanted):
    """Values at wanted angles by a periodic spline of degree 5 through those at the angles of a turn; rates that ``solve`` does not
    give are the spline's."""
    from scipy.interpolate import make_interp_spline

    result = {k: v.reshape(len(turn), -1) for k, v in solve(turn).items()}
    values = np.concatenate([*result.values()], axis=1)
    spline = make_interp_spline(np.append(turn, 2.0 * np.pi), np.vstack([values, values[:1]]), k=5, bc_type="periodic")
    out, at = {}, 0
    every = [spline(wanted), None, None]
    for key, value in result.items():
        part = slice(at, at + value.shape[1])
        out[key] = every[0][:, part] if value.shape[1] > 1 else every[0][:, at]
        at += value.shape[1]
        if isinstance(key, tuple) and key[1] == 0 and (key[0], 1) not in result:
            for d in (1, 2):
                every[d] = spline(wanted, d) if every[d] is None else every[d]
                out[key[0], d] = every[d][:, part] * speed**d
    return out


def from_fewer(solve, speed):
    """Setting -> a function of the wanted angles, for `FEW` positions of a turn."""
    from problem import angles

    return {f"{n} positions, splines": partial(at_any_angle, solve, angles(n), speed) for n in FEW}
