"""Strokes, swings, time ratios and straight lines: published cases, and the motion that results."""

from __future__ import annotations

import numpy as np
import pytest
from design_cases import design_case, time_ratio

from mechcore.design.strokes import (
    STRAIGHT_LINES,
    best_crank_rocker,
    best_slider_crank,
    hoecken,
    slider_crank,
    slotted_lever,
    straightness,
    whitworth,
)
from mechcore.errors import MechanismError

CIRCLE = np.linspace(0.0, 2.0 * np.pi, 7200, endpoint=False)


def test_slider_cranks_of_a_stroke_and_a_time_ratio():
    inputs, expected = design_case("slider-crank-time-ratio")
    for row in expected["rows"]:
        made = slider_crank(inputs["H"], inputs["Q"], row["e"])
        assert (made.crank, made.rod, made.alpha) == pytest.approx((row["r"], row["l"], row["alpha"]), rel=1e-10)
        assert np.degrees(made.pressure_angle) == pytest.approx(row["max_pressure_angle_deg"], rel=1e-10)
    best, wanted = best_slider_crank(inputs["H"], inputs["Q"]), expected["optimum"]
    assert best.offset == pytest.approx(wanted["e"], rel=1e-6)
    assert np.degrees(best.pressure_angle) == pytest.approx(wanted["max_pressure_angle_deg"], rel=1e-10)
    x = best.crank * np.cos(CIRCLE) + np.sqrt(best.rod**2 - (best.offset - best.crank * np.sin(CIRCLE)) ** 2)
    assert (np.ptp(x), time_ratio(x)) == pytest.approx((inputs["H"], inputs["Q"]), rel=1e-6)


@pytest.mark.parametrize("ratio", [1.01, 2.0, 2.3, 2.9, 2.999])
def test_the_best_slider_crank_has_its_stroke_and_ratio_up_to_the_largest_one(ratio):
    """From 3 on the inner dead centre would lie below the crank's pivot, and the crank would not turn fully."""
    best = best_slider_crank(0.2, ratio)
    assert best.turns
    outer, inner = (np.sqrt((best.rod + sign * best.crank) ** 2 - best.offset**2) for sign in (1, -1))
    assert outer - inner == pytest.approx(0.2, rel=1e-9)
    alpha = np.arctan2(best.offset, inner) - np.arctan2(best.offset, outer)
    assert (np.pi + alpha) / (np.pi - alpha) == pytest.approx(ratio, rel=1e-9)


@pytest.mark.parametrize("ratio", [3.0, 4.0, 1e9])
def test_no_slider_crank_is_made_up_for_larger_ratios(ratio):
    with pytest.raises(MechanismError, match="below 3"):
        best_slider_crank(0.2, ratio)
    with pytest.raises(MechanismError, match="below 3"):
        slider_crank(0.2, ratio, 0.01)


def test_the_crank_rocker_of_the_best_transmission():
    """The frame length of the reference's case is that of the other side of the chord, whose own transmission angle is 44.8
    degrees: crank, coupler and rocker and the angle that it states belong to a frame of 1.2126, by the law of cosines."""
    inputs, expected = design_case("crank-rocker-optimum-transmission")
    swing = np.radians(inputs["psi0_deg"])
    best = best_crank_rocker(swing, expected["Q"], inputs["c"])
    assert (best.crank, best.coupler, best.rocker) == pytest.approx([expected[k] for k in "abc"], rel=1e-8)
    assert np.degrees(best.least_transmission()) == pytest.approx(expected["min_transmission_angle_deg"], rel=1e-10)
    a, b, c = best.crank, best.coupler, best.rocker

    def least(d):
        folded, stretched = (np.arccos((b * b + c * c - x * x) / (2.0 * b * c)) for x in (d - a, d + a))
        return np.degrees(min(folded, np.pi - stretched))

    assert best.frame == pytest.approx(1.2126, abs=5e-5)
    assert least(best.frame) == pytest.approx(expected["min_transmission_angle_deg"], rel=1e-10)
    assert least(expected["d"]) == pytest.approx(44.8, abs=0.05)
    _, b, _ = best.positions(CIRCLE)
    angle = np.unwrap(np.angle(b - best.rocker_pivot))
    assert np.ptp(angle) == pytest.approx(swing, rel=1e-6)
    assert time_ratio(angle) == pytest.approx(expected["Q"], rel=1e-5)


def test_slotted_levers_return_quickly():
    made = slotted_lever(0.3, 2.0, 0.2)
    angle = np.angle(made.frame + made.crank * np.exp(1j * CIRCLE))
    assert np.ptp(angle) == pytest.approx(made.swing, rel=1e-6)
    assert 2.0 * made.lever * np.sin(made.swing / 2.0) == pytest.approx(0.3, rel=1e-12)
    assert time_ratio(angle) == pytest.approx(2.0, rel=1e-5)
    distance = whitworth(0.2, 2.0, 0.1).frame  # half a turn of the lever takes as long as the crank's arc on its side
    upper = 2.0 * np.arcsin(distance / 0.1) + np.pi
    assert upper / (2.0 * np.pi - upper) == pytest.approx(2.0, rel=1e-12)


def test_well_known_straight_lines():
    _, expected = design_case("straight-line-linkages")
    assert set(STRAIGHT_LINES) == set(expected)
    for name, row in expected.items():
        error = straightness(STRAIGHT_LINES[name])
        assert error.travel == pytest.approx(row["travel_along_line"], rel=1e-10)
        assert error.greatest - error.least == pytest.approx(row["peak_to_peak"], rel=1e-10)
        assert error.ratio == pytest.approx(row["ratio"], rel=1e-10)


@pytest.mark.parametrize("row", [0, 3])
def test_the_best_proportions_of_hoecken(row):
    _, expected = design_case("hoecken-optimum")
    straight, frame, coupler, ratio = expected["rows"][row]
    designs = hoecken(np.radians(straight))
    assert (designs.four_bar.frame, designs.four_bar.coupler) == pytest.approx((frame, coupler), rel=1e-5)
    assert straightness(designs).ratio == pytest.approx(ratio, rel=1e-3)


@pytest.mark.parametrize(
    ("function", "given"),
    [
        (slider_crank, (0.2, 0.9, 0.01)),
        (slider_crank, (0.2, 1.2, 5.0)),
        (best_slider_crank, (0.2, 1.0)),
        (best_crank_rocker, (np.radians(200), 1.2)),
        (slotted_lever, (0.2, 1.0, 0.1)),
    ],
)
def test_what_cannot_be_had_is_refused(function, given):
    with pytest.raises(MechanismError):
        function(*given)
