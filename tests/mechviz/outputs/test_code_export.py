"""Programs in C that are exported: compiled as strictly as can be, they print what a run has."""

from __future__ import annotations

import csv
import io
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import mechviz as mv
from mechcore.compiled.toolchain import compiler
from mechviz.commands.main import app
from mechviz.outputs.exports.code import code_of


def exported(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["export", *arguments])
    return result.exit_code, result.output


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("scene", ["slider-crank-compressor", "planetary-gear", "cam-oscillating-roller"])
def test_a_program_prints_what_a_run_has(tmp_path: Path, scene: str) -> None:
    code, said = exported(scene, "--c", str(tmp_path / "own.c"))
    assert code == 0 and "note:" not in said
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]
    subprocess.run([*compiler(), *strict, str(tmp_path / "own.c"), "-o", str(tmp_path / "own"), "-lm"], check=True)
    run = mv.run(scene, frames=24, cycles=1)
    drive = run.motion.mechanism.drives[0].joint
    positions, speeds, _ = run.motion.drives[0]
    asked = [repr(float(positions[0])), repr(float(positions[-1])), "25", repr(float(speeds[0]))]
    printed = subprocess.run([str(tmp_path / "own"), *asked], capture_output=True, text=True, check=True).stdout
    head, *rows = csv.reader(io.StringIO(printed))
    assert head[0] == f"{drive} [rad]"
    computed = dict(zip(head, np.array(rows, float).T, strict=True))
    for link in run.motion.model.links[1:]:
        wanted = {"x [m]": run.motion.pose(link)[:, 0], "y [m]": run.motion.pose(link)[:, 1]}
        wanted |= {"angular_velocity [rad/s]": run.motion.velocity(link)[:, 2]}
        wanted |= {"x_acceleration [m/s^2]": run.motion.acceleration(link)[:, 0]}
        for name, values in wanted.items():
            np.testing.assert_allclose(computed[f"{link} {name}"], values, rtol=1e-11, atol=1e-11 * max(np.abs(values).max(), 1.0))
        turned = computed[f"{link} angle [rad]"] - run.motion.pose(link)[:, 2]
        np.testing.assert_allclose(np.sin(turned), 0.0, atol=1e-11)
    if run.forces is not None:
        effort = run.forces.effort(drive)
        np.testing.assert_allclose(computed[f"{drive} effort [N m]"], effort, atol=1e-11 * np.abs(effort).max())


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        ("triad", "the group of P is solved by Newton's method"),
        ("parallelogram", "its assembly modes meet at change points"),
        ("swinging-double-pendulum", "forces decide its motion"),
    ],
)
def test_what_c_does_not_have_is_refused(tmp_path: Path, scene: str, words: str) -> None:
    code, said = exported(scene, "--c", str(tmp_path / "own.c"))
    assert code == 2 and words in " ".join(said.split()) and not list(tmp_path.iterdir())


def test_efforts_that_are_missing_are_noted(tmp_path: Path) -> None:
    code, said = exported("slider-crank-friction", "--c", str(tmp_path / "own.c"))
    assert code == 0 and "note: efforts of drives are not in" in said and "dry friction depends on the reactions" in said


def test_efforts_against_a_gas_are_missing_in_words_of_the_scene(tmp_path: Path) -> None:
    """Whether the piston keeps to its stroke is checked over the frames of a run."""
    code, said = exported("compressor-cycle", "--c", str(tmp_path / "own.c"))
    assert code == 0 and "the range that air must not leave is checked over a whole run" in " ".join(said.split())


@pytest.mark.parametrize("signal", ['sine = { frequency = "3 Hz" }', 'polynomial = { of = "time", coefficients = [1, 2] }'])
def test_a_load_over_time_is_noted(tmp_path: Path, signal: str) -> None:
    scene = tmp_path / "timed.toml"
    text = mv.load("crank-rocker").text
    scene.write_text(f'{text}\n[loads]\nf = {{ force = ["40 N", 0], on = "rocker", at = "C", {signal} }}\n')
    code, said = exported(str(scene), "--c", str(tmp_path / "own.c"))
    assert code == 0 and "note: efforts of drives are not in" in said and "loads depend: f" in " ".join(said.split())
    assert '"A effort"' not in (tmp_path / "own.c").read_text()


def test_no_title_ends_the_comment() -> None:
    for title in ("A **// b", "A /* b */ c", "*/*/"):
        text, _ = code_of(mv.load("crank-rocker").changed({("title",): title}), "own")
        assert text.count("*/") == text.count("/*") == code_of(mv.load("crank-rocker"), "own")[0].count("*/")


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_names_are_printed_as_they_are_by_the_command_in_the_comment(tmp_path: Path) -> None:
    """In C99 ??( stands for a bracket; a name of a file with a space is quoted."""
    scene = mv.loads(
        mv.load("crank-rocker").text.replace('"coupler"', "'odd ??( ??! link'").replace("coupler =", "'odd ??( ??! link' =")
    )
    text, _ = code_of(scene, "my crank")
    (tmp_path / "my crank.c").write_text(text, encoding="utf-8")
    command = text.split("makes a program of it: cc ")[1].split("\n")[0]
    assert command == "-O2 'my crank.c' -o './my crank' -lm"
    subprocess.run([*compiler(), "-std=c99", *shlex.split(command)], check=True, cwd=tmp_path)
    printed = subprocess.run([str(tmp_path / "my crank")], capture_output=True, text=True, check=True).stdout
    assert "odd ??( ??! link x [m]" in printed.splitlines()[0].split(",")
