"""Colours of parts: one muted colour per link, neutral greys for the frame and for pins; and normals of meshes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mechcore.arrays import Index, Integers, Real

SolidColor = tuple[int, int, int, int]  # red, green, blue, alpha, each 0-255

FRAME_COLOR: SolidColor = (112, 119, 128, 255)
PIN_COLOR: SolidColor = (196, 200, 206, 255)
BELT_COLOR: SolidColor = (62, 64, 69, 255)

# Ten muted hues. Neighbours in the list differ in lightness as well as in hue, so that colour-blind viewers can distinguish them,
# also in print; none is a saturated red or green, which force arrows use.
_LINK_COLORS: tuple[SolidColor, ...] = (
    (68, 114, 166, 255),  # blue
    (232, 163, 82, 255),  # amber
    (86, 160, 140, 255),  # teal
    (190, 99, 96, 255),  # brick
    (139, 121, 180, 255),  # violet
    (221, 196, 98, 255),  # straw
    (122, 177, 212, 255),  # sky
    (150, 112, 84, 255),  # brown
    (214, 156, 184, 255),  # rose
    (122, 140, 78, 255),  # olive
)


def link_colors(names: tuple[str, ...], frame: str, stated: Mapping[str, tuple[int, int, int]]) -> dict[str, SolidColor]:
    """Colour of every link: the ``stated`` one, otherwise by its position in the scene; the frame is grey and does not count."""
    moving = [name for name in names if name != frame]
    colors = {name: _LINK_COLORS[k % len(_LINK_COLORS)] for k, name in enumerate(moving)}
    return {**colors, frame: FRAME_COLOR, **{name: (*color, 255) for name, color in stated.items()}}


_CREASE_COSINE = np.cos(np.radians(30.0))


def crisp(vertices: Real, faces: Integers, normal: Real, area: Real) -> tuple[Real, Integers, Real, Integers]:
    """Split closed meshes along their creases.

    Arguments: vertices (V, 3), faces (N, 3), and the result of `face_normals`. Returns vertices (W, 3), faces (N, 3) and unit
    normals (W, 3) of the split mesh, and the index (W,) of the original vertex of each of its vertices. Faces around a vertex that
    are connected by smooth edges form a fan; a vertex is repeated for every fan around it, in the order of the vertices.
    """
    fans = _fans(faces, normal)
    count = int(fans.max(initial=-1)) + 1
    vertex_of = np.empty(count, np.int64)
    vertex_of[fans] = faces.ravel()  # a fan surrounds one vertex
    order = np.argsort(vertex_of, kind="stable")
    place = np.empty(count, np.int64)
    place[order] = np.arange(count)
    corner, shares = place[fans], normal * area[:, None]
    total = np.stack([np.bincount(corner, np.repeat(share, 3), count) for share in shares.T], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    # A degenerate triangle may have no area: a corner without area takes the normal of one of its faces.
    fallback = np.zeros_like(total)
    fallback[corner] = np.repeat(normal, 3, axis=0)
    unit = np.where(length > 0.0, total / np.where(length > 0.0, length, 1.0), fallback)
    source = vertex_of[order]
    return vertices[source], corner.reshape(-1, 3), unit, source


def face_normals(vertices: Real, faces: Integers) -> tuple[Real, Real]:
    """Unit normals (N, 3) and twice the areas (N,) of the faces; a face without area gets the normal (0, 0, 1)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    flat = length == 0.0
    normal = cross / np.where(flat, 1.0, length)[:, None]
    normal[flat] = (0.0, 0.0, 1.0)
    return normal, length


def _fans(faces: Integers, normal: Real) -> Index:
    """The number (3 N,) of the smooth fan to which each corner of each face belongs, corners in the order of the faces."""
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()  # vertices of the edge at each corner
    corner = np.arange(faces.size)
    after = corner.reshape(-1, 3)[:, [1, 2, 0]].ravel()
    forward = start <= end
    low, high = np.where(forward, corner, after), np.where(forward, after, corner)  # corners of the face at the edge's two vertices
    vertices = int(faces.max(initial=0)) + 1
    number = start[low].astype(np.int64) * vertices + start[high]  # of the edge, equal for both of its faces
    order = np.argsort(number, kind="stable")
    same = np.flatnonzero(number[order[1:]] == number[order[:-1]])
    a, b = order[same], order[same + 1]
    smooth = (normal[a // 3] * normal[b // 3]).sum(axis=1) > _CREASE_COSINE
    a, b = a[smooth], b[smooth]  # both ends of an edge join a corner of one face to a corner of the other
    first, second = np.concatenate([low[a], high[a]]), np.concatenate([low[b], high[b]])
    return components(faces.size, first, second)


def components(count: int, first: Index, second: Index) -> Index:
    """The connected component (count,) of each of ``count`` vertices of a graph with edges ``first`` - ``second`` (E,), numbered in
    the order in which they appear."""
    least = np.arange(count)  # a vertex of the same component, finally the first one
    while (apart := least[first] != least[second]).any():
        first, second = first[apart], second[apart]
        a, b = least[first], least[second]
        np.minimum.at(least, np.maximum(a, b), np.minimum(a, b))
        while (further := least[least]).tobytes() != least.tobytes():
            least = further
    return np.unique(least, return_inverse=True)[1]
