"""Places and couples of recordings without what is only rounding, so that readers' balances of moments need no threshold.

Where all that acts on a link passes through its centre of mass, as on a piston that is a point, the moments about it are exactly
zero, or nothing but rounding of forces times coordinates, in which nothing balances. A joint or load at the centre of mass is
therefore recorded at the very place that follows from the link's pose, and couples below rounding are zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Real

if TYPE_CHECKING:
    from mechviz.runs import Run


NEAR = 1e-13  # relative to coordinates and sizes
FAR = 1e-6  # of the size: far beyond rounding


def onto_centres(run: Run, heavy: Sequence[str]) -> Callable[[Sequence[str], Real], Real]:
    """A function of links and a place (F, 2) [m] that gives the place, or the centre of mass of the first of the links (those
    ``heavy``) that it is but for rounding."""
    motion = run.motion

    @cache
    def centre_of(link: str) -> Real:
        pose, (_, centre, _) = motion.pose(link), motion.model.masses[motion.model.index[link]]
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        x, y = centre.real, centre.imag
        return np.asarray(pose[:, :2] + np.stack([c * x - s * y, s * x + c * y], axis=1))

    def placed(links: Sequence[str], place: Real) -> Real:
        for link in links:
            at = centre_of(link) if link in heavy else None
            if at is not None and place.shape == at.shape:
                if (np.abs(place[:1] - at[:1]) > FAR * motion.model.length_scale).any():
                    continue  # most places are elsewhere, which the first frame tells
                room = NEAR * (motion.model.length_scale + np.abs(np.nan_to_num(at)).max(initial=0.0))
                if not (np.abs(np.nan_to_num(place - at)) > room).any():
                    return np.where(np.isfinite(place), at, place)
        return place

    return placed


def without_noise(wrench: Real, size: float) -> Real:
    """Rows of force and moment (F, 3) with zero for moments that are rounding of the forces times ``size`` [m]."""
    force, moment = (np.abs(np.nan_to_num(part)).max(initial=0.0) for part in (wrench[:, :2], wrench[:, 2]))
    if 0.0 < moment <= NEAR * size * force:
        return np.column_stack([wrench[:, :2], np.where(np.isfinite(wrench[:, 2]), 0.0, wrench[:, 2])])
    return wrench
