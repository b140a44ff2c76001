"""The synthesis of cams by inversion: what is laid off is the solved motion, and the profile touches every follower."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import mechviz
from mechcore.constructions.inversion import cam_inversion
from mechcore.errors import MechanismError
from mechcore.motion.solve import compile_mechanism, solve_motion

PLANE = np.array([1.0, 1.0j])


@cache
def motion_of(name, frames=30):
    """One turn of the cam in even steps, the end left out."""
    scene = mechviz.load(name)
    return solve_motion(compile_mechanism(scene.mechanism), scene.mechanism.cycle * np.arange(frames) / frames)


@pytest.mark.parametrize(("name", "point"), [("cam-by-inversion", "T"), ("cam-knife", "T"), ("cam-friction", "T")])
def test_every_step_is_where_the_follower_is_when_the_cam_has_turned_so_far(name, point):
    motion = motion_of(name)
    found = cam_inversion(motion, "K")
    pose = motion.pose("cam")
    place = (pose[:, 0] + 1j * pose[:, 1]) + np.exp(1j * pose[:, 2]) * found.references
    assert place == pytest.approx(motion.point("follower", point) @ PLANE, abs=1e-12)


def test_lifts_are_laid_off_on_lines_that_touch_the_offset_circle():
    motion = motion_of("cam-by-inversion")
    found = cam_inversion(motion, "K")
    assert np.abs(found.origins - found.centre) == pytest.approx(np.full(30, 0.014)) and found.carrier == pytest.approx(0.014)
    across = np.real(np.conj(found.origins - found.centre) * (found.references - found.origins))
    assert across == pytest.approx(np.zeros(30), abs=1e-15)
    assert np.abs(found.starts - found.centre) == pytest.approx(np.full(30, 0.048))  # base 38 and roller 10
    lift = motion.coordinate("S")[:, 0]
    assert found.lifts == pytest.approx(lift - lift[0], abs=1e-12) and found.lifts.max() == pytest.approx(0.026)
    turned = np.unwrap(np.angle((found.starts - found.centre) / (found.starts[0] - found.centre)))
    assert turned == pytest.approx(-2.0 * np.pi * np.arange(30) / 30)  # back, against the cam


@pytest.mark.parametrize(
    "name", ["cam-by-inversion", "cam-flat-offset", "cam-mushroom", "cam-oscillating-flat", "cam-oscillating-roller", "cam-groove"]
)
def test_the_profile_is_the_envelope_of_the_follower(name):
    found = cam_inversion(motion_of(name), "K")
    assert np.abs(found.gap).max() < 1e-7
    assert np.abs(found.profile - found.centre).min() == pytest.approx(found.base, rel=1e-6)


def test_an_undercut_profile_goes_into_the_follower():
    assert cam_inversion(motion_of("cam-undercut"), "K").gap.min() < -1e-3


@pytest.mark.parametrize(
    ("name", "words"), [("cam-barrel", "no disc cam"), ("cam-wedge", "no disc cam"), ("cam-eccentric", "is given")]
)
def test_what_has_no_such_construction_is_refused(name, words):
    with pytest.raises(MechanismError, match=words):
        cam_inversion(motion_of(name), "K")
