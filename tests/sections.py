"""Plane sections of meshes, for tests that look at solids from outside."""

import numpy as np
import shapely
import trimesh
from shapely import LineString, MultiLineString, Polygon


def section(mesh: trimesh.Trimesh, z: float) -> shapely.Geometry:
    """What a plane of constant z cuts out of a mesh (even-odd: plates minus holes plus pins)."""
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    above = mesh.vertices[:, 2] > z
    crossed = above[edges[..., 0]] != above[edges[..., 1]]
    pairs = edges[crossed].reshape(-1, 2, 2)  # a face that is cut at all is cut on two of its edges
    if len(pairs) == 0:
        return Polygon()
    a, b = mesh.vertices[pairs[..., 0]], mesh.vertices[pairs[..., 1]]
    cuts = (a + (b - a) * ((z - a[..., 2]) / (b[..., 2] - a[..., 2]))[..., None])[..., :2]
    merged = shapely.line_merge(MultiLineString([s for s in cuts if (s[0] != s[1]).any()]))
    area: shapely.Geometry = Polygon()
    loops = list(getattr(merged, "geoms", [merged]))
    for loop in loops:
        if loop.is_closed:
            area = area.symmetric_difference(Polygon(loop))
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
