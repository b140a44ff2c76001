"""Mechanisms that the tests of the core use, built straight from specs."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, PPoly

from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.laws.timed import ConstantSpeed, Law
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Force, Load
from mechcore.spec.mechanism import Drive, Joint, Link, Mechanism, Prismatic, Revolute
from mechviz.hard_cases.mechanisms import pin

REFERENCE = Path(__file__).resolve().parents[2] / "tests" / "reference"


def case(file: str, name: str) -> dict[str, Any]:
    """A reference case by file and id."""
    return next(c for c in json.loads((REFERENCE / f"{file}.json").read_text())["cases"] if c["id"] == name)


def four_bar(
    *,
    A: Sequence[float] = (0.0, 0.0),
    E: Sequence[float],
    AB: float,
    BD: float,
    DE: float,
    mode: str = "left",
    coupler_point: Sequence[float] | None = None,
    start: float = 0.0,
    speed: float = 1.0,
    bodies: Mapping[str, tuple[float, Sequence[float], float]] | None = None,
    loads: tuple[Load, ...] = (),
    effects: tuple[str, ...] = (),
    extra: Mapping[str, Mapping[str, tuple[float, float]]] | None = None,
) -> Mechanism:
    """Four-bar A-B-D-E, link frames along AB, BD, ED; ``bodies``: link -> (mass, centre, inertia)."""
    points: dict[str, dict[str, tuple[float, float]]] = {
        "frame": {"A": (A[0], A[1]), "E": (E[0], E[1])},
        "crank": {"A": (0.0, 0.0), "B": (AB, 0.0)},
        "coupler": {"B": (0.0, 0.0), "D": (BD, 0.0)},
        "rocker": {"E": (0.0, 0.0), "D": (DE, 0.0)},
    }
    if coupler_point is not None:
        points["coupler"]["P"] = (coupler_point[0], coupler_point[1])
    for link, more in (extra or {}).items():
        points[link].update(more)
    links = []
    for name, where in points.items():
        mass, centre, inertia = (bodies or {}).get(name, (0.0, (0.0, 0.0), 0.0))
        links.append(Link(name=name, points=where, mass=mass, centre=(centre[0], centre[1]), inertia=inertia))
    return Mechanism(
        name="four-bar",
        frame="frame",
        links=tuple(links),
        joints=(
            pin("A", "frame", "crank"),
            pin("B", "crank", "coupler"),
            pin("D", "coupler", "rocker"),
            pin("E", "frame", "rocker"),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(start, speed)),),
        effects=effects,
        loads=loads,
        modes={"D": mode},
    )


def slider_crank(
    *,
    r: float,
    l: float,  # noqa: E741 - the letter of the textbooks
    e: float = 0.0,
    start: float = 0.0,
    speed: float = 1.0,
    branch: str = "ahead",
    bodies: Mapping[str, tuple[float, Sequence[float], float]] | None = None,
    loads: tuple[Load, ...] = (),
    effects: tuple[str, ...] = (),
    rod_point: Sequence[float] | None = None,
) -> Mechanism:
    """Slider-crank O-B-C, guide along x at height e."""
    points: dict[str, dict[str, tuple[float, float]]] = {
        "frame": {"O": (0.0, 0.0), "G": (0.0, e)},
        "crank": {"O": (0.0, 0.0), "B": (r, 0.0)},
        "rod": {"B": (0.0, 0.0), "C": (l, 0.0)},
        "piston": {"C": (0.0, 0.0)},
    }
    if rod_point is not None:
        points["rod"]["P"] = (rod_point[0], rod_point[1])
    links = []
    for name, where in points.items():
        mass, centre, inertia = (bodies or {}).get(name, (0.0, (0.0, 0.0), 0.0))
        links.append(Link(name=name, points=where, mass=mass, centre=(centre[0], centre[1]), inertia=inertia))
    return Mechanism(
        name="slider-crank",
        frame="frame",
        links=tuple(links),
        joints=(
            pin("O", "frame", "crank"),
            pin("B", "crank", "rod"),
            pin("C", "rod", "piston"),
            Prismatic(name="S", links=("frame", "piston"), points=("G", "C")),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(start, speed)),),
        effects=effects,
        loads=loads,
        modes={"S": branch},
    )


def lever(geometry: Mapping[str, Any], *, law: Law, masses: Mapping[str, Any] | None = None) -> Mechanism:
    """The contour-graph article's lever mechanism; the block is pinned to the crank at A and slides on the lever."""
    g, m = geometry, masses or {}
    offset = float(g["gamma"])
    c = (float(g["BC"] * np.cos(offset)), float(g["BC"] * np.sin(offset)))
    loads: tuple[Load, ...] = ()
    if masses:
        loads = (Force(name="F", link="slider", point="D", vector=(m["F_slider"], 0.0)),)

    def body(k: int) -> dict[str, Any]:
        if not masses:
            return {}
        centre = m.get(f"C{k}", (0.0, 0.0))
        return {"mass": m[f"m{k}"], "inertia": m.get(f"J{k}", 0.0), "centre": (centre[0], centre[1])}

    return Mechanism(
        name="lever",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "B": tuple(g["B"]), "G": (0.0, g["yD"])}),
            Link(name="crank", points={"O": (0.0, 0.0), "A": (g["OA"], 0.0)}, **body(1)),
            Link(name="block", points={"A": (0.0, 0.0)}, **body(2)),
            Link(name="lever", points={"B": (0.0, 0.0), "C": c}, **body(3)),
            Link(name="rod", points={"C": (0.0, 0.0), "D": (g["CD"], 0.0)}, **body(4)),
            Link(name="slider", points={"D": (0.0, 0.0)}, **body(5)),
        ),
        joints=(
            pin("O", "frame", "crank"),
            pin("A", "crank", "block"),
            Prismatic(name="L", links=("lever", "block"), points=("B", "A")),
            pin("B", "frame", "lever"),
            pin("C", "lever", "rod"),
            pin("D", "rod", "slider"),
            Prismatic(name="S", links=("frame", "slider"), points=("G", "D")),
        ),
        drives=(Drive(joint="O", law=law),),
        effects=("inertia", "gravity") if masses else (),
        loads=loads,
        modes={"L": "ahead", "S": "ahead" if g["branch_D"] == 1 else "behind"},
    )


def drawn(
    points: Mapping[str, Sequence[float]],
    links: Mapping[str, Sequence[str]],
    ground: Sequence[str],
    *,
    drive: str,
    law: Law,
    guides: Mapping[str, Sequence[float]] | None = None,
    bodies: Mapping[str, tuple[float, Sequence[float], float]] | None = None,
    effects: tuple[str, ...] = (),
    loads: tuple[Load, ...] = (),
    gravity: tuple[float, float] = (0.0, -9.81),
) -> Mechanism:
    """A linkage from its drawing: every link frame starts at its first point with the axes of the world.

    ``guides``: point -> direction of a slider on the ground; ``bodies``: link -> (mass, centre in the drawing, inertia).
    """
    where: dict[str, list[str]] = {p: ["frame"] for p in ground}
    for name, own in links.items():
        for p in own:
            where.setdefault(p, []).append(name)
    made = [Link(name="frame", points={p: (points[p][0], points[p][1]) for p in [*ground, *(guides or {})]})]
    sketch = {}
    for name, own in links.items():
        x, y = points[own[0]]
        mass, centre, inertia = (bodies or {}).get(name, (0.0, (x, y), 0.0))
        made.append(
            Link(
                name=name,
                points={p: (points[p][0] - x, points[p][1] - y) for p in own},
                mass=mass,
                centre=(centre[0] - x, centre[1] - y),
                inertia=inertia,
            )
        )
        sketch[name] = (x, y, 0.0)
    joints: list[Joint] = []
    for p, on in where.items():
        for i, (first, second) in enumerate(itertools.pairwise(on)):
            joints.append(Revolute(name=p if i == 0 else f"{p}{i}", links=(first, second), points=(p, p)))
    for p, direction in (guides or {}).items():
        made.append(Link(name=f"slider{p}", points={p: (0.0, 0.0)}))
        sketch[f"slider{p}"] = (points[p][0], points[p][1], 0.0)
        joints.append(Revolute(name=p, links=(where[p][0], f"slider{p}"), points=(p, p)))
        joints.append(Prismatic(name=f"guide{p}", links=("frame", f"slider{p}"), points=(p, p), along=(direction[0], direction[1])))
    return Mechanism(
        name="drawn",
        frame="frame",
        links=tuple(made),
        joints=tuple(joints),
        drives=(Drive(joint=drive, law=law),),
        effects=effects,
        loads=loads,
        gravity=gravity,
        sketch=sketch,
    )


def watt_six_bar(i: Mapping[str, Any], *, speed: float) -> Mechanism:
    """Watt six-bar: four-bar A-B-D-E whose rocker carries H, with the dyad H-K-N."""
    base = four_bar(A=i["A"], E=i["E"], AB=i["AB"], BD=i["BD"], DE=i["DE"], speed=speed, extra={"rocker": {"H": tuple(i["H"])}})
    frame = Link(name="frame", points={**base.links[0].points, "N": tuple(i["N"])})
    return Mechanism(
        name="watt",
        frame="frame",
        links=(
            frame,
            *base.links[1:],
            Link(name="link", points={"H": (0.0, 0.0), "K": (i["HK"], 0.0)}),
            Link(name="output", points={"N": (0.0, 0.0), "K": (i["KN"], 0.0)}),
        ),
        joints=(*base.joints, pin("H", "rocker", "link"), pin("K", "link", "output"), pin("N", "frame", "output")),
        drives=base.drives,
        modes={"D": "left", "K": "left" if i["branch2"] == 1 else "right"},
    )


def move(mechanism: Mechanism, theta: Any, omega: float = 1.0, eps: float = 0.0) -> Motion:
    """Motion at given positions of the (first) drive."""
    q = np.atleast_1d(np.asarray(theta, float))
    return solve_motion(
        compile_mechanism(mechanism),
        np.arange(len(q)),
        drives={mechanism.drives[0].joint: (q, np.full_like(q, omega), np.full_like(q, eps))},
    )


def load(mechanism: Mechanism, theta: Any, omega: float = 1.0, eps: float = 0.0) -> Forces:
    """Forces at given positions of the (first) drive."""
    return solve_forces(move(mechanism, theta, omega, eps))


def polynomial_through(t0: float, start: Sequence[float], t1: float, end: Sequence[float]) -> tuple[float, ...]:
    """Coefficients in t - t0 of the polynomial with the value, velocity, acceleration ... of both ends."""
    curve = PPoly.from_bernstein_basis(BPoly.from_derivatives([t0, t1], [start, end]))
    return tuple(float(c) for c in curve.c[::-1, 0])
