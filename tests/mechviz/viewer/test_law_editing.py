"""A law is exchanged for one that needs data of its own: these reproduce the motion that was there, and are edited."""

from __future__ import annotations

import numpy as np
import pytest
from browsers import browser
from browsing import SIZE, caught_up, open_tab, open_viewer, until

import mechviz
from mechcore.laws.segment_laws import joined_table
from mechviz.editor.laws import ACCELERATION, LAW_OPTIONS, POLYNOMIAL, SPLINE, STATED_ENDS, TABLE, VELOCITY, law_changes
from mechviz.editor.parameters import find_choices, find_parameters
from mechviz.editor.rows import find_rows
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.runs import run_scene
from mechviz.scene.document import value_at
from mechviz.scene.faults import path_text

__all__ = ["browser"]  # a fixture

LIFT = ("joints", "K", "profile", "lift")
PLACES = {
    "cam": ("cam-roller", LIFT),
    "time": ("gantry-in-step", ("joints", "X", "drive", "segments")),
    "master": ("two-axis-program", ("joints", "Z", "drive", "program", "segments")),
}
FIRST = {"cam": 0, "time": 5, "master": 0}
NEAR = {STATED_ENDS: 0.02, POLYNOMIAL: 2e-3, SPLINE: 1e-3, ACCELERATION: 2e-3, VELOCITY: 3e-3, TABLE: 1e-4}  # of the stroke


def curve(scene, home=LIFT):
    joined = scene.curves[path_text(home)].curve
    return joined(np.linspace(joined.start, joined.end, 1501), 2)


def other(scene, place, option):
    return scene.changed(law_changes(scene, place, option))


@pytest.mark.sample(6)
@pytest.mark.parametrize("option", NEAR)
@pytest.mark.parametrize("over", PLACES)
def test_data_of_a_law_reproduce_the_motion_and_are_edited(over, option):
    name, home = PLACES[over]
    place = (*home, FIRST[over], "law")
    before = other(mechviz.load(name), place, "modified-sine")
    after = other(before, place, option)
    stroke = np.ptp(curve(before, home)[0])
    np.testing.assert_allclose(curve(after, home)[0], curve(before, home)[0], rtol=0.0, atol=NEAR[option] * stroke)
    speed = np.abs(curve(before, home)[1]).max()
    np.testing.assert_allclose(curve(after, home)[1], curve(before, home)[1], rtol=0.0, atol=7e-2 * speed)

    def mine(key):
        return key.startswith(path_text(place[:-1]))

    rows = [row for row in find_rows(after) if mine(row.key)]
    if option in (ACCELERATION, VELOCITY, TABLE):
        (table,) = rows
        assert f": at [{'s' if over == 'time' else '°'}], values [" in table.title and len(table.values) > 15
        lines = table.text.splitlines()
        at, value = lines[6].split(", ")
        lines[6] = f"{at}, {1.02 * float(value)}"
        edited = after.changed(table.changes("\n".join(lines)))
    else:
        assert not rows
        count = {STATED_ENDS: 3, POLYNOMIAL: 6, SPLINE: 8}[option]  # velocity, acceleration, jerk; or places and positions
        data = [p for p in find_parameters(after) if mine(p.key) and p.path[len(home) + 1 :] not in (("to",), ("to", 0))]
        data = [p for p in data if {"to", "at"} & set(p.path)]
        assert len(data) == count
        last = data[-1]
        edited = after.changed({last.path: last.written(1.02 * last.value)})
    moved = np.abs(curve(edited, home)[0] - curve(after, home)[0]).max()
    assert 1e-5 * stroke < moved < 0.05 * stroke
    back = other(after, place, "modified-sine")
    np.testing.assert_allclose(curve(back, home), curve(before, home), rtol=0.0, atol=1e-7 * np.abs(curve(before, home)).max())


def test_a_given_acceleration_of_a_segment_that_leads_back_ends_at_rest_where_it_begins():
    """From zero up by 4 mm and back in 120 degrees, by a polynomial."""
    place = (*LIFT, 0, "law")
    middle = [{"at": 120.0 * f, "to": 64.0 * (f * (1.0 - f)) ** 2} for f in (0.25, 0.5, 0.75)]
    before = mechviz.load("cam-roller").changed({(*LIFT, 0, "to"): 0.0, place: {"polynomial": middle}})
    after = other(before, place, ACCELERATION)
    assert value_at(after.document, place).balanced
    joined = after.curves[path_text(LIFT)]
    ends = joined.curve(joined.curve.start + joined.overs[0] * np.array([0.0, 1.0 - 1e-12]), 1)
    np.testing.assert_allclose(ends, 0.0, rtol=0.0, atol=1e-12)
    lift = curve(before)[0].max()  # straight lines between sixteen places lack a tenth of so bent an acceleration
    np.testing.assert_allclose(curve(after)[0], curve(before)[0], rtol=0.0, atol=0.1 * lift)


def test_every_law_follows_every_other():
    """What one law states beside itself, such as a velocity at its end, is not left where the next cannot have it."""
    place, scene = (*LIFT, 0, "law"), mechviz.load("cam-roller")
    last = curve(scene)[0]
    for option in (*LAW_OPTIONS, *reversed(LAW_OPTIONS)):
        scene = other(scene, place, option)
        (choice,) = (c for c in find_choices(scene) if c.path == place)
        assert choice.options == LAW_OPTIONS
        if option in NEAR:
            assert np.abs(curve(scene)[0] - last).max() < 0.07 * np.ptp(last), option
        last = curve(scene)[0]
    assert value_at(scene.document, (*LIFT, 0)).to == 20.0


def test_a_law_of_jumps_is_stated_by_few_rows():
    """Of the parabola of constant acceleration, +-4 h / range**2, four rows and no more, which sliders move."""
    place = (*LIFT, 0, "law")
    scene = other(other(mechviz.load("cam-roller"), place, "parabolic"), place, ACCELERATION)
    given = value_at(scene.document, place).acceleration
    assert given.at == [0.0, 60.0, 60.0, 120.0]
    assert given.values == pytest.approx([4 * 20 / 120**2] * 2 + [-4 * 20 / 120**2] * 2, rel=1e-9)
    assert sum("law acceleration values" in p.title for p in find_parameters(scene)) == 4


def test_a_given_acceleration_goes_from_rest_to_rest_whatever_is_edited():
    """Its positive and negative parts have sizes that follow: else the follower would knock, which a cam with a roller refuses."""
    place = (*LIFT, 0, "law")
    scene = other(mechviz.load("cam-roller"), place, ACCELERATION)
    given = value_at(scene.document, place).acceleration
    speed = joined_table(given.at, given.values).integrated(0.0)
    assert abs(speed.advance) < 1e-9 * 20 / 120 and speed.integrated(0.0).advance == pytest.approx(20.0, rel=1e-8)
    edited = scene.changed({(*place, "acceleration", "values", 4): 0.02})
    joined = edited.curves[path_text(LIFT)].curve
    rise = joined(np.radians([0.0, 120.0]), 1, "left")
    np.testing.assert_allclose(1e3 * rise, [[0.0, 20.0], [0.0, 0.0]], atol=1e-10)
    ahead, behind = (joined(np.radians(given.at), 2)[2] * 1e3 * np.radians(1.0) ** 2)[[3, 12]] / np.array(given.values)[[3, 12]]
    assert 0.5 < ahead < 0.95 and 0.8 < behind < 1.3 and abs(ahead - behind) > 0.01
    assert len(run_scene(edited, frames=36).motion.time) == 37


@pytest.mark.parametrize("option", NEAR)
def test_a_motion_to_and_fro_and_a_radius_take_every_law(option):
    """A segment that ends where it begins has no size that follows from its end; a radius has no derivatives at its ends."""
    scene, place = mechviz.load("gantry-in-step"), ("joints", "Z", "drive", "program", "segments", 2, "law")
    before = curve(scene, place[:-2])
    if option != STATED_ENDS:  # no point between the ends is left
        after = curve(other(scene, place, option), place[:-2])
        np.testing.assert_allclose(after[0], before[0], rtol=0.0, atol=0.02 * np.ptp(before[0]))
    scene, place = mechviz.load("cam-polynomial"), ("joints", "K", "profile", "radius", 0, "law")
    before = curve(scene, place[:-2])
    after = curve(other(scene, place, option), place[:-2])
    np.testing.assert_allclose(after[0], before[0], rtol=0.0, atol=0.02 * np.ptp(before[0]))


def test_speeds_at_the_ends_are_kept():
    """Two halves of a rise at one speed: the second, through points, begins and ends with it, and is the same line."""
    halves = [{"over": 60, "to": 10, "law": "constant-velocity"}, {"over": 60, "to": 20, "law": "constant-velocity"}]
    scene = mechviz.load("cam-roller")
    scene = scene.changed({LIFT: [*halves, {"over": 60}, {"over": 180, "to": 0}], ("joints", "K", "profile", "undercut"): "cut"})
    before = curve(scene)
    for option in (SPLINE, POLYNOMIAL):
        after = other(scene, (*LIFT, 1, "law"), option)
        assert value_at(after.document, LIFT)[0].to == [10.0, "free", "free"]
        np.testing.assert_allclose(curve(after)[:2], before[:2], rtol=0.0, atol=1e-5 * np.abs(before[1]).max())


def test_points_in_a_row_are_one_text():
    """Twenty points of a drawn curve: one control, not forty, which changes no number but those that are written anew."""
    points = {f"P{k + 1}": [100.0 / 3.0 + k, float(k % 5)] for k in range(20)}
    scene = mechviz.load("crank-rocker")
    known = len(find_parameters(scene))
    marked = scene.changed({("links", "frame", "points", name): xy for name, xy in points.items()})
    assert len(find_parameters(marked)) == known
    (row,) = (row for row in find_rows(marked) if row.key == "links.frame.points.P")
    assert row.title == "frame P1 to P20 [mm]" and row.text.startswith("33.3333, 0; 34.3333, 1; ") and not row.changes(row.text)
    assert row.changes(row.text.replace("34.3333, 1;", "34.3333, 1.5;", 1)) == {("links", "frame", "points", "P2", 1): 1.5}
    with pytest.raises(ValueError, match="40 numbers are wanted"):
        row.changes("1, 2")


def test_a_table_is_pasted_as_a_spreadsheet_copies_it():
    """Any number of rows, with a header whose units count, decimal commas beside semicolons or tabs; what is wrong is told."""
    place = (*LIFT, 0, "law")
    scene = other(mechviz.load("cam-roller"), place, TABLE)
    (table,) = find_rows(scene)
    assert table.title == "K lift 1 law position: at [°], values [mm]" and not table.changes(table.text)
    at = np.linspace(0.0, 120.0, 121)
    lift = 20.0 * (at / 120.0 - np.sin(np.radians(3.0 * at)) / (2.0 * np.pi))
    rows = [f"{np.radians(x):.12f}\t{y / 10.0:.12f}".replace(".", ",") for x, y in zip(at, lift, strict=True)]
    pasted = scene.changed(table.changes("\n".join(["angle [rad]\tlift [cm]", *rows])))
    given = value_at(pasted.document, place).position
    assert len(given.at) == 121 and given.values[-1] == "2.0 cm"
    cycloid = scene.changed({place: "cycloidal", (*LIFT, 0, "to"): 20.0})
    np.testing.assert_allclose(curve(pasted)[:2], curve(cycloid)[:2], rtol=0.0, atol=1e-8)
    (after,) = find_rows(pasted)
    assert after.title == "K lift 1 law position: at [rad], values [cm]" and after.lists == table.lists
    for text, why in (("0, 0\n1", "row 2 is '1'; 2 numbers are wanted"), ("", "0 rows"), ("1, 2\n" * 1501, "1501 rows")):
        with pytest.raises(ValueError, match=why):
            table.changes(text)


@pytest.mark.thorough
def test_in_the_browser_a_law_becomes_a_given_acceleration(browser):
    place = (*LIFT, 0, "law")
    run = run_scene(mechviz.load("cam-roller"), frames=60)
    with Viewer(run, port=0) as viewer:
        viewer.pause()
        page = open_viewer(browser, viewer, SIZE, [link_path("cam")])
        try:
            open_tab(page, "Edit")
            page.get_by_label("K lift 1 law", exact=True).click()
            page.get_by_role("option", name=ACCELERATION, exact=True).click()
            until(page, lambda: hasattr(value_at(viewer.run.scene.document, place), "acceleration"), "another law")
            key = f"{path_text(place)}.acceleration"
            until(page, lambda: key in viewer.inspector.controls.texts, "its numbers")
            caught_up(viewer, page)
            field = page.locator("textarea").first
            rows = [[float(n) for n in line.split(", ")] for line in field.input_value().splitlines()]
            given = value_at(viewer.run.scene.document, place).acceleration
            assert len(rows) == 17
            np.testing.assert_allclose(rows, np.column_stack([given.at, given.values]), rtol=1e-5, atol=1e-9)
            dense = [[at, np.interp(at, *np.transpose(rows))] for at in np.linspace(0.0, 120.0, 241)]
            field.fill("at [deg];values [mm/deg^2]\n" + "\n".join(f"{x:.6g};{y:.9g}".replace(".", ",") for x, y in dense))
            until(page, lambda: len(value_at(viewer.run.scene.document, place).acceleration.values) == 241, "a pasted table")
            field.fill("1, 2\n3")
            page.get_by_role("alert").filter(has_text="row 2 is '3'; 2 numbers are wanted").first.wait_for()
            assert len(value_at(viewer.run.scene.document, place).acceleration.values) == 241, "the last good ones stay"
        finally:
            page.close()


def test_a_table_from_rest_to_rest_has_no_speed_at_its_ends():
    """Its rows are met; without ``rest`` a cam with a roller would have a corner there, which is refused."""
    rows = {"at": [0, 20, 45, 60, 75, 100, 120], "values": [0, 1, 7, 10.5, 13, 19, 20]}
    scene = mechviz.load("cam-roller")
    place = (*LIFT, 0)
    with pytest.raises(mechviz.SceneError, match="rest = true"):
        scene.changed({(*place, "to"): None, (*place, "law"): {"position": rows}})
    with pytest.raises(mechviz.SceneError, match="rest beside tolerance"):
        scene.changed({(*place, "to"): None, (*place, "law"): {"position": {**rows, "rest": True, "tolerance": "1 mm"}}})
    made = scene.changed({(*place, "to"): None, (*place, "law"): {"position": {**rows, "rest": True}}})
    joined = made.curves[path_text(LIFT)].curve
    values = joined(np.radians(rows["at"]), 2, "left")
    np.testing.assert_allclose(1e3 * values[0], rows["values"], atol=1e-9)
    assert np.abs(values[1:, -1]).max() < 1e-12 and np.abs(joined(np.zeros(1), 2)).max() < 1e-12
