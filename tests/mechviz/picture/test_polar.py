"""Polar plots of shaking force and moment: what is drawn is what was computed, in the stated scale."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
from typer.testing import CliRunner

import mechviz
from mechcore.reduction.balancing import shaking
from mechviz.commands.main import app
from mechviz.runs import run_scene
from mechviz.scene.units import MILLIMETRES
from mechviz.studies.balance import balance_scene, polar_figure


def drawn(figure):
    """Points (n, 2) of the curves and of the dots of the force [N], and angles and moments (n, 2) of the other plot."""
    forces, moments = figure.axes
    plane = [line.get_ydata()[:, None] * np.column_stack([np.cos(t := line.get_xdata()), np.sin(t)]) for line in forces.lines]
    assert forces.get_rmin() == 0.0 and moments.get_rmin() < 0.0 < moments.get_rmax()
    return plane[::2], plane[1::2], [line.get_xydata() for line in moments.lines[:-1]]


def test_curves_are_the_forces_and_moments():
    b = balance_scene(mechviz.load("shaking-engine"))
    figure = polar_figure("x & y", b.motion, {"before": b.before, "after": b.after}, MILLIMETRES)
    curves, dots, moments = drawn(figure)
    angle = b.motion.coordinate("A")[:, 0]
    assert b.before.peak <= figure.axes[0].get_rmax() <= 1.5 * b.before.peak
    for curve, moment, s in zip(curves, moments, (b.before, b.after), strict=True):
        np.testing.assert_allclose(curve, s.force, atol=1e-9 * b.before.peak)
        np.testing.assert_allclose(moment, np.column_stack([angle, s.moment]), atol=1e-12)
    assert [len(d) for d in dots] == [12, 12], "every 30 degrees"
    assert [t.get_text() for t in figure.axes[0].texts] == ["0°", "90°", "180°", "270°"] * 2
    assert [a.get_title("center") for a in figure.axes] == ["shaking force [N]", "shaking moment [N m] over the drive"]


def test_a_full_balance_is_a_point():
    b = balance_scene(mechviz.load("shaking-four-bar"))
    figure = polar_figure("four-bar", b.motion, {"before": b.before, "with counterweights": b.after}, MILLIMETRES)
    curves, dots, _ = drawn(figure)
    assert np.abs(curves[1]).max() < 1e-9 * b.before.peak and [len(d) for d in dots] == [12, 1]
    assert figure.legends[0].get_texts()[1].get_text().startswith("with counterweights: 0 N")


def test_commands_write_them(tmp_path):
    run = CliRunner().invoke
    out = tmp_path / "polar.svg"
    done = run(app, ["balance", "shaking-four-bar", "--plot", str(out)])
    assert done.exit_code == 0 and str(out) in done.stdout
    words = {t.text for t in ElementTree.parse(out).getroot().iter("{http://www.w3.org/2000/svg}text")}
    assert {"shaking force [N]", "Shaking force of a four-bar, and its full balance"} <= words
    before = out.read_bytes()
    run(app, ["balance", "shaking-four-bar", "--plot", str(out)])
    assert out.read_bytes() == before, "the same plot is the same file"
    assert run(app, ["forces", "shaking-engine", "--plot", str(out)]).exit_code == 0 and out.read_bytes() != before
    for ending, start in ((".png", b"\x89PNG"), (".pdf", b"%PDF")):
        assert run(app, ["forces", "shaking-engine", "--plot", str(out.with_suffix(ending))]).exit_code == 0
        assert out.with_suffix(ending).read_bytes().startswith(start)
    for arguments, words in (
        (["balance", "shaking-engine", "--plot", str(tmp_path / "p.gif")], "ends in .svg, .png or .pdf"),
        (["forces", "belt-slip", "--plot", str(out)], "nothing shakes the frame"),
        (["forces", "shaking-engine", "--plot", str(tmp_path / "no" / "p.svg")], "does not exist"),
    ):
        failed = run(app, arguments)
        assert failed.exit_code == 2 and words in failed.stderr


def test_where_the_drive_slides_the_part_of_the_run_is_its_angle():
    run = run_scene(mechviz.load("excavator-arm"))
    resultants = shaking(run.motion)
    curves, _, moments = drawn(polar_figure("arm", run.motion, {"shaking force": resultants}, MILLIMETRES))
    turn = 2.0 * np.pi * run.motion.time / run.motion.time[-1]
    np.testing.assert_allclose(moments[0], np.column_stack([turn, resultants.moment]), atol=1e-12)
    np.testing.assert_allclose(curves[0], resultants.force, atol=1e-12)
