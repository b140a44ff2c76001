"""Cams as joints of the core: motion against the law, contact against the profile, forces in balance, faults."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from cam_mechanisms import FOLLOWERS, SPEED, lift, oscillating, translating, wedge
from random_linkages import balance_of_links

from mechcore.cams.closures import Closure, closing_force
from mechcore.cams.contour import cam_contour
from mechcore.cams.followers import Flat, Knife, Roller
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.program import Segment, program
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.at_once import agreement
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.motion.structure import gruebler, rank_mobility, redundant_joints
from mechcore.spec.loads import Force
from mechcore.spec.mechanism import CamJoint, Drive, Gear, Link, Prismatic, Revolute


def solved(mechanism, frames: int = 91):
    motion = solve_motion(
        compile_mechanism(mechanism), np.linspace(0.0, mechanism.drives[0].law.duration, frames, endpoint=False) + 1e-4
    )
    return motion, solve_forces(motion)


def placed_of(motion, name: str = "K"):
    return next(r.geometry for r in motion.model.relations if r.name == name)


@pytest.mark.parametrize("name", FOLLOWERS)
def test_forces_balance_and_power_closes(name):
    motion, forces = solved(FOLLOWERS[name])
    assert [b.kind for b in motion.model.blocks] == ["relation"]  # closed form: the follower is simply driven
    assert np.abs(forces.power_balance).max() < 1e-12
    assert balance_of_links(forces) < 1e-11
    assert np.abs(forces.reaction("K")[:, :2]).max() > 1.0


@pytest.mark.parametrize("name", FOLLOWERS)
def test_rates_are_the_derivatives_of_positions(name):
    mechanism = FOLLOWERS[name]
    h = 1e-5
    t = np.linspace(0.1, 0.9, 17)[:, None] * mechanism.drives[0].law.duration + h * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    motion = solve_motion(compile_mechanism(mechanism), t.ravel())
    for values, rates in ((motion.pose, motion.velocity), (motion.velocity, motion.acceleration)):
        p = values("follower").reshape(17, 5, 3)
        slope = (p[:, 0] - 8.0 * p[:, 1] + 8.0 * p[:, 3] - p[:, 4]) / (12.0 * h)
        exact = rates("follower").reshape(17, 5, 3)[:, 2]
        np.testing.assert_allclose(slope, exact, atol=2e-6 * max(1e-3, np.abs(exact).max()))


@pytest.mark.parametrize("name", [n for n, m in FOLLOWERS.items() if m.name != "wedge"])
def test_the_contact_is_where_the_turned_profile_is(name):
    """The profile, fixed to the cam's link, passes through the contact with the contact's normal; the follower's point is
    where roller, knife or face says."""
    motion, _ = solved(FOLLOWERS[name], 25)
    placed = placed_of(motion)
    rows = placed.rows(motion)
    contour = cam_contour(placed.cam)
    z = contour(np.linspace(0.0, contour.count, 20001))[0]
    on_link = placed.mount_origin + placed.mount * z
    k = motion.model.index["cam"]
    profile = motion.origins[k] + np.multiply.outer(np.broadcast_to(motion.rotation(k), (25,)), on_link).reshape(25, -1)
    assert np.abs(profile - rows.place[:, None]).min(axis=1).max() < 5e-5  # between two of the samples
    tip = motion.point("follower", "T") @ [1.0, 1j]
    face = placed.cam.follower.face
    if isinstance(face, Flat):
        assert np.abs(np.real((tip - rows.place) * np.conj(rows.normal))).max() < 1e-15
        depth = np.real((profile - rows.place[:, None]) * np.conj(rows.normal[:, None]))
        assert depth.max() < 1e-8  # no part of the cam reaches beyond the face
    else:
        np.testing.assert_allclose(rows.place + face.radius * rows.normal, tip, atol=1e-14)
        assert (np.abs(profile - tip[:, None]).min(axis=1) > face.radius - 1e-12).all()  # nor into the roller


@pytest.mark.parametrize("face", [Roller(0.01), Knife()])
def test_the_contact_force_is_that_of_a_free_follower(face):
    """A follower with a spring alone: the textbook's k (d0 + s) + m g + m w^2 s'', over the cosine of the pressure angle."""
    mechanism = translating(face)
    motion, forces = solved(mechanism, 73)
    rows = placed_of(motion).rows(motion)
    s = placed_of(motion).law(rows.angle)
    zero = s[0] - rows.lift
    preload = 0.2 - (0.2 - zero - 0.06)
    closure = Closure(mass=0.4, stiffness=4e3, preload=float(preload[0]), gravity=9.81)
    along = closing_force(closure, rows.lift, s[2], SPEED)
    np.testing.assert_allclose(np.hypot(*forces.reaction("K")[:, :2].T), along / np.cos(rows.pressure_angle), rtol=1e-10)
    np.testing.assert_allclose(forces.reaction("K")[:, 1], along, rtol=1e-10)
    weight = mechanism.links[1].mass * 9.81 * np.real(motion.centre_of_mass("cam") @ [1.0, 1j])  # of the unbalanced cam
    np.testing.assert_allclose(forces.effort("O"), along * s[1] + weight, atol=1e-10)


def test_a_groove_carries_on_the_other_flank_and_a_yoke_on_the_other_face():
    groove = replace(FOLLOWERS["groove"], loads=())
    yoke = replace(FOLLOWERS["yoke"], loads=())
    for mechanism, apart in ((groove, 0.02), (yoke, None)):
        motion, forces = solved(mechanism, 180)
        tension = np.real(forces.reaction("K")[:, :2] @ [1.0, 1j] * np.conj(placed_of(motion).rows(motion).normal)) < 0.0
        assert 10 < tension.sum() < 170
        pressed = placed_of(motion).rows(motion).place
        here = forces.position("K") @ [1.0, 1j]
        np.testing.assert_allclose(here[~tension], pressed[~tension], atol=1e-15)
        gap = np.abs(here - pressed)[tension]
        if apart is None:  # the faces of a yoke are the breadth of the cam apart
            gap, apart = (pressed - here).imag[tension], 2.0 * 0.05 + 0.02
        np.testing.assert_allclose(gap, apart, rtol=1e-12)
        assert balance_of_links(forces) < 1e-11 and np.abs(forces.power_balance).max() < 1e-12


def test_a_cam_drives_a_linkage_from_a_geared_shaft_on_a_moving_carrier():
    """Motor, gear, camshaft, follower, coupler, lever, all on an arm that turns too: torque against virtual work."""
    points = {"A": (0.0, 0.0), "O": (0.12, 0.0), "G": (0.12, 0.0), "B": (0.2, 0.09)}
    links = (
        Link(name="frame", points={"Q": (0.0, 0.0)}),
        Link(name="arm", points={**points, "Q": (-0.05, -0.02)}, mass=2.0, centre=(0.05, 0.01), inertia=0.02),
        Link(name="motor", points={"A": (0.0, 0.0)}, mass=0.5, inertia=1e-3),
        Link(name="cam", points={"O": (0.0, 0.0)}, mass=0.8, centre=(0.004, 0.0), inertia=1e-3),
        Link(name="follower", points={"T": (0.0, 0.0), "E": (0.0, 0.05)}, mass=0.3, centre=(0.0, 0.02)),
        Link(name="coupler", points={"E": (0.0, 0.0), "C": (0.06, 0.0)}, mass=0.2, centre=(0.03, 0.0), inertia=1e-4),
        Link(name="lever", points={"B": (0.0, 0.0), "C": (0.0, 0.05)}, mass=0.3, centre=(0.0, 0.02), inertia=1e-4),
    )
    mechanism = replace(
        FOLLOWERS["roller"],
        links=links,
        joints=(
            Revolute(name="Q", links=("frame", "arm"), points=("Q", "Q")),
            Revolute(name="A", links=("arm", "motor"), points=("A", "A")),
            Revolute(name="O", links=("arm", "cam"), points=("O", "O")),
            Gear(name="Z", links=("motor", "cam"), carrier="arm", sizes=(20.0, 40.0)),
            Prismatic(name="S", links=("arm", "follower"), points=("G", "T"), along=(0.0, 1.0)),
            CamJoint(name="K", links=("cam", "follower"), guide="S", point="T", lift=lift(0.015), face=Roller(0.01), base=0.035),
            Revolute(name="E", links=("follower", "coupler"), points=("E", "E")),
            Revolute(name="C", links=("coupler", "lever"), points=("C", "C")),
            Revolute(name="B", links=("arm", "lever"), points=("B", "B")),
        ),
        drives=(
            replace(FOLLOWERS["roller"].drives[0], joint="A"),
            replace(FOLLOWERS["roller"].drives[0], joint="Q", law=replace(FOLLOWERS["roller"].drives[0].law, speed=1.3)),
        ),
        modes={"C": "right"},
        loads=(Force(name="F", link="lever", point="C", vector=(30.0, 10.0)),),
    )
    motion = solve_motion(compile_mechanism(mechanism), np.linspace(0.0, 1.2, 301))
    forces = solve_forces(motion)
    assert motion.closure.max() < 1e-15
    assert np.abs(forces.power_balance).max() < 1e-12
    assert balance_of_links(forces) < 1e-11
    rows = placed_of(motion).rows(motion)
    height = motion.coordinate("S")[:, 0]
    np.testing.assert_allclose(height, rows.coordinate, rtol=1e-13)


def _cam(**change):
    m = FOLLOWERS["knife"]
    return replace(m, joints=(*m.joints[:-1], replace(m.joints[-1], **change)))


# -- faults ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mechanism", "words"),
    [
        (translating(Roller(0.01), lift=program([Segment(2.0, 0.01), Segment(2.0, 0.0)])), "229.183°.*Add a dwell of 130.817"),
        (translating(Flat(), base=0.005), "base circle of 5 mm is undercut at .*at least 10"),
        (
            translating(Roller(0.05), base=0.002, lift=program([Segment(0.8, 0.03), Segment(2 * np.pi - 0.8, 0.0)])),
            "undercut.*radius of 50 mm on a pitch curve",
        ),
        (
            translating(Roller(0.01), lift=program([Segment(2.0, (0.01, 0.02)), Segment(2 * np.pi - 2.0, 0.0)])),
            "velocity falls at 114.592° from 20 mm to 0 mm per radian: a corner",
        ),
        (translating(Roller(0.001), base=0.005, offset=0.012), "does not reach the offset"),
        (oscillating(Roller(0.01), base=0.2), "does not reach a base circle"),
        (
            translating(Flat(), base=0.05, closure="form", lift=program([Segment(2.0, 0.01), Segment(2 * np.pi - 2.0, 0.0)])),
            "breadth of the cam varies by .* mm",
        ),
        (wedge(Flat()), "flat face slides"),
        (_cam(point="X"), "no point 'X'.*T, E"),
        (_cam(guide="O"), "no revolute or prismatic joint of 'follower'"),
        (translating(Knife(), lift=program([Segment(2.0, 0.01), Segment(2 * np.pi - 2.0)])), "higher than before"),
    ],
)
def test_faults_name_the_value_and_the_remedy(mechanism, words):
    with pytest.raises(MechanismError, match=r"joints\.K") as error:
        compile_mechanism(mechanism)
    assert re.search(words, str(error.value).replace("\n", " "), re.DOTALL), str(error.value)


def test_the_remedy_of_an_undercut_cam_helps():
    compile_mechanism(translating(Flat(), base=0.01067))
    with pytest.raises(MechanismError, match="undercut"):
        compile_mechanism(translating(Flat(), base=0.01065))


NEAR_AXIS = {
    "roller": translating(Roller(0.01), offset=0.008, stroke=-0.06),
    "knife": translating(Knife(), offset=0.008, stroke=-0.06),
    "arm": oscillating(Roller(0.012), pivot=(0.1, 0.0), arm=0.1, stroke=-0.6),
}


@pytest.mark.parametrize("name", NEAR_AXIS)
def test_a_cam_whose_profile_comes_to_its_axis_is_refused(name):
    """The follower would run through the axis, with a pressure angle beyond a right angle: its profile need not be undercut."""
    m = NEAR_AXIS[name]

    def on_base(base: float):
        return compile_mechanism(replace(m, joints=(*m.joints[:-1], replace(m.joints[-1], base=base))))

    with pytest.raises(MechanismError, match=r"comes to the cam's axis.*Give a base circle of at least .* mm\. Leave") as error:
        on_base(m.joints[-1].base)
    least = 1e-3 * float(re.search(r"at least ([\d.]+) mm", str(error.value))[1])
    on_base(1.001 * least)
    with pytest.raises(MechanismError, match=r"axis|undercut"):
        on_base(0.999 * least)


def test_a_smaller_roller_is_proposed_where_it_helps():
    """On the same base circle it makes a smaller pitch curve."""

    bump = program([Segment(0.4, 0.02), Segment(0.4, 0.0), Segment(2.0 * np.pi - 0.8)])

    def with_roller(radius: float):
        return compile_mechanism(translating(Roller(radius), lift=bump))

    with pytest.raises(MechanismError, match=r"undercut.*Give at most .* mm, or give a base circle of at least") as error:
        with_roller(0.02)
    most = 1e-3 * float(re.search(r"at most ([\d.]+) mm", str(error.value))[1])
    with_roller(0.9999 * most)
    with pytest.raises(MechanismError, match="undercut"):
        with_roller(1.001 * most)


def test_a_follower_cannot_drive_its_cam():
    m = FOLLOWERS["roller"]
    law = replace(m.drives[0].law, speed=0.01, travel=0.01)
    with pytest.raises(MechanismError, match="the follower drives the cam"):
        compile_mechanism(replace(m, drives=(replace(m.drives[0], joint="S", law=law),)))


def test_a_drive_on_the_follower_that_contradicts_the_law_is_refused():
    m = FOLLOWERS["roller"]
    time = np.linspace(0.0, 0.9 * m.drives[0].law.duration, 31)
    alone = solve_motion(compile_mechanism(m), time)
    both = replace(m, drives=(*m.drives, Drive(joint="S", law=ConstantSpeed(0.0, 0.01, travel=0.01))))
    compiled = compile_mechanism(both)
    with pytest.raises(MechanismError, match=r"joints\.K: the drives contradict each other.*Take 1 of the 2 drives away"):
        solve_motion(compiled, time)
    # where they agree there is nothing to refuse, and the constraint counts as left over
    given = {p: tuple(alone.coordinate(p).T) for p in (m.drives[0].joint, "S")}
    agreed = solve_motion(compiled, time, drives=given)
    np.testing.assert_allclose(agreed.velocity("follower"), alone.velocity("follower"), atol=1e-12)
    assert rank_mobility(agreed) == 1 and redundant_joints(agreed.model) == ("K",)
    assert agreement(agreed).velocity < 1e-9


def test_one_freedom_with_and_without_a_dwell():
    motion, _ = solved(FOLLOWERS["roller"], 8)
    assert gruebler(motion.model)[3] == 1
    assert {rank_mobility(motion, k) for k in range(8)} == {1}
