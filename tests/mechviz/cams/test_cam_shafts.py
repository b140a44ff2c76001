"""Links of barrel, end and globoid cams turn about a shaft in the plane, not in it."""

from __future__ import annotations

import numpy as np
import pytest
from cam_scenes import changed, solved, text_of

from mechcore.constructions.centres import kennedy
from mechcore.constructions.studies import compute
from mechcore.motion.metrics import instant_centres, metric_items

SWINGS = changed(
    text_of("cam-barrel").replace(', "friction"', ', "gravity"'),
    'speed = "200 rpm", start = 0',
    'oscillation = { amplitude = 40, period = "0.2 s", centre = 60 }',
)


def test_a_mass_about_a_shaft_in_the_plane_shakes_only_by_what_the_follower_weighs():
    """The carriage slides along y over O: a moment about [50, 0] mm of -0.05 m times its force, none of the cam's J alpha."""
    motion, forces = solved(SWINGS + "\n[shaking]\nabout = [50, 0]\n", 90)
    shaken = compute(motion, forces).shaking
    fall = -0.9 * motion.coordinate("S")[:, 2]
    np.testing.assert_allclose(shaken.force, np.column_stack([0.0 * fall, fall]), atol=1e-9 * np.abs(fall).max())
    np.testing.assert_allclose(shaken.moment, -0.05 * fall, atol=1e-9 * np.abs(fall).max())


def test_its_own_drive_still_turns_its_moment_of_inertia():
    """J alpha of the oscillation, and what the carriage asks for by its weight and inertia; gravity does no work on the cam."""
    motion, forces = solved(SWINGS, 90)
    speed, alpha = motion.coordinate("O")[:, 1:].T
    turn = 2.0 * np.pi / 0.2
    np.testing.assert_allclose(alpha, -np.radians(40) * turn**2 * np.sin(turn * motion.time), atol=1e-9 * turn**2)
    lifted = 0.9 * (motion.coordinate("S")[:, 2] + 9.81) * motion.coordinate("S")[:, 1]
    np.testing.assert_allclose(forces.effort("O") * speed, 0.003 * alpha * speed + lifted, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "pair", "place"), [("cam-barrel", "carriage", (np.inf, np.inf)), ("cam-globoid", "arm", (0.11, 0))]
)
def test_instant_centres_are_those_of_links_in_the_plane(name, pair, place):
    motion, _ = solved(text_of(name), 12)
    assert metric_items("instant_centre", motion.model) == [("frame", pair)]
    (centres,) = instant_centres(motion).values()
    turns = np.isfinite(centres).all(axis=1)
    assert turns.any() == np.isfinite(place).all()
    np.testing.assert_allclose(centres[turns], np.broadcast_to(place, centres[turns].shape), atol=1e-12)
    assert [centre.links for centre in kennedy(motion).values()] == [("frame", pair)]
