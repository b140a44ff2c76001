"""Small sums over frames that cost nothing where there is nothing to add: numpy's fixed price per call counts at few frames."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["added", "nothing", "rotation_of"]

Array = Any


def nothing(a: Array) -> bool:
    """Whether a term is a plain zero (not an array)."""
    return isinstance(a, complex | float) and a == 0


def added(a: Array, b: Array, sign: int = 1) -> Array:
    """a + b, or a - b, plain zeros left out."""
    if nothing(b):
        return a
    if nothing(a):
        return b if sign == 1 else -b
    return a + b if sign == 1 else a - b


def rotation_of(angle: Array) -> Array:
    """exp(i angle) of real angles."""
    out = np.empty(np.shape(angle), complex)
    np.cos(angle, out=out.real)
    np.sin(angle, out=out.imag)
    return out
