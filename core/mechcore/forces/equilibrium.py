"""Equilibrium: what joints and relations transmit under loads on the links, from the last group inwards.

The loops' closing joints are cut; the forces in the cuts follow block by block from the transposed columns of the kinematics
(virtual work of each unknown); then every link of the remaining tree is in equilibrium with the links beyond it, and moments about
the joints that fix an angle give couples and driving torques. Where constraints are redundant the shortest of all solutions is
taken (`mechcore.motion.redundancy`). All of this is linear in the loads. `balance.balance_program` says what balances where.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mechcore.arrays import Plane, Values
from mechcore.forces.balance import Arm, BalanceBlock, SubtreeStep, balance_program
from mechcore.kinematics.columns import constraint_coefficient, transposed
from mechcore.motion.motion import Motion
from mechcore.motion.redundancy import least_norm
from mechcore.numerics.frames import QUIET, added, crossed, nothing, summed


def transmit(
    motion: Motion, force: Sequence[Plane], moment: Sequence[Values], flanks: Mapping[int, Values] | None = None
) -> tuple[list[tuple[Plane, Values]], dict[str, tuple[Plane, Plane]], dict[int, Values]]:
    """Forces that joints and relations transmit under loads on the links: linear in the loads.

    ``force`` (complex) and ``moment`` (about its origin) of each link are (F,) or have axes before that of the frames.
    ``flanks``: multipliers whose signs say which flank or span of each relation carries; else it is the one that the loads ask for.
    Returns force and couple on the second link of every joint (drive included), place and force on the second link of every
    relation by name, and the relations' multipliers.
    """
    with np.errstate(**QUIET):
        return joint_forces(motion, list(force), list(moment), flanks)


def joint_forces(
    motion: Motion, force: list[Plane], moment: list[Values], flanks: Mapping[int, Values] | None = None
) -> tuple[list[tuple[Plane, Values]], dict[str, tuple[Plane, Plane]], dict[int, Values]]:
    """`transmit` for a caller that has quietened numpy; the lists are used up."""
    model = motion.model
    if model.needs_global_solve:
        return least_norm(motion, force, moment, flanks)
    program = model.once(balance_program)
    contacts: dict[str, tuple[Plane, Plane]] = {}  # relation -> place, force on its second link
    cuts, multipliers = _cut_forces(motion, program.blocks, *_subtree_wrenches(motion, force, moment, program.subtrees_of_cuts))
    for r, multiplier in multipliers.items():
        relation = model.relations[r]
        place, direction = relation.contact(motion, multiplier if flanks is None else flanks[r])
        contacts[relation.name] = (place, multiplier * direction)
        for link, sign in zip(relation.links, (-1.0, 1.0), strict=True):
            k = model.index[link]
            f = sign * contacts[relation.name][1]
            force[k] = added(force[k], f)
            moment[k] = added(moment[k], crossed(place - motion.origins[k], f))
        if relation.bearing is not None:
            couple = relation.bearing.couple(motion, *contacts[relation.name])
            for link, sign in ((relation.links[0], 1.0), (relation.bearing.carrier, -1.0)):
                k = model.index[link]
                moment[k] = added(moment[k], sign * couple)
    if multipliers:  # with the cuts open a contact also moves along its own normal: its whole force counts as a load now
        cuts, _ = _cut_forces(motion, program.blocks, *_subtree_wrenches(motion, force, moment, program.subtrees_of_cuts))
    transmitted: list[tuple[Plane, Values]] = [(0j, 0.0)] * len(model.joints)
    for c, cut in cuts.items():
        j, on = program.cuts[c]
        transmitted[j] = cut, 0.0
        for k, sign, arm in on:
            force[k] = added(force[k], cut, sign)
            if arm is not None:
                moment[k] = added(moment[k], crossed(_vector(motion, arm), cut), sign)
    subtree, unbalanced = _subtree_wrenches(motion, force, moment, program.subtrees)
    for j, k, side in program.carriers:
        transmitted[j] = subtree[k] * -1.0 if side else subtree[k], 0.0
    for j, k, other, second in program.leaves_first:  # couples: moments passed on from the leaves of each group
        couple = unbalanced[k]
        transmitted[j] = transmitted[j][0], -couple if second else couple
        if other:
            unbalanced[other] = added(unbalanced[other], couple)
    return transmitted, contacts, multipliers


def _subtree_wrenches(
    motion: Motion, force: Sequence[Plane], moment: Sequence[Values], steps: Iterable[SubtreeStep]
) -> tuple[list[Plane], list[Values]]:
    """Force on each link and all links beyond it in the tree, and the moment about each link's origin that joint forces alone leave
    unbalanced (of the links that ``steps`` ask for); not of the frame."""
    total, unbalanced = list(force), list(moment)
    for k, p, arm, parent_arm in steps:
        f = total[k]
        if nothing(f):
            continue
        if arm is not None:
            unbalanced[k] = added(unbalanced[k], crossed(_vector(motion, arm), f), -1)
        if p:
            total[p] = added(total[p], f)
            if parent_arm is not None:
                unbalanced[p] = added(unbalanced[p], crossed(_vector(motion, parent_arm), f))
    return total, unbalanced


def _vector(motion: Motion, arm: Arm) -> Plane:
    """The arm of a joint's force on a link: a vector that turns with it, or one that also slides along it."""
    vector: Plane = arm.vector * motion.state.rot[arm.rotation_class] if arm.slide is None else motion.arm(*arm.slide)
    return vector


def _cut_forces(
    motion: Motion, steps: Iterable[BalanceBlock], subtree: Sequence[Plane], unbalanced: Sequence[Values]
) -> tuple[dict[int, Plane], dict[int, Values]]:
    """Forces on the second links of the closing joints and in the relations, from the last block back to the first."""
    cuts: dict[int, Plane] = {}
    multipliers: dict[int, Values] = {}
    for number, block, balances in steps:
        if block.kind == "check":  # nothing left to balance: zero is the smallest force that does
            cuts.update(dict.fromkeys(block.loops, 0j))
            multipliers.update(dict.fromkeys(block.relations, 0.0))
            continue
        q = []
        for unknown, links, child, sign, loops, relations in balances:
            total: Values = 0.0
            for k in links:
                total = added(total, unbalanced[k])
            if child and not nothing(subtree[child]):
                total = added(total, (sign * motion.guide(unknown[1]).conjugate() * subtree[child]).real)
            for c, numbers in loops:
                arms, slides = motion.loop_vectors[c]
                if unknown[0] == "slide":
                    work = (slides[numbers[0]][2].conjugate() * cuts[c]).real
                else:
                    work = crossed(summed([arms[i][1] for i in numbers]), cuts[c])
                total = added(total, work, -1)
            for r in relations:
                total = added(total, constraint_coefficient(motion.model, r, unknown, motion.state.bends) * multipliers[r], -1)
            q.append(total)
        forces, solved = transposed(block, motion.columns[number], q)
        cuts.update(zip(block.loops, forces, strict=True))
        multipliers.update(zip(block.relations, solved, strict=True))
    return cuts, multipliers
