"""Forward dynamics with dry friction: true stick and slip, against closed forms and balances."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from dynamic_mechanisms import pendulum, slider_crank
from mechanisms import case

from mechcore.dynamics.events import EndStop
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.laws.signals import Step
from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.motion.solve import compile_mechanism
from mechcore.spec.loads import Factor, Force, Torque
from mechcore.spec.mechanism import Belt, Drive, Friction, Joint, Link, Mechanism, Prismatic, Revolute


def _spring(stiffness: float, link: str = "mass") -> Force:
    return Force(
        name=f"spring {link}",
        link=link,
        point="P",
        vector=(1.0, 0.0),
        factor=Factor(function=lambda x: -stiffness * x, of="x", point=(link, "P")),
    )


def _sliding(name: str, first: str, second: str, points: tuple[str, str], friction: Friction | None = None) -> Prismatic:
    return Prismatic(name=name, links=(first, second), points=points, friction=friction)


def oscillator(mass: float, stiffness: float, mu: float, x0: float, v0: float = 0.0) -> Mechanism:
    """A mass on a spring, sliding on the ground."""
    return Mechanism(
        name="oscillator",
        frame="frame",
        links=(Link(name="frame", points={"G": (0.0, 0.0)}), Link(name="mass", points={"P": (0.0, 0.0)}, mass=mass)),
        joints=(_sliding("S", "frame", "mass", ("G", "P"), Friction(coefficient=mu)),),
        drives=(Drive(joint="S", law=Free(x0, v0)),),
        effects=("inertia", "gravity", "friction"),
        loads=(_spring(stiffness),),
    )


def on_a_belt(i: dict[str, Any], *, start: float = 0.0) -> Mechanism:
    """Reference case friction-stick-slip: a mass on a moving belt, held by a spring."""
    joints: tuple[Joint, ...] = (
        _sliding("belt", "frame", "belt", ("G", "G")),
        _sliding("S", "belt", "mass", ("G", "P"), Friction(coefficient=i["mu_k"], static=i["mu_s"])),
    )
    return Mechanism(
        name="belt",
        frame="frame",
        links=(
            Link(name="frame", points={"G": (0.0, 0.0)}),
            Link(name="belt", points={"G": (0.0, 0.0)}),
            Link(name="mass", points={"P": (0.0, 0.0)}, mass=i["m"]),
        ),
        joints=joints,
        drives=(
            Drive(joint="belt", law=ConstantSpeed(0.0, i["v_belt"], travel=1.0)),
            Drive(joint="S", law=Free(start, 0.0)),
        ),
        effects=("inertia", "gravity", "friction"),
        loads=(_spring(i["k"]),),
    )


def test_oscillator_loses_the_same_way_every_half_swing_and_sticks():
    reference = case("friction", "friction-oscillator")
    i, e = reference["inputs"], reference["expected"]
    simulation = simulate(oscillator(i["m"], i["k"], i["mu"], i["x0"]), 2.0, tolerance=1e-10)
    turns = [h for h in simulation.events if h.time > 0]
    assert len(turns) == len(e["turning_points"]) - 1
    for h, point in zip(turns, e["turning_points"][1:], strict=True):
        assert h.time == pytest.approx(point["t"], abs=1e-9)
        assert simulation([h.time])[0][0, 0] == pytest.approx(point["x"], abs=1e-10)
    assert turns[-1].kind == "stick"
    assert simulation([2.0])[0][0, 0] == pytest.approx(e["final_position"], abs=1e-10)
    for s in e["samples"]:
        q, v, _ = (x[0, 0] for x in simulation([s["t"]]))
        assert (q, v) == pytest.approx((s["x"], s["v"]), abs=1e-9)
    t = np.linspace(0.0, 2.0, 201)
    assert np.abs(simulation.drift(t)).max() < 1e-9
    forces = simulation.forces(simulation.motion(t))
    assert np.abs(forces.power_balance).max() < 1e-9
    held = t > e["stop_time"]
    pull = i["k"] * e["final_position"]  # sticking friction holds the spring
    assert forces.friction.applied("S")[held, 0] == pytest.approx(pull, abs=1e-8)
    assert np.abs(forces.effort("S")).max() < 1e-7


def test_pendulum_with_a_brake_in_its_pin():
    """Reference case friction-pendulum-constant-torque: turning angles by energy, until it stops short of the bottom."""
    reference = case("friction", "friction-pendulum-constant-torque")
    i, angles = reference["inputs"], [a["theta"] for a in reference["expected"]["turning_angles"]]
    body = pendulum(inertia=i["J_O"], mass=i["m"], distance=i["d"], angle=np.radians(i["theta0_deg"]), g=i["g"])
    pin = dataclasses.replace(body.joints[0], friction=Friction(brake=i["T_f"]))
    simulation = simulate(
        dataclasses.replace(body, joints=(pin,), effects=("inertia", "gravity", "friction")), 20.0, tolerance=1e-10
    )
    turns = [h for h in simulation.events if h.time > 0]
    computed = [float(simulation([h.time])[0][0, 0]) + np.pi / 2 for h in turns]
    assert computed == pytest.approx(angles[1:], abs=1e-9)
    assert [h.kind for h in turns] == ["slip"] * (len(turns) - 1) + ["stick"]
    assert abs(computed[-1]) < reference["expected"]["stop_angle"] < abs(computed[-2])


def test_pendulum_whose_friction_depends_on_the_reaction():
    reference = case("friction", "friction-pendulum-reaction-dependent")
    i, e = reference["inputs"], reference["expected"]
    body = pendulum(inertia=i["J_O"], mass=i["m"], distance=i["d"], angle=i["theta0"], g=i["g"])
    pin = dataclasses.replace(body.joints[0], friction=Friction(coefficient=i["mu"], radius=i["r_pin"]))
    body = dataclasses.replace(body, joints=(pin,), effects=("inertia", "gravity", "friction"))
    simulation = simulate(body, 30.0, tolerance=1e-10)
    turns = [h.time for h in simulation.events if h.time > 0]
    for time, angle in zip(turns, e["turning_angles"][1:], strict=False):
        assert simulation([time])[0][0, 0] + np.pi / 2 == pytest.approx(angle, abs=1e-10)
    for s in e["samples"]:
        q, v, _ = (x[0, 0] for x in simulation([s["t"]]))
        assert (q + np.pi / 2, v) == pytest.approx((s["theta"], s["omega"]), abs=1e-9)
    assert simulation.events[-1].kind == "stick"
    assert abs(simulation([30.0])[0][0, 0] + np.pi / 2) < e["stick_angle"]
    assert np.abs(simulation.drift(np.linspace(0.0, 30.0, 100))).max() < 1e-8


def test_stick_slip_is_periodic():
    for e in case("friction", "friction-stick-slip")["expected"]:
        i = e["inputs"]
        simulation = simulate(on_a_belt(i), 6 * e["period"], tolerance=1e-10)
        slips = [h.time for h in simulation.events if h.kind == "slip"]
        sticks = [h.time for h in simulation.events if h.kind == "stick"]
        assert slips[0] == pytest.approx(e["spring_force_at_slip_onset"] / i["k"] / i["v_belt"], rel=1e-9)
        assert np.diff(slips) == pytest.approx(e["period"], abs=1e-9)
        assert np.array(sticks[:4]) - slips[:4] == pytest.approx(e["slip_duration"], abs=1e-9)
        t = np.linspace(0.0, simulation.duration, 400)
        place = simulation.motion(t).point("mass", "P")[:, 0]
        assert place.max() == pytest.approx(e["max_deflection"], rel=1e-3)
        forces = simulation.forces(simulation.motion(t))
        assert np.abs(forces.power_balance).max() < 1e-9
        assert np.abs(forces.effort("S")).max() < 1e-9 * i["m"] * i["g"]  # nothing but friction and spring moves the mass
        assert np.abs(simulation.drift(t)).max() < 1e-7


def test_slider_crank_runs_down_and_stays():
    """Friction in all joints at once: the crank comes to rest; every loss is friction's; the balance holds in every frame."""
    i = case("dynamics", "forward-slider-crank")["inputs"]
    mechanism = slider_crank({**i, "torque": 0.0, "omega_1_0": 30.0})
    joints = []
    for joint in mechanism.joints:
        friction = (
            Friction(coefficient=0.15, length=0.04) if isinstance(joint, Prismatic) else Friction(coefficient=0.1, radius=0.01)
        )
        joints.append(dataclasses.replace(joint, friction=friction))
    mechanism = dataclasses.replace(mechanism, joints=tuple(joints), effects=("inertia", "gravity", "friction"))
    simulation = simulate(mechanism, 6.0, tolerance=1e-8)
    assert {h.kind for h in simulation.events} <= {"stick", "slip"}
    q, v, a = (x[:, 0] for x in simulation([5.9, 6.0]))
    assert v == pytest.approx(0.0, abs=1e-12)
    assert a == pytest.approx(0.0, abs=1e-12)
    assert q[0] == pytest.approx(q[1], abs=1e-12)
    rest = next(h.time for h in reversed(simulation.events))
    t = np.linspace(0.0, rest * 0.999, 300)
    motion = simulation.motion(t)
    forces = simulation.forces(motion)
    assert np.abs(forces.power_balance).max() < 1e-8
    assert np.abs(simulation.drift(t)).max() < 1e-6
    assert forces.power_by_cause(["dry friction"]).max() <= 1e-12
    # without friction it runs on for ever with the same energy
    free = simulate(dataclasses.replace(mechanism, effects=("inertia", "gravity")), 6.0)
    assert free([6.0])[0][0, 0] > 2 * q[1]


def test_two_masses_stick_one_after_the_other():
    """Two masses on one spring on the ground: each sticks and slips by itself; energy goes to friction alone."""
    grip = Friction(coefficient=0.2)

    def apart(x: Any) -> Any:
        return 400.0 * (np.asarray(x) - 0.5)

    link = Factor(function=apart, of="position", joint="between")
    mechanism = Mechanism(
        name="two",
        frame="frame",
        links=(
            Link(name="frame", points={"G": (0.0, 0.0)}),
            Link(name="first", points={"P": (0.0, 0.0)}, mass=1.0),
            Link(name="second", points={"P": (0.0, 0.0)}, mass=2.0),
            Link(name="rod", points={"P": (0.0, 0.0)}),
        ),
        joints=(
            _sliding("left", "frame", "first", ("G", "P"), grip),
            _sliding("right", "frame", "second", ("G", "P"), grip),
            _sliding("between", "first", "rod", ("P", "P")),
            Prismatic(name="tied", links=("rod", "second"), points=("P", "P"), along=(0.0, 1.0)),
        ),
        drives=(Drive(joint="left", law=Free(0.0, 0.0)), Drive(joint="right", law=Free(0.6, 0.0))),
        effects=("inertia", "gravity", "friction"),
        loads=(
            Force(name="pull", link="first", point="P", vector=(1.0, 0.0), factor=link),
            Force(name="back", link="second", point="P", vector=(-1.0, 0.0), factor=link),
        ),
    )
    simulation = simulate(mechanism, 3.0, tolerance=1e-9)
    t = np.linspace(0.0, 3.0, 301)
    q, v, _ = simulation(t)
    assert {h.item for h in simulation.events if h.kind == "slip"} == {"left", "right"}
    assert np.abs(v[-1]).max() < 1e-12
    stretch = q[-1, 1] - q[-1, 0] - 0.5
    assert abs(400.0 * stretch) <= 0.2 * 1.0 * 9.81 * (1 + 1e-9)  # what is left holds at the weaker grip
    # work of friction: each mass's own weight times its own way
    way = np.array([np.abs(np.diff(simulation(np.linspace(0.0, 3.0, 20001))[0][:, k])).sum() for k in (0, 1)])
    stored = 0.5 * 400.0 * (0.1**2 - stretch**2)
    assert 0.2 * 9.81 * (1.0 * way[0] + 2.0 * way[1]) == pytest.approx(stored, rel=1e-5)


def test_jam_in_motion_is_refused_in_words():
    """A long thin rod sliding on rough ground far beyond the limit of Painleve: no acceleration is in balance."""
    steep = Friction(coefficient=3.0, length=0.01)
    mechanism = Mechanism(
        name="sleeve",
        frame="frame",
        links=(
            Link(name="frame", points={"G": (0.0, 0.0)}),
            Link(name="sleeve", points={"P": (0.0, 0.0)}, mass=1.0, centre=(0.0, 0.4), inertia=0.05),
        ),
        joints=(_sliding("S", "frame", "sleeve", ("G", "P"), steep),),
        drives=(Drive(joint="S", law=Free(0.0, 1.0)),),
        effects=("inertia", "gravity", "friction"),
        loads=(Force(name="push", link="sleeve", point="P", vector=(1.0, 0.0)),),
    )
    with pytest.raises(MechanismError, match=r"joints\.S\.friction"):
        simulate(mechanism, 1.0)


def test_the_only_joint_that_rubs_turns_back_at_dead_points_while_the_crank_goes_on():
    """There its relative speed is zero, but nothing rests: friction has to change its sense, and it never drives."""
    import mechviz

    text = mechviz.load("crushing-press").text.replace('effects = ["inertia"', 'effects = ["friction", "inertia"')
    text = text.replace('branch = "ahead" }', 'branch = "ahead", friction = { coefficient = 0.1 } }')
    mechanism = mechviz.loads(text.replace("free = { position = 90 }", 'free = { position = 97, speed = "110 rpm" }')).mechanism
    simulation = simulate(mechanism, 0.6, tolerance=1e-8)
    assert [h.kind for h in simulation.events] == ["slip"] * len(simulation.events)
    words = [h.text[-11:-10] for h in simulation.events]
    assert words[:3] == ["+", "-", "+"]
    t = np.linspace(0.0, 0.6, 300)
    losses = simulation.forces(simulation.motion(t)).friction.losses("S")
    assert losses.min() > -1e-9 * losses.max()


@pytest.mark.parametrize("e", [0.5, 0.0])
def test_friction_brakes_after_an_impact_too(e: float):
    """A block slides to a wall and back: v^2 falls by 2 mu g a metre on both ways, to e^2 of it at the wall."""
    mechanism = dataclasses.replace(oscillator(2.0, 0.0, 0.3, 0.0, 3.0), loads=())
    simulation = simulate(mechanism, 2.0, stops=[EndStop(name="wall", joint="S", at=0.6, restitution=e)])
    back = e**2 * (9.0 - 2 * 0.3 * 9.81 * 0.6) / (2 * 0.3 * 9.81)
    q, v, _ = simulation([2.0])
    assert q[0, 0] == pytest.approx(0.6 - back, abs=1e-9) and abs(v[0, 0]) < 1e-12
    assert {h.kind for h in simulation.events} == {"slip", "impact", "stick"}  # held by friction, the wall has nothing to hold
    energies = simulation.energies(np.linspace(0.0, 2.0, 101))
    assert np.all(np.diff(energies[:, 3]) >= 0.0)
    assert energies[-1] == pytest.approx([0.0, 0.0, 0.0, 9.0], abs=1e-9)


@pytest.mark.parametrize("beside", ["nothing", "another mass", "a stop"])
def test_a_load_that_jumps_breaks_what_sticks_loose(beside: str):
    """From one instant to the next it is more than friction can hold, which then brakes: s = (F - mu m g) t^2 / 2 m."""
    push = Force(name="push", link="mass", point="P", vector=(8.0, 0.0), factor=Factor(function=Step(at=0.5), of="time"))
    m, stops = dataclasses.replace(oscillator(2.0, 0.0, 0.3, 0.0), loads=(push,)), []
    if beside == "another mass":
        m = dataclasses.replace(
            m,
            links=(*m.links, Link(name="other", points={"P": (0.0, 0.0)}, mass=1.0)),
            joints=(*m.joints, _sliding("T", "frame", "other", ("G", "P"))),
            drives=(*m.drives, Drive(joint="T", law=Free(0.0, 1.0))),
        )
    if beside == "a stop":
        back = Force(name="back", link="mass", point="P", vector=(-8.0, 0.0))
        m = dataclasses.replace(m, loads=(back, dataclasses.replace(push, vector=(16.0, 0.0))))
        stops = [EndStop(name="wall", joint="S", at=0.0, side="lower")]
    simulation = simulate(m, 1.0, stops=stops)
    acceleration = (8.0 - 0.3 * 2.0 * 9.81) / 2.0
    assert simulation.events[-1].text == "S slides in the + direction" and simulation.events[-1].time == pytest.approx(
        0.5, abs=1e-12
    )
    expected = [0.5 * acceleration * 0.5**2, acceleration * 0.5, acceleration]
    np.testing.assert_allclose(simulation.motion([0.5, 1.0]).coordinate("S"), [[0.0, 0.0, 0.0], expected], atol=1e-10)
    assert np.ptp(simulation.drift(np.linspace(0.0, 1.0, 50))) < 1e-9


def test_what_rests_on_a_stop_between_two_moving_masses_slides_on_together():
    """One mass runs into another and pushes it along: contact at a joint that no free coordinate is, friction of both."""
    mechanism = Mechanism(
        name="two",
        frame="frame",
        links=(
            Link(name="frame", points={"G": (0.0, 0.0)}),
            Link(name="rear", points={"P": (0.0, 0.0)}, mass=1.0),
            Link(name="front", points={"P": (0.0, 0.0)}, mass=2.0),
            Link(name="rod", points={"P": (0.0, 0.0)}),
        ),
        joints=(
            _sliding("rear", "frame", "rear", ("G", "P"), Friction(coefficient=0.1)),
            _sliding("front", "frame", "front", ("G", "P"), Friction(coefficient=0.3)),
            _sliding("between", "rear", "rod", ("P", "P")),
            Prismatic(name="tied", links=("rod", "front"), points=("P", "P"), along=(0.0, 1.0)),
        ),
        drives=(Drive(joint="rear", law=Free(0.0, 3.0)), Drive(joint="front", law=Free(0.5, 0.0))),
        effects=("inertia", "gravity", "friction"),
    )
    simulation = simulate(mechanism, 1.0, stops=[EndStop(name="buffer", joint="between", at=0.2, side="lower")])
    assert [h.kind for h in simulation.events if h.item == "buffer"][:2] == ["impact", "contact"]
    speed = np.sqrt(9.0 - 2 * 0.1 * 9.81 * 0.3) / 3.0  # of both after the impact
    brake = (0.1 * 1.0 + 0.3 * 2.0) * 9.81 / 3.0
    hit = next(h.time for h in simulation.events if h.kind == "impact")
    t = hit + np.linspace(0.01, 0.9, 7) * speed / brake
    q, v, a = simulation(t)
    assert q[:, 1] - q[:, 0] == pytest.approx(0.2, abs=1e-9) and v[:, 0] == pytest.approx(v[:, 1], abs=1e-9)
    assert v[:, 0] == pytest.approx(speed - brake * (t - hit), abs=1e-8) and a == pytest.approx(-brake, rel=1e-9)
    push = simulation.forces(simulation.view(t)).loads["stop buffer"].values[:, 0]
    assert np.abs(push) == pytest.approx(2.0 * (0.3 * 9.81 - brake), rel=1e-8)
    assert simulation([1.0])[0][0] == pytest.approx([0.3 + speed**2 / (2 * brake), 0.5 + speed**2 / (2 * brake)], abs=1e-8)


LINKS = """
units = { angle = "deg" }
effects = ["inertia", "gravity", "friction"]
run = { duration = "2 s" }
[links]
frame = { points = { O = [0, 0] } }
upper = { points = { O = [0, 0], J = [0.5, 0] }, mass = 1, centre = [0.25, 0], inertia = 0.03 }
lower = { points = { J = [0, 0], E = [0.4, 0] }, mass = 0.7, centre = [0.2, 0], inertia = 0.02 }
[joints.J]
revolute = ["upper", "lower"]
free = { position = 40 }
friction = { coefficient = 0.15, radius = "20 mm", static = 0.2 }
stops = [{ at = -5, side = "lower", restitution = 0.3 }, { at = 60, side = "upper" }]
[joints.O]
revolute = ["frame", "upper"]
friction = { coefficient = 0.1, radius = "20 mm" }
"""


@pytest.mark.parametrize(
    "lead, kinds",
    [
        ("free = { position = -10 }", {"slip J", "slip O", "impact J lower", "contact J lower", "release J lower"}),
        ('drive = { oscillation = { amplitude = 40, period = "1 s" } }', {"slip J", "slip O", "impact J upper", "contact J upper"}),
    ],
)
def test_stops_impacts_and_prescribed_drives_beside_friction(lead: str, kinds: set[str]):
    """Several coordinates, held by stops, led by a drive: nothing that rubs drives, and the works close through every event."""
    import mechviz

    scene = mechviz.loads(LINKS + lead)
    assert scene.simulation is not None
    simulation = simulate(scene.mechanism, 2.0, stops=scene.simulation.stops)
    assert kinds <= {f"{h.kind} {h.item}" for h in simulation.events}
    t = np.linspace(0.0, 2.0, 201)
    view = simulation.view(t)
    forces, energies = simulation.forces(view), simulation.energies(t)
    size = np.abs(energies).max()
    assert np.ptp(energies[:, 0] + energies[:, 1] - energies[:, 2] + energies[:, 3]) < 1e-8 * size
    assert np.all(np.diff(energies[:, 3]) > -1e-12 * size) and energies[-1, 3] > 0.1 * size
    assert np.abs(forces.power_balance).max() < 1e-12
    for joint, radius in (
        ("O", 0.002),
        ("J", 0.003),
    ):  # friction is at its limit while the joint slides
        reaction = np.hypot(*forces.reaction(joint)[:, :2].T)
        moment, rate = forces.friction.wrench(joint)[:, 2], view.coordinate(joint)[:, 1]
        slides = np.abs(rate) > 1e-6
        assert moment[slides] == pytest.approx(-np.sign(rate[slides]) * radius * reaction[slides], rel=1e-9)
        assert np.all(np.abs(moment) <= radius / 0.15 * 0.2 * reaction * (1 + 1e-9) + 1e-12)


@pytest.mark.sample(2)
@pytest.mark.parametrize("tolerance", [1e-8, 1e-9, 1e-10])
def test_a_stop_with_friction_at_its_joint_lets_go_and_never_pulls(tolerance):
    """The lower bar rests on a stop, friction holds it for an instant after the load on the stop has gone, then it leaves."""
    bar = {"mass": 1.2, "centre": (0.15, 0.0), "inertia": 0.009}
    links = (
        Link(name="frame", points={"O": (0.0, 0.0)}),
        Link(name="upper", points={"O": (0.0, 0.0), "J": (0.3, 0.0)}, **bar),
        Link(name="lower", points={"J": (0.0, 0.0)}, mass=0.9, centre=(0.13, 0.0), inertia=0.00507),
    )
    hinge = Friction(coefficient=0.2, radius=0.01)
    joints = (
        Revolute(name="O", links=("frame", "upper"), points=("O", "O")),
        Revolute(name="J", links=("upper", "lower"), points=("J", "J"), friction=hinge),
    )
    start = (Drive(joint="O", law=Free(np.radians(40.0), 0.0)), Drive(joint="J", law=Free(np.radians(50.0), 0.0)))
    m = Mechanism(
        name="d", frame="frame", links=links, joints=joints, drives=start, effects=("inertia", "gravity", "friction"), loads=()
    )
    stop = EndStop(name="low", joint="J", at=float(np.radians(45.0)), side="lower", restitution=0.4)
    high = EndStop(name="high", joint="J", at=float(np.radians(55.0)), side="upper", restitution=1.0)
    run = simulate(m, 0.92, tolerance=tolerance, stops=[stop, high])
    held = []
    for segment in run.segments:
        for _ in segment.resting:
            t = np.linspace(segment.start, segment.end, 9)
            q, v, _ = segment.solution(t)
            held.append(segment.system.holding(q, v, t))
    assert held and min(float(h.min()) for h in held) > -1e-9
    assert max(float(h.max()) for h in held) > 0.1
    left = [h.time for h in run.events if h.kind == "release"]
    assert len(left) == len(set(left)) and not {h.time for h in run.events if h.kind == "contact"} & set(left)
    assert float(run(np.array([left[-1] + 0.1]))[0][0, 1]) > stop.at + 0.05


@pytest.mark.parametrize("executor", ["numpy", "c"])
def test_friction_decides_which_span_of_a_belt_carries(executor: Any) -> None:
    """A wheel that would drive another one by its torque is braked by its bearing, so that the other span is tight. The bearings'
    friction was that under the span that is tight without friction: it was off by a third."""
    bearing = Friction(coefficient=0.3, radius=0.05)
    links = (
        Link(name="frame", points={"A": (0.0, 0.0), "B": (0.6, 0.2)}),
        Link(name="first", points={"A": (0.0, 0.0)}, inertia=0.02),
        Link(name="second", points={"B": (0.0, 0.0)}, mass=8.0, inertia=0.02),
    )
    joints = (
        Revolute(name="A", links=("frame", "first"), points=("A", "A")),
        Revolute(name="B", links=("frame", "second"), points=("B", "B"), friction=bearing),
        Belt(name="V", links=("first", "second"), carrier="frame", radii=(0.05, 0.15)),
    )
    loads = (Torque(name="M", link="second", moment=0.6),)
    drives = (Drive(joint="A", law=Free(0.0, 30.0)),)
    made = {"links": links, "joints": joints, "drives": drives, "loads": loads}
    m = Mechanism(name="belt", frame="frame", **made, effects=("inertia", "gravity", "friction"))
    run = simulate(compile_mechanism(m, executor=executor), 0.1)
    t = np.linspace(0.0, 0.1, 5)
    motion = run.motion(t)
    forces = run.forces(motion)
    without = simulate(dataclasses.replace(m, effects=("inertia", "gravity")), 0.1)
    pulls = [f.reaction("V")[:, :2] for f in (forces, without.forces(without.motion(t)))]
    assert np.abs(pulls[0][0, 1] / pulls[0][0, 0] - pulls[1][0, 1] / pulls[1][0, 0]) > 0.1  # another span
    normal = np.hypot(*forces.reaction("B")[:, :2].T)
    np.testing.assert_allclose(forces.friction.applied("B")[:, 2], -0.3 * 0.05 * normal, rtol=1e-9)
    assert np.abs(run.drift(t)).max() < 1e-9
