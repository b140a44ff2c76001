"""Laws of motion: end conditions, exact derivatives, continuity, repetition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import polynomial_through

from mechcore.laws.timed import ConstantSpeed, Oscillation, Piecewise, Table, TableLaw, zones

REST_TO_REST = Piecewise(knots=(0.0, 2.0), coefficients=(polynomial_through(0.0, (0.5, 0, 0), 2.0, (1.5, 0, 0)),), advance=1.0)
T = np.linspace(0.0, 2.0, 9)
LAWS = {
    "constant": ConstantSpeed(0.3, -2.0),
    "oscillation": Oscillation(1.0, 0.5, 0.7, 0.2),
    "polynomial": REST_TO_REST,
    "zones": zones(start=0.1, speed=3.0, run_up=0.4, steady=2.0, braking=0.6),
    "table": TableLaw(t=tuple(T), q=tuple(np.sin(T) + 0.2 * T)),
    "periodic table": TableLaw(t=tuple(T), q=tuple(2 * np.pi * T / 2 + 0.1 * np.sin(np.pi * T)), periodic=True),
}


@pytest.mark.parametrize("name", LAWS)
def test_speed_and_acceleration_are_the_derivatives(name):
    """Central differences of order 4 at two steps: what is left over falls like h^4 or is rounding."""
    law = LAWS[name]
    t = np.linspace(0.05, 0.95, 7) * law.duration
    t = t[[all(abs(x - b) > 0.03 for b in law.breaks) for x in t]]
    weights = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
    for k in (0, 1):
        errors = []
        for h in (4e-3, 2e-3):
            samples = np.stack([law(t + j * h)[k] for j in range(-2, 3)])
            errors.append(np.abs(weights @ samples / h - law(t)[k + 1]).max())
        assert errors[1] < 1e-10 or errors[1] < errors[0] / 10.0, (name, k, errors)


def test_polynomial_meets_all_its_end_conditions():
    start, end = (0.5, -1.0, 2.0), (3.0, 0.25, -4.0)
    law = Piecewise(knots=(1.0, 3.5), coefficients=(polynomial_through(1.0, start, 3.5, end),))
    q, v, a = law(np.array([1.0, 3.5]))
    np.testing.assert_allclose(np.column_stack([q, v, a]), [start, end], atol=1e-12)


def test_zones_are_the_article_s():
    law = LAWS["zones"]
    assert law.breaks == pytest.approx((2 * 0.4 / 3.0, 2 * 0.4 / 3.0 + 2.0 / 3.0))
    q, v, a = law(np.array([0.0, law.breaks[0], law.breaks[1], law.duration]))
    np.testing.assert_allclose(q, [0.1, 0.5, 2.5, 3.1], rtol=1e-14)
    np.testing.assert_allclose(v, [0.0, 3.0, 3.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(a, [9 / 0.8, 9 / 0.8, 0.0, -9 / 1.2], rtol=1e-14)


@given(
    st.floats(-10.0, 10.0),
    st.floats(0.1, 10.0),
    st.sampled_from([-1.0, 1.0]),
    st.floats(0.01, 3),
    st.floats(0, 3),
    st.floats(0.01, 3),
)
def test_zones_cover_their_ranges_and_rest_at_both_ends(start, speed, sign, run_up, steady, braking):
    law = zones(start=start, speed=sign * speed, run_up=run_up, steady=steady, braking=braking)
    q, v, _ = law(np.array([0.0, law.duration]))
    assert q[1] - q[0] == pytest.approx(sign * (run_up + steady + braking), rel=1e-9)
    assert np.abs(v).max() < 1e-9 * speed


def test_a_law_that_repeats_continues_where_it_ended():
    for law in (LAWS["zones"], REST_TO_REST):
        T = law.duration
        q, v, _ = law(np.array([0.4 * T, 1.4 * T, 2.4 * T]))
        np.testing.assert_allclose(np.diff(q), law.advance, rtol=1e-12)
        np.testing.assert_allclose(v, v[0], rtol=1e-9)
        assert law(T)[0] == pytest.approx(law(T * (1 + 1e-13))[0], abs=1e-9)
    law = LAWS["periodic table"]
    q, v, a = law(np.array([0.7, 2.7, 4.7]))
    np.testing.assert_allclose(np.diff(q), 2 * np.pi, rtol=1e-12)
    np.testing.assert_allclose(np.ptp(a), 0.0, atol=1e-9)


def test_the_part_of_a_table_is_a_whole_number_however_far_its_argument_has_gone():
    table = Table(x=(0.0, 1.0, 2.0), y=(1.0, 2.0, 0.0), period=2.5, smooth=False)
    near, far = table.part(np.array([0.5, 1.5, 2.2, 3.0])), table.part(np.array([-1e29, 1e29]))
    assert list(np.diff(near)) == [1, 1, 2] and near.dtype == far.dtype == np.int64
    assert far[0] < near[0] and far[1] > near[-1]


def test_table_interpolates_smoothly_and_holds_its_ends():
    table = Table(x=(0.0, 1.0, 2.0, 3.0), y=(0.0, 1.0, 4.0, 9.0), smooth="spline")
    assert table([0.5, 2.5]) == pytest.approx([0.25, 6.25]), "a cubic spline reproduces a parabola"
    assert table([-1.0, 4.0]) == pytest.approx([0.0, 9.0])
    assert table([-1.0, 4.0], 1) == pytest.approx([0.0, 0.0])
    ring = Table(x=(0.0, 1.0, 2.0), y=(1.0, 2.0, 0.0), period=3.0, smooth="spline")
    x = np.linspace(0, 3, 7)
    np.testing.assert_allclose(ring(x + 6.0), ring(x), atol=1e-12)
    for d in (0, 1, 2):
        assert ring(3.0 - 1e-9, d) == pytest.approx(ring(0.0, d), abs=1e-6)
    straight = Table(x=(0.0, 1.0, 2.0), y=(0.0, 1.0, 0.0), smooth=False)
    assert straight([0.5, 1.5]) == pytest.approx([0.5, 0.5])


@pytest.mark.parametrize("period", [None, 9.0])
def test_smooth_tables_stay_between_their_rows(period):
    """However unequal the gaps: no value lies beyond the two rows around it, slopes are continuous, all rows are met."""
    rng = np.random.default_rng(5)
    for _ in range(50):
        x = np.cumsum(10.0 ** rng.uniform(-3.0, 0.0, 7))
        y = rng.choice([0.0, 0.0, 1.0, -2.0, 5.0], 7) * rng.uniform(0.5, 1.0, 7)
        table = Table(x=tuple(x), y=tuple(y), period=period)
        np.testing.assert_allclose(table(x), y, atol=1e-13)
        ends, last = (x, y) if period is None else (np.append(x, x[0] + period), np.append(y, y[0]))
        for a, b, low, high in zip(ends, ends[1:], last, last[1:], strict=False):
            inside = table(np.linspace(a, b, 50)[1:-1])
            assert inside.min() >= min(low, high) - 1e-12 and inside.max() <= max(low, high) + 1e-12
        step = 1e-9 * np.diff(ends).min()
        inner = ends[1:-1] if period is None else ends[1:]
        slopes = table(inner - step, 1), table(inner + step, 1)
        np.testing.assert_allclose(*slopes, atol=1e-5 * np.abs(np.diff(last) / np.diff(ends)).max())
        if period is not None:
            np.testing.assert_allclose(table(x + 3.0 * period), y, atol=1e-9)
        t = rng.uniform(x[0], x[-1], 20)
        mirrored = Table(x=tuple(-x[::-1]), y=tuple(y[::-1]), period=period)
        np.testing.assert_allclose(mirrored(-t), table(t), atol=1e-11)
        assert table.overshoot == (0.0, 0) and table.knots == tuple(x)


def test_a_spline_that_leaves_its_rows_says_how_far():
    x, y = (0.0, 1.8, 1.9, 2.0), (0.0, 0.0, -1.0, 0.0)
    table = Table(x=x, y=y, smooth="spline")
    far, row = table.overshoot
    assert row == 0 and far == pytest.approx(np.abs(table(np.linspace(0.0, 1.8, 20_001))).max(), rel=1e-6) and far > 5.0
    assert Table(x=x, y=y).overshoot[0] == Table(x=x, y=y, smooth=False).overshoot[0] == 0.0
    turns = np.arange(12) * 30.0
    around = Table(x=tuple(turns), y=tuple(np.sin(np.radians(turns + 15.0))), period=360.0, smooth="spline")
    assert around.overshoot[0] < 0.05, "a smooth function given by a dozen rows"
    law = TableLaw(t=(0.0, 1.0, 2.0, 2.1, 2.2, 3.0), q=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0))
    q = law(np.linspace(0.0, 3.0, 30_001))[0]
    assert law.overshoot == (pytest.approx(q.max(), rel=1e-5), 0), "far above both rows, which are zero"
    even = TableLaw(t=(0.0, 1.0, 2.0, 3.0), q=(0.0, 2.0, 4.0, 6.0), periodic=True)
    assert even.overshoot == (0.0, 0)
