"""Arrays over frames: sums and products that skip plain zeros, rows of plane vectors, control of the memory of arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from ctypes import CDLL
from functools import cache, reduce
from operator import add, mul
from os import environ
from typing import Any, Generic, TypeVar, overload

import numpy as np
from numpy import ndarray

from mechcore.arrays import Complex, Flags, Plane, Real, Values

QUIET: Any = {"invalid": "ignore", "divide": "ignore", "over": "ignore"}  # out of reach or singular: NaN or infinite, no warning
Value = TypeVar("Value")
Scalars = TypeVar("Scalars", Values, Plane)
PLAIN = (ndarray, complex, float, int)  # numbers; not symbols of a program or traced arrays


class lazy(Generic[Value]):
    """`functools.cached_property` without its lock, whose cost matters for few frames."""

    def __init__(self, work: Callable[[Any], Value]):
        self.work, self.__doc__ = work, work.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, holder: None, owner: type) -> lazy[Value]: ...
    @overload
    def __get__(self, holder: object, owner: type) -> Value: ...
    def __get__(self, holder: object, owner: type) -> lazy[Value] | Value:
        if holder is None:
            return self
        value = holder.__dict__[self.name] = self.work(holder)
        return value


def is_zero(a: Plane | Values) -> bool:
    """Whether a term is a plain zero (not an array)."""
    return type(a) is not ndarray and bool(a == 0)


def added(a: Scalars, b: Scalars) -> Scalars:
    """a + b; plain zeros are skipped."""
    if type(a) is not ndarray and a == 0:
        return b
    return a if type(b) is not ndarray and b == 0 else a + b


def subtracted(a: Scalars, b: Scalars) -> Scalars:
    """a - b; plain zeros are skipped."""
    if type(b) is not ndarray and b == 0:
        return a
    return -b if type(a) is not ndarray and a == 0 else a - b


def determined(divisor: Scalars) -> Scalars:
    """A divisor with NaN in place of zero, so that undetermined quotients become NaN without warnings; plain numbers unchanged."""
    if isinstance(divisor, ndarray) and np.count_nonzero(divisor) < divisor.size:
        return np.where(divisor == 0.0, np.nan, divisor)
    return divisor


def summed(terms: Sequence[Plane]) -> Plane:
    """The sum of terms, plain zero if there are none; with one addition less than `sum`."""
    return reduce(add, terms) if terms else 0j


def product(factors: Sequence[Plane]) -> Plane:
    """The product of at least one factor."""
    return reduce(mul, factors)


def crossed(a: Plane, b: Plane) -> Values:
    """z component of the cross product of plane vectors, by one complex product (only `dyads.cross` is exactly 0 for a = b)."""
    return (a.conjugate() * b).imag


def plane(x: float, y: float) -> complex:
    """x + i y, for numbers or symbols."""
    return x + 1j * y


def imaginary(a: Values) -> Plane:
    """1j a for real a: by assignment, which costs less than a product that first makes ``a`` complex."""
    if not isinstance(a, np.ndarray):
        return 1j * a
    out = np.zeros(a.shape, complex)
    out.imag = a
    return out


def plane_rows(shape: tuple[int, ...], z: Plane, third: Values) -> Real:
    """Plane vectors and a third number as rows of three (*shape, 3)."""
    if not isinstance(z, PLAIN) or not isinstance(third, PLAIN):  # symbols or traced arrays
        return stacked([z.real, z.imag, third], shape)
    out = np.zeros((*shape, 3))
    np.ndarray(shape, complex, out, 0, out.strides[:-1])[...] = z  # both columns at once
    if isinstance(third, np.ndarray) or third != 0.0:
        out[..., 2] = third
    return out


def stacked(parts: Sequence[Values], shape: tuple[int, ...]) -> Real:
    """Numbers broadcast to ``shape`` and stacked along a last axis (*shape, n); arrays and plain numbers by assignment."""
    if not all(isinstance(x, PLAIN) for x in parts):
        side_by_side: Real = np.stack([np.broadcast_to(x, shape) for x in parts], axis=-1)
        return side_by_side
    out = np.empty((*shape, len(parts)))
    for k, x in enumerate(parts):
        out[..., k] = x
    return out


def purely_imaginary(z: Plane) -> Plane:
    """i Im z; an array ``z`` is changed in place."""
    if not isinstance(z, np.ndarray):
        return 1j * z.imag
    z.real = 0.0
    return z


def rotation_of(angle: Values) -> Complex:
    """exp(i angle) of real angles."""
    out = np.empty(angle.shape if isinstance(angle, np.ndarray) else np.shape(angle), complex)
    np.cos(angle, out=out.real)
    np.sin(angle, out=out.imag)
    return out


def runs(flags: Flags) -> list[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8  # of glibc's malloc.h
LARGEST_BLOCK = 2**25  # of memory that is kept: glibc accepts no more than 32 MiB
MOST_KEPT = 2**28  # memory of a four-bar's motion over some 400,000 frames


@cache
def keep_freed_memory() -> None:
    """Let the C library keep up to 256 MiB of freed memory for the next arrays, if it can; once per process.

    The environment variable ``MALLOC_TRIM_THRESHOLD_`` takes precedence.
    """
    if "MALLOC_TRIM_THRESHOLD_" in environ:
        return
    with suppress(AttributeError, OSError, TypeError):
        library = CDLL(None)
        library.mallopt(MMAP_THRESHOLD, LARGEST_BLOCK)
        library.mallopt(TRIM_THRESHOLD, MOST_KEPT)


def give_back_memory() -> None:
    """Let the C library return freed memory to the system, if it can: before work that needs memory from elsewhere."""
    with suppress(AttributeError, OSError, TypeError):  # of glibc
        CDLL(None).malloc_trim(0)


def share_memory() -> None:
    """Let all threads share two pools of memory, if the C library can: each pool keeps the most that it ever needed."""
    with suppress(AttributeError, OSError, TypeError):
        CDLL(None).mallopt(ARENA_MAX, 2)
