"""How large arrows, moments and springs are drawn in all pictures, as parts of the mechanism's size; shapes that they share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "ARC_RADIUS", "ARC_TIP", "ARC_WIDTH", "HEAD", "HEAD_RADIUS", "LEAST_ARROW", "LINKER", "POT", "SHAFT", "SPIRAL",
    "TURNS", "arc_corners", "arc_faces", "pot_length", "ribbon_faces", "spiral_radius",
]  # fmt: skip

Real = NDArray[np.float64]

SHAFT, HEAD_RADIUS, HEAD = 0.0042, 0.0115, 0.03  # of an arrow: radii of its shaft and its head, length of its head
LEAST_ARROW = 1.3 * HEAD  # a shorter arrow is left out, or drawn smaller
ARC_RADIUS, ARC_WIDTH = 0.085, 0.0085  # of the arc of a moment
ARC_TIP = 0.42  # of its head [rad]
POT = 0.028  # half width of dampers and gas springs
SPIRAL = 0.09  # radius of torsion springs
TURNS = 2.5  # of a torsion spring
LINKER = (58, 66, 78)  # colour of dampers, gas springs and torsion springs


def pot_length(least: float, most: float) -> float:
    """Length of the pot of a damper whose ends come as near as ``least`` and go as far as ``most``."""
    return min(max((most - least) / 0.8, 0.5 * most), 0.95 * least)


def spiral_radius(part: Any, size: float) -> Any:
    """Radius [m] of a torsion spring at a part of its length from the inside, in a mechanism of a size [m]."""
    return SPIRAL * size * (0.25 + 0.75 * part)


def arc_corners(turn: float, radius: float, width: float, steps: int) -> NDArray[np.complex128]:
    """Corners of a flat arc with a head, for `arc_faces`: through ``turn`` [rad] about the origin, from the right on."""
    sign = np.sign(turn)
    along = np.linspace(0.0, sign * (abs(turn) - min(ARC_TIP, abs(turn))), steps + 1)
    body = (np.array([radius + 0.5 * width, radius - 0.5 * width]) * np.exp(1j * along)[:, None]).ravel()
    base = np.array([radius + 1.7 * width, radius - 1.7 * width]) * np.exp(1j * along[-1])
    return np.concatenate([body, base, [radius * np.exp(1j * turn)]])


def arc_faces(steps: int) -> NDArray[np.uint32]:
    """Faces of such an arc, counter-clockwise where it turns so."""
    n = 2 * (steps + 1)
    return np.vstack([ribbon_faces(steps + 1), [[n, n + 2, n + 1]]]).astype(np.uint32)


def ribbon_faces(places: int) -> NDArray[np.int64]:
    """Faces of a ribbon whose corners stand as outer, inner, outer, inner ..., counter-clockwise."""
    k = 2 * np.arange(places - 1)
    return np.vstack([np.column_stack([k, k + 2, k + 1]), np.column_stack([k + 1, k + 2, k + 3])])
