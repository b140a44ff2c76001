"""Velocities and accelerations at known positions.

Once positions are known, the equations are linear: each block solves its columns for the rates of its unknowns, first with the
known velocities, then with centripetal, Coriolis and known accelerations (method of the contour graph).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from mechcore.arrays import Plane, Real, Values
from mechcore.kinematics.columns import Columns, LoopVectors, rates
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Block, LoopEquation, NonlinearTerm
from mechcore.numerics.frames import imaginary, is_zero, lazy, purely_imaginary, summed


class RateReplacement(Protocol):
    """Replaces the solved rates of a block at some frames, as an `Interpolant` does."""

    def into(self, rates: list[Any], derivative: int) -> None: ...


Interpolants = Mapping[int, Sequence[RateReplacement]]


class Rates:
    """First rates of all rotation classes [rad/s] and sliding joints [m/s]; second rates if the first are given as ``before``.

    ``factor``: derivative of each rotation class's rotation E divided by E, i omega or i alpha - omega^2. Until the block of a
    rotation class is solved, it holds the known part only: what drives contribute, and the centripetal part. A rate that is always
    zero is a plain zero, not an array. Where a block is singular, its rates are undetermined: NaN.
    """

    def __init__(
        self, model: Model, drives: Sequence[Values], curve_values: Mapping[int, Real] | None = None, before: Rates | None = None
    ):
        self.drives = drives
        self.curve_values: Mapping[int, Real] = curve_values or {}  # of the relations' curves
        self.before = before
        n = len(model.angles.class_group)
        self.angular: list[Values] = [0.0] * n
        self.factor: list[Plane] = [0j] * n if before is None else [f * f for f in before.factor]
        for s, ((first, sense), *more) in model.program.driven_rotations:
            rate = drives[first] if sense == 1 else -drives[first]
            for d, sign in more:
                rate = rate + sign * drives[d]
            self.angular[s] = rate
            self.factor[s] = imaginary(rate) if before is None else self.factor[s] + imaginary(rate)
        self.slide: dict[int, Values] = {j: drives[d] for j, d in model.program.driven_slides}
        self.group: dict[int, Values] = {}

    def settle(self, model: Model, block: Block, solved: Sequence[Values]) -> None:
        """Store a block's solved rates."""
        for group, rate in zip(block.angles, solved, strict=False):
            self._settle_group(model, group, rate, imaginary(rate))
        for j, rate in zip(block.slides, solved[len(block.angles) :], strict=True):
            self.slide[j] = rate

    def solve_dyad(self, model: Model, block: Block, cols: Columns, drift: Plane) -> None:
        """Solve a dyad's rates like `columns.rates`, and store them; i times an angle's rate is a product without its real part."""
        dual: Any = cols.dual
        for group, d in zip(block.angles, dual, strict=False):
            turn = drift * d
            rate = turn.imag
            self._settle_group(model, group, rate, purely_imaginary(turn))
        for j, d in zip(block.slides, dual[len(block.angles) :], strict=True):
            self.slide[j] = (drift * d).imag

    def _settle_group(self, model: Model, group: int, rate: Values, turn: Plane) -> None:
        self.group[group] = rate
        driven, known = model.angles.class_drives, self.before is not None
        for s in model.program.classes_of[group]:
            self.angular[s] = rate + self.angular[s] if driven[s] else rate
            self.factor[s] = self.factor[s] + turn if known or driven[s] else turn

    def drift(self, loop: LoopEquation, vectors: LoopVectors) -> Plane:
        """Rate of a loop's sum while the rates of its block's unknowns are zero."""
        (arms, slides), factor, before = vectors, self.factor, self.before
        if before is None:
            terms = [factor[arms[i][0]] * arms[i][1] for i in loop.known_vectors]
        else:
            terms = [factor[rotation_class] * z for rotation_class, z in arms]
        if slides and before is not None:
            turns = before.factor
            terms += [(2.0 * before.slide[j]) * (turns[s] * d) for j, s, d in slides if not is_zero(turns[s])]  # Coriolis
        if loop.known_guides:
            terms += [self.slide[slides[i][0]] * slides[i][2] for i in loop.known_guides]
        return summed(terms)

    def constraint_drift(self, model: Model, block: Block) -> list[Values]:
        """Right-hand sides of a block's relations: minus their rates while those of the block's unknowns are zero."""
        out = []
        for r in block.relations:
            t = model.constraints[r]
            total: Values = 0.0
            for d, c in t.drives:
                total = total - c * self.drives[d]
            for g, c in t.groups:
                if g not in block.angles:
                    total = total - c * self.group[g]
            for j, c in t.slides:
                if j not in block.slides:
                    total = total - c * self.slide[j]
            if t.curve is not None:
                _, first, second = self.curve_values[r]
                total = total - first * self.argument(t.curve)
                if self.before is not None:
                    total = total - second * self.before.argument(t.curve) ** 2
            out.append(total)
        return out

    def argument(self, curve: NonlinearTerm) -> Values:
        """Rate of a curve's argument."""
        rate: Values = curve.argument(self.drives, self.group.__getitem__, self.slide)
        return rate


class SolvedRates(Rates):
    """Rates of all rotation classes, sliding joints and groups that have been solved elsewhere."""

    def __init__(
        self,
        drives: Sequence[Values],
        curve_values: Mapping[int, Real],
        before: Rates | None,
        angular: list[Values],
        slide: dict[int, Values],
        group: dict[int, Values],
    ):
        self.drives, self.curve_values, self.before = drives, curve_values, before
        self.angular, self.slide, self.group = angular, slide, group

    @lazy
    def factor(self) -> list[Plane]:
        """As in `Rates`, computed at the first access."""
        turns = list(map(imaginary, self.angular))
        return turns if self.before is None else [turn - w * w for turn, w in zip(turns, self.before.angular, strict=True)]


def velocities(
    model: Model,
    vectors: Sequence[LoopVectors],
    cols: Sequence[Columns],
    drive_speeds: Sequence[Values],
    interpolants: Interpolants | None = None,
    curve_values: Mapping[int, Real] | None = None,
) -> Rates:
    """First rates of all rotation classes and slides."""
    return _solved(model, vectors, cols, Rates(model, drive_speeds, curve_values), interpolants)


def accelerations(
    model: Model,
    vectors: Sequence[LoopVectors],
    cols: Sequence[Columns],
    speeds: Rates,
    drive_accelerations: Sequence[Values],
    interpolants: Interpolants | None = None,
) -> Rates:
    """Second rates of all rotation classes and slides, given the first."""
    return _solved(model, vectors, cols, Rates(model, drive_accelerations, speeds.curve_values, speeds), interpolants)


def _solved(
    model: Model, vectors: Sequence[LoopVectors], cols: Sequence[Columns], unknown: Rates, interpolants: Interpolants | None
) -> Rates:
    """The rates, solved block by block, and replaced at the frames of the ``interpolants``."""
    loops = model.program.loop_equations
    for k, (block, c) in enumerate(zip(model.blocks, cols, strict=True)):
        if block.kind == "check":
            continue
        if c.dual is not None and not interpolants:
            loop = block.loops[0]
            unknown.solve_dyad(model, block, c, unknown.drift(loops[loop], vectors[loop]))
            continue
        drift = [unknown.drift(loops[i], vectors[i]) for i in block.loops]
        solved = rates(block, c, drift, unknown.constraint_drift(model, block))
        for interpolant in interpolants.get(k, ()) if interpolants else ():
            interpolant.into(solved, 1 if unknown.before is None else 2)
        unknown.settle(model, block, solved)
    return unknown
