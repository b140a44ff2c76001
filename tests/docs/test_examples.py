"""examples/: every script runs, says something, and writes into the folder that it is given and nowhere else."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_an_example_runs(script, tmp_path, monkeypatch, capsys):
    folder, elsewhere = tmp_path / "given", tmp_path / "working"
    folder.mkdir()
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    monkeypatch.setattr("sys.argv", [str(script), str(folder)])
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out.strip()
    assert not list(elsewhere.iterdir())
    assert bool(list(folder.iterdir())) == ("sys.argv" in script.read_text(encoding="utf-8"))


def test_examples_are_numbered_short_and_explained():
    assert [int(script.name[:2]) for script in SCRIPTS] == list(range(1, len(SCRIPTS) + 1)) and len(SCRIPTS) >= 20
    for script in SCRIPTS:
        lines = script.read_text(encoding="utf-8").splitlines()
        assert lines[0].startswith('"""') and lines[0].endswith('."""') and len(lines) <= 45, script.name
