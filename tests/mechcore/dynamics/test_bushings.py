"""Bushings against the equations of a body on three springs, in large motions, and what is wrong with them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eig, eigh

import mechviz
from mechcore.dynamics.rest.vibrations import small_vibrations
from mechcore.dynamics.simulate import simulate
from mechviz.outputs.exports.gltf_marks import find_marks
from mechviz.outputs.presentation import presentation_of
from mechviz.picture.springs import find_strut_glyphs
from mechviz.runs import run_scene
from mechviz.studies.vibrations import mode_scene, vibration_lines, vibrations_of
from recordings import vectors_of

MOUNTED = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
run = { duration = "0.4 s", tolerance = 1e-11 }
[links]
frame = { points = { A = [0, 0], B = [400, 0] } }
engine = { points = { P = [0, 0], Q = [400, 0] }, mass = "80 kg", centre = [220, 110], inertia = "3 kg m^2" }
[joints]
body = { planar = ["frame", "engine"], START }
[loads]
front = { bushing = ["frame.A", "engine.P"], stiffness = ["200 N/mm", "80 N/mm", "9 kN m/rad"], FRONT }
rear = { bushing = ["frame.B", "engine.Q"], stiffness = ["100 N/mm", "60 N/mm", "2000 N m/rad"] }
"""
MASS = np.diag([80.0, 80.0, 3.0])


def matrix(front: tuple[float, ...], rear: tuple[float, ...]) -> np.ndarray:
    """Stiffness or damping for x, y of the centre of mass and the angle."""
    total = np.zeros((3, 3))
    for (kx, ky, kt), (rx, ry) in ((front, (-0.22, -0.11)), (rear, (0.18, -0.11))):
        rows = np.array([[1.0, 0.0, -ry], [0.0, 1.0, rx], [0.0, 0.0, 1.0]])
        total += rows.T @ np.diag([kx, ky, kt]) @ rows
    return total


STIFFNESS = matrix((200e3, 80e3, 9e3), (100e3, 60e3, 2e3))


def made(front: str = "free_angle = 0", start: str = "free = {}") -> str:
    return MOUNTED.replace("FRONT", front).replace("START", start).replace("9 kN m/rad", "9000 N m/rad")


def test_natural_frequencies():
    vibrations = small_vibrations(mechviz.loads(made()).mechanism)
    expected = np.sqrt(eigh(STIFFNESS, MASS, eigvals_only=True)) / (2.0 * np.pi)
    assert [mode.frequency for mode in vibrations.modes] == pytest.approx(expected, rel=1e-7)


def test_damped_modes():
    text = made('linear = ["900 N s/m", "400 N s/m", "30 N m s/rad"]')
    damping = matrix((900.0, 400.0, 30.0), (0.0, 0.0, 0.0))
    state = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(MASS, STIFFNESS), -np.linalg.solve(MASS, damping)]])
    roots = sorted((z for z in eig(state)[0] if z.imag > 0.0), key=abs)
    vibrations = small_vibrations(mechviz.loads(text).mechanism)
    ours = sorted((z for mode in vibrations.modes for z in mode.eigenvalues if z.imag > 0.0), key=abs)
    assert ours == pytest.approx(roots, rel=1e-6)


def test_a_large_motion():
    """Far from rest, where the axes of both links count, against Newton's and Euler's equations of a single body."""
    start = "free = { x = 60, y = -40, angle = 70, vx = '2 m/s', omega = '90 rpm' }"
    text = made('linear = ["900 N s/m", "400 N s/m", "30 N m s/rad"], free_angle = 10', start)
    run = simulate(mechviz.loads(text).mechanism, 0.4, tolerance=1e-11)

    def rates(_, s):
        z, v, angle, w = complex(s[0], s[1]), complex(s[2], s[3]), s[4], s[5]  # of the engine's frame
        e = np.exp(1j * angle)
        arm = (0.22 + 0.11j) * e
        force, moment = 0j, -9000.0 * (angle - np.radians(10.0)) - 2000.0 * angle - 30.0 * w
        for anchor, point, (kx, ky), (cx, cy) in (
            (0.0, 0.0, (200e3, 80e3), (900.0, 400.0)),
            (0.4, 0.4, (100e3, 60e3), (0.0, 0.0)),
        ):
            d, u = z + point * e - anchor, v + 1j * w * point * e
            pull = -complex(kx * d.real + cx * u.real, ky * d.imag + cy * u.imag)
            force += pull
            moment += (np.conj(point * e - arm) * pull).imag
        alpha = moment / 3.0
        a = force / 80.0 - 1j * alpha * arm + w * w * arm
        return [v.real, v.imag, a.real, a.imag, w, alpha]

    t = np.linspace(0.0, 0.4, 81)
    w = 3.0 * np.pi
    state = [0.06, -0.04, 2.0, 0.0, np.radians(70.0), w]
    expected = solve_ivp(rates, (0.0, 0.4), state, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=t).y
    pose = run.motion(t).pose("engine")
    assert pose[:, :2] == pytest.approx(expected[:2].T, abs=1e-10)
    assert pose[:, 2] == pytest.approx(expected[4], abs=1e-9)
    assert np.abs(run.drift(t)).max() < 1e-9
    forces = run.forces(run.motion(t))
    assert np.abs(forces.power_balance).max() < 1e-12
    lost = run.energies(t)[:, 3]
    assert lost[-1] > 100.0 and np.diff(lost).min() > -1e-9


def test_the_angle_is_wound_up_over_whole_turns():
    """A spinning body winds its bushing up until the spring's energy is that of the spin."""
    text = made(start="free = { omega = '2000 rpm' }").replace("rear", "#").replace("centre = [220, 110]", 'centre = "P"')
    run = simulate(mechviz.loads(text).mechanism, 0.4, tolerance=1e-11)
    w, speed = np.sqrt(9000.0 / 3.0), 2000.0 * np.pi / 30.0
    t = np.linspace(0.0, 0.4, 101)
    assert speed / w > np.pi  # more than half a turn
    assert run.motion(t).pose("engine")[:, 2] == pytest.approx(speed / w * np.sin(w * t), abs=1e-9)


def test_between_moving_links_nothing_comes_from_outside():
    """Two free bodies that a bushing with damping joins: momentum and angular momentum stay."""
    text = made('linear = ["900 N s/m", "400 N s/m", "30 N m s/rad"]').replace('"frame.A"', '"sled.A"').replace("rear", "#")
    text = text.replace("[joints]", """sled = { points = { A = [50, 30] }, mass = "20 kg", centre = [90, 0], inertia = "1 kg m^2" }
[joints]
sled = { planar = ["frame", "sled"], free = { x = -200, vy = "3 m/s", omega = "60 rpm" } }""")  # fmt: skip
    run = simulate(mechviz.loads(text).mechanism, 0.4, tolerance=1e-11)
    t = np.linspace(0.0, 0.4, 41)
    motion = run.motion(t)
    linear, angular = np.zeros((41, 2)), np.zeros(41)
    for link, mass, inertia in (("engine", 80.0, 3.0), ("sled", 20.0, 1.0)):
        x, v = motion.centre_of_mass(link), motion.centre_of_mass(link, 1)
        linear += mass * v
        angular += mass * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) + inertia * motion.velocity(link)[:, 2]
    assert np.ptp(linear, axis=0).max() < 1e-9 * np.abs(linear).max()
    assert np.ptp(angular) < 1e-9 * np.abs(angular).max()
    assert np.abs(run.drift(t)).max() < 1e-9


def test_a_recording_shows_it():
    run = run_scene(mechviz.loads(made("free_angle = 3", "free = { x = 5 }")), frames=24)
    arrow = vectors_of(run)[0]["applied"]["front"]
    assert arrow.value[0] == pytest.approx([200e3 * 5e-3, 0.0])
    assert vectors_of(run)[1]["applied"]["front"].value[0] == pytest.approx(-9e3 * np.radians(3.0))
    ring, bar, _ = next(x for x in find_strut_glyphs(run, 0.4) if x.name == "front").strips(np.array([0, 3]))
    assert ring.shape == (2, 37, 2) and bar.shape == (2, 2, 2)
    assert bar[0].mean(axis=0) == pytest.approx([5e-3, 0.0]) and ring.mean(axis=1) == pytest.approx(np.zeros((2, 2)), abs=1e-3)


def test_a_bushing_is_in_the_solid_model():
    """A ring that stays about its place on the frame, and a cross that moves and turns with the engine."""
    run = run_scene(mechviz.loads(made(start="free = { x = 5, angle = 3 }")), frames=8)
    marks = {mark.name: mark for mark in find_marks(presentation_of(run))}
    ring, cross = (marks[f"bushing front {part}"] for part in ("ring", "cross"))
    assert "bushing rear ring" in marks and "bushing rear cross" in marks
    assert ring.places[:, :2] == pytest.approx(np.zeros((9, 2)), abs=1e-7)  # what is drawn is of single precision
    assert cross.places[:, :2] == pytest.approx(run.motion.point("engine", "P"), abs=1e-7)
    assert cross.angles == pytest.approx(run.motion.pose("engine")[:, 2], abs=5e-6)


def test_a_mode_of_a_free_body_cannot_be_shown():
    scene = mechviz.loads(made())
    vibrations = vibrations_of(scene)
    assert len(vibrations.modes) == 3 and "body.x [m]" in "\n".join(vibration_lines(scene, vibrations))
    with pytest.raises(mechviz.SceneError, match="a mode is shown by driven joints, and a free body has none") as refused:
        mode_scene(scene, vibrations, 1)
    assert refused.value.faults[0].path == "joints.body" and "two sliding joints and a pin" in refused.value.faults[0].remedy


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('stiffness = ["200 N/mm", "80 N/mm", "9000 N m/rad"]', 'stiffness = "2 N/mm"', "Write stiffness = [x, y, angle]."),
        ('stiffness = ["200 N/mm", "80 N/mm", "9000 N m/rad"]', "stiffness = [1, 2]", "loads.front.stiffness"),
        ('stiffness = ["200 N/mm", "80 N/mm", "9000 N m/rad"], ', "", "loads.front: 'stiffness' is missing. Add stiffness = ["),
        ('"200 N/mm", "80 N/mm", "9000 N m/rad"', "0, 0, 0", "all values are zero: it does nothing. Give one of them a value."),
        ('"80 N/mm", "9000', '"80 N m/rad", "9000', "loads.front.stiffness[1]"),
        ('"200 N/mm", "80', '"-200 N/mm", "80', "'-200 N/mm' is negative. Give a positive value."),
        ("free_angle = 0", 'linear = "3 N s/m"', "Write linear = [x, y, angle]."),
        ("free_angle = 0", "quadratic = 3", "quadratic does not go with a bushing"),
        ('"engine.P"', '"engine.X"', "link 'engine' has no point 'X'"),
        ('"engine.P"', '"frame.B"', "both points are on 'frame'"),
    ],
)
def test_what_is_wrong_with_a_bushing_is_said(old, new, words):
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(made().replace(old, new, 1))
    assert words in "\n".join(map(str, error.value.faults))


def test_a_spring_has_one_stiffness():
    text = made().replace("bushing", "spring").replace("free_angle = 0", "free_length = 1")
    with pytest.raises(mechviz.SceneError, match="a spring has one stiffness"):
        mechviz.loads(text)
