"""Motion under forces by a compiled program: the same as by numpy, to rounding, and in balance by itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from dynamic_mechanisms import chain, damped_squeezer, double_pendulum, swinging_five_bar
from dynamic_mechanisms import pendulum as swung
from mechanisms import case
from random_mechanisms import draw
from scipy.special import ellipk

from mechcore import spec as sp
from mechcore.arrays import Real
from mechcore.compiled.collocation import WindowTrial
from mechcore.compiled.toolchain import compiler
from mechcore.constants import TURN
from mechcore.dynamics.equations import curve
from mechcore.dynamics.equations.charts import Chart
from mechcore.dynamics.equations.contacts import missing_in_c
from mechcore.dynamics.equations.curve import CurveEquations
from mechcore.dynamics.equations.program import compiled_program
from mechcore.dynamics.equations.reduced import motion_at, reduce
from mechcore.dynamics.integration.collocation import Window, gauss
from mechcore.dynamics.simulate import simulate
from mechcore.effects.registry import effects_of
from mechcore.errors import MechanismError
from mechcore.laws.timed import Free, Oscillation, Table
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Polynomial
from mechcore.spec.mechanism import Drive, Mechanism
from mechviz.scene.scene import load

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

FACTORS = {
    "straight": sp.Factor(function=Table((-0.3, 0.1, 0.4, 0.9), (1.0, -2.0, 0.5, 3.0), smooth=False)),
    "smooth, periodic": sp.Factor(function=Table((0.0, 0.3, 0.5), (1.0, -2.0, 0.5), period=0.7)),
    "spline of a place": sp.Factor(
        function=Table((0.32, 0.4, 0.45, 0.48), (0.0, 1.0, 0.5, 2.0), smooth="spline"), of="x", point=("rod", "P")
    ),
    "of the time": sp.Factor(function=Table((0.0, 0.3, 1.0), (1.0, 2.0, -1.0)), of="time"),
    "polynomial": sp.Factor(function=Polynomial((0.5, 0.1, -0.2), per=2.0), of="velocity"),
    "of Python": sp.Factor(function=lambda w: np.where(w > 2.1, np.tanh(w), 0.3 * w), of="velocity"),
}
RANDOM = (("four-bar", 2), ("slider-crank", 7), ("several drives", 1), ("belt", 0), ("cam", 2))


def damped() -> Mechanism:
    return damped_squeezer(case("andrews", "andrews-squeezer")["inputs"])


def pendulum() -> Mechanism:
    return double_pendulum(case("dynamics", "double-pendulum-physical")["inputs"])


def driven() -> Mechanism:
    """One arm of a five-bar follows a law, the other one is free and hangs on springs."""
    m = swinging_five_bar()
    prescribed = Drive(joint="A", law=Oscillation(2.2, 0.3, 0.8, 0.0))
    spring = sp.TorsionSpring(name="rods", links=("left rod", "right rod"), stiffness=0.05, free_angle=2.5)
    return replace(m, drives=(prescribed, m.drives[1]), loads=(*m.loads, spring))


def slider_crank_of(crank: float, rod: float) -> Mechanism:
    return sp.Mechanism(
        name="slider-crank",
        frame="frame",
        links=(
            sp.Link(name="frame", points={"O": (0.0, 0.0)}),
            sp.Link(name="crank", points={"O": (0.0, 0.0), "A": (crank, 0.0)}, mass=1.0, centre=(0.02, 0.01), inertia=0.01),
            sp.Link(name="rod", points={"A": (0.0, 0.0), "P": (rod, 0.0)}, mass=0.5, centre=(0.2, 0.0), inertia=0.005),
            sp.Link(name="piston", points={"P": (0.0, 0.0)}, mass=0.7),
        ),
        joints=(
            sp.Revolute(name="O", links=("frame", "crank"), points=("O", "O")),
            sp.Revolute(name="A", links=("crank", "rod"), points=("A", "A")),
            sp.Revolute(name="P", links=("rod", "piston"), points=("P", "P")),
            sp.Prismatic(name="S", links=("frame", "piston"), points=("O", "P")),
        ),
        drives=(Drive(joint="O", law=Free(0.2, 3.0)),),
        effects=("inertia", "gravity"),
        modes={"S": "ahead"},
    )


def pushed() -> Mechanism:
    """A slider-crank under torques by tables, in whose points its windows end."""
    loads = tuple(sp.Torque(name=k, link="crank", moment=2.0, factor=FACTORS[k]) for k in ("straight", "smooth, periodic"))
    return replace(slider_crank_of(0.1, 0.4), loads=loads)


def turned_cam() -> Mechanism:
    """A cam whose law's acceleration jumps, free to turn against a damper, lifts a follower on a spring."""
    m = load("cam-constant-acceleration-smooth").mechanism
    turning = replace(m.links[1], mass=1.0, inertia=2e-3)
    damper = sp.TorsionDamper(name="bearing", links=(turning.name, m.frame), coefficient=0.01)
    free = Drive(joint=m.drives[0].joint, law=Free(0.3, 20.0))
    return replace(m, links=(m.links[0], turning, *m.links[2:]), drives=(free,), loads=(*m.loads, damper))


def servo() -> Mechanism:
    """An arm held at a path by servos, whose integrals are states."""
    return load("servo-arm").mechanism


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("made", "duration"),
    [(damped, 0.02), (pendulum, 1.0), (swinging_five_bar, 0.5), (driven, 0.5), (servo, 0.5), (pushed, 0.6)],
)
def test_motions_are_the_same(made, duration: float) -> None:
    compiled = compile_mechanism(made())
    assert missing_in_c(compiled) is None
    by_numpy, by_c = (simulate(replace(compiled, executor=e), duration, tolerance=1e-9) for e in ("numpy", "c"))
    t = np.linspace(0.0, duration, 21)
    for a, b in zip(by_numpy(t), by_c(t), strict=True):
        assert np.abs(a - b).max() < 1e-11 * np.abs(a).max()
    assert [len(s.solution.windows) for s in by_numpy.segments] == [len(s.solution.windows) for s in by_c.segments]
    assert np.abs(by_c.drift(t)).max() < 1e-9  # work and energy by the kinetostatic core


@pytest.mark.parametrize(
    ("made", "most"),
    [(partial(chain, 3), 0), (partial(slider_crank_of, 0.1, 0.4), curve.EQUAL_PANELS + 1)],
    ids=["through flat positions", "nowhere flat"],
)
def test_tables_of_a_turn_are_the_same(made: Callable[[], Mechanism], most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """J and the reduced force over a turn; of numpy no more positions are asked than where it looks for flat ones."""
    compiled = compile_mechanism(made())
    asked: list[int] = []
    unit = curve._unit
    monkeypatch.setattr(curve, "_unit", lambda c, q: [asked.append(c.executor == "c" and len(q)), unit(c, q)][1])
    by_numpy, by_c = (curve.whole_turn(replace(compiled, executor=e), 0.2) for e in ("numpy", "c"))
    assert by_numpy is not None and by_c is not None and by_c.conservative
    q = np.linspace(0.2, 0.2 + TURN, 301)
    np.testing.assert_allclose(by_c.table(q), by_numpy.table(q), rtol=0, atol=1e-12 * np.abs(by_numpy.table(q)).max())
    assert sum(asked) <= most


@pytest.mark.parametrize("speed", [8.0, -9.0, 7.6])
def test_a_pendulum_goes_round_by_its_energy(speed: float) -> None:
    """A uniform rod of a metre from its lowest place, w^2 = 3 g / 2: beyond 2 w = 7.67 rounds take (4 / v) K(2 w / v), below swings
    (4 / w) K(v / 2 w); between them numpy says where it is."""
    w = np.sqrt(1.5 * 9.81)
    goes_round, share = abs(speed) > 2.0 * w, (2.0 * w / speed) ** 2
    period = 4.0 / abs(speed) * ellipk(share) if goes_round else 4.0 / w * ellipk(1.0 / share)
    compiled = compile_mechanism(swung(inertia=1.0, mass=3.0, distance=0.5, angle=0.0, speed=speed))
    by_numpy, by_c = (simulate(replace(compiled, executor=e), 2.5 * period, method="energy") for e in ("numpy", "c"))
    turns = np.arange(3.0)
    there = by_c(turns * period)[0][:, 0] - by_c([0.0])[0][0]
    np.testing.assert_allclose(there, np.sign(speed) * TURN * turns * goes_round, atol=1e-11)
    t = np.linspace(0.0, 2.5 * period, 200)
    for a, b in zip(by_numpy(t), by_c(t), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-10)


def test_a_camshaft_is_turned_by_forces() -> None:
    """Windows end at the knots of the cam's law, which the program finds, so that the energy balance holds beyond them."""
    compiled, t = compile_mechanism(turned_cam()), np.linspace(0.0, 0.6, 31)
    by_numpy, by_c = (simulate(replace(compiled, executor=e), 0.6, tolerance=1e-9) for e in ("numpy", "c"))
    assert sum(w.cut for w in by_c.segments[0].solution.windows) >= 3
    assert np.abs(by_c.drift(t)).max() < 1e-10
    np.testing.assert_allclose(by_c(t)[0], by_numpy(t)[0], rtol=1e-10)


def test_a_table_is_made_only_where_a_coordinate_leads_no_longer() -> None:
    """A piston drives a crank round: the program leads it without a table, until the crank has to take over at a dead point."""
    m = slider_crank_of(0.1, 0.4)
    at = solve_motion(compile_mechanism(m), np.zeros(1), drives={"O": (np.array([1.0]), np.array([20.0]), np.array([0.0]))})
    start, speed, _ = (float(x) for x in at.coordinate("S")[0])
    damper = sp.TorsionDamper(name="damper", links=("crank", "frame"), coefficient=0.05)
    sketch = {link.name: tuple(at.pose(link.name)[0]) for link in m.links[1:]}
    led = replace(m, drives=(Drive(joint="S", law=Free(start, speed)),), loads=(damper,), modes={}, sketch=sketch)
    by_numpy, by_c = (simulate(compile_mechanism(led, executor=e), 0.3, tolerance=1e-9) for e in ("numpy", "c"))
    assert [(type(s.system), s.independent) for s in by_c.segments] == [(Chart, ["S"]), (CurveEquations, ["O"])]
    assert [s.independent for s in by_numpy.segments] == [["S"], ["O"]]
    for a, b in zip(by_numpy([0.3]), by_c([0.3]), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8)


@pytest.mark.thorough
def test_groups_by_newton_and_turns_that_links_have_gone_are_followed() -> None:
    """A group of class III leads; then another joint takes over, whose coordinate a link with a spring has left by a turn."""
    m = draw("triad", 11, forces=True, friction=False).mechanism
    by_numpy, by_c = (simulate(compile_mechanism(m, executor=e), 0.2, tolerance=1e-7) for e in ("numpy", "c"))
    assert [s.independent for s in by_c.segments] == [["R0"], ["R6"]]
    assert compiled_program(by_c.segments[0].system.compiled).followed[0] == ("angle", 1)
    np.testing.assert_allclose(by_c([0.07, 0.2])[1], by_numpy([0.07, 0.2])[1], rtol=1e-7)


@pytest.mark.parametrize("made", [damped, swinging_five_bar, driven, servo, turned_cam])
def test_reduced_equations_are_the_same(made) -> None:
    compiled = compile_mechanism(made(), executor="c")
    laws = [d.law for d in compiled.mechanism.drives if isinstance(d.law, Free)]
    places = np.array([[float(law(0.0)[0]) for law in laws]]) + np.array([[0.0], [1e-3], [-2e-3]])
    rates, times = np.full(places.shape, 0.7), np.full(3, 0.1)
    program = compiled.cached(compiled_program)
    assert program is not None
    inertia, force = program.reduced(places, rates, times)
    wanted = reduce(compiled, places, rates, times)
    np.testing.assert_allclose(inertia, wanted.inertia, rtol=1e-12)
    np.testing.assert_allclose(force, wanted.force - wanted.bias, rtol=1e-10, atol=1e-12 * np.abs(force).max())


@pytest.mark.parametrize("nodes", [1, 2, 7])
def test_the_end_of_a_window_is_that_of_its_polynomials(nodes: int) -> None:
    rng = np.random.default_rng(nodes)
    window = Window(0.3, 0.2, rng.random(3), rng.random(3), rng.random((nodes, 3)))
    q, v, _ = window(np.array([0.5]))
    for computed, wanted in zip(window.end(), (q[0], v[0]), strict=True):
        np.testing.assert_allclose(computed, wanted, rtol=1e-13)


@pytest.mark.parametrize("executor", ["numpy", "c"])
def test_vibrations_that_nobody_waits_for_are_refused(executor: str) -> None:
    """A program that sees at once that none is fast must not overlook one that is."""
    stiff = swinging_five_bar(stiffness=1e9, speeds=(0.1, 0.1))
    with pytest.raises(MechanismError, match=r"is the fastest vibration, of spring '(left|right) spring'"):
        simulate(compile_mechanism(stiff, executor=executor), 60.0, method="gauss")


def test_numpy_leads_through_change_points() -> None:
    """Four-bars in a row, damped, fold flat and go on: C has each side, with the modes that hold there, numpy what lies between."""
    m = chain(2)
    moving = m.links[1].name
    damped_chain = replace(m, loads=(*m.loads, sp.TorsionDamper(name="damper", links=(moving, m.frame), coefficient=0.4)))
    compiled = compile_mechanism(damped_chain)
    program = compiled_program(compiled)
    assert program is not None and program.partial
    flat = compiled.start[0] + compiled.singular_points.points[0].time

    def solved(q: float) -> tuple[Real, int] | None:
        return program.window(gauss(7), WindowTrial(0.0, 1e-3, np.array([q]), np.ones(1), np.zeros((7, 1)), 1e-12))

    assert solved(flat) is None and solved(flat + 0.01) is None
    assert solved(flat + 0.2) is not None
    t = np.linspace(0.0, 4.0, 33)
    (q, v, _), (p, w, _) = (simulate(replace(compiled, executor=e), 4.0, method="gauss")(t) for e in ("numpy", "c"))
    assert q.min() < -0.5 < 0.5 < q.max()  # flat at 0
    np.testing.assert_allclose(p, q, atol=1e-8)
    np.testing.assert_allclose(w, v, atol=1e-7)


@pytest.mark.parametrize(("kind", "seed"), RANDOM)
def test_accelerations_are_the_same(kind: str, seed: int) -> None:
    computed = draw(kind, seed, forces=True).mechanism
    compiled = compile_mechanism(computed)
    program = compiled_program(compiled)
    assert program is not None, missing_in_c(compiled)
    start = np.array([[float(d.law(0.0)[k]) for d in computed.drives] for k in (0, 1)])
    steps = np.linspace(0.0, 1.0, 7)[:, None]
    q, v, t = start[0] + 0.02 * steps, start[1] * (1.0 + steps), 0.01 * steps[:, 0]
    expected = Chart(compiled)(q, v, t)
    assert np.abs(program(q, v, t) - expected).max() < 1e-11 * np.abs(expected).max()


def test_factors_are_the_same() -> None:
    """Within their borders and beyond, at both sides of every bend."""
    loads = tuple(sp.Torque(name=name, link="crank", moment=2.0, factor=factor) for name, factor in FACTORS.items())
    compiled = compile_mechanism(replace(slider_crank_of(0.1, 0.4), loads=loads))
    program = compiled_program(compiled)
    assert program is not None, missing_in_c(compiled)
    q = np.linspace(-2.0, 4.0, 241)[:, None]
    v, t = np.linspace(1.0, 4.0, 241)[:, None], np.linspace(-0.1, 1.4, 241)
    expected = Chart(compiled)(q, v, t)
    assert np.abs(program(q, v, t) - expected).max() < 1e-12 * np.abs(expected).max()
    bent = [e for e in effects_of(compiled.mechanism) if e.piecewise]
    phases = np.array([e.phase(motion_at(compiled, q, v, t)) for e in bent])
    assert len(bent) == 3 and np.ptp(phases, axis=1).min() >= 2
    np.testing.assert_array_equal(program.forms(q, v, t), phases)


def test_a_stiff_motion_takes_the_same_windows() -> None:
    """By Radau's nodes, whose matrices are the program's only other input."""
    compiled = compile_mechanism(damped())
    ends = [simulate(replace(compiled, executor=e), 0.01, method="radau")([0.01])[0] for e in ("numpy", "c")]
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-11)


def test_auto_goes_on_in_c_where_many_windows_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    from mechcore.dynamics.integration import windows

    compiled = compile_mechanism(pendulum(), executor="auto")
    asked = []
    monkeypatch.setattr("mechcore.dynamics.equations.program.compiled_program", lambda c: asked.append(c))
    simulate(compiled, 2.0)
    assert not asked
    monkeypatch.setattr(windows, "MANY_WINDOWS", 3)
    simulate(compiled, 2.0)
    assert len(asked) == 1
