"""Marks on rollers and belts in the browser: they turn as the rollers roll, and go where the belts run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import viser
from numpy.typing import NDArray

from ..riders import Rider
from .poses import Posed
from .show import Show
from .solids3d import link_path

__all__ = ["RiderNodes"]

Real = NDArray[np.float64]


class RiderNodes:
    """A node below its link's for every mark; ``poses`` says where they are, ``update`` takes another run."""

    def __init__(self, server: viser.ViserServer, show: Show):
        self._server = server
        self._height: float | None = None
        self._marks: tuple[Rider, ...] = ()
        self._nodes: list[viser.FrameHandle] = []
        self._turns: list[Real] = []
        self._places: list[Real] = []
        self.update(show)

    def update(self, show: Show) -> None:
        """Take the marks of ``show``; those that look as before keep their nodes."""
        before, self._marks = self._marks, show.riders
        self._places = [mark.places() for mark in self._marks]
        self._turns = [np.roll(mark.turns(), 1, axis=1) for mark in self._marks]  # w first
        if len(before) != len(self._marks) or not all(map(_alike, before, self._marks)):
            self._build()
        self.cut(self._height)

    def _build(self) -> None:
        for node in self._nodes:
            node.remove()
        self._nodes = []
        for mark in self._marks:
            path = f"{link_path(mark.link)}/{mark.title.replace('/', '_')}"
            node = self._server.scene.add_frame(path, show_axes=False, position=mark.centre)
            self._server.scene.add_mesh_simple(
                f"{path}/mark", mark.vertices, mark.faces, color=mark.color, side="double", cast_shadow=False, receive_shadow=False
            )
            self._nodes.append(node)

    def cut(self, height: float | None) -> None:
        """Leave out the marks before a height [m]; None: none."""
        self._height = height
        for node, mark in zip(self._nodes, self._marks, strict=True):
            seen = height is None or mark.axis is not None or mark.centre[2] <= height
            if node.visible != seen:
                node.visible = seen

    def poses(self, frame: int) -> Iterator[Posed]:
        """Where the marks are at a frame."""
        for node, place, turn in zip(self._nodes, self._places, self._turns, strict=True):
            k = min(frame, len(turn) - 1)
            yield node, place[k], turn[k]

    def tracks(self) -> dict[str, tuple[Real, Real]]:
        """By the name of a node: its places (F, 3) and turns (F, 4) over the frames."""
        return {node.name: (p, q) for node, p, q in zip(self._nodes, self._places, self._turns, strict=True)}


def _alike(one: Rider, other: Rider) -> bool:
    """Whether two marks are of one name and shape."""
    return (one.title, one.link) == (other.title, other.link) and np.array_equal(one.vertices, other.vertices)
