"""Nonlinear least squares of many problems of one shape side by side, with bounds: Levenberg and Marquardt in arrays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechcore.records import dataclass

FIRST_DAMPING = 1e-3
LEAST_DAMPING, MOST_DAMPING = 1e-15, 1e10
SETTLED = 1e-14  # relative gain of the sum of squares that is no gain any more
PATIENCE = 8  # steps in a row without a gain of that size

Evaluate = Callable[[Real, Index], tuple[Real, Real]]
"""Residuals (D, M) and their derivatives (D, M, N) of problems at (D, N); the second argument says which problems they are.
A row of NaN or infinities is a place that cannot be had."""


@dataclass(frozen=True, eq=False)
class Fits:
    """Unknowns (D, N) and sums of squares (D,) of D problems, and which of them settled (D,)."""

    x: Real
    cost: Real
    settled: Flags


def fit_all(evaluate: Evaluate, x: Real, lower: Real, upper: Real, iterations: int = 1500) -> Fits:
    """Least squares from starts (D, N), each by itself, within bounds (N,).

    Steps solve the damped normal equations of the unknowns that are not held at a bound, and are cut at the bounds (projected
    Levenberg-Marquardt; Nocedal and Wright, section 10.3). A step that does not gain is taken back and damped more.
    """
    x = np.clip(x, lower, upper)
    count, size = x.shape
    numbers = np.arange(count)
    residual, slopes = evaluate(x, numbers)
    cost = _cost(residual)
    damping = np.full(count, FIRST_DAMPING)
    idle = np.zeros(count, int)
    done = ~np.isfinite(cost)
    diagonal = np.arange(size)
    for _ in range(iterations):
        at = np.flatnonzero(~done)
        if not at.size:
            break
        j, r = slopes[at], residual[at]
        across = np.swapaxes(j, 1, 2)
        gradient = (across @ r[..., None])[..., 0]
        held = ((x[at] <= lower) & (gradient > 0.0)) | ((x[at] >= upper) & (gradient < 0.0))
        normal = np.where(held[:, :, None] | held[:, None, :], 0.0, across @ j)
        scale = normal[:, diagonal, diagonal]
        scale = np.maximum(scale, 1e-14 * np.maximum(scale.max(1, keepdims=True), 1e-300))
        normal[:, diagonal, diagonal] += damping[at, None] * scale
        root = np.sqrt(normal[:, diagonal, diagonal])
        even = normal / (root[:, :, None] * root[:, None, :])
        step = -np.linalg.solve(even, (np.where(held, 0.0, gradient) / root)[..., None])[..., 0] / root
        tried = np.clip(x[at] + step, lower, upper)
        new_residual, new_slopes = evaluate(tried, at)
        new_cost = _cost(new_residual)
        better = new_cost < cost[at]
        gain = np.where(better, cost[at] - new_cost, 0.0)
        idle[at] = np.where(gain > SETTLED * cost[at], 0, idle[at] + 1)
        won = at[better]
        x[won], residual[won], slopes[won], cost[won] = tried[better], new_residual[better], new_slopes[better], new_cost[better]
        damping[at] = np.clip(np.where(better, damping[at] / 5.0, damping[at] * 4.0), LEAST_DAMPING, MOST_DAMPING)
        done[at] = (idle[at] >= PATIENCE) | (cost[at] == 0.0)
    return Fits(x, cost, done & np.isfinite(cost))


def _cost(residual: Real) -> Real:
    """Sums of squares, infinite where they are no numbers."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = np.einsum("dm,dm->d", residual, residual)
    return np.where(np.isfinite(total), total, np.inf)
