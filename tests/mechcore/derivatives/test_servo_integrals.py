"""Derivatives of motions with servos that have an integral part, a state that changes with the parameters, too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from test_forced import FRAMES, SIXTH, differences

from mechviz.runs import run_scene
from mechviz.scene.scene import Scene, load, loads
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sensitivity import sensitivities, sensitivity
from mechviz.studies.designs.variables import variables_of

CART = """
units = { length = "m", angle = "deg" }
effects = ["inertia"]
run = { duration = "2 s", frames = 40, tolerance = 1e-13 }
[links]
frame = { points = { O = [0, 0] } }
cart = { points = { O = [0, 0] }, mass = 2.0, centre = [0, 0], inertia = 1.0 }
[joints.O]
prismatic = ["frame", "cart"]
along = [1, 0]
free = { position = 0.3, speed = 0.5 }
[loads]
oil = { viscous = "O", linear = 4.0 }
[loads.pid]
servo = "O"
target = 0.2
proportional = "90 N/m"
derivative = "12 N s/m"
integral = "80 N/(m s)"
"""
ROCKER = """
[loads.pid]
servo = "A"
target = 90
proportional = "4 N m/rad"
derivative = "0.2 N m s/rad"
integral = "3 N m/(rad s)"
"""


GAINS = ("proportional", "derivative", "integral")
UNITS = ("N/m", "N s/m", "N/(m s)")


def cart(**changed: object) -> Scene:
    """The cart with other values, by names of its keys."""
    text = CART
    for key, value in changed.items():
        before, _, rest = text.partition(f"{key} = ")
        text = f"{before}{key} = {value}\n{rest.partition(chr(10))[2]}"
    return loads(text, "cart")


@pytest.mark.parametrize("gains", [(90.0, 12.0, 80.0), (90.0, 0.0, 0.0), (0.0, 12.0, 0.0)])
def test_a_cart_on_its_way_to_a_target_follows_the_exponential_of_its_equations(gains):
    """Also with gains of zero, which only grow; the integral of an error that nothing is made of moves nothing."""
    run = run_scene(cart(**{key: f'"{gain} {unit}"' for key, gain, unit in zip(GAINS, gains, UNITS, strict=True)}))
    loaded = [f"loads.pid.{key}" for key in ("proportional", "derivative", "integral", "target")]
    places = ["links.cart.mass", *loaded, "loads.oil.linear", "joints.O.free.position", "joints.O.free.speed"]
    computed = sensitivity(run, "joint.O.displacement", places)

    behind = sensitivity(run, "servo.pid.error", places).slopes
    np.testing.assert_allclose(behind, np.eye(8)[4][:, None] - computed.slopes, atol=1e-15)  # target less place

    def x(m, kp, kd, ki, target, oil, x0, v0):
        rows = [[0, 1, 0, 0], [-kp / m, -(kd + oil) / m, ki / m, kp * target / m], [-1, 0, 0, target], [0, 0, 0, 0]]
        start = np.array([x0, v0, 0.0, 1.0])  # position, speed, integral of the error, one
        return np.array([(expm(np.array(rows, complex) * t) @ start)[0] for t in run.motion.time])

    nominal = [2.0, *gains, 0.2, 4.0, 0.3, 0.5]
    np.testing.assert_allclose(computed.curve, x(*nominal).real, atol=1e-13)
    for k, slopes in enumerate(computed.slopes):
        turned = list(nominal)
        turned[k] += 1e-30j  # exact to rounding: the closed form is analytic
        np.testing.assert_allclose(slopes, x(*turned).imag / 1e-30, atol=1e-13)


BOUNCING = {"duration": '"0.7 s", frames = 40, tolerance = 1e-13 }', "target": 0.36}
BOUNCING["free"] = '{ position = 0.3, speed = 0.5 }\nstops = [{ at = 0.35, side = "upper", restitution = 0.6, name = "die" }]'
STICKING = {"effects": '["inertia", "gravity", "friction"]', "duration": '"3 s", frames = 40, tolerance = 1e-13 }', "target": 0.32}
STICKING["free"] = "{ position = 0.3, speed = 0.5 }\nfriction = { coefficient = 0.1, static = 0.15 }"


@pytest.mark.thorough
@pytest.mark.parametrize(
    "changed, events, number, step",
    [
        (BOUNCING, ["impact"] * 3, "loads.pid.target", 1e-6),
        (BOUNCING, ["impact"] * 3, "joints.O.stops[0].at", 1e-6),
        (STICKING, ["slip", "stick", "slip", "stick"], "loads.pid.target", 5e-6),
        (STICKING, ["slip", "stick", "slip", "stick"], "joints.O.friction.static", 5e-5),
    ],
)
def test_the_integral_goes_on_through_impacts_and_while_it_sticks(changed, events, number, step):
    """Integral action pulls loose what sticks: the stick-slip limit cycle of positioning."""
    scene = cart(**changed)
    run = run_scene(scene, frames=FRAMES)
    assert [e.kind.value for e in run.simulation.events][: len(events)] == events
    measures = [parse_measure(scene, key) for key in ("joint.O.displacement", "energy[work]", "energy[dissipated]")]
    results = sensitivities(run, measures, variables_of(scene, [number]))
    for one, wanted in zip(results, differences(scene, number, results, step, SIXTH), strict=True):
        assert np.abs(wanted).max() > 0.1
        np.testing.assert_allclose(one.slopes[0], wanted, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.sample(1)
@pytest.mark.parametrize("number, step", [("links.rocker.mass", 1e-3), ("loads.pid.integral", 1e-2)])
def test_the_integral_goes_on_where_another_coordinate_leads(number, step):
    text = load("swinging-triple-rocker").source + ROCKER
    scene = loads(text.replace('duration = "4 s"', 'duration = "0.6 s"\ntolerance = 1e-13'), "rocker")
    run = run_scene(scene, frames=FRAMES)
    assert len({tuple(segment.independent) for segment in run.simulation.segments}) == 2
    measures = [parse_measure(scene, key) for key in ("joint.A.angle", "joint.A.reaction", "energy[work]")]
    results = sensitivities(run, measures, variables_of(scene, [number]))
    for one, wanted in zip(results, differences(scene, number, results, step, SIXTH), strict=True):
        np.testing.assert_allclose(one.slopes[0], wanted, atol=1e-9 * np.abs(wanted).max())
