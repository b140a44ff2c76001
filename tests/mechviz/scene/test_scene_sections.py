"""Scenes that ask for section forces: keys, faults, numbers in catalogue, report and recording, diagrams, free motion."""

import math
import re

import numpy as np
import pytest

import mechviz
from mechviz.outputs.images.drawing import svg_of
from mechviz.outputs.inspection import format_inspection, inspect
from mechviz.outputs.presentation import presentation_of
from mechviz.outputs.rerun.writer import write_recording
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.nodes import Lines, Points
from mechviz.quantities.study_tables import study_lines
from mechviz.runs import run_scene
from mechviz.studies.report import check_lines
from recordings import gallery_scene

ROD = gallery_scene("connecting-rod-bending")
TUBE = {"diameter": 30, "wall": 2}
FALLING = """
effects = ["inertia", "gravity"]
run = { duration = 0.3, frames = 31 }
[links]
frame = { points = { A = [0, 0] } }
bar = { points = { A = [0, 0], B = [1.2, 0] }, mass = 3, shape = "bar" }
[joints]
A = { revolute = ["frame", "bar"], free = { position = 0 } }
[sections]
bar = {}
"""


def changed(**sections):
    return ROD.changed({("sections",): sections})


def faults(**sections):
    with pytest.raises(mechviz.SceneError) as error:
        changed(**sections)
    return {f.path: f"{f.message} {f.remedy}" for f in error.value.faults}


def test_cross_sections_have_their_areas_and_moduli():
    def section(**sides):
        (study,) = changed(rod={"section": sides}).mechanism.studies.sections
        return study.section.area, study.section.modulus

    assert section(height=26, width=14) == pytest.approx((26e-3 * 14e-3, 14e-3 * 26e-3**2 / 6.0))
    assert section(diameter=30) == pytest.approx((math.pi / 4 * 9e-4, math.pi / 32 * 2.7e-5))
    assert section(**TUBE) == pytest.approx((math.pi * 28e-3 * 2e-3, math.pi / 32 * (30**4 - 26**4) / 30 * 1e-9))
    hollow = section(height=40, width=20, wall=5)
    assert hollow == pytest.approx((20 * 40e-6 - 10 * 30e-6, (20 * 40**3 - 10 * 30**3) / (6 * 40) * 1e-9))


def test_what_is_wrong_is_told_at_its_place():
    assert "Did you mean 'rod'?" in faults(rood={})["sections.rood"]
    assert "no point 'X'" in faults(rod={"along": ["B", "X"]})["sections.rod.along[1]"]
    assert "at one place" in faults(rod={"along": ["B", "B"]})["sections.rod.along"]
    assert "one point" in faults(piston={})["sections.piston"]
    assert "fixed link" in faults(frame={})["sections.frame"]
    assert "'width' is missing" in faults(rod={"section": {"height": 20}})["sections.rod.section.height"]
    assert "without" in faults(rod={"section": {}})["sections.rod.section"]
    assert "beside diameter" in faults(rod={"section": {"height": 20, "diameter": 20}})["sections.rod.section.height"]
    assert "fills" in faults(rod={"section": {"diameter": 20, "wall": 10}})["sections.rod.section.wall"]
    with pytest.raises(mechviz.SceneError, match="without any force"):
        ROD.changed({("effects",): []})


def test_reading_and_building_agree():
    scene = changed(rod={"along": ["C", "B"], "section": TUBE})
    assert mechviz.loads(scene.to_toml(), scene.name) == scene
    built = mechviz.SceneBuilder("s", length="mm").link("frame", A=(0, 0)).link("bar", A=(0, 0), B=(99, 0), mass=1, shape="bar")
    built.revolute("A", "frame", "bar", drive={"speed": 1}).effect("inertia").section_forces("bar", along=["A", "B"], section=TUBE)
    (study,) = built.scene().mechanism.studies.sections
    assert study.points == ("A", "B") and study.section.modulus == pytest.approx(math.pi / 32 * (30**4 - 26**4) / 30 * 1e-9)


def test_point_masses_of_a_link_are_where_the_scene_puts_them():
    links = {("links", "rod", "point_masses"): [{"mass": "0.3 kg", "at": [150, 0]}]}
    (study,) = ROD.changed(links).mechanism.studies.sections
    assert study.masses[0] == pytest.approx((0.3, 0.15, 0.0, 0.0))
    along = run_scene(ROD.changed(links), frames=12).studies.sections["rod"]
    k = np.flatnonzero(np.abs(along.stations[3] - 0.15) < 1e-12)
    assert abs(np.diff(along.shear[3, k])).max() > 100.0  # the ball's own inertia force
    assert along.unbalanced.max() < 1e-9 * np.abs(along.normal).max()


def test_a_run_and_its_recording_tell_the_largest_bending_moment(tmp_path):
    run = run_scene(ROD, frames=72)
    along, catalogue = run.studies.sections["rod"], run.catalogue
    k = int(np.argmax(np.abs(along.bending.values)))
    assert catalogue["link.rod.bending_moment"].values()[:, 0] == pytest.approx(along.bending.values)
    assert catalogue["link.rod.bending_moment_at"].values()[k, 0] == pytest.approx(1e3 * along.bending.stations[k])
    assert catalogue["link.rod.bending_stress"].unit == "MPa"
    # nearer to the crank than the middle: 220 (1 - 1 / sqrt 3) = 93 mm from it
    assert 92.0 < 1e3 * along.bending.stations[k] < 100.0
    (line,) = [text for text in study_lines(run) if text.startswith("section forces of rod")]
    assert f"{along.bending.values[k]:.5g} N m at {1e3 * along.bending.stations[k]:.5g} mm of its 220 mm" in line
    write_recording(run, tmp_path / "rod.rrd")
    text = format_inspection(inspect(tmp_path / "rod.rrd"))
    assert f"{along.bending.values[k]:.5g} N m" in text
    assert "bending stress rod" in text and "bending moment at" not in text


def test_diagrams_stand_on_their_links_and_go_with_them():
    run = run_scene(changed(rod={}, crank={}), frames=24)
    solids = solids_of(run)
    picture = picture_of(run, solids)
    for group in ("bending_moment", "shear_force", "normal_force"):
        assert {node.owner[1] for node in picture.nodes_of(Lines, group)} == {"rod", "crank"}
    outline = picture.by_key["section.rod.bending_moment"].strips[0][..., :2]
    ends = run.motion.point("rod", "B"), run.motion.point("rod", "C")
    assert outline[:, 0] == pytest.approx(ends[0], abs=1e-6) and outline[:, -1] == pytest.approx(ends[1], abs=1e-6)
    # the tallest ordinate of all links and frames is a fixed part of the mechanism, on the side that is stretched
    tallest = 0.0
    for link, computed in run.studies.sections.items():
        z = picture.by_key[f"section.{link}.bending_moment"].strips[0][..., :2] @ np.array([1.0, 1.0j])
        turned = (z - z[:, :1]) * np.exp(-1j * run.motion.pose(link)[:, 2])[:, None]
        aside = turned.imag[:, 1:-1]
        k = np.unravel_index(np.argmax(np.abs(aside)), aside.shape)
        assert np.sign(aside[k]) == -np.sign(computed.moment[k])
        tallest = max(tallest, float(np.abs(aside).max()))
    assert tallest == pytest.approx(0.16 * solids.size, rel=1e-3)
    dots = list(picture.nodes_of(Points, "bending_moment"))
    assert [dot.labels[0].startswith("|M| ≤ ") for dot in dots] == [True, True]


def test_a_drawing_marks_the_largest_moment():
    run = run_scene(ROD, frames=24)
    drawing = svg_of(presentation_of(run))
    assert drawing.count("<circle") == 1 and "|M| ≤ " in drawing


def test_a_bar_that_falls_freely_breaks_at_a_third_of_its_length():
    """At the start 3 g / (2 L) turns it: m g L / 27 at L / 3, whatever moves it."""
    run = run_scene(mechviz.loads(FALLING, "falling"))
    along = run.studies.sections["bar"]
    assert along.bending.stations[0] == pytest.approx(0.4, rel=2e-3)
    # on the way down, weight across the bar counts by the sine of its angle to the vertical
    slope = np.abs(np.cos(run.motion.pose("bar")[:, 2]))
    assert np.abs(along.bending.values) == pytest.approx(slope * 3.0 * 9.81 * 1.2 / 27.0, rel=1e-5)
    assert along.unbalanced.max() < 1e-6


def test_bearing_forces_at_both_ends_of_a_guide_have_names():
    run = run_scene(gallery_scene("cam-friction"), frames=72)
    behind, ahead = (run.catalogue[f"joint.S.bearing_force_{end}"].values()[:, 0] for end in ("behind", "ahead"))
    load = run.forces.friction.normal_load("S")
    assert np.abs(behind) + np.abs(ahead) == pytest.approx(load, rel=1e-9)  # what its friction is made by


def test_the_stem_of_a_follower_bends_by_its_knife_and_the_pressure_of_its_guide():
    """While it rises: P on the stem, the force of the cam turned by the pressure angle and the angle of friction; its part F
    across is held by two forces at the ends of the guide, whose friction is mu 2 F s / L for a guide of length L a way s above."""
    run = run_scene(gallery_scene("cam-friction"), frames=360)
    rows = slice(10, 111, 10)  # of a rise over 120 degrees
    y, _, acceleration = run.motion.coordinate("S")[rows].T
    tip = 0.105 + y  # of the knife
    slope = run.motion.coordinate("S")[rows, 1] / (4.0 * math.pi)
    load = 3000.0 * (0.09 - (0.185 - tip - 0.085)) + 0.4 * (9.81 + acceleration)
    lean, middle, half = np.arctan2(slope, tip) + math.atan(0.1), 0.105 - tip, 0.02
    across = load / (1.0 / np.tan(lean) - 0.12 * middle / half)
    along = run.studies.sections["follower"]
    for k, force, mid in zip(range(10, 111, 10), across, middle, strict=True):
        s = along.stations[k]
        inside = np.clip(s - mid + half, 0.0, 2.0 * half)  # of the guide, from its lower end
        even, tilting = force * inside**2 / (4.0 * half), force * mid * inside**2 * (3.0 * half - inside) / (4.0 * half**3)
        wanted = np.where(s > mid + half, 0.0, force * s - even - tilting)
        np.testing.assert_allclose(np.abs(along.moment[k]), wanted, atol=1e-9)


def test_check_tells_the_largest_bending_moment():
    """A bar that its drive holds out: M = m g l / 2 at the pivot, stress M / W."""
    held = FALLING.replace("free = { position = 0 }", "drive = { speed = 0 }").replace("bar = {}", 'bar.section.diameter = "30 mm"')
    scene = mechviz.loads("gravity = [0, -10]\n" + held.replace("run = { duration = 0.3, frames = 31 }", ""))
    (line,) = (line for line in check_lines(scene) if line.startswith("inside"))
    moment, place, stress = (float(x) for x in re.search(r"moment (\S+) N m at (\S+) m of .* stress (\S+) MPa", line).groups())
    assert abs(moment) == pytest.approx(3 * 10 * 0.6)
    assert place == pytest.approx(0.0, abs=1e-9)
    assert stress == pytest.approx(18.0 / (math.pi / 32 * 27.0), rel=1e-4)
