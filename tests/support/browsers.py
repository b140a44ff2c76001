"""Headless Chromium for tests: found, or the test is skipped, unless the environment says that it has to be there."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from mechviz.outputs.images.browser import ChromiumError, find_chromium

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
    "--disable-gpu-compositing",  # there is no graphics card: the page itself is put together faster without pretending one
]

# Without a graphics card a picture costs by its samples
ONE_SAMPLE = """const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
        return get.call(this, kind, kind === 'webgl2' ? { ...options, antialias: false } : options); }"""

# Drawn in software, a picture costs more than all else that a page does: a page that is still computes, hears and moves as ever,
# and draws nothing. Where cameras put things is asked without a picture
STILL = """if (!window.drawnLater) { window.drawnLater = {};
    for (const name of ['clear', 'drawElements', 'drawArrays', 'drawElementsInstanced', 'drawArraysInstanced']) {
        const own = WebGL2RenderingContext.prototype; window.drawnLater[name] = own[name]; own[name] = () => {}; } }"""
DRAWING = "Object.assign(WebGL2RenderingContext.prototype, window.drawnLater); window.drawnLater = undefined"


def chromium_or_skip() -> str:
    """The path of Chromium."""
    try:
        return find_chromium()
    except ChromiumError as error:
        missing(str(error))
        raise


def missing(words: str) -> None:
    """No test without what is missing."""
    if os.environ.get("MECHVIZ_REQUIRE_BROWSER") == "1":
        pytest.fail(f"{words}, and MECHVIZ_REQUIRE_BROWSER=1 asks for it")
    pytest.skip(words)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium, driven by playwright."""
    executable = chromium_or_skip()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("playwright is not installed")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=executable, headless=True, args=ARGS)
        yield chromium
        chromium.close()


# Whether the page's own scripts reach another server
REQUESTING = """there => Promise.all([fetch(there + '/fetched').then(() => 'sent', () => 'refused'), new Promise(done => {
    const script = document.createElement('script'); script.onload = () => done('sent'); script.onerror = () => done('refused');
    script.src = there + '/script.js'; document.head.append(script); })])"""


def pulling(there: str) -> str:
    """HTML that would load from another server."""
    return (
        f"<img src='{there}/a.png'><iframe src='{there}/b'></iframe><object data='{there}/c'></object>"
        f"<div style='background:url({there}/d.png)'>.</div><svg><image href='{there}/e.png' width='9' height='9'/></svg>"
    )


@contextlib.contextmanager
def elsewhere() -> Iterator[tuple[str, list[str]]]:
    """Another server: its address, and what it has been asked for."""
    asked: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_error(404)

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", asked
        finally:
            server.shutdown()
