"""Flywheels are sized over whole cycles of the machine, not of its drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from loaded import run
from mechanisms import four_bar

import mechviz
from mechcore.errors import MechanismError
from mechcore.forces.powers import flywheel
from mechcore.laws.timed import Table
from mechcore.spec.loads import Factor, Torque
from mechviz.runs import run_scene

GEARED = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
[links]
frame = { points = { A = [0, 0], M = [-90, 0] } }
motor = { points = { M = [0, 0] } }
crank = { points = { A = [0, 0], B = [60, 0] }, mass = "0.4 kg", centre = [0, 0], inertia = "0.001 kg m^2" }
rod = { points = { B = [0, 0], P = [220, 0] }, mass = "0.5 kg", centre = [100, 0], inertia = "0.002 kg m^2" }
piston = { points = { P = [0, 0] }, mass = "0.7 kg" }
[joints]
M = { revolute = ["frame", "motor"], drive = { speed = "600 rpm" } }
A = { revolute = ["frame", "crank"] }
G = { gear = ["motor", "crank"], teeth = [20, 40] }
B = { revolute = ["crank", "rod"] }
P = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["A", "P"], along = [1, 0], branch = "ahead" }
[loads.W]
force = ["-500 N", 0]
on = "piston"
at = "P"
table = { velocity = ["-10 mm/s", "10 mm/s"], factor = [0, 1], joint = "S" }
[sketch]
crank = { at = [0, 0], angle = 0 }
"""


def test_the_flywheel_of_a_crank_geared_down_is_that_of_two_turns_of_its_motor():
    """Half the motor's speed: kinetic energy of crank, rod and piston, and 500 N on the way out, over a turn of the crank."""
    scene = mechviz.loads(GEARED)
    with pytest.raises(MechanismError, match=r"after the run, of 0.1 s, link rod is not as it was.*--cycles 2"):
        flywheel(run_scene(scene).forces, 0.02)
    phi = np.linspace(0.0, 2.0 * np.pi, 20001)
    w, r, length = 10.0 * np.pi, 0.06, 0.22
    beta = np.arcsin(r * np.sin(phi) / length)
    turning = w * r * np.cos(phi) / (length * np.cos(beta))  # of the rod, clockwise
    velocity = -w * r * np.sin(phi) - length * np.sin(beta) * turning
    sx, sy = -w * r * np.sin(phi) - 0.1 * np.sin(beta) * turning, w * r * np.cos(phi) - 0.1 * np.cos(beta) * turning
    kinetic = 0.5 * (0.001 * w**2 + 0.5 * (sx**2 + sy**2) + 0.002 * turning**2 + 0.7 * velocity**2)
    x = r * np.cos(phi) + length * np.cos(beta)
    taken = kinetic - kinetic[0] + 500.0 * np.where(phi > np.pi, x - x[len(x) // 2], 0.0)
    excess = np.ptp(taken - 60.0 * phi / (2.0 * np.pi))
    wheel = flywheel(run_scene(scene, cycles=2, frames=1440).forces, 0.02)
    assert wheel.mean == pytest.approx(60.0 / (4.0 * np.pi), rel=1e-4)
    assert wheel.inertia == pytest.approx(excess / (0.02 * (20.0 * np.pi) ** 2), rel=1e-3)
    assert wheel.inertia == pytest.approx(0.422, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GEARED.replace('speed = "600 rpm"', 'speed = "600 rpm", travel = 240'), "link rod is not.*--cycles 3"),
        (GEARED.replace("teeth = [20, 40]", "teeth = [37, 163]"), "link rod is not.*No number of cycles up to 120"),
        (mechviz.load("four-stroke-cycle").text.replace("cycles = 2", "cycles = 1"), "load gas on link piston is not.*--cycles 2"),
    ],
    ids=["a part of a turn", "gears", "four strokes"],
)
def test_flywheels_of_runs_after_which_the_machine_is_not_back_are_refused(text, message):
    with pytest.raises(MechanismError, match=message):
        flywheel(run_scene(mechviz.loads(text)).forces, 0.02)


@pytest.mark.parametrize(("period", "cycles"), [(0.1, None), (0.25, 5), (0.3, 3)])
def test_a_load_that_repeats_in_time_has_to_be_back_too(period, cycles):
    """A shaft of 10 turns a second."""
    factor = Factor(of="time", function=Table((0.0, 0.04), (0.0, 1.0), period=period))
    m = four_bar(E=(4.0, 0.0), AB=1.0, BD=3.5, DE=3.0, speed=20.0 * np.pi)
    forces = run(replace(m, effects=(), loads=(Torque(name="M", link="crank", moment=-2.0, factor=factor),)), 40)
    if cycles is None:
        assert flywheel(forces, 0.02).mean == pytest.approx(1.0, rel=1e-3)
    else:
        with pytest.raises(MechanismError, match=f"load M on link crank is not.*--cycles {cycles}"):
            flywheel(forces, 0.02)


def test_a_balanced_wheel_may_stand_anywhere_after_a_cycle():
    """A fan that a slider-crank turns by gears of 37 and 163 teeth changes no excess work."""
    text = GEARED.replace("teeth = [20, 40]", "teeth = [20, 20]")
    fan = text.replace(
        "piston = {", 'fan = { points = { F = [0, 0] }, mass = "3 kg", centre = [0, 0], inertia = "0.1 kg m^2" }\npiston = {'
    )
    fan = fan.replace("M = [-90, 0] }", "M = [-90, 0], F = [0, 300] }").replace(
        "B = { rev", 'F = { revolute = ["frame", "fan"] }\nH = { gear = ["crank", "fan"], teeth = [37, 163] }\nB = { rev'
    )
    plain, more = (flywheel(run_scene(mechviz.loads(x)).forces, 0.02) for x in (text, fan))
    assert more.inertia == pytest.approx(plain.inertia, rel=1e-9) and plain.mean == pytest.approx(60.0 / (2.0 * np.pi), rel=1e-3)


def test_a_motion_under_forces_has_to_come_back_as_far_as_it_settles():
    text = mechviz.load("loose-coupler-pin").text
    assert flywheel(run_scene(mechviz.loads(text)).forces, 0.02).inertia == pytest.approx(0.077, rel=0.05)
    with pytest.raises(MechanismError, match=r"at the end of the run, of 0.3 s, link rod is not where it was"):
        flywheel(run_scene(mechviz.loads(text.replace("0.4 s", "0.3 s"))).forces, 0.02)
