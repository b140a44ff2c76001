"""Whether holes can be cut from a plate: inside its outline, and not twice."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from shapely.geometry import MultiPoint, Point, Polygon

Vec2 = tuple[float, float]
STEPS = 64  # chords of an arc
CLOSE = 2e-3  # of a hole's radius: arcs are chords here, and a hole may touch the outline


def polygon_of(corners: Sequence[Vec2], bulges: Sequence[float] | None) -> Polygon | None:
    """An outline with its arcs as chords, or None where it crosses itself or has no area."""
    z = np.array([complex(*c) for c in corners])
    ring: list[complex] = []
    for a, b, bulge in zip(z, np.roll(z, -1), bulges or [0.0] * len(z), strict=False):
        ring.append(a)
        if bulge and a != b:
            angle = 4.0 * math.atan(bulge)
            centre = 0.5 * (a + b) + 0.5j * (b - a) / math.tan(0.5 * angle)
            ring += list(centre + (a - centre) * np.exp(1j * angle * np.arange(1, STEPS) / STEPS))
    shape = Polygon([(p.real, p.imag) for p in ring]) if len(ring) > 2 else Polygon()
    return shape if shape.is_valid and shape.area > 0.0 else None


def plate_of(points: Sequence[Vec2], radius: float) -> Polygon | None:
    """A plate with round ends about points."""
    known = [p for p in points if all(map(math.isfinite, p))]
    return MultiPoint(known).convex_hull.buffer(radius, quad_segs=STEPS) if known and radius > 0.0 else None


def misplaced(material: Polygon, holes: Sequence[tuple[Vec2, float]]) -> Iterator[tuple[int, str]]:
    """Numbers of holes (centre, radius) that cannot be cut, with what is wrong."""
    for k, (centre, radius) in enumerate(holes):
        if not all(map(math.isfinite, (*centre, radius))):
            continue
        if not material.covers(Point(centre).buffer((1.0 - CLOSE) * radius, quad_segs=STEPS)):
            yield k, "the hole reaches out of the plate."
        for i, (other, size) in enumerate(holes[:k]):
            if math.dist(centre, other) < (1.0 - CLOSE) * (radius + size):
                yield k, f"the hole overlaps hole {i + 1}: material would be taken away twice."
