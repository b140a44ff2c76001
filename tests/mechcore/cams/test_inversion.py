"""The synthesis of cams by inversion: what is laid off is the solved motion, and the profile touches every follower."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import mechviz
from mechcore.constructions.inversion import cam_inversions
from mechcore.errors import MechanismError
from mechcore.motion.solve import compile_mechanism, solve_motion


def cam_inversion(motion, joint):
    return cam_inversions(motion, joint)[joint]


PLANE = np.array([1.0, 1.0j])


@cache
def motion_of(name, frames=30):
    """One turn of the cam in even steps, the end left out."""
    scene = mechviz.load(name)
    return solve_motion(compile_mechanism(scene.mechanism), scene.mechanism.cycle * np.arange(frames) / frames)


@pytest.mark.parametrize(("name", "point"), [("cam-by-inversion", "T"), ("cam-knife", "T"), ("cam-friction", "T")])
def test_every_step_is_where_the_follower_is_when_the_cam_has_turned_so_far(name, point):
    motion = motion_of(name)
    inversion = cam_inversion(motion, "K")
    pose = motion.pose("cam")
    place = (pose[:, 0] + 1j * pose[:, 1]) + np.exp(1j * pose[:, 2]) * inversion.references
    assert place == pytest.approx(motion.point("follower", point) @ PLANE, abs=1e-12)


def test_lifts_are_laid_off_on_lines_that_touch_the_offset_circle():
    motion = motion_of("cam-by-inversion")
    inversion = cam_inversion(motion, "K")
    assert np.abs(inversion.origins - inversion.centre) == pytest.approx(np.full(30, 0.014))
    assert [np.abs(z - inversion.centre).max() for z in inversion.bases] == pytest.approx([0.038, 0.014])
    across = np.real(np.conj(inversion.origins - inversion.centre) * (inversion.references - inversion.origins))
    assert across == pytest.approx(np.zeros(30), abs=1e-15)
    assert np.abs(inversion.starts - inversion.centre) == pytest.approx(np.full(30, 0.048))  # base 38 and roller 10
    lift = motion.coordinate("S")[:, 0]
    assert inversion.lifts == pytest.approx(lift - lift[0], abs=1e-12) and inversion.lifts.max() == pytest.approx(0.026)
    turned = np.unwrap(np.angle((inversion.starts - inversion.centre) / (inversion.starts[0] - inversion.centre)))
    assert turned == pytest.approx(-2.0 * np.pi * np.arange(30) / 30)  # back, against the cam


@pytest.mark.parametrize(
    "name", ["cam-by-inversion", "cam-flat-offset", "cam-mushroom", "cam-oscillating-flat", "cam-oscillating-roller", "cam-groove"]
)
def test_the_profile_is_the_envelope_of_the_follower(name):
    inversion = cam_inversion(motion_of(name), "K")
    assert np.abs(inversion.gap).max() < 1e-7
    assert np.abs(inversion.profile - inversion.centre).min() == pytest.approx(inversion.base, rel=1e-6)


@pytest.mark.parametrize(("name", "joint"), [("cam-wedge", "S"), ("cam-wedge-oscillating", "P")])
def test_along_a_wedge_the_frame_is_pushed_back(name, joint):
    """The positions lie on the way of the roller seen from the slide, and the wedge touches all of them."""
    motion = motion_of(name, 3000)
    inversion = cam_inversion(motion, "K")
    pose = motion.pose("slide")
    follower = "follower" if joint == "S" else "lever"
    point = next(p for p in motion.mechanism.joints if p.name == "K").point
    way = (motion.point(follower, point) @ PLANE - (pose[:, 0] + 1j * pose[:, 1])) * np.exp(-1j * pose[:, 2])
    assert max(np.abs(way - z).min() for z in inversion.references) < 2e-4
    assert len(inversion.angles) == 31 and np.abs(inversion.gap).max() < 1e-6
    assert np.ptp(np.imag(inversion.bases[0])) == pytest.approx(0.0, abs=1e-12) and inversion.lifts.max() > 0.01


@pytest.mark.parametrize("name", ["cam-conjugate", "cam-conjugate-oscillating"])
def test_both_cams_of_a_conjugate_pair_are_drawn(name):
    """A conjugate pair has one follower: at every step the places of its rollers, in the axes of the shaft, lie as far apart."""
    first, second = cam_inversions(motion_of(name), "K").values()
    assert max(np.abs(first.gap).max(), np.abs(second.gap).max()) < 1e-6
    assert np.abs(first.references - second.references) == pytest.approx(
        np.full(30, abs(first.references[0] - second.references[0]))
    )


def test_an_undercut_profile_goes_into_the_follower():
    assert cam_inversion(motion_of("cam-undercut"), "K").gap.min() < -1e-3


@pytest.mark.parametrize(
    ("name", "words"),
    [("cam-barrel", "no cam with a profile in the plane"), ("cam-inverse", "no cam with a profile"), ("cam-eccentric", "is given")],
)
def test_what_has_no_such_construction_is_refused(name, words):
    with pytest.raises(MechanismError, match=words):
        cam_inversion(motion_of(name), "K")
