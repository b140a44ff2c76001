"""Instant centres by Kennedy's lines, evolutes, inflection circles with Euler-Savary and Bobillier, centres of percussion."""

from __future__ import annotations

import numpy as np
import pytest

import mechviz
from mechcore.constructions.centres import inflection_circle, kennedy, path_curvature, percussion
from mechcore.errors import MechanismError
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion

PLANE = np.array([1.0, 1.0j])


def motion_of(name, frames=48):
    scene = mechviz.load(name)
    return solve_motion(compile_mechanism(scene.mechanism), default_times(scene.mechanism, frames, scene.cycles))


def cross(a, b):
    return a.real * b.imag - a.imag * b.real


def crossing(a, b, c, d):
    """Where the line through a and b meets that through c and d."""
    return a + cross(c - a, d - c) / cross(b - a, d - c) * (b - a)


def collinear(a, b, c, size):
    return np.abs(cross(b - a, c - a)) <= 1e-9 * size * (np.abs(b - a) + np.abs(c - a))


# -- instant centres ----------------------------------------------------------------------------------------------------
def test_the_instant_centres_of_a_four_bar_are_where_its_bars_cross():
    motion = motion_of("instant-centres")
    a, b, c, d = (motion.point(*at) @ PLANE for at in (("frame", "A"), ("crank", "B"), ("coupler", "C"), ("frame", "D")))
    centres = kennedy(motion)
    assert list(centres) == ["P01", "P02", "P03", "P12", "P13", "P23"]
    for name, place in (("P01", a), ("P12", b), ("P23", c), ("P03", d)):
        assert centres[name].determined_by == "joint" and centres[name].place == pytest.approx(place, abs=1e-12)
    assert centres["P02"].place == pytest.approx(crossing(a, b, d, c), rel=1e-9)
    assert centres["P13"].place == pytest.approx(crossing(a, d, b, c), rel=1e-9)
    assert [line.through for line in centres["P02"].lines] == [("P01", "P12"), ("P03", "P23")]
    for name in ("P02", "P13"):
        assert centres[name].determined_by == "lines" and centres[name].closure_error.max() < 1e-12
        for line in centres[name].lines:
            assert all(collinear(centres[p].place, line.base, line.base + line.along, 0.1).all() for p in (name, *line.through))
    ratio = motion.velocity("rocker")[:, 2] / motion.velocity("crank")[:, 2]
    turning = np.abs(motion.velocity("crank")[:, 2]) > 1e-6
    arms = (centres["P13"].place - a) / (centres["P13"].place - d)
    assert arms.real[turning] == pytest.approx(ratio[turning], rel=1e-9)


def test_the_centre_of_a_sliding_joint_is_at_infinity_across_its_guide():
    motion = motion_of("slider-crank-compressor")
    computed, slide = kennedy(motion), motion.velocity("piston")[:, :2] @ PLANE
    moving = np.abs(slide) > 1e-9
    assert np.isnan(computed["P03"].place).all()
    assert np.abs(np.real(np.conj(computed["P03"].away) * slide))[moving].max() < 1e-12
    # the piston moves as fast as the crank's point in P13
    arm = computed["P13"].place - (motion.point("crank", "A") @ PLANE)
    assert 1j * motion.velocity("crank")[:, 2] * arm == pytest.approx(slide, abs=1e-9 * np.abs(slide).max())


def test_the_centres_of_wheels_are_where_they_roll():
    """Sun 24, planets 18, ring 60 teeth of module 2 mm: pitch points at 24 mm and 60 mm from the middle."""
    motion = motion_of("planetary-gear", 12)
    computed, turned = kennedy(motion, ["frame", "sun", "planet"]), np.exp(1j * motion.pose("arm")[:, 2])
    assert computed["P23"].place == pytest.approx(0.024 * turned, abs=1e-12)
    assert computed["P03"].place == pytest.approx(0.060 * turned, abs=1e-12)
    assert ("SP",) in [line.through for line in computed["P23"].lines]
    assert {"P13", "P01"} <= set(computed) and "P45" not in computed  # what the lines need, and no more


@pytest.mark.parametrize("name", ["ten-link", "shaper-quick-return", "jansen-leg", "double-rocker", "piston-driven-crank"])
def test_all_triples_of_centres_are_collinear(name):
    motion = motion_of(name, 25)
    centres = kennedy(motion)
    size = motion.model.length_scale
    assert not [c for c in centres.values() if c.determined_by == "velocities"]
    places = {frozenset(c.links): np.where(np.abs(c.place - c.place[0]) < 50 * size, c.place, np.nan) for c in centres.values()}
    links, judged = motion.model.links, 0
    for i in range(len(links)):
        for j in range(i):
            for k in range(j):
                a, b, c = (places[frozenset((links[p], links[q]))] for p, q in ((i, j), (j, k), (i, k)))
                near = np.isfinite(a + b + c)
                judged += int(near.sum())
                assert collinear(a[near], b[near], c[near], size).all()
    assert judged > 50


def test_a_mechanism_far_from_the_origin_has_the_same_centres():
    here, away = (kennedy(solve_motion(compile_mechanism(shifted(x)), np.linspace(0.1, 1.9, 7))) for x in (0.0, 100.0))
    for name, centre in here.items():
        assert away[name].determined_by == centre.determined_by
        np.testing.assert_allclose(away[name].place - 100.0, centre.place, atol=1e-9)


def shifted(x):
    text = mechviz.load("instant-centres").to_toml()
    points = {("links", "frame", "points"): {"A": [1e3 * x, 0], "D": [1e3 * x + 110, 0]}}
    return mechviz.loads(text, "shifted").changed(points).mechanism


# -- curvature ----------------------------------------------------------------------------------------------------------
def test_the_inflection_circle_of_a_rod_between_two_guides_is_the_small_cardan_circle():
    """Ends on straight lines have no centre of curvature: they, and the corner of the guides, are on the circle, at any time."""
    motion = motion_of("cardan-circles")
    circle = inflection_circle(motion, "rod")
    middle, radius = 0.5 * (circle.pole + circle.end), 0.5 * np.abs(circle.end - circle.pole)
    assert radius == pytest.approx(np.full(motion.frames, 0.08), rel=1e-9)  # half of its 160 mm
    assert middle == pytest.approx(motion.point("rod", "M") @ PLANE, abs=1e-9)
    assert np.abs(circle.end) == pytest.approx(0.0, abs=1e-9)  # the inflection pole is the corner
    # the middle of the rod turns about the corner
    assert circle.centre_of_curvature(motion.point("rod", "M") @ PLANE) == pytest.approx(np.zeros(motion.frames), abs=1e-9)


def test_the_evolute_of_an_ellipse():
    """P of the trammel draws x = a cos t, y = b sin t; the centres of its curvature: ((a² - b²) cos³ t / a, (b² - a²) sin³ t /
    b)."""
    motion = motion_of("cardan-circles")
    t = motion.pose("crank")[:, 2]
    a, b = 0.12, 0.04
    assert motion.point("rod", "P") == pytest.approx(np.column_stack([a * np.cos(t), b * np.sin(t)]), abs=1e-9)
    curvature = path_curvature(motion, "rod", "P")
    evolute = (a * a - b * b) * (np.cos(t) ** 3 / a - 1j * np.sin(t) ** 3 / b)
    assert curvature.centre == pytest.approx(evolute, rel=1e-9)


def test_euler_savary_and_the_path_have_one_centre_of_curvature():
    motion = motion_of("jansen-leg")
    for link, point in (("foot", "H"), ("lower_rod", "F"), ("upper_triangle", "E")):
        circle, path = inflection_circle(motion, link), path_curvature(motion, link, point)
        near = np.abs(path.centre - path.place) < 3.0 * motion.model.length_scale
        assert near.sum() > 20
        assert circle.centre_of_curvature(path.place)[near] == pytest.approx(path.centre[near], abs=2e-7)


def test_bobillier_finds_the_pole_tangent_from_two_points():
    motion = motion_of("inflection-circle")
    circle = inflection_circle(motion, "coupler")
    computed = circle.bobillier
    assert computed is not None and computed.points == ("B", "C")
    pivots = [motion.point("frame", name) @ PLANE for name in ("A", "D")]
    np.testing.assert_allclose(computed.centres, pivots, atol=1e-12)
    across = circle.end - circle.pole
    assert np.real(np.conj(computed.tangent) * across / np.abs(across)) == pytest.approx(np.zeros(motion.frames), abs=1e-9)
    # a bar of a guide has its centre at infinity, so that the construction has nothing to start from
    assert inflection_circle(motion_of("cardan-circles"), "rod").bobillier is None


def test_bobillier_finds_nothing_from_two_points_on_one_ray():
    motion = motion_of("eight-bar", 12)  # at its start the pins P and Q, their centres and the pole are in line
    circle = inflection_circle(motion, "plate")
    computed, across = circle.bobillier, circle.end - circle.pole
    assert computed is not None
    assert np.isnan(computed.tangent[[0, -1]]).all() and np.isnan(computed.meeting[[0, -1]]).all()
    assert np.real(np.conj(computed.tangent) * across / np.abs(across))[1:-1] == pytest.approx(np.zeros(11), abs=1e-9)


def test_a_link_that_does_not_turn_has_no_inflection_circle():
    assert np.isnan(inflection_circle(motion_of("slider-crank-compressor"), "piston").pole).all()
    with pytest.raises(MechanismError, match="no moving link"):
        inflection_circle(motion_of("slider-crank-compressor"), "frame")


# -- percussion ---------------------------------------------------------------------------------------------------------
def test_a_rod_is_struck_at_two_thirds_of_its_length():
    motion = motion_of("percussion-centre")
    centre = percussion(motion, "rod", "A")
    assert centre.centre == pytest.approx(motion.point("rod", "W") @ PLANE, abs=1e-12)  # 200 of 300 mm
    assert centre.through == pytest.approx(centre.centre, abs=1e-9) and centre.meeting == pytest.approx(centre.centre, abs=1e-9)
    assert np.abs(centre.direct).max() < 1e-12 * np.abs(centre.turned).max()


def test_the_inertia_resultant_of_a_connecting_rod_goes_through_the_crossing_of_both_parts():
    motion = motion_of("connecting-rod-bending")
    centre = percussion(motion, "rod", "B")
    _, _, inertia = motion.model.masses[motion.model.index["rod"]]
    force = -0.8 * (motion.centre_of_mass("rod", 2) @ PLANE)
    moment = -inertia * motion.acceleration("rod")[:, 2]
    assert centre.force == pytest.approx(force) and centre.direct + centre.turned == pytest.approx(force)
    s = motion.centre_of_mass("rod") @ PLANE
    scale = np.abs(force).max() * 0.22
    for place in (centre.through, centre.meeting):  # about a point of the line the forces have no moment
        known = np.isfinite(place) & (np.abs(place) < 10.0)
        assert known.sum() > 40
        assert (moment + cross(s - place, force))[known] == pytest.approx(0.0, abs=1e-9 * scale)
    # and the parts go through S and W: the moment about W of what remains without translation is none
    assert moment + cross(s - centre.centre, centre.turned) == pytest.approx(0.0, abs=1e-12 * scale)


def test_a_body_turned_about_its_centre_of_mass_has_no_centre_of_percussion():
    with pytest.raises(MechanismError, match="couple without a line"):
        percussion(motion_of("inertia-rotation-about-centre"), "rotor", "S")
