"""Indicator diagrams: the pressure in a cylinder over the piston's displacement, from the usual parameters or from tables.

The displacement x runs from top dead centre (0) to bottom dead centre (``stroke``). The branch of a diagram follows from the sense
of the piston's motion and, for four strokes, from the half of the cycle. Polytropes p V^n = constant as in any text on piston
machines, for example W. Kalide, Energieumwandlung in Kraft- und Arbeitsmaschinen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechcore.laws.timed import Table
from mechcore.records import dataclass


class Cycle(Protocol):
    """Any indicator diagram."""

    @property
    def stroke(self) -> float:
        """From top to bottom dead centre [m]."""
        ...

    @property
    def strokes(self) -> int:
        """Strokes of a cycle: 2 or 4."""
        ...

    def pressure(self, x: Real, outward: Flags, firing: Flags) -> Real:
        """Absolute pressure [Pa] at displacements x (...) [m]; ``outward``: away from the head; ``firing``: compression and
        expansion, else exhaust and intake (four strokes only)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Compressor:
    """Compressor with clearance: compression p V^n from ``suction`` to ``delivery``, delivery, re-expansion, suction."""

    stroke: float
    suction: float  # [Pa]
    delivery: float  # [Pa]
    exponent: float = 1.3
    clearance: float = 0.05  # volume at top dead centre over the swept volume
    strokes: int = 2

    def pressure(self, x: Real, outward: Flags, firing: Flags) -> Real:
        v = np.maximum(self.clearance + x / self.stroke, 0.0)  # over the swept volume; rounding may make it negative
        with np.errstate(divide="ignore", over="ignore"):  # without clearance v is zero at the dead centre: delivery there
            squeezed = self.suction * ((self.clearance + 1.0) / v) ** self.exponent
            left = (self.clearance / v) ** self.exponent if self.clearance else np.zeros(np.shape(v))
        expanded = np.maximum(self.delivery * left, self.suction)
        return np.where(outward, expanded, np.minimum(squeezed, self.delivery))

    def part(self, x: Real, outward: Flags, firing: Flags) -> Index:
        """Whether a valve is open (...): 1, else 0."""
        p = self.pressure(x, outward, firing)
        return np.where(outward, p <= self.suction, p >= self.delivery).astype(int)

    @property
    def work(self) -> float:
        """Work that the gas does in a cycle, over the piston's area [J/m^2]: the negative of the compressor's work.

        -n/(n-1) p1 (V1 - V4) ((p2/p1)^((n-1)/n) - 1), and its limit for n = 1.
        """
        n, ratio = self.exponent, self.delivery / self.suction
        v1, v4 = self.clearance + 1.0, self.clearance * ratio ** (1.0 / n)
        gain = np.log(ratio) if n == 1.0 else n / (n - 1.0) * (ratio ** ((n - 1.0) / n) - 1.0)
        return float(-self.suction * (v1 - v4) * gain * self.stroke)


@dataclass(frozen=True, kw_only=True)
class FourStroke:
    """Four-stroke engine (Seiliger's cycle): intake, compression p V^n, heat at constant volume (pressure times ``rise``) and at
    constant pressure (volume times ``cutoff``), expansion p V^m, exhaust. cutoff = 1 is Otto's cycle, rise = 1 Diesel's."""

    stroke: float
    intake: float = 101325.0  # [Pa]
    exhaust: float = 101325.0  # [Pa]
    ratio: float  # compression ratio: greatest over least volume
    exponent: float = 1.35  # n
    expansion: float | None = None  # m; None: n
    rise: float = 1.0
    cutoff: float = 1.0
    strokes: int = 4

    def _volume(self, x: Real) -> Real:
        """Volume over the clearance."""
        return 1.0 + (self.ratio - 1.0) * x / self.stroke

    @property
    def highest(self) -> float:
        """Highest pressure [Pa]."""
        highest: float = self.intake * self.ratio**self.exponent * self.rise
        return highest

    def pressure(self, x: Real, outward: Flags, firing: Flags) -> Real:
        v = self._volume(x)
        m = self.exponent if self.expansion is None else self.expansion
        squeezed = self.intake * (self.ratio / v) ** self.exponent
        fired = self.highest * np.minimum(1.0, self.cutoff / v) ** m
        return np.where(firing, np.where(outward, fired, squeezed), np.where(outward, self.intake, self.exhaust))

    def part(self, x: Real, outward: Flags, firing: Flags) -> Index:
        """Whether heat is still supplied at constant pressure (...): 1, else 0."""
        return 1 * np.less(self._volume(x), self.cutoff)

    @property
    def work(self) -> float:
        """Work of the gas in a cycle of four strokes, over the piston's area [J/m^2]."""

        def polytrope(p: float, v: float, w: float, n: float) -> float:  # integral of p dV from v to w, from pressure p at v
            return p * v * math.log(w / v) if n == 1.0 else p * v / (1.0 - n) * ((w / v) ** (1.0 - n) - 1.0)

        m = self.exponent if self.expansion is None else self.expansion
        heat = self.highest * (self.cutoff - 1.0)
        out = polytrope(self.highest, self.cutoff, self.ratio, m) + self.intake * (self.ratio - 1.0)
        back = polytrope(self.intake, self.ratio, 1.0, self.exponent) - self.exhaust * (self.ratio - 1.0)
        return float((heat + out + back) * self.stroke / (self.ratio - 1.0))


@dataclass(frozen=True, kw_only=True)
class IndicatorDiagram:
    """A measured diagram of two strokes: pressures [Pa] over the displacement [m], for motion away from the head and towards it."""

    stroke: float
    outward: Callable[[Real], Real]  # a `Table` for example
    inward: Callable[[Real], Real]
    strokes: int = 2

    def pressure(self, x: Real, outward: Flags, firing: Flags) -> Real:
        return np.where(outward, self.outward(x), self.inward(x))

    def part(self, x: Real, outward: Flags, firing: Flags) -> Index:
        """Between which of its points the diagram is (...)."""
        return np.where(outward, _part(self.outward, x), _part(self.inward, x))


@dataclass(frozen=True, kw_only=True)
class FourStrokeDiagram:
    """A measured diagram of four strokes: pressures [Pa] over the displacement [m], stroke by stroke."""

    stroke: float
    power: Callable[[Real], Real]  # a `Table` for example
    exhaust: Callable[[Real], Real]
    intake: Callable[[Real], Real]
    compression: Callable[[Real], Real]
    strokes: int = 4

    def pressure(self, x: Real, outward: Flags, firing: Flags) -> Real:
        fired = np.where(outward, self.power(x), self.compression(x))
        return np.where(firing, fired, np.where(outward, self.intake(x), self.exhaust(x)))

    def part(self, x: Real, outward: Flags, firing: Flags) -> Index:
        """Between which of its points the diagram is (...)."""
        fired = np.where(outward, _part(self.power, x), _part(self.compression, x))
        return np.where(firing, fired, np.where(outward, _part(self.intake, x), _part(self.exhaust, x)))


def _part(branch: Callable[[Real], Real], x: Real) -> Index:
    return branch.part(x) if isinstance(branch, Table) else np.zeros(np.shape(x), int)
