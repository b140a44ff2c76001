"""Steady runs found directly: closed forms, long simulations, the usual flywheel formula in its limit, scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import mechviz
from mechcore.dynamics.rest.steady import size_flywheel, steady_run, with_flywheel
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.laws.timed import Free
from mechcore.spec.loads import DcMotor, Factor, Load, Torque, Viscous
from mechcore.spec.mechanism import Drive, Friction, Link, Mechanism, Revolute
from mechviz.commands.main import app
from mechviz.runs import run_scene

TURN = 2 * np.pi


def wheel(*loads: Load, speed: float = 10.0, inertia: float = 2.0, **more) -> Mechanism:
    return Mechanism(
        name="wheel",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            Link(name="rotor", points={"O": (0.0, 0.0)}, mass=1.0, inertia=inertia),
        ),
        joints=(Revolute(name="O", links=("frame", "rotor"), points=("O", "O"), **more),),
        drives=(Drive(joint="O", law=Free(0.3, speed)),),
        effects=("inertia", "friction") if more else ("inertia",),
        loads=loads,
    )


def lobes(size: float, mean: float = 0.0) -> Torque:
    """-(mean + size cos 2 phi)."""
    return Torque(
        name="lobes",
        link="rotor",
        moment=-1.0,
        factor=Factor(function=lambda q: mean + size * np.cos(2 * q), of="position", joint="O"),
    )


def test_without_losses_every_speed_is_steady_and_the_stated_one_is_taken():
    """J w^2 / 2 = E - (size / 2) sin 2 phi."""
    run = steady_run(wheel(lobes(40.0)))
    x = np.linspace(0.0, TURN, 50)
    phi = 0.3 + x
    expected = np.sqrt(100.0 - 2 / 2.0 * 20.0 * (np.sin(2 * phi) - np.sin(0.6)))
    assert run(x) == pytest.approx(expected, rel=1e-11)
    assert run.multiplier == pytest.approx(1.0, abs=1e-9)
    assert run.greatest == pytest.approx(np.sqrt(100.0 + 20.0 * (1 + np.sin(0.6))), rel=1e-11)
    assert run.least == pytest.approx(np.sqrt(100.0 - 20.0 * (1 - np.sin(0.6))), rel=1e-11)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_constant_torque_and_oil_run_evenly_with_the_closed_multiplier(sense: float):
    """w = T / c; w^2 relaxes along the way as exp(-c / (J w) phi), to first order: its disturbance by exp(-2 pi c / (J w))."""
    run = steady_run(
        wheel(Torque(name="T", link="rotor", moment=6.0 * sense), Viscous(name="c", joint="O", coefficient=0.4), speed=sense)
    )
    assert run.speed == pytest.approx(15.0 * sense, rel=1e-12) and run.fluctuation < 1e-12
    assert run.period == pytest.approx(TURN / 15.0, rel=1e-12)
    assert run.multiplier == pytest.approx(np.exp(-TURN * 0.4 / (2.0 * 15.0)), rel=1e-8)


def started(name: str) -> Mechanism:
    return mechviz.load(name).mechanism


@pytest.mark.parametrize("name", ["compressor-start-up", "crushing-press", "crusher-steady"])
def test_a_cycle_simulated_from_it_comes_back(name: str):
    mechanism = started(name)
    run = steady_run(mechanism)
    (drive,) = mechanism.drives
    simulation = simulate(replace(mechanism, drives=(replace(drive, law=Free(run.start, run.speed)),)), run.period, tolerance=1e-11)
    q, v, _ = simulation(np.linspace(0.0, run.period, 200))
    assert q[-1, 0] - q[0, 0] == pytest.approx(TURN, rel=1e-9)
    assert v[-1, 0] == pytest.approx(v[0, 0], rel=1e-9)
    assert v[:, 0] == pytest.approx(run(q[:, 0] - run.start), rel=1e-8)
    assert v[:, 0].max() <= run.greatest * (1 + 1e-9) and v[:, 0].min() >= run.least * (1 - 1e-9)


@pytest.mark.thorough
def test_a_long_simulation_from_rest_ends_in_it():
    mechanism = started("compressor-start-up")
    run = steady_run(mechanism)
    simulation = simulate(mechanism, 4.0, tolerance=1e-9)
    t = np.linspace(4.0 - run.period, 4.0, 2000)
    speed = simulation(t)[1][:, 0]
    assert speed.max() == pytest.approx(run.greatest, rel=1e-5) and speed.min() == pytest.approx(run.least, rel=1e-5)
    assert TURN / np.trapezoid(np.ones_like(t), t) == pytest.approx(run.mean, rel=1e-12)
    assert 0.0 < run.multiplier < 1.0


def test_dry_friction_is_that_of_the_simulation():
    """A brake of 3 N m beside a motor: w from the motor's line; and friction by reaction in a slider-crank."""
    run = steady_run(
        wheel(DcMotor(name="m", joint="O", stall_torque=9.0, no_load_speed=30.0), lobes(2.0), friction=Friction(brake=3.0))
    )
    assert run.mean == pytest.approx(20.0, rel=1e-3)
    text = mechviz.load("crushing-press").text.replace(
        'effects = ["inertia", "gravity"]', 'effects = ["inertia", "gravity", "friction"]'
    )
    text = text.replace('branch = "ahead" }', 'branch = "ahead", friction = { coefficient = 0.1 } }')
    rubbing = mechviz.loads(text).mechanism
    smooth, run = steady_run(started("crushing-press")), steady_run(rubbing)
    assert run.mean < smooth.mean * (1 - 1e-4)
    (drive,) = rubbing.drives
    simulation = simulate(replace(rubbing, drives=(replace(drive, law=Free(run.start, run.speed)),)), run.period, tolerance=1e-8)
    assert simulation([run.period])[1][0, 0] == pytest.approx(run.speed, rel=1e-6)


def test_sizing_approaches_the_usual_formula_as_the_fluctuation_gets_small():
    """Excess work of the lobes: 10 J; J = 10 / (delta w^2); off by a part that is proportional to delta."""
    motor = DcMotor(name="m", joint="O", stall_torque=60.0, no_load_speed=30.0)
    machine = wheel(motor, lobes(10.0, 20.0), inertia=1e-3)
    off = []
    for delta in (0.02, 0.01, 0.005):
        sized = size_flywheel(machine, delta)
        assert sized.run.fluctuation == pytest.approx(delta, rel=1e-8) and sized.link == "rotor"
        off.append(abs((sized.inertia + 1e-3) * delta * sized.run.mean**2 / 10.0 - 1.0))
    assert off[0] < 0.03
    assert off[2] < 0.6 * off[1] < 0.4 * off[0]


def test_a_flywheel_that_is_large_enough_is_left_alone_and_one_that_stalls_is_found():
    machine = wheel(DcMotor(name="m", joint="O", stall_torque=60.0, no_load_speed=30.0), lobes(10.0, 20.0), inertia=50.0)
    assert size_flywheel(machine, 0.05).inertia == 0.0
    light = wheel(DcMotor(name="m", joint="O", stall_torque=12.0, no_load_speed=30.0), lobes(25.0, 5.0), inertia=1e-3)
    with pytest.raises(MechanismError, match="does not get through the cycle"):
        steady_run(light)
    sized = size_flywheel(light, 0.05)
    assert steady_run(with_flywheel(light, sized.inertia)).fluctuation == pytest.approx(0.05, rel=1e-8)


def test_what_has_no_steady_run_is_refused_in_words():
    with pytest.raises(MechanismError, match="brake at every speed"):
        steady_run(wheel(Viscous(name="c", joint="O", coefficient=0.4)))
    with pytest.raises(MechanismError, match="drive more than they brake at every speed"):
        steady_run(wheel(Torque(name="T", link="rotor", moment=6.0)))
    with pytest.raises(MechanismError, match="depends on time"):
        steady_run(wheel(Torque(name="T", link="rotor", moment=6.0, factor=Factor(function=np.sin, of="time"))))
    with pytest.raises(MechanismError, match="one free joint that turns"):
        steady_run(started("swinging-double-pendulum"))


GEARED = """
run = { steady = 2 }
effects = ["inertia"]
[links]
frame = { points = { A = [0, 0], M = [-0.09, 0] } }
motor = { points = { M = [0, 0] }, mass = "1 kg", centre = [0, 0], inertia = "0.01 kg m^2" }
crank = { points = { A = [0, 0], B = [0.06, 0] }, mass = "0.4 kg", centre = [0, 0], inertia = "0.001 kg m^2" }
rod = { points = { B = [0, 0], P = [0.22, 0] }, mass = "0.5 kg", centre = [0.1, 0], inertia = "0.002 kg m^2" }
piston = { points = { P = [0, 0] }, mass = "0.7 kg" }
[joints]
M = { revolute = ["frame", "motor"], free = { position = 0, speed = "600 rpm" } }
A = { revolute = ["frame", "crank"] }
G = { gear = ["motor", "crank"], teeth = [20, 40] }
B = { revolute = ["crank", "rod"] }
P = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["A", "P"], along = [1, 0], branch = "ahead" }
[sketch]
crank = { at = [0, 0], angle = 0 }
[loads]
motor = { dc_motor = "M", stall_torque = "40 N m", no_load_speed = "700 rpm" }
W = { force = ["-500 N", 0], on = "piston", at = "P", table = { velocity = [-0.05, 0.05], factor = [0, 1], joint = "S" } }
"""


def test_a_crank_geared_down_is_back_after_two_turns_of_its_motor():
    """Lagrange's equation of the motor's angle q, the crank at -q / 2, integrated by scipy over eight turns."""
    mechanism = mechviz.loads(GEARED).mechanism
    with pytest.raises(MechanismError, match=r"after 1 turn link rod is not as it was.*Give 2 turns.*--steady 2"):
        steady_run(mechanism)
    with pytest.raises(MechanismError, match="after 1 turn link rod"):
        size_flywheel(mechanism, 0.1)
    r, length = 0.06, 0.22

    def per_speed(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inertia [kg m^2] and velocity of the piston [m] at a speed of 1."""
        phi, w = -0.5 * q, -0.5
        beta = np.arcsin(r * np.sin(phi) / length)
        turning = w * r * np.cos(phi) / (length * np.cos(beta))
        x, y = -w * r * np.sin(phi) - 0.1 * np.sin(beta) * turning, w * r * np.cos(phi) - 0.1 * np.cos(beta) * turning
        piston = -w * r * np.sin(phi) - length * np.sin(beta) * turning
        return 0.01 + 0.001 * w**2 + 0.5 * (x**2 + y**2) + 0.002 * turning**2 + 0.7 * piston**2, piston

    def rate(_, state: np.ndarray) -> list[float]:
        q, v = state
        inertia, piston = per_speed(q)
        slope = (per_speed(q + 1e-5)[0] - per_speed(q - 1e-5)[0]) / 2e-5
        load = 500.0 * np.clip(0.5 + piston * v / 0.1, 0.0, 1.0) * piston
        return [v, (40.0 * (1.0 - v / (70.0 * np.pi / 3.0)) - load - 0.5 * slope * v**2) / inertia]

    def passes(number: int):
        def reached(_, state: np.ndarray) -> float:
            return state[0] - number * TURN

        return reached

    reached = [passes(6), passes(8)]
    long = solve_ivp(rate, (0.0, 1.2), [0.0, 60.0], rtol=1e-9, atol=1e-9, max_step=1e-3, events=reached, dense_output=True)
    begin, end = (float(times[0]) for times in long.t_events)
    speeds = long.sol(np.linspace(begin, end, 20001))[1]
    run = steady_run(mechanism, turns=2)
    assert run.mean == pytest.approx(2.0 * TURN / (end - begin), rel=1e-6)
    assert (run.least, run.greatest) == pytest.approx((speeds.min(), speeds.max()), rel=1e-5)
    assert run.mean * 30.0 / np.pi == pytest.approx(603.41, abs=0.01)


def test_an_engine_of_four_strokes_is_back_after_two_turns():
    with pytest.raises(MechanismError, match=r"after 1 turn load gas on link piston is not as it was.*--steady 2"):
        steady_run(started("engine-start-up"))
    assert steady_run(started("engine-start-up"), turns=2).fluctuation == pytest.approx(0.1666, abs=1e-4)


def test_the_scene_starts_in_it_and_lasts_a_cycle():
    scene = mechviz.load("crusher-steady")
    assert mechviz.loads(scene.to_toml()) == scene
    run = run_scene(scene)
    assert run.steady is not None and run.motion.time[-1] == pytest.approx(run.steady.period, rel=1e-12)
    speed = run.motion.coordinate("A")[:, 1]
    assert speed[-1] == pytest.approx(speed[0], rel=1e-8)
    energy = run.forces.energy
    assert energy[-1, 2] == pytest.approx(energy[-1, 3], rel=1e-7)  # what the motor and the rock leave is lost in the bearings
    printed = CliRunner().invoke(app, ["forces", "crusher-steady", "--steady", "1", "--flywheel", "0.03"])
    assert printed.exit_code == 0 and "coefficient of fluctuation 0.0557" in printed.output
    assert "flywheel: 16.2" in printed.output
    driven = scene.text.replace('free = { position = 90, speed = "250 rpm" }', 'drive = { speed = "250 rpm" }')
    with pytest.raises(mechviz.SceneError, match="nothing is free"):
        mechviz.loads(driven)
    two = CliRunner().invoke(app, ["forces", "swinging-double-pendulum", "--steady", "1"])
    assert two.exit_code == 2 and "one free joint" in two.output
