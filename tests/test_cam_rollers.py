"""Rollers that roll: speeds without slip, marks in recordings and in the viewer."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.cams.happenings import contact_force, placed_cams
from mechcore.cams.rolling import roller_angle, roller_speed
from mechviz.rollers import find_rollers
from mechviz.run import run_scene
from mechviz.solids import solids_of


def test_on_a_dwell_the_roller_turns_as_the_circles_ask():
    """Against the cam, by the ratio of the radii: -omega rho/r, exactly, where the profile is a circle about the axis."""
    run = run_scene(mechviz.load("cam-roller"))
    (cam,) = placed_cams(run.motion)
    rate, rows = roller_speed(run.motion, cam), cam.rows(run.motion)
    speed = run.motion.coordinate("O")[:, 1]
    dwell = np.abs(cam.law(rows.angle)[1:]).max(axis=0) == 0.0
    assert dwell.sum() > 60
    for lift, rho in ((0.020, 0.060), (0.0, 0.040)):
        still = dwell & (np.abs(rows.lift - lift) < 1e-12)
        np.testing.assert_allclose(rate[still], -speed[still] * rho / 0.010, rtol=1e-12)
    # over a turn: the way rolled off is the profile's length, less what the normal turns by
    contour = cam.contour
    t = np.linspace(0.0, contour.count, 20001)
    length = np.abs(np.diff(contour(t)[0])).sum()
    angle = roller_angle(run.motion, cam)
    assert angle[-1] == pytest.approx(-(length / 0.010), rel=2e-4)


def test_in_a_groove_the_roller_reverses_where_the_flank_changes():
    run = run_scene(mechviz.load("cam-groove"))
    (cam,) = placed_cams(run.motion)
    force = contact_force(run.forces, cam)
    rate = roller_speed(run.motion, cam, force)
    pressed = np.abs(force) > 1e-6 * np.abs(force).max()
    np.testing.assert_array_equal(np.sign(rate[pressed]), -np.sign(force[pressed]) * np.sign(run.motion.coordinate("O")[0, 1]))
    with pytest.raises(ValueError, match="no roller"):
        flat = run_scene(mechviz.load("cam-flat"))
        roller_speed(flat.motion, placed_cams(flat.motion)[0])


@pytest.mark.parametrize("name", ["cam-roller", "cam-groove", "cam-oscillating-roller", "cam-tangent"])
def test_marks_lie_on_the_faces_of_the_rollers(name):
    run = run_scene(mechviz.load(name))
    solids = solids_of(run)
    (mark,) = find_rollers(run, solids)
    (cam,) = placed_cams(run.motion)
    radius = cam.face.radius
    size = np.hypot(*mark.vertices[:, :2].T)
    assert size.max() < radius and size.min() > 0.5 * radius
    low, high = solids.links[mark.link].mesh.bounds[:, 2]
    assert low < mark.centre[2] <= high
    assert mark.angle.shape == (run.motion.frames,) and np.ptp(mark.angle) > 2.0 * np.pi


def test_scenes_without_rollers_have_no_marks():
    for name in ("crank-rocker", "cam-flat"):
        run = run_scene(mechviz.load(name), frames=24)
        assert find_rollers(run, solids_of(run)) == []
