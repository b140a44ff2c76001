"""Every kind of joint: motion against its closed form, forces in balance on every link, power closed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import four_bar, load, move, pin, slider_crank
from wheels import THETA, sound, wheel

from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import ConstantSpeed, Free, Oscillation
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.loads import Force, Torque, Viscous
from mechcore.spec.mechanism import (
    Belt,
    Cylinder,
    Drive,
    Friction,
    Gear,
    Link,
    Mechanism,
    PinSlot,
    Prismatic,
    Rack,
    Revolute,
    Rolling,
    Screw,
    Weld,
)


def _at(name: str, first: str, point: str, second: str, other: str = "c"):
    return Revolute(name=name, links=(first, second), points=(point, other))


def planetary() -> Mechanism:
    """Sun 20 teeth, planet 30, ring 80 held by the frame; the arm is driven."""
    arm = Link(name="arm", points={"O": (0.0, 0.0), "P": (0.05, 0.0)}, mass=2.0, inertia=0.3, centre=(0.01, 0.02))
    return Mechanism(
        name="planetary",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            wheel("sun"),
            arm,
            wheel("planet", centre=(0.003, -0.002)),
            wheel("ring"),
        ),
        joints=(
            pin("O", "frame", "arm"),
            _at("P", "arm", "P", "planet"),
            _at("S", "arm", "O", "sun"),
            _at("R", "arm", "O", "ring"),
            Weld(name="held", links=("frame", "ring"), points=("O", "c")),
            Gear(name="sun-planet", links=("sun", "planet"), carrier="arm", sizes=(20, 30)),
            Gear(name="planet-ring", links=("planet", "ring"), carrier="arm", sizes=(30, 80), internal=True),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, 3.0)),),
        effects=("inertia", "gravity"),
        loads=(Torque(name="M", link="sun", moment=-7.0),),
    )


def test_planetary_train_by_willis():
    """Ring held, arm driven: sun turns 1 + 80/20 times as fast, planet 1 - 80/30 times (Willis)."""
    forces = load(planetary(), THETA, 3.0, 2.0)
    np.testing.assert_allclose(forces.motion.velocity("sun")[:, 2], 3.0 * (1 + 80 / 20), rtol=1e-12)
    np.testing.assert_allclose(forces.motion.velocity("planet")[:, 2], 3.0 * (1 - 80 / 30), rtol=1e-12)
    np.testing.assert_allclose(forces.motion.acceleration("sun")[:, 2], 2.0 * 5, rtol=1e-12)
    np.testing.assert_allclose(np.diff(forces.motion.pose("sun")[:, 2]), 5 * np.diff(THETA), rtol=1e-12)
    assert np.abs(forces.power_balance).max() < 1e-12


def test_a_planetary_train_that_its_sun_drives():
    """Two meshes decide arm and planet together, without a loop. It is the same motion, so the drives have the same power."""
    arm_driven = planetary()
    joints = tuple(_at("S", "frame", "O", "sun") if p.name == "S" else p for p in arm_driven.joints)
    drawn = {"arm": (0.0, 0.0, 0.0)}  # how the wheels stand does not matter
    drives = (Drive(joint="S", law=ConstantSpeed(0.0, 15.0)),)
    forces = load(replace(arm_driven, joints=joints, drives=drives, sketch=drawn), 5.0 * THETA, 15.0, 10.0)
    sound(forces)
    want = load(arm_driven, THETA, 3.0, 2.0)
    np.testing.assert_allclose(forces.motion.pose("arm")[:, 2], THETA, rtol=1e-12)
    np.testing.assert_allclose(forces.motion.acceleration("planet")[:, 2], 2.0 * (1 - 80 / 30), rtol=1e-12)
    np.testing.assert_allclose(5.0 * forces.effort("S"), want.effort("O"), rtol=1e-11)


def test_what_matters_of_the_start_of_geared_links_has_to_be_sketched():
    """The arm that two meshes turn, by name; and a wheel with a slot through its axis, which was taken to stand at zero."""
    planets = planetary()
    joints = tuple(_at("S", "frame", "O", "sun") if p.name == "S" else p for p in planets.joints)
    with pytest.raises(MechanismError, match="how 'arm' stands") as told:
        compile_mechanism(replace(planets, joints=joints, drives=(Drive(joint="S", law=ConstantSpeed(0.0, 15.0)),)))
    assert [f.path for f in told.value.faults] == ["joints.sun-planet"]
    slotted = Mechanism(
        name="slotted wheel",
        frame="frame",
        links=(Link(name="frame", points={"A": (0.0, 0.0), "B": (0.1, 0.0), "H": (0.12, 0.0)}), wheel("motor"), wheel("slotted"),
               wheel("lever", U=(0.06, 0.0))),
        joints=(
            _at("A", "frame", "A", "motor"), _at("B", "frame", "B", "slotted"), _at("H", "frame", "H", "lever"),
            Gear(name="G", links=("motor", "slotted"), carrier="frame", sizes=(20, 30)),
            PinSlot(name="S", links=("slotted", "lever"), points=("c", "U"), along=(1.0, 0.0)),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
        modes={"S": "ahead"},
    )  # fmt: skip
    with pytest.raises(MechanismError, match="how 'slotted' stands"):
        compile_mechanism(slotted)
    motion = move(replace(slotted, sketch={"slotted": (0.1, 0.0, 0.7)}), THETA)
    np.testing.assert_allclose(motion.pose("slotted")[:, 2], 0.7 - THETA / 1.5, atol=1e-12)


def gear_train(internal: bool = False) -> Mechanism:
    d = 0.06 if internal else 0.12
    return Mechanism(
        name="gears",
        frame="frame",
        links=(
            Link(name="frame", points={"A": (0.0, 0.0), "B": (d, 0.03)}),
            wheel("pinion", centre=(0.01, 0.0)),
            wheel("gear", mass=4.0, inertia=1.0, centre=(0.0, 0.02), P=(0.05, 0.01)),
        ),
        joints=(
            _at("A", "frame", "A", "pinion"),
            _at("B", "frame", "B", "gear"),
            Gear(name="G", links=("pinion", "gear"), carrier="frame", sizes=(17, 51), internal=internal),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
        effects=("inertia", "gravity"),
        loads=(Force(name="F", link="gear", point="P", vector=(3.0, -9.0), axes="link"),),
        sketch={"gear": (d, 0.03, 0.4)},
    )


def test_a_gear_driven_through_a_joint_named_the_other_way_round():
    """The drive's angle is the frame's against the pinion's here, so the pinion turns against it."""
    m = gear_train()
    turned = replace(m, joints=(_at("A", "pinion", "c", "frame", "A"), *m.joints[1:]))
    a, b = load(m, THETA, 4.0, 5.0), load(turned, -THETA, -4.0, -5.0)
    np.testing.assert_allclose(b.motion.pose("gear")[:, 2], a.motion.pose("gear")[:, 2], rtol=1e-12)
    np.testing.assert_allclose(b.reaction("G"), a.reaction("G"), rtol=1e-9, atol=1e-9)
    sound(b)


@pytest.mark.parametrize("internal", [False, True])
def test_gear_joint_ratio_reactions_and_line_of_action(internal):
    m = gear_train(internal)
    forces = load(m, THETA, 4.0, 5.0)
    sign = 1.0 if internal else -1.0
    np.testing.assert_allclose(forces.motion.pose("gear")[:, 2], 0.4 + sign * THETA / 3.0, rtol=1e-12)
    np.testing.assert_allclose(forces.motion.velocity("gear")[:, 2], sign * 4.0 / 3.0, rtol=1e-12)
    sound(forces)
    # the pitch point lies on the line of centres at the pinion's radius, the force leans by 20 degrees against the tangent
    b = np.array([0.06 if internal else 0.12, 0.03])
    distance = np.hypot(*b)
    r1 = distance * 17 / ((51 - 17) if internal else (51 + 17))
    pitch = -sign * b / distance * r1
    np.testing.assert_allclose(forces.position("G"), np.tile(pitch, (len(THETA), 1)), atol=1e-14)
    f = forces.reaction("G")[:, :2]
    outward = pitch / r1
    np.testing.assert_allclose(f @ outward, np.hypot(*f.T) * np.sin(np.radians(20)), rtol=1e-9)
    assert (f @ outward > 0).all(), "teeth push each other apart"


def test_gears_that_cannot_mesh_are_refused():
    m = gear_train(internal=True)
    wrong = tuple(replace(p, sizes=(51, 17)) if isinstance(p, Gear) else p for p in m.joints)
    with pytest.raises(MechanismError, match="cannot mesh"):
        compile_mechanism(replace(m, joints=wrong))
    lost = tuple(replace(p, carrier="gear") if isinstance(p, Gear) else p for p in m.joints)
    with pytest.raises(MechanismError, match="not pinned to"):
        compile_mechanism(replace(m, joints=lost))


def test_gear_with_pins_off_its_axis_needs_its_phase():
    points = {"A": (0.0, 0.0), "B": (0.1, 0.0)}
    m = Mechanism(
        name="g",
        frame="f",
        links=(
            Link(name="f", points=points),
            wheel("a"),
            wheel("b", P=(0.02, 0.0)),
            Link(name="rod", points={"P": (0.0, 0.0), "S": (0.2, 0.0)}),
            Link(name="s", points={"S": (0.0, 0.0)}),
        ),
        joints=(
            _at("A", "f", "A", "a"),
            _at("B", "f", "B", "b"),
            Gear(name="G", links=("a", "b"), carrier="f", sizes=(1, 1)),
            pin("P", "b", "rod"),
            pin("S", "rod", "s"),
            Prismatic(name="T", links=("f", "s"), points=("A", "S")),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
        modes={"T": "ahead"},
    )
    with pytest.raises(MechanismError, match="how 'b' stands at the start"):
        compile_mechanism(m)
    motion = solve_motion(compile_mechanism(replace(m, sketch={"b": (0.1, 0.0, 1.0)})), THETA)
    np.testing.assert_allclose(motion.pose("b")[:, 2], 1.0 - THETA, rtol=1e-12)


@pytest.mark.parametrize("crossed", [False, True])
@pytest.mark.parametrize("moment", [-5.0, 5.0])
def test_belt_ratio_and_that_it_only_pulls(crossed, moment):
    m = Mechanism(
        name="belt",
        frame="frame",
        links=(Link(name="frame", points={"A": (0.0, 0.0), "B": (0.5, 0.2)}), wheel("a"), wheel("b", inertia=0.0, mass=0.0)),
        joints=(
            _at("A", "frame", "A", "a"),
            _at("B", "frame", "B", "b"),
            Belt(name="V", links=("a", "b"), carrier="frame", radii=(0.05, 0.15), crossed=crossed),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
        loads=(Torque(name="M", link="b", moment=moment),),
        effects=("gravity",),
    )
    forces = load(m, THETA, 2.0, 1.0)
    np.testing.assert_allclose(forces.motion.velocity("b")[:, 2], 2.0 / 3.0 * (-1 if crossed else 1), rtol=1e-12)
    sound(forces)
    towards = np.array([-0.5, -0.2])
    assert (forces.reaction("V")[:, :2] @ towards > 0).all(), "the belt pulls the second pulley towards the first"
    np.testing.assert_allclose(np.hypot(*forces.reaction("V")[:, :2].T), 5.0 / 0.15, rtol=1e-12)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("guide", [0, 1])
def test_rack_and_pinion(side, guide):
    m = Mechanism(
        name="rack",
        frame="frame",
        links=(
            Link(name="frame", points={"A": (0.0, 0.0), "G": (0.0, -0.04)}),
            wheel("pinion", centre=(0.01, 0.0)),
            Link(name="rack", points={"R": (0.0, 0.0)}, mass=3.0, centre=(0.1, 0.01)),
        ),
        joints=(
            _at("A", "frame", "A", "pinion"),
            Prismatic(name="S", links=("frame", "rack"), points=("G", "R"), along=(1.0, 0.0), guide=guide),
            Rack(name="Z", links=("pinion", "rack"), slider="S", radius=0.04, side=side),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
        effects=("inertia", "gravity"),
        loads=(Force(name="F", link="rack", point="R", vector=(-20.0, 0.0)),),
    )
    forces = load(m, THETA, 2.0, 1.0)
    # the rack lies below a pinion that is on the left of the direction +x: counter-clockwise moves it to the right
    np.testing.assert_allclose(forces.motion.velocity("rack")[:, 0], (1 if side == "left" else -1) * 0.04 * 2.0, rtol=1e-12)
    sound(forces)


@pytest.mark.parametrize("side", ["left", "right"])
def test_wheel_rolls_without_slipping(side):
    """A wheel on a plane driven along it by its centre: cycloids, and a contact force that balances everything."""
    m = Mechanism(
        name="wheel",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.1)}),
            wheel("wheel", centre=(0.02, 0.01), rim=(0.0, -0.1)),
            Link(name="cart", points={"c": (0.0, 0.0)}, mass=1.0),
        ),
        joints=(
            Rolling(name="W", links=("frame", "wheel"), points=("O", "c"), radius=0.1, side=side),
            pin("c", "cart", "wheel"),
            Prismatic(name="S", links=("frame", "cart"), points=("O", "c")),
        ),
        drives=(Drive(joint="S", law=ConstantSpeed(0.0, 1.0, travel=1.0)),),
        effects=("inertia", "gravity"),
    )
    forces = load(m, THETA / 10, 0.5, 0.3)
    turn = -1.0 if side == "left" else 1.0
    np.testing.assert_allclose(forces.motion.velocity("wheel")[:, 2], turn * 0.5 / 0.1, rtol=1e-12)
    contact = forces.position("W")
    np.testing.assert_allclose(contact[:, 1], 0.0 if side == "left" else 0.2, atol=1e-15)
    k = forces.motion.model.index["wheel"]
    at = np.array([complex(*p) for p in contact])
    slip = forces.motion.origin_velocities[k] + 1j * forces.motion.speeds.angular[forces.motion.model.angles.rotation_class[k]] * (
        at - forces.motion.origins[k]
    )
    assert np.abs(slip).max() < 1e-14
    sound(forces)
    normal = forces.reaction("W")[:, 1]
    assert (normal > 0).all(), "the edge carries the wheel"


def test_crank_and_rod_roll_a_wheel():
    """A slider-crank whose slider is a rolling wheel: nothing redundant, the contact force follows from the transposed blocks."""
    base = slider_crank(r=0.05, l=0.2, e=0.1)
    m = replace(
        base,
        links=(*base.links[:3], wheel("wheel", mass=3.0, inertia=0.01, centre=(0.02, 0.01))),
        joints=(
            *base.joints[:2],
            _at("C", "rod", "C", "wheel"),
            Rolling(name="W", links=("frame", "wheel"), points=("G", "c"), radius=0.1),
        ),
        modes={"W": "ahead"},
        effects=("inertia", "gravity"),
    )
    forces = load(m, THETA, 4.0, 3.0)
    motion = forces.motion
    assert not motion.model.redundant
    s = motion.coordinate("W")
    np.testing.assert_allclose(motion.velocity("wheel")[:, 2], -s[:, 1] / 0.1, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(motion.acceleration("wheel")[:, 2], -s[:, 2] / 0.1, rtol=1e-10, atol=1e-10)
    sound(forces)
    np.testing.assert_allclose(forces.position("W")[:, 1], 0.0, atol=1e-15)


def test_pin_in_slot_is_the_shaper():
    """A pin in a slotted lever moves as the block on the lever does, and presses square to the slot."""
    m = Mechanism(
        name="slot",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "B": (0.0, -0.12)}),
            Link(name="crank", points={"O": (0.0, 0.0), "A": (0.05, 0.0)}),
            Link(name="lever", points={"B": (0.0, 0.0)}, mass=2.0, centre=(0.1, 0.0), inertia=0.02),
        ),
        joints=(
            pin("O", "frame", "crank"),
            pin("B", "frame", "lever"),
            PinSlot(name="A", links=("lever", "crank"), points=("B", "A")),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, 1.0)),),
        effects=("inertia", "gravity"),
        modes={"A": "ahead"},
    )
    forces = load(m, THETA, 4.0)
    a = 0.05 * np.exp(1j * THETA) + 0.12j
    np.testing.assert_allclose(forces.motion.coordinate("A")[:, 0], np.abs(a), rtol=1e-13)
    np.testing.assert_allclose(np.exp(1j * forces.motion.pose("lever")[:, 2]), a / np.abs(a), rtol=1e-13)
    sound(forces)
    f = forces.reaction("A")
    along = np.real(np.conj(a / np.abs(a)) * (f[:, 0] + 1j * f[:, 1]))
    assert np.abs(along).max() < 1e-12 * np.abs(f).max() and np.abs(f[:, 2]).max() == 0.0


def test_weld_carries_a_couple_and_moves_as_one():
    base = four_bar(
        E=(0.28, 0.0),
        AB=0.1,
        BD=0.3,
        DE=0.25,
        effects=("inertia", "gravity"),
        bodies={"coupler": (1.0, (0.1, 0.0), 0.01), "rocker": (1.0, (0.1, 0.0), 0.01)},
    )
    plate = Link(name="plate", points={"W": (0.0, 0.0)}, mass=0.7, centre=(0.05, 0.02), inertia=0.004)
    coupler = replace(base.links[2], points={**base.links[2].points, "W": (0.12, 0.03)})
    m = replace(
        base,
        links=(*base.links[:2], coupler, base.links[3], plate),
        joints=(*base.joints, Weld(name="W", links=("coupler", "plate"), points=("W", "W"), angle=0.5)),
    )
    forces = load(m, THETA, 5.0, 3.0)
    np.testing.assert_allclose(forces.motion.pose("plate")[:, 2] - forces.motion.pose("coupler")[:, 2], 0.5, rtol=1e-12)
    sound(forces)
    assert np.abs(forces.reaction("W")[:, 2]).min() >= 0 and np.abs(forces.reaction("W")[:, 2]).max() > 1e-3


def test_cylinder_lifts_a_boom():
    """Length driven; the boom's angle by the cosine rule, the force by virtual work."""
    m = Mechanism(
        name="boom",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "P": (0.5, -0.3)}),
            Link(name="boom", points={"O": (0.0, 0.0), "Q": (0.9, 0.1)}, mass=40.0, centre=(1.0, 0.0), inertia=9.0),
        ),
        joints=(pin("O", "frame", "boom"), Cylinder(name="C", links=("frame", "boom"), points=("P", "Q"))),
        drives=(Drive(joint="C", law=Oscillation(0.7, 0.2, 0.5)),),
        effects=("inertia", "gravity"),
        sketch={"boom": (0.0, 0.0, 0.4)},
    )
    compiled = compile_mechanism(m)
    forces = solve_forces(solve_motion(compiled, np.linspace(0.0, 2.0, 41)))
    length = forces.motion.coordinate("C")
    p, q = np.hypot(0.5, 0.3), np.hypot(0.9, 0.1)
    inner = np.arccos((p**2 + q**2 - length[:, 0] ** 2) / (2 * p * q))
    angle = inner + np.arctan2(-0.3, 0.5) - np.arctan2(0.1, 0.9)
    np.testing.assert_allclose(forces.motion.pose("boom")[:, 2], angle, atol=1e-13)
    sound(forces)
    power = forces.power("C")
    np.testing.assert_allclose(power, forces.effort("C") * length[:, 1], rtol=1e-12, atol=1e-12)
    assert {"C.barrel", "C.rod"} <= set(compiled.model.links)


def test_geared_five_bar_with_a_gear_on_the_coupler():
    """The crank is a gear and drives one on the coupler: this needs the angle of a closed-form group beyond one turn."""
    base = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, speed=1.0)
    tip = wheel("idler", mass=0.5, inertia=0.02, centre=(0.01, 0.0))
    coupler = replace(base.links[2], points={**base.links[2].points, "M": (0.12, 0.0)})
    direct = replace(
        base,
        links=(*base.links[:2], coupler, base.links[3], tip),
        joints=(
            *base.joints,
            _at("i", "coupler", "M", "idler"),
            Gear(name="G", links=("crank", "idler"), carrier="coupler", sizes=(20, 40)),
        ),
        effects=("inertia", "gravity"),
    )
    compiled = compile_mechanism(direct)
    for times in (np.linspace(0.0, 50.0, 2001), np.linspace(0.0, 50.0, 6)):
        motion = solve_motion(compiled, times)
        crank, coupler_angle, idler = (motion.pose(k)[:, 2] for k in ("crank", "coupler", "idler"))
        relative = 20 * (crank - coupler_angle) + 40 * (idler - coupler_angle)
        np.testing.assert_allclose(relative, relative[0], atol=1e-9)
        last = idler[-1]
    sound(solve_forces(motion))
    assert abs(last + 50.0 / 2) < 2.0, "the idler runs on, half as fast as the crank, through eight turns"


def test_two_mechanisms_coupled_by_a_gear():
    """Two slider-cranks side by side, the second driven by the first through a gear pair of ratio 2."""
    a = slider_crank(r=0.05, l=0.18)
    rename = {"crank": "crank2", "rod": "rod2", "piston": "piston2"}
    b = [replace(x, name=rename[x.name]) for x in a.links if x.name in rename]
    frame = Link(name="frame", points={**a.links[0].points, "O2": (0.0, 0.3), "G2": (0.0, 0.3)})

    def second(p):
        links = tuple(rename.get(k, k) for k in p.links)
        points = tuple({"O": "O2", "G": "G2"}.get(x, x) if k == "frame" else x for k, x in zip(p.links, p.points, strict=True))
        return replace(p, name=p.name + "2", links=links, points=points)

    m = replace(
        a,
        links=(frame, *(replace(x, mass=1.0, inertia=0.01) for x in a.links[1:]), *(replace(x, mass=2.0, inertia=0.02) for x in b)),
        joints=(*a.joints, *map(second, a.joints), Gear(name="G", links=("crank", "crank2"), carrier="frame", sizes=(20, 40))),
        modes={"S": "ahead", "S2": "ahead"},
        sketch={"crank2": (0.0, 0.3, 0.7)},
        effects=("inertia", "gravity"),
    )
    forces = load(m, THETA, 3.0, 1.0)
    np.testing.assert_allclose(forces.motion.pose("crank2")[:, 2], 0.7 - THETA / 2, rtol=1e-12)
    x = 0.05 * np.cos(0.7 - THETA / 2)
    y = 0.05 * np.sin(0.7 - THETA / 2)
    np.testing.assert_allclose(forces.motion.coordinate("S2")[:, 0], x + np.sqrt(0.18**2 - y**2), rtol=1e-12)
    sound(forces)


def test_a_drive_on_a_gear_joint_is_refused():
    m = gear_train()
    with pytest.raises(MechanismError, match="no coordinate that a drive could prescribe"):
        compile_mechanism(replace(m, drives=(Drive(joint="G", law=ConstantSpeed(0.0, 1.0)),)))


@pytest.mark.parametrize(
    ("mechanism", "formula"),
    [
        (planetary(), (4, 4, 2, -1)),
        (gear_train(), (2, 2, 1, 1)),
    ],
    ids=["planetary", "gears"],
)
def test_mobility_counts_gears_as_higher_joints(mechanism, formula):
    from mechcore.motion.structure import gruebler, rank_mobility

    motion = move(mechanism, [0.3])
    n, p5, p4, w = formula
    assert gruebler(motion.model)[:3] == (n, p5, p4)
    assert (
        gruebler(motion.model)[3]
        == 3 * n - 2 * p5 - p4 - 3 * sum(isinstance(p, Weld) for p in mechanism.joints)
        == (w if w >= 0 else 3 * 4 - 2 * 4 - 2 - 3)
    )
    assert rank_mobility(motion) == 1


def test_mobility_of_slots_racks_and_rolling():
    from mechcore.motion.structure import gruebler, rank_mobility

    slot = Mechanism(
        name="slot",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "B": (0.0, -0.12)}),
            Link(name="crank", points={"O": (0.0, 0.0), "A": (0.05, 0.0)}),
            Link(name="lever", points={"B": (0.0, 0.0)}),
        ),
        joints=(
            pin("O", "frame", "crank"),
            pin("B", "frame", "lever"),
            PinSlot(name="A", links=("lever", "crank"), points=("B", "A")),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(0.0, 1.0)),),
        modes={"A": "ahead"},
    )
    rack = Mechanism(
        name="rack",
        frame="frame",
        links=(
            Link(name="frame", points={"A": (0.0, 0.0), "G": (0.0, -0.04)}),
            wheel("pinion"),
            Link(name="rack", points={"R": (0.0, 0.0)}),
        ),
        joints=(
            _at("A", "frame", "A", "pinion"),
            Prismatic(name="S", links=("frame", "rack"), points=("G", "R")),
            Rack(name="Z", links=("pinion", "rack"), slider="S", radius=0.04),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
    )
    wheeled = Mechanism(
        name="wheel",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.1)}), wheel("wheel"), Link(name="cart", points={"c": (0.0, 0.0)})),
        joints=(
            Rolling(name="W", links=("frame", "wheel"), points=("O", "c"), radius=0.1),
            pin("c", "cart", "wheel"),
            Prismatic(name="S", links=("frame", "cart"), points=("O", "c")),
        ),
        drives=(Drive(joint="S", law=ConstantSpeed(0.0, 1.0, travel=1.0)),),
    )
    for mechanism, counts in ((slot, (2, 2, 1, 1)), (rack, (2, 2, 1, 1)), (wheeled, (2, 3, 0, 0))):
        motion = move(mechanism, [0.3])
        assert gruebler(motion.model) == counts, mechanism.name
        assert rank_mobility(motion) == 1, mechanism.name


def test_slide_on_a_turning_arm_has_its_coriolis_acceleration():
    """An open chain with two drives: r'' - r w^2 along the arm, r e + 2 r' w across it."""
    m = Mechanism(
        name="polar",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            Link(name="arm", points={"O": (0.0, 0.0)}),
            Link(name="tool", points={"T": (0.0, 0.0)}, mass=2.0),
        ),
        joints=(pin("O", "frame", "arm"), Prismatic(name="S", links=("arm", "tool"), points=("O", "T"))),
        drives=(Drive(joint="O", law=Oscillation(0.3, 0.8, 0.4)), Drive(joint="S", law=Oscillation(1.0, 0.5, 0.7, 0.2))),
        effects=("inertia",),
    )
    forces = solve_forces(solve_motion(compile_mechanism(m), np.linspace(0.0, 2.0, 31)))
    motion = forces.motion
    q, w, e = motion.coordinate("O").T
    r, v, a = motion.coordinate("S").T
    along, across = np.exp(1j * q), 1j * np.exp(1j * q)
    expected = (a - r * w**2) * along + (r * e + 2 * v * w) * across
    np.testing.assert_allclose(motion.point("tool", "T", 2) @ [1, 1j], expected, rtol=1e-12)
    np.testing.assert_allclose(forces.effort("S"), 2.0 * (a - r * w**2), rtol=1e-11)
    np.testing.assert_allclose(forces.effort("O"), 2.0 * r * (r * e + 2 * v * w), rtol=1e-10, atol=1e-12)
    sound(forces)


def on_one_shaft(joined: str) -> Mechanism:
    """A wheel that the frame does not carry directly: it sits on the shaft of an arm that does."""
    links = [
        Link(name="frame", points={"O": (0.0, 0.0), "B": (0.3, 0.1)}),
        Link(name="arm", points={"c": (0.01, -0.02), "T": (0.2, 0.0)}),
        Link(name="shaft", points={"c": (0.0, 0.1), "d": (0.05, 0.1)}),
        wheel("a"),
        wheel("b"),
    ]
    joints = [_at("O", "frame", "O", "arm")]
    if joined == "pins":  # a turns on the shaft, the shaft on the arm, the arm on the frame
        joints += [_at("S", "arm", "c", "shaft"), _at("A", "shaft", "c", "a")]
    else:  # a is welded to the shaft, away from the axis
        links[3] = wheel("a", e=(0.05, 0.0))
        joints += [_at("A", "arm", "c", "shaft"), Weld(name="W", links=("a", "shaft"), points=("e", "d"))]
    joints += [_at("B", "frame", "B", "b"), Gear(name="G", links=("a", "b"), carrier="frame", sizes=(20, 30))]
    drives = [Drive(joint=p.name, law=ConstantSpeed(0.1, 1.0)) for p in joints if p.name in ("O", "S", "A")]
    return Mechanism(name="shaft", frame="frame", links=tuple(links), joints=tuple(joints), drives=tuple(drives))


@pytest.mark.parametrize(("joined", "speed"), [("pins", 3.0), ("weld", 2.0)])
def test_wheels_may_share_an_axis_by_way_of_other_links(joined, speed):
    m = on_one_shaft(joined)
    forces = load(replace(m, effects=("inertia",), loads=(Torque(name="M", link="b", moment=2.0),)), THETA, 1.0)
    np.testing.assert_allclose(forces.motion.velocity("a")[:, 2], speed, rtol=1e-12)
    np.testing.assert_allclose(forces.motion.velocity("b")[:, 2], -speed * 2.0 / 3.0, rtol=1e-12)
    pitch = np.array([0.3, 0.1]) * 0.4
    np.testing.assert_allclose(forces.position("G"), np.tile(pitch, (len(THETA), 1)), atol=1e-14)
    sound(forces)


def test_a_pin_beside_the_axis_is_not_on_it():
    m = on_one_shaft("pins")
    beside = tuple(_at("A", "shaft", "d", "a") if p.name == "A" else p for p in m.joints)
    with pytest.raises(
        MechanismError, match=r"'a' is not pinned to 'frame'.* nor to anything on the same axis\. It is pinned to 'shaft'"
    ):
        compile_mechanism(replace(m, joints=beside))


@pytest.mark.parametrize(
    ("radii", "crossed", "fits"),
    [((0.6, 0.05), False, False), ((0.55, 0.05), False, False), ((0.54, 0.05), False, True), ((0.3, 0.25), True, False),
     ((0.2, 0.3), True, False), ((0.2, 0.29), True, True), ((0.3, 0.25), False, True), ((0.0, 0.1), False, False)],
)  # fmt: skip
def test_belts_that_cannot_fit_are_refused_with_values(radii, crossed, fits):
    """Open: the axes are farther apart than the radii differ; crossed: than they add up to."""
    m = Mechanism(
        name="belt",
        frame="frame",
        links=(Link(name="frame", points={"A": (0.0, 0.0), "B": (0.3, 0.4)}), wheel("a"), wheel("b")),
        joints=(
            _at("A", "frame", "A", "a"),
            _at("B", "frame", "B", "b"),
            Belt(name="V", links=("a", "b"), carrier="frame", radii=radii, crossed=crossed),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 1.0)),),
    )
    if fits:
        compile_mechanism(m)
        return
    values = f"{1e3 * radii[0]:.6g} mm and {1e3 * radii[1]:.6g} mm do not fit on axes 500 mm apart"
    with pytest.raises(MechanismError, match=values):
        compile_mechanism(m)


# -- screws -----------------------------------------------------------------------------------------------------------
LEAD, MEAN, MASS, G = 0.005, 0.009, 3.0, 9.81  # [m], [m], [kg], [m/s^2]


def _run(mechanism: Mechanism, frames: int):
    return solve_motion(compile_mechanism(mechanism), default_times(mechanism, frames))


def lift(mu: float = 0.0, guide: int = 0, **drive: object) -> Mechanism:
    """A mass that a screw lifts against its weight; with ``guide`` 1 the guide goes along with the mass, round the nut at rest."""
    along = (0.0, 2.0) if guide == 0 else (0.0, -2.0)
    rough = Friction(coefficient=mu, radius=MEAN) if mu else None
    return Mechanism(
        name="lift",
        frame="frame",
        links=(
            Link(name="frame", points={"G": (0.1, 0.2)}),
            Link(name="mass", points={"P": (0.02, 0.0)}, mass=MASS, centre=(0.02, 0.0), inertia=0.01),
        ),
        joints=(Screw(name="S", links=("frame", "mass"), points=("G", "P"), lead=LEAD, along=along, guide=guide, friction=rough),),
        effects=("gravity", "inertia", *(["friction"] if mu else [])),
        **drive,
    )


@pytest.mark.parametrize("guide", [0, 1])
@pytest.mark.parametrize("turns", [2.0, -2.0])
@pytest.mark.parametrize("mu", [0.0, 0.05, 0.3])
def test_a_screw_lifts_by_its_lead_with_the_torque_of_power_screws(guide, turns, mu):
    """Shigley: F r tan(lead angle + friction angle) upwards, with their difference downwards; 0.3 locks itself."""
    machine = lift(mu, guide, drives=(Drive(joint="S", law=ConstantSpeed(0.3, turns * 2.0 * np.pi)),))
    forces = solve_forces(_run(machine, 6))
    t, lead, friction = forces.motion.time, np.arctan(LEAD / (2.0 * np.pi * MEAN)), np.arctan(mu)
    height = 0.2 + LEAD * (0.3 / (2.0 * np.pi) + turns * t)
    assert forces.motion.point("mass", "P") == pytest.approx(np.array([0.1 + 0.0 * t, height]).T, abs=1e-15)
    torque = MASS * G * MEAN * np.tan(lead + np.sign(turns) * friction)
    assert forces.effort("S") == pytest.approx(np.full(len(t), torque), rel=1e-12)
    thrust = MASS * G * (1.0 if guide == 0 else -1.0)  # on the spindle, by the link in which it turns
    assert forces.reaction("S") == pytest.approx(np.tile([0.0, thrust, -torque], (len(t), 1)), abs=1e-12 * MASS * G)
    assert np.abs(forces.power_balance).max() < 1e-12


@pytest.mark.parametrize("guide", [0, 1])
def test_a_screw_on_a_turning_link_is_a_slide_whose_force_is_a_torque(guide):
    """Beside a prismatic joint with the same travel: the same motion and reactions, so that the torque loads no link."""

    def crane(joint, law):
        return Mechanism(
            name="crane",
            frame="frame",
            links=(
                Link(name="frame", points={"A": (0.0, 0.0)}),
                Link(name="jib", points={"A": (0.0, 0.0), "R": (0.1, 0.03)}, mass=4.0, centre=(0.3, 0.1), inertia=0.5),
                Link(name="trolley", points={"T": (0.0, 0.0), "Q": (0.05, -0.1)}, mass=MASS, centre=(0.01, -0.02), inertia=0.02),
            ),
            joints=(Revolute(name="A", links=("frame", "jib"), points=("A", "A")), joint),
            drives=(Drive(joint="A", law=Oscillation(0.4, 0.7, 1.0)), Drive(joint="S", law=law)),
            loads=(Force(name="F", link="trolley", point="Q", vector=(20.0, -300.0)),),
            effects=("gravity", "inertia"),
        )  # fmt: skip

    common = {"name": "S", "links": ("jib", "trolley"), "points": ("R", "T"), "along": (0.8, 0.3), "guide": guide, "angle": 0.2}
    travel = LEAD / (2.0 * np.pi)
    screw, slide = (
        solve_forces(_run(crane(joint, Oscillation(60.0 * c, 50.0 * c, 1.5)), 40))
        for joint, c in ((Screw(**common, lead=LEAD), 1.0), (Prismatic(**common), travel))
    )
    assert screw.motion.pose("trolley") == pytest.approx(slide.motion.pose("trolley"), abs=1e-13)
    assert screw.effort("S") == pytest.approx(travel * slide.effort("S"), abs=1e-11)
    assert screw.effort("A") == pytest.approx(slide.effort("A"), abs=1e-9)
    assert screw.reaction("A") == pytest.approx(slide.reaction("A"), abs=1e-9)
    assert screw.reaction("S.slide") == pytest.approx(slide.reaction("S"), abs=1e-9)


def test_a_load_turns_a_screw_that_does_not_lock_itself_against_viscous_drag():
    """m s'' = m g - F, F r tan(lead angle - friction angle) = c omega: the speed tends to its limit exponentially."""
    lead, friction, drag = np.arctan(0.04 / (2.0 * np.pi * MEAN)), np.arctan(0.1), 2e-3
    loads = (Viscous(name="c", joint="S", coefficient=drag),)
    machine = lift(0.1, drives=(Drive(joint="S", law=Free(0.0, 0.0)),), loads=loads)
    machine = replace(machine, joints=(replace(machine.joints[0], lead=0.04),))
    t = np.linspace(0.0, 0.5, 6)
    computed = simulate(compile_mechanism(machine), 0.5, tolerance=1e-11)(t)[1][:, 0]
    arm, travel = MEAN * np.tan(lead - friction), 0.04 / (2.0 * np.pi)
    limit, settling = MASS * G * arm / drag, MASS * travel * arm / drag
    assert computed == pytest.approx(-limit * (1.0 - np.exp(-t / settling)), abs=1e-7 * limit)


@pytest.mark.parametrize("mu", [0.1, 0.0885])
def test_a_self_locking_screw_needs_a_drive(mu):
    """tan of the lead angle is 5 / (2 pi 9) = 0.0884: a little above it nothing but a drive turns the spindle."""
    machine = lift(mu, drives=(Drive(joint="S", law=Free(0.0, -1.0)),))
    with pytest.raises(MechanismError, match=r"joints\.S\.friction: the thread locks itself.*0\.08842"):
        simulate(compile_mechanism(machine), 0.1)
    free = simulate(compile_mechanism(lift(0.088, drives=machine.drives)), 0.1)([0.1])[0]
    assert free[0, 0] == pytest.approx(-0.1 - 0.5 * G * 0.01 * 2.0 * np.pi / LEAD, rel=1e-9), (
        "nothing holds a spindle without inertia"
    )
