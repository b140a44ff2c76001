"""Where values have no bound between two frames: singular positions that a motion passes, in which what a group carries or how fast
it moves grows as one over the distance.

A group's unknowns are N / D, with D the determinant of its columns. Where D changes its sign between two frames while N does not
vanish with it, there is a pole, which no interpolation of the frames shows; where both vanish together (a parallelogram that goes
straight through its flat position) there is none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechcore import blocks as bl

from .quantities import Quantity

__all__ = ["Passage", "passages_of", "size_at"]

Real = NDArray[np.float64]
MARKED = 1e-3  # part of the scale: jumps that are smaller may be rounding next to the singular position
NEAREST = 0.01  # of the distance of two frames: so near to a pole a value is told; nearer it has no bound


@dataclass(frozen=True)
class Passage:
    """A singular position between a frame and the next, after a ``share`` of their distance."""

    frame: int
    share: float


def passages_of(motion: Any) -> list[Passage]:
    """The singular positions between the frames of a motion."""
    whole = ((np.arange(motion.frames), motion),)
    return [found for rows, part in getattr(motion, "parts", whole) for found in _passages(np.asarray(rows), part)]


def _passages(rows: NDArray[np.intp], part: Any) -> Iterator[Passage]:
    for block, cols in zip(part.model.blocks, part.columns, strict=True):
        if block.kind in ("check", "relation"):
            continue
        if cols.pair is not None:
            determinant: Any = 1.0 / cols.inverse
        else:
            matrix, _ = bl.matrix_of(cols)
            if matrix.shape[-1] != matrix.shape[-2]:
                continue
            determinant = np.linalg.det(matrix)
        d = np.broadcast_to(determinant, (part.frames,))
        for k in np.flatnonzero((d[:-1] * d[1:] < 0.0) & (np.diff(rows) == 1)):
            yield Passage(int(rows[k]), float(d[k] / (d[k] - d[k + 1])))


def size_at(passage: Passage, q: Quantity) -> float:
    """How large a quantity gets at a singular position, `NEAREST` to it, relative to its scale; 0 where it has no pole there.

    At a pole it jumps from one side to the other by more than it changes before and after, and the other way.
    """
    k = passage.frame
    if q.kind == "position" or not 0 < k < len(q.values) - 2:
        return 0.0
    before, jump, after = np.diff(q.values[k - 1 : k + 3], axis=0)
    marked = np.abs(jump) > np.maximum(np.maximum(np.abs(before), np.abs(after)), MARKED * q.scale)
    pole = marked & (jump * before < 0.0) & (jump * after < 0.0)
    if not pole.any():
        return 0.0
    strength = np.abs(jump[pole]).max() * passage.share * (1.0 - passage.share)  # A of A / x, x in distances of frames
    return float(strength / NEAREST / q.scale)
