"""Random linkages under random loads, and their solution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from random_linkages import number

from mechcore.effects.registry import EFFECTS, LOADS
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.indicator import Compressor, FourStroke, FourStrokeDiagram, IndicatorDiagram
from mechcore.laws.signals import Chirp, Ramp, SignalPosition, Sine, Step
from mechcore.laws.timed import Oscillation, Table
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.loads import (
    Actuator,
    BeltTension,
    Bushing,
    BushingDamper,
    ConstantPower,
    Damper,
    DcMotor,
    Drag,
    Factor,
    Force,
    GasPressure,
    GasSpring,
    Governor,
    InductionMotor,
    JournalContact,
    JournalLoss,
    Polynomial,
    Servo,
    Spring,
    Torque,
    TorsionDamper,
    TorsionSpring,
    Viscous,
)
from mechcore.spec.mechanism import Belt, Link, Mechanism, Prismatic, Revolute

FAR = (0.0, 12.0)  # a point of a moving link so far away that nothing meets it


positive = st.floats(0.1, 50.0)


@st.composite
def factors(draw, mechanism):
    """A factor of anything that a factor can depend on."""
    of = draw(st.sampled_from(["time", "position", "velocity", "x", "y", "vx", "vy", "speed"]))
    smooth = Polynomial((draw(number), draw(number), draw(number)), per=draw(st.floats(1.0, 10.0)))
    table = Table(x=(-2.0, 0.0, 1.0, 5.0), y=(draw(number), 1.0, draw(number), 0.5))
    signals = [Sine(frequency=draw(positive)), Step(at=0.4), Ramp(begin=0.1, end=0.7), Chirp(frequencies=(1.0, 3.0), duration=0.5)]
    function = draw(st.sampled_from([smooth, table, np.cos, *(signals if of == "time" else [])]))
    if of in ("position", "velocity"):
        return Factor(function=function, of=of, joint=draw(st.sampled_from([None, *(p.name for p in mechanism.joints)])))
    link = mechanism.links[2]
    return (
        Factor(function=function, of=of, point=(link.name, next(iter(link.points))))
        if of != "time"
        else Factor(function=function, of=of)
    )


@st.composite
def loads(draw, mechanism):
    """Some of every kind of load, on the links and points of a mechanism that has the points Q (frame) and Z (last link)."""
    last, second = mechanism.links[-1].name, mechanism.links[2]
    first = mechanism.links[1].name
    point = next(iter(second.points))
    ends = {"links": (second.name, "frame"), "points": (point, "Q")}
    moving = {"links": (last, first), "points": ("Z", next(reversed(mechanism.links[1].points)))}
    turning = draw(st.sampled_from([(first, second.name), ("frame", second.name), (second.name, last)]))
    joint = draw(st.sampled_from([p.name for p in mechanism.joints]))
    turning_joints = [p.name for p in mechanism.joints if isinstance(p, Revolute)]
    made = [
        Force(name="force", link=second.name, point=point, vector=(draw(number), draw(number)), factor=draw(factors(mechanism))),
        Force(name="between", link=first, point="Y", vector=(draw(number), 1.0), against=last, axes="link"),
        Torque(
            name="torque",
            link=last,
            moment=draw(number),
            factor=draw(factors(mechanism)),
            against=draw(st.sampled_from([None, first])),
        ),
        Actuator(name="actuator", **moving, force=draw(number), factor=draw(st.one_of(st.none(), factors(mechanism)))),
        Spring(name="spring", **ends, stiffness=draw(positive), free_length=draw(st.floats(0.0, 20.0)), preload=draw(number)),
        Spring(name="inner spring", **moving, stiffness=draw(positive), free_length=0.0),
        Damper(name="damper", **moving, linear=draw(positive), quadratic=draw(st.floats(0.0, 5.0))),
        GasSpring(
            name="gas spring", **ends, force=draw(positive), extended=60.0, gas_length=70.0, exponent=draw(st.floats(1.0, 1.4))
        ),
        TorsionSpring(name="torsion spring", links=turning, stiffness=draw(positive), free_angle=draw(number)),
        TorsionDamper(name="torsion damper", links=turning, coefficient=draw(positive)),
        Bushing(name="bushing", **moving, stiffness=(draw(positive), draw(positive), 3.0), free_angle=draw(number)),
        BushingDamper(name="rubber", **moving, damping=(draw(positive), 0.0, draw(positive))),
        Drag(name="drag", link=second.name, point=point, linear=draw(positive), quadratic=draw(positive)),
        Drag(name="paddle", link=first, linear=draw(positive), quadratic=draw(positive)),
        Viscous(name="viscous", joint=joint, coefficient=draw(positive)),
        DcMotor(name="dc", joint=draw(st.sampled_from(turning_joints)), stall_torque=draw(positive), no_load_speed=-draw(positive)),
        InductionMotor(
            name="induction",
            link=second.name,
            breakdown_torque=draw(positive),
            breakdown_slip=draw(st.floats(0.05, 0.9)),
            synchronous_speed=draw(st.sampled_from([-1.0, 1.0])) * draw(positive),
        ),
        ConstantPower(name="constant power", link=last, power=draw(positive), torque_limit=draw(positive)),
        Servo(
            name="servo",
            joint=draw(st.sampled_from(turning_joints)),
            target=draw(st.sampled_from([Oscillation(0.0, 1.0, 0.3), SignalPosition(0.4, Ramp(begin=0.1, end=0.9))])),
            proportional=draw(positive),
            derivative=draw(positive),
        ),
        Governor(name="governor", link=first, set_speed=draw(number), gain=draw(positive), least=-5.0, most=draw(positive)),
    ]
    sliding = [p.name for p in mechanism.joints if isinstance(p, Prismatic)]
    made += [Actuator(name="ram", joint=name, force=draw(number), factor=draw(factors(mechanism))) for name in sliding]
    assert {type(load) for load in made} | {GasPressure, BeltTension, JournalContact, JournalLoss} == set(LOADS), (
        "a load of the registry is never drawn"
    )
    return tuple(made[i] for i in sorted(draw(st.sets(st.integers(0, len(made) - 1), min_size=1))))


def with_points(mechanism: Mechanism) -> Mechanism:
    """The mechanism with points for loads: Q on the frame, Y on the first moving link, Z on the last."""
    extra = {0: {"Q": (20.0, 20.0)}, 1: {"Y": (0.3, 0.4)}, len(mechanism.links) - 1: {"Z": FAR}}
    links = [replace(link, points={**link.points, **extra.get(i, {})}) for i, link in enumerate(mechanism.links)]
    return replace(mechanism, links=tuple(links))


def belted(mechanism: Mechanism) -> Mechanism:
    """The mechanism with a fan (link) that a belt V drives from its crank; W is the fan's pin."""
    frame, crank = mechanism.links[:2]
    fan = Link(name="fan", points={"W": (0.0, 0.0)}, mass=0.7, centre=(0.1, 0.05), inertia=0.2)
    frame = replace(frame, points={**frame.points, "W": (-3.0, -4.0)})
    belt = Belt(name="V", links=(crank.name, "fan"), carrier="frame", radii=(0.3, 0.7))
    joints = (*mechanism.joints, Revolute(name="W", links=("frame", "fan"), points=("W", "W")), belt)
    return replace(mechanism, links=(frame, crank, *mechanism.links[2:], fan), joints=joints)


@st.composite
def loaded(draw, kind):
    """Mechanisms under some of every load and effect of the registry, dry friction apart."""
    mechanism = with_points(draw(kind))
    chosen = draw(loads(mechanism))
    if draw(st.booleans()):
        mechanism = belted(mechanism)
        chosen += (BeltTension(name="tension", joint="V", slack=draw(positive), coefficient=draw(st.floats(0.0, 0.5))),)
        chosen += (Viscous(name="windage", joint="V", coefficient=draw(positive)),)
    if any(p.name == "S" for p in mechanism.joints) and draw(st.booleans()):
        chosen += (draw(gas(mechanism)),)
    assert set(EFFECTS) == {"inertia", "gravity", "friction"}, "an effect of the registry is never drawn"
    effects = draw(st.sampled_from([(), ("inertia",), ("gravity",), ("inertia", "gravity")]))
    return replace(mechanism, loads=chosen, effects=effects)


@st.composite
def gas(draw, mechanism):
    """The gas of a random cycle on the piston of a slider-crank."""
    offset, rod = mechanism.links[0].points["G"][1], mechanism.links[2].points["C"][0]
    near, far = np.sqrt((rod - 1.0) ** 2 - offset**2), np.sqrt((rod + 1.0) ** 2 - offset**2)
    low, high = (near, far) if mechanism.modes["S"] == "ahead" else (-far, -near)
    head = draw(st.sampled_from(["ahead", "behind"]))
    stroke = far - near
    cycle = draw(
        st.sampled_from(
            [
                Compressor(stroke=stroke, suction=1e2, delivery=6e2),
                FourStroke(stroke=stroke, intake=1e2, exhaust=1.1e2, ratio=9.0, rise=3.0, cutoff=1.2),
                IndicatorDiagram(stroke=stroke, outward=lambda x: 5e2 - x, inward=lambda x: 2e2 + x),
                FourStrokeDiagram(stroke=stroke, power=np.cos, exhaust=np.sin, intake=np.cos, compression=np.exp),
            ]
        )
    )
    return GasPressure(
        name="gas", joint="S", area=0.1, cycle=cycle, top=high if head == "ahead" else low, head=head, back=1e2, fires=0.3
    )


def run(mechanism, frames=720, cycles=1.0):
    return solve_forces(solve_motion(compile_mechanism(mechanism), default_times(mechanism, frames, cycles)))
