"""Functions of one coordinate as Chebyshev polynomials on panels: values and exact derivatives for many arguments at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from mechcore.arrays import Index, Real
from mechcore.records import dataclass

PANEL_NODES = 16  # of a panel
TAIL_NOISE = 1e-9  # tails below this that no longer decrease are rounding
MANY_ARGUMENTS = 48  # arguments from which the recurrence of the polynomials is faster than their cosines
LONG_RUNS = 12  # mean number of successive arguments on one panel from which evaluation panel by panel pays
_ORDERS = np.arange(PANEL_NODES + 2.0)[None]
NODES = -np.cos(
    np.pi * (np.arange(PANEL_NODES) + 0.5) / PANEL_NODES
)  # Chebyshev points of the first kind in [-1, 1]: none on a boundary of a panel, where assembly modes may meet
FIT = np.linalg.inv(chebyshev.chebvander(NODES, PANEL_NODES - 1))


@lru_cache
def _derivative_matrix(n: int) -> Real:
    """The matrix (n, n) from Chebyshev coefficients of a function to those of its derivative."""
    out = np.zeros((n, n))
    for k in range(n):
        unit = np.zeros(n)
        unit[k] = 1.0
        d = chebyshev.chebder(unit)
        out[: len(d), k] = d
    return out


def _integral_matrix(n: int) -> Real:
    """The matrix (n + 1, n) from Chebyshev coefficients to those of the integral that vanishes at the left boundary."""
    return np.column_stack(
        [np.pad(chebyshev.chebint(unit, lbnd=-1), (0, n - k - 1)) for k, unit in enumerate(map(_unit, range(n)))]
    )


def _unit(k: int) -> Real:
    out = np.zeros(k + 1)
    out[k] = 1.0
    return out


_INT = _integral_matrix(PANEL_NODES)


def _polynomials(z: Real, n: int) -> Real:
    """Chebyshev polynomials T_0 .. T_(n-1) at z (m,), within [-1, 1]: (m, n)."""
    if len(z) < MANY_ARGUMENTS:
        return np.asarray(np.cos(np.multiply.outer(np.arccos(z), np.arange(n))))
    out = np.empty((n, len(z)))
    out[0], out[1] = 1.0, z
    twice = z + z
    for k in range(2, n):
        np.multiply(twice, out[k - 1], out=out[k])
        out[k] -= out[k - 2]
    return out.T


@dataclass(frozen=True, eq=False)
class Panels:
    """``coefficients`` (p, n, c) of c functions on p panels: of equal ``width`` from ``low`` on, or between ``boundaries``
    (p + 1,). With ``periodic`` the functions repeat after the last panel."""

    low: float
    width: float
    coefficients: Real
    periodic: bool
    boundaries: Real | None = None

    @property
    def count(self) -> int:
        return len(self.coefficients)

    @property
    def high(self) -> float:
        return self.low + self.width * self.count if self.boundaries is None else float(self.boundaries[-1])

    @property
    def widths(self) -> Any:
        """Widths of the panels (p, 1, 1), or one number if they are equal."""
        return self.width if self.boundaries is None else np.diff(self.boundaries)[:, None, None]

    @property
    def least(self) -> float:
        """Width of the narrowest panel."""
        return self.width if self.boundaries is None else float(np.diff(self.boundaries).min())

    @property
    def mean(self) -> float:
        """Mean width of the panels."""
        return (self.high - self.low) / self.count

    def within_panel(self, x: float, step: Real) -> Real:
        """Signed displacements ``step`` (n,) from x, each no longer than a panel, cut at the boundary of the panel that they start
        in. With equal panels, those of one smooth function, nothing is cut."""
        if self.boundaries is None:
            return step
        length, edges = self.high - self.low, self.boundaries
        u = x - length * np.floor((x - self.low) / length) if self.periodic else x
        k = int(np.clip(np.searchsorted(edges, u, side="right"), 1, self.count))
        ahead = edges[k] - u
        behind = edges[k - 1] - u or (edges[k - 2] - u if k > 1 else edges[-2] - edges[-1])
        return np.asarray(np.clip(step, behind, ahead))

    def between(self, low: float, high: float) -> Real:
        """Boundaries (n,) of unequal panels between two arguments, those of all periods if periodic."""
        assert self.boundaries is not None
        length = self.high - self.low
        first, last = np.floor((np.array([low, high]) - self.low) / length) if self.periodic else (0.0, 0.0)
        x = np.unique(np.add.outer(length * np.arange(first, last + 1.0), self.boundaries))
        return np.asarray(x[(x > low) & (x < high)])

    def __call__(self, x: Real) -> Real:
        """Values (n, c) of the functions at x (n,). Beyond the panels, if they are not periodic: NaN for equal panels, the value at
        the end for unequal ones."""
        if len(x) == 1 and math.isfinite(place := float(x[0])):
            return self._at_one(place)
        if self.boundaries is not None:
            if self.periodic:
                x = x - (self.high - self.low) * np.floor((x - self.low) / (self.high - self.low))
            cell = self.boundaries[1:-1].searchsorted(x, side="right")
            z = 2.0 * (x - self.boundaries[cell]) / (self.boundaries[cell + 1] - self.boundaries[cell]) - 1.0
            return self._at(cell, z)
        u = (x - self.low) / self.width
        if self.periodic:
            k = np.floor(u)
            cell = k.astype(int) % self.count
            z = 2.0 * (u - k) - 1.0
        else:
            cell = np.minimum(np.maximum(u.astype(int), 0), self.count - 1)
            z = 2.0 * (u - cell) - 1.0
            outside = np.abs(z) > 1.0 + 1e-9
            if outside.any():
                z = np.where(outside, np.nan, z)
        return self._at(cell, z)

    def _at(self, cell: Index, z: Real) -> Real:
        """Values (n, c) of the functions at z (n,) in [-1, 1] on panels ``cell`` (n,)."""
        basis = _polynomials(np.minimum(np.maximum(z, -1.0), 1.0), self.coefficients.shape[1])
        ends = np.flatnonzero(cell[1:] != cell[:-1]) + 1
        if len(cell) < LONG_RUNS * (len(ends) + 1):
            return np.asarray((basis[:, None, :] @ self.coefficients.take(cell, axis=0))[:, 0, :])
        out = np.empty((len(cell), self.coefficients.shape[2]))
        for first, last in pairwise([0, *ends.tolist(), len(cell)]):  # all successive arguments on one panel together
            np.matmul(basis[first:last], self.coefficients[cell[first]], out=out[first:last])
        return out

    def _at_one(self, x: float) -> Real:
        """Values (1, c) of the functions at one argument."""
        cells = self.count
        if self.boundaries is not None:
            if self.periodic:
                x -= (self.high - self.low) * math.floor((x - self.low) / (self.high - self.low))
            cell = int(self.boundaries[1:-1].searchsorted(x, side="right"))
            low, high = float(self.boundaries[cell]), float(self.boundaries[cell + 1])
            z = 2.0 * (x - low) / (high - low) - 1.0
        else:
            u = (x - self.low) / self.width
            k = math.floor(u) if self.periodic else min(max(int(u), 0), cells - 1)
            cell, z = k % cells, 2.0 * (u - k) - 1.0
            if not self.periodic and abs(z) > 1.0 + 1e-9:
                return np.full((1, self.coefficients.shape[2]), np.nan)
        basis = np.cos(math.acos(min(max(z, -1.0), 1.0)) * _ORDERS[:, : self.coefficients.shape[1]])
        return np.asarray(basis @ self.coefficients[cell])

    def _with(self, coefficients: Real) -> Panels:
        """Other functions on the same panels. (`dataclasses.replace` takes several times as long.)"""
        return Panels(self.low, self.width, coefficients, self.periodic, self.boundaries)

    def derivative(self) -> Panels:
        """The functions' derivatives by x."""
        inner = _derivative_matrix(self.coefficients.shape[1]) @ self.coefficients
        return self._with((2.0 / self.widths) * inner)

    def integral(self) -> Panels:
        """The functions' integrals from ``low`` on (not periodic, even if the functions are)."""
        inner = 0.5 * self.widths * (_INT @ self.coefficients)
        gains = inner.sum(axis=1)  # values at the right boundaries: every Chebyshev polynomial is 1 there; 0 at the left
        start = np.concatenate([np.zeros((1, gains.shape[1])), np.cumsum(gains, axis=0)[:-1]])
        inner[:, 0] += start
        return Panels(self.low, self.width, inner, False, self.boundaries)

    def with_integral(self, k: int) -> Panels:
        """The functions and, as the last one, the integral of function k from ``low`` on (not periodic)."""
        p, n, c = self.coefficients.shape
        out = np.zeros((p, n + 1, c + 1))
        out[:, :n, :c] = self.coefficients
        out[:, :, c] = self.only(k).integral().coefficients[:, :, 0]
        return Panels(self.low, self.width, out, False, self.boundaries)

    def stacked(self, other: Panels) -> Panels:
        """The functions of both, on the panels of this one."""
        return self._with(np.concatenate([self.coefficients, other.coefficients], axis=2))

    def joined(self) -> Panels:
        """The same functions without the jumps between panels due to rounding: both sides take the mean value, and the correction
        is linear within a panel."""
        left = self.coefficients[:, ::2].sum(axis=1) - self.coefficients[:, 1::2].sum(axis=1)
        right = self.coefficients.sum(axis=1)
        jumps = 0.5 * (left - np.roll(right, 1, axis=0))
        if not self.periodic:
            jumps[0] = 0.0
        ends = np.roll(jumps, -1, axis=0)
        coefficients = self.coefficients.copy()
        coefficients[:, 0] += 0.5 * (ends - jumps)
        coefficients[:, 1] += 0.5 * (ends + jumps)
        return self._with(coefficients)

    def only(self, k: int) -> Panels:
        """Function k alone."""
        return self._with(self.coefficients[:, :, k : k + 1])

    def tail(self) -> Real:
        """Largest of the last three coefficients of each function, relative to its largest (c,)."""
        largest = np.abs(self.coefficients).max(axis=(0, 1))
        return np.asarray(np.abs(self.coefficients[:, -3:]).max(axis=(0, 1)) / np.where(largest > 0, largest, 1.0))


def nodes_of(low: float, high: float, count: int) -> Real:
    """Nodes (count * PANEL_NODES,) of ``count`` equal panels between ``low`` and ``high``, in order."""
    width = (high - low) / count
    centres = low + width * (np.arange(count) + 0.5)
    return np.asarray((centres[:, None] + 0.5 * width * NODES).ravel())


def fit_panels(
    function: Callable[[Real], Real],
    low: float,
    high: float,
    *,
    periodic: bool,
    tolerance: float,
    first: int = 8,
    most: int = 4096,
    known: Real | None = None,
) -> Panels:
    """Equal panels of ``function(x) -> (n, c)`` whose last coefficients are below ``tolerance`` relative to the largest.

    All panels are halved together until then, until the last coefficients are rounding, or until there would be more than ``most``.
    ``known``: the values at the `nodes_of` the ``first`` panels, if already computed.
    """
    count = first
    previous: Any = np.inf
    coarser: Any = None
    while True:
        width = (high - low) / count
        values = function(nodes_of(low, high, count)) if known is None else known
        known = None
        coefficients = FIT @ values.reshape(count, PANEL_NODES, -1)
        panels = Panels(low, width, coefficients, periodic)
        tail = float(panels.tail().max())
        if previous < TAIL_NOISE and tail > 0.3 * previous:  # the tail is rounding, which smaller panels do not reduce
            return coarser if previous < tail else panels
        if tail <= tolerance or 2 * count > most:
            return panels
        previous, coarser, count = tail, panels, 2 * count


def fit_where_needed(
    function: Callable[[Real], Real],
    boundaries: Real,
    *,
    tolerance: float,
    most: int = 4096,
    periodic: bool = False,
    noise: float = TAIL_NOISE,
) -> tuple[Panels, float]:
    """Unequal panels of ``function(x) -> (n, c)``, and the largest of their last coefficients.

    Each panel is halved until its last coefficients are below ``tolerance`` relative to the largest of all, or are rounding, less
    than ``noise``. Halving ends after ``most`` panels have been fitted, or at a value that is not finite.
    """
    whole = boundaries[-1] - boundaries[0]
    edges = np.stack([boundaries[:-1], boundaries[1:]], axis=1)
    before = np.full(len(edges), np.inf)
    largest: Any = 0.0
    done: list[tuple[Real, Real, Real]] = []
    count = 0
    while True:
        low, width = edges[:, 0], edges[:, 1] - edges[:, 0]
        nodes = (low + 0.5 * width)[:, None] + 0.5 * width[:, None] * NODES
        coefficients = FIT @ function(nodes.ravel()).reshape(len(edges), PANEL_NODES, -1)
        sizes = np.abs(coefficients)
        largest = np.maximum(largest, sizes.max(axis=(0, 1)))
        tail = (sizes[:, -3:].max(axis=1) / np.where(largest > 0, largest, 1.0)).max(axis=1)
        fine = (tail <= tolerance) | ((before < noise) & (tail > 0.3 * before)) | (width <= 1e-13 * whole)
        count += len(edges)
        if not np.isfinite(tail).all() or count > most:
            fine[:] = True
        if fine.any():
            done.append((edges[fine, 0], coefficients[fine], tail[fine]))
        if fine.all():
            break
        middle = 0.5 * edges[~fine].sum(axis=1)
        edges = np.stack([edges[~fine, 0], middle, middle, edges[~fine, 1]], axis=1).reshape(-1, 2)
        before = np.repeat(tail[~fine], 2)
    lows, series, tails = (np.concatenate(x) for x in zip(*done, strict=True)) if len(done) > 1 else done[0]
    order = np.argsort(lows)
    panels = Panels(float(boundaries[0]), np.nan, series[order], periodic, np.append(lows[order], boundaries[-1]))
    return panels, float(tails.max())
