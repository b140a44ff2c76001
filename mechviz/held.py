"""Values over frames of which some are not known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["held"]

Real = NDArray[np.float64]


def held(values: Real, known: NDArray[np.bool_]) -> Real:
    """Values (F,) with those that are not known taken from the nearest one before, at the start from the first known; zero where
    none is."""
    if known.all():
        return np.asarray(values, float)
    if not known.any():
        return np.zeros(len(values))
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.asarray(values[np.where(last < 0, int(np.argmax(known)), last)], float)
