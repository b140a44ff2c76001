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
from .reduced import free_of, motion_at
from .retrace import Known

__all__ = ["Piece"]

Array = NDArray[np.float64]
SAMPLES = 257  # of a piece, by which its way is measured


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

    @property
    def leading(self) -> list[str]:
        """Pairs whose coordinates lead."""
        return [self.compiled.mechanism.drives[i].pair for i in free_of(self.compiled)]

    def known(self, scale: Array) -> Known:
        """What it says to one who looks for the same motion again; ``scale`` (f,): typical sizes of its coordinates."""
        if isinstance(self.way, Solution):
            windows = self.way.windows
            borders = np.array([*(w.start for w in windows), self.way.end])
            return Known(borders, np.array([w.cut for w in windows]), lambda t: self.way(t)[2])
        t = np.linspace(self.start, self.end, SAMPLES)
        far = float((np.abs(self.way(t)[1]).mean(axis=0) / scale).max()) * (self.end - self.start)
        borders = np.linspace(self.start, self.end, int(np.ceil(far)) + 5)
        return Known(borders, np.zeros(len(borders) - 1, bool), lambda t: self.way(t)[2])

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
