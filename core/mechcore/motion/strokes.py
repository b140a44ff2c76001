"""How far the outputs of a mechanism go over a run: range, stroke and time ratio."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mechcore.arrays import Real
from mechcore.motion.events import limit_positions
from mechcore.motion.motion import Motion

REST = 1e-9
"""Speeds below this part of the largest are rest: the run starts and ends in a limit position."""


@dataclass(frozen=True)
class Stroke:
    """Where the coordinate of an output goes over a run [rad or m].

    ``time_ratio``: the slower of the strokes to and fro over the quicker one, of a motion that repeats with two limit positions in
    a cycle; NaN of others. Source: R. L. Norton, Design of Machinery, "quick-return".
    """

    pair: str
    rotary: bool
    low: float
    high: float
    time_ratio: float

    @property
    def length(self) -> float:
        """The range [rad or m]."""
        return self.high - self.low


def strokes(motion: Motion, cycles: int = 1) -> list[Stroke]:
    """The strokes of all undriven pairs at the frame that move, over a run of so many ``cycles``."""
    return [_stroke(motion, pair, times, values, cycles) for pair, times, values in limit_positions(motion)]


def _stroke(motion: Motion, pair: str, times: Real, values: Real, cycles: int) -> Stroke:
    rows = motion.coordinate(pair)
    low, high = float(min([rows[:, 0].min(), *values])), float(max([rows[:, 0].max(), *values]))
    start, period = float(motion.time[0]), float(np.ptp(motion.time)) / cycles
    rests = np.abs(rows[[0, -1], 1]).max() <= REST * np.abs(rows[:, 1]).max()
    repeats = abs(rows[-1, 0] - rows[0, 0]) <= 1e-9 * (high - low)
    ratio = np.nan
    if repeats and len(motion.drives) == 1:
        ends = np.sort(np.concatenate([times, [start] if rests else []]))
        ends = ends[ends < start + period * (1.0 - REST)]
        if len(ends) == 2:
            there = float(ends[1] - ends[0])
            ratio = max(there, period - there) / min(there, period - there)
    return Stroke(pair, motion.model.rotary(pair), low, high, ratio)
