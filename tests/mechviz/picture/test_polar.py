"""Polar plots of shaking force and moment: what is drawn is what was computed, in the stated scale."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
from typer.testing import CliRunner

import mechviz
from mechcore.reduction.shaking import shaking
from mechviz.commands.main import app
from mechviz.runs import run_scene
from mechviz.studies.balance import balance_scene
from mechviz.studies.polar import PANEL, RADIUS, polar_svg

NAME = "{http://www.w3.org/2000/svg}"


def drawn(text):
    """Curves as points from the middle of their plot (y upwards), and the value [N or N m] of each plot's outermost circle."""
    root = ElementTree.fromstring(text)
    curves = [
        np.array(re.findall(r"[ML](-?[0-9.]+) (-?[0-9.]+)", path.get("d")), float)
        for path in root.iter(f"{NAME}path")
        if path.get("stroke-width") == "1.8"
    ]
    circles = [c for c in root.iter(f"{NAME}circle") if c.get("fill") == "none"]
    centres = sorted({(float(c.get("cx")), float(c.get("cy"))) for c in circles})
    values = {
        unit: [
            float(t.text.removesuffix(f" {unit}")) for t in root.iter(f"{NAME}text") if re.fullmatch(rf"[-0-9.e+]+ {unit}", t.text)
        ]
        for unit in ("N", "N m")
    }
    found = [(points - centres[k % 2]) * [1.0, -1.0] for k, points in enumerate(curves)]
    return found, max(values["N"]), max(values["N m"])


def test_curves_are_the_forces_and_moments_in_the_stated_scale():
    b = balance_scene(mechviz.load("shaking-engine"))
    curves, force, moment = drawn(polar_svg("x & y", b.motion, {"before": b.before, "after": b.after}))
    angle = b.motion.coordinate("A")[:, 0]
    assert b.before.peak <= force <= 1.5 * b.before.peak and b.before.peak_moment <= moment <= 1.5 * b.before.peak_moment
    for k, s in enumerate((b.before, b.after)):
        np.testing.assert_allclose(curves[2 * k], s.force * RADIUS / force, atol=0.02)
        radius = RADIUS * (0.5 + 0.5 * s.moment / moment)
        np.testing.assert_allclose(curves[2 * k + 1], radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), atol=0.02)


def test_a_full_balance_is_a_point():
    b = balance_scene(mechviz.load("shaking-four-bar"))
    text = polar_svg("four-bar", b.motion, {"before": b.before, "with counterweights": b.after})
    curves, _, _ = drawn(text)
    assert np.abs(curves[2]).max() < 0.02 and "with counterweights: 0 N" in text
    assert text.count('r="2.4"') == 12  # dots every 30 degrees, of the curve that is one


def test_commands_write_them(tmp_path):
    run = CliRunner().invoke
    out = tmp_path / "polar.svg"
    done = run(app, ["balance", "shaking-four-bar", "--plot", str(out)])
    assert done.exit_code == 0 and str(out) in done.stdout
    assert ElementTree.parse(out).getroot().get("width") == str(2 * PANEL)
    before = out.read_text()
    assert run(app, ["forces", "shaking-engine", "--plot", str(out)]).exit_code == 0 and out.read_text() != before
    for arguments, words in (
        (["balance", "shaking-engine", "--plot", str(tmp_path / "p.png")], "ends in .svg"),
        (["forces", "belt-slip", "--plot", str(out)], "nothing shakes the frame"),
        (["forces", "shaking-engine", "--plot", str(tmp_path / "no" / "p.svg")], "does not exist"),
    ):
        failed = run(app, arguments)
        assert failed.exit_code == 2 and words in failed.stderr


def test_where_the_drive_slides_the_part_of_the_run_is_its_angle():
    run = run_scene(mechviz.load("excavator-arm"))
    found = shaking(run.motion)
    curves, force, moment = drawn(polar_svg("arm", run.motion, {"shaking force": found}))
    turn = 2.0 * np.pi * run.motion.time / run.motion.time[-1]
    radius = RADIUS * (0.5 + 0.5 * found.moment / moment)
    np.testing.assert_allclose(curves[1], radius[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]), atol=0.02)
    np.testing.assert_allclose(curves[0], found.force * RADIUS / force, atol=0.02)
