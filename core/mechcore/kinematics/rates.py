"""Velocities and accelerations on top of positions.

Once positions are known everything is linear: each block solves its columns for the rates of its unknowns, once with the
velocities of what is known, once more with centripetal, Coriolis and known accelerations (contour-graph method).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from mechcore.kinematics import blocks as bl
from mechcore.kinematics.blocks import Columns, Vectors
from mechcore.kinematics.model import Block, Model, NonlinearTerm
from mechcore.numerics.frames import added, imaginary, lazy, purely_imaginary

Array = Any


class Replaces(Protocol):
    """Something that puts rates of its own in place of a block's, such as a `Patch`."""

    def into(self, rates: list[Array], derivative: int) -> None: ...


Patches = Mapping[int, Sequence[Replaces]]


class Rates:
    """Speeds of all spins [rad/s^k] and of all sliding joints [m/s^k]; k = 1 or 2.

    ``turns``: i times the speed of each spin, None where it is plain zero.
    """

    def __init__(
        self, model: Model, drives: Sequence[Array], bends: Mapping[int, Array] | None = None, before: Rates | None = None
    ):
        self.drives = drives
        self.bends: Mapping[int, Array] = bends or {}  # of the relations' curves
        self.before = before  # the first rates, where these are the second
        n = len(model.angles.spin_group)
        self.spin: list[Array] = [0.0] * n
        self.turns: list[Array] = [None] * n
        for s, ((first, way), *more) in model.driven_spins:
            rate = drives[first] if way == 1 else -drives[first]
            for d, sign in more:
                rate = rate + sign * drives[d]
            if isinstance(rate, np.ndarray) or rate:
                self.spin[s], self.turns[s] = rate, imaginary(rate)
        self.slide: dict[int, Array] = {j: drives[d] for j, d in model.driven_slides}
        self.group: dict[int, Array] = {}

    @lazy
    def twice(self) -> list[Array]:
        """(i omega)^2 of each spin, the centripetal factor; for use when all blocks are settled."""
        return [None if t is None else t * t for t in self.turns]

    def settle(self, model: Model, block: Block, solved: list[Array]) -> None:
        """Take over a block's solved rates."""
        for group, rate in zip(block.angles, solved, strict=False):
            self._turn(model, group, rate, imaginary(rate))
        for j, rate in zip(block.slides, solved[len(block.angles) :], strict=True):
            self.slide[j] = rate

    def solve_dyad(self, model: Model, block: Block, cols: Columns, drift: Array) -> None:
        """`blocks.rates` of a dyad, taken over; i times the rate of an angle is had by clearing the real parts of a product."""
        dual: Any = cols.dual
        for group, d in zip(block.angles, dual, strict=False):
            turn = drift * d
            rate = turn.imag
            self._turn(model, group, rate, purely_imaginary(turn))
        for j, d in zip(block.slides, dual[len(block.angles) :], strict=True):
            self.slide[j] = (drift * d).imag

    def _turn(self, model: Model, group: int, rate: Array, turn: Array) -> None:
        self.group[group] = rate
        for spin in model.angles.spins_of[group]:
            if self.turns[spin] is None:
                self.spin[spin], self.turns[spin] = rate, turn
            else:
                self.spin[spin] = rate + self.spin[spin]
                self.turns[spin] = imaginary(self.spin[spin])

    def constraint_drift(self, model: Model, block: Block) -> list[Array]:
        """Right-hand sides of a block's relations: what the known rates in them leave to the unknown ones."""
        out = []
        for r in block.relations:
            t = model.constraints[r]
            total: Array = 0.0
            for d, c in t.drives:
                total = total - c * self.drives[d]
            for g, c in t.groups:
                if g not in block.angles:
                    total = total - c * self.group[g]
            for j, c in t.slides:
                if j not in block.slides:
                    total = total - c * self.slide[j]
            if t.curve is not None:
                _, first, second = self.bends[r]
                total = total - first * self.argument(t.curve)
                if self.before is not None:
                    total = total - second * self.before.argument(t.curve) ** 2
            out.append(total)
        return out

    def argument(self, curve: NonlinearTerm) -> Array:
        """Rate of a curve's argument."""
        total: Array = 0.0
        for d, c in curve.drives:
            total = total + c * self.drives[d]
        for g, c in curve.groups:
            total = total + c * self.group[g]
        for j, c in curve.slides:
            total = total + c * self.slide[j]
        return total


def velocities(
    model: Model,
    contours: dict[int, Vectors],
    cols: Sequence[Columns],
    drive_speeds: Sequence[Array],
    patches: Patches | None = None,
    bends: Mapping[int, Array] | None = None,
) -> Rates:
    """Rates of all spins and slides. Until its block is solved, the rate of an unknown spin is only what drives add to it."""
    found = Rates(model, drive_speeds, bends)
    for k, (block, c) in enumerate(zip(model.blocks, cols, strict=True)):
        if block.kind == "check":
            continue
        turns = found.turns
        drift = []
        for i in block.contours:
            arms, slides, _, _ = contours[i]
            total: Array = None
            for spin, z in arms:
                turn = turns[spin]
                if turn is not None:
                    total = turn * z if total is None else total + turn * z
            if total is None:
                total = 0j
            for j, _, d in slides:
                if j not in block.slides:
                    total = added(total, found.slide[j] * d)
            drift.append(total)
        _solve(model, block, c, drift, found, patches, k, 1)
    return found


def _solve(
    model: Model,
    block: Block,
    cols: Columns,
    drift: list[Array],
    found: Rates,
    patches: Patches | None,
    k: int,
    derivative: int,
) -> None:
    """Rates of the unknowns of block number ``k``, those frames replaced at which they are given."""
    if cols.dual is not None and not patches:
        found.solve_dyad(model, block, cols, drift[0])
        return
    solved = bl.rates(block, cols, drift, found.constraint_drift(model, block))
    for patch in patches.get(k, ()) if patches else ():
        patch.into(solved, derivative)
    found.settle(model, block, solved)


def accelerations(
    model: Model,
    contours: dict[int, Vectors],
    cols: Sequence[Columns],
    speeds: Rates,
    drive_accelerations: Sequence[Array],
    patches: Patches | None = None,
) -> Rates:
    """Second rates of all spins and slides, given the first."""
    found = Rates(model, drive_accelerations, speeds.bends, speeds)
    for k, (block, c) in enumerate(zip(model.blocks, cols, strict=True)):
        if block.kind == "check":
            continue
        turns, twice = found.turns, speeds.twice
        drift = []
        for i in block.contours:
            arms, slides, _, _ = contours[i]
            total: Array = None
            for spin, z in arms:
                turn, centripetal = turns[spin], twice[spin]
                if centripetal is not None:  # and tangential where known
                    turn = centripetal if turn is None else turn + centripetal
                if turn is not None:
                    total = turn * z if total is None else total + turn * z
            if total is None:
                total = 0j
            for j, spin, d in slides:
                if speeds.turns[spin] is not None:
                    total = added(total, (2.0 * speeds.slide[j]) * (speeds.turns[spin] * d))  # Coriolis
                if j not in block.slides:
                    total = added(total, found.slide[j] * d)
            drift.append(total)
        _solve(model, block, c, drift, found, patches, k, 2)
    return found
