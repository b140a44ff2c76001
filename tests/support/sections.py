"""Plane sections of meshes, for tests that look at solids from outside."""

import numpy as np
import shapely
import trimesh
from shapely import LineString, MultiLineString, Polygon


class Sections:
    """Sections of a mesh: between two heights of its corners, where all cut faces are upright, they are the same."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self.mesh = mesh
        corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
        self.span = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)  # of each face
        a, b, c = (corners[:, k, :2] for k in range(3))
        area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        self.leans = np.abs(area) > 1e-12 * np.ptp(corners[..., :2], axis=(0, 1)).max(initial=0.0) ** 2
        self.heights = np.unique(mesh.vertices[:, 2])
        self.known: dict[int, shapely.Geometry] = {}

    def at(self, z: float) -> tuple[int | float, shapely.Geometry]:
        """What the section at a height is known by, the same for the same section, and the section."""
        low, high = self.span
        if (self.leans & (low <= z) & (z < high)).any():
            return z, section(self.mesh, z)
        between = int(np.searchsorted(self.heights, z))
        if between not in self.known:
            self.known[between] = section(self.mesh, z)
        return between, self.known[between]


def section(mesh: trimesh.Trimesh, z: float) -> shapely.Geometry:
    """What a plane of constant z cuts out of a mesh (even-odd: plates minus holes plus pins)."""
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    above = corners[..., 2] > z
    corners = corners[above.any(axis=1) & ~above.all(axis=1)]  # the faces that are cut, each on two of its edges
    if len(corners) == 0:
        return Polygon()
    a, b = corners, np.roll(corners, -1, axis=1)
    swapped = (a[..., 2] > b[..., 2])[..., None]  # the same point, to the last digit, from both faces of an edge
    a, b = np.where(swapped, b, a), np.where(swapped, a, b)
    crossed = (a[..., 2] > z) != (b[..., 2] > z)
    a, b = a[crossed], b[crossed]
    cuts = (a + (b - a) * ((z - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None])[:, :2].reshape(-1, 2, 2)
    lines = shapely.linestrings(cuts[(cuts[:, 0] != cuts[:, 1]).any(axis=1)])
    merged = shapely.line_merge(shapely.multilinestrings(lines))
    area: shapely.Geometry = Polygon()
    loops = list(getattr(merged, "geoms", [merged]))
    for loop in loops:
        if loop.is_closed:  # of facets thinner than their rounding it may cross itself
            area = area.symmetric_difference(shapely.make_valid(Polygon(loop)))
    # outlines of parts of one solid that touch each other (a roller in its fork) are not merged: even-odd by rays
    open_lines = MultiLineString([line for line in loops if not line.is_closed])
    if not open_lines.is_empty:
        faces = list(shapely.polygonize([shapely.unary_union(open_lines)]).geoms)
        assert faces, "the section of a solid is not closed"
        for face in faces:
            inside = face.representative_point()
            ray = LineString([inside, (inside.x + 10.0, inside.y + 0.137)])
            # line by line: some of them coincide, and their crossings would count once
            crossed = sum(len(shapely.get_parts(ray.intersection(line))) for line in open_lines.geoms)
            if crossed % 2:
                area = area.symmetric_difference(face)
    return area
