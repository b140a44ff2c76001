"""Friction at the contact of cams and in the guides of their followers: closed forms, balances, jamming, scenes."""

from __future__ import annotations

import numpy as np
import pytest
from cam_scenes import refused, solved, text_of

from mechcore.forces.cam_events import cam_events
from mechcore.forces.cam_rating import contact_force, placed_cams


def rubbing(name: str, table: str) -> str:
    text = text_of(name).replace('"gravity"]', '"gravity", "friction"]')
    return text.replace("[joints.K.profile]", f"friction = {table}\n\n[joints.K.profile]")


def test_a_flat_face_rubs_along_the_cam():
    """Loss = mu N omega h: the face is h away from the axis, so the cam slides under it with omega h; torque N (h' + mu h)."""
    motion, forces = solved(rubbing("cam-flat", "{ coefficient = 0.1 }").replace("centre = [0, 5]", "centre = [0, 0]"))
    (cam,) = placed_cams(motion)
    speed, h = motion.coordinate("O")[:, 1], cam.rows(motion).coordinate
    n = contact_force(forces, cam)
    np.testing.assert_allclose(forces.friction.losses("K"), 0.1 * n * speed * h, rtol=1e-12)
    np.testing.assert_allclose(np.abs(forces.reaction("K")[:, 0]), 0.1 * n, rtol=1e-12)
    np.testing.assert_allclose(forces.effort("O"), n * (cam.law(cam.argument(motion))[1] + 0.1 * h), rtol=1e-9, atol=1e-9)
    assert np.abs(forces.power_balance).max() < 1e-12
    smooth = solved(text_of("cam-flat"))[1]
    np.testing.assert_allclose(contact_force(smooth, cam), n, rtol=1e-12)  # the guide takes the friction of a flat face


def test_a_roller_rubs_on_its_pin():
    """mu r/R N along the tangent: the same as a sliding shoe with the coefficient mu r/R."""
    pin = solved(rubbing("cam-roller", "{ coefficient = 0.1, radius = 4 }"))[1]
    shoe = solved(rubbing("cam-roller", "{ coefficient = 0.04 }").replace("roller = 10", "mushroom = 10"))[1]
    np.testing.assert_allclose(pin.effort("O"), shoe.effort("O"), rtol=1e-9, atol=1e-12)
    assert pin.friction.losses("K").min() > 0.0 and np.abs(pin.power_balance).max() < 1e-12


@pytest.mark.parametrize("mu", [0.3, 0.45])
def test_a_steep_follower_jams_in_its_guide(mu):
    """The theory's tan(alpha) = b / (mu (2 a + b)) on the rise, overhang a from the contact to the nearer end of the guide."""
    text = (
        text_of("cam-friction")
        .replace("friction = { coefficient = 0.1 }\n", "")
        .replace("base = 40", "base = 20")
        .replace("to = 22", "to = 40")
    )
    text = text.replace('["inertia", "gravity", "friction"]', '["friction"]').replace("coefficient = 0.12", f"coefficient = {mu}")
    motion, forces = solved(text)
    (cam,) = placed_cams(motion)
    rows = cam.rows(motion)
    rate = cam.law(cam.argument(motion))[1]
    rising = rate > 1e-6
    limit = np.arctan2(0.040, mu * (2.0 * (0.105 - 0.020 - rows.coordinate) + 0.040))  # tan a = b / (mu (2 a + b))
    clear = np.abs(rows.pressure_angle - limit) > 1e-6
    jams = (rows.pressure_angle > limit) & rising
    assert jams.any() and (~jams & rising).any()
    np.testing.assert_array_equal(forces.friction.jammed[rising & clear], jams[rising & clear])
    assert "S" in forces.friction.jammed_by(int(np.flatnonzero(jams)[0]))


def test_what_is_lacking_keeps_the_contact():
    """The force that the event names, added along the follower's way, just keeps the contact."""
    motion, forces = solved(text_of("valve-train"))
    lost = [e for e in cam_events(motion, forces) if "contact lost" in e.text]
    lacking = max(float(e.text.split("Press harder by ")[1].split(" N")[0]) for e in lost)
    assert "at 3600 rpm" in lost[0].text
    for share, least in ((1.001, 1), (0.999, 0)):
        load = f'push = {{ force = [0, "{share * lacking:.6f} N"], on = "valve", at = "T" }}\n'
        motion, forces = solved(text_of("valve-train").replace("[loads]\n", f"[loads]\n{load}"), frames=7200)
        n = contact_force(forces, placed_cams(motion)[0])
        assert (n.min() > 0.0) == bool(least)


@pytest.mark.parametrize(
    ("name", "table", "words"),
    [
        ("cam-roller", "{ coefficient = 0.1 }", ["joints.K.friction", "'radius' is missing", "rubs on its pin"]),
        ("cam-flat", "{ coefficient = 0.1, radius = 4 }", ["no roller"]),
        ("cam-flat", "{ lever = 4 }", ["lever does not go with the friction of a cam"]),
        ("cam-flat", "{ }", ["'coefficient' is missing"]),
    ],
)
def test_faults_of_friction_at_cams(name, table, words):
    refused(rubbing(name, table), words)


def test_contact_that_is_lost_next_to_a_jam_has_a_time_and_a_remedy():
    """The base circle is a point, where the pressure angle is unknown, and the follower jams before it comes back to it."""
    text = text_of("cam-friction").replace("base = 40", "base = 1e-12").replace("O = [0, 0] }, mass", "O = [0, 1e6] }, mass")
    motion, forces = solved(text, frames=8)
    events = [e for e in cam_events(motion, forces) if "contact" in e.text]
    assert len(events) == 3 and np.isfinite([e.time for e in events]).all()
    assert all("nan" not in e.text for e in events)
