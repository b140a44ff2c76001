"""Plane force systems: reduced to a point, and to the simplest system that does the same (a force, a couple, nothing).

Arrays may have leading axes, such as frames: points and forces (..., n, 2), couples (..., n).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechcore.arrays import Real
from mechcore.constants import ZERO_SUM
from mechcore.records import dataclass

KINDS = ("equilibrium", "couple", "single force")


def _cross(a: Real, b: Real) -> Real:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def moment_about(points: ArrayLike, forces: ArrayLike, about: ArrayLike = (0.0, 0.0)) -> Real:
    """Moments (..., n) [N m] of forces (..., n, 2) [N] at points (..., n, 2) [m] about a point (..., 2), counter-clockwise
    positive."""
    p, f, o = (np.asarray(x, float) for x in (points, forces, about))
    return _cross(p - (o[..., None, :] if o.ndim > 1 else o), f)


def reduce_to(
    points: ArrayLike, forces: ArrayLike, couples: ArrayLike | None = None, *, about: ArrayLike = (0.0, 0.0)
) -> tuple[Real, Real]:
    """A force system reduced to a point: main vector (..., 2) [N], which no choice of the point changes, and main moment (...)
    [N m] about it."""
    force = np.asarray(forces, float).sum(axis=-2)
    moment = moment_about(points, forces, about).sum(axis=-1)
    return force, moment if couples is None else moment + np.asarray(couples, float).sum(axis=-1)


@dataclass(frozen=True, eq=False)
class Resultant:
    """The simplest system that replaces a force system.

    ``kind`` (...): one of `KINDS`. ``force`` (..., 2) [N]; ``moment`` (...) [N m] about the origin, which of a couple is the same
    about any point. ``point`` (..., 2) [m]: the point of the line of action nearest to the origin, NaN where there is no
    single force.
    """

    kind: NDArray[np.str_]
    force: Real
    moment: Real
    point: Real

    @property
    def magnitude(self) -> Real:
        return np.hypot(self.force[..., 0], self.force[..., 1])

    @property
    def direction(self) -> Real:
        """Unit vector (..., 2) of a single force, NaN where there is none."""
        with np.errstate(invalid="ignore", divide="ignore"):
            unit = self.force / self.magnitude[..., None]
        return np.where((self.kind == KINDS[2])[..., None], unit, np.nan)

    def nearest(self, to: ArrayLike) -> Real:
        """The point (..., 2) [m] of the line of action that is nearest to a given one (..., 2)."""
        away = np.asarray(to, float) - self.point
        unit = self.direction
        return self.point + np.asarray((away * unit).sum(axis=-1))[..., None] * unit


def resultant(points: ArrayLike, forces: ArrayLike, couples: ArrayLike | None = None) -> Resultant:
    """The resultant of a force system: a single force on its line of action, a couple, or equilibrium.

    The line is at the distance M / R of the point to which the system was reduced. What is left of forces that cancel counts
    as zero
    below 1e-12 of their sum, moments below 1e-12 of the sum of forces times the system's extent.
    """
    p, f = np.asarray(points, float), np.asarray(forces, float)
    p = np.broadcast_to(p, np.broadcast_shapes(p.shape, f.shape))
    middle = p.mean(axis=-2)  # reduced to the middle first: the least rounding where the system lies far from the origin
    force, moment = reduce_to(p, f, couples, about=middle)
    sizes = np.hypot(f[..., 0], f[..., 1])
    extent = np.hypot(*np.moveaxis(p - middle[..., None, :], -1, 0)).max(axis=-1)
    turning = (sizes * extent[..., None]).sum(axis=-1)
    if couples is not None:
        turning = turning + np.abs(np.asarray(couples, float)).sum(axis=-1)
    square = (force**2).sum(axis=-1)
    pushes = np.sqrt(square) > ZERO_SUM * sizes.sum(axis=-1)
    turns = np.abs(moment) > ZERO_SUM * turning
    kind = np.where(pushes, KINDS[2], np.where(turns, KINDS[1], KINDS[0]))
    force = np.where(pushes[..., None], force, 0.0)
    moment = np.where(pushes | turns, moment, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        # the arm at right angles to the force with arm x force = moment
        on_line = middle + np.stack([force[..., 1], -force[..., 0]], axis=-1) * (moment / square)[..., None]
        unit = force / np.sqrt(square)[..., None]
        point = on_line - (on_line * unit).sum(axis=-1)[..., None] * unit
    point = np.where(pushes[..., None], point, np.nan)
    about_origin = moment + _cross(middle, force)
    return Resultant(kind=np.asarray(kind, dtype=np.str_), force=force, moment=about_origin, point=point)
