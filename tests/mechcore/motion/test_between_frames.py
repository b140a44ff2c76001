"""Intervals in which a quantity exceeds a limit: where it crosses the limit and how far it goes, whatever the frames."""

from __future__ import annotations

import numpy as np
import pytest
from support.mechanisms import four_bar

import mechviz
from mechcore.motion.between_frames import exceedances, intervals, zeros
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechviz.quantities.events import events_of
from mechviz.runs import run_scene
from mechviz.scene.folder import GALLERY_FOLDER


def crank_motion(frames, turns=2):
    """A crank of 1 m that turns at 1 rad/s, so that the height of its pin is sin t, over nearly so many turns: no part of the
    interval between frames is at a peak."""
    compiled = compile_mechanism(four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, speed=1.0))
    return solve_motion(compiled, np.linspace(0.0, 6.15 * turns, frames))


def height(motion):
    return motion.point("crank", "B")[:, 1]


@pytest.mark.parametrize("frames", [11, 14, 40, 401])
def test_ends_and_largest_values_do_not_depend_on_the_frames(frames):
    """Both peaks of 1 at pi/2 and 5 pi/2, between two frames too."""
    for limit in (0.3, 0.95, 0.99999):
        found = exceedances(crank_motion(frames), height, limit)
        early = np.arcsin(limit)
        for k, each in enumerate(found):
            assert each.start == pytest.approx(early + 2 * k * np.pi, abs=1e-8)
            assert each.end == pytest.approx(np.pi - early + 2 * k * np.pi, abs=1e-8)
            assert each.value == pytest.approx(1.0, abs=1e-9) and each.at == pytest.approx((0.5 + 2 * k) * np.pi, abs=1e-3)
        assert len(found) == 2
    for limit in (1.0, 1.0 - 1e-11):
        assert exceedances(crank_motion(frames), height, limit) == [], "it reaches the limit only, but for rounding"
    assert exceedances(crank_motion(frames), height, 1.1) == []


def test_all_that_lie_between_frames_are_found_beside_as_many_others():
    """Of fifty turns with fourteen frames each, every range is between two frames."""
    found = exceedances(crank_motion(701, turns=50), lambda m: np.abs(height(m)), 0.9999)
    np.testing.assert_allclose([each.at for each in found], (0.5 + np.arange(98)) * np.pi, atol=1e-3)


def test_what_is_constant_but_for_rounding_is_not_searched_for_peaks():
    motion = crank_motion(200)
    solves = []

    def level(m):
        solves.append(m.frames)
        return 2.0 + 1e-15 * height(m)

    ((start, end),) = [(each.start, each.end) for each in exceedances(motion, level, 1.0)]
    assert (start, end) == (motion.time[0], motion.time[-1]) and solves == [200]


def test_frames_that_do_not_count_end_an_interval():
    motion = crank_motion(81)
    counts = motion.time >= 1.0
    first, second = exceedances(motion, height, 0.5, counts)
    assert first.start == motion.time[counts][0] and first.end == pytest.approx(5 * np.pi / 6, abs=1e-8)
    assert second.start == pytest.approx(13 * np.pi / 6, abs=1e-8)


def test_a_jump_and_unknown_values_are_edges():
    motion = crank_motion(30)

    def jumping(m):
        return np.where(m.time > 2.0, 1.0, np.where(m.time < 1.0, np.nan, 0.0))

    (found,) = exceedances(motion, jumping, 0.5)
    assert found.start == pytest.approx(2.0, abs=1e-8) and found.end == motion.time[-1]
    (span,) = intervals(motion, motion.time > 2.0, lambda t: np.where(t > 2.0, 1.0, -1.0))
    assert span == pytest.approx((2.0, motion.time[-1]), abs=1e-8)


CAMS = {
    "pressure angle up to": ("cam-oscillating-roller", {"pressure_limit = 35": "pressure_limit = 15"}),
    "Hertz pressure up to": ("cam-roller", {'limit = "300 MPa"': 'limit = "150 MPa"'}),
    "contact force down to": ("cam-roller", {"margin = 40": "margin = 120"}),
}


@pytest.mark.parametrize("words", list(CAMS))
def test_events_of_cams_begin_where_the_limit_is_crossed_whatever_the_frames(words):
    name, changes = CAMS[words]
    text = (GALLERY_FOLDER / f"{name}.toml").read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    coarse, fine = (
        [(e.time, e.value) for e in events_of(run_scene(mechviz.loads(text), frames=frames)) if words in e.text]
        for frames in (97, 360)
    )
    assert len(coarse) == len(fine) > 0
    np.testing.assert_allclose(coarse, fine, rtol=1e-7)


@pytest.mark.parametrize(("before", "behind"), [(-1.0, 1.0), (1.0, -2.0), (1.0, 0.0)])
@pytest.mark.parametrize("order", [2, 3])
def test_zeros_of_higher_order_are_found_although_rounding_hides_them(before, behind, order):
    """A speed is rounded to 1e-16, as at the end of a cam's rise: its sign is unknown up to 1e-8 or 1e-5 from the zero."""
    motion, exact = crank_motion(361), 1.2345

    def rows(m):
        x = m.time - exact
        speed = np.where(x < 0.0, before, behind) * np.abs(x) ** order * (1.0 + 0.3 * x)
        if not behind:  # after a short rest it turns back
            speed -= np.maximum(x - 0.005, 0.0)
        return np.stack([(1.0 + speed) - 1.0, order * np.abs(x) ** (order - 1) * (speed != 0.0)], axis=-1)

    k = int(np.searchsorted(motion.time, exact))
    (found,) = zeros(motion, rows, [[motion.time[k - 1], exact + 1e-4, motion.time[k]]])
    assert found == pytest.approx(exact, abs=1e-10 if order == 2 else 1e-7)
