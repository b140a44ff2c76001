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


def interleaved(jobs: dict[str, Callable[[], object]], *, runs: int = 7, seconds: float = 0.2) -> dict[str, float]:
    """Median time of each job [s]; the jobs take turns, each repeated until a turn lasts about ``seconds``."""
    repeats = {}
    for name, job in jobs.items():
        job()  # warm-up
        start = time.perf_counter()
        job()
        repeats[name] = max(1, int(seconds / max(time.perf_counter() - start, 1e-7)))
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(runs):
        for name, job in jobs.items():
            start = time.perf_counter()
            for _ in range(repeats[name]):
                job()
            times[name].append((time.perf_counter() - start) / repeats[name])
    return {name: statistics.median(t) for name, t in times.items()}


def machine(*packages: str) -> str:
    """The machine and the versions, for the head of a report."""
    versions = ", ".join(f"{p} {version(p)}" for p in packages)
    return f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {versions}; one thread"
