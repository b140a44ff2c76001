"""The costs of many orders of layers at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Flags, Integers, Real

if TYPE_CHECKING:
    from mechviz.meshes.layers.order import Post


Layers = NDArray[np.int16]


class Costs:
    """Costs (T,) of orders (T, n): clashes, pedestals in front, height, spans of pins, each with its weight."""

    def __init__(
        self,
        conflicts: Sequence[int],
        posts: Sequence[Post],
        behind: Mapping[int, float],
        weights: tuple[float, float, float, float],
    ):
        self.clash, self.front, self.height, self.span = weights
        n = len(conflicts)
        joints = [(g, h) for g in range(n) for h in range(g) if conflicts[g] >> h & 1]
        self._joints = np.array(joints, np.intp).reshape(-1, 2).T
        width = max((len(post.groups) for post in posts), default=1)
        self._groups = (
            np.array([[*post.groups, *[post.groups[0]] * (width - len(post.groups))] for post in posts], np.intp)
            .reshape(-1, width)
            .T.copy()
        )
        self._ground = np.array([post.ground for post in posts], bool)[:, None]
        hits = [(k, g) for k, post in enumerate(posts) for g in range(n) if post.hits >> g & 1]
        self._hits = np.array(hits, np.intp).reshape(-1, 2).T
        # where the hits of each post begin, for sums over them
        self._hit_posts, self._starts = np.unique(self._hits[0], return_index=True)
        self._near = np.array([(i, j) for i, post in enumerate(posts) for j in post.near if j < i], np.intp).reshape(-1, 2).T
        self._behind = np.array(list(behind), np.intp), np.array(list(behind.values()), float)

    def __call__(self, layers: Layers, *, partial: bool = False) -> Real:
        clashes, extra, _ = self.counted(layers, partial=partial)
        return self.clash * clashes + extra

    def counted(self, layers: Layers, *, partial: bool = False) -> tuple[Integers, Real, Flags]:
        """Clashes (T,), all other costs (T,), and which posts reach to the front (posts, T).

        ``partial``: groups on layer -1 are not placed yet and cost nothing.
        """
        at = np.ascontiguousarray(layers.T)  # (n, T): sums then run over whole rows
        top = at.max(axis=0)
        first, second = at[self._joints[0]], at[self._joints[1]]
        same = (first == second) & (first >= 0) if partial else first == second
        clashes = np.add.reduce(same, axis=0, dtype=np.int64)
        which, price = self._behind
        extra = self.height * top
        if len(which):
            extra = extra + price @ (np.maximum(at[which], 0) if partial else at[which])
        front = np.zeros((self._groups.shape[1], at.shape[1]), bool)
        if not len(front):
            return clashes, extra, front
        members = at[self._groups]  # (width, posts, T)
        high = members.max(axis=0)
        if partial:
            members = np.where(members < 0, high, members)
        low = members.min(axis=0)
        if self._hits.size:
            hits, front[self._hit_posts] = self._hit(at, low, high, partial=partial)
            clashes = clashes + hits
        ground, some = self._ground, high >= 0
        start = np.where(ground & ~front, np.int16(-1), low)
        end = np.where(front, top + np.int16(1), high)
        between = high - low  # layers passed by a pin of the air, less those of its own groups
        for k in range(1, len(members)):
            between -= (members[k] != members[:k]).all(axis=0)
        spans = np.where(ground, end - start - np.int16(1), np.maximum(between, 0))
        if partial:
            spans, start, end = spans * some, start * some, end * some
        extra = (
            extra
            + self.front * np.add.reduce(front, axis=0, dtype=np.int64)
            + self.span * np.add.reduce(spans, axis=0, dtype=np.int64)
        )
        if self._near.size:
            i, j = self._near
            close = np.minimum(end[i], end[j]) - np.maximum(start[i], start[j]) > 1
            clashes = clashes + np.add.reduce(close, axis=0, dtype=np.int64)
        return clashes, extra, front

    def _hit(self, at: Layers, low: Layers, high: Layers, *, partial: bool) -> tuple[Integers, Flags]:
        """How many groups run into posts (T,), and whether the posts that may be hit reach to the front to avoid more."""
        post, group = self._hits
        layer, least, most = at[group], low[post], high[post]
        if partial:  # what is not placed lies at the post's own end, where it is in nobody's way
            layer = np.where(layer < 0, least, layer)
        behind, before = self._summed(layer < least), self._summed(layer > most)
        between = self._summed((layer > least) & (layer < most))
        ground = self._ground[self._hit_posts]
        hits = (between + np.where(ground, np.minimum(behind, before), 0)).sum(axis=0)
        return hits, ground & (before < behind)

    def _summed(self, flags: Flags) -> Integers:
        """Numbers of true flags (hits, T) for each post that has any."""
        return np.add.reduceat(flags, self._starts, axis=0, dtype=np.int64)


def packed(layers: Layers) -> Layers:
    """The same orders (T, n) without empty layers."""
    most = int(layers.max()) + 1
    used = np.zeros((len(layers), most), np.int16)
    wide = layers.astype(np.intp)
    np.put_along_axis(used, wide, 1, axis=1)
    return np.take_along_axis(np.cumsum(used, axis=1, dtype=np.int16) - np.int16(1), wide, axis=1)


CHUNK = 512  # orders at once: small enough for the cache


def improve_many(costs: Costs, layers: Layers) -> Layers:
    """Packed orders (S, n) after moves that help, until none does, the best of some hundred at a time."""
    return np.stack([_improved(costs, order) for order in layers])


def _improved(costs: Costs, order: Layers) -> Layers:
    """One order (n,): another layer, a new one between two, a swap, for as long as that helps."""
    current = packed(order[None])
    cost = float(costs(current)[0])
    start = 0
    while True:
        moved = False
        chunks = list(_chunks(current[0]))
        for k in range(len(chunks)):  # on from where the last step was found: what is behind it has been tried
            chunk = (start + k) % len(chunks)
            trials = packed(_applied(current[0], chunks[chunk]))
            found = costs(trials)
            best = int(np.argmin(found))
            if found[best] < cost - 1e-9:
                current, cost, start, moved = trials[best : best + 1], float(found[best]), chunk, True
                break
        if not moved:
            return np.asarray(current[0])


def _chunks(layers: Layers) -> Iterator[Integers]:
    """Moves (m, 3), some hundred at a time: kind, group, and a layer or another group."""
    n, top = len(layers), int(layers.max())
    groups, levels = (a.reshape(-1) for a in np.meshgrid(np.arange(n), np.arange(top + 2), indexing="ij"))
    first, second = np.tril_indices(n, -1)
    kinds = [(np.zeros(1, int), np.zeros(1, int)), (groups, levels), (groups, levels), (first, second)]
    moves = np.concatenate([np.column_stack([np.full(len(a), kind), a, b]) for kind, (a, b) in enumerate(kinds)])
    for k in range(0, len(moves), CHUNK):
        yield moves[k : k + CHUNK]


def _applied(layers: Layers, moves: Integers) -> Layers:
    """The orders (m, n) that moves make."""
    out = np.repeat(layers[None], len(moves), axis=0)
    row = np.arange(len(moves))
    kind, group, other = moves.T
    out[kind == 0] = layers.max() - layers  # upside down
    out[row[kind == 1], group[kind == 1]] = other[kind == 1]
    shift = kind == 2  # a new layer for the group alone
    out[shift] += out[shift] >= other[shift, None]
    out[row[shift], group[shift]] = other[shift]
    swap = kind == 3
    out[row[swap], group[swap]], out[row[swap], other[swap]] = layers[other[swap]], layers[group[swap]]
    return out
