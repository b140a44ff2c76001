"""Dampers, gas springs and torsion springs: lines that deform with the motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import viser
from numpy.typing import NDArray

from ..linkers import Linker
from ..proportions import LINKER
from .playback import PointTrack
from .show import Show

__all__ = ["LinkerNodes", "segments"]


def segments(strips: tuple[NDArray[np.float64], ...], z: float) -> NDArray[np.float32]:
    """Polylines of one frame, each (1, points, 2) [m], as line segments (n, 2, 3) in the plane ``z``."""
    parts = [np.stack([line[0, :-1], line[0, 1:]], axis=1) for line in strips]
    flat = np.concatenate(parts)
    out = np.full((len(flat), 2, 3), z, np.float32)
    out[:, :, :2] = flat
    return out


class LinkerNodes:
    """The lines of all linkers; ``show`` bends them to a frame, ``update`` takes those of another run."""

    def __init__(self, server: viser.ViserServer, show: Show):
        self._server = server
        self._on = True
        self._nodes: dict[str, viser.LineSegmentsHandle] = {}
        self._linkers: dict[str, Linker] = {}
        self.update(show)

    def __len__(self) -> int:
        return len(self._linkers)

    def update(self, show: Show) -> None:
        self._z = show.z_top + 0.01 * show.size
        self._linkers = {_path(linker.name): linker for linker in show.linkers}
        for path, linker in self._linkers.items():
            if path not in self._nodes:
                first = segments(linker.strips(np.array([0])), self._z)
                self._nodes[path] = self._server.scene.add_line_segments(
                    path, first, LINKER, thickness=3.0, thickness_units="screen", visible=self._on
                )
        for path, node in self._nodes.items():
            node.visible = self._on and path in self._linkers

    def switch(self, on: bool) -> None:
        """Draw them, or no more."""
        self._on = on
        for path, node in self._nodes.items():
            node.visible = on and path in self._linkers

    def points(self, path: str, frame: int) -> NDArray[np.float32]:
        """The lines of a linker at a frame (n, 2, 3) [m]."""
        return segments(self._linkers[path].strips(np.array([frame])), self._z)

    def show(self, frame: int) -> None:
        if self._on:
            for path in self._linkers:
                self._nodes[path].points = self.points(path, frame)

    def tracks(self, frames: int) -> Iterator[PointTrack]:
        """How all lines move over the run, if they are on."""
        if self._on:
            for path, linker in self._linkers.items():
                strips = linker.strips(np.arange(frames))
                flat = np.concatenate([np.stack([s[:, :-1], s[:, 1:]], axis=2) for s in strips], axis=1)
                height = np.full((*flat.shape[:3], 1), self._z)
                values = np.concatenate([flat, height], axis=3).reshape(frames, -1).astype(np.float32)
                yield PointTrack(path, "points", values, np.full(frames, values.shape[1]))


def _path(name: str) -> str:
    return f"/springs/{name.replace('/', '_')}"
