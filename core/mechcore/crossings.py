"""Where a quantity that depends on forces passes through zero between two frames."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .kinetostatics import Forces, solve_forces

__all__ = ["crossing"]

ROUNDS = 4  # of searches for the moment between two frames, each to an eighth of the one before
PARTS = 8


def crossing(forces: Forces, values: Callable[[Forces], NDArray[np.float64]], t0: float, t1: float, n0: float, n1: float) -> float:
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
