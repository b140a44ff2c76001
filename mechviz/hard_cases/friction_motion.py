"""Hard cases of dry friction in motion under forces: where a mechanism runs down, sticks and slips, brakes, has no acceleration."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mechcore.dynamics.simulate import simulate
from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.spec.loads import Factor, Force
from mechcore.spec.mechanism import Drive, Friction, Link, Mechanism, Prismatic
from mechviz.hard_cases.case import Case, Check, Outcome, compare, judged, refused
from mechviz.hard_cases.mechanisms import pendulum, pin
from mechviz.hard_cases.rubbing import block

G = 9.81


def _simulated(simulation: Any, found: str, checks: list[Check]) -> Outcome:
    t = np.linspace(0.0, simulation.duration, 101)
    motion = simulation.motion(t)
    drift = float(np.max(np.abs(simulation.drift(t))))
    kinds = [h.kind for h in simulation.events]
    events = tuple(f"{kinds.count(k)} {k}" for k in dict.fromkeys(kinds))
    residual = float(np.max(motion.closure)) / simulation.compiled.model.length_scale
    return Outcome(found, (*checks, Check("energy", drift, 1e-7)), residual, float(np.max(motion.condition)), events)


def _runs_down() -> Outcome:
    """Every half swing the amplitude falls by 2 mu m g / k, at half periods; it sticks in the dead band, off the middle."""
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
        judged("it sticks", simulation.events[-1].kind == "stick"),
    ]
    return _simulated(simulation, f"sticks at {1e3 * end:.9g} mm after {count} half swings", checks)


def _stick_slip() -> Outcome:
    """A mass on a belt held by a spring: sticks until k x = mu_s m g, slips on an arc about mu_k m g / k, over and over."""
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
    return refused(lambda: simulate(m, 1.0), r"joints\.S\.friction")


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
