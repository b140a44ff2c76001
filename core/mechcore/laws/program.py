"""Motion programs: rises, dwells and returns over a cycle of a master angle, and drives that follow one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.errors import Fault, MechanismError
from mechcore.laws.catalogue import rise
from mechcore.laws.curve import MotionCurve, Piece
from mechcore.laws.factors import jumps
from mechcore.laws.timed import ConstantSpeed, Law, polynomial_through

Triple = tuple[Real, Real, Real]


@dataclass(frozen=True)
class Segment:
    """One segment of a program over the range ``over`` (> 0, radians of the master, or any unit used throughout).

    ``to``: the value at its end; ``None`` is a dwell. A sequence (value, velocity, acceleration, jerk) prescribes derivatives
    with respect to the master too and needs ``law="polynomial"``, which joins the states at both ends by the least degree.
    ``law``: a name of the catalogue or any curve 0 -> 1; ``mirrored``: run as 1 - s(1 - x), acceleration and
    deceleration exchanged. ``curve``: instead of both, a curve whose own change of value is added, stretched to ``over``
    along the angle only.
    """

    over: float
    to: float | Sequence[float] | None = None
    law: str | MotionCurve = "cycloidal"
    mirrored: bool = False
    curve: MotionCurve | None = None


def _state(to: float | Sequence[float]) -> tuple[float, ...]:
    return tuple(map(float, to)) if isinstance(to, Sequence) else (float(to),)


def program(
    segments: Sequence[Segment], start: float | Sequence[float] = 0.0, at: float = 0.0, repeats: bool = True
) -> MotionCurve:
    """Segments one after the other, from the value (or state) ``start`` at the master angle ``at`` on.

    ``repeats``: continued periodically over the total range; what a cycle gains is added to the next one. Jumps between
    segments are allowed and found by ``jumps``.
    """
    if not segments:
        raise MechanismError(Fault("program", "it has no segments.", "Give at least one."))
    state = _state(start)
    pieces: list[Piece] = []
    for k, segment in enumerate(segments):
        path = f"program[{k}]"
        if not (np.isfinite(segment.over) and segment.over > 0.0):
            raise MechanismError(Fault(f"{path}.over", f"{segment.over:g} is no range.", "Give a positive one."))
        value = state[0]
        if segment.curve is not None:
            part = segment.curve.scaled(0.0, segment.over, value, 1.0)
            state = (value + segment.curve.advance,)
        elif segment.to is None:
            part = MotionCurve((Piece(segment.over, np.array([value]), np.zeros((0, 3))),))
            state = (value,)
        else:
            end = _state(segment.to)
            if segment.law == "polynomial":
                order = max(len(state), len(end), 3)  # velocity and acceleration zero unless said otherwise
                a, b = (s + (0.0,) * (order - len(s)) for s in (state, end))
                part = MotionCurve.of((0.0, segment.over), [polynomial_through(0.0, a, segment.over, b)])
            elif len(end) > 1:
                raise MechanismError(
                    Fault(f"{path}.to", f"{list(end)}: a velocity at its end.", "Only law = 'polynomial' takes derivatives.")
                )
            else:
                shape = rise(segment.law) if isinstance(segment.law, str) else segment.law
                if abs(shape.advance) < 1e-12:
                    raise MechanismError(Fault(f"{path}.law", "the curve returns to its start.", "Give it as curve = ..."))
                shape = shape.mirrored() if segment.mirrored else shape
                part = shape.scaled(0.0, segment.over, value, (end[0] - value) / shape.advance)
            state = end
        pieces += part.pieces
    return MotionCurve(tuple(pieces), at, repeats)


def constant_breadth(half: MotionCurve) -> MotionCurve:
    """A program over half a turn, completed so that s(x) + s(x + half a turn) is constant: a cam for a yoke with parallel faces.

    The second half is the first one negated; the sum is the value at the start plus that at the end of ``half``.
    """
    begin, turn = float(half.pieces[0].at(0.0, 0)[0]), half.advance
    second = tuple(p.scaled(1.0, -1.0).raised(2.0 * begin + turn) for p in half.pieces)
    return MotionCurve((*half.pieces, *second), half.start, True)


@dataclass(frozen=True, eq=False)
class Follow:
    """A drive whose coordinate is a program of the master angle, which itself is a law of time: several axes on one master.

    Called with times -> position, velocity, acceleration by the chain rule. At a time where the acceleration jumps the value
    belongs to the piece that ends there, as for all laws of time.
    """

    curve: MotionCurve
    master: Law
    phase: float = 0.0

    @cached_property
    def duration(self) -> float:
        """Time of one cycle of the master, of the program where the master's is a plain speed."""
        if isinstance(self.master, ConstantSpeed):
            return float(self.curve.length / abs(self.master.speed))
        return self.master.duration

    @cached_property
    def advance(self) -> float:
        end, begin = self(np.array([self.duration, 0.0]))[0]
        return float(end - begin)

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Times within a cycle at which the acceleration may jump: the master's own and those of the program's knots."""
        angles = [j.angle for j in jumps(self.curve, (1, 2), ends=False)]
        own = list(self.master.breaks)
        if not angles:
            return tuple(own)
        grid = np.unique(np.concatenate([np.linspace(0.0, self.duration, 2049), own]))
        theta = self.master(grid)[0] + self.phase
        for angle in angles:
            if self.curve.repeats:
                low, high = theta.min() - angle, theta.max() - angle
                turns = np.arange(np.ceil(low / self.curve.length), np.floor(high / self.curve.length) + 1.0)
                targets = angle + turns * self.curve.length
            else:
                targets = np.array([angle])
            for target in targets:
                own += self._crossings(grid, theta - target, target)
        span = self.duration
        return tuple(sorted({max(t, 0.0) for t in own if t < span * (1.0 - 1e-12)}))  # 0: between two cycles

    def shock(self, t: float) -> str:
        """What jumps at this time, in words; empty where nothing does."""
        theta = self.master(np.array([t]))[0] + self.phase
        left, right = self.curve(theta, 2, "left")[:, 0], self.curve(theta, 2, "right")[:, 0]
        near = min(self.curve.length, 1e-6)
        around = self.curve(theta + np.array([-near, near]), 2)  # a root is only as exact as the master's law allows
        for order, what in ((1, "the velocity jumps, infinite acceleration"), (2, "the acceleration jumps, infinite jerk")):
            step = max(abs(right[order] - left[order]), abs(around[order, 1] - around[order, 0]))
            if step > 1e-3 * abs(self._sizes[order]):
                return what
        return ""

    @cached_property
    def _sizes(self) -> Real:
        knots = self.curve.knots
        return np.abs(self.curve(np.linspace(knots[0], knots[-1], 257), 2)).max(axis=1)

    def _crossings(self, grid: Real, gap: Real, target: float) -> list[float]:
        from scipy.optimize import brentq

        def f(t: float) -> float:
            return float(self.master(np.array([t]))[0][0] + self.phase - target)

        sign = np.sign(gap)
        found = [float(t) for t in grid[sign == 0.0]]
        for k in np.flatnonzero(sign[:-1] * sign[1:] < 0.0):
            found.append(float(brentq(f, grid[k], grid[k + 1], xtol=1e-15, rtol=1e-15)))
        return found

    def __call__(self, t: ArrayLike) -> Triple:
        theta, w, eps = self.master(t)
        s = self.curve(np.asarray(theta) + self.phase, 2, "left")
        if np.any(w < 0.0):
            s = np.where(w < 0.0, self.curve(np.asarray(theta) + self.phase, 2, "right"), s)
        first = np.asarray(t, float) == 0.0
        if np.any(first):  # the run starts with its first piece
            begin = self.curve(np.asarray(theta) + self.phase, 2, "right")
            s = np.where(first & (w >= 0.0), begin, s)
            if self.curve.repeats:
                s = np.where(first & (w < 0.0), self.curve(np.asarray(theta) + self.phase, 2, "left"), s)
        return s[0], s[1] * w, s[2] * w * w + s[1] * eps
