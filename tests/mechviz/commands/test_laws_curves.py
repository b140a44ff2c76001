"""Motion curves: exact derivatives, the catalogue against the reference, conditions, splines, tables, optima, programs."""

from __future__ import annotations

import json
from fractions import Fraction
from math import perm

import numpy as np
import pytest
from cam_cases import CASES
from cases import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import chebyshev

from mechcore.errors import MechanismError
from mechcore.laws.boundary_conditions import (
    BoundaryCondition,
    from_acceleration,
    measured_table,
    polynomial_law,
    spline_law,
)
from mechcore.laws.catalogue import RISES, acceleration_zones, rise, scca
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import jumps, peak, peak_factors
from mechcore.laws.program import CurveOverMaster, Segment, program
from mechcore.laws.segment_laws import least_peak
from mechcore.laws.timed import ConstantSpeed, Oscillation

REFERENCE = {
    "uniform": "constant-velocity", "parabolic": "parabolic", "harmonic": "harmonic", "cycloidal": "cycloidal",
    "poly345": "3-4-5", "poly4567": "4-5-6-7", "double_harmonic": "double-harmonic",
}  # fmt: skip
PI = np.pi


@pytest.mark.parametrize("row", CASES["cam-laws"]["expected"], ids=lambda r: r["law"])
def test_the_reference_laws_to_all_digits(row):
    curve = rise(REFERENCE[row["law"]])
    for point in row["points"]:
        s = curve(point["x"], 3, "left")
        want = [point[k] for k in ("s", "s1", "s2", "s3")]
        np.testing.assert_allclose(s, want, rtol=1e-13, atol=1e-13 * max(map(abs, want)))
    factors = peak_factors(curve)
    for key, got in (("peak_velocity", factors.velocity), ("peak_acceleration", factors.acceleration), ("peak_jerk", factors.jerk)):
        if key in row:
            assert got == pytest.approx(row[key], rel=1e-14)


@pytest.mark.parametrize(
    ("name", "cv", "ca", "cj"),
    [  # printed in Norton and Neklutin to as many digits; exact forms where they are short
        ("modified-trapezoid", 2.0, 8 * PI / (PI + 2), 32 * PI**2 / (PI + 2)),
        ("modified-sine", 1.7596, 4 * PI**2 / (PI + 4), 69.4664),
        ("modified-constant-velocity", 1.27526, 8.01268, 201.381),
        ("5-6-7-8-9", 315 / 128, 9.37198, 78.75),
        ("freudenstein", 2.0, 5.38559, 16 * PI**2 * 9 / 28),
        ("parabolic", 2.0, 4.0, np.inf),
        ("2-3", 1.5, 6.0, 12.0),
        ("3-4-5-6", 1.7173, 6.0, 48.0),  # Norton's rise and return of 1 in over 180 deg at 15 rad/s: 547 in/s^2
        ("trapezoidal", 2.0, 16 / 3, 128 / 3),
        ("cycloidal-constant-velocity", 4 / 3, 8 * PI / 3, 32 * PI**2 / 3),
        ("modified-trapezoid-constant-velocity", 4 / 3, 32 * PI / (3 * (PI + 2)), 256 * PI**2 / (3 * (PI + 2))),
        ("sine-squared", 2.0, 8.0, 16 * PI),
        ("triple-harmonic-zero-jerk", 2.0, 3 * PI, 18 * PI**2 * 2 / (3 * np.sqrt(3))),
    ],
)
def test_peak_factors_of_the_literature(name, cv, ca, cj):
    f = peak_factors(rise(name))
    assert (f.velocity, f.acceleration, f.jerk) == pytest.approx((cv, ca, cj), rel=2e-5)


@pytest.mark.parametrize(("coast", "cv", "ca"), [(0.2, 1.528, 5.999), (1 / 3, 1.404, 6.616), (0.5, 1.275, 8.013)])
def test_modified_sines_with_constant_velocity_have_the_printed_factors(coast, cv, ca):
    """The table of sine-constant-cosine laws with constant velocity in PSMotion's handbook."""
    f = peak_factors(rise("modified-constant-velocity", coast=coast))
    assert (f.velocity, f.acceleration) == pytest.approx((cv, ca), abs=1e-3)


@pytest.mark.parametrize(
    ("name", "printed"),
    [  # amplitudes of the acceleration in PSMotion's handbook
        ("triple-harmonic-modified-trapezoid", (6.04, 0.0, 0.7296)),
        ("triple-harmonic-modified-sine", (5.1968, 1.769, 0.6057)),
        ("triple-harmonic-zero-jerk", (9 * PI / 4, 0.0, -3 * PI / 4)),
        ("three-harmonics", (2 * PI, 0.0, 0.0)),
    ],
)
def test_triple_harmonics_have_the_printed_amplitudes(name, printed):
    """By the discrete Fourier transform of the acceleration."""
    a = rise(name)(np.arange(64) / 64, 2)[2]
    np.testing.assert_allclose(-2.0 / 64 * np.fft.fft(a).imag[1:5], (*printed, 0.0), atol=5e-5)


@pytest.mark.parametrize(
    ("name", "harmonics"),
    [  # amplitudes of the acceleration: PSMotion's to their digits, Gutman's and Freudenstein's series
        ("triple-harmonic-modified-trapezoid", (6.04, 0.0, 0.7296)),
        ("triple-harmonic-modified-sine", (5.1968, 1.769, 0.6057)),
        ("triple-harmonic-zero-jerk", (9 * PI / 4, 0.0, -3 * PI / 4)),
        ("gutman", (15 * PI / 8, 0.0, 3 * PI / 8)),
        ("freudenstein", (27 * PI / 14, 0.0, 3 * PI / 14)),
        ("freudenstein-1-3-5", tuple(1125 * PI / 596 * share for share in (1.0, 0.0, 1 / 6, 0.0, 1 / 50))),
    ],
)
def test_peak_factors_of_sums_of_sines_by_their_polynomials(name, harmonics):
    """The acceleration is A_k sin(k t), so its extremes are roots of the sum of k A_k T_k(cos t), and those of the jerk of the sum
    of k^2 A_k U_(k-1)(cos t), or the ends; the velocity is largest where the acceleration vanishes."""
    k = np.arange(1, len(harmonics) + 1)
    waves = np.array(harmonics)

    def angles(series):
        roots = chebyshev.chebroots(np.trim_zeros(series, "b"))
        return np.arccos([*roots.real[(abs(roots.imag) < 1e-9) & (abs(roots.real) <= 1.0)], 1.0, -1.0])

    at = angles(np.concatenate([[0.0], k * waves]))
    second = np.zeros(len(waves))  # U_(k-1) by T: twice the sum of every second one from k - 1 down
    for order, amount in zip(k, k * k * waves, strict=True):
        second[order - 1 :: -2] += 2.0 * amount
        second[0] -= amount if order % 2 else 0.0
    bent = angles(second)
    first = np.zeros(len(waves))
    for order, amount in zip(k, waves, strict=True):
        first[order - 1 :: -2] += 2.0 * amount
        first[0] -= amount if order % 2 else 0.0
    fast = angles(first)
    velocity = (waves / (2 * PI * k)) @ (1.0 - np.cos(np.outer(k, fast)))
    acceleration, jerk = waves @ np.sin(np.outer(k, at)), 2 * PI * (k * waves) @ np.cos(np.outer(k, bent))
    f = peak_factors(rise(name))
    wanted = [np.abs(values).max() for values in (velocity, acceleration, jerk)]
    assert (f.velocity, f.acceleration, f.jerk) == pytest.approx(wanted, rel=2e-5)


def test_laws_whose_jerk_vanishes_at_the_crossover():
    for name in ("triple-harmonic-zero-jerk", "sine-squared"):
        np.testing.assert_allclose(rise(name)([0.0, 0.5, 1.0], 3)[2:], 0.0, atol=1e-12)
        assert jumps(rise(name), (0, 1, 2, 3), tolerance=1e-12) == []


def test_a_former_name_of_a_law_is_still_read():
    np.testing.assert_array_equal(rise("triple-harmonic")([0.3], 2), rise("cosine-1-3")([0.3], 2))


@pytest.mark.parametrize("name", RISES)
def test_every_law_goes_from_0_to_1_with_exact_derivatives_to_fourth_order(name):
    curve = rise(name)
    assert curve([0.0, 1.0], 0)[0] == pytest.approx([0.0, 1.0], abs=2e-15)
    x = np.linspace(0.013, 0.987, 41)
    x = x[np.abs(x[:, None] - curve.knots).min(axis=1) > 4e-3]
    weights = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
    for k in range(4):
        errors = []
        for h in (1.6e-3, 8e-4):
            samples = np.stack([curve(x + j * h, 4)[k] for j in range(-2, 3)])
            errors.append(np.abs(weights @ samples / h - curve(x, 4)[k + 1]).max())
        scale = np.abs(curve(x, 4)[k + 1]).max() + 1.0
        assert errors[1] < 1e-9 * scale or errors[1] < errors[0] / 10.0, (k, errors)


@pytest.mark.parametrize("name", RISES)
def test_inner_jumps_are_those_that_the_law_is_known_for(name):
    inner = {j.order for j in jumps(rise(name), (0, 1, 2)) if 0.0 < j.angle < 1.0}
    assert inner == ({2} if name in ("parabolic", "trapezoidal-velocity") else set())


def test_members_of_the_sine_constant_cosine_family_are_the_classical_laws():
    x = np.linspace(0.0, 1.0, 101)
    for shares, name in (((0, 1, 0), "parabolic"), ((0, 0, 1), "harmonic"), ((0.5, 0, 0.5), "cycloidal")):
        np.testing.assert_allclose(scca(*shares)(x, 2), rise(name)(x, 2), atol=3e-14 * 10)
    mcv = rise("modified-constant-velocity")
    np.testing.assert_allclose(mcv(np.linspace(0.25, 0.75, 9), 2)[2], 0.0, atol=1e-13)
    np.testing.assert_allclose(rise("trapezoidal-velocity", run_up=0.2, braking=0.3)(0.5, 1)[1], 1 / 0.75, rtol=1e-14)


@given(st.lists(st.floats(0.02, 1.0), min_size=7, max_size=7))
def test_any_zones_of_acceleration_start_and_end_at_rest(shares):
    shares = np.array(shares) / sum(shares)
    curve = acceleration_zones(shares)
    assert [j.order for j in jumps(curve, (0, 1, 2))] == []
    ends = curve([0.0, 1.0], 2, "left")
    np.testing.assert_allclose(ends[0], [0, 1], atol=1e-14)
    np.testing.assert_allclose(ends[1:], 0.0, atol=1e-12 * abs(peak(curve, 2).value))


def test_skewed_parabola_has_the_accelerations_of_its_shares():
    skewed = rise("parabolic", skew=0.25)
    assert skewed([0.1, 0.9], 2)[2] == pytest.approx([8.0, -8.0 / 3.0])
    back = skewed.mirrored()
    assert back([0.1, 0.9], 2)[2] == pytest.approx([8.0 / 3.0, -8.0])
    np.testing.assert_allclose(back([0.3], 0)[0], 1.0 - skewed([0.7], 0)[0], rtol=1e-15)


@given(st.sampled_from(sorted(RISES)), st.floats(-3, 3), st.floats(0.1, 5), st.floats(-2, 2), st.floats(0.01, 3))
def test_scaling_reversing_and_integrating_keep_the_derivatives_consistent(name, start, length, value, stroke):
    curve = rise(name).scaled(start, length, value, stroke)
    x = start + length * np.array([0.11, 0.37, 0.61, 0.93])
    raw = rise(name)((x - start) / length, 4)
    want = np.array([stroke * raw[k] / length**k for k in range(5)])
    want[0] += value
    np.testing.assert_allclose(curve(x, 4), want, rtol=1e-9, atol=1e-10 * np.abs(want).max())
    mirror = curve.reversed()(2 * start + length - x[::-1], 4)[:, ::-1]
    signs = np.array([1, -1, 1, -1, 1.0])[:, None]
    np.testing.assert_allclose(mirror, signs * want, rtol=1e-8, atol=1e-9 * np.abs(want).max())
    again = curve.integrated(0.3).differentiated()
    np.testing.assert_allclose(again(x, 3), curve(x, 3), rtol=1e-9, atol=1e-9 * np.abs(want).max())


def test_order_and_shape_of_the_angles_do_not_matter():
    curve = program([Segment(2.0, 1.0, "modified-trapezoid"), Segment(1.0), Segment(2 * PI - 3.0, 0.0, "3-4-5")])
    x = np.random.default_rng(3).uniform(-20.0, 20.0, (7, 11))
    got = curve(x, 3)
    assert got.shape == (4, 7, 11)
    one = np.array([curve(v, 3) for v in x.ravel()]).T.reshape(4, 7, 11)
    np.testing.assert_array_equal(got, one)
    np.testing.assert_allclose(curve(x + 2 * PI, 3), got, atol=1e-12)
    many = spline_law([BoundaryCondition(a, np.sin(a)) for a in np.linspace(0, 6, 50)])
    where = np.searchsorted(many.knots, (0.7, 3.3)) - 1
    one_by_one = np.array([many.pieces[k].at(v - many.knots[k], 2) for v, k in zip((0.7, 3.3), where, strict=True)])
    np.testing.assert_allclose(many([0.7, 3.3], 2).T, one_by_one, rtol=1e-13, atol=1e-13)


# --- from conditions and data ---------------------------------------------------------------------------------------------


def test_polynomial_from_rest_conditions_is_3_4_5_and_its_elders():
    for order, name in ((3, "3-4-5"), (4, "4-5-6-7"), (5, "5-6-7-8-9")):
        conditions = [BoundaryCondition(a, float(a == 1.0 and k == 0), k) for a in (0.0, 1.0) for k in range(order)]
        np.testing.assert_allclose(polynomial_law(conditions).pieces[0].poly, rise(name).pieces[0].poly, atol=1e-10)


@settings(max_examples=examples(40))
@given(st.data())
def test_polynomials_and_splines_meet_any_conditions_at_any_angles(data):
    angles = data.draw(st.lists(st.integers(0, 12), min_size=2, max_size=5, unique=True))
    conditions = []
    for a in angles:
        for k in range(data.draw(st.integers(1, 3))):
            conditions.append(BoundaryCondition(0.5 * a - 1.0, data.draw(st.floats(-2, 2)), k))
    for law in (polynomial_law(conditions), spline_law(conditions) if len(conditions) > 5 else None):
        if law is not None:
            for c in conditions:
                size = np.abs(law(np.linspace(law.start, law.end, 65), c.order)[c.order]).max() + 1.0
                assert law(c.angle, c.order, "left" if c.angle == law.end else "right")[c.order] == pytest.approx(
                    c.value, abs=1e-8 * size
                )


def test_coefficients_of_a_high_degree_are_rounded_once():
    """Fourteen conditions, coefficients up to 4e4: those of elimination in fractions, whatever BLAS solves."""
    orders = {-1.0: (0, 0, 0), -0.5: (0, 1, 0), 0.0: (0, 0, 1), 0.5: (0, 0), 1.0: (0, 0, 0)}
    law = polynomial_law([BoundaryCondition(a, v, k) for a, values in orders.items() for k, v in enumerate(values)])
    rows = [
        [perm(p, k) * Fraction(a + 1.0) ** (p - k) if p >= k else Fraction(0) for p in range(14)] + [Fraction(v)]
        for a, values in orders.items()
        for k, v in enumerate(values)
    ]
    for p in range(14):
        pivot = next(k for k in range(p, 14) if rows[k][p])
        rows[p], rows[pivot] = rows[pivot], rows[p]
        rows[p] = [x / rows[p][p] for x in rows[p]]
        rows = [row if k == p else [x - row[p] * y for x, y in zip(row, rows[p], strict=True)] for k, row in enumerate(rows)]
    np.testing.assert_allclose(law.pieces[0].poly, [float(row[-1]) for row in rows], rtol=1e-12, atol=1e-12)


def test_conditions_that_fix_nothing_are_refused():
    with pytest.raises(MechanismError, match="do not fix"):  # slope at the middle and values at both ends: degenerate parabola
        polynomial_law([BoundaryCondition(-1, 0), BoundaryCondition(1, 1), BoundaryCondition(0, 0, 1)])
    with pytest.raises(MechanismError, match="two conditions"):
        polynomial_law([BoundaryCondition(0, 0), BoundaryCondition(0, 1)])
    with pytest.raises(MechanismError, match="Did you mean 'cycloidal'"):
        rise("cycloid")
    with pytest.raises(MechanismError, match="no parameter 'skew'"):
        rise("harmonic", skew=0.3)
    with pytest.raises(MechanismError, match=r"program\[1\]"):
        program([Segment(1.0, 1.0), Segment(-1.0)])


def test_powers_of_one_s_own_choice():
    law = polynomial_law(
        [BoundaryCondition(0, 0), BoundaryCondition(1, 1), BoundaryCondition(1, 0, 1), BoundaryCondition(1, 0, 2)],
        powers=(0, 2, 10, 18),
    )
    assert np.flatnonzero(law.pieces[0].poly).tolist() == [2, 10, 18]
    np.testing.assert_allclose(law(1.0, 2, "left"), [1, 0, 0], atol=1e-12)


def test_splines_converge_and_carry_end_conditions():
    errors = []
    for n in (12, 24):
        a = np.linspace(0, 2, n)
        extra = [BoundaryCondition(0.0, 1.0, 1), BoundaryCondition(2.0, np.cos(2.0), 1)]
        law = spline_law([*(BoundaryCondition(x, np.sin(x)) for x in a), *extra])
        x = np.linspace(0, 2, 301)
        errors.append(np.abs(law(x, 0)[0] - np.sin(x)).max())
        assert law(0.0, 1)[1] == pytest.approx(1.0, abs=1e-12)
        assert not jumps(law, (1, 2, 3), tolerance=1e-7, ends=False)
    assert errors[1] < errors[0] / 30.0


def test_measured_tables_are_smoothed_and_say_by_how_much():
    x = np.linspace(0.0, 2 * PI, 181)
    noise = 1e-3 * np.random.default_rng(5).standard_normal(x.size)
    noise[-1] = noise[0]
    true = 1.0 - np.cos(x)
    curve, report = measured_table(x, true + noise, tolerance=1e-3, repeats=True)
    assert report.rms == pytest.approx(1e-3, rel=0.05)
    assert report.pieces < 40
    rough, exact = measured_table(x, true + noise, repeats=True)
    assert exact.largest < 1e-12
    y = np.linspace(0.3, 9.0, 400)
    assert np.abs(curve(y, 2)[2] - np.cos(y)).max() < 0.05 < 1.0 < np.abs(rough(y, 2)[2] - np.cos(y)).max()
    assert not jumps(curve, (0, 1, 2, 3), tolerance=1e-6)
    ramp, _ = measured_table(x, x + 0.1 * np.sin(x), repeats=True)
    want = 1.0 + 0.1 * np.sin(1.0)
    np.testing.assert_allclose(ramp([1.0, 1.0 + 2 * PI], 1)[0], [want, want + 2 * PI], atol=1e-6)
    np.testing.assert_allclose(ramp([1.0, 1.0 + 2 * PI], 1)[1], 1.0 + 0.1 * np.cos(1.0), atol=1e-6)


def test_the_lecture_s_route_a_given_acceleration_is_integrated_twice():
    a0 = 1.5
    sine = MotionCurve.of((0.0, 2 * PI), [[0.0]], [[[1.0, a0, 0.0]]], repeats=True)
    law = from_acceleration(sine, value=0.04)
    x = np.linspace(0, 2 * PI, 17)
    np.testing.assert_allclose(law(x, 2), [0.04 - a0 * np.sin(x), -a0 * np.cos(x), a0 * np.sin(x)], atol=1e-14)
    steps = MotionCurve.of((0.0, PI, 2 * PI), [[a0], [-a0]], repeats=True)
    smooth = from_acceleration(steps)
    assert smooth(0.0, 1)[1] == pytest.approx(-a0 * PI / 2), "the only constant with a continuous velocity"
    assert [j.order for j in jumps(smooth, (0, 1, 2))] == [2, 2]
    kept = from_acceleration(steps, velocity=0.0)
    assert kept.advance == pytest.approx(a0 * PI**2), "without closing the lift grows from turn to turn"
    np.testing.assert_allclose(sine.integrated(1.0)([PI], 0)[0], 1.0 + 2 * a0)


@pytest.mark.parametrize("row", CASES["cam-lecture-velocity-jumps"]["expected"]["rows"], ids=lambda r: str(r["C1"]))
def test_velocity_jumps_of_the_lecture_s_two_parabolas(row):
    a0, w, c1 = 1.5, 10.0, row["C1"]
    t = PI / w
    half = [0.04, c1, a0 / 2]
    back = [0.04 + c1 * t + a0 * t**2 / 2, a0 * t - a0 * t - c1, -a0 / 2]
    law = MotionCurve.of((0.0, t, 2 * t), [half, back], repeats=True)
    computed = {round(j.angle / t): j.size for j in jumps(law, (0, 1))}
    want = {1: row["jump_at_pi"], 0: row["jump_at_wrap"]}
    for k, size in want.items():
        assert computed.get(k, 0.0) == pytest.approx(size, rel=1e-13, abs=1e-13)
    assert all(j.shock for j in jumps(law, (1, 2)))


# --- optimal --------------------------------------------------------------------------------------------------------------


def test_least_peaks_are_the_bang_bang_laws():
    rest = {"start": (0, 0, 0), "end": (1, 0, 0)}
    assert least_peak("acceleration", **rest).peak == pytest.approx(4.0, rel=1e-9)
    assert least_peak("jerk", **rest).peak == pytest.approx(32.0, rel=1e-9)
    assert least_peak("velocity", start=(0,), end=(1,)).peak == pytest.approx(1.0, rel=1e-9)
    for over in (0.5, 2.0):
        best = least_peak("jerk", start=(0.2, 0, 0), end=(1.7, 0, 0), over=over)
        assert best.peak == pytest.approx(1.5 * 32.0 / over**3, rel=1e-8)
        np.testing.assert_allclose(best.curve([0.0, over], 2, "left"), [[0.2, 1.7], [0, 0], [0, 0]], atol=1e-6)


def test_a_limit_on_the_jerk_costs_acceleration_but_less_than_any_common_law():
    best = least_peak("acceleration", smooth=3, limits={3: 60.0}, steps=100)
    assert 4.0 < best.peak < peak_factors(rise("modified-trapezoid")).acceleration
    assert best.jerk <= 60.0 * (1 + 1e-9)
    # closed form: ramps of the length r at this jerk, acceleration a with a (1/2 - r) (1/2 - ... ) = 1: trapezoid of acceleration
    r = best.peak / 60.0
    assert best.peak * (0.5 - r) * 0.5 == pytest.approx(1.0, rel=5e-3)
    with pytest.raises(MechanismError, match="Loosen"):
        least_peak("acceleration", smooth=3, limits={3: 30.0})


def test_least_contact_force_keeps_the_margin():
    data = {"mass": 0.3, "stiffness": 1.0, "load": 2.0}
    best = least_peak("force", start=(0, 0, 0), end=(1, 0, 0), least_force=0.5, **data)
    x = np.linspace(0, 1, 4001)
    s = best.curve(x, 2)
    force = 0.3 * s[2] + s[0] + 2.0
    assert force.min() >= 0.5 - 1e-6
    assert force.max() == pytest.approx(best.peak, rel=1e-3)
    for name in ("3-4-5", "cycloidal", "modified-trapezoid", "modified-sine"):
        s = rise(name)(x, 2)
        assert best.peak < (0.3 * s[2] + s[0] + 2.0).max()


# --- programs -------------------------------------------------------------------------------------------------------------


@given(
    st.lists(st.tuples(st.floats(0.2, 2.0), st.floats(-3, 3), st.sampled_from(sorted(RISES))), min_size=1, max_size=5),
    st.floats(-2, 2),
)
def test_programs_pass_through_their_ends(rows, start):
    segments = [Segment(over, to, law) for over, to, law in rows]
    curve = program(segments, start)
    ends = np.cumsum([r[0] for r in rows])
    np.testing.assert_allclose(curve(ends, 0, "left")[0], [r[1] for r in rows], atol=1e-12)
    assert not [j for j in jumps(curve, (0,)) if j.angle > 0.0]


def test_polynomial_segments_join_states():
    curve = program([Segment(1.0, (0.5, 1.0, 0.2), "polynomial"), Segment(2.0, 1.0, "polynomial"), Segment(1.0, 0.0)])
    assert not jumps(curve, (0, 1, 2))
    np.testing.assert_allclose(curve(1.0, 2), [0.5, 1.0, 0.2], atol=1e-13)


@pytest.mark.parametrize("master", [ConstantSpeed(0.4, 3.0), ConstantSpeed(0.4, -2.0), Oscillation(1.0, 2.0, 0.5, 0.3)])
def test_axes_on_one_master_follow_by_the_chain_rule(master):
    curve = program([Segment(2.0, 1.0, "4-5-6-7"), Segment(1.0), Segment(2 * PI - 3.0, 0.0, "5-6-7-8-9")])
    axis = CurveOverMaster(curve, master, 0.2)
    t = np.linspace(0.05, 0.9, 23) * axis.duration
    h = 2e-4
    weights = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * h)
    for k in (0, 1):
        numeric = weights @ np.stack([axis(t + j * h)[k] for j in range(-2, 3)])
        np.testing.assert_allclose(numeric, axis(t)[k + 1], atol=1e-6)
    np.testing.assert_allclose(axis(t)[0], curve(master(t)[0] + 0.2, 0)[0], atol=1e-15)
    assert axis.advance == pytest.approx(0.0, abs=1e-12)


def test_shocks_of_a_program_lie_where_the_master_passes_them():
    curve = program([Segment(PI, 1.0, "parabolic"), Segment(PI, 0.0, "cycloidal")])
    axis = CurveOverMaster(curve, ConstantSpeed(0.0, 2.0))
    assert axis.breaks == pytest.approx((0.0, PI / 4, PI / 2))
    assert axis.shock(PI / 4) == "the acceleration jumps, infinite jerk"
    assert axis.shock(1.0) == ""
    with_steps = CurveOverMaster(program([Segment(PI, 1.0, "constant-velocity"), Segment(PI, 0.0)]), ConstantSpeed(0.0, 2.0))
    assert "infinite acceleration" in with_steps.shock(PI / 2)


SCENE = {
    "units": {"length": "mm", "angle": "deg"},
    "links": {
        "frame": {"points": {"O": [0, 0], "G": [0, 0]}},
        "shaft": {"points": {"O": [0, 0], "P": [10, 0]}},
        "slide": {"points": {"C": [0, 0]}},
    },
    "joints": {
        "O": {"revolute": ["frame", "shaft"], "drive": {"speed": "60 rpm"}},
        "X": {
            "prismatic": ["frame", "slide"],
            "at": ["G", "C"],
            "along": [1, 0],
            "drive": {
                "start": 5,
                "program": {
                    "master": "O",
                    "segments": [
                        {"over": 180, "to": "2 cm", "law": "parabolic", "parameters": {"skew": 0.4}},
                        {"over": 180, "to": 5},
                    ],
                },
            },
        },
    },
}  # fmt: skip


def changed(**keys):
    data = json.loads(json.dumps(SCENE))
    data["joints"]["X"]["drive"]["program"].update(keys)
    return data


def test_scenes_drive_several_axes_from_one_master():
    from mechcore.motion.events import find_events
    from mechviz.runs import run_scene
    from mechviz.scene.scene import Scene, loads

    scene = Scene.build(**SCENE)
    law = scene.mechanism.drives[1].law
    assert isinstance(law, CurveOverMaster)
    t = np.array([0.0, 0.25, 0.5, 1.0])
    np.testing.assert_allclose(law(t)[0], [5e-3, law.curve(PI / 2, 0)[0], 20e-3, 5e-3], atol=1e-15)
    again = loads(scene.to_toml())
    np.testing.assert_array_equal(again.mechanism.drives[1].law(t)[0], law(t)[0])
    assert again.to_toml() == scene.to_toml()
    run = run_scene(scene, frames=90)
    texts = [e.text for e in find_events(run.motion)]
    assert any("infinite jerk" in text for text in texts), texts


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"master": "Q"}, "no driven revolute joint"),
        ({"master": "X"}, "no driven revolute joint"),
        ({"speed": "60 rpm"}, "speed and master at once"),
        ({"segments": [{"over": 90, "to": 9, "law": "cycloidl"}]}, "Did you mean 'cycloidal'"),
        ({"segments": [{"over": 90, "to": 9, "law": "parabolic", "parameters": {"skw": 1}}]}, "no parameter 'skw'"),
        ({"segments": [{"over": 90, "too": 9}]}, "Did you mean 'to'"),
        ({"segments": [{"over": "9 mm", "to": 9}]}, "angle"),
    ],
)
def test_faults_of_programs_are_named(keys, message):
    from mechviz.scene.faults import SceneError
    from mechviz.scene.scene import Scene

    with pytest.raises(SceneError, match=message):
        Scene.build(**changed(**keys))


def test_the_command_prints_the_table_and_plots(tmp_path):
    from xml.etree import ElementTree

    from typer.testing import CliRunner

    from mechcore.laws.catalogue import rise
    from mechviz.commands.lectures import laws_figure
    from mechviz.commands.main import app

    picture = tmp_path / "laws.svg"
    out = CliRunner().invoke(app, ["laws", "modified-sine", "parabolic:skew=0.3", "--plot", str(picture)])
    assert out.exit_code == 0, out.output
    assert "5.52796" in out.output
    root = ElementTree.fromstring(picture.read_text())
    words = {t.text for t in root.iter("{http://www.w3.org/2000/svg}text")}
    assert {"modified-sine", "parabolic:skew=0.3", "jerk s'''", "angle / range"} <= words
    law = rise("parabolic", skew=0.3)
    for order, panel in enumerate(laws_figure({"sine": rise("modified-sine"), "parabolic": law}).axes):
        x, y = panel.lines[1].get_xydata().T
        assert np.isnan(y).sum() == len(law.pieces), "a gap after each piece"
        inside = np.isfinite(y) & (np.abs(x[:, None] - law.knots).min(axis=1) > 1e-9)
        np.testing.assert_allclose(y[inside], law(x[inside], order)[order], atol=1e-9)
    assert CliRunner().invoke(app, ["laws", "sinus"]).exit_code == 2
    assert CliRunner().invoke(app, ["laws", "parabolic:skew=x"]).exit_code == 2
    assert CliRunner().invoke(app, ["laws", "--plot", "laws.gif"]).exit_code == 2
