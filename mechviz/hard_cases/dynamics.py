"""Hard cases of motion under forces: benchmarks at which peers fail, singular positions, impacts, stiff and sensitive systems."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk, ellipkinc, ellipkm1

from mechcore.dynamics.event_integrator import Method
from mechcore.dynamics.events import EndStop, EventTrigger
from mechcore.dynamics.simulate import simulate
from mechcore.dynamics.simulation import Simulation
from mechcore.laws.timed import Free
from mechcore.spec.loads import Factor, Torque, TorsionSpring, Viscous
from mechcore.spec.mechanism import Drive, Link, Mechanism
from mechviz.hard_cases.case import Case, Check, Outcome, check_that, compare, refusal_outcome
from mechviz.hard_cases.mechanisms import bars, chain, pendulum, pin
from mechviz.scene.scene import load

G = 9.81
SQUEEZED = (
    15.810771195153707, -15.756371058411839, 0.0408222401196458, -0.5347301163420796,
    0.524409965879954, 0.5347301163420796, 1.048080741041938,
)  # fmt: skip
"""beta, Theta, gamma, Phi, delta, Omega, epsilon of the squeezer after 0.03 s: 36-digit arithmetic, an extrapolation integrator in
beta, confirmed by an energy quadrature (tests/reference/andrews.json); the published digits agree to 1e-9."""


def _outcome(
    simulation: Simulation, summary: str, checks: list[Check], *, drift: float | None = 1e-8, frames: int = 101
) -> Outcome:
    """The outcome of a simulation: beside the given checks its loops have to close and its energy has to balance."""
    t = np.linspace(0.0, simulation.duration, frames)
    motion = simulation.motion(t)
    residual = float(np.max(motion.closure)) / simulation.compiled.model.length_scale
    every = [*checks, Check("loops close", residual, 1e-12)]
    if drift is not None:
        every.append(Check("energy", float(np.max(np.abs(simulation.drift(t)))), drift))
    kinds = [h.kind for h in simulation.events]
    events = [f"{kinds.count(k)} {k}" for k in dict.fromkeys(kinds)]
    return Outcome(summary, tuple(every), residual, float(np.max(motion.condition)), tuple(events))


def _squeezer(method: Method, tolerance: float, bound: float) -> Outcome:
    simulation = simulate(load("andrews-squeezer").mechanism, 0.03, method=method, tolerance=tolerance)
    motion = simulation.motion([0.03])
    beta = float(simulation([0.03])[0][0, 0])
    angles = {k: float(motion.pose(k)[0, 2]) for k in ("K2", "K3", "K4", "K5", "K6", "K7")}
    # Theta = K2 - beta, gamma = K3, Phi = K4 - delta, delta = K5, Omega = K6 - epsilon, epsilon = K7
    got = [
        beta,
        angles["K2"] - beta,
        angles["K3"],
        angles["K4"] - angles["K5"],
        angles["K5"],
        angles["K6"] - angles["K7"],
        angles["K7"],
    ]
    error = np.abs(np.exp(1j * np.array(got)) - np.exp(1j * np.array(SQUEEZED)))
    checks = [compare("crank", beta, SQUEEZED[0], bound), compare("all angles", error, 0.0, bound, scale=1.0)]
    return _outcome(simulation, f"beta = {beta:.13g}", checks, drift=100 * tolerance + 1e-9)


def _rotating(length_inertia: float, moment: float, speed: float, t: float) -> float:
    """Angle turned by a pendulum J phi'' = -M sin(phi) that starts at the top with a speed, by Jacobi's amplitude.

    phi = 2 am(Omega t / 2 + K), modulus m = 4 (M / J) / Omega^2 with Omega the speed at the bottom (Whittaker, Analytical Dynamics,
    44).
    """
    w2 = moment / length_inertia
    omega = np.sqrt(speed**2 + 4.0 * w2)
    m = 4.0 * w2 / omega**2
    # am by Newton on F(phi, m) = u: scipy's ellipj returns it, refined here because its modulus comes close to one
    u = ellipk(m) + 0.5 * omega * t
    phi = ellipj(u, m)[3]
    for _ in range(3):
        phi -= (ellipkinc(phi, m) - u) * np.sqrt(1.0 - m * np.sin(phi) ** 2)
    return float(2.0 * phi - np.pi)


def _chain(n: int, method: Method = "auto") -> Outcome:
    """All uprights have the same angle: one pendulum with J = (n + 1)/3 + n and M = ((n + 1)/2 + n) g."""
    simulation = simulate(chain(n, Free(np.pi / 2, -1.0)), 10.0, method=method, tolerance=1e-9)
    turned = np.pi / 2 - float(simulation([10.0])[0][0, 0])
    want = _rotating((n + 1) / 3.0 + n, ((n + 1) / 2.0 + n) * G, 1.0, 10.0)
    t = np.linspace(0.0, 10.0, 201)
    motion = simulation.motion(t)
    apart = np.exp(1j * motion.pose(f"upright{n}")[:, 2]) - np.exp(1j * motion.pose("upright0")[:, 2])
    checks = [compare("angle after 10 s", turned, want, 1e-9), compare("uprights parallel", np.abs(apart), 0.0, 1e-9)]
    return _outcome(simulation, f"{turned:.15g} rad turned", checks, drift=1e-9)


def _pendulum_at(angle: float, t: object) -> Any:
    """phi of a pendulum J = 0.4, m d = 0.525 released at ``angle``: sin(phi/2) = k cd(w t) (theory of elliptic functions)."""
    w = np.sqrt(1.5 * G * 0.35 / 0.4)
    k = np.sin(0.5 * angle)
    _, cn, dn, _ = ellipj(w * np.asarray(t, float), k * k)
    return 2.0 * np.arcsin(k * cn / dn)


def _near_the_top() -> Outcome:
    """Released 0.1 degree from the top: an error there grows by the factor 10,000 before it comes down."""
    angle = np.radians(179.9)
    period = 4.0 * ellipkm1(np.cos(0.5 * angle) ** 2) * np.sqrt(0.4 / (1.5 * G * 0.35))
    simulation = simulate(pendulum(0.4, 1.5, 0.35, angle), period, tolerance=1e-12)
    t = np.linspace(0.0, period, 41)
    got = simulation(t)[0][:, 0] + np.pi / 2
    return _outcome(simulation, f"period {period:.6g} s", [compare("angle", got, _pendulum_at(angle, t), 1e-8)])


def _many_swings() -> Outcome:
    angle = 2.0
    period = 4.0 * ellipk(np.sin(0.5 * angle) ** 2) * np.sqrt(0.4 / (1.5 * G * 0.35))
    simulation = simulate(pendulum(0.4, 1.5, 0.35, angle), 1000.25 * period, tolerance=1e-10)
    q, v, _ = (x[0, 0] for x in simulation([1000.25 * period]))
    speed = np.sqrt(2.0 * 1.5 * G * 0.35 * (1.0 - np.cos(angle)) / 0.4)
    checks = [compare("at the bottom after 1000 periods", q + np.pi / 2, 0.0, 1e-8), compare("speed there", abs(v), speed, 1e-9)]
    return _outcome(simulation, f"{q + np.pi / 2:.1e} rad off the bottom", checks, drift=None, frames=11)


def _triple_rocker() -> Outcome:
    """No link turns fully: every coordinate has dead points. Kinetic and potential energy by hand, from positions and speeds of the
    links."""
    simulation = simulate(bars(1.0, 0.7, 0.6, 0.8, 1.2, 5.0), 3.0, tolerance=1e-10)
    t = np.linspace(0.0, 3.0, 301)
    motion = simulation.motion(t)
    energy = np.zeros(len(t))
    for k, length in (("crank", 0.7), ("coupler", 0.6), ("rocker", 0.8)):
        v, w = motion.centre_of_mass(k, 1), motion.velocity(k)[:, 2]
        energy += length * (0.5 * (v**2).sum(axis=1) + G * motion.centre_of_mass(k)[:, 1]) + 0.5 * length**3 / 12 * w**2
    leads = {p.compiled.mechanism.drives[0].joint for p in simulation.segments}
    checks = [compare("energy stays", energy, energy[0], 1e-8), check_that("another joint leads in between", len(leads) > 1)]
    return _outcome(simulation, f"led by {', '.join(sorted(leads))}", checks)


def _start_in_a_dead_point() -> Outcome:
    angle = float(np.arccos((1.0 + 0.49 - 1.96) / 1.4))
    return refusal_outcome(lambda: simulate(bars(1.0, 0.7, 0.6, 0.8, angle, 0.0), 1.0), "dead point|cannot be assembled")


def _zeno() -> Outcome:
    """A pendulum that bounces on a stop at the lowest place of its path: each bounce multiplies its speed by e, until it stays in
    contact."""
    stop = EndStop(name="wall", joint="O", at=-np.pi / 2 + 0.5, side="lower", restitution=0.5)
    simulation = simulate(pendulum(0.4, 1.5, 0.35, 1.0), 20.0, stops=[stop], tolerance=1e-9)
    speed = np.sqrt(2.0 * 1.5 * G * 0.35 * (np.cos(0.5) - np.cos(1.0)) / 0.4)
    hits = [h.time for h in simulation.events if h.kind == "impact"]
    before = np.abs(simulation(hits[:8])[1][:, 0])
    checks = [
        compare("speeds before the impacts", before, speed * 0.5 ** np.arange(8), 1e-7, scale=speed),
        check_that("it ends in contact", simulation.events[-1].kind == "contact"),
        compare("and stays there", simulation([20.0])[0][0, 0], stop.at, 1e-7),
    ]
    return _outcome(simulation, f"{len(hits)} impacts in {hits[-1]:.6g} s, then contact", checks)


def _stiff() -> Outcome:
    """c q' = -m g d sin q: tan(q/2) decays with exp(-m g d t / c); the speed follows with a time constant of 1e-5 s."""
    oil = Viscous(name="oil", joint="O", coefficient=4e4)
    m = pendulum(0.4, 1.5, 0.35, 1.0, loads=(oil,))
    simulation = simulate(m, 200.0, method="radau", tolerance=1e-6)
    want = 2.0 * np.arctan(np.tan(0.5) * np.exp(-1.5 * G * 0.35 * 200.0 / 4e4))
    got = float(simulation([200.0])[0][0, 0]) + np.pi / 2
    checks = [compare("angle", got, want, 1e-5), check_that("few evaluations", simulation.evaluations < 2000)]
    return _outcome(simulation, f"{simulation.evaluations} evaluations for 2e7 time constants", checks, drift=None)


def _double(effects: tuple[str, ...], starts: tuple[float, float, float, float]) -> Mechanism:
    """Two rods of 1 m and 0.8 m, 1 kg and 0.7 kg, hinged to each other."""
    q1, q2, w1, w2 = starts
    return Mechanism(
        name="double pendulum",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0)}),
            Link(name="upper", points={"O": (0.0, 0.0), "J": (1.0, 0.0)}, mass=1.0, centre=(0.5, 0.0), inertia=1.0 / 12),
            Link(name="lower", points={"J": (0.0, 0.0)}, mass=0.7, centre=(0.4, 0.0), inertia=0.7 * 0.64 / 12),
        ),
        joints=(pin("O", "frame", "upper"), pin("J", "upper", "lower")),
        drives=(Drive(joint="O", law=Free(q1, w1)), Drive(joint="J", law=Free(q2, w2))),
        effects=effects,
    )


def _lagrange(t: float, y: Any) -> list[float]:
    """The equations of the double pendulum from a textbook, angles from the x axis."""
    a, b, u, v = y
    m1, m2, l1, c1, c2, j1, j2 = 1.0, 0.7, 1.0, 0.5, 0.4, 1.0 / 12, 0.7 * 0.64 / 12
    k = m2 * l1 * c2
    matrix = np.array([[j1 + m1 * c1**2 + m2 * l1**2, k * np.cos(a - b)], [k * np.cos(a - b), j2 + m2 * c2**2]])
    rhs = [
        -k * np.sin(a - b) * v * v - (m1 * c1 + m2 * l1) * G * np.cos(a),
        k * np.sin(a - b) * u * u - m2 * c2 * G * np.cos(b),
    ]
    return [u, v, *np.linalg.solve(matrix, rhs)]


def _chaos() -> Outcome:
    """Against Lagrange's equations by hand and DOP853; neighbouring motions diverge by the factor e in half a second."""
    start = (0.3, 0.5, 0.0, -2.0)
    simulation = simulate(_double(("inertia", "gravity"), start), 3.0, tolerance=1e-11)
    other = solve_ivp(
        _lagrange,
        (0.0, 3.0),
        [start[0], start[0] + start[1], start[2], start[2] + start[3]],
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
    )
    q = simulation([3.0])[0][0]
    return _outcome(
        simulation, f"{q[0]:.10g}, {q.sum():.10g} rad", [compare("angles after 3 s", [q[0], q.sum()], other.y[:2, -1], 1e-8)]
    )


def _there_and_back() -> Outcome:
    start = (0.3, 0.5, 0.0, -2.0)
    there = simulate(_double(("inertia", "gravity"), start), 1.0, tolerance=1e-11)
    q, v, _ = (x[0] for x in there([1.0]))
    back = simulate(_double(("inertia", "gravity"), (q[0], q[1], -v[0], -v[1])), 1.0, tolerance=1e-11)
    got = back([1.0])[0][0]
    return _outcome(back, "back at the start", [compare("start", got, start[:2], 1e-9)])


def _knee() -> Outcome:
    """The lower joint hits a stop without loss: no impulse on the upper joint's coordinate, and energy is conserved."""
    stop = EndStop(name="knee", joint="J", at=-1.0, side="lower", restitution=1.0)
    simulation = simulate(_double(("inertia",), (-0.5, 0.0, 0.0, -3.0)), 2.0, stops=[stop], tolerance=1e-10)
    hit = next(h for h in simulation.events if h.kind == "impact").time
    (q,), (v,) = (x for x in simulation([hit])[:2])
    after = simulation([hit + 1e-10])[1][0]
    k = 0.7 * 0.4 * np.cos(q[1])
    row = np.array([1.0 / 3 + 0.7 + k + k + 0.7 * 0.64 / 3, k + 0.7 * 0.64 / 3])  # momentum that belongs to the upper joint
    checks = [compare("rebound", after[1], -v[1], 1e-7), compare("momentum about O", row @ after, row @ v, 1e-7)]
    return _outcome(simulation, f"hit at {hit:.9g} s", checks)


def _release() -> Outcome:
    pull = Torque(name="pull", link="body", moment=6.0, factor=Factor(function=lambda t: np.sin(np.asarray(t)), of="time"))
    stop = EndStop(name="wall", joint="O", at=-np.pi / 2, side="upper")
    simulation = simulate(pendulum(0.4, 1.5, 0.35, 0.0, loads=(pull,)), 5.0, stops=[stop], tolerance=1e-9)
    kinds = [h.kind for h in simulation.events[:2]]
    checks = [
        check_that("contact, then release", kinds == ["contact", "release"]),
        compare("released at pi", simulation.events[1].time, np.pi, 1e-7),
    ]
    return _outcome(simulation, f"released at {simulation.events[1].time:.9g} s", checks)


def _watch() -> Outcome:
    bottom = EventTrigger(name="bottom", joint="O", at=-np.pi / 2, ends=True)
    simulation = simulate(pendulum(0.4, 1.5, 0.35, 1.0), 100.0, triggers=[bottom], tolerance=1e-11)
    want = np.sqrt(0.4 / (1.5 * G * 0.35)) * ellipk(np.sin(0.5) ** 2)
    return _outcome(
        simulation, f"ends at {simulation.duration:.12g} s", [compare("quarter of a period", simulation.duration, want, 1e-9)]
    )


def _winding() -> Outcome:
    """A torsion spring does not repeat after a turn: 30 / w sin(w t) with w^2 = k / J, some two turns either way."""
    spring = TorsionSpring(name="spring", links=("frame", "body"), stiffness=2.0, free_angle=-np.pi / 2)
    m = pendulum(0.4, 1.5, 0.35, 0.0, speed=30.0, loads=(spring,), effects=("inertia",))
    simulation = simulate(m, 4.0, tolerance=1e-10)
    t, w = np.linspace(0.0, 4.0, 41), np.sqrt(5.0)
    got = simulation(t)[0][:, 0] + np.pi / 2
    return _outcome(
        simulation, f"winds up {np.abs(got).max() / (2 * np.pi):.4g} turns", [compare("angle", got, 30.0 / w * np.sin(w * t), 1e-8)]
    )


def _equilibrium() -> Outcome:
    simulation = simulate(pendulum(0.4, 1.5, 0.35, np.pi), 1.0, tolerance=1e-10)
    return _outcome(simulation, "stays on top", [compare("angle", simulation([1.0])[0][0, 0] + np.pi / 2, np.pi, 1e-9)], drift=None)


def _step_load() -> Outcome:
    """A torque that is switched on at 1 s: speed M (t - 1) / J after it; the jump is located exactly."""
    push = Torque(name="push", link="body", moment=2.0, factor=Factor(function=lambda t: (np.asarray(t) > 1.0) * 1.0, of="time"))
    m = pendulum(0.4, 0.0, 0.0, 0.0, loads=(push,), effects=("inertia",))
    simulation = simulate(m, 3.0, tolerance=1e-9)
    t = np.linspace(0.0, 3.0, 61)
    want = np.where(t > 1.0, 2.0 * (t - 1.0) / 0.4, 0.0)
    return _outcome(
        simulation,
        f"{simulation([3.0])[1][0, 0]:.10g} rad/s after 3 s",
        [compare("speed", simulation(t)[1][:, 0], want, 1e-7)],
        drift=1e-6,
    )


def _no_mass() -> Outcome:
    bare = pendulum(0.4, 1.5, 0.35, 1.0)
    light = replace(bare, links=(bare.links[0], replace(bare.links[1], mass=0.0, inertia=0.0)))
    return refusal_outcome(lambda: simulate(light, 1.0), "moves no mass", "Give a mass")


CASES = (
    Case(
        "P3 squeezer to 1e-11",
        "dynamics",
        "Andrews' squeezing mechanism, 0.03 s",
        "all seven angles in 36 digits",
        lambda: _squeezer("auto", 1e-11, 1e-11),
        "MuJoCo, exudyn, Drake never reach 1e-10",
    ),
    Case(
        "P3 squeezer, stepped",
        "dynamics",
        "the same by collocation in time",
        "all seven angles in 36 digits",
        lambda: _squeezer("gauss", 1e-9, 1e-8),
        "Drake never reaches 1e-6",
    ),
    Case(
        "P4 chain, N = 1",
        "dynamics",
        "through the singular position ten times",
        "Jacobi's amplitude",
        lambda: _chain(1),
        "MuJoCo 1.9 rad, exudyn's energy x 7584",
    ),
    Case(
        "P4 chain, N = 2",
        "dynamics",
        "two parallelograms flat at once",
        "Jacobi's amplitude",
        lambda: _chain(2),
        "Pinocchio + DOP853: wrong branch",
    ),
    Case(
        "P4 chain, N = 2, stepped",
        "dynamics",
        "the same by collocation in time",
        "Jacobi's amplitude",
        lambda: _chain(2, "gauss"),
        "exudyn's energy x 612",
    ),
    Case(
        "P4 chain, N = 10",
        "dynamics",
        "ten parallelograms flat at once",
        "Jacobi's amplitude",
        lambda: _chain(10),
        "Pinocchio + DOP853 1e-2, MuJoCo 0.1",
    ),
    Case(
        "P4 chain, N = 40", "dynamics", "forty parallelograms flat at once", "Jacobi's amplitude", lambda: _chain(40), "MuJoCo 2e-2"
    ),
    Case(
        "released near the top",
        "dynamics",
        "0.1 degree from an unstable equilibrium: errors grow ten thousandfold",
        "elliptic functions",
        _near_the_top,
    ),
    Case("a thousand swings", "dynamics", "errors of the period add up", "at the bottom after 1000.25 periods", _many_swings),
    Case(
        "triple rocker", "dynamics", "every coordinate has dead points", "kinetic and potential energy of the links", _triple_rocker
    ),
    Case("start in a dead point", "dynamics", "the stated coordinate cannot start", "refused in words", _start_in_a_dead_point),
    Case("bouncing comes to rest", "dynamics", "infinitely many impacts in finite time", "each half as fast; then contact", _zeno),
    Case("stiff oil", "dynamics", "time constants 1e-5 s and 8000 s", "creeping by hand", _stiff),
    Case(
        "chaos for 3 s", "dynamics", "a double pendulum parts from its neighbours", "Lagrange's equations by hand, DOP853", _chaos
    ),
    Case("there and back", "dynamics", "time reversed", "the start again", _there_and_back),
    Case("impact on a knee", "dynamics", "the impulse spreads over both links", "momentum and energy stay", _knee),
    Case("resting until released", "dynamics", "a stop holds until the load turns", "released at pi seconds", _release),
    Case("end at a value", "dynamics", "the motion ends where a value is passed", "quarter of a period by K(k)", _watch),
    Case("winding up", "dynamics", "a spring that does not repeat with the turn", "harmonic oscillation", _winding),
    Case("balanced on top", "dynamics", "an unstable equilibrium at rest", "it stays", _equilibrium),
    Case("a torque switched on", "dynamics", "the equations jump in time", "speed by hand", _step_load),
    Case("no mass", "dynamics", "a free coordinate that moves nothing", "refused in words", _no_mass),
)
