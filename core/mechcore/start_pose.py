"""The start pose: where relative angles of links begin.

A relative angle, of one link against another, starts in (-180 deg, 180 deg], or nearest to what is stated of it: the free angle of
a torsion spring, the stops of a joint, the tables over its coordinate. Where drives and rigid joints state it, it is as stated,
whole turns included. Nothing depends on where the x axis of the world points.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .laws import Table
from .model import Model
from .spec import Mechanism

__all__ = ["TURN", "Range", "StartPose", "start_pose"]

Array = Any
Real = NDArray[np.float64]
Range = tuple[float, float]

TURN = 2.0 * math.pi
TOUCH = 1e-6  # [rad] nearer than which a joint starts at its only stop, and not a turn away from it
TIE = 1e-9  # of a turn: angles so near to a border of their range are on it


@dataclass(frozen=True)
class StartPose:
    """Where the links stand at the start: ``angles`` [rad] by link, a number or one for each design (d, 1); links with the same
    number in ``stated`` have a relative angle that drives and rigid joints state. ``ranges`` [rad] nearest to which coordinates of
    joints start."""

    angles: Mapping[str, Array]
    stated: Mapping[str, int]
    ranges: Mapping[str, Range] = field(default_factory=dict)

    def turns(self, first: str, second: str, about: Range | None) -> Array:
        """Turns to be added to the angle of the second link minus that of the first, for it to start where it should."""
        if self.stated[first] == self.stated[second]:
            return 0.0
        angle = self.angles[second] - self.angles[first]
        turns = _turns_about(angle, 0.0)
        if about is None:
            return turns
        started = angle + TURN * turns
        low, high = about
        inside = (started >= low - TIE) & (started <= high + TIE) & (high - low > 0.0)
        return np.where(inside, turns, _turns_about(angle, 0.5 * (low + high)))

    def with_stops(self, stops: Iterable[Any]) -> StartPose:
        """The same with ranges of joints that have stops: these come first. Beside a single stop there is a turn of room."""
        found: dict[str, list[float]] = {}
        for stop in stops:
            low, high = found.setdefault(stop.pair, [-math.inf, math.inf])
            found[stop.pair] = [low, min(high, stop.at)] if stop.side == "upper" else [max(low, stop.at), high]
        ranges = dict(self.ranges)
        for joint, (low, high) in found.items():
            if high == math.inf:
                high = low + TURN - TOUCH
            elif low == -math.inf:
                low = high - TURN + TOUCH
            ranges[joint] = low, high
        return replace(self, ranges=ranges)


def _turns_about(angle: Array, about: float) -> Array:
    """Turns that bring an angle to within half a turn of another; half a turn is counted positive."""
    return np.floor((about + math.pi - angle) / TURN + TIE)


def _ranges_of_tables(mechanism: Mechanism) -> dict[str, Range]:
    """Ranges of the tables over coordinates of joints that loads of a mechanism have, all of a joint together, by joint."""
    found: dict[str, Range] = {}
    for load in mechanism.loads:
        factor = getattr(load, "factor", None)
        table = None if factor is None else factor.function
        if factor is not None and factor.of == "position" and factor.pair and isinstance(table, Table) and table.period is None:
            low, high = found.get(factor.pair, (math.inf, -math.inf))
            found[factor.pair] = min(low, table.x[0]), max(high, table.x[-1])
    return found


def start_pose(model: Model, spins: Real) -> StartPose:
    """The start pose of a mechanism whose spins have the angles ``spins`` (s, ...) there."""
    turning = model.angles
    return StartPose(
        {link: spins[turning.spin[k]] + turning.offset[k] for k, link in enumerate(model.links)},
        dict(zip(model.links, turning.group, strict=True)),
        _ranges_of_tables(model.mechanism),
    )
