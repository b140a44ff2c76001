"""Cam synthesis against the reference and against a second route; the lecture's examples; closures, forces, equivalent linkage."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from cam_cases import CASES, CONTACT_FORCE, by_inversion, segments_program
from cases import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from mechcore.cams.closures import (
    Closure,
    breadth,
    closing_force,
    conjugate,
    first_separation,
    hertz,
)
from mechcore.cams.followers import Arc, Flat, Follower, Knife, Oscillating, Roller, Translating
from mechcore.cams.limits import Requirement, check_limits, find_limits
from mechcore.cams.spatial import InverseCam
from mechcore.cams.synthesis import Cam, cam_on_base, equivalent_linkage, neglected_phase, simplified_offset_error
from mechcore.errors import MechanismError
from mechcore.laws.boundary_conditions import from_acceleration
from mechcore.laws.catalogue import rise
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import jumps
from mechcore.laws.program import Segment, program

PI = np.pi
RTOL = 1e-12


def close(got, want, rtol=RTOL):
    """Relative to the largest comparable value."""
    want = np.asarray(want)
    np.testing.assert_allclose(got, want, rtol=0.0, atol=rtol * np.abs(want).max())


def points(rows, *keys):
    out = []
    for row in rows:
        for key in keys:
            row = row[key]
        out.append(complex(*row))
    return np.array(out)


def column(rows, *keys):
    out = []
    for row in rows:
        for key in keys:
            row = row[key]
        out.append(row)
    return np.array(out)


# --- reference ------------------------------------------------------------------------------------------------------------

RDRD = CASES["cam-rdrd-roller-flat"]
LAW = segments_program(RDRD["inputs"])
OFFSET = Follower(Translating(RDRD["inputs"]["e"]), Roller(RDRD["inputs"]["roller_radius"]))


def test_rise_dwell_return_dwell_cam_with_roller_and_flat_follower():
    rows = RDRD["expected"]
    theta = column(rows, "theta")
    close(LAW(theta, 3), [column(rows, k) for k in ("h", "h1", "h2", "h3")])
    s = Cam(LAW, OFFSET).at(theta)
    other = by_inversion(Cam(LAW, OFFSET), theta)
    for got in (s.pitch, other["pitch"]):
        close(got, points(rows, "roller", "pitch_point"))
    for got in (s.working, other["working"]):
        close(got, points(rows, "roller", "profile_point"))
    for got in (s.pressure_angle, other["pressure_angle"]):
        close(got, column(rows, "roller", "pressure_angle"))
    for got in (s.pitch_radius, other["pitch_radius"]):
        np.testing.assert_allclose(got, column(rows, "roller", "pitch_curvature_radius"), rtol=RTOL)
    np.testing.assert_allclose(s.radius, column(rows, "roller", "profile_curvature_radius"), rtol=RTOL)
    f = Cam(LAW, Follower(Translating(0.01), Flat())).at(theta)
    close(f.contact.real, column(rows, "flat", "contact_offset"))
    close(f.distance, column(rows, "flat", "contact_offset") - 0.01)
    close(f.working, points(rows, "flat", "profile_point"))
    np.testing.assert_allclose(f.radius, column(rows, "flat", "profile_curvature_radius"), rtol=RTOL)


def test_oscillating_roller_follower():
    case = CASES["cam-oscillating-roller"]
    d, arm, r = (case["inputs"][k] for k in ("d", "l", "roller_radius"))
    law = MotionCurve.of((0, 2 * PI), [[np.radians(34)]], [[[1.0, 0.0, -np.radians(9)]]], repeats=True)
    rows = case["expected"]
    cam = Cam(law, Follower(Oscillating(d, arm), Roller(r)))
    theta = column(rows, "theta")
    other = by_inversion(cam, theta)
    s = cam.at(theta)
    for pitch, working, alpha, rho in (
        (s.pitch, s.working, s.pressure_angle, s.pitch_radius),
        (other["pitch"], other["working"], other["pressure_angle"], other["pitch_radius"]),
    ):
        close(pitch, points(rows, "pitch_point"))
        close(working, points(rows, "profile_point"))
        close(np.abs(alpha), column(rows, "pressure_angle_abs"))
        np.testing.assert_allclose(rho, column(rows, "pitch_curvature_radius"), rtol=RTOL)


def test_translating_cam():
    case = CASES["cam-translating-roller"]
    a, wave, r, speed = (case["inputs"][k] for k in ("amplitude", "wavelength", "roller_radius", "speed"))
    rows = case["expected"]
    law = MotionCurve.of((0, wave), [[a]], [[[2 * PI / wave, 0.0, -a]]], repeats=True)
    s = Cam(law, Follower(Translating(), Roller(r)), wedge=True).at(column(rows, "x"))
    close(s.motion[0], column(rows, "pitch_height"))
    close(s.pressure_angle, column(rows, "pressure_angle"))
    close(s.working, points(rows, "profile_point"))
    np.testing.assert_allclose(s.pitch_radius, column(rows, "curvature_radius_pitch"), rtol=RTOL)
    close(speed * s.motion[1], column(rows, "follower_velocity"))
    close(speed**2 * s.motion[2], column(rows, "follower_acceleration"))


def lecture_law(inputs, case):
    """The lecture's laws as functions of the angle; accelerations are integrated as the lecture does it."""
    w, lift = inputs["omega"], inputs["total_lift"]
    if "homework" in case:
        a0 = inputs["a0"] / w**2
        middle = inputs["R"] if "h0" in case else inputs["R"] + lift / 2
        return from_acceleration(MotionCurve.of((0, 2 * PI), [[0.0]], [[[1.0, a0, 0.0]]], repeats=True), middle)
    if "cycloidal" in case:
        return program([Segment(PI, inputs["R"] + lift), Segment(PI, inputs["R"])], inputs["R"])
    a0, c1 = inputs["a0"] / w**2, inputs["C1"] / w
    h0 = inputs.get("h_at_0", inputs["R"])
    top = h0 + c1 * PI + a0 * PI**2 / 2
    return MotionCurve.of((0, PI, 2 * PI), [[h0, c1, a0 / 2], [top, a0 * PI - c1 - a0 * PI, -a0 / 2]], repeats=True)


@pytest.mark.parametrize(
    "case",
    ["cam-lecture-constacc-C1-0", "cam-lecture-constacc-smooth", "cam-homework-sine", "cam-homework-sine-h0-convention",
     "cam-cycloidal-rise-return"],
)  # fmt: skip
def test_the_lecture_s_examples_with_every_boundary(case):
    data = CASES[case]
    inputs = data["inputs"]
    expected = data["expected"]
    rows = expected["rows"] if isinstance(expected, dict) else expected
    law, w, e = lecture_law(inputs, case), inputs["omega"], inputs["e"]
    scale = {k: np.abs(column(rows, k)).max() for k in ("velocity", "acceleration", "jerk")}
    for row in rows:
        side = {"left limit": "left", "right limit": "right"}.get(row["side"], "right")
        theta = np.array([row["theta"]])
        h = law(theta, 3, side)[:, 0]
        assert h[0] == pytest.approx(row["h"], rel=RTOL)
        for k, key in enumerate(("velocity", "acceleration", "jerk"), 1):
            assert h[k] * w**k == pytest.approx(row[key], abs=RTOL * max(scale[key], 1e-3)), key
        for offset, point, alpha, rho in (
            (0.0, "profile_central", "pressure_angle_central", "curvature_radius_central"),
            (e, "profile_offset_exact", "pressure_angle_offset", "curvature_radius_offset"),
        ):
            s = Cam(law, Follower(Translating(offset), Knife())).at(theta, side)
            close(s.working, [complex(*row[point])])
            assert s.pressure_angle[0] == pytest.approx(row[alpha], rel=RTOL, abs=1e-13)
            assert s.radius[0] == pytest.approx(row[rho], rel=RTOL)
        assert neglected_phase(law, e, theta)[0] == pytest.approx(row["phase_neglected_by_lecture"], rel=RTOL)
    if isinstance(expected, dict) and "velocity_jump_at_pi" in expected:
        computed = {round(j.angle / PI): w * j.size for j in jumps(law, (1,))}
        assert computed.get(1, 0.0) == pytest.approx(expected["velocity_jump_at_pi"], abs=1e-13)
        assert computed.get(0, 0.0) == pytest.approx(expected["velocity_jump_at_2pi_wrap"], abs=1e-13)


def test_what_the_lecture_s_simplified_offset_profile_costs():
    expected = CASES["cam-lecture-offset-error"]["expected"]
    inputs = dict(CASES["cam-lecture-offset-error"]["inputs"])
    laws = {
        "constacc_C1_0": lecture_law(CASES["cam-lecture-constacc-C1-0"]["inputs"], ""),
        "sine_base_circle": lecture_law(CASES["cam-homework-sine"]["inputs"], "homework"),
        "cycloidal_rise_return": lecture_law(CASES["cam-cycloidal-rise-return"]["inputs"], "cycloidal"),
    }
    for name, law in laws.items():
        rows = expected[name]["rows"]
        got = simplified_offset_error(law, inputs["offset_m"], np.radians(column(rows, "theta_deg")))
        close(got.obtained, column(rows, "h_obtained"), 1e-9)
        fine = simplified_offset_error(law, inputs["offset_m"], np.linspace(0, 2 * PI, 7201))
        assert fine.largest == pytest.approx(expected[name]["max_abs_error"], rel=1e-6)
    swing = np.degrees(np.ptp(neglected_phase(laws["constacc_C1_0"], 0.01, np.linspace(0, PI, 50))))
    assert swing == pytest.approx(expected["phase_variation_deg"], rel=1e-9)


def test_constant_breadth():
    case = CASES["cam-yoke-constant-breadth"]
    base, lift = case["inputs"]["R_b"], case["inputs"]["H"]
    law = program([Segment(PI, base + lift, "harmonic"), Segment(PI, base, "harmonic")], base)
    size = breadth(law)
    assert size.constant(1e-14)
    assert size.mean == pytest.approx(case["expected"]["breadth"][0], rel=1e-14)
    s = Cam(law, Follower(Translating(), Flat())).at(np.linspace(0, 6, 50))
    close(s.radius, np.full(50, base + lift / 2))  # an eccentric circle
    other = program([Segment(PI, base + lift, "cycloidal"), Segment(PI, base, "3-4-5")], base)
    assert not breadth(other).constant(1e-6)
    half = PI - 1.0  # the same segments downwards complete any half a turn
    same = program([Segment(1.0), Segment(half, 0.05, "3-4-5"), Segment(1.0), Segment(half, base, "3-4-5")], base)
    assert breadth(same).constant(1e-14)
    assert not breadth(program([Segment(1.0), Segment(half, 0.05, "3-4-5"), Segment(1.0), Segment(half, base)], base)).constant()
    # the second face touches the cam too: the faces are each other's contact half a turn later
    half = Cam(law, Follower(Translating(), Flat())).at(np.linspace(0, 6, 50) + PI)
    assert (s.motion[0] + half.motion[0]) == pytest.approx(size.mean)


# --- working curves as functions -----------------------------------------------------------------------------------------------

OSCILLATION = program([Segment(2.0, 0.5, "4-5-6-7"), Segment(1.0), Segment(2.0, 0.4, "5-6-7-8-9"), Segment(2 * PI - 5)], 0.4)
CAMS = {
    "roller": Cam(LAW, OFFSET),
    "clockwise": Cam(LAW, OFFSET, turn=-1),
    "far flank": Cam(LAW, OFFSET, outer=True),
    "knife": Cam(LAW, Follower(Translating(0.01), Knife())),
    "mushroom": Cam(LAW, Follower(Translating(0.01), Arc(0.03))),
    "flat": Cam(LAW, Follower(Translating(0.01), Flat())),
    "tilted flat": Cam(LAW, Follower(Translating(0.01), Flat(tilt=0.2))),
    "oscillating": Cam(OSCILLATION, Follower(Oscillating(0.08 + 0.03j, 0.07), Roller(0.009))),
    "oscillating left": Cam(OSCILLATION, Follower(Oscillating(0.08 + 0.03j, 0.07, -1), Roller(0.009)), turn=-1),
    "oscillating flat": Cam(OSCILLATION, Follower(Oscillating(0.08 + 0.03j, 0.07, -1), Flat(tilt=0.1, shift=0.005))),
    "wedge": Cam(program([Segment(0.04, 0.01, "3-4-5"), Segment(0.03, 0.0)]), Follower(Translating(), Roller(0.004)), wedge=True),
    "wedge on an arm": Cam(
        program([Segment(0.04, 0.4, "3-4-5"), Segment(0.03, 0.3)], 0.3),
        Follower(Oscillating(0.06, 0.05), Roller(0.004)),
        wedge=True,
    ),
}


@pytest.mark.parametrize("name", CAMS)
def test_working_curves_are_functions_with_exact_derivatives(name):
    cam = CAMS[name]
    t = np.array([0.11, 0.23, 0.58]) * cam.period
    h = 2e-5 * cam.period
    w = [cam.working_curve(t + j * h, 3) for j in (-2, -1, 0, 1, 2)]
    for k in range(3):
        numeric = (w[0][k] - 8 * w[1][k] + 8 * w[3][k] - w[4][k]) / (12 * h)
        np.testing.assert_allclose(numeric, w[2][k + 1], atol=3e-8 * np.abs(w[2][k + 1]).max())
    s = cam.at(t)
    close(w[2][0], s.working)
    assert np.abs(np.real(np.conj(s.normal) * w[2][1])).max() < 1e-14 * np.abs(w[2][1]).max(), "the normal is one"
    curvature = np.imag(np.conj(w[2][1]) * w[2][2]) / np.abs(w[2][1]) ** 3
    np.testing.assert_allclose(-cam.turn * cam.flank * curvature, 1.0 / s.radius, rtol=1e-9)
    np.testing.assert_allclose(np.abs(s.pitch - s.working), cam.follower.radius, atol=1e-16) if not isinstance(
        cam.follower.face, Flat
    ) else np.testing.assert_allclose(np.real(np.conj(s.normal) * (s.pitch - s.working)), 0.0, atol=1e-16)


@settings(max_examples=examples(40))
@given(st.floats(-0.02, 0.02), st.floats(0.002, 0.02), st.floats(0.03, 0.08), st.sampled_from([1, -1]), st.booleans())
def test_envelope_and_inversion_agree_for_any_cam(e, r, base, turn, swings):
    guide = Oscillating(0.12 + e * 1j, 0.1, turn) if swings else Translating(e)
    lift = program([Segment(2.0, 0.02, "3-4-5"), Segment(1.0), Segment(2.0, 0.0, "modified-sine"), Segment(2 * PI - 5)])
    cam = cam_on_base(lift, Follower(guide, Roller(r)), base, turn)
    theta = np.linspace(0, 2 * PI, 61)
    s, other = cam.at(theta), by_inversion(cam, theta)
    assert np.abs(s.working).min() >= base * (1 - 1e-12), "nothing lies inside the base circle"
    close(s.working, other["working"])
    np.testing.assert_allclose(s.pressure_angle, other["pressure_angle"], atol=1e-12)
    np.testing.assert_allclose(1 / s.pitch_radius, 1 / other["pitch_radius"], atol=1e-12 / base)


def test_a_clockwise_cam_is_the_mirror_image():
    theta = np.linspace(0, 6, 25)
    a = Cam(LAW, OFFSET).at(theta)
    b = Cam(LAW, Follower(Translating(-0.01), Roller(0.008)), turn=-1).at(theta)
    close(b.working, -np.conj(a.working))
    close(b.radius, a.radius)
    close(b.pressure_angle, -a.pressure_angle)


def test_nothing_is_computed_before_it_is_asked_for(monkeypatch):
    s = Cam(LAW, OFFSET).at(np.linspace(0, 6, 25))
    _ = s.pressure_angle
    assert "_d2" not in vars(s)
    assert "_frame" not in vars(s), "the pressure angle needs neither the second derivative nor the cam's axes"


def test_bad_input_is_named():
    for make, message in (
        (lambda: cam_on_base(rise("3-4-5"), Follower(Translating(0.05), Knife()), 0.02), "does not reach the offset"),
        (lambda: cam_on_base(rise("3-4-5"), Follower(Oscillating(0.1, 0.03), Knife()), 0.02), "does not reach a base circle"),
        (lambda: Oscillating(0.0, 1.0), "pivot"),
        (lambda: Roller(0.0), "positive radius"),
        (lambda: Cam(LAW, Follower(Translating(), Flat()), wedge=True), "roller or a knife"),
        (lambda: Cam(LAW, Follower(Translating(), Flat()), outer=True), "groove"),
        (lambda: Cam(LAW, OFFSET, turn=2), "counter-clockwise"),
    ):
        with pytest.raises(MechanismError, match=message):
            make()


def test_the_package_needs_no_mechviz():
    code = "import sys, mechcore.cams, mechcore.laws; sys.exit(any(m.startswith('mechviz') for m in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- closures ---------------------------------------------------------------------------------------------------------------


def test_conjugate_cams_hold_both_rollers():
    theta = np.linspace(0, 6, 25)
    second, mount = conjugate(Cam(LAW, OFFSET), 0.01, span=0.11, offset=0.003)
    place = np.exp(1j * (theta + mount)) * second.at(theta).pitch
    close(place, 0.003 + 1j * (LAW(theta, 0)[0] - 0.11))
    first = cam_on_base(OSCILLATION.raised(-0.4), Follower(Oscillating(0.1 + 0.02j, 0.09), Roller(0.01)), 0.05)
    second, mount = conjugate(first, 0.012, arm=0.085, angle=1.9)
    pivot = first.follower.guide.pivot
    a = np.exp(1j * theta) * first.at(theta).pitch - pivot
    b = np.exp(1j * (theta + mount)) * second.at(theta).pitch - pivot
    np.testing.assert_allclose(np.angle(b / a), 1.9, rtol=1e-12)
    np.testing.assert_allclose(np.abs(b), 0.085, rtol=1e-12)
    assert not find_limits(second).undercut


@pytest.mark.parametrize("turns", [True, False])
def test_inverse_cams_carry_the_slot_on_the_driven_link(turns):
    law = MotionCurve.of((0, 2 * PI), [[0.3]], [[[1.0, 0.2 if turns else 0.02, 0.0]]], repeats=True)
    cam = InverseCam(law, 0.12, 0.04, 0.006, turns)
    theta = np.linspace(0, 6, 25)
    q = law(theta, 0)[0]
    back = np.exp(1j * q) * cam.pitch(theta)[0] if turns else cam.pitch(theta)[0] + 1j * q
    np.testing.assert_allclose(np.abs(back - 0.12), 0.04, rtol=1e-12)
    h = 1e-4
    numeric = [(cam.pitch(theta + h, k)[k] - cam.pitch(theta - h, k)[k]) / (2 * h) for k in (0, 1)]
    np.testing.assert_allclose(numeric, cam.pitch(theta)[1:], atol=1e-8)
    flank = (cam.flank(theta + h) - cam.flank(theta - h)) / (2 * h)
    assert np.abs(np.real(np.conj(cam.normal(theta)) * flank)).max() < 1e-9
    # virtual work without friction: force times cos of the pressure angle does the work of the crank's tangential force
    n = (np.exp(1j * q) if turns else 1.0) * cam.normal(theta)
    pin = cam.pin(theta, 1)
    speed = law(theta, 1)[1] * (np.abs(pin[0]) if turns else 1.0)
    np.testing.assert_allclose(np.abs(np.real(np.conj(n) * pin[1])), np.abs(speed) * np.cos(cam.pressure_angle(theta)), atol=1e-14)
    # curvature of both flanks from their own second differences
    for side in (1, -1):
        w = [cam.flank(theta + j * 1e-3, side) for j in (-1, 0, 1)]
        d1, d2 = (w[2] - w[0]) / 2e-3, (w[2] - 2 * w[1] + w[0]) / 1e-6
        bend = side * np.imag(np.conj(d1) * d2) / np.abs(d1) ** 3
        want = 1.0 / cam.flank_radius(theta, side)
        with_pin = np.real(np.conj(cam.pitch(theta, 1)[1]) * d1) > 0.0  # an undercut flank runs backwards
        blunt = np.abs(want) < 1e3  # differences do not resolve the sharpest places
        np.testing.assert_allclose(np.where(with_pin, bend, -bend)[blunt], want[blunt], rtol=2e-3, atol=1e-2)
        if turns:
            assert with_pin.sum() == 24 if side == 1 else with_pin.all()


# --- forces -------------------------------------------------------------------------------------------------------------------


def test_contact_force_and_drive_torque_of_the_reference():
    i = CONTACT_FORCE["inputs"]
    lift = program([Segment(i["beta"], i["lift"])], repeats=False)
    closure = Closure(i["m"], i["k"], i["preload_deflection"], i["g"], i["P"])
    for row in CONTACT_FORCE["expected"]:
        theta = np.radians(row["theta_deg"])
        s = lift(theta, 2)
        force = closing_force(closure, s[0], s[2], i["omega"])
        cam = Cam(lift.raised(i["h_base"]), Follower(Translating(i["e"]), Knife())).at(theta)
        assert force == pytest.approx(row["axial_force"], rel=RTOL)
        assert cam.pressure_angle[0] == pytest.approx(row["pressure_angle"], rel=1e-11)
        assert force / np.cos(cam.pressure_angle[0]) == pytest.approx(row["contact_force"], rel=RTOL)
        assert force * s[1] == pytest.approx(row["drive_torque_on_cam"], rel=RTOL)
        flat = Cam(lift.raised(i["h_base"]), Follower(Translating(i["e"]), Flat())).at(theta)
        assert force * flat.distance[0] == pytest.approx(row["flat_follower"]["tilting_moment_about_axis"], rel=1e-11)


@pytest.mark.parametrize("row", CASES["cam-jump-off-harmonic"]["expected"], ids=lambda r: str(r["omega_jump"])[:6])
def test_speed_at_which_contact_is_lost(row):
    i = row["inputs"]
    lift = program([Segment(i["beta"], i["H"], "harmonic"), Segment(i["beta"], 0.0, "harmonic")], repeats=False)
    closure = Closure(i["m"], i["k"], i["preload_deflection"], i["g"])
    lost = first_separation(closure, lift)
    assert lost is not None
    assert lost.speed == pytest.approx(row["omega_jump"], rel=1e-12)
    assert lost.angle == pytest.approx(i["beta"], rel=1e-6), "at full lift"
    for x, force in row["contact_force_at_09_omega_jump"].items():
        s = lift(float(x) * i["beta"], 2, "left")
        assert closing_force(closure, s[0], s[2], 0.9 * lost.speed) == pytest.approx(force, rel=1e-11)


def test_contact_is_lost_inside_the_rise_of_a_cycloid():
    case = CASES["cam-jump-off-cycloidal"]
    i = case["inputs"]
    lift = program([Segment(i["beta"], i["H"])], repeats=False)
    closure = Closure(i["m"], i["k"], i["preload_deflection"], i["g"])
    lost = first_separation(closure, lift)
    assert lost.speed == pytest.approx(case["expected"]["omega_jump"], rel=1e-12)
    assert lost.angle / i["beta"] == pytest.approx(case["expected"]["x"], rel=1e-6)
    assert first_separation(closure, program([Segment(1.0, 1.0, "constant-velocity")])) is None


def test_hertz_stress():
    # steel on steel: p = 0.591 sqrt(F E/(l) (1/r1 + 1/r2)) / sqrt(2): the handbook's 0.418 sqrt(F E / (l r))
    r = 1.0 / (1 / 0.02 + 1 / 0.01)
    p = hertz(1000.0, 0.02, 0.01, 0.015).pressure
    assert float(p) == pytest.approx(0.418 * np.sqrt(1000.0 * 2.1e11 / (0.015 * r)), rel=1e-3)
    strip = hertz([1000.0, 500.0, -5.0], [0.02, -0.03, 0.02], 0.01, 0.015)
    np.testing.assert_allclose((0.5 * PI * strip.pressure * strip.half_width * 0.015)[:2], [1000.0, 500.0], rtol=1e-12)
    assert strip.pressure[2] == 0.0
    assert np.isnan(hertz(10.0, -0.008, 0.01, 0.01).pressure)
    assert np.isinf(hertz(10.0, 0.02, 0.0, 0.01).pressure)


# --- equivalent linkage -----------------------------------------------------------------------------------------------------------


def test_equivalent_linkage_of_the_reference():
    case = CASES["cam-pair-replacement"]
    i, rows = case["inputs"], case["expected"]
    theta, w = np.radians(column(rows, "theta_deg")), i["omega"]
    law = segments_program(i)
    link = equivalent_linkage(Cam(law, Follower(Translating(i["e"]), Knife())).at(theta))
    for key, got in {
        "crank_OK": link.crank, "coupler_KT": np.abs(link.coupler), "coupler_omega": w * link.coupler_rate,
        "coupler_eps": w**2 * link.coupler_acceleration, "follower_velocity": w * link.rate,
        "follower_acceleration": w**2 * link.acceleration,
    }.items():  # fmt: skip
        np.testing.assert_allclose(got, column(rows, "point_follower", key), rtol=1e-10, err_msg=key)
    close(link.centre, points(rows, "point_follower", "curvature_centre_ground"), 1e-10)
    flat = equivalent_linkage(Cam(law, Follower(Translating(i["e"]), Flat())).at(theta))
    close(flat.crank, column(rows, "flat_follower", "crank_OK"))
    close(flat.centre, points(rows, "flat_follower", "curvature_centre_ground"))


@pytest.mark.parametrize("name", [n for n in CAMS if n != "far flank"])
def test_equivalent_linkage_has_the_cam_s_velocities_and_accelerations(name):
    cam = CAMS[name]
    s = cam.at(np.linspace(0.013, 0.97, 41) * cam.period)
    link = equivalent_linkage(s)
    close(link.rate, s.motion[1], 1e-11)
    close(link.acceleration, s.motion[2], 1e-9)


def test_equivalent_linkage_of_a_straight_flank_slides():
    straight = Cam(MotionCurve.of((0, 1), [[0.02, 0.3]]), Follower(Translating(), Roller(0.004)), wedge=True)
    link = equivalent_linkage(straight.at([0.2, 0.4]))
    assert np.isinf(link.coupler).all()
    np.testing.assert_allclose([link.rate, link.acceleration], [[0.3, 0.3], [0, 0]], atol=1e-15)


def test_the_three_conditions_of_the_lecture_pass_or_fail_with_where_and_how_much():
    want = Requirement(radius=0.02, pressure_rise=np.radians(10), pressure_fall=np.radians(30))
    verdicts = {v.condition: v for v in check_limits(Cam(LAW, OFFSET), want)}
    extremes = CASES["cam-rdrd-extremes"]["expected"]
    row = next(r for r in extremes["pressure"] if r["e"] == 0.01)
    v = verdicts["pressure angle on the rise"]
    assert not v.passed and not verdicts["pressure angle on the return"].passed and verdicts["no undercut"].passed
    assert v.reached == pytest.approx(row["rise_max_pressure_angle"], rel=1e-12)
    assert v.angle == pytest.approx(row["rise_theta"], abs=1e-5)
    assert v.margin == pytest.approx(np.radians(10) - row["rise_max_pressure_angle"], rel=1e-10)
    r = verdicts["least radius of curvature"]
    assert r.passed and r.reached == pytest.approx(extremes["min_convex_pitch_radius"]["ret"]["value"] - 0.008, rel=1e-11)
    flat = {v.condition: v for v in check_limits(Cam(LAW, Follower(Translating(), Flat())), Requirement(distance=0.02))}
    assert flat["pressure distance"].margin == pytest.approx(0.02 + extremes["flat_contact_offset_min"]["value"], rel=1e-12)
