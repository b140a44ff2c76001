"""README, CONTRIBUTING and the guides: paths that they name exist, the tree is that of the checkout, commands and Python run."""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

import mechviz as mv
from mechviz.commands.main import app

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
FOLDERS = ("core/", "mechviz/", "docs/", "tests/", "examples/", "benchmarks/")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_paths_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    named = {name for name in re.findall(r"`([\w./-]+)`", text) if name.startswith(FOLDERS)}
    linked = {name.partition("#")[0] for name in re.findall(r"\]\(([^)]+)\)", text) if not name.startswith(("http", "#"))}
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []
    assert [name for name in sorted(linked) if not (page.parent / name).exists()] == []


def test_the_tree_of_contributing_is_that_of_the_checkout():
    tree = re.search(r"## The house\n\n```\n(.*?)```", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.DOTALL)[1]
    for package, until in (("core/mechcore", r"\nmechviz/"), ("mechviz", r"\nexamples/")):
        part = re.split(until, tree[tree.index(f"{package}/") + len(package) + 1 :])[0]
        heads = [row[2:] for row in part.splitlines()[1:] if re.match(r"  \S", row)]
        named = {name for row in heads for name in re.findall(r"(?:^|  )(\w+)/", row)}
        result = {each.name for each in (ROOT / package).iterdir() if each.is_dir() and not each.name.startswith("_")}
        assert named == result, package


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def commands(page: str) -> list[str]:
    rows = [re.split(r"\s#", row)[0].strip() for text in blocks(page, "bash") for row in text.splitlines()]
    return [row.replace(".venv/bin/", "") for row in rows if row.startswith(("mechviz ", ".venv/bin/mechviz "))]


WAITING = ("mechviz view ",)  # until Ctrl-C
GUIDES = ("README.md", "docs/first-steps.md", "docs/outputs.md")


@pytest.mark.parametrize("page", GUIDES)
def test_commands_of_a_guide_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for command in commands(page):
        if command.startswith(WAITING):
            continue
        for part in command.split(" && "):
            words, _, target = part.partition(" > ")
            arguments = shlex.split(words)[1:]
            frames = ["--frames", "24"] if arguments[0] in ("record", "share", "export") and "--frames" not in arguments else []
            done = CliRunner().invoke(app, [*arguments, *frames])
            assert done.exit_code == 0, f"{part}: {done.output}"
            if target:
                Path(target).write_text(done.stdout, encoding="utf-8")
        for name in re.findall(r"\b[\w-]+\.(?:svg|dxf|csv|3mf|glb|rrd|html|toml)\b", command):
            assert (tmp_path / name).stat().st_size > 0


@pytest.mark.parametrize("page", GUIDES[:2])
def test_the_python_of_a_guide_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for code in blocks(page, "python"):
        exec(code.replace("frames=720", "frames=24"), names)
    assert len(names["run"].time) == 25


def test_the_scene_of_the_readme_is_valid():
    (text,) = blocks("README.md", "toml")
    assert mv.loads(text).title == "Crank-rocker with a traced coupler point"


def test_the_readme_is_two_screens_and_holds_the_two_commands():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 95
    for marker in ("first", "test"):
        assert re.search(rf"<!-- {marker} command -->\n```bash\npython3 -m venv .*\n```", text)


def test_every_guide_is_in_the_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert set(re.findall(r": ([\w-]+\.md)", navigation)) == {page.name for page in (ROOT / "docs").glob("*.md")}


@pytest.mark.parametrize("name", ["equations.png", "least-cams.svg"])
def test_charts_of_the_guides_can_be_made_again(name, tmp_path):
    charts = runpy.run_path(str(ROOT / "docs" / "make_charts.py"))["CHARTS"]
    shown = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert [each for each in charts if f"(images/{each})" not in shown] == []
    charts[name](tmp_path / name)
    assert (tmp_path / name).stat().st_size > 10_000
