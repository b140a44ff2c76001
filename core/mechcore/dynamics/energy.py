"""Motion of one freedom by its energy, where all forces depend on the position alone.

Then T(q) = T_0 + integral of Q dq, q'^2 = 2 T / J, and time is a plain integral, t = integral of dq / q': no step in time is
made at all. At turning points, where q' vanishes, a quadratic substitution makes the integrand smooth (theory 8.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .curve import TURN, Curve
from .panels import Panels, fit_panels

__all__ = ["EnergyMotion", "by_energy"]

Array = NDArray[np.float64]
_X, _W = np.polynomial.legendre.leggauss(12)
_GAUSS = 0.5 * (_X + 1.0), 0.5 * _W


@dataclass(frozen=True, eq=False)
class Leg:
    """A way without turning back: ``q = start + length f(u)``, u in [0, 1], f by ``ends`` (which ends are turning points);
    ``clock``: dt/du and t(u) - ``time`` as panels."""

    start: float
    length: float
    ends: tuple[bool, bool]
    time: float
    clock: Panels

    @cached_property
    def edges(self) -> Array:
        """Times [s] since the leg's start at which its panels begin and end (p + 1,)."""
        signs = (-1.0) ** np.arange(self.clock.coefficients.shape[1])
        return np.append(self.clock.coefficients[:, :, 1] @ signs, self.clock.coefficients[-1, :, 1].sum())

    @property
    def duration(self) -> float:
        return float(self.edges[-1])

    def __call__(self, t: Array) -> tuple[Array, Array]:
        """Position and speed (n,) at times (n,) within the leg."""
        edges, count = self.edges, self.clock.count
        local = np.minimum(np.maximum(t - self.time, 0.0), self.duration)
        cell = np.minimum(np.searchsorted(edges[:-1], local, side="right") - 1, count - 1)
        cell = np.maximum(cell, 0)
        low, high = cell / count, (cell + 1) / count
        u = low + (local - edges[cell]) / (edges[cell + 1] - edges[cell]) / count
        for _ in range(40):
            rate, clock = self.clock(u).T
            miss = clock - local
            high, low = np.where(miss > 0, np.minimum(high, u), high), np.where(miss <= 0, np.maximum(low, u), low)
            new = u - miss / rate
            new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
            done = np.abs(new - u).max(initial=0.0) < 4e-16
            u = new
            if done:
                break
        f, slope = _way(u, self.ends)
        return self.start + self.length * f, self.length * slope / self.clock(u)[:, 0]


def _way(u: Array, ends: tuple[bool, bool]) -> tuple[Array, Array]:
    """f(u) on [0, 1] and its slope: flat at the ends that are turning points."""
    if ends == (True, True):
        return np.sin(0.5 * np.pi * u) ** 2, 0.5 * np.pi * np.sin(np.pi * u)
    if ends == (True, False):
        return u * u, 2.0 * u
    if ends == (False, True):
        return u * (2.0 - u), 2.0 - 2.0 * u
    return u, np.ones_like(u)


@dataclass(frozen=True, eq=False)
class EnergyMotion:
    """The motion over its legs; beyond the last one it repeats with ``period`` [s] and ``advance`` [rad], where that is given."""

    curve: Curve
    legs: tuple[Leg, ...]
    period: float | None
    advance: float

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration (n, 1) at times (n,)."""
        t = np.atleast_1d(np.asarray(t, float))
        turns: Array = np.zeros_like(t)
        if self.period is not None:
            end = self.legs[-1].time + self.legs[-1].duration
            turns = np.where(t > end, np.ceil((t - end) / self.period), 0.0)
        local = t - turns * (self.period or 0.0)
        starts = np.array([leg.time for leg in self.legs])
        which = np.clip(np.searchsorted(starts, local, side="right") - 1, 0, len(self.legs) - 1)
        q, v = np.empty_like(t), np.empty_like(t)
        for k in np.unique(which):
            rows = which == k
            q[rows], v[rows] = self.legs[k](local[rows])
        q += turns * self.advance
        a = self.curve(q[:, None], v[:, None], t)
        return q[:, None], v[:, None], a

    def borders(self, end: float) -> Array:
        """Times until ``end`` [s] between which the motion is one smooth function."""
        legs = [leg.time + np.unique(leg.edges[:-1]) for leg in self.legs]
        found = np.concatenate(legs)
        last = self.legs[-1].time + self.legs[-1].duration
        if self.period is not None and end > last:
            again = found[found >= last - self.period * (1.0 + 1e-12)]
            turns = np.arange(1, int(np.ceil((end - last) / self.period)) + 1)
            found = np.concatenate([found, (again + turns[:, None] * self.period).ravel()])
        return np.asarray(found[(found >= 0.0) & (found < end)])


SMALL = 1e-10  # of the largest energy: below, its last digits decide how far a swing goes, and its table would be fitted in vain


def by_energy(curve: Curve, q0: float, v0: float, duration: float, *, tolerance: float = 1e-13) -> EnergyMotion | None:
    """The motion from q0, v0 for ``duration`` [s]; None where this way does not lead on (rest in an equilibrium, a way towards an
    unstable equilibrium, a swing about one that is too small to be seen in the energy, the end of the tabulated range)."""
    work = _Work(curve)
    inertia, done = (float(x[0]) for x in work(np.array([q0])))
    energy = 0.5 * inertia * v0 * v0 - done  # T(q) = energy + work(q)
    size = max(work.largest, abs(energy), 1e-300)
    force, slope = curve.both(np.array([q0]))[0, [1, 3]]
    if 0.5 * inertia * v0 * v0 * abs(slope) + 0.5 * force * force < SMALL * size * abs(slope) and (
        _swings(curve, q0, force, slope, inertia * v0 * v0)
    ):
        return None
    at_rest = 0.5 * inertia * v0 * v0 <= 1e-15 * size
    sign = np.sign(v0) if not at_rest else np.sign(float(curve.table(np.array([q0]))[0, 1]))
    if sign == 0:
        return None
    legs: list[Leg] = []
    q, t, from_rest = q0, 0.0, at_rest
    reach = TURN
    while t < duration and len(legs) < 100_000:
        end, turning = _next(curve, work, energy, q, sign, reach, from_rest, size)
        if end is None:
            return None
        leg = _leg(curve, work, energy, q, end, (from_rest, turning), t, tolerance)
        if leg is None:
            return None
        legs.append(leg)
        t += leg.duration
        if turning:
            sign = -sign
            if len(legs) > 2 and legs[-2].ends == (True, True) and leg.ends == (True, True):
                return EnergyMotion(curve, tuple(legs), legs[-2].duration + leg.duration, 0.0)
        elif not from_rest and abs(work.per_turn) <= 1e-14 * size and curve.table.periodic:
            return EnergyMotion(curve, tuple(legs), leg.duration, end - q)
        elif not from_rest:
            reach = min(2.0 * reach, 64.0 * TURN)
        q, from_rest = end, turning
    return EnergyMotion(curve, tuple(legs), None, 0.0)


def _swings(curve: Curve, q0: float, force: float, slope: float, twice_kinetic: float) -> bool:
    """Whether a motion near q0 stays about an equilibrium there: the force drives it back at twice the linear amplitude on both
    sides. A small force at the start alone tells nothing: a machine may be spun up from where its springs hold the balance."""
    if not slope < 0.0:
        return bool(force == 0.0)
    centre = q0 - force / slope
    reach = 2.0 * float(np.sqrt((force / slope) ** 2 + twice_kinetic / -slope))
    beyond = curve.table(np.array([centre - reach, centre + reach]))[:, 1]
    return bool(beyond[0] >= 0.0 >= beyond[1])


class _Work:
    """Reduced inertia, and work of the reduced force from the table's start, on the whole line where the table is periodic."""

    def __init__(self, curve: Curve):
        table = curve.table
        only = Panels(table.low, table.width, table.coefficients[:, :, 1:2], False)
        integral = only.integral()
        inertia = np.pad(table.coefficients[:, :, :1], ((0, 0), (0, 1), (0, 0)))
        self.both = Panels(table.low, table.width, np.concatenate([inertia, integral.coefficients], axis=2), False)
        self.low, self.high, self.periodic = table.low, table.high, table.periodic
        self.per_turn = float(integral.coefficients[-1, :, 0].sum())
        self.largest = float(np.abs(integral.coefficients).sum(axis=1).max())

    def __call__(self, q: Array) -> tuple[Array, Array]:
        """J and the work (n,) at positions (n,)."""
        if not self.periodic:
            inertia, work = self.both(q).T
            return inertia, work
        turns = np.floor((q - self.low) / (self.high - self.low))
        inertia, work = self.both(q - turns * (self.high - self.low)).T
        return inertia, turns * self.per_turn + work


def _next(
    curve: Curve, work: _Work, energy: float, q: float, sign: float, reach: float, from_rest: bool, size: float
) -> tuple[float | None, bool]:
    """Where the leg that starts at q ends: at the first turning point within ``reach``, or at the end of that."""
    table = curve.table
    span = reach
    if not table.periodic:
        span = min(reach, (table.high - q) if sign > 0 else (q - table.low))
        if span <= 0:
            return None, False
    per = 24 * table.count * max(1, round(span / (table.high - table.low)))
    x = q + sign * span * (np.arange(1, per + 1) / per)
    left = energy + work(x)[1]
    low = np.flatnonzero(left <= 0.0)
    low = low[low > 0] if from_rest else low
    if not len(low):
        return q + sign * span, False
    a, b = (x[low[0] - 1] if low[0] else q), x[low[0]]
    for _ in range(80):
        middle = 0.5 * (a + b)
        if energy + work(np.array([middle]))[1][0] > 0.0:
            a = middle
        else:
            b = middle
    for _ in range(3):  # the last digits by Newton's method: the slope of the energy is the force
        force = float(table(np.array([b]))[0, 1])
        if force == 0.0:
            return None, False
        b = b - (energy + work(np.array([b]))[1][0]) / force
    return float(b), True


def _leg(
    curve: Curve, work: _Work, energy: float, start: float, end: float, ends: tuple[bool, bool], time: float, tolerance: float
) -> Leg | None:
    length = end - start

    def rate(u: Array) -> Array:
        f, slope = _way(u, ends)
        q = start + length * f
        inertia, done = work(q)
        kinetic = energy + done
        for at, turning in ((start, ends[0]), (end, ends[1])):
            if turning:  # next to a turning point the difference would cancel: integrate the force from there
                near = np.abs(q - at) < curve.table.width
                way = q[near] - at
                force = curve.table((at + way[:, None] * _GAUSS[0]).ravel())[:, 1].reshape(len(way), -1)
                kinetic[near] = way * (force @ _GAUSS[1])
        kinetic = np.maximum(kinetic, 1e-300)
        return (abs(length) * slope * np.sqrt(0.5 * inertia / kinetic))[:, None]

    first = max(2, round(abs(length) / curve.table.width))
    panels = fit_panels(rate, 0.0, 1.0, periodic=False, tolerance=tolerance, first=first, most=4096)
    if panels.tail()[0] > 1e-6:
        return None
    rates = np.pad(panels.coefficients, ((0, 0), (0, 1), (0, 0)))
    clock = Panels(panels.low, panels.width, np.concatenate([rates, panels.integral().coefficients], axis=2), False)
    return Leg(start, length, ends, time, clock)
