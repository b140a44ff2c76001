"""The scene as it was opened, pale behind what has been made of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import viser

from mechcore.arrays import Real
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.viser_adapter import Posed
from mechviz.outputs.viewer.world.marks import path_segments
from mechviz.outputs.viewer.world.solids import quaternions

COLOR = (120, 128, 140)
OPACITY = 0.28


class Ghost:
    """The links and paths of ``show`` in pale grey; ``switch`` draws them, made only when they are first wanted."""

    def __init__(self, server: viser.ViserServer, show: ViewModel):
        self._server, self._show = server, show
        self._nodes: dict[str, viser.FrameHandle] = {}
        self._base: viser.FrameHandle | None = None
        self.on = False

    def switch(self, on: bool) -> None:
        """Draw the scene as it was opened, or no more."""
        self.on = on
        if on and self._base is None:
            self._make()
        if self._base is not None:
            self._base.visible = on

    def poses(self, frame: int) -> Iterator[Posed]:
        """Where its links are at a frame, if it is drawn."""
        if self.on:
            for link, node in self._nodes.items():
                pose = self._show.poses[link][min(frame, self._show.frames - 1)]
                yield node, np.array([pose[0], pose[1], 0.0]), quaternions(pose[2:])[0]

    def tracks(self) -> dict[str, tuple[Real, Real | None]]:
        """By the name of a node: its places (F, 3) and turns (F, 4) over the frames."""
        if not self.on:
            return {}
        poses = {node.name: self._show.poses[link] for link, node in self._nodes.items()}
        return {n: (np.column_stack([p[:, :2], np.zeros(len(p))]), quaternions(p[:, 2])) for n, p in poses.items()}

    def _make(self) -> None:
        scene, show = self._server.scene, self._show
        self._base = scene.add_frame("/opened", show_axes=False)
        for link, body in show.bodies.items():
            if link == show.frame:
                continue
            path = f"/opened/{link.replace('/', '_')}"
            self._nodes[link] = scene.add_frame(path, show_axes=False)
            for k, piece in enumerate(body.pieces):
                scene.add_mesh_simple(
                    f"{path}/part_{k}",
                    piece.vertices,
                    piece.faces,
                    color=COLOR,
                    opacity=OPACITY,
                    cast_shadow=False,
                    receive_shadow=False,
                )
        for name, xyz in show.paths.items():
            path = f"/opened/path {name.replace('/', '_')}"
            scene.add_line_segments(path, path_segments(xyz), COLOR, thickness=1.5, thickness_units="screen")
