"""The solids of the links in the browser, and their poses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import viser
from numpy.typing import NDArray

from mechcore import Motion

from ..meshes import Solid, Solids

__all__ = ["SolidNodes", "link_path", "quaternions"]


def link_path(link: str) -> str:
    """Name of a link's node in the scene tree: its pose is the pose of the link's frame."""
    return f"/mechanism/{link.replace('/', '_')}"


def quaternions(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternions w, x, y, z (F, 4) of turns about z by ``angle`` (F,) [rad]."""
    half = 0.5 * np.asarray(angle, float)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


class SolidNodes:
    """A node for every link, with its solid below it; ``show`` moves the links of a frame."""

    def __init__(self, server: viser.ViserServer, motion: Motion, solids: Solids):
        self._moving: list[tuple[viser.FrameHandle, NDArray[np.float64], NDArray[np.float64]]] = []
        for link, solid in solids.links.items():
            node = server.scene.add_frame(link_path(link), show_axes=False)
            for k, (vertices, faces, color) in enumerate(_by_color(solid)):
                server.scene.add_mesh_simple(
                    f"{link_path(link)}/part_{k}", vertices, faces, color=color, cast_shadow=False, receive_shadow=False
                )
            pose = motion.pose(link)
            if not np.isfinite(pose).all():  # viser would pass it on to the browsers
                raise ValueError(f"the pose of link {link} is not finite in all frames")
            if link != motion.mechanism.frame:
                position = np.column_stack([pose[:, :2], np.zeros(len(pose))])
                self._moving.append((node, quaternions(pose[:, 2]), position))

    def show(self, frame: int) -> None:
        for node, turn, position in self._moving:
            node.wxyz = turn[frame]
            node.position = position[frame]


def _by_color(solid: Solid) -> Iterator[tuple[NDArray[np.float32], NDArray[np.uint32], tuple[int, int, int]]]:
    """A solid in pieces of one colour each: viser's meshes have a single one.

    The vertices are split along sharp edges, so that the normals which the browser makes are those of the solid.
    """
    colors, piece = np.unique(solid.colors[:, :3], axis=0, return_inverse=True)
    piece = piece.reshape(-1)
    for k, color in enumerate(colors):
        chosen = np.flatnonzero(piece == k)
        place = np.zeros(len(piece), np.uint32)
        place[chosen] = np.arange(len(chosen), dtype=np.uint32)
        faces = solid.faces[piece[solid.faces[:, 0]] == k]
        yield solid.vertices[chosen], place[faces], (int(color[0]), int(color[1]), int(color[2]))
