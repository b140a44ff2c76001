"""Springs in a recording: a mesh each, and a transform at every picture that places, turns and stretches it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..coils import COLOR, Coil
from ..turns import about_z
from .paths import entity
from .streams import Index, Real, Static, Stream

__all__ = ["coil_shapes", "coil_streams"]


def coil_streams(coils: list[Coil], every: int) -> Iterator[Stream]:
    """Where the springs start, their directions, and how far they are stretched along their axes."""
    import rerun as rr

    for coil in coils:
        places, scales = coil.places(), coil.scales()

        def stretch(frames: Index, coil: Coil = coil, places: Real = places, scales: Real = scales) -> Any:
            return rr.Transform3D.columns(
                translation=places[frames].astype(np.float32),
                quaternion=about_z(coil.pose[frames, 2]).astype(np.float32),
                scale=scales[frames].astype(np.float32),
            )

        yield Stream(entity("mechanism", "springs", coil.name), stretch, every)


def coil_shapes(coils: list[Coil]) -> Iterator[Static]:
    """The springs at their mean lengths, along x."""
    import rerun as rr

    for coil in coils:
        colors = np.tile(np.array([*COLOR, 255], np.uint8), (len(coil.vertices), 1))
        mesh = rr.Mesh3D(
            vertex_positions=coil.vertices, triangle_indices=coil.faces, vertex_normals=coil.normals, vertex_colors=colors
        )
        yield Static(entity("mechanism", "springs", coil.name), mesh)
