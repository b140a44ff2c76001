"""Slots, guides and cylinders with ends: where a motion would carry a pin or slider beyond them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Real, Values
from mechcore.kinematics.model import Model
from mechcore.kinematics.state import State
from mechcore.motion.extremes import peak
from mechcore.motion.motion import Motion

SLACK = 1e-9  # of the mechanism's size: rounding may carry one so far beyond an end


@dataclass(frozen=True)
class Escape:
    """A pin or slider beyond an end of its slot or guide: the joint, that end's coordinate [m], how far it goes beyond [m], at
    which frames (F,), and when it is farthest [s], which may be between two frames."""

    joint: str
    end: float
    beyond: float
    frames: Flags
    time: float


def _excesses(motion: Motion) -> Iterator[tuple[str, float, Any]]:
    """Joint, end and a function of motions: how far its pin is beyond that end (F,) [m], negative within the slot."""
    model = motion.model
    for name, ends in motion.mechanism.ends.items():
        j = model.joint_index[name]
        for end, sign in zip(ends, (-1.0, 1.0), strict=True):

            def excess(at: Motion, j: int = j, end: float = end, sign: float = sign) -> Real:
                beyond = sign * (np.asarray(at.state.slide[j]) - end)
                return np.broadcast_to(beyond, np.broadcast_shapes(beyond.shape, (at.frames,)))

            yield name, end, excess


def room_in_slots(model: Model, state: State) -> list[Values]:
    """How far pins and sliders are from their ends [m] (...), negative beyond, by end."""
    joints = [(state.slide[model.joint_index[name]], ends) for name, ends in model.mechanism.ends.items()]
    return [room for slide, (low, high) in joints for room in (slide - low, high - slide)]


def within_slots(motion: Motion) -> Flags:
    """Whether all pins and sliders are between their ends (F,)."""
    slack = SLACK * motion.model.length_scale
    found: Flags = np.ones(motion.frames, bool)
    for _, _, excess in _excesses(motion):
        found = found & ~(excess(motion) > slack)
    return found


def escapes(motion: Motion) -> list[Escape]:
    """Where a motion carries pins and sliders beyond their ends, between its frames too."""
    slack, found = SLACK * motion.model.length_scale, []
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
