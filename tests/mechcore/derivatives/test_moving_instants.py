"""Derivatives by what moves the instants at which forces change: times of steps, ramps, chirps, tables and drives by pieces."""

from __future__ import annotations

import numpy as np
import pytest
from test_forced import OSCILLATOR, SIXTH, differences
from test_servo_integrals import STICKING, cart

from mechcore.derivatives.time_pieces import on_pieces_of
from mechcore.laws.signals import Chirp, Ramp, Step
from mechcore.laws.timed import Table
from mechviz.runs import run_scene
from mechviz.scene.scene import Scene, load, loads
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sensitivity import sensitivities
from mechviz.studies.designs.variables import variables_of

PUSH = 'push = { force = ["8 N", 0], on = "cart", at = "E", %s }\n'
TABLE = 'table = { smooth = %s, time = ["0 s", "0.3 s", "0.71 s", "1.11 s", "1.9 s"], factor = [0, 1, -1, 2, 0] }'
REPEATED = 'table = { smooth = false, period = "0.8 s", time = ["0 s", "0.3 s", "0.5 s"], factor = [0, 1, -1] }'
RAMP = 'ramp = { begin = "0.2 s", end = "0.6 s" }'
CHIRP = 'chirp = { frequencies = ["1 Hz", "5 Hz"], duration = "1.1 s" }'
FRAMES = 23  # of which none is at a stated time


def agree(scene: Scene, number: str, step: float, *keys: str, bound: float = 1e-9) -> None:
    """Derivatives by a number of a scene are as differences of sixth order say."""
    run = run_scene(scene)
    results = sensitivities(run, [parse_measure(scene, key) for key in keys], variables_of(scene, [number]))
    for one, wanted in zip(results, differences(scene, number, results, step, SIXTH, FRAMES), strict=True):
        assert np.abs(wanted).max() > 0.0
        np.testing.assert_allclose(one.slopes[0], wanted, atol=bound * np.abs(wanted).max())


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    "law, number",
    [
        ('step = { at = "0.5 s" }', "step.at"),
        (RAMP, "ramp.begin"),
        (RAMP, "ramp.end"),
        (CHIRP, "chirp.duration"),
        (TABLE % "true", "table.time[2]"),
        (TABLE % "false", "table.time[4]"),
        (TABLE % '"spline"', "table.time[2]"),
        (REPEATED, "table.period"),
        (REPEATED, "table.time[1]"),
    ],
)
def test_times_of_loads_may_vary(law, number):
    scene = loads(OSCILLATOR.replace("1e-12", "1e-13").replace("frames = 40", f"frames = {FRAMES}") + PUSH % law, "pushed")
    agree(scene, f"loads.push.{number}", 5e-4, "joint.O.displacement", "energy[work]", "energy[dissipated]", bound=2e-9)


def test_a_step_that_pulls_loose_what_sticks_may_come_later():
    scene = cart(**STICKING, integral='"0 N/(m s)"', proportional='"10 N/m"')
    scene = loads(f'{scene.source}\n[loads.push]\nforce = ["8 N", 0]\non = "cart"\nat = "O"\nstep = {{ at = "0.7 s" }}\n', "stuck")
    run = run_scene(scene)
    assert any(e.kind.value == "slip" and abs(e.time - 0.7) < 1e-12 for e in run.simulation.events)
    agree(scene.changed({("run", "frames"): FRAMES}), "loads.push.step.at", 1e-3, "joint.O.displacement", "energy[dissipated]")


@pytest.mark.sample(1)
@pytest.mark.parametrize("number", ["table.time[1]", "table.time[3]"])
def test_a_hammer_that_is_let_go_later_strikes_later(number):
    scene = load("trip-hammer").changed({("run", "tolerance"): 1e-13, ("run", "duration"): "0.85 s", ("run", "frames"): FRAMES})
    agree(scene, f"loads.tappet.{number}", 5e-5, "joint.O.angle", "energy[work]", "energy[dissipated]")


def test_a_servo_may_set_out_later():
    scene = load("servo-arm").changed({("run", "tolerance"): 1e-13, ("run", "duration"): "1 s", ("run", "frames"): FRAMES})
    agree(scene, "loads.shoulder.ramp.begin", 3e-4, "joint.A.angle", "joint.B.reaction")


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    "law, number",
    [
        (f'speed = "10 mm/s", {RAMP}', "ramp.begin"),
        ('speed = "20 mm/s", chirp = { frequencies = ["1 Hz", "3 Hz"], duration = "0.6 s" }', "chirp.duration"),
        ('speed = "40 mm/s", zones = { run_up = 5, steady = 20, braking = 5 }', "speed"),
        ('speed = "40 mm/s", zones = { run_up = 2, steady = 5, braking = 2 }', "zones.run_up"),  # several cycles
    ],
)
def test_times_of_drives_beside_free_coordinates_may_vary(law, number):
    text = (
        load("stick-slip-feed")
        .source.replace("tolerance = 1e-8", "tolerance = 1e-13")
        .replace('duration = "6 s"', 'duration = "0.8 s"')
    )
    text = text.replace('speed = "10 mm/s", travel = 60', law).replace("frames = 1200", f"frames = {FRAMES}")
    scene = loads(text.replace("0.08, static = 0.2", "0.02, static = 0.03"), "feed")
    agree(scene, f"joints.R.drive.{number}", 1e-4, "joint.G.displacement", "energy[work]", bound=5e-9)


TWO_STEPS = ("one", "other")


@pytest.mark.parametrize("number", ["loads.one.step.at", "loads.other.step.at", "loads.one.force[0]"])
def test_of_two_steps_at_once_one_may_move_alone(number):
    """Each has its own response; the cart's equation is linear, so that they add up."""
    one, other = (PUSH.replace("push", name) % 'step = { at = "0.5 s" }' for name in TWO_STEPS)
    text = OSCILLATOR.replace("1e-12", "1e-13").replace("frames = 40", f"frames = {FRAMES}")
    scene = loads(text + one + other.replace("8 N", "-3 N"), "pushed")
    run = run_scene(scene)
    keys = ("joint.O.displacement", "energy[work]", "energy[dissipated]")
    found = sensitivities(run, [parse_measure(scene, key) for key in keys], variables_of(scene, [number]))
    force = 8.0 if "one" in number else -3.0
    t, decay, w = np.maximum(run.motion.time - 0.5, 0.0), 1.0, np.sqrt(24.0)
    later = -force / (2.0 * w) * np.exp(-decay * t) * np.sin(w * t)
    response = (1.0 - np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))) / 50.0
    np.testing.assert_allclose(found[0].slopes[0], later if number.endswith("at") else response, atol=1e-10)
    if number.endswith("at"):
        for result, wanted in zip(found[1:], differences(scene, number, found[1:], 5e-4, SIXTH, FRAMES), strict=True):
            np.testing.assert_allclose(result.slopes[0], wanted, atol=2e-9 * np.abs(wanted).max())


@pytest.mark.parametrize(
    "nominal, own",
    [
        (Step(at=0.5, before=1.0, after=3.0), Step(at=0.6, before=1.1, after=3.2)),
        (Ramp(begin=0.2, end=0.7, before=1.0), Ramp(begin=0.25, end=0.8, before=1.1)),
        (Chirp(frequencies=(1.0, 5.0), duration=0.7), Chirp(frequencies=(1.1, 5.0), duration=0.8, mean=0.1)),
    ],
)
@pytest.mark.parametrize("derivative", [-1, 0, 1, 2])
def test_signals_on_pieces_of_others_are_themselves_where_pieces_are_the_same(nominal, own, derivative):
    """And in between go on as the piece does that is the nominal one."""
    t = np.linspace(0.0, 1.0, 401)
    known = on_pieces_of(nominal, own)
    same = np.all([(t > a) == (t > b) for a, b in zip(nominal.breaks, own.breaks, strict=True)], axis=0)
    np.testing.assert_allclose(known(t, derivative)[same], own(t, derivative)[same], rtol=1e-13, atol=1e-13)
    if derivative >= 0:
        between = ~same & (t > nominal.breaks[0])
        assert between.any()
        if isinstance(own, Step) and derivative == 0:
            np.testing.assert_array_equal(known(t)[between], own.after)


@pytest.mark.parametrize("smooth", [True, False, "spline"])
@pytest.mark.parametrize("period", [None, 2.0])
def test_tables_on_pieces_of_others(smooth, period):
    y = (0.0, 1.0, -1.0, 2.0, 0.5)
    nominal = Table((0.0, 0.3, 0.7, 1.1, 1.9), y, period, smooth)
    own = Table((0.0, 0.35, 0.7, 1.1, 1.85), y, period, smooth)
    known = on_pieces_of(nominal, own)
    x = np.linspace(-0.5, 2.5, 601) if period is None else np.linspace(-5.0, 5.0, 901)
    local = x if period is None else np.mod(x, period)
    same = np.searchsorted(nominal.x, local) == np.searchsorted(own.x, local)
    np.testing.assert_allclose(known(x)[same], own(x)[same], atol=1e-12)
    line = known(np.array([0.3, 0.32]))  # where the second piece has begun, and its own has not: on its straight line beyond
    if smooth is False:
        np.testing.assert_allclose(line, 1.0 - 2.0 / 0.35 * (np.array([0.3, 0.32]) - 0.35), atol=1e-12)
