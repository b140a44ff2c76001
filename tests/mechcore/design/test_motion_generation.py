"""Bodies led through positions: published cases, distances kept, the opposite-pole quadrilateral, defects of linkages."""

from __future__ import annotations

import numpy as np
import pytest
from design_cases import design_case, plane

from mechcore.design.burmester import (
    BodyPositions,
    burmester_curve,
    burmester_points,
    circle_point_values,
    circumcentres,
    fixed_pivots,
    guidance,
    moving_pivots,
    slider_points,
)
from mechcore.design.four_bars import from_pins, judge_four_bars
from mechcore.errors import MechanismError


def poses_of(inputs):
    x, y, angle = np.array(inputs["poses"], float).T
    return BodyPositions(x + 1j * y, angle)


def lengths(poses, w, c):
    return np.abs(poses.of_points(w) - np.asarray(c)[..., None])


def circle_points_at(poses, u):
    """The points of the circle-point curve with the x coordinate u in the body: the real roots of a cubic in y."""
    y = np.arange(4.0)
    roots = np.roots(np.polyfit(y, circle_point_values(poses, u + 1j * y), 3))
    return u + 1j * np.sort(roots.real[np.abs(roots.imag) < 1e-9 * (1.0 + np.abs(roots))])


def test_three_positions():
    inputs, expected = design_case("burmester-3-positions")
    poses = poses_of(inputs)
    assert fixed_pivots(poses, plane(inputs["moving_pivots"])) == pytest.approx(
        plane([row["C"] for row in expected["from_moving"]]), rel=1e-11
    )
    assert moving_pivots(poses, plane(inputs["fixed_pivots"])) == pytest.approx(
        plane([row["w"] for row in expected["from_fixed"]]), rel=1e-11
    )
    for name, at in expected["poles"].items():
        assert poses.pole(int(name[1]) - 1, int(name[2]) - 1) == pytest.approx(complex(*at), rel=1e-11)


def test_four_positions():
    inputs, expected = design_case("burmester-4-positions")
    poses = poses_of(inputs)
    for u in sorted({row[0] for row in expected["rows"]}):
        rows = np.array([row for row in expected["rows"] if row[0] == u])
        w = circle_points_at(poses, u)
        assert w.imag == pytest.approx(rows[:, 1], rel=1e-10)
        c = fixed_pivots(poses, w)
        assert c == pytest.approx(rows[:, 2] + 1j * rows[:, 3], rel=1e-10)
        assert lengths(poses, w, c)[:, 0] == pytest.approx(rows[:, 4], rel=1e-10)


def test_all_of_the_curve_keeps_its_distance_and_sees_the_poles_alike():
    inputs, _ = design_case("burmester-4-positions")
    poses = poses_of(inputs)
    curve = burmester_curve(poses, 200)
    near = np.isfinite(curve.w) & (abs(curve.w) < 20) & (abs(curve.c) < 20)
    w, c = curve.w[near], curve.c[near]
    assert len(w) > 200
    sizes = lengths(poses, w, c)
    assert sizes == pytest.approx(np.broadcast_to(sizes[:, :1], sizes.shape), rel=1e-8)
    p12, p23, p34, p14 = (poses.pole(*pair) for pair in ((0, 1), (1, 2), (2, 3), (0, 3)))
    twice = ((p12 - c) / (p23 - c)) / ((p14 - c) / (p34 - c))  # the same angle modulo pi: real
    apart = np.minimum.reduce([abs(c - p) for p in (p12, p23, p34, p14)]) > 0.02
    assert np.abs(np.sin(np.angle(twice[apart]))).max() < 1e-6
    # the frame moves on the body as the body does on the frame: centre points are circle points of that
    centres = burmester_curve(poses.inverse, 2000).w
    seen = centres[np.isfinite(centres) & (abs(centres) < 20)]
    from_body = lengths(poses.inverse, seen, fixed_pivots(poses.inverse, seen))
    assert np.max([np.nanmin(abs(centres - z)) / (1.0 + abs(z)) for z in c]) < 0.05
    assert from_body == pytest.approx(np.broadcast_to(from_body[:, :1], from_body.shape), rel=1e-8)
    # what the cubic itself gives on lines x = u lies on the traced curve
    for u in (-0.5, 0.0, 0.5):
        for point in circle_points_at(poses, u):
            assert np.nanmin(abs(curve.w - point)) < 0.25


@pytest.mark.parametrize("count", [2, 3, 4])
def test_points_of_the_body_lie_on_lines_in_all_positions(count):
    inputs, _ = design_case("burmester-4-positions")
    whole = poses_of(inputs)
    poses = BodyPositions(whole.places[:count], whole.angles[:count])
    w, direction = slider_points(poses)
    assert len(w) == (1 if count == 4 else 72)
    across = np.imag(np.conj(direction)[:, None] * poses.of_points(w))
    np.testing.assert_allclose(across, np.broadcast_to(across[:, :1], across.shape), rtol=1e-9, atol=1e-12 * np.abs(w).max())
    if count == 3:  # a circle of points
        centre = circumcentres(w[:3])
        assert np.abs(w - centre) == pytest.approx(np.full(72, abs(w[0] - centre)), rel=1e-8)


def test_five_positions_leave_no_slide_unless_they_are_given_so():
    inputs, _ = design_case("burmester-5-positions")
    with pytest.raises(MechanismError, match=r"of 5 positions no point.*mm off"):
        slider_points(poses_of(inputs))
    angles = np.array([0.1, 0.5, 0.4, 1.2, 2.0])
    straight = BodyPositions(np.exp(0.3j) * np.array([0.0, 1.0, 2.5, 3.0, 4.5]) - (1 - 2j) * np.exp(1j * angles), angles)
    w, direction = slider_points(straight)
    assert w == pytest.approx(np.array([1 - 2j]), rel=1e-9)
    assert np.imag(direction * np.exp(-0.3j)) == pytest.approx(0.0, abs=1e-9)


def test_five_positions():
    inputs, expected = design_case("burmester-5-positions")
    poses = poses_of(inputs)
    w, c = burmester_points(poses)
    assert w == pytest.approx(plane([row["w"] for row in expected["real_dyads"]]), rel=1e-10)
    assert c == pytest.approx(plane([row["C"] for row in expected["real_dyads"]]), rel=1e-10)
    # turned, scaled, elsewhere
    moved = BodyPositions((1 + 2j) * poses.places * 40.0 + (300 - 100j), poses.angles + np.angle(1 + 2j))
    assert burmester_points(moved)[0] == pytest.approx(w * 40.0 * abs(1 + 2j), rel=1e-8)


def test_more_positions_than_can_be_met_are_fitted():
    rng = np.random.default_rng(1)
    bar = from_pins(0j, 4 + 0j, 1 + 0.5j, 3 + 2.5j, 2 + 3j)
    a, b, p = bar.positions(np.radians([20, 50, 90, 130, 170, 220, 260]))
    exact = BodyPositions(p, np.angle(b - a))
    _, c = burmester_points(exact)
    assert min(abs(c - 4)) < 1e-8 and min(abs(c)) < 1e-8
    noisy = BodyPositions(p + 1e-5 * rng.normal(size=7), np.angle(b - a))
    assert min(abs(burmester_points(noisy)[1])) < 1e-2


def test_defects_are_those_of_the_motion_itself():
    """Pins at crank angles of one branch have no defect; of two branches, two circuits or another order they have theirs."""
    rocker = from_pins(0j, 4 + 0j, 1j, 3 + 2.5j)
    triple = from_pins(0j, 4 + 0j, 3j, 2 + 4j)
    assert rocker.crank_turns and not triple.crank_turns

    def words(bar, other, angles, kept):
        pins = [
            np.where(kept, one, two)
            for one, two in zip(bar.positions(np.radians(angles)), other.positions(np.radians(angles)), strict=True)
        ]
        return judge_four_bars(np.array([bar.crank_pivot]), np.array([bar.rocker_pivot]), pins[0][None], pins[1][None]).words(0)

    def other(bar):
        return type(bar)(bar.crank_pivot, bar.rocker_pivot, bar.crank, bar.coupler, bar.rocker, -bar.side)

    all_of = np.ones(4, bool)
    assert words(rocker, rocker, [10, 100, 200, 300], all_of) == ""
    assert words(rocker, rocker, [300, 10, 100, 200], all_of) == ""
    assert words(rocker, rocker, [10, 200, 100, 300], all_of) == "order"
    assert words(rocker, other(rocker), [10, 100, 200, 300], np.array([1, 1, 0, 1], bool)) == "branch, circuit"
    assert words(triple, other(triple), [60, 70, 80, 90], np.array([1, 1, 0, 1], bool)) == "branch"
    assert words(triple, triple, [60, 80, 70, 90], all_of) == "order"


def test_pairs_of_dyads_make_linkages_that_pass_all_poses():
    inputs, _ = design_case("burmester-5-positions")
    poses = poses_of(inputs)
    guides = guidance(poses, *burmester_points(poses))
    assert len(guides.w) == 12 and guides.defects.none.any()
    good = np.flatnonzero(guides.defects.none)[0]
    pins = poses.of_points(guides.w[good])
    bar = from_pins(*guides.c[good], *pins[:, 0], poses.places[0])
    assert bar.positions(np.angle(pins[0] - guides.c[good][0]))[2] == pytest.approx(poses.places, abs=1e-9)


def test_what_says_nothing_is_refused():
    with pytest.raises(MechanismError, match="same"):
        BodyPositions(np.zeros(3, complex), np.zeros(3))
    with pytest.raises(MechanismError, match="translates"):
        burmester_curve(BodyPositions(np.array([0, 1, 2 + 1j, 3j]), np.zeros(4)))
