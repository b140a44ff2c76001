"""Newton's method, and the method of Levenberg and Marquardt, for many small systems at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechcore.records import dataclass

Residual = Callable[[Real], tuple[Real, Real]]  # unknowns (..., n) -> values (..., m), derivatives (..., m, n)


def solve_many(jacobian: Real, rhs: Real) -> Real:
    """Solve (..., m, n) systems for (..., m) right-hand sides; minimum-norm least squares if m != n or a system is singular.

    A system with an entry that is not finite gives NaN.
    """
    if jacobian.shape[-1] == jacobian.shape[-2]:
        try:
            return np.linalg.solve(jacobian, rhs[..., None])[..., 0]  # type: ignore[return-value]  # perhaps traced, so not `asarray`
        except np.linalg.LinAlgError:  # one singular system fails the batch
            pass
    bad: Flags = np.asarray(~np.isfinite(jacobian).all(axis=(-1, -2)))
    if bad.any():
        jacobian = np.where(bad[..., None, None], 0.0, jacobian)
    x = (np.linalg.pinv(jacobian, rcond=1e-13) @ rhs[..., None])[..., 0]
    return np.where(bad[..., None], np.nan, x) if bad.any() else np.asarray(x)


def newton(residual: Residual, x: Real, *, tolerance: float = 2e-15, iterations: int = 30) -> tuple[Real, Real, Real]:
    """Solve ``residual(x) = 0`` from starts (..., n); residuals and unknowns are scaled to about 1.

    ``residual`` returns (..., m) values and (..., m, n) derivatives. Returns the best x, the largest residual of each system there,
    and the size of its first correction. Iterates until no system improves any more; a diverging system does not affect others.
    """
    first = None
    best = np.full(x.shape[:-1], np.inf)
    best_x = x
    for k in range(iterations):
        r, j = residual(x)
        size = np.abs(r).max(axis=-1)
        better = size < best
        best_x = np.where(better[..., None], x, best_x)
        gain = size < 0.5 * best
        best = np.where(better, size, best)
        if not (gain & (size > tolerance)).any() and (k >= 12 or not (best > max(1e-8, tolerance)).any()):
            break  # no system improves any more; far from a solution the first steps may increase residuals
        step = solve_many(j, r)
        if first is None:
            first = np.abs(step).max(axis=-1)
        longest = np.abs(step).max(axis=-1, keepdims=True)
        x = x - step * np.minimum(1.0, 1.0 / np.where(longest > 0, longest, 1.0))  # at most one radian per step
    return best_x, best, np.zeros_like(best) if first is None else first


def least_squares(residual: Residual, x: Real, *, iterations: int) -> Real:
    """Residuals (..., m), as in `newton`, at the least sum of squares found from starts (..., n).

    Levenberg's method with one damping for each system, the same for all its unknowns. Marquardt's damping in proportion to the
    diagonal, as in `fit_all`, makes slow progress in the narrow valleys of heavily weighted equations.
    """
    r, jacobian = residual(x)
    cost = (r * r).sum(axis=-1)
    damping = np.full(cost.shape, 1e-2)
    eye = np.eye(x.shape[-1])
    for _ in range(iterations):
        transposed = np.swapaxes(jacobian, -1, -2)
        gradient = (transposed @ r[..., None])[..., 0]
        trial = x - solve_many(transposed @ jacobian + damping[..., None, None] * eye, gradient)
        new_r, new_jacobian = residual(trial)
        new = (new_r * new_r).sum(axis=-1)
        better = new < cost
        x, r = np.where(better[..., None], trial, x), np.where(better[..., None], new_r, r)
        jacobian = np.where(better[..., None, None], new_jacobian, jacobian)
        cost, damping = np.where(better, new, cost), np.where(better, 0.1 * damping, np.minimum(4.0 * damping, 1e12))
    return r


FIRST_DAMPING = 1e-3
LEAST_DAMPING, MOST_DAMPING = 1e-15, 1e10
SETTLED_GAIN = 1e-14  # relative decrease of the sum of squares below which it counts as none
IDLE_STEPS = 8  # successive steps without a larger decrease, after which a problem has settled

Evaluate = Callable[[Real, Index], tuple[Real, Real]]
"""Unknowns (D, N), numbers of the problems (D,) -> residuals (D, M) and their derivatives (D, M, N).
A row of NaN or infinities marks unknowns that are not admissible."""


@dataclass(frozen=True, eq=False)
class Fits:
    """Unknowns (D, N) and sums of squares (D,) of D problems, and which of them have settled (D,)."""

    x: Real
    cost: Real
    settled: Flags


def fit_all(evaluate: Evaluate, x: Real, lower: Real, upper: Real, iterations: int = 1500) -> Fits:
    """Independent least squares problems from starts (D, N), within bounds (N,).

    Steps solve the damped normal equations of the unknowns that are not held at a bound, and are cut at the bounds (projected
    Levenberg-Marquardt; Nocedal and Wright, section 10.3). A step that does not decrease the sum of squares is rejected, and the
    damping is increased.
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
        step = -solve_many(even, np.where(held, 0.0, gradient) / root) / root
        tried = np.clip(x[at] + step, lower, upper)
        new_residual, new_slopes = evaluate(tried, at)
        new_cost = _cost(new_residual)
        better = new_cost < cost[at]
        gain = np.where(better, cost[at] - new_cost, 0.0)
        idle[at] = np.where(gain > SETTLED_GAIN * cost[at], 0, idle[at] + 1)
        won = at[better]
        x[won], residual[won], slopes[won], cost[won] = tried[better], new_residual[better], new_slopes[better], new_cost[better]
        damping[at] = np.clip(np.where(better, damping[at] / 5.0, damping[at] * 4.0), LEAST_DAMPING, MOST_DAMPING)
        done[at] = (idle[at] >= IDLE_STEPS) | (cost[at] == 0.0)
    return Fits(x, cost, done & np.isfinite(cost))


def _cost(residual: Real) -> Real:
    """Sums of squares (D,), infinite where they are not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = np.einsum("dm,dm->d", residual, residual)
    return np.where(np.isfinite(total), total, np.inf)
