"""Sections: what lies before a plane parallel to that of the motion is cut away, so that hidden cams and pins are seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .show import Body, Piece

__all__ = ["sectioned", "shells"]

DARKER = 0.8  # the cut itself beside the rest of the part


def shells(piece: Piece) -> NDArray[np.int64]:
    """The number of the closed part that each vertex (V,) of a piece belongs to; vertices at one place belong together."""
    places, same = np.unique(piece.vertices, axis=0, return_inverse=True)
    corners = same.reshape(-1)[piece.faces.astype(np.int64)]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(places), len(places)))
    return np.asarray(connected_components(graph, directed=False)[1][same.reshape(-1)], np.int64)


def sectioned(body: Body, height: float) -> Body:
    """A body without what lies before z = ``height`` [m].

    All parts are plates: a part that the plane passes through is pushed flat onto it, which closes it with its own outline, and one
    that lies before it is left out. The cut itself is a darker piece. Spatial cams, which turn about an axis in the plane, stay
    whole.
    """
    pieces = []
    for piece in () if body.whole else body.pieces:
        z = piece.vertices[:, 2]
        if z.max() <= height:
            pieces.append(piece)
            continue
        shell = shells(piece)
        lowest = np.full(shell.max() + 1, np.inf)
        np.minimum.at(lowest, shell, z)
        kept = lowest[shell] < height
        vertices = piece.vertices.copy()
        vertices[:, 2] = np.minimum(z, np.float32(height))
        faces = piece.faces[kept[piece.faces[:, 0]]]
        flat = (vertices[faces, 2] == np.float32(height)).all(axis=1)  # in the plane
        red, green, blue = (int(DARKER * c) for c in piece.color)
        pieces += [_part(vertices, faces[~flat], piece.color), _part(vertices, faces[flat], (red, green, blue))]
    return body if body.whole else Body(tuple(piece for piece in pieces if len(piece.faces)))


def _part(vertices: NDArray[np.float32], faces: NDArray[np.uint32], color: tuple[int, int, int]) -> Piece:
    """Some faces with the vertices that they use."""
    used, own = np.unique(faces, return_inverse=True)
    return Piece(vertices[used], own.reshape(-1, 3).astype(np.uint32), color)
