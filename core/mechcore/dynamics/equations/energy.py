"""Motion of one freedom by its energy, where all forces depend on the position alone.

Then T(q) = T_0 + integral of Q dq, q'^2 = 2 T / J, and time is a plain integral, t = integral of dq / q': no time steps are needed.
At turning points, where q' vanishes, a quadratic substitution makes the integrand smooth (theory 8.3).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from mechcore.arrays import Real, numbers
from mechcore.compiled.energy import LAST_STEP, parameters_at, time_of_turn
from mechcore.constants import MOST_TURNS
from mechcore.dynamics.equations.curve import CurveEquations
from mechcore.errors import Fault, MechanismError
from mechcore.numerics.chebyshev import PANEL_NODES, Panels, fit_where_needed
from mechcore.records import dataclass

_X, _W = np.polynomial.legendre.leggauss(12)
_GAUSS = 0.5 * (_X + 1.0), 0.5 * _W
PANEL_SAMPLES = 24  # of a panel, at which the search for turning points begins
_SAMPLED = chebvander(np.linspace(-1.0, 1.0, PANEL_SAMPLES), PANEL_NODES)
_ALTERNATING = (-1.0) ** np.arange(PANEL_NODES + 1)[:, None]


@dataclass(frozen=True, eq=False)
class Leg:
    """A part of the motion without reversal: ``q = start + length f(u)``, u in [0, 1], f by ``ends`` (which ends are turning
    points); ``clock``: dt/du and t(u) - ``time`` as panels, which are evaluated ``by_c`` or by numpy."""

    start: float
    length: float
    ends: tuple[bool, bool]
    time: float
    clock: Panels
    by_c: bool = False

    @cached_property
    def edges(self) -> Real:
        """Times [s] since the leg's start at which its panels begin and end (p + 1,)."""
        clock = self.clock.coefficients[:, :, 1]
        return np.append(clock[:, ::2].sum(axis=1) - clock[:, 1::2].sum(axis=1), clock[-1].sum())

    @property
    def duration(self) -> float:
        return float(self.edges[-1])

    @property
    def back(self) -> Leg:
        """The same leg backwards, between two turning points: a position at time t after its start is passed at time t before its
        end."""
        rate, clock = np.moveaxis(self.clock.coefficients[::-1] * _ALTERNATING, 2, 0)
        clock = -clock
        clock[:, 0] += self.duration
        assert self.clock.boundaries is not None
        panels = Panels(0.0, np.nan, np.stack([rate, clock], axis=2), False, 1.0 - self.clock.boundaries[::-1])
        return Leg(self.start + self.length, -self.length, self.ends, self.time + self.duration, panels, self.by_c)

    def __call__(self, t: Real) -> tuple[Real, Real]:
        """Position and speed (n,) at times (n,) within the leg."""
        edges = self.edges
        known = parameters_at(self.clock, edges, t - self.time) if self.by_c else None
        if known is not None:
            f, _, slope = _displacement(known[:, 0], self.ends)
            return self.start + self.length * f, self.length * slope / known[:, 1]
        assert self.clock.boundaries is not None
        boundaries = self.clock.boundaries
        local = np.minimum(np.maximum(t - self.time, 0.0), self.duration)
        cell = edges[1:-1].searchsorted(local, side="right")
        low, high = boundaries[cell], boundaries[cell + 1]
        u = low + (local - edges[cell]) / (edges[cell + 1] - edges[cell]) * (high - low)
        for _ in range(40):
            rate, clock = self.clock(u).T
            error = clock - local
            high, low = np.where(error > 0, np.minimum(high, u), high), np.where(error <= 0, np.maximum(low, u), low)
            new = u - error / rate
            new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
            change = np.abs(new - u).max(initial=0.0)
            u = new
            if change < LAST_STEP:
                break
        f, _, slope = _displacement(u, self.ends)
        return self.start + self.length * f, self.length * slope / self.clock(u)[:, 0]


def _displacement(u: Real, ends: tuple[bool, bool]) -> tuple[Real, Real, Real]:
    """f(u) on [0, 1], 1 - f(u) without cancellation, and the slope of f, which is zero at ``ends`` that are turning points."""
    if ends == (True, True):
        f, rest = np.sin(0.5 * np.pi * u), np.cos(0.5 * np.pi * u)
        return f * f, rest * rest, np.pi * f * rest
    if ends == (True, False):
        return u * u, (1.0 - u) * (1.0 + u), 2.0 * u
    if ends == (False, True):
        return u * (2.0 - u), (1.0 - u) ** 2, 2.0 - 2.0 * u
    return u, 1.0 - u, np.ones_like(u)


def _place(before: float, after: float, ends: tuple[bool, bool]) -> float:
    """The u at which `_displacement`, from a turning point on, has covered ``before`` and has ``after`` left."""
    return float(np.arctan2(np.sqrt(before), np.sqrt(after)) / (0.5 * np.pi) if ends[1] else np.sqrt(before / (before + after)))


@dataclass(frozen=True, eq=False)
class EnergyMotion:
    """The motion over its legs; beyond the last one it repeats with ``period`` [s] and ``advance`` [rad], where that is given."""

    curve: CurveEquations
    legs: tuple[Leg, ...]
    period: float | None
    advance: float

    def __call__(self, t: Real) -> tuple[Real, Real, Real]:
        """Position, speed and acceleration (n, 1) at times (n,)."""
        t = numbers(t)
        turns: Real = np.zeros_like(t)
        if self.period is not None:
            turns = np.maximum(np.ceil((t - self.last) / self.period), 0.0)
        local = t - turns * (self.period or 0.0)
        if len(self.legs) == 1:
            q, v = self.legs[0](local)
        else:
            which = np.array([leg.time for leg in self.legs[1:]], float).searchsorted(local, side="right")
            q, v = np.empty_like(t), np.empty_like(t)
            for k in np.unique(which):
                rows = which == k
                q[rows], v[rows] = self.legs[k](local[rows])
        q += turns * self.advance
        a = self.curve(q[:, None], v[:, None], t)
        return q[:, None], v[:, None], a

    @property
    def last(self) -> float:
        """Time at which the last leg ends [s]."""
        return self.legs[-1].time + self.legs[-1].duration

    @property
    def repeats(self) -> float | None:
        """Time [s] from which on the motion since the start repeats; None where it does not."""
        if self.period is None:
            return None
        return self.last if self.last >= self.period else self.last + self.period  # the first leg may begin before t = 0

    def boundaries(self, end: float) -> Real:
        """Times until ``end`` [s] between which the motion is one smooth function."""
        times = np.concatenate([leg.time + np.unique(leg.edges[:-1]) for leg in self.legs])
        if self.period is not None and end > self.last:
            again = times[times >= self.last - self.period * (1.0 + 1e-12)]
            turns = np.arange(1, int(np.ceil((end - self.last) / self.period)) + 1)
            times = np.concatenate([times, (again + turns[:, None] * self.period).ravel()])
        return np.asarray(times[(times >= 0.0) & (times < end)])


# Part of the largest energy: below it, rounding decides how far a swing goes, and no table of it can be fitted
SMALL_ENERGY = 1e-10
SAME_BEND = 1e-9  # part of a leg: breakpoints so close to each other are one
FIRST_PANELS = 16  # panels of a leg's clock, at least: so few cost no more than one
FIRST_PANELS_ROUND = 40  # the same of a leg without turning points: fewer would have to be halved, which costs more
NO_GAIN = 1e-13  # part of the largest energy: a smaller gain in a turn is rounding of the table
LEAST_LEFT = 1e-6  # part of the largest energy: where more kinetic energy is left everywhere, the motion does not turn back


def by_energy(
    curve: CurveEquations,
    q0: float,
    v0: float,
    duration: float,
    *,
    tolerance: float = 1e-13,
    progress: Callable[[float], None] | None = None,
) -> EnergyMotion | None:
    """The motion from q0, v0 for ``duration`` [s]; None where the energy does not give it (rest in an equilibrium, approach to an
    unstable equilibrium, a swing too small to be resolved in the energy, the end of the tabulated range), or where the table comes
    close to singular positions. ``progress`` gets the time reached. Raises `MechanismError` where it gains speed for more than
    `MOST_TURNS`."""
    if curve.beside_singular:
        return None
    by_c = curve.compiled.executor == "c"
    if by_c and v0 and curve.table.periodic and curve.table.boundaries is None:
        first, limits = max(FIRST_PANELS_ROUND, curve.table.count), (NO_GAIN, SMALL_ENERGY, LEAST_LEFT)
        turn = time_of_turn(curve.table, q0, v0, tolerance, first, limits)
        if turn is not None:
            around = Leg(q0, float(np.copysign(curve.table.high - curve.table.low, v0)), (False, False), 0.0, turn, by_c)
            if progress is not None:
                progress(min(around.duration, duration))
            return EnergyMotion(curve, (around,), around.duration, around.length)
    work = _Work(curve)
    inertia, force, _, slope, _ = (float(x) for x in curve.table_with_derivatives(np.array([q0]))[0])
    kinetic = 0.5 * inertia * v0 * v0
    size = max(work.largest, kinetic, 1e-300)
    if kinetic * abs(slope) + 0.5 * force * force < SMALL_ENERGY * size * abs(slope) and _swings(
        curve, q0, force, slope, 2.0 * kinetic
    ):
        return None
    sign = float(np.sign(v0 if v0 else force))
    if sign == 0.0:
        return None
    legs: list[Leg] = []
    q, t, from_rest = q0, 0.0, not v0
    whole = curve.table.high - curve.table.low  # a turn, or the range of a table that does not repeat: an angle or a length
    reach = whole
    before = 0.0 if from_rest else _travel_to_turn(work, q0, kinetic, -sign, reach)
    if before is None or not np.isfinite(before):
        before = 0.0
    elif before > 0.0:  # it comes from a turning point, from which the motion is smooth in `_displacement`'s parameter
        from_rest = True
    while t < duration and len(legs) < 100_000:
        travel = _travel_to_turn(work, q, kinetic, sign, reach)
        if travel is None:
            return None
        turning = np.isfinite(travel)
        if not turning:
            travel = reach if curve.table.periodic else min(reach, _room(curve.table, q, sign))
        ends = (from_rest, bool(turning))
        start, length = q - sign * before, before + travel
        clock = _clock(work, start, sign * length, ends, 0.0 if from_rest else kinetic, tolerance)
        if clock is None:
            return None
        passed = float(clock(np.array([_place(before, travel, ends)]))[0, 1]) if before else 0.0
        leg = Leg(start, sign * length, ends, t - passed, clock, by_c)
        legs.append(leg)
        if ends == (True, True):
            legs.append(leg.back)
            return EnergyMotion(curve, tuple(legs), 2.0 * leg.duration, 0.0)
        t, q_next = leg.time + leg.duration, q + sign * travel
        if progress is not None:
            progress(min(t, duration))
        if t < duration and abs(q_next - q0) > whole * MOST_TURNS:
            why = f"after {t:.6g} s of {duration:.6g} s it has made {MOST_TURNS:,} turns; motions are followed no farther."
            raise MechanismError(Fault("run.duration", why, f"Give at most {t:.3g} s."))
        if turning:
            sign, kinetic = -sign, 0.0
        elif not from_rest and abs(work.per_turn) <= NO_GAIN * size and curve.table.periodic:
            return EnergyMotion(curve, tuple(legs), leg.duration, sign * length)
        else:
            kinetic += float(work.gain(q, np.array([sign * travel]))[0])
            if not from_rest or abs(work.per_turn) > NO_GAIN * size:  # else the next turn is the one that repeats
                reach = min(2.0 * reach, 64.0 * whole)
        q, from_rest, before = q_next, bool(turning), 0.0
    return EnergyMotion(curve, tuple(legs), None, 0.0)


def _swings(curve: CurveEquations, q0: float, force: float, slope: float, twice_kinetic: float) -> bool:
    """Whether a motion near q0 stays about an equilibrium there: the force drives it back at twice the linear amplitude on both
    sides. A small force at the start alone is no proof: a machine may be spun up from an equilibrium of its springs."""
    if not slope < 0.0:
        return bool(force == 0.0)
    centre = q0 - force / slope
    reach = 2.0 * float(np.sqrt((force / slope) ** 2 + twice_kinetic / -slope))
    beyond = curve.table(np.array([centre - reach, centre + reach]))[:, 1]
    return bool(beyond[0] >= 0.0 >= beyond[1])


class _Work:
    """Reduced inertia, and work of the reduced force from the table's start, on the whole line where the table is periodic."""

    def __init__(self, curve: CurveEquations):
        self.table = table = curve.table
        self.both, self.per_turn, self.largest, self.lowest = _integrated(table)
        self.low, self.high, self.periodic = table.low, table.high, table.periodic
        self._known: dict[float, float] = {}

    def __call__(self, q: Real) -> tuple[Real, Real]:
        """J and the work (n,) at positions (n,)."""
        if not self.periodic:
            inertia, _, work = self.both(q).T
            return inertia, work
        turns = np.floor((q - self.low) / (self.high - self.low))
        inertia, _, work = self.both(q - turns * (self.high - self.low)).T
        return inertia, turns * self.per_turn + work

    def at(self, q: float) -> float:
        """The work at one position; values are kept, as they are used repeatedly."""
        if q not in self._known:
            self._known[q] = float(self(np.array([q]))[1][0])
        return self._known[q]

    def never_turns(self, q: float, kinetic: float, sign: float) -> bool:
        """Whether the motion from q with this kinetic energy never turns back: no position takes all energy, and no turn loses any
        but for rounding."""
        if not self.periodic or sign * self.per_turn < -NO_GAIN * self.largest:
            return False
        turns = np.floor((q - self.low) / (self.high - self.low))
        done = self.at(q) - float(turns) * self.per_turn
        return kinetic + self.lowest - done > LEAST_LEFT * self.largest

    def near(self, q: float, travel: Real) -> Real:
        """Work (n,) on signed displacements (n,) from q, no longer than a panel, with full relative accuracy however short they
        are."""
        first = self.table.within_panel(q, travel)
        out = self._short(np.full(travel.size, q), first)
        over = first != travel
        out[over] += self._short(q + first[over], (travel - first)[over])
        return out

    def _short(self, q: Real, travel: Real) -> Real:
        """Work (n,) on signed displacements (n,) from q (n,), within a panel each."""
        force = self.table((q[:, None] + travel[:, None] * _GAUSS[0]).ravel())[:, 1].reshape(travel.size, _GAUSS[0].size)
        return np.asarray(travel * (force @ _GAUSS[1]))

    def gain(self, q: float, travel: Real) -> Real:
        """Work (n,) on signed displacements (n,) from q."""
        out = self(q + travel)[1] - self.at(q)
        short = np.abs(travel) <= self.table.least
        if short.any():
            out[short] = self.near(q, travel[short])
        return np.asarray(out)


@lru_cache(8)
def _integrated(table: Panels) -> tuple[Panels, float, float, float]:
    """A table of J and Q with the work of Q; this work over the table, its bound, and its lowest value. Further motions have the
    same table."""
    both = table.with_integral(1)
    integral = both.coefficients[:, :, 2]
    return both, float(integral[-1].sum()), float(np.abs(integral).sum(axis=1).max()), float((_SAMPLED @ integral.T).min())


def _room(table: Panels, q: float, sign: float) -> float:
    """Distance from q to the end of a table that does not repeat."""
    return table.high - q if sign > 0 else q - table.low


def _travel_to_turn(work: _Work, q: float, kinetic: float, sign: float, reach: float) -> float | None:
    """Distance from q, where the motion has some kinetic energy, to its turning point; infinite where that lies beyond ``reach`` or
    the table's end, None where it is unknown (no room, an equilibrium at the very end)."""
    table = work.table
    span = reach if table.periodic else min(reach, _room(table, q, sign))
    if span <= 0:
        return None
    if work.never_turns(q, kinetic, sign):
        return float("inf")
    per = PANEL_SAMPLES * table.count * max(1, round(span / (table.high - table.low)))
    travels = span * (np.arange(1, per + 1) / per)
    left = kinetic + work(q + sign * travels)[1] - work.at(q)
    out = np.flatnonzero(left <= 0.0)
    if len(out) and out[0] == 0:  # a short distance, or rounding next to a start at rest
        short = travels[0] * 2.0 ** np.arange(-MOST_HALVINGS, 1.0)
        out_near = np.flatnonzero(kinetic + work.near(q, sign * short) <= 0.0)
        if len(out_near) and (out_near[0] or kinetic):
            k = out_near[0]
            return _turn(work, q, kinetic, sign, short[k - 1] if k else 0.0, short[k])
        out = out[1:]
    if not len(out):
        return float("inf")
    return _turn(work, q, kinetic, sign, travels[out[0] - 1], travels[out[0]])


MOST_HALVINGS = 40  # halvings of the first sample: a displacement of 1e-12 of it still differs from none


def _turn(work: _Work, q: float, kinetic: float, sign: float, low: float, high: float) -> float | None:
    """The displacement between two others at which the kinetic energy is used up, by Newton's method safeguarded by bisection; None
    where it is an equilibrium."""
    travel, before = 0.5 * (low + high), np.inf
    for _ in range(200):
        left = kinetic + float(work.gain(q, np.array([sign * travel]))[0])
        slope = sign * float(work.table(np.array([q + sign * travel]))[0, 1])
        if left > 0.0:
            low = travel
        else:
            high = travel
        new = travel - left / slope if slope else np.inf
        if not low <= new <= high:
            new = 0.5 * (low + high)
        change, travel = abs(new - travel), new
        if change <= 4e-16 * travel or before <= change <= 1e-12 * travel:  # the last digits fluctuate
            break
        before = change
    return travel if float(work.table(np.array([q + sign * travel]))[0, 1]) else None


def _clock(work: _Work, start: float, length: float, ends: tuple[bool, bool], kinetic: float, tolerance: float) -> Panels | None:
    """dt/du and t(u) of a leg from ``start``, where it has a kinetic energy, over a signed ``length``; None where no table of
    them is found.

    T = length f(u) Q, with Q the mean force from a turning point on: the factor f, which vanishes there, is taken out of the root.
    """
    size, width = abs(length), work.table.least
    until = work.at(start)

    def rate(u: Real) -> Real:
        f, rest, slope = _displacement(u, ends)
        q = start + length * f
        inertia, done = work(q)
        energy = kinetic + (done - until)
        first = np.zeros(len(u), bool)
        if size <= width:  # the whole leg by integrals from its start, which keep the digits of small differences
            first = f <= rest if ends[1] else f >= 0.0
            energy[first] = kinetic + work.near(start, length * f[first])
        elif ends[0]:
            first = size * f < width
            energy[first] = work.near(start, length * f[first])
        if ends[1]:
            last = ~first & (size * rest < width)
            energy[last] = work.near(start + length, -length * rest[last])
        inertia = np.maximum(inertia, 0.0)  # a table of an inertia that nearly vanishes may be negative
        return (size * slope * np.sqrt(0.5 * inertia / np.maximum(energy, 1e-300)))[:, None]

    panels, left = fit_where_needed(rate, _edges(work.table, start, length, ends), tolerance=tolerance)
    return panels.with_integral(0) if left <= 1e-6 else None


def _edges(table: Panels, start: float, length: float, ends: tuple[bool, bool]) -> Real:
    """Values of `_displacement`'s parameter between which a leg's time is one smooth function; unequal panels end at
    breakpoints."""
    if table.boundaries is None:
        least = FIRST_PANELS if any(ends) else FIRST_PANELS_ROUND
        return np.linspace(0.0, 1.0, max(least, round(abs(length) / table.width)) + 1)
    f = np.sort((table.between(min(start, start + length), max(start, start + length)) - start) / length)
    u = {(True, True): np.arctan2(np.sqrt(f), np.sqrt(1.0 - f)) / (0.5 * np.pi), (True, False): np.sqrt(f)}.get(ends)
    u = u if u is not None else 1.0 - np.sqrt(1.0 - f) if ends[1] else f
    u = u[(u > SAME_BEND) & (u < 1.0 - SAME_BEND)]
    return np.concatenate([[0.0], u[np.diff(u, prepend=0.0) > SAME_BEND], [1.0]])
