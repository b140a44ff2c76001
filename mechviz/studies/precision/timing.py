"""Times that mean something: warmed up, repeated, the median with its spread, and the machine that they were taken on."""

from __future__ import annotations

import gc
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

LEAST, MOST = 3, 25
BUDGET = 0.25  # seconds of repeats: quick work is repeated more often


@dataclass(frozen=True)
class Timed:
    """Median [s] of ``repeats`` runs after one that does not count, and the distance of their quartiles [s]."""

    seconds: float
    spread: float
    repeats: int


def timed(work: Callable[[], Any], budget: float = BUDGET, least: int = LEAST) -> Timed:
    """Time some work: once to warm up, then until the budget is spent, at least ``least`` and at most 25 times."""
    work()
    times: list[float] = []
    collecting = gc.isenabled()
    gc.disable()
    try:
        while len(times) < least or (sum(times) < budget and len(times) < MOST):
            start = time.perf_counter()
            work()
            times.append(time.perf_counter() - start)
    finally:
        if collecting:
            gc.enable()
    return _timed(times)


def _timed(times: list[float]) -> Timed:
    low, _, high = statistics.quantiles(times, n=4) if len(times) > 1 else (times[0],) * 3
    return Timed(statistics.median(times), high - low, len(times))


def side_by_side(
    first: Callable[[], Any], second: Callable[[], Any], budget: float = BUDGET, least: int = LEAST
) -> tuple[Timed, Timed]:
    """Time two works in turns, so that whatever else the machine does meets both alike."""
    for work in (first, second):
        work()
    times: tuple[list[float], list[float]] = ([], [])
    while len(times[0]) < least or (sum(times[0]) < budget and len(times[0]) < MOST):
        for work, own in ((first, times[0]), (second, times[1])):
            start = time.perf_counter()
            work()
            own.append(time.perf_counter() - start)
    return _timed(times[0]), _timed(times[1])


@contextmanager
def used() -> Iterator[Callable[[], float]]:
    """What share of the time in its block this program had the processor for: told, at most 1, by what it gives."""
    wall, own = time.perf_counter(), time.process_time()
    found = [1.0]
    yield lambda: found[0]
    found[0] = min(1.0, (time.process_time() - own) / max(time.perf_counter() - wall, 1e-9))


def machine() -> str:
    """The machine in a line: processor, cores, system, Python and numpy."""
    cpu = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                cpu = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass  # no such file on this system
    return f"{cpu}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}, numpy {np.__version__}"
