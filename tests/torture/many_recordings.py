"""Many recordings in one process: memory and threads stay flat.

    python tests/torture/many_recordings.py --count 1000

A fault is a process that has grown by more than 20 MB after the first tenth, or by a thread.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from budget import Tally, options

import mechviz
from mechviz.outputs.rerun.writer import write_recording
from mechviz.runs import run_scene

MOST_GROWN = 20e6  # bytes


def memory() -> float:
    """Memory of this process [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * float(os.sysconf("SC_PAGE_SIZE"))


def main() -> int:
    """Writes recordings; gives 1 where memory or threads have grown."""
    given = options(__doc__, 1000, first=False).parse_args()
    run, tally = run_scene(mechviz.load("crank-rocker"), frames=12), Tally(given.count, given.seconds)
    seen: list[tuple[float, int]] = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in tally.cases():
            write_recording(run, Path(folder) / "a.rrd")
            seen.append((memory(), len(os.listdir("/proc/self/task"))))
    (early, threads), (late, now) = seen[len(seen) // 10], seen[-1]
    first, last = (f"{size / 1e6:.0f} MB and {number} threads" for size, number in ((early, threads), (late, now)))
    words = f"{first} after {len(seen) // 10} recordings, {last} in the end"
    if late - early > MOST_GROWN or now > threads:
        tally.fault(words)
    return tally.end(words)


if __name__ == "__main__":
    sys.exit(main())
