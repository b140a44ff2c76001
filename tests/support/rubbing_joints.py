"""Mechanisms with friction in joints: gears, a rack, a shaper, wheels, a drum with a brake."""

from __future__ import annotations

from dataclasses import replace

from mechanisms import pin

from mechcore.laws.timed import ConstantSpeed
from mechcore.spec.loads import BeltTension, Factor, Torque
from mechcore.spec.mechanism import (
    Belt,
    Drive,
    Friction,
    Gear,
    Joint,
    Link,
    Mechanism,
    PinSlot,
    Prismatic,
    Rack,
    Revolute,
)

LAW = ConstantSpeed(0.0, 1.0)


def link(name: str, **points) -> Link:
    return Link(name=name, points=points or {"c": (0.0, 0.0)}, mass=1.3, centre=(0.01, 0.02), inertia=0.05)


def wheels(joint: Joint, *, carried: bool = False) -> Mechanism:
    """Two wheels on one carrier, the frame or an arm that turns with the drive."""
    frame = Link(name="frame", points={"A": (0.0, 0.0), "B": (0.5, 0.2)})
    arm = link("arm", A=(0.0, 0.0), B=(0.5, 0.2))
    on = "arm" if carried else "frame"
    joints = (
        Revolute(name="A", links=(on, "a"), points=("A", "c")),
        Revolute(name="B", links=(on, "b"), points=("B", "c")),
        joint,
    )
    drives = (Drive(joint="A", law=LAW),)
    if carried:
        joints = (pin("O", "frame", "arm", at="A"), *joints)
        drives = (Drive(joint="O", law=ConstantSpeed(0.2, -0.7)), *drives)
    links = (frame, *((arm,) if carried else ()), link("a"), link("b"))
    load = Torque(name="M", link="b", moment=-3.0)
    return Mechanism(name="wheels", frame="frame", links=links, joints=joints, drives=drives, effects=("inertia",), loads=(load,))


def rack() -> Mechanism:
    return Mechanism(
        name="rack",
        frame="frame",
        links=(Link(name="frame", points={"A": (0.0, 0.0), "G": (0.0, -0.04)}), link("a", A=(0.0, 0.0)), link("r")),
        joints=(
            pin("A", "frame", "a"),
            Prismatic(name="S", links=("frame", "r"), points=("G", "c")),
            Rack(name="K", links=("a", "r"), slider="S", radius=0.04),
        ),
        drives=(Drive(joint="A", law=LAW),),
        effects=("inertia",),
    )


def shaper() -> Mechanism:
    """A crank's pin in the slot of a lever."""
    frame = Link(name="frame", points={"O": (0.0, 0.0), "B": (0.0, -0.3)})
    joints = (
        pin("O", "frame", "crank"),
        pin("B", "frame", "lever"),
        PinSlot(name="K", links=("lever", "crank"), points=("B", "A")),
    )
    links = (frame, link("crank", O=(0.0, 0.0), A=(0.1, 0.0)), link("lever", B=(0.0, 0.0)))
    drives = (Drive(joint="O", law=LAW),)
    return Mechanism(
        name="shaper", frame="frame", links=links, joints=joints, drives=drives, effects=("inertia",), modes={"K": "ahead"}
    )


def belt(crossed: bool) -> Belt:
    return Belt(name="K", links=("a", "b"), carrier="frame", radii=(0.05, 0.15), crossed=crossed)


GEAR = Gear(name="K", links=("a", "b"), carrier="frame", sizes=(20, 30))


def drum(moment: float, crossed: bool = False, *, mu: float = 0.3, journal: Friction | None = None, factor: Factor | None = None):
    """A motor that turns a drum by a belt with 200 N in its slack span."""
    made = wheels(belt(crossed))
    joints = (*(replace(p, friction=journal) for p in made.joints[:2]), made.joints[2])
    loads = (
        Torque(name="M", link="b", moment=moment, factor=factor),
        BeltTension(name="T", joint="K", slack=200.0, coefficient=mu),
    )
    effects = () if journal is None else ("friction",)
    return replace(made, joints=joints, loads=loads, effects=effects)
