"""Scenes: what is read from them, in SI; that writing and reading gives them back; light start-up; the builder; the schema."""

from __future__ import annotations

import json
import math
import os
import re
import stat
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from schemas import SCHEMA, conforms

import mechviz
from mechcore.errors import MechanismError
from mechcore.laws.timed import ConstantSpeed, Oscillation, Piecewise, TableLaw
from mechcore.spec.loads import Force, Torque
from mechcore.spec.mechanism import Prismatic, Revolute
from mechviz.files import OutputError
from mechviz.hard_cases.input import BASE
from mechviz.runs import run_scene
from mechviz.scene.builder import SceneBuilder
from mechviz.scene.faults import SceneError
from mechviz.scene.folder import gallery
from mechviz.scene.scene import Scene, dump, load, loads
from mechviz.scene.units import UNIT_KINDS, Units, parse, unit_factor
from recordings import gallery_scene

NAMES = [entry.name for entry in gallery()]

FOUR_BAR = BASE


def four_bar(**changes: Any) -> Scene:
    return Scene.build(**{**FOUR_BAR, **changes})


def driven(drive: dict[str, Any], **changes: Any) -> Any:
    """The law of the four-bar's crank under another drive."""
    joints = {**FOUR_BAR["joints"], "A": {"revolute": ["frame", "crank"], "drive": drive}}
    return four_bar(joints=joints, **changes).mechanism.drives[0].law


def slider(joint: dict[str, Any], **changes: Any) -> Scene:
    """A block on the frame, moved by a sliding joint."""
    links = {"frame": {"points": {"O": [0, 0], "X": [30, 40]}}, "block": {"points": {"O": [0, 0]}}}
    joint = {"prismatic": ["frame", "block"], "drive": {"oscillation": {"amplitude": 5, "frequency": 2}}, **joint}
    return Scene.build(units={"length": "mm"}, links=links, joints={"O": joint}, **changes)


# --- what a scene says, in SI -----------------------------------------------------------------------------------------


def test_the_scene_of_the_examples_becomes_this_mechanism():
    scene = load("crank-rocker")
    m = scene.mechanism
    assert scene.name == m.name == "crank-rocker"
    assert (scene.frames, scene.cycles, scene.effects) == (360, 1, ())
    assert [link.name for link in m.links] == ["frame", "crank", "coupler", "rocker"]
    assert m.links[2].points == {"B": (0.0, 0.0), "C": (0.18, 0.0), "E": (0.09, 0.07)}
    assert [link.mass for link in m.links] == [0.0, 0.4, 1.1, 0.8]
    assert m.joints[2] == Revolute(name="C", links=("coupler", "rocker"), points=("C", "C"))
    assert m.drives[0].law == ConstantSpeed(start=0.0, speed=2.0 * math.pi, travel=2.0 * math.pi)
    assert m.modes == {"C": "left"}
    assert m.traced == (("coupler", "E"),)
    assert m.effects == ()
    assert m.loads == ()


@pytest.mark.parametrize(
    ("text", "kind", "si"),
    [
        ("80 mm", "length", 0.08),
        ("80mm", "length", 0.08),
        ("1 in", "length", 0.0254),
        ("-2.5e1 cm", "length", -0.25),
        ("30 deg", "angle", math.pi / 6),
        ("30°", "angle", math.pi / 6),
        ("0.25 turn", "angle", math.pi / 2),
        ("60 rpm", "angular speed", 2.0 * math.pi),
        ("1 turn/s", "angular speed", 2.0 * math.pi),
        ("90 deg/s", "angular speed", math.pi / 2),
        ("2 Hz", "frequency", 2.0),
        ("30 1/min", "frequency", 0.5),
        ("3 m/s", "linear speed", 3.0),
        ("9810 mm/s^2", "gravity", 9.81),
        ("5 N m", "torque", 5.0),
        ("5 N*mm", "torque", 0.005),
        ("3 J", "torque", 3.0),
        ("12 kg cm^2", "inertia", 0.0012),
        ("12 kg·cm²", "inertia", 0.0012),
        ("12 kg cm2", "inertia", 0.0012),
        ("400 g", "mass", 0.4),
        ("2 slugs", "mass", 29.187805874412728),
        ("0.5 lbm", "mass", 0.5 * 0.45359237),
        ("2 kN", "force", 2000.0),
        ("2 min", "time", 120.0),
        ("2 minutes", "time", 120.0),
        ("3 N m/(rad s)", "torsional integral gain", 3.0),
        ("3 N m / rad / s", "torsional integral gain", 3.0),
        ("3 N m per rad s⁻¹", "torsional integral gain", 3.0),
        ("3 kg/s**2", "stiffness", 3.0),
        ("2 kilonewton·centimetre^-1", "stiffness", 2e5),
    ],
)
def test_a_text_with_a_unit_is_converted_to_the_last_digit(text, kind, si):
    assert parse(text, kind) == (pytest.approx(si, rel=3e-16) if "angle" in kind or "angular" in kind else si)


@pytest.mark.parametrize("unit", ["m^", "m/", "m*/s", "(m", "m)", "()", "m^0.5", "m^-", "2", "m 2", "Ns", "mx", "m" * 99])
def test_a_text_that_is_no_unit_is_said_to_be_none(unit):
    with pytest.raises(ValueError, match="unknown unit"):
        unit_factor(unit, "length")


def test_lengths_in_millimetres_are_the_doubles_that_metres_give():
    units = Units(length="mm")
    for k in range(1, 2000):
        assert units.si(k / 10, "length") == float(f"{k}e-4") == parse(f"{k / 10} mm", "length")


def test_turns_per_minute_and_cycles_per_second_are_not_confused():
    assert parse("60 rpm", "angular speed") == pytest.approx(2.0 * math.pi, rel=1e-15)
    with pytest.raises(ValueError, match="an angular speed, a frequency is wanted"):
        parse("60 rpm", "frequency")
    with pytest.raises(ValueError, match="a frequency, an angular speed is wanted"):
        parse("1 Hz", "angular speed")


def test_bare_numbers_are_in_the_units_of_the_scene_and_derived_units_follow():
    units = Units(length="mm", angle="deg", time="ms")
    assert units.si(3, "length") == 0.003
    assert units.si(180, "angle") == pytest.approx(math.pi)
    assert units.si(3, "linear speed") == 3.0  # mm/ms
    assert units.si(180, "angular speed") == pytest.approx(1000.0 * math.pi)
    assert units.si(2, "frequency") == 2000.0
    assert units.si(-9.81, "gravity") == -9.81  # always m/s^2
    assert units.si(5, "torque") == 5.0  # N m whatever the unit of length
    assert units.si(5, "inertia") == 5.0


def test_every_kind_of_quantity_understands_its_own_example():
    for name, kind in UNIT_KINDS.items():
        assert math.isfinite(parse(kind.example, name)), name


def test_gravity_effects_run_and_frame_are_read():
    links = {key if key != "frame" else "base": {**value} for key, value in FOUR_BAR["links"].items()}
    links["crank"] |= {"mass": 0.4, "shape": "bar"}
    joints = json.loads(json.dumps(FOUR_BAR["joints"]).replace('"frame"', '"base"'))
    s = four_bar(
        links=links, joints=joints, frame="base", effects=["gravity"], gravity=[0, "-1.62 m/s^2"], run={"frames": 90, "cycles": 3}
    )
    assert (s.mechanism.frame, s.mechanism.gravity, s.frames, s.cycles) == ("base", (0.0, -1.62), 90, 3)
    assert s.mechanism.effects == s.effects == ("gravity",)


# --- masses -----------------------------------------------------------------------------------------------------------


def masses_of(link: dict[str, Any], *, effects: tuple[str, ...] = ("inertia", "gravity")) -> tuple[float, Any, float]:
    links = {**FOUR_BAR["links"], "crank": {**FOUR_BAR["links"]["crank"], **link}}
    made = four_bar(links=links, effects=list(effects)).mechanism.links[1]
    return made.mass, made.centre, made.inertia


def test_masses_are_read_in_si():
    assert masses_of({"mass": "400 g", "centre": [30, 5], "inertia": "12 kg cm^2"}) == (0.4, (0.03, 0.005), 0.0012)


def test_the_centre_of_mass_may_be_a_named_point():
    assert masses_of({"mass": 0.4, "centre": "B", "inertia": 0.001})[1] == (0.06, 0.0)


def test_a_bar_is_uniform_and_slender():
    mass, centre, inertia = masses_of({"mass": 0.4, "shape": "bar"})
    assert (mass, centre) == (0.4, (0.03, 0.0))
    assert inertia == pytest.approx(0.4 * 0.06**2 / 12.0, rel=1e-15)


def test_a_point_mass_sits_at_the_first_point():
    assert masses_of({"mass": 0.4, "shape": "point"}) == (0.4, (0.0, 0.0), 0.0)


def test_a_mass_alone_is_fine_where_no_effect_computes_with_it():
    assert masses_of({"mass": 0.4}, effects=()) == (0.4, (0.0, 0.0), 0.0)


def test_a_slider_of_one_point_that_cannot_turn_needs_neither_centre_nor_inertia():
    links = {"frame": {"points": {"O": [0, 0]}}, "block": {"points": {"O": [3, 4]}, "mass": 2}}
    joints = {"O": {"prismatic": ["frame", "block"], "drive": {"oscillation": {"amplitude": 1, "frequency": 1}}}}
    made = Scene.build(links=links, joints=joints, effects=["inertia"]).mechanism.links[1]
    assert (made.mass, made.centre, made.inertia) == (2.0, (3.0, 4.0), 0.0)


# --- drives -----------------------------------------------------------------------------------------------------------


def test_constant_speed_turns_once_from_its_start():
    assert driven({"speed": 360, "start": 90}) == ConstantSpeed(math.pi / 2, 2.0 * math.pi, 2.0 * math.pi)


def test_travel_and_range_limit_a_constant_speed():
    assert driven({"speed": 90, "travel": 45}).duration == pytest.approx(0.5)
    forward, back = driven({"speed": 90, "range": [-30, 60]}), driven({"speed": -90, "range": [-30, 60]})
    assert np.degrees(forward([0.0, forward.duration])[0]) == pytest.approx([-30.0, 60.0])
    assert np.degrees(back([0.0, back.duration])[0]) == pytest.approx([60.0, -30.0])


def test_zones_are_those_of_the_article():
    law = driven({"start": "38 deg", "speed": "6.283 rad/s", "zones": {"run_up": 12, "steady": 66, "braking": "12 deg"}})
    position, speed, acceleration = law([0.0, law.breaks[0], law.breaks[1], law.duration])
    assert np.degrees(position) == pytest.approx([38.0, 50.0, 116.0, 128.0])
    assert speed == pytest.approx([0.0, 6.283, 6.283, 0.0], abs=1e-12)
    assert acceleration[1] == pytest.approx(94.24222047428393, rel=1e-12)


def test_oscillation_by_frequency_or_period():
    assert driven({"oscillation": {"centre": 90, "amplitude": 45, "frequency": "2 Hz", "phase": 180}}) == Oscillation(
        math.pi / 2, math.pi / 4, 2.0, math.pi
    )
    assert driven({"oscillation": {"amplitude": "45 deg", "period": "0.5 s"}}) == Oscillation(0.0, math.pi / 4, 2.0)


def test_segments_are_quintic_and_rest_to_rest_unless_stated():
    law = driven({"start": 10, "segments": [{"duration": 2, "to": 40}, {"duration": 1, "to": [60, 20, "5 deg/s^2"]}]})
    assert isinstance(law, Piecewise)
    q, v, a = (np.degrees(x) for x in law([0.0, 1.0, 2.0, 3.0]))
    assert q == pytest.approx([10.0, 25.0, 40.0, 60.0])
    assert v == pytest.approx([0.0, 30.0 * 1.875 / 2.0, 0.0, 20.0], abs=1e-12)
    assert a[[0, 2, 3]] == pytest.approx([0.0, 0.0, 5.0], abs=1e-11)
    assert law.duration == 3.0


def test_a_table_goes_through_its_points():
    law = driven({"table": {"time": [0, "500 ms", 1, 1.5, 2], "position": [0, 10, 30, 20, 0], "periodic": True}})
    assert isinstance(law, TableLaw)
    assert np.degrees(law([0.0, 0.5, 1.0, 1.5, 2.0])[0]) == pytest.approx([0.0, 10.0, 30.0, 20.0, 0.0], abs=1e-12)
    assert law(0.0)[1] == pytest.approx(law(2.0)[1])


def test_a_sliding_drive_is_in_lengths():
    law = slider({"drive": {"speed": 20, "travel": "3 cm", "start": -5}}).mechanism.drives[0].law
    assert law == ConstantSpeed(start=-0.005, speed=0.02, travel=0.03)


# --- joints, loads, traces ---------------------------------------------------------------------------------------------


def test_prismatic_joints():
    assert slider({}).mechanism.joints[0] == Prismatic(name="O", links=("frame", "block"), points=("O", "O"))
    made = slider({"at": ["X", "O"], "along": [0, -2], "angle": 1.5}).mechanism.joints[0]
    assert made == Prismatic(name="O", links=("frame", "block"), points=("X", "O"), along=(0.0, -2.0), angle=1.5)
    named = slider({"along": ["O", "X"]}).mechanism.joints[0]
    assert isinstance(named, Prismatic)
    assert named.along == pytest.approx((0.03, 0.04))
    second = slider({"guide": "block"}).mechanism.joints[0]
    assert isinstance(second, Prismatic)
    assert second.guide == 1


def test_the_three_ways_to_state_an_assembly_mode():
    for key, word in (("side", "right"), ("assembly", "crossed"), ("branch", "behind")):
        joints = {**FOUR_BAR["joints"], "C": {"revolute": ["coupler", "rocker"], key: word}}
        assert four_bar(joints=joints).mechanism.modes == {"C": word}


def test_loads_are_read_in_si():
    table = {"position": [0, 180, 360], "factor": [1, 2, 1], "period": 360}
    s = four_bar(
        loads={
            "P": {"force": ["1 kN", -5], "on": "rocker", "at": "C", "axes": "link"},
            "M": {"torque": "5 N m", "on": "crank", "table": table},
        }
    )
    force, torque = s.mechanism.loads
    assert force == Force(name="P", link="rocker", point="C", vector=(1000.0, -5.0), axes="link")
    assert isinstance(torque, Torque)
    assert (torque.link, torque.moment) == ("crank", 5.0)
    assert torque.factor is not None
    assert torque.factor([0.0, math.pi, 2.0 * math.pi, 7.0 * math.pi]) == pytest.approx([1.0, 2.0, 1.0, 2.0])


def test_a_force_on_a_link_of_one_point_needs_no_point():
    load = slider({}, loads={"F": {"force": [1, 0], "on": "block"}}).mechanism.loads[0]
    assert isinstance(load, Force)
    assert load.point == "O"


def test_traces_by_bare_and_by_full_name():
    assert four_bar(trace=["E", "rocker.D", "C"]).mechanism.traced == (("coupler", "E"), ("rocker", "D"), ("coupler", "C"))


# --- drawings and sketches --------------------------------------------------------------------------------------------

DRAWN: dict[str, Any] = {
    "units": {"length": "mm", "angle": "deg"},
    "links": {
        "frame": {"points": ["A", "D"]},
        "crank": {"points": ["A", "B"]},
        "coupler": {"points": ["B", "C", "E"]},
        "rocker": {"points": ["C", "D"]},
    },
    "joints": {
        "A": {"revolute": ["frame", "crank"], "drive": {"speed": "60 rpm"}},
        "B": {"revolute": ["crank", "coupler"]},
        "C": {"revolute": ["coupler", "rocker"]},
        "D": {"revolute": ["rocker", "frame"]},
    },
    "sketch": {"A": [10, 20], "B": [10, 80], "C": [130, 170], "D": [210, 20], "E": [0, 180]},
}


def test_drawn_links_take_their_shape_and_place_from_the_sketch():
    m = Scene.build(**DRAWN).mechanism
    points = {link.name: link.points for link in m.links}
    assert points["frame"] == {"A": (0.01, 0.02), "D": (0.21, 0.02)}  # the fixed link's frame is the world's
    assert points["crank"]["A"] == (0.0, 0.0)
    assert points["crank"]["B"] == pytest.approx((0.06, 0.0))
    assert points["coupler"]["C"] == pytest.approx((0.15, 0.0))  # x axis from B to C
    assert points["coupler"]["E"] == pytest.approx((0.052, 0.086))
    assert m.sketch["coupler"] == pytest.approx((0.01, 0.08, math.atan2(90, 120)))
    assert set(m.sketch) == {"crank", "coupler", "rocker"}


def test_a_drive_between_drawn_links_starts_at_the_drawn_angle_unless_it_states_another():
    assert Scene.build(**DRAWN).mechanism.drives[0].law(0.0)[0] == pytest.approx(math.pi / 2)
    joints = {**DRAWN["joints"], "A": {"revolute": ["frame", "crank"], "drive": {"speed": 1, "start": 30}}}
    assert Scene.build(**{**DRAWN, "joints": joints}).mechanism.drives[0].law(0.0)[0] == pytest.approx(math.pi / 6)


def test_a_sketch_beside_coordinates_gives_rough_poses_only():
    s = four_bar(sketch={"B": [0, 61], "C": [110, 160], "rocker": {"at": [200, 1], "angle": 120}})
    m = s.mechanism
    assert m.links[1].points["B"] == (0.06, 0.0)
    assert m.sketch["crank"] == pytest.approx((0.0, 0.0, math.pi / 2))  # A is known from the frame
    assert m.sketch["coupler"] == pytest.approx((0.0, 0.061, math.atan2(99, 110)))
    assert m.sketch["rocker"] == pytest.approx((0.2, 0.001, math.radians(120)))
    assert m.drives[0].law(0.0)[0] == 0.0


def test_a_sliding_joint_hands_its_angle_to_a_sketched_slider():
    sketched = slider({"angle": 0.5}, sketch={"O": [0, 0]})
    assert sketched.mechanism.sketch == {"block": (0.0, 0.0, 0.5)}


def test_a_sliding_joint_between_drawn_links_keeps_the_drawn_angle():
    s = Scene.build(
        links={"frame": {"points": ["O"]}, "block": {"points": ["O", "P"]}},
        joints={"O": {"prismatic": ["frame", "block"], "drive": {"oscillation": {"amplitude": 1, "frequency": 1}}}},
        sketch={"O": [0, 0], "P": [0, 2]},
    )
    joint = s.mechanism.joints[0]
    assert isinstance(joint, Prismatic)
    assert joint.angle == pytest.approx(math.pi / 2)


# --- writing and reading again ----------------------------------------------------------------------------------------


def same_mechanism(a: Scene, b: Scene) -> bool:
    """Equal mechanisms, laws and tables compared by what they hold (they are functions: == compares identity)."""
    return re.sub(r" at 0x[0-9a-f]+", "", repr(a.mechanism)) == re.sub(r" at 0x[0-9a-f]+", "", repr(b.mechanism))


@pytest.mark.sample(24)
@pytest.mark.parametrize("name", NAMES)
def test_gallery_scenes_survive_writing_and_reading_and_agree_with_the_schema(name):
    scene = gallery_scene(name)
    assert conforms(tomllib.loads(scene.text), SCHEMA, SCHEMA)
    assert loads(scene.text, name, scene.folder) == scene
    again = loads(scene.to_toml(), name, scene.folder)
    assert again == scene
    assert again.to_toml() == scene.to_toml()
    assert same_mechanism(again, scene)


NUMBERS = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e6, max_value=1e6)
POSITIVE = st.floats(min_value=1e-6, max_value=1e6)
NAME = st.text(st.characters(exclude_categories=["C", "Z"], exclude_characters='/\\"'), min_size=1, max_size=12).filter(
    lambda s: not s.startswith("__") and s not in (".", "..") and all(c.isalnum() or (c.isascii() and c.isprintable()) for c in s)
)
TEXT = st.text(
    st.characters(exclude_categories=["Cc", "Cs"], include_characters="\t\n\r", exclude_characters="\ufffe\uffff"), max_size=40
)


def lengths() -> st.SearchStrategy[Any]:
    return NUMBERS | st.builds("{!r} {}".format, NUMBERS, st.sampled_from(["mm", "m", "in"]))


@st.composite
def drives(draw: Any) -> dict[str, Any]:
    kind = draw(st.sampled_from(["speed", "zones", "oscillation", "segments", "table", "program"]))
    if kind == "speed":
        return {"speed": draw(POSITIVE), "start": draw(NUMBERS)}
    if kind == "zones":
        return {"speed": f"{draw(POSITIVE)!r} rpm", "zones": {"run_up": draw(POSITIVE), "braking": draw(POSITIVE)}}
    if kind == "oscillation":
        return {"oscillation": {"amplitude": draw(POSITIVE), "period": draw(POSITIVE), "phase": draw(NUMBERS)}}
    rows = draw(st.lists(st.tuples(st.floats(0.1, 5.0), st.floats(-9.0, 9.0)), min_size=2, max_size=6))
    if kind == "segments":
        return {"start": 10, "segments": [{"duration": h, "to": [q, 0, 1]} for h, q in rows]}
    if kind == "program":
        segments = [{"over": h, "to": q + 30.0, "law": "3-4-5"} if k % 2 else {"over": h} for k, (h, q) in enumerate(rows)]
        return {"program": {"speed": "30 rpm", "phase": 5, "segments": segments}}
    times = np.cumsum([h for h, _ in rows])
    return {"table": {"time": times, "position": [q + 20.0 * k for k, (_, q) in enumerate(rows)]}}


@st.composite
def chains(draw: Any) -> dict[str, Any]:
    """Open chains of links with names, points, masses and drives of all sorts: always valid scenes."""
    names = draw(st.lists(NAME, min_size=2, max_size=5, unique=True))
    links: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    for k, name in enumerate(names):
        points = {"in": [draw(lengths()), draw(lengths())], "out": [draw(lengths()), draw(lengths())]}
        links[name] = {"points": points, "mass": draw(POSITIVE), "centre": [draw(NUMBERS), 0], "inertia": draw(POSITIVE)}
        if k:
            joints[name] = {"revolute": [names[k - 1], name], "at": ["out", "in"], "drive": draw(drives())}
    return {
        "title": draw(TEXT),
        "learning_goal": draw(TEXT),
        "units": {"length": draw(st.sampled_from(["mm", "m"])), "angle": draw(st.sampled_from(["deg", "rad"]))},
        "frame": names[0],
        "effects": draw(st.sampled_from([[], ["inertia"], ["gravity", "inertia"]])),
        "trace": [f"{names[-1]}.out"],
        "links": links,
        "joints": joints,
        "loads": {"F": {"force": [draw(NUMBERS), 1], "on": names[-1], "at": "out"}},
    }


@given(chains())
def test_any_scene_survives_writing_and_reading(data):
    scene = Scene.build(name="s", **data)
    again = loads(scene.to_toml(), "s")
    assert again == scene
    assert again.title == (data["title"] or "s")
    assert list(again.document.links) == list(data["links"])
    assert same_mechanism(again, scene)


@given(st.floats(-1e30, 1e30))
def test_every_double_survives_writing_and_reading(x):
    scene = four_bar(gravity=[x, -9.81])
    (value, _) = loads(scene.to_toml()).mechanism.gravity
    assert value == x


def test_scenes_that_say_different_things_are_not_equal():
    scene = four_bar()
    assert scene == four_bar()
    assert hash(scene) == hash(four_bar())
    assert scene != four_bar(title="another")
    assert scene != four_bar(links=dict(reversed(FOUR_BAR["links"].items()))), "the order of links is the order of results"
    assert scene != 5


def test_text_is_the_file_s_own_with_its_comments():
    scene = load("crank-rocker")
    assert "# stated once" in scene.text
    assert "#" not in scene.to_toml()
    assert loads(scene.text).text == scene.text


def test_dump_replaces_the_whole_file_or_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    target = tmp_path / "my scene.toml"
    target.write_text("old")
    dump(load("triad"), target)
    assert load(target) == load("triad")
    assert load(target).name == "my scene"
    assert stat.S_IMODE(target.stat().st_mode) & 0o400
    before = target.read_text()

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="the disk is full"):
        dump(load("peaucellier"), target)
    assert target.read_text() == before
    assert [p.name for p in tmp_path.iterdir()] == ["my scene.toml"]


def test_dump_into_a_folder_that_does_not_exist_says_so(tmp_path: Path):
    with pytest.raises(OutputError, match="nowhere' does not exist"):
        dump(load("triad"), tmp_path / "nowhere" / "x.toml")


# --- the Python API ---------------------------------------------------------------------------------------------------


def builder() -> SceneBuilder:
    b = SceneBuilder("four-bar", title="Four-bar", length="mm", angle="deg")
    b.link("frame", A=(0, 0), D=(200, 0)).link("crank", {"A": (0, 0), "B": ("6 cm", 0)}, mass="0.4 kg", shape="bar")
    b.link("coupler", B=(0, 0), C=(180, 0), E=(90, 70)).link("rocker", D=(0, 0), C=(150, 0))
    b.revolute("A", "frame", "crank", drive={"speed": "60 rpm"}).revolute("B", "crank", "coupler")
    b.revolute("C", "coupler", "rocker", side="left").revolute("D", "rocker", "frame")
    return b.force("P", (0, -5), on="rocker", at="C").torque("M", "1 N m", on="crank").trace("E").effect("inertia").run(frames=90)


def test_builder_and_text_give_the_same_scene():
    text = """
        title = "Four-bar"
        units = { length = "mm", angle = "deg" }
        effects = ["inertia"]
        trace = ["E"]
        run = { frames = 90 }
        [links]
        frame = { points = { A = [0, 0], D = [200, 0] } }
        crank = { points = { A = [0, 0], B = ["6 cm", 0] }, mass = "0.4 kg", shape = "bar" }
        coupler = { points = { B = [0, 0], C = [180, 0], E = [90, 70] } }
        rocker = { points = { D = [0, 0], C = [150, 0] } }
        [joints]
        A = { revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }
        B = { revolute = ["crank", "coupler"] }
        C = { revolute = ["coupler", "rocker"], side = "left" }
        D = { revolute = ["rocker", "frame"] }
        [loads]
        P = { force = [0, -5], on = "rocker", at = "C" }
        M = { torque = "1 N m", on = "crank" }
    """
    scene = builder().scene()
    assert scene == loads(text)
    assert scene.name == scene.mechanism.name == "four-bar"
    assert loads(scene.text) == scene


def test_builder_covers_sliding_joints_gravity_and_sketches():
    b = SceneBuilder("s", length="mm").link("frame", ["O"]).link("block", ["O", "P"], mass=1, centre="P", inertia=0.1)
    b.prismatic("O", "frame", "block", along=[0, 1], drive={"oscillation": {"amplitude": 1, "frequency": 1}})
    m = b.sketch(O=(0, 0), P=(3, 4)).gravity(0, -1.62).effect("gravity", "inertia").scene().mechanism
    assert m.joints[0] == Prismatic(name="O", links=("frame", "block"), points=("O", "O"), along=(0.0, 1.0), angle=math.atan2(4, 3))
    assert m.links[1].centre == pytest.approx((0.005, 0.0))
    assert m.gravity == (0.0, -1.62)


def test_builder_reports_its_own_faults_and_the_scene_s_at_once():
    b = builder().link("crank", A=(0, 0), B=(1, 0), mass=1, shape="bar").trace("Z")
    with pytest.raises(SceneError) as error:
        b.scene()
    assert [(f.path, f.message) for f in error.value.faults] == [
        ("links.crank", "is given twice."),
        ("trace[1]", "no link has a point 'Z'."),
    ]


def test_numpy_values_and_tuples_are_welcome():
    links = json.loads(json.dumps(FOUR_BAR["links"]))
    links["crank"]["points"] = {"A": np.zeros(2), "B": (np.int64(60), np.float64(0.0))}
    links["crank"]["mass"] = None
    assert four_bar(links=links) == four_bar()


# --- start-up ---------------------------------------------------------------------------------------------------------


def modules_after(code: str) -> set[str]:
    out = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"], capture_output=True, text=True, check=True
    )
    return {name.partition(".")[0] for name in out.stdout.splitlines()[-1].split()}


def test_listing_the_gallery_is_light():
    heavy = {"rerun", "viser", "trimesh", "scipy", "numpy", "pydantic", "pint", "matplotlib", "ezdxf"}
    assert not modules_after("import mechviz; mechviz.gallery()") & heavy


@pytest.mark.parametrize("words", [["scenes"], ["scenes", "--names"], ["--help"]])
def test_commands_that_compute_nothing_load_nothing_heavy(words):
    heavy = {"rerun", "viser", "trimesh", "scipy", "numpy", "pint", "matplotlib", "ezdxf"}
    code = f"import sys\nsys.argv = {['mechviz', *words]!r}\nimport runpy"
    code += "\ntry:\n    runpy.run_module('mechviz', run_name='__main__')\nexcept SystemExit as e:\n    assert not e.code"
    assert not modules_after(code) & heavy


def test_reading_a_scene_loads_no_viewer():
    loaded = modules_after("import mechviz; mechviz.load('crank-rocker')")
    assert not loaded & {"rerun", "viser", "trimesh", "matplotlib", "ezdxf"}
    assert "pydantic" in loaded


def test_the_core_loads_without_what_only_some_mechanisms_need():
    assert "scipy" not in modules_after("import mechcore")


def test_solids_are_made_without_the_library_that_only_exports_need():
    code = "from mechviz.picture.build import solids_of\nfrom mechviz.runs import run_scene\nimport mechviz"
    loaded = modules_after(f"{code}\nsolids_of(run_scene(mechviz.load('crank-rocker'), frames=8))")
    assert "shapely" in loaded and not loaded & {"rerun", "viser", "trimesh"}


# --- the JSON Schema --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("links.crank.points.B", [60]),
        ("links.crank.points.B", [True, 0]),
        ("links.crank.points", []),
        ("links.crank.mass", -1),
        ("links.crank.mass", "1"),
        ("links.crank.mas", 1),
        ("joints.C.side", "lefft"),
        ("joints.A.drive.speed", True),
        ("joints.A.revolute", ["frame"]),
        ("run", {"frames": 0}),
        ("effects", ["inertai"]),
        ("loads", {"P": {"force": [1, 2]}}),
        ("title", 5),
    ],
)
def test_the_json_schema_refuses_what_the_reader_refuses(path, value):
    data = json.loads(json.dumps(FOUR_BAR))
    assert conforms(data, SCHEMA, SCHEMA)
    *parents, key = path.split(".")
    table = data
    for part in parents:
        table = table[part]
    table[key] = value
    assert not conforms(data, SCHEMA, SCHEMA)
    with pytest.raises(SceneError):
        Scene.build(**data)


def test_the_json_schema_explains_every_key_and_has_no_null():
    assert '"null"' not in json.dumps(SCHEMA)
    for name, table in SCHEMA["$defs"].items():
        for key, entry in table["properties"].items():
            assert "description" in entry, f"{name}.{key}"
    assert SCHEMA["$defs"]["LinkDocument"]["properties"]["shape"]["enum"] == ["bar", "point"]


def test_the_package_offers_the_scene_api():
    assert mechviz.Scene is Scene
    assert mechviz.SceneBuilder is SceneBuilder
    assert mechviz.load is load
    with pytest.raises(AttributeError, match="nonsense"):
        mechviz.nonsense  # noqa: B018


def test_pairs_is_read_as_joints_and_faults_name_it_as_it_is_written():
    text = load("crank-rocker").text
    assert "[joints]" in text
    former = text.replace("[joints]", "[pairs]")
    scene = loads(former)
    assert scene == load("crank-rocker") and scene.text == former
    with pytest.raises(SceneError, match=r"pairs\.A\.drive\.speed  .* is a frequency"):
        loads(former.replace("60 rpm", "60 Hz"))
    with pytest.raises(SceneError, match=r"pairs  joints and pairs at once"):
        loads(former + '\n[joints]\nZ = { revolute = ["frame", "crank"] }\n')
    stretched = loads(former.replace("C = [180, 0]", "C = [18, 0]"))  # what the core finds when it is solved
    with pytest.raises(MechanismError) as error:
        run_scene(stretched, frames=9)
    assert all(not fault.path.startswith("joints") for fault in error.value.faults), str(error.value)
    assert scene.changed({("pairs", "A", "drive", "speed"): "30 rpm"}).document.joints["A"].drive.speed == "30 rpm"
    assert "[joints]" in scene.to_toml()


def test_former_keys_of_metrics_and_constructions_are_read():
    asked = 'learning_goal = "g"\nmetrics = ["curvature"]\npolygons = ["velocity"]\ncentrodes = ["coupler"]\n'
    text = asked + load("four-bar-chain").text.split("\n", 2)[2]
    former = text
    for old, new in {"answers": "metrics", "plans": "polygons", "polodes": "centrodes", "teaches": "learning_goal"}.items():
        former = former.replace(f"{new} =", f"{old} =")
    with pytest.raises(SceneError, match=r"polodes\[0\]  .*'coupler'"):
        loads(former)
    present, old = (loads(t.replace('"coupler"', '"bar2"')) for t in (text, former))
    assert old == present and old.document.centrodes == ["bar2"] and "polodes" not in old.to_toml()


def test_former_point_masses_of_links_are_read_but_points_keep_their_names():
    text = load("trip-hammer").text
    former = text.replace("point_masses =", "lumps =")
    assert former != text and loads(former) == load("trip-hammer")
    with pytest.raises(SceneError, match=r"links\.\w+\.lumps\[0\]\.at  .*'Q'"):
        loads(former.replace('at = "H" }]', 'at = "Q" }]'))
    named = load("crank-rocker").changed(
        {("links", "coupler", "points"): {"B": [0, 0], "C": [180, 0], "lumps": [90, 70], "E": [1, 1]}}
    )
    assert loads(named.to_toml()).document.links["coupler"].points["lumps"] == (90.0, 70.0)
    (where,) = (name for name, link in load("trip-hammer").document.links.items() if link.point_masses)
    assert not loads(text).changed({("links", where, "lumps"): None}).document.links[where].point_masses


def test_pair_within_watch_and_loads_is_read_as_joint_and_faults_name_it_as_it_is_written():
    text = load("engine-start-up").text
    former = text.replace('{ joint = "A"', '{ pair = "A"')
    assert former.count("pair =") == 2 and loads(former) == load("engine-start-up")
    with pytest.raises(SceneError, match=r"watch\.running\.pair  there is no joint 'Q'"):
        loads(former.replace('running = { pair = "A"', 'running = { pair = "Q"'))
