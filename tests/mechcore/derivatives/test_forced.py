"""Derivatives of motions under forces: closed forms of an oscillator, differences, energies, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from mechcore.errors import MechanismError
from mechviz.runs import run_scene
from mechviz.scene.scene import load, loads
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sensitivity import sensitivities, sensitivity
from mechviz.studies.designs.variables import variables_of

OSCILLATOR = """
units = { length = "m", angle = "deg" }
effects = ["inertia"]
trace = ["E"]
[run]
duration = "2 s"
frames = 40
tolerance = 1e-12
[links]
frame = { points = { O = [0, 0], W = [-1, 0] } }
cart = { points = { O = [0, 0], E = [0, 0] }, mass = 2.0, centre = [0, 0], inertia = 1.0 }
[joints]
O = { prismatic = ["frame", "cart"], along = [1, 0], free = { position = 0.3, speed = 0.5 } }
[loads]
spring = { spring = ["frame.W", "cart.E"], stiffness = 50.0, free_length = 1.0 }
oil = { viscous = "O", linear = 4.0 }
"""


def test_a_damped_oscillator_moves_as_its_closed_form_says():
    run = run_scene(loads(OSCILLATOR, "oscillator"))
    places = ["links.cart.mass", "loads.spring.stiffness", "loads.oil.linear", "joints.O.free.position", "joints.O.free.speed"]
    computed = sensitivity(run, "link.cart.position[x]", places)
    t = run.motion.time

    def x(m, k, c, x0, v0):
        decay, w = c / (2.0 * m), np.sqrt(k / m - (c / (2.0 * m)) ** 2 + 0j)
        return np.exp(-decay * t) * (x0 * np.cos(w * t) + (v0 + decay * x0) / w * np.sin(w * t))

    nominal = [2.0, 50.0, 4.0, 0.3, 0.5]
    np.testing.assert_allclose(computed.curve, x(*nominal).real, atol=1e-11)
    for k, slopes in enumerate(computed.slopes):
        turned = list(nominal)
        turned[k] += 1e-30j  # exact to rounding: the closed form is analytic
        np.testing.assert_allclose(slopes, x(*turned).imag / 1e-30, atol=1e-10)


def test_loads_and_their_powers_move_with_the_motion():
    run = run_scene(loads(OSCILLATOR, "oscillator"))
    x, v = run.motion.coordinate("O")[:, :2].T
    keys = ("joint.O.displacement", "joint.O.velocity", "load.spring.force[Fx]", "power[spring]", "power[oil]")
    found = sensitivities(run, [parse_measure(run.scene, key) for key in keys], variables_of(run.scene, ["loads.spring.stiffness"]))
    by_x, by_v, *others = (one.slopes[0] for one in found)
    pull = -x - 50.0 * by_x  # -k x, and k itself
    for slopes, wanted in zip(others, (pull, pull * v - 50.0 * x * by_v, -8.0 * v * by_v), strict=True):
        np.testing.assert_allclose(slopes * np.sign(slopes @ wanted), wanted, atol=1e-12 * np.abs(wanted).max())


def differences(scene, name, of, step, weights, frames=None):
    """Slopes of curves by a number of a scene, from runs beside it."""
    (variable,) = variables_of(scene, [name])
    total = [0.0] * len(of)
    for n, weight in weights:
        run = run_scene(variable.changed(scene, variable.value + n * step), frames=frames or FRAMES)
        for k, one in enumerate(of):
            curve = run.catalogue[one.quantity.key].values()[:, one.measure.column(one.quantity)]
            total[k] = total[k] + weight / step * curve
    return total


FRAMES = 24
SIXTH = tuple((s * n, s * w) for n, w in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60)) for s in (1, -1))


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    "name, duration, number, step, keys",
    [
        ("swinging-double-pendulum", "1 s", "links.lower.points.E[0]", 0.1, ["joint.J.angle", "joint.J.reaction[|F|]"]),
        (
            "flyball-governor",
            "0.5 s",
            "links.left_arm.points.L[0]",
            0.2,
            ["joint.R.reaction", "energy[dissipated]", "energy[work]"],
        ),
        ("servo-arm", "1 s", "links.lower.mass", 1e-2, ["joint.A.angle", "joint.B.reaction", "energy[work]"]),
        # through impacts on a stop; slip and stick; a force that jumps at a place; a follower that leaves its cam and bounces;
        # another coordinate that leads
        ("toggle-press-stop", "0.1 s", "links.ram.mass", 0.004, ["joint.B.reaction", "energy[dissipated]"]),
        ("stick-slip-feed", "0.8 s", "loads.drive_train.stiffness", 1e-4, ["joint.G.displacement", "joint.G.reaction"]),
        ("crushing-press", "2 s", "links.ram.mass", 0.02, ["joint.A.angle", "joint.B.reaction"]),
        ("valve-float", "91.79 ms", "loads.valve_spring.stiffness", 1e-4, ["energy[kinetic]", "energy[work]"]),
        # a journal that starts in the middle of its bearing; a gas
        ("loose-coupler-pin", "0.1 s", "links.rod.mass", 1e-5, ["joint.B.reaction"]),
        ("engine-start-up", "0.6 s", "loads.gas.four_stroke.ratio", 1e-3, ["joint.A.angle", "joint.B.reaction"]),
        ("swinging-triple-rocker", "0.6 s", "links.rocker.mass", 1e-3, ["joint.A.angle", "joint.A.reaction"]),
    ],
)
def test_motions_of_gallery_scenes_agree_with_their_differences(name, duration, number, step, keys):
    scene = load(name).changed({("run", "tolerance"): 1e-13, ("run", "duration"): duration})
    run = run_scene(scene, frames=FRAMES)
    measures = [parse_measure(scene, key) for key in keys]
    results = sensitivities(run, measures, variables_of(scene, [number]))
    for one, wanted in zip(results, differences(scene, number, results, step, SIXTH), strict=True):
        assert np.abs(wanted).max() > 0.0
        np.testing.assert_allclose(one.slopes[0], wanted, atol=1e-7 * np.abs(wanted).max())


PISTON = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
run = { duration = "8 ms", tolerance = 1e-13 }
[links]
frame = { points = { S = [0, 0], W = [-200, 0] } }
piston = { points = { S = [0, 0] }, mass = 0.7 }
[joints]
S = { prismatic = ["frame", "piston"], along = [1, 0], free = { speed = "6 m/s" } }
[loads]
spring = { spring = ["frame.W", "piston.S"], stiffness = "100 N/mm", free_length = 200 }
[loads.air]
gas = "S"
bore = 40
top = 40
stroke = 80
back = "1 bar"
compressor = { suction = "1 bar", delivery = "7 bar", exponent = 1.3, clearance = 0.06 }
"""


@pytest.mark.parametrize("number, step", [("links.piston.mass", 1e-3), ("joints.S.free.speed", 1e-2)])
def test_gas_passes_to_another_line_where_a_free_piston_turns_back(number, step):
    """The pressure jumps in the middle of the stroke, at an instant that moves."""
    scene = loads(PISTON, "piston")
    results = sensitivities(
        run_scene(scene, frames=FRAMES), [parse_measure(scene, "joint.S.displacement")], variables_of(scene, [number])
    )
    (wanted,) = differences(scene, number, results, step, SIXTH)
    np.testing.assert_allclose(results[0].slopes[0], wanted, atol=1e-9 * np.abs(wanted).max())


def test_energies_of_prescribed_motions_have_derivatives_too():
    scene = load("parametric-press")
    run = run_scene(scene, frames=FRAMES)
    measures = [parse_measure(scene, f"energy[{name}]") for name in ("kinetic", "work")]
    for number, step in (("stroke", 0.5), ("speed", 0.5)):  # a speed changes the times of the frames, too
        results = sensitivities(run, measures, variables_of(scene, [number]))
        for one, wanted in zip(results, differences(scene, number, results, step, SIXTH), strict=True):
            np.testing.assert_allclose(one.slopes[0], wanted, atol=1e-9 * np.abs(wanted).max())


def test_a_cam_that_presses_on_either_side_may_rub():
    rubs = {("effects",): ["inertia", "friction"], ("joints", "K", "friction"): {"coefficient": 0.1, "radius": "2 mm"}}
    scene, number = load("cam-groove").changed(rubs), "joints.K.friction.coefficient"
    run = run_scene(scene, frames=FRAMES)
    results = sensitivities(run, [parse_measure(scene, "drive.O.torque")], variables_of(scene, [number]))
    (wanted,) = differences(scene, number, results, 1e-4, SIXTH)
    assert np.abs(wanted).max() > 0.1
    np.testing.assert_allclose(results[0].slopes[0], wanted, atol=1e-9 * np.abs(wanted).max())


def test_a_cam_turns_faster():
    scene, number = load("cam-roller"), "joints.O.drive.speed"
    run = run_scene(scene, frames=FRAMES)
    results = sensitivities(run, [parse_measure(scene, "drive.O.torque")], variables_of(scene, [number]))
    (wanted,) = differences(scene, number, results, 0.5, SIXTH)
    np.testing.assert_allclose(results[0].slopes[0], wanted, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize(
    "name, number, reason",
    [
        ("cam-roller", "joints.K.profile.lift[0].over", "follow from one parameter"),  # a turn has 360 degrees
    ],
)
def test_what_cams_refuse_is_said_in_words(name, number, reason):
    with pytest.raises(MechanismError, match=reason):
        sensitivity(run_scene(load(name), frames=8), "joint.K.reaction", [number])


@pytest.mark.parametrize(
    "name, reason",
    [
        ("falling-four-bars", "at a singular position"),  # flat on the ground, where they could go on in two ways
    ],
)
def test_motions_whose_form_follows_from_their_course_are_refused(name, reason):
    run = run_scene(load(name), frames=8)
    number = next(v.name for v in variables_of(run.scene) if v.name.endswith("mass"))
    key = next(key for key in run.catalogue.by_key if key.endswith(".reaction"))
    with pytest.raises(MechanismError, match=reason):
        sensitivity(run, key, [number])


FAN = """
units = { length = "m", angle = "rad" }
effects = ["inertia"]
run = { steady = 1, frames = 24, tolerance = 1e-12 }
[links]
frame = { points = { A = [0, 0] } }
fan = { points = { A = [0, 0] }, mass = 2.0, centre = "A", inertia = 3.0 }
[joints]
A = { revolute = ["frame", "fan"], free = { position = 0.3, speed = 40 } }
[loads]
push = { torque = 90.0, on = "fan" }
oil = { viscous = "A", linear = 1.5 }
"""


def test_a_steady_speed_is_that_at_which_the_torques_balance():
    """Of a fan in oil M / c; its period and with it the time of each frame follow, and the angle of each frame stays."""
    run = run_scene(loads(FAN, "fan"))
    places = ["loads.push.torque", "loads.oil.linear", "links.fan.inertia", "joints.A.free.speed"]
    measures = [
        parse_measure(run.scene, key) for key in ("joint.A.angular_velocity", "joint.A.angle", "joint.A.angular_velocity:mean")
    ]
    speed, angle, mean = sensitivities(run, measures, variables_of(run.scene, places))
    wanted = np.array([1.0 / 1.5, -90.0 / 1.5**2, 0.0, 0.0])
    np.testing.assert_allclose(speed.slopes, np.outer(wanted, np.ones(25)), atol=1e-9)
    np.testing.assert_allclose(angle.slopes, 0.0, atol=1e-8)
    np.testing.assert_allclose(mean.derivatives, wanted, atol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("duration", [None, "0.1 s", "0.5 s"])
def test_a_steady_run_with_jumping_forces_follows_its_parameters(duration):
    """The crusher over its period, whatever that is, over a part of it and over some of them, by differences."""
    scene = load("crusher-steady").changed({("run", "tolerance"): 1e-12, ("run", "duration"): duration})
    run = run_scene(scene, frames=FRAMES)
    keys = ("joint.A.angular_velocity", "joint.D.reaction")
    measures = [parse_measure(scene, key) for key in keys]
    for name, step in (("links.shaft.inertia", 2e-3), ("loads.motor.breakdown_torque", 0.1)):
        computed = sensitivities(run, measures, variables_of(scene, [name]))
        weights = ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12))
        for one, wanted in zip(computed, differences(scene, name, computed, step, weights), strict=True):
            np.testing.assert_allclose(one.slopes[0], wanted, atol=1e-8 * np.abs(wanted).max())
        number = sensitivities(run, [parse_measure(scene, f"{keys[0]}:rms")], variables_of(scene, [name]))[0]
        weights_of_frames = number.measure.weights(number.curve, run.catalogue.numbers.time, None)
        assert number.derivatives[0] == pytest.approx(computed[0].slopes[0] @ weights_of_frames, rel=1e-10), "also backwards"


BALL = """
units = { length = "m", angle = "deg" }
effects = ["inertia", "gravity"]
gravity = [0, -10]
run = { duration = "1.2 s", frames = 30, tolerance = 1e-12 }
[links]
frame = { points = { G = [0, 0] } }
ball = { points = { G = [0, 0] }, mass = 2.0, inertia = 1.0, centre = [0, 0] }
[joints.G]
prismatic = ["frame", "ball"]
along = [0, 1]
free = { position = 1.25 }
stops = [{ at = "floor", side = "lower", restitution = "bounce", name = "floor" }]
[parameters]
floor = "0 m"
bounce = 0.8
"""


def test_a_bouncing_ball_moves_with_its_floor_and_what_it_bounces_as_its_closed_form_says():
    run = run_scene(loads(BALL, "ball"))
    computed = sensitivity(run, "joint.G.displacement", ["floor", "bounce"])
    t = run.motion.time

    def height(floor, bounce):  # dropped from 1.25 m at 10 m/s^2
        hit = np.sqrt((1.25 - floor) / 5.0)
        return np.where(t > 0.5, floor + bounce * 10.0 * hit * (t - hit) - 5.0 * (t - hit) ** 2, 1.25 - 5.0 * t * t)

    for slopes, beside in zip(computed.slopes, (height(1e-30j, 0.8), height(0.0, 0.8 + 1e-30j)), strict=True):
        np.testing.assert_allclose(slopes, beside.imag / 1e-30, atol=1e-9)  # the closed form is analytic


@pytest.mark.parametrize("number, step", [("floor", 1e-4), ("bounce", 1e-4), ("loads.oil.linear", 1e-3)])
def test_oil_takes_more_from_a_ball_that_rises_higher(number, step):
    """An impact that comes later leaves the oil more time at the speed before it, and less at the one after it."""
    scene = loads(BALL + '[loads]\noil = { viscous = "G", linear = 4.0 }\n', "ball")
    results = sensitivities(
        run_scene(scene, frames=FRAMES), [parse_measure(scene, "energy[dissipated]")], variables_of(scene, [number])
    )
    (wanted,) = differences(scene, number, results, step, SIXTH)
    np.testing.assert_allclose(results[0].slopes[0], wanted, atol=1e-9 * np.abs(wanted).max())


def test_forces_that_change_at_stated_times_are_followed():
    """A constant force from half a second on: what it does grows from there, as a step response does; and a little later comes to
    as much less as it would have pushed in that time."""
    scene = loads(OSCILLATOR + 'push = { force = ["8 N", 0], on = "cart", at = "E", step = { at = "0.5 s" } }', "pushed")
    run = run_scene(scene)
    slopes = sensitivity(run, "link.cart.position[x]", ["loads.push.force[0]", "loads.push.step.at"])
    t = np.maximum(run.motion.time - 0.5, 0.0)
    decay, w = 1.0, np.sqrt(24.0)
    response = (1.0 - np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))) / 50.0
    np.testing.assert_allclose(slopes.slopes[0], response, atol=1e-10)
    np.testing.assert_allclose(slopes.slopes[1], -8.0 / (2.0 * w) * np.exp(-decay * t) * np.sin(w * t), atol=1e-10)
