"""Several freedoms through places where their coordinates do not decide the configuration: other joints lead there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dynamic_mechanisms import double_pendulum, pendulum, swinging_five_bar
from mechanisms import case

from mechcore.dynamics import active_chart
from mechcore.dynamics.equations.charts import strain
from mechcore.dynamics.simulate import simulate
from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.spec.loads import Torque
from mechcore.spec.mechanism import Cylinder, Drive, Friction, Gear, Link, Mechanism, Revolute, Screw
from mechviz.hard_cases.mechanisms import four_bar, pin

END = 1.1
TIMES = np.linspace(0.0, END, 61)
POINTS = (("left", "B"), ("left rod", "C"), ("right", "D"))


def falling() -> Mechanism:
    """A five-bar without springs: its rods come in line, and so do rods and arms."""
    return replace(swinging_five_bar(speeds=(6.0, 2.0)), loads=())


def leads(simulation) -> list[str]:
    return ["".join(d.joint for d in p.compiled.mechanism.drives) for p in simulation.segments]


def restated(mechanism: Mechanism, simulation, t: float, joints: str, sense: float = 1.0) -> Mechanism:
    """The mechanism as a simulation has it at a time, with other free joints, and its speeds in either sense."""
    motion = simulation.motion([t])
    drives = []
    for joint in joints:
        q, v, _ = motion.coordinate(joint)[0]
        drives.append(Drive(joint=joint, law=Free(float(q), sense * float(v))))
    poses = {link.name: tuple(map(float, motion.pose(link.name)[0])) for link in mechanism.links[1:]}
    return replace(mechanism, drives=tuple(drives), modes={}, sketch=poses)


@pytest.fixture(scope="module")
def fallen():
    return simulate(falling(), END, tolerance=1e-10)


def test_rods_come_in_line_and_go_on(fallen):
    assert leads(fallen)[0] == "AE" and len(set(leads(fallen))) > 1
    motion = fallen.motion(TIMES)
    bend = np.unwrap(motion.coordinate("C")[:, 0])
    assert (np.diff(np.sign(np.sin(bend))) != 0).any()  # they are in line on the way
    assert motion.closure.max() < 1e-12
    assert np.abs(fallen.drift(TIMES)).max() < 1e-9
    q, v, _ = fallen(TIMES)
    for k, joint in enumerate("AE"):  # the stated coordinates go on being told, without a jump of a turn
        assert np.exp(1j * q[:, k]) == pytest.approx(np.exp(1j * motion.coordinate(joint)[:, 0]), abs=1e-9)
    assert np.abs(np.diff(q, axis=0)).max() < 1.5 * np.abs(v).max() * TIMES[1]
    forces = fallen.forces(motion)
    assert np.abs(forces.power_balance).max() < 1e-9


def test_the_motion_is_the_same_whoever_leads_first(fallen):
    other = simulate(restated(falling(), fallen, 0.0, "BC"), END, tolerance=1e-9)
    assert leads(other)[0] == "BC"
    for link, point in POINTS:
        at = other.motion(TIMES).point(link, point)
        assert np.abs(at - fallen.motion(TIMES).point(link, point)).max() < 1e-8


def test_time_reversal_leads_back_through_all_charts(fallen):
    back = simulate(restated(falling(), fallen, END, "AE", sense=-1.0), END, tolerance=1e-9)
    q, v, _ = back([END])
    assert np.exp(1j * q[0]) == pytest.approx(np.exp(1j * np.array([2.2, 0.9])), abs=1e-6)
    assert v[0] == pytest.approx([-6.0, -2.0], abs=1e-5)


def test_springs_count_their_turns_through_all_charts():
    body = swinging_five_bar(stiffness=0.1, speeds=(9.0, 2.0))
    simulation = simulate(replace(body, loads=body.loads[:1]), END, tolerance=1e-8)
    assert any("A" not in joints for joints in leads(simulation))
    assert np.abs(simulation.drift(TIMES)).max() < 1e-7
    q, v, _ = simulation(TIMES)
    assert np.abs(np.diff(q, axis=0) - TIMES[1] * 0.5 * (v[1:] + v[:-1])).max() < 0.3  # no jump of a turn


def test_beside_a_prescribed_drive():
    """One arm turns evenly: the only free coordinate is handed on where the rods come in line."""
    body = replace(falling(), drives=(Drive(joint="A", law=ConstantSpeed(2.2, -3.0, 9.0)), falling().drives[1]))
    simulation = simulate(body, END, tolerance=1e-8)
    assert {"AE", "DA", "BA"} <= set(leads(simulation))
    assert simulation.motion(TIMES).coordinate("A")[:, 1] == pytest.approx(-3.0, abs=1e-12)
    assert np.abs(simulation.drift(TIMES)).max() < 1e-7


def test_dead_points_are_passed_where_springs_count_the_turns_of_both_arms():
    t = np.linspace(0.0, 2.0, 121)
    simulation = simulate(swinging_five_bar(stiffness=0.1, speeds=(9.0, 2.0)), 2.0, tolerance=1e-9)
    assert len(set(leads(simulation))) > 2
    assert np.abs(simulation.drift(t)).max() < 1e-7
    q, v, _ = simulation(t)
    assert np.abs(np.diff(q, axis=0) - t[1] * 0.5 * (v[1:] + v[:-1])).max() < 0.3


def test_open_chains_and_single_freedoms_are_not_watched(monkeypatch):
    monkeypatch.setattr(active_chart, "strain", lambda *_: pytest.fail("watched"))
    simulate(double_pendulum(case("dynamics", "double-pendulum-rods")["inputs"]), 0.2, tolerance=1e-4)
    simulate(pendulum(inertia=1.0, mass=1.0, distance=1.0, angle=1.0), 0.2, tolerance=1e-4, method="gauss")


@pytest.mark.parametrize("freedoms", [1, 2])
def test_friction_goes_on_where_other_coordinates_lead(fallen, freedoms):
    """A brake in a pin that turns one way is a constant torque on its link: a four-bar whose crank turns back at a dead point
    while its rocker turns on, and a five-bar whose rods come in line."""
    if freedoms == 1:
        bars = {"crank": 0.4, "coupler": 0.25, "rocker": 0.3}
        bodies = {name: (2.0 * x, (0.5 * x, 0.0), x**3 / 6.0) for name, x in bars.items()}
        base = four_bar(0.5, *bars.values(), start=0.2, bodies=bodies, effects=("inertia", "gravity"))
        base = replace(base, drives=(Drive(joint="A", law=Free(0.2, -6.0)),))
        braked, link, moment, end = "E", "rocker", 0.2, 0.24
    else:
        base, braked, link, moment, end = restated(falling(), fallen, 0.5, "AE"), "A", "left", 0.01, 0.4
    joints = tuple(replace(p, friction=Friction(brake=moment)) if p.name == braked else p for p in base.joints)
    rubbing = simulate(replace(base, joints=joints, effects=(*base.effects, "friction")), end, tolerance=1e-10)
    t = np.linspace(0.0, end, 25)
    motion = rubbing.motion(t)
    sense = np.sign(motion.coordinate(braked)[:, 1])
    assert np.ptp(sense) == 0.0 and len({e.time for e in rubbing.events}) == 1, "it slides one way, and nothing else happens"
    assert len(set(leads(rubbing))) > 1
    torque = Torque(name="brake", link=link, moment=-moment * sense[0])
    same = simulate(replace(base, loads=(torque,)), end, tolerance=1e-10).motion(t)
    for link in base.links[1:]:
        assert np.abs(motion.pose(link.name) - same.pose(link.name)).max() < 2e-8
    assert np.abs(rubbing.drift(t)).max() < 1e-8
    assert rubbing.forces(motion).friction.wrench(braked)[:, 2] == pytest.approx(-moment * sense)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_shaft_whose_gear_does_not_come_back_after_a_turn_goes_on_in_either_sense(sense):
    """A pinion of 14 teeth drives an eccentric wheel of 51: charts of two turns follow each other; the energy is that of both."""
    wheel = Link(name="wheel", points={"B": (0.0, 0.0)}, mass=1.0, centre=(0.1, 0.0), inertia=0.01)
    pinion = Link(name="pinion", points={"A": (0.0, 0.0)}, mass=0.5, inertia=0.004)
    mechanism = Mechanism(
        name="geared",
        frame="frame",
        links=(Link(name="frame", points={"A": (0.0, 0.0), "B": (0.3, 0.0)}), pinion, wheel),
        joints=(
            pin("A", "frame", "pinion"),
            pin("B", "frame", "wheel"),
            Gear(name="G", links=("pinion", "wheel"), carrier="frame", sizes=(14.0, 51.0)),
        ),
        drives=(Drive(joint="A", law=Free(0.3 * sense, 20.0 * sense)),),
        effects=("inertia", "gravity"),
        sketch={"wheel": (0.3, 0.0, 0.0 if sense > 0 else np.pi)},
    )
    simulation = simulate(mechanism, 1.0, tolerance=1e-10)
    t = np.linspace(0.0, 1.0, 81)
    q, v, _ = (x[:, 0] for x in simulation(t))
    ratio = 14.0 / 51.0
    angle = (0.0 if sense > 0 else np.pi) - ratio * (q - q[0])
    inertia = 0.004 + (0.01 + 1.0 * 0.1**2) * ratio**2
    energy = 0.5 * inertia * v**2 + 9.81 * 0.1 * np.sin(angle)
    assert sense * (q[-1] - q[0]) > 2.2 * 2.0 * np.pi
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-9 * energy[0])


def test_a_cylinder_that_stands_still_for_an_instant_hands_over_to_the_boom():
    """Its base turns fastest where its length is least, but is no joint of the mechanism; the boom is a pendulum."""
    boom = Link(name="boom", points={"O": (0.0, 0.0), "Q": (0.45, 0.0)}, mass=1.0, centre=(0.4, 0.0), inertia=0.01)
    mechanism = Mechanism(
        name="boom",
        frame="frame",
        links=(Link(name="frame", points={"O": (0.0, 0.0), "P": (0.5, 0.0)}), boom),
        joints=(pin("O", "frame", "boom"), Cylinder(name="C", links=("frame", "boom"), points=("P", "Q"))),
        drives=(Drive(joint="C", law=Free(0.4, -2.0)),),
        effects=("inertia", "gravity"),
        sketch={"boom": (0.0, 0.0, 0.9)},
    )
    simulation = simulate(mechanism, 1.0, tolerance=1e-10)
    assert "O" in leads(simulation)
    t = np.linspace(0.0, 1.0, 81)
    rows = simulation.motion(t).coordinate("O")
    energy = 0.5 * (0.01 + 0.4**2) * rows[:, 1] ** 2 + 9.81 * 0.4 * np.sin(rows[:, 0])
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-8 * np.abs(energy[0]))
    assert rows[:, 0].min() < -0.5 < 0.5 < rows[0, 0]


def test_other_coordinates_lead_before_digits_are_lost():
    """A window of this five-bar ends where some joint turns 80 times as fast as those that lead: they change within the window."""
    mechanism = replace(swinging_five_bar(speeds=(8.96, 0.32)), loads=())
    simulation = simulate(mechanism, END, tolerance=1e-11)
    assert len(simulation.segments) > 1
    for segment in simulation.segments[:-1]:
        q, v, _ = segment.solution(np.array([segment.end]))
        assert strain(segment.compiled, q[0], v[0], segment.end) < 20.1
    assert np.abs(simulation.drift(TIMES)).max() < 1e-9


def test_a_free_cylinder_hands_over_beside_a_free_screw() -> None:
    """An arm falls through the place where its cylinder is longest. With a screw free as well there were fewer pins and slides than
    freedoms to choose from, and the run ended with an IndexError, or as a dead point."""
    joints = (
        Revolute(name="O", links=("frame", "arm"), points=("O", "O")),
        Cylinder(name="C", links=("frame", "arm"), points=("P", "Q")),
        Screw(name="S", links=("arm", "nut"), points=("Q", "N"), lead=0.1),
    )
    links = (
        Link(name="frame", points={"O": (0.0, 0.0), "P": (0.0, 0.3)}),
        Link(name="arm", points={"O": (0.0, 0.0), "Q": (0.5, 0.0)}, mass=1.0, centre=(0.3, 0.0), inertia=0.05),
        Link(name="nut", points={"N": (0.0, 0.0)}, mass=0.5, inertia=0.01),
    )
    drives = (Drive(joint="C", law=Free(0.6, 0.0)), Drive(joint="S", law=Free(0.0, 0.0)))
    falling = Mechanism(
        name="boom", frame="frame", links=links, joints=joints, drives=drives, modes={"C": "left"}, effects=("inertia", "gravity")
    )
    run = simulate(falling, 1.2, tolerance=1e-10)
    t = np.linspace(0.0, 1.2, 61)
    angle, length = (run.motion(t).coordinate(joint)[:, 0] for joint in "OC")
    assert len(run.segments) > 1 and (np.diff(np.sign(np.cos(angle))) != 0).any()  # through the lowest place
    assert length == pytest.approx(np.abs(0.5 * np.exp(1j * angle) - 0.3j), abs=1e-12)
    assert np.abs(run.drift(t)).max() < 1e-8
