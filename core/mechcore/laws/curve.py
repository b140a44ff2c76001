"""``MotionCurve``: a coordinate as a piecewise analytic function of a master angle, with exact derivatives of any order.

On every piece the value is a polynomial plus sines and cosines of the distance from the start of the piece. This class contains
every law of the literature, splines, and the integrals and mirror images of all of them, so that one evaluation, one search
for extremes and one list of jumps serve them all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from math import comb, factorial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Index, Real, numbers
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass

Side = Literal["left", "right"]

_MANY = 24  # pieces: more are evaluated from a table instead of one by one


@dataclass(frozen=True, eq=False)
class Piece:
    """``sum_j poly[j] u^j + sum_m (waves[m, 1] sin(w_m u) + waves[m, 2] cos(w_m u))`` with ``w_m = waves[m, 0]`` on [0, length]."""

    length: float
    poly: Real
    waves: Real  # (m, 3): circular frequency, amplitude of the sine, amplitude of the cosine

    @cached_property
    def _derivatives(self) -> list[list[float]]:
        out = [[float(c) for c in self.poly]]
        for _ in range(8):
            out.append([j * c for j, c in enumerate(out[-1])][1:] or [0.0])
        return out

    def fill(self, u: Real, out: Real, first: int = 0) -> None:
        """Distances (n) from the start of the piece -> ``out`` (k, n): derivatives ``first``, ``first + 1``, ..."""
        for k in range(len(out)):
            c = self._derivatives[first + k]
            row = out[k]
            row[...] = c[-1]
            for cj in c[-2::-1]:
                np.multiply(row, u, out=row)
                row += cj
        for w, a, b in self.waves:
            x = w * u
            s, c_ = np.sin(x), np.cos(x)
            even, odd = a * s + b * c_, a * c_ - b * s  # the value and its derivative, up to factors w and signs
            for k in range(len(out)):
                d = first + k
                factor = w**d * (-1.0 if d % 4 in (2, 3) else 1.0)
                out[k] += factor * (odd if d % 2 else even)

    def at(self, u: float, order: int) -> Real:
        """Derivatives 0 ... ``order`` at one distance, (order + 1)."""
        out = np.zeros((order + 1, 1))
        self.fill(np.array([u]), out)
        return out[:, 0]

    def reversed(self) -> Piece:
        """The same piece in reverse: ``u -> length - u``."""
        degree = len(self.poly) - 1
        length = self.length
        p = np.zeros(degree + 1)
        for j in range(degree + 1):  # Taylor coefficients about the far end
            p[j] = (-1) ** j * sum(self.poly[i] * (factorial(i) // (factorial(j) * factorial(i - j))) * length ** (i - j)
                                   for i in range(j, degree + 1))  # fmt: skip
        waves = self.waves.copy()
        for row, (w, a, b) in zip(waves, self.waves, strict=True):
            s, c = np.sin(w * length), np.cos(w * length)
            row[1:] = b * s - a * c, a * s + b * c
        return Piece(length, p, waves)

    def beginning(self, later: float, length: float) -> Piece:
        """The same function over another ``length``, starting at the distance ``later`` (negative: before the piece)."""
        degree = len(self.poly) - 1
        p = np.zeros(degree + 1)
        for j in range(degree + 1):  # Taylor coefficients about the new start
            p[j] = sum(self.poly[i] * comb(i, j) * later ** (i - j) for i in range(j, degree + 1))
        waves = self.waves.copy()
        for row, (w, a, b) in zip(waves, self.waves, strict=True):
            s, c = np.sin(w * later), np.cos(w * later)
            row[1:] = a * c - b * s, a * s + b * c
        return Piece(length, p, waves)

    def scaled(self, dx: float, dy: float) -> Piece:
        """The piece scaled by ``dx`` along the angle and ``dy`` along the coordinate."""
        p = dy * self.poly / dx ** np.arange(len(self.poly))
        waves = self.waves * np.array([1.0 / dx, dy, dy])
        return Piece(self.length * dx, p, waves)

    def raised(self, dy: float) -> Piece:
        p = self.poly.copy()
        p[0] += dy
        return Piece(self.length, p, self.waves)

    def integrated(self, value: float) -> Piece:
        """The antiderivative that starts at ``value``."""
        p = np.concatenate([[0.0], self.poly / np.arange(1.0, len(self.poly) + 1.0)])
        waves = self.waves.copy()
        if len(waves):
            waves[:, 1] = self.waves[:, 2] / self.waves[:, 0]
            waves[:, 2] = -self.waves[:, 1] / self.waves[:, 0]
        p[0] = value - waves[:, 2].sum()
        return Piece(self.length, p, waves)

    def differentiated(self) -> Piece:
        p = (self.poly * np.arange(len(self.poly)))[1:]
        waves = self.waves.copy()
        if len(waves):
            waves[:, 1] = -self.waves[:, 2] * self.waves[:, 0]
            waves[:, 2] = self.waves[:, 1] * self.waves[:, 0]
        return Piece(self.length, p if len(p) else np.zeros(1), waves)


@dataclass(frozen=True, eq=False)
class MotionCurve:
    """Pieces joined end to end from ``start`` on; ``repeats``: continued periodically, each cycle adding ``advance``.

    ``extended``: pieces are continued beyond their ends, where they need not join, for derivatives by parameters that move knots.
    """

    pieces: tuple[Piece, ...]
    start: float = 0.0
    repeats: bool = False
    extended: bool = False

    def __post_init__(self) -> None:
        lengths = np.array([p.length for p in self.pieces])
        if not len(lengths) or not np.all(np.isfinite(lengths)) or np.any(lengths <= 0.0):
            raise MechanismError(
                Fault("law", f"pieces of the lengths {lengths.tolist()}: each must be positive.", "Leave out pieces of no length.")
            )

    # -- making -------------------------------------------------------------------------------------------------------

    @classmethod
    def of(
        cls,
        knots: Sequence[float],
        polys: Iterable[ArrayLike],
        waves: Iterable[ArrayLike] | None = None,
        repeats: bool = False,
    ) -> MotionCurve:
        """The curve of knots (n + 1), polynomial coefficients of each piece, ascending in the distance from its start, and waves
        (m, 3)."""
        lengths = np.diff(np.asarray(knots, float))
        tables = [numbers(p) for p in polys]
        rows = [np.zeros((0, 3))] * len(tables) if waves is None else [np.asarray(w, float).reshape(-1, 3) for w in waves]
        return cls(
            tuple(Piece(float(d), p, w) for d, p, w in zip(lengths, tables, rows, strict=True)),
            float(knots[0]),
            repeats,
        )

    # -- properties ---------------------------------------------------------------------------------------------------

    @cached_property
    def knots(self) -> Real:
        """Ends of the pieces (n + 1)."""
        return self.start + np.concatenate([[0.0], np.cumsum(self.lengths)])

    @cached_property
    def lengths(self) -> Real:
        """Lengths of the pieces (n)."""
        return np.array([p.length for p in self.pieces])

    @cached_property
    def _polynomial(self) -> bool:
        """Whether no piece has waves."""
        return not any(len(p.waves) for p in self.pieces)

    @property
    def length(self) -> float:
        return float(self.knots[-1] - self.knots[0])

    @property
    def end(self) -> float:
        return float(self.knots[-1])

    @cached_property
    def advance(self) -> float:
        """Value at the end minus value at the start."""
        return float(self.pieces[-1].at(self.pieces[-1].length, 0)[0] - self.pieces[0].at(0.0, 0)[0])

    # -- values -------------------------------------------------------------------------------------------------------

    def __call__(self, x: ArrayLike, order: int = 2, side: Side = "right") -> Real:
        """Angles (...) -> value and derivatives 0 ... ``order``, shape (order + 1, ...).

        ``side``: which one-sided value is taken at the knots. A curve that does not repeat is continued by its end pieces.
        """
        written: Callable[[Sequence[float], int], Real] | None = getattr(x, "on_curve", None)
        if written is not None and side == "right":  # of a program in C
            return written(self.numbers, order)
        x = np.asarray(x, float)
        flat = x.ravel()
        out = np.empty((order + 1, flat.size))
        if not flat.size:
            return out.reshape(order + 1, *x.shape)
        knots = self.knots
        cycle: Real | None = None
        low, high = flat.min(), flat.max()
        if self.repeats and (low < knots[0] or high > knots[-1] or (low == knots[0] if side == "left" else high == knots[-1])):
            turns = (flat - knots[0]) / self.length
            cycle = np.floor(turns) if side == "right" else np.ceil(turns) - 1.0
            flat = np.clip(flat - cycle * self.length, knots[0], knots[-1])
        if len(self.pieces) > _MANY and self._polynomial:
            self._gather(flat, out, side)
        elif flat.size == 1 or np.all(flat[1:] >= flat[:-1]):
            self._visit(flat, out, side)
        else:
            rank = np.argsort(flat, kind="stable")
            ordered = np.empty_like(out)
            self._visit(flat[rank], ordered, side)
            out[:, rank] = ordered
        if cycle is not None and self.advance != 0.0:
            out[0] += cycle * self.advance
        return out.reshape(order + 1, *x.shape)

    def _visit(self, x: Real, out: Real, side: Side) -> None:
        """Fill ``out`` at ordered angles: each piece its own slice."""
        inner = self.knots[1:-1]
        cuts = np.concatenate([[0], np.searchsorted(x, inner, side="left" if side == "right" else "right"), [x.size]])
        for piece, first, last, x0 in zip(self.pieces, cuts[:-1], cuts[1:], self.knots, strict=False):
            if last > first:
                piece.fill(x[first:last] - x0, out[:, first:last])

    def _gather(self, x: Real, out: Real, side: Side) -> None:
        """Fill ``out`` for many polynomial pieces, with the coefficients of each angle's piece from one table."""
        k = np.clip(np.searchsorted(self.knots, x, side=side) - 1, 0, len(self.pieces) - 1)
        self._fill(k, x - self.knots[k], out)

    def on_pieces(self, k: Index, x: Real, order: int) -> Real:
        """Value and derivatives (order + 1, n) at angles (n), each on the piece of index ``k`` (n), continued beyond its ends."""
        out = np.empty((order + 1, x.size))
        self._fill(k, x - self.knots[k], out)
        return out

    def _fill(self, k: Index, u: Real, out: Real) -> None:
        """Fill ``out`` at distances ``u`` (n) from the starts of pieces ``k`` (n)."""
        if not self._polynomial:
            for j in np.unique(k):
                own = np.flatnonzero(k == j)
                filled = np.empty((len(out), own.size))
                self.pieces[j].fill(u[own], filled)
                out[:, own] = filled
            return
        table = self._table[:, k]
        for d in range(len(out)):
            row = np.zeros_like(u)
            for j in range(len(table) - 1, d - 1, -1):
                row *= u
                row += (factorial(j) // factorial(j - d)) * table[j]
            out[d] = row

    @cached_property
    def _table(self) -> Real:
        table = np.zeros((max(len(p.poly) for p in self.pieces), len(self.pieces)))
        for k, p in enumerate(self.pieces):
            table[: len(p.poly), k] = p.poly
        return table

    @cached_property
    def numbers(self) -> tuple[float, ...]:
        """All numbers of the curve in one tuple, in the layout that `curve` of the programs in C takes."""
        n, knots, rows = len(self.pieces), self.knots, [[len(p.poly), *p.poly, len(p.waves), *p.waves.ravel()] for p in self.pieces]
        places = np.cumsum([5 + 2 * n, *map(len, rows[:-1])])
        numbers = n, self.start, self.length * self.repeats, self.advance, *knots, *places, *(x for row in rows for x in row)
        return tuple(map(float, numbers))

    def limits(self, order: int = 4) -> tuple[Real, Real]:
        """One-sided values at the knots: left (n, order + 1) at the ends of the pieces, right (n, order + 1) at their starts."""
        every = np.arange(len(self.pieces))
        left, right = np.empty((2, order + 1, len(every)))
        self._fill(every, self.lengths, left)
        self._fill(every, np.zeros(len(every)), right)
        return left.T, right.T

    # -- new curves ---------------------------------------------------------------------------------------------------

    def scaled(self, start: float, length: float, value: float, stroke: float) -> MotionCurve:
        """The curve scaled to begin at ``start`` with ``value`` and to have the ``length``, its coordinate times ``stroke``."""
        dx = length / self.length
        y0 = float(self.pieces[0].at(0.0, 0)[0])
        pieces = tuple(p.scaled(dx, stroke).raised(value - stroke * y0) for p in self.pieces)
        return MotionCurve(pieces, start, self.repeats)

    def reversed(self) -> MotionCurve:
        """The curve in reverse over the same angles."""
        return MotionCurve(tuple(p.reversed() for p in self.pieces[::-1]), self.start, self.repeats)

    def mirrored(self) -> MotionCurve:
        """A rise 0 -> 1 rotated by half a turn: ``1 - s(1 - x)``, the same law with acceleration and deceleration exchanged."""
        y = self.advance
        pieces = tuple(p.scaled(1.0, -1.0).raised(y) for p in self.reversed().pieces)
        return MotionCurve(pieces, self.start, self.repeats)

    def integrated(self, value: float = 0.0) -> MotionCurve:
        """The continuous antiderivative that starts at ``value``."""
        pieces = []
        for p in self.pieces:
            pieces.append(p.integrated(value))
            value = float(pieces[-1].at(p.length, 0)[0])
        return MotionCurve(tuple(pieces), self.start, self.repeats)

    def differentiated(self) -> MotionCurve:
        return MotionCurve(tuple(p.differentiated() for p in self.pieces), self.start, self.repeats)

    def raised(self, dy: float) -> MotionCurve:
        return replace(self, pieces=tuple(p.raised(dy) for p in self.pieces))

    def then(self, *others: MotionCurve) -> MotionCurve:
        """This curve and others one after the other, with unchanged values."""
        return MotionCurve(tuple(p for c in (self, *others) for p in c.pieces), self.start)

    def repeating(self) -> MotionCurve:
        return MotionCurve(self.pieces, self.start, True)
