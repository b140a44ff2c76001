"""Reactions in a stretch of motion: with the friction that forward dynamics found, and with what end stops hold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..effects import sum_up
from ..effects.pair_effort import pair_wrench
from ..kinetostatics import Forces, solve_forces, transmit
from ..motion import Motion
from .chart import jacobian_of
from .dry import DrySystem, forces_with
from .free import Free
from .happenings import Stop
from .reduced import tangents

__all__ = ["STOP", "piece_forces", "stop_name"]

Array = NDArray[np.float64]
STOP = "stop"  # kind and cause of what an end stop holds


def stop_name(stop: Stop) -> str:
    """Name of an end stop among the loads."""
    return f"stop {stop.name}"


def piece_forces(motion: Motion, system: Any, q: Array, v: Array, resting: Sequence[Stop]) -> Forces:
    """All reactions of a motion in which one system holds; q, v (n, f): free coordinates and their rates.

    ``resting``: stops that something rests on. What it takes to hold that is a load on the two links of the stop's pair; nothing is
    left for the free coordinates to do.
    """
    rubs = isinstance(system, DrySystem)
    forces = forces_with(motion, system, q, v) if rubs else solve_forces(motion)
    if not resting:
        return forces
    free = [i for i, d in enumerate(motion.mechanism.drives) if isinstance(d.law, Free)]
    rows, _ = jacobian_of(motion, tangents(motion, free), [stop.pair for stop in resting])
    efforts = np.stack([forces.effort(motion.mechanism.drives[i].pair) for i in free], axis=1)
    inner = rows @ rows.swapaxes(1, 2)
    found = np.linalg.solve(inner, rows @ efforts[..., None])[..., 0]
    held = [
        pair_wrench(motion, stop.pair, effort, name=stop_name(stop), kind=STOP, cause=STOP)
        for stop, effort in zip(resting, found.T, strict=True)
    ]
    if rubs:
        return forces_with(motion, system, q, v, held)
    applied = (*forces.applied, *held)
    loads = sum_up(list(applied), len(motion.model.links))
    return Forces(motion, applied, *transmit(motion, *loads)[:2], forces.friction)
