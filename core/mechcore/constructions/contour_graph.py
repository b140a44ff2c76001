"""The contour graph of a mechanism: links are its vertices, joints its edges, independent loops (contours) its independent
cycles."""

from __future__ import annotations

from collections.abc import Sequence

from mechcore.kinematics.model import Model
from mechcore.motion.structure import loop_steps
from mechcore.records import dataclass


@dataclass(frozen=True)
class GraphEdge:
    """A joint between two vertices. ``higher``: it leaves two relative freedoms (class IV); ``driven``: a drive moves it."""

    joint: str
    ends: tuple[int, int]
    higher: bool
    driven: bool


@dataclass(frozen=True)
class ContourGraph:
    """``links`` by number, the frame first; ``edges``; ``loops``: vertices round each independent loop, from the one nearest to the
    frame, and the edges by number, the first from the first vertex to the second. There are as many as edges and one more than
    vertices leave over."""

    links: tuple[str, ...]
    edges: tuple[GraphEdge, ...]
    loops: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]


def contour_graph(model: Model) -> ContourGraph:
    """The contour graph of a mechanism: its vector loops in the order of their equations, then those that gears, cams, belts
    close."""
    bound = {r.name for r in model.relations}
    edges = [GraphEdge(j.name, ends, j.freedoms == 2 and j.name not in bound, k in model.driven)
             for k, (j, ends) in enumerate(zip(model.joints, model.ends, strict=True))]  # fmt: skip
    loops = []
    for loop in model.loops:
        steps = loop_steps(model, loop.closing)
        loops.append((tuple(p for _, p, _ in steps), tuple(j for j, _, _ in steps)))
    for relation in model.relations:
        if relation.name in model.joint_index:
            continue  # it rolls along a slot, which is an edge already
        p, q = (model.index[link] for link in relation.links)
        path = _shortest(edges, p, q)
        edges.append(GraphEdge(relation.name, (p, q), True, False))
        if path is not None:
            vertices, used = path
            loops.append((tuple(vertices), (*used, len(edges) - 1)))
    return ContourGraph(model.links, tuple(edges), tuple(loops))


def _shortest(edges: Sequence[GraphEdge], start: int, end: int) -> tuple[list[int], list[int]] | None:
    """Vertices and edges of a shortest path; None where there is none."""
    paths: dict[int, tuple[list[int], list[int]]] = {start: ([start], [])}
    fresh = [start]
    for vertex in fresh:  # grows while it is walked through
        for k, edge in enumerate(edges):
            if vertex in edge.ends:
                other = edge.ends[0] if edge.ends[1] == vertex else edge.ends[1]
                if other not in paths:
                    vertices, used = paths[vertex]
                    paths[other] = [*vertices, other], [*used, k]
                    fresh.append(other)
    return paths.get(end)
