"""Velocities and accelerations on top of positions.

Once positions are known everything is linear: each block solves its columns for the rates of its unknowns, once with the
velocities of what is known, once more with centripetal, Coriolis and known accelerations (contour-graph method).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from . import blocks as bl
from .blocks import Columns, Vectors
from .frames import added, nothing
from .model import Model
from .positions import drive_rates

__all__ = ["Rates", "accelerations", "velocities"]

Array = Any


class Replaces(Protocol):
    """Something that puts rates of its own in place of a block's, such as a `Patch`."""

    def into(self, rates: list[Array], derivative: int) -> None: ...


Patches = Mapping[int, Sequence[Replaces]]


class Rates:
    """Speeds of all spins [rad/s^k] and of all sliding joints [m/s^k]; k = 1 or 2."""

    def __init__(self, model: Model, drives: Sequence[Array]):
        extra, self.slide = drive_rates(model, drives)
        self.drives = drives
        self.spin: list[Array] = extra
        self.group: dict[int, Array] = {}

    def settle(self, model: Model, block: bl.Block, solved: list[Array]) -> None:
        """Take over a block's solved rates."""
        for group, rate in zip(block.angles, solved, strict=False):
            self.group[group] = rate
            for spin in model.angles.spins_of[group]:
                extra = self.spin[spin]
                self.spin[spin] = rate if nothing(extra) else rate + extra
        for j, rate in zip(block.slides, solved[len(block.angles) :], strict=True):
            self.slide[j] = rate

    def tied(self, model: Model, block: bl.Block) -> list[Array]:
        """Right-hand sides of a block's relations: what the known rates in them leave to the unknown ones."""
        out = []
        for r in block.relations:
            t = model.sums[r]
            total: Array = 0.0
            for d, c in t.drives:
                total = total - c * self.drives[d]
            for g, c in t.groups:
                if g not in block.angles:
                    total = total - c * self.group[g]
            for j, c in t.slides:
                if j not in block.slides:
                    total = total - c * self.slide[j]
            out.append(total)
        return out


def velocities(
    model: Model,
    contours: dict[int, Vectors],
    cols: Sequence[Columns],
    drive_speeds: Sequence[Array],
    patches: Patches | None = None,
) -> Rates:
    """Rates of all spins and slides. Until its block is solved, the rate of an unknown spin is only what drives add to it."""
    found = Rates(model, drive_speeds)
    for k, (block, c) in enumerate(zip(model.blocks, cols, strict=True)):
        if block.kind == "check":
            continue
        rhs = []
        for i in block.contours:
            v = contours[i]
            total: Array = 0j
            for spin, z in v.arms:
                w = found.spin[spin]
                if not nothing(w):
                    total = added(total, w * z)
            total = -1j * total
            for j, _, d in v.slides:
                if j not in block.slides:
                    total = total - found.slide[j] * d
            rhs.append(total)
        found.settle(model, block, _patched(bl.rates(block, c, rhs, found.tied(model, block)), patches, k, 1))
    return found


def accelerations(
    model: Model,
    contours: dict[int, Vectors],
    cols: Sequence[Columns],
    speeds: Rates,
    drive_accelerations: Sequence[Array],
    patches: Patches | None = None,
) -> Rates:
    """Second rates of all spins and slides, given the first."""
    found = Rates(model, drive_accelerations)
    for k, (block, c) in enumerate(zip(model.blocks, cols, strict=True)):
        if block.kind == "check":
            continue
        rhs = []
        for i in block.contours:
            v = contours[i]
            total: Array = 0j
            tangential: Array = 0j
            for spin, z in v.arms:
                w, a = speeds.spin[spin], found.spin[spin]
                if not nothing(w):
                    total = added(total, (w * w) * z)  # centripetal
                if not nothing(a):
                    tangential = added(tangential, a * z)
            for j, spin, d in v.slides:
                w = speeds.spin[spin]
                if not nothing(w):
                    tangential = added(tangential, (2.0 * w * speeds.slide[j]) * d)  # Coriolis
                if j not in block.slides:
                    total = total - found.slide[j] * d
            rhs.append(added(total, 1j * tangential, -1))
        found.settle(model, block, _patched(bl.rates(block, c, rhs, found.tied(model, block)), patches, k, 2))
    return found


def _patched(rates: list[Array], patches: Patches | None, block: int, derivative: int) -> list[Array]:
    """Rates of a block with those frames replaced at which they are given."""
    for patch in patches.get(block, ()) if patches else ():
        patch.into(rates, derivative)
    return rates
