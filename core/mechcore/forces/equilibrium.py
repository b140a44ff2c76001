"""Equilibrium: the balances of a model as data, and the forces that joints and relations transmit under loads on the links, from
the last group inwards.

Forwards, `mechcore.kinematics.program` solves a block for its unknowns; backwards, the virtual work of each of these unknowns gives
the forces in the cuts of the loops' closing joints, block by block, from the transposed columns of the kinematics. Then every link
of the remaining tree is in equilibrium with the links beyond it, and moments about the joints that fix an angle give couples and
driving torques. Where constraints are redundant, the solution of least norm is taken (`mechcore.motion.at_once`). All of this is
linear in the loads. The order, `balance_program`, does not depend on time; `solution_order` describes both directions in words.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mechcore.arrays import Complex, Plane, Values
from mechcore.kinematics.columns import constraint_coefficient, transposed
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Block, Unknown, moved_by
from mechcore.motion.at_once import least_norm
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import QUIET, added, crossed, is_zero, subtracted, summed
from mechcore.topology.graph import FRAME, leaves_first


class Arm(NamedTuple):
    """Point at which a joint's force acts on a link: a vector in the axes of a rotation class, plus the joint's slide if the link
    carries its guide; ``slide``: (link, joint, side) of it."""

    rotation_class: int
    vector: complex | Complex
    slide: tuple[int, int, int] | None


class SubtreeStep(NamedTuple):
    """A step: the force on a link and all links beyond it in the tree is passed to its parent.

    The arms are those at which it acts on the link and on the parent; None where the moment is not needed, or the force acts at the
    link's origin.
    """

    link: int
    parent: int
    arm: Arm | None
    parent_arm: Arm | None


class Balance(NamedTuple):
    """Balance at an unknown: the moments on the ``links`` of an angle, or the force on the subtree of a ``child`` (0: none)
    along ``sign`` times its guide; and the forces in the cuts of later blocks in which it appears: ``loops``, each with the numbers
    of the vectors that it moves, and ``relations``."""

    unknown: Unknown
    links: tuple[int, ...]
    child: int
    sign: float
    loops: tuple[tuple[int, tuple[int, ...]], ...]
    relations: tuple[int, ...]


class BalanceBlock(NamedTuple):
    """A step: the transposed columns of a block give the forces in its cuts."""

    number: int
    block: Block
    balances: tuple[Balance, ...]


class Cut(NamedTuple):
    """The joint that closes a loop, and the moving links that the force in its cut acts on: (link, side, arm), on the first (side
    0) the opposite."""

    joint: int
    on: tuple[tuple[int, int, Arm | None], ...]


class BalanceProgram(NamedTuple):
    """The steps from which joint forces follow, in the order in which they are taken, and their tables."""

    subtrees_of_cuts: tuple[SubtreeStep, ...]  # those that the forces in the cuts need
    blocks: tuple[BalanceBlock, ...]  # from the last back to the first
    cuts: tuple[Cut, ...]  # of every loop
    subtrees: tuple[SubtreeStep, ...]  # those that couples and drives need
    carriers: tuple[tuple[int, int, int], ...]  # joints of the tree, each with the link that it leads to and that link's side in it
    leaves_first: tuple[tuple[int, int, int, bool], ...]  # see `graph.leaves_first`, of the joints that fix an angle


def balance_program(model: Model) -> BalanceProgram:
    """All balances of a model, in order; call it through `Model.cached`."""
    joint, parent, outwards = model.tree.joint, model.tree.parent, model.tree.order
    sides = {k: 1 if model.ends[joint[k]][1] == k else 0 for k in outwards}  # of each link in the joint that leads to it
    child = {joint[k]: k for k in outwards}
    passed_on = leaves_first(model.ends, model.angles.edges)
    passing = frozenset(k for _, *links, _ in passed_on for k in links if k)  # moments, through joints that fix an angle
    grouped = frozenset(k for k, g in enumerate(model.angles.group) if g)  # their moments balance with the forces in the cuts
    moved: dict[Unknown, list[tuple[int, tuple[int, ...]]]] = {}  # loops by the unknown that moves them
    for c, loop in enumerate(model.loop_sums):
        for unknown, numbers in moved_by(loop, model.angles).items():
            moved.setdefault(unknown, []).append((c, numbers))

    def balance(block: Block, unknown: Unknown) -> Balance:
        what, i = unknown
        loops = tuple((c, numbers) for c, numbers in moved.get(unknown, ()) if c not in block.loops)
        relations = tuple(
            r for r, constraint in enumerate(model.constraints) if r not in block.relations and unknown in constraint.unknowns
        )
        if what == "angle":
            return Balance(unknown, model.angles.links_of[i], 0, 1.0, loops, relations)
        k = child.get(i, 0)  # of a tree joint: the subtree of the child moves along the guide
        back = k != 0 and model.ends[i][model.joints[i].guide] == k
        return Balance(unknown, (), k, -1.0 if back else 1.0, loops, relations)

    def cut(j: int) -> Cut:
        return Cut(j, tuple((k, side, _arm_of(model, passing, k, j, side)) for side, k in enumerate(model.ends[j]) if k))

    def subtrees(wanted: frozenset[int], among: frozenset[int]) -> Iterator[SubtreeStep]:
        """Steps over the links ``among``, with the moments on the links ``wanted``."""
        for k in outwards[::-1]:
            if k in among:
                p, side = parent[k], sides[k]
                on = _arm_of(model, wanted, p, joint[k], 1 - side) if p else None
                own = _arm_of(model, wanted, k, joint[k], side)
                if (p and p in among) or own is not None or on is not None:
                    yield SubtreeStep(k, p, own, on)

    decisive = {child[j] for b in model.blocks for j in b.slides if j in child}
    decisive |= {k for k in outwards if k in grouped or parent[k] in grouped}
    for k in outwards:  # parents first: all links beyond a needed link are needed too
        if parent[k] in decisive:
            decisive.add(k)
    blocks = [BalanceBlock(i, b, tuple(balance(b, u) for u in b.unknowns)) for i, b in enumerate(model.blocks)]
    return BalanceProgram(
        subtrees_of_cuts=tuple(subtrees(grouped, frozenset(decisive))),
        blocks=tuple(blocks[::-1]),
        cuts=tuple(cut(loop.closing) for loop in model.loops),
        subtrees=tuple(subtrees(passing, frozenset(outwards))),
        carriers=tuple((joint[k], k, sides[k]) for k in outwards),
        leaves_first=passed_on,
    )


def _arm_of(model: Model, wanted: frozenset[int], k: int, j: int, side: int) -> Arm | None:
    """The arm of a joint's force on a link; None where it is zero, or the moment on the link is not ``wanted``."""
    joint = model.joints[j]
    at = joint.b if side else joint.a
    slides = joint.slide is not None and joint.guide == side
    still = isinstance(at, complex) and at == 0 and not slides
    if still or k not in wanted:
        return None
    return Arm(model.angles.rotation_class[k], at * model.turn[k], (k, j, side) if slides else None)


FORMS = {
    "theta_theta": "a e1 + b e2 = c",
    "theta_slide": "a e + s d = c",
    "arm_slide": "(a + s d) e = c",
    "slide_slide": "s1 d1 + s2 d2 = c",
    "angle": "a e = c",
    "slide": "s d = c",
    "check": "nothing is left to solve: it only has to close",
    "relation": "sum of coordinates",
    "general": "Newton's method",
}
"""How each kind of `Block` is solved, e = exp(i angle)."""


def solution_order(model: Model) -> list[str]:
    """Lines of text: what the drives determine, what every block solves and how, and the balances on the way back to the drives.

    Loops are numbered as among the loop equations.
    """
    program, back = model.program, model.cached(balance_program)
    steps = [f"{_drives(model, turned.drives)} turn{'s' * (len(turned.drives) == 1)} {_turned(model, turned.rotation_class)}"
             for turned in program.driven_rotations]  # fmt: skip
    steps += [f"drive {model.joints[j].name} moves along its guide" for j, _ in program.driven_slides]
    steps += [_solved(model, block) for block in program.blocks]
    lines = ["order of solution, e = exp(i angle): forwards to positions, velocities and accelerations"]
    lines += [f"  {n}. {words}" for n, words in enumerate(steps, 1)]
    if model.needs_global_solve:
        return [*lines, "joint forces: of all joints together"]
    lines.append("back to joint forces, from the loads and inertia forces on the links")
    steps = [_balanced(model, block, balances) for _, block, balances in back.blocks if block.kind != "check"]
    steps.append("link by link towards the frame: equilibrium gives the forces in all other joints, couples and drives")
    return lines + [f"  {n}. {words}" for n, words in enumerate(steps, 1)]


def _drives(model: Model, drives: tuple[tuple[int, int], ...]) -> str:
    names = [model.mechanism.drives[d].joint for d, _ in drives]
    return f"drive{'s' * (len(names) > 1)} {' and '.join(names)}"


def _turned(model: Model, rotation_class: int) -> str:
    """The links of a rotation class, with the links against which they turn where these are not the frame's."""
    links = ", ".join(model.links[k] for k, s in enumerate(model.angles.rotation_class) if s == rotation_class)
    group = model.angles.class_group[rotation_class]
    others = [model.links[k] for k in model.angles.links_of[group] if model.angles.rotation_class[k] != rotation_class]
    return links if group == model.angles.class_group[FRAME] else f"{links} against {', '.join(others)}"


def _solved(model: Model, block: Block) -> str:
    unknowns = ", ".join(_unknown(model, u) for u in block.unknowns)
    return f"{block.name}: {FORMS[block.kind]}, {_equations(model, block)}{': ' * bool(unknowns)}{unknowns}"


def _equations(model: Model, block: Block) -> str:
    loops = [f"loop{'s' * (len(block.loops) > 1)} {', '.join(str(c + 1) for c in block.loops)}"] if block.loops else []
    return " and ".join(loops + [f"{model.relations[r].kind} {model.relations[r].name}" for r in block.relations])


def _unknown(model: Model, unknown: Unknown) -> str:
    what, i = unknown
    if what == "slide":
        return f"displacement {model.joints[i].name}"
    return f"angle of {', '.join(model.links[k] for k in model.angles.links_of[i])}"


def _balanced(model: Model, block: Block, balances: tuple[Balance, ...]) -> str:
    cuts = [model.joints[model.loops[c].closing].name for c in block.loops] + [model.relations[r].name for r in block.relations]
    works = ", ".join(_work(model, b) for b in balances)
    return f"{block.name}: {works}: force{'s' * (len(cuts) > 1)} in {', '.join(cuts)}"


def _work(model: Model, balance: Balance) -> str:
    what, i = balance.unknown
    if what == "angle":
        return f"moments on {', '.join(model.links[k] for k in balance.links)}"
    return f"forces along {model.joints[i].name}"


def transmit(
    motion: Motion, force: Sequence[Plane], moment: Sequence[Values], flanks: Mapping[int, Values] | None = None
) -> tuple[list[tuple[Plane, Values]], dict[str, tuple[Plane, Plane]], dict[int, Values]]:
    """Forces that joints and relations transmit under loads on the links: linear in the loads.

    ``force`` (complex) and ``moment`` (about its origin) of each link are (F,) or have axes before that of the frames. ``flanks``:
    multipliers whose signs select the flank or span of each relation that carries; without them it follows from the loads. Returns
    force and couple on the second link of every joint (drive included), place and force on the second link of every relation by
    name, and the relations' multipliers.
    """
    with np.errstate(**QUIET):
        return joint_forces(motion, list(force), list(moment), flanks)


def joint_forces(
    motion: Motion, force: list[Plane], moment: list[Values], flanks: Mapping[int, Values] | None = None
) -> tuple[list[tuple[Plane, Values]], dict[str, tuple[Plane, Plane]], dict[int, Values]]:
    """`transmit` for a caller that has silenced numpy's warnings; the lists are modified."""
    model = motion.model
    if model.needs_global_solve:
        return least_norm(motion, force, moment, flanks)
    program = model.cached(balance_program)
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
    if multipliers:  # with the cuts open, a contact also moves along its own normal: its whole force is a load now
        cuts, _ = _cut_forces(motion, program.blocks, *_subtree_wrenches(motion, force, moment, program.subtrees_of_cuts))
    transmitted: list[tuple[Plane, Values]] = [(0j, 0.0)] * len(model.joints)
    for c, cut in cuts.items():
        j, on = program.cuts[c]
        transmitted[j] = cut, 0.0
        for k, side, arm in on:
            add = added if side else subtracted
            force[k] = add(force[k], cut)
            if arm is not None:
                moment[k] = add(moment[k], crossed(_vector(motion, arm), cut))
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
    unbalanced (of the links that ``steps`` list); the frame is left out."""
    total, unbalanced = list(force), list(moment)
    for k, p, arm, parent_arm in steps:
        f = total[k]
        if is_zero(f):
            continue
        if arm is not None:
            unbalanced[k] = subtracted(unbalanced[k], crossed(_vector(motion, arm), f))
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
        if block.kind == "check":  # no unknown is left to balance: the force of least norm is zero
            cuts.update(dict.fromkeys(block.loops, 0j))
            multipliers.update(dict.fromkeys(block.relations, 0.0))
            continue
        q = []
        for unknown, links, child, sign, loops, relations in balances:
            total: Values = 0.0
            for k in links:
                total = added(total, unbalanced[k])
            if child and not is_zero(subtree[child]):
                total = added(total, (sign * motion.guide(unknown[1]).conjugate() * subtree[child]).real)
            for c, numbers in loops:
                arms, slides = motion.loop_vectors[c]
                if unknown[0] == "slide":
                    work = (slides[numbers[0]][2].conjugate() * cuts[c]).real
                else:
                    work = crossed(summed([arms[i][1] for i in numbers]), cuts[c])
                total = subtracted(total, work)
            for r in relations:
                coefficient = constraint_coefficient(motion.model, r, unknown, motion.state.curve_values)
                total = subtracted(total, coefficient * multipliers[r])
            q.append(total)
        forces, solved = transposed(block, motion.columns[number], q)
        cuts.update(zip(block.loops, forces, strict=True))
        multipliers.update(zip(block.relations, solved, strict=True))
    return cuts, multipliers
