"""Cases that once gave silent wrong numbers or a traceback: found by trying to break the core."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import drawn, four_bar, load, pin, polynomial_through
from wheels import THETA, sound, wheel

from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import ConstantSpeed, Oscillation, Piecewise, zones
from mechcore.motion.reach import reachable_ranges
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.loads import Torque
from mechcore.spec.mechanism import Drive, Gear, Link, Mechanism, Prismatic, Revolute, Rolling

TURN = 2.0 * np.pi


def parallelogram(law) -> Mechanism:
    m = four_bar(E=(2.0, 0.0), AB=1.0, BD=2.0, DE=1.0, start=1.0)
    start = float(law(0.0)[0])
    return replace(m, drives=(Drive(joint="A", law=law),), modes={"D": "left" if np.sin(start + 1e-9) > 0 else "right"})


DWELL = Piecewise(
    knots=(0.0, 1.0, 2.0, 3.0),
    coefficients=(
        polynomial_through(0.0, (1.0, 0.0, 0.0), 1.0, (0.0, 0.0, 0.0)),
        (0.0,),
        polynomial_through(2.0, (0.0, 0.0, 0.0), 3.0, (1.0, 0.0, 0.0)),
    ),
)


@pytest.mark.parametrize(
    ("law", "end"),
    [
        (ConstantSpeed(1.0, 1.0, travel=2.0), 6.0),
        (ConstantSpeed(0.0, 1.0, travel=2.0), 8.0),
        (ConstantSpeed(1.0, TURN, travel=20 * TURN), 20.0),
        (zones(start=0.0, speed=1.0, run_up=0.5, steady=1.0, braking=0.5), 9.0),
        (zones(start=0.5, speed=1.0, run_up=0.5, steady=1.0, braking=np.pi - 2.0), 4.283185307179586),
        (Oscillation(np.pi / 6, np.pi / 6, 0.5), 4.0),
        (Oscillation(0.5, 20 * np.pi, 0.1), 10.0),
        (DWELL, 3.0),
    ],
    ids=[
        "travel",
        "travel from a change point",
        "many turns a cycle",
        "zones",
        "stops on it",
        "reverses on it",
        "swings far",
        "dwells on it",
    ],
)
def test_a_parallelogram_stays_one_whatever_its_drive_does(law, end):
    motion = solve_motion(compile_mechanism(parallelogram(law)), np.linspace(0.0, end, 1441))
    np.testing.assert_allclose(motion.pose("rocker")[:, 2], motion.pose("crank")[:, 2], atol=1e-9)
    np.testing.assert_allclose(motion.velocity("rocker")[:, 2], motion.drives[0][1], atol=1e-7 * np.abs(motion.drives[0][1]).max())
    assert np.isfinite(motion.acceleration("coupler")).all()
    assert motion.closure.max() < 1e-12 * 2.0


def two_parallelograms(first, second_law) -> Mechanism:
    a = parallelogram(first)
    rename = {"crank": "crank2", "coupler": "coupler2", "rocker": "rocker2"}
    frame = replace(a.links[0], points={**a.links[0].points, "A2": (0.0, 5.0), "E2": (2.0, 5.0)})
    pins = {"A": "A2", "E": "E2"}
    second = [
        Revolute(
            name=p.name + "2",
            links=tuple(rename.get(k, k) for k in p.links),
            points=tuple(pins.get(x, x) if k == "frame" else x for k, x in zip(p.links, p.points, strict=True)),
        )
        for p in a.joints
    ]
    return replace(
        a,
        links=(frame, *a.links[1:], *(replace(x, name=rename[x.name]) for x in a.links[1:])),
        joints=(*a.joints, *second),
        drives=(*a.drives, Drive(joint="A2", law=second_law)),
        modes={"D": "left", "D2": "left"},
    )


@pytest.mark.parametrize("ratio", [1.0 / 3.0, 1.618])
def test_two_drives_whose_cycles_do_not_fit_together(ratio):
    m = two_parallelograms(ConstantSpeed(1.0, 1.0), ConstantSpeed(0.7, ratio))
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, 40.0, 2001))
    for crank, rocker in (("crank", "rocker"), ("crank2", "rocker2")):
        np.testing.assert_allclose(motion.velocity(rocker)[:, 2], motion.velocity(crank)[:, 2], atol=1e-8)
    assert motion.closure.max() < 1e-11


@pytest.mark.parametrize("least", [0.0, 0.1, -0.1])
def test_a_drive_that_turns_back_just_at_a_change_point_or_beside_it(least):
    """Led by two laws: where the first turns back on the flat position itself, the modes meet but are not exchanged."""
    law = Oscillation(0.6, 0.6 - least, 0.5)
    motion = solve_motion(compile_mechanism(two_parallelograms(law, ConstantSpeed(0.7, 0.9))), np.linspace(0.0, 6.0, 1441))
    for crank, rocker in (("crank", "rocker"), ("crank2", "rocker2")):
        np.testing.assert_allclose(motion.pose(rocker)[:, 2], motion.pose(crank)[:, 2], atol=1e-9)
        np.testing.assert_allclose(motion.velocity(rocker)[:, 2], motion.velocity(crank)[:, 2], atol=1e-6)


@pytest.mark.parametrize(("frames", "cycles"), [(360, 1000), (12, 10), (10, 10), (2, 1)])
def test_angles_through_few_frames_and_many_turns(frames, cycles):
    drag_link = four_bar(E=(0.5, 0.0), AB=2.0, BD=2.2, DE=2.1, start=1.0)
    motion = solve_motion(compile_mechanism(drag_link), default_times(drag_link, frames, cycles))
    for link in ("coupler", "rocker"):
        angle = motion.pose(link)[:, 2]
        assert angle[-1] - angle[0] == pytest.approx(TURN * cycles, rel=1e-9), link


def test_a_geared_follower_of_a_turning_rocker_keeps_its_turns():
    base = four_bar(E=(0.5, 0.0), AB=2.0, BD=2.2, DE=2.1, start=1.0)
    frame = replace(base.links[0], points={**base.links[0].points, "W": (3.5, 0.0)})
    m = replace(
        base,
        links=(frame, *base.links[1:], wheel("pinion")),
        joints=(
            *base.joints,
            Revolute(name="W", links=("frame", "pinion"), points=("W", "c")),
            Gear(name="G", links=("rocker", "pinion"), carrier="frame", sizes=(20, 30)),
        ),
    )
    motion = solve_motion(compile_mechanism(m), default_times(m, 1080, 3))
    pinion = motion.pose("pinion")[:, 2]
    assert pinion[-1] - pinion[0] == pytest.approx(-3 * TURN * 2 / 3, rel=1e-9)
    assert np.abs(np.diff(pinion)).max() < 0.1


@pytest.mark.parametrize("order", [("planet", "rocker"), ("rocker", "planet")])
def test_forces_of_a_gear_that_a_moving_link_carries(order):
    """The planet's wheel partner is pinned to the carrier by the loop's closing joint."""
    base = four_bar(E=(2.0, 0.0), AB=0.5, BD=1.8, DE=1.5, start=1.0, coupler_point=(1.0, 0.7))
    m = replace(
        base,
        links=(*base.links, wheel("planet")),
        joints=(
            *base.joints,
            Revolute(name="P", links=("coupler", "planet"), points=("P", "c")),
            Gear(name="G", links=order, carrier="coupler", sizes=(20, 30)),
        ),
        loads=(Torque(name="M", link="planet", moment=3.0),),
        effects=("inertia", "gravity"),
    )
    sound(load(m, THETA, 2.0, 1.0))


def test_reaction_of_a_driven_rolling_joint_leaves_the_drive_out():
    m = Mechanism(
        name="wheel",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.5)}), wheel("wheel")),
        joints=(Rolling(name="W", links=("frame", "wheel"), points=("O", "c"), radius=0.5),),
        drives=(Drive(joint="W", law=ConstantSpeed(0.0, 1.0, travel=2.0)),),
        loads=(Torque(name="M", link="wheel", moment=3.0),),
    )
    forces = load(m, [0.0, 1.0])
    np.testing.assert_allclose(forces.reaction("W")[:, 0], -6.0, rtol=1e-12)
    np.testing.assert_allclose(forces.wrench("W")[:, 0], 6.0, rtol=1e-12)
    sound(forces)


def test_three_drives_in_series_are_assembled_where_they_stand():
    points = {"O": (0.0, 0.0), "P": (0.0, 1.0), "Q": (0.9, 1.5), "H": (0.5, 1.2), "T": (1.2, 0.1), "F": (2.0, -1.0)}
    base = drawn(points, {"a": "OP", "b": "PQ", "c": "QH", "d": "HT", "e": "TF"}, "OF", drive="O", law=ConstantSpeed(0.3, 0.1))
    m = replace(
        base,
        drives=tuple(Drive(joint=p, law=ConstantSpeed(q, 0.1)) for p, q in (("O", 0.3), ("P", -0.5), ("Q", 0.7))),
    )
    compiled = compile_mechanism(replace(m, sketch={}, modes={"T": "left"}))
    motion = solve_motion(compiled, [0.0])
    for name, angle in (("a", 0.3), ("b", -0.2), ("c", 0.5)):
        k = compiled.model.index[name]
        rotation_class = compiled.model.angles.rotation_class[k]
        assert np.angle(complex(compiled.assembly.state.rot[rotation_class])) == pytest.approx(angle)
        assert motion.pose(name)[0, 2] == pytest.approx(angle)


def test_a_block_of_slides_only():
    def slide(name, first, second, along):
        return Prismatic(name=name, links=(first, second), points=("O", "O"), along=along)

    names = ("frame", "a", "b", "c")
    m = Mechanism(
        name="slides",
        frame="frame",
        links=tuple(Link(name=n, points={"O": (0.0, 0.0)}, mass=1.0) for n in names),
        joints=(
            slide("1", "frame", "a", (1.0, 0.2)),
            slide("2", "a", "b", (0.0, 1.0)),
            slide("3", "frame", "b", (1.0, 1.0)),
            slide("4", "b", "c", (1.0, 0.3)),
            slide("5", "c", "a", (0.2, 1.0)),
        ),
        drives=(Drive(joint="1", law=ConstantSpeed(0.1, 1.0, travel=0.5)),),
        effects=("gravity",),
    )
    forces = solve_forces(solve_motion(compile_mechanism(m), np.linspace(0.0, 0.5, 5)))
    assert forces.motion.closure.max() < 1e-14
    assert np.abs(forces.power_balance).max() < 1e-10


@pytest.mark.parametrize("frames", [2, 3, 12])
def test_a_stretch_between_frames_that_cannot_be_assembled_is_refused(frames):
    m = four_bar(E=(1.0, 0.0), AB=0.9, BD=0.6, DE=0.7, start=0.9)  # cannot turn fully
    with pytest.raises(MechanismError, match="cannot be assembled"):
        solve_motion(compile_mechanism(m), default_times(m, frames))


def test_pins_at_the_same_place_in_another_order():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, effects=("gravity",), bodies={"coupler": (1.0, (0.1, 0.0), 0.0)})
    turned = replace(
        m,
        joints=(
            pin("A", "frame", "crank"),
            pin("B", "coupler", "crank"),
            pin("D", "rocker", "coupler"),
            pin("E", "rocker", "frame"),
        ),
    )
    a, b = load(m, THETA), load(replace(turned, modes={"D": "right"}), THETA)
    for name, sign in (("A", 1.0), ("B", -1.0), ("D", -1.0), ("E", -1.0)):
        np.testing.assert_allclose(b.reaction(name), sign * a.reaction(name), rtol=1e-9, atol=1e-12)


def test_two_groups_with_a_limit_each():
    """The range is that of the narrower one, whichever comes first."""
    base = four_bar(E=(1.0, 0.0), AB=0.9, BD=0.6, DE=0.7, start=0.4)  # limit: B and E farther apart than 1.3
    frame = replace(base.links[0], points={**base.links[0].points, "H": (0.4, 1.0)})
    rod = Link(name="rod", points={"F": (0.0, 0.0), "G": (0.9, 0.0)})
    last = Link(name="last", points={"H": (0.0, 0.0), "G": (0.5, 0.0)})
    crank = replace(base.links[1], points={**base.links[1].points, "F": (0.5, 0.0)})
    m = replace(
        base,
        links=(frame, crank, *base.links[2:], rod, last),
        joints=(*base.joints, pin("F", "crank", "rod"), pin("G", "rod", "last"), pin("H", "frame", "last")),
        modes={**base.modes, "G": "left"},
    )
    low, high = reachable_ranges(compile_mechanism(m))[0]
    outer = np.arccos((0.81 + 1.0 - 1.69) / 1.8)
    assert high == pytest.approx(outer, abs=1e-9)
    f = np.linspace(low, high, 1001)
    away = np.abs(0.5 * np.exp(1j * f) - (0.4 + 1.0j))
    assert away.max() <= 1.4 + 1e-9 and low == pytest.approx(max(-outer, _angle_at(1.4)), abs=1e-9)


def _angle_at(reach: float) -> float:
    """Crank angle below zero at which F is ``reach`` away from H: law of cosines about A."""
    h = 0.4 + 1.0j
    return float(np.angle(h) - np.arccos((0.25 + abs(h) ** 2 - reach**2) / (2 * 0.5 * abs(h))))


def test_a_motion_below_rounding_is_not_searched_for_changes():
    """Three bars drawn straight by the fourth, turned by rounding only: no height of the triangle is a change."""
    turn = 0.7
    for lengths in ((0.31, 0.43, 0.29), (0.97, 1.13, 0.41)):
        far = sum(lengths) * np.exp(1j * turn)
        base = four_bar(E=(far.real, far.imag), AB=lengths[0], BD=lengths[1], DE=lengths[2], start=turn)
        m = replace(base, drives=(Drive(joint="A", law=Oscillation(turn, 1e-12, 1.0)),))
        compiled = compile_mechanism(m)
        assert compiled.singular_points is not None and len(compiled.singular_points.points) < 10
        assert solve_motion(compiled, default_times(m, 20)).closure.max() < 1e-9


def test_the_range_that_fails_is_that_of_all_its_frames():
    """A drive that turns back within the range: its ends are not where the range was entered and left."""
    base = four_bar(E=(1.0, 0.0), AB=0.9, BD=0.6, DE=0.7, start=0.4)  # limit: B and E farther apart than 1.3
    m = replace(base, drives=(Drive(joint="A", law=Oscillation(0.4, 1.4, 1.0)),))
    with pytest.raises(MechanismError, match=r"from 8[67][0-9.]+° to 103\.132°"):  # up to 1.8 rad
        solve_motion(compile_mechanism(m), default_times(m, 360))
