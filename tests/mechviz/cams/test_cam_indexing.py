"""Indexing cams: the turret goes on by one roller every turn, all rollers fit between the ribs, forces and friction balance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cam_scenes import changed, refused, text_of

import mechviz
from mechcore.forces.cam_events import cam_events
from mechcore.forces.cam_rating import contact_force, placed_cams
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechviz.meshes.kinds.spatial_cams import rib
from mechviz.studies.cam_report import cam_facts

SCENES = ["cam-indexing", "cam-indexing-barrel"]
PERIOD = 0.5  # s a turn of the cam


def solved(name: str, turns: float, frames: int, friction: bool = True):
    mechanism = mechviz.load(name).mechanism
    if not friction:
        mechanism = replace(mechanism, effects=("inertia",))
    motion = solve_motion(compile_mechanism(mechanism), np.linspace(0.0, turns * PERIOD, frames))
    return motion, solve_forces(motion)


@pytest.mark.parametrize("name", SCENES)
def test_a_turret_goes_on_by_one_roller_every_turn(name):
    """Exactly the law, turn after turn, with its rates; forces do work as in a balance, and friction takes some."""
    motion, forces = solved(name, 3.0, 271)
    (cam,) = placed_cams(motion)
    step = 2.0 * np.pi / cam.blank.rollers
    turn, angle = motion.coordinate("O"), motion.coordinate("P")
    law = cam.cam.law
    inside = np.mod(turn[:, 0], 2.0 * np.pi)
    done = np.rint((turn[:, 0] - inside) / (2.0 * np.pi))
    whole = inside > 2.0 * np.pi - 1e-9  # rounding of whole turns
    inside, done = np.where(whole, 0.0, inside), done + whole
    wanted = step * done + law(inside, 0)[0] - law(0.0, 0)[0]
    np.testing.assert_allclose(-(angle[:, 0] - angle[0, 0]), wanted, atol=1e-12)
    np.testing.assert_allclose(-angle[::90, 0], -angle[0, 0] + step * np.arange(4), atol=1e-12)
    np.testing.assert_allclose(-angle[:, 1], law(inside, 1)[1] * turn[:, 1], atol=1e-10)
    resting = inside < np.radians(149.0)
    assert np.abs(angle[resting, 1]).max() < 1e-12 < np.abs(angle[~resting, 1]).max()
    assert np.abs(forces.power_balance).max() < 1e-12 and forces.friction.losses("K").max() > 0.0
    assert not cam_events(motion, forces)
    rows = cam.rows(motion)
    assert 0.0 <= rows.lift.min() < 1e-12 and rows.lift.max() < step + 1e-12
    places = np.abs(rows.place - cam.to_world(motion, (cam.pivot - cam.centre) / cam.axes))
    np.testing.assert_allclose(places, cam.arm, rtol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_the_turret_s_inertia_turns_the_shaft(name):
    """Torque = J q'' q' over the speed; the contact force in space has it as its moment about the shaft."""
    motion, forces = solved(name, 1.0, 91, friction=False)
    (cam,) = placed_cams(motion)
    inertia = motion.mechanism.links[2].inertia
    angle, turn = motion.coordinate("P"), motion.coordinate("O")
    torque = inertia * angle[:, 2] * angle[:, 1] / turn[:, 1]
    np.testing.assert_allclose(forces.effort("O"), torque, atol=1e-12 * np.abs(torque).max())
    force, flank = contact_force(forces, cam), cam.cam.flank(cam.argument(motion), [cam.middle])
    n, p = flank.normal[:, 0], flank.point[:, 0]
    moment = force * cam.sense * (p[:, 0] * n[:, 1] - p[:, 1] * n[:, 0])
    np.testing.assert_allclose(moment, torque, atol=1e-9 * np.abs(torque).max())


@pytest.mark.parametrize("name", SCENES)
def test_all_rollers_fit_between_the_ribs(name):
    """In space: no point of the rib is nearer to the axis of any roller than its radius; two rollers always touch it."""
    motion, _ = solved(name, 1.0, 2, friction=False)
    (cam,) = placed_cams(motion)
    body, theory = rib(cam).vertices, cam.cam
    sections = body.reshape(-1, 11, 3)[:, [1, 9]].reshape(-1, 3)  # the edges of its top, where the rollers are thick
    step, law = 2.0 * np.pi / cam.blank.rollers, theory.law
    for theta in law.start + np.linspace(0.0, 2.0 * np.pi, 19):
        c, s = np.cos(theta), theory.turn * np.sin(theta)
        x = np.column_stack([c * sections[:, 0] - s * sections[:, 1], s * sections[:, 0] + c * sections[:, 1], sections[:, 2]])
        touched = 0
        for k in range(cam.blank.rollers):
            psi = float(law(theta, 0)[0]) + k * step
            point, axis = (v[0, 0] for v in theory.mount.axis(np.array([[psi], [0.0], [0.0]])))
            along = (x - point) @ axis
            across = np.linalg.norm(x - point - along[:, None] * axis, axis=1)
            beside = (along > theory.inner - 1e-3) & (along < theory.outer + 1e-3)
            if beside.any():
                assert across[beside].min() > theory.radius - 6e-5, (np.degrees(theta), k)
                touched += across[beside].min() < theory.radius + 3e-4
        assert touched >= 2, np.degrees(theta)


@pytest.mark.parametrize("name", SCENES)
def test_the_rollers_that_are_allowed_leave_room_between_them(name):
    """What `mechviz cams` calls the greatest roller is the greatest that the scene takes; neighbours do not touch each other."""
    scene = mechviz.load(name)
    (cam,) = placed_cams(solve_motion(compile_mechanism(scene.mechanism), np.zeros(1)))
    (words,) = (fact.text for fact in cam_facts(*solved(name, 1.0, 5)) if "rollers up to" in fact.text)
    most = float(words.split("up to")[1].split()[0])
    apart = 2.0 * np.sin(np.pi / cam.blank.rollers) * (cam.cam.inner if name == SCENES[0] else cam.arm)
    assert 2e-3 * most < apart
    key = ("joints", "K", "follower", "roller")
    compile_mechanism(scene.changed({key: most - 0.001}).mechanism)
    with pytest.raises(ValueError, match=r"no rib between them|undercuts"):
        compile_mechanism(scene.changed({key: most + 0.001}).mechanism)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_read_as_they_were_written(name):
    scene = mechviz.load(name)
    again = mechviz.loads(scene.to_toml(), scene.name, scene.folder)
    assert again == scene and again.to_toml() == scene.to_toml()
    assert again.mechanism.joints[-1].spatial == scene.mechanism.joints[-1].spatial and scene.mechanism.joints[-1].spatial.rollers


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("cam-indexing", "to = 36", "to = 40", ["joints.K.profile.lift", "ends at 40°", "Let it end at 36° after a whole turn"]),
        ("cam-indexing", "over = 210", "over = 200", ["joints.K.profile.lift", "in 350°"]),
        ("cam-indexing", 'closure = "form"', 'closure = "force"', ["joints.K.closure", "Give closure = 'form'"]),
        ("cam-indexing", "globoid = {", "base = 0\ngloboid = {", ["joints.K.profile.base", "Leave it out"]),
        ("cam-indexing", "rollers = 10", "rollers = 2", ["joints.K.profile.globoid.rollers"]),
        ("cam-indexing", "rollers = 10", "rollers = 5", ["joints.K.profile.globoid.rollers", "Give at least 6"]),
        ("cam-indexing", "roller = 9", "roller = 20", ["joints.K.follower.roller", "no rib between them"]),
        ("cam-indexing-barrel", "P = [96, 0]", "P = [140, 0]", ["joints.K.profile.barrel", "the rollers pass its axis at up to"]),
        ("cam-indexing-barrel", "barrel = {", "end = {", ["rollers do not go with end"]),
    ],
)  # fmt: skip
def test_faults_of_indexing_cams(name, old, new, words):
    refused(changed(text_of(name), old, new), words)


@pytest.mark.parametrize(
    ("name", "old", "new", "path", "words"),
    [
        (
            "cam-indexing-barrel",
            'point = "T" }',
            'point = "T", second = { roller = 8, point = "E" } }',
            "follower.second",
            "barrel",
        ),
        ("cam-indexing", "radius = 3 }", "radius = 30 }", "friction.radius", "not thinner"),
        ("cam-indexing", "rollers = 10", "rollers = 2", "profile.globoid.rollers", "too small. Give at least 6."),
        ("cam-indexing", "rollers = 10", "rollers = 5", "profile.globoid.rollers", "too small. Give at least 6."),
        ("cam-indexing", "depth = 12", "depth = 1e6", "profile.globoid.depth", "smaller"),
        ("cam-indexing-barrel", "depth = 10", "depth = 1e6", "profile.barrel.depth", "smaller"),
        ("cam-inverse-slide", "phase = 42", 'phase = "42 deg"', "profile.phase", "length is wanted"),
        ("cam-inverse-slide", "[joints.K.profile]", "graphical = { step = 5 }\n[joints.K.profile]", "graphical", "disc cam"),
    ],
)
def test_one_fault_is_told_once_and_where_it_is(name, old, new, path, words):
    text = text_of(name)
    assert old in text
    with pytest.raises(ValueError) as refused:
        compile_mechanism(mechviz.loads(text.replace(old, new)).mechanism)
    (fault,) = refused.value.faults
    assert fault.path == f"joints.K.{path}" and words in f"{fault.message} {fault.remedy}"
