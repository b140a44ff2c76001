"""Stretches of a motion in each of which one system of equations holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kinetostatics import Forces
from ..motion import Motion
from ..solve import Compiled
from .chart import Chart
from .curve import Curve
from .energy import EnergyMotion
from .happenings import Stop
from .integrate import Solution
from .reactions import piece_forces
from .reduced import motion_at

__all__ = ["Piece"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of the motion on which the same system holds: ``way(t)`` gives q, v, a (n, f) in the chart of ``compiled``."""

    start: float
    end: float
    compiled: Compiled
    way: Any
    system: Any
    resting: tuple[Stop, ...] = ()  # stops that something rests on
    lifted: tuple[str, ...] = ()  # cams that their followers have left: their guides' coordinates come after the others

    def __call__(self, t: Array) -> tuple[Array, Array, Array]:
        """Positions, speeds (n, f) by the dense output, accelerations by the equations of motion."""
        q, v, a = self.way(t)
        return q, v, a if isinstance(self.way, EnergyMotion) else self.system(q, v, t)

    def motion(self, t: Array) -> Motion:
        """The mechanism's motion at times (n,) within the piece; accelerations not from a table, so that links are in balance to
        the last digits."""
        q, v, _ = self.way(t)
        system = Chart(self.compiled) if isinstance(self.system, Curve) else self.system
        return motion_at(self.compiled, q, v, t, system(q, v, t))

    def forces(self, t: Array, motion: Motion) -> Forces:
        """All reactions of the piece's motion at times (n,)."""
        q, v, _ = self.way(t)
        return piece_forces(motion, self.system, q, v, self.resting)

    def goes_on(self, later: Piece) -> bool:
        """Whether a later stretch is more of the same: windows of one integration."""
        if not (isinstance(self.way, Solution) and isinstance(later.way, Solution)):
            return False
        same = self.system is later.system and (self.resting, self.lifted) == (later.resting, later.lifted)
        return same and self.end == later.start

    def with_windows(self, later: Sequence[Piece]) -> Piece:
        """This stretch and those in which it goes on."""
        windows = [w for piece in (self, *later) for w in piece.way.windows] if later else []
        return replace(self, end=later[-1].end, way=Solution(windows)) if later else self
