"""Makes the picture of a shared page in outputs.md: the page in headless Chromium, at a drive angle that tells something.

python docs/make_share_picture.py [SCENE] [DEGREES]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

import mechviz
from mechviz.outputs.images.browser import Chromium
from mechviz.outputs.images.pictures import SETTLED_SCRIPT, picture_time
from mechviz.outputs.page.page import make_page
from mechviz.outputs.presentation import presentation_of
from mechviz.runs import run_scene

TO = Path(__file__).parent / "images" / "share.png"


def main(scene: str, degrees: float) -> None:
    shown = presentation_of(run_scene(mechviz.load(scene)))
    time = picture_time(shown, angle=np.radians(float(degrees))).time
    with tempfile.TemporaryDirectory() as folder, Chromium(1400, 820) as browser:
        page = Path(folder) / "page.html"
        page.write_text(make_page(shown)[0], encoding="utf-8")
        browser.go(page)
        browser.evaluate("mechviz.ready")
        browser.evaluate(f"mechviz.player.seek({time!r}); mechviz.player.drawNow(); {SETTLED_SCRIPT}")
        TO.write_bytes(browser.screenshot())
    print(TO)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="slider-crank-compressor", help="of the gallery [default: %(default)s]")
    parser.add_argument("degrees", nargs="?", type=float, default=300.0, help="angle of the drive [default: %(default)g]")
    given = parser.parse_args()
    main(given.scene, given.degrees)
