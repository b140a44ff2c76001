"""Actuators of constant force against closed forms, and what is wrong with them."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.dynamics.simulate import simulate
from mechviz.picture.springs import find_strut_glyphs
from mechviz.runs import run_scene
from recordings import vectors_of

SLIDE = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
run = { duration = "0.8 s", tolerance = 1e-10 }
[links]
frame = { points = { A = [0, 0], P = [0, 300] } }
arm = { points = { A = [0, 0], S = [0, 0] }, mass = "3 kg", centre = "A", inertia = "0.1 kg m^2" }
block = { points = { S = [0, 0] }, mass = "2 kg", shape = "point" }
[joints]
A = { revolute = ["frame", "arm"], ARM }
S = { prismatic = ["arm", "block"], along = [1, 0], free = { position = 100 } }
[loads]
push = { ACTUATOR, thrust = "10 N" }
"""


def made(actuator: str, arm: str = "free = {}") -> str:
    return SLIDE.replace("ARM", arm).replace("ACTUATOR", actuator)


def test_along_a_slide_it_makes_a_parabola():
    """Between arm and block it turns nothing: the arm rests."""
    run = simulate(mechviz.loads(made('actuator = "S"')).mechanism, 0.8, tolerance=1e-10)
    t = np.linspace(0.0, 0.8, 33)
    q, v, a = run(t)
    assert q[:, 1] == pytest.approx(0.1 + 0.5 * 5.0 * t**2, abs=1e-13)
    assert v[:, 1] == pytest.approx(5.0 * t, abs=1e-12) and a[:, 1] == pytest.approx(np.full(33, 5.0), abs=1e-11)
    assert np.abs(q[:, 0]).max() < 1e-13


def test_on_a_slide_of_a_turning_arm():
    """At a constant speed w of the arm: r'' = w^2 r + F / m."""
    text = made('actuator = "S"', 'drive = { speed = "3 rad/s" }')
    run = simulate(mechviz.loads(text).mechanism, 0.8, tolerance=1e-10)
    t = np.linspace(0.0, 0.8, 33)
    rest = -5.0 / 9.0  # where the two forces balance
    assert run(t)[0][:, 0] == pytest.approx(rest + (0.1 - rest) * np.cosh(3.0 * t), abs=1e-12)
    forces = run.forces(run.motion(t))
    assert np.abs(forces.power_balance).max() < 1e-12


def test_between_two_points_its_work_is_force_times_way():
    run = simulate(mechviz.loads(made('actuator = ["frame.P", "block.S"]')).mechanism, 0.8, tolerance=1e-10)
    t = np.linspace(0.0, 0.8, 33)
    way = np.hypot(*(run.motion(t).point("block", "S") - [0.0, 0.3]).T)
    assert run.kinetic_energy(t) == pytest.approx(10.0 * (way - way[0]), abs=1e-9)
    assert np.ptp(way) > 0.1
    forces = run.forces(run.motion(t))
    on_frame = forces.loads["push"].values
    assert np.hypot(*on_frame[:, :2].T) == pytest.approx(np.full(33, 10.0), rel=1e-12)
    away = np.array([0.0, 0.3]) - run.motion(t).point("block", "S")
    assert np.einsum("ni,ni->n", on_frame[:, :2], away) == pytest.approx(10.0 * way, rel=1e-12)
    assert np.abs(run.drift(t)).max() < 1e-9


def test_a_recording_shows_it():
    """The arrow has its size, a strut is drawn between its points; along a slide there is only the arrow."""
    run = run_scene(mechviz.loads(made('actuator = ["frame.P", "block.S"]')), frames=24)
    assert vectors_of(run)[0]["applied"]["push"].magnitude == pytest.approx(np.full(25, 10.0))
    assert [(x.name, x.kind) for x in find_strut_glyphs(run, 0.3)] == [("push", "actuator")]
    run = run_scene(mechviz.loads(made('actuator = "S"')), frames=24)
    assert vectors_of(run)[0]["applied"]["push"].magnitude == pytest.approx(np.full(25, 10.0))
    assert not list(find_strut_glyphs(run, 0.3))


@pytest.mark.parametrize(
    ("actuator", "words"),
    [
        ('actuator = "A"', "loads.push.actuator: 'A' is a revolute joint, no sliding joint. Name a sliding joint: 'S'."),
        ('actuator = "X"', "loads.push.actuator: there is no joint 'X'."),
        ('actuator = ["frame.P", "arm.X"]', "loads.push.actuator[1]: link 'arm' has no point 'X'."),
        ('actuator = ["arm.S", "arm.A"]', "loads.push.actuator: both points are on 'arm'. Name points of two links."),
        ('actuator = ["arm.S", "arm.S"]', "loads.push.actuator: acts between 'arm.S' and itself."),
        ('actuator = ["arm.S"]', "loads.push.actuator"),
        ("actuator = 3", "loads.push.actuator"),
        ('actuator = "S", stiffness = 3', "loads.push.stiffness: stiffness does not go with an actuator."),
        ('actuator = "S", step = { at = 1 }, sine = { frequency = 1 }', "sine and step at once"),
    ],
)
def test_what_is_wrong_with_an_actuator_is_said(actuator, words):
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(made(actuator))
    assert words in "\n".join(map(str, error.value.faults))


def test_without_a_force_it_is_refused():
    with pytest.raises(mechviz.SceneError, match="'thrust' is missing"):
        mechviz.loads(made('actuator = "S"').replace(', thrust = "10 N"', ""))
