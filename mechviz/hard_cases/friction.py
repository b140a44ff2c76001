"""Hard cases of dry friction: jamming, self-locking, reversal, and normal loads that statics does not determine; under forces
motions that run down, stick-slip, braking, and states in which no acceleration exists."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mechcore.dynamics.simulate import simulate
from mechcore.dynamics.simulation import Simulation
from mechcore.forces.friction.events import friction_events
from mechcore.forces.friction.normal_loads import solve_normal_loads, stability
from mechcore.forces.friction.solve import FrictionResult
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.loads import Factor, Force
from mechcore.spec.mechanism import Drive, Friction, Link, Mechanism, Prismatic, Revolute, Rolling
from mechviz.hard_cases.case import Case, Check, Outcome, check_that, compare, motion_outcome, refusal_outcome
from mechviz.hard_cases.mechanisms import bearing, block, forces_at, gears, incline, pendulum, pin, sleeve, slider_crank
from mechviz.scene.scene import load

G = 9.81


def friction_in(forces: Forces) -> FrictionResult:
    """The friction of forces; they must have some."""
    assert forces.friction is not None
    return forces.friction


def rubbing_joint(joint: Any, friction: Friction) -> Any:
    """A joint, of a kind that can have friction, with ``friction``."""
    return replace(joint, friction=friction)


def _before_the_jam() -> Outcome:
    """Moments about the axis: N b = H x, H (1 - 2 mu x / b) = W; a billionth before x = b / (2 mu)."""
    part = 1.0 - 1e-9
    forces = forces_at(sleeve(part * 0.08 / 0.4, 0.08, 0.2), [0.0], 0.1)
    effort = float(forces.effort("H")[0])
    return motion_outcome(
        forces.motion, f"effort {effort:.6g} N for 30 N", [compare("effort", effort, 30.0 / (1.0 - part), 1e-6)], forces
    )


def _beyond_the_jam() -> Outcome:
    forces = forces_at(sleeve((1.0 + 1e-9) * 0.08 / 0.4, 0.08, 0.2), [0.0], 0.1)
    friction = friction_in(forces)
    checks = [
        check_that("jammed", friction.jammed),
        check_that("by S", friction.jammed_by(0) == ("S",)),
        check_that("no number where there is none", np.isnan(forces.effort("H"))),
        compare("share of the coefficients", friction.movable_share[0], 1.0 / (1.0 + 1e-9), 1e-9),
    ]
    return motion_outcome(
        forces.motion, f"jams; {friction.movable_share[0]:.12g} of the coefficient still moves", checks, events=["jams"]
    )


def _jam_between_frames() -> Outcome:
    """The gallery's sleeve: the time at which the lift's arm reaches b / (2 mu) = 200 mm, found between frames."""
    scene = load("jamming-sleeve")
    m = scene.mechanism
    forces = solve_forces(solve_motion(compile_mechanism(m), default_times(m, 37)))
    jam = next(e for e in friction_events(forces) if e.text.startswith("jams"))
    speed = 0.04  # the cart's, from 40 mm
    return motion_outcome(
        forces.motion, f"jams at {jam.time:.9g} s", [compare("time", jam.time, (0.2 - 0.04) / speed, 1e-6)], events=[jam.text]
    )


def _self_locking() -> Outcome:
    """tan(alpha + rho) up and tan(alpha - rho) down, a thousandth of a degree on either side of alpha = rho."""
    mu, weight = 0.2, 2.0 * G
    rho, checks, states = np.arctan(mu), [], []
    for alpha in (rho - 2e-5, rho + 2e-5):
        up, down = forces_at(incline(alpha, mu), [0.2], 0.1), forces_at(incline(alpha, mu), [0.2], -0.1)
        checks.append(compare("push up", up.effort("H")[0] / weight, np.tan(alpha + rho), 1e-12))
        checks.append(compare("hold", down.effort("H")[0] / weight, np.tan(alpha - rho), 1e-10, scale=1.0))
        states.append(bool(friction_in(up).self_locking[0]))
    checks.append(check_that("locks below, slides above", states == [True, False]))
    return motion_outcome(up.motion, "locks below arctan mu, slides above", checks, up)


def _reversal() -> Outcome:
    """A slider-crank through its dead centre: the friction force of the piston is zero at rest and changes its sign there."""
    m = slider_crank(0.05, 0.18, loads=(Force(name="F", link="piston", point="C", vector=(-9.0, -2.0)),), effects=("friction",))
    m = replace(m, joints=(*m.joints[:-1], rubbing_joint(m.joints[-1], Friction(coefficient=0.2))))
    forces = forces_at(m, [-1e-4, 0.0, 1e-4], 1.0)
    x = friction_in(forces).wrench("S")[:, 0]
    checks = [
        check_that("slips, rests, slips back", friction_in(forces).state("S") == ["slips +", "at rest", "slips -"]),
        check_that("zero at rest", x[1] == 0.0),
        compare("alike on both sides", x[0], -x[2], 1e-3),
    ]
    return motion_outcome(forces.motion, f"{x[0]:.4g}, {x[1]:.4g}, {x[2]:.4g} N", checks, forces, ["at rest"])


def _two_ends() -> Outcome:
    """mu F while the load lies within the bearing, 2 mu F e / b outside: on both sides of the transition."""
    b, mu, checks = 0.08, 0.15, []
    for e in (0.0, 0.04 - 1e-9, 0.04 + 1e-9, 0.1):
        forces = forces_at(bearing(e, Friction(coefficient=mu, length=b)), [0.0], 2.0)
        checks.append(compare(f"e = {e:g}", forces.effort("S")[0], mu * 100.0 * max(1.0, 2.0 * e / b), 1e-13))
    return motion_outcome(forces.motion, f"{forces.effort('S')[0]:.6g} N at e = 0.1 m", checks, forces)


def _one_pin() -> Outcome:
    """|a + b g| = g is a quadratic: loads up to the turning point of the branch, |b| sin(angle) = 1."""
    angle, a = 2.2, 3.0 * np.exp(0.4j)
    size = np.array([0.3, 0.95, 1.1, 1.0 / np.sin(2.2) - 1e-6, 1.0 / np.sin(2.2) + 1e-6, 5.0])
    b = size * np.exp(1j * (angle + 0.4))
    parts = (np.broadcast_to([a.real, a.imag], (6, 1, 2)), np.stack([b.real, b.imag], -1)[:, None, :, None], np.array([True]))
    solution = solve_normal_loads(*parts)
    c = (np.conj(a) * b).real
    with np.errstate(invalid="ignore"):
        want = abs(a) ** 2 / (np.sqrt(c**2 + (1.0 - size**2) * abs(a) ** 2) - c)
    good = size < 1.0 / np.sin(2.2)
    checks = [
        check_that("jams beyond the turn", solution.jammed == ~good),
        compare("loads", solution.loads[good, 0] / want[good], 1.0, 1e-7),
        check_that("stable", stability(*parts, solution.loads)[good] > 0.0),
        compare("share where it ends", solution.movable_share[~good] * size[~good], 1.0 / np.sin(2.2), 1e-6),
    ]
    return Outcome(
        f"loads {np.array2string(solution.loads[good, 0], precision=5)}", tuple(checks), float(solution.residual[good].max())
    )


def _gears() -> Outcome:
    """Tooth force F from the moments on the second wheel, on either flank."""
    lever, r1, r2, pressure, arm, checks = 0.002, 0.1, 0.2, np.radians(20.0), 0.001, []
    for sense in (1.0, -1.0):
        forces = forces_at(gears(lever, sense), [0.0, 1.0], 5.0)
        f = 40.0 / (r2 * np.cos(pressure) - sense * (arm + lever))
        checks.append(compare("tooth force", np.hypot(*forces.reaction("G")[:, :2].T), f, 1e-12))
        checks.append(compare("torque", forces.effort("A"), sense * f * r1 * np.cos(pressure) + f * (arm + lever), 1e-12))
    return motion_outcome(forces.motion, f"tooth force {f:.6g} N", checks, forces)


def _rolling() -> Outcome:
    m = Mechanism(
        name="wheel",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.3)}), Link(name="wheel", points={"W": (0.0, 0.0)}, mass=40.0)),
        joints=(Rolling(name="R", links=("frame", "wheel"), points=("O", "W"), radius=0.3, friction=Friction(lever=0.004)),),
        drives=(Drive(joint="R", law=ConstantSpeed(0.0, 1.0)),),
        effects=("gravity", "friction"),
    )
    forces = forces_at(m, [0.0, 0.5], -2.0)
    return motion_outcome(
        forces.motion,
        f"{forces.effort('R')[0]:.6g} N",
        [compare("pull", forces.effort("R"), -40.0 * G * 0.004 / 0.3, 1e-13)],
        forces,
    )


def _hidden_load() -> Outcome:
    m = slider_crank(0.05, 0.2, loads=(Force(name="F", link="piston", point="C", vector=(-50.0, 0.0)),), effects=("friction",))
    rough = rubbing_joint(m.joints[-1], Friction(coefficient=0.1))
    doubled = replace(m, joints=(*m.joints[:-1], rough, Prismatic(name="S2", links=("frame", "piston"), points=("O", "C"))))
    return refusal_outcome(
        lambda: forces_at(doubled, np.linspace(0.0, 6.0, 31)), "statics does not determine the contact force at S"
    )


def _small_coefficients() -> Outcome:
    """Coefficients of 1e-9: the loss is that of the frictionless reactions, to the first order."""
    journal = Friction(coefficient=1e-9, radius=0.01)
    plain = slider_crank(0.05, 0.18, loads=(Force(name="F", link="piston", point="C", vector=(-900.0, 0.0)),))
    m = replace(
        plain,
        joints=tuple(rubbing_joint(p, journal) if isinstance(p, Revolute) else p for p in plain.joints),
        effects=("friction",),
    )
    theta = np.linspace(0.1, 6.0, 60)
    forces, without = forces_at(m, theta, 40.0), forces_at(plain, theta, 40.0)
    lost = np.zeros(60)
    for p in ("O", "B", "C"):
        lost += 1e-11 * np.hypot(*without.reaction(p)[:, :2].T) * np.abs(without.motion.coordinate(p)[:, 1])
    return motion_outcome(
        forces.motion,
        f"{-friction_in(forces).power.max():.3g} W at least",
        [compare("loss", -friction_in(forces).power, lost, 1e-8)],
        forces,
    )


def _simulated(simulation: Simulation, summary: str, checks: list[Check]) -> Outcome:
    t = np.linspace(0.0, simulation.duration, 101)
    motion = simulation.motion(t)
    drift = float(np.max(np.abs(simulation.drift(t))))
    kinds = [h.kind for h in simulation.events]
    events = tuple(f"{kinds.count(k)} {k}" for k in dict.fromkeys(kinds))
    residual = float(np.max(motion.closure)) / simulation.compiled.model.length_scale
    return Outcome(summary, (*checks, Check("energy", drift, 1e-7)), residual, float(np.max(motion.condition)), events)


def _runs_down() -> Outcome:
    """In every half swing the amplitude falls by 2 mu m g / k, at half periods; the block sticks in the dead band, off the
    middle."""
    mu, k, x0 = 0.1, 100.0, 0.2
    step, half = 2.0 * mu * G / k, np.pi / 10.0
    count = int(np.ceil((x0 - 0.5 * step) / step))
    simulation = simulate(block(Friction(coefficient=mu), x0, 0.0, k), 5.0, tolerance=1e-10)
    turns = [h.time for h in simulation.events if h.time > 0.0]
    end = float(simulation([5.0])[0][0, 0])
    checks = [
        compare(
            "turns back at half periods", turns if len(turns) == count else [np.nan] * count, half * np.arange(1, count + 1), 1e-9
        ),
        compare("where it sticks", end, (-1.0) ** count * (x0 - count * step), 1e-9, scale=x0),
        check_that("it sticks", simulation.events[-1].kind == "stick"),
    ]
    return _simulated(simulation, f"sticks at {1e3 * end:.9g} mm after {count} half swings", checks)


def _stick_slip() -> Outcome:
    """A mass on a belt held by a spring: it sticks until k x = mu_s m g and slips on an arc about mu_k m g / k, repeatedly."""
    k, belt, static, kinetic = 50.0, 0.1, 0.4, 0.2
    w, x1 = np.sqrt(k), static * G / k
    centre = kinetic * G / k
    swing = 2.0 * (np.pi - np.arctan((x1 - centre) * w / belt)) / w
    period = swing + 2.0 * (x1 - centre) / belt
    m = Mechanism(
        name="belt",
        frame="frame",
        links=(
            Link(name="frame", points={"G": (0.0, 0.0)}),
            Link(name="belt", points={"G": (0.0, 0.0)}),
            Link(name="mass", points={"P": (0.0, 0.0)}, mass=1.0),
        ),
        joints=(
            Prismatic(name="belt", links=("frame", "belt"), points=("G", "G")),
            Prismatic(name="S", links=("belt", "mass"), points=("G", "P"), friction=Friction(coefficient=kinetic, static=static)),
        ),
        drives=(Drive(joint="belt", law=ConstantSpeed(0.0, belt, travel=1.0)), Drive(joint="S", law=Free(0.0, 0.0))),
        effects=("inertia", "gravity", "friction"),
        loads=(
            Force(
                name="spring", link="mass", point="P", vector=(1.0, 0.0),
                factor=Factor(function=lambda x: -k * x, of="x", point=("mass", "P")),
            ),
        ),
    )  # fmt: skip
    simulation = simulate(m, 4.5 * period, tolerance=1e-10)
    slips = [h.time for h in simulation.events if h.kind == "slip"]
    checks = [compare("first slip", slips[0], x1 / belt, 1e-8), compare("period", np.diff(slips), period, 1e-8)]
    return _simulated(simulation, f"every {np.mean(np.diff(slips)):.9g} s", checks)


def _painleve() -> Outcome:
    m = Mechanism(
        name="sleeve",
        frame="frame",
        links=(
            Link(name="frame", points={"G": (0.0, 0.0)}),
            Link(name="sleeve", points={"P": (0.0, 0.0)}, mass=1.0, centre=(0.0, 0.4), inertia=0.05),
        ),
        joints=(
            Prismatic(name="S", links=("frame", "sleeve"), points=("G", "P"), friction=Friction(coefficient=3.0, length=0.01)),
        ),
        drives=(Drive(joint="S", law=Free(0.0, 1.0)),),
        effects=("inertia", "gravity", "friction"),
        loads=(Force(name="push", link="sleeve", point="P", vector=(1.0, 0.0)),),
    )
    return refusal_outcome(lambda: simulate(m, 1.0), r"joints\.S\.friction")


def _brake() -> Outcome:
    """A wheel of 2 kg m^2 at 30 rad/s under a brake of 5 N m stops after J w / M, having turned J w^2 / (2 M), and stays."""
    m = pendulum(2.0, 0.0, 0.0, np.pi / 2, speed=30.0, effects=("inertia", "friction"))
    m = replace(m, joints=(replace(pin("O", "frame", "body"), friction=Friction(brake=5.0)),))
    simulation = simulate(m, 15.0, tolerance=1e-10)
    stops = [h.time for h in simulation.events if h.kind == "stick"]
    turned = float(simulation([15.0])[0][0, 0])
    checks = [
        compare("time", stops[-1], 12.0, 1e-9),
        compare("angle", turned, 180.0, 1e-9),
        compare("stays", simulation([14.0])[0][0, 0], turned, 1e-12),
    ]
    return _simulated(simulation, f"stops at {stops[-1]:.9g} s", checks)


CASES = (
    Case(
        "a billionth before the jam", "friction", "a sleeve's effort grows without bound", "W / (1 - 2 mu x / b)", _before_the_jam
    ),
    Case(
        "a billionth beyond the jam",
        "friction",
        "no effort moves it any more",
        "named, no numbers, share of the coefficient",
        _beyond_the_jam,
    ),
    Case("jam between two frames", "friction", "it jams while it moves", "time by hand: 4 s", _jam_between_frames),
    Case(
        "self-locking at its edge",
        "friction",
        "the slope is the friction angle to a thousandth of a degree",
        "tan(alpha +- rho)",
        _self_locking,
    ),
    Case(
        "reversal at a dead centre",
        "friction",
        "friction is undetermined between two limits at rest",
        "zero, the sign changes around it",
        _reversal,
    ),
    Case(
        "ends of a bearing",
        "friction",
        "the load leaves the bearing: pressure jumps to the other side",
        "mu F max(1, 2 e / b)",
        _two_ends,
    ),
    Case("no contraction", "friction", "fixed-point iteration diverges; the branch turns back", "a quadratic equation", _one_pin),
    Case("flank of a gear", "friction", "friction depends on which flank carries", "moments on the wheel", _gears),
    Case("rolling resistance", "friction", "a couple against rolling, backwards", "G f / R", _rolling),
    Case(
        "hidden normal load",
        "friction",
        "two guides share the load: statics does not determine the shares",
        "refused in words",
        _hidden_load,
    ),
    Case(
        "coefficients of 1e-9",
        "friction",
        "the losses are eleven digits below the powers",
        "first order of the frictionless reactions",
        _small_coefficients,
    ),
    Case(
        "runs down and sticks",
        "friction",
        "turns back nine times, then sticks off the middle",
        "2 mu m g / k a half swing",
        _runs_down,
    ),
    Case("stick-slip", "friction", "sticks and slips on a belt, static friction greater", "closed form of its period", _stick_slip),
    Case("Painleve", "friction", "no acceleration is in balance", "refused in words", _painleve),
    Case("a brake", "friction", "stops exactly and holds", "J w / M, J w^2 / (2 M)", _brake),
)
