"""The contour graph of a mechanism as a drawing: where its vertices, edges and loop numbers stand.

Vertices stand as far from each other as there are edges between them, as nearly as that can be had in the plane (stress
majorization, Gansner, Koren and North 2004); of several starts the layout with the fewest crossings. Where edges cross in all of
them, the vertices of a loop stand on a circle and every other one in the middle of its neighbours (Tutte 1963). The frame stands
at the bottom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.constructions.contour_graph import ContourGraph
from mechcore.motion.structure import ROMAN

STARTS, ROUNDS = 24, 120
"""Layouts that are tried, and steps of each."""
BEND = 0.22
"""How far edges between the same two vertices bend apart, in lengths of an edge."""
APART = 0.45
"""Least distance of loop numbers from each other, in lengths of an edge."""
CLEAR = 0.15
"""A vertex this near to another one or to an edge, in lengths of an edge, counts as lying on it."""
CURVE_POINTS = 15


@dataclass(frozen=True, eq=False)
class GraphLayout:
    """Places in lengths of an edge, about the middle: of ``vertices`` (n,), along ``edges`` (points,) each, of ``numbers`` of the
    loops (m,)."""

    vertices: Complex
    edges: tuple[Complex, ...]
    numbers: Complex


def loop_number(k: int) -> str:
    """I, II, III ... of the loop with the index k."""
    return ROMAN[k + 1] if k + 1 < len(ROMAN) else str(k + 1)


def layout(graph: ContourGraph) -> GraphLayout:
    """The drawing of a graph; the same for the same graph."""
    pairs = [edge.ends for edge in graph.edges]
    places = _spread(len(graph.links), pairs, [vertices for vertices, _ in graph.loops])
    curves: list[Complex] = []
    for k, (p, q) in enumerate(pairs):
        alike = [i for i, ends in enumerate(pairs) if set(ends) == {p, q}]
        aside = BEND * (alike.index(k) - 0.5 * (len(alike) - 1)) * (1.0 if p < q else -1.0)
        along = np.linspace(0.0, 1.0, CURVE_POINTS if aside else 2)
        curves.append(places[p] + (along + 4j * aside * along * (1.0 - along)) * (places[q] - places[p]))
    numbers = np.array([_middle([curves[e] for e in edges]) for _, edges in graph.loops], complex)
    for _ in range(60):  # loops within each other: their numbers side by side
        for a, b in combinations(range(len(numbers)), 2):
            gap = numbers[b] - numbers[a]
            if abs(gap) < APART:
                push = 0.5 * (APART - abs(gap)) * (gap / abs(gap) if abs(gap) > 1e-9 else 1.0)
                numbers[a] -= push
                numbers[b] += push
    return GraphLayout(places, tuple(curves), numbers)


def _middle(curves: Sequence[Complex]) -> complex:
    return complex(np.mean([z[1:-1].mean() if len(z) > 2 else z.mean() for z in curves]))


def _spread(count: int, pairs: Sequence[tuple[int, int]], loops: Sequence[Sequence[int]]) -> Complex:
    """Places (n,) of vertices, about their middle, the first one at the bottom."""
    far = _distances(count, pairs)
    random = np.random.default_rng(1)
    best, least = np.zeros(count, complex), (np.inf, np.inf)
    for start in range(STARTS if count > 3 else 1):
        order = np.arange(count) if not start else random.permutation(count)
        z = _majorized(np.exp(2j * np.pi * np.argsort(order) / count) * count / (2.0 * np.pi), far)
        cost = (float(_crossings(z, pairs)), _stress(z, far))
        if cost[0] < least[0] or (cost[0] == least[0] and cost[1] < least[1] - 1e-6):
            best, least = z, cost
    for loop in loops if least[0] else ():
        z = _around(count, pairs, loop)
        if _crossings(z, pairs) < least[0]:
            best, least = z, (float(_crossings(z, pairs)), 0.0)
    best = best - best.mean()
    return np.asarray(best * np.exp(-1j * (np.angle(best[0]) + 0.5 * np.pi)) if abs(best[0]) > 1e-9 else best)


def _around(count: int, pairs: Sequence[tuple[int, int]], loop: Sequence[int]) -> Complex:
    """Places (n,) with the vertices of a loop on a circle and every other one in the middle of its neighbours."""
    z = np.zeros(count, complex)
    z[list(loop)] = 0.3 * count * np.exp(2j * np.pi * np.arange(len(loop)) / len(loop))
    inner = [k for k in range(count) if k not in loop]
    laplacian = np.zeros((count, count))
    for p, q in {(min(e), max(e)) for e in pairs}:
        laplacian[[p, q], [p, q]] += 1.0
        laplacian[[p, q], [q, p]] -= 1.0
    if inner:
        z[inner] = np.linalg.solve(laplacian[np.ix_(inner, inner)], -laplacian[np.ix_(inner, list(loop))] @ z[list(loop)])
    return z


def _distances(count: int, pairs: Sequence[tuple[int, int]]) -> Real:
    """Edges (n, n) on the shortest path between any two vertices (Floyd and Warshall)."""
    far = np.full((count, count), float(count))
    np.fill_diagonal(far, 0.0)
    for p, q in pairs:
        if p != q:
            far[p, q] = far[q, p] = 1.0
    for k in range(count):
        far = np.minimum(far, far[:, k : k + 1] + far[k])
    return far


def _majorized(z: Complex, far: Real) -> Complex:
    """Places moved to less stress, sum of ((distance - wanted) / wanted)^2."""
    count = len(z)
    if count < 2:
        return z
    weights = np.divide(1.0, far * far, out=np.zeros_like(far), where=far > 0.0)
    laplacian = np.diag(weights.sum(axis=1)) - weights + np.ones((count, count)) / count
    inverse = np.linalg.inv(laplacian)
    for _ in range(ROUNDS):
        apart = np.abs(z[:, None] - z)
        ratio = np.divide(weights * far, apart, out=np.zeros_like(far), where=apart > 1e-12)
        z = inverse @ (ratio.sum(axis=1) * z - ratio @ z)
        z = z - z.mean()
    return np.asarray(z)


def _stress(z: Complex, far: Real) -> float:
    some = far > 0.0
    return float((((np.abs(z[:, None] - z) - far)[some] / far[some]) ** 2).sum())


def _crossings(z: Complex, pairs: Sequence[tuple[int, int]]) -> int:
    """Pairs of edges without a common end that cross, and vertices on others or on edges that are not theirs."""
    apart = np.abs(z[:, None] - z) + len(z) * np.eye(len(z))
    count = int((apart < CLEAR).sum()) // 2
    for p, q in pairs:
        along = z[q] - z[p]
        for k in set(range(len(z))) - {p, q} if abs(along) > CLEAR else ():
            part = ((z[k] - z[p]) / along).real
            count += int(abs(z[p] + np.clip(part, 0.0, 1.0) * along - z[k]) < CLEAR)
    for (a, b), (c, d) in combinations({(min(e), max(e)) for e in pairs}, 2):
        if {a, b} & {c, d}:
            continue
        sides = [((z[q] - z[p]).conjugate() * (z[r] - z[p])).imag for p, q, r in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))]
        count += int(sides[0] * sides[1] < 0.0 and sides[2] * sides[3] < 0.0)
    return count
