"""Where flat outlines meet while their links move: exact tests on polygons, all frames at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry import Polygon

__all__ = ["Swept", "meet"]


@dataclass(frozen=True, eq=False)
class Swept:
    """An outline fixed to a link, and the poses (F, 3) of that link over the run, in units of the size."""

    outline: Polygon
    pose: np.ndarray

    @cached_property
    def _circle(self) -> tuple[np.ndarray, float]:
        """A circle around the outline, in the link's frame."""
        low_x, low_y, high_x, high_y = self.outline.bounds
        centre = np.array([0.5 * (low_x + high_x), 0.5 * (low_y + high_y)])
        xy = np.asarray(self.outline.exterior.coords)[:, :2]
        return centre, float(np.hypot(*(xy - centre).T).max())

    @cached_property
    def _rings(self) -> list[np.ndarray]:
        return [np.asarray(ring.coords)[:, :2] for ring in (self.outline.exterior, *self.outline.interiors)]

    @cached_property
    def _centre_path(self) -> np.ndarray:
        """The circle's centre in the world (F, 2)."""
        (x, y), _ = self._circle
        c, s = np.cos(self.pose[:, 2]), np.sin(self.pose[:, 2])
        return np.column_stack([self.pose[:, 0] + c * x - s * y, self.pose[:, 1] + s * x + c * y])

    @cached_property
    def prepared(self) -> Polygon:
        shapely.prepare(self.outline)
        return self.outline

    def seen_from(self, other: Swept, frames: np.ndarray) -> np.ndarray:
        """This outline in the frame of the other one's link, at the given frames: an array of polygons."""
        mine, base = self.pose[frames], other.pose[frames]
        turn = mine[:, 2] - base[:, 2]
        cb, sb = np.cos(base[:, 2]), np.sin(base[:, 2])
        dx, dy = mine[:, 0] - base[:, 0], mine[:, 1] - base[:, 1]
        x0, y0 = cb * dx + sb * dy, -sb * dx + cb * dy
        c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
        loops = []
        for xy in self._rings:
            x = x0[:, None] + c * xy[:, 0] - s * xy[:, 1]
            y = y0[:, None] + s * xy[:, 0] + c * xy[:, 1]
            loops.append(shapely.linearrings(np.stack([x, y], axis=-1)))
        if len(loops) == 1:
            return shapely.polygons(loops[0])
        return shapely.polygons(loops[0], np.stack(loops[1:], axis=1))


def meet(a: Swept, b: Swept) -> bool:
    """Whether two outlines touch or overlap at any frame."""
    gap = np.hypot(*(a._centre_path - b._centre_path).T)
    frames = np.flatnonzero(gap <= a._circle[1] + b._circle[1])
    if len(frames) == 0:
        return False
    if len(a._rings) < len(b._rings):  # move the simpler outline
        a, b = b, a
    return bool(shapely.intersects(a.prepared, b.seen_from(a, frames)).any())
