"""Laws and signals of time as motion curves, the form in which programs in C take them."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.constants import TURN
from mechcore.laws.curve import MotionCurve
from mechcore.laws.signals import Ramp, Sine, Step
from mechcore.laws.timed import ConstantSpeed, Oscillation, Piecewise, Rest, Table

KNOWN = Rest, ConstantSpeed, Oscillation, Piecewise, Table, Sine, Step, Ramp
NO_WAVES = np.zeros((0, 3))


def numbers_of_time(function: object) -> tuple[float, ...] | None:
    """The numbers of the motion curve of a law or signal, as programs in C take them; None where there is none."""
    return _numbers(function) if isinstance(function, KNOWN) else None


@lru_cache(256)
def _numbers(function: object) -> tuple[float, ...] | None:
    curve = curve_of_time(function)
    return None if curve is None else curve.numbers


def curve_of_time(function: object) -> MotionCurve | None:
    """The motion curve that equals a drive's law or a signal at times from zero on; None where there is none."""
    if isinstance(function, Rest):
        return _one([function.position])
    if isinstance(function, ConstantSpeed):
        return _one([function.start, function.speed])
    if isinstance(function, Oscillation):
        return _swinging(function.centre, function.amplitude, function.frequency, function.phase)
    if isinstance(function, Sine):
        return _swinging(function.mean, function.amplitude, function.frequency, function.phase)
    if isinstance(function, Piecewise):
        curve = MotionCurve.of(function.knots, function.coefficients, repeats=True)
        return curve if np.isclose(curve.advance, function.advance, rtol=1e-14, atol=0.0) else None
    if isinstance(function, Step):
        return _steps([function.at], [[function.before], [function.after]])
    if isinstance(function, Ramp):
        slope = (function.after - function.before) / (function.end - function.begin)
        return _steps([function.begin, function.end], [[function.before], [function.before, slope], [function.after]])
    if isinstance(function, Table):
        borders, coefficients = function.pieces()
        polys = list(coefficients[:, ::-1])
        if function.period is not None:
            return MotionCurve.of(borders.tolist(), polys, repeats=True)
        return _steps(borders, [[function.y[0]], *polys, [function.y[-1]]])
    return None


def _one(poly: list[float], waves: Real = NO_WAVES) -> MotionCurve:
    return MotionCurve.of((0.0, 1.0), [poly], [waves])


def _swinging(mean: float, amplitude: float, frequency: float, phase: float) -> MotionCurve:
    return _one([mean], np.array([[TURN * frequency, amplitude * np.cos(phase), amplitude * np.sin(phase)]]))


def _steps(borders: Any, polys: list[Any]) -> MotionCurve:
    """Pieces before, between and after borders (n,); the first and the last are unbounded."""
    return MotionCurve.of([borders[0] - 1.0, *borders, borders[-1] + 1.0], polys)
