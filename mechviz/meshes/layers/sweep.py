"""Where flat outlines meet while their links move: exact tests on polygons, all pairs and all frames at once.

Circles around the outlines, then boxes, leave few places where two of them may meet; there the rings of one, moved into the frame
of the other one's link, are tested exactly, the likeliest places first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from mechcore.arrays import Flags, Integers, Real
from mechviz.meshes.extrude import ShapeError

_FIRST = 3  # places at which a question is tried before all others
_TOGETHER = (48, 6)  # frames in a row that are looked at as one, in turn
_PORTION = 500_000  # pairs of outlines times frames, and vertices, in one array


class Sweeps:
    """Outlines fixed to links, and the poses (F, 3) of those links over the run, in units of the size. Raises `ShapeError` where an
    outline is empty."""

    def __init__(self, outlines: Sequence[Polygon], links: Sequence[str], poses: Mapping[str, Real]) -> None:
        self._shapes = np.array(outlines, object)
        if shapely.is_empty(self._shapes).any():  # beside a link that is very much longer
            raise ShapeError("the outline of a part is lost in rounding")
        names = list(dict.fromkeys(links))
        self._link = np.array([names.index(link) for link in links], np.int64)
        pose = np.array([poses[name] for name in names], float).reshape(len(names), -1, 3)
        self._x, self._y, angle = np.moveaxis(pose, 2, 0)  # (links, F)
        self._c, self._s = np.cos(angle), np.sin(angle)

    def meet(self, pairs: Integers, questions: Integers | None = None) -> Flags:
        """Whether outlines (P, 2) touch or overlap at any frame: (P,); or for each question (P,) from 0 on whether any of its
        pairs do: (questions,)."""
        pairs = np.asarray(pairs, np.int64).reshape(-1, 2)
        questions = np.arange(len(pairs)) if questions is None else np.asarray(questions, np.int64)
        met = np.zeros(int(questions.max(initial=-1)) + 1, bool)
        if not len(pairs):
            return met
        pairs = self._larger_first(pairs)
        pair, frame, depth = self._places(pairs)
        asked = questions[pair]
        # the deeper boxes lie in each other, the likelier the outlines meet
        order = np.lexsort((-depth, asked))
        rank = np.arange(len(order)) - np.searchsorted(asked[order], asked[order])
        likely = order[rank < _FIRST]
        met[asked[likely[self._touch(pairs[pair[likely]], frame[likely])]]] = True
        rest = np.flatnonzero(~met[asked])
        for count in _TOGETHER:
            rest = rest[self._within_reach(pairs, pair[rest], frame[rest], count)]
        for part in self._portions(rest, pairs[pair, 1]):
            open_ = part[~met[asked[part]]]
            met[asked[open_[self._touch(pairs[pair[open_]], frame[open_])]]] = True
        return met

    @cached_property
    def _boxes(self) -> tuple[Real, Real, Real]:
        """Boxes around the outlines in their links' frames, and circles about their middles: (N, 2), half sides (N, 2), (N,)."""
        low_x, low_y, high_x, high_y = shapely.bounds(self._shapes).T
        middle = 0.5 * np.column_stack([low_x + high_x, low_y + high_y])
        half = 0.5 * np.column_stack([high_x - low_x, high_y - low_y])
        xy, number = shapely.get_coordinates(self._shapes, return_index=True)
        away = np.hypot(*(xy - middle[number]).T)
        return middle, half, np.maximum.reduceat(away, np.flatnonzero(np.r_[True, np.diff(number) > 0]))

    @cached_property
    def _paths(self) -> tuple[Real, Real]:
        """The middles of the boxes in the world, x and y (N, F)."""
        (x, y), of = self._boxes[0].T[:, :, None], self._link
        c, s = self._c[of], self._s[of]
        return self._x[of] + c * x - s * y, self._y[of] + s * x + c * y

    @cached_property
    def _rings(self) -> tuple[Real, Integers, Integers, Integers]:
        """Vertices of all rings (V, 2), where each ring begins, how many it has, and where each outline's rings begin (N + 1)."""
        count = shapely.get_num_interior_rings(self._shapes) + 1
        xy, number = shapely.get_coordinates(shapely.get_rings(self._shapes), return_index=True)
        length = np.bincount(number, minlength=int(count.sum()))
        return xy, np.cumsum(length) - length, length, np.r_[0, np.cumsum(count)]

    @cached_property
    def _prepared(self) -> NDArray[np.object_]:
        shapely.prepare(self._shapes)
        return self._shapes

    def _larger_first(self, pairs: Integers) -> Integers:
        """The pairs turned so that no outline can lie within the second one: then it is enough to look where its rings are."""
        area = shapely.area(shapely.polygons(shapely.get_exterior_ring(self._shapes)))
        turned = area[pairs[:, 0]] < area[pairs[:, 1]]
        return np.where(turned[:, None], pairs[:, ::-1], pairs)

    def _places(self, pairs: Integers) -> tuple[Integers, Integers, Real]:
        """Pairs (M,) and frames (M,) where boxes overlap, and how deep."""
        x, y = self._paths
        _, _, radius = self._boxes
        low = np.stack([x.min(axis=1), y.min(axis=1)]) - radius
        high = np.stack([x.max(axis=1), y.max(axis=1)]) + radius
        a, b = pairs.T
        near = np.flatnonzero((np.minimum(high[:, a], high[:, b]) >= np.maximum(low[:, a], low[:, b])).all(axis=0))
        meetings = []
        step = max(1, _PORTION // x.shape[1])
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
        """How far boxes (M, 2) reach into each other at frames, less than zero where an axis separates them: (M,)."""
        middle, half, radius = self._boxes
        i, j = pairs.T
        dx, dy, c, s = self._relative(self._link[i], self._link[j], frame)
        x, y = dx + c * middle[j, 0] - s * middle[j, 1] - middle[i, 0], dy + s * middle[j, 0] + c * middle[j, 1] - middle[i, 1]
        (ax, ay), (bx, by), ca, sa = half[i].T, half[j].T, np.abs(c), np.abs(s)
        of_first = np.maximum(np.abs(x) - ax - ca * bx - sa * by, np.abs(y) - ay - sa * bx - ca * by)
        of_second = np.maximum(np.abs(c * x + s * y) - bx - ca * ax - sa * ay, np.abs(c * y - s * x) - by - sa * ax - ca * ay)
        return np.asarray(1e-12 * (radius[i] + radius[j]) - np.maximum(of_first, of_second))

    def _within_reach(self, pairs: Integers, pair: Integers, frame: Integers, count: int) -> Flags:
        """Which places (M,), in the order of pairs and frames, remain when so many in a row are taken together: those where a
        circle around all places of the second outline reaches the first one. A pin in its hole never does."""
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
        """Places x, y and cosines, sines of other links in the frames of base links, at frames: (M,) each."""
        cb, sb, co, so = self._c[base, frame], self._s[base, frame], self._c[other, frame], self._s[other, frame]
        dx, dy = self._x[other, frame] - self._x[base, frame], self._y[other, frame] - self._y[base, frame]
        return cb * dx + sb * dy, cb * dy - sb * dx, cb * co + sb * so, cb * so - sb * co

    def _portions(self, places: Integers, moved: Integers) -> list[Integers]:
        """Places in portions whose moved outlines have not too many vertices."""
        _, _, length, first = self._rings
        size = np.add.reduceat(length, first[:-1])[moved[places]]
        return np.split(places, np.flatnonzero(np.diff(np.cumsum(size) // _PORTION)) + 1)

    def _touch(self, pairs: Integers, frame: Integers) -> Flags:
        """Whether outlines (M, 2) meet, each pair at one frame: (M,). Of the second the rings are looked at, moved to the first."""
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
    """start[0], start[0] + 1, ..., count[0] of them, then those from start[1] on, and so forth."""
    ends = np.cumsum(count)
    return np.arange(ends[-1] if len(ends) else 0) + np.repeat(start - ends + count, count)
