"""Rates by the equations of all joints at once, against those by groups and against differences of positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mechcore.accuracy import DEFAULT
from mechcore.motion import at_once
from mechcore.motion.at_once import agreement, rates_at_once
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from recordings import gallery_scene

SCENES = (
    "watt-six-bar", "stephenson-six-bar", "shaper-quick-return", "scotch-yoke", "planetary-gear", "cam-roller", "cam-indexing",
    "cam-wedge-oscillating", "excavator-arm", "parallelogram-six-bar", "wave-machine", "rolling-wheel",
)  # fmt: skip


def motion_of(name, accuracy=DEFAULT, frames=24):
    mechanism = gallery_scene(name).mechanism
    return solve_motion(compile_mechanism(mechanism, accuracy), default_times(mechanism, frames, 1))


@pytest.mark.parametrize("dense", [at_once.DENSE_UNKNOWNS, 0], ids=["full", "sparse"])
@pytest.mark.parametrize("name", SCENES)
def test_all_equations_at_once_give_the_rates_of_the_groups(name, dense, monkeypatch):
    """By sparse matrices, too, as of mechanisms with more links: also where there are more equations than rates."""
    monkeypatch.setattr(at_once, "DENSE_UNKNOWNS", dense)
    check = agreement(motion_of(name))
    assert check.frames >= 20
    assert check.velocity < 1e-11
    assert check.acceleration < 1e-9


@pytest.mark.parametrize("name", ["shaper-quick-return", "cam-wedge-oscillating", "planetary-gear"])
def test_rates_at_once_are_differences_of_positions(name):
    """Positions alone, at neighbouring instants: nothing of how rates are found is in them."""
    motion = motion_of(name)
    h = 1e-4 * float(motion.time[-1] - motion.time[0])
    times = np.add.outer(motion.time[5:9], h * np.array([-2, -1, 0, 1, 2])).ravel()
    near = motion.at_times(times)
    poses = np.stack([near.pose(link) for link in motion.model.links[1:]], axis=1).reshape(4, 5, -1, 3)
    velocity = np.tensordot(poses, np.array([1, -8, 0, 8, -1]) / (12 * h), axes=(1, 0))
    acceleration = np.tensordot(poses, np.array([-1, 16, -30, 16, -1]) / (12 * h * h), axes=(1, 0))
    first, second, _ = rates_at_once(motion, slice(5, 9))
    np.testing.assert_allclose(first, velocity, atol=1e-7 * np.abs(velocity).max())
    np.testing.assert_allclose(second, acceleration, atol=1e-5 * np.abs(acceleration).max())


def test_rates_that_are_off_are_seen():
    check = agreement(motion_of("watt-six-bar", replace(DEFAULT, differentiation="differences"), 72))
    assert check.velocity > 1e-5
    assert check.acceleration > 1e-5
