"""Position servos (PD, PID) against linear theory and scipy, beside friction, stops and loops; what is wrong with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import mechviz
from mechcore.dynamics.rest.vibrations import small_vibrations
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Servo
from mechcore.spec.mechanism import Drive
from mechviz.editor.parameters import find_parameters
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene
from recordings import vectors_of

SLIDE = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"EFFECTS]
run = { duration = "2 s", tolerance = 1e-11 }
[links]
frame = { points = { S = [0, 0] } }
block = { points = { S = [0, 0] }, mass = "2 kg", shape = "point" }
[joints]
S = { prismatic = ["frame", "block"], FREE MORE }
[loads]
servo = { servo = "S", TARGET, GAINS }
"""
KP, KD, KI = 300.0, 30.0, 900.0
PID = 'proportional = "0.3 N/mm", derivative = "30 N s/m", integral = "900 N/(m s)"'
PD = 'proportional = "0.3 N/mm", derivative = "30 N s/m"'


def scene(target: str, gains: str = PID, more: str = "", effects: str = "", free: str = "free = {}") -> mechviz.Scene:
    text = SLIDE.replace("TARGET", target).replace("GAINS", gains).replace("MORE", more).replace("EFFECTS", effects)
    return mechviz.loads(text.replace("FREE", free))


@pytest.mark.parametrize(("gains", "integral"), [(PD, 0.0), (PID, KI)])
def test_step_response_is_that_of_linear_theory(gains, integral):
    """x'' m = P e + D e' + I z with e = X - x, from rest: the state (x, x', z) by the matrix exponential from the step on."""
    run = simulate(scene('target = "40 mm", step = { at = "0.2 s" }', gains).mechanism, 2.0, tolerance=1e-11)
    a = np.array(
        [[0.0, 1.0, 0.0, 0.0], [-KP / 2, -KD / 2, integral / 2, KP * 0.04 / 2], [-1.0, 0.0, 0.0, 0.04], [0.0, 0.0, 0.0, 0.0]]
    )
    t = np.linspace(0.0, 2.0, 101)
    expected = np.array([expm(a * max(s - 0.2, 0.0)) @ [0.0, 0.0, 0.0, 1.0] for s in t])
    q, v, _ = run(t)
    assert q[:, 0] == pytest.approx(expected[:, 0], abs=1e-12)
    assert v[:, 0] == pytest.approx(expected[:, 1], abs=1e-10)
    assert np.abs(run.drift(t)).max() < 1e-9
    forces = run.forces(run.motion(t))
    effort = 2.0 * (a @ expected.T)[1]
    assert forces.loads["servo"].values[:, 0] == pytest.approx(np.where(t > 0.2, effort, 0.0), abs=1e-9)
    assert np.abs(forces.power_balance).max() < 1e-12


@pytest.mark.parametrize(
    ("target", "law"),
    [
        ('target = "40 mm", sine = { frequency = "1.5 Hz" }', lambda t: 0.04 * np.sin(3.0 * np.pi * t)),
        ('target = "40 mm", ramp = { end = "0.5 s" }', lambda t: 0.08 * np.clip(t, 0.0, 0.5)),
        (
            'target = { oscillation = { centre = 10, amplitude = 30, frequency = "1 Hz" } }',
            lambda t: 0.01 + 0.03 * np.sin(6.283185307179586 * t),
        ),
        ('target = { speed = "100 mm/s", zones = { run_up = 20, steady = 40, braking = 20 } }', None),
    ],
)
def test_it_follows_a_target_that_moves(target, law):
    """In the coordinates of the error: m e'' + D e' + P e + I z = m X'', e and z continuous."""
    made = scene(target)
    (servo,) = made.mechanism.loads
    run = simulate(made.mechanism, 2.0, tolerance=1e-11)
    t = np.linspace(0.0, 2.0, 201)
    if law is not None:
        assert servo.target(t)[0] == pytest.approx(law(t), abs=1e-12)
    breaks = [0.4, 0.8, 1.2, 1.6] if law is None else [b for b in servo.target.breaks if b > 0.0]
    state, expected = [0.0, 0.0, 0.0], np.zeros((3, len(t)))
    for a, b in zip([0.0, *breaks], [*breaks, 2.0], strict=True):

        def rates(time, s, a=a, b=b):
            x, v, _ = (float(k) for k in servo.target(np.clip(time, np.nextafter(a, b) if a else 0.0, b)))
            return [s[1], (KP * (x - s[0]) + KD * (v - s[1]) + KI * s[2]) / 2.0, x - s[0]]

        solution = solve_ivp(rates, (a, b), state, method="DOP853", rtol=1e-13, atol=1e-14, dense_output=True)
        here, state = (t >= a) & (t <= b), solution.y[:, -1]
        expected[:, here] = solution.sol(t[here])
    assert run(t)[0][:, 0] == pytest.approx(expected[0], abs=1e-11)


ARM = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
run = { duration = "1.5 s", tolerance = 1e-10 }
[links]
frame = { points = { A = [0, 0] } }
upper = { points = { A = [0, 0], B = [400, 0] }, mass = "2 kg", centre = [200, 0], inertia = "0.03 kg m^2" }
lower = { points = { B = [0, 0], C = [250, 0] }, mass = "1 kg", centre = [125, 0], inertia = "0.006 kg m^2" }
[joints]
A = { revolute = ["frame", "upper"], free = { position = 10 } }
B = { revolute = ["upper", "lower"], free = { position = 30 } }
[loads.shoulder]
servo = "A"
target = 60
step = { at = "0.2 s" }
proportional = "90 N m/rad"
derivative = "9 N m s/rad"
integral = "150 N m/(rad s)"
[loads.elbow]
servo = "B"
target = { oscillation = { amplitude = 40, frequency = "1 Hz" } }
proportional = "30 N m/rad"
derivative = "2 N m s/rad"
integral = "50 N m/(rad s)"
"""


def test_an_arm_with_two_servos():
    """Lagrange's equations of the double pendulum under the two controllers, integrated by scipy from step to step."""
    run = simulate(mechviz.loads(ARM).mechanism, 1.5, tolerance=1e-10)
    ma, mb, r, ca, cb, ja, jb, g = 2.0, 1.0, 0.4, 0.2, 0.125, 0.03, 0.006, 9.81

    def rates(t, s):
        a, b, u, w, za, zb = s
        ea, eb = np.radians(60.0) * (t > 0.2) - a, np.radians(40.0) * np.sin(2.0 * np.pi * t) - b
        speed = np.radians(40.0) * 2.0 * np.pi * np.cos(2.0 * np.pi * t)
        pa, pb = 90.0 * ea - 9.0 * u + 150.0 * za, 30.0 * eb + 2.0 * (speed - w) + 50.0 * zb
        c, k = np.cos(b), mb * r * cb * np.sin(b)
        both = jb + mb * (cb**2 + r * cb * c)
        inertia = np.array([[ja + ma * ca**2 + mb * r**2 + both + mb * r * cb * c, both], [both, jb + mb * cb**2]])
        weight = g * mb * cb * np.cos(a + b)
        force = [pa + k * w * (2.0 * u + w) - g * (ma * ca + mb * r) * np.cos(a) - weight, pb - k * u * u - weight]
        return [u, w, *np.linalg.solve(inertia, force), ea, eb]

    t = np.linspace(0.0, 1.5, 76)
    start = [np.radians(10.0), np.radians(30.0), 0.0, 0.0, 0.0, 0.0]
    first = solve_ivp(rates, (0.0, 0.2), start, method="DOP853", rtol=1e-12, atol=1e-13, dense_output=True)
    later = solve_ivp(
        lambda s, y: rates(max(s, 0.2000000001), y),
        (0.2, 1.5),
        first.y[:, -1],
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
        dense_output=True,
    )
    expected = np.where(t <= 0.2, first.sol(np.minimum(t, 0.2)), later.sol(np.maximum(t, 0.2)))
    assert run(t)[0] == pytest.approx(expected[:2].T, abs=1e-9)
    assert np.abs(run.drift(t)).max() < 1e-8
    assert np.abs(run.forces(run.motion(t)).power_balance).max() < 1e-12


def test_target_and_error_are_recorded(tmp_path):
    """Of a run as of its recording: the target by hand, the coordinate reached, and how far it is behind."""
    run = run_scene(mechviz.loads(ARM), frames=60)
    write_recording(run, tmp_path / "arm.rrd")
    t, computed, data = run.motion.time, run.catalogue.by_key, Recording(tmp_path / "arm.rrd")
    target, reached = computed["servo.elbow.position"].values().T
    assert target == pytest.approx(40.0 * np.sin(2.0 * np.pi * t), abs=1e-9)
    assert reached == pytest.approx(np.degrees(run.motion.coordinate("B")[:, 0]), abs=1e-9)
    error = computed["servo.elbow.error"]
    assert error.values()[:, 0] == pytest.approx(target - reached, abs=1e-9) and error.unit == "°"
    assert computed["servo.shoulder.position"].values()[:, 0] == pytest.approx(np.where(t > 0.2, 60.0, 0.0), abs=1e-9)
    assert np.degrees(data.scalars("data", "servos", "elbow", "error")[1][:, 0]) == pytest.approx(target - reached, abs=1e-9)


def test_friction_holds_until_the_integral_has_grown():
    """At rest an error e stays: P e + I e t reaches the limit of sticking at a known time."""
    friction = "friction = { coefficient = 0.1, static = 0.2 }"
    made = scene('target = "10 mm"', more=f", {friction}", effects=', "gravity", "friction"')
    run = simulate(made.mechanism, 2.0, tolerance=1e-10)
    limit = 0.2 * 2.0 * 9.81
    (loose,) = (h.time for h in run.events[:2] if h.kind == "slip")
    assert loose == pytest.approx((limit - KP * 0.01) / (KI * 0.01), abs=1e-9)
    assert run(np.array([0.99 * loose]))[0][0, 0] == 0.0
    assert np.abs(run.drift(np.linspace(0.0, 2.0, 41))).max() < 1e-8


def test_the_integral_goes_on_through_impacts_and_rest_on_a_stop():
    """A stop at 20 mm holds the block; the target then goes back, and what was wound up meanwhile keeps it there for a while."""
    stop = ', stops = [{ at = 20, side = "upper", restitution = 0.4 }]'
    made = scene('target = "40 mm", step = { at = "1 s", before = 1, after = -0.5 }', more=stop)
    assert made.simulation is not None
    run = simulate(made.mechanism, 2.0, tolerance=1e-11, stops=made.simulation.stops)
    now, state = 0.0, np.array([0.0, 0.0, 0.0, 1.0])

    def system(target: float) -> np.ndarray:
        return np.array([[0, 1, 0, 0], [-KP / 2, -KD / 2, KI / 2, KP * target / 2], [-1, 0, 0, target], [0, 0, 0, 0]], float)

    hits = [h.time for h in run.events if h.kind == "impact"]
    rest = next(h.time for h in run.events if h.kind == "contact")
    for hit in hits:
        state = expm(system(0.04) * (hit - now)) @ state
        assert state[0] == pytest.approx(0.02, abs=1e-10)
        state[1] *= -0.4
        now = hit
    assert rest == hits[-1]
    wound = state[2] + 0.02 * (1.0 - rest)  # until the target turns back
    release = next(h.time for h in run.events if h.kind == "release")
    if KP * -0.04 + KI * wound > 0.0:
        assert release == pytest.approx(1.0 + (KI * wound - KP * 0.04) / (KI * 0.04), abs=1e-9)
    else:
        assert release == pytest.approx(1.0, abs=1e-9)
    held = np.array([0.5 * (rest + 1.0)])
    push = run.forces(run.view(held)).loads["stop S upper"].values[0, 0]
    assert push == pytest.approx(-(KP * 0.02 + KI * (state[2] + 0.02 * (held[0] - rest))), rel=1e-9)


CRANK = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
run = { duration = "1 s", tolerance = 1e-10 }
[links]
frame = { points = { A = [0, 0] } }
crank = { points = { A = [0, 0], B = [100, 0] }, mass = "1 kg", shape = "bar" }
rod = { points = { B = [0, 0], C = [300, 0] }, mass = "1 kg", shape = "bar" }
piston = { points = { C = [0, 0] }, mass = "1 kg", shape = "point" }
[joints]
A = { revolute = ["frame", "crank"] AFREE }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["A", "C"] SFREE }
[sketch]
B = [70.71067811865476, 70.71067811865476]
C = [362.2582728609198, 0]
[loads.servo]
servo = "A"
target = { speed = "60 rpm", start = 45 }
proportional = "90 N m/rad"
derivative = "5 N m s/rad"
integral = "400 N m/(rad s)"
"""


def test_it_leads_through_dead_points_of_the_free_joint():
    """Other joints lead the equations meanwhile; the integral goes on."""
    by_crank = CRANK.replace("AFREE", ", free = { position = 45 }").replace("SFREE", "")
    by_slide = CRANK.replace("AFREE", "").replace("SFREE", ", free = { position = 362.2582728609198 }")
    t = np.linspace(0.0, 1.0, 51)
    one, two = (simulate(mechviz.loads(text).mechanism, 1.0, tolerance=1e-10) for text in (by_crank, by_slide))
    assert two.motion(t).coordinate("A")[:, 0] == pytest.approx(one.motion(t).coordinate("A")[:, 0], abs=1e-7)
    assert len({id(p.compiled) for p in two.segments}) > 1
    assert one.motion(t).coordinate("A")[-1, 0] > 5.0
    for run in (one, two):
        assert np.abs(run.drift(t)).max() < 1e-7


def test_small_vibrations_are_those_of_its_gains():
    vibrations = small_vibrations(scene('target = "10 mm"', PD).mechanism)
    assert vibrations.modes[0].frequency == pytest.approx(np.sqrt(KP / 2.0) / (2.0 * np.pi), rel=1e-6)
    assert vibrations.modes[0].damping_ratio == pytest.approx(KD / (2.0 * np.sqrt(KP * 2.0)), rel=1e-6)
    assert any("servo" in note for note in small_vibrations(scene('target = "10 mm"').mechanism).notes)


@pytest.mark.parametrize(
    "target", ['{ oscillation = { centre = 10, amplitude = 5, period = "1 s" } }', '10, ramp = { begin = "-1 s", end = "0 s" }']
)
def test_small_vibrations_are_about_a_target_that_stands_still(target: str):
    """The rate of the target at the start is no force: by the derivative gain it moved the equilibrium."""
    vibrations = small_vibrations(scene(f"target = {target}", PD).mechanism)
    assert vibrations.equilibrium.position == pytest.approx([0.01], abs=1e-12)
    assert vibrations.modes[0].damping_ratio == pytest.approx(KD / (2.0 * np.sqrt(KP * 2.0)), rel=1e-6)


def test_a_prescribed_motion_knows_no_integral():
    mechanism = scene('target = "10 mm"').mechanism
    (servo,) = mechanism.loads
    driven = replace(mechanism, drives=(Drive(joint="S", law=ConstantSpeed(0.0, 0.1, travel=0.1)),))
    with pytest.raises(MechanismError, match=r"loads.servo: the integral of its error is known in motions under forces only"):
        solve_forces(solve_motion(compile_mechanism(driven), [0.0, 0.5]))
    assert isinstance(servo, Servo)
    driven = replace(driven, loads=(replace(servo, integral=0.0),))
    forces = solve_forces(solve_motion(compile_mechanism(driven), [0.0, 0.5]))
    assert forces.effort("S") == pytest.approx([-(KP * 0.01 - KD * 0.1), -(KP * -0.04 - KD * 0.1)])


def test_a_recording_shows_it():
    run = run_scene(mechviz.loads(ARM), frames=30)
    moments = vectors_of(run)[1]["applied"]
    assert moments["shoulder"].value[0] == pytest.approx(-90.0 * np.radians(10.0)) and "elbow" in moments
    run = run_scene(scene('target = "40 mm"'), frames=30)
    assert vectors_of(run)[0]["applied"]["servo"].value[0] == pytest.approx([KP * 0.04, 0.0])


def test_its_gains_are_sliders_with_their_units():
    result = {p.title for p in find_parameters(mechviz.loads(ARM)) if p.path[0] == "loads"}
    assert {"shoulder target [°]", "shoulder proportional [N m/rad]", "elbow integral [N m/(rad s)]"} <= result


@pytest.mark.parametrize(
    ("target", "gains", "words"),
    [
        ("", PID, "loads.servo: 'target' is missing. Add target ="),
        ("target = 10", 'derivative = "3 N s/m"', "'proportional' is missing. Add proportional ="),
        ("target = 10", "proportional = 0", "all gains are zero: it does nothing. Give one of them a value."),
        ("target = 10", 'proportional = "-3 N/mm"', "'-3 N/mm' is negative."),
        ("target = 10", 'proportional = "3 N m/rad"', "loads.servo.proportional"),
        ("target = 10", 'proportional = 3, integral = "3 N/m"', "loads.servo.integral"),
        ('target = "30 deg"', PID, "loads.servo.target"),
        ("target = {}", PID, "loads.servo.target: the drive has no law of motion."),
        ("target = { oscillation = { amplitude = 3 } }", PID, "loads.servo.target.oscillation"),
        (
            "target = { oscillation = { amplitude = 3, period = 1 } }, step = { at = 1 }",
            PID,
            "step beside a target that is a law of motion.",
        ),
        ("target = 3, step = { at = 1 }, ramp = { end = 1 }", PID, "step and ramp at once"),
        ("target = 3, table = { time = [0, 1], factor = [0, 1] }", PID, "table does not go with a servo"),
    ],
)
def test_what_is_wrong_with_a_servo_is_said(target, gains, words):
    with pytest.raises(mechviz.SceneError) as error:
        scene(target, gains) if target else scene("use = 'useful'", gains)
    assert words in "\n".join(map(str, error.value.faults))


def test_a_servo_needs_a_free_motion_and_a_free_joint():
    driven = 'drive = { oscillation = { amplitude = 30, period = "1 s" } }'
    with pytest.raises(mechviz.SceneError) as error:
        scene("target = 3", free=driven)
    words = "\n".join(map(str, error.value.faults))
    assert "loads.servo.servo: nothing is free: a servo moves a joint under forces." in words
    assert "the drive of 'S' decides its motion, whatever a servo does. Let the joint be free" in words
    with pytest.raises(mechviz.SceneError, match="there is no joint 'X'"):
        mechviz.loads(ARM.replace('servo = "A"', 'servo = "X"'))
