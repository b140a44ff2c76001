"""The same mechanism at other scales, far from the origin, and after ten thousand turns gives the same relative answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import four_bar, pin, slider_crank

import mechviz
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Force
from mechcore.spec.mechanism import Drive, Gear, Link, Mechanism

TURN = 2.0 * np.pi
TIME = np.linspace(0.0, TURN, 181)

BODIES = {"crank": (1.1, (0.04, 0.0), 2e-3), "coupler": (0.7, (0.12, 0.05), 6e-3), "rocker": (0.9, (0.1, 0.01), 5e-3)}
RODS = {"crank": (1.1, (0.01, 0.0), 2e-3), "rod": (0.7, (0.07, 0.0), 2e-3), "piston": (0.9, (0.0, 0.0), 0.0)}


def bar() -> Mechanism:
    load = Force(name="F", link="rocker", point="D", vector=(30.0, -50.0))
    return four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, bodies=BODIES, effects=("inertia", "gravity"), loads=(load,))


def engine() -> Mechanism:
    load = Force(name="F", link="piston", point="C", vector=(-400.0, 0.0))
    return slider_crank(r=0.05, l=0.18, e=0.012, bodies=RODS, effects=("inertia", "gravity"), loads=(load,))


def moved(m: Mechanism, scale: float, shift: float) -> Mechanism:
    """Lengths, forces and gravity times ``scale``, moments of inertia times its square; the whole moved by (shift, -shift)."""
    links = []
    for k in m.links:
        at = (shift, -shift) if k.name == m.frame else (0.0, 0.0)
        points = {n: (scale * x + at[0], scale * y + at[1]) for n, (x, y) in k.points.items()}
        centre = (scale * k.centre[0], scale * k.centre[1])
        links.append(replace(k, points=points, centre=centre, inertia=scale**2 * k.inertia))
    loads = tuple(replace(f, vector=(scale * f.vector[0], scale * f.vector[1])) for f in m.loads if isinstance(f, Force))
    return replace(m, links=tuple(links), loads=loads, gravity=(scale * m.gravity[0], scale * m.gravity[1]))


@pytest.mark.parametrize(("scale", "shift"), [(1.0, 1e4), (1e3, 1e7)])  # scales alone: test_metamorphic
@pytest.mark.parametrize("build", [bar, engine])
def test_motion_and_forces_in_kilometres_and_ten_kilometres_away(build, scale, shift):
    base = solve_forces(solve_motion(compile_mechanism(build()), TIME))
    other = solve_forces(solve_motion(compile_mechanism(moved(build(), scale, shift)), TIME))
    # coordinates 10 km away are written down to 2e-12 m, 1e-11 of the mechanism
    near = 2e-9
    for link in base.motion.model.links[1:]:
        want, got = base.motion.pose(link), other.motion.pose(link) - [shift, -shift, 0.0]
        np.testing.assert_allclose(got / [scale, scale, 1.0], want, rtol=0, atol=near)
        for computed in ("velocity", "acceleration"):
            want, got = getattr(base.motion, computed)(link), getattr(other.motion, computed)(link) / [scale, scale, 1.0]
            np.testing.assert_allclose(got, want, rtol=0, atol=near * np.abs(want).max())
    for joint in (p.name for p in base.motion.mechanism.joints):
        want = base.reaction(joint)
        np.testing.assert_allclose(other.reaction(joint) / [scale, scale, scale**2], want, rtol=0, atol=near * np.abs(want).max())
    drive = base.motion.mechanism.drives[0].joint
    want = base.effort(drive)
    np.testing.assert_allclose(other.effort(drive) / scale**2, want, rtol=0, atol=near * np.abs(want).max())
    np.testing.assert_allclose(other.motion.condition, base.motion.condition, rtol=1e-6)


def geared() -> Mechanism:
    """The four-bar with a pinion on its rocker's pivot line, driven by the crank: 3 turns of the pinion to 2 of the crank."""
    m = bar()
    frame = replace(m.links[0], points={**m.links[0].points, "W": (-0.1, 0.0)})
    wheel = Link(name="pinion", points={"W": (0.0, 0.0)})
    gear = Gear(name="G", links=("crank", "pinion"), carrier="frame", sizes=(30, 20))
    return replace(m, links=(frame, *m.links[1:], wheel), joints=(*m.joints, pin("W", "frame", "pinion"), gear))


def triad() -> Mechanism:
    """A group that only Newton's method solves, with a crank at one radian a second."""
    m = mechviz.load("triad").mechanism
    return replace(m, drives=(replace(m.drives[0], law=ConstantSpeed(m.drives[0].law.start, 1.0)),))


@pytest.mark.parametrize("build", [bar, engine, geared, triad])
def test_turn_ten_thousand_equals_turn_one(build):
    turns = 10_000
    compiled = compile_mechanism(build())
    first, last = (solve_motion(compiled, TIME + k * TURN) for k in (0, turns))
    full = {"crank": 1.0, "pinion": -1.5}
    for link in first.model.links[1:]:
        went = np.array([0.0, 0.0, turns * TURN * full.get(link, 0.0)])
        size = first.model.length_scale
        np.testing.assert_allclose(last.pose(link) - went, first.pose(link), rtol=0, atol=1e-10 * max(1.0, size))
        for computed in ("velocity", "acceleration"):  # a drive at 62,832 rad is known to 7e-12
            want, got = getattr(first, computed)(link), getattr(last, computed)(link)
            np.testing.assert_allclose(got, want, rtol=0, atol=1e-9 * max(np.abs(want).max(), 1.0))
    assert last.closure.max() <= 1e-12 * last.model.length_scale
    if build is not triad:
        a, b = (solve_forces(m) for m in (first, last))
        for joint in (p.name for p in first.mechanism.joints):
            want = a.reaction(joint)
            np.testing.assert_allclose(b.reaction(joint), want, rtol=0, atol=1e-9 * max(np.abs(want).max(), 1.0))


@pytest.mark.parametrize("frames", [2, 360])
def test_whole_turns_are_counted_however_few_frames_look_at_them(frames):
    """A parallelogram's rocker turns with the crank: also where the crank goes round thousands of times between two frames."""
    turns = 12_345.4
    m = four_bar(E=(2.0, 0.0), AB=1.0, BD=2.0, DE=1.0, start=0.5, mode="left")
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, turns * TURN, frames))
    np.testing.assert_allclose(motion.pose("rocker")[:, 2], motion.pose("crank")[:, 2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(motion.pose("coupler")[:, 2], 0.0, atol=1e-9)


def test_drives_that_go_on_for_ever_are_refused_with_the_limit():
    m = bar()
    compiled = compile_mechanism(m)
    most = 50_000
    assert solve_motion(compiled, [0.0, 0.999 * most * TURN]).frames == 2
    with pytest.raises(
        MechanismError, match=r"joints.A.drive: it goes 111111 turns .* over 50,000 turns at most\. Run fewer cycles"
    ):
        solve_motion(compiled, [0.0, np.radians(4e7)])
    slider = replace(engine(), drives=(Drive(joint="S", law=ConstantSpeed(0.2, 1.0)),), modes={"B": "left"})
    with pytest.raises(MechanismError, match=r"joints.S.drive: it goes 6e\+07 mm, .* times the size of the mechanism"):
        solve_motion(compile_mechanism(slider), [0.0, 6e4])
