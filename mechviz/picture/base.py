"""The base of the fixed link: bars behind all parts that join the bearings, and posts from the bars to the parts of the ground."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon, box
from shapely.ops import unary_union

from mechcore.arrays import Real, Vec2
from mechcore.records import dataclass
from mechviz.meshes.outline import polygons
from mechviz.meshes.shading import SolidColor
from mechviz.picture.proportions import occlusion_frames
from mechviz.picture.springs import Coil

if TYPE_CHECKING:
    from mechviz.meshes.solids import Solids
    from mechviz.runs import Run

BAR_DEPTH = 0.018  # depth of the bars along z, in sizes of the mechanism
BAR_HALF_WIDTH, POST_HALF_WIDTH = 0.011, 0.006  # half widths of bars and posts, in sizes
BASE_COLOR: SolidColor = (92, 99, 109, 255)  # a little darker than the parts on it
POST_DISTANCES = (0.06, 0.12, 0.2, 0.3)  # distances of a post beside its part that are tried, in sizes
POST_DIRECTIONS = 12  # directions of these that are tried
POST_PLACES = 12  # places of a part at which a post is tried
CORE_RIMS = (0.006, 0.004, 0.0025, 0.0015)  # widths of the rim with the hatching that is removed from an outline, in sizes
HAIRLINE = 5e-6  # in sizes

PlacedOutline = tuple[Polygon, tuple[float, float], SolidColor]
"""An outline [m] in the frame of a link, the heights [m] between which it lies, and its colour."""


@dataclass(frozen=True)
class _Foot:
    """A place on the bars where a part of the ground is supported, and the solids that lead there: a post behind the part, and
    perhaps an arm beside it."""

    at: Vec2
    parts: tuple[PlacedOutline, ...] = ()


@dataclass(frozen=True, eq=False)
class _Room:
    """The space in front of the bars that links and springs leave free."""

    run: Run
    solids: Solids
    back: float  # height [m] of the front faces of the bars
    springs: list[tuple[shapely.Geometry, float, float]]  # area of the plane [m] that each covers, and its heights [m]

    def free(self, shape: Polygon, heights: tuple[float, float]) -> bool:
        """Whether no link or spring passes through a shape between two heights [m] during the run."""
        coiled = any(low < heights[1] and high > heights[0] and area.intersects(shape) for area, low, high in self.springs)
        return not coiled and not blocked(self.run, self.solids, shape, heights)

    def post(self, at: Vec2, high: float) -> _Foot | None:
        """A post at a place, up to a height [m]; None where a link or spring passes through it."""
        half, heights = POST_HALF_WIDTH * self.solids.size, (self.back, high)
        shape = box(at[0] - half, at[1] - half, at[0] + half, at[1] + half)
        return _Foot(at, ((shape, heights, BASE_COLOR),)) if self.free(shape, heights) else None


def blocked(run: Run, solids: Solids, shape: Polygon, heights: tuple[float, float]) -> bool:
    """Whether a link passes through a shape on the ground between two heights [m] during the run."""
    frames, known = occlusion_frames(run, solids.heights)
    ring = np.asarray(shape.exterior.coords)
    return solids.heights.is_crossed(heights, np.broadcast_to(ring, (len(frames), *ring.shape)), known, run.motion.mechanism.frame)


def find_base(run: Run, solids: Solids, coils: Sequence[Coil], fixtures: Sequence[PlacedOutline]) -> list[PlacedOutline]:
    """The bars and posts that support the parts of the ground: bearings, guides and ``fixtures``.

    A part that no post can reach without collision has no support. The result is empty where the ground has only one part, and for
    mechanisms with shafts in the plane, which have a bed of their own.
    """
    if any(solid.spin is not None for solid in solids.links.values()):
        return []
    size, frame = solids.size, run.motion.mechanism.frame
    covered = [_covered(run, solids, coil) for coil in coils]
    lows = [low - POST_HALF_WIDTH * size for low in (*(low for _, low, _ in covered), *(low for _, (low, _), _ in fixtures))]
    room = _Room(run, solids, min([float(solids.bounds[0, 2]), *lows]), covered)
    feet: list[_Foot] = []
    for (foot, low, high), *columns in solids.heights.parts(frame, ("pedestal",)):
        posts = _feet(room, foot, (low, high))
        if posts and columns and low < min(bottom for _, bottom, _ in columns):  # posts below the bearing itself
            posts = [post for outline, *_ in columns if (post := room.post(_xy(outline.centroid), low)) is not None] or posts
        feet += posts
    for part in solids.heights.parts(frame, ("rail", "block", "rod")):
        outline, low, high = part[0]
        feet += _feet(room, outline, (low, high))
    for outline, heights, _ in fixtures:
        feet += _feet(room, outline, heights)
    if len(feet) < 2:
        return []
    places = np.array([foot.at for foot in feet])
    bars = [LineString(places[list(pair)]).buffer(BAR_HALF_WIDTH * size, quad_segs=8) for pair in _tree(places)]
    across = [(shape, (room.back - BAR_DEPTH * size, room.back), BASE_COLOR) for shape in polygons(unary_union(bars))]
    longest: dict[Vec2, PlacedOutline] = {}  # longest post at each place
    arms: list[PlacedOutline] = []
    for foot in feet:
        for upright in foot.parts[:1]:
            longest[foot.at] = max(longest.get(foot.at, upright), upright, key=lambda one: one[1][1])
        arms += foot.parts[1:]
    standing = [placed for placed in (*longest.values(), *arms) if placed[1][1] - placed[1][0] > 1e-3 * size]
    return across + [  # each slightly shorter than the one before, so that no two parts share a corner
        (shape, (low + k * HAIRLINE * size, high - k * HAIRLINE * size), color)
        for k, (shape, (low, high), color) in enumerate(standing, 1)
    ]


def _covered(run: Run, solids: Solids, coil: Coil) -> tuple[shapely.Geometry, float, float]:
    """The area of the plane [m] that a spring sweeps during the run, and its least and greatest height [m]."""
    frames, _ = occlusion_frames(run, solids.heights)
    start, angle = coil.pose[frames, :2], coil.pose[frames, 2]
    long, wide = coil.stretch[frames] * float(coil.vertices[:, 0].max()), float(np.abs(coil.vertices[:, 1]).max())
    lines = np.stack([start, start + long[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])], axis=1)
    known = lines[np.isfinite(lines).all(axis=(1, 2))]
    area = shapely.union_all(shapely.buffer(shapely.linestrings(known), wide, cap_style="flat"))
    return area, coil.height - wide, coil.height + wide


def _feet(room: _Room, outline: Polygon, heights: tuple[float, float]) -> list[_Foot]:
    """Supports of a part of the ground on the bars: two for a long part, none where every place is blocked."""
    size, (low, high) = room.solids.size, heights
    candidates = _post_candidates(outline, size)
    long = np.hypot(*np.subtract(candidates[0], candidates[-1])) > 6.0 * BAR_HALF_WIDTH * size
    feet: list[_Foot] = []
    for order in (candidates, candidates[::-1]) if long else (candidates,):
        foot = next((foot for at in order if (foot := room.post(at, low)) is not None), None)
        if foot is not None and all(foot.at != other.at for other in feet):
            feet.append(foot)
    if feet:
        return feet
    start = _xy(outline.representative_point())
    for arm in POST_DISTANCES:
        for direction in np.exp(2j * np.pi * np.arange(POST_DIRECTIONS) / POST_DIRECTIONS):
            at = (start[0] + arm * size * float(direction.real), start[1] + arm * size * float(direction.imag))
            foot = room.post(at, high)
            reach = polygons(LineString([start, at]).buffer(POST_HALF_WIDTH * size, quad_segs=4).difference(outline))
            if foot is not None and all(room.free(shape, heights) for shape in reach):
                return [_Foot(at, (*foot.parts, *((shape, heights, BASE_COLOR) for shape in reach)))]
    return []


def _post_candidates(outline: Polygon, size: float) -> list[Vec2]:
    """Places [m] for posts within the core of an outline, from one end of it to the other."""
    cores = (polygons(outline.buffer(-part * size)) for part in CORE_RIMS)
    core = next((core[0] for core in cores if core), outline)
    corners = np.asarray(core.minimum_rotated_rectangle.exterior.coords)[:4]
    if np.hypot(*(corners[1] - corners[0])) < np.hypot(*(corners[2] - corners[1])):
        corners = np.roll(corners, -1, axis=0)
    start, end = 0.5 * (corners[0] + corners[3]), 0.5 * (corners[1] + corners[2])
    places = [Point(*(start + part * (end - start))) for part in np.linspace(0.06, 0.94, POST_PLACES)]
    return [_xy(at) for at in places if core.contains(at)] or [_xy(core.representative_point())]


def _xy(point: Point) -> Vec2:
    return (float(point.x), float(point.y))


def _tree(places: Real) -> Iterator[tuple[int, int]]:
    """Edges of the minimum spanning tree of places (n, 2), as pairs of their numbers (Prim)."""
    apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    inside = [0]
    while len(inside) < len(places):
        outside = np.setdiff1d(np.arange(len(places)), inside)
        a, b = np.unravel_index(np.argmin(apart[inside][:, outside]), (len(inside), len(outside)))
        yield inside[int(a)], int(outside[int(b)])
        inside.append(int(outside[int(b)]))
