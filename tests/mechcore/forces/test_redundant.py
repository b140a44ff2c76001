"""Redundant constraints: motion exact, reactions the shortest that balance, indeterminate joints named; contradictions refused."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from mechanisms import drawn, four_bar, load, move
from random_linkages import balance_of_links

from mechcore.errors import MechanismError
from mechcore.forces.equilibrium import transmit
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.at_once import indeterminate
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.motion.structure import gruebler, rank_mobility
from mechcore.spec.loads import Force
from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic, Weld

POINTS = {"A": (0, 0), "E": (3, 0), "G": (1.5, 0), "B": (0.6, 0.8), "D": (3.6, 0.8), "H": (2.1, 0.8)}
LINKS = {"c1": "AB", "bar": "BDH", "c2": "ED", "c3": "GH"}


def three_cranks(**more) -> Mechanism:
    return drawn(
        POINTS,
        LINKS,
        "AEG",
        drive="A",
        law=ConstantSpeed(0.0, 1.0),
        effects=("inertia", "gravity"),
        bodies={"bar": (4.0, (2.1, 0.8), 0.5), "c1": (1.0, (0.3, 0.4), 0.1)},
        loads=(Force(name="F", link="bar", point="D", vector=(30.0, -10.0)),),
        **more,
    )


def test_three_parallel_cranks():
    forces = load(three_cranks(), np.linspace(-0.5, 1.5, 21), 2.0, 1.0)
    motion = forces.motion
    assert gruebler(motion.model)[3] == 0 and rank_mobility(motion) == 1
    np.testing.assert_allclose(motion.velocity("bar")[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(motion.velocity("c3")[:, 2], 2.0, atol=1e-11)
    assert motion.closure.max() < 1e-12 * motion.model.length_scale
    assert balance_of_links(forces) < 1e-10
    assert np.abs(forces.power_balance).max() < 1e-10
    assert set(indeterminate(motion)) == set("ABDEGH"), "all three cranks can be stressed against each other"


def test_the_reactions_are_the_shortest_that_balance():
    """Any other solution, made by adding a self-stress, is longer: the answer is orthogonal to the self-stress."""
    forces = load(three_cranks(), [0.3], 2.0, 1.0)
    motion = forces.motion
    size = motion.model.length_scale
    # self-stress: tensions t_k along the cranks on the bar with no resultant force and no moment
    u = (motion.point("c1", "B") - motion.point("c1", "A"))[0]
    u = u / np.hypot(*u)
    x = np.array([POINTS[p][0] for p in "BDH"])
    t = np.linalg.svd(np.array([np.ones(3), x]))[2][2]
    pins = {"A": t[0], "B": t[0], "E": t[1], "D": t[1], "G": t[2], "H": t[2]}
    inner = 0.0
    for joint, tension in pins.items():
        spec = next(p for p in motion.mechanism.joints if p.name == joint)
        towards = 1.0 if spec.links[1] in ("c1", "c2", "c3") else -1.0
        at_frame = joint in "AEG"
        pull = tension * (1.0 if at_frame else -1.0) * towards  # on the second link
        inner += forces.reaction(joint)[0, :2] @ u * pull
    scale = np.abs([forces.reaction(p)[0] for p in pins]).max()
    assert abs(inner) < 1e-9 * scale
    assert size == pytest.approx(3.0)


def test_a_redundant_constraint_that_does_not_close_is_refused():
    wrong = drawn({**POINTS, "H": (2.1, 0.81)}, LINKS, "AEG", drive="A", law=ConstantSpeed(0.0, 1.0))
    with pytest.raises(MechanismError, match="redundant constraint does not close"):
        move(wrong, np.linspace(-0.5, 1.5, 21))


def double_guide(angle: float = 0.0) -> Mechanism:
    return Mechanism(
        name="guides",
        frame="frame",
        links=(
            Link(name="frame", points={"P": (0.0, 0.0), "Q": (0.0, 0.2)}),
            Link(name="table", points={"P": (0.0, 0.0), "Q": (0.3, 0.2)}, mass=10.0, centre=(0.1, 0.1), inertia=0.2),
        ),
        joints=(
            Prismatic(name="P", links=("frame", "table"), points=("P", "P")),
            Prismatic(name="Q", links=("frame", "table"), points=("Q", "Q"), angle=angle),
        ),
        drives=(Drive(joint="P", law=ConstantSpeed(0.0, 0.1, travel=1.0)),),
        effects=("inertia", "gravity"),
        loads=(Force(name="F", link="table", point="Q", vector=(-50.0, 0.0)),),
    )


def test_two_aligned_guides():
    forces = load(double_guide(), [0.0, 0.2, 0.5], 0.1, 3.0)
    motion = forces.motion
    np.testing.assert_allclose(motion.coordinate("Q")[:, 1], 0.1, rtol=1e-13)
    assert balance_of_links(forces) < 1e-10
    assert np.abs(forces.power_balance).max() < 1e-10
    assert set(indeterminate(motion)) == {"P", "Q"}
    np.testing.assert_allclose(forces.effort("P"), 10.0 * 3.0 + 50.0, rtol=1e-12)
    np.testing.assert_allclose(forces.reaction("P")[:, 1] + forces.reaction("Q")[:, 1], 98.1, rtol=1e-12)


def test_guides_that_are_not_parallel_are_refused():
    with pytest.raises(MechanismError, match=r"contradicts that of the other guides.*Make the guides parallel"):
        compile_mechanism(double_guide(angle=0.01))


def test_contradicting_drives_are_named():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25)
    both = replace(m, drives=(*m.drives, Drive(joint="E", law=ConstantSpeed(1.6252677045288113, 1.0))), modes={})
    with pytest.raises(MechanismError, match=r"drives contradict each other.*Take 1 of the 2 drives away"):
        solve_motion(compile_mechanism(both), np.linspace(0.0, 1.0, 21))
    twice = replace(m, drives=(*m.drives, Drive(joint="X", law=ConstantSpeed(0.0, 2.0))), modes={"D": "left"})
    twice = replace(twice, joints=(*m.joints, replace(m.joints[0], name="X")))
    with pytest.raises(MechanismError, match="decided twice"):
        compile_mechanism(twice)


def test_links_without_length_are_named():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25)
    short = tuple(replace(x, points={"B": (0.1, 0.0), "D": (0.1, 0.0)}) if x.name == "coupler" else x for x in m.links)
    with pytest.raises(MechanismError, match=r"links\.coupler: it has no length: its pins B and D"):
        compile_mechanism(replace(m, links=short))


def test_coincident_points_of_a_crank_are_named():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25)
    none = tuple(replace(x, points={"A": (0.0, 0.0), "B": (0.0, 0.0)}) if x.name == "crank" else x for x in m.links)
    with pytest.raises(MechanismError, match=r"links\.crank: it has no length: its pins A and B are at the same point"):
        compile_mechanism(replace(m, links=none))


def chain_of_four() -> Mechanism:
    """An open chain of three moving links with one drive."""
    points = {"A": (0, 0), "B": (1, 0), "C": (2, 0), "D": (3, 0)}
    return drawn(points, {"a": "AB", "b": "BC", "c": "CD"}, "A", drive="A", law=ConstantSpeed(0.0, 1.0))


def test_more_than_one_freedom_left_is_counted():
    with pytest.raises(
        MechanismError, match=r"2 degrees of freedom without a drive: .* at B, C\. Add 2 drives, such as .*, at 2 of these joints"
    ):
        compile_mechanism(chain_of_four())


def test_a_missing_joint_is_named_by_the_points_that_none_joins():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25)
    for missing in m.joints:
        left = tuple(joint for joint in m.joints if joint is not missing)
        drives = tuple(drive for drive in m.drives if drive.joint != missing.name)
        with pytest.raises(MechanismError) as e:
            compile_mechanism(replace(m, joints=left, drives=drives, modes={}))
        said = re.search(rf"Add a joint at {missing.name}, where none joins '(\w+)' to '(\w+)'; or ", str(e.value))
        assert said is not None and set(said.groups()) == set(missing.links)


def test_a_joint_too_many_is_no_choice():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25)
    welded = tuple(Weld(name=j.name, links=j.links, points=j.points) if j.name == "D" else j for j in m.joints)
    with pytest.raises(MechanismError, match=r"leave no choice\. Leave it out\. The group has 1 more constraint than it needs"):
        compile_mechanism(replace(m, joints=welded, modes={"E": "left"}))


def test_impossible_input_has_its_own_message_each():
    """No two kinds of impossible input share their words."""
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25)
    apart = four_bar(E=(1.0, 0.0), AB=0.1, BD=0.3, DE=0.25)
    none = tuple(replace(x, points={"B": (0.1, 0.0), "D": (0.1, 0.0)}) if x.name == "coupler" else x for x in m.links)
    both = replace(m, drives=(*m.drives, Drive(joint="E", law=ConstantSpeed(1.6252677045288113, 1.0))), modes={})
    wrong = drawn({**POINTS, "H": (2.1, 0.81)}, LINKS, "AEG", drive="A", law=ConstantSpeed(0.0, 1.0))
    cases = {
        "cannot be assembled at the start": apart,
        "it has no length": replace(m, links=none),
        "drives contradict each other": both,
        "redundant constraint does not close": wrong,
        "a degree of freedom without a drive": replace(m, drives=()),
        "2 degrees of freedom without a drive": chain_of_four(),
    }
    said = []
    for words, mechanism in cases.items():
        with pytest.raises(MechanismError) as e:
            solve_motion(compile_mechanism(mechanism), np.linspace(0.0, 1.0, 21))
        assert words in str(e.value)
        said.append(str(e.value))
    assert all(sum(words in text for text in said) == 1 for words in cases)


def test_a_group_between_coincident_points_is_named():
    """Frame points that coincide, with equal links between them: the two links turn freely."""
    m = four_bar(E=(0.1, 0.0), AB=0.1, BD=0.3, DE=0.3, start=0.0)  # B is where E is
    with pytest.raises(MechanismError, match="outer pins of its group are at the same point at the start"):
        compile_mechanism(m)
    late = solve_motion(compile_mechanism(replace(m, drives=(Drive(joint="A", law=ConstantSpeed(0.1, 1.0)),))), [0.0, 7.0])
    assert late.closure.max() < 1e-14
    loop = {"A": (0, 0), "B": (1, 0), "C": (1.5, 1), "D": (0.2, 1.0)}
    free = drawn(loop, {"a": "ABD", "b": "BC", "c": "DC"}, "A", drive="C", law=ConstantSpeed(0.5, 1.0))
    with pytest.raises(MechanismError):  # the drive moves links against each other, and nothing holds the whole
        compile_mechanism(free)


# -- double parallelogram --------------------------------------------------------------------------------------------------
def ladder(**more) -> Mechanism:
    """Two cranks of length 1 on a frame of 2, joined by a bar at their ends and another one half-way."""
    points = {"A": (0.0, 0.0), "E": (2.0, 0.0), "B": (0.6, 0.8), "D": (2.6, 0.8), "P": (0.3, 0.4), "Q": (2.3, 0.4)}
    links = {"c1": "APB", "c2": "EQD", "bar": "BD", "rung": "PQ"}
    return drawn(points, links, "AE", drive="A", law=ConstantSpeed(0.0, 2.0), **more)


def test_a_double_parallelogram():
    forces = load(ladder(effects=("gravity",), bodies={"bar": (3.0, (1.6, 0.8), 0.2)}), np.linspace(-0.4, 1.0, 15), 2.0, 0.0)
    motion = forces.motion
    assert gruebler(motion.model)[3] == 0 and rank_mobility(motion) == 1
    for link, speed in (("bar", 0.0), ("rung", 0.0), ("c2", 2.0)):
        np.testing.assert_allclose(motion.velocity(link)[:, 2], speed, atol=1e-11)
    assert motion.closure.max() < 1e-12 * motion.model.length_scale
    assert balance_of_links(forces) < 1e-10 and np.abs(forces.power_balance).max() < 1e-10
    assert set(indeterminate(motion)) == set("ABDEPQ"), "the bars can be stressed against each other through the cranks"
    assert not forces.reaction("P").any() and not forces.reaction("Q").any(), (
        "shortest: the second bar carries nothing, not rounding"
    )
    # virtual work: the torque carries the weight of the bar, however the bars share it
    angle = motion.pose("c1")[:, 2]
    np.testing.assert_allclose(forces.effort("A"), 3.0 * 9.81 * np.cos(angle + np.arctan2(0.8, 0.6)), rtol=1e-10)


def test_the_reactions_of_a_double_parallelogram_are_the_shortest():
    """Orthogonal to the self-stress: the bars pull with 1 and -2, the pins on the frame hold the difference."""
    bodies = {"bar": (3.0, (1.6, 0.8), 0.2), "rung": (2.0, (0.5, 0.4), 0.1)}
    forces = load(ladder(effects=("gravity",), bodies=bodies), [0.2], 2.0, 0.0)
    assert abs(forces.reaction("P")).max() > 1.0
    stress = {"B": -1.0, "D": 1.0, "P": 2.0, "Q": -2.0, "A": 1.0, "E": -1.0}  # x, on the bars; on the cranks
    inner = scale = 0.0
    for joint, x in stress.items():
        spec = next(p for p in forces.motion.mechanism.joints if p.name == joint)
        bar = next((k for k in ("bar", "rung") if k in spec.links), spec.links[0])
        sign = 1.0 if spec.links[1] == bar or spec.links[0] == "frame" else -1.0
        inner += sign * x * forces.reaction(joint)[0, 0]
        scale = max(scale, abs(forces.reaction(joint)[0]).max())
    assert abs(inner) < 1e-10 * scale


def test_reactions_are_unknown_where_no_position_is():
    """As at instants that an integrator tries: the reactions ended with an exception of numpy. Others are as without these."""
    motion = load(three_cranks(), [0.2, 0.3, 0.4], 2.0, 1.0).motion
    force, moment = [0j, *[3.0 - 1j] * 4], [0.0] * 5
    whole, *_ = transmit(motion, force, moment)
    lost = np.array([False, True, False])
    state = replace(motion.state, rot=[np.where(lost, np.nan, x) for x in motion.state.rot])
    parts, *_ = transmit(Motion(motion.model, motion.time, motion.drives, state, motion.angles), force, moment)
    for (pull, _), (known, _) in zip(parts, whole, strict=True):
        assert np.isnan(pull[1]) and pull[~lost] == pytest.approx(known[~lost], rel=1e-12)
