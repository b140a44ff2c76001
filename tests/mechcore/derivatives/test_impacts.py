"""Derivatives of motions in which several contacts are struck at once: together, or apart, where a parameter moves one alone."""

from __future__ import annotations

import numpy as np
import pytest
from cases import side_by_side
from test_forced import SIXTH, differences

from mechcore.errors import MechanismError
from mechviz.runs import run_scene
from mechviz.scene.scene import Scene, loads
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sensitivity import sensitivities, sensitivity
from mechviz.studies.designs.variables import variables_of

FRAMES = 37
BODIES = """
units = { length = "m", angle = "deg" }
effects = ["inertia", "gravity"]
run = { duration = "1.3 s", frames = 37, tolerance = 1e-13 }
[parameters]
floor = "0 m"
other_floor = "0 m"
height = "1 m"
other_height = "1 m"
bounce = 0.6
other_bounce = 0.7
[links]
frame = { points = { G = [0, 0], H = [3, 0] } }
left = { points = { G = [0, 0] }, mass = 2.0, centre = "G", inertia = 1.0 }
right = { points = { H = [0, 0] }, mass = 2.5, centre = "H", inertia = 1.0 }
[joints.G]
prismatic = ["frame", "left"]
along = [0, 1]
free = { position = "height" }
stops = [{ at = "floor", side = "lower", restitution = "bounce", name = "one" }]
[joints.H]
prismatic = ["frame", "right"]
along = [0, 1]
free = { position = "other_height" }
stops = [{ at = "other_floor", side = "lower", restitution = "other_bounce", name = "other" }]
"""
BEAM = """
[links.beam]
points = { G = [0, 0], H = [3, 0] }
mass = 2.0
centre = [1.2, 0]
inertia = 1.5
[joints.P]
revolute = ["left", "beam"]
at = ["G", "G"]
[joints.Q]
pin_slot = ["beam", "right"]
at = ["H", "H"]
along = [1, 0]
branch = "ahead"
"""
COUPLED = """
[loads]
damper = { damper = ["left.G", "right.H"], linear = 3.0 }
spring = { spring = ["left.G", "right.H"], stiffness = 9.0, free_length = 2.5 }
"""
KEYS = ["joint.G.displacement", "joint.H.displacement", "energy[dissipated]"]


def one_floor(text: str) -> Scene:
    return loads(text.replace('"other_floor"', '"floor"').replace('"other_height"', '"height"'), "bodies")


def struck_at_once(scene: Scene) -> None:
    first, second = run_scene(scene).simulation.events[:2]
    assert first.time == second.time and {first.item, second.item} == {"one", "other"}


def compared(scene: Scene, number: str, step: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Derivatives by a number, and differences of sixth order."""
    run = run_scene(scene)
    results = sensitivities(run, [parse_measure(scene, key) for key in KEYS], variables_of(scene, [number]))
    found = differences(scene, number, results, step, SIXTH, FRAMES)
    return [(one.slopes[0], wanted) for one, wanted in zip(results, found, strict=True)]


def test_of_two_bodies_that_land_at_once_one_may_have_fallen_farther():
    """Whatever moves one of them leaves the other as it is; each bounces as its closed form says."""
    scene = loads(BODIES, "bodies")
    struck_at_once(scene)
    run, g = run_scene(scene), 9.81
    computed = sensitivities(
        run, [parse_measure(scene, key) for key in KEYS[:2]], variables_of(scene, ["height", "floor", "bounce"])
    )

    def of_first(height, floor, bounce):
        t = run.motion.time
        landed = np.sqrt(2.0 * (height - floor) / g)
        fast = bounce * g * landed
        again = landed + 2.0 * fast / g
        once = np.where(t > landed.real, floor + fast * (t - landed) - 0.5 * g * (t - landed) ** 2, height - 0.5 * g * t**2)
        return np.where(t > again.real, floor + bounce * fast * (t - again) - 0.5 * g * (t - again) ** 2, once)

    nominal = [1.0 + 0j, 0.0 + 0j, 0.6 + 0j]
    np.testing.assert_allclose(computed[0].curve, of_first(*nominal).real, atol=1e-12)
    for k in range(3):
        turned = list(nominal)
        turned[k] += 1e-30j  # exact to rounding: between the impacts the closed form is analytic
        np.testing.assert_allclose(computed[0].slopes[k], of_first(*turned).imag / 1e-30, atol=1e-9)
        np.testing.assert_allclose(computed[1].slopes[k], 0.0, atol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("number", ["height", "other_height", "floor", "other_floor"])
def test_bodies_that_springs_and_dampers_couple_may_land_apart(number):
    """What comes second then moves on a little longer under forces of the first one's new speed: to second order that is another
    motion on either side, which differences feel in the first power of their step."""
    scene = loads(BODIES + COUPLED, "bodies")
    struck_at_once(scene)
    for (exact, coarse), (_, fine) in zip(compared(scene, number, 1e-4), compared(scene, number, 5e-5), strict=True):
        assert np.abs(fine).max() > 0.01
        np.testing.assert_allclose(exact, 2.0 * fine - coarse, atol=1e-8 * np.abs(fine).max())


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("number", "bounce"),  # coefficients that differ may add energy: then the smallest holds for both
    side_by_side(["height", "floor", "links.beam.centre[0]", "bounce", "other_bounce"], [0.7, 0.4]),
)
def test_a_beam_that_falls_flat_strikes_both_stops_together(number, bounce):
    scene = one_floor((BODIES + BEAM).replace("1.3 s", "0.8 s").replace("other_bounce = 0.7", f"other_bounce = {bounce}"))
    struck_at_once(scene)
    for exact, wanted in compared(scene, number, 1e-4):
        np.testing.assert_allclose(exact, wanted, atol=1e-9 * max(np.abs(wanted).max(), 1e-2))


def test_a_beam_that_does_not_rebound_lies_on_both_stops():
    scene = one_floor((BODIES + BEAM).replace("bounce = 0.6", "bounce = 0").replace("bounce = 0.7", "bounce = 0"))
    struck_at_once(scene)
    pairs = compared(scene, "height", 1e-4)
    assert np.abs(pairs[2][1]).max() > 10.0
    for exact, wanted in pairs:
        np.testing.assert_allclose(exact, wanted, atol=1e-9 * np.abs(wanted).max())


def test_stops_under_a_beam_that_move_apart_are_refused():
    """With one foot first, it lands on the other one in another way than with that one first."""
    scene = loads((BODIES + BEAM).replace('"other_height"', '"height"'), "beam")
    with pytest.raises(MechanismError, match="struck at once, which floor takes apart"):
        sensitivity(run_scene(scene), "joint.G.displacement", ["floor"])
