"""The frames of a recording that a page shows, and rows of entities at them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechviz.outputs.rerun.reader import Recording, evenly

Real = NDArray[np.float64]
Index = NDArray[np.int64]

Progress = Callable[[int, int], None]
"""Is told how much is done, and of how much."""

MOST_FRAMES = 1000
"""Frames of a page, where nothing else is asked for. The browser moves smoothly between them."""


def quiet(done: int, total: int) -> None:
    """No progress bar."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The chosen frames (n,) of ``total``, their times and where the drives are."""

    chosen: Index
    total: int
    ns: Index
    drives: dict[str, Index]  # drive_mdeg, drive_um

    @property
    def time(self) -> Real:
        """Times [s]."""
        return 1e-9 * self.ns.astype(float)


def find_frames(recording: Recording, most: int, keep: float | None = None) -> Frames:
    """At most ``most`` frames of a recording, spread evenly over the run, the first and the last among them, and those on both
    sides of the time ``keep`` [s]."""
    rows = recording.rows("data", "links", recording.model["frame"], "pose", component="Scalars:scalars")
    whole = recording.frame_times
    total = len(rows.time) if whole is None else len(whole)
    chosen = evenly(total, most)
    if keep is not None:
        k = int(np.searchsorted(rows.time if whole is None else whole, round(1e9 * keep)))
        chosen = np.unique(np.append(chosen, np.clip([k - 1, k], 0, total - 1)))
    if whole is None:
        row = chosen
    else:  # those that have been read
        numbers = np.searchsorted(whole, rows.time)
        row = np.unique(np.clip(np.searchsorted(numbers, chosen), 0, len(numbers) - 1))
        chosen = numbers[row]
    return Frames(chosen, total, rows.time[row], {k: v[row] for k, v in rows.drives.items()})


def rows_at(recording: Recording, frames: Frames, path: str, *components: str) -> list[list[NDArray[Any]]] | None:
    """Rows of components of an entity at the frames: for each component a list with an array of instances a frame.

    A frame without a row of its own has the last one before it, as in rerun. None where there are no rows.
    """
    found = []
    for component in components:
        try:
            rows = recording.rows(path, component=component)
        except KeyError:
            return None
        if not len(rows.time):
            return None
        ends = np.cumsum(rows.lengths)
        row = np.searchsorted(rows.time, frames.ns, side="right") - 1
        empty = rows.values[:0]
        found.append([rows.values[ends[r] - rows.lengths[r] : ends[r]] if r >= 0 else empty for r in row])
    return found
