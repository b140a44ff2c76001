"""Sweeps over parameters: the same as run by run, rows with reasons, samples, studies that go on where they were cut off."""

from __future__ import annotations

import csv
import io

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

import mechviz
from mechcore.compiled.toolchain import compiler
from mechcore.errors import MechanismError
from mechviz.commands.main import app
from mechviz.runs import run_scene
from mechviz.scene.scene import load, loads
from mechviz.studies.designs.evaluate import evaluate, study_of
from mechviz.studies.designs.measures import parse_measure
from mechviz.studies.designs.sampling import grid, parse_sample, parse_variation, sampled
from mechviz.studies.designs.sweep import Store, about_study, run_study

OF = ["drive.A.torque:max", "joint.B.reaction:peak", "joint.S.displacement:range", "link.rod.angle:at 90 deg"]


def question(scene, vary, of, frames=24):
    return study_of(scene, [parse_variation(scene, v) for v in vary], [parse_measure(scene, m) for m in of], frames=frames)


@pytest.fixture(scope="module")
def press():
    return mechviz.load("parametric-press")


def test_a_batch_is_the_same_as_run_by_run_and_as_the_closed_form(press):
    study = question(press, ["stroke=60..100mm:3", "ratio=3.5,5"], OF)
    assert study.batch is not None
    designs = grid(study.variations)
    outcomes = evaluate(study, designs)
    assert not any(outcomes.reasons)
    for k, (stroke, ratio) in enumerate(designs):
        run = run_scene(press.with_parameters({"stroke": f"{stroke} mm", "ratio": float(ratio)}), frames=24)
        assert outcomes.values[0][k] == pytest.approx(run.catalogue["drive.A.torque"].values().max(), rel=1e-12)
        assert outcomes.values[1][k] == pytest.approx(run.catalogue["joint.B.reaction"].values()[:, 2].max(), rel=1e-12)
        assert outcomes.values[2][k] == pytest.approx(stroke, rel=1e-12)
        assert outcomes.values[3][k] == pytest.approx(-np.degrees(np.arcsin(1.0 / ratio)), rel=1e-12)


@pytest.mark.parametrize(
    "executor", ["numpy", pytest.param("c", marks=pytest.mark.skipif(compiler() is None, reason="no C compiler"))]
)
def test_speeds_of_the_drive_vary_in_a_batch(press, executor):
    """What inertia needs goes with the square of the speed; frames are compared where the drive is."""
    variations = [parse_variation(press, v) for v in ("speed=60rpm,240rpm", "stroke=70mm,90mm")]
    measures = [
        parse_measure(press, m)
        for m in ("joint.S.velocity:rms", "drive.A.torque:mean", "drive.A.torque:at 40 deg", "drive.A.power")
    ]
    study = study_of(press, variations, measures, frames=24, executor=executor)
    assert study.batch is not None and study.compiled == (executor == "c")
    designs = grid(variations)
    outcomes = evaluate(study, designs)
    velocity = dict(zip(map(tuple, designs), outcomes.values[0], strict=True))
    assert velocity[240.0, 70.0] == pytest.approx(4.0 * velocity[60.0, 70.0], rel=1e-12)
    for k, (speed, stroke) in enumerate(designs):
        run = run_scene(press.with_parameters({"stroke": f"{stroke} mm", "speed": f"{speed} rpm"}), frames=24)
        for measure, values in zip(measures, outcomes.values, strict=True):
            curve = run.catalogue[measure.key].values()[:, 0]
            drive = run.catalogue.coordinate("A")
            wanted = measure.reduced(curve, run.motion.time, drive)
            np.testing.assert_allclose(values[k], wanted, rtol=1e-10, atol=1e-12 * np.abs(curve).max())


CHANGE_POINT = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
parameters = { crank = "60 mm" }
[links]
frame = { points = { A = [0, 0], D = [200, 0] } }
crank = { points = { A = [0, 0], B = ["crank", 0] } }
coupler = { points = { B = [0, 0], C = [180, 0] }, mass = 2.0, centre = [90, 0], inertia = "0.01 kg m^2" }
rocker = { points = { D = [0, 0], C = [155, 0] }, mass = 2.0, centre = [75, 0], inertia = "0.01 kg m^2" }
[joints]
A = { revolute = ["frame", "crank"], drive = { speed = "120 rpm" } }
B = { revolute = ["crank", "coupler"] }
C = { revolute = ["coupler", "rocker"], side = "left" }
D = { revolute = ["rocker", "frame"] }
"""


@pytest.mark.parametrize("effects", ["inertia", "inertia, gravity"])
def test_a_design_at_a_change_point_is_what_it_is_by_itself(effects):
    """135 + 200 = 180 + 155: the links come to lie in one line at a frame, and side by side with others reactions have no bound."""
    text = CHANGE_POINT.replace('"inertia"]', ", ".join(f'"{e}"' for e in effects.split(", ")) + "]")
    study = question(loads(text, "change-point"), ["crank=60mm,135mm"], ["joint.B.reaction:peak"], 360)
    assert study.batch is not None
    outcomes = evaluate(study, np.array([[60.0], [135.0]]))
    assert outcomes.values[0][0] < 100.0 and outcomes.reasons[0] == ""
    if "gravity" in effects:  # whose power cannot balance there
        assert np.isnan(outcomes.values[0][1]) and "not to be trusted" in outcomes.reasons[1]
    else:
        alone = run_scene(study.scene.with_parameters({"crank": "135 mm"}), frames=360)
        assert outcomes.values[0][1] == pytest.approx(alone.catalogue.peak("joint.B.reaction"), rel=1e-12)


@pytest.mark.parametrize("drive", [', drive = { speed = "0 rpm" }', ""])
def test_what_stands_still_is_computed_side_by_side(drive):
    """A crank that is held, and a structure: the bar from the crank's end to the frame takes the crank's freedom."""
    text = CHANGE_POINT.replace('["inertia"]', '["inertia", "gravity"]').replace(', drive = { speed = "120 rpm" }', drive)
    if not drive:
        text = text.replace("[joints]", "bar = { points = { B = [0, 0], D = [165, 0] } }\n[joints]")
        text += 'E = { revolute = ["frame", "bar"], at = "D" }\nF = { revolute = ["crank", "bar"], at = "B", side = "left" }\n'
    study = question(loads(text, "still"), ["crank=60mm,70mm"], ["joint.B.reaction:peak", "link.coupler.angle:max"], None)
    assert study.batch is not None
    outcomes = evaluate(study, grid(study.variations))
    assert not any(outcomes.reasons)
    for k, crank in enumerate(("60 mm", "70 mm")):
        run = run_scene(study.scene.with_parameters({"crank": crank}))
        assert outcomes.values[0][k] == pytest.approx(run.catalogue.peak("joint.B.reaction"), rel=1e-12)
        assert outcomes.values[1][k] == pytest.approx(run.catalogue["link.coupler.angle"].values().max(), rel=1e-12)


def test_a_drive_that_would_turn_round_is_run_by_itself(press):
    text = press.to_toml().replace('speed = "speed"', 'speed = "speed - 100 rpm"')
    assert text != press.to_toml()
    study = question(mechviz.loads(text), ["speed=60rpm,240rpm"], ["joint.S.velocity:rms"])
    assert study.batch is None
    slow, fast = evaluate(study, grid(study.variations)).values[0]
    assert fast == pytest.approx(3.5 * slow, rel=1e-12)


def test_a_range_that_begins_below_zero_has_its_ends():
    text = load("crank-rocker").to_toml() + '\n[parameters]\nheight = { value = "-20 mm", range = ["-30 mm", "30 mm"] }\n'
    scene = loads(text).changed({("links", "coupler", "points", "E"): [90, "height"], ("trace",): ["coupler.E"]})
    study = question(scene, ["height=-30mm,30mm"], ["point.coupler.E.position[y]:max"])
    assert not any(evaluate(study, grid(study.variations)).reasons)


TWO_DRIVES = """
units = { length = "mm", angle = "deg" }
effects = ["inertia"]
trace = ["P"]
[parameters]
left_speed = "90 rpm"
right_speed = "-60 rpm"
start = "30 deg"
arm = "70 mm"
[links]
frame = { points = { A = [0, 0], E = [200, 0] } }
left  = { points = { A = [0, 0], B = ["arm", 0] }, mass = "0.5 kg", centre = [35, 0], inertia = "0.001 kg m^2" }
upper_left  = { points = { B = [0, 0], P = [220, 0] }, mass = "0.8 kg", centre = [110, 0], inertia = "0.003 kg m^2" }
upper_right = { points = { P = [0, 0], D = [220, 0] }, mass = "0.8 kg", centre = [110, 0], inertia = "0.003 kg m^2" }
right = { points = { E = [0, 0], D = [70, 0] }, mass = "0.5 kg", centre = [35, 0], inertia = "0.001 kg m^2" }
[joints]
A = { revolute = ["frame", "left"], drive = { speed = "left_speed", start = 90 } }
B = { revolute = ["left", "upper_left"] }
P = { revolute = ["upper_left", "upper_right"], side = "left" }
D = { revolute = ["upper_right", "right"] }
E = { revolute = ["frame", "right"], drive = { speed = "right_speed", start = "start" } }
"""


@pytest.mark.parametrize(
    "executor", ["numpy", pytest.param("c", marks=pytest.mark.skipif(compiler() is None, reason="no C compiler"))]
)
@pytest.mark.parametrize(
    "vary", [["left_speed=60rpm,120rpm", "arm=60mm,70mm"], ["right_speed=-90rpm,0rpm,45rpm", "start=10deg,200deg"]]
)
def test_several_drives_vary_in_a_batch(executor, vary):
    scene = loads(TWO_DRIVES, "two-drives")
    variations = [parse_variation(scene, v) for v in vary]
    measures = [parse_measure(scene, m) for m in ("drive.E.torque", "link.upper_left.angle")]
    study = study_of(scene, variations, measures, frames=24, executor=executor)
    assert study.batch is not None and study.compiled == (executor == "c")
    designs = grid(variations)
    found = evaluate(study, designs)
    for k, design in enumerate(designs):
        run = run_scene(
            scene.with_parameters({v.name: v.stated(float(x)) for v, x in zip(variations, design, strict=True)}), frames=24
        )
        for measure, values in zip(measures, found.values, strict=True):
            wanted = run.catalogue[measure.key].values()[:, 0]
            np.testing.assert_allclose(values[k], wanted, rtol=1e-10, atol=1e-11 * np.abs(wanted).max())


def test_masses_that_follow_from_lengths_vary_in_a_batch():
    bar = 'mass = "0.8 kg", centre = [110, 0], inertia = "0.003 kg m^2" }\nupper_right'
    assert bar in TWO_DRIVES
    text = TWO_DRIVES.replace(bar, 'mass = "0.8 kg", shape = "bar" }\nupper_right').replace(
        "B = [0, 0], P = [220, 0]", 'B = [0, 0], P = ["3*arm", 0]'
    )
    study = question(loads(text, "bars"), ["arm=65mm,75mm"], ["drive.E.torque:peak"])
    assert study.batch is not None
    for arm, peak in zip((65.0, 75.0), evaluate(study, grid(study.variations)).values[0], strict=True):
        run = run_scene(study.scene.with_parameters({"arm": f"{arm} mm"}), frames=24)
        assert peak == pytest.approx(np.abs(run.catalogue["drive.E.torque"].values()).max(), rel=1e-11)


def test_axes_that_follow_a_shaft_vary_with_its_speed_in_a_batch():
    """Frames are compared where the shaft is: speeds of what follows it go with its own, accelerations with its square."""
    text = mechviz.load("two-axis-program").to_toml().replace("[links]", '[parameters]\nw = "60 rpm"\n\n[links]')
    scene = mechviz.loads(text).changed({("joints", "M", "drive", "speed"): "w"})
    of = [f"link.carriage.{what}:peak" for what in ("position[x]", "velocity", "acceleration")]
    study = question(scene, ["w=60rpm,180rpm"], of)
    assert study.batch is not None
    place, speed, acceleration = evaluate(study, grid(study.variations)).values
    assert place[1] == pytest.approx(place[0], rel=1e-12)
    assert speed[1] == pytest.approx(3.0 * speed[0], rel=1e-12)
    assert acceleration[1] == pytest.approx(9.0 * acceleration[0], rel=1e-12)


def test_a_law_is_run_by_itself():
    text = mechviz.load("crank-rocker").to_toml().replace("[links]", '[parameters]\na = "10 deg"\n\n[links]')
    swings = {"oscillation": {"period": "1 s", "amplitude": "a", "centre": 60}}
    study = question(mechviz.loads(text).changed({("joints", "A", "drive"): swings}), ["a=10deg,20deg"], ["link.crank.angle:max"])
    assert study.batch is None
    np.testing.assert_allclose(evaluate(study, grid(study.variations)).values[0], [70.0, 80.0], rtol=1e-12)


def test_a_design_that_cannot_be_assembled_is_a_row_with_its_reason():
    text = mechviz.load("crank-rocker").to_toml().replace("[links]", '[parameters]\na = "60 mm"\n\n[links]')
    scene = mechviz.loads(text).changed({("links", "crank", "points", "B", 0): "a"})
    study = question(scene, ["a=60mm,170mm"], ["link.rocker.angle:range"])
    outcomes = evaluate(study, grid(study.variations))
    assert not outcomes.reasons[0] and np.isfinite(outcomes.values[0][0])
    assert "assembled" in outcomes.reasons[1] and np.isnan(outcomes.values[0][1])


def test_a_study_that_was_cut_off_goes_on_and_ends_the_same(press, tmp_path, monkeypatch):
    monkeypatch.setattr("mechviz.studies.designs.sweep.FLUSH_SECONDS", 0.0)
    monkeypatch.setattr("mechviz.studies.designs.sweep.LARGEST_CHUNK", (8, 8, 8))
    study = question(press, ["speed=60..240rpm:20"], ["drive.A.torque:max"])
    designs = grid(study.variations)
    whole = run_study(study, designs)
    path = tmp_path / "study.parquet"

    def stop(done, total):
        if done >= 8:
            raise KeyboardInterrupt

    store = Store(path, about_study(study, None))
    with pytest.raises(KeyboardInterrupt):
        run_study(study, designs, store, progress=stop)
    assert not path.exists()
    again = Store(path, about_study(study, None))
    again.open()
    assert again.done == set(range(8))
    ended = run_study(study, designs, again)
    np.testing.assert_array_equal(ended.results.values[0], whole.results.values[0])
    complete = Store(path, about_study(study, None))
    complete.open()
    assert complete.done == set(range(20))
    np.testing.assert_array_equal(run_study(study, designs, complete).results.values[0], whole.results.values[0])
    complete.close()
    assert [p.name for p in tmp_path.iterdir()] == ["study.parquet"]
    assert pq.read_schema(path).metadata[b"mechviz.scene_toml"].decode() == press.text
    other = Store(path, about_study(study, parse_sample("lhs:4", 1)))
    with pytest.raises(MechanismError, match="another study"):
        other.open()


def test_two_sweeps_at_once_do_not_write_one_file(press, tmp_path):
    study, path = question(press, ["speed=60..240rpm:20"], ["drive.A.torque:max"]), tmp_path / "study.parquet"
    first = Store(path, about_study(study, None))
    first.open()
    words = ["sweep", "parametric-press", "--vary", "stroke=60mm,70mm", "--of", "drive.A.torque:max", "-n", "12", "-o", str(path)]
    for more in ([], ["--fresh"]):
        second = CliRunner().invoke(app, [*words, *more])
        assert second.exit_code == 1 and "being written by another sweep. Wait for it" in second.output
    run_study(study, grid(study.variations), first)
    first.close()
    assert CliRunner().invoke(app, words).exit_code == 2  # another study: nothing is lost
    assert pq.read_table(path).num_rows == 20 and [p.name for p in tmp_path.iterdir()] == ["study.parquet"]
    assert CliRunner().invoke(app, [*words, "--fresh"]).exit_code == 0
    assert pq.read_table(path).num_rows == 2 and [p.name for p in tmp_path.iterdir()] == ["study.parquet"]


def test_samples_fill_their_ranges_and_repeat(press):
    variations = [parse_variation(press, "stroke"), parse_variation(press, "ratio=3..5")]
    for text in ("lhs:16", "sobol:16"):
        points = sampled(variations, parse_sample(text, 3))
        np.testing.assert_array_equal(points, sampled(variations, parse_sample(text, 3)))
        for column, low, high in ((points[:, 0], 40.0, 120.0), (points[:, 1], 3.0, 5.0)):
            cells = np.floor((column - low) / (high - low) * 16).astype(int)
            assert sorted(cells) == list(range(16))  # one point in each sixteenth


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--vary", "strok=1..2mm:3", "--of", "drive.A.torque"], "Did you mean 'stroke'"),
        (["--vary", "stroke=60..100:3", "--of", "drive.A.torque"], "have no unit"),
        (["--vary", "stroke=60..200mm:3", "--of", "drive.A.torque"], "'stroke', 40 to 120 mm."),
        (["--vary", "links.crank.points.B[0]=40..50mm:3", "--of", "drive.A.torque"], "only those vary in sweeps. Name its value"),
        (["--vary", "stroke", "--of", "drive.A.torque"], "how many values"),
        (["--vary", "stroke:3", "--of", "drive.A.torqe:max"], "Did you mean 'drive.A.torque'"),
        (["--vary", "stroke:3", "--of", "joint.A.torque"], "Did you mean 'drive.A.torque'"),
        (["--vary", "stroke:3", "--of", "drive.A.torque:maximum"], "Did you mean 'max'"),
        (["--vary", "stroke", "--of", "drive.A.torque", "--sample", "sobol:100"], "Take 64 or 128"),
    ],
)
def test_what_cannot_be_asked_is_refused(options, said):
    run = CliRunner().invoke(app, ["sweep", "parametric-press", "--frames", "24", *options])
    assert run.exit_code == 2
    assert said in " ".join(run.output.split())


def test_the_command_prints_a_row_for_each_design():
    run = CliRunner().invoke(
        app, ["sweep", "parametric-press", "-n", "24", "--vary", "stroke=60..100mm:3", "--of", "joint.S.displacement:range"]
    )
    rows = list(csv.DictReader(io.StringIO(run.stdout)))
    assert [float(row["joint.S.displacement:range [mm]"]) for row in rows] == pytest.approx([60.0, 80.0, 100.0])


TO_AND_FRO = """
units = { length = "mm", angle = "deg" }
[run]
frames = 360
[links]
frame = { points = { A = [0, 0] } }
crank = { points = { A = [0, 0] } }
[joints]
A = { revolute = ["frame", "crank"], drive = { oscillation = { centre = 10, amplitude = 60, period = "1 s" } } }
"""


@pytest.mark.parametrize(
    ("frames", "place", "near"), [(360, 40, 1e-6), (360, 39.9, 1e-6), (360, 68, 1e-5), (36, 68, 1e-2), (48, 10, 1e-3)]
)
def test_a_drive_that_goes_to_and_fro_is_at_a_place_for_the_first_time_on_its_way_out(frames, place, near):
    """Its speed there by the energy of the oscillation; frames that rounding puts on the place on the way back do not go before."""
    scene = loads(TO_AND_FRO)
    run = run_scene(scene, frames=frames)
    speed, angle = (
        float(m.reduced(run.catalogue[m.key].values()[:, 0], run.catalogue.numbers.time, run.catalogue.coordinate("A")))
        for m in (parse_measure(scene, f"joint.A.{what}:at {place}") for what in ("angular_velocity", "angle"))
    )
    assert speed == pytest.approx(2.0 * np.pi * np.radians(np.sqrt(60.0**2 - (place - 10.0) ** 2)), rel=near)
    assert angle == pytest.approx(place, rel=1e-9)
