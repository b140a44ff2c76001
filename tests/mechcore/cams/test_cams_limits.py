"""Limits of cams against the reference, the search for base circle and offset, the hard cases, spatial cams."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cam_cases import CASES, NAMES, segments_program
from cases import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from mechcore.cams.analysis import analyse
from mechcore.cams.contour import cam_contour
from mechcore.cams.followers import Flat, Follower, Knife, Oscillating, Roller, Translating
from mechcore.cams.limits import Requirement, find_limits, judge_limits, undercut_ranges
from mechcore.cams.real_profiles import cut_profile
from mechcore.cams.sizing import best_offset, least_base, outer_flank
from mechcore.cams.spatial import Barrel, BarrelArm, Globoid, SpatialCam, spatial_limits
from mechcore.cams.synthesis import Cam, cam_on_base
from mechcore.errors import MechanismError
from mechcore.laws.catalogue import RISES, rise
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import peak_factors
from mechcore.laws.program import Segment, program

PI = np.pi
LIFT = program([Segment(2.0, 0.02), Segment(1.0), Segment(1.6, 0.0, "3-4-5"), Segment(2 * PI - 4.6)])
THETA = np.linspace(0, 2 * PI, 20001)


def test_extremes_of_the_reference():
    case = CASES["cam-rdrd-extremes"]
    law, expected = segments_program(case["inputs"]), case["expected"]
    for row in expected["pressure"]:
        limits = find_limits(Cam(law, Follower(Translating(row["e"]), Knife())))
        assert limits.rise.value == pytest.approx(row["rise_max_pressure_angle"], rel=1e-12)
        assert limits.rise.angle == pytest.approx(row["rise_theta"], abs=1e-5)
        assert -limits.fall.value == pytest.approx(row["return_extreme_pressure_angle"], rel=1e-12)
    flat = find_limits(Cam(law, Follower(Translating(), Flat())))
    assert flat.distance_right.value == pytest.approx(expected["flat_contact_offset_max"]["value"], rel=1e-13)
    assert flat.distance_left.value == pytest.approx(expected["flat_contact_offset_min"]["value"], rel=1e-13)
    assert flat.face_length == pytest.approx(flat.distance_right.value - flat.distance_left.value)
    computed = find_limits(Cam(law, Follower(Translating(0.01), Roller(0.008))))
    assert computed.greatest_roller.value == pytest.approx(expected["max_roller_radius_without_undercut"], rel=1e-12)
    assert computed.concave is None


def test_a_roller_as_large_as_the_least_radius_makes_a_cusp_and_a_larger_one_undercuts():
    case = CASES["cam-roller-cusp"]
    law = segments_program(case["inputs"])
    for stroke in case["expected"].values():
        cam = Cam(law, Follower(Translating(case["inputs"]["e"]), Roller(stroke["rho_min"])))
        s = cam.at(stroke["theta"])
        assert abs(s.radius[0]) < 1e-12 * stroke["rho_min"]
        np.testing.assert_allclose([s.working[0].real, s.working[0].imag], stroke["cusp_point"], rtol=0, atol=1e-11)
    least = case["expected"]["rise"]["rho_min"]
    exact = find_limits(Cam(law, Follower(Translating(0.004), Roller(least))))
    assert abs(exact.sharpness.value) < 1e-11 and not exact.undercut
    larger = Cam(law, Follower(Translating(0.004), Roller(least * 1.001)))
    assert find_limits(larger).undercut
    ranges = undercut_ranges(larger, np.linspace(0, 2 * PI, 20000))
    assert len(ranges) == 1 and ranges[0][0] < case["expected"]["rise"]["theta"] < ranges[0][1]
    assert find_limits(Cam(law, Follower(Translating(0.004), Roller(least * 0.999)))).sharpness.value == pytest.approx(
        1e-3, rel=1e-6
    )


@pytest.mark.parametrize("row", CASES["cam-flat-undercut-threshold"]["expected"], ids=lambda r: f"{r['law']}-{r['beta']:.2f}")
def test_flat_follower_at_the_threshold_of_undercut(row):
    lift = program([Segment(row["beta"], row["lift"], NAMES[row["law"]])], repeats=False)
    least = least_base(lift, Follower(Translating(), Flat()), Requirement())
    assert least.base == pytest.approx(row["min_base_radius"], rel=1e-12, abs=1e-15)
    if row["min_base_radius"] > 0.0:
        assert not least.limits.undercut, "exactly at the threshold there is a cusp, no undercut"
        assert abs(least.limits.sharpness.value) < 1e-12
        assert find_limits(cam_on_base(lift, Follower(Translating(), Flat()), 0.99 * least.base)).undercut


@pytest.mark.parametrize("row", CASES["cam-pressure-limited-base"]["expected"], ids=lambda r: f"{r['law']}-{r['e']}")
def test_least_base_for_a_pressure_angle(row):
    lift = program([Segment(row["beta"], row["lift"], NAMES[row["law"]])], repeats=False)
    least = least_base(lift, Follower(Translating(row["e"]), Knife()), Requirement(pressure_rise=row["alpha_max"]))
    assert least.start == pytest.approx(row["min_h_base"], rel=1e-11)
    assert least.decides == "pressure angle on the rise"


@settings(max_examples=examples(15))
@given(st.floats(12, 40), st.floats(12, 40), st.floats(0.0, 0.012), st.floats(0.001, 0.02), st.sampled_from([1, -1]))
def test_best_offset_is_feasible_and_beats_its_neighbours(up, down, radius, r, turn):
    want = Requirement(radius, np.radians(up), np.radians(down))
    best = best_offset(LIFT, Roller(r), want, turn)
    assert all(v.margin > -1e-9 for v in best.verdicts)
    assert min(v.margin for v in best.verdicts if v.condition == best.decides or best.decides == "base circle") < 1e-6
    for e in best.offset + np.array([-3e-3, -3e-4, 3e-4, 3e-3]):
        other = least_base(LIFT, Follower(Translating(e), Roller(r)), want, turn)
        assert other.base >= best.base * (1 - 1e-5)
    mirrored = best_offset(LIFT, Roller(r), want, -turn)
    assert mirrored.base == pytest.approx(best.base, rel=1e-6)
    assert mirrored.offset == pytest.approx(-best.offset, abs=1e-6)


def test_offset_against_the_turning_eases_the_rise_and_loads_the_return():
    rise_only = best_offset(LIFT, Knife(), Requirement(pressure_rise=np.radians(20), pressure_fall=np.radians(60)))
    assert rise_only.offset > 0.0
    fall_only = best_offset(LIFT, Knife(), Requirement(pressure_rise=np.radians(60), pressure_fall=np.radians(20)))
    assert fall_only.offset < 0.0
    at = [find_limits(cam_on_base(LIFT, Follower(Translating(e), Knife()), 0.05)) for e in (0.0, 0.01)]
    assert at[1].rise.value < at[0].rise.value and at[1].fall.value > at[0].fall.value


@pytest.mark.parametrize("face", [Roller(0.01), Knife(), Flat()])
@pytest.mark.parametrize("side", [1, -1])
def test_least_base_of_oscillating_followers_is_the_least(face, side):
    lift = program([Segment(2.0, 0.25), Segment(1.0), Segment(1.6, 0.0, "3-4-5"), Segment(2 * PI - 4.6)])
    want = Requirement(radius=0.004, pressure_rise=np.radians(40), pressure_fall=np.radians(50))
    follower = Follower(Oscillating(0.16, 0.14, side), face)
    best = least_base(lift, follower, want)
    assert all(v.margin > -1e-9 for v in best.verdicts)
    tight = next(v for v in best.verdicts if v.condition == best.decides)
    assert abs(tight.margin) < 1e-7
    smaller = cam_on_base(lift, follower, best.base * 0.999)
    limits = find_limits(smaller)
    fails = limits.undercut or limits.rise.value > want.pressure_rise or limits.fall.value > want.pressure_fall
    assert fails or limits.convex.value < want.radius


@settings(max_examples=examples(25))
@given(
    st.sampled_from(sorted(set(RISES) - {"constant-velocity", "constant-acceleration"})),
    st.sampled_from(sorted(set(RISES) - {"constant-velocity", "constant-acceleration"})),
    st.floats(0.5, 2.4),
    st.floats(-0.02, 0.02),
    st.sampled_from([Knife(), Roller(0.007), Flat()]),
    st.sampled_from([None, 0.3, 0.6]),
    st.sampled_from([None, 0.006]),
    st.sampled_from([1, -1]),
)
def test_least_base_keeps_its_limits_for_any_law(up, down, over, e, face, alpha, radius, turn):
    lift = program([Segment(over, 0.03, up), Segment(0.5), Segment(over, 0.0, down), Segment(2 * PI - 0.5 - 2 * over)])
    want = Requirement(radius, alpha, alpha)
    best = least_base(lift, Follower(Translating(e), face), want, turn, at_least=0.002)
    assert all(v.margin > -1e-9 for v in best.verdicts), (best.decides, best.verdicts)
    if best.decides != "base circle" and not isinstance(face, Flat):
        worse = judge_limits(find_limits(Cam(lift.raised(best.start * (1 - 1e-4)), best.cam.follower, turn)), want)
        assert not all(v.passed for v in worse)


def test_a_law_whose_velocity_jumps_has_no_least_base():
    lift = program([Segment(2.0, 0.02, "constant-velocity"), Segment(1.0), Segment(2.0, 0.0), Segment(2 * PI - 5)])
    with pytest.raises(MechanismError, match="velocity jumps down at"):
        least_base(lift, Follower(Translating(), Roller(0.01)), Requirement())


def test_limits_that_cannot_be_kept_are_refused():
    lift = program([Segment(2.0, 0.5), Segment(2 * PI - 2.0, 0.0)])
    with pytest.raises(MechanismError, match="Move the pivot"):
        least_base(lift, Follower(Oscillating(0.1, 0.09), Roller(0.01)), Requirement(pressure_rise=np.radians(2)))
    with pytest.raises(MechanismError, match="stem"):
        best_offset(LIFT, Flat(), Requirement())


# --- hard cases -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("base", [0.0, 1e-12, 1e-6])
@pytest.mark.parametrize("face", [Knife(), Roller(0.005), Flat()])
def test_base_circle_near_zero_stays_finite(base, face):
    limits = find_limits(cam_on_base(LIFT, Follower(Translating(), face), base))
    for value in (limits.rise.value, limits.fall.value, limits.sharpness.value):
        assert np.isfinite(value)
    assert 0.0 <= limits.rise.value <= PI / 2
    if isinstance(face, Knife):
        assert limits.rise.value > 1.5, "a knife at the centre is pushed sideways"


def test_the_lecture_s_cam_with_velocity_jumps_under_a_roller():
    """C1 = 0: at pi the velocity falls, a fold of the profile; at the wrap it rises, and the roller cuts an arc of its own
    radius."""
    a0 = 0.02 / PI**2
    law = MotionCurve.of((0, PI, 2 * PI), [[0.04, 0.0, a0], [0.06, 0.0, -a0]], repeats=True)
    for face in (Roller(0.006), Flat(), Knife()):
        cam = Cam(law, Follower(Translating(0.01), face))
        limits = find_limits(cam)
        assert limits.convex.value == 0.0 and limits.convex.angle == pytest.approx(PI)
        assert limits.undercut == (not isinstance(face, Knife))
    cam = Cam(law, Follower(Translating(0.01), Roller(0.006)))
    whole = cam_contour(cam)
    ends = np.array([p(np.array([0.0, 1.0]), 0)[0] for p in whole.pieces])
    np.testing.assert_allclose(ends[:, 1], np.roll(ends[:, 0], -1), atol=1e-15)
    hollow = min(1.0 / whole.curvature(np.arange(whole.count) + 0.5), key=lambda r: abs(r + 0.006))
    assert hollow == pytest.approx(-0.006)
    cut = cut_profile(cam, 1440)
    ((a, b),) = cut.lost
    assert a < PI < b
    theta = np.concatenate([np.linspace(0.2, a - 0.05, 9), np.linspace(b + 0.05, 6.1, 9)])
    got = analyse(cut.contour, cam.follower, theta, bridges=False)
    np.testing.assert_allclose(got.motion[0], law(theta, 0)[0], rtol=1e-12)
    assert cut.error > 1e-5


def test_dwells_are_arcs_and_curvature_jumps_are_seen_from_both_sides():
    lift = program([Segment(2.0, 0.02, "parabolic"), Segment(1.0), Segment(1.6, 0.0, "harmonic"), Segment(2 * PI - 4.6)])
    cam = Cam(lift.raised(0.05), Follower(Translating(), Roller(0.008)))
    dwell = cam.at([2.2, 2.5, 5.0])
    np.testing.assert_allclose(dwell.pitch_radius, [0.07, 0.07, 0.05], rtol=1e-14)
    np.testing.assert_allclose(dwell.pressure_angle, 0.0, atol=1e-16)
    # the harmonic return begins with an acceleration step: the least radius is the limit from its side
    left, right = cam.at([3.0], "left").radius[0], cam.at([3.0], "right").radius[0]
    assert left == pytest.approx(0.062) and right < left
    limits = find_limits(cam)
    sampled = cam.at(THETA).radius
    assert limits.convex.value <= sampled[sampled > 0].min() * (1 + 1e-12)
    assert peak_factors(rise("parabolic")).jerk == np.inf


def test_concave_cams_and_rollers_in_a_groove():
    # a wedge with a hollow: the near flank can be cut by any roller that fits, the far flank is cut by the convex parts
    wave = program([Segment(0.04, 0.012, "harmonic"), Segment(0.04, 0.0, "harmonic")])
    near = Cam(wave, Follower(Translating(), Roller(0.008)), wedge=True)
    far = replace(near, outer=True)
    a, b = find_limits(near), find_limits(far)
    assert a.concave is not None and a.greatest_roller.value == pytest.approx(b.greatest_roller.value, rel=1e-9)
    s, f = near.at([0.003, 0.021, 0.037]), far.at([0.003, 0.021, 0.037])
    np.testing.assert_allclose(np.abs(s.working - f.working), 0.016, rtol=1e-13)
    np.testing.assert_allclose(s.radius + f.radius, -0.016, rtol=1e-12)


def test_what_the_cutter_leaves_of_an_undercut_cam():
    law = segments_program(CASES["cam-roller-cusp"]["inputs"])
    whole = cut_profile(Cam(law, Follower(Translating(0.004), Roller(0.012))), 1440)
    assert whole.lost == () and whole.error == 0.0
    cam = Cam(law, Follower(Translating(0.004), Roller(0.016)))
    cut = cut_profile(cam, 1440)
    assert len(cut.lost) == 2
    w = cam.working_curve(np.ravel(cut.lost), 0)[0].reshape(2, 2)
    np.testing.assert_allclose(w[:, 0], w[:, 1], atol=1e-14)
    # nothing that is left lies in the way of the roller anywhere
    z = cut.contour.samples(200)[2]
    pitch = cam.at(np.linspace(0, 2 * PI, 4001)).pitch
    assert np.abs(z[:, None] - pitch[None, ::4]).min() > 0.016 * (1 - 1e-9)
    assert 1e-5 < cut.error < 1e-3
    assert any(a <= cut.angle + turn <= b for a, b in cut.lost for turn in (0.0, 2 * PI))
    with pytest.raises(MechanismError, match="only disc cams"):
        cut_profile(replace(cam, outer=True))


# --- spatial cams ---------------------------------------------------------------------------------------------------------------

AXIAL = program([Segment(np.radians(150), 0.03), Segment(1.0), Segment(2.0, 0.0, "4-5-6-7"), Segment(2 * PI - np.radians(150) - 3)])
SWING = program([Segment(2.0, 0.6, "4-5-6-7"), Segment(1.0), Segment(2.0, 0.0, "5-6-7-8-9"), Segment(2 * PI - 5)]).raised(-0.3)
SPATIAL = {
    "barrel": SpatialCam(AXIAL, Barrel(), 0.008, 0.035, 0.045),
    "barrel clockwise": SpatialCam(AXIAL, Barrel(), 0.008, 0.035, 0.045, turn=-1),
    "barrel with an arm": SpatialCam(SWING, BarrelArm((0.06, 0.0), 0.06), 0.008, 0.035, 0.05),
    "globoid": SpatialCam(SWING, Globoid(0.1), 0.008, 0.05, 0.07),
    "globoid clockwise": SpatialCam(SWING, Globoid(0.1), 0.008, 0.05, 0.07, turn=-1),
}


def test_barrel_cam_of_the_reference():
    case = CASES["cam-cylindrical"]
    i, rows = case["inputs"], case["expected"]
    law = program([Segment(np.radians(i["beta_deg"]), i["lift"])], repeats=False)
    theta = np.array([r["theta"] for r in rows])
    flank = SpatialCam(law, Barrel(), 0.005, 0.04, 0.05).flank(theta, i["radius"])
    np.testing.assert_allclose(flank.pressure_angle[:, 0], [r["pressure_angle"] for r in rows], rtol=1e-12)
    np.testing.assert_allclose(flank.motion[0], [r["axial"] for r in rows], rtol=1e-12)
    np.testing.assert_allclose(i["omega"] * flank.motion[1], [r["axial_velocity"] for r in rows], rtol=1e-12)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("name", SPATIAL)
def test_flanks_touch_the_roller_by_inversion(name, side):
    """Kinematic inversion: of all positions of the roller the one at theta comes nearest to its flank point, at the distance r."""
    cam = SPATIAL[name]
    along = np.array([cam.inner, cam.outer])
    for theta in (0.4, 1.2, 3.7):
        point, normal = cam.flank(theta, along, side).point[0], cam.flank(theta, along, side).normal[0]
        for p, n in zip(point, normal, strict=True):
            gaps = []
            for d in (-1e-3, 0.0, 1e-3):
                foot = cam.flank(theta + d, [0.0, 1.0], side).axis_point[0]
                a = foot[1] - foot[0]
                w = p - foot[0]
                gaps.append(np.linalg.norm(w - (w @ a) * a))
                if d == 0.0:
                    assert abs(n @ a) < 1e-12
            assert gaps[1] == pytest.approx(cam.radius, rel=1e-12)
            assert gaps[0] >= cam.radius and gaps[2] >= cam.radius
            assert abs(gaps[2] - gaps[0]) < 0.05 * (gaps[2] + gaps[0] - 2 * gaps[1]) + 1e-12 or abs(gaps[2] - gaps[0]) < 1e-8


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("name", SPATIAL)
def test_curvatures_and_regularity_of_flanks_by_differences(name, side):
    cam = SPATIAL[name]
    theta, along, h = np.array([0.4, 1.3, 3.9]), np.linspace(cam.inner, cam.outer, 3), 1e-4

    def slope(what, along_axis):
        def at(k):
            f = cam.flank(theta + (0 if along_axis else k * h), along + (k * h if along_axis else 0), side)
            return getattr(f, what)

        return (at(-2) - 8 * at(-1) + 8 * at(1) - at(2)) / (12 * h)

    f = cam.flank(theta, along, side)
    s = [slope("point", k) for k in (False, True)]
    n = [slope("normal", k) for k in (False, True)]
    x = [slope("axis_point", k) for k in (False, True)]
    dot = lambda a, b: np.einsum("...i,...i->...", a, b)  # noqa: E731  # short and local
    area, whole = dot(np.cross(*s), f.normal), dot(np.cross(*x), f.normal)
    np.testing.assert_allclose(f.sharpness, area / whole, atol=1e-9)
    assert max(np.abs(dot(v, f.normal)).max() for v in s) < 1e-10
    first = np.array([[dot(a, b) for a in s] for b in s]).transpose(2, 3, 0, 1)
    second = np.array([[dot(a, b) for a in n] for b in s]).transpose(2, 3, 0, 1)
    want = np.sort(np.linalg.eigvals(np.linalg.solve(first, second)).real, axis=-1)
    large, small = f.principal_curvatures
    np.testing.assert_allclose(want[..., 1], large, atol=1e-7 * np.abs(want).max())
    np.testing.assert_allclose(want[..., 0], small, atol=1e-7 * np.abs(want).max())
    # the roller radius at which the flank becomes singular does make it singular
    limit = float(f.greatest_roller.min())
    assert np.abs(replace(cam, radius=limit).flank(theta, along, side).sharpness).min() < 1e-12
    assert replace(cam, radius=limit * 1.01).flank(theta, along, side).sharpness.min() < 0.0


def test_thin_rollers_on_a_barrel_are_the_plane_cam_of_its_development():
    radius, r = 0.045, 1e-5
    theta = np.linspace(0.1, 2.4, 9)
    flat = Cam(
        program([Segment(np.radians(150) * radius, 0.03)], repeats=False), Follower(Translating(), Roller(r)), wedge=True
    ).at(theta * radius)
    flank = SpatialCam(AXIAL, Barrel(), r, 0.04, 0.05).flank(theta, radius)
    np.testing.assert_allclose(flank.pressure_angle[:, 0], flat.pressure_angle, rtol=1e-12)
    np.testing.assert_allclose((1 - flank.sharpness[:, 0]) / r, 1 / flat.pitch_radius, rtol=1e-3, atol=1e-3)


def test_limits_of_spatial_cams():
    cam = SPATIAL["barrel"]
    limits = spatial_limits(cam)
    beta = np.radians(150)
    assert limits.pressure.value >= np.arctan(2 * 0.03 / beta / cam.inner) * (1 - 1e-4)
    assert not limits.undercut
    thick = replace(cam, radius=limits.greatest_roller.value * 1.01)
    assert spatial_limits(thick).undercut
    assert spatial_limits(replace(cam, radius=limits.greatest_roller.value * 0.99)).sharpness.value > 0.0
    rib = spatial_limits(cam, sides=(1,))
    assert rib.greatest_roller.value >= limits.greatest_roller.value
    for name in ("globoid", "barrel with an arm"):
        f = SPATIAL[name].flank([1.0, 4.0], [0.5 * (SPATIAL[name].inner + SPATIAL[name].outer)])
        assert f.pressure_angle[0, 0] > 0.0 > f.pressure_angle[1, 0], "positive while the cam lifts"
    with pytest.raises(MechanismError, match="smaller first"):
        SpatialCam(AXIAL, Barrel(), 0.008, 0.05, 0.04)


def test_the_best_offset_of_a_groove_counts_its_outer_flank():
    """A steep return bends the pitch curve inwards: there the outer flank decides, and the offset that is best for the inner one
    alone asks for a base circle of half as much again."""
    lift = program(
        [Segment(np.radians(150), 0.020), Segment(np.radians(60)), Segment(np.radians(90), 0.0), Segment(np.radians(60))]
    )
    want, roller = Requirement(pressure_rise=np.radians(45), pressure_fall=np.radians(45)), Roller(0.012)
    inner = best_offset(lift, roller, want)
    best = best_offset(lift, roller, want, beside=outer_flank)

    def base_at(offset: float) -> float:
        return least_base(lift, Follower(Translating(offset), roller), want, beside=outer_flank).base

    assert base_at(inner.offset) > 1.4 * best.base
    assert min(base_at(best.offset + shift) for shift in (-1e-4, 1e-4)) > best.base
    bent = outer_flank(best.cam)[0]
    assert find_limits(bent).sharpness.value == pytest.approx(0.0, abs=1e-6)
