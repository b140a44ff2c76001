"""Drives and targets of servos in motions under forces: what knocks, and what ends before the run does, is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mechviz
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.laws.course import end_time, first_velocity_jump
from mechcore.laws.timed import ConstantSpeed, Law, Oscillation, Rest, TableLaw, zones

CART = """
effects = ["inertia", "gravity"]
run = {{ duration = "{duration} s" }}
[links]
frame = {{ points = {{ S = [0, 0] }} }}
cart = {{ points = {{ S = [0, 0], P = [0, 0] }}, mass = 2, shape = "point" }}
bob = {{ points = {{ P = [0, 0], Q = [0, -1] }}, mass = 1, centre = "Q", inertia = 0 }}
[joints]
S = {{ prismatic = ["frame", "cart"], {cart} }}
P = {{ revolute = ["cart", "bob"], free = {{ position = 0 }} }}
{loads}
"""
FLIGHT = """
effects = ["inertia", "gravity"]
run = { duration = 2 }
[links]
frame = { points = { A = [0, 0] } }
crank = { points = { A = [0, 0], B = [0.1, 0] }, mass = 1, centre = [0.02, 0], inertia = 0.01 }
rod = { points = { B = [0, 0], C = [0.3, 0] }, mass = 1, centre = [0.1, 0], inertia = 0.01 }
piston = { points = { C = [0, 0] }, mass = 2 }
body = { points = { P = [0, 0] }, mass = 1, inertia = 0.1 }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "600 rpm" } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["A", "C"], branch = "ahead" }
T = { planar = ["frame", "body"], free = { vy = 4, omega = 2 } }
"""
RISE = '{ duration = "0.5 s", to = 0.3, law = "constant-velocity" }'
PROGRAM = (
    '{ start = 0, program = { speed = "60 rpm", segments = [{ over = "90 deg", to = 0.3LAW }, { over = "270 deg", to = 0 }] } }'
)
ZONES = '{ start = 0, speed = "0.5 m/s", zones = { run_up = 0.1, steady = 0.3 } }'
TABLE = "{ table = { time = [1, 1.5, 2], position = [0, 0.3, 0.4] } }"
RANGE = '{ speed = "0.5 m/s", range = [0, 0.5] }'


def law_of(drive: str) -> Law:
    return mechviz.loads(CART.format(duration=0.1, cart=f"drive = {drive}", loads="")).mechanism.drives[0].law


@pytest.mark.parametrize(
    ("drive", "knock"),
    [
        (f'{{ start = 0, segments = [{RISE}, {{ duration = "0.5 s" }}] }}', 0.5),
        ('{ start = 0, segments = [{ duration = "0.5 s", to = [0.3, 0.5] }] }', 0.5),  # and from rest again
        (PROGRAM.replace("LAW", ', law = "constant-velocity"'), 0.25),
        (ZONES, 1.0),
    ],
)
def test_a_drive_whose_speed_jumps_beside_a_free_joint_is_refused(drive: str, knock: float):
    """The impact on the pendulum was left out: of the energy up to nine tenths were missing. Up to the jump it balances."""
    assert first_velocity_jump(law_of(drive), 10.0) == pytest.approx(knock, abs=1e-12)
    short, longer = (CART.format(duration=t, cart=f"drive = {drive}", loads="") for t in (knock, 1.1 * knock))
    with pytest.raises(mechviz.SceneError, match=rf"joints.S.drive +its speed jumps at {knock:g} s"):
        mechviz.loads(longer)
    mechanism = mechviz.loads(short).mechanism
    with pytest.raises(MechanismError, match=rf"joints.S.drive: its speed jumps at {knock:g} s"):
        simulate(mechanism, 1.1 * knock)
    run = simulate(mechanism, knock)
    assert np.abs(run.drift(np.linspace(0.0, knock, 21))).max() < 1e-9


@pytest.mark.parametrize(
    "law",
    [
        law_of(f"{{ start = 0, segments = [{RISE}, {RISE.replace('0.3', '0.6')}] }}"),
        law_of(PROGRAM.replace("LAW", "")),
        law_of(PROGRAM.replace("LAW", ', law = "parabolic"')),
        law_of('{ speed = "0.2 m/s", ramp = { begin = "0.3 s", end = "0.300001 s" } }'),
        law_of('{ speed = "0.2 m/s", chirp = { frequencies = ["1 Hz", "20 Hz"], duration = "0.7 s" } }'),
        law_of(TABLE),
        zones(start=0.0, speed=-0.5, run_up=0.1, steady=0.0, braking=0.2),
        TableLaw((0.0, 0.4, 0.5, 0.9, 1.0), (0.0, 0.1, 0.4, 0.2, 0.0), periodic=True),
        Oscillation(0.0, 0.1, 3.0),
        Rest(0.3),
        ConstantSpeed(0.0, 0.0),
    ],
)
def test_laws_of_continuous_velocity_do_not_knock(law: Law):
    assert first_velocity_jump(law, 10.0) is None


@pytest.mark.parametrize(("drive", "end"), [(TABLE, 1.0), (RANGE, 1.0), (RANGE.replace('"0.5', '"-0.5'), 1.0), (ZONES, math.inf)])
def test_a_law_that_ends_before_the_run_is_refused(drive: str, end: float):
    """A polynomial went on beyond its table, a drive beyond its range; as the target of a servo likewise."""
    assert end_time(law_of(drive)) == pytest.approx(end)
    servo = f'loads = {{ s = {{ servo = "S", target = {drive}, proportional = "50 N/m" }} }}'
    led, driven = (CART.format(duration=0.9, cart=x, loads="") for x in ("free = {}", f"drive = {drive}"))
    for scene, path in ((servo + led, "loads.s.target"), (driven, "joints.S.drive")):
        mechanism = mechviz.loads(scene).mechanism
        if math.isfinite(end):
            with pytest.raises(MechanismError, match=rf"run.duration: 1.5 s are wanted, and {path} ends after 1 s"):
                simulate(mechanism, 1.5)
        elif path.startswith("loads"):  # a target may jump: its error does
            assert np.abs(simulate(mechanism, 1.5).drift([1.5])) < 1e-9


def test_a_table_of_three_rows_is_a_parabola():
    """It was two straight lines, with a knock at the middle row of which no acceleration told."""
    t = np.linspace(0.0, 1.0, 11)
    assert np.stack(law_of(TABLE)(t)) == pytest.approx(np.stack([0.8 * t - 0.4 * t * t, 0.8 - 0.8 * t, -0.8 + 0.0 * t]), abs=1e-12)


def test_works_of_a_quick_drive_beside_a_slow_flight():
    """A body flies in few long windows of the integration, in which a crank turns twenty times: nine tenths of the crank's
    work were missing, and the run was refused as one that does not keep its energy."""
    run = simulate(mechviz.loads(FLIGHT).mechanism, 2.0)
    t = np.linspace(0.0, 2.0, 41)
    assert len(run.boundaries()) < 20
    assert np.abs(run.drift(t)).max() < 1e-9
    ((work,),) = run.energies([0.02])[:, 2:3]
    fine = np.linspace(0.0, 0.02, 2001)
    assert work == pytest.approx(np.trapezoid(run.forces(run.view(fine)).power("A"), fine), rel=1e-5)
