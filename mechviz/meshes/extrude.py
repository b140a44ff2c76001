"""Closed triangle meshes of flat parts with bevelled edges and turned features (bosses, holes, pins).

Everything is built from rings of vertices that neighbouring surfaces share by index, so that the result is watertight
by construction and no vertices need merging. Lengths are in units of the mechanism's size.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from mapbox_earcut import triangulate_float64
from shapely.geometry import LinearRing, Point, Polygon

from mechcore.arrays import Integers, Real
from mechcore.records import dataclass
from mechviz.meshes.outline import ShapeError, clean
from mechviz.meshes.shading import SolidColor

Profile = tuple[tuple[float, float], ...]
Ring = tuple[Real, Integers]
"""A closed line of vertices: positions (n, 2) and indices (n,)."""


@dataclass(frozen=True)
class Shell:
    """A closed triangle mesh: vertices (V, 3) and faces (N, 3), counter-clockwise seen from outside."""

    vertices: Real
    faces: Integers

    @property
    def bounds(self) -> Real:
        """Lowest and highest corner (2, 3)."""
        return np.array([self.vertices.min(axis=0), self.vertices.max(axis=0)])


def joined_shells(shells: Sequence[Shell]) -> Shell:
    """Several shells as one, in their order."""
    starts = np.cumsum([0, *(len(shell.vertices) for shell in shells)])
    return Shell(
        np.vstack([shell.vertices for shell in shells]),
        np.vstack([shell.faces + start for shell, start in zip(shells, starts, strict=False)]),
    )


@dataclass(frozen=True)
class RoundFeature:
    """A round feature of a plate: profiles (radius, z) that start on the plate's top and bottom face.

    An empty profile leaves that face unchanged. If both profiles end at the same radius > 0 they are joined by the wall of a
    through hole. If a profile ends at radius 0 the feature is closed on that side (a stud). ``bore``: the outline of a hole that is
    not round, which replaces the last radius of both profiles.
    """

    centre: tuple[float, float]
    top: Profile = ()
    bottom: Profile = ()
    bore: Polygon | None = None

    @property
    def rim(self) -> float:
        """The largest radius where the feature leaves a face of the plate."""
        reach = 0.0 if self.bore is None else float(np.hypot(*(_coords(self.bore.exterior) - self.centre).T).max())
        return max([reach, *(profile[0][0] for profile in (self.top, self.bottom) if profile)])


@dataclass(frozen=True)
class Groove:
    """A groove around the edge of a plate, between two heights within its straight wall."""

    depth: float
    low: float
    high: float


class _Builder:
    """Collects rings of vertices and the surfaces between them."""

    def __init__(self) -> None:
        self._vertices: list[Real] = []
        self._faces: list[Integers] = []
        self._count = 0

    def ring(self, xy: Real, z: Real | float) -> Integers:
        """Add vertices xy (n, 2) at height z, one for all or (n,); return their indices (n,)."""
        out = np.empty((len(xy), 3))
        out[:, :2], out[:, 2] = xy, z
        self._vertices.append(out)
        self._count += len(xy)
        return np.arange(self._count - len(xy), self._count)

    def strips(self, rings: Sequence[Integers]) -> None:
        """Add the surfaces from each ring to the next, equally long; for counter-clockwise rings in ascending order they face
        outwards."""
        if len(rings) < 2:
            return
        own = np.array(rings)
        nxt = np.concatenate([own[:, 1:], own[:, :1]], axis=1)
        start, s2, end, e2 = own[:-1], nxt[:-1], own[1:], nxt[1:]
        faces = np.empty((len(start), 2, start.shape[1], 3), np.int64)
        for k, side in enumerate(((start, s2, e2), (start, e2, end))):
            for corner, index in enumerate(side):
                faces[:, k, :, corner] = index
        self._faces.append(faces.reshape(-1, 3))

    def cap(self, ring: Integers, centre: tuple[float, float], z: float, *, up: bool) -> None:
        """Add a fan of triangles that closes a circle."""
        apex = self.ring(np.array([centre]), z)[0]
        faces = np.full((len(ring), 3), apex)
        own, following = (0, 1) if up else (1, 0)
        faces[:, own], faces[:-1, following], faces[-1, following] = ring, ring[1:], ring[0]
        self._faces.append(faces)

    def face(self, rings: Sequence[Ring], *, up: bool) -> None:
        """Add the flat face inside the first ring and outside the others."""
        triangles = _triangulate([xy for xy, _ in rings])
        index = np.concatenate([i for _, i in rings])
        self._faces.append(index[triangles if up else triangles[:, ::-1]])

    def shell(self) -> Shell:
        return Shell(np.vstack(self._vertices), np.vstack(self._faces).astype(np.int64))


def plate_mesh(
    outline: Polygon,
    z: tuple[float, float],
    bevel: float,
    turned: Sequence[RoundFeature] = (),
    segments: int = 40,
    groove: Groove | None = None,
) -> Shell:
    """A plate between the heights z, with edges bevelled at 45 degrees, turned features on its faces, and a groove around its outer
    edge. The bevel is left out if the outline is too fine for it. Raises `ShapeError` if the outline falls apart.
    """
    outline = clean(outline)
    if not isinstance(outline, Polygon) or outline.is_empty:
        raise ShapeError("the outline of a part falls apart")
    rings = [_coords(ring) for ring in (outline.exterior, *outline.interiors)]
    insets = _insets(rings, bevel, turned)
    if insets is None:  # the outline is too fine for a bevel
        insets, bevel = rings, 0.0
    low, high = z
    build = _Builder()
    top, bottom = [], []
    for k, (ring, inset) in enumerate(zip(rings, insets, strict=True)):
        edge = []
        if groove is not None and k == 0:
            floor = _inset(ring, groove.depth)
            edge = [(ring, groove.low), (floor, groove.low), (floor, groove.high), (ring, groove.high)]
        if bevel > 0.0:
            levels = [(inset, low), (ring, low + bevel), *edge, (ring, high - bevel), (inset, high)]
        else:
            levels = [(ring, low), *edge, (ring, high)]
        index = [build.ring(xy, height) for xy, height in levels]
        build.strips(index)
        bottom.append((inset, index[0]))
        top.append((inset, index[-1]))
    for feature in turned:
        _add_turned(build, feature, top, bottom, segments)
    build.face(top, up=True)
    build.face(bottom, up=False)
    return build.shell()


def revolve(profile: Profile, centre: tuple[float, float] = (0.0, 0.0), segments: int = 40) -> Shell:
    """A solid of revolution about a line through ``centre`` parallel to the z axis.

    The profile (radius, z) starts and ends on the axis, lowest point first.
    """
    circle = _circle(segments)
    build = _Builder()
    rings = [build.ring(centre + r * circle, z) for r, z in profile[1:-1]]
    build.strips(rings)
    build.cap(rings[0], centre, profile[0][1], up=False)
    build.cap(rings[-1], centre, profile[-1][1], up=True)
    return build.shell()


def bored(rings: Sequence[tuple[Real, Real | float]], bore: Polygon) -> Shell:
    """A solid around the z axis with a through bore of any outline.

    rings: xy (n, 2), counter-clockwise, and z (n,) or one number, all with the same n, from the outer edge of the lower end face to
    that of the upper one; both faces are flat.
    """
    build = _Builder()
    index = [build.ring(xy, z) for xy, z in rings]
    build.strips(index)
    hole = _coords(clean(bore).exterior)
    low, high = (build.ring(hole, float(np.mean(z))) for z in (rings[0][1], rings[-1][1]))
    build.face([(rings[0][0], index[0]), (hole, low)], up=False)
    build.face([(rings[-1][0], index[-1]), (hole, high)], up=True)
    build.strips([high, low])
    return build.shell()


def _add_bored(build: _Builder, feature: RoundFeature, top: list[Ring], bottom: list[Ring], segments: int) -> None:
    """Add a hole that is not round, with or without a boss around it."""
    assert feature.bore is not None
    circle, hole = _circle(segments), _coords(clean(feature.bore).exterior)
    ends = []
    for profile, face, up in ((feature.top, top, True), (feature.bottom, bottom, False)):
        end = build.ring(hole, profile[-1][1])
        ends.append(end)
        if len(profile) == 1:  # no boss
            face.append((hole, end))
            continue
        radii = [r for r, _ in profile[:-1]]
        rings = [build.ring(feature.centre + r * circle, z) for r, z in profile[:-1]]
        face.append((feature.centre + radii[0] * circle, rings[0]))
        build.strips(rings if up else rings[::-1])
        build.face([(feature.centre + radii[-1] * circle, rings[-1]), (hole, end)], up=up)
    build.strips(ends)


def _add_turned(build: _Builder, feature: RoundFeature, top: list[Ring], bottom: list[Ring], segments: int) -> None:
    if feature.bore is not None:
        return _add_bored(build, feature, top, bottom, segments)
    circle = _circle(segments)
    sides = []
    for profile, face in ((feature.top, top), (feature.bottom, bottom)):
        closed = bool(profile) and profile[-1][0] == 0.0
        rings = [build.ring(feature.centre + r * circle, z) for r, z in (profile[:-1] if closed else profile)]
        if rings:
            # The orientation of a hole does not matter: triangulation needs only its points.
            face.append((feature.centre + profile[0][0] * circle, rings[0]))
        sides.append((rings, closed))
    (up, up_closed), (down, down_closed) = sides
    build.strips(up)
    build.strips(down[::-1])
    if up and down and not up_closed and not down_closed:
        build.strips([up[-1], down[-1]])
    if up_closed:
        build.cap(up[-1], feature.centre, feature.top[-1][1], up=True)
    if down_closed:
        build.cap(down[-1], feature.centre, feature.bottom[-1][1], up=False)


def _insets(rings: list[Real], bevel: float, turned: Sequence[RoundFeature]) -> list[Real] | None:
    """The rings offset into the material by the bevel, vertex by vertex; None if no valid face remains."""
    if bevel <= 0.0:
        return None
    insets = [_inset(ring, bevel) for ring in rings]
    face = Polygon(insets[0], insets[1:])
    if not face.is_valid or not Polygon(rings[0], rings[1:]).contains(face):
        return None
    if any(not face.contains(Point(t.centre).buffer(t.rim)) for t in turned):
        return None
    return insets


def _inset(ring: Real, distance: float) -> Real:
    """A ring (n, 2) with every vertex moved to the left of the direction of the ring, so that edges move by ``distance``."""
    edge = np.roll(ring, -1, axis=0) - ring
    edge = edge / np.linalg.norm(edge, axis=1, keepdims=True)
    normal = np.column_stack([-edge[:, 1], edge[:, 0]])
    before = np.roll(normal, 1, axis=0)
    bisector = before + normal
    return np.asarray(ring + distance * bisector / np.maximum(1.0 + (before * normal).sum(axis=1, keepdims=True), 0.1))


def _coords(ring: LinearRing) -> Real:
    return np.asarray(ring.coords)[:-1, :2]


@lru_cache(maxsize=16)
def _circle(segments: int) -> Real:
    """A unit circle, counter-clockwise (n, 2)."""
    angle = 2.0 * np.pi * np.arange(segments) / segments
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    circle.flags.writeable = False  # the cached array is shared
    return circle


def _triangulate(rings: Sequence[Real]) -> Integers:
    """Triangles (N, 3), counter-clockwise, of the region inside the first ring and outside the others.

    Ear clipping drops vertices where rings are exactly aligned; the number of triangles is then too small. In that case the points
    are rotated by an arbitrary angle and triangulated again. Raises `ShapeError` if no angle succeeds.
    """
    points = np.vstack(rings)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    expected = len(points) + 2 * (len(rings) - 1) - 2
    for turn in (0.0, 0.7391, 1.2345, 0.3217, 2.1113, 2.7771):
        c, s = np.cos(turn), np.sin(turn)
        flat = np.ascontiguousarray((points - points.mean(axis=0)) @ np.array([[c, s], [-s, c]]))
        triangles = triangulate_float64(flat, ends).reshape(-1, 3).astype(np.int64)
        if len(triangles) == expected:
            break
    else:
        raise ShapeError("a face of a part cannot be divided into triangles")
    a, b, c3 = points[triangles[:, 0]], points[triangles[:, 1]], points[triangles[:, 2]]
    area = ((b - a)[:, 0] * (c3 - a)[:, 1] - (b - a)[:, 1] * (c3 - a)[:, 0]).sum()
    return triangles if area > 0.0 else triangles[:, ::-1]


@dataclass(frozen=True, eq=False)
class Prism:
    """The space that a part occupies: an outline in its link's frame between two heights."""

    outline: Polygon
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Part:
    """One watertight part of a link."""

    link: str
    kind: str  # "plate", "wheel", "block", "rail", "belt", "barrel", "rod", "neck", "pin", "key" or "pedestal"
    shell: Shell
    color: SolidColor | None  # None: the colour of the link
    space: tuple[Prism, ...]
    mates: frozenset[str] = frozenset()  # joints in which it meshes: parts with a common joint do not clash
