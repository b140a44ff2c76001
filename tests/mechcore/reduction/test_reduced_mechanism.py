"""Reduced mass and force, shaking force, balancing: references, kinetostatics as the second method, random linkages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanisms import case, four_bar, slider_crank

import mechviz
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.events import strokes
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.reduction.balancing import (
    Counterweight,
    FourBarLinks,
    Shaking,
    SliderCrankLinks,
    balance,
    counterweights,
    find_linkage,
    shaking,
    with_counterweights,
)
from mechcore.reduction.reduced import reduce_mechanism
from mechcore.spec.loads import Force
from mechviz.scene.assembly.simulation import oscillation_changes

BODIES = {"crank": (0.8, (0.05, 0.01), 0.001), "coupler": (1.6, (0.14, 0.02), 0.012), "rocker": (1.2, (0.12, -0.01), 0.007)}


def moved(mechanism, frames=48):
    compiled = compile_mechanism(mechanism)
    return solve_motion(compiled, default_times(mechanism, frames))


def balancing_effort(reduced):
    """Torque or force of a drive there that the motion needs: J a + J' v^2 / 2 - reduced force."""
    return reduced.mass * reduced.second + 0.5 * reduced.slope * reduced.rate**2 - reduced.force


def test_reduced_inertia_of_the_reference():
    c = case("misc", "reduced-inertia-slider-crank")
    i = c["inputs"]
    bodies = {"crank": (i["m1"], i["C1"], i["J1"]), "rod": (i["m2"], i["C2"], i["J2"]), "piston": (i["m3"], (0.0, 0.0), 0.0)}
    m = slider_crank(r=i["r"], l=i["l"], e=i["e"], bodies=bodies)
    compiled = compile_mechanism(m)
    angles = np.radians([row["theta_1_deg"] for row in c["expected"]])
    motion = solve_motion(compiled, angles, drives={"O": (angles, np.ones_like(angles), np.zeros_like(angles))})
    reduced = reduce_mechanism(motion, "crank")
    assert reduced.mass == pytest.approx([row["J_red"] for row in c["expected"]], rel=1e-11)
    assert reduced.slope == pytest.approx([row["dJ_dtheta"] for row in c["expected"]], rel=1e-10)


@pytest.mark.parametrize("name", ["kinetostatic-four-bar", "ten-link-forces", "slider-crank-engine", "contour-lever"])
def test_the_equation_of_motion_in_the_drive_gives_the_torque_of_kinetostatics(name):
    scene = mechviz.load(name)
    m = replace(scene.mechanism, effects=("inertia", "gravity"))
    compiled = compile_mechanism(m)
    motion = solve_motion(compiled, default_times(m, 60, scene.cycles))
    forces = solve_forces(motion)
    drive = m.drives[0].joint
    link = next(p for p in m.joints if p.name == drive).links[1]
    reduced = reduce_mechanism(motion, link, loads=forces.applied)
    effort = forces.effort(drive)
    assert np.abs(balancing_effort(reduced) - effort).max() <= 1e-9 * np.abs(effort).max()
    assert reduced.energy == pytest.approx(forces.kinetic_energy, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize(
    ("link", "point"), [("rocker", None), ("coupler", None), ("rocker", "D"), ("coupler", "P"), ("crank", "B")]
)
def test_reduced_to_any_link_or_point_the_energy_and_the_power_are_the_same(link, point):
    m = four_bar(
        E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, bodies=BODIES, coupler_point=(0.1, 0.08),
        speed=20.0, effects=("inertia", "gravity"),
        loads=(Force(name="F", link="rocker", point="D", vector=(-150.0, -60.0)),),
    )  # fmt: skip
    motion = moved(m)
    forces = solve_forces(motion)
    reduced = reduce_mechanism(motion, link, point, forces.applied)
    assert reduced.energy == pytest.approx(forces.kinetic_energy, rel=1e-9)
    load = sum(power for w, power in forces.powers() if w.kind in ("gravity", "force"))
    assert reduced.force * reduced.rate == pytest.approx(load, rel=1e-9, abs=1e-9 * np.abs(load).max())
    power = forces.power_supplied  # also through the equation of motion there, with the derivative of the reduced mass
    assert balancing_effort(reduced) * reduced.rate == pytest.approx(power, rel=1e-7, abs=1e-9 * np.abs(power).max())


def test_the_slope_is_the_derivative():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, bodies=BODIES)
    compiled = compile_mechanism(m)
    h = 1e-4

    def at(shift, link, point):
        q = np.linspace(0.3, 6.0, 9) + shift
        return solve_motion(compiled, q, drives={"A": (q, np.ones_like(q), np.zeros_like(q))}), link, point

    for link, point in (("crank", None), ("coupler", None), ("rocker", "D")):
        low, mid, high = (reduce_mechanism(*at(s, link, point)) for s in (-h, 0.0, h))
        difference = (high.mass - low.mass) / (2.0 * h) / mid.rate  # by the angle of the link, or the way of the point
        assert mid.slope == pytest.approx(difference, rel=1e-4, abs=1e-5 * np.abs(mid.slope).max())


def test_several_drives_and_unknown_places_are_refused():
    motion = moved(mechviz.load("five-bar").mechanism)
    with pytest.raises(MechanismError, match="2 drives"):
        reduce_mechanism(motion, "crank")
    motion = moved(four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, bodies=BODIES))
    with pytest.raises(MechanismError, match="no link or point"):
        reduce_mechanism(motion, "crank", "Q")


def test_a_point_that_stands_still_has_an_infinite_reduced_mass_not_a_rounded_one():
    """A piston at both dead points, exactly: one over the square of a rounded speed was 1e32 kg there, and the energy NaN."""
    bodies = {"crank": (1.0, (0.01, 0.0), 0.001), "rod": (1.0, (0.075, 0.0), 0.002), "piston": (0.7, (0.0, 0.0), 0.0)}
    load = Force(name="P", link="piston", point="C", vector=(-100.0, 0.0))
    motion = moved(slider_crank(r=0.04, l=0.15, bodies=bodies, loads=(load,), effects=("inertia",)), 12)
    applied = solve_forces(motion).applied
    of_crank, of_piston = reduce_mechanism(motion, "crank", None, applied), reduce_mechanism(motion, "piston", "C", applied)
    dead = np.isin(np.arange(13), [0, 6, 12])
    assert np.isinf(of_piston.mass[dead]).all() and np.isfinite(of_piston.mass[~dead]).all()
    assert np.isnan(of_piston.slope[dead]).all() and np.isfinite(of_piston.slope[~dead]).all()
    assert np.isnan(of_piston.force[dead]).all()  # no power at no speed: any force
    np.testing.assert_allclose(np.abs(of_piston.force[~dead]), 100.0)
    np.testing.assert_allclose(of_piston.energy, of_crank.energy, rtol=1e-12)
    with pytest.raises(MechanismError, match=r"'piston' never turns.*such as 'piston.C'"):
        reduce_mechanism(motion, "piston")
    with pytest.raises(MechanismError, match=r"'crank\.O' never moves"):
        reduce_mechanism(motion, "crank", "O")


SHAPER = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
reduced = ["crank", "ram.R"]
run = { frames = 90 }

[links]
frame = { points = { A = [0, 0], D = [0, -200], R = [0, 150] } }
slide = { points = { D = [0, 0] } }
crank = { points = { A = [0, 0], B = [60, 0] }, mass = "1 kg", shape = "bar" }
lever = { points = { D = [0, 0], L = [350, 0] }, mass = "1 kg", shape = "bar" }
ram   = { points = { R = [0, 0] }, mass = "1 kg", shape = "point" }

[joints]
S = { SLIDE }
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
B = { pin_slot = ["lever", "crank"], at = ["D", "B"], branch = "ahead" }
D = { revolute = ["slide", "lever"] }
R = { prismatic = ["frame", "ram"] }
V = { pin_slot = ["ram", "lever"], at = ["R", "L"], along = [0, 1] }
"""


def test_a_drive_that_holds_its_joint_is_no_second_one():
    """A shaper whose pivot can be set: it has the reduced mass and the time ratio of one whose pivot is welded there."""
    guide = 'prismatic = ["frame", "slide"], at = "D", along = [0, 1]'
    ways = (f"{guide}, drive = {{ speed = 0 }}", 'weld = ["frame", "slide"], at = "D"')
    held, fixed = (mechviz.loads(SHAPER.replace("SLIDE", words)) for words in ways)
    assert oscillation_changes(held.document) == oscillation_changes(fixed.document) != {}  # what --reachable changes
    a, b = moved(held.mechanism), moved(fixed.mechanism)
    for link, point in (("crank", None), ("ram", "R")):
        ours, theirs = reduce_mechanism(a, link, point), reduce_mechanism(b, link, point)
        for name in ("mass", "slope", "rate", "second"):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-9, atol=1e-12)
    (stroke,) = (s for s in strokes(a) if s.joint == "R")
    beta = np.arccos(60.0 / 200.0)
    assert stroke.time_ratio == pytest.approx((np.pi - beta) / beta, rel=1e-9)
    with pytest.raises(mechviz.SceneError, match="drives 'S', 'A' move"):
        mechviz.loads(SHAPER.replace("SLIDE", f'{guide}, drive = {{ oscillation = {{ amplitude = 5, period = "1 s" }} }}'))


# -- shaking and balancing ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["kinetostatic-four-bar", "slider-crank-compressor", "ten-link-forces"])
def test_shaking_is_what_joints_and_drives_do_to_the_frame(name):
    m = replace(mechviz.load(name).mechanism, effects=("inertia",), loads=())
    motion = moved(m)
    forces, computed = solve_forces(motion), shaking(motion, (0.02, -0.05))
    on_frame, moment = np.zeros((motion.frames, 2)), np.zeros(motion.frames)
    driven = {d.joint for d in m.drives}
    for c in motion.model.connections:
        if m.frame in c.links:
            sign = 1.0 if c.links[1] == m.frame else -1.0
            wrench = forces.reaction(c.name) + (forces.wrench(c.name) if c.name in driven else 0.0)
            at = forces.position(c.name) - np.array([0.02, -0.05])
            on_frame += sign * wrench[:, :2]
            moment += sign * (wrench[:, 2] + at[:, 0] * wrench[:, 1] - at[:, 1] * wrench[:, 0])
    assert np.abs(computed.force - on_frame).max() <= 1e-10 * computed.peak
    assert np.abs(computed.moment - moment).max() <= 1e-10 * computed.peak_moment


@settings(max_examples=examples(15))
@given(st.integers(0, 10**6))
def test_a_balanced_four_bar_does_not_shake_whatever_the_crank_does(seed):
    rng = np.random.default_rng(seed)
    bodies = {
        k: (rng.uniform(0.3, 3), tuple(rng.uniform(-0.1, 0.3, 2)), rng.uniform(0, 0.05)) for k in ("crank", "coupler", "rocker")
    }
    m = four_bar(E=(0.28, 0.05), A=(0.0, 0.05), AB=0.1, BD=0.3, DE=0.25, bodies=bodies, effects=("inertia",))
    better, weights = balance(m, (rng.uniform(0.02, 0.2), rng.uniform(0.02, 0.2)))
    compiled = compile_mechanism(better)
    q = rng.uniform(0, 6.28, 30)
    motion = solve_motion(compiled, np.arange(30.0), drives={"A": (q, rng.normal(size=30), rng.normal(size=30))})
    before = solve_motion(compile_mechanism(m), np.arange(30.0), drives={"A": tuple(motion.drives[0])})
    single = max(np.abs(link.mass * motion.centre_of_mass(link.name, 2)).max() for link in better.links)
    assert shaking(motion).peak <= 1e-12 * single
    assert shaking(before).peak > 1e-3 * single
    assert {w.link for w in weights} == {"crank", "rocker"}
    # the common centre of mass stands still
    total = sum(link.mass * motion.centre_of_mass(link.name) for link in better.links if link.mass)
    assert np.ptp(total, axis=0).max() <= 1e-12 * np.abs(total).max()


def test_the_moment_of_a_force_balanced_four_bar_is_a_pure_couple():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, bodies=BODIES, speed=20.0, effects=("inertia",))
    motion = moved(balance(m, 0.06)[0])
    here, there = shaking(motion), shaking(motion, (3.0, -2.0))
    assert here.moment == pytest.approx(there.moment, rel=1e-9)


def test_partial_balance_of_a_slider_crank_shifts_the_shaking_from_the_guide_across_it():
    bodies = {"crank": (2.2, (0.004, 0.0), 0.005), "rod": (0.55, (0.042, 0.0), 0.0016), "piston": (0.42, (0.0, 0.0), 0.0)}
    m = slider_crank(r=0.04, l=0.14, bodies=bodies, speed=157.0, effects=("inertia",))
    computed = {k: shaking(moved(balance(m, 0.05, fraction=k)[0], 360)) for k in (0.0, 0.5, 1.0)}
    for (
        k,
        s,
    ) in computed.items():  # across the guide only what turns with the crank acts: the part that is balanced beyond what turns
        to_and_fro = 0.55 * 0.042 / 0.14 + 0.42
        assert np.abs(s.force[:, 1]).max() == pytest.approx(k * to_and_fro * 0.04 * 157.0**2, rel=1e-3, abs=1e-9 * s.peak)
    plain = shaking(moved(m, 360))
    assert computed[0.5].peak < min(computed[0.0].peak, computed[1.0].peak, plain.peak)
    assert computed[0.5].rms < plain.rms


def test_a_rod_with_its_centre_beside_its_line_leaves_a_force_along_one_line():
    """With all that turns balanced, what is left is that of masses that go to and fro: m z C'' and M C'' of one complex sum."""
    bodies = {"crank": (2.2, (0.004, 0.001), 0.005), "rod": (0.55, (0.042, 0.02), 0.0016), "piston": (0.42, (0.0, 0.0), 0.0)}
    m = slider_crank(r=0.04, l=0.14, bodies=bodies, speed=157.0, effects=("inertia",))
    force = shaking(moved(balance(m, 0.05, fraction=0.0)[0], 360)).force
    along, across = np.linalg.svd(force, compute_uv=False)
    assert across < 1e-9 * along


def test_counterweights_are_where_they_are_said_to_be():
    m = four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, bodies=BODIES)
    linkage = find_linkage(m)
    assert isinstance(linkage, FourBarLinks)
    for w in counterweights(linkage, (0.05, 0.08)):
        assert np.hypot(*w.at) == pytest.approx({"crank": 0.05, "rocker": 0.08}[w.link])
        assert w.mass > 0
    heavier = with_counterweights(m, (Counterweight("crank", 2.0, (-0.1, 0.0)),))
    crank = next(k for k in heavier.links if k.name == "crank")
    assert crank.mass == pytest.approx(2.8) and crank.centre[0] == pytest.approx((0.8 * 0.05 - 0.2) / 2.8)
    assert isinstance(find_linkage(slider_crank(r=0.04, l=0.14)), SliderCrankLinks)


def test_what_is_no_linkage_is_refused():
    with pytest.raises(MechanismError, match="neither"):
        find_linkage(mechviz.load("ten-link").mechanism)
    with pytest.raises(MechanismError, match="radius"):
        balance(four_bar(E=(0.28, 0.0), AB=0.1, BD=0.3, DE=0.25, bodies=BODIES), 0.0)


def test_the_mean_square_of_a_cycle_counts_its_closing_frame_once():
    """cos over a turn in n equal steps: exactly 1 / sqrt(2) without the frame that closes the cycle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    force = np.column_stack([np.cos(angle), 0.0 * angle])
    s = Shaking(force=force, moment=3.0 * np.cos(angle), about=(0.0, 0.0))
    assert s.rms == pytest.approx(np.sqrt(0.5), rel=1e-14) and s.rms_moment == pytest.approx(3.0 * np.sqrt(0.5), rel=1e-14)
