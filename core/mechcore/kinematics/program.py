"""The order of solution as data: what the drives decide, then what every block solves. Nothing here depends on time.

Plane vectors are complex numbers. Every set of links that turns together (a *rotation class*, see `graph.Angles`) has one rotation
``E = exp(i angle)``. Each vector of a mechanism, round a loop or to a point, is a `VectorSum` over rotation classes and sliding
joints; its derivatives are the same sum over the derivatives of E and of s E. A program runs forwards for positions, velocities and
accelerations; `mechcore.forces.equilibrium` runs it backwards for forces, from the last block to the drives.

A program consists of indices, numbers and kinds of steps, so that executors other than numpy can run it. Only the nonlinear term of
a relation (the law of a cam) is a function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np

from mechcore.arrays import Plane, Values
from mechcore.numerics.frames import summed
from mechcore.records import dataclass
from mechcore.topology.graph import FRAME, Angles

Unknown = tuple[str, int]  # ("angle", group) or ("slide", joint)


class VectorSum(NamedTuple):
    """``constant + sum of A E`` over rotation classes that turn ``+ sum of d E s`` over sliding joints, d a unit vector in the axes
    of its rotation class.

    In a sweep the vectors ``constant`` and A are arrays (designs, 1).
    """

    constant: Plane
    arms: tuple[tuple[int, Plane], ...]  # (class, A)
    slides: tuple[tuple[int, int, complex], ...]  # (joint, class, d)

    def scaled(self, factor: Values) -> VectorSum:
        """The sum times a number; in a sweep times one of each design (designs, 1)."""
        arms = tuple((s, factor * a) for s, a in self.arms)
        slides = tuple((j, s, cast(complex, factor * d)) for j, s, d in self.slides)
        return VectorSum(factor * self.constant, arms, slides)


@dataclass(frozen=True)
class NonlinearTerm:
    """The nonlinear term of a relation: ``function`` of a linear sum as in `LinearConstraint` plus ``shift``."""

    function: Callable[[Any], Any]
    groups: tuple[tuple[int, float], ...]
    drives: tuple[tuple[int, float], ...]
    slides: tuple[tuple[int, float], ...]
    shift: float

    def argument(self, drives: Sequence[Any], group: Callable[[int], Any], slides: Mapping[int, Any], start: float = 0.0) -> Any:
        """``start`` plus the sum of coefficients times coordinates, or times their rates: of drives, groups and slides."""
        total: Any = start
        for d, c in self.drives:
            total = total + c * drives[d]
        for g, c in self.groups:
            total = total + c * group(g)
        for j, c in self.slides:
            total = total + c * slides[j]
        return total

    def slope(self, unknown: Unknown) -> float:
        """Derivative of the argument by an unknown."""
        return dict(self.groups if unknown[0] == "angle" else self.slides).get(unknown[1], 0.0)


@dataclass(frozen=True)
class LinearConstraint:
    """A relation between coordinates: ``sum of coefficients times groups, drives and slides + curve = constant``."""

    name: str
    groups: tuple[tuple[int, float], ...]  # unknown groups [m per rad]
    drives: tuple[tuple[int, float], ...]  # rotary drives inside groups
    slides: tuple[tuple[int, float], ...]  # sliding joints
    curve: NonlinearTerm | None = None
    constant: float | None = None  # None: taken from the start

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """All groups and slides in it, those of its curve included."""
        terms = (self,) if self.curve is None else (self, self.curve)
        angles, slides = [g for t in terms for g, _ in t.groups], [j for t in terms for j, _ in t.slides]
        return tuple(dict.fromkeys([*(("angle", g) for g in angles), *(("slide", j) for j in slides)]))


class DrivenRotation(NamedTuple):
    """A step: drives turn a rotation class relative to its group, by the sum of sign times position."""

    rotation_class: int
    drives: tuple[tuple[int, int], ...]  # (drive, sign)


class DrivenSlide(NamedTuple):
    """A step: a drive gives the displacement of a sliding joint."""

    joint: int
    drive: int


@dataclass(frozen=True)
class Block:
    """A step: a smallest set of loops and unknowns that are solved together (an Assur group), or the check of one loop or relation.

    ``kind`` says how: ``theta_theta`` (RRR), ``theta_slide`` (RRP), ``arm_slide`` (RPR), ``slide_slide`` (RPP, PRP) are closed
    forms; ``angle`` and ``slide`` are a loop with one unknown and a redundant equation; ``check`` is a loop or relation without
    unknowns, which must close; ``relation`` is one relation with one unknown; ``general`` is solved by Newton's method.
    """

    kind: str
    loops: tuple[int, ...]  # numbers of its loops
    angles: tuple[int, ...]  # unknown groups
    slides: tuple[int, ...]  # unknown sliding joints
    name: str  # of a joint, by which users identify the group
    redundant: int = 0  # number of redundant equations
    relations: tuple[int, ...] = ()  # numbers of its constraints

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """("angle", group) and ("slide", joint) of the block's unknowns."""
        return (*(("angle", g) for g in self.angles), *(("slide", j) for j in self.slides))

    @cached_property
    def dyad(self) -> bool:
        """Whether it is one loop with two unknowns."""
        return len(self.loops) == 1 and len(self.angles) + len(self.slides) == 2 and not self.relations


class UnknownSlide(NamedTuple):
    """A displacement that a block solves, along a guide with this ``direction`` in the axes of its rotation class."""

    joint: int
    carrier: int  # number of the block's angle that turns the guide; -1 where the guide is known
    rotation_class: int
    direction: complex


class LoopEquation(NamedTuple):
    """A loop as its block solves it.

    For positions, the vectors of the unknowns add up to ``target``: ``arms`` are the vectors that each unknown angle of the block
    turns, in axes that turn with it; ``slides`` are the unknown slides.

    For rates, the loop's vectors in world axes are known. ``vectors`` are those that turn: (class, A, numbers of the ``guides``
    whose displacements belong to it). ``guides`` are all slides: (joint, class, d). ``columns`` gives the numbers of those that
    each unknown moves; ``known_vectors`` and ``known_guides`` those with rates that are known before the block is solved.
    """

    target: VectorSum
    arms: tuple[VectorSum, ...]
    slides: tuple[UnknownSlide, ...]
    vectors: tuple[tuple[int, Plane, tuple[int, ...]], ...]
    guides: tuple[tuple[int, int, complex], ...]
    columns: tuple[tuple[int, ...], ...]
    known_vectors: tuple[int, ...]
    known_guides: tuple[int, ...]


class Program(NamedTuple):
    """The computation of a mechanism's positions and rates: steps in their order, and the tables they use."""

    driven_rotations: tuple[DrivenRotation, ...]
    driven_slides: tuple[DrivenSlide, ...]
    blocks: tuple[Block, ...]
    loop_equations: tuple[LoopEquation, ...]  # by the numbers in `Block.loops`
    constraints: tuple[LinearConstraint, ...]  # by the numbers in `Block.relations`
    classes_of: tuple[tuple[int, ...], ...]  # the rotation classes that each group turns
    shorter: tuple[int, ...]  # for each rotation class an earlier one whose drives are the same without the last; -1: none


def compile_program(
    blocks: Sequence[Block],
    sums: Sequence[VectorSum],
    constraints: Sequence[LinearConstraint],
    angles: Angles,
    driven_slides: Sequence[DrivenSlide],
) -> Program:
    """The program of a mechanism from the ``sums`` of its loops and its ``blocks`` in solving order."""
    block_of = {c: b for b in blocks for c in b.loops}
    known: dict[tuple[tuple[int, int], ...], int] = {}
    shorter: list[int] = []  # along a chain of drives each rotation class has one drive more than the one before
    for s, drives in enumerate(angles.class_drives):
        shorter.append(known.get(drives[:-1], -1))
        if drives:
            known.setdefault(drives, s)
    return Program(
        driven_rotations=tuple(DrivenRotation(s, drives) for s, drives in enumerate(angles.class_drives) if drives),
        driven_slides=tuple(driven_slides),
        blocks=tuple(blocks),
        loop_equations=tuple(_equation(total, block_of[c], angles) for c, total in enumerate(sums)),
        constraints=tuple(constraints),
        classes_of=angles.classes_of,
        shorter=tuple(shorter),
    )


def _equation(total: VectorSum, block: Block, angles: Angles) -> LoopEquation:
    group = angles.class_group
    known_slides = [slide for slide in total.slides if slide[0] not in block.slides]

    def arm(g: int) -> VectorSum:
        fixed = [a for s, a in total.arms if group[s] == g and not angles.class_drives[s]]
        turned = tuple((s, a) for s, a in total.arms if group[s] == g and angles.class_drives[s])
        return VectorSum(summed(fixed), turned, tuple(slide for slide in known_slides if group[slide[1]] == g))

    def unknown_slide(j: int, rotation_class: int, d: complex) -> UnknownSlide:
        carrier = block.angles.index(group[rotation_class]) if group[rotation_class] in block.angles else -1
        return UnknownSlide(j, carrier, rotation_class, d)

    classes, moved = _turning(total), moved_by(total, angles)
    constant = dict(total.arms)
    return LoopEquation(
        target=VectorSum(
            -total.constant,
            tuple((s, -a) for s, a in total.arms if group[s] not in block.angles),
            tuple((j, s, -d) for j, s, d in known_slides if group[s] not in block.angles),
        ),
        arms=tuple(arm(g) for g in block.angles),
        slides=tuple(unknown_slide(*slide) for j in block.slides for slide in total.slides if slide[0] == j),
        vectors=tuple((s, constant.get(s, 0j), tuple(i for i, x in enumerate(total.slides) if x[1] == s)) for s in classes),
        guides=total.slides,
        columns=tuple(moved.get(u, ()) for u in block.unknowns),
        known_vectors=tuple(i for i, s in enumerate(classes) if group[s] not in block.angles or angles.class_drives[s]),
        known_guides=tuple(i for i, (j, _, _) in enumerate(total.slides) if j not in block.slides),
    )


def _turning(total: VectorSum) -> list[int]:
    """The rotation classes of a loop's vectors that turn, in the order of `LoopEquation.vectors`."""
    return list(dict.fromkeys([*(s for s, _ in total.arms), *(s for _, s, _ in total.slides if s != FRAME)]))


def moved_by(total: VectorSum, angles: Angles) -> dict[Unknown, tuple[int, ...]]:
    """The unknowns that move a loop: unknown -> numbers of the `vectors` that it turns, or the number of the one of the `guides`
    along which it slides."""
    moved: dict[Unknown, tuple[int, ...]] = {("slide", j): (n,) for n, (j, _, _) in enumerate(total.slides)}
    for n, s in enumerate(_turning(total)):
        unknown: Unknown = ("angle", angles.class_group[s])
        moved[unknown] = (*moved.get(unknown, ()), n)
    return moved


def vector_sum(arms: Mapping[int, Any], slides: Sequence[tuple[int, int, complex]]) -> VectorSum:
    """A `VectorSum` from vectors by rotation class; that of the frame's class is its ``constant``, zero vectors are dropped."""
    turning = tuple((s, a) for s, a in arms.items() if s != FRAME and (a != 0 if isinstance(a, complex) else np.any(a != 0)))
    return VectorSum(arms.get(FRAME, 0j), turning, tuple(slides))
