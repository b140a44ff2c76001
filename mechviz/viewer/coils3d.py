"""Springs in the browser: a mesh each, stretched along its axis from frame to frame."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import viser
from numpy.typing import NDArray

from ..coils import COLOR, Coil
from .playback import PointTrack
from .poses import Posed
from .show import Show
from .solids3d import quaternions

__all__ = ["CoilNodes"]

Real = NDArray[np.float64]


class CoilNodes:
    """The springs; ``poses`` and ``show`` place and stretch them, ``update`` takes those of another run."""

    def __init__(self, server: viser.ViserServer, show: Show):
        self._server = server
        self._on = True
        self._height: float | None = None
        self._nodes: dict[str, viser.MeshHandle] = {}
        self._coils: dict[str, Coil] = {}
        self._turns: dict[str, Real] = {}
        self.update(show)

    def __len__(self) -> int:
        return len(self._coils)

    def update(self, show: Show) -> None:
        """Take the springs of ``show``; a mesh is sent anew only where it is another."""
        before, self._coils = self._coils, {_path(coil.name): coil for coil in show.coils}
        for path in [p for p in self._nodes if p not in self._coils or not _same(before[p], self._coils[p])]:
            self._nodes.pop(path).remove()
        self._turns = {path: quaternions(coil.pose[:, 2]) for path, coil in self._coils.items()}
        for path, coil in self._coils.items():
            if path not in self._nodes:
                self._nodes[path] = self._server.scene.add_mesh_simple(
                    path, coil.vertices, coil.faces, color=COLOR, visible=self._seen(coil), cast_shadow=False, receive_shadow=False
                )

    def switch(self, on: bool) -> None:
        """Draw them, or no more."""
        self._on = on
        self.cut(self._height)

    def cut(self, height: float | None) -> None:
        """Leave out the springs before a height [m]; None: none."""
        self._height = height
        for path, node in self._nodes.items():
            node.visible = self._seen(self._coils[path])

    def _seen(self, coil: Coil) -> bool:
        return self._on and (self._height is None or coil.height <= self._height)

    def poses(self, frame: int) -> Iterator[Posed]:
        """Where the springs are at a frame, if they are drawn."""
        if self._on:
            for path, node in self._nodes.items():
                coil, k = self._coils[path], min(frame, len(self._coils[path].pose) - 1)
                yield node, np.array([*coil.pose[k, :2], coil.height]), self._turns[path][k]

    def show(self, frame: int) -> None:
        """Stretch them as at a frame."""
        if self._on:
            for path, node in self._nodes.items():
                stretch = self._coils[path].stretch
                node.scale = (float(stretch[min(frame, len(stretch) - 1)]), 1.0, 1.0)

    def tracks(self) -> dict[str, tuple[Real, Real]]:
        """By the name of a node: its places (F, 3) and turns (F, 4) over the frames."""
        return {path: (coil.places(), self._turns[path]) for path, coil in self._coils.items()}

    def stretches(self) -> Iterator[PointTrack]:
        """How the springs are stretched over the run, if they are on."""
        if self._on:
            for path, coil in self._coils.items():
                yield PointTrack(path, "scale", coil.scales().astype(np.float32), np.full(len(coil.stretch), 3))


def _same(a: Coil, b: Coil) -> bool:
    """Whether two springs have the same mesh."""
    return a.vertices.shape == b.vertices.shape and np.array_equal(a.vertices, b.vertices)


def _path(name: str) -> str:
    return f"/coils/{name.replace('/', '_')}"
