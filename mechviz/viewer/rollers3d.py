"""Marks on the rollers of cams in the browser: they turn as the rollers roll."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import viser
from numpy.typing import NDArray

from ..rollers import COLOR, RollerMark
from .poses import Posed
from .show import Show
from .solids3d import link_path

__all__ = ["RollerNodes"]

Real = NDArray[np.float64]


class RollerNodes:
    """A node below the follower's for every roller; ``poses`` says how they turn, ``update`` takes another run."""

    def __init__(self, server: viser.ViserServer, show: Show):
        self._server = server
        self._height: float | None = None
        self._marks: tuple[RollerMark, ...] = ()
        self._nodes: list[viser.FrameHandle] = []
        self._turns: list[Real] = []
        self.update(show)

    def update(self, show: Show) -> None:
        """Take the rollers of ``show``."""
        for node in self._nodes:
            node.remove()
        self._marks, self._nodes, self._turns = show.rollers, [], []
        for mark in self._marks:
            path = f"{link_path(mark.link)}/roller {mark.name.replace('/', '_')}"
            node = self._server.scene.add_frame(path, show_axes=False, position=mark.centre)
            self._server.scene.add_mesh_simple(
                f"{path}/mark", mark.vertices, mark.faces, color=COLOR, side="double", cast_shadow=False, receive_shadow=False
            )
            self._nodes.append(node)
            self._turns.append(np.roll(mark.turns(), 1, axis=1))  # w first
        self.cut(self._height)

    def cut(self, height: float | None) -> None:
        """Leave out the marks before a height [m]; None: none."""
        self._height = height
        for node, mark in zip(self._nodes, self._marks, strict=True):
            seen = height is None or mark.axis is not None or mark.centre[2] <= height
            if node.visible != seen:
                node.visible = seen

    def poses(self, frame: int) -> Iterator[Posed]:
        """How far the rollers have turned at a frame."""
        for node, mark, turn in zip(self._nodes, self._marks, self._turns, strict=True):
            yield node, np.array(mark.centre), turn[min(frame, len(turn) - 1)]

    def tracks(self) -> dict[str, tuple[Real, Real]]:
        """By the name of a node: its places (F, 3) and turns (F, 4) over the frames."""
        return {
            node.name: (np.tile(np.array(mark.centre), (len(turn), 1)), turn)
            for node, mark, turn in zip(self._nodes, self._marks, self._turns, strict=True)
        }
