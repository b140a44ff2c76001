"""Which layer every group of parts lies on: graph colouring with pins that pass through.

Groups that meet during the motion need different layers. A pin (or any other part that reaches from one layer to
another) must not be hit by groups on the layers between. The search is deterministic: several greedy starts, each
improved by local moves. All starts and all moves of a step are looked at in one array.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from mechcore.arrays import Integers
from mechviz.meshes.layers.costs import Costs, Layers, improve_many, packed

_CLASH = 1000.0
_FRONT = 12.0  # a pedestal in front of everything hides the view: worth one more layer, but no clash
_HEIGHT = 8.0
_SPAN = 3.0  # a pin that is one layer longer than it needs to be
WEIGHTS = (_CLASH, _FRONT, _HEIGHT, _SPAN)
_MANY = 24  # groups above which the moves of a step are tried in portions
_FEW = 12  # groups up to which each step is the best one there is, not the first one down
_LESS = 1e-9  # what is not cheaper by this is not cheaper


@dataclass(frozen=True)
class Post:
    """Something that reaches through layers: a pin of two or more groups, or of a group and the ground.

    `hits` are the groups that would run into it, `near` the other posts that come too close to pass a layer beside it.
    """

    groups: tuple[int, ...]
    ground: bool = False
    hits: int = 0  # bit mask of groups
    near: tuple[int, ...] = ()


@dataclass(frozen=True)
class Order:
    """Layer of every group, counted from the back; for every post whether it reaches to the front, not the back."""

    layers: tuple[int, ...]
    front: tuple[bool, ...]
    clashes: int


def order_layers(conflicts: Sequence[int], posts: Sequence[Post], behind: Mapping[int, float] = MappingProxyType({})) -> Order:
    """The best order found: fewest clashes first, then few pedestals in front, few layers and short pins.

    `conflicts[i]` is the bit mask of the groups that must not share a layer with group i; `behind` names groups that would
    rather lie at the back, where they hide less, and what each layer further to the front costs.
    """
    n = len(conflicts)
    if n == 0:
        return Order((), tuple(False for _ in posts), 0)
    costs = Costs(conflicts, posts, behind, WEIGHTS)
    layers = np.zeros((1, 1), np.int16) if n == 1 else _found(costs, conflicts, posts)
    best = layers[[int(np.argmin(costs(layers)))]]
    clashes, _, front = costs.counted(best)
    return Order(tuple(best[0].tolist()), tuple(front[:, 0].tolist()), int(clashes[0]))


def _found(costs: Costs, conflicts: Sequence[int], posts: Sequence[Post]) -> Layers:
    """The orders (S, n) that no move makes cheaper, from one or another start."""
    n = len(conflicts)
    rng = random.Random(0)
    starts = 14 if n <= _FEW else 5 if n <= 20 else 3 if n <= _MANY else 2
    ranks = [natural_ranks(conflicts, posts), *(rng.sample(range(n), n) for _ in range(starts - 1))]
    layers = packed(greedy(costs, np.array(ranks)))
    return improve(costs, layers) if n <= _MANY else improve_many(costs, layers)


def natural_ranks(conflicts: Sequence[int], posts: Sequence[Post]) -> list[int]:
    """Groups outwards from the ground, as a person would stack them."""
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
    """Orders (S, n) in which groups came one by one, ranks (S, n), each to the layer that costs least so far."""
    count, n = ranks.shape
    layers = np.full((count, n), -1, np.int16)
    row = np.arange(count)
    for group in ranks.T:
        # for some more than one beyond their top: that costs more than the first of them
        levels = np.arange(int(layers.max()) + 2, dtype=np.int16)
        trials = np.repeat(layers[:, None], len(levels), axis=1)
        trials[row, :, group] = levels
        found = costs(trials.reshape(-1, n), partial=True).reshape(count, -1)
        layers[row, group] = found.argmin(axis=1)
    return layers


def improve(costs: Costs, layers: Layers) -> Layers:
    """Packed orders (S, n) after moves that help, until none does: another layer, a new layer between two, a swap, upside down.

    Orders that become the same stay one: fewer may come back, each at the place of its first start.
    """
    n = layers.shape[1]
    current = _distinct(layers)
    cost = costs(current)
    open_ = np.ones(len(current), bool)
    while open_.any():
        which = np.flatnonzero(open_)
        trials = packed(_moved(current[which]).reshape(-1, n)).reshape(len(which), -1, n)
        found = costs(trials.reshape(-1, n)).reshape(len(which), -1)
        # few groups: the best step; many groups: the first step down will do
        step = found.argmin(axis=1) if n <= _FEW else (found < cost[which, None] - _LESS).argmax(axis=1)
        row = np.arange(len(which))
        helps = found[row, step] < cost[which] - _LESS
        current[which[helps]], cost[which[helps]] = trials[row[helps], step[helps]], found[row[helps], step[helps]]
        open_[which[~helps]] = False
        _, first = np.unique(current, axis=0, return_index=True)
        first.sort()
        current, cost, open_ = current[first], cost[first], open_[first]
    return current


def _distinct(layers: Layers) -> Layers:
    """Rows without those that came before."""
    return layers[np.sort(np.unique(layers, axis=0, return_index=True)[1])]


def _moved(layers: Layers) -> Layers:
    """All orders one move away from each of some (S, n): (S, m, n), not packed."""
    count, n = layers.shape
    tops = layers.max(axis=1)
    levels = np.arange(int(tops.max()) + 2, dtype=np.int16)  # what lies beyond an order's own top is on it once packed
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
