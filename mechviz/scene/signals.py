"""Signals of a scene: sine, step, ramp and chirp of time, by which loads and the speeds of drives are multiplied."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Literal

from pydantic import Field, model_validator

from mechcore.laws import Chirp, Ramp, Signal, Sine, Step

from .convert import LARGEST, Converter
from .fields import Angle, Duration, Frequency, Number, Time
from .tables import Table, is_whole, one_of, refuse

__all__ = ["SIGNALS", "ChirpDocument", "RampDocument", "SineDocument", "StepDocument", "signal_of"]


class SineDocument(Table):
    """A factor mean + amplitude sin(2 pi frequency t + phase)."""

    frequency: Frequency | None = None
    """Cycles per time. Give this or period."""
    period: Duration | None = None
    """Time of one cycle. Give this or frequency."""
    amplitude: Number = 1.0
    """Largest distance of the factor from its mean."""
    mean: Number = 0.0
    """Mean of the factor."""
    phase: Angle = 0.0
    """Phase angle at time zero."""

    @model_validator(mode="after")
    def _one_rate(self) -> SineDocument:
        refuse(one_of(self, ("frequency", "period"), "the sine"))
        return self


class StepDocument(Table):
    """A factor that jumps."""

    at: Time
    """Time of the jump."""
    before: Number = 0.0
    """Factor until then."""
    after: Number = 1.0
    """Factor from then on."""


class RampDocument(Table):
    """A factor that changes evenly from one value to another."""

    begin: Time = 0.0
    """Time at which the change begins."""
    end: Time
    """Time at which it ends."""
    before: Number = 0.0
    """Factor until it begins."""
    after: Number = 1.0
    """Factor once it has ended."""


class ChirpDocument(Table):
    """A factor mean + amplitude sin(x) whose frequency sweeps from one value to another, from time zero on."""

    frequencies: Annotated[list[Frequency], Field(min_length=2, max_length=2)]
    """Frequencies [at time zero, at the end of the sweep], at which it stays."""
    duration: Duration
    """Time of the sweep."""
    sweep: Literal["linear", "exponential"] = "linear"
    """"linear": the frequency grows evenly; "exponential": by the same factor in the same time."""
    amplitude: Number = 1.0
    """Largest distance of the factor from its mean."""
    mean: Number = 0.0
    """Mean of the factor."""
    phase: Angle = 0.0
    """Phase angle at time zero."""


class _Numbers:
    """The values of one signal in SI; a fault is noted for each that is not sound."""

    def __init__(self, given: Table, convert: Converter, path: str):
        self.given, self.convert, self.path = given, convert, path

    def si(self, key: str, kind: str) -> float:
        return self.convert.si(getattr(self.given, key), kind, f"{self.path}.{key}")

    def plain(self, *keys: str) -> dict[str, float]:
        """Numbers without a unit, by their keys."""
        for key in keys:
            value = getattr(self.given, key)
            if abs(value) > LARGEST:
                self.convert.note(f"{self.path}.{key}", f"{value:g} is beyond {LARGEST:g}.", "Check the number.")
        return {key: getattr(self.given, key) for key in keys}

    def sine(self) -> Signal:
        given, waves = self.given, self.plain("amplitude", "mean")
        assert isinstance(given, SineDocument)
        frequency = math.nan  # neither is a fault that is noted where the sine was read
        if given.period is not None:
            frequency = 1.0 / self.si("period", "time")
        elif given.frequency is not None:
            frequency = self.si("frequency", "frequency")
        return Sine(frequency=frequency, **waves, phase=self.si("phase", "angle"))

    def step(self) -> Signal:
        return Step(at=self.si("at", "time"), **self.plain("before", "after"))

    def ramp(self) -> Signal:
        begin, end = self.si("begin", "time"), self.si("end", "time")
        if end <= begin and self.convert.certain("time"):
            why = "ends before it begins." if end < begin else "ends where it begins: it jumps."
            remedy = "Give a later end." if end < begin else "Give a later end, or write step = { at = ... }."
            self.convert.note(f"{self.path}.end", why, remedy)
        return Ramp(begin=begin, end=end, **self.plain("before", "after"))

    def chirp(self) -> Signal:
        given, waves = self.given, self.plain("amplitude", "mean")
        assert isinstance(given, ChirpDocument)
        first, last = self.convert.row(given.frequencies, "frequency", f"{self.path}.frequencies")
        if abs(last - first) <= ALIKE * first:
            remedy = "Write sine = { frequency = ... }, or give two that differ."
            self.convert.note(f"{self.path}.frequencies", "are the same: nothing sweeps.", remedy)
        phase, duration = self.si("phase", "angle"), self.si("duration", "time")
        return Chirp(frequencies=(first, last), duration=duration, sweep=given.sweep, phase=phase, **waves)


ALIKE = 1e-6
"""Relative difference of two frequencies that counts as none."""

SIGNALS: Mapping[str, Callable[[_Numbers], Signal]] = {
    "sine": _Numbers.sine,
    "step": _Numbers.step,
    "ramp": _Numbers.ramp,
    "chirp": _Numbers.chirp,
}
"""The keys of the signals, and how each becomes one of the core."""


def signal_of(key: str, given: Table, convert: Converter, path: str) -> Signal | None:
    """The signal that stands under one of the keys of `SIGNALS`; None where a fault of it was noted."""
    before = len(convert.faults)
    sound = is_whole(given)
    signal = SIGNALS[key](_Numbers(given, convert, path)) if sound else None
    unknown = isinstance(signal, Sine) and math.isnan(signal.frequency)
    return None if unknown or len(convert.faults) > before else signal
