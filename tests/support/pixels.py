"""Pictures compared as one sees them: two drawings of the same scene may differ in the last digits of a colour and of an edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SEEN = 16  # levels of 255 by which one channel of a pixel has to change to count
SAME = 1e-3  # part of the pixels that may change, edges of lines drawn a rounding aside, in the same picture


def changed(first: NDArray[np.int_], second: NDArray[np.int_]) -> float:
    """Part of the pixels (rows, columns, RGB) that have another colour; all of them where the pictures have other sizes."""
    if first.shape != second.shape:
        return 1.0
    return float((np.abs(first - second) > SEEN).any(axis=2).mean())


def same(first: NDArray[np.int_], second: NDArray[np.int_]) -> bool:
    """Whether two pictures show the same."""
    return changed(first, second) <= SAME
