"""Where commands write: what cannot be written there is refused before anything is computed, and nothing is half written."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mechviz.commands.main import app
from mechviz.files import OutputError, output_error
from mechviz.scene.scene import dump, load

COMMANDS = {
    "record": ("record", "crank-rocker", "-o", "{}.rrd"),
    "forces": ("forces", "kinetostatic-four-bar", "--csv", "{}.csv"),
    "polar": ("forces", "shaking-engine", "--plot", "{}.svg"),
    "balance": ("balance", "shaking-four-bar", "-o", "{}.toml"),
    "vibrations": ("vibrations", "swinging-double-pendulum", "--csv", "{}.csv"),
    "csv": ("export", "crank-rocker", "--csv", "{}.csv"),
    "parquet": ("export", "crank-rocker", "--parquet", "{}.parquet"),
    "glb": ("export", "crank-rocker", "--glb", "{}.glb"),
    "3mf": ("export", "crank-rocker", "--3mf", "{}.3mf"),
    "dxf": ("export", "cam-roller", "--dxf", "{}.dxf"),
    "share": ("share", "crank-rocker", "-o", "{}.html"),
    "shot": ("shot", "crank-rocker", "-o", "{}.svg"),
    "accuracy": ("accuracy", "crank-rocker", "-o", "{}.svg"),
    "accuracy as a recording": ("accuracy", "crank-rocker", "--rrd", "{}.rrd"),
    "laws": ("laws", "--plot", "{}.svg"),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("fault", ["no folder", "a folder", "below a file"])
def test_what_cannot_be_written_there_is_refused_before_anything_is_computed(tmp_path: Path, monkeypatch, command, fault):
    """The same words and the same exit code everywhere, whatever the command would write."""
    monkeypatch.setattr("mechviz.commands.shared.solving.run_scene", lambda *_, **__: pytest.fail("it was computed"))
    monkeypatch.setattr("mechviz.commands.accuracy.ladder", lambda *_, **__: pytest.fail("it was measured"))
    (tmp_path / "file").write_text("kept")
    place = {"no folder": "nowhere/out", "a folder": "out", "below a file": "file/out"}[fault]
    words = {"no folder": "does not exist", "a folder": "is a folder", "below a file": "is not a folder"}[fault]
    arguments = [text.format(tmp_path / place) for text in COMMANDS[command]]
    if fault == "a folder":
        Path(arguments[-1]).mkdir()
    before = sorted(tmp_path.rglob("*"))
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2 and words in done.stderr and done.stdout == "", done.output
    assert sorted(tmp_path.rglob("*")) == before


def test_full_disks_are_not_the_fault_of_what_was_asked():
    assert [output_error(OSError(number, "full"), Path("x")).code for number in (28, 122, 27, 13)] == [1, 1, 1, 2]
    assert OutputError("no").code == 2


def test_scenes_are_not_written_over_devices_and_go_where_links_point(tmp_path: Path):
    with pytest.raises(OutputError, match="not a regular file"):
        dump(load("triad"), "/dev/null")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    (tmp_path / "link.toml").symlink_to(tmp_path / "real.toml")
    dump(load("triad"), tmp_path / "link.toml")
    assert (tmp_path / "link.toml").is_symlink() and load(tmp_path / "real.toml") == load("triad")


def test_diagrams_of_accuracy_and_curves_of_laws_are_written_whole_or_not_at_all(tmp_path: Path, monkeypatch):
    out = tmp_path / "laws.svg"
    out.write_text("old")
    monkeypatch.setattr("mechviz.files.put_in_place", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    done = CliRunner().invoke(app, ["laws", "cycloidal", "--plot", str(out)])
    assert done.exit_code == 1 and "the disk is full" in done.stderr
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("laws.svg", "old")]


def test_the_help_says_what_the_exit_codes_mean():
    text = " ".join(CliRunner().invoke(app, ["--help"]).stdout.split())
    assert "Exit codes: 0 done; 2 it cannot be done as it is asked for" in text and "130 and 143 interrupted" in text


def test_a_page_that_is_interrupted_on_its_way_leaves_nothing(tmp_path: Path, monkeypatch):
    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mechviz.commands.export.make_page", stopped)
    done = CliRunner().invoke(app, ["share", "crank-rocker", "-n", "12", "-o", str(tmp_path / "a.html")])
    assert (done.exit_code, done.stderr.strip()) == (130, "Interrupted: nothing was written.")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [name for name in COMMANDS if name not in ("balance", "laws")])
def test_nothing_is_written_over_what_it_is_made_from(tmp_path: Path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    name, gallery, *options, target = COMMANDS[command]
    scene = tmp_path / target.format("scene")  # whatever it is called
    scene.write_text(load(gallery).text, encoding="utf-8")
    before = scene.read_bytes()
    (tmp_path / target.format("link")).symlink_to(scene)
    for wanted in (scene.name, target.format("link")):
        done = CliRunner().invoke(app, [name, str(scene), *options, wanted])
        assert done.exit_code == 2 and ("is what this is made from" in done.stderr or scene.suffix == ".rrd"), done.output
    assert scene.read_bytes() == before


def test_two_things_are_not_written_into_one_file(tmp_path: Path):
    same = str(tmp_path / "out.parquet")
    done = CliRunner().invoke(app, ["export", "crank-rocker", "--csv", same, "--parquet", same])
    assert done.exit_code == 2 and "wanted for two things" in done.stderr and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["balance", "shaking-four-bar", "--radius", "nan"], "--radius: nan is not a finite number"),
        (["export", "crank-rocker", "--csv", "x.csv", "--every", "inf"], "--every: inf is not a finite number"),
        (["record", "crank-rocker", "--frames", "1"], "greater than or equal to 2"),
        (["share", "crank-rocker", "--cycles", "100001"], "less than or equal to 100000"),
    ],
)
def test_options_are_refused_by_their_names(tmp_path: Path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2 and words in done.stderr and not list(tmp_path.iterdir()), done.output
