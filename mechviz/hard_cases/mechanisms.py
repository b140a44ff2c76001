"""Small mechanisms of the hard cases, built directly from the core's specs; those with dry friction have results known by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.laws.timed import ConstantSpeed, Free, Law
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Factor, Force, Load, Torque
from mechcore.spec.mechanism import Drive, Friction, Gear, Link, Mechanism, PinSlot, Prismatic, Revolute

Bodies = Mapping[str, tuple[float, Sequence[float], float]]


def pin(name: str, first: str, second: str, at: str | None = None) -> Revolute:
    """A revolute joint whose point has its name, or ``at``."""
    return Revolute(name=name, links=(first, second), points=(at or name, at or name))


def body(name: str, points: Mapping[str, tuple[float, float]], bodies: Bodies | None) -> Link:
    """A link with its mass, centre and inertia from ``bodies`` (link -> mass, centre, inertia)."""
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


def chain(n: int, drive: Law) -> Mechanism:
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


def motion_at(mechanism: Mechanism, positions: ArrayLike, speed: float = 1.0, acceleration: float = 0.0) -> Motion:
    """Motion at positions (n,) of the first drive."""
    q = np.atleast_1d(np.asarray(positions, float))
    given = {mechanism.drives[0].joint: (q, np.full_like(q, speed), np.full_like(q, acceleration))}
    return solve_motion(compile_mechanism(mechanism), np.arange(len(q)), drives=given)


def forces_at(mechanism: Mechanism, positions: ArrayLike, speed: float = 1.0, acceleration: float = 0.0) -> Forces:
    """Forces at positions (n,) of the first drive."""
    return solve_forces(motion_at(mechanism, positions, speed, acceleration))


def sleeve(x: float, length: float, mu: float, *, weight: float = 30.0, **more: Any) -> Mechanism:
    """A sleeve on a column with its weight [N] on the axis, lifted at a distance x from it (drive H); ``more``: keys of its
    friction."""
    return Mechanism(
        name="sleeve",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "X": (x, 0.0)}),
            Link(name="sleeve", points={"S": (0.0, 0.0), "L": (x, 0.0)}),
            Link(name="lift", points={"X": (0.0, 0.0)}),
        ),
        joints=(
            Prismatic(
                name="S",
                links=("frame", "sleeve"),
                points=("O", "S"),
                along=(0.0, 1.0),
                friction=Friction(coefficient=mu, length=length, **more),
            ),
            Prismatic(name="H", links=("frame", "lift"), points=("X", "X"), along=(0.0, 1.0)),
            PinSlot(name="T", links=("lift", "sleeve"), points=("X", "L")),
        ),
        drives=(Drive(joint="H", law=ConstantSpeed(0.0, 0.1)),),
        loads=(Force(name="W", link="sleeve", point="S", vector=(0.0, -weight)),),
        effects=("friction",),
    )


def incline(alpha: float, mu: float, *, mass: float = 2.0, speed: float = 0.1) -> Mechanism:
    """A block on an incline, pushed by a vertical slot on a slider along x (drive H); without friction where ``mu`` is 0."""
    return Mechanism(
        name="incline",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            Link(name="block", points={"P": (0.0, 0.0)}, mass=mass),
            Link(name="pusher", points={"Q": (0.0, 0.0)}),
        ),
        joints=(
            Prismatic(
                name="P",
                links=("frame", "block"),
                points=("O", "P"),
                along=(np.cos(alpha), np.sin(alpha)),
                friction=Friction(coefficient=mu) if mu else None,
            ),
            Prismatic(name="H", links=("frame", "pusher"), points=("O", "Q")),
            PinSlot(name="T", links=("pusher", "block"), points=("Q", "P"), along=(0.0, 1.0)),
        ),
        drives=(Drive(joint="H", law=ConstantSpeed(0.2, speed)),),
        effects=("gravity", "friction"),
    )


def bearing(e: float, friction: Friction) -> Mechanism:
    """A slider loaded across with 100 N at a distance e from its point."""
    return Mechanism(
        name="bearing",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0)}), Link(name="block", points={"S": (0.0, 0.0), "E": (e, 0.0)})),
        joints=(Prismatic(name="S", links=("frame", "block"), points=("O", "S"), friction=friction),),
        drives=(Drive(joint="S", law=ConstantSpeed(0.0, 1.0)),),
        loads=(Force(name="F", link="block", point="E", vector=(0.0, -100.0)),),
        effects=("friction",),
    )


def gears(lever: float, sign: float = 1.0) -> Mechanism:
    """Two gears with friction on the teeth and in their pins; the load on the second changes the flank with its sign."""
    journal = Friction(coefficient=0.1, radius=0.01)
    return Mechanism(
        name="gears",
        frame="frame",
        links=(
            Link(name="frame", points={"A": (0.0, 0.0), "B": (0.3, 0.0)}),
            Link(name="one", points={"A": (0.0, 0.0)}),
            Link(name="two", points={"B": (0.0, 0.0)}),
        ),
        joints=(
            Revolute(name="A", links=("frame", "one"), points=("A", "A"), friction=journal),
            Revolute(name="B", links=("frame", "two"), points=("B", "B"), friction=journal),
            Gear(name="G", links=("one", "two"), carrier="frame", sizes=(20, 40), friction=Friction(lever=lever)),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
        loads=(Torque(name="M", link="two", moment=40.0 * sign),),
        effects=("friction",),
    )


def block(friction: Friction, x0: float, v0: float, stiffness: float) -> Mechanism:
    """1 kg on a spring, sliding on the ground."""
    pull = Factor(function=lambda x: -stiffness * x, of="x", point=("mass", "P"))
    return Mechanism(
        name="oscillator",
        frame="frame",
        links=(Link(name="frame", points={"G": (0.0, 0.0)}), Link(name="mass", points={"P": (0.0, 0.0)}, mass=1.0)),
        joints=(Prismatic(name="S", links=("frame", "mass"), points=("G", "P"), friction=friction),),
        drives=(Drive(joint="S", law=Free(x0, v0)),),
        effects=("inertia", "gravity", "friction"),
        loads=(Force(name="spring", link="mass", point="P", vector=(1.0, 0.0), factor=pull),),
    )
