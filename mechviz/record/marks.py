"""Vertical lines in plots where something happens: rerun has none of its own, so they are series that run up and down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mechcore.events import Event

from .paths import entity
from .streams import Timelines

__all__ = ["MOST_MARKS", "mark_path", "mark_times", "send_marks"]

MOST_MARKS = 16  # more lines than these would hide the curves, and say nothing
COLOR = (118, 126, 140)


def mark_times(events: Sequence[Event]) -> np.ndarray:
    """Times [s] at which plots get a line; none where so much happens that lines would hide the curves."""
    times = np.unique([e.time for e in events])
    return times if len(times) <= MOST_MARKS else times[:0]


def mark_path(view: str) -> str:
    """The entity of the lines in a plot, which are as high as its axis."""
    return entity("plots", "events", view)


def send_marks(stream: Any, timelines: Timelines, times: np.ndarray, spans: Mapping[str, tuple[float, float]]) -> None:
    """Lines at times [s] for each plot, by its name, from one end of its axis to the other."""
    import rerun as rr

    if not len(times):
        return
    columns = timelines.columns_at(np.repeat(times, 3))
    look = rr.SeriesLines.from_fields(names=["events"], colors=[COLOR], widths=[1.0], aggregation_policy="Off")
    for view, (low, high) in spans.items():
        stream.log(mark_path(view), look, static=True)
        rows = np.tile([low, high, np.nan], len(times))  # the gap keeps neighbours apart
        stream.send_columns(mark_path(view), columns, rr.Scalars.columns(scalars=rows))
