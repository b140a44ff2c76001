"""Marks on rollers in a recording: a mesh under the follower's link that turns as the roller rolls."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..rollers import COLOR, RollerMark
from .paths import entity
from .streams import Index, Real, Static, Stream

__all__ = ["roller_shapes", "roller_streams"]


def roller_streams(marks: list[RollerMark]) -> Iterator[Stream]:
    """Places and turns of the marks in their links."""
    import rerun as rr

    for mark in marks:
        turns = mark.turns()

        def turn(frames: Index, mark: RollerMark = mark, turns: Real = turns) -> Any:
            return rr.Transform3D.columns(
                translation=np.tile(np.array(mark.centre, np.float32), (len(frames), 1)),
                quaternion=turns[frames].astype(np.float32),
            )

        yield Stream(entity("mechanism", "links", mark.link, f"roller {mark.name}"), turn)


def roller_shapes(marks: list[RollerMark]) -> Iterator[Static]:
    """What the marks look like."""
    import rerun as rr

    for mark in marks:
        colors = np.tile(np.array([*COLOR, 255], np.uint8), (len(mark.vertices), 1))
        mesh = rr.Mesh3D(
            vertex_positions=mark.vertices, triangle_indices=mark.faces, vertex_normals=mark.normals, vertex_colors=colors
        )
        yield Static(entity("mechanism", "links", mark.link, f"roller {mark.name}"), mesh)
