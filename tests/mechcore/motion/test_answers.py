"""What teachers ask for, against closed forms and theorems."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from comparison_columns import close, column
from dynamic_mechanisms import free_four_bar
from hypothesis import given
from mechanisms import case, four_bar, load, move, slider_crank
from random_linkages import crank_rockers

from mechcore.constructions.centres import inflection_circle, path_curvature
from mechcore.constructions.polygons import centrodes
from mechcore.dynamics.simulate import simulate
from mechcore.laws.timed import ConstantSpeed, Oscillation
from mechcore.motion import metrics as answers
from mechcore.motion.events import find_events
from mechcore.motion.reach import reachable_ranges
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic, Revolute

THETA = np.linspace(0.05, 6.2, 40)


@given(crank_rockers())
def test_instant_centres_obey_the_theorem_of_kennedy(mechanism):
    """The three instant centres of any three links lie on one line (Aronhold-Kennedy)."""
    centres = answers.instant_centres(move(mechanism, THETA[::6]))
    links = ["frame", "crank", "coupler", "rocker"]
    assert len(centres) == 6

    def at(a, b):
        return centres[a, b] if (a, b) in centres else centres[b, a]

    for a, b, c in combinations(links, 3):
        p, q, r = at(a, b), at(b, c), at(a, c)
        ok = np.isfinite(np.column_stack([p, q, r])).all(axis=1)
        u, v = (q - p)[ok], (r - p)[ok]
        area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        size = np.hypot(*u.T) * np.hypot(*v.T)
        assert (area <= 1e-7 * np.maximum(size, 1e-6)).all()


def test_instant_centres_of_a_slider_crank():
    motion = move(slider_crank(r=1.0, l=3.0), THETA)
    centres = answers.instant_centres(motion)
    np.testing.assert_allclose(centres["frame", "crank"], 0.0, atol=1e-14)
    np.testing.assert_allclose(centres["crank", "rod"], motion.point("crank", "B"), atol=1e-13)
    np.testing.assert_allclose(centres["rod", "piston"], motion.point("rod", "C"), atol=1e-12)
    assert np.isinf(centres["frame", "piston"]).any(axis=1).all(), "a slider turns about no point at a finite place"
    x = motion.coordinate("S")[:, 0]
    np.testing.assert_allclose(centres["frame", "rod"][:, 0], x, rtol=1e-10)
    np.testing.assert_allclose(centres["frame", "rod"][:, 1], x * np.tan(THETA), rtol=1e-8)


def test_instant_centre_of_the_elliptic_trammel_is_the_reference_s():
    from test_reference_linkages import test_elliptic_trammel_driven_by_its_angle as trammel

    trammel()  # the mechanism itself is checked there
    c = case("linkages", "elliptic-trammel")
    i, rows = c["inputs"], c["expected"]
    from mechanisms import pin

    bar = Link(name="bar", points={"A": (0.0, 0.0), "B": (i["L"], 0.0)})
    m = Mechanism(
        name="trammel",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            Link(name="a", points={"A": (0.0, 0.0)}),
            Link(name="b", points={"B": (0.0, 0.0)}),
            bar,
        ),
        joints=(
            Prismatic(name="x", links=("frame", "a"), points=("O", "A")),
            Prismatic(name="y", links=("frame", "b"), points=("O", "B"), along=(0.0, 1.0)),
            pin("A", "a", "bar"),
            pin("B", "b", "bar"),
        ),
        drives=(Drive(joint="A", law=ConstantSpeed(np.pi, -1.0)),),
    )
    motion = move(m, np.pi - column(rows, "theta"), -i["theta_dot"])
    close(answers.instant_centres(motion)["frame", "bar"], column(rows, "ic"))


def test_transmission_angle_and_its_extremes():
    c = case("linkages", "fourbar-crank-rocker")
    i = c["inputs"]
    for branch, mode in (("branch_+1", "left"), ("branch_-1", "right")):
        rows = c["expected"][branch]
        motion = move(four_bar(E=i["E"], AB=i["AB"], BD=i["BD"], DE=i["DE"], mode=mode), column(rows, "theta_1"))
        angle = column(rows, "transmission_angle")
        close(answers.transmission_angles(motion)["D"], angle)
        close(answers.transmission_rows(motion)["D"][:, 1], np.pi / 2 - np.abs(angle - np.pi / 2))
    for e in case("linkages", "fourbar-rocker-extremes")["expected"]:
        m = four_bar(E=(e["d"], 0.0), AB=e["AB"], BD=e["BD"], DE=e["DE"])
        angle = answers.transmission_angles(move(m, np.linspace(0.0, 2 * np.pi, 361)))["D"]
        assert angle.min() == pytest.approx(e["transmission_angle_min"], rel=1e-12)
        assert angle.max() == pytest.approx(e["transmission_angle_max"], rel=1e-12)


def test_limit_positions_of_the_rocker_are_where_its_velocity_ratio_vanishes():
    for e in case("linkages", "fourbar-rocker-extremes")["expected"]:
        m = four_bar(E=(e["d"], 0.0), AB=e["AB"], BD=e["BD"], DE=e["DE"])
        motion = move(m, [e["crank_angle_outer"], e["crank_angle_inner"]], 0.0)  # the drive may stand still
        assert np.abs(answers.velocity_ratios(motion)["E"]).max() < 1e-13
        assert (answers.mechanical_advantage(motion)["E"] > 1e12).all()
        swing = np.diff(motion.pose("rocker")[:, 2])
        assert abs(swing[0]) == pytest.approx(e["rocker_swing"], rel=1e-11)


def test_mechanical_advantage_is_what_a_load_on_the_output_needs():
    """Statics with a unit torque on the rocker: the driving torque is its reciprocal."""
    from mechcore.spec.loads import Torque

    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, loads=(Torque(name="M", link="rocker", moment=1.0),))
    forces = load(m, THETA)
    np.testing.assert_allclose(1.0 / np.abs(forces.effort("A")), answers.mechanical_advantage(forces.motion)["E"], rtol=1e-9)


def test_grashof_types_and_ranges():
    for e in case("linkages", "fourbar-limits")["expected"]:
        limits = [e["crank_angle_limit_folded"], e["crank_angle_limit_stretched"]]
        low, high = (0.0 if limits[0] is None else limits[0]), (np.pi if limits[1] is None else limits[1])
        m = four_bar(E=(e["d"], 0.0), AB=e["AB"], BD=e["BD"], DE=e["DE"], start=0.5 * (low + high))
        compiled = compile_mechanism(m)
        (loop,) = answers.grashof(compiled.model)
        assert loop.type == e["grashof_type"]
        assert loop.lengths == pytest.approx((e["AB"], e["BD"], e["DE"], e["d"]))
        (a, b), *_ = reachable_ranges(compiled)
        if limits[1] is None and limits[0] is None:
            assert b - a == pytest.approx(2 * np.pi)
        else:
            assert b == pytest.approx(e["crank_angle_limit_stretched"], abs=1e-9)
            assert a == pytest.approx(-b if limits[0] is None else limits[0], abs=1e-9)
    assert answers.grashof_type(0.1, 0.3, 0.1, 0.3) == "change point"


def test_curvature_of_circles_and_straight_lines():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, coupler_point=(0.1, 0.05))
    motion = move(m, THETA, 0.0)
    np.testing.assert_allclose(answers.curvature(motion, "crank", "B"), 10.0, rtol=1e-12)
    np.testing.assert_allclose(np.abs(answers.curvature(motion, "rocker", "D")), 4.0, rtol=1e-8)
    # a coupler point, by the circle through three neighbouring positions
    h = 1e-4
    for t in (0.7, 3.1):
        p = move(m, [t - h, t, t + h]).point("coupler", "P")
        a, b, c = (p[1] - p[0], p[2] - p[1], p[2] - p[0])
        expected = 2 * (a[0] * b[1] - a[1] * b[0]) / (np.hypot(*a) * np.hypot(*b) * np.hypot(*c))
        assert answers.curvature(move(m, [t]), "coupler", "P")[0] == pytest.approx(expected, rel=1e-6)


def test_answers_at_a_change_point_are_finite():
    m = four_bar(E=(0.3, 0.0), AB=0.1, BD=0.3, DE=0.1, start=0.5)
    motion = solve_motion(compile_mechanism(m), [0.0, np.pi - 0.5])
    np.testing.assert_allclose(answers.velocity_ratios(motion)["E"], 1.0, atol=1e-11)


def travelled(motion, link, point):
    """Curvature of the path that a point takes, from its velocity and acceleration."""
    v, a = motion.point(link, point, 1), motion.point(link, point, 2)
    return (v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / np.hypot(*v.T) ** 3


def about(motion, link):
    """Where a link has no velocity."""
    v = motion.velocity(link)
    return motion.pose(link)[:, :2] + np.column_stack([-v[:, 1], v[:, 0]]) / v[:, 2:]


def led_by_two(second):
    """A four-bar whose rocker turns about a pin of a slide that moves, too: each by its own law."""
    frame, crank, coupler, rocker = (
        Link(name="frame", points={"A": (0.0, 0.0), "D": (0.2, 0.0)}),
        Link(name="crank", points={"A": (0.0, 0.0), "B": (0.06, 0.0)}),
        Link(name="coupler", points={"B": (0.0, 0.0), "C": (0.18, 0.0), "E": (0.09, 0.07)}),
        Link(name="rocker", points={"D": (0.0, 0.0), "C": (0.15, 0.0)}),
    )
    slide = Link(name="slide", points={"D": (0.0, 0.0)})
    ends = {"A": ("frame", "crank"), "B": ("crank", "coupler"), "C": ("coupler", "rocker"), "D": ("rocker", "slide")}
    joints = tuple(Revolute(name=name, links=links, points=(name, name)) for name, links in ends.items())
    guide = Prismatic(name="S", links=("frame", "slide"), points=("D", "D"), along=(0.0, 1.0))
    drives = (Drive(joint="A", law=Oscillation(centre=1.0, amplitude=0.4, frequency=1.0)), Drive(joint="S", law=second))
    return Mechanism(
        name="two", frame="frame", links=(frame, crank, coupler, rocker, slide), joints=(*joints, guide), drives=drives,
        modes={"C": "left"}, traced=(("coupler", "E"),),
    )  # fmt: skip


def test_centres_and_curvatures_are_those_of_the_motion_of_all_drives():
    """With two drives the path is bent by both, and the instant centre lies where the link has no velocity."""
    law = Oscillation(centre=0.02, amplitude=0.03, frequency=1.4, phase=0.4)
    motion = solve_motion(compile_mechanism(led_by_two(law)), np.linspace(0.01, 1.4, 60))
    np.testing.assert_allclose(answers.curvature(motion, "coupler", "E"), travelled(motion, "coupler", "E"), rtol=1e-9)
    centre = about(motion, "coupler")
    np.testing.assert_allclose(answers.instant_centres(motion)["frame", "coupler"], centre, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(centrodes(motion, "coupler").fixed, centre, rtol=1e-8, atol=1e-9)
    path = path_curvature(motion, "coupler", "E")
    circle = inflection_circle(motion, "coupler").centre_of_curvature(path.place)
    np.testing.assert_allclose(circle, path.centre, rtol=1e-6)


def test_at_rest_a_single_drive_leads_and_several_have_no_direction():
    still = ConstantSpeed(start=0.02, speed=0.0)
    rest = np.array([0.25])  # where the oscillation turns back
    for mechanism, known in (
        (led_by_two(still), True),
        (led_by_two(Oscillation(centre=0.0, amplitude=0.01, frequency=1.0)), False),
    ):
        compiled = compile_mechanism(mechanism)
        motion = solve_motion(compiled, np.append(np.linspace(0.0, 0.2, 5), rest))
        bend, centre = answers.curvature(motion, "coupler", "E"), answers.instant_centres(motion)["frame", "coupler"]
        assert np.isfinite(bend[:-1]).all() and np.isfinite(centre[:-1]).all()
        assert np.isfinite(bend[-1]) == known == np.isfinite(centre[-1]).all()


def test_metrics_of_a_motion_under_forces_are_those_of_its_path():
    """A four-bar that swings from rest through dead points of its free rocker, where another joint leads: one path all along."""
    masses = {f"m{k}": 1.0 for k in (1, 2, 3)} | {f"J{k}": 0.002 for k in (1, 2, 3)}
    centres = {"C1": (0.075, 0.0), "C2": (0.09, 0.0), "C3": (0.03, 0.0)}
    sizes = {"A": (0.0, 0.0), "E": (0.2, 0.0), "AB": 0.15, "BD": 0.18, "DE": 0.06, "branch": -1}
    mechanism = free_four_bar({**masses, **centres, **sizes, "theta_1_0": 1.05, "omega_1_0": 0.0})
    motion = simulate(mechanism, 2.0).motion(np.linspace(0.0, 2.0, 101))
    assert len(motion.parts) > 1
    late = slice(1, None)
    np.testing.assert_allclose(answers.curvature(motion, "coupler", "D")[late], travelled(motion, "coupler", "D")[late], rtol=1e-6)
    found = answers.instant_centres(motion)["frame", "coupler"]
    np.testing.assert_allclose(found[late], about(motion, "coupler")[late], rtol=1e-6, atol=1e-7)
    (angle,) = answers.transmission_angles(motion).values()
    rows, _ = motion.parts[0]
    assert np.isfinite(angle[rows]).all() and not np.isfinite(angle).all()  # other groups where another joint leads


def test_a_point_at_rest_while_others_move_has_no_curvature():
    """It was a quotient of rounding errors, with a radius of 1e-17 m as the sharpest bend of the path."""
    frame = Link(name="frame", points={"A": (0.0, 0.0), "E": (1.0, 0.0)})
    arms = tuple(Link(name=k, points={p: (0.0, 0.0), "P": (0.2, 0.1)}) for k, p in (("left", "A"), ("right", "E")))
    joints = tuple(Revolute(name=p, links=("frame", k), points=(p, p)) for k, p in (("left", "A"), ("right", "E")))
    drives = (Drive(joint="A", law=Oscillation(0.7, 0.3, 1.0)), Drive(joint="E", law=ConstantSpeed(0.1, 3.0)))
    made = {"links": (frame, *arms), "joints": joints, "drives": drives}
    two = Mechanism(name="two", frame="frame", **made, traced=(("left", "P"),), metrics=("curvature",))
    motion = solve_motion(compile_mechanism(two), np.linspace(0.0, 1.0, 41))
    bend = answers.curvature(motion, "left", "P")
    at_rest = np.isin(np.arange(41), [10, 30])
    assert np.isnan(bend[at_rest]).all()
    np.testing.assert_allclose(np.abs(bend[~at_rest]), 1.0 / np.hypot(0.2, 0.1), rtol=1e-9)
    (sharpest,) = (e for e in find_events(motion) if "sharpest bend" in e.text)
    assert sharpest.value == pytest.approx(1.0 / np.hypot(0.2, 0.1), rel=1e-6)


def test_a_straight_path_has_no_sharpest_bend():
    """A slider in a slanting guide: its curvature is rounding, next to the dead centres above all."""
    m = slider_crank(r=1.0, l=3.0)
    turned = (np.cos(0.4), np.sin(0.4))
    joints = tuple(replace(p, along=turned) if isinstance(p, Prismatic) else p for p in m.joints)
    sloping = replace(m, joints=joints, traced=(("piston", "C"),), metrics=("curvature",))
    motion = solve_motion(compile_mechanism(sloping), np.linspace(0.0, m.drives[0].law.duration, 73))
    assert not [e.text for e in find_events(motion) if "sharpest bend" in e.text]
