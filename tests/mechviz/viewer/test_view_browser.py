"""The picture in a real browser on windows of many sizes: how much of it mechanisms fill, docks that fold, and a finger."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import browsing
import numpy as np
import pytest
from browsers import browser
from browsing import CAMERA, CANVAS, PLACE, camera_rests, caught_up, heard, next_frames, open_tab, open_viewer, picture, until
from filled import SCENES, arrows_box, solid_points
from shapely.geometry import MultiPoint

from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.viser_adapter import uuid_of
from mechviz.outputs.viewer.world.camera import fit_view
from mechviz.runs import run_scene
from mechviz.scene.scene import load
from recordings import ran, solids

__all__ = ["browser"]  # a fixture

pytestmark = pytest.mark.browser

WINDOWS = {"1600x1000": (1600, 1000), "1280x720": (1280, 720), "390x844": (390, 844)}
PHONE, TURNED = {"width": 390, "height": 844}, {"width": 844, "height": 390}
# The box around places of the scene in parts of the picture, from its middle to its edges -1 to 1
BOX = """places => { const m = window.__viserMutable, Vector3 = m.camera.position.constructor, box = [[9, 9], [-9, -9]];
    m.camera.updateMatrixWorld();
    for (const [x, y, z] of places) {
        const p = new Vector3(x, y, z).applyMatrix4(m.nodeRefFromName['/joints'].matrixWorld).project(m.camera);
        box[0] = [Math.min(box[0][0], p.x), Math.min(box[0][1], p.y)];
        box[1] = [Math.max(box[1][0], p.x), Math.max(box[1][1], p.y)]; }
    return box; }"""
WIDER, HIGHER = (f"least => window.__viserMutable.canvas.getBoundingClientRect().{side} > least" for side in ("width", "height"))
# Of the tabs of each dock name, left, top and right
TABS = """() => [...document.querySelectorAll('[role=tablist]')].map(list => [...list.querySelectorAll('[role=tab]')].map(tab => {
    const r = tab.getBoundingClientRect(); return [tab.textContent.trim(), r.left, Math.round(r.top), r.right]; }))"""
CURVES = "uuid => (window.__viserTestpoints.uplots[uuid]?.chart?.data ?? []).map(part => Array.from(part))"
TURN = "() => { const c = window.__viserMutable.camera; return c.getWorldDirection(c.position.clone()).toArray(); }"


@pytest.fixture(scope="module")
def viewer(browser) -> Iterator[Viewer]:
    with Viewer(ran(SCENES[0]), port=0) as shown:
        yield shown


@pytest.fixture(scope="module")
def page(browser, viewer) -> Iterator[Any]:
    """A phone's page, which hears fingers; its window takes other sizes."""
    opened = open_viewer(browser, viewer, PHONE, ["/joints/A/dot"], has_touch=True)
    yield opened
    opened.close()


def _until_fitted(page: Any, box: np.ndarray, core: np.ndarray, what: str) -> None:
    """Until the camera stands where it sees a box in the present window."""

    def fitted() -> bool:
        _, _, wide, high = page.evaluate(CANVAS)
        wanted = fit_view(box, wide / high, core=core).position
        now = np.array(page.evaluate(CAMERA)) * [-1.0, 1.0, -1.0]
        return bool(np.abs(now - wanted).max() < 5e-3 * np.linalg.norm(wanted))

    until(page, fitted, what)


def _settled(viewer: Viewer, page: Any) -> None:
    """Until the page has its size, and the camera rests where it sees everything."""
    heard(viewer)
    caught_up(viewer, page)
    _until_fitted(page, viewer.scene.bounds, viewer.scene.current.bounds, "everything")
    camera_rests(page, 20)


@pytest.mark.thorough
def test_mechanisms_fill_two_thirds_of_the_picture_and_nothing_is_cut_off(viewer, page):
    """Where the page's own camera has them, in windows of three sizes, each with a part of the scenes."""
    for k, (window, (width, height)) in enumerate(WINDOWS.items()):
        page.set_viewport_size({"width": width, "height": height})
        for name in SCENES[k :: len(WINDOWS)]:
            box, core = arrows_box(name), np.asarray(solids(name).bounds, float)
            viewer.scene.cameras.set_bounds(box, core)
            _until_fitted(page, box, core, f"{name} in {window}")
            low, high = np.array(page.evaluate(BOX, _rim(name)))
            assert max(-low.min(), high.max()) < 1.0, (name, window)
            assert (high - low).max() > 2.0 * 2.0 / 3.0, (name, window)
    viewer.scene.cameras.set_bounds(viewer.scene.bounds, viewer.scene.current.bounds)
    page.set_viewport_size(PHONE)
    _settled(viewer, page)


def _rim(name: str) -> list[list[float]]:
    """Of all places of solids over the run the outermost ones in front and behind."""
    points = solid_points(name)
    z = points[:, 2]
    rings = [MultiPoint(points[part][:, :2]).convex_hull.exterior.coords for part in (z <= np.median(z), z >= np.median(z))]
    return [[x, y, at] for ring, at in zip(rings, (z.min(), z.max()), strict=True) for x, y in ring]


def _fingers(page: Any, *steps: list[tuple[float, float]]) -> None:
    """Fingers that go down, move and go up: of each step all of them."""
    session = page.context.new_cdp_session(page)
    for k, step in enumerate(steps):
        points = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(step)]
        session.send("Input.dispatchTouchEvent", {"type": "touchMove" if k else "touchStart", "touchPoints": points})
        next_frames(page, 1)
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    session.detach()


def _middle(page: Any) -> tuple[float, float]:
    left, top, width, height = page.evaluate(CANVAS)
    return left + 0.5 * width, top + 0.5 * height


def test_a_finger_turns_the_view_and_two_come_nearer(viewer, page):
    _settled(viewer, page)
    x, y = _middle(page)
    before, far = np.array(page.evaluate(TURN)), np.linalg.norm(page.evaluate(CAMERA))
    _fingers(page, *([(x - 100.0 + 20.0 * k, y + 120.0)] for k in range(8)))
    until(page, lambda: float(np.dot(before, page.evaluate(TURN))) < 0.95, "turned")
    _fingers(page, *([(x - 20.0 - 12.0 * k, y), (x + 20.0 + 12.0 * k, y)] for k in range(8)))
    until(page, lambda: np.linalg.norm(page.evaluate(CAMERA)) < 0.8 * far, "nearer")
    client = next(iter(viewer.server.get_clients().values()))
    viewer.scene.cameras.set_preset(client, "front")
    until(page, lambda: float(np.dot(before, page.evaluate(TURN))) > 0.9999, "back at the front")


def test_a_tapped_joint_opens_its_values(viewer, page):
    _settled(viewer, page)
    x, y = page.evaluate(PLACE, "/joints/B/dot")
    page.touchscreen.tap(x, y)
    until(page, lambda: viewer.inspector.detail.item == "joint B", "joint B")


def test_docks_are_folded_on_a_phone_on_its_side_and_open_at_a_tap(viewer, page):
    _settled(viewer, page)
    page.set_viewport_size(TURNED)
    page.wait_for_function(WIDER, arg=740)
    page.locator("[data-dock-region=left] [data-dock-minimize-all]").first.tap()
    page.wait_for_function(f"least => !({WIDER})(least)", arg=740)
    page.locator("[data-dock-region-collapse=left]").tap()
    page.wait_for_function(WIDER, arg=740)
    page.set_viewport_size(PHONE)
    page.wait_for_function(f"least => !({WIDER})(least)", arg=740)


def test_the_drawer_of_a_phone_closes_at_its_head_and_the_picture_takes_its_place(viewer, page):
    _settled(viewer, page)
    before = page.evaluate(CANVAS)[3]
    head = page.locator(".mantine-Paper-root:has(.mechviz-heading)")
    play = page.get_by_role("button", name="Play", exact=True)
    assert play.bounding_box()["height"] >= 32.0, "for a thumb"
    folded = page.locator('[aria-label^="Expand panel"] > p').first
    assert folded.evaluate("e => Number(getComputedStyle(e).opacity)") >= 0.8, "read on a dark page, too"
    top = head.bounding_box()
    page.touchscreen.tap(top["x"] + 0.4 * top["width"], top["y"] + 20.0)
    page.wait_for_function(HIGHER, arg=1.5 * before)
    top = head.bounding_box()
    page.touchscreen.tap(top["x"] + 0.4 * top["width"], top["y"] + 20.0)
    page.wait_for_function(f"least => !({HIGHER})(least)", arg=1.2 * before)
    assert picture(page).std() > 5.0


def test_the_drawer_of_a_phone_is_as_wide_as_the_phone_whatever_is_opened_in_it(viewer, page):
    """Plots are as wide as the drawer; once they had widened it with every frame."""
    _settled(viewer, page)
    for opened in (page.locator(".mechviz-strip summary").first, page.get_by_text("Plots · Look closer").first):
        opened.tap()
        next_frames(page, 10)
        for _ in range(3):
            viewer.player.step(1)
            caught_up(viewer, page)
            next_frames(page, 5)
        width = "() => document.querySelector('.mechviz-strip').closest('.mantine-ScrollArea-content').scrollWidth"
        assert page.evaluate(width) <= PHONE["width"]
    assert page.locator(".uplot").first.bounding_box()["width"] > 0.9 * PHONE["width"]
    browsing.reload(page, ["/joints/A/dot"])


# -- a scene of which all can be had ----------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def full(browser) -> Iterator[tuple[Viewer, Any]]:
    """A four-bar with a parameter that has a range and a tolerance, and a goal: its viewer has every tab; and a page of it."""
    own = {("parameters", "r"): {"value": "60 mm", "range": ["50 mm", "65 mm"], "tolerance": "0.2 mm"}}
    own |= {("links", "crank", "points", "B", 0): "r", ("goal",): {"minimise": ["link.rocker.angle:range"]}}
    with Viewer(run_scene(load("crank-rocker").changed(own), frames=60), port=0) as shown:
        page = open_viewer(browser, shown, {"width": 1400, "height": 850}, ["/joints/A/dot"])
        yield shown, page
        page.close()


@pytest.mark.thorough
def test_tabs_lie_in_one_row_at_1400_pixels(full):
    _, page = full
    lists = page.evaluate(TABS)
    assert {"Edit", "View", "Plots", "Diagrams", "Designs", "Synthesis"} <= {name for tabs in lists for name, *_ in tabs}
    for tabs in lists:
        assert len({top for _, _, top, _ in tabs}) == 1, tabs
        assert all(right <= left + 1 for (_, _, _, right), (_, left, _, _) in pairwise(tabs)), "none over another"
        assert tabs[-1][3] <= 1400


def test_the_band_of_tolerances_is_drawn_as_wide_as_is_chosen(full):
    viewer, page = full
    plots, slot = viewer.plots, next(slot for slot in viewer.plots.slots if slot.chart.bands)

    def width() -> float:
        """The largest one of the last curve's band, as the page has it."""
        drawn = page.evaluate(CURVES, uuid_of(slot.chart))[-3:-1]
        return max((abs(a - b) for a, b in zip(*drawn, strict=True)), default=0.0) if drawn else 0.0

    open_tab(page, "Plots")
    until(page, lambda: width() > 0.0, "a band")
    usual = width()
    page.get_by_label("Tolerance band", exact=True).click()
    page.get_by_role("option", name="10 times", exact=True).click()
    until(page, lambda: abs(width() - 10.0 * usual) < 1e-6 * usual, "a wider band")
    page.get_by_label("Tolerance band", exact=True).click()
    page.get_by_role("option", name="none", exact=True).click()
    until(page, lambda: not slot.chart.bands and plots.band.value == "none", "no band")
