"""The atlas of coupler curves: what draws a curve is found from the curve alone; made once, in the user's cache."""

from __future__ import annotations

import numpy as np
import pytest
from mechanisms import case

from mechcore.cache import cache_folder
from mechcore.design import atlas as module
from mechcore.design.atlas import make_atlas, nearest_linkages, stored_atlas
from mechcore.design.four_bars import TURN, FourBar
from mechcore.design.paths import PathTask, path_designs

SMALL = make_atlas(seed=1, curves=200, arcs=300)


def bar_of(design, side):
    frame, coupler, rocker, x, y = map(float, design[:5])
    return FourBar(0j, complex(frame), 1.0, coupler, rocker, side, (x + side * 1j * y) * coupler)


def moved(points):
    return 3.0 - 2.0j + 0.7 * np.exp(0.9j) * points


def test_fourier_descriptors_of_the_reference():
    """Of the coupler curve over the crank's angle; the ratios of all but the first two orders know neither the coupler point nor
    the place, scale and rotation of the frame."""
    given, expected = (case("design", "fourier-descriptors")[key] for key in ("inputs", "expected"))
    theta = np.linspace(0.0, TURN, 512, endpoint=False)

    def descriptors(traced):
        bar = FourBar(0j, complex(given["d"]), given["a"], given["b"], given["c"], given["side"], traced)
        return np.fft.fft(bar.positions(theta)[2]) / len(theta)

    own = descriptors(complex(*given["u"]))
    for k in given["k"]:
        assert own[k] == pytest.approx(complex(*expected["c"][str(k)]), rel=1e-10, abs=1e-15)
    for size in (own, descriptors(-0.4 + 2.1j), np.fft.fft(moved(np.fft.ifft(own)))):
        assert abs(size[2] / size[3]) == pytest.approx(expected["ratio_abs_c2_c3"], rel=1e-10)
        assert abs(size[-1] / size[2]) == pytest.approx(expected["ratio_abs_cm1_c2"], rel=1e-10)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("sense", [1, -1])
def test_a_curve_of_the_atlas_is_found_wherever_it_begins(side, sense):
    design = SMALL.curves[20]
    theta = side * 0.8 + sense * np.linspace(0.0, TURN, 400)
    points = moved(bar_of(design, side).positions(theta)[2])
    candidates = nearest_linkages(points, True, side, sense, 3, SMALL)
    assert candidates.ratios[0] == pytest.approx(design[:3])
    assert np.angle(np.exp(1j * (candidates.start[0] - side * 0.8))) == pytest.approx(0.0, abs=TURN / module.SHIFTS)
    assert candidates.steps[0, [0, -1]] == pytest.approx([0.0, TURN])
    assert candidates.steps[0] == pytest.approx(np.linspace(0.0, TURN, 400), abs=0.3)
    assert (np.diff(candidates.steps[0]) > 0.0).all()


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("sense", [1, -1])
def test_an_arc_of_the_atlas_is_found_with_its_crank_angles(side, sense):
    design = SMALL.arcs[11]
    first, span = map(float, design[5:])
    own = first + span * np.linspace(0.0, 1.0, 300)[:: side * sense]
    points = moved(bar_of(design, side).positions(side * own)[2])
    candidates = nearest_linkages(points, False, side, sense, 3, SMALL)
    assert candidates.ratios[0] == pytest.approx(design[:3])
    assert candidates.start[0] + sense * candidates.steps[0] == pytest.approx(side * own, abs=2e-3)


def test_a_curve_drawn_at_even_speed_is_met():
    """Of 20,000 random cranks that go with the pen the best led 7 % of its size astray."""
    curve = FourBar(0j, 1.6 + 0j, 1.0, 2.6, 2.5, 1, 2.4 - 2.4j).positions(np.linspace(0.0, TURN, 2001))[2]
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(curve)))])
    points = np.interp(np.linspace(0.0, along[-1], 41), along, curve)
    designs = path_designs(PathTask(moved(points)))
    assert designs[0].largest < 1e-5 * abs(points - points.mean()).max()


def test_the_atlas_is_made_once_and_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(module, "make_atlas", lambda: SMALL)
    stored_atlas.cache_clear()
    try:
        assert stored_atlas() is not SMALL
        (kept,) = cache_folder().iterdir()
        monkeypatch.setattr(module, "make_atlas", lambda: pytest.fail("it is made again"))
        stored_atlas.cache_clear()
        assert np.array_equal(stored_atlas().descriptors, SMALL.descriptors)
        kept.write_bytes(kept.read_bytes()[:-50])  # damaged: it is made anew
        monkeypatch.setattr(module, "make_atlas", lambda: SMALL)
        stored_atlas.cache_clear()
        assert np.array_equal(stored_atlas().places, SMALL.places)
    finally:
        stored_atlas.cache_clear()
