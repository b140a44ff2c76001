"""Newton's method, and that of Levenberg and Marquardt, for many small systems at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mechcore.arrays import Flags, Real

Residual = Callable[[Real], tuple[Real, Real]]  # unknowns (..., n) -> values (..., m), derivatives (..., m, n)


def solve_many(jacobian: Real, rhs: Real) -> Real:
    """Solve (..., m, n) systems for (..., m) right-hand sides; least squares of least norm where m != n or singular."""
    if jacobian.shape[-1] == jacobian.shape[-2]:
        try:
            return np.linalg.solve(jacobian, rhs[..., None])[..., 0]  # type: ignore[return-value]  # perhaps traced, so not `asarray`
        except np.linalg.LinAlgError:  # one singular frame spoils the batch
            pass
    bad: Flags = np.asarray(~np.isfinite(jacobian).all(axis=(-1, -2)))
    if bad.any():
        jacobian = np.where(bad[..., None, None], 0.0, jacobian)
    x = (np.linalg.pinv(jacobian, rcond=1e-13) @ rhs[..., None])[..., 0]
    return np.where(bad[..., None], np.nan, x) if bad.any() else np.asarray(x)


def newton(residual: Residual, x: Real, *, tolerance: float = 2e-15, iterations: int = 30) -> tuple[Real, Real, Real]:
    """Solve ``residual(x) = 0`` from starts (..., n); residuals and unknowns are scaled to about 1.

    ``residual`` returns (..., m) values and (..., m, n) derivatives. Returns x, the largest residual of each system and the size
    of its first correction. Iterates until no system improves any more; a system that diverges only spoils itself.
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
            break  # nothing improves any more; far from a solution the first steps may go uphill
        step = solve_many(j, r)
        if first is None:
            first = np.abs(step).max(axis=-1)
        longest = np.abs(step).max(axis=-1, keepdims=True)
        x = x - step * np.minimum(1.0, 1.0 / np.where(longest > 0, longest, 1.0))  # never more than a radian at once
    return best_x, best, np.zeros_like(best) if first is None else first


def least_squares(residual: Residual, x: Real, *, iterations: int) -> Real:
    """Values (..., m) of a residual as in `newton` where the sum of their squares is least, from starts (..., n); by the method of
    Levenberg and Marquardt with a damping of its own for each system."""
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
