"""Friction in a recording: lanes of states."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.friction.events import friction_lanes

from .paths import entity
from .streams import Static, Timelines

if TYPE_CHECKING:
    from ..run import Run

__all__ = ["STATES", "friction_styles", "send_lanes"]

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


def send_lanes(stream: Any, timelines: Timelines, run: Run) -> None:
    """One row for every change of a pair's state: slips, at rest, jammed; and of the mechanism: moves, self-locking, jammed."""
    if run.forces is None or run.forces.friction is None:
        return
    import rerun as rr

    for name, changes in friction_lanes(run.forces).items():
        times = np.array([t for t, _ in changes])
        stream.send_columns(
            entity("state", name), timelines.columns_at(times), rr.StateChange.columns(state=[s for _, s in changes])
        )
