"""What a motion under forces adds to a recording: lanes of stick, slip and contact, notes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ..power_report import steady_lines
from ..quantities.simulated import lanes_of
from .paths import entity
from .streams import Static, Timelines

if TYPE_CHECKING:
    from mechcore.dynamics import Simulation

    from ..run import Run

__all__ = ["LANES", "send_lanes", "simulation_notes", "simulation_styles"]

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
    for h in s.happenings:
        kinds[h.kind] = kinds.get(h.kind, 0) + 1
    lines += [f"- {count} × {kind}" for kind, count in kinds.items()]
    return lines
