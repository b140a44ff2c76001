"""Makes the pictures of the README: the viewer in headless Chromium.

python docs/make_pictures.py [--to FOLDER] [SCENE ...]
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

import mechviz
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.runs import run_scene

HERE = Path(__file__).parent / "images"
ARGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]
READY = """names => { const m = window.__viserMutable; return !!m && !!m.messageQueue && m.messageQueue.length === 0 &&
    names.every(n => m.nodeRefFromName[n]); }"""
SETTLING = 3500  # [ms] that the page takes to fit its view and to draw it


def shoot(browser: Any, scene: str, path: Path, *, part: float | None = None) -> None:
    """One picture of a scene, at the frame at which the viewer opens or at a part of its run."""
    run = run_scene(mechviz.load(scene))
    with Viewer(run, port=0) as viewer:
        viewer.pause()
        if part is not None:
            viewer.set_frame(int(part * (run.motion.frames - 1)))
        page = browser.new_page(viewport={"width": 1400, "height": 850})
        page.set_default_timeout(60_000)
        page.goto(viewer.url)
        page.add_style_tag(content=".mantine-Notifications-root{display:none !important}")
        page.wait_for_function(READY, arg=[link_path(link) for link in run.motion.model.links])
        page.wait_for_timeout(SETTLING)
        page.screenshot(path=path)
        page.close()
    print(path, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", metavar="SCENE")
    parser.add_argument("--to", type=Path, default=HERE, metavar="FOLDER")
    chosen = parser.parse_args()
    chosen.to.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=shutil.which("chromium"), args=ARGS)
        for scene in chosen.scenes:
            shoot(browser, scene, chosen.to / f"{scene}.png")
        if not chosen.scenes:
            shoot(browser, "slider-crank-compressor", chosen.to / "viewer.png", part=0.87)
        browser.close()


if __name__ == "__main__":
    main()
