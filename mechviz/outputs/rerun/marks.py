"""Vertical lines in plots where something happens: rerun has none of its own, so they are series that run up and down."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.forces.friction.events import friction_lanes
from mechcore.motion.events import Event
from mechviz.outputs.rerun.paths import entity
from mechviz.outputs.rerun.streams import Static, Timelines
from mechviz.quantities.events import lanes_of
from mechviz.quantities.power_table import steady_lines

if TYPE_CHECKING:
    from mechviz.runs import Run


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


STATES = {
    "slips +": ("slips +", (84, 168, 255)),
    "slips -": ("slips −", (60, 110, 180)),
    "at rest": ("at rest", (120, 126, 136)),
    "moves": ("moves", (72, 160, 110)),
    "self-locking": ("self-locking", (240, 190, 60)),
    "jammed": ("jammed", (230, 60, 60)),
}
"""States of the lanes of friction, with their labels and colours."""

LANES = {
    "sticks": ("sticks", (230, 140, 60)),
    "slips +": ("slips +", (84, 168, 255)),
    "slips -": ("slips −", (60, 110, 180)),
    "free": ("free", (72, 160, 110)),
    "contact": ("rests on the stop", (230, 60, 60)),
    "touches": ("follower in contact", (72, 160, 110)),
    "flies": ("contact lost", (230, 60, 60)),
}
"""States of the lanes, with their labels and colours."""


def find_lanes(run: Run) -> tuple[dict[str, list[tuple[float, str]]], Mapping[str, tuple[str, tuple[int, int, int]]]]:
    """Changes of state (time [s], state) by lane, and labels and colours of the states: of joints with friction and the mechanism
    (slips, at rest, jammed); where forces decide the motion of joints, stops and cams."""
    if run.simulation is not None:
        return lanes_of(run.simulation), LANES
    return ({} if run.forces is None else friction_lanes(run.forces)), STATES


def lane_styles(run: Run) -> Iterator[Static]:
    """How lanes look."""
    import rerun as rr

    lanes, looks = find_lanes(run)
    labels, colors = (list(part) for part in zip(*looks.values(), strict=True))
    for name in lanes:
        yield Static(entity("state", name), rr.StateConfiguration(values=list(looks), labels=labels, colors=colors))


def send_lanes(stream: Any, timelines: Timelines, run: Run) -> None:
    """One row for every change of state."""
    import rerun as rr

    for name, changes in find_lanes(run)[0].items():
        times = np.array([t for t, _ in changes])
        stream.send_columns(
            entity("state", name), timelines.columns_at(times), rr.StateChange.columns(state=[s for _, s in changes])
        )


def simulation_notes(run: Run) -> list[str]:
    """How the motion was found, in lines of markdown."""
    s = run.simulation
    if s is None:
        return []
    drift = float(np.abs(s.drift(run.motion.time)).max(initial=0.0))
    how = {"energy": "by its energy, without steps in time", "gauss": "by Gauss collocation", "radau": "by Radau collocation"}
    lines = ["", "## Motion under forces", ""]
    lines.append(f"- found {how.get(s.method, s.method)}, tolerance {s.tolerance:.1e}, {s.evaluations} evaluations of windows")
    lines.append(f"- energy balance of the whole run: drift at most {drift:.1e} of the largest energy or work")
    if run.steady is not None:
        lines += [f"- {line}" for line in steady_lines(run.steady)]
    kinds: dict[str, int] = {}
    for h in s.events:
        kinds[h.kind] = kinds.get(h.kind, 0) + 1
    lines += [f"- {count} × {kind}" for kind, count in kinds.items()]
    return lines
