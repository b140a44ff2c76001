"""Hard cases of cams as pairs of scenes: thresholds met exactly, limits of zero, corners, hollows."""

from __future__ import annotations

import numpy as np
import pytest
from cam_scenes import solved, text_of

from mechcore.cams.followers import Flat, Follower, Roller, Translating
from mechcore.cams.limits import Requirement, find_limits
from mechcore.cams.sizing import least_base
from mechcore.cams.synthesis import cam_on_base
from mechcore.errors import MechanismError
from mechcore.forces.cam_events import cam_events
from mechcore.forces.cam_rating import contact_force, placed_cams
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.program import Segment, program

TURN = np.radians


def with_profile(name: str, profile: str) -> str:
    head, _, tail = text_of(name).partition("[joints.K.profile]\n")
    return f"{head}[joints.K.profile]\n{profile}\n\n{tail[tail.index('[loads]') :]}"


LIFT = "lift = [{ over = 120, to = 20, law = 'harmonic' }, { over = 120, to = 0, law = 'harmonic' }, { over = 120 }]"


def test_the_undercut_threshold_of_a_flat_face_is_hit_exactly():
    """Theory: base radius H (pi^2 / (2 beta^2) - 1) for a harmonic rise; there a cusp, below it undercut, at it none."""
    least = 0.020 * (np.pi**2 / (2.0 * TURN(120) ** 2) - 1.0)
    lift = program([Segment(TURN(120), 0.02, "harmonic"), Segment(TURN(120), 0.0, "harmonic"), Segment(TURN(120))])
    assert least_base(lift, Follower(Translating(), Flat()), Requirement()).base == pytest.approx(least, rel=1e-9)
    motion, _ = solved(with_profile("cam-flat", f"base = {1e3 * least * (1.0 + 1e-12):.15g}\n{LIFT}"))
    rows = placed_cams(motion)[0].rows(motion)
    assert rows.radius.min() == pytest.approx(0.0, abs=1e-5), "the profile has a cusp there"
    with pytest.raises(MechanismError, match="undercut"):
        solved(with_profile("cam-flat", f"base = {1e3 * least * (1.0 - 1e-6):.15g}\n{LIFT}"))


def test_a_roller_of_the_least_radius_of_curvature():
    """As large as the pitch curve is sharp: a cusp, which is not yet undercut; a little larger is refused with that radius."""
    lift = program([Segment(TURN(70), 0.03), Segment(TURN(20)), Segment(TURN(70), 0.0), Segment(TURN(200))])
    pitch = 0.050  # base circle and roller together: the pitch curve stays the same
    most = find_limits(cam_on_base(lift, Follower(Translating(), Roller(0.001)), pitch - 0.001)).greatest_roller.value
    assert 0.005 < most < 0.045

    def text(radius: float) -> str:
        profile = (
            f"base = {1e3 * (pitch - radius):.15g}\n"
            "lift = [{ over = 70, to = 30 }, { over = 20 }, { over = 70, to = 0 }, { over = 200 }]"
        )
        made = with_profile("cam-roller", profile).replace("[0, 95]", "[0, 175]")
        return made.replace("roller = 10", f"roller = {1e3 * radius:.15g}")

    motion, _ = solved(text(most * (1.0 - 1e-10)))
    assert find_limits(placed_cams(motion)[0].cam).sharpness.value == pytest.approx(0.0, abs=1e-8), "a cusp"
    with pytest.raises(MechanismError, match="undercut"):
        solved(text(most * (1.0 + 1e-6)))


def test_zero_offset_is_the_limit_of_small_ones():
    """Central is no special case: pressure angles and forces come continuously out of offsets of either sign."""
    text = text_of("cam-roller-offset")
    central = solved(text.replace("[14,", "[0,"))
    for offset in (1e-6, -1e-6):
        near = solved(text.replace("[14,", f"[{offset},"))
        r0, r1 = (placed_cams(motion)[0].rows(motion) for motion, _ in (central, near))
        np.testing.assert_allclose(r1.pressure_angle, r0.pressure_angle, atol=5e-8)
        torque = central[1].effort("O")
        np.testing.assert_allclose(near[1].effort("O"), torque, atol=1e-5 * np.abs(torque).max())


def test_on_a_dwell_the_profile_is_a_circle_about_the_axis():
    motion, forces = solved(text_of("cam-roller"))
    (cam,) = placed_cams(motion)
    rows, s = cam.rows(motion), cam.law(cam.argument(motion))
    still = (s[1] == 0.0) & (s[2] == 0.0)
    assert still.sum() > 60
    np.testing.assert_allclose(rows.radius[still], rows.coordinate[still] - 0.010, rtol=1e-12)
    np.testing.assert_allclose(rows.pressure_angle[still], 0.0, atol=1e-15)
    gravity = forces.effort("O")[still] + 1.1 * 9.81 * 0.004 * np.sin(motion.pose("cam")[still, 2])
    np.testing.assert_allclose(gravity, 0.0, atol=1e-12)  # nothing but the cam's own weight asks for a torque


def test_a_flat_face_rests_on_the_rims_of_a_hollow():
    """It never touches the bottom of a concave flank: the contact leaps from rim to rim, and the lift is that of the hull."""
    profile = "outline = [[40, 0], [0, 40], [-30, 0], [0, -40]]\nbulges = [-0.3, 0.35, 0.35, 0.35]"
    motion, forces = solved(with_profile("cam-flat", profile).replace("face = [30, 30]", "face = [60, 60]"))
    (cam,) = placed_cams(motion)
    leaps = [e for e in cam_events(motion, forces) if "leaps" in e.text]
    assert "56.57 mm over a hollow" in leaps[0].text and "a knock" in leaps[0].text  # from corner to corner, 40 mm times sqrt(2)
    z = cam.contour(np.linspace(0.0, cam.contour.count, 40001))[0]
    angle = motion.pose("cam")[:, 2]
    hull = np.array([(z * np.exp(1j * a)).imag.max() for a in angle[::20]])
    np.testing.assert_allclose(cam.rows(motion).coordinate[::20], hull, atol=1e-9)
    concave = cam.rows(motion).radius < -1e-6
    assert not concave.any(), "a flat face touches convex places and corners only"


def test_a_base_circle_of_almost_nothing():
    """A knife edge reproduces any law on any base: 1 um, where the pitch curve all but runs into the axis and turns sharply."""
    motion, forces = solved(with_profile("cam-knife", f"base = 0.001\n{LIFT}"))
    (cam,) = placed_cams(motion)
    rows = cam.rows(motion)
    np.testing.assert_allclose(rows.coordinate - rows.lift, 1e-6, rtol=1e-9)
    assert np.isfinite(rows.pressure_angle).all() and np.isfinite(forces.effort("O")).all()
    np.testing.assert_allclose(np.abs(rows.place), rows.coordinate, rtol=1e-12)
    assert np.abs(forces.power_balance).max() < 1e-9


def test_infinite_jerk_is_an_event_and_the_force_steps_there():
    motion, forces = solved(text_of("cam-knife"))
    (cam,) = placed_cams(motion)
    jerks = [e for e in cam_events(motion, forces) if "infinite jerk" in e.text]
    assert jerks and all(e.level == "INFO" for e in jerks)
    again = motion.at_times
    for e in jerks[1:3]:
        n = contact_force(solve_forces(again(np.array([e.time - 1e-9, e.time + 1e-9]))), cam)
        assert abs(n[1] - n[0]) > 1.0
