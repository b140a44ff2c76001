"""Makes the pictures of the README: the viewer in headless Chromium.

python docs/make_pictures.py [SCENE ...]
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

import mechviz
from mechviz.run import run_scene
from mechviz.viewer import Viewer

HERE = Path(__file__).parent / "images"
ARGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]


def shoot(scene: str, path: Path, *, part: float = 0.87) -> None:
    """One picture of a scene at a part of its run."""
    run = run_scene(mechviz.load(scene))
    with Viewer(run, port=0) as viewer, sync_playwright() as p:
        viewer.pause()
        viewer.set_frame(int(part * (run.motion.frames - 1)))
        browser = p.chromium.launch(executable_path=shutil.which("chromium"), args=ARGS)
        page = browser.new_page(viewport={"width": 1400, "height": 850})
        page.goto(viewer.url)
        page.add_style_tag(content=".mantine-Notifications-root{display:none !important}")
        page.wait_for_timeout(9000)
        page.screenshot(path=path)
        browser.close()
    print(path)


def main() -> None:
    HERE.mkdir(exist_ok=True)
    scenes = sys.argv[1:] or ["slider-crank-compressor"]
    for scene in scenes:
        shoot(scene, HERE / ("viewer.png" if len(sys.argv) < 2 else f"{scene}.png"))


if __name__ == "__main__":
    main()
