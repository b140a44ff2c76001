"""What a roller in a groove has in common however the groove is made: a law of one argument, a place on a carrier."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .followers import Roller
from .placed import argument_of, on_knots, segment_of

if TYPE_CHECKING:
    from ..motion import Motion

__all__ = ["PlacedRoller"]

Array = Any
Real = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedRoller:
    """``links`` are those of the pair. A place w of the theory's ground axes in the plane lies at ``centre + axes w`` on the
    ``carrier``; ``guide`` is the pair that guides the driven link, ``bed`` the one on which a driving link slides.

    ``own``: where the theory's origin lies in the axes of the link that carries the groove.
    """

    name: str
    links: tuple[str, str]
    carrier: str
    guide: str
    cam: Any  # the theory: its ``law`` [m or rad] of the driving coordinate, and the roller's ``radius`` [m]
    centre: complex
    axes: complex
    own: complex
    sense: int
    pressure_limit: float | None
    form: bool
    base: float = 0.0
    phase: float = 0.0
    bed: str | None = None
    ahead: float = 1.0
    bridges: tuple[Any, ...] = ()
    lost: tuple[Any, ...] = ()
    intended: None = None
    mate: None = None

    @property
    def pace(self) -> float:
        """How far the driven coordinate goes on per unit of the law's argument, on average; 0 where it returns."""
        return 0.0

    @property
    def side(self) -> int:
        return 1

    @property
    def face(self) -> Roller:
        return Roller(self.cam.radius)

    @property
    def knots(self) -> Real:
        return np.asarray(self.cam.law.knots)

    def law(self, argument: Array) -> Array:
        """The driven coordinate and its first two derivatives with respect to the law's argument, (3, ...)."""
        x, known = self.known(argument)
        values, law = self.cam.law(x, 2), self.cam.law
        if law.repeats and law.advance != 0.0:  # arguments on a knot are those of the first cycle
            values[0] += law.advance * np.rint((np.where(known, argument, x) - x) / law.length)
        return np.where(known, values, np.nan)

    def known(self, argument: Array) -> tuple[Array, Array]:
        """Arguments put on the law's knots, those that are NaN replaced by its start, and which are known."""
        x = on_knots(self.cam.law, np.asarray(argument, float))
        known = np.isfinite(x)
        return np.where(known, x, self.cam.law.start), known

    def argument(self, motion: Motion) -> Real:
        """The law's argument (F): [rad] within one turn, or [m] of a driving link that slides."""
        return argument_of(self, motion)

    def segment(self, motion: Motion) -> Real:
        """Number of the segment of the law in which the cam is, by frame (F)."""
        return segment_of(self, motion)

    def world(self, motion: Motion) -> Array:
        """Direction of the theory's first axis in the world (F), complex."""
        return self.axes * motion.rotation(motion.model.index[self.carrier])

    def place(self, motion: Motion, w: Array) -> Array:
        """Places of the theory's ground axes in the world."""
        k = motion.model.index[self.carrier]
        return motion.of_point(k, 0j) + motion.rotation(k) * (self.centre + self.axes * w)
