"""Motors, governors and brakes against closed forms, in the core and from scenes; bends of laws are ends of windows."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import mechviz
from mechcore.dynamics.simulate import simulate
from mechcore.effects.machines import Induction
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import ConstantSpeed, Free, Table
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import ConstantPower, DcMotor, Factor, Governor, InductionMotor, Load, Torque
from mechcore.spec.mechanism import Drive, Friction, Link, Mechanism, Revolute
from mechviz.runs import run_scene

INERTIA = 0.5
TIMES = np.linspace(0.0, 3.0, 61)


def wheel(load: Load | None = None, *, speed: float = 0.0, friction: Friction | None = None) -> Mechanism:
    return Mechanism(
        name="wheel",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0)}), Link(name="wheel", points={"O": (0.0, 0.0)}, inertia=INERTIA)),
        joints=(Revolute(name="O", links=("frame", "wheel"), points=("O", "O"), friction=friction),),
        drives=(Drive(joint="O", law=Free(0.0, speed)),),
        effects=("inertia",) if friction is None else ("inertia", "friction"),
        loads=() if load is None else (load,),
    )


def speeds(mechanism: Mechanism) -> np.ndarray:
    return simulate(mechanism, TIMES[-1], tolerance=1e-11)(TIMES)[1][:, 0]


@pytest.mark.parametrize("on", [{"link": "wheel"}, {"joint": "O"}])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_dc_motor_starts_up_exponentially(on: dict[str, str], way: float):
    motor = DcMotor(name="motor", **on, stall_torque=20.0 * way, no_load_speed=150.0 * way)  # type: ignore[arg-type]
    expected = 150.0 * way * (1.0 - np.exp(-20.0 * TIMES / (INERTIA * 150.0)))
    assert speeds(wheel(motor)) == pytest.approx(expected, abs=1e-9)


def test_induction_motor_starts_up_by_kloss():
    """J ws ds/dt = -2 Mb / (s / sb + sb / s), integrated: t = J ws / (2 Mb) ((1 - s^2) / (2 sb) - sb ln s)."""
    breakdown, most, synchronous = 60.0, 0.2, 157.0
    motor = InductionMotor(name="m", joint="O", breakdown_torque=breakdown, breakdown_slip=most, synchronous_speed=synchronous)
    slip = 1.0 - speeds(wheel(motor)) / synchronous
    time = INERTIA * synchronous / (2.0 * breakdown) * ((1.0 - slip**2) / (2.0 * most) - most * np.log(slip))
    assert time == pytest.approx(TIMES, abs=1e-9)


def test_kloss_has_its_greatest_torque_at_the_breakdown_slip():
    motor = InductionMotor(name="m", joint="O", breakdown_torque=60.0, breakdown_slip=0.2, synchronous_speed=-157.0)
    w = np.linspace(-200.0, 50.0, 25001)
    torque = Induction(motor).torque(w)
    assert torque.min() == pytest.approx(-60.0, rel=1e-6)
    assert w[np.argmin(torque)] == pytest.approx(-157.0 * 0.8, abs=0.02)
    assert Induction(motor).torque(np.array([-157.0]))[0] == 0.0


def test_constant_power_after_the_limit():
    power, limit = 1000.0, 50.0
    corner = power / limit
    until = corner * INERTIA / limit
    late = np.sqrt(corner**2 + 2 * power * np.maximum(TIMES - until, 0) / INERTIA)
    expected = np.where(until > TIMES, limit / INERTIA * TIMES, late)
    for way in (1.0, -1.0):
        machine = ConstantPower(name="m", joint="O", power=power, torque_limit=way * limit)
        assert speeds(wheel(machine)) == pytest.approx(way * expected, abs=1e-9)


def test_governor_reaches_its_set_speed():
    governor = Governor(name="g", joint="O", set_speed=30.0, gain=2.0, least=0.0, most=10.0)
    until = (30.0 - 10.0 / 2.0) * INERTIA / 10.0
    late = 30.0 - 5.0 * np.exp(-2.0 / INERTIA * np.maximum(TIMES - until, 0.0))
    assert speeds(wheel(governor)) == pytest.approx(np.where(until > TIMES, 10.0 / INERTIA * TIMES, late), abs=1e-9)


def test_a_brake_stops_and_holds():
    """A constant torque against the motion, then as much as is needed: the load is less than the brake."""
    load = Torque(name="load", link="wheel", moment=2.0)
    simulation = simulate(wheel(load, speed=10.0, friction=Friction(brake=5.0)), 6.0, tolerance=1e-11)
    stop = 10.0 * INERTIA / (5.0 - 2.0)
    assert simulation.events[-1].kind == "stick" and simulation.events[-1].time == pytest.approx(stop, abs=1e-9)
    t = np.linspace(0.0, 6.0, 62)
    assert simulation(t)[1][:, 0] == pytest.approx(np.maximum(10.0 - 6.0 * t, 0.0), abs=1e-9)
    forces = simulation.forces(simulation.motion(t))
    assert forces.friction.applied("O")[:, 2] == pytest.approx(np.where(t < stop, -5.0, -2.0))


def test_a_brake_in_a_driven_joint_costs_its_torque():
    driven = dataclasses.replace(wheel(friction=Friction(brake=5.0)), drives=(Drive(joint="O", law=ConstantSpeed(0.0, 3.0)),))
    forces = solve_forces(solve_motion(compile_mechanism(driven), np.linspace(0.0, 1.0, 5)))
    assert forces.effort("O") == pytest.approx(np.full(5, 5.0))


def test_windows_end_where_a_table_bends():
    """A torque of straight lines over time: the speed is its integral, exactly, and the balance keeps the tolerance."""
    table = Table(x=(0.0, 0.31, 0.32, 0.9), y=(0.0, 1.0, -1.0, 0.5), smooth=False)
    load = Torque(name="pull", link="wheel", moment=3.0, factor=Factor(function=table, of="time"))
    simulation = simulate(wheel(load), 3.0, tolerance=1e-9)
    t = np.array([0.31, 0.32, 0.9, 3.0])
    area = np.cumsum([0.155, 0.0, -0.145, 0.5 * 2.1])
    assert simulation(t)[1][:, 0] == pytest.approx(3.0 / INERTIA * area, abs=1e-10)
    starts = np.array([w.start for w in simulation.segments[0].solution.windows])
    for bend in table.x[1:]:
        assert np.abs(starts - bend).min() < 1e-9
    assert np.abs(simulation.drift(TIMES)).max() < 1e-9


SCENE = """
title = "start"
effects = ["inertia"]
[run]
duration = "1 s"
frames = 50
[links]
frame = { points = { O = [0, 0] } }
wheel = { points = { O = [0, 0] }, mass = 1, centre = "O", inertia = 0.5 }
[joints]
O = { revolute = ["frame", "wheel"], free = { position = 0 } }
[loads]
motor = { MOTOR }
"""
KINDS = {
    "dc": 'dc_motor = "O", stall_torque = "20 N m", no_load_speed = "1500 rpm"',
    "ac": 'induction_motor = "wheel", breakdown_torque = 60, breakdown_slip = 0.2, synchronous_speed = "1500 rpm"',
    "power": 'constant_power = "O", power = "1 kW", torque_limit = "50 N m"',
    "governor": 'governor = "O", set_speed = "300 rpm", gain = "2 N m s/rad", limits = [0, "10 N m"]',
}


@pytest.mark.parametrize("kind", KINDS)
def test_machines_in_scenes_drive_and_are_written_back(kind: str):
    scene = mechviz.loads(SCENE.replace("MOTOR", KINDS[kind]))
    assert mechviz.loads(scene.to_toml()) == scene
    run = run_scene(scene)
    assert np.abs(run.simulation.drift(run.motion.time)).max() < 1e-8
    assert run.motion.coordinate("O")[-1, 1] > 10.0


@pytest.mark.parametrize(
    ("kind", "old", "new", "words"),
    [
        ("dc", '"O"', '"P"', "there is no joint 'P'"),
        ("dc", "1500", "-1500", "opposite directions"),
        ("dc", '"20 N m"', '"20 N"', "loads.motor.stall_torque"),
        ("dc", ', no_load_speed = "1500 rpm"', "", "'no_load_speed' is missing"),
        ("dc", '"O"', '"frame"', "is the fixed link"),
        ("governor", "[0, ", "[20, ", "no less than"),
        ("power", "1 kW", "-1 kW", "is negative"),
        ("ac", "0.2", "0", "0 is not positive"),
    ],
)
def test_faults_of_machines_in_scenes(kind: str, old: str, new: str, words: str):
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(SCENE.replace("MOTOR", KINDS[kind].replace(old, new)))
    assert words in " ".join(str(error.value).split())


def test_the_core_refuses_machines_that_make_no_sense():
    for load, words in (
        (DcMotor(name="m", stall_torque=1.0, no_load_speed=1.0), "a link or on a joint"),
        (DcMotor(name="m", joint="X", stall_torque=1.0, no_load_speed=1.0), "no revolute joint"),
        (DcMotor(name="m", joint="O", stall_torque=1.0, no_load_speed=0.0), "is zero"),
        (Governor(name="m", joint="O", set_speed=1.0, gain=1.0, least=1.0, most=0.0), "no less than"),
    ):
        with pytest.raises(MechanismError, match=words):
            simulate(wheel(load), 1.0)
