"""Turns about z as quaternions x, y, z, w, for all pictures; what wants w first rolls them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["about_z"]


def about_z(angle: Any) -> NDArray[np.float64]:
    """Unit quaternions (..., 4) of turns by ``angle`` (...) [rad]; continuous where the angle is."""
    half = 0.5 * np.asarray(angle, float)
    nothing = np.zeros_like(half)
    return np.stack([nothing, nothing, np.sin(half), np.cos(half)], axis=-1)
