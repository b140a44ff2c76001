"""Inverse cams: a body with a slot on the driven link, and the roller on the crank that runs in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from shapely.geometry import LineString, Point, Polygon

from mechcore.joints.base import Builder
from mechcore.spec.mechanism import CamJoint, Mechanism, Vec2
from mechviz.meshes import outline
from mechviz.meshes.draft import Draft, Neck, Piece

if TYPE_CHECKING:
    from mechviz.meshes.model import Model


_SAMPLES = 1080  # points of a flank
_ROLLER = 256  # sides of the roller


@dataclass(frozen=True, eq=False)
class InverseDrawing:
    """``groove``: what the roller sweeps out of the driven link, in its axes; ``tip`` in the crank's."""

    joint: str
    crank: str
    driven: str
    groove: Polygon
    ends: tuple[Vec2, Vec2]  # places beyond the ends of the groove, on its body
    tip: Vec2
    radius: float


def find_inverse(mechanism: Mechanism, parts: Builder, size: float) -> tuple[InverseDrawing, ...]:
    """All inverse cams of a mechanism."""
    by_name = {r.name: r.geometry for r in parts.relations}
    found = []
    for joint in mechanism.joints:
        if not isinstance(joint, CamJoint) or not joint.inverse:
            continue
        placed = by_name[joint.name]
        low, high = placed.way
        margin = 0.06 * (high - low)
        theta = np.linspace(low - margin, high + margin, _SAMPLES)
        w = (placed.own + placed.mount * placed.cam.pitch(theta, 0)[0]) / size
        radius = placed.cam.radius / size
        groove = LineString(np.column_stack([w.real, w.imag])).buffer(radius, quad_segs=64)
        out = [w[0] + 1.6 * radius * (w[0] - w[8]) / abs(w[0] - w[8]), w[-1] + 1.6 * radius * (w[-1] - w[-9]) / abs(w[-1] - w[-9])]
        tip = (placed.tip.real / size, placed.tip.imag / size)
        first, last = ((z.real, z.imag) for z in out)
        found.append(InverseDrawing(joint.name, joint.links[0], joint.links[1], groove, (first, last), tip, radius))
    return tuple(found)


def _group(drawing: InverseDrawing) -> str:
    return f"groove {drawing.joint}"


def draw_inverse(model: Model, draft: Draft) -> None:
    """Pieces of all inverse cams."""
    r = model.proportions.r
    for drawing in model.inverse:
        group, mates = _group(drawing), frozenset([drawing.joint])
        body = drawing.groove.buffer(max(1.3 * r, 0.9 * drawing.radius), quad_segs=32).difference(drawing.groove)
        draft.pieces.append(Piece(drawing.driven, outline.polygons(body)[0], group, "wheel", mates))
        for end in drawing.ends:
            spot = outline.polygons(Point(end).buffer(0.5 * r).intersection(body.buffer(-0.05 * r)))
            if spot:
                draft.necks.append(Neck(drawing.driven, spot[0], (draft.groups[drawing.driven], group)))
        roller = outline.disc(drawing.tip, drawing.radius, _ROLLER)
        draft.pieces.append(Piece(drawing.crank, roller, group, "wheel", mates))
        pin = outline.disc(drawing.tip, 0.5 * min(drawing.radius, r), model.segments)
        draft.necks.append(Neck(drawing.crank, pin, (draft.groups[drawing.crank], group)))
