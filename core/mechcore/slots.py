"""Slots with ends: where a motion would carry a pin out of its slot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .blocks import State
from .extremes import peak
from .model import Model
from .motion import Motion
from .spec import Mechanism, PinSlot

__all__ = ["Escape", "escapes", "has_ends", "room_in_slots", "within_slots"]

Array = Any
SLACK = 1e-9  # of the mechanism's size: rounding may carry a pin so far beyond an end


@dataclass(frozen=True)
class Escape:
    """A pin beyond an end of its slot: the joint, that end's coordinate [m], how far it goes beyond [m], at which frames (F,), and
    when it is farthest [s], which may be between two frames."""

    joint: str
    end: float
    beyond: float
    frames: Array
    time: float


def has_ends(mechanism: Mechanism) -> bool:
    """Whether a mechanism has a slot with ends."""
    return any(isinstance(pair, PinSlot) and pair.ends is not None for pair in mechanism.pairs)


def _excesses(motion: Motion) -> Iterator[tuple[str, float, Any]]:
    """Joint, end and a function of motions: how far its pin is beyond that end (F,) [m], negative within the slot."""
    model = motion.model
    for pair in motion.mechanism.pairs:
        if isinstance(pair, PinSlot) and pair.ends is not None:
            j = model.joint_index[pair.name]
            for end, sign in zip(pair.ends, (-1.0, 1.0), strict=True):

                def excess(at: Motion, j: int = j, end: float = end, sign: float = sign) -> Array:
                    beyond = sign * (np.asarray(at.state.slide[j]) - end)
                    return np.broadcast_to(beyond, np.broadcast_shapes(beyond.shape, (at.frames,)))

                yield pair.name, end, excess


def room_in_slots(model: Model, state: State) -> list[Array]:
    """How far pins are from the ends of their slots [m] (...), negative beyond, by end."""
    joints = [(model.joint_index[p.name], p.ends) for p in model.mechanism.pairs if isinstance(p, PinSlot) and p.ends is not None]
    return [room for j, (low, high) in joints for room in (state.slide[j] - low, high - state.slide[j])]


def within_slots(motion: Motion) -> Array:
    """Whether all pins are between the ends of their slots (F,)."""
    slack = SLACK * motion.model.size
    found: Array = np.ones(motion.frames, bool)
    for _, _, excess in _excesses(motion):
        found = found & ~(excess(motion) > slack)
    return found


def escapes(motion: Motion) -> list[Escape]:
    """Where a motion carries pins beyond the ends of their slots, between its frames too."""
    slack, found = SLACK * motion.model.size, []
    for joint, end, excess in _excesses(motion):
        values = excess(motion)
        outside = values > slack
        farthest = int(np.argmax(np.where(np.isfinite(values), values, -np.inf)))
        time, beyond = float(motion.time[farthest]), float(values.flat[farthest])
        step = float(np.max(np.abs(np.diff(values)), initial=0.0))
        if not outside.any() and beyond > -step:  # perhaps between two frames
            time, beyond = peak(motion, excess)
        if beyond > slack:
            found.append(Escape(joint, end, beyond, outside, time))
    return found
