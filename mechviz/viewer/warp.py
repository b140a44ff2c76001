"""Solids that follow a length while it is dragged: every vertex goes with the points of its link that are near to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .show import Body, Piece

__all__ = ["warped", "warped_body"]

Points = Mapping[str, tuple[float, float]]
SHARPNESS = 2  # weights fall with this power of the squared distance: around a point the solid moves as a whole


def warped(xy: NDArray[np.float64], before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (V, 2) in a plane in which points ``before`` (P, 2) have moved to ``after`` (P, 2).

    Two points carry the plane with them: lengths along their line are stretched, those across it stay. In general each place
    moves by the mean of what the points move, weighted by inverse distance (Shepard's interpolation, 1968).
    """
    moves = after - before
    if not len(before) or not np.any(moves):
        return xy
    if len(before) == 1:
        return np.asarray(xy + moves[0])
    turn = np.ones(1, complex)
    if len(before) == 2:  # a bar: turned as a whole, then stretched between its ends
        a, b = (complex(*(p[1] - p[0])) for p in (before, after))
        if abs(a) > 0.0 and abs(b) > 0.0:
            turn = np.array([b / a / abs(b / a)])
            z = (xy[:, 0] - before[0, 0] + 1j * (xy[:, 1] - before[0, 1])) * np.conj(a) / abs(a)
            part = np.clip(z.real / abs(a), 0.0, 1.0)
            z = (z + part * (abs(b) - abs(a))) * a / abs(a) * turn + complex(*after[0])
            return np.column_stack([z.real, z.imag])
    square = ((xy[:, None] - before[None]) ** 2).sum(axis=-1)
    spread = float(np.ptp(before, axis=0).max()) or 1.0
    weights = 1.0 / (square / spread**2 + 1e-12) ** SHARPNESS
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray(xy + weights @ moves)


def warped_body(body: Body, before: Points, after: Points) -> Body:
    """A body whose link's points have moved; itself where they have not."""
    names = [name for name in before if name in after]
    old, new = (np.array([p[n] for n in names], float).reshape(-1, 2) for p in (before, after))
    if np.array_equal(old, new):
        return body
    pieces = []
    for piece in body.pieces:
        vertices = piece.vertices.copy()
        vertices[:, :2] = warped(piece.vertices[:, :2].astype(float), old, new)
        pieces.append(Piece(vertices, piece.faces, piece.color))
    return replace(body, pieces=tuple(pieces))
