"""Viscous friction in every kind of joint, seals and losses of cylinders, tension and slip of belts."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from cam_mechanisms import oscillating, translating, wedge
from mechanisms import load, pin
from random_linkages import balance_of_links
from rubbing_joints import GEAR, LAW, belt, drum, link, rack, shaper, wheels

import mechviz
from mechcore.cams.followers import Flat, Knife, Roller
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.forces.load_events import belt_events, belt_grip
from mechcore.laws.timed import ConstantSpeed, Oscillation, Table
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import BeltTension, Factor, Force, Viscous
from mechcore.spec.mechanism import (
    Belt,
    CamJoint,
    Cylinder,
    Drive,
    Friction,
    Gear,
    Joint,
    Link,
    Mechanism,
    Planar,
    Rack,
    Revolute,
    Rolling,
    Screw,
    Weld,
)
from mechviz.quantities.events import events_of
from mechviz.runs import run_scene

THETA = np.linspace(0.1, 6.0, 19)
C = 7.0


def rolling() -> Mechanism:
    wheel = Rolling(name="K", links=("frame", "a"), points=("O", "c"), radius=0.3)
    links = (Link(name="frame", points={"O": (0.0, 0.3)}), link("a"))
    return Mechanism(
        name="wheel", frame="frame", links=links, joints=(wheel,), drives=(Drive(joint="K", law=LAW),), effects=("inertia",)
    )


def boom(friction: Friction | None = None, *, driven: bool = True) -> Mechanism:
    """A boom that its cylinder lifts, or, if that is not driven, that turns by itself."""
    frame = Link(name="frame", points={"O": (0.0, 0.0), "P": (0.5, -0.3)})
    arm = Link(name="boom", points={"O": (0.0, 0.0), "Q": (0.9, 0.1)}, mass=40.0, centre=(1.0, 0.0), inertia=9.0)
    cylinder = Cylinder(name="K", links=("frame", "boom"), points=("P", "Q"), friction=friction)
    drive = Drive(joint="K", law=Oscillation(0.7, 0.2, 0.5)) if driven else Drive(joint="O", law=Oscillation(0.4, 0.3, 0.5))
    effects = ("inertia", "gravity", "friction") if friction is not None else ("inertia", "gravity")
    return Mechanism(
        name="boom",
        frame="frame",
        links=(frame, arm),
        joints=(pin("O", "frame", "boom"), cylinder),
        drives=(drive,),
        effects=effects,
        modes={} if driven else {"K": "ahead"},
        sketch={"boom": (0.0, 0.0, 0.4)},
    )


def screw() -> Mechanism:
    """A mass that a screw moves on a link that turns."""
    links = (
        Link(name="frame", points={"A": (0.0, 0.0)}),
        Link(name="jib", points={"A": (0.0, 0.0), "R": (0.1, 0.03)}, mass=4.0, centre=(0.3, 0.1), inertia=0.5),
        Link(name="trolley", points={"T": (0.0, 0.0)}, mass=3.0, centre=(0.01, -0.02), inertia=0.02),
    )
    joints = (pin("A", "frame", "jib"), Screw(name="K", links=("jib", "trolley"), points=("R", "T"), lead=0.3, along=(0.8, 0.3)))
    drives = (Drive(joint="A", law=Oscillation(0.4, 0.7, 1.0)), Drive(joint="K", law=Oscillation(6.0, 5.0, 1.5)))
    return Mechanism(name="crane", frame="frame", links=links, joints=joints, drives=drives, effects=("inertia", "gravity"))


EVERY = {
    "gear": wheels(GEAR),
    "planet": wheels(replace(GEAR, carrier="arm"), carried=True),
    "ring": wheels(replace(GEAR, sizes=(20, 60), internal=True)),
    "belt": wheels(belt(False)),
    "crossed belt": wheels(belt(True)),
    "belt on an arm": wheels(replace(belt(False), carrier="arm"), carried=True),
    "rack": rack(),
    "rolling": rolling(),
    "pin in slot": shaper(),
    "cylinder": boom(),
    "screw": screw(),
    "knife": translating(Knife(), offset=0.006),
    "roller": translating(Roller(0.01), slope=70.0),
    "flat": translating(Flat()),
    "lever": oscillating(Roller(0.012)),
    "wedge": wedge(Roller(0.01)),
    "revolute": replace(rack(), joints=(replace(rack().joints[0], name="K"), *rack().joints[1:2], replace(rack().joints[2],
    name="Z")),
                        drives=(Drive(joint="K", law=LAW),)),
    "prismatic": replace(rack(), joints=(rack().joints[0], replace(rack().joints[1], name="K"),
                                        replace(rack().joints[2], name="Z", slider="K"))),
}  # fmt: skip


def speed(mechanism: Mechanism, motion) -> np.ndarray:
    """Speed of the relative motion in joint K, from poses and rates alone."""
    joint = next(p for p in mechanism.joints if p.name == "K")
    if isinstance(joint, Revolute | Gear | Rack | Rolling):
        return motion.velocity(joint.links[1])[:, 2] - motion.velocity(joint.links[0])[:, 2]
    if isinstance(joint, Belt):
        turning = [motion.velocity(k)[:, 2] - motion.velocity(joint.carrier)[:, 2] for k in joint.links]
        np.testing.assert_allclose(np.abs(turning[0]) * joint.radii[0], np.abs(turning[1]) * joint.radii[1], rtol=1e-12)
        return turning[0] * joint.radii[0]
    if isinstance(joint, CamJoint):
        place = motion.joint_position("K")
        ends = []
        for k in joint.links:
            arm, (v, w) = place - motion.pose(k)[:, :2], np.split(motion.velocity(k), [2], axis=1)
            ends.append(v + w * np.column_stack([-arm[:, 1], arm[:, 0]]))
        return np.hypot(*(ends[1] - ends[0]).T)  # where they touch they do not move along the normal
    return motion.coordinate("K")[:, 1]


def test_every_kind_of_joint_that_moves_is_here():
    kinds = {type(next(p for p in m.joints if p.name == "K")) for m in EVERY.values()}
    assert kinds == set(get_args(Joint)) - {Weld, Planar}


@pytest.mark.parametrize("name", EVERY)
def test_viscous_friction_in_every_kind_of_joint(name):
    """It takes c times the square of the relative speed, the drives pay for it, and every link stays in balance."""
    mechanism = EVERY[name]
    rough = replace(mechanism, loads=(*mechanism.loads, Viscous(name="oil", joint="K", coefficient=C)))
    if any(len(m.drives) > 1 for m in (mechanism,)) or not isinstance(mechanism.drives[0].law, ConstantSpeed):
        times = np.linspace(0.0, 1.7, 15)
        forces, dry = (solve_forces(solve_motion(compile_mechanism(m), times)) for m in (rough, mechanism))
    else:
        q = THETA if "wedge" not in name else 0.01 * THETA
        forces, dry = (load(m, q, 2.0, 0.7) for m in (rough, mechanism))
    lost = forces.power_by_cause(["viscous"])
    np.testing.assert_allclose(lost, -C * speed(mechanism, forces.motion) ** 2, rtol=1e-9, atol=1e-13)
    assert (lost < 0.0).any()
    np.testing.assert_allclose(
        forces.power_supplied - dry.power_supplied, -lost, rtol=1e-9, atol=1e-11 * np.abs(forces.power_supplied).max()
    )
    assert np.abs(forces.power_balance).max() < 1e-10
    assert balance_of_links(forces) < 1e-10


def test_a_weld_has_no_friction():
    m = replace(
        rack(), links=(*rack().links, link("w")), joints=(*rack().joints, Weld(name="W", links=("r", "w"), points=("c", "c")))
    )
    with pytest.raises(MechanismError, match="'W' is no joint that moves"):
        compile_mechanism(replace(m, loads=(Viscous(name="oil", joint="W", coefficient=1.0),)))


# -- cylinders -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.0, 0.08])
def test_seals_and_losses_of_a_driven_cylinder(share):
    """Effort E against the force F without friction: E = F + s (seals + share |E|), s the sign of the speed."""
    seals = 120.0
    times = np.linspace(0.0, 2.0, 41)
    forces, dry = (
        solve_forces(solve_motion(compile_mechanism(boom(f)), times)) for f in (Friction(coefficient=share, brake=seals), None)
    )
    s, f, e = np.sign(forces.motion.coordinate("K")[:, 1].round(12)), dry.effort("K"), forces.effort("K")
    np.testing.assert_allclose(e, f + s * (seals + share * np.abs(e)), rtol=1e-12)
    np.testing.assert_allclose(
        forces.friction.losses("K"), np.abs(forces.motion.coordinate("K")[:, 1]) * (seals + share * np.abs(e)), rtol=1e-9, atol=1e-9
    )
    assert forces.friction.residual.max() < 1e-12
    assert np.abs(forces.power_balance).max() < 1e-12 and balance_of_links(forces) < 1e-11


def test_a_cylinder_that_is_not_driven_has_its_seals_only():
    times = np.linspace(0.0, 2.0, 41)
    made = (boom(Friction(coefficient=c, brake=b), driven=False) for c, b in ((0.3, 120.0), (0.0, 120.0), (0.3, 0.0)))
    both, seals, share = (solve_forces(solve_motion(compile_mechanism(m), times)) for m in made)
    np.testing.assert_allclose(both.effort("O"), seals.effort("O"), rtol=1e-12)
    np.testing.assert_allclose(both.friction.losses("K"), 120.0 * np.abs(both.motion.coordinate("K")[:, 1]), atol=1e-9)
    assert np.abs(share.friction.power).max() < 1e-9
    for forces in (both, seals):
        assert np.abs(forces.power_balance).max() < 1e-12 and balance_of_links(forces) < 1e-11


# -- belts ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("crossed", [False, True])
@pytest.mark.parametrize("moment", [-30.0, 30.0])
def test_both_spans_pull_on_the_bearings(crossed, moment):
    """Slack span 200 N, tight span 200 N + |M| / r, each along its own tangent; no work is done by the tension."""
    forces = load(drum(moment, crossed), THETA, 2.0)
    distance = np.hypot(0.5, 0.2)
    lean = np.arcsin((0.05 + (0.15 if crossed else -0.15)) / distance)  # of the spans against the line of centres
    tight, slack = 200.0 + 30.0 / 0.15, 200.0
    wanted = np.hypot((tight + slack) * np.cos(lean), (tight - slack) * np.sin(lean))
    for p in "AB":
        np.testing.assert_allclose(np.hypot(*forces.reaction(p)[:, :2].T), wanted, rtol=1e-12)
    assert np.abs(forces.power_by_cause(["elastic"])).max() < 1e-9
    assert np.abs(forces.power_balance).max() < 1e-12 and balance_of_links(forces) < 1e-12
    towards = np.array([-0.5, -0.2]) / distance
    np.testing.assert_allclose(forces.loads["T"].values[:, :2] @ towards, 2.0 * slack * np.cos(lean), rtol=1e-12)


@pytest.mark.parametrize("crossed", [False, True])
def test_angles_of_wrap_and_what_a_belt_carries(crossed):
    m = drum(1.0, crossed)
    grip = belt_grip(solve_motion(compile_mechanism(m), np.zeros(1)), m.loads[1])
    d = np.hypot(0.5, 0.2)
    small = np.pi + 2 * np.arcsin(0.2 / d) if crossed else np.pi - 2 * np.arcsin(0.1 / d)
    np.testing.assert_allclose(grip.wraps, (small, small if crossed else 2 * np.pi - small), rtol=1e-13)
    assert grip.most == pytest.approx(200.0 * (np.exp(0.3 * small) - 1.0), rel=1e-13)
    toothed = replace(m.loads[1], coefficient=0.0)
    assert belt_grip(solve_motion(compile_mechanism(m), np.zeros(1)), toothed).most == np.inf


def test_a_belt_slips_where_its_tensions_differ_too_much():
    """A torque that grows in proportion to the angle reaches the limit at a known place, whatever the frames."""
    most = 200.0 * (np.exp(0.3 * (np.pi - 2 * np.arcsin(0.1 / np.hypot(0.5, 0.2)))) - 1.0)
    ramp = Factor(function=Table(x=(0.0, 2.0, 4.0), y=(0.0, 2.0, 0.0), smooth=False), of="time")
    m = replace(drum(-most * 0.15, factor=ramp), drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),))
    for frames in (9, 31):
        forces = solve_forces(solve_motion(compile_mechanism(m), np.linspace(0.0, 4.0, frames)))
        (event,) = belt_events(forces)
        assert event.time == pytest.approx(1.0, rel=1e-9) and event.item == "K" and event.level == "WARN"
        assert "Euler and Eytelwein" in event.text and f"{most:.5g} N is the most" in event.text
        assert event.value == pytest.approx(2.0 * most if frames == 9 else event.value, rel=1e-9)
    held = replace(m, loads=(m.loads[0], replace(m.loads[1], slack=500.0)))
    assert belt_events(solve_forces(solve_motion(compile_mechanism(held), np.linspace(0.0, 4.0, 31)))) == []


def test_a_belt_that_slips_between_two_frames_is_told():
    """A torque that swings with time asks for 1.01 times what the belt carries for a moment, halfway between two of the frames."""
    most = 200.0 * (np.exp(0.3 * (np.pi - 2 * np.arcsin(0.1 / np.hypot(0.5, 0.2)))) - 1.0)
    swing = Factor(function=lambda t: np.sin(0.5 * np.pi * t), of="time")
    m = replace(drum(-1.01 * most * 0.15, factor=swing), drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),))
    (event,) = belt_events(solve_forces(solve_motion(compile_mechanism(m), np.linspace(0.0, 2.0, 6))))
    assert event.value == pytest.approx(1.01 * most, rel=1e-9)
    assert event.time == pytest.approx(np.arcsin(1.0 / 1.01) * 2.0 / np.pi, rel=1e-4)


DRUM = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
run = { duration = "1 s", frames = 20 }
[links]
frame = { points = { A = [0, 0], B = [360, 90] } }
motor = { points = { A = [0, 0] }, mass = "1.5 kg", inertia = "0.01 kg m^2" }
drum = { points = { B = [0, 0] }, mass = "9 kg", inertia = "0.2 kg m^2" }
[joints]
A = { revolute = ["frame", "motor"], free = { speed = "10 rpm" } }
B = { revolute = ["frame", "drum"] }
V = { belt = ["motor", "drum"], radii = [55, 130] }
[loads]
drive = { torque = "40 N m", on = "motor", ramp = { begin = 0, end = "1 s" } }
tension = { belt_tension = "V", slack = "120 N", coefficient = 0.35 }
"""


def test_a_belt_that_forces_move_says_when_it_slips():
    """The drum takes its part of a torque that rises with time: from when Euler and Eytelwein let the belt carry no more."""
    (event,) = [e for e in events_of(run_scene(mechviz.loads(DRUM))) if "slips from" in e.text]
    i, distance = 55.0 / 130.0, np.hypot(360.0, 90.0)
    carried = 120.0 * np.expm1(0.35 * (np.pi - 2.0 * np.arcsin((130.0 - 55.0) / distance)))
    of_full_torque = 40.0 * 0.2 * i**2 / (0.01 + 0.2 * i**2) / 0.055  # [N]
    assert event.item == "V" and event.time == pytest.approx(carried / of_full_torque, rel=1e-4)
    assert f"{carried:.5g} N is the most that it carries" in event.text


def test_the_tension_makes_friction_in_the_bearings():
    """Two journals under |R| each: the motor pays mu r |R| at both; without load R is the tension's pull alone."""
    journal = Friction(coefficient=0.1, radius=0.01)
    forces = load(drum(0.0, journal=journal), THETA, 2.0)
    brake = 0.1 * 0.01 * np.hypot(*forces.reaction("B")[:, :2].T)
    carried = np.hypot(*forces.reaction("K")[:, :2].T)
    np.testing.assert_allclose(carried * 0.15, brake, rtol=1e-10)  # the belt turns the drum against its bearing
    np.testing.assert_allclose(
        forces.effort("A"), carried * 0.05 + 0.1 * 0.01 * np.hypot(*forces.reaction("A")[:, :2].T), rtol=1e-10
    )
    assert np.abs(forces.power_balance).max() < 1e-12 and balance_of_links(forces) < 1e-12


def test_a_tension_of_no_belt_is_refused():
    m = drum(1.0)
    with pytest.raises(MechanismError, match="'A' is no belt or chain"):
        compile_mechanism(replace(m, loads=(BeltTension(name="T", joint="A", slack=1.0),)))


# -- scenes --------------------------------------------------------------------------------------------------------------

SCENE = """
units = { length = "mm", angle = "deg" }
effects = ["friction"]

[links]
frame = { points = { A = [0, 0], B = [420, 60], P = [100, -200] } }
motor = { points = { A = [0, 0] } }
drum  = { points = { B = [0, 0], Q = [80, 0] } }
pump  = { points = { P = [0, 0], R = [300, 0] } }

[joints]
A = { revolute = ["frame", "motor"], drive = { speed = "120 rpm" } }
B = { revolute = ["frame", "drum"], friction = { coefficient = 0.1, radius = 12 } }
V = { belt = ["motor", "drum"], radii = [50, 150] }
P = { revolute = ["frame", "pump"], drive = { oscillation = { centre = 20, amplitude = 10, period = "1 s" } } }
C = { cylinder = ["frame", "pump"], at = ["B", "R"], friction = { coefficient = 0.05, brake = "80 N" } }

[loads]
T = { belt_tension = "V", slack = "150 N", coefficient = 0.35 }
air = { viscous = "V", linear = "3 N s/m" }
oil = { viscous = "C", linear = "0.2 N s/mm" }
M = { torque = "-20 N m", on = "drum" }
"""


def test_scenes_say_it():
    scene = mechviz.loads(SCENE)
    joints, computed = {p.name: p for p in scene.mechanism.joints}, {x.name: x for x in scene.mechanism.loads}
    assert joints["C"].friction == Friction(coefficient=0.05, brake=80.0)
    assert computed["T"] == BeltTension(name="T", joint="V", slack=150.0, coefficient=0.35)
    assert computed["oil"].coefficient == pytest.approx(200.0) and computed["air"].coefficient == 3.0
    again = mechviz.loads(scene.to_toml())
    assert again == scene and again.mechanism == scene.mechanism
    defaults = mechviz.loads(SCENE + "\n[friction]\ncoefficient = 0.2\n")
    assert {p.name: p for p in defaults.mechanism.joints}["C"].friction.coefficient == 0.05


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('belt_tension = "V"', 'belt_tension = "B"', "'B' is a revolute joint, no belt or chain."),
        ('slack = "150 N", ', "", "'slack' is missing."),
        ('slack = "150 N"', 'slack = "-150 N"', "belts only pull"),
        ("coefficient = 0.35", "coefficient = -0.35", "negative"),
        ("V = { belt =", "V = { chain =", "a chain does not slip"),
        ('"3 N s/m"', '"3 N m s/rad"', "torsional damping"),
        ('brake = "80 N"', 'radius = "8 mm"', "radius does not go with the friction of a cylinder."),
        ('{ coefficient = 0.05, brake = "80 N" }', "{}", "neither 'coefficient' nor 'brake'"),
        ("radii = [50, 150] }", "radii = [50, 150], friction = { coefficient = 0.1 } }", "belt_tension shows where it slips"),
    ],
)
def test_faults(old, new, words):
    assert old in SCENE
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(SCENE.replace(old, new))
    assert words in str(error.value)


def test_a_rolling_wheel_and_a_force_on_it():
    """Viscous losses of a wheel pulled at its axle: F = c w / R."""
    m = replace(
        rolling(),
        effects=(),
        loads=(Viscous(name="oil", joint="K", coefficient=C), Force(name="F", link="a", point="c", vector=(0.0, -1.0))),
    )
    forces = load(m, [0.0, 0.5], 1.2)
    np.testing.assert_allclose(forces.effort("K"), C * (1.2 / 0.3) / 0.3, rtol=1e-13)
