"""Analysis of given profiles: law -> profile -> lift for every follower, first contact, bridges, corners, the graphical method."""

from __future__ import annotations

import numpy as np
import pytest
from cam_cases import CASES
from cases import examples
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mechcore.cams.analysis import analyse
from mechcore.cams.contour import Contour, arc, bulged, cam_contour, circle, line, polar_contour, polygon, spline_contour
from mechcore.cams.followers import Arc, Flat, Follower, Knife, Oscillating, Roller, Translating
from mechcore.cams.limits import Requirement, find_limits
from mechcore.cams.real_profiles import cut_profile, graphical
from mechcore.cams.sizing import least_base
from mechcore.cams.synthesis import Cam, cam_on_base
from mechcore.errors import MechanismError
from mechcore.laws.catalogue import RISES
from mechcore.laws.curve import MotionCurve
from mechcore.laws.program import Segment, program

PI = np.pi
TURN = np.linspace(0.03, 2 * PI + 0.02, 40)
LAWS = sorted(set(RISES) - {"constant-velocity", "constant-acceleration"})  # velocity jumps: the pitch curve has corners


@pytest.mark.parametrize("name", ["knife", "roller", "flat"])
def test_eccentric_disc_of_the_reference(name):
    case = CASES["cam-eccentric-circle"]
    i, rows = case["inputs"], case["expected"]
    face = {"knife": Knife(), "roller": Roller(i["roller_radius"]), "flat": Flat()}[name]
    theta = np.array([r["theta"] for r in rows])
    c = analyse(circle(i["r"], i["ecc"]), Follower(Translating(i["e"]), face), theta)
    w = i["omega"]
    for k, key in enumerate(("h", "velocity", "acceleration")):
        want = np.array([r[name][key] for r in rows])
        np.testing.assert_allclose(c.motion[k] * w**k, want, atol=1e-13 * np.abs(want).max())
    np.testing.assert_allclose(c.radius, i["r"], rtol=1e-12)
    h = 1e-3  # the jerk: the contact runs unevenly along the disc, so that all terms of the chain rule count
    near = [analyse(circle(i["r"], i["ecc"]), Follower(Translating(i["e"]), face), theta + j * h).motion[2] for j in (-2, -1, 1, 2)]
    numeric = (near[0] - 8 * near[1] + 8 * near[2] - near[3]) / (12 * h)
    np.testing.assert_allclose(c.motion[3], numeric, atol=1e-9 * np.abs(c.motion[2]).max())
    if name == "flat":
        place = (c.point * np.exp(1j * theta)).real
        np.testing.assert_allclose(place, [r["flat"]["contact_offset"] for r in rows], atol=1e-15)


@settings(max_examples=examples(40))
@given(
    st.sampled_from(LAWS),
    st.sampled_from(LAWS),
    st.sampled_from(["knife", "roller", "arc", "flat"]),
    st.booleans(),
    st.sampled_from([1, -1]),
    st.sampled_from([1, -1]),
    st.floats(-0.012, 0.012),
    st.floats(0.003, 0.03),
    st.floats(1.2, 2.4),
)
def test_law_to_profile_to_lift_returns_the_law(up, down, kind, swings, side, turn, offset, radius, over):
    stroke = 0.12 if swings else 0.015
    lift = program([Segment(over, stroke, up), Segment(0.9), Segment(over, 0.0, down), Segment(2 * PI - 0.9 - 2 * over)])
    face = {"knife": Knife(), "roller": Roller(radius), "arc": Arc(radius), "flat": Flat()}[kind]
    guide = Oscillating(0.2 + 1j * offset, 0.18, side) if swings else Translating(offset)
    follower = Follower(guide, face)
    base = 0.08
    if kind == "flat" and not swings:
        base = max(base, 1.2 * least_base(lift, follower, Requirement()).base)
    cam = cam_on_base(lift, follower, base, turn)
    limits = find_limits(cam, count=720)
    assume(limits.sharpness.value > 0.05)
    assume(not (kind == "flat" and limits.concave is not None))
    if kind != "knife":
        assume(cut_profile(cam, 360).lost == ())
    c = analyse(cam_contour(cam), follower, TURN, turn, samples=720, bridges=False)
    want = cam.law(TURN, 2)
    assert np.abs(c.motion[0] - want[0]).max() < 1e-9 * stroke
    smooth = np.abs(TURN[:, None] - np.concatenate([cam.law.knots, cam.law.knots + 2 * PI])).min(axis=1) > 1e-6
    for k in (1, 2):
        assert np.abs(c.motion[k] - want[k])[smooth & ~c.corner].max() < 1e-7 * np.abs(want[k]).max()


def test_jerk_and_contact_points_come_back_too():
    lift = program([Segment(2.0, 0.02, "4-5-6-7"), Segment(1.0), Segment(1.6, 0.0, "5-6-7-8-9"), Segment(2 * PI - 4.6)])
    for follower in (
        Follower(Translating(0.008), Roller(0.01)),
        Follower(Translating(0.008), Flat(tilt=0.1)),
        Follower(Translating(-0.004), Arc(0.05, 1.2)),
    ):
        cam = cam_on_base(lift, follower, 0.06)
        c, s = analyse(cam_contour(cam), follower, TURN, samples=720, bridges=False), cam.at(TURN)
        want = cam.law(TURN, 3)
        for k in range(4):
            np.testing.assert_allclose(c.motion[k], want[k], atol=1e-11 * np.abs(want[k]).max())
        np.testing.assert_allclose(c.point, s.working, atol=1e-8)
        np.testing.assert_allclose(c.normal, s.normal, atol=1e-7)
        np.testing.assert_allclose(c.radius, s.radius, rtol=1e-6)


def test_a_wedge_comes_back():
    law = program([Segment(0.04, 0.03, "3-4-5"), Segment(0.03, 0.02, "cycloidal")], 0.02)
    cam = Cam(law, Follower(Translating(), Roller(0.004)), wedge=True)
    x = np.linspace(0.005, 0.065, 24)
    c = analyse(cam_contour(cam), cam.follower, x, wedge=True, samples=600)
    for got, want in zip(c.motion, law(x, 3), strict=True):
        np.testing.assert_allclose(got, want, atol=1e-10 * np.abs(want).max())


def test_a_roller_rolls_over_corners_and_a_knife_is_knocked_by_them():
    square = polygon([0.03 + 0.03j, -0.03 + 0.03j, -0.03 - 0.03j, 0.03 - 0.03j][::-1])
    assert square.area == pytest.approx(0.0036, rel=1e-3), "either sense of the outline is taken"
    theta = np.linspace(0.01, 2 * PI, 120)
    roller = analyse(square, Follower(Translating(), Roller(0.01)), theta)
    assert roller.corner.any() and not roller.corner.all() and not roller.bridges
    # while it rolls over a corner its centre is on a circle about it
    k = roller.corner
    corner = roller.point[k] * np.exp(1j * theta[k])
    np.testing.assert_allclose(np.abs(1j * roller.motion[0][k] - corner), 0.01, rtol=1e-12)
    h = 1e-4
    near = analyse(square, Follower(Translating(), Roller(0.01)), np.array([0.7 - h, 0.7, 0.7 + h]), bridges=False).motion
    assert (near[0, 2] - near[0, 0]) / (2 * h) == pytest.approx(near[1, 1], rel=1e-6)
    assert (near[0, 2] - 2 * near[0, 1] + near[0, 0]) / h**2 == pytest.approx(near[2, 1], rel=1e-5)
    knife = analyse(square, Follower(Translating(), Knife()), theta)
    angles = [b.angle for b in knife.bridges]
    np.testing.assert_allclose(angles, np.radians([45, 135, 225, 315]), atol=1e-12)
    rate = 0.03 * np.sqrt(2)
    for b in knife.bridges:
        np.testing.assert_allclose(b.velocity, [rate, -rate], rtol=1e-9)
        assert b.shock
    np.testing.assert_allclose(knife.motion[0].max(), rate, rtol=1e-2)


def test_a_flat_follower_bridges_a_hollow_and_says_so():
    hollow = bulged([0.04, 0.04j, -0.04, -0.04j], [0.4, -0.2, 0.4, 0.4])
    theta = np.linspace(0.01, 2 * PI, 120)
    c = analyse(hollow, Follower(Translating(), Flat()), theta)
    (bridge,) = [b for b in c.bridges if b.shock]
    # the face lies on the corners at both ends of the hollow when their line is level
    assert bridge.angle == pytest.approx(np.radians(315), abs=1e-9)
    assert {round(bridge.leaves), round(bridge.lands)} == {1, 2}, "piece 1 is never touched"
    np.testing.assert_allclose(np.abs(bridge.velocity), 0.04 / np.sqrt(2), rtol=1e-9)
    assert not np.any((c.parameter > 1 + 1e-9) & (c.parameter < 2 - 1e-9))
    # a roller that fits goes through, one that does not is knocked
    radius = abs(1.0 / hollow.curvature([1.5])[0])
    small = analyse(hollow, Follower(Translating(), Roller(0.5 * radius)), theta)
    assert np.any((small.parameter > 1.3) & (small.parameter < 1.7)) and not any(b.shock for b in small.bridges)
    large = analyse(hollow, Follower(Translating(), Roller(2.0 * radius)), theta)
    assert any(b.shock for b in large.bridges)


@pytest.mark.parametrize("swings", [False, True])
@pytest.mark.parametrize("radius", [1e-3, 1e-4, 1e-5])
def test_a_roller_thinner_than_the_samples_are_apart(radius, swings):
    """Its centre runs as a knife on the curve at its radius; the law comes back whether or not a sample lies under the roller."""
    guide = Oscillating(0.2 + 0.01j, 0.16) if swings else Translating(0.012)
    lift = program([Segment(1.4, 0.1 if swings else 0.02), Segment(0.9), Segment(1.3, 0.0, "3-4-5"), Segment(2 * PI - 3.6)])
    cam = cam_on_base(lift, Follower(guide, Roller(radius)), 0.1)
    c = analyse(cam_contour(cam), cam.follower, TURN, bridges=False)
    for k in range(3):
        np.testing.assert_allclose(c.motion[k], cam.law(TURN, 2)[k], atol=1e-9 * np.abs(cam.law(TURN, 2)[k]).max())
    square, turns = polygon([0.1, 0.1j, -0.1, -0.1j]), np.linspace(0.0, 2.0 * PI, 361)
    thin, sharp = (analyse(square, f, turns, bridges=False) for f in (cam.follower, Follower(guide, Knife())))
    assert thin.corner.any() == (radius == 1e-3)  # as the radius goes to zero it is the knife
    off = (thin.motion[0] - sharp.motion[0]) * (0.16 if swings else 1.0)
    assert (off > 0.0).all() and off.max() < 4.0 * radius


def test_a_mushroom_on_an_arm_ends_where_its_arc_does():
    """The contact of a circular arc about the arm's point leaves it where the normal does: half_angle from straight across."""
    arm = Oscillating(0.12 + 0j, 0.11)
    disc, wide = circle(0.03, 0.012), analyse(circle(0.03, 0.012), Follower(arm, Arc(0.04)), TURN, bridges=False)
    centre = arm.pivot + arm.arm * arm.home * np.exp(-1j * arm.side * wide.motion[0])
    lean = np.abs(np.angle((wide.point * np.exp(1j * TURN) - centre) / (1j * arm.side * (centre - arm.pivot))))
    limit = 0.5 * (lean.min() + lean.max())
    short = analyse(disc, Follower(arm, Arc(0.04, limit)), TURN, bridges=False)
    inside = lean < limit - 1e-3
    np.testing.assert_allclose(short.motion[0][inside], wide.motion[0][inside], atol=1e-13)
    beyond = lean > limit + 1e-3
    assert inside.any() and beyond.any() and (~(np.abs(short.motion[0] - wide.motion[0]) < 1e-9))[beyond].all()


def test_first_contact_wins_everywhere():
    """Against brute force: no sampled point of the profile is inside the follower, and one touches it."""
    rng = np.random.default_rng(8)
    phi = np.linspace(0, 2 * PI, 14)[:-1]
    z, _ = spline_contour((0.04 + 0.012 * rng.random(13)) * np.exp(1j * phi))
    theta = np.linspace(0.1, 6.2, 31)
    points = z.samples(400)[2]
    for follower in (
        Follower(Translating(0.01), Roller(0.012)),
        Follower(Oscillating(0.09 + 0.01j, 0.08), Roller(0.012)),
        Follower(Oscillating(0.09 + 0.01j, 0.08, -1), Roller(0.012)),
    ):
        c = analyse(z, follower, theta)
        centre = follower.reference(c.motion[:1])[0]
        distance = np.abs(points[None, :] * np.exp(1j * theta)[:, None] - centre[:, None]).min(axis=1)
        assert distance.min() > 0.012 * (1 - 1e-12)
        assert distance.max() < 0.012 * (1 + 1e-4)
    flat = analyse(z, Follower(Translating(), Flat()), theta)
    top = (points[None, :] * np.exp(1j * theta)[:, None]).imag.max(axis=1)
    assert np.all(flat.motion[0] >= top * (1 - 1e-14)) and np.all(flat.motion[0] < top * (1 + 1e-5))


@pytest.mark.parametrize("tilt", [0.0, 0.2])
def test_a_short_face_moves_as_an_endless_one(tilt):
    """An eccentric disc: its centre is a radius away from the face, at the angle theta; the velocity is the exact derivative."""
    r, e, theta = 0.03, 0.02, np.linspace(0, 2 * PI, 25)
    c = analyse(circle(r, e), Follower(Translating(), Flat(tilt=tilt, left=0.005, right=0.005)), theta, bridges=False)
    x, cosine = theta - tilt, np.cos(tilt)
    wanted = np.array([r + e * np.sin(x), e * np.cos(x), -e * np.sin(x), -e * np.cos(x)]) / cosine
    np.testing.assert_allclose(c.motion, wanted, atol=1e-14)
    np.testing.assert_allclose(c.point * np.exp(1j * theta), e * np.exp(1j * theta) + 1j * r * np.exp(1j * tilt), atol=1e-14)
    np.testing.assert_allclose(c.radius, r, rtol=1e-12)


def test_a_short_face_on_an_arm_moves_as_an_endless_one():
    """The face through the pivot touches a disc whose centre is d away: its angle from the line to the centre is asin(r / d)."""
    r, e, pivot, theta = 0.03, 0.01, 0.1 + 0j, np.linspace(0, 2 * PI, 25)
    follower = Follower(Oscillating(pivot, 0.1), Flat(left=0.005, right=0.005))
    c = analyse(circle(r, e), follower, theta, bridges=False)
    away = e * np.exp(1j * theta) - pivot
    np.testing.assert_allclose(c.motion[0], -np.angle(-away) + np.arcsin(r / np.abs(away)), atol=1e-14)
    reach = np.abs(c.point * np.exp(1j * theta) - follower.reference(c.motion[:1])[0])
    assert reach.max() > 0.005, "the contact lies beyond the ends of the face"


def test_a_knife_beside_the_profile_touches_nothing():
    assert analyse(circle(0.03, 0.02), Follower(Translating(0.06), Knife()), TURN, bridges=False).lost.all()


def test_tangent_cam_of_arcs_and_lines():
    """Base circle, flanks as tangents, nose circle: the textbook's closed form of the lift on the flank."""
    base, nose, distance = 0.03, 0.01, 0.035
    beta = np.arccos((base - nose) / distance)  # polar angle of the tangent's normal from the axis of symmetry
    n1, n2 = np.exp(1j * beta), np.exp(-1j * beta)
    cam = Contour((
        arc(distance, nose, -beta, 2 * beta),
        line(distance + nose * n1, base * n1),
        arc(0, base, beta, 2 * PI - 2 * beta),
        line(base * n2, distance + nose * n2),
    ))  # fmt: skip
    assert not cam.corners(), "tangent everywhere"
    r = 0.012
    phi = np.linspace(0.02, 0.2, 7)  # angle from the start of the straight flank
    theta = PI / 2 - beta + phi
    c = analyse(cam, Follower(Translating(), Roller(r)), theta)
    np.testing.assert_allclose(c.motion[0], (base + r) / np.cos(theta - PI / 2 + beta), rtol=1e-12)
    x = theta - PI / 2 + beta
    np.testing.assert_allclose(c.motion[1], (base + r) * np.tan(x) / np.cos(x), rtol=1e-11)
    np.testing.assert_allclose(c.motion[2], (base + r) * (1 + 2 * np.tan(x) ** 2) / np.cos(x), rtol=1e-11)
    assert np.isinf(c.radius).all()


def test_polynomial_and_measured_profiles():
    law = MotionCurve.of((0, PI, 2 * PI), [[0.04, 0, 0.003, -0.0002], [0.04 + 0.003 * PI**2 - 0.0002 * PI**3, 0, -0.001]])
    end = float(law(2 * PI, 0, "left")[0])
    closed = program([Segment(PI, 0.06, "3-4-5"), Segment(PI, 0.04, "3-4-5")], 0.04)
    assert end != pytest.approx(0.04)
    with pytest.raises(MechanismError, match="gap"):
        polar_contour(law)
    for least in (0.0, 1e-9, -0.01):  # a point that has no tangent, or a radius on the other side of the axis
        with pytest.raises(MechanismError, match="axis is not inside of the profile"):
            polar_contour(program([Segment(PI / 2, least, "3-4-5"), Segment(PI / 2, least), Segment(PI, 0.04, "3-4-5")], 0.04))
    contour = polar_contour(closed)
    theta = np.linspace(0.1, 6.0, 21)
    c = analyse(contour, Follower(Translating(), Knife()), theta)
    np.testing.assert_allclose(c.motion[0], closed(PI / 2 - theta, 0)[0], rtol=1e-12)
    # measured points of a known cam: the spline converges to it
    cam = cam_on_base(program([Segment(PI, 0.02, "3-4-5"), Segment(PI, 0.0, "3-4-5")]), Follower(Translating(), Roller(0.01)), 0.05)
    errors = []
    for n in (60, 240):
        z, rms = spline_contour(cam.at(np.linspace(0, 2 * PI, n, endpoint=False)).working)
        assert rms < 1e-12
        got = analyse(z, cam.follower, theta, bridges=False).motion[0]
        errors.append(np.abs(got - cam.law(theta, 0)[0]).max())
    assert errors[1] < errors[0] / 20 and errors[1] < 1e-7
    noisy = cam.at(np.linspace(0, 2 * PI, 240, endpoint=False)).working + 1e-5 * np.random.default_rng(1).standard_normal(240)
    smooth, rms = spline_contour(noisy, tolerance=1e-5)
    assert rms == pytest.approx(1e-5, rel=0.1)
    assert smooth.count < 60
    phi = np.arange(12) * PI / 6
    z = (0.03 + 0.004 * np.cos(2 * phi) + 1e-6 * np.random.default_rng(0).standard_normal(12)) * np.exp(1j * phi)
    for part in range(-32, -2):  # the search for the smoothest ends without success at some: no warning, within the tolerance
        for closed_ in (True, False):
            tolerance = 0.03 * 10 ** (0.5 * part)
            assert spline_contour(z, tolerance, closed_)[1] <= max(1.01 * tolerance, 1e-15)


def test_outlines_that_are_none():
    with pytest.raises(MechanismError, match="no length"):
        line(1.0, 1.0)
    with pytest.raises(MechanismError, match="measured points"):
        spline_contour([0, 1, 1j])
    with pytest.raises(MechanismError, match="no outline"):
        bulged([1.0, 1.0])


def test_bulges_are_arcs_of_the_dxf_kind():
    half = bulged([0.02, -0.02], [1.0, 1.0])
    assert half.area == pytest.approx(PI * 0.02**2, rel=1e-3)
    np.testing.assert_allclose(half.curvature([0.3, 1.7]), 50.0, rtol=1e-12)


def test_the_graphical_method_and_its_error():
    disc = circle(0.04, 0.012)
    follower = Follower(Translating(), Roller(0.01))
    coarse, fine = graphical(disc, follower, 24), graphical(disc, follower, 96)
    assert np.all(coarse.largest[1:] / fine.largest[1:] > 14.0), "error falls with the square of the step"
    assert 0.005 < coarse.largest[2] < 0.03
    read = graphical(disc, follower, 24, resolution=5e-4)
    assert np.abs(read.error[0]).max() <= 2.5e-4 + 1e-15
    assert read.largest[2] > 3 * coarse.largest[2], "two differentiations magnify what cannot be read off"
    assert graphical(disc, follower, 24, "tangent").largest[2] > coarse.largest[2]
    with pytest.raises(MechanismError, match="at least 4"):
        graphical(disc, follower, 3)


@pytest.mark.parametrize("guide", [Translating(0.01), Translating(-0.004), Oscillating(0.1, 0.09)], ids=["right", "left", "arm"])
def test_a_knife_exactly_on_a_joint_of_the_profile_stands_there(guide):
    """At the knots of the law the tip passes the ends of two pieces: the outer crossing is found, not the one on the far side."""
    swings = isinstance(guide, Oscillating)
    lift = program([Segment(PI, 0.2 if swings else 0.02, "constant-acceleration"), Segment(PI, 0.0, "constant-acceleration")])
    cam = cam_on_base(lift, Follower(guide, Knife()), 0.04)
    computed = analyse(cam_contour(cam), cam.follower, np.append(lift.knots, [2.0, 5.0]), bridges=False).motion[0]
    np.testing.assert_allclose(computed, cam.law(np.append(lift.knots, [2.0, 5.0]), 0)[0], rtol=1e-9)
