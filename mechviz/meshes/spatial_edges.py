"""Where the flanks of a barrel, end or globoidal cam meet its outer surface and the floor of its groove, in the cam's own axes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mechcore.cams.placed_spatial import PlacedSpatial

__all__ = ["circle", "edge"]

Real = NDArray[np.float64]

_ROUND = 360  # points of a ring
_ACROSS = 9  # places along the roller between which the flank is interpolated


def _depth(placed: PlacedSpatial, p: Real) -> Real:
    """How deep points (..., 3) of the cam lie, as the roller's axis counts: from the axis, of a globoid from the pivot's circle."""
    rho = np.hypot(p[..., 0], p[..., 1])
    if placed.blank.kind != "globoid":
        return rho
    distance = abs(placed.pivot - placed.centre) if placed.pivot is not None else 0.0
    return np.hypot(distance - rho, p[..., 2])


def edge(placed: PlacedSpatial, side: int, at: float, shift: float = 0.0, theta: Real | None = None) -> Real:
    """The line of a flank (n, 3) at a depth, over angles ``theta`` (n) or all around; ``shift``: of the follower's coordinate."""
    cam = placed.cam if shift == 0.0 else replace(placed.cam, law=placed.cam.law.raised(shift))
    law = cam.law
    theta = law.start + law.length * np.arange(_ROUND) / _ROUND if theta is None else theta
    low, high = cam.inner, cam.outer
    along = np.linspace(low - 0.3 * (high - low), high + 0.3 * (high - low), _ACROSS)
    p = cam.flank(theta, along, side).point
    depth = _depth(placed, p)
    k = np.clip((depth < at).sum(axis=1), 1, _ACROSS - 1)
    rows = np.arange(len(theta))
    a, b = p[rows, k - 1], p[rows, k]
    da, db = depth[rows, k - 1], depth[rows, k]
    return a + ((at - da) / (db - da))[:, None] * (b - a)


def circle(azimuth: Real, radius: float | Real, z: float | Real) -> Real:
    return np.stack(np.broadcast_arrays(radius * np.cos(azimuth), radius * np.sin(azimuth), np.asarray(z, float)), axis=-1)
