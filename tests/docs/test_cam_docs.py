"""docs/cams.md: its commands run, its Python runs, its scenes exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

import mechviz
from mechviz.commands.main import app

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "cams.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", PAGE, flags=re.DOTALL)
COMMANDS = [line.split("  #")[0].strip() for language, text in BLOCKS if language == "bash" for line in text.splitlines()]


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_of_the_page_run(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    program, *arguments = shlex.split(command)
    assert program == "mechviz"
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == (1 if "limits are violated" in done.output else 0), done.output
    for name in re.findall(r"\b[\w-]+\.(?:svg|dxf|csv|3mf|glb)\b", command):
        assert (tmp_path / name).stat().st_size > 0


def test_the_python_of_the_page_runs(capsys):
    (code,) = [text for language, text in BLOCKS if language == "python"]
    names: dict = {}
    exec(code, names)
    base, rise, _ = map(float, capsys.readouterr().out.split())
    assert rise <= 30.0 + 1e-6 and 1e-3 * base == pytest.approx(names["least"].base)


def test_every_cam_scene_is_on_the_page_and_the_page_names_no_other():
    table = PAGE.split("## Which scene shows what")[1].split("## What is computed")[0]
    named: set[str] = set()
    for row in table.splitlines():
        last = ""
        for word in re.findall(r"`(-?[a-z][a-z-]*)`", row):
            last = word if not word.startswith("-") else last
            named.add(word if not word.startswith("-") else last + word)
    scenes = {entry.name for entry in mechviz.gallery()}
    assert named <= scenes
    assert {name for name in scenes if name.startswith("cam-")} <= named
