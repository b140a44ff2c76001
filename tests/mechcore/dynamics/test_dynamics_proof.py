"""What forward dynamics promises: its order, its tolerance, conservation, reversal, and places where integrators fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import examples
from dynamic_mechanisms import chain, double_pendulum, pendulum, slider_crank, swinging_five_bar
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mechanisms import case
from scipy.special import ellipk
from scipy_check import cross_check

import mechviz
from mechcore.compiled.collocation import WindowTrial
from mechcore.dynamics.equations.charts import Chart
from mechcore.dynamics.events import EndStop
from mechcore.dynamics.integration.collocation import Window, gauss, radau, solve_window
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import Free
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Factor, Force, Torque
from mechcore.spec.mechanism import Drive, Link, Mechanism, Prismatic, Revolute
from mechviz.hard_cases.mechanisms import bars
from mechviz.runs import run_scene

# --- order of the method ----------------------------------------------------------------------------------------------


def four_bar() -> Mechanism:
    return bars(frame=1.0, crank=0.3, coupler=0.9, rocker=0.7, angle=0.5, speed=0.0)


def crank_slider() -> Mechanism:
    return slider_crank({**case("dynamics", "forward-slider-crank")["inputs"], "torque": 0.0})


MANUFACTURED = {"four-bar": four_bar, "slider-crank": crank_slider, "five-bar": swinging_five_bar}


class Wanted:
    """q = start + rate t + size sin(w t + phase) of a drive."""

    duration, breaks = 1.0, ()

    def __init__(self, start: float, k: int):
        self.start, self.phase = start, 0.4 + k

    def __call__(self, t):
        t, w, size = np.asarray(t, float), 4.0, 0.25
        s, c = np.sin(w * t + self.phase), np.cos(w * t + self.phase)
        begin = self.start - size * np.sin(self.phase)
        return begin + 0.3 * t + size * s, 0.3 + w * size * c, -(w**2) * size * s


def manufactured(name: str) -> tuple[Mechanism, list[Wanted]]:
    """The mechanism under the torques that a wanted motion needs, by kinetostatics, as functions of time alone."""
    body = MANUFACTURED[name]()
    laws = [Wanted(d.law.start, k) for k, d in enumerate(body.drives)]
    driven = compile_mechanism(
        replace(body, drives=tuple(Drive(joint=d.joint, law=w) for d, w in zip(body.drives, laws, strict=True)))
    )
    known: dict[bytes, dict[str, np.ndarray]] = {}

    def efforts(t: np.ndarray) -> dict[str, np.ndarray]:
        if t.tobytes() not in known:
            forces = solve_forces(solve_motion(driven, t, drives={d.joint: w(t) for d, w in zip(body.drives, laws, strict=True)}))
            known[t.tobytes()] = {d.joint: forces.effort(d.joint) for d in body.drives}
        return known[t.tobytes()]

    def torque(joint: str) -> Torque:
        (link,) = (k for p in body.joints if p.name == joint for k in p.links if k != body.frame)
        factor = Factor(function=lambda t: efforts(np.atleast_1d(np.asarray(t, float)))[joint], of="time")
        return Torque(name=f"wanted {joint}", link=link, moment=1.0, factor=factor)

    free = tuple(Drive(joint=d.joint, law=Free(float(w(0.0)[0]), float(w(0.0)[1]))) for d, w in zip(body.drives, laws, strict=True))
    loads = tuple(load for load in body.loads if load.name != "torque")
    return replace(body, drives=free, loads=(*loads, *(torque(d.joint) for d in body.drives))), laws


def end_of(mechanism: Mechanism, rule, windows: int, span: float) -> np.ndarray:
    system = Chart(compile_mechanism(mechanism))
    q, v = (np.array([float(d.law(0.0)[k]) for d in mechanism.drives]) for k in (0, 1))
    h, s = span / windows, len(rule.nodes)
    for k in range(windows):
        solved = solve_window(rule, system, WindowTrial(k * h, h, q, v, np.zeros((s, len(q))), 1e-15))
        assert solved is not None
        window = Window(k * h, h, q, v, rule.legendre @ solved[0])
        q, v = (x[0] for x in window(np.array([(k + 1) * h]))[:2])
    return q


@pytest.mark.sample(8)
@pytest.mark.parametrize("name", MANUFACTURED)
@pytest.mark.parametrize(
    ("rule", "nodes", "windows", "span"),
    [(gauss, 2, 12, 0.5), (gauss, 3, 8, 0.5), (gauss, 4, 16, 1.5), (radau, 2, 16, 0.5), (radau, 3, 10, 0.5)],
)
def test_manufactured_motion_is_approached_in_the_nominal_order(name: str, rule, nodes: int, windows: int, span: float):
    mechanism, laws = manufactured(name)
    exact = np.array([float(w(span)[0]) for w in laws])
    errors = [float(np.abs(end_of(mechanism, rule(nodes), n, span) - exact).max()) for n in (windows, 2 * windows)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(rule(nodes).order, abs=0.25)


@pytest.mark.parametrize("name", MANUFACTURED)
def test_manufactured_motion_is_met_to_rounding(name: str):
    mechanism, laws = manufactured(name)
    exact = np.array([float(w(0.5)[0]) for w in laws])
    assert end_of(mechanism, gauss(10), 4, 0.5) == pytest.approx(exact, abs=2e-13)
    assert end_of(mechanism, radau(9), 4, 0.5) == pytest.approx(exact, abs=2e-13)


# --- tolerance --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["double pendulum", "five-bar"])
def test_error_is_proportional_to_the_tolerance_over_five_decades(name: str):
    body = double_pendulum(case("dynamics", "double-pendulum-rods")["inputs"]) if name != "five-bar" else swinging_five_bar()
    compiled = compile_mechanism(body)
    exact = simulate(compiled, 1.0, tolerance=1e-13)([1.0])[0][0]
    tolerances = np.array([1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
    errors = np.array([np.abs(simulate(compiled, 1.0, tolerance=t)([1.0])[0][0] - exact).max() for t in tolerances])
    slope = np.polyfit(np.log10(tolerances), np.log10(errors + 1e-14), 1)[0]
    assert 0.7 < slope < 2.0
    assert np.all(errors < 20.0 * tolerances)


@pytest.mark.parametrize("method", ["DOP853", "Radau", "LSODA"])
def test_scipy_finds_the_same_motion_from_the_same_equations(method: str):
    body = swinging_five_bar()
    loose = {"Radau": 1e-7, "LSODA": 1e-9}.get(method, 1e-10)
    assert cross_check(simulate(body, 0.2, tolerance=1e-11), method=method, tolerance=loose) < 30.0 * loose


def test_scipy_agrees_between_impacts_and_releases():
    body = pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=1.2)
    stop = EndStop(name="wall", joint="O", at=-np.pi / 2, side="lower", restitution=0.5)
    simulation = simulate(body, 1.5, stops=[stop], tolerance=1e-11)
    assert len(simulation.segments) > 2 and cross_check(simulation) < 1e-8


# --- conservation -----------------------------------------------------------------------------------------------------


@settings(max_examples=examples(12))
@given(st.floats(0.2, 0.5), st.floats(0.8, 1.4), st.floats(0.8, 1.4), st.floats(-3.0, 3.0), st.floats(-8.0, 8.0))
def test_four_bars_keep_their_energy_and_come_back_when_time_is_reversed(crank, coupler, rocker, angle, speed):
    assume(abs(coupler - rocker) < 1.0 - crank)  # else the links miss each other
    body = bars(frame=1.0, crank=crank, coupler=coupler, rocker=rocker, angle=angle, speed=speed)
    there = simulate(body, 1.0, tolerance=1e-11, method="gauss")
    assert np.abs(there.drift(np.linspace(0.0, 1.0, 11))).max() < 1e-9
    q, v, _ = (float(x[0, 0]) for x in there([1.0]))
    turned = replace(body, drives=(Drive(joint="A", law=Free(q, -v)),), modes={}, sketch=poses(there))
    back = simulate(turned, 1.0, tolerance=1e-11, method="gauss")([1.0])
    assert back[0][0, 0] == pytest.approx(angle, abs=1e-7) and -back[1][0, 0] == pytest.approx(speed, abs=1e-6)


def poses(simulation) -> dict[str, tuple[float, float, float]]:
    motion = simulation.motion([1.0])
    return {k: tuple(float(x) for x in motion.pose(k)[0]) for k in motion.model.links[1:]}


@settings(max_examples=examples(12))
@given(
    st.floats(0.1, 20.0),
    st.floats(0.1, 20.0),
    st.floats(0.2, 2.0),
    st.floats(-3.0, 3.0),
    st.floats(-2.0, 2.0),
    st.floats(-4.0, 4.0),
)
def test_a_pendulum_on_a_cart_keeps_its_momentum_along_the_rail(cart, bob, length, angle, speed, spin):
    """Nothing acts along the rail: m v_cart + m v_bob stays; and with it the mean motion of the centre of mass."""
    body = Mechanism(
        name="cart",
        frame="frame",
        links=(
            Link(name="frame", points={"G": (0.0, 0.0)}),
            Link(name="cart", points={"P": (0.0, 0.0)}, mass=cart),
            Link(name="bob", points={"P": (0.0, 0.0)}, mass=bob, centre=(length, 0.0), inertia=0.1 * bob * length**2),
        ),
        joints=(
            Prismatic(name="S", links=("frame", "cart"), points=("G", "P")),
            Revolute(name="P", links=("cart", "bob"), points=("P", "P")),
        ),
        drives=(Drive(joint="S", law=Free(0.0, speed)), Drive(joint="P", law=Free(angle, spin))),
        effects=("inertia", "gravity"),
    )
    simulation = simulate(body, 1.0, tolerance=1e-11)
    motion = simulation.motion(np.linspace(0.0, 1.0, 13))
    momentum = cart * motion.centre_of_mass("cart", 1)[:, 0] + bob * motion.centre_of_mass("bob", 1)[:, 0]
    size = np.abs(bob * motion.centre_of_mass("bob", 1)).max() + abs(momentum[0])
    assert np.ptp(momentum) < 1e-9 * size
    assert np.abs(simulation.drift(motion.time)).max() < 1e-8


# --- hard places ------------------------------------------------------------------------------------------------------


def test_at_rest_on_a_dead_point_it_stays_and_says_why():
    """A force along the guide has no arm at the dead centre; a little beside, it has."""
    i = case("dynamics", "forward-slider-crank")["inputs"]
    body = slider_crank({**i, "torque": 0.0, "theta_1_0": 0.0, "omega_1_0": 0.0, "e": 0.0})
    push = Force(name="push", link="slider", point="C", vector=(-50.0, 0.0))
    level = [replace(k, centre=(k.centre[0], 0.0)) if k.centre else k for k in body.links]
    body = replace(body, links=tuple(level), loads=(push,), effects=("inertia",))
    simulation = simulate(body, 2.0)
    assert simulation([2.0])[0][0, 0] == 0.0
    (word,) = simulation.events
    assert word.kind == "equilibrium" and "no arm" in word.text
    beside = simulate(replace(body, drives=(Drive(joint="O", law=Free(1e-3)),)), 2.0)
    assert not beside.events and abs(np.ptp(beside(np.linspace(0, 2, 50))[0])) > 1.0


def parallelogram(coupler: float, *, gravity: bool, speed: float, angle: float = 0.5) -> Mechanism:
    body = bars(frame=1.0, crank=0.4, coupler=1.0, rocker=0.4, angle=angle, speed=speed)
    links = [replace(k, mass=coupler, inertia=coupler / 12.0) if k.name == "coupler" else k for k in body.links]
    sketch = {"crank": (0.0, 0.0, angle), "coupler": (0.4 * np.cos(angle), 0.4 * np.sin(angle), 0.0), "rocker": (1.0, 0.0, angle)}
    effects = ("inertia", "gravity") if gravity else ("inertia",)
    return replace(body, links=tuple(links), effects=effects, modes={}, sketch=sketch)


@pytest.mark.parametrize("method", ["energy", "gauss"])
def test_a_parallelogram_with_inertia_runs_evenly_through_its_change_points(method: str):
    simulation = simulate(parallelogram(3.0, gravity=False, speed=7.0), 10.0, method=method, tolerance=1e-10)
    q, v, _ = simulation(np.linspace(0.0, 10.0, 101))
    assert q[:, 0] == pytest.approx(0.5 + 7.0 * np.linspace(0.0, 10.0, 101), abs=1e-8)
    assert v[:, 0] == pytest.approx(7.0, rel=1e-10)


@pytest.mark.parametrize("coupler", [1e-15, 1e-9, 1.0, 1e9])
def test_nearly_massless_links_and_mass_ratios_of_1e9(coupler: float):
    """A parallelogram is a pendulum: J = 2 m l^2 / 3 + M l^2, weight (m + M) l; its period from rest at 90 degrees by K."""
    m, length, g = 0.4, 0.4, 9.81
    inertia, weight = 2.0 * m * length**2 / 3.0 + coupler * length**2, (m + coupler) * g * length
    period = 4.0 * np.sqrt(inertia / weight) * ellipk(np.sin(np.pi / 4) ** 2)
    for method in ("energy", "gauss"):
        simulation = simulate(parallelogram(coupler, gravity=True, speed=0.0, angle=0.0), period, method=method, tolerance=1e-11)
        half, whole = (float(x) for x in simulation([0.5 * period, period])[0][:, 0])
        assert half == pytest.approx(-np.pi, abs=1e-7) and whole == pytest.approx(0.0, abs=1e-7)
        assert np.abs(simulation.drift(np.linspace(0.0, period, 9))).max() < 1e-9


@pytest.mark.parametrize("beyond", [-1e-6, -1e-12, 0.0, 1e-12, 1e-6])
def test_a_stop_at_the_very_place_where_the_swing_turns_back(beyond: float):
    """Grazing: touched with no speed or hardly any; the swing goes on, no energy to speak of is lost, and nothing loops."""
    body = pendulum(inertia=0.4, mass=1.5, distance=0.35, angle=1.0)
    stop = EndStop(name="wall", joint="O", at=-1.0 - np.pi / 2 + beyond, side="lower", restitution=0.3)
    simulation = simulate(body, 5.0, stops=[stop], tolerance=1e-11)
    assert len(simulation.events) < 12
    free = simulate(body, 5.0, tolerance=1e-11)
    assert simulation([5.0])[0][0, 0] == pytest.approx(free([5.0])[0][0, 0], abs=1e-4 + 5.0 * np.sqrt(max(beyond, 0.0)))
    assert np.abs(simulation.drift(np.linspace(0.0, 5.0, 20))).max() < 1e-8


def test_ten_thousand_turns_do_not_drift():
    """A slider-crank that spins freely: after 10,000 of its own periods it has made 10,000 turns, with the speed of the start."""
    i = case("dynamics", "forward-slider-crank")["inputs"]
    body = replace(slider_crank({**i, "torque": 0.0, "omega_1_0": 20.0}), effects=("inertia",), loads=())
    once = simulate(body, 2.0)
    at, rate = once([0.0])[0][0, 0], once([0.0])[1][0, 0]
    low, high = 0.1, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if once([middle])[0][0, 0] < at + 2 * np.pi else (low, middle)
    simulation = simulate(body, 10_000 * high)
    assert simulation.method == "energy"
    q, v, _ = simulation([10_000 * high])
    assert q[0, 0] - at == pytest.approx(10_000 * 2 * np.pi, rel=1e-11)
    assert v[0, 0] == pytest.approx(rate, rel=1e-7)
    t = np.linspace(0.0, 10_000 * high, 7)
    kinetic = simulation.kinetic_energy(t)
    assert np.ptp(kinetic) < 1e-10 * kinetic[0]


def test_chain_of_40_four_bars_keeps_its_energy_through_the_singular_position():
    simulation = simulate(chain(40), 10.0, tolerance=1e-9)
    assert np.pi / 2 - simulation([10.0])[0][0, 0] == pytest.approx(31.597433743985738, abs=1e-8)
    t = np.linspace(0.0, 10.0, 60)
    assert np.abs(simulation.drift(t)).max() < 1e-9
    assert simulation.kinetic_energy([0.0])[0] == pytest.approx(41 / 6 + 20.0, rel=1e-12)  # of 620.338... J with its height


# --- the balance with everything on -----------------------------------------------------------------------------------

EVERYTHING = """
title = "everything at once"
units = { length = "mm", angle = "deg" }
effects = ["inertia", "gravity", "friction"]
[run]
frames = 60
duration = "0.4 s"
tolerance = 1e-8
[friction]
coefficient = 0.08
radius = "6 mm"
[links]
frame = { points = { A = [0, 0], H = [-60, 90] } }
crank = { points = { A = [0, 0], B = [40, 0] }, mass = "3 kg", centre = [5, 3], inertia = "0.05 kg m^2" }
rod = { points = { B = [0, 0], C = [150, 0] }, mass = "0.9 kg", centre = [52, 4], inertia = "0.0031 kg m^2" }
piston = { points = { C = [0, 0] }, mass = "0.7 kg" }
[joints]
A = { revolute = ["frame", "crank"], free = { position = 20, speed = "120 rpm" }, friction = { brake = "0.3 N m" } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["A", "C"], along = [1, 0], branch = "ahead", friction = { length = "60 mm" } }
[watch]
back = { joint = "S", at = 150, rising = false }
[loads]
motor = { dc_motor = "A", stall_torque = "4 N m", no_load_speed = "200 rpm" }
oil = { viscous = "S", linear = "25 N s/m" }
spring = { spring = ["frame.H", "rod.C"], stiffness = "300 N/m", free_length = 120 }
damper = { damper = ["frame.H", "rod.C"], linear = "4 N s/m", quadratic = "2 N s^2/m^2" }
twist = { torsion_spring = ["crank", "rod"], stiffness = "0.05 N m/rad" }
film = { torsion_damper = ["crank", "rod"], linear = "0.01 N m s/rad" }
air = { drag = "rod.C", quadratic = "3 N s^2/m^2" }
fan = { drag = "crank", quadratic = "0.001 N m s^2/rad^2" }
push = { force = [-9, 2], on = "rod", at = "C", axes = "link" }
gas = { gas = "S", bore = 40, top = 190, stroke = 80, compressor = { suction = "1 bar", delivery = "3 bar" } }
"""


def test_the_energy_balance_closes_with_every_effect_on_through_every_event():
    run = run_scene(mechviz.loads(EVERYTHING))
    kinds = {h.kind for h in run.simulation.events}
    assert {"slip", "stick", "watch"} <= kinds
    energy = run.forces.energy
    size = np.abs(energy).max()
    assert np.ptp(energy[:, 0] + energy[:, 1] - energy[:, 2] + energy[:, 3]) < 20e-8 * size
    assert np.abs(run.simulation.drift(run.motion.time)).max() < 20e-8
    assert np.all(np.diff(energy[:, 3]) > -1e-8 * size) and energy[-1, 3] > 0.5 * size
    assert np.abs(run.forces.power_balance).max() < 1e-9


def test_the_energy_balance_closes_through_impacts_contact_and_release():
    text = EVERYTHING.replace('free = { position = 20, speed = "120 rpm" }', 'free = { position = 60, speed = "-300 rpm" }')
    text = text.replace('friction = { brake = "0.3 N m" } }', 'stops = [{ at = 30, side = "lower", restitution = 0.4 }] }')
    text = text.replace('effects = ["inertia", "gravity", "friction"]', 'effects = ["inertia", "gravity"]')
    text = text.replace('[friction]\\ncoefficient = 0.08\\nradius = "6 mm"\\n', "").replace(', friction = { length = "60 mm" }', "")
    text = "\n".join(line for line in text.splitlines() if not line.startswith("gas ="))
    text = text.replace('"4 N m", no_load_speed = "200 rpm"', '"-4 N m", no_load_speed = "-200 rpm"')  # onto the stop
    text = text.replace('duration = "0.4 s"', 'duration = "1.5 s"')
    run = run_scene(mechviz.loads(text))
    kinds = [h.kind for h in run.simulation.events]
    assert kinds.count("impact") >= 2 and "contact" in kinds
    energy = run.forces.energy
    assert np.ptp(energy[:, 0] + energy[:, 1] - energy[:, 2] + energy[:, 3]) < 20e-8 * np.abs(energy).max()
    assert np.abs(run.simulation.drift(run.motion.time)).max() < 20e-8


def test_a_gas_that_pushes_back_whichever_way_it_moves_is_told_not_followed_for_ever():
    """An indicator diagram in the middle of a stroke, and nothing that rubs: the crank would tremble on the spot."""
    text = EVERYTHING.replace('free = { position = 20, speed = "120 rpm" }', 'free = { position = 60, speed = "-300 rpm" }')
    text = text.replace(', friction = { brake = "0.3 N m" }', "").replace(', friction = { length = "60 mm" }', "")
    text = text.replace('[friction]\ncoefficient = 0.08\nradius = "6 mm"\n', "").replace('"gravity", "friction"]', '"gravity"]')
    with pytest.raises(MechanismError, match="pushes back whichever way the mechanism moves"):
        run_scene(mechviz.loads(text))
