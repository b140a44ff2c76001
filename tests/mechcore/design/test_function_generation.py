"""Function generators: published cases, precision points met by the closure of the links, defects, least squares that is least."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_cases import design_case

from mechcore.design.freudenstein import FunctionTask, chebyshev_points, fitted_generator, generators, slider_generator
from mechcore.errors import MechanismError

TANGENT = FunctionTask(np.tan, 0.0, np.pi / 4, np.radians(60), np.radians(60))
INVERSE = FunctionTask(lambda x: 1.0 / x, 1.0, 2.0, np.radians(90), np.radians(-90))


def closure(made, task, x):
    """|B - A| of the signed links at the wanted angles, which has to be the coupler."""
    phi, psi = task.turned(x)
    a = made.crank * np.exp(1j * (made.input_start + phi))
    return np.abs(1.0 + made.rocker * np.exp(1j * (made.output_start + psi)) - a)


def check(made, expected):
    assert made.k == pytest.approx(expected["K"], rel=1e-10)
    for name, value in zip("abc", (made.crank, made.coupler, made.rocker), strict=True):
        assert value == pytest.approx(expected[name], rel=1e-10)


def test_three_points_in_closed_form():
    inputs, expected = design_case("freudenstein-3-points")
    x = chebyshev_points(inputs["x0"], inputs["x1"], 3)
    assert x == pytest.approx(expected["precision_x"], rel=1e-12)
    (made,) = generators(TANGENT, x, np.radians(60), np.radians(90))
    check(made, expected)
    error, place = made.largest_error(TANGENT)
    assert (error, place) == pytest.approx((expected["max_structural_error"], expected["at_x"]), rel=1e-10)
    assert np.degrees(made.least_transmission(TANGENT)) == pytest.approx(expected["min_transmission_angle_deg"], rel=1e-10)


def test_four_points_have_two_solutions():
    _, expected = design_case("freudenstein-4-points")
    computed = generators(INVERSE, np.array(expected["precision_x"]), np.radians(30))
    assert len(computed) == len(expected["solutions"])
    for made, wanted in zip(computed, expected["solutions"], strict=True):
        check(made, wanted)
        assert np.degrees(made.output_start) == pytest.approx(wanted["psi_s_deg"], rel=1e-10)
        assert np.degrees(made.largest_error(INVERSE)[0]) == pytest.approx(wanted["max_structural_error_deg"], rel=1e-9)
        assert made.defects.none.all() == wanted["same_branch"]


def test_five_points_are_met_and_all_found():
    _, expected = design_case("freudenstein-5-points")
    x = chebyshev_points(1.0, 2.0, 5)
    computed = [one for one in generators(INVERSE, x) if max(abs(one.crank), one.coupler, abs(one.rocker)) < 30]
    (wanted,) = expected["solutions"]
    (made,) = computed
    check(made, wanted)
    assert np.degrees([made.input_start, made.output_start]) == pytest.approx([wanted["phi_s_deg"], wanted["psi_s_deg"]], rel=1e-10)
    assert np.degrees(made.largest_error(INVERSE)[0]) == pytest.approx(wanted["max_structural_error_deg"], rel=1e-9)
    assert closure(made, INVERSE, x) == pytest.approx(made.coupler, rel=1e-12)


def test_least_squares_of_the_residual_and_of_the_error_itself():
    _, expected = design_case("freudenstein-least-squares")
    x = np.linspace(0.0, np.pi / 4, 31)
    made = fitted_generator(TANGENT, x, np.radians(60), np.radians(90))
    check(made, expected)

    def size(one):
        return np.sqrt((one.structural_error(TANGENT, x) ** 2).mean())

    assert size(made) == pytest.approx(expected["rms_structural_error"], rel=1e-10)
    refined = fitted_generator(TANGENT, x, np.radians(60), np.radians(90), refine=True)
    for k in range(3):  # no neighbour is better
        for sign in (-1, 1):
            moved = refined.k * (1.0 + sign * 1e-4 * (np.arange(3) == k))
            other = replace(refined, k=moved)
            assert size(other) > size(refined)
    freed = fitted_generator(TANGENT, x, np.radians(60), np.radians(90), refine=True, starts_too=True)
    assert size(freed) < size(refined) < size(made)


def test_the_branch_is_that_of_positive_lengths_too():
    for made in generators(INVERSE, chebyshev_points(1.0, 2.0, 4), np.radians(30)):
        bar = made.four_bar()
        phi, psi = INVERSE.turned(made.points)
        half = np.pi * np.array([made.crank < 0, made.rocker < 0])
        _, b, _ = bar.positions(made.input_start + phi + half[0])
        assert np.exp(1j * (np.angle(b - 1.0) - half[1])) == pytest.approx(np.exp(1j * (made.output_start + psi)), abs=1e-12)


def test_slider_cranks_meet_three_points():
    phi, s = np.radians([0.0, 40.0, 80.0]), np.array([0.0, -0.02, -0.07])
    made = slider_generator(phi, s, np.radians(20), 0.3)
    assert made is not None
    assert made.displacements(made.input_start + phi) - 0.3 == pytest.approx(s, abs=1e-13)


def test_a_range_goes_either_way():
    task = FunctionTask(np.square, 2.0, 1.0, np.radians(90), np.radians(90))
    for made in generators(task, chebyshev_points(2.0, 1.0, 5)):
        error, place = made.largest_error(task)
        assert 1.0 <= place <= 2.0
        assert abs(error) >= np.abs(made.structural_error(task, np.linspace(1.0, 2.0, 1001))).max() * (1.0 - 1e-9)


@pytest.mark.parametrize(("start", "end"), [(-1.0, 1.0), (1.0, -1.0), (-1.0, 2.0)])
def test_a_pole_within_the_range_is_named(start, end):
    task = replace(INVERSE, start=start, end=end)
    with pytest.raises(MechanismError, match="no finite value"), np.errstate(divide="ignore"):
        generators(task, chebyshev_points(start, end, 3), 0.5, 0.6)


@pytest.mark.parametrize("count", [2, 3, 6])
def test_what_does_not_fit_is_refused(count):
    with pytest.raises(MechanismError, match="points"):
        generators(INVERSE, chebyshev_points(1.0, 2.0, count), 0.5)
