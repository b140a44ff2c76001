"""Friction in a recording: friction circles with the lines of action that touch them, lanes of states."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechcore.friction.events import friction_lanes

from .paths import entity
from .streams import Index, Static, Stream, Timelines, in_space

if TYPE_CHECKING:
    from ..meshes import Solids
    from ..run import Run

__all__ = ["STATES", "friction_streams", "friction_styles", "send_lanes"]

Real = NDArray[np.float64]

STATES = {
    "slips +": ("slips +", (84, 168, 255)),
    "slips -": ("slips −", (60, 110, 180)),
    "at rest": ("at rest", (120, 126, 136)),
    "moves": ("moves", (72, 160, 110)),
    "self-locking": ("self-locking", (240, 190, 60)),
    "jammed": ("jammed", (230, 60, 60)),
}
"""States of the lanes, with their labels and colours."""

COLOR = (255, 214, 92)
CIRCLE_POINTS = 48
LINE = 0.12  # half of a drawn line of action, in sizes of the mechanism


def friction_streams(run: Run, solids: Solids, every: int) -> Iterator[Stream]:
    """Friction circle of every pin, true to scale, with the line of action of its reaction, which touches it."""
    if run.forces is None or run.forces.friction is None:
        return
    import rerun as rr

    forces, friction = run.forces, run.forces.friction
    z = solids.z_top + 0.012 * solids.size
    turn = np.linspace(0.0, 2.0 * np.pi, CIRCLE_POINTS)
    around = np.column_stack([np.cos(turn), np.sin(turn)])
    for e in friction.elements:
        if e.kind != "pin":
            continue
        place, reaction = forces.position(e.pair), forces.reaction(e.pair)
        size = np.hypot(reaction[:, 0], reaction[:, 1])
        with np.errstate(invalid="ignore", divide="ignore"):
            along = reaction[:, :2] / size[:, None]
            arm = friction.wrench(e.pair)[:, 2] / size  # the moment about the pin is that of the force on its line of action
        touch = place + arm[:, None] * np.column_stack([along[:, 1], -along[:, 0]])
        there = np.isfinite(touch).all(axis=1)

        def circle(frames: Index, place: Real = place, radius: float = e.factor) -> Any:
            strips = place[frames][:, None] + radius * around
            return rr.LineStrips3D.columns(strips=in_space(strips.reshape(-1, 2), z).reshape(-1, CIRCLE_POINTS, 3))

        def line(frames: Index, touch: Real = touch, along: Real = along, there: Any = there) -> Any:
            shown = frames[there[frames]]
            half = LINE * solids.size * along[shown]
            ends = np.stack([touch[shown] - half, touch[shown] + half], axis=1)
            strips = in_space(ends.reshape(-1, 2), z).reshape(-1, 2, 3)
            return rr.LineStrips3D.columns(strips=strips).partition(there[frames].astype(np.int64))

        yield Stream(entity("vectors", "friction", e.pair, "circle"), circle, every)
        yield Stream(entity("vectors", "friction", e.pair, "line"), line, every)


def friction_styles(run: Run, solids: Solids) -> Iterator[Static]:
    """How circles, lines and lanes look."""
    if run.forces is None or run.forces.friction is None:
        return
    import rerun as rr

    friction = run.forces.friction
    for e in friction.elements:
        if e.kind == "pin":
            thin = rr.LineStrips3D.from_fields(colors=[COLOR], radii=[0.0018 * solids.size])
            yield Static(entity("vectors", "friction", e.pair, "circle"), thin)
            yield Static(entity("vectors", "friction", e.pair, "line"), thin)
    if run.simulation is not None:
        return  # its lanes know sticking and contact
    look = rr.StateConfiguration(
        values=list(STATES), labels=[label for label, _ in STATES.values()], colors=[color for _, color in STATES.values()]
    )
    for name in (*friction.pairs, "mechanism"):
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
