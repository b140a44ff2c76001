"""Several freedoms: the mechanism in a chart of its configurations, with some of its coordinates free and others held.

A chart is a choice of pair coordinates that, taken as drives, decide the configuration. Positions are solved on the manifold
itself for every node, so nothing drifts and redundant constraints do no harm.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..solve import Compiled
from .reduced import free_of, reduce

__all__ = ["Chart", "differences"]

Array = NDArray[np.float64]
STEP = 1e-7  # of a finite difference; slopes only steer Newton's method


class Chart:
    """Accelerations of all coordinates (n, f); those that are ``held`` stand still, and `holding` gives what that takes."""

    def __init__(self, compiled: Compiled, held: frozenset[int] = frozenset()):
        self.compiled = compiled
        count = len(free_of(compiled))
        self.held = np.array(sorted(held), int)
        self.free = np.array([i for i in range(count) if i not in held], int)

    def __call__(self, q: Array, v: Array, t: Array) -> Array:
        return self._solve(q, v, t)[0]

    def _solve(self, q: Array, v: Array, t: Array) -> tuple[Array, Any]:
        r = reduce(self.compiled, q, v, t)
        if not len(self.held):
            return r.acceleration(), r
        a = np.zeros_like(q)
        if len(self.free):
            inner = r.inertia[:, self.free[:, None], self.free]
            a[:, self.free] = np.linalg.solve(inner, (r.force - r.bias)[:, self.free, None])[..., 0]
        return a, r

    def holding(self, q: Array, v: Array, t: Array) -> Array:
        """What holds the held coordinates (n, h): torque [N m] or force [N] in the direction of each."""
        a, r = self._solve(q, v, t)
        return ((r.inertia @ a[..., None])[..., 0] + r.bias - r.force)[:, self.held]

    def slopes(self, q: Array, v: Array, t: Array, a: Array) -> tuple[Array, Array]:
        """Derivatives of the accelerations by position and speed (n, f, f) each, by differences, all in one call."""
        return differences(self, q, v, t, a)


def differences(system: Any, q: Array, v: Array, t: Array, a: Array) -> tuple[Array, Array]:
    """Slopes of a system's accelerations by position and speed (n, f, f) each, by differences, all in one call."""
    n, f = q.shape
    many_q, many_v = np.tile(q, (2 * f, 1)), np.tile(v, (2 * f, 1))
    step_q = STEP * np.maximum(1.0, np.abs(q).max(axis=0))
    step_v = STEP * np.maximum(1.0, np.abs(v).max(axis=0))
    for k in range(f):
        many_q[k * n : (k + 1) * n, k] += step_q[k]
        many_v[(f + k) * n : (f + k + 1) * n, k] += step_v[k]
    changed = system(many_q, many_v, np.tile(t, 2 * f)).reshape(2 * f, n, f) - a
    by_q = np.moveaxis(changed[:f] / step_q[:, None, None], 0, -1)
    by_v = np.moveaxis(changed[f:] / step_v[:, None, None], 0, -1)
    return by_q, by_v
