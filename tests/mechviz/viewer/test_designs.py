"""Designs in the browser: a study's designs open as scenes, an optimisation shows its best one and keeps it when it is stopped."""

from __future__ import annotations

import re

import numpy as np
import pytest
from browsers import browser
from browsing import POSE, SEEN, SIZE, heard, open_tab, open_viewer, until
from patience import PATIENCE

from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.panels import designs
from mechviz.outputs.viewer.panels.designs import goal_words, optimise, scatter
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.runs import run_scene
from mechviz.scene.scene import load
from mechviz.studies.designs.figures import StoredStudy
from mechviz.studies.designs.problem import problem_of

__all__ = ["browser"]  # a fixture

STROKES = np.array([60.0, 75.0, 90.0])


@pytest.fixture(scope="module")
def viewer():
    run = run_scene(load("parametric-press"), frames=24)
    peaks = np.array([90.0, np.nan, 110.0])
    study = StoredStudy("press", "", (("stroke", "mm"),), {"stroke [mm]": STROKES}, {"peak [N m]": peaks}, ("", "a jam", ""))
    with Viewer(run, port=0, study=study) as shown:
        yield shown


def values(viewer, *names):
    return [viewer.session.run.scene.parameters[name].amount.number for name in names]


def test_a_design_of_a_study_opens_as_a_scene_and_can_be_undone(viewer):
    chart = viewer.inspector.study
    chart.design.value = 2
    chart.choose(chart.number)
    assert viewer.session.wait() and values(viewer, "stroke") == pytest.approx([0.09])
    assert "stroke [mm]: <b>90</b>" in chart.report.content
    chart.design.value = 1e9  # what is typed beyond the ends is the last one
    assert chart.number == 2
    viewer.session.undo()
    assert viewer.session.wait() and values(viewer, "stroke") == pytest.approx([0.08])


def test_marks_stand_where_the_values_are_and_name_their_design():
    drawn = scatter(STROKES, np.array([1.0, np.nan, 3.0]), ("x", "a < b"), 0, "slider")
    marks = re.findall(r'slider:(\d+)"[^<]*<title>[^<]*</title><circle cx="([\d.]+)" cy="([\d.]+)"', drawn)
    places = {int(k): (float(x), float(y)) for k, x, y in marks}
    assert places[2][0] > places[0][0] and places[2][1] < places[0][1]
    assert drawn.count("data-mv-pick") == 3 and drawn.count("<path d=") == 2 and "a &lt; b" in drawn


def test_a_goal_is_said_in_words_and_its_way_marked_in_the_scene():
    assert goal_words(load("parametric-press")) == [
        "<b>Sought:</b> least drive.A.torque:peak",
        "<b>Kept:</b> joint.S.displacement:range at least 70 mm, joint.B.reaction:peak at most 4.96 kN",
        "<b>May vary:</b> stroke, ratio",
    ]
    way = {"path": {"point": "ram.C", "through": [[100, 0], [200, 10]]}, "box": [[0, 0], [300, 200]]}
    scene = load("parametric-press").changed({("goal",): way, ("trace",): ["ram.C"]})
    assert goal_words(scene)[:2] == ["<b>Sought:</b> ram.C on its stated way", "<b>Kept:</b> all points within a box"]
    with Viewer(run_scene(scene, frames=12), port=0) as shown:
        marks = shown.server.scene._handle_from_node_name["/goal/way"].points
    np.testing.assert_allclose(marks.reshape(2, 4, 3).mean(axis=1)[:, :2], [[0.1, 0.0], [0.2, 0.01]], atol=1e-7)


def test_a_search_shows_its_best_design_and_stopping_keeps_it(viewer, monkeypatch):
    """The optimum of the press: the least stroke that its limit allows, and the longest rod."""
    search = viewer.inspector.optimiser
    search.begin()
    assert search.stop.visible and not search.start.visible
    search.thread.join()
    assert viewer.session.wait() and values(viewer, "stroke", "ratio") == pytest.approx([0.07, 6.0], rel=1e-6)
    assert "Done." in search.report.content and search.start.visible and not search.stop.visible
    optimum = viewer.session.run.catalogue.peak("drive.A.torque")
    viewer.session.reset()
    assert viewer.session.wait()
    change = viewer.session.change

    def stopped(key, draft):
        search.close()
        change(key, draft)

    monkeypatch.setattr(viewer.session, "change", stopped)
    monkeypatch.setattr("mechviz.outputs.viewer.panels.designs.LOOK_INTERVAL", 0.0)
    search.begin()
    search.thread.join()
    assert viewer.session.wait() and "Stopped" in search.report.content
    start = run_scene(load("parametric-press"), frames=24).catalogue.peak("drive.A.torque")
    assert optimum < viewer.session.run.catalogue.peak("drive.A.torque") < start


def test_the_best_design_is_shown_in_the_end_whatever_others_did_meanwhile(viewer):
    """Another browser undoes the best design, which is not found again, or edits what the search does not vary."""
    search, session, best = viewer.inspector.optimiser, viewer.session, np.array([75.0, 5.0])
    session.reset()
    assert session.wait()
    problem = problem_of(session.run.scene)
    search._take(problem, best)
    assert session.wait() and values(viewer, "stroke", "ratio") == pytest.approx([0.075, 5.0])
    session.undo()
    assert session.wait() and values(viewer, "stroke") == pytest.approx([0.08])
    search._take(problem, best, last=True)
    assert session.wait() and values(viewer, "stroke", "ratio") == pytest.approx([0.075, 5.0])
    steps = len(session.history._drafts)
    search._take(problem, best, last=True)
    assert session.wait() and len(session.history._drafts) == steps and not search._edited(problem)
    session.change("speed", lambda draft: draft.changed({("joints", "A", "drive", "speed"): "90 rpm"}))
    assert search._edited(problem)
    session.reset()
    assert session.wait()


@pytest.mark.thorough
@pytest.mark.browser
def test_designs_and_bands_are_asked_for_in_the_page(viewer, browser, monkeypatch):
    """Each control of the tab, and the tolerance band of plots."""
    viewer.inspector.study.design.value = 0  # other tests choose one
    assert viewer.session.wait()
    viewer.session.reset()
    assert viewer.session.wait(until_idle=True)
    page = open_viewer(browser, viewer, SIZE, [link_path(viewer.run.motion.mechanism.links[1].name)])
    chart, search, plots = viewer.inspector.study, viewer.inspector.optimiser, viewer.plots

    def choose(label, option):
        page.get_by_label(label, exact=True).click()
        page.get_by_role("option", name=option, exact=True).click()
        heard(viewer)

    def type_at(label, value):
        uuid = page.locator("label", has_text=label).first.get_attribute("for")
        page.locator(f'[id="{uuid}"] ~ div input').fill(value)

    slot = plots.slots[0]
    plots.choose(slot, "joint S: displacement [mm]")
    wide = np.ptp(slot.chart.data[2])
    choose("Tolerance band", "100 times")
    until(page, lambda: np.ptp(slot.chart.data[2]) > wide + 1.0, "a wider band")
    open_tab(page, "Designs")
    drawn = chart.chart.content
    choose("Across", "peak [N m]")
    choose("Upwards", "stroke [mm]")
    until(page, lambda: chart.chart.content == scatter(np.array([90.0, np.nan, 110.0]), STROKES, ("peak [N m]", "stroke [mm]"), 0,
                                                       chart.design._impl.uuid) != drawn, "the axes change places")  # fmt: skip
    type_at("Design", "2")
    until(page, lambda: viewer.session.wait() and values(viewer, "stroke") == pytest.approx([0.09]), "the last design")
    type_at("Seed", "7")
    until(page, lambda: search.seed.value == 7, "another seed")
    monkeypatch.setattr(designs, "optimise", lambda sought: search._stopped.wait(PATIENCE) and optimise(sought))  # it takes long
    page.get_by_role("button", name="Optimise", exact=True).click()
    page.get_by_role("button", name="Stop and keep the best").click()
    until(page, lambda: not search.stop.visible, "it has stopped")
    search.thread.join()
    page.get_by_text("designs were looked at").wait_for()
    page.close()


@pytest.mark.thorough
@pytest.mark.browser
def test_two_designs_lie_over_each_other_in_the_page(browser):
    """`view A B`: the second stands pale behind the first from the start, its curve beside; a box takes both away."""
    longer = run_scene(load("parametric-press").with_parameters({"stroke": "110 mm"}), frames=24)
    with Viewer(run_scene(load("parametric-press"), frames=24), port=0, compared={"longer": longer}) as shown:
        shown.pause()
        shown.set_frame(6)
        page = open_viewer(browser, shown, SIZE, [link_path("ram")])
        slot = shown.plots.slots[0]
        shown.plots.choose(slot, "joint S: displacement [mm]")
        page.wait_for_function(SEEN, arg="/beside_1/ram")
        x, y, _ = longer.motion.pose("ram")[6]
        until(page, lambda: np.allclose(page.evaluate(POSE, "/beside_1/ram")[4:6], [x, y], atol=1e-4), "where the other design is")
        page.get_by_text("longer 275 mm").first.wait_for()  # the peak of its curve
        open_tab(page, "View")
        page.get_by_label("Compare with longer", exact=True).uncheck()
        until(page, lambda: not page.evaluate(SEEN, "/beside_1/ram"), "gone")
        until(page, lambda: page.get_by_text("longer 275 mm").count() == 0, "its curve too")
        page.close()
