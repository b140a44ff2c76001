"""Mechanisms with dry friction whose answers are known by hand: for the hard cases, and for the tests of friction."""

from __future__ import annotations

from typing import Any

import numpy as np

from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.spec.loads import Factor, Force, Torque
from mechcore.spec.mechanism import Drive, Friction, Gear, Link, Mechanism, PinSlot, Prismatic, Revolute


def sleeve(x: float, length: float, mu: float, *, weight: float = 30.0, **more: Any) -> Mechanism:
    """A sleeve on a column with its weight [N] on the axis, lifted at a distance x from it (drive H); ``more``: of its friction."""
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
