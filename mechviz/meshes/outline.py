"""Outlines of flat parts: discs and hulls, rails, pedestals and hatched bars of the ground, bores with keyways and their keys."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry import MultiPolygon, Point, Polygon, box
from shapely.geometry.polygon import orient
from shapely.ops import unary_union

from mechcore.arrays import Vec2

Disc = tuple[Vec2, float]  # centre and radius


def disc(centre: Vec2, radius: float, segments: int) -> Polygon:
    return Point(centre).buffer(radius, quad_segs=max(2, segments // 4))


def hull(discs: Iterable[Disc], segments: int) -> Polygon:
    """The smallest convex outline around all discs: a plate with rounded ends, or a rounded polygon."""
    return unary_union([disc(centre, radius, segments) for centre, radius in discs]).convex_hull


def rectangle(centre: Vec2, along: Vec2, length: float, width: float, fillet: float = 0.0) -> Polygon:
    """A rectangle whose length is in the unit direction ``along``, with rounded corners if ``fillet`` > 0."""
    u = np.asarray(along)
    v = np.array([-u[1], u[0]])
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    corners = [np.asarray(centre) + 0.5 * (a * length * u + b * width * v) for a, b in signs]
    return rounded(Polygon(corners), fillet)


def rounded(shape: Polygon, fillet: float) -> Polygon:
    """The shape with its convex corners rounded."""
    return shape.buffer(-fillet, join_style="mitre").buffer(fillet, quad_segs=5) if fillet > 0.0 else shape


def cutouts(plate: Polygon, keep: Sequence[Polygon], rim: float, fillet: float, least: float) -> list[Polygon]:
    """Lightening cut-outs: the area of a plate inside a rim and outside the regions to keep, with rounded corners.

    ``least``: smallest area of a cut-out.
    """
    inner = plate.buffer(-rim)
    for region in keep:
        inner = inner.difference(region)
    inner = inner.buffer(-fillet, quad_segs=6).buffer(fillet, quad_segs=6)
    return [part for part in polygons(inner) if part.area > least and not part.interiors]


def pedestal(pivot: Vec2, r: float, segments: int) -> Polygon:
    """A bearing foot below a ground pivot, on a base line with ground hatching; r is the half width of a plate."""
    x, y = pivot
    base = y - 2.9 * r
    triangle = Polygon([(x - 1.5 * r, base), (x + 1.5 * r, base), (x, y)])
    foot = unary_union([disc(pivot, 1.05 * r, segments), triangle]).convex_hull
    top = base + 0.1 * r  # of the base line: it overlaps the foot, so that both become one part
    return unary_union([foot, hatched_bar((x - 2.2 * r, top), (x + 2.2 * r, top), r, thickness=0.4 * r)])


MOST_RIBS = 1_000  # hatching ribs of a bar of the ground: more could not be distinguished


def hatched_bar(start: Vec2, end: Vec2, r: float, *, thickness: float) -> Polygon:
    """A straight bar of the ground whose left edge runs from start to end, with slanted hatching ribs on its right."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(b - a))
    u = (b - a) / length
    n = np.array([u[1], -u[0]])
    parts = [Polygon([a, b, b + thickness * n, a + thickness * n])]
    rib, height, margin = 0.2 * r, 0.75 * r, 0.1 * r
    count = min(max(3, round(length / (0.95 * r))), MOST_RIBS)
    pitch = (length - height - rib - margin) / (count - 1)
    for k in range(count):
        foot = a + (height + k * pitch) * u + 0.5 * thickness * n
        point = foot + (0.5 * thickness + height) * n - height * u
        parts.append(Polygon([foot, foot + rib * u, point + rib * u, point]))
    return unary_union(parts)


def guide_rails(origin: Vec2, along: Vec2, low: float, high: float, half_width: float, r: float) -> list[Polygon]:
    """Two guide rails with ground hatching on their outer sides."""
    rails = []
    for side in (1.0, -1.0):
        # The material lies to the right of the direction from a to b, which must be the outer side.
        ends = (high, low) if side > 0.0 else (low, high)
        a, b = (_beside(origin, along, s, side * (half_width + 0.02 * r)) for s in ends)
        rails.append(hatched_bar(a, b, r, thickness=0.42 * r))
    return rails


def _beside(origin: Vec2, along: Vec2, s: float, lateral: float) -> Vec2:
    """The point at distance s along a line and to the left of it."""
    return (origin[0] + s * along[0] - lateral * along[1], origin[1] + s * along[1] + lateral * along[0])


def polygons(shape: shapely.Geometry) -> list[Polygon]:
    """The polygons of any shapely geometry, largest first."""
    if shape.is_empty:
        return []
    if isinstance(shape, Polygon):
        return [shape]
    if isinstance(shape, MultiPolygon) or hasattr(shape, "geoms"):
        return sorted((p for g in shape.geoms for p in polygons(g)), key=lambda p: (-p.area, p.bounds))
    return []


class ShapeError(ValueError):
    """A part cannot be made: its proportions are too extreme for its outline."""


def largest(shape: shapely.Geometry) -> Polygon:
    """The largest polygon of any shapely geometry. Raises `ShapeError` if there is none."""
    left = polygons(shape)
    if not left:
        raise ShapeError("nothing is left of the outline of a part")
    return left[0]


def clean(shape: Polygon) -> Polygon:
    """The polygon with the material to the left of every ring, without superfluous vertices on straight edges."""
    simple = shapely.simplify(shape, 1e-7, preserve_topology=True)
    return orient(simple if isinstance(simple, Polygon) and not simple.is_empty else shape, 1.0)


# A key to DIN 6885 (d = 22 to 30 mm: 8 x 7 mm, 3.3 mm of it in the hub), slightly higher to be visible, in radii of its shaft.
_KEY_HALF_WIDTH = 0.27  # half its width
_KEYWAY_REACH = 0.34  # depth of the keyway in the hub beyond the shaft
_KEY_FIT = 0.97  # width of the key over that of its keyway
_LEAST_HUB = 1.12  # least radius of a hub over the outer radius of the keyway


def keyway_reach(shaft: float) -> float:
    """The least radius of a hub around the keyway on a shaft of this radius."""
    return _LEAST_HUB * (1.0 + _KEYWAY_REACH) * shaft


def keyway_corner(shaft: float) -> float:
    """The radius of the outer corners of the keyway on a shaft of this radius."""
    return float(np.hypot(1.0 + _KEYWAY_REACH, _KEY_HALF_WIDTH)) * shaft


def keyed_bore(centre: Vec2, shaft: float, hole: float, towards: Vec2, segments: int) -> Polygon:
    """A round hole with a keyway in the unit direction ``towards``, for a shaft of the radius ``shaft``."""
    slot = box(0.0, -_KEY_HALF_WIDTH * shaft, (1.0 + _KEYWAY_REACH) * shaft, _KEY_HALF_WIDTH * shaft)
    return largest(disc(centre, hole, segments).union(_turned(slot, centre, towards)))


def key_outline(centre: Vec2, shaft: float, towards: Vec2, segments: int) -> Polygon:
    """The part of the key outside its shaft, with a very small gap: no two parts may share a vertex."""
    half = _KEY_FIT * _KEY_HALF_WIDTH * shaft
    whole = _turned(box(0.0, -half, (1.0 + _KEY_FIT * _KEYWAY_REACH) * shaft, half), centre, towards)
    return largest(whole.difference(disc(centre, 1.004 * shaft, segments)))


def _turned(shape: Polygon, centre: Vec2, towards: Vec2) -> Polygon:
    c, s = np.asarray(towards) / np.hypot(*towards)
    return affinity.affine_transform(shape, [c, -s, s, c, *centre])
