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
    from mechcore.dynamics.simulation import Simulation
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
"""States of the lanes, with their labels and colours."""


def friction_styles(run: Run) -> Iterator[Static]:
    """How lanes look; those of a motion under forces know sticking and contact."""
    if run.forces is None or run.forces.friction is None or run.simulation is not None:
        return
    import rerun as rr

    look = rr.StateConfiguration(
        values=list(STATES), labels=[label for label, _ in STATES.values()], colors=[color for _, color in STATES.values()]
    )
    for name in (*run.forces.friction.pairs, "mechanism"):
        yield Static(entity("state", name), look)


def send_friction_lanes(stream: Any, timelines: Timelines, run: Run) -> None:
    """One row for every change of a pair's state: slips, at rest, jammed; and of the mechanism: moves, self-locking, jammed."""
    if run.forces is None or run.forces.friction is None:
        return
    import rerun as rr

    for name, changes in friction_lanes(run.forces).items():
        times = np.array([t for t, _ in changes])
        stream.send_columns(
            entity("state", name), timelines.columns_at(times), rr.StateChange.columns(state=[s for _, s in changes])
        )


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


def send_lanes(stream: Any, timelines: Timelines, simulation: Simulation) -> None:
    """One row for every change of state."""
    import rerun as rr

    for name, changes in lanes_of(simulation).items():
        times = np.array([t for t, _ in changes])
        stream.send_columns(
            entity("state", name), timelines.columns_at(times), rr.StateChange.columns(state=[s for _, s in changes])
        )


def simulation_styles(run: Run) -> Iterator[Static]:
    """How lanes look."""
    if run.simulation is None:
        return
    import rerun as rr

    look = rr.StateConfiguration(
        values=list(LANES), labels=[label for label, _ in LANES.values()], colors=[color for _, color in LANES.values()]
    )
    for name in lanes_of(run.simulation):
        yield Static(entity("state", name), look)


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
