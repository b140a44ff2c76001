"""From pieces to heights: pieces and pins that would meet, the order of the layers, and the heights z of everything."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from mechcore.arrays import Flags, Integers, Real
from mechcore.records import dataclass
from mechviz.meshes.draft import Neck, PlacedPart, SolidsDraft
from mechviz.meshes.kinds.wheels_drawn import webs
from mechviz.meshes.layer_order import Post, order_layers
from mechviz.meshes.model import Proportions, ScaledMechanism
from mechviz.meshes.outline import ShapeError, disc

_FIRST_PLACES = 3  # number of the most likely cases per question that are tested before all others
_FRAMES_TOGETHER = (48, 6)  # numbers of successive frames that are tested together, in successive passes
_PAIRS_AT_ONCE = 500_000  # largest number of pairs of outlines times frames, and of vertices, in one array


class Sweeps:
    """Tests outlines fixed to links for contact over the run; ``poses`` (F, 3) of the links in units of the size. Raises
    `ShapeError` if an outline is empty."""

    def __init__(self, outlines: Sequence[Polygon], links: Sequence[str], poses: Mapping[str, Real]) -> None:
        self._shapes = np.array(outlines, object)
        if shapely.is_empty(self._shapes).any():  # if another link is very much longer
            raise ShapeError("the outline of a part is lost in rounding")
        names = list(dict.fromkeys(links))
        self._link = np.array([names.index(link) for link in links], np.int64)
        pose = np.array([poses[name] for name in names], float).reshape(len(names), -1, 3)
        self._x, self._y, angle = np.moveaxis(pose, 2, 0)  # (links, F)
        self._c, self._s = np.cos(angle), np.sin(angle)

    def meet(self, pairs: Integers, questions: Integers | None = None) -> Flags:
        """Whether pairs of outlines (P, 2) touch or overlap in any frame: (P,). With ``questions`` (P,), numbers of questions from
        0: for each question, whether any of its pairs does."""
        pairs = np.asarray(pairs, np.int64).reshape(-1, 2)
        questions = np.arange(len(pairs)) if questions is None else np.asarray(questions, np.int64)
        met = np.zeros(int(questions.max(initial=-1)) + 1, bool)
        if not len(pairs):
            return met
        pairs = self._larger_first(pairs)
        pair, frame, depth = self._places(pairs)
        asked = questions[pair]
        # the deeper the boxes overlap, the likelier the outlines meet
        order = np.lexsort((-depth, asked))
        rank = np.arange(len(order)) - np.searchsorted(asked[order], asked[order])
        nearest = order[rank < _FIRST_PLACES]
        met[asked[nearest[self._touch(pairs[pair[nearest]], frame[nearest])]]] = True
        rest = np.flatnonzero(~met[asked])
        for count in _FRAMES_TOGETHER:
            rest = rest[self._within_reach(pairs, pair[rest], frame[rest], count)]
        for part in self._portions(rest, pairs[pair, 1]):
            open_ = part[~met[asked[part]]]
            met[asked[open_[self._touch(pairs[pair[open_]], frame[open_])]]] = True
        return met

    @cached_property
    def _boxes(self) -> tuple[Real, Real, Real]:
        """Boxes around the outlines in their links' frames: centres (N, 2), half sides (N, 2), radii (N,) about the centres."""
        low_x, low_y, high_x, high_y = shapely.bounds(self._shapes).T
        middle = 0.5 * np.column_stack([low_x + high_x, low_y + high_y])
        half = 0.5 * np.column_stack([high_x - low_x, high_y - low_y])
        xy, number = shapely.get_coordinates(self._shapes, return_index=True)
        away = np.hypot(*(xy - middle[number]).T)
        return middle, half, np.maximum.reduceat(away, np.flatnonzero(np.r_[True, np.diff(number) > 0]))

    @cached_property
    def _paths(self) -> tuple[Real, Real]:
        """World coordinates of the centres of the boxes, x and y (N, F)."""
        (x, y), of = self._boxes[0].T[:, :, None], self._link
        c, s = self._c[of], self._s[of]
        return self._x[of] + c * x - s * y, self._y[of] + s * x + c * y

    @cached_property
    def _rings(self) -> tuple[Real, Integers, Integers, Integers]:
        """Vertices of all rings (V, 2), first vertex and vertex count of each ring, and first ring of each outline (N + 1,)."""
        count = shapely.get_num_interior_rings(self._shapes) + 1
        xy, number = shapely.get_coordinates(shapely.get_rings(self._shapes), return_index=True)
        length = np.bincount(number, minlength=int(count.sum()))
        return xy, np.cumsum(length) - length, length, np.r_[0, np.cumsum(count)]

    @cached_property
    def _prepared(self) -> NDArray[np.object_]:
        shapely.prepare(self._shapes)
        return self._shapes

    def _larger_first(self, pairs: Integers) -> Integers:
        """The pairs with the outline of larger area first, so that the first cannot lie within the second: it then suffices to test
        the rings of the second."""
        area = shapely.area(shapely.polygons(shapely.get_exterior_ring(self._shapes)))
        turned = area[pairs[:, 0]] < area[pairs[:, 1]]
        return np.where(turned[:, None], pairs[:, ::-1], pairs)

    def _places(self, pairs: Integers) -> tuple[Integers, Integers, Real]:
        """Pairs (M,) and frames (M,) in which boxes overlap, and the depths of overlap (M,)."""
        x, y = self._paths
        _, _, radius = self._boxes
        low = np.stack([x.min(axis=1), y.min(axis=1)]) - radius
        high = np.stack([x.max(axis=1), y.max(axis=1)]) + radius
        a, b = pairs.T
        near = np.flatnonzero((np.minimum(high[:, a], high[:, b]) >= np.maximum(low[:, a], low[:, b])).all(axis=0))
        meetings = []
        step = max(1, _PAIRS_AT_ONCE // x.shape[1])
        for k in range(0, len(near), step):
            some = near[k : k + step]
            i, j = pairs[some].T
            square = (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2
            row, frame = np.nonzero(square <= ((1.0 + 1e-12) * (radius[i] + radius[j]) ** 2)[:, None])
            depth = self._depth(pairs[some[row]], frame)
            kept = depth >= 0.0
            meetings.append((some[row[kept]], frame[kept], depth[kept]))
        if not meetings:
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
        pair, frame, depth = (np.concatenate(part) for part in zip(*meetings, strict=True))
        return pair, frame, depth

    def _depth(self, pairs: Integers, frame: Integers) -> Real:
        """Depths of overlap (M,) of boxes (M, 2) at frames (M,), negative if an axis separates them."""
        middle, half, radius = self._boxes
        i, j = pairs.T
        dx, dy, c, s = self._relative(self._link[i], self._link[j], frame)
        x, y = dx + c * middle[j, 0] - s * middle[j, 1] - middle[i, 0], dy + s * middle[j, 0] + c * middle[j, 1] - middle[i, 1]
        (ax, ay), (bx, by), ca, sa = half[i].T, half[j].T, np.abs(c), np.abs(s)
        of_first = np.maximum(np.abs(x) - ax - ca * bx - sa * by, np.abs(y) - ay - sa * bx - ca * by)
        of_second = np.maximum(np.abs(c * x + s * y) - bx - ca * ax - sa * ay, np.abs(c * y - s * x) - by - sa * ax - ca * ay)
        return np.asarray(1e-12 * (radius[i] + radius[j]) - np.maximum(of_first, of_second))

    def _within_reach(self, pairs: Integers, pair: Integers, frame: Integers, count: int) -> Flags:
        """Flags (M,) of the cases, in the order of pairs and frames, that remain when ``count`` successive ones are tested
        together: those in which a circle around all positions of the second outline reaches the first one. A pin in its hole never
        does."""
        if not len(pair):
            return np.zeros(0, bool)
        middle, _, radius = self._boxes
        i, j = pairs[pair].T
        dx, dy, c, s = self._relative(self._link[i], self._link[j], frame)
        x, y = dx + c * middle[j, 0] - s * middle[j, 1], dy + s * middle[j, 0] + c * middle[j, 1]
        new = np.r_[True, pair[1:] != pair[:-1]]
        begin = np.maximum.accumulate(np.where(new, np.arange(len(pair)), 0))
        start = np.flatnonzero((np.arange(len(pair)) - begin) % count == 0)
        low, high = (np.stack([f.reduceat(part, start) for part in (x, y)]) for f in (np.minimum, np.maximum))
        reach = (1.0 + 1e-9) * (0.5 * np.hypot(*(high - low)) + radius[j[start]])
        near = shapely.dwithin(self._prepared[i[start]], shapely.points(*(0.5 * (low + high))), reach)
        return np.repeat(near, np.diff(np.r_[start, len(pair)]))

    def _relative(self, base: Integers, other: Integers, frame: Integers) -> tuple[Real, Real, Real, Real]:
        """Positions x, y and cosines, sines of other links in the frames of base links, at frames: (M,) each."""
        cb, sb, co, so = self._c[base, frame], self._s[base, frame], self._c[other, frame], self._s[other, frame]
        dx, dy = self._x[other, frame] - self._x[base, frame], self._y[other, frame] - self._y[base, frame]
        return cb * dx + sb * dy, cb * dy - sb * dx, cb * co + sb * so, cb * so - sb * co

    def _portions(self, places: Integers, moved: Integers) -> list[Integers]:
        """Cases in portions whose moved outlines have at most about `_PAIRS_AT_ONCE` vertices."""
        _, _, length, first = self._rings
        size = np.add.reduceat(length, first[:-1])[moved[places]]
        return np.split(places, np.flatnonzero(np.diff(np.cumsum(size) // _PAIRS_AT_ONCE)) + 1)

    def _touch(self, pairs: Integers, frame: Integers) -> Flags:
        """Whether outlines (M, 2) meet, each pair in one frame: (M,). The rings of the second are moved to the frame of the
        first."""
        if not len(pairs):
            return np.zeros(0, bool)
        xy, start, length, first = self._rings
        i, j = pairs.T
        rings = _ranges(first[j], first[j + 1] - first[j])
        place = np.repeat(np.arange(len(pairs)), first[j + 1] - first[j])
        vertices = _ranges(start[rings], length[rings])
        line = np.repeat(np.arange(len(rings)), length[rings])
        dx, dy, c, s = (part[place[line]] for part in self._relative(self._link[i], self._link[j], frame))
        x, y = xy[vertices].T
        lines = shapely.linestrings(np.column_stack([dx + c * x - s * y, dy + s * x + c * y]), indices=line)
        touching = np.zeros(len(pairs), bool)
        touching[place[shapely.intersects(self._prepared[i][place], lines)]] = True
        return touching


def _ranges(start: Integers, count: Integers) -> Integers:
    """Concatenated ranges: ``count[0]`` integers from ``start[0]``, then ``count[1]`` from ``start[1]``, and so on."""
    ends = np.cumsum(count)
    return np.arange(ends[-1] if len(ends) else 0) + np.repeat(start - ends + count, count)


_RAIL_COST = 1.0  # cost of rails per layer from the back
_CARRIER_COST = 9.0  # the same for the carrier of a planetary gear or the web of a ring, which would hide the wheels


@dataclass(frozen=True)
class Levels:
    """Layers of a mechanism, counted from the back, and their heights in units of the size."""

    proportions: Proportions
    layer: Mapping[str, int]  # group -> layer
    group: Mapping[str, str]  # moving link -> group of its plate
    axle_layers: tuple[tuple[int, ...], ...]  # for every axle the layers that its pin passes
    axle_front: tuple[bool, ...]  # for every axle: whether its pedestal stands in front
    block_front: tuple[bool, ...]  # for every block that is fixed to the ground
    top: int  # the layer nearest to the viewer
    clashes: int = 0  # number of remaining clashes of pieces and pins

    def layer_of(self, link: str) -> int:
        """Layer of a moving link's plate."""
        return self.layer[self.group[link]]

    def plate(self, layer: int) -> tuple[float, float]:
        """Heights of the plates of a layer."""
        return layer * self.proportions.pitch, layer * self.proportions.pitch + self.proportions.thickness

    def slab(self, layer: int) -> tuple[float, float]:
        """Lower and upper height of everything on a layer, including bosses."""
        low, high = self.plate(layer)
        return low - self.proportions.boss, high + self.proportions.boss


@dataclass(frozen=True, eq=False)
class _Reach:
    """A pin or neck that extends through layers: its outline, the groups that it joins, and the links to which it belongs."""

    outline: Polygon
    link: str
    groups: tuple[str, ...]
    members: frozenset[str]
    ground: bool


def stack_pieces(model: ScaledMechanism, draft: SolidsDraft) -> Levels:
    """The layers, in the order with the fewest clashes of pieces and pins during the motion."""
    names = draft.group_names
    number = {name: k for k, name in enumerate(names)}
    reaches = [_axle_reach(model, draft, k) for k in range(len(model.axles))]
    reaches += [_neck_reach(neck) for neck in draft.necks]
    reaches += [
        _Reach(disc(centre, 0.6 * model.proportions.half_width, 16), model.frame, (group,), frozenset({model.frame}), True)
        for centre, group in draft.fixed_blocks
    ]
    conflicts, hits, near = _meetings(model, draft, reaches, number)
    posts = [
        Post(tuple(sorted({number[g] for g in reach.groups})), reach.ground, hits[k], near[k]) for k, reach in enumerate(reaches)
    ]
    behind = {number[piece.group]: _RAIL_COST for piece in draft.pieces if piece.kind == "rail"}
    behind |= {number[draft.groups[name]]: _CARRIER_COST for name in model.wheels.carriers - {model.frame}}
    behind |= {number[group]: _CARRIER_COST for group in webs(model, draft)}
    order = order_layers(conflicts, posts, behind)
    layer = _in_planes(model, draft, {name: order.layers[number[name]] for name in names})
    axles, necks = len(model.axles), len(draft.necks)
    top = max(layer.values(), default=0)
    passed = tuple(tuple(sorted({layer[g] for g in draft.groups_on_axle(model, k)})) for k in range(axles))
    return Levels(
        model.proportions, layer, draft.groups, passed, order.front[:axles], order.front[axles + necks :], top, order.clashes
    )


def _in_planes(model: ScaledMechanism, draft: SolidsDraft, layer: dict[str, int]) -> dict[str, int]:
    """Layers of groups such that links of one stated plane lie together, at least as far in front of the first plane as stated."""
    plane = dict.fromkeys(layer, 0.0)
    for piece in draft.pieces:
        plane[piece.group] = max(plane[piece.group], model.planes.get(piece.link, 0.0), key=abs)
    planes: dict[str, int] = {}
    last = -1
    for at in sorted(set(plane.values())):
        own = [group for group in layer if plane[group] == at]
        used = sorted({layer[group] for group in own})
        first = max(last + 1, math.ceil((at - min(plane.values())) / model.proportions.pitch - 1e-9))
        planes |= {group: first + used.index(layer[group]) for group in own}
        last = first + len(used) - 1
    return planes


def _axle_reach(model: ScaledMechanism, draft: SolidsDraft, number: int) -> _Reach:
    axle = model.axles[number]
    ground = model.frame in axle.centres
    link = model.frame if ground else axle.owner
    outline = disc(axle.centres[link], axle.sleeve, 16)
    return _Reach(outline, link, draft.groups_on_axle(model, number), frozenset(axle.centres), ground)


def _neck_reach(neck: Neck) -> _Reach:
    return _Reach(neck.outline, neck.link, neck.groups, frozenset({neck.link}), False)


def _meetings(
    model: ScaledMechanism, draft: SolidsDraft, reaches: list[_Reach], number: Mapping[str, int]
) -> tuple[list[int], list[int], list[tuple[int, ...]]]:
    """Bit masks: for every group, the groups that it meets in some frame (or to which a joint connects it); for every pin or neck,
    the groups that would run into it. And for every pin or neck, the others that it meets, except for those of a common link, which
    do not move relative to each other."""
    conflicts, hits = [0] * len(number), [0] * len(reaches)
    near: list[list[int]] = [[] for _ in reaches]

    def forbid(a: int, b: int) -> None:
        if a != b:
            conflicts[a] |= 1 << b
            conflicts[b] |= 1 << a

    for k in range(len(model.axles)):
        groups = [number[group] for group in draft.groups_on_axle(model, k)]
        for a in groups:
            for b in groups:
                forbid(a, b)
    for neck in draft.necks:
        forbid(number[neck.groups[0]], number[neck.groups[1]])
    if not model.frames:
        return conflicts, hits, [() for _ in reaches]
    pieces, count = draft.pieces, len(draft.pieces)
    owners = [number[piece.group] for piece in pieces]
    asked: dict[tuple[str, int, int], list[tuple[int, int]]] = {}  # question -> pairs of outlines that decide it
    for i, p in enumerate(pieces):
        for j, q in enumerate(pieces[:i]):
            a, b = sorted((owners[i], owners[j]))
            if a != b and p.link != q.link and not conflicts[a] >> b & 1:
                asked.setdefault(("conflict", a, b), []).append((i, j))
    for k, reach in enumerate(reaches):
        for i, piece in enumerate(pieces):
            if piece.group not in reach.groups and piece.link not in reach.members - {model.frame}:
                asked.setdefault(("hit", k, owners[i]), []).append((count + k, i))
        for j, other in enumerate(reaches[:k]):
            if not reach.members & other.members - {model.frame}:
                asked["near", k, j] = [(count + k, count + j)]
    sweeps = Sweeps(
        [*_grown(model, pieces), *(reach.outline for reach in reaches)],
        [*(piece.link for piece in pieces), *(reach.link for reach in reaches)],
        model.poses,
    )
    pairs = np.array([pair for some in asked.values() for pair in some], np.int64)
    met = sweeps.meet(pairs, np.repeat(np.arange(len(asked)), [len(some) for some in asked.values()]))
    for (what, a, b), yes in zip(asked, met.tolist(), strict=True):
        if yes and what == "conflict":
            forbid(a, b)
        elif yes and what == "hit":
            hits[a] |= 1 << b
        elif yes:
            near[a].append(b)
            near[b].append(a)
    return conflicts, hits, [tuple(sorted(n)) for n in near]


def _grown(model: ScaledMechanism, pieces: Sequence[PlacedPart]) -> list[Polygon]:
    """Outlines of pieces without their holes, slightly enlarged: a part within a hole would hit the edge of the hole."""
    r = model.proportions.half_width
    whole = shapely.polygons(shapely.get_exterior_ring([piece.outline for piece in pieces]))
    return list(shapely.simplify(shapely.buffer(whole, 0.08 * r, quad_segs=2), 0.01 * r))


def poses_of(model: ScaledMechanism, link: str) -> Real:
    """Poses (F, 3) of a link; at rest at the origin if the motion is not known."""
    return model.poses[link] if model.frames else np.zeros((1, 3))
