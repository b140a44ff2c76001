"""Block order: which unknowns belong together, and in which order the groups can be solved.

A system of equations is given only by its pattern: which unknowns each equation contains. Matching every equation to an
unknown of its own (Dulmage-Mendelsohn) shows what is determined, what is over- and what is under-determined; the strongly
connected components of the matched graph are the smallest sets that must be solved together. On the equations of a mechanism
they are the Assur groups of the textbooks, in the order of the hand method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Order:
    """``blocks``: (equations, unknowns) in an order in which each needs only earlier ones. ``spare``: equations that no unknown
    is left for (redundant constraints). ``free``: unknowns that no equation is left for (freedoms without a drive).
    ``loose``: all unknowns that cannot be found because of those (the under-determined part)."""

    blocks: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]
    spare: tuple[int, ...]
    free: tuple[int, ...]
    loose: frozenset[int]


def block_order(pattern: Sequence[Sequence[int]], unknowns: int) -> Order:
    """Pattern: for each equation the unknowns in it -> its blocks in solving order."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import maximum_bipartite_matching

    rows = len(pattern)
    match = np.full(rows, -1)
    if rows and unknowns:
        lengths = [len(p) for p in pattern]
        columns = np.fromiter((u for p in pattern for u in p), int, sum(lengths))
        pointer = np.concatenate([[0], np.cumsum(lengths)])
        graph = csr_array((np.ones(len(columns), np.int8), columns, pointer), shape=(rows, unknowns))
        match = maximum_bipartite_matching(graph, perm_type="column")  # equation -> its unknown or -1
    owner = np.full(unknowns, -1)  # unknown -> its equation
    for e, u in enumerate(match):
        if u >= 0:
            owner[u] = e
    spare = tuple(int(e) for e in range(rows) if match[e] < 0)
    free = tuple(int(u) for u in range(unknowns) if owner[u] < 0)

    appears: list[list[int]] = [[] for _ in range(unknowns)]
    for e, p in enumerate(pattern):
        for u in p:
            appears[u].append(e)
    loose, stack = set(free), list(free)
    while stack:  # whatever an alternating path reaches from a free unknown is not determined either
        for e in appears[stack.pop()]:
            u = int(match[e])
            if u >= 0 and u not in loose:
                loose.add(u)
                stack.append(u)

    # equation e depends on the equations that own its other unknowns
    needs = [[int(owner[u]) for u in p if owner[u] >= 0 and owner[u] != e] if match[e] >= 0 else [] for e, p in enumerate(pattern)]
    blocks = tuple((tuple(sorted(c)), tuple(sorted(int(match[e]) for e in c))) for c in _components(needs) if match[c[0]] >= 0)
    return Order(blocks=blocks, spare=spare, free=free, loose=frozenset(loose))


def _components(needs: Sequence[Sequence[int]]) -> list[list[int]]:
    """Strongly connected components, each after those that it needs (Tarjan 1972, without recursion)."""
    n = len(needs)
    index, low, on = [-1] * n, [0] * n, [False] * n
    stack: list[int] = []
    found: list[list[int]] = []
    count = 0
    for root in range(n):
        if index[root] >= 0:
            continue
        work = [(root, 0)]
        while work:
            v, k = work.pop()
            if k == 0:
                index[v] = low[v] = count
                count += 1
                stack.append(v)
                on[v] = True
            else:
                low[v] = min(low[v], low[needs[v][k - 1]])
            for j in range(k, len(needs[v])):
                w = needs[v][j]
                if index[w] < 0:
                    work += [(v, j + 1), (w, 0)]
                    break
                if on[w]:
                    low[v] = min(low[v], index[w])
            else:
                if low[v] == index[v]:
                    component = []
                    while True:
                        w = stack.pop()
                        on[w] = False
                        component.append(w)
                        if w == v:
                            break
                    found.append(component)
    return found
