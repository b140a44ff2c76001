"""The way back through the program as data: what balances where, from the last block to the drives. Nothing here depends on time.

Forwards, `mechcore.kinematics.program` solves a block for its unknowns; backwards the virtual work of each of these unknowns gives
the forces in the loops' cuts. The rest is equilibrium of links: forces are summed up along the tree, couples along the joints that
fix an angle.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from mechcore.arrays import Complex
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Block, Unknown, moved_by
from mechcore.topology.graph import leaves_first


class Arm(NamedTuple):
    """Where a joint's force acts on a link: at a vector in the axes of a rotation class, and beyond it at what the joint has slid
    there, if it carries the guide of a ``slide``: (link, joint, side)."""

    rotation_class: int
    vector: complex | Complex
    slide: tuple[int, int, int] | None


class SubtreeStep(NamedTuple):
    """A step: the force on a link and all beyond it in the tree is handed to its parent.

    The arms are those at which it acts on the link and on the parent; None where the moment is not asked for, or the force acts at
    the link's origin.
    """

    link: int
    parent: int
    arm: Arm | None
    parent_arm: Arm | None


class Balance(NamedTuple):
    """What balances at an unknown: the moments on the ``links`` of an angle, or the force on the subtree of a ``child`` (0: none)
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
    """The joint that closes a loop, and the moving links that the force in its cut acts on: (link, sign, arm)."""

    joint: int
    on: tuple[tuple[int, int, Arm | None], ...]


class BalanceProgram(NamedTuple):
    """All that joint forces follow from: steps in the order in which they are taken, and their tables."""

    subtrees_of_cuts: tuple[SubtreeStep, ...]  # as far as the forces in the cuts need them
    blocks: tuple[BalanceBlock, ...]  # from the last back to the first
    cuts: tuple[Cut, ...]  # of every loop
    subtrees: tuple[SubtreeStep, ...]  # as far as couples and drives need them
    carriers: tuple[tuple[int, int, int], ...]  # joints of the tree, each with the link that it leads to and that link's side in it
    leaves_first: tuple[tuple[int, int, int, bool], ...]  # see `graph.leaves_first`, of the joints that fix an angle


def balance_program(model: Model) -> BalanceProgram:
    """What balances where in a model; ask for it by `Model.once`."""
    joint, parent, outwards = model.tree.joint, model.tree.parent, model.tree.order
    sides = {k: 1 if model.ends[joint[k]][1] == k else 0 for k in outwards}  # of each link in the joint that leads to it
    child = {joint[k]: k for k in outwards}
    passed_on = leaves_first(model.ends, model.angles.edges)
    passing = frozenset(k for _, *links, _ in passed_on for k in links if k)  # moments, through joints that fix an angle
    grouped = frozenset(k for k, g in enumerate(model.angles.group) if g)  # their moments balance with the forces in the cuts

    def balance(block: Block, unknown: Unknown) -> Balance:
        what, i = unknown
        moved = ((c, moved_by(loop, unknown, model.angles)) for c, loop in enumerate(model.loop_sums) if c not in block.loops)
        loops = tuple((c, numbers) for c, numbers in moved if numbers)
        relations = tuple(
            r for r, constraint in enumerate(model.constraints) if r not in block.relations and unknown in constraint.unknowns
        )
        if what == "angle":
            return Balance(unknown, model.angles.links_of[i], 0, 1.0, loops, relations)
        k = child.get(i, 0)  # of a tree joint: the subtree of the child moves along the guide
        back = k != 0 and model.ends[i][model.joints[i].guide] == k
        return Balance(unknown, (), k, -1.0 if back else 1.0, loops, relations)

    def cut(j: int) -> Cut:
        sides = ((k, sign, side) for side, (k, sign) in enumerate(zip(model.ends[j], (-1, 1), strict=True)) if k)
        return Cut(j, tuple((k, sign, _arm_of(model, passing, k, j, side)) for k, sign, side in sides))

    def subtrees(wanted: frozenset[int], among: frozenset[int]) -> Iterator[SubtreeStep]:
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
