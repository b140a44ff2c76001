"""Marks on belts and chains that show how they run: sleeves around the belt, evenly along it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .held import held
from .riders import Rider

if TYPE_CHECKING:
    from .meshes import Solids
    from .meshes.bands import Loop
    from .run import Run

__all__ = ["find_belt_marks", "way_of"]

Real = NDArray[np.float64]

MARKS = 8  # on a belt
LONG = 1.1  # of a mark, in thicknesses of the belt
OVER = 0.09  # how far it stands out, in thicknesses


def find_belt_marks(run: Run, solids: Solids) -> Iterator[Rider]:
    """The marks of all belts of a run, below the links that carry the pulleys."""
    for loop in solids.loops:
        way = way_of(run, loop)
        over = OVER * loop.thick
        box = _box(LONG * loop.thick, loop.thick + 2.0 * over, loop.high - loop.low + 2.0 * over)
        height = 0.5 * (loop.low + loop.high)
        for k in range(MARKS):
            at, direction = loop.at(way + k * loop.length / MARKS)
            path = np.column_stack([at.real, at.imag, np.full(len(at), height)])
            first = (float(path[0, 0]), float(path[0, 1]), height)
            yield Rider("belt", f"{loop.pair} {k + 1}", loop.carrier, first, direction, *box, path=path)


def way_of(run: Run, loop: Loop) -> Real:
    """How far a belt has run at every frame (F,) [m]: as far as the rim of its first pulley has turned against the carrier. It
    stands still at frames that could not be assembled."""
    turned = run.motion.pose(loop.pulley)[:, 2] - run.motion.pose(loop.carrier)[:, 2]
    turned = held(turned, np.isfinite(turned))
    return loop.radii[0] * (turned - turned[0])


def _box(*sides: float) -> tuple[NDArray[np.float32], NDArray[np.uint32], NDArray[np.float32]]:
    """A box about the origin: vertices (24, 3), four to a face, faces (12, 3), normals (24, 3)."""
    vertices, normals = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = sign * np.eye(3)[axis]
            across = np.roll(normal, 1)
            for u, v in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
                corner = normal + u * across + v * np.cross(normal, across)
                vertices.append(0.5 * corner * sides)
                normals.append(normal)
    faces = (4 * np.arange(6)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return np.array(vertices, np.float32), faces.astype(np.uint32), np.array(normals, np.float32)
