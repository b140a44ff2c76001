"""Real browsers that look at one viewer at once: they turn the picture, play, scrub, come and go.

    python tests/torture/browsers_at_once.py --browsers 20 --seconds 600

Each has its own session; four processes of Chromium have them all (``--processes``). No page reports an error, the viewer's memory
stays flat, and it draws the scene correctly afterwards.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from browsers import ARGS
from browsing import ONE_SAMPLE, PIXELS
from hostile_messages import MOST_GROWN, draws, grown, memory, viewer
from playwright.sync_api import sync_playwright

from mechviz.outputs.images.browser import find_chromium

LINKS = ["/mechanism/crank", "/mechanism/rocker"]
SIZE = {"width": 800, "height": 600}
# Others may play the motion meanwhile, so that no page ever rests
THERE = "names => !!window.__viserMutable && names.every(name => window.__viserMutable.nodeRefFromName[name])"
PATIENCE = 180.0  # [s] for a page on a machine that many browsers share


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--browsers", type=int, default=20)
    parser.add_argument("--processes", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng, errors, sizes, done = random.Random(options.seed), list[str](), list[float](), 0
    with viewer() as (port, process), sync_playwright() as playwright:
        started = [
            playwright.chromium.launch(executable_path=find_chromium(), headless=True, args=ARGS)
            for _ in range(min(options.processes, options.browsers))
        ]
        pages = []
        for k in range(options.browsers):
            pages.append(opened(started[k % len(started)], port, errors))
            print(f"{k + 1} of {options.browsers} browsers are there", flush=True)
        end = time.monotonic() + options.seconds
        while time.monotonic() < end:
            k = rng.randrange(len(pages))
            if rng.random() < 0.1:
                pages[k].close()
                pages[k] = opened(started[k % len(started)], port, errors)
            else:
                look(pages[k], rng)
            done += 1
            sizes.append(memory(process))
        for chromium in started:
            chromium.close()
        draws(port)
        sizes.append(memory(process))
    print(
        f"{options.browsers} browsers did {done} things in {options.seconds:g} s; the viewer takes {sizes[-1] / 1e6:.0f} MB, ",
        end="",
    )
    print(f"grown by {grown(sizes) / 1e6:.1f} MB; {len(errors)} errors on pages; the picture is right")
    for error in dict.fromkeys(errors):
        print(error[:300])
    sys.exit(int(bool(errors) or grown(sizes) > MOST_GROWN))


if __name__ == "__main__":
    main()
