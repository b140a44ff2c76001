"""Small vibrations: against closed forms, against the motion that forward dynamics finds, by symmetry; the command."""

from __future__ import annotations

import csv
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from dynamic_mechanisms import chain, double_pendulum, pendulum
from scipy.linalg import expm
from typer.testing import CliRunner

import mechviz
from mechcore.dynamics.events import EndStop
from mechcore.dynamics.rest.equilibrium import find_equilibrium
from mechcore.dynamics.rest.vibrations import small_vibrations
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import Free
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Damper, Drag, Factor, Force, Spring, Torque, TorsionDamper, TorsionSpring
from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic, Revolute
from mechviz.commands.main import app
from mechviz.hard_cases.mechanisms import bars
from mechviz.studies.vibrations import mode_scene, vibration_lines, vibrations_of

TURN = 2.0 * np.pi


def carts(*, masses, springs, dampers=(), start=(0.03, 0.0), loads=(), effects=("inertia",)) -> Mechanism:
    """Carts in a row between two walls; springs and dampers (one more than carts), unstretched at position 0 of all."""
    n = len(masses)
    names = [f"cart{k}" for k in range(n)]
    points = {"W": (-1.0, 0.0), "E": (float(n), 0.0)} | {f"G{k}": (float(k), 0.0) for k in range(n)}
    links = [Link(name="frame", points=points)]
    links += [Link(name=name, points={"P": (0.0, 0.0)}, mass=m) for name, m in zip(names, masses, strict=True)]
    ends = [("frame", "W"), *((name, "P") for name in names), ("frame", "E")]
    between = [((a[0], b[0]), (a[1], b[1])) for a, b in pairwise(ends)]
    made = [
        Spring(name=f"spring{n}", links=k, points=p, stiffness=c, free_length=1.0)
        for n, ((k, p), c) in enumerate(zip(between, springs, strict=True))
    ]
    made += [
        Damper(name=f"damper{n}", links=k, points=p, linear=c)
        for n, ((k, p), c) in enumerate(zip(between, dampers, strict=False))
        if c
    ]
    return Mechanism(
        name="carts",
        frame="frame",
        links=tuple(links),
        joints=tuple(Prismatic(name=f"S{k}", links=("frame", name), points=(f"G{k}", "P")) for k, name in enumerate(names)),
        drives=tuple(Drive(joint=f"S{k}", law=Free(s)) for k, s in enumerate(start)),
        effects=effects,
        loads=(*made, *loads),
    )


def flywheels(inertias, stiffnesses, dampers=()) -> Mechanism:
    """Flywheels on one axis, joined one to the next by torsion springs; nothing holds them to the frame."""
    names = [f"wheel{k}" for k in range(len(inertias))]
    wheels = [Link(name=n, points={"O": (0.0, 0.0)}, mass=1.0, inertia=j) for n, j in zip(names, inertias, strict=True)]
    between = list(pairwise(names))
    loads: list = [
        TorsionSpring(name=f"shaft{k}", links=b, stiffness=c) for k, (b, c) in enumerate(zip(between, stiffnesses, strict=True))
    ]
    loads += [TorsionDamper(name=f"loss{k}", links=b, linear=c) for k, (b, c) in enumerate(zip(between, dampers, strict=False))]
    return Mechanism(
        name="flywheels",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0)}), *wheels),
        joints=tuple(Revolute(name=f"O{k}", links=("frame", n), points=("O", "O")) for k, n in enumerate(names)),
        drives=tuple(Drive(joint=f"O{k}", law=Free(0.2 * k)) for k in range(len(names))),
        effects=("inertia",),
        loads=tuple(loads),
    )


# --- closed forms -----------------------------------------------------------------------------------------------------


def test_physical_double_pendulum_against_its_equations():
    """(M w^2 - K) = 0 with M, K of the textbook in the absolute angles, brought to the relative ones."""
    i = {"L1": 0.5, "a1": 0.2, "m1": 1.3, "J1": 0.04, "a2": 0.35, "m2": 0.7, "J2": 0.03}
    vibrations = small_vibrations(double_pendulum({**i, "theta_1": 0.9, "theta_2": -0.4, "omega_1": 2.0, "omega_2": 0.0}))
    m = np.array(
        [
            [i["J1"] + i["m1"] * i["a1"] ** 2 + i["m2"] * i["L1"] ** 2, i["m2"] * i["L1"] * i["a2"]],
            [i["m2"] * i["L1"] * i["a2"], i["J2"] + i["m2"] * i["a2"] ** 2],
        ]
    )
    k = 9.81 * np.diag([i["m1"] * i["a1"] + i["m2"] * i["L1"], i["m2"] * i["a2"]])
    t = np.array([[1.0, 0.0], [1.0, 1.0]])  # absolute angles from relative ones
    np.testing.assert_allclose(vibrations.inertia, t.T @ m @ t, rtol=1e-12)
    np.testing.assert_allclose(vibrations.stiffness, t.T @ k @ t, rtol=1e-10, atol=1e-10)
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(m, k)))
    np.testing.assert_allclose([x.square for x in vibrations.modes], squares, rtol=1e-10)
    assert vibrations.stability == "stable" and vibrations.equilibrium.position == pytest.approx([-np.pi / 2, 0.0], abs=1e-12)
    np.testing.assert_allclose(vibrations.shapes.T @ vibrations.inertia @ vibrations.shapes, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(
        vibrations.shapes.T @ vibrations.stiffness @ vibrations.shapes, np.diag(squares), atol=1e-9 * squares[1]
    )
    assert np.abs(vibrations.damping).max() == 0.0


def test_two_carts_beat_with_the_sum_and_the_difference_of_their_modes():
    m, k, c = 2.0, 500.0, 60.0
    vibrations = small_vibrations(carts(masses=(m, m), springs=(k, c, k)))
    np.testing.assert_allclose([x.square for x in vibrations.modes], [k / m, (k + 2 * c) / m], rtol=1e-11)
    np.testing.assert_allclose(np.abs(vibrations.shapes), 1.0 / np.sqrt(2.0 * m), rtol=1e-10)
    assert vibrations.shapes[0, 0] * vibrations.shapes[1, 0] > 0 > vibrations.shapes[0, 1] * vibrations.shapes[1, 1]


def test_flywheels_on_a_shaft_have_a_free_mode_and_the_textbook_frequency():
    j, c = (0.3, 0.5), 800.0
    vibrations = small_vibrations(flywheels(j, (c,)))
    assert [x.kind for x in vibrations.modes] == ["neutral", "vibration"] and vibrations.stability == "neutral"
    assert vibrations.modes[0].frequency == 0.0
    assert vibrations.modes[1].square == pytest.approx(c * (1 / j[0] + 1 / j[1]), rel=1e-11)
    assert vibrations.modes[1].shape[0] / vibrations.modes[1].shape[1] == pytest.approx(-j[1] / j[0], rel=1e-9)
    three = small_vibrations(flywheels((0.1,) * 3, (50.0, 50.0)))  # w^2 = 0, c/J, 3 c/J
    np.testing.assert_allclose([x.square for x in three.modes], [0.0, 500.0, 1500.0], rtol=1e-11)


def test_damping_ratios_below_and_above_the_critical_one():
    m, k = 2.0, 800.0  # w = 20
    for ratio in (0.05, 0.7, 3.0):
        vibrations = small_vibrations(carts(masses=(m,), springs=(k, 0.0), dampers=(2.0 * ratio * 20.0 * m,), start=(0.01,)))
        (mode,) = vibrations.modes
        assert mode.damping_ratio == pytest.approx(ratio, rel=1e-9)
        assert mode.damped_frequency * TURN == pytest.approx(20.0 * np.sqrt(max(0.0, 1.0 - ratio**2)), rel=1e-9)
        assert mode.growth == pytest.approx(-20.0 * ratio + 20.0 * np.sqrt(max(0.0, ratio**2 - 1.0)), rel=1e-8)


def test_eigenvalues_of_any_damping_satisfy_the_quadratic_problem():
    """One strong damper on the last of three carts: one joint creeps, modes are no longer decoupled."""
    mechanism = carts(
        masses=(1.0, 2.0, 1.5), springs=(300.0, 200.0, 400.0, 0.0), dampers=(0.0, 1.0, 2.0, 120.0), start=(0.0, 0.01, 0.0)
    )
    vibrations = small_vibrations(mechanism)
    values = np.array([s for x in vibrations.modes for s in x.eigenvalues])
    assert len({complex(round(s.real, 6), round(s.imag, 6)) for s in values}) == 6 and (values.real < 0).all()
    assert sum(values.imag == 0) == 2
    for s in values:
        singular = np.linalg.svd(s * s * vibrations.inertia + s * vibrations.damping + vibrations.stiffness, compute_uv=False)
        assert singular[-1] < 1e-10 * singular[0]
    assert sum(values).real == pytest.approx(-np.trace(np.linalg.solve(vibrations.inertia, vibrations.damping)), rel=1e-9)


def test_quadratic_drag_does_not_damp_small_vibrations():
    mechanism = pendulum(
        inertia=0.2, mass=1.0, distance=0.3, angle=0.4, loads=(Drag(name="air", link="body", point="O", quadratic=3.0),
                                                              Drag(name="spin", link="body", quadratic=2.0, linear=0.01))
    )  # fmt: skip
    vibrations = small_vibrations(mechanism)
    assert vibrations.damping[0, 0] == pytest.approx(0.01, rel=1e-9)
    assert vibrations.modes[0].square == pytest.approx(9.81 * 0.3 / 0.2, rel=1e-10)


# --- against the simulated motion -------------------------------------------------------------------------------------


def linear_motion(result, away, t):
    """The exact solution of the linear equations after letting go at ``away`` from the equilibrium."""
    solve, f = np.linalg.solve, len(result.inertia)
    slopes = [[np.zeros((f, f)), np.eye(f)], [-solve(result.inertia, result.stiffness), -solve(result.inertia, result.damping)]]
    start = np.concatenate([away, np.zeros(f)])
    return np.array([(expm(np.block(slopes) * x) @ start)[:f] for x in t])


@pytest.mark.parametrize("damped", [False, True])
def test_the_simulated_small_motion_is_the_linear_one(damped: bool):
    """Let go at a small distance: what is left of the difference falls with the square of the amplitude."""
    dampers = (6.0, 1.0, 2.0) if damped else ()
    base = carts(masses=(2.0, 3.0), springs=(500.0, 90.0, 300.0), dampers=dampers, start=(0.0, 0.0))
    i = {"L1": 0.5, "a1": 0.2, "m1": 1.3, "J1": 0.04, "a2": 0.35, "m2": 0.7, "J2": 0.03, "omega_1": 0.0, "omega_2": 0.0}
    t = np.linspace(0.0, 2.0, 41)
    errors = []
    for size in (8e-3, 4e-3):
        if damped:
            drives = tuple(Drive(joint=d.joint, law=Free(size * x)) for d, x in zip(base.drives, (1.0, -0.5), strict=True))
            mechanism = replace(base, drives=drives)
            away = size * np.array([1.0, -0.5])
        else:
            mechanism = double_pendulum({**i, "theta_1": size, "theta_2": -0.5 * size})
            away = size * np.array([1.0, -1.5])
        vibrations = small_vibrations(mechanism)
        q = simulate(mechanism, 2.0, tolerance=1e-12)(t)[0] - vibrations.equilibrium.position
        errors.append(np.abs(q - linear_motion(vibrations, away, t)).max() / size)
    if damped:
        assert max(errors) < 1e-9  # its equations are linear
    else:
        assert errors[0] < 2e-3 and errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_a_four_bar_swings_as_its_linearised_equation_says():
    """One freedom past its dead points: the small swing of a closed chain about the place that it falls to."""
    falling = bars(frame=1.0, crank=0.7, coupler=0.6, rocker=0.8, angle=1.2, speed=0.0)
    vibrations = small_vibrations(falling)
    eq = vibrations.equilibrium
    (joint,), (q,) = eq.joints, eq.position
    near = replace(eq.compiled.mechanism, drives=(Drive(joint=joint, law=Free(q + 1e-3)),))
    period = 1.0 / vibrations.modes[0].frequency
    back = simulate(near, period, tolerance=1e-9)(np.array([0.5 * period, period]))[0][:, 0]
    assert (back - q) / 1e-3 == pytest.approx([-1.0, 1.0], abs=2e-3)
    assert vibrations.stability == "stable"


# --- equilibria -------------------------------------------------------------------------------------------------------


def test_an_unstable_equilibrium_is_told_with_its_growth():
    up = pendulum(inertia=0.2, mass=1.0, distance=0.3, angle=np.pi)
    vibrations = small_vibrations(up)
    assert vibrations.stability == "unstable" and vibrations.modes[0].kind == "divergence"
    assert vibrations.stiffness[0, 0] == pytest.approx(-9.81 * 0.3, rel=1e-10)
    assert vibrations.modes[0].growth == pytest.approx(np.sqrt(9.81 * 0.3 / 0.2), rel=1e-9)
    assert np.isnan(vibrations.modes[0].frequency) and np.isnan(vibrations.modes[0].damping_ratio)
    near = pendulum(inertia=0.2, mass=1.0, distance=0.3, angle=np.pi - 0.1)
    assert find_equilibrium(near).position[0] == pytest.approx(-np.pi / 2, abs=1e-10)  # downhill
    assert find_equilibrium(near, seek="nearest").position[0] == pytest.approx(np.pi / 2, abs=1e-10)


def test_upright_four_bars_stand_unstably():
    vibrations = small_vibrations(chain(2))
    assert vibrations.stability == "unstable"
    assert vibrations.stiffness[0, 0] == pytest.approx(-9.81 * (3 * 0.5 + 2 * 1.0), rel=1e-9)


def test_a_follower_force_makes_it_flutter():
    """Two carts, the second pushed by what the first one does: no potential, and one joint of exponents grows."""
    push = Factor(function=lambda x: x, of="x", point=("cart0", "P"))
    loads = (Force(name="push", link="cart1", point="P", vector=(-400.0, 0.0), factor=push),)
    vibrations = small_vibrations(
        carts(masses=(1.0, 1.0), springs=(300.0, 100.0, 310.0), loads=loads, start=(1e-3, 0.0)), seek="nearest"
    )
    assert vibrations.stability == "unstable" and any("no potential" in note for note in vibrations.notes)
    matrix = vibrations.stiffness  # unit masses: exponents are the roots of the eigenvalues of -K
    wanted = np.sqrt(-np.linalg.eigvals(matrix).astype(complex))
    got = max((s for m in vibrations.modes for s in m.eigenvalues), key=lambda s: s.real)
    assert got.real == pytest.approx(np.abs(wanted.real).max(), rel=1e-9)


def test_what_has_no_equilibrium_is_refused_in_words():
    wheel = pendulum(inertia=0.2, mass=1.0, distance=0.0, angle=0.0, loads=(Torque(name="push", link="body", moment=2.0),))
    with pytest.raises(MechanismError, match=r"still push O with 2.*always pushes the same way"):
        small_vibrations(wheel)
    hanging = pendulum(inertia=0.2, mass=1.0, distance=0.3, angle=0.5)
    with pytest.raises(MechanismError, match=r"lies 21.2451° beyond 'shelf'"):
        small_vibrations(hanging, stops=(EndStop(name="shelf", joint="O", at=-1.2, side="lower"),))
    prescribed = replace(hanging, effects=("gravity",))
    with pytest.raises(MechanismError, match="inertia is not named"):
        small_vibrations(prescribed)


def test_a_force_that_jumps_as_the_motion_turns_round_is_refused():
    jump = Factor(function=np.sign, of="vx", point=("cart0", "P"))
    loads = (Force(name="rub", link="cart0", point="P", vector=(-4.0, 0.0), factor=jump),)
    with pytest.raises(MechanismError, match="jumps as the motion turns round"):
        small_vibrations(carts(masses=(1.0, 1.0), springs=(300.0, 100.0, 310.0), loads=loads))


# --- scenes and the command -------------------------------------------------------------------------------------------


def test_in_a_mode_inertia_and_loads_balance_without_the_drives():
    """The effort left to the drives falls with the third power of the amplitude, relative to the torques with the second."""
    scene = mechviz.load("swinging-double-pendulum")
    vibrations = vibrations_of(scene)
    left = []
    for amplitude in (0.04, 0.02):
        mode = mode_scene(scene, vibrations, 2, amplitude=amplitude)
        time = np.linspace(0.0, 1.0 / vibrations.modes[1].frequency, 49)
        motion = solve_motion(compile_mechanism(mode.mechanism), time)
        forces = solve_forces(motion)
        left.append(max(np.abs(forces.effort(p)).max() for p in ("O", "J")) / amplitude)
        for joint, x in zip(vibrations.joints, vibrations.modes[1].shape, strict=True):
            moved = motion.coordinate(joint)[:, 0] - motion.coordinate(joint)[0, 0]
            ratio = moved[12] / (motion.coordinate("O")[12, 0] - motion.coordinate("O")[0, 0])
            assert ratio == pytest.approx(x / vibrations.modes[1].shape[0], rel=1e-9)
    assert left[0] / left[1] == pytest.approx(4.0, rel=0.1)


def test_a_mode_of_a_chain_beside_a_prescribed_drive_and_with_friction():
    scene = mechviz.load("stick-slip-feed")
    vibrations = vibrations_of(scene)
    assert vibrations.modes[0].square == pytest.approx(4000.0 / 12.0, rel=1e-10)
    assert vibrations.modes[0].damping_ratio == pytest.approx(20.0 / (2.0 * np.sqrt(4000.0 * 12.0)), rel=1e-9)
    assert len(vibrations.notes) == 2
    mode = mode_scene(scene, vibrations, 1)
    motion = solve_motion(compile_mechanism(mode.mechanism), np.linspace(0.0, 0.3, 7))
    assert np.ptp(motion.coordinate("R")[:, 0]) < 1e-11 < 1e-3 < np.ptp(motion.coordinate("G")[:, 0])


def test_the_mode_of_a_four_bar_starts_where_another_joint_leads():
    """The triple rocker comes to rest beyond a dead point of its free joint, on another branch of its assembly."""
    scene = mechviz.load("swinging-triple-rocker")
    vibrations = vibrations_of(scene)
    mode = mode_scene(scene, vibrations, 1, amplitude=0.02)
    again = mechviz.loads(mode.to_toml())
    assert again == mode
    motion = solve_motion(compile_mechanism(mode.mechanism), np.zeros(1))
    for link in ("crank", "coupler", "rocker"):
        assert np.abs(motion.pose(link)[0, :2] - vibrations.equilibrium.motion.pose(link)[0, :2]).max() < 1e-9


def test_shapes_of_slides_have_a_largest_part_of_one_and_no_damping_is_zero():
    """Two masses whose damper lies in a node of the first mode: it had 0.9 m, the size of the mechanism, and 7e-30."""
    scene = mechviz.loads("""
units = { length = "mm" }
effects = ["inertia"]
run = { duration = "1 s" }
links.frame.points = { A = [0, 0], B = [900, 0] }
links.m1 = { points = { P = [0, 0] }, mass = 2 }
links.m2 = { points = { Q = [0, 0] }, mass = 3 }
[joints]
S1 = { prismatic = ["frame", "m1"], at = ["A", "P"], free = { position = 310 } }
S2 = { prismatic = ["frame", "m2"], at = ["A", "Q"], free = { position = 600 } }
[loads]
k1 = { spring = ["frame.A", "m1.P"], stiffness = "1 N/mm", free_length = 300 }
k2 = { spring = ["m1.P", "m2.Q"], stiffness = "2 N/mm", free_length = 300 }
k3 = { spring = ["m2.Q", "frame.B"], stiffness = "1.5 N/mm", free_length = 300 }
c = { damper = ["m1.P", "m2.Q"], linear = "5 N s/m" }
""")
    first, second = (line.split() for line in vibration_lines(scene, vibrations_of(scene))[-2:])
    assert first[:3] == ["1", "3.55881", "0"] and first[-2:] == ["1", "1"]
    assert [abs(float(x)) for x in second[-2:]] == pytest.approx([1.0, 2.0 / 3.0], rel=1e-3)


def test_the_command_prints_writes_and_refuses(tmp_path: Path):
    run = CliRunner().invoke(
        app, ["vibrations", "coupled-carts", "--csv", str(tmp_path / "m.csv"), "--mode", "1", "-o", str(tmp_path / "m.toml")]
    )
    assert run.exit_code == 0, run.output
    assert "2.51646" in run.output and "2.80221" in run.output and "stable" in run.output
    rows = list(csv.DictReader((tmp_path / "m.csv").open()))
    assert float(rows[1]["frequency_Hz"]) == pytest.approx(np.sqrt(620.0 / 2.0) / TURN, rel=1e-10)
    assert mechviz.load(tmp_path / "m.toml").mechanism.drives[0].law.duration == pytest.approx(TURN / np.sqrt(250.0))
    for arguments, words in (
        (["crank-rocker"], "nothing can vibrate"),
        (["compressor-start-up"], "still push A"),
        (["coupled-carts", "--mode", "3", "-o", "m.toml"], "from 1 to 2"),
        (["coupled-carts", "--mode", "1"], "needs both"),
        (["coupled-carts", "--mode", "1", "-o", "m.txt"], "neither in .rrd"),
        (["coupled-carts", "--mode", "1", "-o", "m.toml", "--amplitude", "-1"], "no part"),
        (["trip-hammer"], "rests on this stop"),
        (["loose-coupler-pin"], "Leave out the clearance"),
    ):
        run = CliRunner().invoke(app, ["vibrations", *arguments])
        assert run.exit_code == 2 and words in " ".join(run.output.split()), (arguments, run.output)


def test_the_governor_stands_at_the_height_that_its_speed_wants():
    """Porter's governor: h = (m + M) g / (m w^2) whatever the length of the arms, and there its motion ends."""
    scene = mechviz.load("flyball-governor")
    vibrations = vibrations_of(scene)
    height = -vibrations.equilibrium.motion.point("right_arm", "R")[0, 1]
    assert height == pytest.approx((1.5 + 6.0) * 9.81 / 370.11, rel=1e-12)
    simulation = simulate(scene.mechanism, 12.0)
    assert simulation.motion([12.0]).point("sleeve", "P")[0, 1] == pytest.approx(-2.0 * height, rel=1e-6)
