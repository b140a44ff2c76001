"""Drives: a coordinate as a function of time with its exact derivatives, or one that follows from the forces."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import field
from functools import cached_property, lru_cache
from typing import Any, Literal, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechcore.arrays import Real
from mechcore.laws.factors import VELOCITY_JUMP
from mechcore.numerics.tape import Traced
from mechcore.numerics.tape_functions import piecewise
from mechcore.records import dataclass

MOST_PARTS = 2.0**62  # below the largest 64-bit integer
ROUNDING = 1e-9  # least jump of a derivative, relative to its size; smaller steps are rounding
JUMPS = ("the velocity jumps, infinite acceleration", "the acceleration jumps, infinite jerk")
"""Jumps of the first two derivatives of a law, in words."""


@dataclass(frozen=True)
class Free:
    """In place of a drive's law: a free coordinate. The mechanism is assembled at ``start`` [rad or m] and starts at ``speed``.

    As a law it is the straight line through the start; forward dynamics replaces it by the motion that it finds.
    """

    start: float
    speed: float = 0.0

    @property
    def duration(self) -> float:
        return 2.0 * np.pi / abs(self.speed) if self.speed else 2.0 * np.pi

    @property
    def breaks(self) -> tuple[float, ...]:
        return ()

    def __call__(self, t: ArrayLike) -> tuple[Real, Real, Real]:
        t = np.asarray(t, float)
        return self.start + self.speed * t, np.full_like(t, self.speed), np.zeros_like(t)


Triple = tuple[Real, Real, Real]
Smoothness = bool | Literal["spline"]


class Law(Protocol):
    """Any motion of a drive."""

    @property
    def duration(self) -> float:
        """Time of one cycle [s]."""
        ...

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times within a cycle at which the acceleration may jump [s]."""
        ...

    def __call__(self, t: ArrayLike) -> Triple:
        """Times (...) [s] -> position, velocity, acceleration, each (...) in rad or m per s^k."""
        ...


@dataclass(frozen=True)
class Rest:
    """A constant coordinate, a held input. ``cycle``: time of a cycle where the drive states one, else 0 [s]."""

    position: float
    cycle: float = 0.0

    @property
    def duration(self) -> float:
        return math.inf

    @property
    def breaks(self) -> tuple[float, ...]:
        return ()

    def __call__(self, t: ArrayLike) -> Triple:
        t = np.asarray(t, float)
        return np.full_like(t, self.position), np.zeros_like(t), np.zeros_like(t)


def moves(law: Law) -> bool:
    """Whether a law moves its drive: it is neither `Rest` nor a constant speed of zero."""
    return not (isinstance(law, Rest) or (isinstance(law, ConstantSpeed) and law.speed == 0.0))


@dataclass(frozen=True)
class ConstantSpeed:
    """``start + speed t``; one cycle is one turn, or ``travel`` where that is given (sliding drives, limited ranges). ``ends``:
    with the cycle, at the end of a range."""

    start: float
    speed: float
    travel: float = 2.0 * np.pi
    ends: bool = False

    @property
    def duration(self) -> float:
        return abs(self.travel / self.speed) if self.speed else math.inf

    @property
    def breaks(self) -> tuple[float, ...]:
        return ()

    def __call__(self, t: ArrayLike) -> Triple:
        t = np.asarray(t, float)
        return self.start + self.speed * t, np.full_like(t, self.speed), np.zeros_like(t)


@dataclass(frozen=True)
class Oscillation:
    """``centre + amplitude sin(2 pi frequency t + phase)``."""

    centre: float
    amplitude: float
    frequency: float  # [Hz]
    phase: float = 0.0

    @property
    def duration(self) -> float:
        return 1.0 / self.frequency

    @property
    def breaks(self) -> tuple[float, ...]:
        return ()

    def __call__(self, t: ArrayLike) -> Triple:
        w = 2.0 * np.pi * self.frequency
        x = w * np.asarray(t, float) + self.phase
        s, c = self.amplitude * np.sin(x), self.amplitude * np.cos(x)
        return self.centre + s, w * c, -w * w * s


@dataclass(frozen=True, eq=False)
class Piecewise:
    """Polynomial pieces: on ``(knots[k], knots[k+1]]`` the value is ``sum_j coefficients[k][j] (t - knots[k])^j``.

    Before the first knot the first piece is continued. After the last knot the law repeats (``advance`` is added per cycle), where
    the scene allows such times.
    """

    knots: tuple[float, ...]
    coefficients: tuple[tuple[float, ...], ...]
    advance: float = 0.0
    _table: Real = field(init=False, repr=False)

    def __post_init__(self) -> None:
        degree = max(map(len, self.coefficients))
        table = np.zeros((degree, len(self.coefficients)))
        for k, c in enumerate(self.coefficients):
            table[: len(c), k] = c
        object.__setattr__(self, "_table", table)

    @property
    def duration(self) -> float:
        return self.knots[-1] - self.knots[0]

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Knots at which the value or one of its first three derivatives jumps [s]."""
        inner = np.asarray(self.knots[1:-1], float)
        jumping = np.zeros(inner.size, bool)
        for order in range(min(4, len(self._table))):
            steps, size = self._steps(order)
            jumping |= np.abs(steps[1:]) > ROUNDING * size
        return tuple(float(k) for k in inner[jumping] - self.knots[0])

    def _steps(self, order: int) -> tuple[Real, float]:
        """The step of a derivative at the start of each piece (n), the first against the end of the last, and the size of it."""
        if order >= len(self._table):
            return np.zeros(len(self.coefficients)), 1e-300
        degrees, lengths = np.arange(len(self._table) - order), np.diff(self.knots)
        factors = np.array([math.perm(int(d) + order, order) for d in degrees], float)[:, None] * self._table[order:]
        parts = factors * lengths ** degrees[:, None]
        return factors[0] - np.roll(parts.sum(axis=0), 1), max(float(np.abs(parts).sum(axis=0).max()), 1e-300)

    def shock(self, t: float) -> str:
        """The jump at one of the ``breaks``, or between two cycles, in words; empty where velocity and acceleration do not jump."""
        begins = np.asarray(self.knots[:-1]) - self.knots[0]
        off = (t - begins) / self.duration
        piece = int(np.argmin(np.abs(off - np.round(off))))
        for order, least in ((1, VELOCITY_JUMP), (2, ROUNDING)):
            steps, size = self._steps(order)
            if abs(steps[piece]) > least * size:
                return JUMPS[order - 1]
        return ""

    def __call__(self, t: ArrayLike) -> Triple:
        t = np.asarray(t, float)
        cycle, piece = self.place(t)
        q, v, a = self.on_piece(piece, t - cycle * self.duration - np.asarray(self.knots)[piece])
        return q + cycle * self.advance, v, a

    def place(self, t: Real) -> tuple[Real, NDArray[np.intp]]:
        """The cycle and the piece that contain each of the times (...)."""
        cycle = np.ceil((t - self.knots[0]) / self.duration) - 1.0  # half-open on the left: the end of a cycle belongs to it
        cycle = np.maximum(cycle, 0.0)
        piece = np.searchsorted(self.knots, t - cycle * self.duration, side="left") - 1
        return cycle, np.clip(piece, 0, len(self.coefficients) - 1)

    def on_piece(self, piece: NDArray[np.intp], u: Real) -> Triple:
        """Position, velocity and acceleration on pieces (...) at times ``u`` (...) after their starts; pieces continue beyond
        their ends."""
        q, v, a = np.zeros_like(u), np.zeros_like(u), np.zeros_like(u)
        for ck in self._table[:, piece][::-1]:  # Horner, value and two derivatives at once
            a = a * u + 2.0 * v
            v = v * u + q
            q = q * u + ck
        return q, v, a


def zones(*, start: float, speed: float, run_up: float, steady: float, braking: float) -> Piecewise:
    """Run-up from rest with uniform acceleration, steady running, uniform braking to rest, each over a stated range.

    ``run_up``, ``steady``, ``braking`` are ranges of the coordinate (positive numbers, rad or m); the sign of ``speed`` is the
    direction. Acceleration speed^2 / (2 range), as in the contour-graph article (`omega^2 = 2 eps (alpha - alpha_0)`).
    A zone of range 0 is left out.
    """
    sign = 1.0 if speed > 0 else -1.0
    pieces: list[tuple[float, float, float, float]] = []  # duration, q0, v0, acceleration
    q = start
    if run_up > 0:
        pieces.append((2.0 * run_up / abs(speed), q, 0.0, sign * speed**2 / (2.0 * run_up)))
        q += sign * run_up
    if steady > 0:
        pieces.append((steady / abs(speed), q, speed, 0.0))
        q += sign * steady
    if braking > 0:
        pieces.append((2.0 * braking / abs(speed), q, speed, -sign * speed**2 / (2.0 * braking)))
        q += sign * braking
    knots = np.concatenate([[0.0], np.cumsum([p[0] for p in pieces])])
    return Piecewise(
        knots=tuple(map(float, knots)),
        coefficients=tuple((q0, v0, 0.5 * a) for _, q0, v0, a in pieces),
        advance=q - start,
    )


@dataclass(frozen=True, eq=False)
class Table:
    """A function through points, periodic where ``period`` is given.

    ``smooth``: piecewise cubic with a continuous derivative that stays between neighbouring points (PCHIP; F. N. Fritsch and
    R. E. Carlson, Monotone Piecewise Cubic Interpolation, SIAM J. Numer. Anal. 17, 1980). "spline": the cubic spline with two
    continuous derivatives, which may overshoot. False: straight lines. Arguments outside the range of ``x`` of a table without a
    period take the end values.
    """

    x: tuple[float, ...]
    y: tuple[float, ...]
    period: float | None = None
    smooth: Smoothness = True
    _spline: Any = field(init=False, repr=False)  # of scipy

    def __post_init__(self) -> None:
        object.__setattr__(self, "_spline", _interpolation(tuple(self.x), tuple(self.y), self.period, self.smooth))

    @property
    def straight(self) -> bool:
        """Whether the table is linear between the points."""
        return _is_straight(self.x, self.period, self.smooth)

    @property
    def knots(self) -> tuple[float, ...]:
        """Arguments within the range at which a derivative jumps: the points; of a spline its ends; of a periodic spline none."""
        if self.smooth != "spline" or self.straight:
            return self.x
        return (self.x[0], self.x[-1]) if self.period is None else ()

    @property
    def overshoot(self) -> tuple[float, int]:
        """Largest distance outside the range of the two neighbouring points, relative to the range of all, and the index of that
        pair of points, from 0."""
        x, y = np.asarray(self.x, float), np.asarray(self.y, float)
        if self.smooth != "spline" or self.straight:
            return 0.0, 0
        if self.period is not None:
            x, y = np.append(x, x[0] + self.period), np.append(y, y[0])
        return _overshoot(x, y, self._spline)

    def __call__(self, x: ArrayLike, derivative: int = 0) -> Real:
        """Argument (...) -> value (...) or its derivative."""
        if isinstance(x, Traced) and derivative == 0:
            within: Any = x.clip(self.x[0], self.x[-1]) if self.period is None else self.x[0] + np.mod(x - self.x[0], self.period)
            return cast(Real, piecewise(within, *self.pieces()))
        x = np.asarray(x, float)
        if self.period is not None:
            x = self.x[0] + np.mod(x - self.x[0], self.period)
            return np.asarray(self._spline(x, derivative))
        inside = np.clip(x, self.x[0], self.x[-1])
        value = np.asarray(self._spline(inside, derivative))
        return value if derivative == 0 else np.where(x == inside, value, 0.0)

    def pieces(self) -> tuple[Real, Real]:
        """Borders (n + 1,) and coefficients (n, 4) of its polynomials in the distance from the lower border, descending powers."""
        from scipy.interpolate import PPoly

        spline: Any = PPoly.from_spline(self._spline) if self.straight else self._spline
        used = np.diff(spline.x) > 0.0  # the end knots of a linear spline are double
        coefficients = np.zeros((int(used.sum()), 4))
        coefficients[:, 4 - len(spline.c) :] = spline.c.T[used]
        return np.unique(spline.x), coefficients

    def part(self, x: ArrayLike) -> NDArray[np.int64]:
        """Number of the interval between its ``knots`` that contains each argument (...)."""
        x = np.asarray(x, float)
        knots = np.asarray(self.knots, float)
        if self.period is None:
            return np.asarray(np.searchsorted(knots, x, side="right"))
        turns = np.floor((x - self.x[0]) / self.period)
        inner = np.searchsorted(knots, x - turns * self.period, side="right")
        return np.asarray(np.clip(turns * (len(knots) + 1) + inner, -MOST_PARTS, MOST_PARTS), np.int64)


def _is_straight(x: Sequence[float], period: float | None, smooth: Smoothness) -> bool:
    return not smooth or len(x) < 2 + (period is None)


@lru_cache(maxsize=256)  # a change of a scene leaves most of its tables as they are
def _interpolation(knots: tuple[float, ...], values: tuple[float, ...], period: float | None, smooth: Smoothness) -> object:
    from scipy.interpolate import CubicHermiteSpline, CubicSpline, PchipInterpolator, make_interp_spline

    x, y = np.asarray(knots, float), np.asarray(values, float)
    if period is not None:
        x, y = np.append(x, x[0] + period), np.append(y, y[0])
    if _is_straight(knots, period, smooth):
        return make_interp_spline(x, y, k=1)
    if smooth == "spline":
        return CubicSpline(x, y, bc_type="periodic" if period is not None else "not-a-knot")
    if period is None:
        return PchipInterpolator(x, y)
    # a slope follows from the points on both sides
    around = PchipInterpolator(np.r_[x[-2] - period, x, x[1] + period], np.r_[y[-2], y, y[1]])
    return CubicHermiteSpline(x, y, around(x, 1))


def _overshoot(x: Real, y: Real, curve: Any) -> tuple[float, int]:
    """Largest distance of a piecewise polynomial outside the range of two neighbouring points, relative to the range of all, and
    the index of these two."""
    extreme = np.ravel(curve.derivative().roots(extrapolate=False))
    extreme = extreme[np.isfinite(extreme) & (extreme >= x[0]) & (extreme <= x[-1])]
    if not len(extreme):
        return 0.0, 0
    k = np.clip(np.searchsorted(x, extreme) - 1, 0, len(x) - 2)
    low, high = np.minimum(y[k], y[k + 1]), np.maximum(y[k], y[k + 1])
    value = curve(extreme)
    beyond = np.maximum(np.maximum(low - value, value - high), 0.0) / (np.ptp(y) or 1.0)
    worst = int(np.argmax(beyond))
    return float(beyond[worst]), int(k[worst])


@dataclass(frozen=True, eq=False)
class TableLaw:
    """A drive given by a table of position against time: quintic spline, so that the acceleration is smooth too; of five rows or
    four a cubic one, of three a parabola.

    ``periodic``: the last row is the end of the cycle and continues smoothly into the next one, shifted by ``advance``.
    """

    t: tuple[float, ...]
    q: tuple[float, ...]
    periodic: bool = False
    _spline: Any = field(init=False, repr=False)  # of scipy

    def __post_init__(self) -> None:
        from scipy.interpolate import make_interp_spline

        t, q = np.asarray(self.t, float), np.asarray(self.q, float)
        degree = min(len(t) - 1, 5 if len(t) > 5 else 3)
        if self.periodic:
            trend = self.advance * (t - t[0]) / (t[-1] - t[0])
            spline = make_interp_spline(t, q - trend, k=degree, bc_type="periodic")
        else:
            spline = make_interp_spline(t, q, k=degree)
        object.__setattr__(self, "_spline", spline)

    @property
    def advance(self) -> float:
        return self.q[-1] - self.q[0]

    @property
    def overshoot(self) -> tuple[float, int]:
        """Largest distance of the motion outside the range of the two neighbouring rows, relative to the range of all, and the
        index of that pair of rows, from 0."""
        from scipy.interpolate import PPoly

        t, motion = np.asarray(self.t, float), PPoly.from_spline(self._spline)
        if self.periodic:
            rate = self.advance / self.duration
            motion.c[-1] += rate * (motion.x[:-1] - t[0])
            motion.c[-2] += rate
        return _overshoot(t, np.asarray(self.q, float), motion)

    @property
    def duration(self) -> float:
        return self.t[-1] - self.t[0]

    @property
    def breaks(self) -> tuple[float, ...]:
        return ()

    def __call__(self, t: ArrayLike) -> Triple:
        t = np.asarray(t, float) + self.t[0]  # the run starts at t = 0
        f = self._spline
        if not self.periodic:
            q, v, a = (np.asarray(f(t, k)) for k in range(3))
            return q, v, a
        rate = self.advance / self.duration
        q, v, a = (np.asarray(f(self.t[0] + np.mod(t - self.t[0], self.duration), k)) for k in range(3))
        return q + rate * (t - self.t[0]), v + rate, a


def timed(laws: Iterable[Law]) -> list[Law]:
    """Those of some laws that have breakpoints, see `next_break`."""
    return [law for law in laws if law.breaks or isinstance(law, Piecewise)]


def next_break(law: Law, after: float) -> float:
    """The first time [s] later than ``after`` at which a prescribed drive's acceleration may jump, within cycles or between."""
    begun = np.floor(after / law.duration) * law.duration if np.isfinite(law.duration) else 0.0
    times = begun + np.array([0.0, law.duration])[:, None] + np.array([0.0, *law.breaks])
    return float(times[times > after].min(initial=np.inf))
