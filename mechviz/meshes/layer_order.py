"""Assignment of groups of parts to layers: graph colouring with pins that pass through layers.

Groups that meet during the motion need different layers. A pin (or any other part that extends from one layer to
another) must not be hit by groups on the layers between. The search is deterministic: several greedy starts, each
improved by local moves. All starts and all moves of a step are evaluated in one array.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Flags, Integers, Real
from mechcore.records import dataclass

_CLASH_COST = 1000.0
_FRONT_COST = 12.0  # of a pedestal in front of all layers, which hides the view: more than one layer, less than a clash
_HEIGHT_COST = 8.0  # of a layer
_SPAN_COST = 3.0  # of each layer by which a pin is longer than necessary
COST_WEIGHTS = (_CLASH_COST, _FRONT_COST, _HEIGHT_COST, _SPAN_COST)
_MANY_GROUPS = 24  # groups above which the moves of a step are tried in portions
_FEW_GROUPS = 12  # groups up to which each step is the best move, not the first improvement
_LEAST_GAIN = 1e-9  # least reduction of costs that counts as an improvement


@dataclass(frozen=True)
class Post:
    """A part that extends through layers: a pin of two or more groups, or of a group and the ground.

    ``hits``: the groups that would run into it; ``near``: the other posts that come too close to pass through the same layer.
    """

    groups: tuple[int, ...]
    ground: bool = False
    hits: int = 0  # bit mask of groups
    near: tuple[int, ...] = ()


@dataclass(frozen=True)
class LayerOrder:
    """Layer of every group, counted from the back; for every post whether it extends to the front instead of the back."""

    layers: tuple[int, ...]
    front: tuple[bool, ...]
    clashes: int


def order_layers(conflicts: Sequence[int], posts: Sequence[Post], behind: Mapping[int, float] = MappingProxyType({})) -> LayerOrder:
    """The best order found: fewest clashes first, then few pedestals in front, few layers and short pins.

    ``conflicts[i]``: bit mask of the groups that must not share a layer with group i; ``behind``: groups that should be at the
    back, where they hide less, with their cost per layer from the back.
    """
    n = len(conflicts)
    if n == 0:
        return LayerOrder((), tuple(False for _ in posts), 0)
    costs = Costs(conflicts, posts, behind, COST_WEIGHTS)
    layers = np.zeros((1, 1), np.int16) if n == 1 else _best_order(costs, conflicts, posts)
    best = layers[[int(np.argmin(costs(layers)))]]
    clashes, _, front = costs.counted(best)
    return LayerOrder(tuple(best[0].tolist()), tuple(front[:, 0].tolist()), int(clashes[0]))


def _best_order(costs: Costs, conflicts: Sequence[int], posts: Sequence[Post]) -> Layers:
    """Locally optimal orders (S, n), from different starts."""
    n = len(conflicts)
    rng = random.Random(0)
    starts = 14 if n <= _FEW_GROUPS else 5 if n <= 20 else 3 if n <= _MANY_GROUPS else 2
    ranks = [natural_ranks(conflicts, posts), *(rng.sample(range(n), n) for _ in range(starts - 1))]
    layers = without_empty_layers(greedy(costs, np.array(ranks)))
    return improve(costs, layers) if n <= _MANY_GROUPS else improve_many(costs, layers)


def natural_ranks(conflicts: Sequence[int], posts: Sequence[Post]) -> list[int]:
    """Groups in the order of their distance from the ground, as a person would stack them."""
    n = len(conflicts)
    distance = {g: 0 for post in posts if post.ground for g in post.groups}
    while True:
        grown = dict(distance)
        for post in posts:
            known = [distance[g] for g in post.groups if g in distance]
            for g in post.groups:
                if known and g not in grown:
                    grown[g] = min(known) + 1
        if len(grown) == len(distance):
            break
        distance = grown
    return sorted(range(n), key=lambda g: (distance.get(g, n), -conflicts[g].bit_count(), g))


def greedy(costs: Costs, ranks: Integers) -> Layers:
    """Orders (S, n) in which groups are placed one by one, in sequences ``ranks`` (S, n), each on the layer of least cost so
    far."""
    count, n = ranks.shape
    layers = np.full((count, n), -1, np.int16)
    row = np.arange(count)
    for group in ranks.T:
        # common to all orders: for some, several layers above their top, of which the first costs least
        levels = np.arange(int(layers.max()) + 2, dtype=np.int16)
        trials = np.repeat(layers[:, None], len(levels), axis=1)
        trials[row, :, group] = levels
        prices = costs(trials.reshape(-1, n), partial=True).reshape(count, -1)
        layers[row, group] = prices.argmin(axis=1)
    return layers


def improve(costs: Costs, layers: Layers) -> Layers:
    """Packed orders (S, n) after improving moves, until there is none: another layer, a new layer between two, a swap, reversal.

    Orders that become equal are merged: the result may have fewer rows, each in the position of its first start.
    """
    n = layers.shape[1]
    current = _distinct(layers)
    cost = costs(current)
    open_ = np.ones(len(current), bool)
    while open_.any():
        which = np.flatnonzero(open_)
        trials = without_empty_layers(_moved(current[which]).reshape(-1, n)).reshape(len(which), -1, n)
        prices = costs(trials.reshape(-1, n)).reshape(len(which), -1)
        # few groups: the best move; many groups: the first improvement
        step = prices.argmin(axis=1) if n <= _FEW_GROUPS else (prices < cost[which, None] - _LEAST_GAIN).argmax(axis=1)
        row = np.arange(len(which))
        helps = prices[row, step] < cost[which] - _LEAST_GAIN
        current[which[helps]], cost[which[helps]] = trials[row[helps], step[helps]], prices[row[helps], step[helps]]
        open_[which[~helps]] = False
        _, first = np.unique(current, axis=0, return_index=True)
        first.sort()
        current, cost, open_ = current[first], cost[first], open_[first]
    return current


def _distinct(layers: Layers) -> Layers:
    """Distinct rows, in the order of their first occurrence."""
    return layers[np.sort(np.unique(layers, axis=0, return_index=True)[1])]


def _moved(layers: Layers) -> Layers:
    """All orders (S, m, n) one move away from each of the orders (S, n), not packed."""
    count, n = layers.shape
    tops = layers.max(axis=1)
    levels = np.arange(int(tops.max()) + 2, dtype=np.int16)  # layers far above an order's top are removed by packing
    placed = np.empty((count, n, len(levels), 2, n), np.int16)  # by group, level, and whether the level is new
    placed[:, :, :, 0] = layers[:, None, None]
    placed[:, :, :, 1] = (layers[:, None] + (layers[:, None] >= levels[:, None]))[:, None]
    group = np.arange(n)
    placed[:, group, :, :, group] = levels[:, None]
    first, second = np.tril_indices(n, -1)
    swapped = np.repeat(layers[:, None], len(first), axis=1)
    joint = np.arange(len(first))
    swapped[:, joint, first], swapped[:, joint, second] = layers[:, second], layers[:, first]
    over = (tops[:, None] - layers)[:, None]
    return np.concatenate([over, placed.reshape(count, -1, n), swapped], axis=1)


Layers = NDArray[np.int16]


class Costs:
    """Computes the costs (T,) of orders (T, n): weighted sums of clashes, pedestals in front, height, and spans of pins."""

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
        # index of the first hit of each post, for sums over its hits
        self._hit_posts, self._starts = np.unique(self._hits[0], return_index=True)
        self._near = np.array([(i, j) for i, post in enumerate(posts) for j in post.near if j < i], np.intp).reshape(-1, 2).T
        self._behind = np.array(list(behind), np.intp), np.array(list(behind.values()), float)

    def __call__(self, layers: Layers, *, partial: bool = False) -> Real:
        clashes, extra, _ = self.counted(layers, partial=partial)
        return self.clash * clashes + extra

    def counted(self, layers: Layers, *, partial: bool = False) -> tuple[Integers, Real, Flags]:
        """Clashes (T,), all other costs (T,), and flags of posts that extend to the front (posts, T).

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
        between = high - low  # layers passed by a pin without ground, less those of its own groups
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
        """Number of groups that run into posts (T,), and flags of the posts (with any hits) that extend to the front, because fewer
        groups hit them there."""
        post, group = self._hits
        layer, least, most = at[group], low[post], high[post]
        if partial:  # groups that are not placed count as on the post's own end layer, where they do not hit
            layer = np.where(layer < 0, least, layer)
        behind, before = self._summed(layer < least), self._summed(layer > most)
        between = self._summed((layer > least) & (layer < most))
        ground = self._ground[self._hit_posts]
        hits = (between + np.where(ground, np.minimum(behind, before), 0)).sum(axis=0)
        return hits, ground & (before < behind)

    def _summed(self, flags: Flags) -> Integers:
        """Numbers (posts, T) of true flags (hits, T) for each post with hits."""
        return np.add.reduceat(flags, self._starts, axis=0, dtype=np.int64)


def without_empty_layers(layers: Layers) -> Layers:
    """The same orders (T, n) without empty layers."""
    most = int(layers.max()) + 1
    used = np.zeros((len(layers), most), np.int16)
    wide = layers.astype(np.intp)
    np.put_along_axis(used, wide, 1, axis=1)
    return np.take_along_axis(np.cumsum(used, axis=1, dtype=np.int16) - np.int16(1), wide, axis=1)


ORDERS_AT_ONCE = 512  # number of orders evaluated at once: small enough for the CPU cache


def improve_many(costs: Costs, layers: Layers) -> Layers:
    """Packed orders (S, n) after improving moves, until there is none; each move is the best of `ORDERS_AT_ONCE`."""
    return np.stack([_improved(costs, order) for order in layers])


def _improved(costs: Costs, order: Layers) -> Layers:
    """One order (n,) after improving moves: reversal, another layer, a new layer between two, a swap, until there is none."""
    current = without_empty_layers(order[None])
    cost = float(costs(current)[0])
    start = 0
    while True:
        moved = False
        chunks = list(_chunks(current[0]))
        for k in range(len(chunks)):  # continue where the last improvement was found: earlier moves have been tried
            chunk = (start + k) % len(chunks)
            trials = without_empty_layers(_applied(current[0], chunks[chunk]))
            prices = costs(trials)
            best = int(np.argmin(prices))
            if prices[best] < cost - _LEAST_GAIN:
                current, cost, start, moved = trials[best : best + 1], float(prices[best]), chunk, True
                break
        if not moved:
            return np.asarray(current[0])


def _chunks(layers: Layers) -> Iterator[Integers]:
    """Moves (m, 3) in portions of `ORDERS_AT_ONCE`: kind, group, and a layer or another group."""
    n, top = len(layers), int(layers.max())
    groups, levels = (a.reshape(-1) for a in np.meshgrid(np.arange(n), np.arange(top + 2), indexing="ij"))
    first, second = np.tril_indices(n, -1)
    kinds = [(np.zeros(1, int), np.zeros(1, int)), (groups, levels), (groups, levels), (first, second)]
    moves = np.concatenate([np.column_stack([np.full(len(a), kind), a, b]) for kind, (a, b) in enumerate(kinds)])
    for k in range(0, len(moves), ORDERS_AT_ONCE):
        yield moves[k : k + ORDERS_AT_ONCE]


def _applied(layers: Layers, moves: Integers) -> Layers:
    """The orders (m, n) that result from moves (m, 3)."""
    out = np.repeat(layers[None], len(moves), axis=0)
    row = np.arange(len(moves))
    kind, group, other = moves.T
    out[kind == 0] = layers.max() - layers  # reversal
    out[row[kind == 1], group[kind == 1]] = other[kind == 1]
    shift = kind == 2  # a new layer for the group alone
    out[shift] += out[shift] >= other[shift, None]
    out[row[shift], group[shift]] = other[shift]
    swap = kind == 3
    out[row[swap], group[swap]], out[row[swap], other[swap]] = layers[other[swap]], layers[group[swap]]
    return out
