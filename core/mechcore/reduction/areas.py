"""Exact integrals over plane areas bounded by straight lines and circular arcs: area, centre, polar moment (Green's theorem).

An outline is a closed chain of vertices; the side to the next vertex is straight, or an arc given by its bulge, the tangent of a
quarter of the angle that it spans (positive: counter-clockwise), as in drawing exchange files.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechcore.errors import Fault, MechanismError
from mechcore.reduction.bodies import Body, combine
from mechcore.texts import as_length

Vec2 = tuple[float, float]


@dataclass(frozen=True)
class Area:
    """``area`` [m^2], ``centre`` [m], ``polar`` moment about the centre, the integral of r^2 dA [m^4]."""

    area: float
    centre: Vec2
    polar: float

    def body(self, surface_density: float) -> Body:
        """A plate of this shape; ``surface_density`` [kg/m^2] is density times thickness, negative for a hole."""
        return Body(surface_density * self.area, self.centre, surface_density * self.polar)


def area_of(vertices: ArrayLike, bulges: Sequence[float] | None = None) -> Area:
    """Integrals over the inside of an outline (n, 2) [m], in either sense of rotation. `MechanismError` where it has no area."""
    z = np.asarray(vertices, float)
    middle = z.mean(axis=0)
    p = z - middle  # integrals about a point inside: no cancellation for outlines far from the origin
    q = np.roll(p, -1, axis=0)
    c = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
    area = 0.5 * c.sum()
    first = (c[:, None] * (p + q)).sum(axis=0) / 6.0
    second = (c * ((p * p).sum(axis=1) + (p * q).sum(axis=1) + (q * q).sum(axis=1))).sum() / 12.0
    for bulge, a, b in zip(bulges or (), p, q, strict=bool(bulges)):
        if bulge:
            da, df, ds = _segment(a, b, bulge)
            area, first, second = area + da, first + df, second + ds
    if abs(area) <= 1e-12 * float((p * p).sum()):
        raise MechanismError(Fault("outline", "the outline has no area.", "Check its corners and bulges."))
    if area < 0.0:
        area, first, second = -area, -first, -second
    centre = first / area
    return Area(float(area), (float(middle[0] + centre[0]), float(middle[1] + centre[1])), float(second - area * (centre**2).sum()))


def _segment(a: np.ndarray, b: np.ndarray, bulge: float) -> tuple[float, np.ndarray, float]:
    """Signed area, first and second polar moment about the origin of the segment between a chord and its arc."""
    chord = b - a
    length = float(np.hypot(*chord))
    angle = 4.0 * math.atan(abs(bulge))  # that the arc spans
    radius = length / (2.0 * math.sin(0.5 * angle))
    out = np.array([chord[1], -chord[0]]) / length * math.copysign(1.0, bulge)  # from the chord to the arc
    centre = 0.5 * (a + b) - out * radius * math.cos(0.5 * angle)
    half = 0.5 * angle
    area = radius**2 * (half - math.sin(half) * math.cos(half))
    # distance of the segment's centre from the circle's, and its polar moment about the circle's centre
    away = 2.0 / 3.0 * radius**3 * math.sin(half) ** 3 / area if area > 0.0 else radius
    # sector less triangle, both about the circle's centre
    triangle = radius**2 * math.sin(half) * math.cos(half) * radius**2 * (math.cos(half) ** 2 / 2.0 + math.sin(half) ** 2 / 6.0)
    polar = radius**4 * half / 2.0 - triangle
    at = centre + away * out
    polar += area * (float((at**2).sum()) - away**2)
    sign = math.copysign(1.0, bulge)
    return sign * area, sign * area * at, sign * polar


def circle(centre: Vec2, radius: float) -> Area:
    """A full circle."""
    return Area(math.pi * radius**2, centre, 0.5 * math.pi * radius**4)


def stadium(a: Vec2, b: Vec2, radius: float) -> Area:
    """A plate with round ends about two points: the outline of a drawn binary link."""
    d = complex(*b) - complex(*a)
    n = 1j * d / abs(d) * radius
    corners = [complex(*a) + n, complex(*a) - n, complex(*b) - n, complex(*b) + n]
    return area_of([(z.real, z.imag) for z in corners], [1.0, 0.0, 1.0, 0.0])


def plate(outer: Area, surface_density: float, *, holes: Iterable[Area] = (), bosses: Iterable[tuple[Area, float]] = ()) -> Body:
    """A plate with holes through it, and bosses on it, each with a surface density of its own [kg/m^2]."""
    parts = [outer.body(surface_density), *(h.body(-surface_density) for h in holes)]
    return combine([*parts, *(area.body(extra) for area, extra in bosses)])


def rounded_hull(points: Sequence[Vec2], radius: float) -> Area:
    """The smallest convex outline around circles of one radius about points: a plate with round ends, or a rounded polygon."""
    z = sorted({complex(*p) for p in points}, key=lambda c: (c.real, c.imag))
    if radius <= 0.0:
        raise MechanismError(Fault("plate", f"a radius of {as_length(radius)} at its ends.", "Give a positive width."))
    corners = _hull(z)
    if len(corners) == 1:
        return circle((corners[0].real, corners[0].imag), radius)
    vertices, bulges = [], []
    n = len(corners)
    for i, at in enumerate(corners):
        before, after = at - corners[i - 1], corners[(i + 1) % n] - at
        turn = math.atan2((before.conjugate() * after).imag, (before.conjugate() * after).real) % (2.0 * math.pi)
        for side, bulge in ((before, math.tan(0.25 * turn)), (after, 0.0)):
            place = at - 1j * side / abs(side) * radius  # to the right of the way round
            vertices.append((place.real, place.imag))
            bulges.append(bulge)
    return area_of(vertices, bulges)


def _hull(z: list[complex]) -> list[complex]:
    """Corners of the convex hull, counter-clockwise (Andrew's monotone chain)."""
    if len(z) < 3:
        return z

    def half(places: Sequence[complex]) -> list[complex]:
        out: list[complex] = []
        for p in places:
            while len(out) > 1 and ((out[-1] - out[-2]).conjugate() * (p - out[-1])).imag <= 0.0:
                out.pop()
            out.append(p)
        return out[:-1]

    return half(z) + half(z[::-1])
