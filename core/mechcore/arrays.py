"""Types of arrays (real and complex numbers, indices, flags; docstrings give the shapes), and a few functions of arrays."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.intp]
Integers = NDArray[np.int64]  # frames, and ticks of timelines
Single = NDArray[np.float32]  # drawn data
Flags = NDArray[np.bool_]
Values = NDArray[np.floating[Any]] | float  # numbers over frames, or one for all
Vec2 = tuple[float, float]  # a plane vector as given by the user
Plane = NDArray[np.complexfloating[Any, Any]] | complex  # plane vectors over frames, or one for all


modulus = cast(Callable[[Plane | Values], Values], abs)
"""Lengths of plane vectors, or absolute values of numbers; plain numbers stay plain."""


def unit_vectors(z: Plane) -> Complex:
    """z divided by its length; z may be symbols. NaN stays NaN without the warning that the division of a complex NaN gives."""
    return cast(Complex, z * (1.0 / np.abs(z)))


def numbers(values: ArrayLike) -> Real:
    """Values as an array of one dimension or more; a symbol of a program in C is returned unchanged."""
    return cast(Real, values) if hasattr(values, "on_curve") else np.array(values, float, ndmin=1, copy=None)


def ascending(values: Real) -> Real:
    """The distinct values in ascending order. `np.unique` would first load numpy's masked arrays: a tenth of a short command."""
    ordered = np.sort(values)
    return cast(Real, ordered[np.append(True, ordered[1:] != ordered[:-1])])
