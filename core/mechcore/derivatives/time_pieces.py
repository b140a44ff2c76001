"""Piecewise functions, tables and signals of time, evaluated on the pieces of nominal ones; pieces are continued beyond their ends.

A parameter that moves the points of a table, or the time of a step, moves a value from one piece to the next: the value is then no
smooth function of the parameter. On the nominal pieces it is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Flags, Real
from mechcore.constants import TURN
from mechcore.laws.signals import Chirp, Ramp, Signal, SignalPosition, SignalSpeed, Sine, Step
from mechcore.laws.timed import Piecewise, Table
from mechcore.numerics.tape import value_of
from mechcore.records import dataclass


def on_pieces_of(nominal: Callable[[Any], Any], own: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A function of the same scene with another value of a parameter, evaluated on the pieces of the ``nominal`` one; functions
    other than tables and piecewise signals are unchanged."""
    if isinstance(own, Table) and isinstance(nominal, Table) and len(own.x) == len(nominal.x):
        return _TableOnPieces(own, nominal)
    signals = Step | Ramp | Chirp
    if isinstance(own, signals) and isinstance(nominal, signals) and type(own) is type(nominal):
        return SignalOnPieces(own, nominal)
    return own


def law_on_pieces_of(nominal: Any, own: Any, *, same_times: bool = True) -> Any:
    """A law of time that follows a signal, or with ``same_times`` one of polynomials, evaluated on the pieces of the ``nominal``
    one; other laws are unchanged."""
    if same_times and isinstance(own, Piecewise) and isinstance(nominal, Piecewise) and len(own.knots) == len(nominal.knots):
        return PolynomialsOnPieces(own, nominal)
    signal = getattr(nominal, "signal", None)
    if isinstance(own, SignalPosition) and isinstance(nominal, SignalPosition) and signal is not None:
        return SignalPosition(own.value, _signal(signal, own.signal), own.duration)
    if isinstance(own, SignalSpeed) and isinstance(nominal, SignalSpeed) and signal is not None:
        return SignalSpeed(own.start, own.speed, _signal(signal, own.signal), own.duration)
    return own


def _signal(nominal: Signal, own: Signal) -> Signal:
    if isinstance(own, Step | Ramp | Chirp) and type(own) is type(nominal):
        return SignalOnPieces(own, nominal)
    return own


class PolynomialsOnPieces:
    """A law of polynomial pieces, evaluated on the pieces and in the cycles of a ``nominal`` one of as many pieces."""

    def __init__(self, own: Piecewise, nominal: Piecewise):
        self.own, self.nominal = own, nominal
        self.duration, self.breaks = nominal.duration, nominal.breaks

    def __call__(self, t: ArrayLike) -> tuple[Real, Real, Real]:
        t = np.asarray(t, float)
        own, cycle, piece = self.own, *self.nominal.place(t)
        u = t - cycle * own.duration - np.asarray(own.knots)[piece]
        position, rate, second = own.on_piece(piece, u)
        return position + cycle * own.advance, rate, second


class TracedTarget:
    """A law of time at the times of a nominal motion, whose position and rate may be on a tape."""

    def __init__(self, nominal: Any, time: Real, position: Any, rate: Any):
        self.nominal, self.time = nominal, time
        self._values = position, rate, nominal(time)[2]

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(self.nominal.breaks)

    @property
    def duration(self) -> float:
        return float(self.nominal.duration)

    def __call__(self, t: Any) -> tuple[Any, Any, Any]:
        position, rate, second = self._values
        later = t - self.time
        return position + value_of(rate) * later, rate + second * later, second


@dataclass(frozen=True, eq=False)
class TracedTable:
    """A table whose ``values`` (F,) at the arguments of a nominal motion are on a tape."""

    nominal: Table
    values: Any

    def __call__(self, x: Any) -> Any:
        return self.nominal(x) + (self.values - value_of(self.values))


@dataclass(frozen=True, eq=False)
class SignalOnPieces:
    """A signal of time, its derivatives and its integral, on the pieces of the ``nominal`` one of its kind."""

    own: Any
    nominal: Any

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(self.nominal.breaks)

    @property
    def order(self) -> int:
        return int(self.nominal.order)

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Real:
        t = np.asarray(t, float)
        match self.own:
            case Step():
                return self._step(t, derivative)
            case Ramp():
                return self._ramp(t, derivative)
            case _:
                return self._chirp(t, derivative)

    def _begun(self, t: Real, at: float) -> Flags:
        """Whether the piece that begins at the time ``at`` has begun: that time belongs to the piece before it, if there is one."""
        return np.asarray(t > at if at > 0.0 else t >= at)

    def _step(self, t: Real, derivative: int) -> Real:
        own, at = self.own, self.nominal.at
        if derivative > 0:
            return np.zeros_like(t)
        if derivative == 0:
            return np.asarray(np.where(self._begun(t, at), own.after, own.before))

        def since(t: Real) -> Real:
            return np.where(self._begun(t, at), t - own.at, 0.0)

        return np.asarray(own.before * t + (own.after - own.before) * (since(t) - since(np.zeros(()))))

    def _ramp(self, t: Real, derivative: int) -> Real:
        own, nominal = self.own, self.nominal
        span = own.end - own.begin
        slope = (own.after - own.before) / span

        def choose(t: Real, before: Any, during: Any, after: Any) -> Real:
            return np.asarray(np.where(t > nominal.end, after, np.where(self._begun(t, nominal.begin), during, before)))

        def area(t: Real) -> Real:
            return choose(t, 0.0, 0.5 * (t - own.begin) ** 2, 0.5 * span**2 + span * (t - own.end))

        if derivative == -1:
            return np.asarray(own.before * t + slope * (area(t) - area(np.zeros(()))))
        if derivative > 0:
            return choose(t, 0.0, slope if derivative == 1 else 0.0, 0.0)
        return choose(t, own.before, own.before + slope * (t - own.begin), own.after)

    def _chirp(self, t: Real, derivative: int) -> Real:
        own, last = self.own, self.own.frequencies[1]
        sweeps = t <= self.nominal.duration
        swept, after = np.where(sweeps, t, own.duration), np.where(sweeps, 0.0, t - own.duration)
        if derivative == -1:
            rest = Sine(frequency=last, amplitude=own.amplitude, phase=float(own._angle(np.array(own.duration))))
            return np.asarray(own.mean * t + own.amplitude * (own._swept(swept) - own._swept(np.zeros(()))) + rest(after, -1))
        x = own._angle(swept) + TURN * last * after
        if derivative > 0:
            w = TURN * own._frequency(swept)
            faster = np.where(sweeps, TURN * own._frequency(swept, 1), 0.0)
            return np.asarray(own.amplitude * (w * np.cos(x) if derivative == 1 else faster * np.cos(x) - w * w * np.sin(x)))
        return np.asarray(own.mean + own.amplitude * np.sin(x))


class _TableOnPieces:
    """A function through points, evaluated on the pieces of a ``nominal`` one of as many points."""

    def __init__(self, own: Table, nominal: Table):
        self.own, self.nominal = own, nominal
        (self._borders, self._coefficients), (self._between, _) = own.pieces(), nominal.pieces()

    def __call__(self, x: ArrayLike) -> Real:
        x = np.asarray(x, float)
        own, nominal = self.own, self.nominal
        if own.period is not None and nominal.period is not None:
            turns = np.floor((x - nominal.x[0]) / nominal.period)
            place, x = x - turns * nominal.period, x - turns * own.period
        else:
            place = x
        k = np.clip(np.searchsorted(self._between, place, side="right") - 1, 0, len(self._coefficients) - 1)
        u, c = x - self._borders[k], self._coefficients[k]
        value = ((c[..., 0] * u + c[..., 1]) * u + c[..., 2]) * u + c[..., 3]
        if nominal.period is None:  # beyond its ends it has the end values
            value = np.where(place < nominal.x[0], own.y[0], np.where(place > nominal.x[-1], own.y[-1], value))
        return np.asarray(value)
