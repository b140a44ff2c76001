"""Recording throughput: 10,000 frames of the ten-link gallery scenes, as kinematics and with forces and all.

python benchmarks/recording.py
"""

from __future__ import annotations

from timing import machine  # first: it sets one thread

import statistics  # isort: skip
import tempfile
import time
from pathlib import Path

import mechviz
from mechviz.record import write_recording
from mechviz.run import run_scene

FRAMES = 10_000


def throughput(name: str) -> None:
    scene = mechviz.load(name)
    run = run_scene(scene, frames=FRAMES - 1)
    links = len(scene.mechanism.links)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.rrd"
        times = []
        for _ in range(5):
            start = time.perf_counter()
            write_recording(run, path)
            times.append(time.perf_counter() - start)
        size = path.stat().st_size
    seconds = statistics.median(times)
    rate, each = FRAMES / seconds, size / FRAMES
    print(f"{name}: {FRAMES} frames, {links} links: {seconds:.2f} s, {rate:.0f} frames/s, {each:.0f} B a frame")
    for s in run.stages:
        print(f"  {s.name}: {1e3 * s.seconds:.1f} ms")


def main() -> None:
    print(machine("numpy", "rerun-sdk"))
    for name in ("ten-link", "ten-link-forces"):
        throughput(name)


if __name__ == "__main__":
    main()
