"""Loads in recordings and in the viewer: both links named, energies, powers, springs that deform between their points."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.spec.loads import Damper, GasSpring
from mechviz.outputs.viewer.world.bodies import segments
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.nodes import Lines
from mechviz.picture.proportions import SPIRAL_RADIUS
from mechviz.picture.springs import find_strut_glyphs, spiral_strips, strut_strips
from mechviz.runs import run_scene
from recordings import made, vectors_of

NAMES = ("lamp-arm", "valve-spring", "compressor-cycle", "door-closer", "tailgate", "plunger-in-drag")


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", NAMES)
def test_loads_name_both_links_and_powers_sum_to_zero(name):
    m = made(name)
    model = m.recording.model
    for load in m.mechanism.loads:
        two = getattr(load, "links", None)
        if two is not None:
            assert model["loads"][load.name]["links"] == list(two)
    items = list(m.recording.properties["power_items"])
    powers = m.data("power")
    assert powers.shape[1] == len(items) and {load.name for load in m.mechanism.loads} <= set(items)
    assert np.abs(powers.sum(axis=1)).max() <= 1e-9 * np.abs(powers).max()
    kinetic, stored, work, lost = m.data("energy").T
    total = kinetic + stored - work + lost
    scale = max(np.ptp(x) for x in (kinetic, stored, work, lost))
    assert np.ptp(total) <= 2e-4 * scale  # the works are integrated over frames; the drives of two scenes have kinks
    assert np.all(np.diff(lost) >= -1e-4 * scale)


@pytest.mark.parametrize(("name", "load"), [("tailgate", "strut"), ("door-closer", "damper")])
def test_struts_are_drawn_between_their_points(name, load):
    m = made(name)
    rows = m.recording.rows("mechanism", "springs", load, component="LineStrips3D:strips")
    spec = next(x for x in m.mechanism.loads if x.name == load)
    assert isinstance(spec, Damper | GasSpring)
    ends = [m.run.motion.point(*end) for end in zip(spec.links, spec.points, strict=True)]
    every = max(1, m.run.motion.frames // len(rows.time))
    starts = np.concatenate([[0], np.cumsum(rows.lengths)])
    for k in (0, len(rows.time) // 3, len(rows.time) - 1):
        strips = rows.values[starts[k] : starts[k + 1]]
        points = np.concatenate([np.stack(list(strip)).astype(float).reshape(-1, 3)[:, :2] for strip in strips])
        for end in ends:
            assert np.hypot(*(points - end[k * every]).T).min() < 1e-6 * (1.0 + np.abs(end).max())


def test_linkers_only_where_loads_are_computed():
    assert list(find_strut_glyphs(run_scene(mechviz.load("crank-rocker"), frames=12), 1.0)) == []
    result = list(find_strut_glyphs(run_scene(mechviz.load("door-closer"), frames=12), 0.4))
    assert {x.kind for x in result} == {"torsion spring", "damper"}
    run = run_scene(mechviz.load("door-closer"), frames=12)
    (damper,) = (x for x in picture_of(run, solids_of(run)).nodes_of(Lines) if x.key == "spring.damper")
    lines = segments(damper, 3)
    assert lines.shape == (6 + 3, 2, 3) and np.all(lines[:, :, 2] == np.float32(damper.height))


def test_shapes_keep_their_widths_and_lengths():
    a = np.zeros((3, 2))
    for closed in (True, False):
        pot, rod = strut_strips(a[:2], np.array([[0.6, 0.0], [1.0, 0.0]]), 0.6, 1.0, 0.05, closed=closed)
        assert np.ptp(pot[..., 0], axis=1)[0] == pytest.approx(np.ptp(pot[..., 0], axis=1)[1])  # the pot keeps its length
        assert np.ptp(rod[..., 0], axis=1)[0] == pytest.approx(np.ptp(rod[..., 0], axis=1)[1])  # and the rod
        assert np.all(rod[:, 1:, 0] <= pot[..., 0].max()) and np.all(rod[:, 1:, 0] >= 0.0)  # the piston stays in the pot
    spiral = spiral_strips(a[:1], np.array([0.5]), np.array([1.0]), 0.2 / SPIRAL_RADIUS)
    assert np.hypot(*spiral[0, -1]) == pytest.approx(0.2) and np.arctan2(*spiral[0, 0][::-1]) == pytest.approx(1.0)
    assert np.arctan2(*spiral[0, -1][::-1]) == pytest.approx(0.5 - np.pi)  # two turns and a half further, on the first link's side


def test_moments_that_are_rounding_are_not_drawn():
    """The lamp without its bearing: a torque of 1e-15 N m is nothing beside forces of 70 N on 0.4 m."""
    scene = mechviz.loads(mechviz.load("lamp-arm").text.replace('bearing = { viscous = "A", linear = "0.02 N m s/rad" }', ""))
    assert vectors_of(run_scene(scene, frames=24))[1] == {}
    assert "drive" in vectors_of(made("lamp-arm").run)[1]
