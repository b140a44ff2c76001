"""Structure of a mechanism: mobility, structural groups (Assur), loops and their equations, derived from the model for display."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from heapq import heappop, heappush

import numpy as np

from mechcore.arrays import Real
from mechcore.constants import SINGULAR
from mechcore.joints.base import Relation
from mechcore.kinematics.model import Model
from mechcore.motion.at_once import JointEquations
from mechcore.motion.motion import Motion
from mechcore.records import dataclass

MOST_TOGETHER = 300  # connected links up to which the rank of their constraints is computed: its cost grows with the third power
ROMAN = ("", "I", "II", "III", "IV", "V", "VI", "VII", "VIII")


@dataclass(frozen=True)
class Group:
    """A structural group in solving order. ``kind``: the joint letters of a dyad such as RRR (outer, inner, outer)."""

    links: tuple[str, ...]
    joints: tuple[str, ...]
    assur_class: str  # "I" for a driven link, "II" for dyads, ...
    kind: str
    solved_by: str  # "drive", "closed form" or "Newton"

    def __str__(self) -> str:
        kind = f" {self.kind}" if self.kind else ""
        return f"class {self.assur_class}{kind}: {', '.join(self.links)} (joints {', '.join(self.joints)})"


def gruebler(model: Model) -> tuple[int, int, int, int]:
    """Planar mobility by Gruebler-Kutzbach: n moving links, p5 joints with one degree of freedom, p4 with two, mobility W.

    W = 3n - 2 p5 - p4, minus 3 for each weld.
    """
    rolling = {r.name for r in model.relations} & set(model.joint_index)  # a slot and a relation: one degree of freedom
    n = len(model.links) - 1
    p5 = sum(1 for j in model.joints if j.freedoms == 1) + len(rolling)
    p4 = sum(1 for j in model.joints if j.freedoms == 2) + len(model.relations) - 2 * len(rolling)
    welds = sum(1 for j in model.joints if j.freedoms == 0)
    return n, p5, p4, 3 * n - 2 * p5 - p4 - 3 * welds


def rank_mobility(motion: Motion, frame: int = 0, *, tolerance: float = 1e-9) -> int:
    """Actual mobility at a frame, without drives: 3n minus the numerical rank of the constraints of all joints.

    It differs from `gruebler` if constraints are redundant. The constraints are in absolute coordinates (x, y, angle of every link)
    with lengths in units of the mechanism's size; the rank comes from the singular values, part by part. A link attached by one
    joint only has the degrees of freedom of that joint and is counted without its constraints, so that long chains cost nothing.
    With parts larger than ``MOST_TOGETHER``, a regular, non-redundant mechanism has as many degrees of freedom as drives.
    """
    model = motion.model
    leaves = _leaf_links(model)
    freedoms = sum(model.joints[j].freedoms for j in leaves)
    kept = [k for k in range(1, len(model.links)) if k not in leaves.values()]
    rows: list[dict[int, float]] = []  # coefficients of a constraint by the numbers of coordinates, three of each link
    equations = JointEquations(motion, frame)
    for j in range(len(model.joints)):
        if j not in leaves:
            rows += equations.joint(j)
    rows += [equations.relation(constraint) for constraint in model.constraints]
    parts = _parts(rows, kept)
    large = max(map(len, parts.values()), default=0) > MOST_TOGETHER
    if large and not model.redundant and float(np.broadcast_to(motion.condition, motion.frames)[frame]) <= SINGULAR:
        return len(model.mechanism.drives)  # the drives determine every group: one degree of freedom for each
    values = [np.linalg.svd(matrix, compute_uv=False) for matrix in _matrices(rows, parts)]
    s = np.concatenate([np.zeros(0), *values])
    return freedoms + 3 * len(kept) - int((s > tolerance * s.max(initial=0.0)).sum())


def _parts(rows: Sequence[Mapping[int, float]], kept: Sequence[int]) -> dict[int, list[int]]:
    """Parts of the mechanism: links connected by constraints other than through the frame, by one link of each part."""
    first = {k: k for k in kept}

    def root(k: int) -> int:
        while first[k] != k:
            first[k] = k = first[first[k]]
        return k

    for row in rows:
        one, *others = {root(c // 3) for c in row if c // 3 in first} or {0}
        for other in others:
            first[other] = one
    parts: dict[int, list[int]] = {}
    for k in kept:
        parts.setdefault(root(k), []).append(k)
    return parts


def _matrices(rows: Sequence[Mapping[int, float]], parts: Mapping[int, Sequence[int]]) -> Iterator[Real]:
    """The matrix of the constraints of each part, by the coordinates of its links."""
    owner = {k: part for part, links in parts.items() for k in links}
    own: dict[int, list[Mapping[int, float]]] = {}
    for row in rows:
        part = next((owner[c // 3] for c in row if c // 3 in owner), None)
        if part is not None:
            own.setdefault(part, []).append(row)
    for part, constraints in own.items():
        column = {3 * k + i: 3 * n + i for n, k in enumerate(parts[part]) for i in range(3)}
        matrix = np.zeros((len(constraints), len(column)))
        for r, row in enumerate(constraints):
            for c, value in row.items():
                if c in column:
                    matrix[r, column[c]] = value
        yield matrix


def _leaf_links(model: Model) -> dict[int, int]:
    """Links attached by one joint only, once such links beyond them are removed: number of the joint -> link."""
    bound = {0} | {model.index[link] for r in model.relations for link, _ in (*r.angles, *(r.curve.angles if r.curve else ()))}
    slides = [j for t in model.constraints for j, _ in (*t.slides, *(t.curve.slides if t.curve else ()))]
    bound |= {k for j in slides for k in model.ends[j]}
    at: dict[int, set[int]] = {}
    for j, ends in enumerate(model.ends):
        for k in ends:
            at.setdefault(k, set()).add(j)
    leaves: dict[int, int] = {}
    fresh = [k for k, joints in at.items() if len(joints) == 1 and k not in bound]
    while fresh:
        k = fresh.pop()
        if len(at[k]) != 1:
            continue
        j = at[k].pop()
        leaves[j] = k
        (other,) = set(model.ends[j]) - {k}
        at[other].discard(j)
        if len(at[other]) == 1 and other not in bound:
            fresh.append(other)
    return leaves


def groups(model: Model) -> tuple[Group, ...]:
    """Structural groups in solving order: driven links first, then Assur groups.

    A group is a smallest set of n links with 3n constraints by joints among themselves and to links already solved.
    """
    last = len(model.order.blocks)
    rank = [0] * len(model.links)
    for k, (_, unknowns) in enumerate(model.order.blocks):
        for u in unknowns:
            rank[u // 3 + 1] = max(rank[u // 3 + 1], k)
    for u in model.order.free:
        rank[u // 3 + 1] = last
    constraints: list[tuple[tuple[int, ...], int]] = [
        (e, 3 - joint.freedoms + (j in model.driven)) for j, (joint, e) in enumerate(zip(model.joints, model.ends, strict=True))
    ]
    for r, t in zip(model.relations, model.constraints, strict=True):
        angles = r.angles if r.curve is None else (*r.angles, *r.curve.angles)
        slides = t.slides if t.curve is None else (*t.slides, *t.curve.slides)
        constraints.append((tuple(model.index[k] for k, _ in angles) + tuple(x for j, _ in slides for x in model.ends[j]), 1))
    at: dict[int, list[int]] = {}
    for i, (e, _) in enumerate(constraints):
        for k in set(e):
            at.setdefault(k, []).append(i)
    left = dict.fromkeys(sorted(range(1, len(model.links)), key=lambda k: rank[k]))
    place = {k: n for n, k in enumerate(left)}
    followed = {angle for b in model.blocks if b.kind == "general" for angle in b.angles}
    coupled = {link: "geared" if r.curve is None else "with a higher pair" for r in model.relations for link in r.links}
    solved, out = {0}, []
    links = [(n, k) for k, n in place.items()]  # heaps: candidates to check again because a neighbour has been solved
    pairs = [i for i, (e, _) in enumerate(constraints) if len(set(e)) == 2]

    def count(own: set[int]) -> int:
        near = {i for k in own for i in at.get(k, ())}
        return sum(constraints[i][1] for i in near if all(k in own or k in solved for k in constraints[i][0]))

    while left:
        own: set[int] = set()
        while links and not own:
            k = heappop(links)[1]
            if k not in solved and count({k}) >= 3:
                own = {k}
        while pairs and not own:
            pair = set(constraints[heappop(pairs)][0])
            if not pair & solved and count(pair) >= 6:
                own = pair
        if not own:
            for k in left:
                own.add(k)
                if count(own) >= 3 * len(own):
                    break
        members = sorted(own)
        solved |= own
        at_them = sorted({i for k in own for i in at.get(k, ()) if i < len(model.ends)})
        out.append(_group(model, members, followed, coupled, [j for j in at_them if set(model.ends[j]) <= solved]))
        for k in own:
            del left[k]
        for n in {n for k in own for i in at.get(k, ()) for n in constraints[i][0] if n not in solved}:
            heappush(links, (place[n], n))
            for i in at[n]:
                if len(set(constraints[i][0])) == 2:
                    heappush(pairs, i)
    return tuple(out)


def _group(model: Model, own: Sequence[int], followed: set[int], coupled: Mapping[str, str], joints: Sequence[int]) -> Group:
    inside = set(own)
    inner = [j for j in joints if set(model.ends[j]) <= inside]
    outer = [j for j in joints if j not in inner]
    names = tuple(model.links[k] for k in own)
    joint_names = tuple(model.joints[j].name for j in joints)
    general = any(model.angles.group[k] in followed for k in own)
    driven = any(j in model.driven for j in joints)
    if driven and len(own) == 1:
        return Group(names, joint_names, "I", "", "drive")
    if len(own) == 1:
        over = sum(3 - model.joints[j].freedoms for j in joints) > 3
        alone = "redundant" if over else "with a higher pair" if len(joints) > 1 else "fixed"
        how = coupled.get(names[0], alone)
        return Group(names, joint_names, "I", how, "closed form")
    kind = ""
    if len(own) == 2 and len(inner) == 1 and len(outer) == 2:
        first = next(j for j in outer if own[0] in model.ends[j])
        second = next(j for j in outer if j != first)
        kind = "".join(model.joints[j].kind[0].upper() for j in (first, inner[0], second))
        kind = max(kind, kind[::-1])  # RRP and PRR are one kind
    return Group(names, joint_names, _class_of(model, own, inner, joints), kind, "Newton" if general else "closed form")


def _class_of(model: Model, own: Sequence[int], inner: Sequence[int], joints: Sequence[int]) -> str:
    """Class after Assur and Artobolevsky: II for dyads, III if a link carries three joints, k for an inner loop of k links."""
    if len(own) <= 2:
        return "II" if len(own) == 2 else "I"
    near: dict[int, list[int]] = {k: [] for k in own}
    for j in inner:
        p, q = model.ends[j]
        near[p].append(q)
        near[q].append(p)
    longest = 0
    for j in inner:  # shortest inner loop through each joint
        p, q = model.ends[j]
        distance, queue = {p: 0}, [p]
        while queue:
            k = queue.pop(0)
            for other in near[k]:
                if {k, other} != {p, q} and other not in distance:
                    distance[other] = distance[k] + 1
                    queue.append(other)
        if q in distance:
            longest = max(longest, distance[q] + 1)
    most = max(sum(1 for j in joints if k in model.ends[j]) for k in own)
    number = max(longest, 3 if most >= 3 else 2)
    return ROMAN[number] if number < len(ROMAN) else str(number)


def loop_joints(model: Model) -> tuple[tuple[str, ...], ...]:
    """The names of the joints of each independent loop, in order round the loop, starting at the body nearest to the frame."""
    return tuple(tuple(model.joints[j].name for j, _, _ in loop_steps(model, loop.closing)) for loop in model.loops)


def redundant_joints(model: Model) -> tuple[str, ...]:
    """Names of the joints with redundant constraints: statics alone does not determine their reactions."""
    names = [model.joints[j].name for j in model.angles.redundant]
    names += [b.name for b in model.blocks if b.redundant]
    return tuple(dict.fromkeys(names))


def loop_equations(motion: Motion, frame: int = 0) -> list[str]:
    """Lines of text: the legend, then the velocity and acceleration equations of every loop, with numbers at a frame, and those of
    every gear, rack, belt, rolling or cam joint: the bodies have the same velocity along the line of contact.

    They follow the contour-graph method in the plane. Round a loop 0-1-...-n-0, with joint A_i between body i-1 and body i, r_i its
    position, w_ij = w_i - w_j::

        sum w_(i,i-1) = 0                                         sum e_(i,i-1) = 0
        sum ( y_i w_(i,i-1), -x_i w_(i,i-1)) + sum v_i = 0        the same with e and relative accelerations
                                                                  + sum a^c_i - sum w_i^2 (r_(i+1) - r_i) = 0
    """
    model = motion.model
    turning = [s != model.angles.rotation_class[0] for s in model.angles.rotation_class]
    lines = ["bodies  " + ", ".join(f"{i} {name}" for i, name in enumerate(model.links))]
    lines.append(
        "w_ij = w_i - w_j [rad/s], e_ij alike [rad/s2]; v_A, a_A: sliding velocity and acceleration along the guide of joint A;"
    )
    lines.append("places of the joints in metres, at the start; positive angles counter-clockwise")

    for number, loop in enumerate(model.loops, 1):
        steps = loop_steps(model, loop.closing)
        bodies = [0 if not steps else steps[0][1], *(q for _, _, q in steps)]
        names = [model.joints[j].name for j, _, _ in steps]
        lines += ["", f"loop {number}: {'-'.join(map(str, bodies))} through {', '.join(names)}"]
        term, along = partial(_term, least=1e-12 * model.length_scale), partial(_term, least=1e-12)  # of lengths and of directions
        omegas: list[str] = []
        first: list[str] = []
        second: list[str] = []
        spin2: list[str] = []
        x2: list[str] = []
        y2: list[str] = []
        for j, p, q in steps:
            joint = model.joints[j]
            z = complex(np.broadcast_to(motion.joint_point(j), motion.frames)[frame])
            if joint.turns:
                w = f"w_{q},{p}"
                omegas.append(w)
                first.append(term(z.imag, w))
                second.append(term(-z.real, w))
                spin2.append(f"e_{q},{p}")
                x2.append(term(z.imag, f"e_{q},{p}"))
                y2.append(term(-z.real, f"e_{q},{p}"))
            if joint.slide is not None:
                d = complex(np.broadcast_to(motion.guide(j), motion.frames)[frame])
                # velocity of body q's point at the joint relative to body p's, in the direction in which the coordinate grows
                d = d if model.ends[j][joint.guide] == p else -d
                carrier = model.ends[j][joint.guide]
                first.append(along(d.real, f"v_{joint.name}"))
                second.append(along(d.imag, f"v_{joint.name}"))
                coriolis = 2.0 if turning[carrier] else 0.0
                x2.append(along(d.real, f"a_{joint.name}") + along(-coriolis * d.imag, f"w_{carrier} v_{joint.name}"))
                y2.append(along(d.imag, f"a_{joint.name}") + along(coriolis * d.real, f"w_{carrier} v_{joint.name}"))
        for (j, _, q), (nxt, _, _) in zip(steps, [*steps[1:], steps[0]], strict=True):
            if not turning[q]:
                continue
            vector = complex(np.broadcast_to(motion.joint_point(nxt) - motion.joint_point(j), motion.frames)[frame])
            x2.append(term(-vector.real, f"w_{q}^2"))
            y2.append(term(-vector.imag, f"w_{q}^2"))
        lines.append("  velocities")
        lines += [f"    {' + '.join(omegas) or '0'} = 0", f"    {''.join(first) or '0 '}= 0", f"    {''.join(second) or '0 '}= 0"]
        lines.append("  accelerations")
        lines += [f"    {' + '.join(spin2) or '0'} = 0", f"    {''.join(x2) or '0 '}= 0", f"    {''.join(y2) or '0 '}= 0"]
    for number, relation in enumerate(model.relations):
        p, q = (model.index[k] for k in relation.links)
        lines += ["", f"{relation.kind} {relation.name}: bodies {p} and {q}"]
        velocities, accelerations = _tied(motion, relation, number, frame)
        lines += ["  velocities", f"    {velocities or '0 '}= 0", "  accelerations", f"    {accelerations or '0 '}= 0"]
    return lines


def _term(coefficient: float, symbols: str, least: float) -> str:
    return f"{coefficient:+.6g} {symbols} " if abs(coefficient) > least else ""


def _tied(motion: Motion, relation: Relation, number: int, frame: int) -> tuple[str, str]:
    """The left-hand sides of a relation's velocity and acceleration equations, as text."""
    index = motion.model.index

    def rates(angles: Sequence[tuple[str, float]], slides: Sequence[tuple[str, float]]) -> dict[str, float]:
        sums: dict[str, float] = {}
        for name, c in [*((f"w_{index[k]}", c) for k, c in angles if index[k]), *((f"v_{j}", c) for j, c in slides)]:
            sums[name] = sums.get(name, 0.0) + c
        return sums

    total, squares = rates(relation.angles, relation.slides), ""
    if relation.curve is not None:
        _, slope, second = (float(np.broadcast_to(b, motion.frames)[frame]) for b in motion.state.curve_values[number])
        inner = list(rates(relation.curve.angles, relation.curve.slides).items())
        for i, (name, c) in enumerate(inner):
            total[name] = total.get(name, 0.0) + slope * c
            squares += _term(second * c * c, f"{name}^2", 0.0)
            squares += "".join(_term(2.0 * second * c * d, f"{name} {other}", 0.0) for other, d in inner[i + 1 :])
    least = 1e-12 * max((abs(c) for c in total.values()), default=0.0)
    rate = {"w": "e", "v": "a"}
    first = "".join(_term(c, name, least) for name, c in total.items())
    return first, "".join(_term(c, rate[name[0]] + name[1:], least) for name, c in total.items()) + squares


def loop_steps(model: Model, closing: int) -> list[tuple[int, int, int]]:
    """The joints round a loop: (joint, from body, to body), starting at the body nearest to the frame."""
    p, q = model.ends[closing]
    tree = model.tree
    up, line = [], [p]
    while line[-1] != 0:
        line.append(tree.parent[line[-1]])
    down = []
    k = q
    while k not in line:
        down.append((tree.joint[k], k, tree.parent[k]))
        k = tree.parent[k]
    for link in line[: line.index(k)]:
        up.append((tree.joint[link], tree.parent[link], link))
    return [*reversed(up), (closing, p, q), *down]
