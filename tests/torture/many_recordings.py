"""Many recordings in one process: memory and threads stay flat.

    python tests/torture/many_recordings.py [COUNT] [SECONDS]

exits with 1 where the process has grown by more than 20 MB after the first tenth, or by a thread.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

import mechviz
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene

MOST_GROWN = 20e6  # bytes


def memory() -> float:
    """Memory of this process [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * float(os.sysconf("SC_PAGE_SIZE"))


def main(count: int = 1000, seconds: float = 3600.0) -> int:
    """Writes recordings; gives 1 where memory or threads have grown."""
    run, begun, made = run_scene(mechviz.load("crank-rocker"), frames=12), time.monotonic(), 0
    seen: list[tuple[float, int]] = []
    with tempfile.TemporaryDirectory() as folder:
        while made < count and time.monotonic() - begun < seconds:
            write_recording(run, Path(folder) / "a.rrd")
            made += 1
            seen.append((memory(), len(os.listdir("/proc/self/task"))))
    (early, threads), (late, now) = seen[made // 10], seen[-1]
    first, last = (f"{size / 1e6:.0f} MB and {number} threads" for size, number in ((early, threads), (late, now)))
    print(f"{made} recordings: {first} after {made // 10}, {last} in the end")
    return int(late - early > MOST_GROWN or now > threads)


if __name__ == "__main__":
    sys.exit(main(*(kind(text) for kind, text in zip((int, float), sys.argv[1:], strict=False))))
