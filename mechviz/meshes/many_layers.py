"""Local moves of mechanisms of many links: too many at a time for one array."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .layer_costs import Costs, Layers, packed

__all__ = ["improve_many"]

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
            return current[0]


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
