"""The executor on the command line: what the plan says of it, what is refused, and that results are the same."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import mechviz as mv
from mechcore.compiled import toolchain
from mechcore.compiled.toolchain import compiler
from mechcore.errors import Fault, MechanismError
from mechcore.motion import design_program
from mechviz.commands.main import app

has_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def said(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.output


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setattr(toolchain, "find_spec", lambda _: None)
    compiler.cache_clear()
    yield
    monkeypatch.undo()
    compiler.cache_clear()


@has_compiler
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("crank-rocker",), "positions and rates  numpy: 361 frames; compiling"),
        (("crank-rocker", "--executor", "c"), "positions and rates  C, "),
        (("triad", "--executor", "c"), "positions and rates  C, "),
        (("swinging-double-pendulum",), "motion under forces  numpy; C where more than 250 windows are left"),
        (("stick-slip-feed", "--executor", "c"), "; numpy where friction jams"),
        (("valve-float", "--executor", "c"), "motion under forces  numpy: no coordinate is free until a follower leaves its cam"),
        (("toggle-press-stop", "--executor", "c"), "; another program while a stop holds"),
        (("crank-rocker", "--executor", "numpy"), "numpy, as asked for"),
        (("slider-crank-compressor", "--executor", "c"), "reactions, efforts   C, "),
        (("screw-jack", "--executor", "c"), "; numpy where friction jams, or turns a flank"),
        (("slider-crank-compressor",), "reactions, efforts   numpy, as the positions"),
    ],
)
def test_the_plan_names_the_executor(arguments, words):
    code, text = said("plan", *arguments)
    assert code == 0 and words in text


def test_without_a_compiler_c_is_refused(no_compiler, tmp_path):
    target = tmp_path / "a.rrd"
    code, text = said("record", "crank-rocker", "--executor", "c", "-o", str(target))
    assert code == 2 and "there is no C compiler" in text and "pip install 'mechviz[fast]'" in text
    assert not target.exists()
    assert "numpy: there is no C compiler" in said("plan", "crank-rocker")[1]


@has_compiler
def test_what_numpy_has_to_do_is_noted(tmp_path):
    code, text = said("export", "cam-barrel-arm", "--executor", "c", "-n", "12", "--csv", str(tmp_path / "a.csv"))
    assert code == 0 and "note: numpy runs reactions and efforts: the cam of K touches its roller in space." in text


@has_compiler
def test_designs_say_what_computed_them():
    ask = ("sweep", "parametric-press", "--vary", "ratio=3..5:3", "--of", "drive.A.torque:peak", "-n", "12", "--executor")
    (_, by_numpy), (code, by_c) = (said(*ask, executor) for executor in ("numpy", "c"))
    assert code == 0 and "Computed by C, " in by_c and "Computed by numpy, many designs at once." in by_numpy
    rows = [
        [float(x) for line in text.splitlines() if line[0].isdigit() and "," in line for x in line.split(",")[:2]]
        for text in (by_numpy, by_c)
    ]
    np.testing.assert_allclose(*rows, rtol=1e-13)
    assert "12 frames" not in by_c and "compiling pays" in said(*ask, "auto")[1]


@has_compiler
def test_results_are_the_same():
    by_numpy, by_c = (mv.run("swinging-double-pendulum", frames=40, executor=e) for e in ("numpy", "c"))
    for key in by_numpy:
        a, b = by_numpy[key], by_c[key]
        assert np.abs(a - b).max() <= 1e-6 * max(np.abs(a).max(), 1e-6), key  # two bars that fall free are chaotic


@has_compiler
def test_designs_with_friction_say_that_compiling_fails(tmp_path, monkeypatch):
    """They were run one by one instead, without a word."""
    text = mv.load("slider-crank-friction").text.replace("[50, 0]", '["r", 0]')
    scene = tmp_path / "rubbing.toml"
    scene.write_text(text.replace("[links]", '[parameters]\nr = "50 mm"\n\n[links]'))
    ask = ("sweep", str(scene), "--vary", "r=40..60mm:3", "--of", "drive.O.torque:peak", "-n", "12", "--executor", "c")

    def fails(_):
        raise MechanismError(Fault("executor", "the C compiler fails: no space left.", "Choose the executor numpy."))

    monkeypatch.setattr(design_program, "library", fails)
    code, text = said(*ask)
    assert code == 2 and "the C compiler fails: no space left." in text
