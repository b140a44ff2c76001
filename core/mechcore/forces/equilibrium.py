"""Equilibrium: what joints and relations transmit under loads on the links, from the last group inwards.

The contours' closing joints are cut; the forces in the cuts follow block by block from the transposed columns of the kinematics
(virtual work of each unknown); then every link of the remaining tree is in equilibrium with the links beyond it, and moments about
the joints that fix an angle give couples and driving torques. Where constraints are redundant the shortest of all solutions is
taken (`mechcore.motion.redundancy`). All of this is linear in the loads. `balance_plan` says once per model what balances where.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mechcore.kinematics import blocks as bl
from mechcore.kinematics.model import Block, Model
from mechcore.motion.motion import CALM, Motion
from mechcore.motion.redundancy import least_norm
from mechcore.numerics.frames import crossed, minus, nothing, plus
from mechcore.topology.graph import leaves_first

Array = Any

Arm = tuple[int, Array, tuple[int, int, int] | None]
"""(spin, vector in its axes, None), or (spin, vector, (link, joint, side)) where a slide is part of it: see `Motion.arm`."""


class SubtreeStep(NamedTuple):
    """A link, its parent in the tree, and the arms at which the force on its subtree acts on it and on the parent; None where the
    moment is not asked for, or the force acts at the link's origin."""

    link: int
    parent: int
    arm: Arm | None
    parent_arm: Arm | None


class Balance(NamedTuple):
    """What balances at an unknown: the moments on the ``links`` of an angle, or the force on the subtree of a ``child`` along its
    guide (``back``: against it); and the forces in the cuts of later blocks, their contours and relations, in which it appears."""

    unknown: tuple[str, int]
    links: tuple[int, ...]
    child: int  # 0: none
    back: bool
    contours: tuple[int, ...]
    relations: tuple[int, ...]


class Cut(NamedTuple):
    """The joint that closes a contour, and the moving links that the force in its cut acts on: whether it is added to theirs
    (`plus`) or taken from it (`minus`), and its arm where the moment is asked for."""

    joint: int
    on: tuple[tuple[int, Callable[[Array, Array], Array], Arm | None], ...]


class BalancePlan(NamedTuple):
    """What balances where in a model; nothing here depends on time."""

    balances: tuple[tuple[int, Block, tuple[Balance, ...]], ...]  # of the blocks, from the last back to the first, with its number
    cuts: tuple[Cut, ...]  # of every contour
    subtrees: tuple[SubtreeStep, ...]  # inwards, as far as couples and drives need them
    subtrees_of_cuts: tuple[SubtreeStep, ...]  # as far as the forces in the cuts need them
    carriers: tuple[tuple[int, int, int], ...]  # joints of the tree, each with the link that it leads to and that link's side in it
    leaves_first: tuple[tuple[int, int, int, bool], ...]  # see `graph.leaves_first`, of the joints that fix an angle


def balance_plan(model: Model) -> BalancePlan:
    """What balances where in a model."""
    joint, parent, outwards = model.tree.joint, model.tree.parent, model.tree.order
    sides = {k: 1 if model.ends[joint[k]][1] == k else 0 for k in outwards}  # of each link in the joint that leads to it
    child = {joint[k]: k for k in outwards}
    passed_on = leaves_first(model.ends, model.angles.edges)
    passing = frozenset(k for _, *links, _ in passed_on for k in links if k)  # moments, through joints that fix an angle
    grouped = frozenset(k for k, g in enumerate(model.angles.group) if g)  # their moments balance with the forces in the cuts
    later = _later(model)

    def balance(unknown: tuple[str, int]) -> Balance:
        what, i = unknown
        if what == "angle":
            return Balance(unknown, model.angles.links_of[i], 0, False, *later[unknown])
        k = child.get(i, 0)  # of a tree joint: the subtree of the child moves along the guide
        return Balance(unknown, (), k, k != 0 and model.ends[i][model.joints[i].guide] == k, *later[unknown])

    def cut(j: int) -> Cut:
        sides = ((k, put, side) for side, (k, put) in enumerate(zip(model.ends[j], (minus, plus), strict=True)) if k)
        return Cut(j, tuple((k, put, _arm_of(model, passing, k, j, side)) for k, put, side in sides))

    def subtrees(wanted: frozenset[int], among: frozenset[int]) -> Iterable[SubtreeStep]:
        """Over the links ``among``, the moments on the links ``wanted``."""
        for k in outwards[::-1]:
            if k in among:
                p, side = parent[k], sides[k]
                on = _arm_of(model, wanted, p, joint[k], 1 - side) if p else None
                own = _arm_of(model, wanted, k, joint[k], side)
                if (p and p in among) or own is not None or on is not None:
                    yield SubtreeStep(k, p, own, on)

    decisive = {child[j] for b in model.blocks for j in b.slides if j in child}
    decisive |= {k for k in outwards if k in grouped or parent[k] in grouped}
    for k in outwards:  # parents first: all beyond a link that is needed is needed too
        if parent[k] in decisive:
            decisive.add(k)
    return BalancePlan(
        balances=tuple((i, b, tuple(balance(u) for u in b.unknowns)) for i, b in enumerate(model.blocks))[::-1],
        cuts=tuple(cut(contour.closing) for contour in model.contours),
        subtrees=tuple(subtrees(passing, frozenset(outwards))),
        subtrees_of_cuts=tuple(subtrees(grouped, frozenset(decisive))),
        carriers=tuple((joint[k], k, sides[k]) for k in outwards),
        leaves_first=passed_on,
    )


def _arm_of(model: Model, wanted: frozenset[int], k: int, j: int, side: int) -> Arm | None:
    """The arm of a joint's force on a link; None where it is zero, or the moment on the link is not ``wanted``."""
    joint = model.joints[j]
    at = joint.b if side else joint.a
    slides = joint.slide is not None and joint.guide == side
    still = isinstance(at, complex) and at == 0 and not slides
    return None if still or k not in wanted else (model.angles.spin[k], at * model.turn[k], (k, j, side) if slides else None)


def _later(model: Model) -> Mapping[tuple[str, int], tuple[tuple[int, ...], tuple[int, ...]]]:
    """For every unknown the contours and the relations of other blocks, solved later, in which it appears."""
    own = {u: b for b in model.blocks for u in b.unknowns}
    found: dict[tuple[str, int], tuple[list[int], list[int]]] = {u: ([], []) for u in own}
    for c, contour in enumerate(model.spin_contours):
        groups = {model.angles.spin_group[s] for s, _ in contour.arms} | {model.angles.spin_group[s] for _, s, _ in contour.slides}
        for u in [("angle", g) for g in groups] + [("slide", j) for j, _, _ in contour.slides]:
            if u in own and c not in own[u].contours:
                found[u][0].append(c)
    for r, t in enumerate(model.constraints):
        terms = (t,) if t.curve is None else (t, t.curve)
        own_terms = [u for x in terms for u in [*(("angle", g) for g, _ in x.groups), *(("slide", j) for j, _ in x.slides)]]
        for u in dict.fromkeys(own_terms):
            if u in own and r not in own[u].relations:
                found[u][1].append(r)
    return {u: (tuple(c), tuple(r)) for u, (c, r) in found.items()}


def transmit(
    motion: Motion, force: Sequence[Array], moment: Sequence[Array], flanks: Mapping[int, Array] | None = None
) -> tuple[list[tuple[Array, Array]], dict[str, tuple[Array, Array]], dict[int, Array]]:
    """What joints and relations transmit under loads on the links: linear in the loads.

    ``force`` (complex) and ``moment`` (about its origin) of each link are (F,) or have axes before that of the frames.
    ``flanks``: multipliers whose signs say which flank or span of each relation carries; else it is the one that the loads ask for.
    Returns force and couple on the second link of every joint (drive included), place and force on the second link of every
    relation by name, and the relations' multipliers.
    """
    with np.errstate(**CALM):
        return joint_forces(motion, [None if nothing(f) else f for f in force], [None if nothing(m) else m for m in moment], flanks)


def joint_forces(
    motion: Motion, force: list[Array], moment: list[Array], flanks: Mapping[int, Array] | None = None
) -> tuple[list[tuple[Array, Array]], dict[str, tuple[Array, Array]], dict[int, Array]]:
    """`transmit` for a caller that has quietened numpy, with None for loads that are nothing; the lists are used up."""
    model = motion.model
    if model.needs_global_solve:
        return least_norm(motion, [0j if f is None else f for f in force], [0.0 if m is None else m for m in moment], flanks)
    plan = model.once(balance_plan)
    contacts: dict[str, tuple[Array, Array]] = {}  # relation -> place, force on its second link
    cuts, multipliers = _cut_forces(motion, *_subtree_wrenches(motion, force, moment, plan.subtrees_of_cuts))
    for r, multiplier in multipliers.items():
        relation = model.relations[r]
        place, direction = relation.contact(motion, multiplier if flanks is None else flanks[r])
        contacts[relation.name] = (place, multiplier * direction)
        for link, sign in zip(relation.links, (-1.0, 1.0), strict=True):
            k = model.index[link]
            f = sign * contacts[relation.name][1]
            force[k] = plus(force[k], f)
            moment[k] = plus(moment[k], crossed(place - motion.origins[k], f))
        if relation.bearing is not None:
            couple = relation.bearing.couple(motion, *contacts[relation.name])
            for link, sign in ((relation.links[0], 1.0), (relation.bearing.carrier, -1.0)):
                k = model.index[link]
                moment[k] = plus(moment[k], sign * couple)
    if multipliers:  # with the cuts open a contact also moves along its own normal: its whole force counts as a load now
        cuts, _ = _cut_forces(motion, *_subtree_wrenches(motion, force, moment, plan.subtrees_of_cuts))
    transmitted: list[tuple[Array, Array]] = [(0j, 0.0)] * len(model.joints)
    for c, cut in cuts.items():
        j, on = plan.cuts[c]
        transmitted[j] = cut, 0.0
        for k, put, arm in on:
            force[k] = put(force[k], cut)
            if arm is not None:
                moment[k] = put(moment[k], crossed(_arm(motion, *arm), cut))
    subtree, unbalanced = _subtree_wrenches(motion, force, moment, plan.subtrees)
    for j, k, side in plan.carriers:
        f = subtree[k]
        if f is not None:
            transmitted[j] = f * -1.0 if side else f, 0.0
    for j, k, other, second in plan.leaves_first:  # couples: moments passed on from the leaves of each group
        couple = unbalanced[k]
        if couple is not None:
            transmitted[j] = transmitted[j][0], -couple if second else couple
            if other:
                unbalanced[other] = plus(unbalanced[other], couple)
    return transmitted, contacts, multipliers


def _subtree_wrenches(
    motion: Motion, force: Sequence[Array], moment: Sequence[Array], steps: Iterable[SubtreeStep]
) -> tuple[list[Array], list[Array]]:
    """Force on each link and all links beyond it in the tree, and the moment about each link's origin that joint forces alone leave
    unbalanced (of the links that ``steps`` ask for); not of the frame. None: nothing."""
    total, unbalanced = list(force), list(moment)
    for k, p, own, carrying in steps:
        f = total[k]
        if f is None:
            continue
        if own is not None:
            unbalanced[k] = minus(unbalanced[k], crossed(_arm(motion, *own), f))
        if p:
            total[p] = plus(total[p], f)
            if carrying is not None:
                unbalanced[p] = plus(unbalanced[p], crossed(_arm(motion, *carrying), f))
    return total, unbalanced


def _arm(motion: Motion, spin: int, vector: Array, sliding: tuple[int, int, int] | None) -> Array:
    """The arm of a joint's force on a link: a vector that turns with it, or one that also slides along it."""
    return vector * motion.state.rot[spin] if sliding is None else motion.arm(*sliding)


def _cut_forces(motion: Motion, subtree: Sequence[Array], unbalanced: Sequence[Array]) -> tuple[dict[int, Array], dict[int, Array]]:
    """Forces on the second links of the closing joints and in the relations, from the last block back to the first."""
    model, columns = motion.model, motion.columns
    cuts: dict[int, Array] = {}
    multipliers: dict[int, Array] = {}
    for i, block, balances in model.once(balance_plan).balances:
        if block.kind == "check":  # nothing left to balance: zero is the smallest force that does
            cuts.update(dict.fromkeys(block.contours, 0j))
            multipliers.update(dict.fromkeys(block.relations, 0.0))
            continue
        q = []
        for unknown, links, child, back, contours, relations in balances:
            total: Array = None
            for k in links:
                if unbalanced[k] is not None:
                    total = plus(total, unbalanced[k])
            if child and subtree[child] is not None:
                guide = motion.guide(unknown[1])
                total = ((-guide if back else guide).conjugate() * subtree[child]).real
            for c in contours:
                col = bl.column(model, motion.contours[c], unknown)
                if col is not None:
                    total = minus(total, (np.conj(col) * cuts[c]).real)
            for r in relations:
                total = minus(total, bl.constraint_coefficient(model, r, unknown, motion.state.bends) * multipliers[r])
            q.append(0.0 if total is None else total)
        found, solved = bl.transposed(block, columns[i], q)
        for c, cut in zip(block.contours, found, strict=True):
            cuts[c] = cut
        for r, multiplier in zip(block.relations, solved, strict=True):
            multipliers[r] = multiplier
    return cuts, multipliers
