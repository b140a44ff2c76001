"""Mechanisms that move under forces, as the reference data describe them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mechcore.laws.timed import Free
from mechcore.spec.loads import Drag, Factor, Force, Load, Spring, Torque, TorsionDamper, TorsionSpring, Viscous
from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic
from mechviz.hard_cases.mechanisms import chain as driven_chain
from mechviz.hard_cases.mechanisms import pin


def pendulum(
    *, inertia: float, mass: float, distance: float, angle: float, speed: float = 0.0, g: float = 9.81, loads: tuple[Load, ...] = ()
) -> Mechanism:
    """A physical pendulum about O, its angle measured from hanging straight down; ``inertia`` about O."""
    body = Link(name="body", points={"O": (0.0, 0.0)}, mass=mass, centre=(distance, 0.0), inertia=inertia - mass * distance**2)
    return Mechanism(
        name="pendulum",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0)}), body),
        joints=(pin("O", "frame", "body"),),
        drives=(Drive(joint="O", law=Free(angle - np.pi / 2, speed)),),
        effects=("inertia", "gravity"),
        gravity=(0.0, -g),
        loads=loads,
    )


def double_pendulum(i: dict[str, Any]) -> Mechanism:
    """Reference cases double-pendulum-*: angles from hanging straight down."""
    links = (
        Link(name="frame", points={"O": (0.0, 0.0)}),
        Link(name="upper", points={"O": (0.0, 0.0), "J": (i["L1"], 0.0)}, mass=i["m1"], centre=(i["a1"], 0.0), inertia=i["J1"]),
        Link(name="lower", points={"J": (0.0, 0.0)}, mass=i["m2"], centre=(i["a2"], 0.0), inertia=i["J2"]),
    )
    free = (
        Drive(joint="O", law=Free(i["theta_1"] - np.pi / 2, i["omega_1"])),
        Drive(joint="J", law=Free(i["theta_2"] - i["theta_1"], i["omega_2"] - i["omega_1"])),
    )
    return Mechanism(
        name="double pendulum",
        frame="frame",
        links=links,
        joints=(pin("O", "frame", "upper"), pin("J", "upper", "lower")),
        drives=free,
        effects=("inertia", "gravity"),
    )


def slider_crank(i: dict[str, Any]) -> Mechanism:
    """Reference cases forward-slider-crank*: constant torque on the crank; spring and damper on the slider where they are given."""
    loads: list[Load] = [Torque(name="torque", link="crank", moment=i["torque"])]
    if "spring_k" in i:
        stiffness, free = i["spring_k"], i["spring_x0"]
        pull = Factor(function=lambda x: -stiffness * (x - free), of="x", point=("slider", "C"))
        loads += [
            Force(name="spring", link="slider", point="C", vector=(1.0, 0.0), factor=pull),
            Viscous(name="damper", joint="guide", coefficient=i["damper_c"]),
        ]
    return Mechanism(
        name="slider-crank",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "G": (0.0, i["e"])}),
            Link(name="crank", points={"O": (0.0, 0.0), "B": (i["r"], 0.0)}, mass=i["m1"], centre=tuple(i["C1"]), inertia=i["J1"]),
            Link(name="rod", points={"B": (0.0, 0.0), "C": (i["l"], 0.0)}, mass=i["m2"], centre=tuple(i["C2"]), inertia=i["J2"]),
            Link(name="slider", points={"C": (0.0, 0.0)}, mass=i["m3"]),
        ),
        joints=(
            pin("O", "frame", "crank"),
            pin("B", "crank", "rod"),
            pin("C", "rod", "slider"),
            Prismatic(name="guide", links=("frame", "slider"), points=("G", "C")),
        ),
        drives=(Drive(joint="O", law=Free(i["theta_1_0"], i["omega_1_0"])),),
        effects=("inertia", "gravity"),
        loads=tuple(loads),
        modes={"C": "ahead"},
    )


def free_four_bar(i: dict[str, Any]) -> Mechanism:
    """Reference case forward-fourbar-gravity."""
    links = (
        Link(name="frame", points={"A": tuple(i["A"]), "E": tuple(i["E"])}),
        Link(name="crank", points={"A": (0.0, 0.0), "B": (i["AB"], 0.0)}, mass=i["m1"], centre=tuple(i["C1"]), inertia=i["J1"]),
        Link(name="coupler", points={"B": (0.0, 0.0), "D": (i["BD"], 0.0)}, mass=i["m2"], centre=tuple(i["C2"]), inertia=i["J2"]),
        Link(name="rocker", points={"E": (0.0, 0.0), "D": (i["DE"], 0.0)}, mass=i["m3"], centre=tuple(i["C3"]), inertia=i["J3"]),
    )
    return Mechanism(
        name="four-bar",
        frame="frame",
        links=links,
        joints=(
            pin("A", "frame", "crank"),
            pin("B", "crank", "coupler"),
            pin("D", "coupler", "rocker"),
            pin("E", "rocker", "frame"),
        ),
        drives=(Drive(joint="A", law=Free(i["theta_1_0"], i["omega_1_0"])),),
        effects=("inertia", "gravity"),
        modes={"D": "left" if i["branch"] == 1 else "right"},
    )


def chain(n: int) -> Mechanism:
    """N-four-bar chain of the multibody benchmark: started upright with 1 m/s at the top of the first upright, to the right."""
    return driven_chain(n, Free(np.pi / 2, -1.0))


def squeezer(i: dict[str, Any]) -> Mechanism:
    """Andrews' squeezing mechanism, reference case andrews-squeezer; crank angle beta at joint O."""
    q = i["initial_q"]
    b, first, g = q["beta"], q["Theta"], q["gamma"]
    de, ep = q["delta"], q["epsilon"]
    links = (
        Link(name="frame", points={"O": (0, 0), "A": (i["xa"], i["ya"]), "B": (i["xb"], i["yb"]), "C": (i["xc"], i["yc"])}),
        Link(name="K1", points={"O": (0, 0), "P": (i["rr"], 0)}, mass=i["m1"], centre=(i["ra"], 0), inertia=i["I1"]),
        Link(name="K2", points={"P": (0, 0), "F": (-i["d"], 0)}, mass=i["m2"], centre=(-i["da"], 0), inertia=i["I2"]),
        Link(
            name="K3",
            points={"B": (0, 0), "F": (0, -i["ss"]), "D": (i["sd"], -i["sc"])},
            mass=i["m3"],
            centre=(i["sb"], -i["sa"]),
            inertia=i["I3"],
        ),
        Link(name="K4", points={"E": (0, 0), "F": (0, -i["e"])}, mass=i["m4"], centre=(0, i["ea"] - i["e"]), inertia=i["I4"]),
        Link(name="K5", points={"A": (0, 0), "E": (i["zt"], 0)}, mass=i["m5"], centre=(i["tb"], i["ta"]), inertia=i["I5"]),
        Link(name="K6", points={"H": (0, 0), "F": (i["zf"], 0)}, mass=i["m6"], centre=(i["zf"] - i["fa"], 0), inertia=i["I6"]),
        Link(name="K7", points={"A": (0, 0), "H": (0, -i["u"])}, mass=i["m7"], centre=(i["ub"], -i["ua"]), inertia=i["I7"]),
    )
    joints = (
        pin("O", "frame", "K1"),
        pin("P", "K1", "K2"),
        pin("F3", "K2", "K3", at="F"),
        pin("B", "frame", "K3"),
        pin("F4", "K2", "K4", at="F"),
        pin("E", "K4", "K5"),
        pin("A5", "frame", "K5", at="A"),
        pin("F6", "K2", "K6", at="F"),
        pin("H", "K6", "K7"),
        pin("A7", "frame", "K7", at="A"),
    )
    sketch = {
        "K1": (0.0, 0.0, b),
        "K2": (i["rr"] * np.cos(b), i["rr"] * np.sin(b), b + first),
        "K3": (i["xb"], i["yb"], g),
        "K5": (i["xa"], i["ya"], de),
        "K4": (i["xa"] + i["zt"] * np.cos(de), i["ya"] + i["zt"] * np.sin(de), q["Phi"] + de),
        "K7": (i["xa"], i["ya"], ep),
        "K6": (i["xa"] + i["u"] * np.sin(ep), i["ya"] - i["u"] * np.cos(ep), q["Omega"] + ep),
    }
    loads: tuple[Load, ...] = (
        Torque(name="motor", link="K1", moment=i["mom"]),
        Spring(name="spring", links=("frame", "K3"), points=("C", "D"), stiffness=i["c0"], free_length=i["lo"]),
    )
    return Mechanism(
        name="squeezer",
        frame="frame",
        links=links,
        joints=joints,
        drives=(Drive(joint="O", law=Free(b)),),
        effects=("inertia",),
        loads=loads,
        sketch=sketch,
    )


def damped_squeezer(i: dict[str, Any]) -> Mechanism:
    """`squeezer` with a damped crank and a point that moves in a medium: forces that depend on speeds."""
    m = squeezer(i)
    damper = TorsionDamper(name="damper", links=("K1", "frame"), coefficient=1e-5)
    return replace(m, loads=(*m.loads, damper, Drag(name="medium", link="K4", point="E", linear=0.02, quadratic=0.01)))


def swinging_five_bar(*, stiffness: float = 0.3, speeds: tuple[float, float] = (8.0, 5.0)) -> Mechanism:
    """A five-bar of uniform bars (1 kg per m) under gravity, both arms held by torsion springs, so that it stays put together."""

    def bar(name: str, first: str, second: str, length: float) -> Link:
        points = {first: (0.0, 0.0), second: (length, 0.0)}
        return Link(name=name, points=points, mass=length, centre=(length / 2, 0.0), inertia=length**3 / 12)

    return Mechanism(
        name="five-bar",
        frame="frame",
        links=(
            Link(name="frame", points={"A": (0.0, 0.0), "E": (0.16, 0.0)}),
            bar("left", "A", "B", 0.14),
            bar("left rod", "B", "C", 0.22),
            bar("right rod", "D", "C", 0.22),
            bar("right", "E", "D", 0.14),
        ),
        joints=(
            pin("A", "frame", "left"),
            pin("B", "left", "left rod"),
            pin("C", "left rod", "right rod"),
            pin("D", "right", "right rod"),
            pin("E", "frame", "right"),
        ),
        drives=(Drive(joint="A", law=Free(2.2, speeds[0])), Drive(joint="E", law=Free(0.9, speeds[1]))),
        effects=("inertia", "gravity"),
        modes={"C": "left"},
        loads=(
            TorsionSpring(name="left spring", links=("frame", "left"), stiffness=stiffness, free_angle=2.2),
            TorsionSpring(name="right spring", links=("frame", "right"), stiffness=stiffness, free_angle=0.9),
        ),
    )
