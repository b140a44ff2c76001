"""Stiff springs: an L-stable rule steps over vibrations that nobody sees, all others are told before the work begins."""

from dataclasses import replace

import numpy as np
import pytest
from dynamic_mechanisms import pendulum

from mechcore.compiled.collocation import WindowTrial
from mechcore.dynamics.equations.reduced import reduce
from mechcore.dynamics.integration.collocation import Window, radau, solve_window
from mechcore.dynamics.rest.equilibrium import fastest_vibration, find_equilibrium
from mechcore.dynamics.rest.vibrations import small_vibrations
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.loads import TorsionDamper, TorsionSpring
from mechviz.accuracy.estimate import estimate_errors
from mechviz.runs import run_scene
from mechviz.scene.scene import load


def held(stiffness, *, angle=0.7, free=0.7, speed=0.0, damping=0.0):
    """A pendulum on a torsion spring, its angle from hanging; ``free`` angle of the spring likewise."""
    spring = TorsionSpring(name="k", links=("frame", "body"), stiffness=stiffness, free_angle=free - np.pi / 2)
    damper = TorsionDamper(name="c", links=("frame", "body"), coefficient=damping)
    loads = (spring, damper) if damping else (spring,)
    return pendulum(inertia=0.05, mass=1.0, distance=0.2, angle=angle, speed=speed, loads=loads)


class Vibrating:
    """q'' = -w^2 q."""

    def __init__(self, omega):
        self.omega = omega

    def __call__(self, q, v, t):
        return -(self.omega**2) * q

    def slopes(self, q, v, t, a):
        return np.full((len(q), 1, 1), -(self.omega**2)), np.zeros((len(q), 1, 1))


@pytest.mark.parametrize("nodes", [3, 7, 12])
def test_radau_is_l_stable(nodes):
    """A window of a million radians leaves nothing of a vibration, neither of its place nor of its speed."""
    rule, omega = radau(nodes), 1e6
    for q, v in ((1.0, 0.0), (0.0, omega)):
        a, _ = solve_window(rule, Vibrating(omega), WindowTrial(0.0, 1.0, np.array([q]), np.array([v]), np.zeros((nodes, 1)), 1e-6))
        end = Window(0.0, 1.0, np.array([q]), np.array([v]), rule.legendre @ a)(np.array([1.0]))
        assert abs(end[0].item()) < 1e-3 and abs(end[1].item()) < 1e-3 * omega


class Damped(Vibrating):
    """q'' = -w v."""

    def __call__(self, q, v, t):
        return -self.omega * v

    def slopes(self, q, v, t, a):
        return np.zeros((len(q), 1, 1)), np.full((len(q), 1, 1), -self.omega)


@pytest.mark.parametrize("nodes", [2, 5, 8, 11, 12, 13, 14, 17])
def test_stiff_windows_do_not_stand_on_the_last_digits(nodes):
    """Rounding in the rule's matrices changes with the processor's linear algebra; it decides about no window's convergence."""
    exact = radau(nodes)
    for seed in range(150):
        noise = np.random.default_rng(seed)
        once, twice, series = (
            m * (1.0 + 1e-15 * noise.standard_normal(m.shape)) for m in (exact.integral, exact.double_integral, exact.legendre)
        )
        rule = replace(exact, integral=once, double_integral=twice, legendre=series)
        omega, h = 10.0 ** noise.uniform(4.0, 9.0), 10.0 ** noise.uniform(-1.0, 1.0)
        for system, q, v in ((Vibrating(omega), 1.0, 0.0), (Vibrating(omega), 0.0, omega), (Damped(omega), 0.0, omega)):
            solved = solve_window(rule, system, WindowTrial(0.0, h, np.array([q]), np.array([v]), np.zeros((nodes, 1)), 1e-6))
            assert solved is not None and solved[1] <= 4
            end = Window(0.0, h, np.array([q]), np.array([v]), rule.legendre @ solved[0])(np.array([h]))
            left, rounding = 2.0 * nodes / (omega * h), 1e-12 * h * abs(v)
            rest = v / omega if isinstance(system, Damped) else 0.0
            assert abs(end[0].item() - rest) < left + rounding
            assert abs(end[1].item()) < (left + rounding / h) * omega


@pytest.mark.parametrize("stiffness", [1e9, 1e11, 1e13])
def test_a_stiff_spring_leads_to_the_equilibrium(stiffness):
    """It stays within its deflection M g l / k of where it is, in a few windows; the equilibrium is that of statics."""
    mechanism = held(stiffness)
    simulation = simulate(mechanism, 2.0, tolerance=1e-8)
    assert simulation.method == "radau" and simulation.evaluations < 300
    t = np.linspace(0.5, 2.0, 50)
    rest = 0.7 - np.pi / 2 - 9.81 * 0.2 * np.sin(0.7) / stiffness  # to the square of the deflection
    assert np.abs(simulation(t)[0] - rest).max() < 1e-3 * 9.81 * 0.2 / stiffness + 1e-15
    assert simulation.events[0].kind == "stiff" and "k" in simulation.events[0].text
    assert 0.0 < simulation.skipped_vibration[0] <= 1e-8


def test_the_slow_motion_beside_a_stiff_spring_is_that_of_a_rigid_joint():
    """A double pendulum, whose second joint a spring holds stiffly, swings like the body that the two make together."""
    run = run_scene(load("swinging-double-pendulum"), outputs=())
    mechanism = run.compiled.mechanism
    bent = float(mechanism.drives[1].law(0.0)[0])
    spring = TorsionSpring(name="k", links=("upper", "lower"), stiffness=1e10, free_angle=bent)
    stiff = simulate(replace(mechanism, loads=(spring,)), 2.0, tolerance=1e-8)
    assert stiff.method == "radau" and stiff.evaluations < 3000
    t = np.linspace(0.0, 2.0, 41)
    q, v, _ = stiff([0.0])
    masses = [(link.mass, run.motion.centre_of_mass(link.name)[0]) for link in mechanism.links if link.mass]
    mass = sum(m for m, _ in masses)
    x, y = sum(m * place for m, place in masses) / mass
    inertia = float(reduce(run.compiled, q, v, np.zeros(1)).inertia[0, 0, 0])
    body = pendulum(inertia=inertia, mass=mass, distance=float(np.hypot(x, y)), angle=float(np.arctan2(x, -y)))
    rigid = simulate(body, 2.0, tolerance=1e-12)
    assert np.abs(stiff(t)[0][:, 1] - bent).max() < 1e-8
    swing, other = ((s(t)[0] - s([0.0])[0])[:, 0] for s in (stiff, rigid))
    assert np.abs(swing).max() > 0.5 and np.abs(swing - other).max() < 1e-6


def test_frequency_is_that_of_small_vibrations():
    """The same from the equations linearised about the equilibrium, by other code."""
    for mechanism in (held(40.0), held(2.0, angle=0.3, free=0.5)):
        rest = find_equilibrium(mechanism)
        fast = fastest_vibration(rest.compiled, rest.position, np.zeros(1))
        assert fast.frequency == pytest.approx(small_vibrations(mechanism).modes[-1].frequency, rel=1e-7)
        assert fast.load == "k"


def test_amplitude_and_damping():
    """From the start at the spring's free angle: the static deflection; with a speed: that over the angular frequency."""
    k, inertia = 5e4, 0.05
    omega = np.sqrt(k / inertia)
    static = 9.81 * 0.2 * np.sin(0.7) / k
    for mechanism, amplitude, ratio in (
        (held(k), static, 0.0),
        (held(k, speed=3.0), 3.0 / omega, 0.0),
        (held(k, damping=2.0), static, 2.0 / (2.0 * inertia * omega)),
    ):
        compiled = compile_mechanism(mechanism)
        law = compiled.mechanism.drives[0].law
        fast = fastest_vibration(compiled, np.array([law(0.0)[0]]).ravel(), np.array([law(0.0)[1]]).ravel())
        assert fast.amplitude == pytest.approx(amplitude, rel=1e-3)
        assert fast.damping == pytest.approx(ratio, rel=1e-3, abs=1e-12)


def test_what_takes_long_is_told_before_it_begins():
    """With frequency, spring, stiffness and number of periods; nothing has been integrated then."""
    told = []

    class Begun(Exception):
        pass

    def begin(_):
        raise Begun(len(told))

    with pytest.raises(Begun, match="1"):
        simulate(held(4e5, speed=0.1), 3.0, tolerance=1e-6, warn=told.append, progress=begin)
    periods = 3.0 * np.sqrt(4e5 / 0.05) / (2.0 * np.pi)
    assert f"{periods:,.0f} periods" in told[0] and "'k' with 400000 N m/rad" in told[0] and "450.2 Hz" in told[0]


def test_what_takes_too_long_is_refused_with_a_remedy():
    """And the remedy works."""
    mechanism = held(1e9, speed=1.0)
    with pytest.raises(MechanismError) as error:
        simulate(mechanism, 3.0, tolerance=1e-9)
    (fault,) = error.value.faults
    assert fault.path == "loads.k.stiffness" and "67,524 periods" in fault.message and "1e+09 N m/rad" in fault.message
    tolerance = float(fault.remedy.split("tolerance = ")[1].split(" ")[0])
    assert simulate(mechanism, 3.0, tolerance=tolerance, method="radau").evaluations < 300
    longest = float(fault.remedy.split("at most ")[1].split(" ")[0])
    assert fastest_vibration(compile_mechanism(mechanism), np.array([0.7 - np.pi / 2]), np.ones(1)).periods(longest) <= 50_500


def test_vibrations_that_are_seen_are_followed():
    """Above the tolerance nothing is stepped over: the closed form of the small vibration, 200 periods long."""
    k = 1e6
    mechanism = held(k, speed=1.0)
    simulation = simulate(mechanism, 0.3, tolerance=1e-10)
    assert simulation.method == "gauss" and simulation.skipped_vibration == (0.0, 0.0)
    omega, t = np.sqrt(k / 0.05), np.linspace(0.0, 0.3, 7)
    assert np.abs(simulation(t)[0][:, 0] - (0.7 - np.pi / 2) - np.sin(omega * t) / omega).max() < 3e-6


def test_errors_of_what_stands_still_are_absolute(tmp_path):
    """A bar in stable equilibrium but for rounding: its rates are rounding, which is not compared with itself."""
    path = tmp_path / "still.toml"
    path.write_text(
        """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity"]
run = { duration = "3 s", frames = 120, method = "gauss" }
[links]
frame = { points = { O = [0, 0] } }
bar = { points = { O = [0, 0], E = [400, 0] }, mass = "1 kg", shape = "bar" }
[joints]
O = { revolute = ["frame", "bar"], free = { position = -90.0000000001 } }
"""
    )
    run = run_scene(load(str(path)))
    assert 0.0 < np.ptp(run.motion.pose("bar")[:, 2]) < 1e-11
    worst = estimate_errors(run).worst()
    assert all(value < 1e-6 for value in worst.values()), worst
    assert np.abs(run.simulation.drift(run.motion.time)).max() < 1e-6
