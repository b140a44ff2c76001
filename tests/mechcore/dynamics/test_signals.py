"""Signals of time (sine, step, ramp, chirp): their integrals and rates, loads that follow them, and what is wrong with them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from dynamic_mechanisms import pendulum
from scipy.integrate import quad, solve_ivp
from scipy.signal import chirp

import mechviz
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.signals import Chirp, Ramp, Sine, Step
from mechcore.motion.events import find_events
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Factor, Torque
from mechviz.runs import run_scene

SIGNALS = [
    Sine(frequency=2.3, amplitude=0.7, mean=0.2, phase=0.4),
    Step(at=0.37),
    Step(at=0.0, before=0.3, after=0.8),
    Ramp(begin=0.2, end=0.9),
    Ramp(begin=-0.5, end=0.5, before=3.0, after=-1.0),
    Chirp(frequencies=(1.0, 9.0), duration=1.2, phase=0.3, mean=0.1, amplitude=2.0),
    Chirp(frequencies=(9.0, 1.0), duration=1.2, phase=0.3),
    Chirp(frequencies=(0.0, 4.0), duration=0.8),
    Chirp(frequencies=(0.5, 7.0), duration=1.2, phase=0.3, sweep="exponential"),
    Chirp(frequencies=(9.0, 1.0), duration=0.5, phase=0.3, sweep="exponential"),
    Chirp(frequencies=(3.0, 3.0), duration=0.2, phase=0.3),
]


@pytest.mark.parametrize("signal", SIGNALS, ids=str)
def test_integral_and_rate_are_those_of_the_value(signal):
    for t in (0.0, 0.1, 0.37, 0.55, 0.95, 1.2, 1.7):
        edges = [0.0, *(b for b in signal.breaks if 0.0 < b < t), t]
        area = sum(quad(lambda x: float(signal(x)), a, b, epsabs=1e-13, limit=500)[0] for a, b in pairwise(edges))
        assert signal(t, -1) == pytest.approx(area, abs=2e-13)
        if all(abs(t - b) > 1e-4 for b in signal.breaks):
            assert signal(t, 1) == pytest.approx((signal(t + 1e-5) - signal(t - 1e-5)) / 2e-5, abs=2e-5)
            assert signal(t, 2) == pytest.approx((signal(t + 1e-5, 1) - signal(t - 1e-5, 1)) / 2e-5, abs=2e-3)


@pytest.mark.parametrize(("sweep", "method"), [("linear", "linear"), ("exponential", "logarithmic")])
def test_a_chirp_is_that_of_scipy(sweep, method):
    t = np.linspace(0.0, 2.0, 501)
    ours = Chirp(frequencies=(2.0, 11.0), duration=2.0, phase=np.pi / 2, sweep=sweep)(t)
    assert ours == pytest.approx(chirp(t, 2.0, 2.0, 11.0, method=method), abs=1e-12)


@pytest.mark.parametrize("signal", [s for s in SIGNALS if s.breaks], ids=str)
def test_at_a_break_the_piece_before_it_holds(signal):
    t = np.array([b for b in signal.breaks if b > 0.0])
    before = signal(np.nextafter(t, 0.0)), signal(np.nextafter(t, 0.0), 1)
    assert signal(t) == pytest.approx(before[0], abs=1e-12)
    assert signal(t, 1) == pytest.approx(before[1], rel=1e-12, abs=1e-9)


OSCILLATOR = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
run = { duration = "3 s", tolerance = 1e-11 }
[links]
frame = { points = { S = [0, 0], H = [-200, 0] } }
block = { points = { S = [0, 0] }, mass = "2 kg" }
[joints]
S = { prismatic = ["frame", "block"], free = {} }
[loads]
spring = { spring = ["frame.H", "block.S"], stiffness = "800 N/m", free_length = 200 }
damper = { viscous = "S", linear = "6 N s/m" }
push = { force = ["25 N", 0], on = "block", SIGNAL }
"""
FORCING = {
    'sine = { period = "0.37 s", phase = 30, mean = 0.3 }': Sine(frequency=1 / 0.37, phase=np.pi / 6, mean=0.3),
    'step = { at = "1.3 s", after = 0.7 }': Step(at=1.3, after=0.7),
    "step = { at = 0 }": Step(at=0.0),
    'ramp = { begin = "0.7 s", end = "0.7001 s" }': Ramp(begin=0.7, end=0.7001),
    'chirp = { frequencies = ["0.5 Hz", "8 Hz"], duration = "2 s" }': Chirp(frequencies=(0.5, 8.0), duration=2.0),
    'chirp = { frequencies = [8, 1], duration = "2 s", sweep = "exponential" }': Chirp(
        frequencies=(8.0, 1.0), duration=2.0, sweep="exponential"
    ),
}


@pytest.mark.sample(6)
@pytest.mark.parametrize("method", ["auto", "radau"])
@pytest.mark.parametrize("text", FORCING)
def test_forced_oscillator(text, method):
    """Against an independent integration, piece by piece between the breaks."""
    signal, mechanism = FORCING[text], mechviz.loads(OSCILLATOR.replace("SIGNAL", text)).mechanism
    t = np.linspace(0.0, 3.0, 301)
    edges, state, expected = [0.0, *(b for b in signal.breaks if 0.0 < b < 3.0), 3.0], [0.0, 0.0], np.zeros((2, len(t)))
    for a, b in pairwise(edges):

        def rates(time, y, a=a, b=b):
            inside = np.clip(time, np.nextafter(a, b) if a else 0.0, b)
            return [y[1], (25.0 * float(signal(inside)) - 6.0 * y[1] - 800.0 * y[0]) / 2.0]

        solution = solve_ivp(rates, (a, b), state, method="DOP853", rtol=1e-13, atol=1e-15, dense_output=True)
        here, state = (t >= a) & (t <= b), solution.y[:, -1]
        expected[:, here] = solution.sol(t[here])
    run = simulate(mechanism, 3.0, tolerance=1e-11, method=method)
    q, v, _ = run(t)
    assert q[:, 0] == pytest.approx(expected[0], abs=1e-12)
    assert v[:, 0] == pytest.approx(expected[1], abs=1e-10)
    assert np.abs(run.drift(t)).max() < 1e-9


def test_the_integration_is_cut_at_the_breaks():
    """A window ends at each, and no short windows feel their way to it."""
    for text in ('step = { at = "1.3 s" }', 'ramp = { begin = "0.7 s", end = "1.9 s" }'):
        run = simulate(mechviz.loads(OSCILLATOR.replace("SIGNAL", text)).mechanism, 3.0, tolerance=1e-11)
        windows = run.segments[0].solution.windows
        ends = np.array([w.start + w.length for w in windows])
        for b in FORCING.get(text, Ramp(begin=0.7, end=1.9) if "ramp" in text else Step(at=1.3)).breaks:
            near = np.abs(ends - b).min()
            assert 0.0 <= near <= 4.0 * np.spacing(b)
        assert min(w.length for w in windows) > 0.01


def test_a_load_of_a_prescribed_motion():
    """The reaction along the guide is the spring's, the damper's and the signal's."""
    text = OSCILLATOR.replace("SIGNAL", 'sine = { frequency = "3 Hz" }')
    text = text.replace('run = { duration = "3 s", tolerance = 1e-11 }', "")
    text = text.replace("free = {}", 'drive = { oscillation = { amplitude = 20, frequency = "2 Hz" } }')
    mechanism = mechviz.loads(text).mechanism
    t = np.linspace(0.0, 0.5, 41)
    forces = solve_forces(solve_motion(compile_mechanism(mechanism), t))
    w = 4.0 * np.pi
    x, v, a = 0.02 * np.sin(w * t), 0.02 * w * np.cos(w * t), -0.02 * w * w * np.sin(w * t)
    assert forces.effort("S") == pytest.approx(2.0 * a + 6.0 * v + 800.0 * x - 25.0 * np.sin(6.0 * np.pi * t), abs=1e-11)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sine = {}", "loads.push.sine: the sine has none of frequency or period. Give one of them."),
        ('sine = { frequency = "2 Hz", period = "1 s" }', "frequency and period at once"),
        ("sine = { frequency = 0 }", "loads.push.sine.frequency: 0 is zero. Give a positive value."),
        ("sine = { frequency = 1, amplitude = 1e40 }", "loads.push.sine.amplitude: 1e+40 is beyond 1e+30."),
        ("step = {}", "loads.push.step: 'at' is missing"),
        ('step = { at = "2 m" }', "loads.push.step.at"),
        ("ramp = { begin = 2, end = 1 }", "loads.push.ramp.end: ends before it begins. Give a later end."),
        ("ramp = { begin = 1, end = 1 }", "write step = { at = ... }"),
        ("chirp = { frequencies = [2, 2], duration = 1 }", "loads.push.chirp.frequencies: are the same: nothing sweeps."),
        ("chirp = { frequencies = [2], duration = 1 }", "loads.push.chirp.frequencies"),
        ('chirp = { frequencies = [2, 3], duration = 1, sweep = "square" }', "loads.push.chirp.sweep"),
        ("step = { at = 1 }, ramp = { end = 1 }", "loads.push.ramp: step and ramp at once. Keep one of them."),
        ("stepp = { at = 1 }", "Did you mean 'step'?"),
    ],
)
def test_what_is_wrong_with_a_signal_is_said(text, words):
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(OSCILLATOR.replace("SIGNAL", text))
    assert words in "\n".join(map(str, error.value.faults))


def test_a_signal_goes_with_a_force_only():
    text = OSCILLATOR.replace("free_length = 200", "free_length = 200, sine = { frequency = 1 }").replace(", SIGNAL", "")
    with pytest.raises(mechviz.SceneError, match="sine does not go with a spring"):
        mechviz.loads(text)


TOWED = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
run = { duration = "3 s", tolerance = 1e-10 }
[links]
frame = { points = { S = [0, 0], T = [0, 0] } }
tug = { points = { T = [0, 0] }, mass = "1 kg" }
block = { points = { S = [0, 0] }, mass = "2 kg" }
[joints]
T = { prismatic = ["frame", "tug"], drive = { zones = { run_up = 40, steady = 60, braking = 30 }, speed = "100 mm/s", start = 300 }}
S = { prismatic = ["frame", "block"], free = {} }
[loads]
rope = { spring = ["tug.T", "block.S"], stiffness = "800 N/m", free_length = 300 }
"""


def test_the_integration_is_cut_where_a_prescribed_drive_changes_its_law():
    """Zones tow a block by a spring: closed form from zone to zone, cycle after cycle."""
    mechanism = mechviz.loads(TOWED).mechanism
    law = mechanism.drives[0].law
    run = simulate(mechanism, 3.0, tolerance=1e-10)
    ends = np.array([w.start + w.length for w in run.segments[0].solution.windows])
    boundaries = [0.0, *law.breaks, law.duration, law.duration + law.breaks[0]]
    for b in boundaries[1:]:
        assert np.abs(ends - b).min() <= 4.0 * np.spacing(b)
    assert np.diff(ends, prepend=0.0).min() > 0.01
    w, x, v = 20.0, 0.0, 0.0  # of the block, from where the rope is slack
    for begin, end in pairwise([*boundaries, 3.0]):
        h, (p, u, a) = end - begin, (float(z) for z in law(0.5 * (begin + end)))
        p, u = p - 0.5 * h * u + 0.125 * h * h * a - 0.3, u - 0.5 * h * a  # of the tug where the zone begins, less the free length
        # x'' = w^2 (p + u t + a t^2 / 2 - x) has the particular solution p - a / w^2 + u t + a t^2 / 2
        d, e = x - p + a / w**2, (v - u) / w
        x = p - a / w**2 + u * h + 0.5 * a * h * h + d * np.cos(w * h) + e * np.sin(w * h)
        v = u + a * h + w * (e * np.cos(w * h) - d * np.sin(w * h))
        assert run(end)[0][0, 0] == pytest.approx(x, abs=1e-12)


# --- speeds of drives ---------------------------------------------------------------------------------------------------

PRESS = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
run = { frames = 240 }
[links]
frame = { points = { O = [0, 0] } }
crank = { points = { O = [0, 0], P = [40, 0] }, mass = "1 kg", centre = "O", inertia = "0.003 kg m^2" }
rod = { points = { P = [0, 0], Q = [150, 0] }, mass = "0.4 kg", centre = [60, 0], inertia = "0.001 kg m^2" }
ram = { points = { Q = [0, 0] }, mass = "2 kg" }
[joints]
O = { revolute = ["frame", "crank"], drive = { speed = "90 rpm", start = 20, DRIVE } }
P = { revolute = ["crank", "rod"] }
Q = { revolute = ["rod", "ram"] }
S = { prismatic = ["frame", "ram"], at = ["O", "Q"], branch = "ahead" }
"""
W = 2.0 * np.pi / 0.8
SPEEDS = {  # drive -> duration, factor and its integral over time [s], by hand
    'sine = { period = "0.8 s", amplitude = 0.5, mean = 1 }': (
        0.8,
        lambda t: 1.0 + 0.5 * np.sin(W * t),
        lambda t: t + 0.5 / W * (1.0 - np.cos(W * t)),
    ),
    'ramp = { begin = "0.2 s", end = "0.6 s" }, duration = "1 s"': (
        1.0,
        lambda t: np.interp(t, [0.2, 0.6], [0.0, 1.0]),
        lambda t: np.where(t < 0.2, 0.0, np.where(t < 0.6, 1.25 * (t - 0.2) ** 2, 0.2 + t - 0.6)),
    ),
    'step = { at = "0.5 s", before = 1, after = -0.5 }, duration = "1 s"': (
        1.0,
        lambda t: np.where(t <= 0.5, 1.0, -0.5),
        lambda t: np.where(t <= 0.5, t, 0.5 - 0.5 * (t - 0.5)),
    ),
    'chirp = { frequencies = [1, 5], duration = "1 s" }': (
        1.0,
        lambda t: np.sin(2.0 * np.pi * (t + 2.0 * t * t)),
        lambda t: np.array([quad(lambda x: np.sin(2.0 * np.pi * (x + 2.0 * x * x)), 0.0, end, epsabs=1e-14)[0] for end in t]),
    ),
}


@pytest.mark.parametrize("text", SPEEDS)
def test_the_speed_of_a_drive_follows_a_signal(text):
    """Position, speed and acceleration by hand; the drive's power is the rate of kinetic energy, whose change is its work."""
    duration, factor, area = SPEEDS[text]
    scene = mechviz.loads(PRESS.replace("DRIVE", text))
    assert mechviz.loads(scene.to_toml()) == scene
    run = run_scene(scene)
    t, (q, v, a) = run.motion.time, run.motion.coordinate("O").T
    assert t[-1] == pytest.approx(duration, rel=1e-15)
    speed = 3.0 * np.pi
    np.testing.assert_allclose(q, np.radians(20.0) + speed * area(t), rtol=0, atol=2e-13)
    np.testing.assert_allclose(v, speed * factor(t), rtol=0, atol=1e-13)
    inner = (t > 0.01) & (t < duration - 0.01) & (np.abs(t - 0.2) > 1e-3) & (np.abs(t - 0.5) > 1e-3) & (np.abs(t - 0.6) > 1e-3)
    rate = (factor(t + 1e-6) - factor(t - 1e-6)) / 2e-6
    np.testing.assert_allclose(a[inner], speed * rate[inner], atol=1e-6 * max(1.0, np.abs(a).max()))
    power, forces = run.forces.power("O"), run.forces
    assert np.abs(forces.power_balance).max() < 1e-12
    kinetic = np.zeros(len(t))
    for body in scene.mechanism.links[1:]:
        way, turning = run.motion.centre_of_mass(body.name, 1), run.motion.velocity(body.name)[:, 2]
        kinetic += 0.5 * body.mass * (way**2).sum(axis=-1) + 0.5 * body.inertia * turning**2
    if "step" not in text:
        work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t))])
        np.testing.assert_allclose(kinetic - kinetic[0], work, atol=1e-2 * np.ptp(kinetic))  # the power jumps with the ramp
    told = ["velocity" in e.text for e in find_events(run.motion) if "jumps" in e.text]
    assert told == {"step": [True], "ramp": [False, False]}.get(text.split()[0], [])  # where the ramp begins and where it ends


def test_a_drive_whose_speed_follows_a_signal_beside_a_free_joint():
    """A tug pulls a block by a spring, its speed ramped up: closed form before, in and after the ramp."""
    zones = "zones = { run_up = 40, steady = 60, braking = 30 }, "
    text = TOWED.replace('speed = "100 mm/s"', 'speed = "100 mm/s", ramp = { begin = "0.3 s", end = "1.1 s" }').replace(zones, "")
    mechanism = mechviz.loads(text).mechanism
    run = simulate(mechanism, 3.0, tolerance=1e-11)
    t = np.linspace(0.0, 3.0, 31)
    towed = solve_ivp(
        lambda time, y: [y[1], 400.0 * (float(mechanism.drives[0].law(time)[0]) - 0.3 - y[0])],
        (0.0, 3.0), [0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14, t_eval=t, max_step=0.02,
    )  # fmt: skip
    np.testing.assert_allclose(run(t)[0][:, 0], towed.y[0], atol=1e-10)
    with pytest.raises(mechviz.SceneError, match="the speed jumps: beside free joints it would be an impact"):
        mechviz.loads(text.replace('ramp = { begin = "0.3 s", end = "1.1 s" }', "step = { at = 1 }"))


@pytest.mark.parametrize(
    ("drive", "path", "words"),
    [
        ("ramp = { end = 1 }", "joints.O.drive", "without saying how long a cycle lasts. Add duration"),
        ("ramp = { end = 0 }, duration = 1", "joints.O.drive.ramp.end", "it jumps"),
        ("step = { at = 1 }, sine = { period = 1 }, duration = 1", "joints.O.drive", "has sine and step at once"),
        ("sine = { period = 1 }, travel = 90", "joints.O.drive.travel", "travel does not go with sine"),
        ("duration = 2", "joints.O.drive.duration", "duration does not go with speed"),
        ("sine = { }", "joints.O.drive.sine", "frequency or period"),
    ],
)
def test_faults_of_speeds_with_signals(drive, path, words):
    with pytest.raises(mechviz.SceneError) as refused:
        mechviz.loads(PRESS.replace("DRIVE", drive))
    (fault,) = refused.value.faults
    assert fault.path == path and words in f"{fault.message} {fault.remedy}"


def test_signals_multiply_speeds_and_only_some_repeat():
    with pytest.raises(mechviz.SceneError, match="without the speed that it multiplies"):
        mechviz.loads(PRESS.replace('speed = "90 rpm", start = 20, DRIVE', "sine = { period = 1 }"))
    twice = PRESS.replace("run = { frames = 240 }", "run = { frames = 240, cycles = 2 }")
    with pytest.raises(mechviz.SceneError, match="2 cycles of a chirp, which does not repeat"):
        mechviz.loads(twice.replace("DRIVE", 'chirp = { frequencies = [1, 5], duration = "1 s" }'))
    angle = run_scene(mechviz.loads(twice.replace("DRIVE", "sine = { period = 1, mean = 1 }"))).motion.coordinate("O")[:, 0]
    assert angle[-1] - angle[0] == pytest.approx(6.0 * np.pi, rel=1e-14)


def test_what_a_load_swings_through_is_foreseen():
    """Periods by the integral of the frequency; a load that nobody would follow is refused before the work begins."""
    swept = Chirp(frequencies=(2.0, 10.0), duration=3.0, phase=0.4)
    assert swept.periods(5.0) == pytest.approx(18.0 + 20.0)
    assert Sine(frequency=7.0).periods(2.0) == pytest.approx(14.0)
    shaken = Torque(name="M", link="body", moment=1e-3, factor=Factor(function=Sine(frequency=1e6), of="time"))
    with pytest.raises(
        MechanismError, match=r"'M' swings through 1,000,000 periods in 1 s.*Lower its frequency, or run at most 0.05 s"
    ):
        simulate(pendulum(inertia=1.0, mass=1.0, distance=0.5, angle=0.3, loads=(shaken,)), 1.0)
