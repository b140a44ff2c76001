"""What is said to a user: quantities in the scene's units, paths that the scene has."""

from __future__ import annotations

import copy
import random
import re
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cases import examples

import mechviz
from mechcore.errors import Fault, MechanismError
from mechcore.motion.events import Event
from mechcore.texts import QuantityKind, Text, as_angle, as_coordinate, as_force, as_length
from mechviz.scene.document import UnitsDocument
from mechviz.scene.faults import SceneError
from mechviz.scene.folder import GALLERY_FOLDER, gallery
from mechviz.scene.scene import Scene, load
from mechviz.scene.units import UNIT_KINDS, Units
from mechviz.studies.report import check_lines

ODD = Units(length="in", angle="turn", force="kgf")
FOREIGN = re.compile(r"(?<![\w'\"])-?[\d.]+(e[+-]?\d+)? ?(mm|cm|m|deg|rad|°)(?![\w²³/^])(?! \w*['\"])")
"""A number with a unit of length or angle other than those of `ODD`."""


def shown_in(scene: Scene, units: Units) -> Scene:
    """The same mechanism from a scene whose bare numbers are counted in other units."""
    return replace(scene, document=scene.document.model_copy(update={"units": UnitsDocument(**vars(units))}))


# --- texts ------------------------------------------------------------------------------------------------------------


def test_a_text_shows_its_quantities_in_the_units_of_its_reader():
    text = Text(f"{as_length(0.0508)} at {as_angle(np.pi / 2, 4)}")
    assert text == "50.8 mm at 90°"
    assert text.in_units(ODD) == "2 in at 0.25 turn"
    assert text.in_units(Units()) == "0.0508 m at 1.571 rad"
    assert Text(f"{as_coordinate(0.0, rotary=True)}, {as_coordinate(-0.0, rotary=False)}") == "0°, 0 mm"
    assert Text(as_force(9.80665)).in_units(ODD) == "1 kgf"


def test_faults_and_events_show_theirs_too():
    fault = Fault("joints.A", f"{as_length(0.0254)} apart.", f"Give {as_length(0.0127)}.")
    assert str(fault) == "joints.A: 25.4 mm apart. Give 12.7 mm."
    assert fault.in_units(ODD) == Fault("joints.A", "1 in apart.", "Give 0.5 in.")
    assert replace(fault, path="joints.B").in_units(ODD).message == "1 in apart."
    event = Event(0.0, "INFO", "A", f"at {as_angle(np.pi)}")
    assert event.text == "at 180°" and event.in_units(ODD).text == "at 0.5 turn"


def test_the_units_of_a_scene_have_all_kinds_of_quantities_of_texts():
    units = Units(length="mm", angle="deg", force="kN", time="s", torque="kN m")
    shown = {kind: units.show(1.0, kind, 4) for kind in QuantityKind.__args__}
    assert shown == {
        "length": "1000 mm", "angle": "57.3°", "linear speed": "1000 mm/s", "angular speed": "57.3 °/s", "force": "0.001 kN",
        "torque": "0.001 kN m", "stiffness": "1e-06 kN/mm", "torsional stiffness": "1.745e-05 kN m/°", "Pa": "1e-06 MPa",
        "1/m": "1 1/m", "m/rad": "1 m/rad", "rad/m": "1 rad/m", "rad/m^2": "1 rad/m²",
    }  # fmt: skip
    assert set(shown) - set(UNIT_KINDS) == {"Pa", "1/m", "m/rad", "rad/m", "rad/m^2"}


# --- faults: scenes whose numbers are changed -------------------------------------------------------------------------

SCENES = [(entry.name, tomllib.loads(entry.path.read_text(encoding="utf-8"))) for entry in gallery()]
SYSTEMS = {
    Units(length="mm", angle="deg"): "(m|cm|in|rad|turn)",
    Units(length="in", angle="rad"): "(mm|cm|m|deg|°|turn)",
    Units(length="ft", angle="turn", force="kgf"): "(mm|cm|m|deg|°|rad)",
}
"""Units of scenes, and those that nothing may be told in."""


def foreign(units: Units, words: str) -> bool:
    """Whether a number with another unit of length or angle stands in a text, but for examples and what is quoted."""
    unit = SYSTEMS[units]
    return re.search(rf"(?<![\w'\"])-?[\d.]+(e[+-]?\d+)? ?{unit}(?![\w²³/^])(?! \w*['\"])", words) is not None


def numbers(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of numbers of the scene's units in plain data."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from numbers(inner, (*path, key))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path


def spoilt(rng: random.Random) -> tuple[str, dict[str, Any]]:
    """A scene of the gallery with one number of its links, joints or loads multiplied."""
    name, raw = rng.choice(SCENES)
    raw = copy.deepcopy(raw)
    *parents, key = rng.choice([p for p in numbers(raw) if p[0] in ("links", "joints", "loads")] or [("run",)])
    if not parents:
        return name, raw
    table = raw
    for part in parents:
        table = table[part]
    table[key] *= rng.choice([0, -1, 0.1, 0.5, 3, 10, 1000, 1e-6])
    return name, raw


@pytest.mark.sample(1)
@pytest.mark.parametrize("units", list(SYSTEMS), ids=lambda u: f"{u.length} {u.angle}")
def test_faults_of_spoilt_scenes_are_in_their_units_and_at_their_keys(units):
    rng, told = random.Random(units.length), 0
    while told < examples(12):
        name, raw = spoilt(rng)
        if "free" in str(raw["joints"]):
            continue
        if rng.random() < 0.3:  # its numbers are counted in other units: what the reader says of them
            raw["units"] = vars(units)
        try:
            scene = Scene.build(name=name, folder=GALLERY_FOLDER, **raw)
        except SceneError as error:
            faults = [f for f in error.faults if raw.get("units") == vars(units)]
        else:
            scene = shown_in(scene, units)
            try:
                assert not [line for line in check_lines(scene) if foreign(units, line)], name
                continue
            except MechanismError as error:
                faults = list(error.faults)
            for f in faults:
                assert f.path.partition(".")[0] in type(scene.document).model_fields, (name, str(f))
        told += len(faults)
        assert not [str(f) for f in faults if foreign(units, f"{f.message} {f.remedy}")], name


def test_a_fault_within_a_fault_is_in_the_units_too():
    """The sketch of a mechanism that cannot be led to its start: words of one fault inside those of another."""
    text = load("excavator-arm").text
    raw = tomllib.loads(text)
    drive = raw["joints"]["C1"]["drive"]
    place = next(iter(numbers(drive)))
    table = drive
    for part in place[:-1]:
        table = table[part]
    table[place[-1]] *= 1000
    scene = shown_in(Scene.build(**raw), ODD)
    with pytest.raises(MechanismError) as error:
        check_lines(scene)
    assert error.value.faults and not [str(f) for f in error.value.faults if FOREIGN.search(str(f))]


@pytest.mark.parametrize(
    ("name", "change", "path"),
    [
        ("cam-roller", ("over = 60 }", "over = 50 }"), "joints.K.profile.lift"),
        ("cam-barrel", ("roller = 8", "roller = 80"), "joints.K.follower.roller"),
        ("cam-inverse", ("groove = 8", "groove = 60"), "joints.K.follower.groove"),
        ("cam-oscillating-roller", ("base = ", "base = 9"), "joints.K.profile.base"),
    ],
)
def test_faults_of_cams_name_keys_that_exist(name, change, path):
    text = load(name).text
    assert change[0] in text
    with pytest.raises(MechanismError) as error:
        check_lines(mechviz.loads(text.replace(*change), folder=GALLERY_FOLDER))
    assert [f.path for f in error.value.faults] == [path]


# --- remedies ---------------------------------------------------------------------------------------------------------

SIX_BAR = """
units = { length = "mm", angle = "deg" }

[links]
frame = { points = { A = [0, 0], D = [150, 0], G = [150, 150] } }
crank = { points = { A = [0, 0], B = [40, 0] } }
rod = { points = { B = [0, 0], C = [120, 0] } }
rocker = { points = { D = [0, 0], C = [90, 0] } }
link = { points = { C = [0, 0], H = [70, 0] } }
arm = { points = { G = [0, 0], H = [70, 0] } }

[joints]
A = { revolute = ["frame", "crank"], drive = { oscillation = { centre = 60, amplitude = 20, period = "1 s" } } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "rocker"], side = "right" }
D = { revolute = ["frame", "rocker"] }
L = { revolute = ["rocker", "link"], at = ["C", "C"] }
G = { revolute = ["frame", "arm"] }
H = { revolute = ["link", "arm"], side = "left" }
"""
"""A four-bar whose C lies above or below its coupler; only from above do 140 mm reach to G."""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("", ""), 'at the start.*or take the other mode at C, side = "left", in which it fits.'),
        (("G = [150, 150]", "G = [150, 60]"), 'or take the other mode at C, side = "left", in which it runs.'),
    ],
)
def test_the_other_assembly_mode_of_a_group_before_is_named_where_it_fits(change, words):
    scene = mechviz.loads(SIX_BAR.replace(*change))
    with pytest.raises(MechanismError, match=rf"(?s)joints.H: .*{words}"):
        check_lines(scene)
    check_lines(mechviz.loads(SIX_BAR.replace(*change).replace('"right"', '"left"')))
    far = mechviz.loads(SIX_BAR.replace("G = [150, 150]", "G = [150, 400]"))
    with pytest.raises(MechanismError) as error:
        check_lines(far)
    assert "the other mode" not in str(error.value)


def test_the_joint_at_which_a_mode_is_stated_is_named():
    """Any joint of a group may state its mode."""
    text = (GALLERY_FOLDER / "crank-rocker.toml").read_text(encoding="utf-8")
    stated, pin = ', side = "left"', '["rocker", "frame"]'
    assert stated in text and pin in text
    scene = mechviz.loads(text.replace(stated, "").replace(pin, pin + stated))
    assert next(line for line in check_lines(scene) if line.startswith("  C:")) == "  C: left (stated at D)"


def test_a_free_link_is_not_called_driven_and_a_follower_not_geared():
    def groups(name: str) -> str:
        return " ".join(line for line in check_lines(load(name)) if "class " in line)

    assert "; free" in groups("swinging-double-pendulum") and "driven" not in groups("swinging-double-pendulum")
    assert "with a higher pair" in groups("cam-roller") and "geared" not in groups("cam-roller")
    assert "geared" in groups("gear-train")


def test_a_moment_of_inertia_in_another_unit_is_noticed():
    """In a scene in mm, kg mm^2 are written for kg m^2: the radius of gyration is a thousand times too large."""
    sound = load("slider-crank-compressor")
    place = ("links", "rod", "inertia")
    wrong = sound.changed({place: 1e6 * sound.mechanism.links[[x.name for x in sound.mechanism.links].index("rod")].inertia})
    assert not [line for line in check_lines(sound) if line.startswith("masses")]
    (line,) = (line for line in check_lines(wrong) if line.startswith("masses"))
    assert line.startswith("masses     rod: its radius of gyration is ") and line.endswith("is its moment of inertia in kg m²?")
