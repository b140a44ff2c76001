"""The frames of a run that a page shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mechcore.arrays import Integers, Real
from mechviz.outputs.presentation import Presentation
from mechviz.outputs.rerun.reader import evenly

Progress = Callable[[int, int], None]
"""Is told how much is done, and of how much."""

MOST_FRAMES = 1000
"""Frames of a page, where nothing else is asked for. The browser moves smoothly between them."""


def quiet(done: int, total: int) -> None:
    """No progress bar."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The chosen frames (n,) of the ``total`` of a run, their ``rows`` in what is shown, and their ``time`` [s]."""

    chosen: Integers
    total: int
    rows: Integers
    time: Real


def find_frames(shown: Presentation, most: int, keep: float | None = None) -> Frames:
    """At most ``most`` frames, spread evenly over the run, the first and the last among them, and those on both sides of the time
    ``keep`` [s]."""
    time, last = shown.picture.time, len(shown.picture.time) - 1
    rows = np.clip(np.searchsorted(shown.chosen, evenly(shown.total, most)), 0, last)
    if keep is not None:
        k = int(np.searchsorted(time, keep - 1e-9))  # times in a recording are whole nanoseconds
        rows = np.append(rows, np.clip([k - 1, k, k + 1], 0, last))
    rows = np.unique(rows)
    return Frames(shown.chosen[rows], shown.total, rows, time[rows])
