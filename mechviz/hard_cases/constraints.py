"""Hard cases of linkages: scales, whole turns, redundant and contradicting constraints, loops without angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.redundancy import indeterminate
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import Drive, Gear, Link, Mechanism, Prismatic, Revolute
from mechviz.hard_cases.case import Case, Outcome, compare, judged, moved, refused
from mechviz.hard_cases.mechanisms import TURN, four_bar, load_at, pin


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
    forces = load_at(m, np.linspace(-0.5, 1.5, 21))
    up = sum(forces.reaction(p)[:, 1] for p in "BDH")
    loose = indeterminate(forces.motion)
    checks = [
        compare("speed of the third crank", forces.motion.velocity("c3")[:, 2], 1.0, 1e-11),
        compare("weight of the bar", up, 4.0 * 9.81, 1e-11),
        judged("all joints named", set(loose) == set("ABDEGH")),
    ]
    return moved(forces.motion, f"indeterminate: {', '.join(loose)}", checks, forces, ["reactions not determined"])


def _contradiction() -> Outcome:
    m = four_bar(0.28, 0.1, 0.3, 0.25)
    both = replace(m, drives=(*m.drives, Drive(joint="E", law=ConstantSpeed(1.6252677045288113, 1.0))), modes={})
    return refused(
        lambda: solve_motion(compile_mechanism(both), np.linspace(0.0, 1.0, 21)), "contradict each other", "Take 1 of the 2"
    )


def _few_frames() -> Outcome:
    m = four_bar(0.5, 2.0, 2.2, 2.1, start=1.0)
    motion = solve_motion(compile_mechanism(m), default_times(m, 12, 10))
    turns = [(motion.pose(k)[-1, 2] - motion.pose(k)[0, 2]) / TURN for k in ("coupler", "rocker")]
    return moved(motion, f"{turns[0]:.10g} and {turns[1]:.10g} turns", [compare("ten turns each", turns, 10.0, 1e-9)])


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
    return moved(motion, f"the pinion turns {turned:.10g} times", [compare("two thirds of three turns, back", turned, -2.0, 1e-9)])


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
    return moved(motion, f"b goes to {where[-1, 0]:.6g}, {where[-1, 1]:.6g} m", [compare("place of b", where, want, 1e-14)])


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
        judged("four changes", len(motion.changes) == 4),
    ]
    return moved(motion, f"as at its own scale, to {max(c.error for c in checks):.1e}", checks)


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
)
