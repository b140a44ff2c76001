"""What commands say where the program fails, where numbers are none, and where results cannot be trusted."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

import mechviz
from mechcore.errors import MechanismError
from mechviz.accuracy.estimate import check_finite, doubts
from mechviz.commands import recording
from mechviz.commands.main import main
from mechviz.runs import run_scene
from mechviz.scene.faults import SceneError
from mechviz.scene.scene import loads

FOUR_BAR = """
units = {{ length = "mm", angle = "deg" }}
effects = ["inertia", "gravity"]
[links]
frame = {{ points = {{ A = [0, 0], D = [100, 0] }} }}
crank = {{ points = {{ A = [0, 0], B = [30, 0] }}, mass = "1 kg", centre = [{centre}, 0], inertia = "1e-3 kg m^2" }}
coupler = {{ points = {{ B = [0, 0], C = [90, 0] }}, mass = "1 kg", centre = [45, 0], inertia = "1e-3 kg m^2" }}
rocker = {{ points = {{ C = [60, 0], D = [0, 0] }}, mass = "1 kg", centre = [30, 0], inertia = "1e-3 kg m^2" }}
[joints]
A = {{ revolute = ["frame", "crank"], drive = {{ speed = "60 rpm", start = {start} }} }}
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
    heavy.write_text(FOUR_BAR.format(centre="1e16", start="0"))
    code, text = said(monkeypatch, capsys, "record", str(heavy), "-o", str(target))
    assert code == 3 and "power balance" in text and "--keep" in text and not target.exists()
    code, text = said(monkeypatch, capsys, "record", str(heavy), "-o", str(target), "--keep")
    assert code == 0 and "power balance" in text and target.exists()


def test_sound_runs_raise_no_doubts():
    for name in ("kinetostatic-four-bar", "jamming-sleeve"):
        assert not doubts(run_scene(mechviz.load(name), frames=24), errors=True), name


def test_a_load_that_is_no_number_is_an_error_that_names_it():
    run = run_scene(mechviz.load("kinetostatic-four-bar"), frames=12)
    load = next(x for name, x in run.forces.loads.items() if "/" not in name)
    load.values[3, 0] = np.nan
    with pytest.raises(MechanismError, match=f"loads.{load.name}: its force is no finite number at 1 of 13 frames"):
        check_finite(run)


def test_a_pipe_or_a_device_is_no_scene(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    for path in (tmp_path / "pipe.toml", Path("/dev/zero")):
        with pytest.raises(SceneError, match="not a regular file"):
            mechviz.load(path)
