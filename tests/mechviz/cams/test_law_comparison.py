"""``mechviz laws --scene``: laws side by side on a scene's cam, against the closed forms of its rise."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from cam_scenes import text_of
from typer.testing import CliRunner

import mechviz
from mechcore.errors import MechanismError
from mechcore.laws.catalogue import rise
from mechcore.laws.factors import peak_factors
from mechviz.commands.main import app
from mechviz.studies.law_comparison import AS_IT_IS, compare_laws, comparison_lines, with_law

SCENE = mechviz.loads(text_of("cam-roller"))  # 20 mm over 120 deg, a dwell of 60 deg, back over 120 deg


def test_laws_on_a_cam_have_the_peaks_of_their_factors():
    rows = compare_laws(SCENE, None, {"sine-squared": ("sine-squared", {}), "skew": ("parabolic", {"skew": 0.3})}, 72)
    assert [row.name for row in rows] == [AS_IT_IS, "sine-squared", "skew"]
    over = math.radians(120.0)
    for row, name, parameters in ((rows[1], "sine-squared", {}), (rows[2], "parabolic", {"skew": 0.3})):
        s = row.lift(np.linspace(0.01, over - 0.01, 2001), 2)
        assert np.abs(s[2]).max() == pytest.approx(peak_factors(rise(name, **parameters)).acceleration * 0.02 / over**2, rel=2e-3)
        assert np.isfinite(row.effort).all()
    lines = comparison_lines(rows, SCENE.units)
    assert "∞" in lines[-1]
    assert lines[-1].split()[:3] == ["skew", "20", "mm"]


def test_what_is_told_of_a_law_is_that_of_the_cam_that_it_makes():
    """A harmonic rise on a pitch circle of 50 mm: pressure angle and curvature by the formulas of a central follower, and with the
    least spring that is told the contact force just keeps the margin of the scene's rating."""
    rows = compare_laws(SCENE, None, {"harmonic": ("harmonic", {})}, 360)
    row = rows[1]
    over, stroke, prime = math.radians(120.0), 0.02, 0.05
    rise = (row.argument > 1e-9) & (row.argument < over - 1e-9)
    x = np.pi * row.argument[rise] / over
    s = 0.5 * stroke * (1.0 - np.cos(x))
    first, second = 0.5 * stroke * np.pi / over * np.sin(x), 0.5 * stroke * (np.pi / over) ** 2 * np.cos(x)
    h = prime + s
    np.testing.assert_allclose(np.abs(row.pressure_angle[rise]), np.arctan2(first, h), atol=1e-12)
    pitch = (h**2 + first**2) ** 1.5 / (h**2 + 2.0 * first**2 - h * second)
    np.testing.assert_allclose(row.radius[rise], pitch - 0.01, rtol=1e-9)
    rate = re.search(r"[\d.]+ N/mm$", comparison_lines(rows, SCENE.units)[-1])[0]
    sprung = SCENE.changed({("loads", "return_spring", "stiffness"): rate})
    assert compare_laws(sprung, None, {"harmonic": ("harmonic", {})}, 360)[1].force.min() == pytest.approx(40.0, abs=0.05)


def test_the_scene_s_own_law_is_the_first_row_and_others_change_nothing_else():
    rows = compare_laws(SCENE, "K", {"same": ("cycloidal", {})}, 36)
    both = with_law(SCENE, "K", "cycloidal", {}).document
    assert both.joints["K"].profile.base == SCENE.document.joints["K"].profile.base
    again = compare_laws(with_law(SCENE, "K", "cycloidal", {}), "K", {}, 36)[0]
    np.testing.assert_array_equal(rows[1].effort, again.effort)


def test_a_law_that_undercuts_is_told_beside_the_others():
    text = text_of("cam-roller").replace("base = 40", "base = 6", 1)
    small = mechviz.loads(re.sub(r"roller = \d+", "roller = 46", text, count=1))  # the same pitch curve
    rows = compare_laws(small, None, {"harmonic": ("harmonic", {}), "snap": ("5-6-7-8-9", {})}, 36)
    faults = {row.name: row.fault for row in rows}
    assert "undercut" in faults["snap"]
    assert not faults["harmonic"]
    assert "undercut" in comparison_lines(rows, small.units)[-1]


def test_scenes_without_such_a_cam_are_refused():
    for scene, cam in ((mechviz.load("plans-four-bar"), None), (SCENE, "S")):
        with pytest.raises(MechanismError, match="no cam with a lift"):
            compare_laws(scene, cam, {}, 36)


def test_the_command_prints_and_draws(tmp_path):
    target = tmp_path / "laws.svg"
    out = CliRunner().invoke(app, ["laws", "3-4-5", "--scene", "cam-roller", "--frames", "36", "--plot", str(target)]).output
    assert "as it is" in out
    assert "radius of curvature [mm]" in target.read_text()
    assert "are for --scene" in CliRunner().invoke(app, ["laws", "--cam", "K"]).output
