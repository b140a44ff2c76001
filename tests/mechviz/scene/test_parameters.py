"""Parameters of a scene and expressions of them: values, units, faults, what is saved, and what the command line sets."""

from __future__ import annotations

import inspect
import math
import tomllib
from importlib import import_module

import numpy as np
import pytest
from schemas import SCHEMA, conforms
from typer.testing import CliRunner

import mechviz
from mechviz.commands.main import COMMANDS, app
from mechviz.editor.history import Draft
from mechviz.editor.parameters import find_parameters
from mechviz.editor.saving import updated_text
from mechviz.outputs.rerun.reader import Recording
from mechviz.scene.expressions import Amount, parse_expression
from mechviz.scene.faults import SceneError
from mechviz.scene.reading.formulas import parameter_words
from mechviz.scene.units import QuantityError

TEXT = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]

[parameters]
r = { value = "30 mm", range = ["20 mm", "60 mm"], tolerance = "0.05 mm" }
l = "5*r"          # the ratio stays
omega = "900 rpm"
n = 3
tilt = "10 deg"

[links]
frame = { points = { A = [0, 0] } }
crank = { points = { A = [0, 0], B = ["r*cos(tilt)", "r*sin(tilt)"] }, mass = "n * 0.4 kg", centre = ["r/4", 0], inertia = 0.0042 }
rod = { points = { B = [0, 0], C = ["l", 0] }, mass = "0.9 kg", centre = [52, 0], inertia = "0.0031 kg m^2" }
piston = { points = { C = [0, 0] }, mass = "0.7 kg" }

[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "omega/n" } }
B = { revolute = ["crank", "rod"] }
C = { revolute = ["rod", "piston"] }
S = { prismatic = ["frame", "piston"], at = ["A", "C"], along = [1, 0], branch = "ahead" }

[run]
frames = "12*n"
"""
R, PHI = Amount(0.03, (0, 1, 0, 0)), Amount(0.5, (1, 0, 0, 0))


@pytest.fixture(scope="module")
def scene():
    return mechviz.loads(TEXT, "engine")


@pytest.mark.parametrize(
    ("text", "number", "powers"),
    [
        ("2*r + 5 mm", 0.065, (0, 1, 0, 0)),
        ("-r^2 - -(1 cm)^2", -0.0009 + 0.0001, (0, 2, 0, 0)),
        ("(2*n + 1) mm", 0.007, (0, 1, 0, 0)),
        ("12 mm/2/3", 0.002, (0, 1, 0, 0)),
        ("r*cos(phi - 30 deg)", 0.03 * math.cos(0.5 - math.pi / 6), (0, 1, 0, 0)),
        ("sqrt(r^2 + (4 cm)^2)", 0.05, (0, 1, 0, 0)),
        ("max(r, 50 mm, 1 cm) - min(r, 1 in)", 0.05 - 0.0254, (0, 1, 0, 0)),
        ("2 m/s / r * 1 rad", 2.0 / 0.03, (1, 0, 0, -1)),
        ("3 N/mm*r", 90.0, (0, 1, 1, -2)),
        ("5 N m/(rad s)", 5.0, (-1, 2, 1, -3)),
        ("abs(-2)^n + 2**-1", 8.5, (0, 0, 0, 0)),
        ("atan(1)*4/pi", 1.0, (1, 0, 0, 0)),
        ("1e-3 m + 7e0mm", 0.008, (0, 1, 0, 0)),
    ],
)
def test_expressions_have_the_value_of_the_formula(text, number, powers):
    computed = parse_expression(text).value({"r": R, "phi": PHI, "n": Amount(3.0)})
    assert computed.powers == powers
    assert float(computed.number) == pytest.approx(number, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("r + 5", "adds a length and a plain number"),
        ("r - phi", "subtracts a length and an angle"),
        ("max(r, phi)", "compares"),
        ("sin(r)", "not of an angle"),
        ("sqrt(r)", "the root of a length"),
        ("r^n^2 + r", "'\\^' stands where"),
        ("r^0.5", "no whole power"),
        ("1/(r - 30 mm)", "no finite value"),
        ("2 r", "'r' in '2 r' stands directly after a value"),
        ("2*r +", "ends too early"),
        ("(r", "ends too early"),
        ("r; r", "holds ';'"),
        ("cosh(n)", "no function"),
        ("sin(phi, phi)", "has 2 values"),
        ("radius", "unknown parameter 'radius'\\."),
        ("__import__('os')", "holds '''|no function"),
        ("(" * 100 + "r" + ")" * 100, "nests brackets"),
    ],
)
def test_expressions_that_say_nothing_are_refused(text, said):
    with pytest.raises(QuantityError, match=said):
        parse_expression(text).value({"r": R, "phi": PHI, "n": Amount(3.0)})


def test_a_scene_of_expressions_is_the_scene_of_their_values(scene):
    values = {
        '"r*cos(tilt)", "r*sin(tilt)"': f"{30 * math.cos(math.radians(10))!r}, {30 * math.sin(math.radians(10))!r}",
        '"n * 0.4 kg"': "1.2", '"r/4"': "7.5", '"l"': "150", '"omega/n"': '"300 rpm"', '"12*n"': "36",
    }  # fmt: skip
    head, _, rest = TEXT.partition("[parameters]")
    text = head + rest[rest.index("[links]") :]
    for expression, value in values.items():
        assert expression in text
        text = text.replace(expression, value)
    plain = mechviz.loads(text)
    assert plain.frames == scene.frames == 36
    for ours, theirs in zip(scene.mechanism.links, plain.mechanism.links, strict=True):
        assert ours.name == theirs.name
        assert ours.mass == pytest.approx(theirs.mass, rel=3e-16)
        assert ours.centre == theirs.centre
        for point, place in theirs.points.items():
            np.testing.assert_allclose(ours.points[point], place, rtol=3e-16, atol=0.0)
    (drive,), (other,) = scene.mechanism.drives, plain.mechanism.drives
    assert drive.law.speed == pytest.approx(other.law.speed, rel=3e-16)


def test_another_value_reaches_all_that_follows_from_it_and_nothing_else(scene):
    changed = scene.with_parameters({"r": "40 mm", "n": 4})
    crank, rod = changed.mechanism.links[1:3]
    assert np.hypot(*crank.points["B"]) == pytest.approx(0.040, rel=1e-15)
    assert rod.points["C"][0] == pytest.approx(0.200, rel=1e-15)
    assert crank.mass == pytest.approx(1.6, rel=1e-15)
    assert changed.frames == 48
    assert changed.mechanism.links[3] == scene.mechanism.links[3]
    assert changed.with_parameters({"r": "30 mm", "n": 3}) == scene


def test_saving_keeps_expressions_and_comments(scene):
    assert mechviz.loads(scene.to_toml()) == scene
    changed = scene.changed({("parameters", "r", "value"): "42 mm", ("links", "crank", "mass"): "n * 0.5 kg"})
    assert updated_text(scene, changed) == TEXT.replace('"30 mm"', '"42 mm"').replace("n * 0.4 kg", "n * 0.5 kg")
    plain = scene.changed({("links", "rod", "points", "C", 0): 100.0})
    assert plain.with_parameters({"r": "40 mm"}).mechanism.links[2].points["C"] == (0.1, 0.0)  # no expression stands there any more


def test_a_list_may_become_longer_by_an_expression(scene):
    table = {"position": [0, 120, 360], "factor": [1, 2, 1]}
    loaded = scene.changed({("loads", "P"): {"force": [1, 0], "on": "piston", "at": "C", "table": table}})
    changed = loaded.changed({("loads", "P", "table"): {"position": [0, 60, 120, 360], "factor": [1, 2, 2, "n"]}})
    assert changed.document.loads["P"].table.factor == [1.0, 2.0, 2.0, 3.0]
    assert mechviz.loads(changed.to_toml()) == changed


def test_expressions_of_default_values_are_kept():
    text = TEXT.replace("[parameters]", 'gravity = ["0*fall", "-fall"]\n[parameters]\nfall = "9.81 m/s^2"')
    again = mechviz.loads(mechviz.loads(text).to_toml())
    assert again.document.gravity == (0.0, -9.81)
    assert again.document.formulas["gravity", 1] == "-fall"
    assert again.document.formulas["gravity", 0] == "0*fall"


@pytest.mark.parametrize(
    ("before", "after", "path", "said"),
    [
        ('l = "5*r"', 'l = "5*q"', "parameters.l", "unknown parameter 'q' in '5*q'"),
        ('l = "5*r"', 'l = "5*tillt"', "parameters.l", "Did you mean 'tilt'?"),
        ('l = "5*r"', 'l = "2*k"\nk = "l/3"', "parameters.l", "follows from itself: l -> k -> l"),
        ('l = "5*r"', 'l = "l + r"', "parameters.l", "names itself"),
        ('l = "5*r"', 'l = "5 deg"', "links.rod.points.C[0]", "'l' is an angle, a length is wanted"),
        ('l = "5*r"', "l = 150", "links.rod.points.C[0]", "a length is wanted. Multiply a plain number by its unit, such as 1 mm"),
        ('"omega/n"', '"2 m/s/r"', "joints.A.drive.speed", "multiply by 1 rad"),
        ('"12*n"', '"n/2"', "run.frames", "1.5, a whole number is wanted"),
        ('"12*n"', '"1 mm"', "run.frames", "1 mm"),
        ('"n * 0.4 kg"', '"-n * 0.4 kg"', "links.crank.mass", "'-n * 0.4 kg': -1.2"),
        ('"20 mm", "60 mm"', '"40 mm", "60 mm"', "parameters.r", "outside of its range"),
        ('"20 mm", "60 mm"', '"60 mm", "20 mm"', "parameters.r.range", "begins where it ends"),
        ('tolerance = "0.05 mm"', "tolerance = 0.05", "parameters.r.tolerance", "is a plain number, r is a length"),
        ("tilt = ", 'mm = "1 m"\ntilt = ', "parameters.mm", "the symbol of a unit"),
        ("tilt = ", 'sin = "1 m"\ntilt = ', "parameters.sin", "has its own meaning"),
    ],
)
def test_every_fault_names_its_place(before, after, path, said):
    assert before in TEXT
    with pytest.raises(SceneError) as caught:
        mechviz.loads(TEXT.replace(before, after))
    (fault,) = caught.value.faults
    assert fault.path == path
    assert said in f"{fault.message} {fault.remedy}"


def test_a_plain_number_is_to_be_multiplied_by_a_unit_of_the_scene():
    with pytest.raises(SceneError, match=r"its unit, such as 1 in\."):
        mechviz.loads(TEXT.replace('length = "mm"', 'length = "in"').replace('l = "5*r"', "l = 6"))


def test_parameters_are_told_in_the_units_of_the_scene(scene):
    assert parameter_words(scene.document) == [
        "r = 30 mm, from 20 mm to 60 mm, ± 0.05 mm", "l = 5*r = 150 mm", "omega = 900 rpm", "n = 3", "tilt = 10 deg"
    ]  # fmt: skip


def test_sliders_are_the_parameters_first_and_not_what_follows_from_them(scene):
    parameters = find_parameters(scene)
    assert [p.label for p in parameters[:4]] == ["r", "omega", "n", "tilt"]  # l follows from r
    first = parameters[0]
    assert (first.value, first.unit, first.low, first.high) == (30.0, "mm", 20.0, 60.0)
    assert parameters[2].whole  # a number of frames follows from it
    assert not {p.path for p in parameters} & scene.document.formulas.keys()
    moved = Draft.of(scene).with_value(first.path, first.written(45.0)).scene()
    assert moved == scene.with_parameters({"r": "45.0 mm"})


def test_a_parameter_is_set_on_the_command_line_and_travels_in_the_recording(tmp_path, scene):
    file, recording = tmp_path / "engine.toml", tmp_path / "engine.rrd"
    file.write_text(TEXT, encoding="utf-8")
    run = CliRunner().invoke(app, ["record", str(file), "--set", "r=42mm", "--set", "n=4", "-o", str(recording)])
    assert run.exit_code == 0, run.output
    read = Recording(str(recording)).scene()
    assert read == scene.with_parameters({"r": "42mm", "n": 4})
    assert read.parameters["r"].amount.number == pytest.approx(0.042)


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("r=42", "is a plain number, r is a length"),
        ("q=1", "no parameter 'q'"),
        ("r", "like r=42mm"),
        ("r=70mm", "outside of its range"),
    ],
)
def test_settings_that_do_not_fit_are_refused(tmp_path, setting, said):
    file = tmp_path / "engine.toml"
    file.write_text(TEXT, encoding="utf-8")
    run = CliRunner().invoke(app, ["check", str(file), "--set", setting])
    assert run.exit_code == 2
    assert said in run.output


def test_every_command_of_a_scene_sets_parameters():
    functions = [getattr(import_module(f"mechviz.commands.{m}"), c) for m, commands in COMMANDS.items() for c in commands]
    reading = [f for f in functions if {"scene", "source"} & inspect.signature(f).parameters.keys()]
    assert len(reading) > 10
    assert not [f.__name__ for f in reading if "values" not in inspect.signature(f).parameters]


def test_the_schema_knows_parameters_and_expressions():
    document = tomllib.loads(TEXT)
    assert conforms(document, SCHEMA, SCHEMA)
    for wrong in ("80", "rpm 60", ""):
        assert not conforms({**document, "gravity": [0, wrong]}, SCHEMA, SCHEMA)
    assert not conforms({**document, "run": {"frames": "36"}}, SCHEMA, SCHEMA)
