"""The command line as a user meets it: what `check` and `inspect` print, signals, full and closed outputs."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from patience import PATIENCE
from typer.testing import CliRunner

from mechcore.motion.reach import reachable_ranges
from mechcore.motion.solve import compile_mechanism
from mechviz.commands.main import app
from mechviz.outputs.inspection import format_inspection, inspect
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene
from mechviz.scene.folder import TOPICS, gallery, gallery_names
from mechviz.scene.scene import Scene, load, loads
from mechviz.studies.report import check_lines
from recordings import gallery_scene

COMMAND = [sys.executable, "-m", "mechviz"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


def after(marker: str, lines: list[str]) -> list[str]:
    """The lines below the one that begins with a word, as far as they are indented."""
    start = next(k for k, line in enumerate(lines) if line.startswith(marker))
    below = lines[start + 1 :]
    return below[: next((k for k, line in enumerate(below) if not line.startswith(" ")), len(below))]


# --- check ------------------------------------------------------------------------------------------------------------


@pytest.mark.sample(24)
@pytest.mark.parametrize("name", gallery_names())
def test_check_prints_every_scene_of_the_gallery_and_tells_modes_apart(name):
    lines = check_lines(gallery_scene(name), modes=True)
    modes = [line.split(":", 1)[1].split("<-")[0].strip() for line in after("modes", lines) if re.match(r" {4}\w+:", line)]
    for first, second in zip(modes[::2], modes[1::2], strict=True):
        assert first != second
    assert not any(re.search(r"-0 mm|e-1[0-9] mm[,\s]", line) for line in lines if not line.startswith("health"))


def test_check_says_what_moves_only_because_its_lengths_agree():
    said = {name: "\n".join(check_lines(load(name))) for name in ("braced-parallelogram", "two-guides", "crank-rocker")}
    assert ["it moves only because its lengths and angles agree" in text for text in said.values()] == [True, True, False]


def test_modes_whose_joint_stays_at_its_place_are_told_by_displacement_and_angle():
    lines = check_lines(load("slotted-lever"), modes=True)
    ahead, behind = after("modes", lines)[1:]
    values = [float(re.search(r"displaced by (\S+) mm", line)[1]) for line in (ahead, behind)]  # type: ignore[index]
    assert values[0] == -values[1] > 0.0
    angles = [float(re.search(r"lever (\S+)°", line)[1]) for line in (ahead, behind)]  # type: ignore[index]
    assert abs(angles[0] - angles[1]) == pytest.approx(180.0, abs=0.1)


def test_the_reach_of_a_sliding_drive_names_first_what_the_run_can_reach():
    lines = check_lines(load("piston-driven-crank"))
    at = next(k for k, line in enumerate(lines) if line.startswith("reach"))
    assert lines[at] == "reach      drive S: 90 mm to 170 mm"
    assert "no way leads from there to -170 mm to -90 mm" in lines[at + 1]


def test_the_length_of_a_cylinder_is_never_negative():
    scene = load("excavator-arm")
    assert min(low for low, _ in reachable_ranges(compile_mechanism(scene.mechanism))) > 0.0
    (reach,) = [line for line in check_lines(scene) if line.startswith("reach")]
    assert "-" not in reach.replace("excavator-arm", "")


# --- inspect ----------------------------------------------------------------------------------------------------------


def inspected(scene: Scene, path: Path, frames: int = 60) -> str:
    write_recording(run_scene(scene, frames=frames), path)
    return format_inspection(inspect(path))


def test_inspect_prints_zero_for_rounding_but_leaves_health_alone(tmp_path: Path):
    text = inspected(load("excavator-arm"), tmp_path / "a.rrd")
    peaks, health = text.split("Peaks\n")[1].split("Worst health\n")
    values = [float(match[1]) for line in peaks.splitlines() if (match := re.search(r" (\S+) N(?: m)? ", line))]
    assert len(values) > 8
    assert all(value == 0.0 or abs(value) > 1e-7 for value in values)
    assert re.search(r"couple C1 +0 N m +throughout", peaks)
    assert re.search(r"reaction C1 +0 N +throughout", peaks)
    assert re.search(r"closure +\d\S*e-1\d m ", health)
    assert "-0 " not in text


def test_inspect_shows_the_range_of_a_drive_that_goes_to_and_fro(tmp_path: Path):
    line = next(x for x in inspected(load("piston-driven-crank"), tmp_path / "a.rrd", 80).splitlines() if x.startswith("  frames"))
    assert line.endswith("drive 130.000 mm to 130.000 mm between 90.000 mm and 170.000 mm")
    line = next(x for x in inspected(load("crank-rocker"), tmp_path / "b.rrd").splitlines() if x.startswith("  frames"))
    assert line.endswith("drive 0.000° to 360.000°")


def test_events_name_no_position_that_is_only_rounding(tmp_path: Path):
    text = inspected(load("elliptic-trammel"), tmp_path / "a.rrd")
    assert "drive H at 0 mm" in text
    assert not re.search(r"at -?\d\S*e-1\d mm", text)


def test_odd_names_go_through_a_recording_and_back(tmp_path: Path):
    """Links, joints and points of any name: what a reader finds by the names of the model is the motion."""
    odd = ("ü", "a b", "a.b", "a:b", "b'", "日本", "a,b;c", "[0]", "{x}", "%41", "~", "$HOME", "*?", "(a|b)", "1.5")
    text = load("slider-crank-compressor").to_toml()
    names = [n for n in ("rod", "crank", "piston", "A", "B", "C") if re.search(rf"(?<![\w\"]){n}(?= =|\])", text)]
    for first in range(0, len(odd), len(names)):
        given = dict(zip(names, odd[first : first + len(names)], strict=False))
        there = text
        for old, name in given.items():
            quoted = json.dumps(name, ensure_ascii=False)
            there = re.sub(rf"(?<![\w\"]){old}(?= =|\])|\"{old}\"", lambda _, quoted=quoted: quoted, there)
        scene = loads(there)
        assert {*given.values()} <= {*scene.document.links, *scene.document.joints}
        run = run_scene(scene, frames=12)
        write_recording(run, tmp_path / "a.rrd")
        inspection = inspect(tmp_path / "a.rrd")
        assert {*given.values()} <= {*inspection.links, *(joint.name for joint in inspection.joints)}
        recording = Recording(tmp_path / "a.rrd")
        for link in scene.document.links:
            pose = recording.scalars("data", "links", link, "pose")[1]
            np.testing.assert_array_equal(pose[:, :2], run.motion.pose(link)[:, :2])
        assert loads(scene.to_toml()) == scene


# --- outputs and signals ----------------------------------------------------------------------------------------------


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("arguments", [["scenes"], ["check", "crank-rocker"]])
def test_a_full_output_is_a_message(arguments):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*COMMAND, *arguments], stdout=full, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT, timeout=PATIENCE
        )
    assert done.returncode == 1
    assert done.stderr == "the output cannot be written: no space left on device.\n"


@pytest.mark.parametrize("arguments", [["schema"]])
def test_a_reader_that_leaves_is_no_error(arguments):
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [*COMMAND, *arguments], stdout=write, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT, timeout=PATIENCE
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


def test_files_are_written_though_the_reader_of_the_words_has_left(tmp_path):
    read, write = os.pipe()
    os.close(read)
    words = [*COMMAND, "forces", "slider-crank-compressor", "--csv", "power.csv"]  # the words come before the file
    at_once = {**ENVIRONMENT, "PYTHONUNBUFFERED": "1"}
    done = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, text=True, env=at_once, cwd=tmp_path, timeout=PATIENCE)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "") and (tmp_path / "power.csv").stat().st_size > 500


@pytest.mark.parametrize("arguments", [["check", "crank-rocker"], ["check", "Kurbel ü"]])
def test_terminals_of_few_letters_get_all_that_they_can_show(arguments):
    done = subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, env={**ENVIRONMENT, "PYTHONIOENCODING": "ascii"}, timeout=PATIENCE
    )
    assert done.returncode == (2 if "Kurbel ü" in arguments else 0) and "Traceback" not in done.stderr
    assert {"crank-rocker": "3\\xb73 - 2\\xb74", "Kurbel ü": ""}[arguments[-1]] in done.stdout
    assert ("Kurbel \\xfc" in done.stderr) == ("Kurbel ü" in arguments)


SLOW_START = """
import sys, time
from importlib.abc import MetaPathFinder
class Wait(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            print("here", flush=True)
            try:
                time.sleep(60)
            except BaseException:  # as libraries do that try one thing after the other
                pass
sys.meta_path.insert(0, Wait())
from mechviz.__main__ import main
sys.argv = ["mechviz", *{arguments!r}, {path!r}]
main()
"""


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("module", "number", "code"),
    [
        ("typer", signal.SIGINT, 130),
        ("rerun", signal.SIGTERM, 143),
        ("trimesh", signal.SIGINT, 130),
        ("mechcore.numerics.newton", signal.SIGTERM, 143),
    ],
)
def test_a_signal_while_libraries_load_ends_the_command_with_a_message(tmp_path: Path, module, number, code):
    arguments = ["export", "crank-rocker", "--stl"] if module == "trimesh" else ["record", "crank-rocker", "-o"]
    script = SLOW_START.format(module=module, arguments=arguments, path=str(tmp_path / "x.rrd"))
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
    )
    assert process.stdout is not None and process.stdout.readline() == "here\n"
    process.send_signal(number)
    _, said = process.communicate(timeout=PATIENCE)
    assert (process.returncode, said.strip()) == (code, "Interrupted: nothing was written.")
    assert not list(tmp_path.iterdir())


def test_a_signal_while_frames_are_written_is_said_once(tmp_path: Path):
    number, code = signal.SIGINT, 130
    target = tmp_path / "x.rrd"
    process = subprocess.Popen(
        [*COMMAND, "record", "crank-rocker", "-n", "60000", "-o", str(target)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
    )
    while process.poll() is None and not any(entry.stat().st_size > 200_000 for entry in tmp_path.iterdir()):
        time.sleep(0.02)
    process.send_signal(number)
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == code
    assert said.lower().count("interrupted") == 1 and "Traceback" not in said
    assert not target.exists()


def test_a_folder_named_like_the_package_does_not_hide_it(tmp_path: Path):
    """A checkout in a folder named mechviz, and Python started in the folder above it."""
    for name in ("mechviz", "mechcore"):
        (tmp_path / name / "tests").mkdir(parents=True)
    code = "import mechcore, mechviz; print(len(mechviz.gallery()), mechcore.__file__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, timeout=PATIENCE)
    assert done.returncode == 0 and int(done.stdout.split()[0]) > 50, done.stderr


# --- what commands say first ------------------------------------------------------------------------------------------


def test_the_gallery_is_listed_by_topic_in_short_lines_and_searched_by_words():
    runner = CliRunner()
    lines = runner.invoke(app, ["scenes"]).stdout.splitlines()
    assert [line for line in lines if not line.startswith(" ")] == list(TOPICS)
    assert len(lines) == len(gallery()) + len(TOPICS) and max(map(len, lines)) <= 100
    parts = runner.invoke(app, ["scenes", "Slider", "friction", "--names"]).stdout.split()
    assert "slider-crank-friction" in parts and len(parts) < 10
    none = runner.invoke(app, ["scenes", "zeppelin"])
    assert none.exit_code == 2 and "no scene of the gallery is about zeppelin" in none.stderr


def test_an_unknown_scene_is_answered_by_the_nearest_three():
    said = CliRunner().invoke(app, ["check", "crank-roker"])
    assert said.exit_code == 2 and "Did you mean 'crank-rocker', '" in said.stderr and len(said.stderr) < 300
    said = CliRunner().invoke(app, ["check", "double_pendulum"])  # a part of a name
    assert "Did you mean 'swinging-double-pendulum'?" in said.stderr


def test_record_says_where_the_file_is_what_to_look_at_and_costs_when_asked(tmp_path: Path):
    path = tmp_path / "my engine.rrd"
    said = CliRunner().invoke(app, ["record", "slider-crank-engine", "-n", "40", "-o", str(path)])
    assert said.stdout == f"{path}\n" and f"mechviz view '{path}'" in said.stderr
    assert load("slider-crank-engine").learning_goal in said.stderr and "compile" not in said.stderr
    costs = CliRunner().invoke(app, ["record", "slider-crank-engine", "-n", "40", "-o", str(path), "--cost"]).stderr
    assert re.search(r"compile +\S+ ms", costs) and "loading rerun" in costs and "left out: effect gravity" in costs


def test_inspect_tells_peaks_of_the_motion_and_of_studies(tmp_path: Path):
    run = run_scene(load("shaking-engine"), frames=60)
    write_recording(run, tmp_path / "a.rrd")
    inspection = inspect(tmp_path / "a.rrd")
    motion = {peak.item: peak.value for peak in inspection.motion}
    rate = np.abs(run.motion.velocity("rod")[:, 2]).max()
    assert abs(motion["angular velocity rod"]) == pytest.approx(rate, rel=1e-12)
    studies = {peak.item: peak.value for peak in inspection.studies}
    assert studies["force shaking"] == pytest.approx(np.hypot(*run.studies.shaking.force.T).max(), rel=1e-12)
    assert studies["force shaking balanced"] < 0.5 * studies["force shaking"]
    assert "Peaks of the motion" in format_inspection(inspection) and "Peaks of the studies" in format_inspection(inspection)
    turned = run_scene(load("substitute-masses"), frames=60)  # forces along both axes
    write_recording(turned, tmp_path / "b.rrd")
    force = next(peak for peak in inspect(tmp_path / "b.rrd").studies if peak.item == "force link.substitutes")
    assert force.value == pytest.approx(np.hypot(*turned.studies.substitutes["link"].force.T).max(), rel=1e-12)
