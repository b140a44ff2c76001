"""Small mechanisms of the hard cases, built straight from the core's specs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Load
from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic, Revolute

TURN = 2.0 * np.pi
Bodies = Mapping[str, tuple[float, Sequence[float], float]]


def pin(name: str, first: str, second: str, at: str | None = None) -> Revolute:
    """A revolute joint whose point has its name, or ``at``."""
    return Revolute(name=name, links=(first, second), points=(at or name, at or name))


def body(name: str, points: Mapping[str, tuple[float, float]], bodies: Bodies | None) -> Link:
    """A link with what ``bodies`` (link -> mass, centre, inertia) says of it."""
    mass, centre, inertia = (bodies or {}).get(name, (0.0, (0.0, 0.0), 0.0))
    return Link(name=name, points=points, mass=mass, centre=(centre[0], centre[1]), inertia=inertia)


def four_bar(
    frame: float, crank: float, coupler: float, rocker: float, *, mode: str = "left", start: float = 0.0, speed: float = 1.0,
    bodies: Bodies | None = None, loads: tuple[Load, ...] = (), effects: tuple[str, ...] = (), P: tuple[float, float] = (0.0, 0.0),
) -> Mechanism:  # fmt: skip
    """Four-bar A-B-D-E with the frame along x and a point P of the coupler; D on the stated side of B -> E."""
    points: dict[str, dict[str, tuple[float, float]]] = {
        "frame": {"A": (0.0, 0.0), "E": (frame, 0.0)},
        "crank": {"A": (0.0, 0.0), "B": (crank, 0.0)},
        "coupler": {"B": (0.0, 0.0), "D": (coupler, 0.0), "P": P},
        "rocker": {"E": (0.0, 0.0), "D": (rocker, 0.0)},
    }
    return Mechanism(
        name="four-bar",
        frame="frame",
        links=tuple(body(name, where, bodies) for name, where in points.items()),
        joints=(
            pin("A", "frame", "crank"),
            pin("B", "crank", "coupler"),
            pin("D", "coupler", "rocker"),
            pin("E", "frame", "rocker"),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(start, speed)),),
        loads=loads,
        effects=effects,
        modes={"D": mode},
    )


def slider_crank(
    crank: float, rod: float, *, speed: float = 1.0, bodies: Bodies | None = None, loads: tuple[Load, ...] = (),
    effects: tuple[str, ...] = (),
) -> Mechanism:  # fmt: skip
    """Central slider-crank O-B-C, the guide S along x."""
    points: dict[str, dict[str, tuple[float, float]]] = {
        "frame": {"O": (0.0, 0.0)},
        "crank": {"O": (0.0, 0.0), "B": (crank, 0.0)},
        "rod": {"B": (0.0, 0.0), "C": (rod, 0.0)},
        "piston": {"C": (0.0, 0.0)},
    }
    return Mechanism(
        name="slider-crank",
        frame="frame",
        links=tuple(body(name, where, bodies) for name, where in points.items()),
        joints=(
            pin("O", "frame", "crank"),
            pin("B", "crank", "rod"),
            pin("C", "rod", "piston"),
            Prismatic(name="S", links=("frame", "piston"), points=("O", "C")),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, speed)),),
        loads=loads,
        effects=effects,
        modes={"S": "ahead"},
    )


def chain(n: int, drive: Any) -> Mechanism:
    """The linkage of the IFToMM benchmark: n unit parallelograms in a row of uniform bars of 1 kg, all flat at the same instant."""
    bar: dict[str, Any] = {"mass": 1.0, "centre": (0.5, 0.0), "inertia": 1.0 / 12.0}
    links = [Link(name="frame", points={f"A{k}": (float(k), 0.0) for k in range(n + 1)})]
    joints: list[Revolute] = []
    sketch = {}
    for k in range(n + 1):
        links.append(Link(name=f"upright{k}", points={f"A{k}": (0.0, 0.0), f"B{k}": (1.0, 0.0)}, **bar))
        joints.append(pin(f"A{k}", "frame", f"upright{k}"))
        sketch[f"upright{k}"] = (float(k), 0.0, np.pi / 2)
    for k in range(n):
        links.append(Link(name=f"bar{k}", points={f"B{k}": (0.0, 0.0), f"B{k + 1}": (1.0, 0.0)}, **bar))
        joints.append(pin(f"B{k}", f"upright{k}", f"bar{k}"))
        joints.append(pin(f"C{k}", f"bar{k}", f"upright{k + 1}", f"B{k + 1}"))
        sketch[f"bar{k}"] = (float(k), 1.0, 0.0)
    return Mechanism(
        name="chain",
        frame="frame",
        links=tuple(links),
        joints=tuple(joints),
        drives=(Drive(joint="A0", law=drive),),
        effects=("inertia", "gravity") if isinstance(drive, Free) else (),
        sketch=sketch,
    )


def bars(frame: float, crank: float, coupler: float, rocker: float, angle: float, speed: float) -> Mechanism:
    """Four-bar of uniform bars (1 kg per m), free at A, under gravity; D on the left of B -> E."""

    def bar(name: str, first: str, second: str, length: float) -> Link:
        points = {first: (0.0, 0.0), second: (length, 0.0)}
        return Link(name=name, points=points, mass=length, centre=(length / 2, 0.0), inertia=length**3 / 12)

    return Mechanism(
        name="bars",
        frame="frame",
        links=(
            Link(name="frame", points={"A": (0.0, 0.0), "E": (frame, 0.0)}),
            bar("crank", "A", "B", crank),
            bar("coupler", "B", "D", coupler),
            bar("rocker", "E", "D", rocker),
        ),
        joints=(
            pin("A", "frame", "crank"),
            pin("B", "crank", "coupler"),
            pin("D", "coupler", "rocker"),
            pin("E", "frame", "rocker"),
        ),
        drives=(Drive(joint="A", law=Free(angle, speed)),),
        effects=("inertia", "gravity"),
        modes={"D": "left"},
    )


def pendulum(
    inertia: float, mass: float, distance: float, angle: float, *, speed: float = 0.0, loads: tuple[Load, ...] = (),
    effects: tuple[str, ...] = ("inertia", "gravity"),
) -> Mechanism:  # fmt: skip
    """A physical pendulum about O, its angle from hanging straight down; ``inertia`` about O."""
    link = Link(name="body", points={"O": (0.0, 0.0)}, mass=mass, centre=(distance, 0.0), inertia=inertia - mass * distance**2)
    return Mechanism(
        name="pendulum",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0)}), link),
        joints=(pin("O", "frame", "body"),),
        drives=(Drive(joint="O", law=Free(angle - np.pi / 2, speed)),),
        effects=effects,
        loads=loads,
    )


def at(mechanism: Mechanism, positions: Any, speed: float = 1.0, acceleration: float = 0.0) -> Motion:
    """Motion at positions (n,) of the first drive."""
    q = np.atleast_1d(np.asarray(positions, float))
    given = {mechanism.drives[0].joint: (q, np.full_like(q, speed), np.full_like(q, acceleration))}
    return solve_motion(compile_mechanism(mechanism), np.arange(len(q)), drives=given)


def load_at(mechanism: Mechanism, positions: Any, speed: float = 1.0, acceleration: float = 0.0) -> Forces:
    """Forces at positions (n,) of the first drive."""
    return solve_forces(at(mechanism, positions, speed, acceleration))
