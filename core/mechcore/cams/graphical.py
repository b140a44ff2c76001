"""The graphical method of the lecture, with its error: the lift drawn point by point, differentiated twice by chords or
tangents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import Fault, MechanismError
from .analysis import analyse
from .contour import Contour
from .followers import Follower

__all__ = ["Graphical", "graphical"]

Real = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Graphical:
    """Angles (n) and what the drawing gives there: coordinate, velocity, acceleration, (3, n); ``exact`` (3, n); their
    difference."""

    angle: Real
    drawn: Real
    exact: Real

    @property
    def error(self) -> Real:
        return self.drawn - self.exact

    @property
    def largest(self) -> Real:
        """Largest error of each row, relative to the largest exact value of the row (3)."""
        return np.abs(self.error).max(axis=1) / np.maximum(np.abs(self.exact).max(axis=1), 1e-300)


def graphical(
    contour: Contour,
    follower: Follower,
    divisions: int = 24,
    method: Literal["chord", "tangent"] = "chord",
    resolution: float = 0.0,
    turn: int = 1,
) -> Graphical:
    """The cam turned step by step over one turn, the lift laid off at each step and differentiated graphically twice.

    "chord": slopes of the chords belong to the middles of the steps; the velocity drawn at a division is the mean of
    both neighbours, the acceleration the slope between them. "tangent": the tangent at a division laid by eye through both
    neighbours (its slope), twice. ``resolution`` [m or rad]: what can be read off the drawing; lifts are rounded to it.
    """
    if divisions < 4:
        raise MechanismError(Fault("graphical.divisions", f"{divisions}", "Divide the turn into at least 4 steps."))
    angle = 2.0 * np.pi * np.arange(divisions) / divisions
    exact = analyse(contour, follower, angle, turn, bridges=False).motion[:3]
    s = exact[0].copy()
    if resolution > 0.0:
        s = resolution * np.round(s / resolution)
    step = 2.0 * np.pi / divisions
    if method == "chord":
        chord = (np.roll(s, -1) - s) / step  # at the middle of the step that follows
        v, a = 0.5 * (chord + np.roll(chord, 1)), (chord - np.roll(chord, 1)) / step
    elif method == "tangent":
        v = (np.roll(s, -1) - np.roll(s, 1)) / (2.0 * step)
        a = (np.roll(v, -1) - np.roll(v, 1)) / (2.0 * step)
    else:
        raise MechanismError(Fault("graphical.method", f"'{method}' is none.", "Give 'chord' or 'tangent'."))
    return Graphical(angle, np.array([s, v, a]), exact)
