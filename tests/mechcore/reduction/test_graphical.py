"""Polygons, funicular polygon, centrodes: they close, agree with the algebra, and show what the hand method shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanisms import case, four_bar

import mechviz
from mechcore.constructions.force_polygons import force_polygons, funicular
from mechcore.constructions.polygons import acceleration_polygon, centrodes, polygon_layout, velocity_polygon
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.reduction.reduced import resultant
from mechcore.spec.loads import Force, Spring
from recordings import COVERING, ran


def motion_of(name, frames=72):
    scene = mechviz.load(name)
    compiled = compile_mechanism(scene.mechanism)
    return solve_motion(compiled, default_times(scene.mechanism, frames, scene.cycles))


@pytest.mark.sample(12)
@pytest.mark.parametrize("name", COVERING)
def test_every_plan_of_the_gallery_closes(name):
    run = ran(name)
    if run.simulation is not None:  # no plans are made of motions under forces
        return
    motion, forces = run.motion, run.forces
    for plan in (velocity_polygon(motion), acceleration_polygon(motion)):
        # links on fixed pins alone have no side
        assert bool(plan.edges) == any(not c.fixed for c in polygon_layout(motion.model)[0])
        good = np.isfinite(plan.largest)
        assert good.mean() > 0.9
        assert plan.closing[good].max() <= 1e-9, plan.name
    if forces is not None:
        solved = np.isfinite(forces.reaction(motion.mechanism.joints[0].name)).all(axis=1)  # not where friction jams it
        assert solved.any()
        for plan in force_polygons(forces):
            assert np.array_equal(np.isfinite(plan.closing), solved), plan.name
            assert plan.closing[solved].max() <= 1e-9, plan.name


def bar(**more):
    return four_bar(
        E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, speed=20.0, coupler_point=(0.14, 0.1), effects=("inertia", "gravity"),
        bodies={"crank": (0.8, (0.05, 0.0), 0.001), "coupler": (1.6, (0.14, 0.02), 0.012), "rocker": (1.2, (0.12, -0.01), 0.007)},
        loads=(Force(name="P", link="rocker", point="D", vector=(-150.0, -60.0)),), **more,
    )  # fmt: skip


def bar_motion(frames=36, traced=True):
    m = replace(bar(), traced=(("coupler", "P"),) if traced else ())
    return solve_motion(compile_mechanism(m), default_times(m, frames))


def test_the_velocity_plan_of_a_four_bar_has_the_sides_of_the_textbook():
    motion = bar_motion()
    plan = velocity_polygon(motion)
    sides = {e.name: e for e in plan.edges}
    assert {"v_B", "v_DB", "v_D", "v_PB"} <= set(sides)
    assert np.abs(sides["v_B"].vector) == pytest.approx(20.0 * 0.1)
    for name, link in (("v_B", "crank"), ("v_D", "rocker"), ("v_DB", "coupler")):  # each at right angles to its link
        along = np.exp(1j * motion.pose(link)[:, 2])
        assert np.real(sides[name].vector * np.conj(along)) == pytest.approx(0.0, abs=1e-12)
    images = plan.images
    # the image of the coupler is similar to it, turned by a right angle and scaled by its angular velocity
    ratio = (images["P"] if "P" in images else images["p"]) - images["b"]
    k = ratio / (images["d"] - images["b"])
    assert k == pytest.approx(np.full(len(k), complex(0.14, 0.1) / 0.3), rel=1e-9)
    v = motion.point("coupler", "P", 1)
    assert images["p"] == pytest.approx(v[:, 0] + 1j * v[:, 1], abs=1e-12)


def test_the_acceleration_plan_has_centripetal_and_tangential_parts_and_a_similar_image():
    motion = bar_motion()
    plan = acceleration_polygon(motion)
    sides = {e.name: e for e in plan.edges}
    assert {"a_B^n", "a_DB^n", "a_DB^t", "a_D^n", "a_D^t"} <= set(sides)
    for name, link in (("D", "rocker"), ("DB", "coupler")):
        along = np.exp(1j * motion.pose(link)[:, 2])
        assert np.imag(sides[f"a_{name}^n"].vector * np.conj(along)) == pytest.approx(0.0, abs=1e-9)
        assert np.real(sides[f"a_{name}^t"].vector * np.conj(along)) == pytest.approx(0.0, abs=1e-9)
        assert (np.real(sides[f"a_{name}^n"].vector * np.conj(along)) <= 1e-9).all()  # towards the centre
    k = (plan.images["p"] - plan.images["b"]) / (plan.images["d"] - plan.images["b"])
    assert k == pytest.approx(np.full(len(k), complex(0.14, 0.1) / 0.3), rel=1e-9)


def test_the_coriolis_part_stands_across_the_lever_and_is_2_omega_v():
    motion = motion_of("contour-lever")
    plan = acceleration_polygon(motion)
    coriolis = next(e for e in plan.edges if e.kind == "coriolis")
    velocity = next(e for e in velocity_polygon(motion).edges if e.kind == "sliding")
    lever = next(k for k in motion.model.links if k in coriolis.name or k == "lever")
    w = motion.velocity(lever)[:, 2]
    assert coriolis.vector == pytest.approx(2j * w * velocity.vector, abs=1e-9 * np.abs(coriolis.vector).max())


def test_a_plan_shows_where_links_do_not_fit():
    """Mutation: with a wrong speed of one link the plan no longer closes."""
    motion = bar_motion()
    rotation_class = motion.model.angles.rotation_class[motion.model.index["rocker"]]
    motion.speeds.angular[rotation_class] = motion.speeds.angular[rotation_class] * 1.001
    assert velocity_polygon(motion).closing.max() > 1e-5


def test_the_force_plan_of_the_dyad_follows_the_hand_method():
    motion = bar_motion(traced=False)
    forces = solve_forces(motion)
    dyad, crank = force_polygons(forces)
    names = [e.name for e in dyad.edges]
    assert dyad.name == "coupler + rocker" and crank.name == "crank"
    assert names[:2] == ["R_B^n", "R_B^t"] and names[-2:] == ["R_E^t", "R_E^n"]
    assert {"F_i coupler", "G_coupler", "F_i rocker", "G_rocker", "P", "R_D"} <= set(names)
    sides = {e.name: e.vector for e in dyad.edges}
    rows = {p: forces.reaction(p) @ np.array([1, 1j, 0]) for p in "ABDE"}
    assert sides["R_B^n"] + sides["R_B^t"] == pytest.approx(rows["B"], rel=1e-9)  # moments against the solver
    assert sides["R_E^n"] + sides["R_E^t"] == pytest.approx(rows["E"], rel=1e-9)
    assert sides["R_D"] == pytest.approx(-rows["D"], rel=1e-9)  # on the coupler, the first link of joint D
    inner = next(e for e in dyad.edges if e.kind == "inner")
    assert np.abs(inner.end).max() <= 1e-9 * dyad.largest.max()  # the diagonal leads back to the start
    assert crank.closing.max() <= 1e-12


def test_a_spring_between_links_pulls_both_ways_in_the_force_plans():
    """Between crank and rocker: the dyad and the crank both feel it, with opposite signs."""
    spring = Spring(name="k", links=("crank", "rocker"), points=("B", "D"), stiffness=2000.0, free_length=0.1)
    m = replace(bar(), loads=(*bar().loads, spring))
    motion = solve_motion(compile_mechanism(m), default_times(m, 36))
    forces = solve_forces(motion)
    dyad, crank = force_polygons(forces)
    pulls = [next(e.vector for e in plan.edges if e.name == "k") for plan in (dyad, crank)]
    assert pulls[0] == pytest.approx(-pulls[1])
    assert np.abs(pulls[0]).max() > 100.0
    assert dyad.closing.max() <= 1e-9 and crank.closing.max() <= 1e-9


def test_a_force_plan_that_lacks_a_load_stays_open():
    motion = bar_motion(traced=False)
    forces = solve_forces(motion)
    forces.applied = tuple(w for w in forces.applied if w.name != "P")
    assert force_polygons(forces)[0].closing.max() > 1e-2


# -- funicular ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "name", ["forces-three-general", "forces-parallel-same-sense", "forces-parallel-opposite-sense", "forces-couple"]
)
def test_the_funicular_polygon_finds_the_resultants_of_the_reference(name):
    c = case("forces_reduction", name)
    e = c["expected"]
    for pole in (None, (-40.0, 23.0), (61.0, 5.0)):
        polygon = funicular([c["inputs"]["points"]], [c["inputs"]["forces"]], pole=pole)
        assert polygon.kind[0] == e["type"]
        assert polygon.moment[0] == pytest.approx(e.get("moment_about_origin", e.get("moment")), rel=1e-11)
        if e["type"] == "single force":
            on, d = complex(*e["line_of_action_point_nearest_origin"]), complex(*e["line_of_action_direction"])
            assert np.imag((polygon.meeting[0] - on) * np.conj(d)) == pytest.approx(0.0, abs=1e-11)
        else:
            assert np.isnan(polygon.meeting[0])


@settings(max_examples=examples(60))
@given(st.integers(0, 10**6), st.integers(2, 8))
def test_the_result_does_not_depend_on_the_pole(seed, n):
    rng = np.random.default_rng(seed)
    points, forces = rng.uniform(-1, 1, (3, n, 2)), rng.normal(size=(3, n, 2))
    couples = rng.normal(size=(3, n)) * (seed % 2)
    algebra = resultant(points, forces, couples)
    for pole in (None, rng.normal(size=(3, 2)) * 3):
        polygon = funicular(points, forces, couples, pole=pole)
        assert list(polygon.kind) == list(algebra.kind)
        assert polygon.resultant == pytest.approx(algebra.force @ np.array([1, 1j]), rel=1e-12)
        # rounding grows where a string is nearly parallel to its force: judged by the smallest sine
        cross = np.imag(np.conj(polygon.rays[:, :-1]) * polygon.forces)
        sine = np.min(
            np.abs(cross) / (np.abs(polygon.rays[:, :-1]) * np.abs(polygon.forces) + 1e-300),
            initial=1.0,
            where=np.abs(polygon.forces) > 0,
        )
        reach = max(np.abs(polygon.knots).max(), 1.0)
        tolerance = 1e-12 * reach * np.abs(polygon.forces).sum() * max(1.0, np.abs(polygon.rays).max()) / max(sine, 1e-6)
        assert polygon.moment == pytest.approx(algebra.moment, abs=tolerance)
        if pole is None:
            assert polygon.closing.max() < 1e-9


@settings(max_examples=examples(50))
@given(st.integers(0, 10**6))
def test_strings_are_parallel_to_rays_and_meet_on_the_forces(seed):
    rng = np.random.default_rng(seed)
    polygon = funicular(rng.uniform(-1, 1, (2, 5, 2)), rng.normal(size=(2, 5, 2)))
    on_lines = np.imag((polygon.knots - polygon.points) * np.conj(polygon.forces))
    assert on_lines == pytest.approx(np.zeros_like(on_lines), abs=1e-9 * (1 + np.abs(polygon.knots).max()))
    string = np.diff(polygon.knots, axis=1)
    assert np.imag(string * np.conj(polygon.rays[:, 1:-1])) == pytest.approx(0.0, abs=1e-9 * (1 + np.abs(polygon.knots).max()))


def test_couples_vanishing_forces_and_equilibrium():
    alone = funicular([[[0.3, 0.1]]], [[[0.0, 0.0]]], [[5.0]])
    assert alone.kind[0] == "couple" and alone.moment[0] == pytest.approx(5.0)
    still = funicular([[[0, 0], [1, 0], [0.5, 1]]], [[[0, 1], [0, 1], [0, -2]]])
    assert still.kind[0] == "equilibrium"
    gone = funicular([[[0, 0], [1, 0], [2, 0]]], [[[0, 1], [0, 0], [0, 1]]])
    assert gone.kind[0] == "single force" and gone.meeting[0].real == pytest.approx(1.0)


def test_forces_and_a_couple_at_one_place():
    """The mean of three equal coordinates differs from them by rounding, which is no size of the system."""
    for x, y in ((0.17, 0.17 / 3.0), (0.0357, 0.0119), (1e3, 1e3 / 3.0)):
        drawn = funicular([[[x, y]] * 3], [[[0.0, -19.62], [5.0, 3.0], [0.0, 0.0]]], [[0.0, 0.0, 3.0]])
        assert drawn.kind[0] == "single force" and np.abs(drawn.forces).max() < 20.0
        about = np.imag(np.conj(drawn.meeting[0] - complex(x, y)) * drawn.resultant[0])
        assert about == pytest.approx(3.0, rel=1e-9)
        assert drawn.closing[0] < 1e-12


# -- centrodes ------------------------------------------------------------------------------------------------------------
def test_the_moving_centrode_rolls_on_the_fixed_one():
    motion = bar_motion(720)
    curves = centrodes(motion, "coupler")
    fixed, moving = (np.hypot(*np.diff(p, axis=0).T) for p in (curves.fixed, curves.moving))
    near = np.isfinite(fixed) & (fixed < 0.01)
    assert near.sum() > 100
    assert fixed[near] == pytest.approx(moving[near], rel=2e-3)  # chords of equal arcs
    # and they touch: the moving one, carried along, passes the pole, where the link's velocity is zero
    k = motion.model.index["coupler"]
    local = curves.moving[:, 0] + 1j * curves.moving[:, 1]
    place = motion.origins[k] + local * motion.rotation(k)
    assert np.column_stack([place.real, place.imag]) == pytest.approx(curves.fixed, rel=1e-9)
    v = motion.origin_velocities[k] + 1j * motion.velocity("coupler")[:, 2] * local * motion.rotation(k)
    assert np.abs(v).max() <= 1e-9 * np.abs(motion.origin_velocities[k]).max() * (1 + np.abs(local).max())


def test_elliptic_trammel_has_cardan_circles_for_centrodes():
    motion = motion_of("elliptic-trammel", 90)
    rod = max(motion.mechanism.links, key=lambda k: len(k.points) if k.name != motion.mechanism.frame else 0).name
    curves = centrodes(motion, rod)
    circle = []
    for way in (curves.fixed, curves.moving):
        a = np.column_stack([2.0 * way, np.ones(len(way))])
        (x, y, c), *_ = np.linalg.lstsq(a, (way**2).sum(axis=1), rcond=None)
        radius = np.sqrt(c + x * x + y * y)
        assert np.hypot(way[:, 0] - x, way[:, 1] - y) == pytest.approx(np.full(len(way), radius), rel=1e-9)
        circle.append(radius)
    assert circle[0] == pytest.approx(2.0 * circle[1], rel=1e-9)


def test_a_sliding_link_has_no_centrode():
    motion = motion_of("slider-crank-compressor")
    assert np.isnan(centrodes(motion, "piston").fixed).all()
