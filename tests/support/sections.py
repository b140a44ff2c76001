"""Plane sections of meshes, for tests that look at solids from outside."""

import numpy as np
import shapely
import trimesh
from shapely import LineString, MultiLineString, Polygon


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
