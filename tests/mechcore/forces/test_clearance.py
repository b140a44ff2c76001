"""Clearance of revolute joints: free flight, impact, rest, the limit of the ideal joint, balances; scenes and their faults."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dynamic_mechanisms import slider_crank
from scipy.special import gamma

import mechviz
from mechcore.dynamics.simulate import simulate
from mechcore.effects import resistance
from mechcore.effects.resistance import loss_factor
from mechcore.errors import MechanismError
from mechcore.forces.cam_rating import contact_force, placed_cams
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.clearance import Clearance, journals_of, with_clearances, with_ideal_joints
from mechcore.spec.mechanism import Drive, Link, Mechanism, Revolute
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene

SCENE = mechviz.load("loose-coupler-pin").text


def ball(**clearance) -> Mechanism:
    """A ball of 2 kg, or rather its journal, in a fixed bearing of 10 mm clearance."""
    body = Link(name="ball", points={"O": (0.0, 0.0)}, mass=2.0, inertia=0.01)
    ideal = Mechanism(
        name="ball",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0)}), body),
        joints=(Revolute(name="O", links=("frame", "ball"), points=("O", "O")),),
        drives=(Drive(joint="O", law=Free(0.0, clearance.pop("spin", 0.0))),),
        effects=("inertia", "gravity"),
    )
    return with_clearances(ideal, {"O": Clearance(**{"radial": 0.01, "stiffness": 1e7} | clearance)})


def test_a_journal_flies_freely_until_it_touches():
    simulation = simulate(ball(), 0.04, tolerance=1e-12)
    t = np.linspace(0.0, np.sqrt(2.0 * 0.01 / 9.81), 20)
    q, v, _ = simulation(t)
    np.testing.assert_allclose(q[:, 2], -0.5 * 9.81 * t * t, atol=1e-14)
    np.testing.assert_allclose(v[:, 2], -9.81 * t, atol=1e-12)
    forces = simulation.forces(simulation.motion(t[:-1]))
    assert np.abs(forces.reaction("O")).max() == 0.0


@pytest.mark.parametrize("exponent", [1.0, 2.0])
@pytest.mark.parametrize("restitution", [1.0, 0.7, 0.2])
def test_an_impact_has_the_stated_restitution_whatever_the_stiffness(restitution: float, exponent: float):
    """Without weight: the ball comes in at the stated speed and leaves with the stated part of it; energy and losses close."""
    speed = 0.4
    made = ball(loss=loss_factor(restitution, speed), exponent=exponent, stiffness=3e6)
    drives = tuple(replace(d, law=Free(0.0, speed)) if d.joint == "O.across" else d for d in made.drives)
    simulation = simulate(replace(made, drives=drives, effects=("inertia",)), 0.06, tolerance=1e-11)
    _, v, _ = simulation([0.0, 0.045])
    assert v[0, 1] == speed and v[1, 1] == pytest.approx(-restitution * speed, rel=1e-8)
    energy = simulation.energies([0.045])[0]
    assert energy[3] == pytest.approx(speed**2 * (1.0 - restitution**2), rel=1e-6, abs=1e-9)
    assert abs(simulation.drift([0.06])[0]) < 1e-8


@pytest.mark.parametrize("exponent", [1.5, 2.5])
def test_a_contact_of_hertz_is_as_exact_as_asked_for(exponent: float):
    """Its force starts as a broken power of time, which no polynomial follows. Without weight and losses, against the duration of
    the contact (Johnson, Contact Mechanics, 11.4, for 3/2): 2 d / v times the integral of 1 / sqrt(1 - x^(n + 1)), 0 to 1."""
    speed, stiffness, radial, mass = 0.4, 3e6, 0.01, 2.0
    made = ball(exponent=exponent, stiffness=stiffness)
    drives = tuple(replace(d, law=Free(0.0, speed)) if d.joint == "O.across" else d for d in made.drives)
    compiled = compile_mechanism(replace(made, drives=drives, effects=("inertia",)))
    p = 1.0 / (exponent + 1.0)
    deepest = (0.5 * mass * speed**2 / (stiffness * radial ** (1.0 - exponent) * p)) ** p
    lasts = 2.0 * deepest / speed * np.sqrt(np.pi) * gamma(1.0 + p) / gamma(0.5 + p)
    for tolerance in (1e-8, 1e-9, 1e-11):
        simulation = simulate(compiled, 0.06, tolerance=tolerance)
        q, v, _ = simulation([0.06])
        assert abs(q[0, 1] - (radial - speed * (0.06 - radial / speed - lasts))) < 0.2 * tolerance
        assert abs(v[0, 1] + speed) < 6.0 * tolerance
        assert abs(simulation.drift([0.06])[0]) < 30.0 * tolerance


def test_it_comes_to_rest_on_the_bottom_pressed_in_by_its_weight():
    simulation = simulate(ball(loss=loss_factor(0.2, 0.3), stiffness=2e5, start=(0.0, -0.0098)), 0.6, tolerance=1e-7)
    q, v, _ = simulation([0.6])
    assert q[0, 2] == pytest.approx(-0.01 - 2.0 * 9.81 / 2e5, rel=1e-6) and abs(q[0, 1]) < 1e-12
    assert np.abs(v[0, 1:]).max() < 1e-4
    held = simulation.forces(simulation.view([0.6])).reaction("O")[0, :2]
    assert held == pytest.approx([0.0, 2.0 * 9.81], abs=1e-2)


def test_friction_in_the_bearing_brakes_the_spin_by_the_moment_that_the_joint_shows():
    made = ball(loss=2.0, stiffness=2e5, friction=0.2, radius=0.05, start=(0.0, -0.01), spin=30.0)
    simulation = simulate(made, 0.2, tolerance=1e-8)
    t = np.linspace(0.12, 0.2, 9)
    motion = simulation.view(t)
    reaction = simulation.forces(motion).reaction("O")
    np.testing.assert_allclose(reaction[:, 2], 0.01 * motion.acceleration("ball")[:, 2], rtol=1e-9)  # J alpha
    assert (reaction[:, 2] < 0).all() and simulation([0.2])[1][0, 0] < 30.0
    side, up = reaction[:, 0], reaction[:, 1]
    np.testing.assert_allclose(reaction[:, 2], -0.05 * 0.2 / np.sqrt(1.04) * np.hypot(side, up), rtol=1e-3)
    assert abs(simulation.drift([0.2])[0]) < 1e-6


def crank() -> Mechanism:
    base = slider_crank(
        {
            "r": 0.05, "l": 0.2, "e": 0.0, "m1": 1.0, "C1": (0.02, 0.0), "J1": 0.002, "m2": 0.5, "C2": (0.08, 0.0), "J2": 0.002,
            "m3": 0.8, "torque": 0.0, "theta_1_0": 0.3, "omega_1_0": 0.0,
        }
    )  # fmt: skip
    return replace(base, drives=(Drive(joint="O", law=ConstantSpeed(start=0.3, speed=15.0)),), effects=("inertia",), loads=())


def test_reactions_approach_those_of_the_ideal_joint_as_the_clearance_vanishes():
    """Over half a turn in which the load changes sides, after a settling quarter: deviations of the reactions from the ideal ones
    and of the piston from its place fall with the clearance."""
    ideal = crank()
    quarter = 0.5 * np.pi / 15.0
    t = np.linspace(quarter, 3.0 * quarter, 301)
    motion = solve_motion(compile_mechanism(ideal), t)
    wanted = solve_forces(motion).reaction("B")[:, :2]
    means, spreads, places = [], [], []
    for radial in (1e-3, 1e-4, 1e-5):
        made = with_clearances(ideal, {"B": Clearance(radial=radial, stiffness=3e5, loss=20.0, start=(radial, 0.0))})
        simulation = simulate(made, 3.0 * quarter, tolerance=1e-5)
        moved = simulation.view(t)
        forces = simulation.forces(moved)
        off = forces.reaction("B")[:, :2] - wanted
        means.append(np.abs(off.mean(axis=0)).max())
        spreads.append(np.sqrt((off**2).mean()))
        places.append(np.abs(moved.point("slider", "C")[:, 0] - motion.point("slider", "C")[:, 0]).max())
        assert np.abs(forces.power_balance).max() < 1e-9 and abs(simulation.drift(t[-1:])[0]) < 1e-5
    largest = np.abs(wanted).max()
    assert spreads[0] > spreads[1] > spreads[2] and spreads[2] < 0.05 * largest
    assert means[1] < 0.02 * largest and means[2] < 0.005 * largest
    assert places[0] < 1.3e-3 and places[1] < 1.5e-4 and places[2] < 6e-5  # the rest is indentation


def test_what_has_no_clearance_costs_nothing(monkeypatch: pytest.MonkeyPatch):
    def never(*_: object) -> None:
        raise AssertionError("a mechanism without clearance asks for its journal")

    monkeypatch.setattr(resistance.JournalPressure, "__init__", never)
    monkeypatch.setattr(resistance.JournalFriction, "__init__", never)
    ideal = crank()
    assert with_clearances(ideal, {}) is ideal and with_ideal_joints(ideal) is ideal and not journals_of(ideal)
    simulate(mechviz.load("swinging-double-pendulum").mechanism, 0.1, tolerance=1e-4)


def test_it_is_taken_out_again():
    ideal = crank()
    made = with_clearances(ideal, {"B": Clearance(radial=1e-4, stiffness=1e7, friction=0.1, radius=0.01)})
    assert with_ideal_joints(made) == ideal
    assert len(made.links) == len(ideal.links) + 2 and len(made.loads) == 2
    with pytest.raises(MechanismError, match="clearance is for revolute joints"):
        with_clearances(ideal, {"guide": Clearance(radial=1e-4, stiffness=1e7)})


VALVE = """
units = { length = "mm", angle = "deg" }
effects = ["inertia", "friction"]
run = { duration = "2 ms", tolerance = 1e-6 }
[links]
frame = { points = { O = [0, 0], G = [0, 63], H = [0, 120], P = [60, 120] } }
cam = { points = { O = [0, 0] } }
tappet = { points = { T = [0, 0], R = [0, 40] }, mass = "0.11 kg", centre = [0, 20] }
rod = { points = { R = [0, 0], Q = [0, 40] }, mass = "0.05 kg", centre = [0, 20], inertia = "1e-5 kg m^2" }
rocker = { points = { P = [0, 0], Q = [-60, 23] }, mass = "0.1 kg", centre = [-10, 0], inertia = "5e-5 kg m^2" }
[sketch]
T = [0, 25]
R = [0, 65]
Q = [0, 105]
P = [60, 120]
[joints]
O = { revolute = ["frame", "cam"], drive = { speed = "3500 rpm", start = 145 } }
S = { prismatic = ["frame", "tappet"], at = ["G", "T"], along = [0, 1], friction = { brake = "5 N", coefficient = 0.1 } }
R = { revolute = ["tappet", "rod"], clearance = { radial = 0.1, stiffness = "300 N/mm", restitution = 0.5, speed = "0.3 m/s" } }
Q = { revolute = ["rod", "rocker"] }
P = { revolute = ["frame", "rocker"], friction = { coefficient = 0.1, radius = 8 } }
[joints.K]
cam = ["cam", "tappet"]
follower = { flat = true, guide = "S", point = "T", face = [20, 20] }
liftoff = { restitution = 0.2 }
[joints.K.profile]
base = 25
phase = -110
lift = [{ over = 70, to = 8.5, law = "3-4-5" }, { over = 70, to = 0, law = "3-4-5" }, { over = 220 }]
[loads]
spring = { spring = ["frame.H", "tappet.R"], stiffness = "30 N/mm", free_length = 70 }
"""


def test_a_loose_pin_beside_dry_friction_and_a_follower_that_flies():
    """Valve train: the tappet leaves the cam and lands, its pin rattles, guide and rocker rub; all balances hold."""
    scene = mechviz.loads(VALVE)
    assert mechviz.loads(scene.to_toml()) == scene and scene.simulation is not None
    simulation = simulate(
        scene.mechanism, scene.simulation.duration, tolerance=1e-6, separable_cams=scene.simulation.separable_cams
    )
    assert {("lost", "K"), ("impact", "K"), ("slip", "S"), ("slip", "P")} <= {(h.kind, h.item) for h in simulation.events}
    t = np.linspace(0.0, simulation.duration, 181)
    view = simulation.view(t)
    forces, energies = simulation.forces(view), simulation.energies(t)
    size = np.abs(energies).max()
    assert np.ptp(energies[:, 0] + energies[:, 1] - energies[:, 2] + energies[:, 3]) < 1e-5 * size
    assert np.all(np.diff(energies[:, 3]) > -1e-12 * size) and np.abs(forces.power_balance).max() < 1e-12
    gap, contact = simulation.gap("K", view), contact_force(forces, placed_cams(view)[0])
    assert gap.max() > 1e-4 and np.all((np.abs(gap) < 1e-11) | (np.abs(contact) < 1e-9 * contact.max()))
    play = np.hypot(*(view.coordinate(name)[:, 0] for name in ("R.across", "R.journal")))
    touching = np.hypot(*forces.reaction("R")[:, :2].T) > 1e-9
    assert (play < 1e-4).any() and touching.any() and not np.any(touching & (play <= 1e-4))  # flies, or presses
    reaction, spin = np.hypot(*forces.reaction("P")[:, :2].T), view.coordinate("P")[:, 1]
    slides = np.abs(spin) > 1e-3
    assert forces.friction.wrench("P")[slides, 2] == pytest.approx(-8e-4 * (np.sign(spin) * reaction)[slides], rel=1e-9)


# --- scenes -----------------------------------------------------------------------------------------------------------


def test_a_scene_reads_its_units_and_writes_them_back():
    scene = mechviz.load("loose-coupler-pin")
    load = journals_of(scene.mechanism)["B"]
    assert (load.radial, load.stiffness, load.exponent) == pytest.approx((4e-4, 2e5, 1.0), rel=1e-12)
    assert scene.simulation is not None and scene.simulation.duration == 0.4
    again = mechviz.loads(scene.to_toml())
    assert again == scene and journals_of(again.mechanism) == journals_of(scene.mechanism)


def test_a_recording_shows_the_ideal_links_and_the_gap(tmp_path):
    short = mechviz.loads(SCENE.replace('duration = "0.4 s"', 'duration = "0.05 s"').replace("frames = 720", "frames = 60"))
    path = tmp_path / "loose.rrd"
    run = run_scene(short)
    write_recording(run, path)
    recording = Recording(path)
    assert not any("B.across" in entity or "B.journal" in entity for entity in recording.entities)
    gap = recording.scalars("data", "joints", "B", "journal")[1][:, 2]
    assert gap[0] == pytest.approx(4e-4) and gap.min() < 0.0
    touching = np.abs(run.forces.reaction("B")[:, :2]).max(axis=1) > 1e-9
    assert np.array_equal(touching, gap < 0.0)


def test_the_moment_of_friction_in_a_bearing_is_a_quantity():
    rubbing = SCENE.replace('speed = "0.2 m/s"', 'speed = "0.2 m/s", radius = "10 mm", friction = 0.1')
    run = run_scene(
        mechviz.loads(rubbing.replace('duration = "0.4 s"', 'duration = "0.02 s"').replace("frames = 720", "frames = 30"))
    )
    couple = run.catalogue["joint.B.couple"]
    np.testing.assert_array_equal(couple.values()[:, 0], run.forces.reaction("B")[:, 2])
    assert couple.unit == "N m" and np.abs(couple.values()).max() > 0.0
    assert "joint.A.couple" not in run.catalogue.by_key  # without clearance and friction


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (', speed = "0.2 m/s"', "", "a restitution at which speed?"),
        ('speed = "0.2 m/s"', "speed = 0", "an impact at no speed"),
        ("radial = 0.4", "radial = 0", "radial"),
        ("radial = 0.4", "radail = 0.4", "Did you mean 'radial'?"),
        ("restitution = 0.5", "restitution = 0", "no coefficient of restitution of a bearing"),
        ("restitution = 0.5", "restitution = 0.5, friction = 0.1", "friction without the radius of the journal"),
        ("restitution = 0.5", "restitution = 0.5, exponent = 0.5", "no exponent of a contact"),
        ('stiffness = "200 N/mm"', 'stiffness = "200 N m/rad"', "torsional stiffness"),
        ('effects = ["inertia"]', "effects = []", "B has clearance, motion under forces needs masses"),
        ("[joints.B]", "[joints.B]\nfriction = { coefficient = 0.1 }", "friction of a joint with clearance"),
        ('duration = "0.4 s"', "cycles = 2", "'duration' is missing: how long does B move?"),
        ("frame = {", '"B.journal" = { points = { A = [0, 0] } }\nframe = {', "which is taken"),
        ('C = { revolute = ["rod", "piston"] }', 'C = { revolute = ["rod", "piston"], clearance = {} }', "radial"),
        ('S = { prismatic = [', 'S = { clearance = { radial = 1, stiffness = 1 }, prismatic = [', "does not go with a prismatic"),
    ],
)  # fmt: skip
def test_faults_name_the_item_and_the_remedy(old: str, new: str, words: str):
    assert old in SCENE
    with pytest.raises(mechviz.SceneError) as error:
        mechviz.loads(SCENE.replace(old, new))
    assert words in " ".join(str(error.value).split())
