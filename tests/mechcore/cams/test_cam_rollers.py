"""Rollers that roll: speeds without slip, marks in recordings and in the viewer."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.cams.placement.spatial import roller_angle, roller_speed
from mechcore.forces.cam_rating import contact_force, placed_cams
from mechviz.picture.build import solids_of
from mechviz.picture.surface_marks import find_rollers
from mechviz.runs import run_scene


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


@pytest.mark.parametrize("name", ["cam-conjugate", "cam-barrel-rib", "cam-end", "cam-inverse"])
def test_every_roller_of_a_cam_is_marked_and_rolls_off_its_flank(name):
    """Both rollers of a joint; over a turn each rolls off the length of its flank, or comes back where the crank only swings."""
    run = run_scene(mechviz.load(name))
    solids = solids_of(run)
    marks = find_rollers(run, solids)
    (cam,) = placed_cams(run.motion)
    assert len(marks) == (2 if name in ("cam-conjugate", "cam-barrel-rib") else 1)
    for mark in marks:
        wide = np.hypot(*mark.vertices[:, :2].T).max()
        if cam.mate is not None:
            own = cam if "second" not in mark.name else cam.mate
            t = np.linspace(0.0, own.contour.count, 20001)
            length, radius = np.abs(np.diff(own.contour(t)[0])).sum(), own.face.radius
            assert mark.angle[-1] == pytest.approx(-length / radius, rel=3e-4)
        elif name != "cam-inverse":  # the groove's middle line, developed
            theta = cam.cam.law.start + cam.cam.law.length * np.linspace(0.0, 1.0, 20001)
            way = np.hypot(cam.middle * np.diff(theta), np.diff(cam.cam.law(theta, 0)[0])).sum()
            assert np.abs(mark.angle[-1]) == pytest.approx(way / cam.face.radius, rel=1e-6)
        assert wide < 1.02 * cam.face.radius
    if name == "cam-inverse":  # against the velocity of the slot's flank at the place of contact, by differences
        force = contact_force(run.forces, cam)
        rate = roller_speed(run.motion, cam, force)
        place = cam.contact(run.motion, force)[0]
        k, f = (run.motion.model.index[link] for link in cam.links)
        frames = np.ones(run.motion.frames)
        slot = (run.motion.origins[f] * frames, run.motion.rotation(f) * frames)
        pin = (run.motion.origins[k] + run.motion.rotation(k) * cam.tip) * frames
        i = run.motion.frames // 3
        dt = run.motion.time[i + 1] - run.motion.time[i - 1]
        stuck = (place[i] - slot[0][i]) / slot[1][i]  # that point of the driven link, before and after
        moved = (slot[0] + slot[1] * stuck)[[i - 1, i + 1]]
        slip = ((moved[1] - moved[0]) - (pin[i + 1] - pin[i - 1])) / dt
        out = place[i] - pin[i]
        assert rate[i] == pytest.approx(np.imag(np.conj(out) * slip) / abs(out) ** 2, rel=2e-3)


def test_the_roller_of_a_globoid_rolls_about_its_arm():
    """Spin from velocities in space: the surfaces of roller and flank move alike across the roller's axis where they touch."""
    run = run_scene(mechviz.load("cam-globoid"))
    (cam,) = placed_cams(run.motion)
    (mark,) = find_rollers(run, solids_of(run))
    force = contact_force(run.forces, cam)
    rate = roller_speed(run.motion, cam, force)
    theta, turn, h = cam.argument(run.motion), cam.cam.turn, 1e-5
    speed = cam.sense * run.motion.coordinate("O")[:, 1]
    side = np.where(force < 0.0, -1, 1)

    def of_ground(values, angle):
        c, s = np.cos(angle), turn * np.sin(angle)
        return np.stack([c * values[:, 0] - s * values[:, 1], s * values[:, 0] + c * values[:, 1], values[:, 2]], axis=1)

    def axis(angle):
        ends = of_ground(cam.cam.flank(angle, [cam.middle], 1).axis_point[:, 0], angle)
        tips = of_ground(cam.cam.flank(angle, [cam.middle + 0.01], 1).axis_point[:, 0], angle)
        return ends, (tips - ends) / 0.01

    centre, along = axis(theta)
    moved = (axis(theta + h)[0] - axis(theta - h)[0]) / (2.0 * h) * speed[:, None]
    flanks = {k: cam.cam.flank(theta, [cam.middle], k) for k in (1, -1)}
    normal = of_ground(np.where(side[:, None] > 0, flanks[1].normal[:, 0], flanks[-1].normal[:, 0]), theta)
    touch = centre - cam.face.radius * normal
    material = turn * speed[:, None] * np.column_stack([-touch[:, 1], touch[:, 0], np.zeros(len(touch))])
    across = np.cross(along, normal)
    wanted = -((material - moved) * across).sum(axis=1) / cam.face.radius
    np.testing.assert_allclose(rate, wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())
    assert mark.axis is not None and np.hypot(*mark.axis) == pytest.approx(1.0)
    own = mark.vertices @ [*mark.axis, 0.0]
    rho = np.linalg.norm(mark.vertices - own[:, None] * np.float32([*mark.axis, 0.0]), axis=1)
    assert rho.max() == pytest.approx(1.012 * cam.face.radius, rel=1e-3) and own.min() > 0.0


def test_a_roller_beside_a_barrel_rolls_off_the_way_of_its_axis_and_turns_with_its_arm():
    """Speed in the world from differences of places: the drum passes below, across its own axis."""
    run = run_scene(mechviz.load("cam-barrel-arm"), frames=3600)
    (cam,) = placed_cams(run.motion)
    place, time = cam.rows(run.motion).place, run.motion.time
    moved = (place[2:] - place[:-2]) / (time[2] - time[0])
    slip = run.motion.coordinate("O")[1:-1, 1] * cam.middle - moved * np.conj(cam.axes)
    for sign in (1.0, -1.0):
        rate = roller_speed(run.motion, cam, sign)[1:-1]
        np.testing.assert_allclose(np.abs(rate), np.abs(slip) / cam.face.radius, rtol=2e-5)
        assert np.all(np.sign(rate) == np.sign(rate[0]) * np.sign(slip.real) * np.sign(slip.real[0]))


def test_the_rollers_of_a_turret_turn_alike_at_both_ends_of_its_cycle():
    run = run_scene(mechviz.load("cam-indexing"), frames=24)
    rate = roller_speed(run.motion, placed_cams(run.motion)[0])
    assert rate[-1] == pytest.approx(rate[0], rel=1e-12)


def test_scenes_without_rollers_have_no_marks():
    for name in ("crank-rocker", "cam-flat"):
        run = run_scene(mechviz.load(name), frames=24)
        assert find_rollers(run, solids_of(run)) == []
