"""Block order: which unknowns must be solved together, and in which order the blocks can be solved.

A system of equations is given only by its pattern: which unknowns each equation contains. Matching every equation to an
unknown of its own (Dulmage-Mendelsohn) separates the determined, over-determined and under-determined parts. The strongly connected
components of the matched graph are the smallest sets that must be solved together. For the equations of a mechanism they are the
Assur groups of the textbooks, in the order of the hand method.
"""

from __future__ import annotations

from collections.abc import Sequence

from mechcore.records import dataclass


@dataclass(frozen=True)
class SolvingOrder:
    """The blocks of a system of equations in solving order.

    ``blocks``: (equations, unknowns), each dependent on earlier ones only. ``redundant``: equations without an unknown of their own
    (redundant constraints). ``free``: unknowns without an equation of their own (undriven degrees of freedom). ``unmatched``: all
    unknowns that are therefore undetermined (the under-determined part).
    """

    blocks: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]
    redundant: tuple[int, ...]
    free: tuple[int, ...]
    unmatched: frozenset[int]


def block_order(pattern: Sequence[Sequence[int]], unknowns: int) -> SolvingOrder:
    """The solving order of a system with this ``pattern``: for each equation the unknowns in it."""
    rows = len(pattern)
    match = maximum_matching(pattern, unknowns)
    owner = [-1] * unknowns  # unknown -> its equation
    for e, u in enumerate(match):
        if u >= 0:
            owner[u] = e
    redundant = tuple(e for e in range(rows) if match[e] < 0)
    free = tuple(u for u in range(unknowns) if owner[u] < 0)

    appears: list[list[int]] = [[] for _ in range(unknowns)]
    for e, p in enumerate(pattern):
        for u in p:
            appears[u].append(e)
    unmatched, stack = set(free), list(free)
    while stack:  # an unknown that an alternating path reaches from a free one is not determined either
        for e in appears[stack.pop()]:
            u = match[e]
            if u >= 0 and u not in unmatched:
                unmatched.add(u)
                stack.append(u)

    # equation e depends on the equations that own its other unknowns
    needs = [[owner[u] for u in p if owner[u] >= 0 and owner[u] != e] if match[e] >= 0 else [] for e, p in enumerate(pattern)]
    blocks = tuple((tuple(sorted(c)), tuple(sorted(match[e] for e in c))) for c in _components(needs) if match[c[0]] >= 0)
    return SolvingOrder(blocks=blocks, redundant=redundant, free=free, unmatched=frozenset(unmatched))


def maximum_matching(pattern: Sequence[Sequence[int]], unknowns: int) -> list[int]:
    """Maximum matching: for each equation an unknown of its own, or -1; as many equations as possible are matched.

    Hopcroft & Karp, An n^(5/2) algorithm for maximum matchings in bipartite graphs (1973): each round augments along a maximal
    set of disjoint shortest alternating paths.
    """
    match, owner = [-1] * len(pattern), [-1] * unknowns
    while True:
        level = [0 if u < 0 else -1 for u in match]  # steps of an alternating path from an unmatched equation
        layer, reached = [e for e, u in enumerate(match) if u < 0], False
        while layer and not reached:
            following = []
            for e in layer:
                for u in pattern[e]:
                    next_equation = owner[u]
                    if next_equation < 0:
                        reached = True
                    elif level[next_equation] < 0:
                        level[next_equation] = level[e] + 1
                        following.append(next_equation)
            layer = following
        if not reached:
            return match
        untried = [iter(unknowns_of) for unknowns_of in pattern]
        for root in [e for e, u in enumerate(match) if u < 0]:
            path: list[tuple[int, int]] = []  # equations, each with the unknown that leads to the next
            e = root
            while True:
                u = next(untried[e], -1)
                if u < 0:  # a dead end
                    if not path:
                        break
                    e, _ = path.pop()
                elif owner[u] < 0:
                    for equation, unknown in (*path, (e, u)):
                        match[equation], owner[unknown] = unknown, equation
                    break
                elif level[owner[u]] == level[e] + 1:
                    path.append((e, u))
                    e = owner[u]


def _components(needs: Sequence[Sequence[int]]) -> list[list[int]]:
    """Strongly connected components, each after those that it depends on (Tarjan 1972, without recursion)."""
    n = len(needs)
    index, low, on = [-1] * n, [0] * n, [False] * n
    stack: list[int] = []
    components: list[list[int]] = []
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
                    components.append(component)
    return components
