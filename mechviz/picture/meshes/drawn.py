"""Outlines of links as they are drawn, in metres: what a mass that follows from the drawing is integrated over."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from shapely.affinity import scale
from shapely.geometry import Polygon

from mechcore.spec.mechanism import Mechanism
from mechviz.picture.meshes.layers.stack import stack_pieces
from mechviz.picture.meshes.model import build_model
from mechviz.picture.meshes.parts import make_parts
from mechviz.picture.meshes.shapes import draft_pieces

SEGMENTS = 512  # sides of a full circle: 0.003 % of its area is missing
FLAT = ("plate", "wheel", "block", "rail")


def drawn_outlines(
    mechanism: Mechanism, poses: Mapping[str, np.ndarray] | None, links: Collection[str]
) -> dict[str, list[Polygon]]:
    """Flat parts of ``links`` in the links' frames [m], with the holes for their pins and their cut-outs.

    poses: x, y, angle (F, 3) [m, m, rad] of every link over the run, as for `build_solids`: slots and guides follow from them.
    """
    model = build_model(mechanism, poses, SEGMENTS)
    draft = draft_pieces(model)
    parts = make_parts(model, draft, stack_pieces(model, draft))
    out: dict[str, list[Polygon]] = {name: [] for name in links}
    for part in parts:
        if part.link in out and part.kind in FLAT:
            shape = part.space[0].outline
            whole = [shape] if isinstance(shape, Polygon) else list(shape.geoms)
            out[part.link] += [scale(p, model.size, model.size, origin=(0.0, 0.0)) for p in whole]
    return out
