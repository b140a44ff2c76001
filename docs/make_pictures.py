"""Makes the pictures of the viewer in the README and the guides: the viewer in headless Chromium.

python docs/make_pictures.py [--to FOLDER] [NAME ...]
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
AGAIN, ALIKE = 1500, 4  # the page is whole when so many pictures, this far apart [ms], are the same: letters come a few a frame
WIDE, PHONE = (1400, 850), (390, 844)


def _nothing(_viewer: Viewer, _page: Any) -> None:
    """Leave the page as it opens."""


def _dark(viewer: Viewer, page: Any) -> None:
    page.get_by_role("tab", name="View", exact=True).click()
    page.get_by_label("Dark page").check()
    page.get_by_role("tab", name="Edit", exact=True).click()


def _compare(viewer: Viewer, page: Any) -> None:
    control = page.locator("label", has_text="crank A–B [mm]").first.get_attribute("for")
    box = page.locator(f'[id="{control}"] ~ div input')
    box.fill("46")
    box.press("Enter")
    page.wait_for_timeout(SETTLING)
    viewer.session.wait(until_idle=True)
    page.get_by_label("Compare with the scene as opened").check()


def _polygons(viewer: Viewer, page: Any) -> None:
    page.get_by_role("tab", name="Diagrams", exact=True).click()


@dataclass(frozen=True)
class Shot:
    """A picture: the scene, the part of its run, what is done to the page first, and its size in pixels."""

    scene: str
    part: float | None = None
    prepare: Callable[[Viewer, Any], None] = _nothing
    size: tuple[int, int] = WIDE


SHOTS: Mapping[str, Shot] = {
    "viewer": Shot("slider-crank-compressor", 0.87),
    "viewer-six-bar": Shot("watt-six-bar"),
    "viewer-cam": Shot("cam-roller", 0.15),
    "viewer-phone": Shot("stephenson-six-bar", size=PHONE),
    "viewer-dark": Shot("engine-start-up", 0.12, _dark),
    "viewer-compare": Shot("slider-crank-compressor", 0.87, _compare),
    "viewer-polygons": Shot("plans-four-bar", None, _polygons),
}


def shoot(browser: Any, shot: Shot, path: Path) -> None:
    """One picture, at the frame at which the viewer opens or at a part of its run."""
    run = run_scene(mechviz.load(shot.scene))
    with Viewer(run, port=0) as viewer:
        viewer.pause()
        if shot.part is not None:
            viewer.set_frame(int(shot.part * (run.motion.frames - 1)))
        width, height = shot.size
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(60_000)
        page.goto(viewer.url)
        page.add_style_tag(content=".mantine-Notifications-root{display:none !important}")
        page.wait_for_function(READY, arg=[link_path(link) for link in run.motion.model.links])
        shot.prepare(viewer, page)
        page.wait_for_timeout(SETTLING)
        pictures = [page.screenshot()]
        while len(pictures) < ALIKE or len(set(pictures[-ALIKE:])) > 1:
            page.wait_for_timeout(AGAIN)
            pictures.append(page.screenshot())
        path.write_bytes(pictures[-1])
        page.close()
    print(path, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(SHOTS)} [default: all]")
    parser.add_argument("--to", type=Path, default=HERE, metavar="FOLDER")
    chosen = parser.parse_args()
    chosen.to.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=shutil.which("chromium"), args=ARGS)
        for name in chosen.names or SHOTS:
            shoot(browser, SHOTS[name], chosen.to / f"{name}.png")
        browser.close()


if __name__ == "__main__":
    main()
