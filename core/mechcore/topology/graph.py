"""The graph of a mechanism: links are vertices, joints are edges.

From it follow the angles (links joined by joints that do not turn share one), a spanning tree rooted at the frame, and one
independent loop (closed vector polygon) for every joint that is not in the tree.

The choice of the tree limits how small the blocks of the loop equations can be. It is the minimum spanning tree with respect to the
order in which the joints' constraints are solved in absolute coordinates. By the cycle property of such trees no loop then contains
a joint that is solved later than the joint that closes it. The loops therefore split into the same groups, whatever the numbering.
"""

from __future__ import annotations

import heapq
from bisect import bisect_left
from collections.abc import Sequence
from operator import itemgetter

from mechcore.joints.base import LoopJoint
from mechcore.records import dataclass
from mechcore.topology.order import SolvingOrder, block_order

FRAME = 0  # number of the frame among the links, and of the class of links that do not turn among the rotation classes


@dataclass(frozen=True)
class Angles:
    """Groups of links whose relative angles are fixed or driven. Link k has the angle ``x[group[k]] + offset[k] + sum of sign *
    drive position``.

    Group 0 contains the frame and is known. ``rotation_class``: for each link the number of its rotation class, the set of links
    that turn at exactly the same speed (same group and same drives); ``class_group`` and ``class_drives``: group and drives of each
    class. ``edges``: joints that fix a relative angle and form a forest; ``redundant``: those that fix an angle already fixed.
    """

    group: tuple[int, ...]
    offset: tuple[float, ...]
    rotation_class: tuple[int, ...]
    class_group: tuple[int, ...]
    class_drives: tuple[tuple[tuple[int, int], ...], ...]  # (drive, sign)
    edges: tuple[int, ...]
    redundant: tuple[int, ...]
    groups: int
    classes_of: tuple[tuple[int, ...], ...]  # the rotation classes of each group
    links_of: tuple[tuple[int, ...], ...]  # the links of each group


@dataclass(frozen=True)
class Tree:
    """Spanning tree: for each link in ``order`` (parents first, frame left out) the joint to its parent."""

    order: tuple[int, ...]
    parent: tuple[int, ...]  # of each link; -1 for the frame
    joint: tuple[int, ...]  # of each link; -1 for the frame
    closing: tuple[int, ...]  # joints that close a loop


@dataclass(frozen=True)
class Loop:
    """One closed vector polygon. Its sum is ``point on the first link of the closing joint - point on the second``.

    ``links``: (link, coefficient in that link's frame [m]); ``slides``: (joint, guide's link, direction in its frame).
    """

    closing: int
    links: tuple[tuple[int, complex], ...]
    slides: tuple[tuple[int, int, complex], ...]


def angles(n: int, ends: Sequence[tuple[int, int]], joints: Sequence[LoopJoint], driven: dict[int, int]) -> Angles:
    """Groups of the links whose relative angle is fixed or driven. ``driven``: joint -> drive."""
    near: list[list[tuple[int, int, float, int]]] = [[] for _ in range(n)]  # joint, other link, offset, direction
    for j, (joint, (p, q)) in enumerate(zip(joints, ends, strict=True)):
        if not joint.turns or (j in driven and joint.coordinate == "angle"):
            near[p].append((j, q, joint.angle, 1))
            near[q].append((j, p, -joint.angle, -1))
    group, offset = [-1] * n, [0.0] * n
    drives: list[tuple[tuple[int, int], ...]] = [()] * n
    edges: list[int] = []
    redundant: list[int] = []
    seen: set[int] = set()
    groups = 0
    for root in range(n):
        if group[root] >= 0:
            continue
        group[root], stack = groups, [root]
        groups += 1
        while stack:
            p = stack.pop()
            for j, q, turn, sign in near[p]:
                if j in seen:
                    continue
                seen.add(j)
                if group[q] >= 0:
                    redundant.append(j)
                    continue
                edges.append(j)
                group[q], offset[q] = group[p], offset[p] + turn
                drives[q] = _turned(drives[p], driven[j], sign) if joints[j].turns else drives[p]
                stack.append(q)
    keys: dict[tuple[int, tuple[tuple[int, int], ...]], int] = {}
    members: list[list[int]] = [[] for _ in range(groups)]
    rotation_class = tuple(keys.setdefault((group[k], drives[k]), len(keys)) for k in range(n))
    for s, (g, _) in enumerate(keys):
        members[g].append(s)
    links: list[list[int]] = [[] for _ in range(groups)]
    for k, g in enumerate(group):
        links[g].append(k)
    return Angles(
        group=tuple(group),
        offset=tuple(offset),
        rotation_class=rotation_class,
        class_group=tuple(g for g, _ in keys),
        class_drives=tuple(d for _, d in keys),
        edges=tuple(edges),
        redundant=tuple(redundant),
        groups=groups,
        classes_of=tuple(map(tuple, members)),
        links_of=tuple(map(tuple, links)),
    )


def _turned(drives: tuple[tuple[int, int], ...], drive: int, sign: int) -> tuple[tuple[int, int], ...]:
    """``drives`` (drive, sign), sorted by drive, with ``sign`` added to that of one drive; those with sum 0 are dropped."""
    at = bisect_left(drives, drive, key=itemgetter(0))
    there = at < len(drives) and drives[at][0] == drive
    total = sign + (drives[at][1] if there else 0)
    return (*drives[:at], *([(drive, total)] if total else []), *drives[at + there :])


def structure(
    n: int, ends: Sequence[tuple[int, int]], joints: Sequence[LoopJoint], driven: dict[int, int]
) -> tuple[SolvingOrder, tuple[tuple[int, ...], ...]]:
    """Block order of the constraints in absolute coordinates (x, y, angle of every moving link), and the numbers of the equations
    of each joint."""
    pattern: list[list[int]] = []
    of_joint: list[tuple[int, ...]] = []
    for j, (joint, (p, q)) in enumerate(zip(joints, ends, strict=True)):
        turned = [3 * (k - 1) + 2 for k in (p, q) if k]
        placed = [3 * (k - 1) + c for k in (p, q) if k for c in range(3)]
        rows = [placed] * (2 if joint.slide is None or j in driven else 1)
        if not joint.turns or (j in driven and joint.coordinate == "angle"):
            rows = [*rows, turned]
        of_joint.append(tuple(range(len(pattern), len(pattern) + len(rows))))
        pattern += rows
    return block_order(pattern, 3 * (n - 1)), tuple(of_joint)


def spanning_tree(n: int, ends: Sequence[tuple[int, int]], order: SolvingOrder, equations: Sequence[tuple[int, ...]]) -> Tree:
    """Minimum spanning tree from the frame (Prim); equal weights are resolved in favour of short paths to the frame."""
    rank: dict[int, int] = {e: k for k, (block, _) in enumerate(order.blocks) for e in block}
    last = len(order.blocks)
    weight = [max(rank.get(e, last) for e in eqs) for eqs in equations]
    near: list[list[tuple[int, int]]] = [[] for _ in range(n)]
    for j, (p, q) in enumerate(ends):
        near[p].append((j, q))
        near[q].append((j, p))
    parent, joint, depth = [-1] * n, [-1] * n, [0] * n
    reached = [False] * n
    outwards: list[int] = []
    heap: list[tuple[int, int, int, int, int]] = [(-1, 0, -1, 0, -1)]
    while heap:
        _, d, j, k, p = heapq.heappop(heap)
        if reached[k]:
            continue
        reached[k], parent[k], joint[k], depth[k] = True, p, j, d
        if j >= 0:
            outwards.append(k)
        for j2, q in near[k]:
            if not reached[q]:
                heapq.heappush(heap, (weight[j2], d + 1, j2, q, k))
    used = set(joint)
    closing = tuple(j for j in range(len(ends)) if j not in used)
    return Tree(order=tuple(outwards), parent=tuple(parent), joint=tuple(joint), closing=closing)


LinkVectors = dict[int, complex]  # link -> vector in its axes
LoopSlides = list[tuple[int, int, complex]]  # (joint, link with the guide, its direction)


def vector_loops(ends: Sequence[tuple[int, int]], joints: Sequence[LoopJoint], tree: Tree) -> tuple[Loop, ...]:
    """One loop for each closing joint; coefficients of a link that enters twice are added."""
    depth = [0] * len(tree.parent)
    for k in tree.order:
        depth[k] = depth[tree.parent[k]] + 1
    out = []
    for c in tree.closing:
        p, q = ends[c]
        vectors: LinkVectors = {}
        slides: LoopSlides = []

        def add(j: int, link: int, side: int, sign: int, vectors: LinkVectors = vectors, slides: LoopSlides = slides) -> None:
            """``sign`` times the vector from the origin of ``link`` to its point of joint ``j``, the slide included."""
            joint = joints[j]
            vectors[link] = vectors.get(link, 0j) + sign * (joint.b if side else joint.a)
            if joint.slide is not None and joint.guide == side:
                slides.append((j, link, sign * joint.slide))

        add(c, p, 0, 1)
        add(c, q, 1, -1)
        up, down = p, q
        while up != down:  # climb the deeper side until both meet: above, both sides cancel
            side_is_up = depth[up] >= depth[down]
            k = up if side_is_up else down
            j, parent, sign = tree.joint[k], tree.parent[k], (1 if side_is_up else -1)
            child_side = 1 if ends[j][1] == k else 0
            add(j, k, child_side, -sign)  # back from the child's point to its origin
            add(j, parent, 1 - child_side, sign)  # forth from the parent's origin to the joint
            if side_is_up:
                up = parent
            else:
                down = parent
        out.append(Loop(closing=c, links=tuple(sorted(vectors.items())), slides=tuple(slides)))
    return tuple(out)


def leaves_first(ends: Sequence[tuple[int, int]], edges: Sequence[int]) -> tuple[tuple[int, int, int, bool], ...]:
    """The joints of a forest in order from the leaves to the frame: (joint, link, other link, whether the link is the joint's
    second).

    In this order the imbalance at a link can be passed on through its joint after all contributions from links beyond have arrived.
    """
    near: dict[int, list[int]] = {}
    for j in edges:
        for k in ends[j]:
            near.setdefault(k, []).append(j)
    degree = {k: len(js) for k, js in near.items()}
    done: set[int] = set()
    order = []
    leaves = [k for k, d in degree.items() if d == 1 and k != 0]
    while leaves:
        k = leaves.pop()
        left = [i for i in near[k] if i not in done]
        if not left:
            continue
        j = left[0]
        done.add(j)
        other = ends[j][0] if ends[j][1] == k else ends[j][1]
        order.append((j, k, other, ends[j][1] == k))
        degree[other] -= 1
        degree[k] -= 1
        if degree[other] == 1 and other != 0:
            leaves.append(other)
    return tuple(order)
