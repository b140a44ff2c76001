"""How arrows and arcs look in a recording: colours on its dark ground, the shape of an arc, the room that they take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..picture.arrows import SHORTEST, visible
from ..proportions import ARC_RADIUS
from ..vectors import FAMILIES, LARGEST_ARC, LARGEST_ARROW, Moment, Scales, Vector

__all__ = ["COLORS", "LEGEND_ROOM", "arc_strips", "arc_sweep", "extent", "seen", "sweep_of"]

Real = NDArray[np.float64]


def lighter(channel: int) -> int:
    """A colour channel on a dark ground."""
    return round(0.6 * channel + 102)


_LIGHTER: Mapping[str, tuple[int, int, int]] = {
    "reaction": (255, 72, 84),
    "applied": (255, 138, 20),
    "gravity": (214, 178, 130),
    "inertia": (208, 112, 246),
    "drive": (72, 222, 128),
    "friction": (255, 214, 92),
    "velocity": (84, 168, 255),
    "acceleration": (52, 214, 220),
}
COLORS: Mapping[str, tuple[int, int, int]] = {
    name: _LIGHTER.get(name, (lighter(family.color[0]), lighter(family.color[1]), lighter(family.color[2])))
    for name, family in FAMILIES.items()
}
"""The hues that the viewer gives to the families, lighter: the background is dark."""

ARC_POINTS = 24
LEGEND_ROOM = 0.2  # in sizes of the mechanism: below solids and arrows, for the legend of the arrows


def seen(item: Vector | Moment, scales: Scales, size: float) -> bool:
    """Whether an arrow or arc is drawn at any frame."""
    if isinstance(item, Vector):
        return bool(visible(item.value, scales.per_metre(item.family), size).any())
    return bool(sweep_of(item, scales, size).any())


def sweep_of(moment: Moment, scales: Scales, size: float) -> Real:
    """Signed angles (F,) [rad] of the arc of a moment; 0 where it is not drawn."""
    sweep = arc_sweep(moment.value, scales.newton_metres_per_metre, size)
    return sweep if moment.shown is None else np.where(moment.shown, sweep, 0.0)


def extent(vectors: Sequence[Vector], scales: Scales, bounds: Real, size: float) -> Real:
    """The box (2, 3) [m] around the mechanism and its arrows; arrows that lie far outside do not count in full."""
    low, high = np.array(bounds[0]), np.array(bounds[1])
    room = LARGEST_ARROW * size
    for vector in vectors:
        scale = scales.per_metre(vector.family)
        shown = visible(vector.value, scale, size)
        if shown.any():
            tips = vector.origin[shown] + vector.value[shown] / scale
            low[:2] = np.minimum(low[:2], np.maximum(tips.min(axis=0), bounds[0][:2] - room))
            high[:2] = np.maximum(high[:2], np.minimum(tips.max(axis=0), bounds[1][:2] + room))
    if vectors:
        low[1] -= LEGEND_ROOM * size  # for the legend
    return np.array([low, high])


def arc_sweep(moments: Real, scale: float, size: float) -> Real:
    """Signed angles (F,) [rad] that arcs span so that their length stands for moments (F,) [N m]; 0 where too short to see."""
    sweep = np.nan_to_num(moments / (scale * ARC_RADIUS * size))
    most = LARGEST_ARC / ARC_RADIUS
    sweep = np.clip(sweep, -most, most)
    return np.where(np.abs(sweep) * ARC_RADIUS > SHORTEST, sweep, 0.0)


def arc_strips(centres: Real, sweep: Real, z: float, size: float) -> NDArray[np.float32]:
    """Arcs with arrow heads about centres (n, 2), spanning angles (n,), each drawn as one strip: (n, points, 3)."""
    radius = ARC_RADIUS * size
    # the arc opens evenly about the vertical
    angles = 0.5 * np.pi + sweep[:, None] * np.linspace(-0.5, 0.5, ARC_POINTS)
    arc = centres[:, None] + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    end = angles[:, -1]
    along = np.sign(sweep)[:, None] * np.column_stack([-np.sin(end), np.cos(end)])
    across = np.column_stack([np.cos(end), np.sin(end)])
    head = 0.3 * radius
    tip = arc[:, -1] + 0.5 * head * along
    barbs = [tip - head * along + side * 0.6 * head * across for side in (1, -1)]
    strip = np.concatenate([arc, np.stack([tip, barbs[0], tip, barbs[1]], axis=1)], axis=1)
    return np.concatenate([strip, np.full((*strip.shape[:2], 1), z)], axis=-1).astype(np.float32)
