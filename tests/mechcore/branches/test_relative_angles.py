"""Relative angles have one branch at the start pose and are continuous from there; nothing depends on the world's x axis.

What is compared with is computed apart: the geometry of the four-bar and the slider-crank by triangles, motions under forces in
absolute coordinates with multipliers (`second_formulation`), where every angle is a state of its own.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from second_formulation import Second
from wound_springs import AT_REST, FIVE_BAR, GEARED, SLIDER_CRANK, SPRING, STOPPED, TABLE, four_bar

from mechcore.dynamics.simulate import simulate
from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.mechanism import Drive, Gear, Link, Mechanism, Revolute
from mechviz.runs import run_scene
from mechviz.scene.scene import loads

INVERTED = """
units = { length = "m", angle = "deg", mass = "kg", inertia = "g cm^2" }
effects = ["inertia", "gravity"]
gravity = [-2.3005099314122837, -2.6095236567550177]
frame = "base"
run = { frames = 40, duration = 0.1541741293565704 }
[links.base]
points = { F0 = [0.14651539077583245, 0.17485623733267955], D3 = [0.041113528684752244, 0.024863651847573068] }
[links.gear]
points = { F0 = [-0.04531662318023681, 0.28608220125383843], P1x = [0.11906963785135366, 0.18270307194071062] }
mass = 1.096796010449766
centre = [0.10034767642718527, 0.11568055935708355]
inertia = 77733.31296718823
[links.lever]
points = { P1 = [-0.185566767860225, -0.04786040053985865], E2 = [0.019174490267473882, 0.050062991143768026] }
mass = 0.8219408470457228
centre = [-0.16700341806620392, 0.08268558027952547]
inertia = 89782.35955391423
[links.arm]
points = { E2 = [0.12274775026790574, -0.18160980176925967], D3g = [0.281224444773806, -0.17348803178867075] }
mass = 0.1900311232959736
centre = [0.3069637714419099, -0.30019247226003887]
inertia = 22169.939364843707
[joints]
E2 = { revolute = ["lever", "arm"] }
F0 = { revolute = ["gear", "base"], free = { position = 51.900753168489175, speed = "-1.2731712282828556 rad/s" } }
P1 = { revolute = ["lever", "gear"], at = ["P1", "P1x"] }
[joints.D3]
prismatic = ["base", "arm"]
at = ["D3", "D3g"]
along = [0.6514944999690653, -0.758653357278578]
guide = "arm"
angle = 2.9878706115950093
[loads]
spring = { torsion_spring = ["lever", "base"], stiffness = "2.93379757514422 N m/rad", free_angle = -20.526036570487857 }
[sketch]
gear = { at = [-0.050653519509971816, -0.037325390117506976], angle = -51.900753168489175 }
lever = { at = [-0.024908474146801265, -0.011010228479800334], angle = 163.359558317311 }
arm = { at = [-0.18966343899216956, 0.12147903063597734], angle = 2.9878706115950093 }
"""

TRIAD = """
units = { length = "mm", angle = "deg", mass = "kg", inertia = "kg mm^2" }
effects = ["inertia", "gravity"]
run = { frames = 30, duration = 0.45 }
[links]
frame = { points = { A = [0, 0], E = [300, 0], F = [150, 320] } }
c1 = { points = { A = [0, 0], B = [60, 0] }, mass = 0.5, centre = [30, 0], inertia = 400 }
c2 = { points = { E = [0, 0], D = [50, 0] }, mass = 0.5, centre = [25, 0], inertia = 400 }
b1 = { points = { B = [0, 0], P = [170, 0] }, mass = 0.2, centre = [85, 0], inertia = 500 }
b2 = { points = { D = [0, 0], Q = [170, 0] }, mass = 0.2, centre = [85, 0], inertia = 500 }
b3 = { points = { F = [0, 0], R = [150, 0] }, mass = 0.2, centre = [75, 0], inertia = 400 }
t = { points = { P = [0, 0], Q = [120, 0], R = [60, 70] }, mass = 0.3, centre = [60, 25], inertia = 600 }
[joints]
A = { revolute = ["frame", "c1"], free = { position = 40, speed = "200 rpm" } }
E = { revolute = ["frame", "c2"], free = { position = 120, speed = "-150 rpm" } }
B = { revolute = ["c1", "b1"] }
D = { revolute = ["c2", "b2"] }
F = { revolute = ["frame", "b3"] }
P = { revolute = ["b1", "t"] }
Q = { revolute = ["b2", "t"] }
R = { revolute = ["b3", "t"] }
[loads]
spring = { torsion_spring = ["c1", "b1"], stiffness = "0.4 N m/rad", free_angle = 30 }
[sketch]
b1 = { at = [46, 38], angle = 75 }
b2 = { at = [275, 43], angle = 110 }
b3 = { at = [150, 320], angle = -90 }
t = { at = [90, 200], angle = 10 }
"""
MOVING = {"crank": SLIDER_CRANK + AT_REST, "five-bar": FIVE_BAR, "inverted": INVERTED, "geared": GEARED, "triad": TRIAD}


def four_bar_by_triangles(crank: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles [rad] of coupler against crank and of rocker against frame, continuous in the crank's angles (n,)."""
    b, e = 60.0 * np.exp(1j * crank), complex(-200.0, 60.0)
    d = np.abs(e - b)
    along = (d * d + 180.0**2 - 120.0**2) / (2.0 * d)
    joint = b + (e - b) / d * (along + 1j * np.sqrt(180.0**2 - along**2))  # left of the line from B to E
    return np.unwrap(np.angle((joint - b) / np.exp(1j * crank))), np.unwrap(np.angle(joint - e))


def expected_torque(load: str) -> np.ndarray:
    """Torque of the drive [N m] at 41 frames of a turn, by virtual power."""
    fine = 100
    crank = np.radians(170.0) + np.linspace(0.0, 2.0 * np.pi, 40 * fine + 1)
    between, rocker = four_bar_by_triangles(crank)
    between += 2.0 * np.pi * np.round((np.radians(20.0) - between[0]) / (2.0 * np.pi))
    step = crank[1] - crank[0]
    if load is SPRING:
        torque = 2.0 * (between - np.radians(20.0)) * np.gradient(between, step, edge_order=2)
    else:
        factor = np.interp(np.degrees(between), [-60.0, 20.0, 60.0], [0.0, 1.0, 0.5])
        torque = -40.0 * factor * np.gradient(rocker, step, edge_order=2)
    return torque[::fine]


@pytest.mark.parametrize("load", [SPRING, TABLE], ids=["spring", "table"])
@pytest.mark.parametrize("turn", [0.0, -40.0, -90.0, 180.0, 179.999, 360.0])
def test_the_torque_of_a_wound_four_bar_is_that_of_its_triangles(load, turn):
    run = run_scene(four_bar(load, turn))
    torque = expected_torque(load)
    assert run.forces.effort("A") == pytest.approx(torque, abs=2e-4 * np.abs(torque).max())
    between = np.degrees(run.motion.coordinate("B")[:, 0])
    exact, _ = four_bar_by_triangles(np.radians(170.0) + np.linspace(0.0, 2.0 * np.pi, 41))
    assert between == pytest.approx(np.degrees(exact), abs=1e-9)


def simulated(text: str):
    """A run, and the same motion in absolute coordinates: states at the frames."""
    run = run_scene(loads(text))
    first = run.simulation.view([0.0])
    mechanism = run.scene.mechanism
    poses = {k: tuple(map(float, first.pose(k)[0])) for k in first.model.links}
    body = Second(mechanism, poses, {d.joint: float(d.law(0.0)[0]) for d in mechanism.drives})
    return run, body, body.run(run.motion.time)


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", MOVING)
def test_motion_under_torsion_springs_is_that_of_absolute_coordinates(name):
    """Of one freedom and of several, through changes of the leading joints, with gears and with a group without a closed form."""
    run, body, states = simulated(MOVING[name])
    scale = run.motion.model.length_scale
    for k, link in enumerate(body.names):
        pose, want = run.motion.pose(link), states["q"][:, 3 * k : 3 * k + 3]
        assert pose[:, :2] == pytest.approx(want[:, :2], abs=1e-7 * scale), link
        assert pose[:, 2] == pytest.approx(want[:, 2], abs=1e-7), link
    energy = np.array([body.energy(q, v) for q, v in zip(states["q"], states["v"], strict=True)])
    assert np.ptp(energy) <= 1e-8 * max(np.abs(energy).max(), 1.0)
    assert run.forces.energy[:, :2].sum(axis=1) == pytest.approx(energy, abs=1e-7 * np.abs(energy).max())
    assert np.abs(run.simulation.drift(run.motion.time)).max() < 1e-8


def test_a_crank_at_rest_beside_its_unloaded_spring_hardly_accelerates():
    run = run_scene(loads(SLIDER_CRANK + AT_REST))
    assert run.motion.coordinate("O")[0, 2] == pytest.approx(-3.7678, abs=1e-4)
    assert np.abs(run.motion.coordinate("O")[:, 0] - np.radians(20.0)).max() < np.radians(0.3)


def test_a_stop_beyond_half_a_turn_is_met_and_the_motion_goes_back():
    """Without forces the kinetic energy stays: the time to the stop is an integral over the crank's angle."""
    run = run_scene(loads(SLIDER_CRANK + STOPPED))

    def rod(q: float) -> float:
        return np.pi + np.arcsin(1.5 * np.sin(q))  # of the world: C is on the axis, behind B

    def inertia(q: float) -> float:
        """Of all links, reduced to the crank, by the rod's rate."""
        b, psi = 0.15 * np.exp(1j * q), rod(q)
        rate = 1.5 * np.cos(q) / np.cos(psi - np.pi)
        vb, arm = 1j * b, 1j * 0.1 * np.exp(1j * psi) * rate
        return 0.002 + abs(0.5 * vb) ** 2 + 0.5 * abs(vb + 0.5 * arm) ** 2 + 0.001 * rate**2 + 0.3 * abs(vb + arm) ** 2

    assert np.degrees(rod(np.radians(-10.0)) - np.radians(-10.0)) == pytest.approx(175.0, abs=0.1)
    start, omega = np.radians(-10.0), np.radians(1000.0)

    def time_to(angle: float) -> float:
        end = brentq(lambda q: rod(q) - q - np.radians(angle), start, np.radians(40.0), xtol=1e-15)
        return quad(lambda q: np.sqrt(inertia(q) / inertia(start)) / omega, start, end, epsabs=1e-14, epsrel=1e-13)[0]

    passed, hit = time_to(185.0), time_to(190.0)
    computed = run.simulation.events
    assert [h.kind for h in computed] == ["watch", "impact", "watch"]
    assert [h.time for h in computed] == pytest.approx([passed, hit, 2.0 * hit - passed], abs=1e-9)
    t = np.linspace(0.0, hit, 7)
    assert run.simulation(2.0 * hit - t)[0] == pytest.approx(run.simulation(t)[0], abs=1e-9)  # all the way back
    assert np.degrees(run.motion.coordinate("B")[:, 0]).max() <= 190.0 + 1e-9


@pytest.mark.parametrize("ratio", [31.0, 62.8, 500.0])
@pytest.mark.parametrize("law", [ConstantSpeed(0.0, 2.0, 6.0), Free(0.0, 2.0)])
def test_fast_wheels_of_gear_trains_keep_their_turns(ratio: float, law: ConstantSpeed | Free) -> None:
    """A wheel that turned by nearly whole turns from one point to the next counted as one that turned back a little."""
    middle = np.sqrt(ratio)
    places = {"A": (0.0, 0.0), "B": (1.0 + middle, 0.0), "C": (2.0 + 2.0 * middle, 0.0), "X": (0.0, 9.0)}
    wheels = tuple(Link(name=p.lower(), points={p: (0.0, 0.0)}, inertia=1.0) for p in places)
    pins = tuple(Revolute(name=p, links=("frame", p.lower()), points=(p, p)) for p in places)
    gears = tuple(Gear(name=a + b, links=(a, b), carrier="frame", sizes=(middle, 1.0)) for a, b in ("ab", "bc"))
    drives = (Drive(joint="A", law=law), Drive(joint="X", law=law))
    frame = Link(name="frame", points=places)
    train = Mechanism(
        name="train", frame="frame", links=(frame, *wheels), joints=(*pins, *gears), drives=drives, effects=("inertia",)
    )
    t = np.linspace(0.0, 3.0, 12)
    motion = simulate(train, 3.0).motion(t) if isinstance(law, Free) else solve_motion(compile_mechanism(train), t)
    slow, fast = (motion.coordinate(joint)[:, 0] for joint in "AC")
    assert fast - fast[0] == pytest.approx(ratio * (slow - slow[0]), abs=1e-8)
