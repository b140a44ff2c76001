"""What the tests of the viewer in a real browser share: pages, and waiting for what they show."""

from __future__ import annotations

import io
import itertools
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from browsers import DRAWING, ONE_SAMPLE, STILL
from patience import PATIENCE

from mechviz.outputs.viewer.viser_adapter import run_script

_marks = itertools.count(1)

# Without a graphics card a picture costs by its pixels: half as many each way. That is also what keeps viser from
# changing the number of pixels by itself when the machine is busy.
PIXELS = "?fixedDpr=0.5"
SIZE = {"width": 1100, "height": 700}
READY = """names => { const m = window.__viserMutable; return !!m && !!m.messageQueue && m.messageQueue.length === 0 &&
    names.every(n => m.nodeRefFromName[n] && m.nodePoseData[n] && m.nodePoseData[n].poseUpdateState === 'updated'); }"""
POSES = """names => names.map(n => { const d = window.__viserMutable.nodePoseData[n]; return [...d.wxyz, ...d.position]; })"""
POSE = "name => { const d = window.__viserMutable.nodePoseData[name]; return [...d.wxyz, ...d.position]; }"
CAMERA = "() => window.__viserMutable.camera.position.toArray()"
CANVAS = """() => { const r = document.querySelector('canvas[data-engine]').getBoundingClientRect();
    return [r.left, r.top, r.width, r.height]; }"""
SEEN = """name => { let node = window.__viserMutable.nodeRefFromName[name]; if (!node) return false;
    for (; node; node = node.parent) if (!node.visible) return false; return true; }"""
# Where the middle of a node is on the page
PLACE = """name => { const m = window.__viserMutable, node = m.nodeRefFromName[name], r = m.canvas.getBoundingClientRect();
    const p = new m.camera.position.constructor().setFromMatrixPosition(node.matrixWorld).project(m.camera);
    return [r.left + (p.x + 1) / 2 * r.width, r.top + (1 - p.y) / 2 * r.height]; }"""
CURSOR = """uuid => { const d = window.__viserTestpoints.uplots[uuid]?.chart?.data; if (!d) return [];
    return Array.from(d[0]).filter((_, k) => Number.isFinite(d[d.length - 1][k])); }"""


def new_page(browser: Any, size: dict[str, int], **more: Any) -> Any:
    opened = browser.new_page(viewport=size, **more)
    opened.set_default_timeout(1000.0 * PATIENCE)
    return opened


def open_viewer(browser: Any, viewer: Any, size: dict[str, int], nodes: Sequence[str], **more: Any) -> Any:
    """A page with the viewer, when these nodes of the scene are there, which draws where `picture` looks; ``more`` of the page."""
    page = new_page(browser, size, **more)
    page.add_init_script(ONE_SAMPLE)
    page.add_init_script(STILL)
    page.goto(f"{viewer.url}{PIXELS}")
    _arrange(page, nodes)
    return page


def reload(page: Any, nodes: Sequence[str]) -> None:
    """Load the viewer's page again."""
    page.reload()
    _arrange(page, nodes)


def _arrange(page: Any, nodes: Sequence[str]) -> None:
    # Without a graphics card viser says so in a note that covers the top of the page
    page.add_style_tag(content=".mantine-Notifications-root{visibility:hidden}")
    page.wait_for_function(READY, arg=list(nodes))


def open_tab(page: Any, tab: str) -> None:
    """Open a tab of a panel, if it is not open."""
    control = page.get_by_role("tab", name=tab, exact=True)
    if control.get_attribute("aria-selected") != "true":
        control.click()


def caught_up(viewer: Any, page: Any) -> None:
    """Wait until all that has been asked for is drawn by the server, and all that the server has sent so far has reached the page:
    what is then not there is not on its way either."""
    assert viewer.player.wait()
    mark = next(_marks)
    run_script(viewer.server, f"window.mechvizMark = {mark};", "mark of a test")  # among all others, hence after those before it
    viewer.server.flush()
    page.wait_for_function("mark => window.mechvizMark >= mark", arg=mark)


def heard(viewer: Any) -> None:
    """Wait until all that the browsers have said so far has reached the server, and its callbacks have run."""
    for client in viewer.server.get_clients().values():
        client.local_storage.get_item("", timeout=PATIENCE)  # an answer, hence after all that was said before it
    assert viewer.player.wait()


def next_frames(page: Any, count: int = 2) -> None:
    """Wait until the page has gone through some more of its frames."""
    page.evaluate(
        "count => new Promise(done => { const next = () => count-- > 0 ? requestAnimationFrame(next) : done(); next(); })", count
    )


def camera_rests(page: Any, frames: int = 30) -> None:
    """Wait until the camera has stood still over some frames: after an edit it may be fitted anew, a quarter of a second later."""
    page.evaluate(
        """frames => new Promise(done => { let last = "", same = 0; const look = () => {
            const now = window.__viserMutable.camera.matrixWorld.elements.join();
            same = now === last ? same + 1 : 0; last = now;
            same >= frames ? done() : requestAnimationFrame(look); }; look(); })""",
        frames,
    )


def until(page: Any, condition: Any, what: str, seconds: float = PATIENCE) -> None:
    """Wait for a condition of this process, while the page's events are handled."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        page.wait_for_timeout(20)


# Draw one picture of the scene
DRAWN_ONCE = f"""async () => {{ {DRAWING};
    const m = window.__viserMutable, own = m.scene.__r3f, {{ scene }} = (own.root || own).getState();
    await new Promise(done => {{ const after = scene.onAfterRender;
        scene.onAfterRender = () => {{ scene.onAfterRender = after; done(); }}; m.requestRender(); }});
    await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
    {STILL} }}"""


def picture(page: Any) -> np.ndarray:
    """The part of the page between the panels, as (rows, columns, RGB)."""
    from PIL import Image

    page.evaluate(DRAWN_ONCE)
    clip = dict(zip(("x", "y", "width", "height"), page.evaluate(CANVAS), strict=True))
    return np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB")).astype(int)
