"""Force systems, inertia resultants, bodies and areas, substitute masses: references, second methods, random cases."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanisms import case

from mechcore.errors import MechanismError
from mechcore.reduction.bodies import (
    SOLIDS,
    RigidBody,
    acceleration_field,
    area_of,
    circle,
    combine,
    percussion_centre,
    plate,
    rounded_hull,
    single_resultant,
    solid,
)
from mechcore.reduction.reduced import reduce_to, resultant
from mechcore.reduction.substitute import PointMass, static_replacement, substitute_masses

FILE = "forces_reduction"
coordinate = st.floats(-2.0, 2.0)
vector = st.tuples(coordinate, coordinate)


# -- force systems ------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "name", ["forces-three-general", "forces-parallel-same-sense", "forces-parallel-opposite-sense", "forces-couple"]
)
def test_resultants_of_the_reference(name):
    c = case(FILE, name)
    expected = c["expected"]
    points, forces = c["inputs"]["points"], c["inputs"]["forces"]
    resultants = resultant(points, forces)
    assert resultants.kind == expected["type"]
    assert resultants.force == pytest.approx(expected["resultant"], rel=1e-13, abs=1e-13)
    key = "moment_about_origin" if "moment_about_origin" in expected else "moment"
    assert float(resultants.moment) == pytest.approx(expected[key], rel=1e-13)
    if "line_of_action_point_nearest_origin" in expected:
        assert resultants.point == pytest.approx(expected["line_of_action_point_nearest_origin"], abs=1e-14)
        assert resultants.direction == pytest.approx(expected["line_of_action_direction"], abs=1e-14)


def test_forces_in_equilibrium_come_to_nothing():
    resultants = resultant([[0, 0], [1, 0], [0.5, 1]], [[0, 1], [0, 1], [0, -2]])
    assert resultants.kind == "equilibrium"
    assert resultants.moment == 0 and np.isnan(resultants.point).all() and np.isnan(resultants.direction).all()


def test_forces_in_equilibrium_at_one_place_up_to_rounding_come_to_nothing():
    x = 0.3 * (1.0 + np.array([0.0, 2.0, -1.0]) * np.finfo(float).eps)
    system = resultant(np.column_stack([x, x[::-1]]), [[4.0, 1.0], [-1.0, 6.0], [-3.0, -7.0]])
    assert system.kind == "equilibrium" and system.moment == 0


def test_a_couple_far_from_the_origin_is_a_couple():
    resultants = resultant([[1e6, 1e6], [1e6 + 0.5, 1e6]], [[0, -3], [0, 3]])
    assert resultants.kind == "couple"
    assert float(resultants.moment) == pytest.approx(1.5, rel=1e-9)


@settings(max_examples=examples(50))
@given(st.lists(st.tuples(vector, vector), min_size=1, max_size=8), vector, coordinate)
def test_the_main_vector_does_not_depend_on_the_point_and_the_moment_shifts_by_r_cross_f(system, about, couple):
    points, forces = (np.array(x) for x in zip(*system, strict=True))
    couples = np.zeros(len(points))
    couples[0] = couple
    f0, m0 = reduce_to(points, forces, couples)
    f1, m1 = reduce_to(points, forces, couples, about=about)
    assert np.array_equal(f0, f1)
    assert m1 == pytest.approx(m0 - (about[0] * f0[1] - about[1] * f0[0]), abs=1e-12)
    resultants = resultant(points, forces, couples)
    if (
        resultants.kind == "single force" and resultants.magnitude > 1e-3
    ):  # alone on its line it has the system's moment about any point
        back = resultant([resultants.point], [resultants.force])
        assert float(back.moment) == pytest.approx(float(m0), abs=1e-9 * (1 + np.abs(resultants.point).max()))
        assert np.hypot(*resultants.nearest(about) - about) <= np.hypot(*resultants.point - about) + 1e-12


def test_frames_lead_and_each_has_its_own_kind():
    forces = np.array([[[0, 1], [0, 1]], [[0, 1], [0, -1]], [[0, 0], [0, 0]]], float)
    resultants = resultant(np.array([[0.0, 0.0], [2.0, 0.0]]), forces)
    assert list(resultants.kind) == ["single force", "couple", "equilibrium"]
    assert resultants.point[0] == pytest.approx([1.0, 0.0])


# -- inertia ------------------------------------------------------------------------------------------------------------
def inertia_wrench(mass, inertia, a_s, alpha):
    """Inertia force at the centre of mass and inertia moment (d'Alembert)."""
    return -mass * np.asarray(a_s), -inertia * np.asarray(alpha)


def inertia_of_points(masses, places, a_s, omega, alpha):
    """Force and moment about S of the inertia forces of point masses at places from S."""
    r = np.asarray(places, float)
    single = -np.asarray(masses, float)[:, None] * acceleration_field(r, a_s, omega, alpha)
    return single.sum(axis=-2), (r[..., 0] * single[..., 1] - r[..., 1] * single[..., 0]).sum(axis=-1)


def test_special_cases_of_motion():
    c = case(FILE, "inertia-special-motions")
    for row in c["expected"]:
        force, moment = inertia_wrench(c["inputs"]["m"], c["inputs"]["J_S"], row["a_S"], row["eps"])
        assert force == pytest.approx(row["P_b"], abs=1e-13), row["motion"]
        assert float(moment) == pytest.approx(row["M_b"], abs=1e-13)
        if "arm_h" in row:
            at, far = single_resultant(force, moment)
            assert float(far) == pytest.approx(row["arm_h"], rel=1e-13)
            assert np.hypot(*at) == pytest.approx(row["arm_h"], rel=1e-13)


def test_the_inertia_resultant_crosses_the_line_to_the_pivot_in_the_centre_of_percussion():
    for row in case(FILE, "percussion-centre")["expected"]["rows"]:
        m, j, rho = row["mass"], row["mass"] * row["i_S_squared"], row["rho"]
        w = percussion_centre(m, j, (rho, 0.0), (0.0, 0.0))
        assert w == pytest.approx([row["BW"], 0.0], rel=1e-13)
        a_s = [-(row["omega"] ** 2) * rho, row["eps"] * rho]
        force, moment = inertia_wrench(m, j, a_s, row["eps"])
        assert force == pytest.approx(row["inertia_force"], rel=1e-12)
        at, far = single_resultant(force, moment, (rho, 0.0))
        assert float(far) == pytest.approx(row["arm_h"], rel=1e-12)
        # the line through `at` along the force passes W
        assert (w - at)[0] * force[1] - (w - at)[1] * force[0] == pytest.approx(0.0, abs=1e-12)


def test_no_centre_of_percussion_about_the_centre_of_mass():
    with pytest.raises(MechanismError, match="couple"):
        percussion_centre(1.0, 1.0, (0.1, 0.2), (0.1, 0.2))


def test_a_moment_alone_has_no_line_and_nothing_stays_where_it_is():
    at, far = single_resultant([[0.0, 0.0], [0.0, 0.0]], [2.0, 0.0], (1.0, 1.0))
    assert np.isnan(at[0]).all() and np.isinf(far[0])
    assert at[1] == pytest.approx([1, 1]) and far[1] == 0


# -- bodies and areas ---------------------------------------------------------------------------------------------------
def test_the_lectures_table_of_solids():
    c = case(FILE, "inertia-table")
    v = {k: float(x) for k, x in c["inputs"].items()}
    m, r, rr, length = v["m"], v["r"], v["R"], v["L"]
    a, b, cc, alpha = v["a"], v["b"], v["c"], v["alpha"]
    ours = {
        "point mass": ("point", {"radius": rr}), "through the end": ("rod end", {"length": length}),
        "through the centre": ("rod", {"length": length}), "inclined": ("rod inclined", {"length": length, "angle": alpha}),
        "solid cylinder, own": ("cylinder", {"radius": rr}), "transverse": ("cylinder across", {"radius": rr, "length": length}),
        "hollow": ("hollow cylinder", {"radius": rr, "bore": r}), "thin ring": ("ring", {"radius": rr}),
        "solid sphere": ("sphere", {"radius": rr}), "shell": ("shell", {"radius": rr}), "disc": ("disc", {"radius": rr}),
        "ellipsoid": ("ellipsoid", {"b": b, "c": cc}), "cone": ("cone", {"radius": rr}),
        "torus": ("torus", {"radius": rr, "section": r}),
        "cube": ("cube", {"a": a}),
    }  # fmt: skip
    seen = set()
    for row in c["expected"]:
        hits = [k for k in ours if k in row["body"]]
        if "box" in row["body"] or "cuboid" in row["body"] or "block" in row["body"]:
            computed = [m * SOLIDS["box"].square(p, q) for p, q in ((a, b), (b, cc), (a, cc))]
            assert any(x == pytest.approx(row["I"], rel=1e-13) for x in computed), row["body"]
            seen.add("box")
            continue
        assert len(hits) >= 1, row["body"]
        name, sizes = ours[hits[-1] if "inclined" in row["body"] else hits[0]]
        if "inclined" in row["body"]:
            name, sizes = ours["inclined"]
        assert m * SOLIDS[name].square(**sizes) == pytest.approx(row["I"], rel=1e-13), row["body"]
        seen.add(name)
    assert len(seen) == 16


def test_solids_by_density_and_clear_words():
    assert solid("sphere", density=7800, radius=0.05).mass == pytest.approx(7800 * 4 / 3 * math.pi * 0.05**3)
    assert solid("box", mass=2, a=0.3, b=0.4, centre=(1, 2)).inertia == pytest.approx(2 * 0.25 / 12)
    for bad in (
        {"kind": "egg", "mass": 1}, {"kind": "rod", "density": 1, "length": 1}, {"kind": "rod", "mass": 1},
        {"kind": "rod end", "mass": 1},
        {"kind": "disc", "mass": 1, "density": 2, "radius": 1}, {"kind": "disc", "mass": 1, "radius": -1},
        {"kind": "disc", "mass": 1, "radius": 1, "a": 2},
        {"kind": "hollow cylinder", "mass": 1, "radius": 1, "bore": 2},
    ):  # fmt: skip
        with pytest.raises(MechanismError):
            solid(**bad)


@settings(max_examples=examples(50))
@given(st.lists(st.tuples(st.floats(0.1, 5), vector, st.floats(0, 2)), min_size=1, max_size=6))
def test_putting_bodies_together_keeps_mass_moment_and_polar_moment(parts):
    bodies = [RigidBody(m, c, j) for m, c, j in parts]
    whole = combine(bodies)
    assert whole.mass == pytest.approx(sum(b.mass for b in bodies))
    for x, y in ((0.0, 0.0), (1.0, -2.0)):
        assert whole.about(x, y) == pytest.approx(sum(b.about(x, y) for b in bodies), rel=1e-12)


def test_areas_with_arcs_against_known_shapes():
    square = area_of([(0, 0), (2, 0), (2, 1), (0, 1)])
    assert (square.area, *square.centre, square.polar) == pytest.approx((2, 1, 0.5, 2 * (4 + 1) / 12))
    disc = area_of([(1.0, 2.0), (-1.0, 2.0)], [1.0, 1.0])  # two half circles
    known = circle((0.0, 2.0), 1.0)
    assert (disc.area, *disc.centre, disc.polar) == pytest.approx((known.area, *known.centre, known.polar), abs=1e-14)
    quarter = math.tan(math.pi / 8)
    four = area_of([(1, 0), (0, 1), (-1, 0), (0, -1)], [quarter] * 4)
    assert (four.area, four.polar) == pytest.approx((math.pi, math.pi / 2))
    three_quarters = area_of([(0.0, 1.0), (1.0, 0.0)], [math.tan(3 * math.pi / 8), 0.0])
    segment = math.pi / 4 - 0.5  # of the other side of the chord
    assert three_quarters.area == pytest.approx(math.pi - segment)
    assert three_quarters.centre[0] == pytest.approx(three_quarters.centre[1])


@settings(max_examples=examples(50))
@given(st.floats(0.05, 0.4), vector, st.floats(0.5, 2.0), st.floats(-3, 3))
def test_arcs_against_many_short_sides(radius, start, length, angle):
    end = (start[0] + length * math.cos(angle), start[1] + length * math.sin(angle))
    exact = rounded_hull([start, end], radius)
    n = 400
    t = np.linspace(0, np.pi, n)
    base = angle + np.pi / 2
    half = lambda c, a: np.column_stack([c[0] + radius * np.cos(a + t), c[1] + radius * np.sin(a + t)])  # noqa: E731 a local shape
    fine = area_of(np.vstack([half(start, base), half(end, base + np.pi)]))
    assert fine.area == pytest.approx(exact.area, rel=2e-5)
    assert fine.centre == pytest.approx(exact.centre, abs=1e-9)
    assert fine.polar == pytest.approx(exact.polar, rel=5e-5)


@pytest.mark.parametrize("bulge", [1.0, -0.3, 1e-3, -1e-5, 1e-6, 1e-9])
def test_shallow_arcs_are_those_of_their_halves(bulge: float):
    """Their circles are huge: moments about the middle of these lost all digits, at 1e-5 of a bulge 6 % of the inertia."""
    z = np.array([0.1, 1.0 + 0.2j, 0.8 + 0.9j, -0.1 + 0.7j])
    tops = 0.5 * (z + np.roll(z, -1)) - 0.5j * bulge * (np.roll(z, -1) - z)
    finer = np.stack([z, tops], axis=1).ravel()
    corners, halves = (np.stack([w.real, w.imag], axis=1) for w in (z, finer))
    whole, same = area_of(corners, [bulge] * 4), area_of(halves, [math.tan(0.5 * math.atan(bulge))] * 8)
    assert (whole.area, *whole.centre, whole.polar) == pytest.approx((same.area, *same.centre, same.polar), rel=1e-13)


def test_a_plate_with_holes_and_bosses():
    outer = area_of([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    hole = circle((0.5, 0.0), 0.2)
    body = plate(outer, 10.0, holes=[hole], bosses=[(circle((-0.5, 0), 0.3), 4.0)])
    area = math.pi * 0.04
    boss = math.pi * 0.09 * 4
    assert body.mass == pytest.approx(40 - 10 * area + boss)
    assert body.centre[0] * body.mass == pytest.approx(-0.5 * 10 * area - 0.5 * boss)
    assert body.about(0, 0) == pytest.approx(10 * 8 / 3 - 10 * area * (0.02 + 0.25) + boss * (0.045 + 0.25))


# -- substitute masses --------------------------------------------------------------------------------------------------
def equivalent(mass, inertia, solution):
    """Largest relative difference of inertia force and moment between the body and its point masses, over random motions."""
    masses, places = solution
    rng = np.random.default_rng(4)
    a_s, omega, alpha = rng.normal(size=(20, 2)), rng.normal(size=20), rng.normal(size=20)
    force, moment = inertia_of_points(masses, places, a_s, omega, alpha)
    own_force, own_moment = inertia_wrench(mass, inertia, a_s, alpha)
    size = 1 + np.abs(places).max()
    scale = np.abs(masses).sum() * size**2 + inertia
    return max(np.abs(force - own_force).max(), np.abs(moment - own_moment).max()) / scale


@pytest.mark.parametrize("name", ["masses-lecture-exact", "masses-lecture-rounded"])
def test_the_lectures_worked_task_has_two_solutions(name):
    c = case(FILE, name)
    i = c["inputs"]
    substitution = substitute_masses(
        i["m"], i["I_S"], [PointMass(x=i["A"][0], y=i["A"][1]), PointMass(x=i["B"][0], y=i["B"][1]), PointMass(y=i["y_C"])]
    )
    assert len(substitution.solutions) == 2 and "two" in substitution.message and "negative" in substitution.message
    for (masses, places), branch in zip(substitution.solutions, c["expected"]["branches"], strict=True):  # the positive one first
        assert masses == pytest.approx([branch["m_A"], branch["m_B"], branch["m_C"]], rel=1e-12)
        assert places[2] == pytest.approx([branch["x_C"], i["y_C"]], rel=1e-12)
        assert (masses > 0).all() == branch["all_positive"]
        assert equivalent(i["m"], i["I_S"], (masses, places)) < 1e-13
    assert substitution.negative == ((), (0,))


def test_no_real_solution_is_said():
    i = case(FILE, "masses-no-real-solution")["inputs"]
    substitution = substitute_masses(
        i["m"], i["I_S"], [PointMass(x=i["A"][0], y=i["A"][1]), PointMass(x=i["B"][0], y=i["B"][1]), PointMass(y=i["y_C"])]
    )
    assert substitution.solutions == () and "no real solution" in substitution.message


@pytest.mark.parametrize("name", ["inertia-lecture-aB30", "inertia-lecture-aB25"])
def test_point_forces_of_the_worked_task(name):
    c = case(FILE, name)
    i, e = c["inputs"], c["expected"]
    a = np.array([complex(*i["A"]), complex(*i["B"])])
    acc = [i[f"a_{k}"] * np.exp(1j * np.radians(i[f"a_{k}_angle_deg"])) for k in "AB"]
    field = (acc[1] - acc[0]) / (a[1] - a[0])
    omega, alpha = math.sqrt(-field.real), field.imag
    a_s = acc[0] - field * a[0]
    assert omega**2 == pytest.approx(e["omega_squared"], rel=1e-11) and alpha == pytest.approx(e["eps"], rel=1e-11)
    substitution = substitute_masses(
        i["m"], i["I_S"], [PointMass(x=i["A"][0], y=i["A"][1]), PointMass(x=i["B"][0], y=i["B"][1]), PointMass(y=i["y_C"])]
    )
    for (masses, places), branch in zip(substitution.solutions, e["branches"], strict=True):
        single = -masses[:, None] * acceleration_field(places, [a_s.real, a_s.imag], omega, alpha)
        for k, name in enumerate("ABC"):
            assert single[k] == pytest.approx(branch[f"P_{name}"], rel=1e-10)
        force, moment = inertia_of_points(masses, places, [a_s.real, a_s.imag], omega, alpha)
        assert force == pytest.approx(e["resultant"], rel=1e-11) and float(moment) == pytest.approx(e["moment_about_S"], rel=1e-11)
        at, far = single_resultant(force, moment)
        assert at == pytest.approx(e["line_of_action_point_nearest_S"], rel=1e-11) and float(far) == pytest.approx(
            e["arm_h"], rel=1e-11
        )


@pytest.mark.parametrize("name", ["masses-collinear", "masses-collinear-negative"])
def test_three_masses_in_line_through_s(name):
    c = case(FILE, name)
    i, e = c["inputs"], c["expected"]
    # the line is x; a fourth place off it, of zero mass, makes four equations for four masses
    points = [PointMass(x=-i["b"], y=0.0), PointMass(x=0.0, y=0.0), PointMass(x=i["c"], y=0.0), PointMass(x=0.1, y=0.7)]
    substitution = substitute_masses(i["m"], i["J_S"], points)
    ((masses, places),) = substitution.solutions
    assert masses == pytest.approx([e["m_B"], e["m_S"], e["m_C"], 0.0], rel=1e-12, abs=1e-13)
    assert equivalent(i["m"], i["J_S"], (masses, places)) < 1e-13


def test_two_masses_of_the_reference():
    c = case(FILE, "masses-two-point")
    i, e = c["inputs"], c["expected"]
    ((masses, places),) = substitute_masses(i["m"], i["J_S"], [PointMass(x=i["A"][0], y=i["A"][1]), PointMass()]).solutions
    assert masses == pytest.approx([e["m_A"], e["m_B"]], rel=1e-13)
    assert places[1] == pytest.approx(e["B"], rel=1e-13)


def test_published_two_mass_systems():
    for name in ("khurmi_15_15", "khurmi_15_16", "bevan_2_7"):
        c = case("published", name)
        i, e = c["inputs"], c["exact_here"]
        ((masses, places),) = substitute_masses(i["m"], e["I"] if name == "khurmi_15_16" else i["m"] * e["kG"] ** 2, [
            PointMass(x=-i["l1"], y=0.0), PointMass()]).solutions  # fmt: skip
        assert masses == pytest.approx([e["m1"], e["m2"]], rel=1e-8)
        assert places[1] == pytest.approx([e["l2"], 0.0], rel=1e-8)
    i, e = case("published", "bevan_2_7")["inputs"], case("published", "bevan_2_7")["exact_here"]
    joint = static_replacement(i["m"], i["m"] * i["kG"] ** 2, (-i["l1"], 0.0), (i["l3"], 0.0))
    assert float(joint.correction(i["alpha"])) / i["g_c"] == pytest.approx(e["correction_couple"], rel=1e-8)
    assert joint.excess == pytest.approx(i["m"] * (i["l1"] * i["l3"] - i["kG"] ** 2), rel=1e-13)


@settings(max_examples=examples(50))
@given(
    st.floats(0.5, 5), st.floats(0.01, 2), st.integers(2, 5), st.data(),
)  # fmt: skip
def test_every_solution_replaces_the_body_and_a_known_one_is_found(mass, inertia, n, data):
    """A random body is made of n random point masses; four of their parameters are forgotten and must be found again."""
    rng = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    m = rng.uniform(0.2, 2.0, n) * np.where(rng.random(n) < 0.25, -0.3, 1.0)
    if m.sum() < 0.1:
        m = np.abs(m)
    xy = rng.uniform(-1, 1, (n, 2))
    xy -= (m @ xy) / m.sum()
    j = float(m @ (xy**2).sum(axis=1))
    if j <= 1e-3:
        return
    names = [(i, k) for i in range(n) for k in ("mass", "x", "y")]
    for _ in range(8):
        chosen = [names[k] for k in rng.choice(len(names), 4, replace=False)]
        points = [
            PointMass(*(None if (i, k) in chosen else float(v) for k, v in zip(("mass", "x", "y"), (m[i], *xy[i]), strict=True)))
            for i in range(n)
        ]
        try:
            substitution = substitute_masses(float(m.sum()), j, points)
        except MechanismError as error:  # choices that say nothing about one of the equations, or leave a family
            assert any(
                w in str(error)
                for w in ("family", "all masses are given", "nothing that is unknown", "has no influence", "one circle")
            )
            continue
        for solution in substitution.solutions:
            assert equivalent(float(m.sum()), j, solution) < 1e-9
        near = [max(np.abs(a - m).max(), np.abs(b - xy).max()) for a, b in substitution.solutions]
        assert min(near, default=np.inf) < 1e-4, (chosen, substitution.message)


def test_wrong_numbers_of_unknowns_and_families_are_refused():
    with pytest.raises(MechanismError, match="Give 5"):
        substitute_masses(1, 1, [PointMass(), PointMass(), PointMass()])
    with pytest.raises(MechanismError, match="all masses are given"):
        substitute_masses(1, 1, [PointMass(mass=0.5), PointMass(mass=0.5)])
    with pytest.raises(MechanismError, match="along y"):  # all of them on a line beside S
        substitute_masses(1, 1, [PointMass(y=0.1), PointMass(y=0.1)])
    with pytest.raises(MechanismError, match="positive"):
        substitute_masses(-1, 1, [PointMass(x=1, y=0), PointMass()])


def test_a_double_root_is_one_solution():
    """Between the y_C that have two solutions and those that have none lies one with a double solution."""

    def count(y):
        return len(
            substitute_masses(1.35, 0.0142, [PointMass(x=-0.08, y=-0.02), PointMass(x=0.19, y=-0.03), PointMass(y=y)]).solutions
        )

    none, two = 0.055, 0.025
    assert count(none) == 0 and count(two) == 2
    for _ in range(60):
        middle = 0.5 * (none + two)
        none, two = (middle, two) if count(middle) == 0 else (none, middle)
    ((masses, places),) = substitute_masses(
        1.35, 0.0142, [PointMass(x=-0.08, y=-0.02), PointMass(x=0.19, y=-0.03), PointMass(y=two)]
    ).solutions
    assert equivalent(1.35, 0.0142, (masses, places)) < 1e-12


@settings(max_examples=examples(50))
@given(st.floats(0.5, 4), st.floats(0.01, 1), st.floats(0.1, 2), st.floats(0.1, 2), st.floats(-3, 3))
def test_static_replacement_with_its_correction_couple_is_the_body(mass, inertia, a, b, angle):
    u = np.array([math.cos(angle), math.sin(angle)])
    joint = static_replacement(mass, inertia, -a * u, b * u)
    a_s, omega, alpha = np.array([1.0, -2.0]), 3.0, 4.0
    force, moment = inertia_of_points(joint.masses, [-a * u, b * u], a_s, omega, alpha)
    own = inertia_wrench(mass, inertia, a_s, alpha)
    assert force == pytest.approx(own[0], rel=1e-12)
    assert float(moment + joint.correction(alpha)) == pytest.approx(float(own[1]), rel=1e-9, abs=1e-9)


def test_static_replacement_needs_s_on_the_line():
    with pytest.raises(MechanismError, match="line"):
        static_replacement(1, 1, (0.1, 0.1), (1, 0))
