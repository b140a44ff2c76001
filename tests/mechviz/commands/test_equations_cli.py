"""``mechviz forces --equations``: text and LaTeX of the equilibrium equations at a moment."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

from mechviz.commands.main import app
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene
from recordings import gallery_scene


def said(*arguments):
    return CliRunner().invoke(app, ["forces", *arguments])


def test_equations_at_an_angle_are_solved_there():
    """The driving torque of the reference at 60 deg, though no frame of 7 is there."""
    few, many = (said("kinetostatic-four-bar", "--equations", "--at", "50 deg", "-n", n).stdout for n in ("7", "360"))
    torque = [re.search(r"T_A = (\S+) N m", text)[1] for text in (few, many)]
    assert float(torque[0]) == pytest.approx(float(torque[1]), rel=1e-5)
    assert "sum M_D" in few and "group 1: class II RRR: coupler, rocker" in few
    at_once = re.search(r"all 9 equations at once, without groups, for 9 unknowns: the same values, to (\S+) of", few)
    assert float(at_once[1]) < 1e-12
    assert "load F_i crank: Fx 8, Fy 13.8564, moment 0\n" in said("kinetostatic-four-bar", "--equations", "--at", "60 deg").stdout
    assert "at 0.02 s" in said("kinetostatic-four-bar", "--equations", "--at", "20 ms").stdout


def test_a_drive_that_begins_by_delivering_does_so_from_zero_on():
    """Not from the rounding of its power at the dead point."""
    assert "drive A delivers power from 0 to 0.004282 s" in said("connecting-rod-bending").stdout


def test_latex_is_mathematics():
    from matplotlib.mathtext import MathTextParser

    text = said("connecting-rod-bending", "--equations", "--at", "30", "--latex").stdout
    rows = [line for line in text.splitlines() if re.search(r"&= \S", line)]
    assert sum(r"\sum" in row for row in rows) == 9
    assert all(text.count(rf"\begin{{{name}}}") == text.count(rf"\end{{{name}}}") == 2 for name in ("align*", "alignat*"))
    for row in rows:
        assert row.count("&") <= 6, "values in a row that fit on a page"
        plain = row.removesuffix(r" \\").replace("&", "").replace(r"\textstyle", "").replace(r"\text", r"\mathrm")
        MathTextParser("path").parse(f"${plain}$")
    for line in text.splitlines():
        assert line.count("{") == line.count("}")


def test_a_scene_that_asks_for_force_polygons_has_its_equations_in_the_notes(tmp_path):
    scene = gallery_scene("kinetostatic-four-bar")
    for plans, there in (([], False), (["force"], True)):
        run = run_scene(scene.changed({("polygons",): plans}), frames=6)
        write_recording(run, tmp_path / "a.rrd")
        notes = Recording(tmp_path / "a.rrd").notes
        assert ("Equilibrium equations" in notes) == there
    assert "| 1 | coupler | M_D | 0.249629 R_Bx - 0.166389 R_By + 6.18829 = 0 |" in notes
    assert "T_A = 6.26362 N m" in notes and "all 9 equations at once" in notes


def test_what_does_not_fit_is_refused():
    assert said("kinetostatic-four-bar", "--at", "20 ms").exit_code == 2
    outside = said("kinetostatic-four-bar", "--equations", "--at", "400 deg")
    assert outside.exit_code == 2 and "outside what the drive does" in outside.stderr
    assert said("crank-rocker", "--equations").exit_code == 2
