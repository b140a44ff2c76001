"""Motions under forces through change points and close by them, against the integral of the energy over closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from energy_integral import Body, Linkage, change_point_way, linkage_way

from mechcore.branches.singular_points import find_singular_points
from mechcore.dynamics.simulate import simulate
from mechcore.laws.timed import Free
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.mechanism import Drive, Link, Mechanism
from mechviz.hard_cases.mechanisms import pin
from mechviz.scene.scene import loads

LINKS = ("crank", "coupler", "rocker")
Sizes = tuple[float, float, float, float]


def four_bar(
    sizes: Sizes, side: str, start: float, speed: float, *, gravity: bool, masses=(1.0, 1.0, 1.0)
) -> tuple[Mechanism, Linkage]:
    """Uniform bars, crank a, coupler b, rocker c, frame d; and the same for the reference."""
    a, b, c, d = sizes
    bars = zip(LINKS, "ABD", "BCC", (a, b, c), masses, strict=True)
    links = [Link(name="frame", points={"A": (0.0, 0.0), "D": (d, 0.0)})]
    links += [
        Link(name=n, points={p: (0.0, 0.0), q: (size, 0.0)}, mass=m, centre=(size / 2, 0.0), inertia=m * size**2 / 12)
        for n, p, q, size, m in bars
    ]
    ends = {"A": ("frame", "crank"), "B": ("crank", "coupler"), "C": ("coupler", "rocker"), "D": ("frame", "rocker")}
    mechanism = Mechanism(
        name="four-bar",
        frame="frame",
        links=tuple(links),
        joints=tuple(pin(name, *between) for name, between in ends.items()),
        drives=(Drive(joint="A", law=Free(start, speed)),),
        modes={"C": side},
        effects=("inertia", "gravity") if gravity else ("inertia",),
    )
    inertia = [m * size**2 / 12 for m, size in zip(masses, (a, b, c), strict=True)]
    places: tuple[tuple[tuple[int, complex], ...], ...] = ((), ((0, a),), ())
    bodies = tuple(Body(m, j, size / 2, p) for m, j, size, p in zip(masses, inertia, (a, b, c), places, strict=True))
    return mechanism, Linkage(bodies, ((((0, a), (1, b), (2, -c)), -d),), 9.81 if gravity else 0.0)


def angles_of(motion) -> np.ndarray:
    return np.column_stack([motion.pose(name)[:, 2] for name in LINKS])


def side_of(mechanism: Mechanism) -> float:
    """+1 where the coupler is turned counterclockwise from the line of its outer pins at the start."""
    motion = solve_motion(compile_mechanism(mechanism), [0.0])
    to_rocker = (motion.point("rocker", "D")[0] - motion.point("crank", "B")[0]) @ [1.0, 1.0j]
    return float(np.sign((np.exp(1j * motion.pose("coupler")[0, 2]) / to_rocker).imag))


CHANGE_POINTS = {
    "with the longest frame and the shortest crank": ((1.0, 3.0, 2.0, 4.0), "left", np.pi / 3, 5.0, True),
    "without gravity": ((2.0, 4.0, 3.0, 5.0), "left", np.pi / 3, -12.0, False),
    "the other way": ((2.0, 4.0, 3.0, 5.0), "right", 2.0, 12.0, False),
    "led by a short arm of a triangle": ((1.3868633, 1.6685932, 1.9382405, 2.2199704), "left", -1.4984, 11.5363, False),
    "folded": ((1.07508, 1.29708, 1.72746, 1.50546), "right", -1.15852, 9.65841, False),
    "folded, a kite but for little": ((0.71346629, 0.73667469, 0.42442312, 0.40121472), "right", -2.313, 9.772, False),
}


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", CHANGE_POINTS)
def test_a_change_point_four_bar_turns_three_times(name: str):
    sizes, side, start, speed, gravity = CHANGE_POINTS[name]
    mechanism, linkage = four_bar(sizes, side, start, speed, gravity=gravity)
    t, angles = change_point_way(sizes, linkage, side_of(mechanism), start, speed, 3.0, 24)
    simulation = simulate(mechanism, float(t[-1]), tolerance=1e-11)
    assert np.abs(np.exp(1j * angles_of(simulation.motion(t))) - np.exp(1j * angles)).max() < 1e-9
    assert np.abs(simulation.drift(t)).max() < 1e-9


@pytest.mark.parametrize("joint", "BCD")
def test_a_change_point_four_bar_led_by_another_joint(joint: str):
    sizes = (2.0, 4.0, 3.0, 5.0)
    mechanism, linkage = four_bar(sizes, "left", np.pi / 3, -12.0, gravity=False)
    at = solve_motion(compile_mechanism(mechanism), [0.0])
    start, speed, _ = (float(x) for x in at.coordinate(joint)[0])
    poses = {name: tuple(float(x) for x in at.pose(name)[0]) for name in LINKS}
    led = replace(mechanism, drives=(Drive(joint=joint, law=Free(start, speed)),), modes={}, sketch=poses)
    t, angles = change_point_way(sizes, linkage, side_of(mechanism), np.pi / 3, -12.0, 3.0, 24)
    simulation = simulate(led, float(t[-1]), tolerance=1e-11)
    assert np.abs(np.exp(1j * angles_of(simulation.motion(t))) - np.exp(1j * angles)).max() < 1e-9


def test_the_four_bar_of_a_scene_that_stopped_after_a_turn():
    """Its crank's mass is no uniform bar's."""
    text = """
        effects = ["inertia", "gravity"]
        [run]
        frames = 150
        duration = "3 s"
        tolerance = 1e-11
        [links]
        frame = { points = { O2 = [0, 0], O4 = [4, 0] } }
        crank = { points = { O2 = [0, 0], B = [1, 0] }, mass = 2, centre = [0.5, 0], inertia = 0.01 }
        coupler = { points = { B = [0, 0], C = [3, 0], P = [1.5, 0.5] }, mass = 3, centre = [1.5, 0], inertia = 0.05 }
        rocker = { points = { O4 = [0, 0], C = [2, 0] }, mass = 2, centre = [1, 0], inertia = 0.02 }
        [joints]
        O2 = { revolute = ["frame", "crank"], free = { position = "60 deg", speed = "5 rad/s" } }
        B = { revolute = ["crank", "coupler"] }
        C = { revolute = ["coupler", "rocker"], side = "left" }
        O4 = { revolute = ["frame", "rocker"] }
    """
    bodies = Body(2.0, 0.01, 0.5, ()), Body(3.0, 0.05, 1.5, ((0, 1.0),)), Body(2.0, 0.02, 1.0, ())
    linkage = Linkage(bodies, ((((0, 1.0), (1, 3.0), (2, -2.0)), -4.0),))
    mechanism = loads(text).mechanism
    t, angles = change_point_way((1.0, 3.0, 2.0, 4.0), linkage, 1.0, np.pi / 3, 5.0, 3.0, 24)
    simulation = simulate(mechanism, float(t[-1]), tolerance=1e-11)
    assert np.abs(np.exp(1j * angles_of(simulation.motion(t))) - np.exp(1j * angles)).max() < 1e-9


def test_a_change_point_beside_which_an_arm_is_short_is_found():
    """Driven at B the arm from A to C is 0.02 long where the triangle is flat: no polynomial from degree to degree says that."""
    a, b, c = 1.0, 1.02, 1.5
    mechanism, _ = four_bar((a, b, c, c + b - a), "left", 0.4, 1.0, gravity=False)
    at = solve_motion(compile_mechanism(mechanism), [0.0])
    poses = {name: tuple(float(x) for x in at.pose(name)[0]) for name in LINKS}
    start = float(at.coordinate("B")[0, 0])
    driven = replace(mechanism, drives=(Drive(joint="B", law=Free(start)),), modes={}, sketch=poses)
    compiled = compile_mechanism(driven)
    changes = find_singular_points(compiled.model, compiled.assembly.modes, {})
    assert changes is not None
    assert {round(np.cos(start + c.time), 9) for c in changes.points} == {-1.0}


NEAR = {
    "turns fully": ((1.0, 3.0, 2.0, 4.0), "left", np.pi / 3, 12.0, 1.0),
    "swings": ((1.0, 3.0, 2.0, 4.0), "left", np.pi / 3, 12.0, -1.0),
    "led by four joints in turn": ((1.951153927, 1.524597255, 1.087410565, 0.660855893), "left", 1.57766, 18.545, -1.0),
}


@pytest.mark.sample(2)
@pytest.mark.parametrize(("name", "decade"), [*zip([*NEAR] * 3, range(-9, 0), strict=True)])
def test_four_bars_near_a_change_point(name: str, decade: int):
    """The rocker is a little too long or too short for the modes to meet; 1e-4 in 2 was refused after a turn."""
    (a, b, c, d), side, start, speed, sense = NEAR[name]
    gap = sense * 10.0**decade * (a + b + c + d)
    mechanism, linkage = four_bar((a, b, c + gap, d), side, start, speed, gravity=True)
    first = angles_of(solve_motion(compile_mechanism(mechanism), [0.0]))[0]
    t = np.linspace(0.2, 1.0, 5)
    want = linkage_way(linkage, first, 0, speed, list(t), 0.03 * np.sqrt(abs(gap)))
    simulation = simulate(mechanism, 1.0, tolerance=1e-11)
    assert np.abs(angles_of(simulation.motion(t)) - want).max() < 1e-9


@pytest.mark.sample(2)
@pytest.mark.parametrize(("gap", "rod"), [(1e-2, 2.2), (-1e-4, 2.6), (1e-6, 2.2), (-1e-9, 2.6)])
def test_six_bars_near_a_change_point(gap: float, rod: float):
    """A four-bar and a dyad on a point of its coupler."""
    mechanism, four = four_bar((0.8, 1.6, 1.2 - 4.8 * gap, 2.0), "left", 0.9, 14.0, gravity=True, masses=(1.0, 0.7, 1.3))
    frame, crank, coupler, rocker = mechanism.links
    bars = [
        Link(name=n, points={p: (0.0, 0.0), "Q": (size, 0.0)}, mass=0.5, centre=(size / 2, 0.0), inertia=size**2 / 24)
        for n, p, size in (("rod", "P", rod), ("bar", "G", 2.4))
    ]
    frame = replace(frame, points={**frame.points, "G": (1.5, -1.2)})
    coupler = replace(coupler, points={**coupler.points, "P": (0.7, 0.3)})
    joints = (*mechanism.joints, pin("P", "coupler", "rod"), pin("Q", "rod", "bar"), pin("G", "frame", "bar"))
    six = replace(mechanism, links=(frame, crank, coupler, rocker, *bars), joints=joints, modes={"C": "left", "Q": "left"})
    to_point = ((0, 0.8 + 0j), (1, 0.7 + 0.3j))
    bodies = (*four.bodies, Body(0.5, rod**2 / 24, rod / 2, to_point), Body(0.5, 2.4**2 / 24, 1.2, ()))
    linkage = Linkage(bodies, (*four.loops, ((*to_point, (3, rod), (4, -2.4)), -1.5 + 1.2j)))
    names = (*LINKS, "rod", "bar")
    first = np.array([solve_motion(compile_mechanism(six), [0.0]).pose(n)[0, 2] for n in names])
    t = np.linspace(0.2, 0.8, 4)
    want = linkage_way(linkage, first, 0, 14.0, list(t), 0.03 * np.sqrt(abs(4.8 * gap)))
    motion = simulate(six, 0.8, tolerance=1e-11).motion(t)
    assert np.abs(np.column_stack([motion.pose(n)[:, 2] for n in names]) - want).max() < 1e-9
