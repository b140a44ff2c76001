"""Cams with every plane follower as mechanisms, each with masses, a spring and a load."""

from __future__ import annotations

import math

from mechcore.cams.followers import Arc, Flat, Knife, Roller
from mechcore.laws.curve import MotionCurve
from mechcore.laws.program import Segment, program
from mechcore.laws.timed import ConstantSpeed
from mechcore.spec.loads import Force, Spring
from mechcore.spec.mechanism import CamJoint, Drive, Link, Mechanism, Prismatic, Revolute

DEG = math.pi / 180.0
SPEED = 20.0  # rad/s


def lift(stroke: float, law: str = "cycloidal") -> MotionCurve:
    """Rise 120 deg, dwell 60, return 120, dwell 60: of constant breadth."""
    return program([Segment(120 * DEG, stroke, law), Segment(60 * DEG), Segment(120 * DEG, 0.0, law), Segment(60 * DEG)])


def _cam_link(**more) -> Link:
    return Link(name="cam", points={"O": (0.0, 0.0)}, mass=1.2, centre=(0.003, 0.002), inertia=2e-3, **more)


def translating(
    face, *, offset: float = 0.0, base: float = 0.04, stroke: float = 0.02, slope: float = 90.0, speed: float = SPEED, **more
) -> Mechanism:
    """A follower on a straight guide through the frame, which points ``slope`` degrees from x, with its spring."""
    u = complex(math.cos(slope * DEG), math.sin(slope * DEG))
    foot, top = -1j * offset * u, (0.2 - 1j * offset) * u
    frame = Link(name="frame", points={"O": (0.0, 0.0), "G": (foot.real, foot.imag), "H": (top.real, top.imag)})
    follower = Link(name="follower", points={"T": (0.0, 0.0), "E": (0.0, 0.06)}, mass=0.4, centre=(0.002, 0.03), inertia=1e-4)
    joint = {"lift": lift(stroke), "base": base, **more}
    return Mechanism(
        name="translating",
        frame="frame",
        links=(frame, _cam_link(), follower),
        joints=(
            Revolute(name="O", links=("frame", "cam"), points=("O", "O")),
            Prismatic(name="S", links=("frame", "follower"), points=("G", "T"), along=(u.real, u.imag), angle=(slope - 90.0) * DEG),
            CamJoint(name="K", links=("cam", "follower"), guide="S", point="T", face=face, **joint),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(start=0.3, speed=speed * joint.get("sense", 1))),),
        loads=(Spring(name="spring", links=("frame", "follower"), points=("H", "E"), stiffness=4e3, free_length=0.2),),
        effects=("inertia", "gravity"),
    )


def oscillating(face, *, pivot=(0.1, 0.01), arm: float = 0.09, base: float = 0.04, stroke: float = 0.25, **more) -> Mechanism:
    """A follower on a lever about a pivot of the frame."""
    frame = Link(name="frame", points={"O": (0.0, 0.0), "P": pivot, "H": (0.02, 0.15)})
    follower = Link(
        name="follower",
        points={"P": (0.0, 0.0), "T": (arm, 0.0), "E": (0.8 * arm, 0.01)},
        mass=0.4,
        centre=(0.03, 0.002),
        inertia=1e-4,
    )
    joint = {"lift": lift(stroke), "base": base, **more}
    return Mechanism(
        name="oscillating",
        frame="frame",
        links=(frame, _cam_link(), follower),
        joints=(
            Revolute(name="O", links=("frame", "cam"), points=("O", "O")),
            Revolute(name="P", links=("frame", "follower"), points=("P", "P")),
            CamJoint(name="K", links=("cam", "follower"), guide="P", point="T", face=face, **joint),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(start=0.3, speed=SPEED * joint.get("sense", 1))),),
        loads=(Force(name="push", link="follower", point="E", vector=(10.0, -60.0)),),
        effects=("inertia", "gravity"),
    )


def wedge(face, *, along=(1.0, 0.0), oscillates: bool = False, sense: int = 1, phase: float = 0.0) -> Mechanism:
    """A cam that slides to and fro under its follower."""
    frame = Link(name="frame", points={"B": (-0.02, 0.0), "G": (0.02, 0.0), "P": (0.12, 0.06), "H": (0.02, 0.2)})
    follower = Link(name="follower", points={"T": (0.0, 0.0), "P": (0.1, 0.0)}, mass=0.3, centre=(0.05, 0.001), inertia=1e-4)
    slider = Link(name="cam", points={"B": (0.01, 0.002)}, mass=0.7)
    curve = program([Segment(0.05, 0.01 if not oscillates else 0.1, "3-4-5"), Segment(0.03), Segment(0.04, 0.0)], repeats=False)
    held = (
        Revolute(name="S", links=("frame", "follower"), points=("P", "P"))
        if oscillates
        else Prismatic(name="S", links=("frame", "follower"), points=("G", "T"), along=(0.0, 1.0))
    )
    return Mechanism(
        name="wedge",
        frame="frame",
        links=(frame, slider, follower),
        joints=(
            Prismatic(name="B", links=("frame", "cam"), points=("B", "B"), along=along),
            held,
            CamJoint(
                name="K", links=("cam", "follower"), guide="S", point="T", lift=curve, face=face, base=0.02, bed="B", sense=sense,
                phase=phase,
            ),
        ),
        drives=(Drive(joint="B", law=ConstantSpeed(start=0.0, speed=0.5, travel=0.12)),),
        loads=(Force(name="push", link="follower", point="T", vector=(5.0, -80.0)),),
        effects=("inertia", "gravity"),
    )  # fmt: skip


FOLLOWERS = {
    "knife": translating(Knife()),
    "roller": translating(Roller(0.01)),
    "offset roller": translating(Roller(0.01), offset=0.012, slope=60.0),
    "clockwise": translating(Roller(0.01), offset=-0.012, sense=-1, phase=0.7),
    "flat": translating(Flat(), base=0.05),
    "tilted flat": translating(Flat(tilt=0.1), base=0.05, offset=0.005),
    "mushroom": translating(Arc(0.05)),
    "oscillating knife": oscillating(Knife()),
    "oscillating roller": oscillating(Roller(0.012)),
    "oscillating right": oscillating(Roller(0.012), side="right", sense=-1),
    "oscillating flat": oscillating(Flat(left=0.1, right=0.1), pivot=(-0.1, 0.0), base=0.03, stroke=0.15),
    "groove": translating(Roller(0.01), closure="form"),
    "yoke": translating(Flat(), base=0.05, closure="form", lift=lift(0.02)),
    "wedge": wedge(Roller(0.01)),
    "wedge backwards": wedge(Roller(0.01), along=(-1.0, 0.0), phase=0.01),
    "wedge oscillating": wedge(Knife(), oscillates=True),
}
