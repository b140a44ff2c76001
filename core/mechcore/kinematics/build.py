"""Compiling a mechanism: links and joints as indices, loops, blocks in solving order."""

from __future__ import annotations

import cmath
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from mechcore.errors import Fault, MechanismError, Named
from mechcore.joints.base import LoopJoint, Relation
from mechcore.joints.registry import build_joints
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Block, LinearConstraint, NonlinearTerm, VectorSum, vector_sum
from mechcore.spec.mechanism import Mechanism
from mechcore.topology.checks import check_items, check_lengths, check_redundant_angles
from mechcore.topology.graph import Angles, Loop, angles, spanning_tree, structure, vector_loops
from mechcore.topology.order import block_order


def build_model(mechanism: Mechanism) -> Model:
    """Compile a mechanism: graph, loops, blocks. Raises `MechanismError` if the description contradicts itself."""
    check_items(mechanism)
    parts = build_joints(mechanism)
    names = (mechanism.frame, *(k for k in parts.links if k != mechanism.frame))
    index = Named("link", {k: i for i, k in enumerate(names)})
    joints = tuple(parts.joints)
    own = {j.name: i for i, j in enumerate(joints)}
    joint_index = Named("joint", own, [r.name for r in parts.relations if r.name not in own])
    ends = tuple((index[j.links[0]], index[j.links[1]]) for j in joints)
    turned = Counter(k for d in mechanism.drives if d.joint in joint_index for k in joints[joint_index[d.joint]].links)
    decided = {k for k, times in turned.items() if times > 1} | {k for r in parts.relations for k, _ in r.angles}
    check_lengths(joints, ends, names, decided)
    undrivable = [d.joint for d in mechanism.drives if d.joint not in joint_index or not joints[joint_index[d.joint]].freedoms]
    if undrivable:
        why = "has no coordinate that a drive could prescribe."
        raise MechanismError([Fault(f"joints.{p}.drive", why, "Drive a revolute or sliding joint instead.") for p in undrivable])
    driven = {joint_index[d.joint]: i for i, d in enumerate(mechanism.drives)}
    n = len(names)

    turning = angles(n, ends, joints, driven)
    check_redundant_angles(mechanism, turning, joints, ends)
    order, equations = structure(n, ends, joints, driven)
    tree = spanning_tree(n, ends, order, equations)
    if len(tree.order) < n - 1:
        lost = [k for i, k in enumerate(names) if i and tree.parent[i] < 0]
        raise MechanismError([Fault(f"links.{k}", "no chain of joints joins it to the frame.", "Add a joint.") for k in lost])
    closed = vector_loops(ends, joints, tree)
    turn = tuple(cmath.exp(1j * o) for o in turning.offset)
    size = _size(mechanism)
    sums = tuple(loop_sum(c, turning, turn, 1e-14 * size) for c in closed)
    constraints = tuple(_linear_constraint(r, turning, index, joint_index) for r in parts.relations)
    blocks, unmatched = _blocks(sums, tree.closing, constraints, turning, joints, ends, driven)
    _check_curves(blocks, constraints)
    free_angles = {g for b in blocks if b.kind in ("general", "relation") for g in b.angles}
    multi_turn = {g for t in constraints for g, _ in t.groups} - free_angles
    return Model(
        mechanism=mechanism,
        links=names,
        joints=joints,
        ends=ends,
        driven=driven,
        angles=turning,
        tree=tree,
        order=order,
        loops=closed,
        loop_sums=sums,
        relations=tuple(parts.relations),
        constraints=constraints,
        multi_turn=tuple(sorted(multi_turn)),
        blocks=blocks,
        free=_free_joints(unmatched, turning, joints, ends),
        turn=turn,
        length_scale=size,
        index=index,
        joint_index=joint_index,
        bodies=parts.links,
    )


def loop_sum(loop: Loop, turning: Angles, turn: tuple[complex, ...], least: float = 0.0) -> VectorSum:
    """The sum of the vectors round a loop, by rotation class; it is zero where the loop closes.

    Vectors no longer than ``least`` [m] are dropped (slides stay).
    """
    arms: dict[int, Any] = {}
    for k, vector in loop.links:
        arms[turning.rotation_class[k]] = arms.get(turning.rotation_class[k], 0j) + vector * turn[k]
    if least > 0.0:
        arms = {s: a for s, a in arms.items() if abs(a) > least}
    return vector_sum(arms, [(j, turning.rotation_class[k], d * turn[k]) for j, k, d in loop.slides])


def _size(m: Mechanism) -> float:
    """Characteristic length [m]: the largest extent along x or y of a moving link's points; if zero, of the frame's; else 1."""
    for moving in (True, False):
        best = 0.0
        for link in m.links:
            if (link.name != m.frame) == moving and len(link.points) > 1:
                x, y = zip(*link.points.values(), strict=True)
                best = max(best, max(x) - min(x), max(y) - min(y))
        if best > 0.0:
            return float(best)
    return 1.0


def _linear_constraint(
    relation: Relation, turning: Angles, index: Mapping[str, int], joint_index: Mapping[str, int]
) -> LinearConstraint:
    groups: dict[int, float] = {}
    drives: dict[int, float] = {}
    offset = 0.0  # contribution of the constant angles between the links and their groups
    for link, c in relation.angles:
        k = index[link]
        groups[turning.group[k]] = groups.get(turning.group[k], 0.0) + c
        for d, sign in turning.class_drives[turning.rotation_class[k]]:
            drives[d] = drives.get(d, 0.0) + c * sign
        offset += c * turning.offset[k]
    scale = max((abs(c) for _, c in relation.angles), default=0.0)
    return LinearConstraint(
        name=relation.name,
        groups=tuple((g, c) for g, c in groups.items() if g and abs(c) > 1e-14 * scale),
        drives=tuple((d, c) for d, c in drives.items() if c != 0.0),
        slides=tuple((joint_index[j], c) for j, c in relation.slides),
        curve=_nonlinear_term(relation, turning, index, joint_index),
        constant=None if relation.constant is None else relation.constant - offset,
    )


def _nonlinear_term(
    relation: Relation, turning: Angles, index: Mapping[str, int], joint_index: Mapping[str, int]
) -> NonlinearTerm | None:
    curve = relation.curve
    if curve is None:
        return None
    inner = replace(relation, angles=curve.angles, slides=curve.slides, curve=None, constant=curve.shift)
    argument = _linear_constraint(inner, turning, index, joint_index)
    shift = 2.0 * curve.shift - float(argument.constant or 0.0)  # the links' offsets belong to the argument
    return NonlinearTerm(curve.function, argument.groups, argument.drives, argument.slides, shift)


def _check_curves(blocks: tuple[Block, ...], constraints: tuple[LinearConstraint, ...]) -> None:
    """Raise `MechanismError` if a curve's argument is unknown where its relation is solved (a cam driven by its follower)."""
    faults = []
    for block in blocks:
        for r in block.relations:
            curve = constraints[r].curve
            if curve is not None and any(curve.slope(u) for u in block.unknowns):
                faults.append(
                    Fault(
                        f"joints.{constraints[r].name}",
                        "here the follower drives the cam: a dwell or a reversal then leaves the cam's place open.",
                        "Drive the cam (its revolute joint, or what turns it), and let it drive the follower.",
                    )
                )
    if faults:
        raise MechanismError(faults)


def _blocks(
    sums: tuple[VectorSum, ...],
    closing: tuple[int, ...],
    constraints: tuple[LinearConstraint, ...],
    turning: Angles,
    joints: tuple[LoopJoint, ...],
    ends: tuple[tuple[int, int], ...],
    driven: Mapping[int, int],
) -> tuple[tuple[Block, ...], list[tuple[str, int]]]:
    sliding = [j for j, joint in enumerate(joints) if joint.slide is not None and j not in driven]
    columns: dict[tuple[str, int], int] = {("angle", g): g - 1 for g in range(1, turning.groups)}
    columns |= {("slide", j): turning.groups - 1 + i for i, j in enumerate(sliding)}
    unknown = list(columns)
    pattern: list[list[int]] = []
    for c in sums:
        groups = {turning.class_group[s] for s, _ in c.arms}
        groups |= {turning.class_group[g] for _, g, _ in c.slides}
        row = [columns["angle", g] for g in sorted(groups - {0})]
        row += [columns["slide", j] for j, _, _ in c.slides if j not in driven]
        pattern += [row, row]
    for t in constraints:
        pattern.append([columns[u] for u in t.unknowns if u in columns])
    order = block_order(pattern, len(columns))
    last = 2 * len(sums)
    rows = [{e // 2 for e in equations if e < last} for equations, _ in order.blocks]
    relations = [tuple(sorted(e - last for e in equations if e >= last)) for equations, _ in order.blocks]
    placed = {c for r in rows for c in r}
    solved = {r for t in relations for r in t}
    between: dict[frozenset[int], int] = {}
    for j in sorted(range(len(ends)), key=lambda j: j in sliding):  # a joint that slides closes another group than its two links
        between.setdefault(frozenset(turning.group[k] for k in ends[j]), j)
    blocks = []
    for loop_rows, own_relations, (_, unknowns) in zip(rows, relations, order.blocks, strict=True):
        picked = [unknown[u] for u in unknowns]
        group = tuple(i for what, i in picked if what == "angle")
        slides = tuple(i for what, i in picked if what == "slide")
        own = tuple(sorted(loop_rows))
        blocks.append(
            Block(
                kind=_kind(own, own_relations, group, slides, sums, turning),
                loops=own,
                angles=group,
                slides=slides,
                name=joints[_inner_joint(own, group, slides, closing, between)].name if own else constraints[own_relations[0]].name,
                redundant=2 * len(own) + len(own_relations) - len(unknowns),
                relations=own_relations,
            )
        )
    blocks += [Block("check", (i,), (), (), joints[j].name, redundant=2) for i, j in enumerate(closing) if i not in placed]
    blocks += [
        Block("check", (), (), (), t.name, redundant=1, relations=(i,)) for i, t in enumerate(constraints) if i not in solved
    ]
    return tuple(blocks), [unknown[u] for u in sorted(order.unmatched)]


def _kind(
    own: tuple[int, ...],
    relations: tuple[int, ...],
    group: tuple[int, ...],
    slides: tuple[int, ...],
    sums: tuple[VectorSum, ...],
    turning: Angles,
) -> str:
    if relations:
        return "general" if own or len(relations) > 1 else "relation"
    if len(own) > 1:
        return "general"
    if len(group) + len(slides) == 1:
        return "angle" if group else "slide"
    if len(group) == 2:
        return "theta_theta"
    if len(slides) == 2:
        return "slide_slide"
    carrier = next(turning.class_group[g] for j, g, _ in sums[own[0]].slides if j == slides[0])
    return "arm_slide" if carrier == group[0] else "theta_slide"


def _inner_joint(
    own: tuple[int, ...],
    group: tuple[int, ...],
    slides: tuple[int, ...],
    closing: tuple[int, ...],
    between: Mapping[frozenset[int], int],
) -> int:
    """The joint that names a block: the one between its two unknown groups, else the first that slides, else the closing joint."""
    if len(group) == 2 and frozenset(group) in between:
        return between[frozenset(group)]
    return slides[0] if slides else closing[own[0]]


def _free_joints(
    unmatched: list[tuple[str, int]], turning: Angles, joints: tuple[LoopJoint, ...], ends: tuple[tuple[int, int], ...]
) -> tuple[str, ...]:
    """Names of the joints next to unknowns that no equation determines, for messages to the user."""
    groups = {i for what, i in unmatched if what == "angle"}
    slides = {i for what, i in unmatched if what == "slide"}
    return tuple(
        joint.name
        for j, (joint, (p, q)) in enumerate(zip(joints, ends, strict=True))
        if j in slides or (joint.turns and {turning.group[p], turning.group[q]} & groups)
    )
