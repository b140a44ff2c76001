"""Free bodies by a planar joint: flight, seen from links that stand still or turn, beside loops; what is recorded and refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

import mechviz
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.laws.timed import Free
from mechcore.spec.mechanism import Drive, Link, Mechanism, Planar
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.nodes import Arrow
from mechviz.runs import run_scene
from recordings import vectors_of

THROWN = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
run = { duration = "0.8 s", tolerance = 1e-10 }
[links]
frame = { points = { O = [0, 0] } }
plate = { points = { P = [-100, -50], Q = [100, -50], T = [0, 120] }, mass = "4 kg", centre = [30, 10], inertia = "0.09 kg m^2" }
[joints]
body = { planar = ["frame", "plate"], at = "T", START }
"""
START = 'free = { x = 300, y = "0.2 m", vx = "2 m/s", vy = "4 m/s", angle = 20, omega = "90 rpm" }'


def test_a_thrown_body_flies_a_parabola_and_turns_evenly():
    run = simulate(mechviz.loads(THROWN.replace("START", START)).mechanism, 0.8, tolerance=1e-10)
    t = np.linspace(0.0, 0.8, 41)
    motion = run.motion(t)
    w, turned = 3.0 * np.pi, np.exp(1j * np.radians(20.0))
    arm = (0.03 + 0.01j - 0.12j) * turned  # from T to the centre of mass
    start, speed = 0.3 + 0.2j + arm, 2.0 + 4.0j + 1j * w * arm
    centre = start + speed * t - 0.5j * 9.81 * t**2
    assert motion.centre_of_mass("plate") @ [1.0, 1.0j] == pytest.approx(centre, abs=1e-13)
    assert motion.pose("plate")[:, 2] == pytest.approx(np.radians(20.0) + w * t, abs=1e-12)
    assert motion.coordinate("body")[:, 0] == pytest.approx(np.radians(20.0) + w * t, abs=1e-12)
    assert motion.point("plate", "T") == pytest.approx(np.column_stack([run(t)[0][:, 0], run(t)[0][:, 1]]), abs=1e-13)
    assert np.abs(run.drift(t)).max() < 1e-13
    forces = run.forces(motion)
    assert max(np.abs(forces.reaction(name)).max() for name in ("body.x", "body.y", "body")) < 1e-12


@pytest.mark.parametrize("speed", [-7.0, 0.4])
def test_the_flight_is_the_same_seen_from_a_turning_link(speed):
    """Coordinates in the axes of a crank that is driven: the world's motion does not know of it."""
    crank = "crank = { points = { O = [0, 0] } }\n[joints]"
    pin = f'O = {{ revolute = ["frame", "crank"], drive = {{ speed = "{speed} rad/s" }} }}'
    text = THROWN.replace('["frame", "plate"]', '["crank", "plate"]').replace("[joints]", f"{crank}\n{pin}")
    at, v, w = 0.3 + 0.2j, 2.0 + 4.0j - 1j * speed * (0.3 + 0.2j), 3.0 * np.pi - speed
    start = f"free = {{ x = 300, y = 200, vx = '{v.real} m/s', vy = '{v.imag} m/s', angle = 20, omega = '{w} rad/s' }}"
    seen = simulate(mechviz.loads(text.replace("START", start)).mechanism, 0.8, tolerance=1e-11)
    still = simulate(mechviz.loads(THROWN.replace("START", START)).mechanism, 0.8, tolerance=1e-11)
    t = np.linspace(0.0, 0.8, 17)
    for point in "PQT":
        assert seen.motion(t).point("plate", point) == pytest.approx(still.motion(t).point("plate", point), abs=1e-11)
    place = still.motion(t).point("plate", "T") @ [1.0, 1.0j] * np.exp(-1j * speed * t)
    assert seen(t)[0][:, 0] + 1j * seen(t)[0][:, 1] == pytest.approx(place, abs=1e-11)
    assert place[0] == pytest.approx(at)


def test_it_starts_as_drawn():
    text = THROWN.replace("START", "free = {}").replace("{ P = [-100, -50], Q = [100, -50], T = [0, 120] }", '["P", "Q", "T"]')
    text += "[sketch]\nP = [100, 50]\nQ = [100, 250]\nT = [-70, 150]\n"
    scene = mechviz.loads(text)
    q = {d.joint: d.law.start for d in scene.mechanism.drives}
    assert q == pytest.approx({"body.x": -0.07, "body.y": 0.15, "body": np.pi / 2}, abs=1e-12)
    assert simulate(scene.mechanism, 0.1).motion(0.0).point("plate", "Q")[0] == pytest.approx([0.1, 0.25])


def test_beside_a_loop_that_changes_its_leading_joint():
    """A four-bar whose crank passes its dead points and a body that hangs on it by a spring, against the same as two scenes."""
    loop = """
        crank = { points = { A = [0, 0], B = [150, 0] }, mass = "1 kg", shape = "bar" }
        coupler = { points = { B = [0, 0], C = [180, 0] }, mass = "1 kg", shape = "bar" }
        rocker = { points = { D = [0, 0], C = [120, 0] }, mass = "1 kg", shape = "bar" }
        [joints]
        A = { revolute = ["frame", "crank"], free = { position = 70 } }
        B = { revolute = ["crank", "coupler"] }
        C = { revolute = ["coupler", "rocker"], side = "left" }
        D = { revolute = ["rocker", "frame"] }
        """
    loop = "\n".join(line.strip() for line in loop.splitlines())
    alone = THROWN.replace("START", START).replace("O = [0, 0]", "O = [0, 0], A = [0, 0], D = [200, 0]")
    both = alone.replace("[joints]", loop)
    four_bar = both.replace(next(line for line in both.splitlines() if line.startswith("plate")), "")
    four_bar = four_bar.replace(next(line for line in both.splitlines() if line.startswith("body")), "")
    t = np.linspace(0.0, 0.8, 33)
    computed, body, rest = (simulate(mechviz.loads(text).mechanism, 0.8, tolerance=1e-10) for text in (both, alone, four_bar))
    assert computed.motion(t).pose("plate") == pytest.approx(body.motion(t).pose("plate"), abs=1e-9)
    for link in ("crank", "coupler", "rocker"):
        assert computed.motion(t).point(link, "B" if link != "rocker" else "C") == pytest.approx(
            rest.motion(t).point(link, "B" if link != "rocker" else "C"), abs=1e-8
        )
    assert np.abs(computed.drift(t)).max() < 1e-8


def test_a_recording_knows_nothing_of_what_it_is_made_of(tmp_path):
    run = run_scene(mechviz.loads(THROWN.replace("START", START)), frames=40)
    assert run.errors.worst()["between_frames"] < 1e-4
    write_recording(run, tmp_path / "a.rrd")
    model = json.loads(Recording(tmp_path / "a.rrd").properties["model"])
    assert model["links"] == ["frame", "plate"] and model["joints"] == {} and model["drives"] == []


@pytest.mark.parametrize(
    ("start", "words"),
    [
        (
            "free = { position = 3 }",
            "position does not go with a planar joint. Its start has x, y, angle, vx, vy and omega.",
        ),
        ("friction = { coefficient = 1 }", "joints.body: 'free' is missing. Add free = { y ="),
        ('drive = { speed = "60 rpm" }', "joints.body.drive: drive does not go with a planar joint. Its start is free ="),
        ('free = { x = "3 deg" }', "joints.body.free.x"),
        ('free = { vx = "3 m" }', "joints.body.free.vx"),
        ("free = { xx = 3 }", "joints.body.free: unknown key 'xx'."),
        ("free = {}, branch = 'ahead'", "branch does not go with a planar joint"),
    ],
)
def test_what_is_wrong_with_a_free_body_is_said(start, words):
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(THROWN.replace("START", start))
    assert words in "\n".join(map(str, error.value.faults))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('at = "T"', 'at = "X"', "joints.body.at: link 'plate' has no point 'X'."),
        ('at = "T"', 'at = ["O", "T"]', "joints.body.at: names two points. Name one point of 'plate'."),
        ('["frame", "plate"]', '["frame", "plte"]', "there is no link 'plte'"),
        (
            "[joints]",
            '[joints]\n"body.x" = { revolute = ["frame", "plate"], at = ["O", "T"] }',
            "the planar 'body' brings along a part",
        ),
        ('run = { duration = "0.8 s", tolerance = 1e-10 }', "", "'duration' is missing: how long does body move?"),
    ],
)
def test_what_does_not_fit_a_free_body_is_said(old, new, words):
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(THROWN.replace("START", START).replace(old, new))
    assert words in "\n".join(map(str, error.value.faults))


def test_a_revolute_joint_starts_with_an_angle_and_a_speed():
    text = THROWN.replace("START", "free = { x = 3 }").replace("planar", "revolute").replace('"T"', '["O", "T"]')
    with pytest.raises(mechviz.SceneError, match=r"x does not go with a revolute joint. Its start has position and speed"):
        mechviz.loads(text)


def test_a_coordinate_without_a_drive_is_named():
    mechanism = Mechanism(
        name="lost",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0)}), Link(name="body", points={"C": (0.0, 0.0)}, mass=1.0, inertia=1.0)),
        joints=(Planar(name="B", links=("frame", "body")),),
        drives=(Drive(joint="B.x", law=Free(0.0)), Drive(joint="B", law=Free(0.0))),
        effects=("inertia",),
    )
    with pytest.raises(MechanismError, match=r"B\.y"):
        simulate(mechanism, 1.0)


def test_a_torque_on_a_free_body_is_drawn_at_its_centre():
    """The link has no joint at which it could be drawn."""
    text = """
    effects = ["inertia"]
    run = { duration = "0.2 s", frames = 4 }
    [links]
    frame = { points = { O = [0, 0] } }
    body = { points = { P = [0, 0], Q = [0.3, 0] }, mass = 2, centre = [0.1, 0], inertia = 1 }
    [joints]
    B = { planar = ["frame", "body"], at = "P", free = { vx = 1 } }
    [loads]
    spin = { torque = 3, on = "body" }
    """
    run = run_scene(mechviz.loads(text))
    moment = vectors_of(run)[1]["applied"]["spin"]
    np.testing.assert_allclose(moment.origin, run.motion.centre_of_mass("body"), atol=1e-12)
    picture = picture_of(run, solids_of(run))  # with the height of its arc
    (inertia,) = (node.vector.origin for node in picture.nodes_of(Arrow, "inertia"))  # a couple alone: its force is round-off
    np.testing.assert_allclose(inertia, run.motion.centre_of_mass("body"), atol=1e-12)
