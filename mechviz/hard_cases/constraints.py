"""Hard cases of linkages: scales, whole turns, redundant and contradicting constraints, loops without angles; and two that compare
engines, a four-bar (P1) and the reactions of a slider-crank (P2)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mechcore.constants import TURN
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.at_once import indeterminate
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.loads import Force
from mechcore.spec.mechanism import Drive, Gear, Link, Mechanism, Prismatic, Revolute
from mechviz.hard_cases.case import Case, Outcome, check_that, compare, motion_outcome, refusal_outcome
from mechviz.hard_cases.mechanisms import forces_at, four_bar, motion_at, pin, slider_crank


def _redundant() -> Outcome:
    """Three parallel cranks on one bar: exact motion, reactions that balance; the sum of the vertical ones carries the weight."""
    points = {"A": (0.0, 0.0), "E": (3.0, 0.0), "G": (1.5, 0.0)}
    links = [
        Link(name="frame", points=points),
        Link(name="bar", points={"B": (0.0, 0.0), "D": (3.0, 0.0), "H": (1.5, 0.0)}, mass=4.0),
    ]
    joints = []
    for crank, (foot, head) in {"c1": ("A", "B"), "c2": ("E", "D"), "c3": ("G", "H")}.items():
        links.append(Link(name=crank, points={foot: (0.0, 0.0), head: (0.6, 0.8)}))
        joints += [pin(foot, "frame", crank), pin(head, crank, "bar")]
    m = Mechanism(
        name="three cranks",
        frame="frame",
        links=tuple(links),
        joints=tuple(joints),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
        effects=("gravity",),
        sketch={"bar": (0.6, 0.8, 0.0), "c1": (0.0, 0.0, 0.0), "c2": (3.0, 0.0, 0.0), "c3": (1.5, 0.0, 0.0)},
    )
    forces = forces_at(m, np.linspace(-0.5, 1.5, 21))
    up = sum(forces.reaction(p)[:, 1] for p in "BDH")
    loose = indeterminate(forces.motion)
    checks = [
        compare("speed of the third crank", forces.motion.velocity("c3")[:, 2], 1.0, 1e-11),
        compare("weight of the bar", up, 4.0 * 9.81, 1e-11),
        check_that("all joints named", set(loose) == set("ABDEGH")),
    ]
    return motion_outcome(forces.motion, f"indeterminate: {', '.join(loose)}", checks, forces, ["reactions not determined"])


def _contradiction() -> Outcome:
    m = four_bar(0.28, 0.1, 0.3, 0.25)
    both = replace(m, drives=(*m.drives, Drive(joint="E", law=ConstantSpeed(1.6252677045288113, 1.0))), modes={})
    return refusal_outcome(
        lambda: solve_motion(compile_mechanism(both), np.linspace(0.0, 1.0, 21)), "contradict each other", "Take 1 of the 2"
    )


def _few_frames() -> Outcome:
    m = four_bar(0.5, 2.0, 2.2, 2.1, start=1.0)
    motion = solve_motion(compile_mechanism(m), default_times(m, 12, 10))
    turns = [(motion.pose(k)[-1, 2] - motion.pose(k)[0, 2]) / TURN for k in ("coupler", "rocker")]
    return motion_outcome(motion, f"{turns[0]:.10g} and {turns[1]:.10g} turns", [compare("ten turns each", turns, 10.0, 1e-9)])


def _geared_turns() -> Outcome:
    base = four_bar(0.5, 2.0, 2.2, 2.1, start=1.0)
    frame = replace(base.links[0], points={**base.links[0].points, "W": (3.5, 0.0)})
    m = replace(
        base,
        links=(frame, *base.links[1:], Link(name="pinion", points={"c": (0.0, 0.0)})),
        joints=(
            *base.joints,
            Revolute(name="W", links=("frame", "pinion"), points=("W", "c")),
            Gear(name="G", links=("rocker", "pinion"), carrier="frame", sizes=(20, 30)),
        ),
    )
    motion = solve_motion(compile_mechanism(m), default_times(m, 1080, 3))
    turned = (motion.pose("pinion")[-1, 2] - motion.pose("pinion")[0, 2]) / TURN
    return motion_outcome(
        motion, f"the pinion turns {turned:.10g} times", [compare("two thirds of three turns, back", turned, -2.0, 1e-9)]
    )


def _loop_of_slides() -> Outcome:
    def slide(name: str, first: str, second: str, along: tuple[float, float]) -> Prismatic:
        return Prismatic(name=name, links=(first, second), points=("O", "O"), along=along)

    m = Mechanism(
        name="slides",
        frame="frame",
        links=tuple(Link(name=n, points={"O": (0.0, 0.0)}) for n in ("frame", "a", "b")),
        joints=(slide("1", "frame", "a", (1.0, 0.2)), slide("2", "a", "b", (0.0, 1.0)), slide("3", "frame", "b", (1.0, 1.0))),
        drives=(Drive(joint="1", law=ConstantSpeed(0.1, 1.0, travel=0.5)),),
    )
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, 0.5, 5))
    q = motion.coordinate("1")[:, 0]
    where = motion.pose("b")[:, :2]
    want = np.outer(q / np.hypot(1.0, 0.2), [1.0, 1.0])  # on the third guide, above the block a
    return motion_outcome(
        motion, f"b goes to {where[-1, 0]:.6g}, {where[-1, 1]:.6g} m", [compare("place of b", where, want, 1e-14)]
    )


def _scaled(scale: float, shift: float, bound: float) -> Outcome:
    """The same parallelogram on another scale, or far from the origin: the same angles, points in proportion."""
    t = np.linspace(0.0, 2 * TURN, 361)
    m = four_bar(0.3, 0.1, 0.3, 0.1, start=0.5, mode="right")
    base = solve_motion(compile_mechanism(m), t)
    links = []
    for link in m.links:
        away = shift if link.name == "frame" else 0.0
        links.append(replace(link, points={p: (scale * x + away, scale * y - away) for p, (x, y) in link.points.items()}))
    motion = solve_motion(compile_mechanism(replace(m, links=tuple(links))), t)
    d = motion.point("coupler", "D") - [shift, -shift]
    checks = [
        compare("speed of the rocker", motion.velocity("rocker")[:, 2], base.velocity("rocker")[:, 2], bound),
        compare("way of D", d / scale, base.point("coupler", "D"), bound),
        check_that("four changes", len(motion.singular_points) == 4),
    ]
    return motion_outcome(motion, f"as at its own scale, to {max(c.error for c in checks):.1e}", checks)


def _p1() -> Outcome:
    """The four-bar 4, 1, 3.5, 3 of the comparison: coupler point and its rates by complex numbers on the closing triangle."""
    a, b, c, d = 4.0, 1.0, 3.5, 3.0
    theta = np.linspace(0.0, TURN, 3601)
    motion = motion_at(four_bar(a, b, c, d, P=(1.5, 1.0)), theta)
    crank = b * np.exp(1j * theta)
    distance = a - crank  # from B to E
    length = np.abs(distance)
    up = np.sqrt((length + c + d) * (-length + c + d) * (length - c + d) * (length + c - d)) / 2.0  # twice the triangle's area
    k = distance * ((length**2 + c**2 - d**2) / 2.0 + 1j * up) / length**2 / c  # direction of the coupler, D left of B -> E
    e, f = 1j * crank, c * k  # speeds: e + i w2 f = i w3 g
    g = f + crank - a
    w2 = -np.real(e * np.conj(g)) / np.real(1j * f * np.conj(g))
    w3 = np.real((e + 1j * w2 * f) / (1j * g))
    e2 = -crank
    rest = e2 - w2**2 * f + w3**2 * g
    eps2 = -np.real(rest * np.conj(g)) / np.real(1j * f * np.conj(g))
    arm = (1.5 + 1.0j) * k
    want = [crank + arm, e + 1j * w2 * arm, e2 + (1j * eps2 - w2**2) * arm]
    checks = []
    for order, (name, w) in enumerate(zip(("position", "velocity", "acceleration"), want, strict=True)):
        got = motion.point("coupler", "P", order) @ [1.0, 1j]
        checks.append(compare(f"{name} of the coupler point", np.abs(got - w) / np.abs(w).max(), 0.0, 1e-13))
    return motion_outcome(motion, f"largest relative error {max(x.error for x in checks):.1e}", checks)


def _p2() -> Outcome:
    """All reactions of a slider-crank under gravity and a working force, by Newton and Euler: 8 equations a frame."""
    r, l, f, g = 0.05, 0.2, -900.0, 9.81  # noqa: E741 - the letter of the textbooks
    m1, m2, m3, j1, j2, speed = 1.6, 0.9, 0.7, 4e-3, 3e-3, 60.0
    bodies = {"crank": (m1, (0.01, 0.0), j1), "rod": (m2, (0.07, 0.0), j2), "piston": (m3, (0.0, 0.0), 0.0)}
    loads = (Force(name="F", link="piston", point="C", vector=(f, 0.0)),)
    m = slider_crank(r, l, bodies=bodies, loads=loads, effects=("inertia", "gravity"))
    theta = np.linspace(0.0, TURN, 361)
    forces = forces_at(m, theta, speed)
    b = r * np.exp(1j * theta)
    phi = np.arcsin(-b.imag / l)
    w = -speed * b.real / (l * np.cos(phi))
    eps = (speed**2 * b.imag + w**2 * l * np.sin(phi)) / (l * np.cos(phi))
    rod = np.exp(1j * phi)
    a1 = -(speed**2) * 0.2 * b
    a2 = -(speed**2) * b + (1j * eps - w**2) * 0.07 * rod
    a3 = -(speed**2) * b + (1j * eps - w**2) * l * rod
    n = len(theta)
    a, rhs = np.zeros((n, 8, 8)), np.zeros((n, 8))  # Ox Oy Bx By Cx Cy N M; each on the second link of its joint
    s1, s2, s2c = 0.2 * b - b, -0.07 * rod, (l - 0.07) * rod  # from centres: crank to B (minus), rod to B, rod to C
    a[:, 0, 0] = a[:, 1, 1] = 1.0
    a[:, 0, 2] = a[:, 1, 3] = -1.0
    rhs[:, 0], rhs[:, 1] = m1 * a1.real, m1 * (a1.imag + g)
    o = -0.2 * b
    a[:, 2, 0], a[:, 2, 1], a[:, 2, 2], a[:, 2, 3], a[:, 2, 7] = -o.imag, o.real, -s1.imag, s1.real, 1.0
    a[:, 3, 2] = a[:, 4, 3] = 1.0
    a[:, 3, 4] = a[:, 4, 5] = -1.0
    rhs[:, 3], rhs[:, 4] = m2 * a2.real, m2 * (a2.imag + g)
    a[:, 5, 2], a[:, 5, 3], a[:, 5, 4], a[:, 5, 5] = -s2.imag, s2.real, s2c.imag, -s2c.real
    rhs[:, 5] = j2 * eps
    a[:, 6, 4] = a[:, 7, 5] = a[:, 7, 6] = 1.0
    rhs[:, 6], rhs[:, 7] = m3 * a3.real - f, m3 * (a3.imag + g)
    want = np.linalg.solve(a, rhs[..., None])[..., 0]
    got = np.column_stack(
        [
            forces.reaction("O")[:, :2],
            forces.reaction("B")[:, :2],
            forces.reaction("C")[:, :2],
            forces.reaction("S")[:, 1],
            forces.effort("O"),
        ]
    )
    checks = [compare("reactions", got[:, :7], want[:, :7], 1e-13), compare("driving torque", got[:, 7], want[:, 7], 1e-12)]
    return motion_outcome(forces.motion, f"largest relative error {max(x.error for x in checks):.1e}", checks, forces)


CASES = (
    Case(
        "micrometres",
        "linkages",
        "links of 100 nm through change points",
        "as at 100 mm, in proportion",
        lambda: _scaled(1e-6, 0.0, 1e-11),
    ),
    Case(
        "10 km from the origin",
        "linkages",
        "coordinates lose eight digits",
        "as at the origin, to what is left of the digits",
        lambda: _scaled(1.0, 1e4, 1e-8),
    ),
    Case(
        "three parallel cranks",
        "linkages",
        "a redundant constraint: W = 0 by Gruebler, yet it moves",
        "motion exact, weight carried, indeterminate joints named",
        _redundant,
    ),
    Case("contradicting drives", "linkages", "two drives for one freedom", "refused, says how many to take away", _contradiction),
    Case("12 frames for ten turns", "linkages", "links turn 300 degrees between frames", "ten turns counted", _few_frames),
    Case(
        "gear on a turning rocker",
        "linkages",
        "a gear train multiplies whole turns, not angles modulo a turn",
        "-2 turns in 3",
        _geared_turns,
    ),
    Case("slides only", "linkages", "a loop without a single angle", "intersection of two lines", _loop_of_slides),
    Case(
        "P1 four-bar",
        "linkages",
        "position, velocity, acceleration at 3601 places",
        "complex numbers on the closing triangle, to 1e-13",
        _p1,
        "exudyn 2e-4 in acceleration, Drake 3e-6, mechanism 5e-11",
    ),
    Case(
        "P2 slider-crank",
        "linkages",
        "all seven reactions and the torque",
        "Newton-Euler, 8 equations a frame",
        _p2,
        "OpenSim lacks a reaction; exudyn 5e-5",
    ),
)
