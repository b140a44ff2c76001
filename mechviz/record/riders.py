"""Marks on rollers and belts in a recording: a mesh under a link that turns as the roller rolls, or goes where the belt runs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..riders import Rider
from .paths import entity
from .streams import Index, Real, Static, Stream

__all__ = ["rider_shapes", "rider_streams"]


def rider_streams(marks: list[Rider]) -> Iterator[Stream]:
    """Places and turns of the marks in their links."""
    import rerun as rr

    for mark in marks:
        places, turns = mark.places(), mark.turns()

        def turn(frames: Index, places: Real = places, turns: Real = turns) -> Any:
            return rr.Transform3D.columns(
                translation=places[frames].astype(np.float32), quaternion=turns[frames].astype(np.float32)
            )

        yield Stream(entity("mechanism", "links", mark.link, mark.title), turn)


def rider_shapes(marks: list[Rider]) -> Iterator[Static]:
    """What the marks look like."""
    import rerun as rr

    for mark in marks:
        colors = np.tile(np.array([*mark.color, 255], np.uint8), (len(mark.vertices), 1))
        mesh = rr.Mesh3D(
            vertex_positions=mark.vertices, triangle_indices=mark.faces, vertex_normals=mark.normals, vertex_colors=colors
        )
        yield Static(entity("mechanism", "links", mark.link, mark.title), mesh)
