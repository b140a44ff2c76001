"""Laws of segments: states at their ends, what is free, given accelerations and velocities, tables, least peaks."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cases import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from mechcore.errors import MechanismError
from mechcore.laws.boundary_conditions import BoundaryCondition
from mechcore.laws.factors import jumps, peak
from mechcore.laws.program import CurveOverMaster, Segment, over_time, program
from mechcore.laws.segment_laws import (
    BoundaryPolynomial,
    GivenAcceleration,
    GivenPosition,
    GivenVelocity,
    LeastPeak,
    Spline,
    fourier_curve,
    joined_table,
)
from mechcore.laws.timed import Piecewise

DESIGN = {c["id"]: c for c in json.loads((Path(__file__).parents[2] / "reference" / "design.json").read_text())["cases"]}
FREE = None
PI = np.pi


@pytest.mark.parametrize("axis", ["x", "y", "pen"])
def test_free_knots_of_several_axes_are_the_reference_s_splines(axis):
    case = DESIGN["multi-axis-quintic-spline"]
    knots, values, want = case["inputs"]["knots"], case["inputs"]["axes"][axis], case["expected"][axis]
    ends = [*([v, FREE, FREE] for v in values[1:-1]), values[-1]]
    curve = program(
        [Segment(float(b - a), to, "polynomial") for a, b, to in zip(knots, knots[1:], ends, strict=False)],
        values[0],
        repeats=False,
    )
    np.testing.assert_allclose([p.poly for p in curve.pieces], want["coefficients"], rtol=1e-9, atol=1e-11)
    assert abs(peak(curve, 2).value) == pytest.approx(want["peak_acceleration"], rel=1e-9)
    law = over_time(curve)
    assert isinstance(law, Piecewise)
    np.testing.assert_allclose(np.stack(law(knots[1:-1]))[1], want["knot_velocity"][1:-1], rtol=1e-9)


STATES = st.lists(st.tuples(st.floats(0.3, 2.0), *[st.one_of(st.none(), st.floats(-2, 2))] * 3), min_size=2, max_size=5)


@settings(max_examples=examples(40))
@given(STATES, st.booleans())
def test_free_states_join_with_least_jerk(rows, repeats):
    """Where the velocity and the acceleration are free the third and the fourth derivative are continuous, and so on: each free
    entry of order k makes the derivative 5 - k continuous."""
    segments = [Segment(over, [float(i % 2), v, a], "polynomial") for i, (over, v, a, _) in enumerate(rows)]
    curve = program(segments, [0.0, FREE, FREE] if repeats else 0.0, repeats=repeats)
    left, right = curve.limits(4)
    size = np.abs(np.vstack([left, right])).max(axis=0) + 1.0
    for k, (_, v, a, _) in enumerate(rows):
        last = k == len(rows) - 1
        if last and not repeats:
            continue
        gap = np.abs(right[(k + 1) % len(rows)] - left[k]) / size
        assert np.all(gap[1:3] < 1e-8)
        assert left[k, 0] == pytest.approx(float(k % 2), abs=1e-9)
        for value, order in ((v, 1), (a, 2)):
            if value is None and not (last and repeats):
                assert gap[5 - order] < 1e-6
            elif value is not None:
                assert left[k, order] == pytest.approx(value, abs=1e-8)


def test_jerk_at_an_end_raises_the_degree():
    degrees = []
    for start, end in ((0.0, 1.0), (0.0, [1.0, 0, 0, 0]), ([0.0, 0, 0, 0], [1.0, 0, 0, 0])):
        curve = program([Segment(2.0, end, "polynomial")], start, repeats=False)
        degrees.append(np.flatnonzero(np.abs(curve.pieces[0].poly) > 1e-12).max())
    assert degrees == [5, 6, 7]
    unit = program([Segment(1.0, [1.0, 0, 0, 0], "polynomial")], [0.0, 0, 0, 0])
    np.testing.assert_allclose(unit.pieces[0].poly, [0, 0, 0, 0, 35, -84, 70, -20], atol=1e-11)


def test_what_is_free_beside_a_law_of_its_own_shape_follows_it():
    curve = program([Segment(1.0, 1.0, "constant-velocity"), Segment(2.0, 0.0, "polynomial")], [0.0, FREE, FREE])
    assert [j.order for j in jumps(curve, (0, 1))] == [1, 1]  # the default is rest
    smooth = program(
        [Segment(1.0, [1.0, FREE, FREE], "constant-velocity"), Segment(2.0, [0.0, FREE, FREE], "polynomial")], [0.0, FREE, FREE]
    )
    assert jumps(smooth, (0, 1, 2)) == []
    np.testing.assert_allclose(smooth([1.0, 3.0], 2, "left")[1:], [[1, 1], [0, 0]], atol=1e-12)


def test_a_shape_cannot_meet_a_velocity():
    with pytest.raises(MechanismError, match="a velocity at its end"):
        program([Segment(1.0, [1.0, 0.5], "cycloidal")])


def test_given_acceleration_as_the_lecture_integrates_it():
    """Theory 5.4: a = +-a0 by half turns; the ends decide: C1 = -a0 pi/2 w gives continuous velocity where the mean is zero."""
    a0 = 0.3
    table = joined_table([0.0, PI, 2 * PI], [a0, -a0, 0.0], steps=True)
    curve = program([Segment(2 * PI, None, GivenAcceleration(table))], 0.04)
    assert jumps(curve, (0, 1)) == []
    assert curve(0.0, 1)[1] == pytest.approx(-a0 * PI / 2)
    assert np.ptp(curve(np.linspace(0, 2 * PI, 721), 0)[0]) == pytest.approx(a0 * PI**2 / 4)
    sine = program([Segment(2 * PI, None, GivenAcceleration(fourier_curve(2 * PI, 0.0, [(1, 0.01, 0.0)])))], 0.04)
    x = np.linspace(0, 2 * PI, 9)
    np.testing.assert_allclose(sine(x, 0)[0], 0.04 - 0.01 * np.sin(x), atol=1e-15)


def test_the_size_of_a_given_acceleration_follows_from_rest():
    """A parabola by its shape alone; with a velocity before it, which it takes up."""
    shape = GivenAcceleration(joined_table([0.0, 0.5, 1.0], [7.0, -7.0, 0.0], steps=True), scaled=True)
    curve = program([Segment(1.0, 2.0, shape)], repeats=False)
    np.testing.assert_allclose(curve([0.25, 0.75], 2)[2], [8.0, -8.0])
    np.testing.assert_allclose(curve([0.0, 1.0], 1, "left"), [[0, 2], [0, 0]], atol=1e-14)
    after = program([Segment(1.0, [1.0, FREE, FREE], "constant-velocity"), Segment(1.0, 3.0, shape)], repeats=False)
    assert jumps(after, (0, 1), ends=False) == []


def test_a_balanced_acceleration_that_leads_back_needs_three_stretches():
    """Up and down alone can only vanish; lopsided ones as well."""
    for values in ([1.0, -1.0], [1.0, -0.9]):
        shape = GivenAcceleration(joined_table([0.0, 0.6, 1.0], [values[0], values[1], 0.0], steps=True), balanced=True)
        with pytest.raises(MechanismError, match="end at rest"):
            program([Segment(1.0, 0.0, shape)])


def test_a_balanced_acceleration_that_leads_back_ends_at_rest_where_it_begins():
    """Of x^3 (1 - x)^3 at sixty places: three stretches of one sign, whose sizes meet both conditions with little change."""
    x = np.linspace(0.0, 1.0, 61)
    table = joined_table(x, 6.0 * x * (1.0 - x) * (1.0 - 5.0 * x * (1.0 - x)))
    law = program([Segment(1.0, 0.5, GivenAcceleration(table, balanced=True))], 0.5)
    ends = law(np.array([0.0, 1.0 - 1e-12]), 1)
    np.testing.assert_allclose(ends[0], 0.5, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(ends[1], 0.0, rtol=0.0, atol=1e-11)
    between = np.linspace(0.0, 0.999, 200)
    np.testing.assert_allclose(law(between, 0)[0] - 0.5, (between * (1.0 - between)) ** 3, rtol=0.0, atol=5e-3 * 0.5**6)


def test_given_velocity_decides_the_end_or_is_scaled_to_it():
    velocity = GivenVelocity(joined_table([0.0, 1.0, 2.0], [0.0, 3.0, 0.0]))
    assert program([Segment(2.0, None, velocity), Segment(1.0)], 1.0, repeats=False).pieces[-1].poly[0] == pytest.approx(4.0)
    scaled = program([Segment(2.0, 2.0, velocity)], 1.0, repeats=False)
    np.testing.assert_allclose(scaled([1.0, 2.0], 1, "left"), [[1.5, 2.0], [1.0, 0.0]], atol=1e-14)


def test_tables_and_splines_pass_through_their_points():
    table = GivenPosition(joined_table([0.0, 0.4, 1.0], [0.0, 0.3, 0.1]))
    assert program([Segment(1.0, None, table), Segment(1.0)], repeats=False)([0.4, 1.0, 1.7], 0)[0] == pytest.approx(
        [0.3, 0.1, 0.1]
    )
    inner = (BoundaryCondition(0.5, 0.8), BoundaryCondition(1.2, 0.9), BoundaryCondition(1.2, 0.25, 1))
    for law in (Spline(inner), BoundaryPolynomial(inner)):
        curve = program([Segment(2.0, 1.0, law)], repeats=False)
        assert curve([0.0, 0.5, 1.2, 2.0], 0)[0] == pytest.approx([0.0, 0.8, 0.9, 1.0], abs=1e-11)
        assert curve(1.2, 1)[1] == pytest.approx(0.25)
        assert jumps(curve, (0, 1, 2)) == []


def test_least_peak_between_states_is_bang_bang():
    curve = program([Segment(2.0, 6.0, LeastPeak("acceleration", steps=16))], repeats=False)
    assert abs(peak(curve, 2).value) == pytest.approx(4.0 * 6.0 / 2.0**2, rel=1e-9)
    moving = program([Segment(2.0, [6.0, 3.0], LeastPeak("acceleration", steps=16))], [0.0, 3.0], repeats=False)
    assert abs(peak(moving, 2).value) == pytest.approx(0.0, abs=1e-9)  # 6 = 3 x 2: nothing to do
    limited = program([Segment(2.0, 6.0, LeastPeak("acceleration", {3: 40.0}, smooth=3))], repeats=False)
    assert abs(peak(limited, 3).value) <= 40.0 * 6.0 / 2.0**3 * (1 + 1e-9)
    assert jumps(limited, (0, 1, 2)) == []


@pytest.mark.parametrize("stroke", range(4))
def test_seven_phases_of_constant_jerk_make_the_reference_s_strokes(stroke):
    """Its times of ramps, of constant acceleration and of constant speed lead from rest to rest over its way; where no limit but
    that of the jerk counts, no law of the same time has a smaller jerk."""
    case = DESIGN["stroke-time-parametrisation"]
    limits, wanted = case["inputs"]["strokes"][stroke], case["expected"]["strokes"][stroke]
    ramp, even, coast, total = (wanted[key] for key in ("t_jerk", "t_const_acc", "t_cruise", "total_time"))
    a, speeding = wanted["peak_acceleration"], 2.0 * ramp + even
    at = np.cumsum([0.0, ramp, even, ramp, coast, ramp, even, ramp])
    assert at[-1] == pytest.approx(total)
    kept = np.append(True, np.diff(at) > 0.0)
    shape = GivenAcceleration(joined_table(at[kept], np.array([0, a, a, 0, 0, -a, -a, 0])[kept]), scaled=True)
    curve = program([Segment(at[-1], limits["L"], shape)], repeats=False)
    assert [abs(peak(curve, k).value) for k in (1, 2, 3)] == pytest.approx([wanted["peak_speed"], a, limits["j"]], rel=1e-9)
    assert curve(speeding, 1)[1] == pytest.approx(wanted["peak_speed"])
    assert jumps(curve, (0, 1, 2)) == []
    if wanted["peak_speed"] < limits["v"] and a < limits["a"]:
        least = program([Segment(total, limits["L"], LeastPeak("jerk", steps=64))], repeats=False)
        assert abs(peak(least, 3).value) == pytest.approx(limits["j"], rel=1e-6)


def test_a_program_over_time_with_waves_follows_a_clock():
    law = over_time(program([Segment(0.5, 1.0), Segment(0.5)], repeats=True))
    assert isinstance(law, CurveOverMaster)
    assert law.duration == pytest.approx(1.0)
    np.testing.assert_allclose(law(np.array([0.25, 0.75]))[0], [0.5, 1.0])


@pytest.mark.parametrize("to", [0.0, 2.5])
@pytest.mark.parametrize("name", ["3-4-5", "cycloidal", "harmonic", "modified-sine"])
def test_segments_over_time_begin_anew_whatever_their_laws(name, to):
    """Waves as polynomials: the second cycle is the first one, from where that has ended."""
    law = over_time(program([Segment(0.5, 1.0, name), Segment(0.3), Segment(0.4, to, name)], repeats=False))
    assert law.duration == pytest.approx(1.2)
    t = np.linspace(0.01, 1.19, 40)
    first, second = np.stack(law(t)), np.stack(law(t + 1.2))
    np.testing.assert_allclose(second[0], first[0] + to, atol=1e-12)
    np.testing.assert_allclose(second[1:], first[1:], atol=1e-10)


def test_breaks_of_a_law_of_time_are_where_a_derivative_jumps():
    """Of bang-bang jerk over 64 steps the two switches, of quintics that join up to the fourth derivative none."""
    switches = over_time(program([Segment(2.0, 1.0, LeastPeak("jerk"))], repeats=False)).breaks
    np.testing.assert_allclose(switches, [0.5, 1.5])
    smooth = [Segment(1.0, [1.0, FREE, FREE], "polynomial"), Segment(1.0, 3.0, "polynomial")]
    assert over_time(program(smooth, repeats=False)).breaks == ()
    rest = [Segment(1.0, 1.0, "polynomial"), Segment(1.0, 3.0, "polynomial")]
    assert over_time(program(rest, repeats=False)).breaks == (1.0,)  # the jerk
