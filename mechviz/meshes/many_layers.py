"""The costs of many orders of layers at once, for mechanisms of many links: the same costs as in `layers`, over arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .layers import Post

__all__ = ["Costs", "improve"]

Layers = NDArray[np.int16]

CHUNK = 512  # orders at once: small enough for the cache


class Costs:
    """Costs (T,) of complete orders (T, n): clashes, height, spans of pins, with the weights of `layers`."""

    def __init__(
        self,
        conflicts: Sequence[int],
        posts: Sequence[Post],
        behind: Mapping[int, float],
        weights: tuple[float, float, float, float],
    ):
        self.clash, self.front, self.height, self.span = weights
        n = len(conflicts)
        pairs = [(g, h) for g in range(n) for h in range(g) if conflicts[g] >> h & 1]
        self._pairs = np.array(pairs, np.intp).reshape(-1, 2)
        width = max((len(post.groups) for post in posts), default=1)
        self._groups = np.array(
            [[*post.groups, *[post.groups[0]] * (width - len(post.groups))] for post in posts], np.intp
        ).reshape(-1, width)
        self._ground = np.array([post.ground for post in posts], bool)
        hits = [(k, g) for k, post in enumerate(posts) for g in range(n) if post.hits >> g & 1]
        self._hits = np.array(hits, np.intp).reshape(-1, 2)
        # where the hits of each post begin, for sums over them
        self._hit_posts, self._starts = np.unique(self._hits[:, 0], return_index=True)
        self._near = np.array([(i, j) for i, post in enumerate(posts) for j in post.near if j < i], np.intp).reshape(-1, 2)
        self._behind = np.array(list(behind), np.intp), np.array(list(behind.values()), float)

    def __call__(self, layers: Layers) -> NDArray[np.float64]:
        top = layers.max(axis=1)
        clashes = (layers[:, self._pairs[:, 0]] == layers[:, self._pairs[:, 1]]).sum(axis=1)
        which, price = self._behind
        extra = self.height * top + layers[:, which] @ price
        if len(self._groups):
            placed = np.sort(layers[:, self._groups], axis=2)
            low, high = placed[:, :, 0], placed[:, :, -1]
            distinct = 1 + (np.diff(placed, axis=2) > 0).sum(axis=2)
            front = np.zeros(low.shape, bool)
            if len(self._hits):
                post, group = self._hits.T
                at = layers[:, group]
                between = self._summed((at > low[:, post]) & (at < high[:, post]))
                below, above = self._summed(at < low[:, post]), self._summed(at > high[:, post])
                ground = self._ground[self._hit_posts]
                clashes = clashes + between.sum(axis=1) + np.where(ground, np.minimum(below, above), 0).sum(axis=1)
                front[:, self._hit_posts] = ground & (above < below)
            ends = top[:, None] + 1
            start = np.where(self._ground & ~front, -1, low)
            end = np.where(front, ends, high)
            spans = np.where(self._ground, end - start - 1, np.maximum(0, high - low - distinct + 1))
            extra = extra + self.front * front.sum(axis=1) + self.span * spans.sum(axis=1)
            i, j = self._near.T
            clashes = clashes + (np.minimum(end[:, i], end[:, j]) - np.maximum(start[:, i], start[:, j]) > 1).sum(axis=1)
        return self.clash * clashes + extra

    def _summed(self, flags: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Numbers of true flags (T, hits) for each post that has any."""
        return np.add.reduceat(flags, self._starts, axis=1, dtype=np.int64)


def improve(costs: Costs, layers: Sequence[int]) -> list[int]:
    """Local moves until none helps, the best of some hundred at a time: another layer, a new one between two, a swap."""
    current = _packed(np.array([layers], np.int16))
    cost = float(costs(current)[0])
    start = 0
    while True:
        moved = False
        chunks = list(_chunks(current[0]))
        for k in range(len(chunks)):  # on from where the last step was found: what is behind it has been tried
            chunk = (start + k) % len(chunks)
            trials = _packed(_applied(current[0], chunks[chunk]))
            found = costs(trials)
            best = int(np.argmin(found))
            if found[best] < cost - 1e-9:
                current, cost, start, moved = trials[best : best + 1], float(found[best]), chunk, True
                break
        if not moved:
            return [int(layer) for layer in current[0]]


def _chunks(layers: Layers) -> Iterator[NDArray[np.int64]]:
    """Moves (m, 3), some hundred at a time: kind, group, and a layer or another group."""
    n, top = len(layers), int(layers.max())
    groups, levels = (a.reshape(-1) for a in np.meshgrid(np.arange(n), np.arange(top + 2), indexing="ij"))
    first, second = np.tril_indices(n, -1)
    kinds = [(np.zeros(1, int), np.zeros(1, int)), (groups, levels), (groups, levels), (first, second)]
    moves = np.concatenate([np.column_stack([np.full(len(a), kind), a, b]) for kind, (a, b) in enumerate(kinds)])
    for k in range(0, len(moves), CHUNK):
        yield moves[k : k + CHUNK]


def _applied(layers: Layers, moves: NDArray[np.int64]) -> Layers:
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


def _packed(layers: Layers) -> Layers:
    """The same orders without empty layers."""
    most = int(layers.max()) + 1
    used = np.zeros((len(layers), most), np.int16)
    np.put_along_axis(used, layers.astype(np.int64), 1, axis=1)
    return np.take_along_axis((np.cumsum(used, axis=1) - 1).astype(np.int16), layers.astype(np.int64), axis=1)
