"""What the tests in a real browser share: Chromium, pages, and waiting for what they show."""

from __future__ import annotations

import io
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ARGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
SIZE = {"width": 1100, "height": 700}
PATIENCE = 60.0  # [s] for anything that has to come: a slow machine without a graphics card may need most of it
READY = """names => { const m = window.__viserMutable; return !!m && !!m.messageQueue && m.messageQueue.length === 0 &&
    names.every(n => m.nodeRefFromName[n] && m.nodePoseData[n] && m.nodePoseData[n].poseUpdateState === 'updated'); }"""
POSE = "name => { const d = window.__viserMutable.nodePoseData[name]; return [...d.wxyz, ...d.position]; }"
CAMERA = "() => window.__viserMutable.camera.position.toArray()"
CANVAS = """() => { const r = document.querySelector('canvas[data-engine]').getBoundingClientRect();
    return [r.left, r.top, r.width, r.height]; }"""
SEEN = """name => { let node = window.__viserMutable.nodeRefFromName[name]; if (!node) return false;
    for (; node; node = node.parent) if (!node.visible) return false; return true; }"""
CURSOR = """uuid => { const d = window.__viserTestpoints.uplots[uuid].chart.data;
    return Array.from(d[0]).filter((_, k) => Number.isFinite(d[d.length - 1][k])); }"""


def chromium_path() -> str:
    """The browser, or no test: a skip, unless the environment says that it has to be there."""
    found = next((path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None)
    if found is None and Path("/usr/bin/chromium").exists():
        found = "/usr/bin/chromium"
    if found is None:
        missing("Chromium is not installed (Debian: apt-get install chromium)")
    return str(found)


def missing(words: str) -> None:
    if os.environ.get("MECHVIZ_REQUIRE_BROWSER") == "1":
        pytest.fail(f"{words}, and MECHVIZ_REQUIRE_BROWSER=1 asks for it")
    pytest.skip(words)


def new_page(browser: Any, size: dict[str, int]) -> Any:
    opened = browser.new_page(viewport=size)
    opened.set_default_timeout(1000.0 * PATIENCE)
    return opened


def open_tab(page: Any, tab: str) -> None:
    """Open a tab of a panel."""
    page.get_by_role("tab", name=tab, exact=True).click()


def until(page: Any, condition: Any, what: str, seconds: float = PATIENCE) -> None:
    """Wait for a condition of this process, while the page's events are handled."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        page.wait_for_timeout(20)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    executable = chromium_path()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("playwright is not installed")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=executable, headless=True, args=ARGS)
        yield chromium
        chromium.close()


def picture(page: Any) -> np.ndarray:
    """The part of the page between the panels, as (rows, columns, RGB)."""
    from PIL import Image

    clip = dict(zip(("x", "y", "width", "height"), page.evaluate(CANVAS), strict=True))
    return np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip))).convert("RGB")).astype(int)
