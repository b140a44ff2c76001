"""What commands say where the program fails, where numbers are none, and where results cannot be trusted."""

from __future__ import annotations

import csv
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import mechviz
from mechcore import simulate
from mechcore.errors import MechanismError
from mechcore.forces.powers import flywheel
from mechcore.motion import events
from mechcore.motion.events import find_events
from mechviz.accuracy.estimate import accuracy_warnings, check_finite
from mechviz.commands import recording
from mechviz.commands.main import app, main
from mechviz.outputs.exports.code import code_of
from mechviz.outputs.viewer.app import Viewer
from mechviz.picture.build import solids_of
from mechviz.runs import run_scene
from mechviz.scene import limits
from mechviz.scene.faults import SceneError
from mechviz.scene.scene import Scene, loads

FOUR_BAR = """
units = {{ length = "mm", angle = "deg" }}
effects = ["inertia", "gravity"]
[links]
frame = {{ points = {{ A = [0, 0], D = [100, 0] }} }}
crank = {{ points = {{ A = [0, 0], B = [30, 0] }}, mass = "1 kg", centre = [{centre}, 0], inertia = "1e-3 kg m^2" }}
coupler = {{ points = {{ B = [0, 0], C = [90, 0] }}, mass = "1 kg", centre = [45, 0], inertia = "1e-3 kg m^2" }}
rocker = {{ points = {{ C = [60, 0], D = [0, 0] }}, mass = "1 kg", centre = [30, 0], inertia = "1e-3 kg m^2" }}
[joints]
A = {{ revolute = ["frame", "crank"], drive = {{ speed = "600 rpm", start = {start} }} }}
B = {{ revolute = ["crank", "coupler"] }}
C = {{ revolute = ["coupler", "rocker"], side = "left" }}
D = {{ revolute = ["frame", "rocker"] }}
[run]
frames = 24
"""


def said(monkeypatch, capsys, *words: str) -> tuple[int, str]:
    """Exit code and messages of a command, run in this process."""
    monkeypatch.setattr(sys, "argv", ["mechviz", *words])
    with pytest.raises(SystemExit) as end:
        main()
    return int(end.value.code or 0), capsys.readouterr().err


def test_a_fault_of_ours_is_a_message_with_a_code_of_its_own(monkeypatch, capsys, tmp_path):
    def broken(*_args, **_kwargs):
        raise IndexError("list index out of range")

    monkeypatch.setattr(recording, "solve", broken)
    words = ("record", "crank-rocker", "-o", str(tmp_path / "a.rrd"))
    code, text = said(monkeypatch, capsys, *words)
    assert code == 70 and "IndexError" in text and "report" in text and "Traceback" not in text
    code, text = said(monkeypatch, capsys, *words, "--traceback")
    assert code == 70 and "Traceback" in text and "in broken" in text
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("forces", "kinetostatic-four-bar", "--flywheel", "inf"), "--flywheel"),
        (("effects", "crank-rocker", "--accuracy", "nan"), "--accuracy"),
        (("vibrations", "engine-mounts", "--amplitude", "inf"), "--amplitude"),
        (("laws", "parabolic:skew=inf"), "parabolic.skew"),
    ],
)
def test_options_refuse_what_is_no_finite_number_by_name(monkeypatch, capsys, words, name):
    code, text = said(monkeypatch, capsys, *words)
    assert code == 2 and name in text and "not a finite number" in text


def test_a_start_of_too_many_turns_is_refused():
    with pytest.raises(MechanismError, match="turns") as error:
        loads(FOUR_BAR.format(centre="15", start="1e15"))
    assert error.value.faults[0].path == "joints.A.drive.start" and error.value.faults[0].remedy


def test_results_that_do_not_balance_are_not_written_unless_they_are_to_be_kept(monkeypatch, capsys, tmp_path):
    """The crank has its centre of mass so far away that its balance is nothing but rounding."""
    heavy, target = tmp_path / "heavy.toml", tmp_path / "a.rrd"
    heavy.write_text(FOUR_BAR.format(centre="9e14", start="0"))
    code, text = said(monkeypatch, capsys, "record", str(heavy), "-o", str(target))
    assert code == 3 and "power balance" in text and "--keep" in text and not target.exists()
    code, text = said(monkeypatch, capsys, "record", str(heavy), "-o", str(target), "--keep")
    assert code == 0 and "power balance" in text and target.exists()


def test_the_viewer_says_why_a_run_cannot_be_trusted():
    with Viewer(run_scene(loads(FOUR_BAR.format(centre="9e14", start="0"))), port=0) as viewer:
        assert viewer.session.wait()
        assert "Not to be trusted: the powers supplied and absorbed do not balance" in viewer.timeline.strip.content
        viewer.session.change("centre", lambda draft: draft.with_value(("links", "crank", "centre"), [15, 0]))
        assert viewer.session.wait(until_idle=True)
        assert "Not to be trusted" not in viewer.timeline.strip.content, viewer.session.status


def changed(name: str, *changes: tuple[tuple[str | int, ...], object], frames: int = 8) -> Scene:
    """A scene of the gallery with other values at some places."""
    return mechviz.load(name).changed({("run", "frames"): frames, **dict(changes)})


def test_rates_at_a_singular_position_are_not_determined_and_raise_no_warning():
    """The ground joint on the crank's: the dyad is flat at the start, where its links turn at any speed."""
    motion = run_scene(changed("four-bar-chain", (("links", "frame", "points", "A2"), [0, 0]))).motion
    rates = [motion.velocity(link) for link in motion.model.links]
    assert any(np.isnan(r).any() for r in rates) and not any(np.isinf(r).any() for r in rates)


def test_a_run_of_any_length_ends_at_its_stop():
    """The cycles of a drive that nothing moves are counted, however many: 1e29 of them are no integer."""
    ends = [run_scene(changed("toggle-press-stop", (("run", "duration"), d))).motion.pose("ram")[-1] for d in ("2 s", 1e29)]
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.0, atol=1e-9)


def test_a_run_that_blurs_the_cycle_of_a_drive_is_refused():
    """The other drive of the five-bar has cycles of 1.2 s: looking for change points in them took 5 GB."""
    with pytest.raises(MechanismError, match=r"8\.33e\+28 cycles of the drive of E, of 1\.2 s each") as error:
        run_scene(changed("five-bar", (("joints", "A", "drive", "segments", 1, "duration"), 1e29)))
    assert error.value.faults[0].path == "run.cycles" and error.value.faults[0].remedy


def test_a_link_beside_which_the_others_vanish_is_refused_by_name():
    run = run_scene(changed("contour-lever", (("links", "slider", "points", "D"), [1e29, 0])))
    with pytest.raises(MechanismError, match=r"links\.slider: the solids cannot be made") as error:
        solids_of(run)
    assert error.value.faults[0].remedy


def test_zone_boundaries_of_a_drive_are_counted_where_they_are_too_many(monkeypatch):
    """A drive whose law repeats once in a run has no more boundaries than one."""
    motion = run_scene(changed("crank-rocker")).motion
    assert not [e for e in find_events(motion) if "too many to list" in e.text]
    monkeypatch.setattr(events, "MOST_BOUNDARIES", 1)
    (told,) = [e for e in find_events(motion) if "too many to list" in e.text]
    assert told.item == motion.mechanism.drives[0].joint


def test_what_is_too_large_is_refused_with_its_number_unless_it_is_wanted(monkeypatch, capsys, tmp_path):
    links = "".join(f"l{k} = {{ points = {{ A = [0, 0] }} }}\n" for k in range(30))
    text = FOUR_BAR.format(centre="15", start="0").replace("[joints]", links + "[joints]")
    monkeypatch.setattr(limits, "MOST_ITEMS", 30)
    with pytest.raises(SceneError, match=r"38 links, joints and loads; up to 30 are taken\.[\s\S]*--large"):
        loads(text)
    monkeypatch.setattr(limits, "MOST_KEYS", 20)
    with pytest.raises(SceneError, match=r"keys; up to 20 are read"):
        loads(text)
    monkeypatch.setattr(limits, "MOST_KEYS", 200)
    monkeypatch.setattr(limits, "MOST_POSES", 1000)
    monkeypatch.setattr(limits, "MOST_DRAWN", 2)
    words = ("record", "crank-rocker", "-o", str(tmp_path / "a.rrd"), "--frames")
    code, said_of_it = said(monkeypatch, capsys, *words, "300")
    assert code == 2 and "1,200 poses" in said_of_it and "up to 250 frames" in said_of_it and "--large" in said_of_it
    code, said_of_it = said(monkeypatch, capsys, *words, "30")
    assert code == 2 and "4 links; solids are laid out for up to 2" in said_of_it
    monkeypatch.setenv(limits.LARGE_VARIABLE, "")
    assert said(monkeypatch, capsys, *words, "300", "--large")[0] == 0
    monkeypatch.setenv(limits.LARGE_VARIABLE, "1")
    with pytest.raises(SceneError, match="no chain of joints joins it"):
        loads(text)  # it is read, and what is wrong with it is told


def test_a_motion_of_very_many_windows_is_told_once_while_it_begins(monkeypatch):
    """Under a gravity of 100 million g a pendulum swings 10,000 times as fast, so that it takes as many more windows."""
    heavy = changed("swinging-double-pendulum", (("gravity",), [0.0, -1e9]), (("run", "duration"), "3 ms"))
    monkeypatch.setattr(sys.modules["mechcore.dynamics.simulate"], "MANY_WINDOWS", 500)
    told: list[str] = []
    run_scene(heavy, warn=told.append)
    (words,) = [text for text in told if "windows" in text]
    assert "100 windows led to" in words
    told.clear()
    run = run_scene(changed("swinging-double-pendulum"), warn=told.append)
    assert not told and run.resimulate is not None
    monkeypatch.setattr(sys.modules["mechcore.dynamics.simulate"], "QUIET_SECONDS", -1.0)
    for tolerance in (1e-11, 1e-12):  # as an error estimate asks for, which may take much longer than the run itself
        run.resimulate(tolerance)
    (words,) = told
    assert "it goes on for about" in words


def test_an_exponent_that_no_gas_has_is_refused():
    """Its powers overflow: energies were infinite, with a warning of numpy's."""
    with pytest.raises(MechanismError, match=r"loads\.strut\.exponent *1e\+29 is no polytropic exponent"):
        changed("tailgate", (("loads", "strut", "exponent"), 1e29))


def test_a_motion_of_more_windows_than_memory_holds_is_refused(monkeypatch):
    """Carts that swing for 1e29 s: the windows of their motion fill memory."""
    monkeypatch.setattr(sys.modules["mechcore.dynamics.simulate"], "MOST_WINDOWS", 200)
    with pytest.raises(MechanismError, match=r"200 windows of the integration led to .* s of 1e\+29 s") as error:
        run_scene(changed("coupled-carts", (("run", "duration"), 1e29)), warn=lambda _: None)
    assert error.value.faults[0].path == "run.duration" and "Give at most" in error.value.faults[0].remedy


SPUN_UP = """
effects = ["inertia"]
run = { duration = "1e6 s", frames = 24 }
[links]
frame = { points = { A = [0, 0] } }
rotor = { points = { A = [0, 0] }, mass = "1 kg", centre = [0, 0], inertia = "1 kg m^2" }
[joints]
A = { revolute = ["frame", "rotor"], free = { position = 10 } }
[loads]
motor = { torque = "1 N m", on = "rotor" }
"""


@pytest.mark.thorough
def test_a_rotor_that_gains_speed_for_ever_is_followed_over_so_many_turns():
    """At 1 rad/s^2 it has made 50,000 turns after sqrt(2 x 50,000 x 2 pi) s = 792.7 s."""
    with pytest.raises(MechanismError, match=r"after 79[23].* s of 1e\+06 s it has made 50,000 turns") as error:
        run_scene(loads(SPUN_UP, "spun up"))
    assert error.value.faults[0].path == "run.duration" and "Give at most 79" in error.value.faults[0].remedy


def test_a_motion_whose_windows_become_short_is_told_from_its_last_seconds(monkeypatch):
    """Ten seconds in, the average promises an end in three more: a rod of a million kilometres went on for 17 without a word."""
    mechanism, last, clock = changed("swinging-double-pendulum").mechanism, 0.0, 0.0

    def process_time() -> float:
        nonlocal clock
        clock += 1e-3 if last < 15.0 else 0.2
        return clock

    def look(until: float) -> None:
        nonlocal last
        last = until

    monkeypatch.setattr(sys.modules["mechcore.dynamics.simulate"], "time", SimpleNamespace(process_time=process_time))
    told: list[str] = []
    simulate(mechanism, 20.0, warn=told.append, progress=look)
    assert [words.partition(" of work")[0] for words in told] == ["10 s"]


def test_sound_runs_raise_no_doubts():
    for name in ("kinetostatic-four-bar", "jamming-sleeve"):
        assert not accuracy_warnings(run_scene(mechviz.load(name), frames=24), errors=True), name


def test_a_load_that_is_no_number_is_an_error_that_names_it():
    run = run_scene(mechviz.load("kinetostatic-four-bar"), frames=12)
    load = next(x for name, x in run.forces.loads.items() if "/" not in name)
    values = load.values
    values[3, 0] = np.nan
    run.forces.loads[load.name] = replace(load, rows=lambda: values)
    with pytest.raises(MechanismError, match=f"loads.{load.name}: its force is no finite number at 1 of 13 frames"):
        check_finite(run)


def test_links_that_lead_nowhere_are_called_that(monkeypatch, capsys, tmp_path):
    for name, there in (("a.rrd", "nowhere/a.rrd"), ("a.toml", "nowhere.toml")):
        (tmp_path / name).symlink_to(tmp_path / there)
    code, text = said(monkeypatch, capsys, "record", "crank-rocker", "-o", str(tmp_path / "a.rrd"))
    assert code == 2 and "is a link to" in text and "nowhere/a.rrd', whose folder does not exist" in text
    code, text = said(monkeypatch, capsys, "check", str(tmp_path / "a.toml"))
    assert code == 2 and "is a link to" in text and "does not exist" in " ".join(text.split())


def test_a_pipe_or_a_device_is_no_scene(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    for path in (tmp_path / "pipe.toml", Path("/dev/zero")):
        with pytest.raises(SceneError, match="not a regular file"):
            mechviz.load(path)


def test_forces_of_motions_under_forces_are_a_table_of_powers(tmp_path):
    """Not the reactions of a structure; what such a run does not have is refused in words."""

    def printed(*words: str) -> tuple[int, str]:
        done = CliRunner().invoke(app, ["forces", *words])
        return done.exit_code, done.stdout + done.stderr

    code, text = printed("crusher-steady", "-n", "48")
    assert code == 0 and "motor" in text and "absorbed" in text and "reactions, of each joint" not in text
    code, text = printed("crusher-steady", "-n", "48", "--flywheel", "0.03")
    assert code == 2 and "--steady TURNS" in text
    code, text = printed("swinging-double-pendulum", "--plot", str(tmp_path / "x.svg"))
    assert code == 2 and "forces decide the motion" in text
    code, text = printed("crank-rocker", "--equations", "--csv", str(tmp_path / "x.csv"))
    assert code == 2 and "--csv" in text
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("record", "crank-rocker", "-o", "run.csv"), "does not end in .rrd"),
        (("share", "crank-rocker", "-o", "run.rrd"), "does not end in .html"),
        (("balance", "crank-rocker", "--radius", "60mm", "-o", "b.png"), "does not end in .toml"),
        (("export", "crank-rocker", "--glb", "run.stl"), "does not end in .glb"),
        (("export", "crank-rocker", "--thickness", "4 mm", "--csv", "run.csv"), "--kit"),
        (("export", "crank-rocker", "--every", "1 ms", "--glb", "run.glb"), "--csv or --parquet"),
        (("sweep", "parametric-press", "--vary", "stroke=60mm,70mm", "--of", "drive.A.torque:max", "--seed", "3"), "--sample"),
        (("vibrations", "swinging-double-pendulum", "--amplitude", "0.2"), "--mode"),
        (("balance", "slider-crank-compressor", "--radius", "60mm", "--rocker-radius", "4mm"), "no rocker"),
    ],
)
def test_what_an_option_or_a_name_would_not_do_is_refused(monkeypatch, tmp_path, words, why):
    """A file whose name says another kind of file, and options that belong to what is not asked for."""
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2 and why in done.stderr
    assert not list(tmp_path.iterdir())


def test_counterweights_are_in_the_units_of_the_scene(tmp_path):
    done = CliRunner().invoke(app, ["balance", "crank-rocker", "--radius", "60mm", "-o", str(tmp_path / "b.toml")])
    assert "0.75 kg at (-60, 0) mm of its frame" in done.stdout
    assert "{ mass = 0.75, at = [-60, 0] }" in (tmp_path / "b.toml").read_text()


def test_titles_of_a_program_in_c_are_as_many_as_its_columns():
    """Names may have commas."""
    comma = "rod, long"
    text = FOUR_BAR.format(centre=15, start='"20 deg"').replace("coupler", f'"{comma}"').replace(f'""{comma}""', f'"{comma}"')
    text = code_of(loads(text), "bar")[0]
    columns = int(text.split("#define COLUMNS ")[1].split()[0])
    (titles,) = csv.reader([json.loads(text.split("fputs(")[1].split(", stdout);")[0])])
    assert len(titles) == columns + 1 and titles[0] == "A [rad]" and f"{comma} x [m]" in titles


def test_a_drive_between_moving_links_has_no_flywheel():
    arm = loads(
        """
effects = ["inertia"]
[links]
frame = { points = { A = [0, 0] } }
first = { points = { A = [0, 0], B = [0.1, 0] }, mass = "1 kg", centre = [0.05, 0], inertia = "1e-3 kg m^2" }
second = { points = { B = [0, 0] }, mass = "1 kg", centre = [0.05, 0], inertia = "1e-3 kg m^2" }
[joints]
A = { revolute = ["frame", "first"], drive = { speed = 0 } }
B = { revolute = ["first", "second"], drive = { speed = "60 rpm" } }
"""
    )
    forces = run_scene(arm, frames=24).forces
    with pytest.raises(MechanismError, match="two moving links"):
        flywheel(forces, 0.02, "B")
