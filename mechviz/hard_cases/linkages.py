"""Hard cases of linkages: change points and dead points, narrow gaps, limits of the drive."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal, localcontext

import numpy as np

from mechcore.constants import TURN
from mechcore.laws.timed import ConstantSpeed, Oscillation, zones
from mechcore.motion.reach import reachable_ranges
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import Drive, Link, Mechanism, Revolute
from mechviz.hard_cases.case import Case, Check, Outcome, check_that, compare, motion_outcome, refusal_outcome
from mechviz.hard_cases.mechanisms import chain, four_bar, motion_at, slider_crank
from mechviz.scene.scene import load


def _branch(mode: str) -> Outcome:
    """Cranks 0.1 on a frame of 0.3: the rocker turns as fast as the crank, or (r^2 - d^2)/(r^2 + d^2 - 2 r d cos) times as fast."""
    t = np.sort(np.concatenate([np.arange(1, 2001) * np.pi - 0.5, np.linspace(0.0, 1000 * TURN, 10_001)]))
    motion = solve_motion(compile_mechanism(four_bar(0.3, 0.1, 0.3, 0.1, start=0.5, mode=mode)), t)
    want = np.ones_like(t) if mode == "left" else (0.01 - 0.09) / (0.1 - 0.06 * np.cos(t + 0.5))
    got = motion.velocity("rocker")[:, 2]
    ratio = f"rocker turns {got.min():.4g} to {got.max():.4g} times as fast as the crank"
    return motion_outcome(
        motion,
        ratio,
        [compare("speed of the rocker", got, want, 1e-10), check_that("2000 changes", len(motion.singular_points) == 2000)],
    )


def _kite() -> Outcome:
    """Frame and crank 2, the others 3: D lies on the line of symmetry at half the crank's angle."""
    t = np.sort(np.concatenate([np.linspace(0.0, 100 * TURN, 4001), np.arange(1, 101) * TURN - 0.5]))
    motion = solve_motion(compile_mechanism(four_bar(2.0, 2.0, 3.0, 3.0, start=0.5)), t)
    half = 0.5 * (t + 0.5)
    d = (2.0 * np.cos(half) + np.sqrt(9.0 - 4.0 * np.sin(half) ** 2)) * np.exp(1j * half)
    got = motion.point("coupler", "D") @ [1.0, 1j]
    return motion_outcome(motion, "100 turns, all the way round D", [compare("way of D", np.abs(got - d), 0.0, 1e-9)])


def _flat_margin() -> Outcome:
    """Frame + crank = coupler + rocker - 1e-12: the pin D compared with the triangle in 60 digits."""
    motion = motion_at(four_bar(3.0, 1.0, 2.5, 1.5 + 1e-12, start=np.pi), [np.pi])
    with localcontext() as context:
        context.prec = 60
        b, r2, r3 = Decimal(-1), Decimal("2.5"), Decimal(1.5 + 1e-12)
        d = Decimal(3) - b
        along = (d * d + r2 * r2 - r3 * r3) / (2 * d)
        want = complex(float(b + along), float((r2 * r2 - along * along).sqrt()))
    got = complex(*motion.point("coupler", "D")[0])
    limit = 3.0 * 8e-16 * float(motion.condition[0])
    return motion_outcome(motion, f"D stands {got.imag:.6g} off the line", [compare("place of D", abs(got - want), 0.0, limit)])


def _dead_points() -> Outcome:
    m = slider_crank(1.0, 3.0)
    driven = replace(m, drives=(Drive(joint="S", law=Oscillation(3.0, 1.0, 1.0)),), modes={"B": "left"})
    motion = solve_motion(compile_mechanism(driven), np.linspace(0.0, 3.0, 541))
    angle = motion.pose("crank")[:, 2]
    s = np.cos(angle) + np.sqrt(9.0 - np.sin(angle) ** 2)
    checks = [
        compare("three strokes are three turns", abs(angle[-1] - angle[0]), 3 * TURN, 1e-10),
        check_that("always on in one direction", np.diff(angle) * np.sign(angle[-1] - angle[0]) > 0),
        compare("piston", motion.coordinate("S")[:, 0], s, 1e-12),
        check_that("six dead points", [c.dead for c in motion.singular_points] == [True] * 6),
    ]
    return motion_outcome(motion, f"the crank turns {abs(angle[-1] - angle[0]) / TURN:.12g} times", checks)


def _beyond() -> Outcome:
    m = replace(slider_crank(1.0, 3.0), drives=(Drive(joint="S", law=Oscillation(3.0, 1.01, 1.0)),), modes={"B": "left"})
    return refusal_outcome(
        lambda: solve_motion(compile_mechanism(m), np.linspace(0.0, 1.0, 361)), r"keep the drive within \[2000 mm, 4000 mm\]"
    )


def _sliver() -> Outcome:
    """The links miss each other by 1e-9 in a range that no frame hits; its limit by the law of cosines."""
    m = four_bar(3.0, 1.0, 2.5, 1.5 - 1e-9, start=0.3)
    edge = np.degrees(np.arccos((10.0 - (4.0 - 1e-9) ** 2) / 6.0))

    def range_of(text: str) -> list[Check]:
        high = float(text.split("keep the drive within [")[1].split("]")[0].replace("°", "").split(",")[1])
        return [compare("edge of the range", high, edge, 1e-6)]

    return refusal_outcome(lambda: solve_motion(compile_mechanism(m), default_times(m, 90)), "cannot be assembled", checks=range_of)


def _from_a_change_point() -> Outcome:
    motion = solve_motion(compile_mechanism(four_bar(0.3, 0.1, 0.3, 0.1)), np.linspace(0.0, 2 * TURN, 721))
    return motion_outcome(
        motion, "stays a parallelogram", [compare("speed of the rocker", motion.velocity("rocker")[:, 2], 1.0, 1e-9)]
    )


def _stops_on_it() -> Outcome:
    law = zones(start=0.5, speed=1.0, run_up=0.5, steady=1.0, braking=np.pi - 2.0)
    m = replace(four_bar(2.0, 1.0, 2.0, 1.0, start=0.5), drives=(Drive(joint="A", law=law),))
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, law.duration, 1441))
    checks = [
        compare("ends flat", motion.pose("crank")[-1, 2], np.pi, 1e-15),
        compare("rocker follows the crank", motion.pose("rocker")[:, 2], motion.pose("crank")[:, 2], 1e-9),
        check_that("accelerations are finite", np.isfinite(motion.acceleration("coupler"))),
    ]
    return motion_outcome(motion, f"ends at {np.degrees(motion.pose('crank')[-1, 2]):.9g}°, flat", checks)


def _coupled() -> Outcome:
    """Three antiparallelograms in a row, frame 2 and cranks 1, all flat at once: ratio (1 - d^2)/(1 + d^2 - 2 d cos)."""
    n, d = 3, 2.0
    links = [Link(name="frame", points={f"A{i}": (d * i, 0.0) for i in range(n + 1)})]
    joints = []
    for i in range(n + 1):
        links.append(Link(name=f"c{i}", points={"A": (0.0, 0.0), "X": (1.0, 0.0)}))
        joints.append(Revolute(name=f"A{i}", links=("frame", f"c{i}"), points=(f"A{i}", "A")))
    for i in range(n):
        links.append(Link(name=f"k{i}", points={"L": (0.0, 0.0), "R": (d, 0.0)}))
        joints.append(Revolute(name=f"L{i}", links=(f"c{i}", f"k{i}"), points=("X", "L")))
        joints.append(Revolute(name=f"R{i}", links=(f"k{i}", f"c{i + 1}"), points=("R", "X")))
    m = Mechanism(
        name="coupled",
        frame="frame",
        links=tuple(links),
        joints=tuple(joints),
        drives=(Drive(joint="A0", law=ConstantSpeed(0.5, 1.0)),),
        modes={f"R{i}": ("right", "left")[i % 2] for i in range(n)},
    )
    t = np.unique(np.concatenate([np.linspace(0.0, 2 * TURN, 1441), np.arange(1, 4) * np.pi - 0.5]))
    motion = solve_motion(compile_mechanism(m), t)
    angle, speed = t + 0.5, np.ones_like(t)
    checks = []
    for i in range(n):
        speed = speed * (1.0 - d * d) / (1.0 + d * d - 2.0 * d * np.cos(angle))
        whole = TURN * np.round(angle / TURN)
        angle = -whole - 2.0 * np.arctan((d + 1.0) / (d - 1.0) * np.tan(0.5 * (angle - whole)))
        checks.append(compare(f"speed of crank {i + 1}", motion.velocity(f"c{i + 1}")[:, 2], speed, 1e-9))
    return motion_outcome(motion, f"the last crank up to {np.abs(speed).max():.4g} times as fast", checks)


def _long_chain() -> Outcome:
    motion = solve_motion(compile_mechanism(chain(100, ConstantSpeed(np.pi / 2, 1.0))), np.linspace(0.0, TURN, 25))
    checks = [
        compare("last upright", motion.velocity("upright100")[:, 2], 1.0, 1e-10),
        compare("last bar stays level", motion.velocity("bar99")[:, 2], 0.0, 1e-10),
    ]
    return motion_outcome(motion, "100 parallelograms flat at once", checks)


def _triad() -> Outcome:
    """A group of class III over ten turns: the branch at the end is that of the start; rates by a second method."""
    m = load("triad").mechanism
    compiled = compile_mechanism(m)
    period = m.drives[0].law.duration
    t = np.linspace(0.0, 10 * period, 3601)
    motion = solve_motion(compiled, t)
    h = 1e-5 * period
    around = solve_motion(compiled, (t[5:-5:40, None] + h * np.arange(-2, 3)).ravel())
    p = around.pose("plate").reshape(-1, 5, 3)
    slope = (p[:, 0] - 8.0 * p[:, 1] + 8.0 * p[:, 3] - p[:, 4]) / (12.0 * h)
    checks = [
        compare("back after ten turns", motion.pose("plate")[-1], motion.pose("plate")[0], 1e-12),
        compare("speeds are the slopes of positions", around.velocity("plate")[2::5], slope, 1e-8),
        check_that("no jump", np.abs(np.diff(motion.pose("plate")[:, 2])).max() < 0.1),
    ]
    return motion_outcome(motion, "ten turns on one branch", checks)


def _double_rocker() -> Outcome:
    """Driven exactly to where coupler and rocker are in line, by the law of cosines; the motion continues on the other side."""
    limit = float(np.arccos((0.3**2 + 0.22**2 - (0.16 + 0.21) ** 2) / (2 * 0.3 * 0.22)))
    m = replace(four_bar(0.3, 0.22, 0.16, 0.21), drives=(Drive(joint="A", law=Oscillation(0.0, limit, 0.25)),))
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, 8.0, 1601))
    times = [c.time for c in motion.singular_points]
    checks = [
        compare("dead points at 1, 3, 5, 7 s", times if len(times) == 4 else [np.nan] * 4, [1.0, 3.0, 5.0, 7.0], 1e-6),
        check_that("the rocker swings on", np.abs(motion.velocity("rocker")[180:220, 2]).min() > 0.5),
    ]
    return motion_outcome(motion, f"{len(times)} dead points passed", checks)


def _narrower_limit() -> Outcome:
    m = four_bar(1.0, 0.9, 0.6, 0.7, start=0.4)
    low, high = reachable_ranges(compile_mechanism(m))[0]
    edge = float(np.arccos((0.81 + 1.0 - 1.69) / 1.8))
    motion = motion_at(m, np.linspace(low + 1e-9, high - 1e-9, 301))
    return motion_outcome(
        motion, f"{np.degrees(low):.7g}° to {np.degrees(high):.7g}°", [compare("limits", [-low, high], edge, 1e-9)]
    )


CASES = (
    Case(
        "parallelogram, 1000 turns",
        "linkages",
        "both branches meet twice a turn",
        "the rocker turns as the crank does, at all 2000 change points",
        lambda: _branch("left"),
    ),
    Case(
        "antiparallelogram, 1000 turns",
        "linkages",
        "the other branch through the same points",
        "closed form of its speed ratio",
        lambda: _branch("right"),
        "adaptive steppers swap the branch",
    ),
    Case(
        "kite",
        "linkages",
        "pins coincide once a turn: a whole circle of positions opens",
        "D on the line of symmetry, at half the crank's angle",
        _kite,
    ),
    Case(
        "near-flat four-bar",
        "linkages",
        "Grashof margin 1e-12: the triangle is flat to 12 digits",
        "60-digit arithmetic, to rounding times condition",
        _flat_margin,
    ),
    Case(
        "piston drives the crank",
        "linkages",
        "the drive turns back at six dead points",
        "the crank goes on in one direction: three turns",
        _dead_points,
    ),
    Case(
        "beyond the dead point",
        "linkages",
        "the drive asks for 1 % more than the links reach",
        "refused with the range 2 to 4 m",
        _beyond,
    ),
    Case(
        "sliver between frames",
        "linkages",
        "a range of 1e-4 degrees that no frame meets cannot be assembled",
        "refused; its edge by the law of cosines",
        _sliver,
    ),
    Case("start on a change point", "linkages", "both branches fit at the start", "the stated one is kept", _from_a_change_point),
    Case(
        "drive stops on a change point",
        "linkages",
        "speed and acceleration vanish where the modes meet",
        "rocker follows crank, accelerations finite",
        _stops_on_it,
    ),
    Case(
        "three antiparallelograms",
        "linkages",
        "three groups singular at the same instant, 27 times as fast",
        "closed form stage after stage",
        _coupled,
    ),
    Case(
        "chain of 100 parallelograms",
        "linkages",
        "100 groups flat at once",
        "last upright as the first, bars level",
        _long_chain,
        "Pinocchio + DOP853 leaves the branch at N = 2",
    ),
    Case(
        "triad, ten turns",
        "linkages",
        "a group of class III has up to six modes and no closed form",
        "back on the same branch; speeds by differences",
        _triad,
    ),
    Case(
        "double rocker at its limits",
        "linkages",
        "driven exactly to the limit angle",
        "dead points at 1, 3, 5, 7 s, the rocker swings on",
        _double_rocker,
    ),
    Case("range of a double rocker", "linkages", "where does it end?", "law of cosines, to 1e-9", _narrower_limit),
)
