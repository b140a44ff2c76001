"""Newton's method for many small systems at once: the blocks that no closed form solves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Residual = Callable[[Any], tuple[Any, Any]]


def solve_many(jacobian: Any, rhs: Any) -> Any:
    """Solve (..., m, n) systems for (..., m) right-hand sides; least squares of least norm where m != n or singular."""
    if jacobian.shape[-1] == jacobian.shape[-2]:
        try:
            return np.linalg.solve(jacobian, rhs[..., None])[..., 0]
        except np.linalg.LinAlgError:  # one singular frame spoils the batch
            pass
    bad = ~np.isfinite(jacobian).all(axis=(-1, -2))
    if bad.any():
        jacobian = np.where(bad[..., None, None], 0.0, jacobian)
    x = (np.linalg.pinv(jacobian, rcond=1e-13) @ rhs[..., None])[..., 0]
    return np.where(bad[..., None], np.nan, x) if bad.any() else x


def newton(residual: Residual, x: Any, *, tolerance: float = 2e-15, iterations: int = 30) -> tuple[Any, Any, Any]:
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
