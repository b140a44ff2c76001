"""Whether a profile crosses itself: then it encloses no body that could be a cam."""

from __future__ import annotations

import numpy as np

from .contour import Contour

__all__ = ["self_crossing"]

SEGMENTS = 720  # chords round the profile, at least
_NEAR = 1e-9  # parts of a chord by which it may miss the other, and of the profile below which points are one


def self_crossing(contour: Contour) -> complex | None:
    """A place [m] where a closed contour crosses or touches itself, None of a simple one; by its chords.

    Two chords that are no neighbours meet where ``a + t r = b + s q`` has both parameters in [0, 1]; pairs whose middles are
    farther apart than the longest chord cannot.
    """
    from scipy.spatial import cKDTree

    z = contour.samples(max(2, -(-SEGMENTS // contour.count) + 1))[2]
    z = z[np.abs(z - np.roll(z, 1)) > _NEAR * contour.size]
    way = np.roll(z, -1) - z
    middle = z + 0.5 * way
    tree = cKDTree(np.column_stack([middle.real, middle.imag]))
    i, j = tree.query_pairs(float(np.abs(way).max(initial=0.0)) * (1.0 + _NEAR), output_type="ndarray").T
    apart = j - i  # i < j
    i, j = (k[(apart > 1) & (apart < len(z) - 1)] for k in (i, j))
    gap, det = z[j] - z[i], np.imag(np.conj(way[i]) * way[j])
    clear = np.abs(det) > _NEAR * np.abs(way[i] * way[j])  # not parallel
    i, gap, det, other, own = i[clear], gap[clear], det[clear], way[j[clear]], way[i[clear]]
    t, s = np.imag(np.conj(gap) * other) / det, np.imag(np.conj(gap) * own) / det
    met = np.flatnonzero((np.abs(t - 0.5) <= 0.5 + _NEAR) & (np.abs(s - 0.5) <= 0.5 + _NEAR))
    return complex(z[i[met[0]]] + t[met[0]] * own[met[0]]) if met.size else None
