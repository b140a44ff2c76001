"""Which layer every group of parts lies on: graph colouring with pins that pass through.

Groups that meet during the motion need different layers. A pin (or any other part that reaches from one layer to
another) must not be hit by groups on the layers between. The search is deterministic: several greedy starts, each
improved by local moves.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from .many_layers import Costs, improve

__all__ = ["Order", "Post", "order_layers"]

_CLASH = 1000.0
_FRONT = 12.0  # a pedestal in front of everything hides the view: worth one more layer, but no clash
_HEIGHT = 8.0
_SPAN = 3.0  # a pin that is one layer longer than it needs to be
_MANY = 24  # groups above which moves are tried many at a time


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
    search = _Search(conflicts, posts, behind)
    rng = random.Random(0)
    best: list[int] | None = None
    best_cost = float("inf")
    starts = 14 if n <= 12 else 5 if n <= 20 else 3 if n <= _MANY else 2
    for attempt in range(starts):
        ranks = search.natural_ranks() if attempt == 0 else rng.sample(range(n), n)
        layers = search.greedy(ranks)
        layers = search.improve(layers) if n <= _MANY else improve(search.costs, layers)
        cost = search.cost(layers)
        if cost < best_cost - 1e-9:
            best, best_cost = layers, cost
    assert best is not None
    return Order(tuple(best), search.sides(best), search.clashes(best))


class _Search:
    def __init__(self, conflicts: Sequence[int], posts: Sequence[Post], behind: Mapping[int, float]) -> None:
        self.n = len(conflicts)
        self.conflicts = conflicts
        self.posts = posts
        self.behind = behind
        self.costs = Costs(conflicts, posts, behind, (_CLASH, _FRONT, _HEIGHT, _SPAN))
        self.near = [(i, j) for i, post in enumerate(posts) for j in post.near if j < i]

    def natural_ranks(self) -> list[int]:
        """Groups outwards from the ground, as a person would stack them."""
        distance = {g: 0 for post in self.posts if post.ground for g in post.groups}
        while True:
            grown = dict(distance)
            for post in self.posts:
                known = [distance[g] for g in post.groups if g in distance]
                for g in post.groups:
                    if known and g not in grown:
                        grown[g] = min(known) + 1
            if len(grown) == len(distance):
                break
            distance = grown
        return sorted(range(self.n), key=lambda g: (distance.get(g, self.n), -self.conflicts[g].bit_count(), g))

    def greedy(self, ranks: Sequence[int]) -> list[int]:
        """Groups one by one on the layer that costs least so far."""
        layers = [-1] * self.n
        for g in ranks:
            top = max(layers) + 1
            costs = []
            for layer in range(top + 1):
                layers[g] = layer
                costs.append(self.cost(layers))
            layers[g] = costs.index(min(costs))
        return layers

    def improve(self, layers: list[int]) -> list[int]:
        """Local moves until none helps: another layer, a new layer between two, a swap, everything upside down."""
        current, cost = _packed(layers), self.cost(_packed(layers))
        while True:
            candidate, candidate_cost = None, cost
            for trial in self._moves(current):
                trial = _packed(trial)
                trial_cost = self.cost(trial, candidate_cost)
                if trial_cost < candidate_cost - 1e-9:
                    candidate, candidate_cost = trial, trial_cost
                    if self.n > 12:  # many groups: the first step down will do
                        break
            if candidate is None:
                return current
            current, cost = candidate, candidate_cost

    def _moves(self, layers: list[int]):
        top = max(layers)
        yield [top - layer for layer in layers]
        for g in range(self.n):
            for layer in range(top + 2):
                if layer != layers[g]:
                    yield [layer if k == g else old for k, old in enumerate(layers)]
                yield [layer if k == g else old + (old >= layer) for k, old in enumerate(layers)]
        for g in range(self.n):
            for h in range(g):
                if layers[g] != layers[h]:
                    trial = list(layers)
                    trial[g], trial[h] = trial[h], trial[g]
                    yield trial

    def cost(self, layers: Sequence[int], limit: float = float("inf")) -> float:
        """Cost of an order, or anything above `limit`; groups on layer -1 are not placed yet and cost nothing."""
        top = max(layers)
        masks = self._masks(layers, top)
        clashes = self._same_layer(layers, masks)
        extra = _HEIGHT * top + sum(cost * max(layers[g], 0) for g, cost in self.behind.items())
        spans = []
        for post in self.posts:
            if _CLASH * clashes + extra > limit:
                break
            placed = [layers[g] for g in post.groups if layers[g] >= 0]
            if not placed:
                spans.append((0, 0))
                continue
            low, high = min(placed), max(placed)
            hit, front = self._reach(post, low, high, masks, top)
            clashes += hit
            if post.ground:
                extra += _FRONT if front else 0.0
                low, high = (low, top + 1) if front else (-1, high)
                extra += _SPAN * (high - low - 1)
            else:
                extra += _SPAN * max(0, high - low - len(set(placed)) + 1)
            spans.append((low, high))
        else:
            clashes += self._posts_too_close(spans)
        return _CLASH * clashes + extra

    def clashes(self, layers: Sequence[int]) -> int:
        return int(self.cost(layers) // _CLASH)

    def sides(self, layers: Sequence[int]) -> tuple[bool, ...]:
        """Which grounded posts reach to the front."""
        top = max(layers)
        masks = self._masks(layers, top)
        result = []
        for post in self.posts:
            placed = [layers[g] for g in post.groups]
            result.append(bool(placed) and self._reach(post, min(placed), max(placed), masks, top)[1])
        return tuple(result)

    def _masks(self, layers: Sequence[int], top: int) -> list[int]:
        masks = [0] * (top + 1)
        for g, layer in enumerate(layers):
            if layer >= 0:
                masks[layer] |= 1 << g
        return masks

    def _same_layer(self, layers: Sequence[int], masks: list[int]) -> int:
        return sum((self.conflicts[g] & masks[layer]).bit_count() for g, layer in enumerate(layers) if layer >= 0) // 2

    def _reach(self, post: Post, low: int, high: int, masks: list[int], top: int) -> tuple[int, bool]:
        """Groups that a post runs into between its layers, and whether it reaches to the front to avoid more."""
        hits = post.hits
        if not hits:
            return 0, False
        hit = sum((mask & hits).bit_count() for mask in masks[low + 1 : high])
        if not post.ground:
            return hit, False
        behind = sum((mask & hits).bit_count() for mask in masks[:low])
        before = sum((mask & hits).bit_count() for mask in masks[high + 1 :])
        return hit + min(behind, before), before < behind

    def _posts_too_close(self, spans: Sequence[tuple[int, int]]) -> int:
        """Pairs of posts that come close to each other on a layer that both of them pass."""
        # A post fills the open interval between its ends; at the ends it lies inside its links, which are checked.
        return sum(min(spans[i][1], spans[j][1]) - max(spans[i][0], spans[j][0]) > 1 for i, j in self.near)


def _packed(layers: Sequence[int]) -> list[int]:
    """The same order without empty layers."""
    used = {layer: k for k, layer in enumerate(sorted(set(layers)))}
    return [used[layer] for layer in layers]
