"""Parts of a picture: a flat list of nodes, each with a key, an owner, the group with which it is shown or hidden, and a track."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from enum import StrEnum
from functools import cached_property
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Flags, Index, Real, Single
from mechcore.records import dataclass
from mechviz.meshes import solids
from mechviz.quantities.vectors import Moment, Scales, Vector

# [m]: outlines, springs and constructions reach beyond the points that they belong to
FARTHEST_VERTEX = 10.0 * solids.FARTHEST_POINT

Color = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A solid: ``vertices`` (V, 3) [m], ``faces`` (N, 3), unit ``normals`` (V, 3), ``colors`` (V, 3) from 0 to 255."""

    vertices: Single
    faces: NDArray[np.uint32]
    normals: Single
    colors: NDArray[np.uint8]

    def pieces(self) -> Iterator[tuple[Color, Index, NDArray[np.uint32]]]:
        """The parts of one colour each: colour, indices (n,) of its vertices, and faces (m, 3) with indices into these. A face has
        the colour of its first corner."""
        shades, piece = np.unique(self.colors, axis=0, return_inverse=True)
        piece = piece.reshape(-1)
        for k, (red, green, blue) in enumerate(shades.tolist()):
            chosen = np.flatnonzero(piece == k)
            place = np.zeros(len(piece), np.uint32)
            place[chosen] = np.arange(len(chosen), dtype=np.uint32)
            yield (red, green, blue), chosen, place[self.faces[piece[self.faces[:, 0]] == k]]


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """Poses of a body at every frame: ``places`` (F, 3) [m], ``quaternions`` x, y, z, w (F, 4), ``scales`` (F, 3)."""

    places: Single
    quaternions: Single
    scales: Single | None = None


class NodeKind(StrEnum):
    """Kinds of nodes, by their names in recordings, which do not change with the names of classes."""

    BODY = "body"
    LINES = "lines"
    POINTS = "points"
    ARROWS = "arrowset"
    ARROW = "arrow"
    ARC = "arc"


@dataclass(frozen=True, eq=False)
class Node:
    """A drawn item. ``key``: unique in its picture; ``owner``: kind (link, joint, load, point, construction) and name; ``group``:
    the group with which it is shown or hidden; ``entity``: entity path in a recording, in parts; ``height``: its z [m]."""

    key: str
    owner: tuple[str, str]
    group: str
    entity: tuple[str, ...]
    height: float

    KIND: ClassVar[NodeKind]


@dataclass(frozen=True, eq=False)
class Body(Node):
    """A solid in the axes of the link ``parent``, or in the world where ``parent`` is empty; without ``poses`` it is at rest
    there."""

    KIND = NodeKind.BODY

    parent: str
    mesh: Mesh
    poses: PoseTrack | None = None

    def bounds(self) -> Real:
        """Box (2, 2) [m] over the run around a body that is scaled along its axis in the plane. The body must have scales."""
        assert self.poses is not None and self.poses.scales is not None
        places, (z, w) = self.poses.places[:, :2], self.poses.quaternions[:, 2:].T
        long, wide = self.poses.scales[:, 0] * self.mesh.vertices[:, 0].max(), float(self.mesh.vertices[:, 1].max())
        points = np.concatenate([places, places + long[:, None] * np.column_stack([w * w - z * z, 2.0 * w * z])]).astype(float)
        return np.array([np.nanmin(points, axis=0) - wide, np.nanmax(points, axis=0) + wide])


@dataclass(frozen=True, eq=False)
class Lines(Node):
    """Strips (F, n, 3) [m] in the world at every frame, or (1, n, 3) at rest in the world or in the axes of the link ``parent``.

    ``colors`` and ``radii`` [m]: one for each strip, or one for all; ``visible`` (F,): whether the lines are drawn at a frame.
    """

    KIND = NodeKind.LINES

    strips: tuple[Single, ...]
    colors: tuple[Color, ...]
    radii: tuple[float, ...]
    visible: Flags | None = None
    labels: tuple[str, ...] = ()
    parent: str = ""

    @property
    def moves(self) -> bool:
        return len(self.strips[0]) > 1


@dataclass(frozen=True, eq=False)
class Points(Node):
    """Points (F, n, 3) [m] in the world at every frame, or (1, n, 3) at rest in the axes of the link ``parent``. All are NaN at
    frames where they do not exist. ``colors``: one for each point, or one for all."""

    KIND = NodeKind.POINTS

    parent: str
    places: Single
    colors: tuple[Color, ...]
    radii: tuple[float, ...]
    labels: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ArrowSet(Node):
    """Arrows of a construction from ``origins`` along ``vectors`` (F, n, 3) [m]; ``colors``: one for each arrow, or one for all."""

    KIND = NodeKind.ARROWS

    origins: Single
    vectors: Single
    colors: tuple[Color, ...]
    radius: float
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Arrow(Node):
    """A vector over the frames. ``offset`` [m]: shift to the left of its line, where another arrow lies on that."""

    KIND = NodeKind.ARROW

    vector: Vector
    offset: float = 0.0

    @property
    def origin(self) -> Real:
        """Start of the drawn arrow (F, 2) [m]."""
        return self.origin_at(slice(None))

    def origin_at(self, frames: slice) -> Real:
        """Start of the drawn arrow at some frames (n, 2) [m]."""
        origin = self.vector.origin[frames]
        if not self.offset:
            return origin
        x, y = self.vector.value[frames].T
        length = np.hypot(x, y)
        across = np.column_stack([-y, x]) / np.where(length > 0.0, length, 1.0)[:, None]
        return np.asarray(origin + self.offset * across)


@dataclass(frozen=True, eq=False)
class MomentArc(Node):
    """A moment over the frames, drawn as an arc of a ``radius`` [m]; moments at one place have different radii."""

    KIND = NodeKind.ARC

    moment: Moment
    radius: float


def farthest(node: Node) -> float:
    """Largest coordinate [m] of a node's places, in absolute value; 0 for nodes without a track."""
    places: tuple[Real | Single, ...] = ()
    match node:
        case Body(poses=PoseTrack(places=at)):
            places = (at,)
        case Lines():
            places = node.strips
        case Points():
            places = (node.places,)
        case ArrowSet():
            places = node.origins, node.vectors
        case Arrow():
            places = (node.vector.origin,)
    return max((float(np.max(np.abs(at), initial=0.0, where=~np.isnan(at))) for at in places), default=0.0)


N = TypeVar("N", bound=Node)


@dataclass(frozen=True, eq=False)
class Picture:
    """The picture of a run over the frames at ``time`` (F,) [s]: ``poses`` x, y, angle (F, 3) [m, m, rad] of all links, and the
    nodes.

    ``frame``: the fixed link; ``size``: of the mechanism [m]; ``bounds`` (2, 3) [m]: box around all solids over the run; ``top``:
    height [m] of the front of the solids; ``scales``: of the arrows; ``widths``: of springs by name, relative to that of a spring
    around a stem only; ``fixtures``: meshes that are drawn with the solids of links; both are empty where they are not known.
    ``marks``: whether names of joints and arrows are shown at first.
    """

    time: Real
    frame: str
    poses: Mapping[str, Real]
    nodes: tuple[Node, ...]
    scales: Scales
    size: float
    bounds: Real
    top: float
    widths: Mapping[str, float] = field(default_factory=dict)
    fixtures: Mapping[str, Sequence[Mesh]] = field(default_factory=dict)
    marks: bool = True

    @cached_property
    def by_key(self) -> Mapping[str, Node]:
        return {node.key: node for node in self.nodes}

    def nodes_of(self, kind: type[N], *groups: str) -> Iterator[N]:
        """The nodes of a class, in the given groups or, without groups, in all."""
        return (node for node in self.nodes if isinstance(node, kind) and (not groups or node.group in groups))
