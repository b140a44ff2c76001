"""Signals: functions of time that loads and speeds follow, with their derivative and their integral in closed form.

A signal is called with times (...) [s] and ``derivative`` 0 (its value), 1 or 2 (its rates) or -1 (its integral from time zero).
``breaks`` are the breakpoints [s], at which one piece ends and another begins; there the value belongs to the piece that ends, as
for all laws of time. ``order`` is that of the lowest derivative that jumps there.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.constants import TURN
from mechcore.laws.timed import JUMPS
from mechcore.records import dataclass


class Signal(Protocol):
    """Any of the signals of this module."""

    @property
    def breaks(self) -> tuple[float, ...]: ...
    @property
    def order(self) -> int: ...
    def __call__(self, t: ArrayLike, derivative: int = 0) -> Real: ...


@dataclass(frozen=True, kw_only=True)
class Sine:
    """``mean + amplitude sin(2 pi frequency t + phase)``."""

    frequency: float  # [Hz]
    amplitude: float = 1.0
    mean: float = 0.0
    phase: float = 0.0  # [rad]
    order: ClassVar[int] = 0

    @property
    def breaks(self) -> tuple[float, ...]:
        return ()

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Real:
        t = np.asarray(t, float)
        w = TURN * self.frequency
        x = w * t + self.phase
        if derivative > 0:
            return np.asarray(self.amplitude * w**derivative * (np.cos(x) if derivative == 1 else -np.sin(x)))
        if derivative == -1:  # cos(phase) - cos(x) without a difference of nearly equal numbers
            return np.asarray(self.mean * t + 2.0 * self.amplitude / w * np.sin(0.5 * w * t) * np.sin(0.5 * w * t + self.phase))
        return np.asarray(self.mean + self.amplitude * np.sin(x))

    def periods(self, until: float) -> float:
        """Number of periods from time zero until a time [s]."""
        return abs(self.frequency) * until


@dataclass(frozen=True, kw_only=True)
class Step:
    """``before`` until the time ``at`` [s], ``after`` from then on."""

    at: float
    before: float = 0.0
    after: float = 1.0
    order: ClassVar[int] = 0

    @property
    def breaks(self) -> tuple[float, ...]:
        return (self.at,)

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Real:
        t = np.asarray(t, float)
        if derivative > 0:
            return np.zeros_like(t)
        if derivative == -1:
            return self.before * t + (self.after - self.before) * (np.maximum(t - self.at, 0.0) - max(-self.at, 0.0))
        return np.where(t > self.at if self.at > 0.0 else t >= self.at, self.after, self.before)


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """``before`` until the time ``begin`` [s], then linearly to ``after``, which is reached at the time ``end`` and kept."""

    begin: float
    end: float
    before: float = 0.0
    after: float = 1.0
    order: ClassVar[int] = 1

    @property
    def breaks(self) -> tuple[float, ...]:
        return (self.begin, self.end)

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Real:
        t = np.asarray(t, float)
        slope = (self.after - self.before) / (self.end - self.begin)
        if derivative == 2:
            return np.zeros_like(t)
        if derivative == 1:
            begun = t > self.begin if self.begin > 0.0 else t >= self.begin
            return np.where(begun & (t <= self.end), slope, 0.0)
        if derivative == -1:
            return self.before * t + slope * (self._area(t) - self._area(np.zeros(())))
        return np.where(t >= self.end, self.after, self.before + slope * np.clip(t - self.begin, 0.0, None))

    def _area(self, t: Real) -> Real:
        """Integral of the time since ``begin``, which is constant from ``end`` on."""
        risen = np.clip(t - self.begin, 0.0, self.end - self.begin)
        return 0.5 * risen**2 + (self.end - self.begin) * np.maximum(t - self.end, 0.0)


@dataclass(frozen=True, kw_only=True)
class Chirp:
    """``mean + amplitude sin(x)`` whose frequency x' / 2 pi goes from the first of ``frequencies`` [Hz] to the second.

    It changes linearly ("linear") or exponentially ("exponential") in time, over ``duration`` [s] from time zero on, and stays at
    the second frequency afterwards. ``phase``: x at time zero [rad].
    """

    frequencies: tuple[float, float]
    duration: float
    amplitude: float = 1.0
    mean: float = 0.0
    phase: float = 0.0
    sweep: Literal["linear", "exponential"] = "linear"
    order: ClassVar[int] = 2

    @property
    def breaks(self) -> tuple[float, ...]:
        return (self.duration,)

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Real:
        t = np.asarray(t, float)
        swept, after = np.clip(t, None, self.duration), np.maximum(t - self.duration, 0.0)
        if derivative == -1:
            last = Sine(frequency=self.frequencies[1], amplitude=self.amplitude, phase=float(self._angle(np.array(self.duration))))
            return np.asarray(self.mean * t + self.amplitude * (self._swept(swept) - self._swept(np.zeros(()))) + last(after, -1))
        x = self._angle(swept) + TURN * self.frequencies[1] * after
        if derivative > 0:
            w = TURN * self._frequency(swept)
            faster = np.where(t <= self.duration, TURN * self._frequency(swept, 1), 0.0)
            return np.asarray(self.amplitude * (w * np.cos(x) if derivative == 1 else faster * np.cos(x) - w * w * np.sin(x)))
        return np.asarray(self.mean + self.amplitude * np.sin(x))

    def periods(self, until: float) -> float:
        """Number of periods from time zero until a time [s]."""
        swept = float(self._angle(np.array(min(until, self.duration)))) - self.phase
        return abs(swept) / TURN + abs(self.frequencies[1]) * max(until - self.duration, 0.0)

    @property
    def _growth(self) -> float:
        """Rate of the logarithm of the frequency [1/s]."""
        return math.log(self.frequencies[1] / self.frequencies[0]) / self.duration

    def _frequency(self, t: Real, derivative: int = 0) -> Real:
        """Frequency during the sweep [Hz], or its rate."""
        first, last = self.frequencies
        if self.sweep == "linear":
            rate = (last - first) / self.duration
            return np.full_like(t, rate) if derivative else np.asarray(first + rate * t)
        return np.asarray(first * np.exp(self._growth * t) * self._growth**derivative)

    def _angle(self, t: Real) -> Real:
        """x during the sweep [rad]."""
        first, last = self.frequencies
        if self.sweep == "linear" or first == last:
            return np.asarray(self.phase + TURN * t * (first + 0.5 * (last - first) * (t / self.duration)))
        return np.asarray(self.phase + TURN * first * np.expm1(self._growth * t) / self._growth)

    def _swept(self, t: Real) -> Real:
        """An antiderivative of sin(x) during the sweep, by the integrals of Fresnel or the sine and cosine integrals."""
        from scipy.special import fresnel, sici

        first, last = self.frequencies
        if first == last:
            return np.asarray(-np.cos(self._angle(t)) / (TURN * first))
        if self.sweep == "linear":
            rate = (last - first) / self.duration
            c = self.phase - np.pi * first**2 / rate  # x = c + pi rate u^2
            s, cos = fresnel(np.sqrt(2.0 * abs(rate)) * (t + first / rate))
            return np.asarray((np.sign(rate) * np.cos(c) * s + np.sin(c) * cos) / np.sqrt(2.0 * abs(rate)))
        u = TURN * first * np.exp(self._growth * t) / self._growth  # x = c + u, dt = du / (growth u)
        c = self.phase - TURN * first / self._growth
        si, ci = sici(np.abs(u))
        return np.asarray((np.sin(c) * ci + np.cos(c) * np.sign(u) * si) / self._growth)


@dataclass(frozen=True, eq=False)
class SignalPosition:
    """A coordinate that is ``value`` [rad or m] times a signal of time; ``duration`` of a cycle is infinite: there is none."""

    value: float
    signal: Signal
    duration: float = math.inf

    @property
    def breaks(self) -> tuple[float, ...]:
        return self.signal.breaks

    def __call__(self, t: ArrayLike) -> tuple[Real, Real, Real]:
        return self.value * self.signal(t), self.value * self.signal(t, 1), self.value * self.signal(t, 2)


@dataclass(frozen=True, eq=False)
class SignalSpeed:
    """A drive whose speed is ``speed`` times a signal of time; its coordinate is ``start`` plus the integral. ``duration`` of a run
    [s]."""

    start: float
    speed: float
    signal: Signal
    duration: float

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(t for t in self.signal.breaks if 0.0 < t < self.duration)

    def shock(self, t: float) -> str:
        """The jump at one of the ``breaks`` in words; empty where nothing below the jerk jumps."""
        return JUMPS[self.signal.order] if self.signal.order < len(JUMPS) else ""

    def __call__(self, t: ArrayLike) -> tuple[Real, Real, Real]:
        t = np.asarray(t, float)
        return self.start + self.speed * self.signal(t, -1), self.speed * self.signal(t), self.speed * self.signal(t, 1)
