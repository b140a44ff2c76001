"""How the page draws without a graphics card: lightly while something moves, as well as it can at rest, the grid as lines."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browsing import CANVAS, PLACE, POSE, browser, caught_up, next_frames, open_viewer, picture, until
from pixels import changed, same

from mechviz import scene
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.browser import SCRIPT
from mechviz.outputs.viewer.world.arrows import arc_path
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.outputs.viewer.world.stage import CELLS
from mechviz.runs import run_scene

__all__ = ["browser"]  # a fixture

pytestmark = pytest.mark.browser

SMALL = {"width": 900, "height": 420}
COUPLER = link_path("coupler")
STATE = """() => { const { software, fixed, moving, level, whole, light, size } = window.mechvizDrawing;
    const canvas = document.querySelector('canvas[data-engine]');
    return { software, fixed, moving, level, whole, light, size, full: [canvas.width, canvas.height] }; }"""
# On a busy machine viser takes pixels away, even after the last picture: another one at rest gives them back
RESTS = """() => { const own = window.__viserMutable.scene.__r3f, { viewport, gl } = (own.root || own).getState();
    const d = window.mechvizDrawing, canvas = gl.getContext().canvas;
    if (d.moving || !d.software) return !d.moving;
    if (viewport.dpr < window.devicePixelRatio) { d.touch(); return false; }
    return d.size[0] === canvas.width && d.size[1] === canvas.height; }"""
# Decisions are made by the tests, not by the time that this machine needs
TIMED = "() => { const d = window.mechvizDrawing; d.decide = d.took; d.took = () => {}; d.forget(); d.level = 1; }"
TOOK = "time => { for (let k = 0; k < 3; k++) window.mechvizDrawing.decide(time); return window.mechvizDrawing.level; }"
# At each picture: where the coupler is, the corners of the torque's arc, and the places of the arrows of the reactions
WATCH = """([coupler, arc]) => { const v = window.__viserMutable, own = v.scene.__r3f, { gl } = (own.root || own).getState();
    const draw = gl.render, found = (name, is) => { let o = null; v.nodeRefFromName[name].traverse(n => { o = o || (is(n) && n); });
        return o; };
    window.watched = [];
    gl.render = (scene, camera) => { draw(scene, camera);
        const pose = v.nodePoseData[coupler], corners = found(arc, n => n.isMesh).geometry.attributes.position.array;
        const arrows = found('/vectors/reaction', n => n.matricesTexture).matricesTexture.image.data;
        window.watched.push([pose.position.join(), corners.slice(-6).join(), arrows.slice(0, 32).join()]); };
    window.unwatch = () => { gl.render = draw; }; }"""
# Which depth is in front: whether it runs backwards, whether it should, what it is cleared to, and what passes (>= or <=)
DEPTH = """() => { const own = window.__viserMutable.scene.__r3f, { gl } = (own.root || own).getState(), c = gl.getContext();
    return [gl.state.buffers.depth.getReversed(), gl.capabilities.reversedDepthBuffer, c.getParameter(c.DEPTH_CLEAR_VALUE),
        { [c.GEQUAL]: '>=', [c.LEQUAL]: '<=' }[c.getParameter(c.DEPTH_FUNC)]]; }"""
GRID = """() => { const { lines } = window.mechvizDrawing; if (!lines) return null;
    let seen = true; for (let o = lines; o; o = o.parent) seen = seen && o.visible;
    const color = lines.material.uniforms.cellColor.value.clone().convertLinearToSRGB();
    return { seen, own: lines.parent.layers.mask, lines: lines.isLineSegments && lines.isMesh === false,
        count: lines.geometry.attributes.position.count / 2,
        color: [color.r, color.g, color.b].map(c => Math.round(255 * c)) }; }"""


@pytest.fixture(scope="module")
def viewer(browser) -> Iterator[Viewer]:
    with Viewer(run_scene(scene.load("kinetostatic-four-bar")), port=0) as shown:
        yield shown


@pytest.fixture(scope="module")
def page(browser, viewer) -> Iterator[Any]:
    opened = open_viewer(browser, viewer, SMALL, [COUPLER], spared=False)
    opened.wait_for_function("() => !!window.mechvizDrawing")
    opened.evaluate(TIMED)
    yield opened
    opened.close()


def _rested(viewer: Viewer, page: Any) -> dict[str, Any]:
    """The state when everything has arrived and nothing moves any more, drawn since then."""
    caught_up(viewer, page)
    page.wait_for_function(RESTS)
    next_frames(page, 3)
    page.wait_for_function(RESTS)
    return dict(page.evaluate(STATE))


def test_what_moves_is_drawn_lightly_and_at_rest_everything_is_drawn_as_well_as_can_be(viewer, page):
    before = _rested(viewer, page)
    assert before["software"] and not before["fixed"], "tests draw by software"
    assert before["size"] == before["full"]
    viewer.set_frame(100)
    until(page, lambda: page.evaluate(STATE)["light"] > before["light"], "a light picture")
    after = _rested(viewer, page)
    assert after["whole"] > before["whole"] and after["size"] == after["full"]


def test_a_light_picture_shows_the_same(viewer, page):
    """Sharp edges and fewer pixels make the difference, no other place or colour."""
    viewer.set_frame(200)
    _rested(viewer, page)
    best = picture(page)
    hold = """level => { const d = window.mechvizDrawing; d.level = level; d.light = 0;
        Object.defineProperty(d, 'moving', { get: () => true, set: () => {}, configurable: true, enumerable: true }); d.draw(); }"""
    release = """() => { const d = window.mechvizDrawing; d.level = 1;
        Object.defineProperty(d, 'moving', { value: true, writable: true, configurable: true, enumerable: true });
        d.touch(); d.draw(); }"""
    for level, most in ((1, 2.0), (2, 3.5), (3, 5.0)):
        page.evaluate(hold, level)
        page.wait_for_function("() => window.mechvizDrawing.light > 0")
        full = page.evaluate(STATE)["full"]
        part = (None, 1.0, 0.75, 0.5)[level]
        assert page.evaluate(STATE)["size"] == [int(length * part) for length in full]
        difference = np.abs(picture(page) - best).mean()
        assert 0.0 < difference < most, f"at {part} of the pixels each way"
        assert page.evaluate(DEPTH)[:3] in ([True, True, 0.0], [False, False, 1.0]), "what is near stays in front"
    page.evaluate(release)
    _rested(viewer, page)
    assert same(picture(page), best)
    assert page.evaluate(DEPTH) in ([True, True, 0.0, ">="], [False, False, 1.0, "<="])


def test_what_is_in_front_is_seen_after_light_pictures_too(viewer, page):
    """The dots of the joints lie before all links, the fixed one with its supports behind them."""
    viewer.set_frame(120)
    viewer.set_frame(100)
    assert _rested(viewer, page)["light"] > 0
    left, top, _, _ = page.evaluate(CANVAS)
    shot = picture(page)
    for joint in "AE":
        x, y = page.evaluate(PLACE, f"/joints/{joint}/dot")
        x, y = round(x - left), round(y - top)
        assert np.median(shot[y - 1 : y + 2, x - 1 : x + 2]) > 150, f"the dot of {joint}"
    state = """() => { const own = window.__viserMutable.scene.__r3f, { gl } = (own.root || own).getState();
        return [gl.state.buffers.depth.getReversed(), window.__viserMutable.camera.reversedDepth]; }"""
    reversed_now, wanted = page.evaluate(state)
    assert reversed_now == wanted


def test_pictures_that_take_long_get_fewer_pixels_if_that_helps(page):
    page.evaluate("() => { window.mechvizDrawing.forget(); window.mechvizDrawing.level = 1; }")
    assert page.evaluate(TOOK, 8.0) == 1
    assert [page.evaluate(TOOK, time) for time in (40.0, 24.0, 12.0, 8.0)] == [2, 3, 3, 3]
    assert [page.evaluate(TOOK, time) for time in (3.0, 3.0, 3.0, 3.0)] == [2, 1, 0, 0], "and get them back, and their samples"
    assert [page.evaluate(TOOK, time) for time in (30.0, 30.0)] == [1, 2]
    assert page.evaluate(TOOK, 29.0) == 1, "it was not the pixels"
    assert page.evaluate(TOOK, 30.0) == 1, "nor is it now"


def test_a_card_is_left_to_draw_as_ever(viewer, page):
    page.evaluate("() => { window.mechvizDrawing.software = false; }")
    before = _rested(viewer, page)
    viewer.set_frame(50)
    caught_up(viewer, page)
    after = _rested(viewer, page)
    assert (after["light"], after["whole"]) == (before["light"], before["whole"])
    page.evaluate("() => { window.mechvizDrawing.software = true; }")


def test_a_page_without_the_hooks_stays_as_it_is(page):
    found = page.evaluate(
        """source => { const drawing = window.mechvizDrawing, viser = window.__viserMutable, found = [];
        for (const other of [undefined, {}, { scene: {} }, { scene: { __r3f: { root: { getState: () => ({ gl: null }) } } } }]) {
            window.__viserMutable = other; window.mechvizDrawing = undefined;
            try { (0, eval)(source); found.push(window.mechvizDrawing === undefined); } catch (error) { found.push(String(error)); }
        }
        window.__viserMutable = viser; window.mechvizDrawing = drawing;
        return found; }""",
        SCRIPT,
    )
    assert found == [True] * 4


def test_the_first_picture_of_a_move_has_all_of_it(viewer, page):
    viewer.set_frame(300)
    _rested(viewer, page)
    page.evaluate(WATCH, [COUPLER, arc_path("drive", "A")])
    before = page.evaluate(POSE, COUPLER)
    viewer.set_frame(323)
    until(page, lambda: page.evaluate(POSE, COUPLER) != before, "a new pose")
    _rested(viewer, page)
    watched = page.evaluate("() => { window.unwatch(); return window.watched; }")
    first = next(seen for seen in watched if seen[0] == watched[-1][0])
    assert first == watched[-1], "the arc and the arrows stand where they belong, as the link does"


def test_large_scenes_have_fewer_triangles_while_they_move(viewer, page):
    """As if this were one: corners nearer than a pixel or so, of faces that look the same way, become one."""
    viewer.set_frame(120)
    _rested(viewer, page)
    best = picture(page)
    count = """() => { const own = window.__viserMutable.scene.__r3f, { gl } = (own.root || own).getState();
        const d = window.mechvizDrawing; d.triangles = 1e6; d.light = 0; d.moving = true; d.level = 1; d.draw();
        return gl.info.render.triangles; }"""
    full = page.evaluate(count)
    page.wait_for_function("() => window.mechvizDrawing.light > 0")
    drawn = page.evaluate(
        """() => { const own = window.__viserMutable.scene.__r3f, { gl } = (own.root || own).getState();
        return { triangles: gl.info.render.triangles, meshes: [...window.mechvizDrawing.coarse].map(([mesh, { low }]) => [
            mesh.layers.mask, low.layers.mask, mesh.geometry.attributes.position === low.geometry.attributes.position,
            mesh.geometry.index.count, low.geometry.index.count]) }; }"""
    )
    light = picture(page)
    page.evaluate("() => { const d = window.mechvizDrawing; d.touch(); d.draw(); }")
    _rested(viewer, page)
    assert drawn["triangles"] < 0.7 * full
    assert len(drawn["meshes"]) >= 6
    for own, low, shared, triangles, fewer in drawn["meshes"]:
        assert own == 1 and low == 0 and shared, "outside a light picture the mesh itself is drawn, and can be clicked"
        assert 0 < fewer < triangles
    assert 0.0 < np.abs(light - best).mean() < 3.0
    assert same(picture(page), best)


def test_corners_are_put_together_by_place_and_direction(page):
    """A square with a corner too many, seen from both sides: what lies in a cell and looks the same way becomes one."""
    ring = [[0, 0], [1, 0], [1, 0.02], [1, 1], [0, 1]]
    position = [[*xy, 0.0] for xy in ring] + [[*xy, 0.0] for xy in ring]
    normal = [[0, 0, 1]] * 5 + [[0, 0, -1]] * 5
    front = [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    back = [[5 + a, 5 + c, 5 + b] for a, b, c in front]
    arrays = [[float(x) for row in rows for x in row] for rows in (position, normal)] + [[k for row in front + back for k in row]]
    cluster = """([position, normal, index, cell]) => Array.from(
        window.mechvizDrawing.cluster(new Float32Array(position), new Float32Array(normal), index, cell))"""
    assert page.evaluate(cluster, [*arrays, 1e-3]) == arrays[2]
    fewer = np.reshape(page.evaluate(cluster, [*arrays, 0.1]), (-1, 3)).tolist()
    assert fewer == [[0, 1, 3], [0, 3, 4], [5, 8, 6], [5, 9, 8]], "the two sides stay apart"
    assert page.evaluate(cluster, [*arrays, 10.0]) == []


def test_the_grid_is_lines_that_are_switched_and_darkened_as_the_grid(viewer, page):
    _rested(viewer, page)
    grid = page.evaluate(GRID)
    assert grid["seen"] and grid["lines"] and grid["own"] == 0, "viser's own grid is not drawn"
    assert grid["count"] > 50 and tuple(grid["color"]) == CELLS[False][0]
    with_grid = picture(page)
    try:
        viewer.scene.stage.switch(False)
        caught_up(viewer, page)
        until(page, lambda: not page.evaluate(GRID)["seen"], "no lines")
        _rested(viewer, page)
        assert 0.005 < changed(picture(page), with_grid) < 0.5, "lines, not an area"
        viewer.scene.stage.switch(True)
        viewer.scene.stage.darken(True)
        until(page, lambda: tuple(page.evaluate(GRID)["color"]) == CELLS[True][0], "the colour of a dark page")
    finally:
        viewer.scene.stage.switch(True)
        viewer.scene.stage.darken(False)
    until(page, lambda: tuple(page.evaluate(GRID)["color"]) == CELLS[False][0], "the colour of a light page")
    _rested(viewer, page)
    assert same(picture(page), with_grid)
