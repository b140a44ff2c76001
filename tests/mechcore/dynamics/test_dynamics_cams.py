"""Followers that may leave their cams: onset against the closed form, flight, landing, recordings."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from cam_mechanisms import oscillating, translating

import mechviz
from mechcore.cams.closures import Closure, first_separation
from mechcore.cams.followers import Flat, Roller
from mechcore.dynamics.events import SeparableCam
from mechcore.dynamics.simulate import simulate
from mechcore.errors import MechanismError
from mechcore.forces.cam_rating import contact_force, placed_cams
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import ConstantSpeed, Free
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Force, Torque
from mechcore.spec.mechanism import CamJoint, Drive, Friction, Mechanism
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.quantities.events import events_of, lanes_of
from mechviz.quantities.tables import tables
from mechviz.runs import run_scene

MASS, STIFFNESS, CLOSED = 0.4, 4e3, 0.06 + 0.05  # of `translating` with a roller of 10 mm; spring's deflection at zero lift
G = 9.81


def at_speed(mechanism: Mechanism, speed: float) -> Mechanism:
    return replace(mechanism, drives=(Drive(joint="O", law=ConstantSpeed(start=0.0, speed=speed)),))


def lift_of(mechanism: Mechanism):
    return next(p.lift for p in mechanism.joints if isinstance(p, CamJoint))


def onset() -> tuple[Mechanism, float, float]:
    mechanism = translating(Roller(0.01))
    separation = first_separation(Closure(MASS, STIFFNESS, CLOSED, G), lift_of(mechanism))
    assert separation is not None
    return mechanism, separation.speed, separation.angle


def contact_at(mechanism: Mechanism, speed: float) -> np.ndarray:
    """Contact force over a turn by kinetostatics of the mechanism held on its cam."""
    motion = solve_motion(compile_mechanism(at_speed(mechanism, speed)), np.linspace(0.0, 2 * np.pi / speed, 721))
    return contact_force(solve_forces(motion), placed_cams(motion)[0])


def turns(mechanism: Mechanism, speed: float, count: float = 1.0, e: float = 0.3):
    return simulate(at_speed(mechanism, speed), count * 2 * np.pi / speed, separable_cams=[SeparableCam(joint="K", restitution=e)])


def test_onset_speed_and_place_agree_with_the_closed_form():
    mechanism, speed, angle = onset()
    assert not turns(mechanism, speed * (1 - 1e-7)).events
    first = turns(mechanism, speed * (1 + 1e-7)).events[0]
    assert first.kind == "lost" and first.item == "K"
    assert first.time * speed == pytest.approx(angle, abs=2e-3)  # it only just begins there


@pytest.mark.parametrize(
    "mechanism",
    [
        oscillating(Flat(left=0.1, right=0.1), pivot=(-0.1, 0.0), base=0.03, stroke=0.15),
        oscillating(Roller(0.012), side="right", sense=-1),
    ],
)
def test_an_oscillating_follower_is_lost_where_kinetostatics_would_have_to_pull(mechanism: Mechanism):
    push = 60.0 if contact_at(mechanism, 1.0).max() < 0.0 else -60.0
    mechanism = replace(mechanism, loads=(Force(name="push", link="follower", point="E", vector=(0.0, push)),))

    low, high = 10.0, 2000.0
    assert contact_at(mechanism, low).min() > 0.0 > contact_at(mechanism, high).min()
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if contact_at(mechanism, middle).min() > 0.0 else (low, middle)
    assert not turns(mechanism, 0.999 * low).events
    simulation = turns(mechanism, 1.001 * low, e=0.0)
    assert [h.kind for h in simulation.events[:2]] == ["lost", "regained"]


def test_flight_is_that_of_a_mass_on_its_spring():
    mechanism, speed, _ = onset()
    simulation = turns(mechanism, 1.3 * speed, e=0.5)
    lost, hit = simulation.events[0].time, simulation.events[1].time
    t = np.linspace(lost, hit, 40)
    y = simulation.view(t).coordinate("S")
    w = np.sqrt(STIFFNESS / MASS)
    rest = 0.14 - 0.2 - MASS * G / STIFFNESS  # height of the point at which spring and weight are balanced
    a, b = y[0, 0] - rest, y[0, 1] / w
    expected = rest + a * np.cos(w * (t - lost)) + b * np.sin(w * (t - lost))
    assert y[:, 0] == pytest.approx(expected, abs=1e-9)
    assert y[1:-1, 2] == pytest.approx(-(w**2) * (expected - rest)[1:-1], rel=1e-7)


def test_contact_presses_or_is_open_and_energy_closes_through_every_impact():
    mechanism, speed, _ = onset()
    simulation = turns(mechanism, 1.3 * speed, count=2.0, e=0.4)
    t = np.linspace(0.0, simulation.duration, 501)
    view = simulation.view(t)
    forces, gap = simulation.forces(view), simulation.gap("K", view)
    force = contact_force(forces, placed_cams(view)[0])
    size = np.abs(force).max()
    assert gap.min() > -1e-12 and force.min() > -1e-9 * size
    assert np.all((gap < 1e-12) | (np.abs(force) < 1e-12 * size))  # complementarity
    assert gap.max() > 1e-3 and (force > 0.1 * size).any()
    assert np.abs(simulation.drift(t)).max() < 1e-9
    assert np.abs(forces.power_balance).max() < 1e-10
    energies = simulation.energies(t)
    assert np.ptp(energies[:, 0] + energies[:, 1] - energies[:, 2] + energies[:, 3]) < 1e-9 * np.abs(energies).max()
    assert energies[-1, 3] > 0.0 and np.all(np.diff(energies[:, 3]) >= -1e-12)


def test_the_impact_has_the_stated_restitution():
    mechanism, speed, _ = onset()
    e = 0.4
    simulation = turns(mechanism, 1.3 * speed, e=e)
    hits = [h for h in simulation.events if h.kind == "impact"]
    assert len(hits) >= 2
    eps = 1e-9

    def rate(t: float) -> float:
        """Of the gap, by its difference over a short time."""
        view = simulation.view(np.array([t, t + 1e-8]))
        return float(np.diff(simulation.gap("K", view))[0] / 1e-8)

    for h in hits[:2]:
        before, after = rate(h.time - 2e-8), rate(h.time + eps)
        assert before < 0 < after
        assert after == pytest.approx(-e * before, rel=1e-3)
        lost = next(
            energy for t, energy in simulation.impact_losses if t == h.time
        )  # the camshaft does not give way: only the follower's mass
        assert lost == pytest.approx(0.5 * MASS * (1 - e**2) * before**2, rel=2e-3)


def test_a_free_camshaft_feels_the_impact():
    """Camshaft with a motor's torque: angular momentum of the shaft and energy change together, the drift stays small."""
    mechanism, speed, _ = onset()
    free = replace(
        mechanism,
        drives=(Drive(joint="O", law=Free(0.0, 1.12 * speed)),),
        loads=(*mechanism.loads, Torque(name="motor", link="cam", moment=5.0)),
    )
    simulation = simulate(free, 0.03, separable_cams=[SeparableCam(joint="K", restitution=0.5)])
    hits = np.array([h.time for h in simulation.events if h.kind == "impact"])
    knocks = simulation(hits + 1e-7)[1] - simulation(hits - 1e-7)[1]
    assert np.abs(knocks).max() > 1e-3 * speed
    t = np.linspace(0.0, simulation.duration, 101)
    assert np.abs(simulation.drift(t)).max() < 1e-7
    assert simulation.gap("K", simulation.view(t)).min() > -1e-11


def test_what_is_not_named_is_not_looked_at(monkeypatch):
    from mechcore.dynamics import event_integrator
    from mechcore.dynamics.contact import separation

    def never(*_, **__):
        raise AssertionError

    monkeypatch.setattr(separation.FollowerSeparation, "__init__", never)
    monkeypatch.setattr(event_integrator, "first_beyond", never)
    from simulated_scenes import STOPPED

    run_scene(mechviz.loads(STOPPED))


def test_bad_input_is_refused_in_words():
    mechanism, speed, _ = onset()
    with pytest.raises(MechanismError, match="no cam that its follower could leave"):
        simulate(at_speed(mechanism, speed), 0.1, separable_cams=[SeparableCam(joint="S")])
    text = mechviz.load("valve-float").text
    for old, new, words in (
        ('frames = 960\nduration = "180 ms"', "frames = 960", "'duration' is missing"),
        ("restitution = 0.25", "restitution = 2", "no coefficient of restitution"),
        ("restitution = 0.25", "restitutoin = 0.25", "Did you mean 'restitution'?"),
        ('effects = ["inertia"]', 'effects = ["gravity"]', "inertia is not named"),
        ("liftoff =", 'closure = "form"\nliftoff =', "cannot leave its cam"),
    ):
        assert old in text
        with pytest.raises(mechviz.SceneError) as error:
            mechviz.loads(text.replace(old, new))
        assert words in " ".join(str(error.value).split())


@pytest.mark.parametrize("start", ["drive", "free"])
def test_a_law_whose_velocity_jumps_is_refused_where_its_impact_would_count(start: str):
    """The follower is thrown off at half a turn and knocked at its end: neither was seen, and the energy did not close."""
    text = mechviz.load("cam-constant-acceleration").text.replace("drive = {", f"{start} = {{")
    text = text.replace('cam = ["cam", "follower"]', 'cam = ["cam", "follower"]\nliftoff = { restitution = 0.3 }')
    with pytest.raises(MechanismError, match=r"joints\.K: the velocity of its law jumps at 0°"):
        run_scene(mechviz.loads(f'{text}\n[run]\nduration = "0.1 s"'))


def test_valve_float_is_recorded_with_lane_gap_and_events(tmp_path: Path):
    scene = mechviz.load("valve-float")
    assert mechviz.loads(scene.to_toml()) == scene
    run = run_scene(scene, frames=300)
    write_recording(run, tmp_path / "x.rrd")
    recording = Recording(tmp_path / "x.rrd")
    texts = [e.text for e in recording.events]
    lost = [t for t in texts if "contact lost" in t]
    assert len(lost) >= 5 and any("contact regained" in t for t in texts)
    assert "/state/K" in {e.replace("\\", "") for e in recording.entities}
    gap = recording.scalars("data", "cams", "K", "gap")[1]
    assert gap.max() > 2e-3 and gap.min() > -1e-12
    # held by the closed form: not before the speed at which the spring is too weak
    joint = next(p for p in scene.mechanism.joints if isinstance(p, CamJoint))
    slow = first_separation(Closure(0.11, 24e3, 0.046 - (0.066 - 0.025 - 0.012), 0.0), joint.lift)
    assert slow is not None
    speed = np.interp(run.simulation.events[0].time, run.motion.time, run.motion.coordinate("O")[:, 1])
    assert slow.speed < speed < 1.05 * slow.speed


def with_brake(mechanism: Mechanism, brake: float, coefficient: float = 0.0) -> Mechanism:
    """The same with dry friction in the follower's guide."""
    joints = tuple(
        replace(p, friction=Friction(coefficient=coefficient, brake=brake, length=0.03)) if p.name == "S" else p
        for p in mechanism.joints
    )
    return replace(mechanism, joints=joints, effects=(*mechanism.effects, "friction"))


def test_dry_friction_in_the_guide_shifts_the_onset_as_statics_says():
    """On its way back friction holds the follower up: it is lost at a lower speed, where kinetostatics finds no force left."""
    mechanism, speed, _ = onset()
    rough = with_brake(mechanism, 6.0, 0.1)
    low, high = 0.8 * speed, speed
    assert contact_at(rough, low).min() > 0.0 > contact_at(rough, high).min()
    for _ in range(18):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if contact_at(rough, middle).min() > 0.0 else (low, middle)
    assert not {h.kind for h in turns(rough, 0.9999 * low).events} & {"lost", "impact"}
    result = [h for h in turns(rough, 1.001 * low, e=0.0).events if h.item == "K"]
    assert [h.kind for h in result[:2]] == ["lost", "regained"]


def test_a_follower_flies_against_the_friction_in_its_guide():
    """On its way up it is a mass on a spring with Coulomb friction; the works close through stick, slip, flight and impacts."""
    mechanism, speed, _ = onset()
    simulation = turns(with_brake(mechanism, 6.0), 1.5 * speed, count=1.2, e=0.4)
    kinds = [(h.kind, h.item) for h in simulation.events]
    assert {("slip", "S"), ("lost", "K"), ("impact", "K"), ("regained", "K")} <= set(kinds)
    lost = next(h.time for h in simulation.events if h.kind == "lost")
    turned = next(h.time for h in simulation.events if h.kind == "slip" and h.time > lost)
    t = np.linspace(lost, turned, 40)
    y = simulation.view(t).coordinate("S")
    w = np.sqrt(STIFFNESS / MASS)
    rest = 0.14 - 0.2 - (MASS * G + 6.0) / STIFFNESS  # friction acts downwards
    a, b = y[0, 0] - rest, y[0, 1] / w
    assert y[:, 0] == pytest.approx(rest + a * np.cos(w * (t - lost)) + b * np.sin(w * (t - lost)), abs=1e-9)
    assert y[-1, 1] == pytest.approx(0.0, abs=1e-9)  # there it turns back
    t = np.linspace(0.0, simulation.duration, 301)
    energies = simulation.energies(t)
    size = np.abs(energies).max()
    assert np.ptp(energies[:, 0] + energies[:, 1] - energies[:, 2] + energies[:, 3]) < 1e-9 * size
    assert np.all(np.diff(energies[:, 3]) > -1e-12 * size)
    view = simulation.view(t)
    forces = simulation.forces(view)
    assert simulation.gap("K", view).min() > -1e-11 and contact_force(forces, placed_cams(view)[0]).min() > -1e-7
    way = np.abs(np.diff(simulation.view(np.linspace(0.0, simulation.duration, 20001)).coordinate("S")[:, 0])).sum()
    impacts = sum(e for _, e in simulation.impact_losses)
    assert energies[-1, 3] - impacts == pytest.approx(6.0 * way, rel=1e-4)  # a brake takes the same everywhere
    lanes = lanes_of(simulation)
    assert {"K", "S"} <= set(lanes) and {"flies", "touches"} <= {state for _, state in lanes["K"]}


def test_a_follower_that_its_guide_holds_hangs_where_the_cam_has_left_it():
    mechanism, speed, _ = onset()
    simulation = turns(with_brake(mechanism, 900.0), 0.4 * speed, count=1.0, e=0.0)
    assert [h.kind for h in simulation.events if h.item == "K"] == ["lost"]
    t = np.linspace(simulation.events[-1].time, simulation.duration, 50)
    assert np.ptp(simulation.view(t).coordinate("S")[:, 0]) < 1e-12
    with pytest.raises(MechanismError, match=r"joints\.K\.friction: friction between a cam and its follower while forces move"):
        rough = with_brake(mechanism, 6.0)
        joints = tuple(replace(p, friction=Friction(coefficient=0.1)) if p.name == "K" else p for p in rough.joints)
        simulate(
            replace(rough, joints=joints, drives=(Drive(joint="O", law=Free(0.3, 20.0)),)),
            0.1,
            separable_cams=[SeparableCam(joint="K")],
        )


def let_free(name: str, start: float, speed: float) -> Mechanism:
    """A gallery scene's mechanism without friction, its drive free."""
    mechanism = mechviz.load(name).mechanism
    drive = replace(mechanism.drives[0], law=Free(start=start, speed=speed))
    return replace(mechanism, drives=(drive,), effects=tuple(e for e in mechanism.effects if e != "friction"))


@pytest.mark.parametrize(("start", "speed"), [(0.0, 1.0), (2.0, 0.0)])
def test_a_free_camshaft_is_found_by_its_energy_wherever_it_starts(start: float, speed: float):
    """On a dwell the spring does no work: there may be no place near enough to the start to be integrated from it."""
    simulation = simulate(let_free("cam-roller", start, speed), 0.5)
    assert simulation.method == "energy"
    assert np.abs(simulation.drift(np.linspace(0.0, 0.5, 51))).max() < 1e-13


@pytest.mark.parametrize("method", ["energy", "gauss"])
@pytest.mark.parametrize("name", ["cam-knife", "cam-barrel"])
def test_tables_of_cams_are_smooth_between_the_bends_of_their_laws(name: str, method: str):
    """Panels that held a bend gave up there, and a knife's motion kept its energy to 8e-9 at best."""
    simulation = simulate(let_free(name, 0.3, 8.0), 1.0, method=method, tolerance=1e-12)
    assert np.abs(simulation.drift(np.linspace(0.0, 1.0, 101))).max() < 3e-12


@pytest.mark.parametrize(
    ("name", "guide", "start", "speed", "end"), [("cam-barrel", "S", 0.0, 20.0, 0.3), ("cam-inverse", "P", -0.65, 2.0, 0.65)]
)
def test_a_roller_in_a_groove_follows_a_free_drive(name: str, guide: str, start: float, speed: float, end: float):
    """Windows end on the knots of its law; over the pieces put together the contact is that of each."""
    mechanism = let_free(name, start, speed)
    computed, by_energy = (simulate(mechanism, end, method=method) for method in ("gauss", "energy"))
    t = np.linspace(0.0, end, 41)
    assert np.abs(computed.drift(t)).max() < 1e-9
    view, other = computed.view(t), by_energy.view(t)
    np.testing.assert_allclose(view.coordinate("O")[:, :2], other.coordinate("O")[:, :2], rtol=1e-7, atol=1e-9)
    (cam,) = placed_cams(view)
    rows, x = cam.rows(view), cam.argument(view)
    lift = view.coordinate(guide)[:, 0]
    np.testing.assert_allclose(rows.coordinate - rows.coordinate[0], lift - lift[0], atol=1e-12)
    np.testing.assert_array_equal(rows.angle, x)
    assert len(set(cam.segment(view))) >= 2
    # no other force drives the follower: the flank that presses is the one that accelerates it
    force, a = contact_force(computed.forces(view), cam), view.coordinate(guide)[:, 2]
    pressed = np.abs(a) > 1e-3 * np.abs(a).max()
    assert pressed.sum() > 10
    np.testing.assert_array_equal(np.sign(force[pressed]), np.sign(a[pressed]))


BESIDE = """
[links]
frame = { points = { O2 = [200, 0], P = [260, -110] } }
crank = { points = { O2 = [0, 0], A = [60, 0] }, mass = "0.6 kg", centre = [20, 0], inertia = "4e-4 kg m^2" }
lever = { points = { P = [0, 0] }, mass = "0.9 kg", centre = [0, 60], inertia = "0.002 kg m^2" }

[joints]
O2 = { revolute = ["frame", "crank"], drive = { speed = "950 rpm", start = -40 } }
P = { revolute = ["frame", "lever"] }

[joints.K2]
cam = ["crank", "lever"]
closure = "form"
follower = { groove = 8, guide = "P", point = "A" }

[joints.K2.profile]
base = 0
phase = 42
lift = [{ over = 12 }, { over = 60, to = -22, law = "3-4-5" }, { over = 12 }]
"""


def merged(into: dict, more: dict) -> dict:
    return into | {k: merged(into[k], v) if isinstance(v, dict) and k in into else v for k, v in more.items()}


def test_an_inverse_cam_goes_on_beside_a_cam_that_its_follower_leaves():
    """Only the cam that may be left has a gap; the other one's contact is that of the crank's angle throughout."""
    text = resources.files("mechviz").joinpath("gallery", "valve-float.toml").read_text(encoding="utf-8")
    data = merged(tomllib.loads(text), tomllib.loads(BESIDE)) | {"run": {"frames": 40, "duration": "14 ms"}}
    data["joints"]["O"]["drive"] = {"speed": "5200 rpm", "start": 180}
    run = run_scene(mechviz.Scene.build(**data))
    assert [h.kind for h in run.simulation.events][:1] == ["lost"]
    computed = {t.path[1:]: t for t in tables(run) if t.path[1] == "cams"}
    assert ("cams", "K", "gap") in computed and ("cams", "K2", "gap") not in computed
    cam = next(c for c in placed_cams(run.motion) if c.name == "K2")
    lift = computed["cams", "K2", "lift"].values[:, 0]
    x = np.degrees(-0.6981317007977318 + 950 * np.pi / 30 * run.motion.time)
    s = np.clip((x + 30.0) / 60.0, 0.0, 1.0)
    np.testing.assert_allclose(np.degrees(lift), -22.0 * (10 * s**3 - 15 * s**4 + 6 * s**5), atol=1e-9)
    assert len(set(cam.segment(run.motion))) == 3


RATED = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
run = { frames = 360 }
[links]
frame = { points = { O = [0, 0], G = [0, 95], H = [0, 170] } }
cam = { points = { O = [0, 0] }, mass = "1.2 kg", inertia = "0.0014 kg m^2" }
follower = { points = { T = [0, 0], E = [0, 80] }, mass = "0.4 kg", centre = [0, 30] }
[joints]
O = { revolute = ["frame", "cam"], drive = { speed = "600 rpm" } }
S = { prismatic = ["frame", "follower"], at = ["G", "T"], along = [0, 1] }
[joints.K]
cam = ["cam", "follower"]
profile.base = 42
profile.lift = [{ over = 120, to = 20, law = "LAW" }, { over = 40 }, { over = 120, to = 0, law = "LAW" }, { over = 80 }]
follower = { roller = 10, guide = "S", point = "T" }
rating = { width = 8, limit = "100 MPa", margin = "650 N" }
[loads]
return_spring = { spring = ["follower.E", "frame.H"], stiffness = "8 N/mm", free_length = 110 }
"""


@pytest.mark.parametrize("law", ["cycloidal", "parabolic"])
def test_what_is_told_of_a_cam_is_told_of_one_whose_follower_may_leave_it_too(law):
    """It never does: pressures, forces and jerks are those of the prescribed motion, and so is what is said of them."""
    text = RATED.replace("LAW", law)
    leaving = text.replace("rating =", "liftoff = { restitution = 0 }\nrating =").replace("360 }", '360, duration = "100 ms" }', 1)
    free = run_scene(mechviz.loads(leaving))
    led = run_scene(mechviz.loads(text))
    assert free.simulation is not None and led.simulation is None and not free.simulation.events
    told, wanted = ([(e.item, e.text) for e in events_of(run) if e.item == "K"] for run in (free, led))
    assert [e for e in told if "joint reaction" not in e[1]] == [e for e in wanted if "joint reaction" not in e[1]]
    for words in ("Hertz pressure", "contact force down to", *(["infinite jerk"] if law == "parabolic" else [])):
        assert any(words in text for _, text in told)


def test_a_face_too_short_is_told_while_the_follower_touches():
    text = resources.files("mechviz").joinpath("gallery", "valve-float.toml").read_text(encoding="utf-8")
    data = tomllib.loads(text) | {"run": {"frames": 120, "duration": "14 ms"}}
    data["joints"]["O"]["drive"] = {"speed": "5200 rpm", "start": 180}
    data["joints"]["K"]["follower"]["face"] = [2, 2]
    run = run_scene(mechviz.Scene.build(**data))
    told = [e for e in events_of(run) if "the contact leaves the face" in e.text]
    (cam,) = placed_cams(run.motion)
    outside = np.abs(cam.rows(run.motion).eccentricity) > 2e-3
    touching = np.abs(run.simulation.gap("K", run.motion)) < 1e-12
    assert (outside & ~touching).any(), "it flies where the law's contact would be beyond the face"
    assert told and {e.level for e in told} == {"WARN"}
    starts = np.flatnonzero(np.diff((outside & touching).astype(int), prepend=0) == 1)
    for event, k in zip(told, starts, strict=True):
        assert run.motion.time[k - 1] <= event.time <= run.motion.time[k]
        if touching[k - 1]:
            reached = cam.rows(run.motion.at_times(np.array([event.time]))).eccentricity
            np.testing.assert_allclose(np.abs(reached), 2e-3, rtol=1e-7)
