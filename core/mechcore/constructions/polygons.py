"""Polygons of vectors laid end to end, of which graphical constructions are made, and the places where they are meant to meet.

Values are in the quantity's own unit (m/s, m/s^2, N); whoever draws them chooses a scale. Plane vectors are complex, (F,) each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Real


@dataclass(frozen=True, eq=False)
class Edge:
    """A vector (F,) drawn from ``start`` (F,), with the name that stands at it.

    ``kind``: "absolute", "relative", "normal", "tangential", "coriolis", "sliding" of motions; "reaction", "reaction normal",
    "reaction tangential", "inner", "load", "inertia", "gravity", "resultant", "ray" of forces.
    """

    name: str
    kind: str
    start: Complex
    vector: Complex

    @property
    def end(self) -> Complex:
        return self.start + self.vector


@dataclass(frozen=True, eq=False)
class Plan:
    """A polygon of vectors over all frames.

    ``images``: named corners (F,). ``gap`` (F,): the largest distance between where a chain of sides ends and where it has to end,
    in the plan's ``unit``.
    """

    name: str
    unit: str
    edges: tuple[Edge, ...]
    images: dict[str, Complex]
    gap: Real

    @property
    def largest(self) -> Real:
        """The longest side of each frame (F,)."""
        return largest_side(self.edges, len(self.gap))

    @property
    def closing(self) -> Real:
        """Closing error relative to the longest side of the run (F,): 0 where there is no side at all."""
        most = float(np.nanmax(self.largest, initial=0.0))
        return self.gap / most if most > 0.0 else np.zeros_like(self.gap)


def largest_side(edges: tuple[Edge, ...], frames: int) -> Real:
    longest = np.zeros(frames)
    for e in edges:
        longest = np.fmax(longest, np.abs(e.vector))
    return longest


def frames_of(value: ArrayLike, frames: int) -> Complex:
    """A value over all frames, complex."""
    return np.array(np.broadcast_to(np.asarray(value, complex), (frames,)))
