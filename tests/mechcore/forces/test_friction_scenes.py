"""Friction in scene files, plans, events and recordings."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from faulty_scenes import changed, faults_of
from random_linkages import balance_of_links

import mechviz
from mechcore.effects.plan import make_plan
from mechcore.forces.friction.events import find_jams, friction_events, friction_lanes
from mechcore.forces.friction.losses import losses_of_run
from mechcore.forces.instants import energies
from mechcore.forces.kinetostatics import solve_forces
from mechcore.forces.powers import power_table
from mechcore.laws.timed import ConstantSpeed, Oscillation
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.spec.mechanism import Drive, Friction, Link, PinSlot, Prismatic
from mechviz.hard_cases.mechanisms import sleeve
from mechviz.outputs.inspection import _losses, format_inspection, inspect
from mechviz.runs import run_scene
from mechviz.scene.builder import SceneBuilder
from mechviz.scene.scene import Scene, json_schema
from mechviz.studies.report import check_lines
from recordings import gallery_scene, made

SCENES = ("slider-crank-friction", "four-bar-friction-circles", "jamming-sleeve", "self-locking-wedge", "toggle-clamp")


def forces_of(name: str, frames: int | None = None):
    scene = mechviz.load(name)
    times = default_times(scene.mechanism, frames or scene.frames, scene.cycles)
    return solve_forces(solve_motion(compile_mechanism(scene.mechanism), times))


FAULTS = [
    ("joints/B/friction", {"coefficient": -0.1, "radius": 0.01}, "joints.B.friction.coefficient", "-0.1 is negative."),
    ("joints/B/friction", {"coefficient": "high", "radius": 0.01}, "joints.B.friction.coefficient", "coefficient of friction"),
    ("joints/B/friction", {"coefficient": 0.1}, "joints.B.friction", "'radius' is missing"),
    ("joints/B/friction", {"radius": "5 mm"}, "joints.B.friction", "'coefficient' is missing."),
    ("joints/B/friction", {"coefficient": 0.1, "radius": "5 s"}, "joints.B.friction.radius", "a length is wanted"),
    ("joints/B/friction", {"coefficient": 0.1, "radius": 0}, "joints.B.friction.radius", "zero"),
    (
        "joints/B/friction",
        {"coefficient": 0.1, "length": 0.1},
        "joints.B.friction",
        "length does not go with the friction of a revolute",
    ),
    ("joints/B/friction", {"mu": 0.1, "radius": 0.01}, "joints.B.friction", "unknown key 'mu'."),
    ("joints/B/friction", 0.1, "joints.B.friction", "where a table is wanted"),
    ("friction", {"coefficient": -1}, "friction.coefficient", "-1 is negative."),
    ("friction", {"lever": 1}, "friction", "unknown key 'lever'."),
    ("effects", ["friction"], "effects", "no joint has any friction that could act."),
]


@pytest.mark.parametrize(("where", "value", "path", "message"), FAULTS)
def test_faults(where, value, path, message):
    faults = faults_of(changed((where, value)))
    assert any(f.path == path and message in f.message for f in faults), faults
    assert all(f.remedy for f in faults)


def test_more_faults():
    slide = {"prismatic": ["frame", "rocker"], "at": "C", "friction": {"coefficient": 0.1, "height": 0.02}}
    faults = faults_of(changed(("joints/D", slide)))
    assert any(f.path == "joints.D.friction.height" and "length" in f.remedy for f in faults)
    rolling = {"rolling": ["frame", "rocker"], "at": "C", "radius": 1, "friction": {"coefficient": 0.1}}
    assert any("does not go with the friction of a rolling joint" in f.message for f in faults_of(changed(("joints/D", rolling))))
    weld = {"weld": ["frame", "rocker"], "at": "C", "friction": {"coefficient": 0.1}}
    assert any(f.message == "friction does not go with a weld." for f in faults_of(changed(("joints/D", weld))))


def test_defaults_units_and_writing_back():
    text = """
effects = ["friction"]
units = { length = "mm" }
[friction]
coefficient = 0.1
radius = 5
length = "6 cm"
[links]
frame  = { points = { A = [0, 0], G = [0, 0] } }
crank  = { points = { A = [0, 0], B = [40, 0] } }
rod    = { points = { B = [0, 0], C = [150, 0] } }
piston = { points = { C = [0, 0] } }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
B = { revolute = ["crank", "rod"], friction = { coefficient = 0.2, exact = true } }
C = { revolute = ["rod", "piston"], friction = { coefficient = 0 } }
S = { prismatic = ["frame", "piston"], at = ["G", "C"], friction = { bearing = "guide", offset = "-10 mm", height = 8 } }
[loads]
F = { force = [-10, 0], on = "piston" }
"""
    scene = mechviz.loads(text)
    result = {p.name: p.friction for p in scene.mechanism.joints}
    assert result["A"] == Friction(coefficient=0.1, radius=0.005)
    assert result["B"] == Friction(coefficient=0.2, radius=0.005, exact=True)
    assert result["C"].coefficient == 0.0
    assert result["S"] == Friction(coefficient=0.1, length=0.06, bearing="guide", offset=-0.01, height=0.008)
    again = mechviz.loads(scene.to_toml())
    assert again == scene and again.mechanism == scene.mechanism
    plan = make_plan(scene.mechanism)
    assert "A, B, S" in next(s.why for s in plan.computed if s.name == "effect friction")
    quiet = mechviz.loads(text.replace('effects = ["friction"]', ""))
    assert "A, B, S have coefficients" in next(s.why for s in make_plan(quiet.mechanism).skipped if s.name == "effect friction")
    keys = str(json_schema())
    for key in ("FrictionDocument", "coefficient", "bearing", "lever"):
        assert key in keys


def test_the_builder_has_friction():
    b = SceneBuilder("s", length="mm").friction(coefficient=0.1, radius=4).effect("friction")
    b.link("frame", A=(0, 0), G=(0, 0)).link("crank", A=(0, 0), B=(40, 0)).link("rod", B=(0, 0), C=(150, 0)).link(
        "piston", C=(0, 0)
    )
    b.revolute("A", "frame", "crank", drive={"speed": "60 rpm"}).revolute("B", "crank", "rod", friction={"radius": 8})
    b.revolute("C", "rod", "piston").prismatic("S", "frame", "piston", at=("G", "C"), friction={"coefficient": 0.3})
    b.force("F", (-10, 0), on="piston")
    scene = b.scene()
    assert isinstance(scene, Scene)
    assert {p.name: p.friction.coefficient for p in scene.mechanism.joints} == {"A": 0.1, "B": 0.1, "C": 0.1, "S": 0.3}
    assert scene.mechanism.joints[1].friction.radius == 0.008


# -- events -----------------------------------------------------------------------------------------------------------
def test_the_sleeve_jams_at_b_over_two_mu_whatever_the_frames():
    for frames in (7, 100):
        forces = forces_of("jamming-sleeve", frames)
        (jam,) = find_jams(forces)
        assert jam.joints == ("S",)
        # the arm of 40 mm grows by 40 mm/s to 80 / (2 * 0.2) = 200 mm
        assert jam.start == pytest.approx(4.0, abs=1e-7) and jam.end == pytest.approx(5.0)
        warnings = [e for e in friction_events(forces) if e.level == "WARN"]
        assert len(warnings) == 1 and "drive X at 200 mm" in warnings[0].text and "83.33 %" in warnings[0].text
        good = ~forces.friction.jammed
        assert np.isfinite(forces.effort("V")[good]).all() and np.isnan(forces.energy[-1, 3])
        assert friction_lanes(forces)["mechanism"][-1][1] == "jammed"


def test_the_edge_of_a_jam_is_found_from_how_much_could_still_be_moved(monkeypatch):
    """In three looks where halving an interval again and again would take thirty times."""
    from mechcore.forces.friction import events

    looks, solve = [], events.solve_forces
    monkeypatch.setattr(events, "solve_forces", lambda motion: looks.append(motion.frames) or solve(motion))
    (jam,) = find_jams(forces_of("jamming-sleeve", 7))
    assert jam.start == pytest.approx(4.0, abs=1e-8)
    assert len(looks) <= 3 and max(looks) <= 20


@pytest.mark.thorough
def test_a_jam_between_two_frames_is_found():
    """The arm passes the critical length for a moment: the effort goes through infinity and back between two frames."""
    b, mu, excess = 0.08, 0.2, 2e-4
    m = sleeve(0.1, b, mu)
    peak = b / (2 * mu) * (1.0 + excess)
    cart = Link(name="cart", points={"X": (0.0, 0.0)})
    m = replace(
        m,
        links=(*m.links, cart),
        joints=(
            m.joints[0],
            Prismatic(name="X", links=("frame", "cart"), points=("O", "X")),
            Prismatic(name="H", links=("cart", "lift"), points=("X", "X"), along=(0.0, 1.0)),
            PinSlot(name="T", links=("sleeve", "lift"), points=("S", "X")),
        ),
        drives=(
            Drive(joint="X", law=Oscillation(centre=peak - 0.1, amplitude=0.1, frequency=0.5, phase=-np.pi / 2)),
            Drive(joint="H", law=ConstantSpeed(0.0, 0.01)),
        ),
    )
    times = np.linspace(0.0, 2.0, 12)  # the greatest arm, at 1 s, lies between two of them
    forces = solve_forces(solve_motion(compile_mechanism(m), times))
    assert not forces.friction.jammed.any()
    (jam,) = find_jams(forces)
    # critical where peak - 0.1 - 0.1 cos(pi t) = b / (2 mu)
    edge = np.arccos(1.0 - excess * b / (2 * mu) / 0.1) / np.pi
    assert (jam.start, jam.end) == pytest.approx((1.0 - edge, 1.0 + edge), abs=1e-7)
    assert jam.joints == ("S",)


def test_the_wedge_locks_itself_and_a_steeper_one_does_not():
    forces = forces_of("self-locking-wedge")
    moving = np.abs(forces.motion.coordinate("W")[:, 1]) > 1e-6
    assert forces.friction.self_locking[moving].all()
    assert any(e.text.startswith("self-locking") for e in friction_events(forces))
    steep = mechviz.loads(mechviz.load("self-locking-wedge").text.replace("along = [-10, 1]", "along = [-4, 1]"))
    computed = solve_forces(solve_motion(compile_mechanism(steep.mechanism), default_times(steep.mechanism, 100)))
    assert not computed.friction.self_locking.any()


def test_the_toggle_locks_near_its_dead_centre_only():
    """Frictionless it would be held at the dead centre alone; with friction circles in a range around it."""
    forces = forces_of("toggle-clamp")
    angle = np.degrees(forces.motion.coordinate("O")[:, 0])
    locked = forces.friction.self_locking
    assert locked[np.abs(angle) < 1.2].mean() > 0.95 and not locked[angle > 3.0].any()


def test_sign_changes_lie_where_the_relative_motion_reverses():
    forces = forces_of("four-bar-friction-circles")
    result = [e for e in friction_events(forces) if "changes its sign" in e.text]
    assert {e.item for e in result} == {"C", "D"}  # crank and coupler pins turn one way only
    for e in result:
        at = forces.motion.at_times(np.array([e.time - 1e-7, e.time + 1e-7])).coordinate(e.item)[:, 1]
        assert at[0] * at[1] < 0.0
    lanes = friction_lanes(forces)
    assert [s for _, s in lanes["A"]] == ["slips +"] and len(lanes["D"]) == 3


# -- recordings -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", SCENES)
def test_recorded_friction_is_part_of_the_balance(name):
    m = made(name)
    forces = m.run.forces
    friction = forces.friction
    for joint in friction.joints:
        np.testing.assert_array_equal(m.data("joints", joint, "friction"), friction.wrench(joint))
        np.testing.assert_array_equal(m.data("joints", joint, "friction_loss")[:, 0], friction.losses(joint))
        assert m.recording.has("state", joint)
    assert m.recording.has("state", "mechanism")
    if not friction.jammed.any():
        assert balance_of_links(forces) < 1e-11
        left = np.trapezoid(-friction.power, forces.motion.time)
        assert forces.dissipated[-1] == pytest.approx(left, rel=2e-2)
    np.testing.assert_array_equal(m.data("energy"), energies(forces))


def test_pins_show_their_friction_circle_and_the_line_that_touches_it():
    m = made("four-bar-friction-circles")
    forces = m.run.forces
    for joint in ("A", "B", "C", "D"):
        assert m.recording.has("vectors", "friction", joint, "circle") and m.recording.has("vectors", "friction", joint, "line")
        reaction = forces.reaction(joint)
        arm = np.abs(reaction[:, 2]) / np.hypot(reaction[:, 0], reaction[:, 1])
        turning = forces.friction.elements[0].sign != 0
        slipping = np.array([s.startswith("slips") for s in forces.friction.state(joint)])
        np.testing.assert_allclose(arm[turning & slipping], 0.01, rtol=1e-9)  # mu r = 0.4 * 25 mm
    assert not made("crank-rocker").recording.has("vectors", "friction", "A", "circle")


def test_inspection_lists_losses_and_jams():
    inspection = inspect(made("slider-crank-friction").path)
    losses = losses_of_run(made("slider-crank-friction").run.forces)
    assert dict(inspection.losses) == pytest.approx(dict(losses.mean), rel=3e-3)  # frames alone, across the jumps of its table
    text = format_inspection(inspection)
    assert "Friction losses, mean of the run" in text and "friction moment O" in text and "efficiency of the run" in text
    jam = format_inspection(inspect(made("jamming-sleeve").path))
    assert "jams to the end of the run" in jam and " nan " not in jam
    assert "where it jams: there are no forces beyond" in jam


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("odd", [(("links", "cart", "points", "X"), [1e6, 0.0]), (("loads", "W", "force"), [1e12, 0.0])])
def test_a_run_that_jams_throughout_or_under_huge_forces_warns_of_nothing(odd):
    items = power_table(run_scene(gallery_scene("jamming-sleeve").changed(dict([odd])), frames=8).forces).items
    assert all(np.isnan(i.peak) or abs(i.peak) == np.nanmax(np.abs(i.power)) for i in items)


def test_losses_of_a_run_that_jams_at_its_beginning_are_those_of_its_other_frames():
    """Of a power that is 2 W and 4 W where it is known: as such a recording has it, and one that jams throughout."""
    whole = inspect(made("slider-crank-friction").path)
    none = float("nan")

    class Rows:
        time = np.array([0, 1, 2, 3, 4, 5]) * 10**9

        def __init__(self, values):
            self.values = np.array(values)

    class Jammed:
        def __init__(self, values):
            self.values = values

        def has(self, *path):
            return path[2] == "O"

        def rows(self, *path, component):
            return Rows(self.values)

    def text(*values: float) -> str:
        result = _losses(Jammed(values), SimpleNamespace(joints=("O", "B")))
        told = replace(whole, start=0.0, end=5.0, losses=tuple(f[:2] for f in result), losses_over=result[0][2])
        return format_inspection(told)

    late = text(none, none, 2.0, 2.0, none, 4.0)
    assert "Friction losses, mean over 2 s to 3 s, 5 s: at the other frames it jams" in late
    assert f"  {'all':<12}  {2:>12.5g} W" in late and "nan" not in late
    assert "Friction losses: it jams over the whole run, there are no forces" in text(*[none] * 6)
    assert "Friction losses, mean of the run" in text(*[2.0] * 6)


def test_check_and_record_say_where_friction_jams_or_locks():
    """Without a recording, and in what the recording's command prints."""
    assert any("jams from" in line and "to the end of the run" in line for line in check_lines(mechviz.load("jamming-sleeve")))
    wedge = check_lines(mechviz.load("self-locking-wedge"))
    assert any("W: self-locking from 1 s to 3 s (drive W at 100 mm to -100 mm)" in line for line in wedge)
    smooth = mechviz.loads(mechviz.load("jamming-sleeve").text.replace("coefficient = 0.2", "coefficient = 0.02"))
    assert any("no jam and no self-locking" in line for line in check_lines(smooth))
    assert not any(line.startswith("friction") for line in check_lines(mechviz.load("crank-rocker")))
    assert "warning: S: jams to the end of the run" in str(made("jamming-sleeve").summary)
