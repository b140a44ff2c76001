"""Laws and signals of time as motion curves: the same values, also beyond their first cycle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mechcore.laws.signals import Chirp, Ramp, Sine, Step
from mechcore.laws.time_curves import curve_of_time, numbers_of_time
from mechcore.laws.timed import ConstantSpeed, Oscillation, Rest, Table, zones

POINTS = {"x": (0.1, 0.4, 0.5, 1.1), "y": (1.0, -2.0, 0.5, 3.0)}
LAWS = [
    Rest(0.3),
    ConstantSpeed(0.2, -3.0),
    Oscillation(0.1, 0.4, 2.3, 0.7),
    zones(start=0.1, speed=2.0, run_up=0.5, steady=1.0, braking=0.4),
]
SIGNALS = [
    Sine(frequency=1.7, amplitude=2.0, mean=-0.3, phase=1.1),
    Step(at=0.37, before=-1.0),
    Ramp(begin=0.21, end=0.8, before=2.0),
    *(Table(**POINTS, smooth=smooth, period=period) for smooth in (True, False, "spline") for period in (None, 1.3)),  # type: ignore[arg-type]
]
TIMES = np.linspace(0.001, 6.0, 997)


@pytest.mark.parametrize("law", LAWS)
def test_laws(law: Any) -> None:
    curve = curve_of_time(law)
    assert curve is not None
    for own, value in zip(curve(TIMES), law(TIMES), strict=True):
        np.testing.assert_allclose(own, value, rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize("signal", SIGNALS)
def test_signals(signal: Any) -> None:
    curve = curve_of_time(signal)
    assert curve is not None and numbers_of_time(signal) == curve.numbers
    np.testing.assert_allclose(curve(TIMES, 0)[0], signal(TIMES), rtol=1e-12, atol=1e-12)


def test_what_has_no_pieces_has_no_curve() -> None:
    assert numbers_of_time(Chirp(frequencies=(1.0, 2.0), duration=1.0)) is None
    assert numbers_of_time(np.sin) is None
