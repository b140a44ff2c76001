"""What a recording, a page and a picture of a mechanism of 100 bodies cost: processor time (without Chromium's), size, memory.

python benchmarks/sharing.py [--short] [--forces]

The page is made by the command in a process of its own: its memory is that of the command. With ``--forces`` every link has a mass
and the recording all reactions, the inertia, weight and driving torque of every frame.
"""

from __future__ import annotations

from timing import machine  # first: it sets one thread

import argparse  # isort: skip
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mechviz.outputs.images.browser import ChromiumError
from mechviz.outputs.images.drawing import write_svg
from mechviz.outputs.images.pictures import Look, PictureTime, shot
from mechviz.outputs.page.pack import MOST_FRAMES
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene
from mechviz.scene.scene import loads

# The command line, and then what it has used: processor time [s], most memory [KiB]
SHARE = """
import atexit, time
from pathlib import Path
from mechviz.__main__ import main
atexit.register(lambda: print(time.process_time(), Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]))
main()
"""


def train(count: int, forces: bool = False) -> str:
    """A train of crank-rockers, each driven by the rocker before: 2 count + 1 moving links, with masses where ``forces`` are."""
    lines = [f'title = "Train of {count} four-bars"', 'units = { length = "mm", angle = "deg" }']
    if forces:
        lines += ['effects = ["inertia", "gravity"]', 'gravity = [0, "-9.81 m/s2"]']
    heavy = ', mass = "0.3 kg", centre = [80, 0], inertia = "0.001 kg*m2"' if forces else ""
    lines.append("[links]")
    lines.append(f"frame = {{ points = {{ {', '.join(f'D{k} = [{200 * k}, 0]' for k in range(count + 1))} }} }}")
    lines.append(f"rocker0 = {{ points = {{ D0 = [0, 0], B1 = [60, 0] }}{heavy} }}")
    for k in range(1, count + 1):
        lines.append(f"coupler{k} = {{ points = {{ B{k} = [0, 0], C{k} = [190, 0] }}{heavy} }}")
        lines.append(f"rocker{k} = {{ points = {{ D{k} = [0, 0], C{k} = [120, 0], B{k + 1} = [90, 20] }}{heavy} }}")
    lines += ["[joints]", 'D0 = { revolute = ["frame", "rocker0"], drive = { speed = "60 rpm" } }']
    for k in range(1, count + 1):
        lines.append(f'B{k} = {{ revolute = ["rocker{k - 1}", "coupler{k}"] }}')
        lines.append(f'C{k} = {{ revolute = ["coupler{k}", "rocker{k}"], side = "left" }}')
        lines.append(f'D{k} = {{ revolute = ["rocker{k}", "frame"] }}')
    return "\n".join(lines)


def main(short: bool, forces: bool) -> None:
    print(machine())
    frames, count = (1000, 10) if short else (10_000, 50)
    with tempfile.TemporaryDirectory() as folder:
        recording, page, picture = (Path(folder) / name for name in ("run.rrd", "page.html", "picture.png"))
        start = time.process_time()

        def tell(what: str, file: Path, told: list[str] | None = None) -> None:
            nonlocal start
            spent, most = time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            if told:
                spent, most = float(told[0]), int(told[1])
            size = file.stat().st_size / 1e6
            print(f"{what:<40} {spent:6.1f} s  {size:8.2f} MB  at most {most / 1024:6.0f} MiB", flush=True)
            start = time.process_time()

        write_recording(run_scene(loads(train(count, forces)), frames=frames), recording)
        tell(f"{2 * count + 1} bodies{' with forces' if forces else ''}, {frames} frames, recorded", recording)
        command = [sys.executable, "-c", SHARE, "share", str(recording), "-o", str(page)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        tell("page", page, done.stdout.split()[-2:])
        read = Recording(recording, most=MOST_FRAMES)  # as the commands do
        drawing = write_svg(read, picture.with_suffix(".svg"))
        tell("drawing (SVG)", drawing)
        try:
            shot(read, picture, Look(view="front"), PictureTime())
            tell("picture (PNG, Chromium without a graphics card)", picture)
        except ChromiumError as error:
            print(error)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="1,000 frames of ten loops, not 10,000 of fifty")
    parser.add_argument("--forces", action="store_true", help="masses and effects: with reactions, inertia, weight, driving torque")
    given = parser.parse_args()
    main(given.short, given.forces)
