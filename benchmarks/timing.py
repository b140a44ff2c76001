"""Timing side by side: alternating runs, medians, ratios. One thread, so that ratios do not depend on the cores."""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # before numpy is imported

import platform
import statistics
import time
from collections.abc import Callable
from importlib.metadata import version

__all__ = ["interleaved", "machine"]

SHORT = os.environ.get("MECHVIZ_BENCHMARKS") == "short"
"""What `report.py --short` asks of all scripts: a quarter of the time a turn, half of the turns."""


def interleaved(
    jobs: dict[str, Callable[[], object]],
    *,
    runs: int = 7,
    seconds: float = 0.2,
    pick: Callable[[list[float]], float] = statistics.median,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, float]:
    """Median time of each job [s]; the jobs take turns, each repeated until a turn lasts about ``seconds``.

    ``pick`` may take another value than the median, ``clock`` may be `time.process_time`: on a busy machine the least processor
    time is steadier.
    """
    if SHORT:
        runs, seconds = max(3, runs // 2), 0.25 * seconds
    repeats = {}
    for name, job in jobs.items():
        job()  # warm-up
        start = clock()
        job()
        repeats[name] = max(1, int(seconds / max(clock() - start, 1e-7)))
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(runs):
        for name, job in jobs.items():
            start = clock()
            for _ in range(repeats[name]):
                job()
            times[name].append((clock() - start) / repeats[name])
    return {name: pick(t) for name, t in times.items()}


def machine(*packages: str) -> str:
    """The machine and the versions, for the head of a report."""
    versions = ", ".join(f"{p} {version(p)}" for p in packages)
    return f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {versions}; one thread"
