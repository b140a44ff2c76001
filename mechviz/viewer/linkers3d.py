"""Springs, dampers and gas springs: lines that deform with the motion."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

from ..linkers import Linker

__all__ = ["LinkerNodes", "segments"]

COLOR = (58, 66, 78)


def segments(strips: tuple[NDArray[np.float64], ...], z: float) -> NDArray[np.float32]:
    """Polylines of one frame, each (1, points, 2) [m], as line segments (n, 2, 3) in the plane ``z``."""
    parts = [np.stack([line[0, :-1], line[0, 1:]], axis=1) for line in strips]
    flat = np.concatenate(parts)
    out = np.full((len(flat), 2, 3), z, np.float32)
    out[:, :, :2] = flat
    return out


class LinkerNodes:
    """The lines of all linkers; ``show`` bends them to a frame."""

    def __init__(self, server: viser.ViserServer, linkers: list[Linker], z: float):
        self._z = z
        self._on = True
        self._nodes: list[tuple[viser.LineSegmentsHandle, Linker]] = []
        for linker in linkers:
            first = segments(linker.strips(np.array([0])), z)
            name = f"/springs/{linker.name.replace('/', '_')}"
            node = server.scene.add_line_segments(name, first, COLOR, thickness=3.0, thickness_units="screen")
            self._nodes.append((node, linker))

    def __len__(self) -> int:
        return len(self._nodes)

    def switch(self, on: bool) -> None:
        """Draw them, or no more."""
        self._on = on
        for node, _ in self._nodes:
            node.visible = on

    def show(self, frame: int) -> None:
        if self._on:
            for node, linker in self._nodes:
                node.points = segments(linker.strips(np.array([frame])), self._z)
