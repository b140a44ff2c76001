"""Editing, looking closer, effects and saving in a real browser: controls are used as a person would."""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsers import browser
from browsing import (
    CANVAS,
    PLACE,
    POSE,
    POSES,
    READY,
    SEEN,
    camera_rests,
    caught_up,
    heard,
    next_frames,
    open_tab,
    open_viewer,
    picture,
    reload,
    until,
)
from live_scenes import BOUNCING
from patience import PATIENCE

from mechviz import scene
from mechviz.outputs.viewer import app
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.panels import accuracy as accuracy_tab
from mechviz.outputs.viewer.viser_adapter import uuid_of
from mechviz.outputs.viewer.world.arrows import arrows_by_family
from mechviz.outputs.viewer.world.camera import VIEW_PRESETS
from mechviz.outputs.viewer.world.labels import SUBSCRIPT_SIZE, typeset
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.picture.build import solids_of
from mechviz.picture.nodes import Body
from mechviz.runs import run_scene
from mechviz.scene.scene import load, loads
from mechviz.studies import precision
from mechviz.studies.cost import WallTime

__all__ = ["browser"]  # a fixture

pytestmark = pytest.mark.browser

SIZE = {"width": 1040, "height": 650}  # a picture costs by its pixels; less leaves panels no room beside each other
LINKS = ("crank", "coupler", "rocker")
NODES = [link_path(link) for link in LINKS]
CRANK = "crank A–B [m]"
EXTENT = """name => { const mesh = window.__viserMutable.nodeRefFromName[name]; let low = 1e9, high = -1e9;
    mesh.traverse(o => { const p = o.geometry && o.geometry.attributes.position; if (!p) return;
        for (let k = 0; k < p.count; k++) { low = Math.min(low, p.getX(k)); high = Math.max(high, p.getX(k)); } });
    return high - low; }"""
NAMELESS = """() => [...document.querySelectorAll('button, input:not([type=hidden]), [role=slider], [role=tab], svg[role=img]')]
    .filter(e => e.tagName === 'svg' || e.offsetParent !== null)
    .filter(e => !(e.getAttribute('aria-label') || e.getAttribute('title') || e.textContent.trim()))
    .filter(e => !(e.labels && e.labels.length))
    .map(e => e.outerHTML.slice(0, 250))"""
# Where a place of the scene is on the page; viser turns the scene in its own world
PROJECTED = """([x, y, z]) => { const m = window.__viserMutable, r = m.canvas.getBoundingClientRect();
    const p = new m.camera.position.constructor(x, y, z).applyMatrix4(m.nodeRefFromName['/joints'].matrixWorld).project(m.camera);
    return [r.left + (p.x + 1) / 2 * r.width, r.top + (1 - p.y) / 2 * r.height]; }"""
BOTH = f"([node, at]) => [({PLACE})(node), ({PROJECTED})(at)]"
FOV = "() => window.__viserMutable.camera.fov"
# Whether plates of labels that are drawn are dark
PLATES = """() => { const own = window.__viserMutable.scene.__r3f, found = new Set();
    (own.root || own).getState().scene.traverse(o => { const shader = o.isMesh && o.material.fragmentShader;
        if (shader && shader.includes('0.85 * vAlpha') && o.geometry.instanceCount) found.add(!shader.includes('1.0, 1.0')); });
    return [...found]; }"""
# From where to where below the line a text reaches, as it is drawn and as it is measured, and how wide it is
ROWS = """text => { const canvas = Object.assign(document.createElement('canvas'), { width: 200, height: 200 });
    const g = canvas.getContext('2d'), rows = new Set();
    g.font = '80px sans-serif';
    g.fillText(text, 20, 100);
    g.getImageData(0, 0, 200, 200).data.forEach((v, k) => { if (k % 4 === 3 && v > 128) rows.add(Math.floor(k / 800)); });
    const { actualBoundingBoxAscent: up, actualBoundingBoxDescent: down, width } = g.measureText(text);
    return [Math.min(...rows) - 100, Math.max(...rows) - 99, -up, down, width]; }"""
DATA = "uuid => Array.from(window.__viserTestpoints.uplots[uuid].chart.data[1])"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("saved")


@pytest.fixture(scope="module")
def viewer(browser, folder) -> Iterator[Viewer]:
    with Viewer(run_scene(scene.load("kinetostatic-four-bar")), port=0, folder=folder) as shown:
        yield shown


@pytest.fixture(scope="module")
def errors() -> list[str]:
    return []


@pytest.fixture(scope="module")
def page(browser, viewer, errors) -> Iterator[Any]:
    opened = open_viewer(browser, viewer, SIZE, NODES)
    opened.on("pageerror", lambda error: errors.append(str(error)))
    yield opened
    opened.close()


@pytest.fixture(autouse=True)
def as_opened(viewer, page) -> None:
    """Every test starts with the scene as opened, at a frame with large forces; solids are made anew when nothing moves any more,
    and the camera follows."""
    viewer.session.reset()
    assert viewer.session.wait(until_idle=True)
    viewer.set_frame(300)
    open_tab(page, "Edit")
    open_tab(page, "Plots")
    _until_drawn(viewer, page)


def _type(page: Any, label: str, value: str) -> None:
    """Type a value beside a slider."""
    uuid = page.locator("label", has_text=label).first.get_attribute("for")
    page.locator(f'[id="{uuid}"] ~ div input').fill(value)


def _drawn(viewer: Viewer, page: Any) -> bool:
    x, y, angle = np.array([viewer.run.motion.pose(link)[viewer.frame] for link in LINKS]).T
    zero = np.zeros(len(LINKS))
    wanted = np.column_stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2), x, y, zero])
    return bool(np.abs(np.array(page.evaluate(POSES, NODES)) - wanted).max() < 1e-3)


def _width(viewer: Viewer) -> float:
    """Extent along x of the crank's own solid, which follows the stretched one when a slider rests."""
    return float(np.ptp(solids_of(viewer.run).links["crank"].mesh.vertices[:, 0]))


def _until_drawn(viewer: Viewer, page: Any) -> None:
    """Until the run is there as it is now, and nothing else is on its way."""
    assert viewer.session.wait()
    caught_up(viewer, page)
    until(page, lambda: _drawn(viewer, page), "poses in the browser")


def test_a_typed_length_changes_solids_poses_plots_and_forces(viewer, page, errors):
    peak = np.abs(viewer.run.forces.effort("A")).max()
    before = page.evaluate(EXTENT, NODES[0])
    _type(page, CRANK, "0.12")
    until(page, lambda: viewer.run.motion.mechanism.links[1].points["B"][0] == pytest.approx(0.12), "solved")
    _until_drawn(viewer, page)
    assert _width(viewer) > before + 0.015
    until(page, lambda: page.evaluate(EXTENT, NODES[0]) == pytest.approx(_width(viewer), abs=1e-4), "a longer crank")
    assert np.abs(viewer.run.forces.effort("A")).max() != pytest.approx(peak, rel=1e-3)
    uuid = uuid_of(viewer.plots.slots[0].chart)
    largest = np.abs(viewer.run.forces.effort("A")).max()
    until(page, lambda: np.abs(page.evaluate(DATA, uuid)).max() == pytest.approx(largest), "the new torque in the plot")
    assert not errors


def test_dragging_a_slider_solves_on_the_way_and_ends_at_its_value(viewer, page):
    uuid = page.locator("label", has_text=CRANK).first.get_attribute("for")
    thumb = page.locator(f'[id="{uuid}"] [role=slider]').bounding_box()
    x, y = thumb["x"] + thumb["width"] / 2, thumb["y"] + thumb["height"] / 2
    slider = viewer.inspector.controls.sliders["links.crank.points.B[0]"]

    def length() -> float:
        return viewer.run.motion.mechanism.links[1].points["B"][0]

    page.mouse.move(x, y)
    page.mouse.down()
    try:
        for k in range(1, 5):  # each step is solved before the next one is made: the button is down all the time
            before = length()
            page.mouse.move(x + 4 * k, y)
            until(page, lambda before=before: length() > before, "solved while it is dragged")
    finally:
        page.mouse.up()
    until(page, lambda: slider.value > 0.105 and length() == pytest.approx(slider.value), "the last value")
    _until_drawn(viewer, page)


def test_undo_redo_and_reset(viewer, page):
    def length() -> float:
        return viewer.run.motion.mechanism.links[1].points["B"][0]

    _type(page, CRANK, "0.12")
    until(page, lambda: length() == pytest.approx(0.12), "0.12")
    for button, wanted in (("↶ Undo", 0.1), ("Redo ↷", 0.12), ("Reset", 0.1), ("↶ Undo", 0.12)):
        page.get_by_role("button", name=button, exact=True).click()
        until(page, lambda wanted=wanted: length() == pytest.approx(wanted), f"{button} to {wanted}")
        uuid = page.locator("label", has_text=CRANK).first.get_attribute("for")
        box = page.locator(f'[id="{uuid}"] ~ div input')
        until(page, lambda wanted=wanted, box=box: float(box.input_value()) == pytest.approx(wanted), "the slider follows")


def test_a_length_that_cannot_be_assembled_is_told_in_place_with_its_range(viewer, page):
    shown = viewer.run
    _type(page, CRANK, "0.9")
    page.get_by_role("alert").filter(has_text="Reachable: 0.02 m to 0.83 m").first.wait_for()
    assert page.get_by_role("alert").filter(has_text="cannot be assembled").count() == 1, "at its slider"
    assert viewer.run is shown
    _until_drawn(viewer, page)
    uuid = page.locator("label", has_text=CRANK).first.get_attribute("for")
    box = page.locator(f'[id="{uuid}"] ~ div input')
    until(page, lambda: float(box.input_value()) == pytest.approx(0.1), "the slider goes back to what is shown")
    _type(page, CRANK, "0.11")
    until(page, lambda: viewer.run is not shown, "solved again")
    until(page, lambda: page.get_by_role("alert").count() == 0, "the fault is gone")


def test_a_crank_that_cannot_turn_any_more_swings(viewer, page):
    """Across Grashof's limit, 0.23 m: as far as it can go and back; on the near side it turns again."""
    told = page.get_by_role("status").filter(has_text="Drive A runs as far as it can go and back")
    _type(page, CRANK, "0.24")
    told.wait_for()
    assert page.get_by_role("alert").count() == 0
    _until_drawn(viewer, page)
    q = viewer.run.motion.drives[0][0]
    assert 0.5 < np.ptp(q) < 2.0 * np.pi and q[-1] == pytest.approx(q[0])
    _type(page, CRANK, "0.11")
    told.wait_for(state="detached")
    assert np.ptp(viewer.run.motion.drives[0][0]) == pytest.approx(2.0 * np.pi)


def test_effects_are_switched_and_weighed(viewer, page):
    open_tab(page, "Effects")
    page.get_by_label("inertia", exact=True).uncheck()
    until(page, lambda: viewer.run.scene.effects == (), "no inertia")
    open_tab(page, "View")
    page.get_by_label("Reactions", exact=True).wait_for()
    until(page, lambda: not page.get_by_label("Inertia", exact=True).is_visible(), "no arrows of inertia to be had")
    open_tab(page, "Effects")
    caught_up(viewer, page)  # nothing is on its way that would put the box back under the pointer
    page.get_by_label("inertia", exact=True).check()
    until(page, lambda: viewer.run.scene.effects == ("inertia",), "inertia")
    caught_up(viewer, page)
    page.get_by_label("P", exact=True).uncheck()
    until(page, lambda: not viewer.run.scene.document.loads, "no load")
    caught_up(viewer, page)
    page.get_by_label("P", exact=True).check()
    until(page, lambda: "P" in viewer.run.scene.document.loads, "the load with its values")
    assert viewer.run.scene == viewer.session.history.opened.scene()
    peak = np.abs(viewer.run.forces.effort("A")).max()
    page.locator("tr", has_text="inertia").filter(has_text="N m").filter(has_text="ms").first.wait_for()
    assert peak > 0.0
    page.get_by_text("pure kinematics").wait_for(state="detached")
    boxes = page.get_by_role("img", name="Analysis plan").locator("g")
    label_and_state = "gs => gs.map(g => [g.querySelector('title').textContent.split(':')[0], g.dataset.on])"
    wanted = {"inertia": "1", "P": "1", "gravity": "0"}  # the plan follows at most a moment after the picture
    until(page, lambda: wanted.items() <= dict(boxes.evaluate_all(label_and_state)).items(), "the plan with inertia and the load")
    assert boxes.count() == 10
    assert viewer.session.wait(until_idle=True)
    viewer.inspector.effects.table.content = ""
    row = page.locator("tr", has_text="inertia").filter(has_text="N m").filter(has_text="ms")
    until(page, lambda: row.count() == 0, "no table")
    page.get_by_role("button", name="Weigh the effects").click()
    row.first.wait_for()


@pytest.mark.thorough
def test_a_click_on_a_setting_in_the_diagram_of_accuracy_applies_it(viewer, page, monkeypatch):
    monkeypatch.setattr(precision, "FRAMES", (40, 90))
    monkeypatch.setattr(precision, "time_repeatedly", lambda work, *_, **__: (work(), WallTime(1e-3 * next(count), 0.0, 1))[1])
    monkeypatch.setattr(accuracy_tab, "SHOWN_SETTINGS", ("frames",))
    count = itertools.count(1)
    open_tab(page, "Accuracy")
    tab = viewer.inspector.accuracy
    page.get_by_role("button", name="Measure what accuracy costs").click()
    until(page, lambda: len(tab.choice.options) > 1, "settings")
    tab.wait()
    caught_up(viewer, page)
    page.locator("g[id^=setting]").filter(has_text="quintics, 90 frames").dispatch_event("click")
    heard(viewer)
    assert tab.choice.value.startswith("frames: quintics, 90 frames")
    assert viewer.session.wait()
    assert viewer.run.scene.frames == 90 and viewer.run.accuracy.interpolation == 5
    _choose(page, "Setting", next(name for name in tab.choice.options if name.startswith("frames: ") and "40 frames" in name))
    until(page, lambda: viewer.session.wait() and viewer.run.scene.frames == 40, "chosen from the list")
    wanted = next(name for name, error in accuracy_tab.TARGET_CHOICES.items() if error not in (None, viewer.run.accuracy.target))
    _choose(page, "Wanted error", wanted)
    until(
        page, lambda: viewer.session.wait() and viewer.run.accuracy.target == accuracy_tab.TARGET_CHOICES[wanted], "another error"
    )


def _choose(page: Any, label: str, option: str) -> None:
    """Choose from a list."""
    page.get_by_label(label, exact=True).click()
    page.get_by_role("option", name=option, exact=True).click()


def test_plots_are_added_joined_saved_and_removed(viewer, page):
    plots, count = viewer.plots, len(viewer.plots.slots)
    page.get_by_role("button", name="Add a plot").click()
    until(page, lambda: len(plots.slots) == count + 1, "one more")
    slot = plots.slots[-1]
    label = f"Plot {plots._made}"
    _choose(page, label, "joint A: reaction [N]")
    until(page, lambda: slot.quantity.parts[0].key == "joint.A.reaction", "another quantity")
    page.get_by_label("with", exact=True).last.click()
    page.get_by_role("option", name="joint B: reaction [N]", exact=True).click()
    until(page, lambda: len(slot.quantity.parts) == 2, "two quantities")
    for kind, start in (("CSV", plots._axis.title.encode()), ("SVG", b"<?xml"), ("PNG", b"\x89PNG")):
        with page.expect_download() as saved:
            page.get_by_role("button", name=kind, exact=True).last.click()
        assert saved.value.suggested_filename.endswith(f".{kind.lower()}")
        assert Path(saved.value.path()).read_bytes().startswith(start)
    page.get_by_role("button", name="Remove", exact=True).last.click()
    until(page, lambda: len(plots.slots) == count and slot not in plots.slots, "one less")


def test_the_other_assembly_is_chosen_from_a_list(viewer, page):
    before = viewer.run.motion.pose("rocker")[0, 2]
    folder = page.get_by_text("Assembly", exact=True)
    folder.click()
    page.get_by_label("D side", exact=True).click()
    page.get_by_role("option", name="right", exact=True).click()
    until(page, lambda: viewer.run.scene.document.joints["D"].side == "right", "the other side")
    assert abs(viewer.run.motion.pose("rocker")[0, 2] - before) > 0.5
    _until_drawn(viewer, page)
    folder.click()


def test_a_click_on_a_link_and_a_joint_opens_their_values(viewer, page):
    _click(page, viewer, viewer.run.motion.point("coupler", "B")[300] * 0.5 + viewer.run.motion.point("coupler", "D")[300] * 0.5)
    until(page, lambda: viewer.inspector.detail.item == "link coupler", "the coupler")
    tab = page.get_by_role("tab", name="Look closer", exact=True)
    until(page, lambda: tab.get_attribute("aria-selected") == "true", "its tab has opened")
    row = page.locator("tr", has_text="angular velocity").first
    wanted = viewer.run.motion.velocity("coupler")[300, 2]
    until(page, lambda: f"{wanted:.5g}".replace("-", "−") in row.inner_text(), "its angular velocity")
    page.get_by_label("Look at").click()
    page.get_by_role("option", name="joint B", exact=True).click()
    until(page, lambda: viewer.inspector.detail.item == "joint B", "chosen with the keyboard or mouse")
    force = np.hypot(*viewer.run.forces.reaction("B")[300, :2])
    until(page, lambda: f"{force:.5g}" in page.locator("tr", has_text="reaction").first.inner_text(), "its reaction")
    assert viewer.inspector.detail.slot.quantity.label == "joint B: reaction"


def test_a_point_that_is_clicked_is_traced(viewer, page):
    open_tab(page, "Look closer")
    page.get_by_label("Trace the point that I click").check()
    middle = 0.5 * (viewer.run.motion.point("coupler", "B")[300] + viewer.run.motion.point("coupler", "D")[300])
    _click(page, viewer, middle)
    until(page, lambda: viewer.run.motion.mechanism.traced == (("coupler", "T1"),), "traced")
    page.wait_for_function(SEEN, arg="/paths/coupler.T1")
    computed = viewer.run.motion.point("coupler", "T1")[300]
    assert np.abs(computed - middle).max() < 0.02 * viewer.scene.size
    page.get_by_label("Trace the point that I click").uncheck()


def test_the_scene_as_opened_stands_behind_as_a_ghost(viewer, page):
    _type(page, CRANK, "0.13")
    page.get_by_label("Compare with the scene as opened").check()
    page.wait_for_function(SEEN, arg="/beside_0/crank")
    x, y, _ = viewer.session.opened.poses["coupler"][300]
    until(page, lambda: np.allclose(page.evaluate(POSE, "/beside_0/coupler")[4:6], [x, y], atol=1e-4), "as it was opened")
    page.get_by_label("Compare with the scene as opened").uncheck()
    until(page, lambda: not page.evaluate(SEEN, "/beside_0/crank"), "gone")


def test_a_pivot_is_dragged_and_everything_follows(viewer, page):
    page.get_by_label("Drag pivots").check()
    page.wait_for_function(SEEN, arg="/pivots/E")
    open_tab(page, "View")
    page.get_by_role("button", name="Front", exact=True).click()  # the arrow of the handle is as long as the view says
    open_tab(page, "Edit")
    heard(viewer)
    camera_rests(page)
    tries = itertools.count(3)
    until(page, lambda: _dragged_right(page, viewer, next(tries)) > 0.285, "the pivot has moved")
    assert viewer.run.motion.mechanism.links[0].points["E"][1] == pytest.approx(0.0, abs=1e-3)
    _until_drawn(viewer, page)
    page.get_by_label("Drag pivots").uncheck()


TOLD = "() => { const b = document.getElementById('mechviz-hover'); return b.style.display === 'none' ? '' : b.innerText; }"
BESIDE = "() => [...document.getElementById('mechviz-values').children].map(plate => plate.textContent)"


def test_arrows_tell_their_values_at_the_pointer_and_beside_them_when_asked(viewer, page):
    view_model, forces = viewer.inspector.view_model, viewer.run.forces
    reactions = [arrow.vector.item for arrow in arrows_by_family(view_model)["reaction"]]

    def told(joint: str, digits: int) -> str:
        return f"{float(f'{np.hypot(*forces.reaction(joint)[viewer.frame, :2]):.{digits}g}'):g} N"

    ends = viewer.scene.arrows.points("reaction", viewer.frame)
    assert len(ends) == len(reactions), "all are drawn"
    at = ends[reactions.index("D")].astype(float)
    page.mouse.move(*page.evaluate(PROJECTED, (0.2 * at[0] + 0.8 * at[1]).tolist()))
    until(page, lambda: page.evaluate(TOLD).split("\n")[0] == f"Reactions: D, {told('D', 5)}", "the arrow with its value")
    open_tab(page, "View")
    page.get_by_label("Values beside arrows", exact=True).check()
    for frame in (300, 320):
        viewer.set_frame(frame)
        torque = float(f"{forces.effort('A')[frame]:.4g}")
        wanted = {f"{joint}: {told(joint, 4)}" for joint in reactions} | {f"A: {torque:g} N m".replace("-", "−")}
        until(page, lambda wanted=wanted: wanted <= set(page.evaluate(BESIDE)), f"values at frame {frame}")
    page.get_by_label("Reactions", exact=True).uncheck()
    until(
        page, lambda: not [text for text in page.evaluate(BESIDE) if text.endswith(" N") and text[0] in "BDE"], "none of reactions"
    )
    page.get_by_label("Reactions", exact=True).check()
    page.get_by_label("Values beside arrows", exact=True).uncheck()
    until(page, lambda: not viewer.inspector.values.value, "heard")
    page.wait_for_function("() => document.getElementById('mechviz-values').style.display === 'none'")


def test_cameras_2d_and_dark(viewer, page):
    client = next(iter(viewer.server.get_clients().values()))
    open_tab(page, "View")
    page.get_by_role("button", name="2D", exact=True).click()
    until(
        page, lambda: page.evaluate("() => window.__viserMutable.camera.fov") == pytest.approx(1.5, abs=0.01), "nearly orthographic"
    )
    turned = "() => window.__viserMutable.camera.getWorldDirection(window.__viserMutable.camera.position.clone()).toArray()"
    until(page, lambda: abs(abs(page.evaluate(turned)[2]) - 1.0) < 1e-4, "straight on")
    page.get_by_role("button", name="Angled", exact=True).click()
    until(page, lambda: page.evaluate(FOV) == pytest.approx(18.0, abs=0.1), "in space again")
    for button, preset in (("Isometric", "isometric"), ("Top", "top"), ("Side", "side"), ("Behind", "behind"), ("Front", "front")):
        page.get_by_role("button", name=button, exact=True).click()
        away = np.array(VIEW_PRESETS[preset].direction) * [-1.0, 1.0, -1.0]  # viser turns the scene by half a turn about y
        until(page, lambda a=away: np.allclose(page.evaluate(turned), -a / np.linalg.norm(a), atol=1e-3), f"from {button}")
    assert client.client_id in viewer.server.get_clients()
    bright = picture(page).mean()
    page.get_by_label("Dark page").check()
    until(page, lambda: picture(page).mean() < 0.6 * bright, "a dark picture")
    until(page, lambda: page.evaluate(PLATES) == [True], "dark plates below the names of joints")
    page.get_by_label("Dark page").uncheck()
    until(page, lambda: page.evaluate(PLATES) == [False], "light ones again")
    until(page, lambda: picture(page).mean() > 0.9 * bright, "a light picture")


def test_letters_below_the_line_are_smaller_and_lower(page):
    """As the page draws them for the labels of the scene."""
    above, line, _, _, width = page.evaluate(ROWS, "B")
    top, bottom, ascent, descent, narrow = page.evaluate(ROWS, typeset("a_B").removeprefix("a"))
    assert (
        line == pytest.approx(0, abs=1)
        and 10 <= bottom <= 22
        and bottom - top == pytest.approx(SUBSCRIPT_SIZE * (line - above), abs=2)
    )
    assert (top, bottom) == pytest.approx((ascent, descent), abs=2) and narrow == pytest.approx(SUBSCRIPT_SIZE * width, rel=0.03)
    assert page.evaluate(ROWS, typeset("a_B"))[4] == pytest.approx(narrow + page.evaluate(ROWS, "a")[4], rel=0.02)


def test_marks_lie_at_their_joints_and_the_mechanism_fills_the_picture(viewer, page):
    """In every view: the dot of a joint is at the front of its pin, and all solids are within, and large."""
    open_tab(page, "View")
    view_model = viewer.scene.current
    for label in [preset.label for preset in VIEW_PRESETS.values()][::-1]:
        page.get_by_role("button", name=label, exact=True).click()
        heard(viewer)
        caught_up(viewer, page)
        camera_rests(page)
        for joint in ("A", "B", "D", "E"):
            at = [*viewer.run.motion.joint_position(joint)[viewer.frame], 0.0]
            at[2] = max(
                _front(body, view_model.poses[body.parent][viewer.frame], at)
                for body in view_model.picture.nodes_of(Body, "solids")
            )

            def miss(dot: str = f"/joints/{joint}/dot", at: list[float] = at) -> float:
                drawn, wanted = page.evaluate(BOTH, [dot, at])  # of one picture: the camera may still be fitted
                return float(np.hypot(*np.subtract(drawn, wanted)))

            until(page, lambda miss=miss: miss() < 2.0, f"{joint} at its joint, {label}")
        corners = np.array(np.meshgrid(*view_model.bounds.T)).reshape(3, -1).T

        def filled(corners: np.ndarray = corners) -> bool:
            left, top, width, height = page.evaluate(CANVAS)
            spots = (np.array([page.evaluate(PROJECTED, corner.tolist()) for corner in corners]) - [left, top]) / [width, height]
            return bool((spots > 0.0).all() and (spots < 1.0).all() and np.ptp(spots, axis=0).max() > 2.0 / 3.0)

        until(page, filled, f"all of it, and large, {label}")


def _front(body: Body, pose: np.ndarray, at: list[float]) -> float:
    """The greatest height [m] of what a solid has around a joint."""
    x, y, angle = pose
    world = (body.mesh.vertices[:, 0] + 1j * body.mesh.vertices[:, 1]) * np.exp(1j * angle) + complex(x, y)
    return float(body.mesh.vertices[np.abs(world - complex(at[0], at[1])) < 0.01, 2].max(initial=-np.inf))


def test_links_become_transparent(viewer, page):
    open_tab(page, "View")
    uuid = page.locator("label", has_text="Opacity of links").first.get_attribute("for")
    page.locator(f'[id="{uuid}"] ~ div input').fill("0.3")
    until(page, lambda: viewer.server.scene.get_handle_by_name(f"{NODES[0]}/part_0").opacity == pytest.approx(0.3), "transparent")
    page.locator(f'[id="{uuid}"] ~ div input').fill("1")
    until(page, lambda: viewer.server.scene.get_handle_by_name(f"{NODES[0]}/part_0").opacity is None, "solid")


def test_a_section_cuts_the_front_away(viewer, page):
    open_tab(page, "View")
    depth = "name => { let z = -1e9; window.__viserMutable.nodeRefFromName[name].traverse(o => { const p = o.geometry && "
    depth += "o.geometry.attributes.position; if (p) for (let k = 0; k < p.count; k++) z = Math.max(z, p.getZ(k)); }); return z; }"
    assert viewer.session.wait(until_idle=True)  # the solids of this scene, not stretched ones of what an edit before it has made
    caught_up(viewer, page)
    before = max(page.evaluate(depth, node) for node in NODES)
    uuid = page.locator("label", has_text="Section").first.get_attribute("for")
    page.locator(f'[id="{uuid}"] ~ div input').fill("60")
    low, high = viewer.scene.current.bounds[:, 2]
    wanted = high - 0.6 * (high - low)
    until(page, lambda: max(page.evaluate(depth, node) for node in NODES) < wanted + 1e-6 < before, "cut")
    page.locator(f'[id="{uuid}"] ~ div input').fill("0")
    until(page, lambda: max(page.evaluate(depth, node) for node in NODES) == pytest.approx(before), "whole again")


def test_a_scene_is_saved_and_never_replaced_untold(viewer, page, folder):
    _type(page, CRANK, "0.12")
    until(page, lambda: viewer.run.motion.mechanism.links[1].points["B"][0] == pytest.approx(0.12), "edited")
    target = folder / "mine.toml"
    page.get_by_role("button", name="Scene", exact=True).click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("button", name="Cancel", exact=True).click()
    dialog.wait_for(state="hidden")
    assert not list(folder.glob("*mine.toml"))
    page.get_by_role("button", name="Scene", exact=True).click()
    dialog.get_by_label("Name of the file").fill("../mine")
    dialog.get_by_role("button", name="Save", exact=True).click()
    until(page, lambda: (folder / "_mine.toml").exists() or target.exists(), "saved in the folder and nowhere else")
    saved = next(iter(folder.glob("*mine.toml")))
    assert load(saved) == viewer.run.scene
    text = saved.read_text()
    _type(page, CRANK, "0.11")
    until(page, lambda: viewer.run.motion.mechanism.links[1].points["B"][0] == pytest.approx(0.11), "edited again")
    page.get_by_role("button", name="Scene", exact=True).click()
    dialog.get_by_role("textbox").fill(saved.name)
    dialog.get_by_role("button", name="Save", exact=True).click()
    dialog.get_by_text("is there already").wait_for()
    assert saved.read_text() == text
    other = folder / "other.toml"
    other.write_text(text)
    dialog.get_by_role("textbox").fill(other.name)
    dialog.get_by_role("button", name="Replace it").click()
    dialog.get_by_text("other.toml is there already").wait_for()
    assert other.read_text() == text, "it was asked about another file"
    dialog.get_by_role("textbox").fill(saved.name)
    dialog.get_by_role("button", name="Replace it").click()
    until(page, lambda: saved.read_text() != text, "replaced when told")
    assert load(saved) == viewer.run.scene


def test_a_recording_is_saved(viewer, page, folder):
    from mechviz.outputs.rerun.reader import Recording

    page.get_by_role("button", name="Recording", exact=True).click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("textbox").press("Escape")
    dialog.wait_for(state="hidden")
    page.get_by_role("button", name="Recording", exact=True).click()
    dialog.get_by_role("textbox").fill("run")
    dialog.get_by_role("button", name="Save", exact=True).click()
    until(page, lambda: (folder / "run.rrd").exists(), "recorded")
    viewer.inspector.saver.last.join(PATIENCE)
    _, poses = Recording(folder / "run.rrd").scalars("data", "links", "coupler", "pose")
    np.testing.assert_allclose(poses, viewer.run.motion.pose("coupler"), atol=1e-12)


def test_a_plan_is_asked_for_where_diagrams_are_shown_and_what_cannot_be_had_is_told(viewer, page):
    open_tab(page, "Diagrams")
    page.get_by_label("Velocity polygon", exact=True).check()
    until(page, lambda: viewer.run.scene.document.polygons == ["velocity"], "asked for")
    until(page, lambda: viewer.inspector.diagrams.choice.value == "Velocity polygon", "looked at")
    page.get_by_role("img", name="Velocity polygon", exact=True).wait_for()
    page.wait_for_function(SEEN, arg="/drawings/velocity")
    before = page.locator(".mechviz-diagram").inner_html()
    viewer.set_frame(200)
    until(page, lambda: page.locator(".mechviz-diagram").inner_html() != before, "it moves with the frame")
    page.get_by_label("Centrodes of coupler", exact=True).check()
    page.get_by_role("img", name="Centrodes of coupler", exact=True).wait_for()
    page.get_by_label("Sections of coupler", exact=True).click()
    until(
        page, lambda: any(q.key == "link.coupler.bending_moment" for q in viewer.inspector.view_model.quantities), "section forces"
    )
    page.get_by_label("Transmission angle", exact=True).click()
    until(page, lambda: any(q.key.startswith("transmission_angle.") for q in viewer.inspector.view_model.quantities), "an answer")
    page.get_by_label("Velocity polygon", exact=True).uncheck()
    until(page, lambda: viewer.run.scene.document.polygons == [], "no more")
    page.wait_for_function("name => !window.__viserMutable.nodeRefFromName[name]", arg="/drawings/velocity")
    open_tab(page, "Effects")
    box = page.get_by_label("friction", exact=True)
    box.click()  # no joint has a coefficient
    page.get_by_text("No joint has any friction that could act").first.wait_for(state="attached")
    until(page, lambda: not box.is_checked(), "the switch goes back")


@pytest.mark.thorough
def test_a_motion_grows_in_a_page_that_then_finds_a_cam_at_a_new_server(browser, folder, monkeypatch):
    """One page: the path of ``view --live``, a server that is started anew at the same address, and what belongs to cams."""
    shown, opened = _watch_it_grow(browser, folder, monkeypatch)
    try:
        opened.bring_to_front()
        with Viewer(run_scene(scene.load("cam-flat"), frames=90), port=shown.port, folder=folder) as second:
            opened.wait_for_function("title => document.title.startsWith(title)", arg="Disc cam with a flat-faced follower")
            opened.wait_for_function(READY, arg=["/mechanism/cam", "/mechanism/follower"])
            opened.get_by_role("button", name="Start", exact=True).click()
            until(opened, lambda: second.frame == 0, "the new server listens")
            _look_at_a_cam(opened, second)
    finally:
        opened.close()


def _watch_it_grow(browser: Any, folder: Any, monkeypatch: Any) -> tuple[Viewer, Any]:
    """A page in which a motion under forces grows. The computing is held halfway until the page has shown how far it is."""
    moving = loads(BOUNCING)
    go_on, stopped, viewers = threading.Event(), threading.Event(), []

    class Seen(Viewer):
        def __init__(self, *args: Any, **options: Any):
            super().__init__(*args, **options)
            viewers.append(self)

    def solve(observe: Any) -> Any:
        def held(stretch: Any, duration: float) -> None:
            observe(stretch, duration)
            if stretch.duration > 0.4 * duration:
                assert go_on.wait(PATIENCE)

        return run_scene(moving, observe=held)

    monkeypatch.setattr(app, "Viewer", Seen)
    monkeypatch.setattr(app, "_until_stopped", lambda: contextlib.nullcontext(stopped))
    serving = threading.Thread(target=app.serve_while, args=(solve, moving, 0, folder), daemon=True)
    serving.start()
    try:
        end = time.monotonic() + PATIENCE
        while not viewers:
            assert serving.is_alive() and time.monotonic() < end
            time.sleep(0.01)
        (shown,) = viewers
        opened = open_viewer(browser, shown, SIZE, ["/mechanism/bar"])
        progress = opened.locator(".mechviz-progress")
        progress.filter(has_text="Computing: ").wait_for()
        assert opened.get_by_role("tab", name="Edit", exact=True).count() == 0
        assert 1 <= shown.inspector.view_model.frames - 1 < moving.frames

        def drawn() -> bool:
            angle = shown.inspector.view_model.poses["bar"][shown.frame, 2]
            return bool(
                np.allclose(opened.evaluate(POSE, "/mechanism/bar")[:4], [np.cos(angle / 2), 0, 0, np.sin(angle / 2)], atol=1e-3)
            )

        until(opened, drawn, "its newest frame")
        go_on.set()
        opened.get_by_role("tab", name="Edit", exact=True).wait_for()
        until(opened, lambda: shown.inspector.view_model.frames == moving.frames + 1, "the whole motion")
        until(opened, lambda: progress.count() == 0 and shown.timeline.slider.max == moving.frames, "nothing is computed any more")
        shown.set_frame(moving.frames)
        until(opened, drawn, "its end")
        _type(opened, "O free position", "-60")
        until(opened, lambda: shown.run.motion.coordinate("O")[0, 0] == pytest.approx(np.radians(-60.0)), "edited")
    finally:
        go_on.set()
        stopped.set()
        serving.join(PATIENCE)
    assert not serving.is_alive()
    return shown, opened


def _look_at_a_cam(page: Any, viewer: Viewer) -> None:
    """Its values at a click, its diagrams, the least base circle, another law, a section."""
    open_tab(page, "View")
    page.get_by_role("button", name="Front", exact=True).click()
    open_tab(page, "Edit")
    caught_up(viewer, page)
    _click(page, viewer, np.array([0.0, -0.02]))
    until(page, lambda: viewer.inspector.detail.item == "cam K", "a click on the cam")
    row = page.locator("tr", has_text="contact force").first
    force = next(q for q in viewer.inspector.view_model.quantities if q.label == "cam K: contact force").values()[0, 0]
    until(page, lambda: f"{force:.5g}" in row.inner_text(), "its contact force")
    open_tab(page, "Diagrams")
    page.get_by_role("img", name="Pressure angle [°] of cam K", exact=True).wait_for()
    page.get_by_label("Diagram", exact=True).click()
    page.get_by_role("option", name="Curvature [1/m] of cam K", exact=True).click()
    page.get_by_role("img", name="Curvature [1/m] of cam K", exact=True).wait_for()
    _type(page, "K base [mm]", "8")
    page.get_by_role("alert").filter(has_text="undercut").filter(has_text="Reachable: 10.6").first.wait_for()
    page.get_by_label("K lift 1 law", exact=True).click()
    page.get_by_role("option", name="harmonic", exact=True).click()
    until(page, lambda: viewer.run.scene.document.joints["K"].profile.lift[0].law == "harmonic", "another law")
    until(page, lambda: page.get_by_role("alert").count() == 0, "all is well")
    assert viewer.session.wait(until_idle=True)
    whole = {piece.color for piece in viewer.inspector.view_model.bodies["cam"].pieces}
    (low, high), picture = viewer.inspector.view_model.bounds[:, 2], viewer.inspector.view_model.picture
    axis = next(node.height for node in picture.nodes if node.key == "spring.return_spring")
    open_tab(page, "View")
    _type(page, "Section", str(int(100.0 * (high - axis) / (high - low)) + 1))  # just behind the axis of the spring
    scene3d = viewer.inspector.scene
    until(page, lambda: {piece.color for piece in scene3d.links._drawn["cam"].pieces} - whole != set(), "a cut of another colour")
    until(page, lambda: not page.evaluate(SEEN, "/bodies/spring.return_spring"), "the spring before the cut is away")
    _type(page, "Section", "0")
    until(page, lambda: page.evaluate(SEEN, "/bodies/spring.return_spring"), "whole again")


def test_a_recording_plays_and_its_scene_can_be_edited(viewer, browser, folder):
    from mechviz.outputs.rerun.reader import Recording
    from mechviz.outputs.rerun.writer import write_recording

    write_recording(run_scene(scene.load("kinetostatic-four-bar"), frames=120), folder / "short.rrd")
    with Viewer(Recording(folder / "short.rrd"), port=0) as shown:
        opened = open_viewer(browser, shown, SIZE, NODES)
        try:
            assert opened.get_by_role("tab", name="Edit", exact=True).count() == 0
            open_tab(opened, "Diagrams")
            opened.get_by_role("img", name="Phase: velocity [rad/s] against angle [°], E", exact=True).wait_for()
            open_tab(opened, "About")
            opened.get_by_text("Kinetostatics of a four-bar").last.wait_for()
            open_tab(opened, "Plots")
            opened.get_by_role("button", name="Play", exact=True).click()
            until(opened, lambda: shown.player.is_remote, "played by the browser")
            opened.get_by_role("button", name="Pause", exact=True).click()
            until(opened, lambda: not shown.playing, "paused")
            opened.get_by_role("button", name="Edit this scene").click()
            opened.get_by_role("tab", name="Edit", exact=True).wait_for()
            until(
                opened,
                lambda: shown._session is not None and shown.run.motion.frames == 121,
                "the scene, solved as it was recorded",
            )
            _type(opened, CRANK, "0.12")
            until(opened, lambda: shown.run.motion.mechanism.links[1].points["B"][0] == pytest.approx(0.12), "edited")
            until(opened, lambda: _drawn(shown, opened), "drawn")
        finally:
            opened.close()


def test_who_comes_later_or_reloads_sees_what_has_been_made_of_the_scene(viewer, page):
    _type(page, CRANK, "0.125")
    until(page, lambda: viewer.run.motion.mechanism.links[1].points["B"][0] == pytest.approx(0.125), "edited")
    until(page, lambda: _drawn(viewer, page), "drawn")
    longer = _width(viewer)
    until(page, lambda: page.evaluate(EXTENT, NODES[0]) == pytest.approx(longer, abs=1e-4), "the longer crank")
    reload(page, NODES)
    _until_drawn(viewer, page)
    until(page, lambda: page.evaluate(EXTENT, NODES[0]) == pytest.approx(longer, abs=1e-4), "the longer crank after a reload")
    uuid = page.locator("label", has_text=CRANK).first.get_attribute("for")
    until(page, lambda: float(page.locator(f'[id="{uuid}"] ~ div input').input_value()) == pytest.approx(0.125), "its slider")
    until(page, lambda: len(viewer.server.get_clients()) == 1, "the old page has gone")


def test_a_fault_in_editing_is_told_and_survived(viewer, page, monkeypatch):
    def fail(*_: Any, **__: Any) -> None:
        raise RuntimeError("a test made this fail")

    monkeypatch.setattr("mechviz.outputs.viewer.session.view_model_of_run", fail)
    _type(page, CRANK, "0.115")
    page.get_by_text("RuntimeError: a test made this fail").first.wait_for(state="attached")
    monkeypatch.undo()
    uuid = page.locator("label", has_text=CRANK).first.get_attribute("for")
    box = page.locator(f'[id="{uuid}"] ~ div input')
    until(page, lambda: float(box.input_value()) == pytest.approx(0.1), "the slider goes back to what is shown")
    _type(page, CRANK, "0.116")
    until(page, lambda: viewer.run.motion.mechanism.links[1].points["B"][0] == pytest.approx(0.116), "the editor lives")
    _until_drawn(viewer, page)


def test_every_control_has_a_name(page):
    """For screen readers: each input, slider and list is labelled, each button says what it does."""
    for tab in ("Edit", "Effects", "View"):
        open_tab(page, tab)
        until(page, lambda: page.evaluate(NAMELESS) == [], f"a name for every control under {tab}")
    page.get_by_role("button", name="Search for a command").click()
    page.get_by_role("dialog", name="Search commands").wait_for()
    page.keyboard.press("Escape")
    page.get_by_role("dialog").wait_for(state="hidden")


def _dragged_right(page: Any, viewer: Viewer, frames: int) -> float:
    """Where pivot E is after a drag of its handle, which a camera that is fitted meanwhile takes from below the mouse; the page has
    ``frames`` of its frames to see the mouse on it."""
    x, y = _on_screen(page, viewer, np.array(viewer.run.motion.mechanism.links[0].points["E"]))
    page.mouse.move(x + 30, y)  # the arrow of the handle that points right
    next_frames(page, frames)
    page.mouse.down()
    for k in range(1, 8):
        page.mouse.move(x + 30 + 4 * k, y)
        next_frames(page, 2)
    page.mouse.up()
    heard(viewer)
    return viewer.run.motion.mechanism.links[0].points["E"][0]


def _on_screen(page: Any, viewer: Viewer, xy: np.ndarray) -> tuple[float, float]:
    """Where a place in front of the mechanism is on the page."""
    left, top, width, height = page.evaluate(CANVAS)
    z = viewer.scene.current.z_top
    next_frames(page)  # a camera that has been told where to be is there
    at = page.evaluate(
        """([x, y, z]) => { const m = window.__viserMutable; const root = m.nodeRefFromName[''];
            const v = m.camera.position.clone().set(x, y, z).applyMatrix4(root.matrixWorld).project(m.camera);
            return [v.x, v.y]; }""",
        [float(xy[0]), float(xy[1]), float(z)],
    )
    return left + width * (at[0] + 1.0) / 2.0, top + height * (1.0 - at[1]) / 2.0


def _click(page: Any, viewer: Viewer, xy: np.ndarray) -> None:
    x, y = _on_screen(page, viewer, xy)
    page.mouse.move(x, y)
    page.wait_for_function(
        "() => document.querySelector('canvas[data-engine]').style.cursor === 'pointer'"
    )  # the page sees that the mouse is on it
    page.mouse.click(x, y)
