"""Signals of a scene: sine, step, ramp and chirp of time, by which loads and the speeds of drives are multiplied."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Literal

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from mechcore.laws.signals import Chirp, Ramp, Signal, Sine, Step
from mechcore.laws.timed import Smoothness
from mechviz.scene.convert import LARGEST_VALUE, Converter
from mechviz.scene.fields import (
    Angle,
    Argument,
    Coordinate,
    DocumentTable,
    Duration,
    Frequency,
    Length,
    Number,
    Period,
    Rate,
    Speed,
    Text,
    Time,
    describe,
    fault,
    is_complete,
    one_of,
    raise_faults,
)


class SineDocument(DocumentTable):
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
        raise_faults(one_of(self, ("frequency", "period"), "the sine"))
        return self


class StepDocument(DocumentTable):
    """A factor that jumps."""

    at: Time
    """Time of the jump."""
    before: Number = 0.0
    """Factor until then."""
    after: Number = 1.0
    """Factor from then on."""


class RampDocument(DocumentTable):
    """A factor that changes linearly from one value to another."""

    begin: Time = 0.0
    """Time at which the change begins."""
    end: Time
    """Time at which it ends."""
    before: Number = 0.0
    """Factor until it begins."""
    after: Number = 1.0
    """Factor once it has ended."""


class ChirpDocument(DocumentTable):
    """A factor mean + amplitude sin(x) whose frequency sweeps from one value to another, from time zero on."""

    frequencies: Annotated[list[Frequency], Field(min_length=2, max_length=2)]
    """Frequencies [at time zero, at the end of the sweep]; the last one then remains."""
    duration: Duration
    """Time of the sweep."""
    sweep: Literal["linear", "exponential"] = "linear"
    """How the frequency changes: "linear", in proportion to time, or "exponential", by the same factor in equal times."""
    amplitude: Number = 1.0
    """Largest distance of the factor from its mean."""
    mean: Number = 0.0
    """Mean of the factor."""
    phase: Angle = 0.0
    """Phase angle at time zero."""


class _Numbers:
    """The values of one signal in SI; a fault is noted for each that is not valid."""

    def __init__(self, given: DocumentTable, convert: Converter, path: str):
        self.given, self.convert, self.path = given, convert, path

    def si(self, key: str, kind: str) -> float:
        return self.convert.si(getattr(self.given, key), kind, f"{self.path}.{key}")

    def plain(self, *keys: str) -> dict[str, float]:
        """Numbers without a unit, by their keys."""
        for key in keys:
            value = getattr(self.given, key)
            if abs(value) > LARGEST_VALUE:
                self.convert.note(f"{self.path}.{key}", f"{value:g} is beyond {LARGEST_VALUE:g}.", "Check the number.")
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
        if end <= begin and self.convert.has_known_unit("time"):
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
"""Relative difference up to which two frequencies count as equal."""

SIGNALS: Mapping[str, Callable[[_Numbers], Signal]] = {
    "sine": _Numbers.sine,
    "step": _Numbers.step,
    "ramp": _Numbers.ramp,
    "chirp": _Numbers.chirp,
}
"""The keys of the signals, each with its conversion to the core."""


def signal_of(key: str, given: DocumentTable, convert: Converter, path: str) -> Signal | None:
    """The core's signal of the table under one of the keys of `SIGNALS`; None where a fault of it was noted."""
    before = len(convert.faults)
    valid = is_complete(given)
    signal = SIGNALS[key](_Numbers(given, convert, path)) if valid else None
    unknown = isinstance(signal, Sine) and math.isnan(signal.frequency)
    return None if unknown or len(convert.faults) > before else signal


ARGUMENTS = ("position", "velocity", "time", "x", "y", "vx", "vy", "speed")
"""Arguments of a factor: coordinate or rate of a joint, the time, place or velocity of a point."""

_OF_PAIRS, _OF_POINTS = ("position", "velocity"), ("x", "y", "vx", "vy", "speed")


def _smooth(value: object) -> Smoothness:
    if isinstance(value, bool):
        return value
    if value == "spline":
        return "spline"
    raise fault(f"{describe(value)} does not say how the points are joined.", 'Write true, false (straight lines) or "spline".')


Smooth = Annotated[Smoothness, PlainValidator(_smooth), WithJsonSchema({"anyOf": [{"type": "boolean"}, {"const": "spline"}]})]


def _names(of: str, joint: str | None, drive: str | None, point: str | None) -> list[tuple[str, str, str]]:
    """Faults where the name of a joint or point does not go with the argument of the factor."""
    wrong = []
    if joint is not None and drive is not None:
        wrong.append(("drive", "joint and drive at once.", "Keep one of them."))
    for key, value in (("joint", joint), ("drive", drive)):
        if value is not None and of not in _OF_PAIRS:
            wrong.append((key, f"{key} does not go with {of}.", f"Leave out {key}."))
    if of in _OF_POINTS and point is None:
        wrong.append(("", f"depends on {of}, but of which point?", 'Add point = "link.point".'))
    if of not in _OF_POINTS and point is not None:
        wrong.append(("point", f"point does not go with {of}.", "Leave out point."))
    return wrong


class FactorTable(DocumentTable):
    """A factor as a function of one of position, velocity, time, x, y, vx, vy, speed."""

    position: Annotated[list[Coordinate], Field(min_length=2)] | None = None
    """Increasing coordinates of a joint, by default of the first drive."""
    velocity: Annotated[list[Rate], Field(min_length=2)] | None = None
    """Increasing rates of the coordinate of a joint."""
    time: Annotated[list[Time], Field(min_length=2)] | None = None
    """Increasing times."""
    x: Annotated[list[Length], Field(min_length=2)] | None = None
    """Increasing x coordinates of a point in the world."""
    y: Annotated[list[Length], Field(min_length=2)] | None = None
    """Increasing y coordinates of a point in the world."""
    vx: Annotated[list[Speed], Field(min_length=2)] | None = None
    """Increasing velocities of a point along x."""
    vy: Annotated[list[Speed], Field(min_length=2)] | None = None
    """Increasing velocities of a point along y."""
    speed: Annotated[list[Speed], Field(min_length=2)] | None = None
    """Increasing speeds of a point, whatever their direction."""
    factor: Annotated[list[Number], Field(min_length=2)]
    """Factors there."""
    period: Period | None = None
    """Position, time: the table repeats after this much; without it the end values hold outside the table."""
    smooth: Smooth = True
    """true: a cubic between any two points that stays between them (monotone, PCHIP); "spline": a cubic spline with continuous
    second derivatives, which may overshoot; false: straight lines."""
    drive: Text | None = None
    """Position, velocity: the driven joint. Default: the first one."""
    joint: Text | None = None
    """Position, velocity: any joint, driven or not."""
    point: Text | None = None
    """x, y, vx, vy, speed: the point, as "link.point"."""

    @property
    def of(self) -> str:
        return next((key for key in ARGUMENTS if getattr(self, key) is not None), "position")

    @model_validator(mode="after")
    def _same_length(self) -> FactorTable:
        raise_faults(one_of(self, ARGUMENTS, "the table"))
        rows = getattr(self, self.of)
        wrong = _names(self.of, self.joint, self.drive, self.point)
        if self.has_valid(self.of, "factor") and len(rows) != len(self.factor):
            plural = f"{self.of}s" if self.of in ("position", "time", "speed") else f"values of {self.of}"
            wrong.append(("", f"{len(rows)} {plural} and {len(self.factor)} factors.", f"Give one factor for each {self.of}."))
        if self.period is not None and self.of not in ("position", "time"):
            wrong.append(("period", f"period does not go with {self.of}.", "Leave out period."))
        raise_faults(wrong)
        return self


class FactorPolynomial(DocumentTable):
    """A factor as a polynomial: the sum of coefficients[k] (argument / per)^k."""

    of: Literal["position", "velocity", "time", "x", "y", "vx", "vy", "speed"]
    """The argument: coordinate or rate of a joint, the time, place or velocity of a point."""
    coefficients: Annotated[list[Number], Field(min_length=1)]
    """Coefficients, the constant one first."""
    per: Argument | None = None
    """Divisor of the argument. Default: one of the scene's units."""
    drive: Text | None = None
    """Position, velocity: the driven joint. Default: the first one."""
    joint: Text | None = None
    """Position, velocity: any joint, driven or not."""
    point: Text | None = None
    """x, y, vx, vy, speed: the point, as "link.point"."""

    @model_validator(mode="after")
    def _named(self) -> FactorPolynomial:
        raise_faults(_names(self.of, self.joint, self.drive, self.point))
        return self
