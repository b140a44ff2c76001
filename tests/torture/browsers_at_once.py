"""Real browsers that look at one viewer at once: they turn the picture, play, scrub, come and go.

    python tests/torture/browsers_at_once.py --browsers 20 --seconds 600

Each has its own session; four processes of Chromium have them all (``--processes``). No page reports an error, the viewer's memory
stays flat, and it draws the scene correctly afterwards.
"""

from __future__ import annotations

import random
import sys
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from browsers import ARGS
from browsing import ONE_SAMPLE, PIXELS
from budget import Tally, options
from hostile_messages import MOST_GROWN, draws, grown, memory, viewer
from patience import PATIENCE
from playwright.sync_api import sync_playwright

from mechviz.outputs.images.browser import find_chromium

LINKS = ["/mechanism/crank", "/mechanism/rocker"]
SIZE = {"width": 800, "height": 600}
# Others may play the motion meanwhile, so that no page ever rests
THERE = "names => !!window.__viserMutable && names.every(name => window.__viserMutable.nodeRefFromName[name])"


def opened(chromium: Any, port: int, errors: list[str]) -> Any:
    """A page with the picture in it."""
    page = chromium.new_page(viewport=SIZE)  # in a context of its own
    page.set_default_timeout(1e3 * PATIENCE)
    page.add_init_script(ONE_SAMPLE)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(f"http://127.0.0.1:{port}/{PIXELS}")
    page.wait_for_function(THERE, arg=LINKS)
    return page


def look(page: Any, rng: random.Random) -> None:
    """Do one of the things that people do."""
    x, y = rng.uniform(320.0, 480.0), rng.uniform(150.0, 400.0)
    match rng.randrange(5):
        case 0:
            page.mouse.move(x, y)
            page.mouse.down()
            page.mouse.move(x + rng.uniform(-99.0, 99.0), y + rng.uniform(-99.0, 99.0), steps=4)
            page.mouse.up()
        case 1:
            page.mouse.move(x, y)
            page.mouse.wheel(0.0, rng.uniform(-200.0, 200.0))
        case 2:
            page.keyboard.press("Space")  # plays or pauses, also where a narrow page has its buttons in a drawer
        case 3:
            page.mouse.click(x, y)
        case _:
            page.set_viewport_size({"width": rng.randrange(320, 1100), "height": rng.randrange(320, 800)})


def main() -> int:
    parser = options(__doc__, 1_000_000, seconds=600.0)
    parser.add_argument("--browsers", type=int, default=20)
    parser.add_argument("--processes", type=int, default=4, help="of Chromium (4)")
    given = parser.parse_args()
    rng, errors, sizes = random.Random(given.first), list[str](), list[float]()
    with viewer() as (port, process), sync_playwright() as playwright:
        started = [
            playwright.chromium.launch(executable_path=find_chromium(), headless=True, args=ARGS)
            for _ in range(min(given.processes, given.browsers))
        ]
        pages = []
        for k in range(given.browsers):
            pages.append(opened(started[k % len(started)], port, errors))
            print(f"{k + 1} of {given.browsers} browsers are there", flush=True)
        tally = Tally(given.count, given.seconds)
        for _ in tally.cases():
            k = rng.randrange(len(pages))
            if rng.random() < 0.1:
                pages[k].close()
                pages[k] = opened(started[k % len(started)], port, errors)
            else:
                look(pages[k], rng)
            sizes.append(memory(process))
        for chromium in started:
            chromium.close()
        try:
            draws(port)
        except AssertionError as error:
            tally.fault(str(error))
        sizes.append(memory(process))
    for message in errors:
        tally.fault(f"on a page: {message[:300]}", message)
    if grown(sizes) > MOST_GROWN:
        tally.fault("memory has grown")
    return tally.end(f"the viewer takes {sizes[-1] / 1e6:.0f} MB, grown by {grown(sizes) / 1e6:.1f} MB")


if __name__ == "__main__":
    sys.exit(main())
