"""Vertex normals with crisp edges: smooth along round walls, split where faces meet at more than 30 degrees."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

__all__ = ["crisp"]

_CREASE = np.cos(np.radians(30.0))


def crisp(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split a closed mesh along its creases.

    vertices (V, 3) and faces (N, 3) -> vertices (W, 3), faces (N, 3) and unit normals (W, 3) of the split mesh. Faces
    around a vertex that are connected over smooth edges form a fan; a vertex is repeated for every fan around it.
    """
    normal, area = face_normals(vertices, faces)
    key = np.stack([faces.ravel(), _fans(faces, normal)], axis=1)
    pairs, corner = np.unique(key, axis=0, return_inverse=True)
    corner = corner.reshape(-1)
    total = np.zeros((len(pairs), 3))
    np.add.at(total, corner, np.repeat(normal * area[:, None], 3, axis=0))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    # A needle of a triangle may have no area of its own: such a corner takes the normal of one of its faces.
    fallback = np.zeros_like(total)
    fallback[corner] = np.repeat(normal, 3, axis=0)
    unit = np.where(length > 0.0, total / np.where(length > 0.0, length, 1.0), fallback)
    return vertices[pairs[:, 0]], corner.reshape(-1, 3), unit


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (N, 3) and twice the areas (N,) of the faces; a face without area gets the normal (0, 0, 1)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    flat = length == 0.0
    normal = cross / np.where(flat, 1.0, length)[:, None]
    normal[flat] = (0.0, 0.0, 1.0)
    return normal, length


def _fans(faces: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The number of the smooth fan that each corner of each face belongs to (3 N,), corners in the order of the faces."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    same = (edges[1:] == edges[:-1]).all(axis=1)
    shared, a, b = edges[:-1][same], owner[:-1][same], owner[1:][same]
    smooth = (normal[a] * normal[b]).sum(axis=1) > _CREASE
    shared, a, b = shared[smooth], a[smooth], b[smooth]
    links = [
        [3 * face + (faces[face] == shared[:, [end]]).argmax(axis=1) for face in (a, b)] for end in (0, 1)
    ]  # both ends of an edge join a corner of one face to a corner of the other
    first, second = (np.concatenate([links[0][k], links[1][k]]) for k in (0, 1))
    graph = coo_matrix((np.ones(len(first)), (first, second)), shape=(faces.size, faces.size))
    return connected_components(graph, directed=False)[1]
