"""Motion programs: rises, dwells and returns over a cycle of a master angle, and drives that follow one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.errors import Fault, MechanismError
from mechcore.laws.catalogue import rise
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import VELOCITY_JUMP, jumps
from mechcore.laws.segment_laws import BoundaryPolynomial, BoundaryState, Dwell, NormalisedLaw, SegmentLaw, Spline
from mechcore.laws.timed import JUMPS, ConstantSpeed, Law, Piecewise, Triple
from mechcore.records import dataclass

SAME_PLACE = 1e-7  # error of the angle at a knot, over the program's length: its time is only as exact as the master's law


@dataclass(frozen=True)
class Segment:
    """One segment of a program over the range ``over`` (> 0, radians of the master, or any unit used throughout).

    ``to``: the value at its end, or its state (value, velocity, acceleration, jerk) with respect to the master, ``None`` is free;
    velocity and acceleration are zero by default. Without ``to`` the law determines the end; without a law, too, it is a dwell.
    ``law``: a name of the catalogue, "polynomial", a curve 0 -> 1, or any `SegmentLaw`; default cycloidal, to a state polynomial.
    ``mirrored``: a named law or a curve is used as 1 - s(1 - x), acceleration and deceleration exchanged.
    """

    over: float
    to: float | Sequence[float | None] | None = None
    law: str | MotionCurve | SegmentLaw | None = None
    mirrored: bool = False

    def made(self) -> SegmentLaw:
        """The law of the segment. Raises ``MechanismError`` where the catalogue has none of that name."""
        law = self.law
        if law is None:
            law = "polynomial" if isinstance(self.to, Sequence) else "cycloidal" if self.to is not None else Dwell()
        if self.to is None and isinstance(law, str | MotionCurve):
            return Dwell()
        if law == "polynomial":
            return BoundaryPolynomial()
        if isinstance(law, str | MotionCurve):
            return NormalisedLaw(rise(law) if isinstance(law, str) else law, self.mirrored)
        return law


def _state(to: float | Sequence[float | None]) -> BoundaryState:
    given = tuple(to) if isinstance(to, Sequence) else (to,)
    return given + (0.0,) * (3 - len(given))


def program(
    segments: Sequence[Segment], start: float | Sequence[float | None] = 0.0, at: float = 0.0, repeats: bool = True
) -> MotionCurve:
    """The curve of segments one after the other, from the value (or state) ``start`` at the master angle ``at`` on.

    ``repeats``: continued periodically over the total range; the advance of a cycle is added to the next one. Jumps between
    segments are allowed and found by ``jumps``. Free entries of the states follow from neighbouring laws of fixed shape, and
    between polynomials and splines from the least integral of the squared jerk: quintics then join with continuous third and
    fourth derivatives.
    """
    if not segments:
        raise MechanismError(Fault("program", "it has no segments.", "Give at least one."))
    states: list[BoundaryState] = [_state(start)]
    laws: list[SegmentLaw] = []
    for k, segment in enumerate(segments):
        path = f"program[{k}]"
        if not (np.isfinite(segment.over) and segment.over > 0.0):
            raise MechanismError(Fault(f"{path}.over", f"{segment.over:g} is no range.", "Give a positive one."))
        laws.append(law := segment.made())
        before = states[-1][0]
        own = None if before is None else law.end(before)
        if segment.to is None and own is None:
            raise MechanismError(Fault(f"{path}.to", "the law does not say where the segment ends.", "Give to = ..."))
        states.append(_state(own or 0.0) if segment.to is None else _state(segment.to))
        if not law.meets and isinstance(segment.to, Sequence) and any(v is not None for v in segment.to[1:]):
            raise MechanismError(
                Fault(f"{path}.to", f"{list(segment.to)}: a velocity at its end.", "Only law = 'polynomial' takes derivatives.")
            )
    overs = [segment.over for segment in segments]
    curves = _filled(laws, states, overs, repeats)
    return MotionCurve(tuple(p for c in curves for p in c.pieces), at, repeats)


def _filled(laws: list[SegmentLaw], states: list[BoundaryState], overs: list[float], repeats: bool) -> list[MotionCurve]:
    """The curves of the segments. Free entries of ``states`` are found first and written to it."""
    n = len(laws)
    curves: dict[int, MotionCurve] = {}

    def known(k: int, order: int, value: float) -> None:
        states[k] = (*states[k][:order], value, *states[k][order + 1 :])

    def pass_on() -> None:
        """Fill free entries from finished curves beside them and from the other end of the cycle."""
        for k in range(n + 1):
            for order, value in enumerate(states[k]):
                sides = [(curves.get(k - 1), -1), (curves.get(k), 0)]
                if repeats and order:
                    sides += [(curves.get(n - 1), -1)] * (k == 0) + [(curves.get(0), 0)] * (k == n)
                for curve, end in sides:
                    if value is None and states[k][order] is None and curve is not None:
                        piece = curve.pieces[end]
                        known(k, order, float(piece.at(piece.length if end else 0.0, order)[order]))
                other = states[n if k == 0 else 0] if k in (0, n) and repeats and order else ()
                if states[k][order] is None and len(other) > order and (there := other[order]) is not None:
                    known(k, order, there)

    def join(k: int) -> None:
        curves[k] = _joined(laws[k], states[k], states[k + 1], overs[k], k)

    for k, law in enumerate(laws):
        if not law.meets:
            join(k)
            pass_on()
    pass_on()
    unknown = [
        (k, order)
        for k in range(n + 1)
        for order, value in enumerate(states[k])
        if value is None and any(0 <= i < n and isinstance(laws[i], BoundaryPolynomial | Spline) for i in (k - 1, k))
    ]
    for place, value in zip(unknown, _least_jerk(laws, states, overs, unknown, repeats), strict=True):
        known(*place, value)
    for k in range(n):
        if k not in curves:
            join(k)
            pass_on()
    return [curves[k] for k in range(n)]


def _joined(law: SegmentLaw, start: BoundaryState, end: BoundaryState, over: float, k: int) -> MotionCurve:
    """The curve of segment ``k``, whose faults name it."""
    try:
        return law.join(start, end, over)
    except MechanismError as error:
        raise MechanismError([replace(f, path=f"program[{k}].{f.path}") for f in error.faults]) from None


def _least_jerk(
    laws: list[SegmentLaw], states: list[BoundaryState], overs: list[float], unknown: list[tuple[int, int]], repeats: bool
) -> list[float]:
    """Values of the unknown entries (knot, order) of states for the least integral of the squared jerk."""
    if not unknown:
        return []
    n = len(laws)
    shared = [(0, o) if repeats and k == n and o and (0, o) in unknown else (k, o) for k, o in unknown]
    columns = {place: c for c, place in enumerate(dict.fromkeys(shared))}
    nodes, weights = np.polynomial.legendre.leggauss(12)  # exact up to degree 23
    rows: list[Real] = []
    for k, law in enumerate(laws):
        if not isinstance(law, BoundaryPolynomial | Spline):
            continue
        h = overs[k]
        mine = [(i, p) for i, p in enumerate(unknown) if p[0] in (k, k + 1)]
        zero = [[0.0 if v is None else v for v in states[j]] for j in (k, k + 1)]

        def jerk(ends: list[list[float]], law: SegmentLaw = law, h: float = h, k: int = k) -> Real:
            curve = _joined(law, tuple(ends[0]), tuple(ends[1]), h, k)
            out = []
            for p in curve.pieces:
                value = np.empty((1, nodes.size))
                p.fill(0.5 * p.length * (nodes + 1.0), value, 3)
                out.append(value[0] * np.sqrt(0.5 * p.length * weights))
            return np.concatenate(out)

        base = jerk(zero)
        block = np.zeros((base.size, len(columns) + 1))
        block[:, -1] = -base
        for i, (j, order) in mine:
            unit = [row.copy() for row in zero]
            size = h ** (1 - order)
            unit[j - k][order] += size
            block[:, columns[shared[i]]] += (jerk(unit) - base) / size
        rows.append(block)
    table = np.vstack(rows)
    scale = np.abs(table[:, :-1]).max(axis=0)
    scale[scale == 0.0] = 1.0
    solved = np.linalg.lstsq(table[:, :-1] / scale, table[:, -1], rcond=1e-13)[0] / scale
    return [float(solved[columns[place]]) for place in shared]


CLOCK = ConstantSpeed(0.0, 1.0)
"""The master of a program over time: its angle is the time [s]."""


def over_time(curve: MotionCurve) -> Law:
    """A program as a law of time: its master angle is the time [s]. After its end it repeats, from the value reached."""
    if any(len(p.waves) for p in curve.pieces):
        return CurveOverMaster(curve.repeating(), CLOCK)
    knots, polys = curve.knots - curve.start, [tuple(map(float, p.poly)) for p in curve.pieces]
    return Piecewise(knots=tuple(map(float, knots)), coefficients=tuple(polys), advance=curve.advance)


@dataclass(frozen=True, eq=False)
class CurveOverMaster:
    """A drive whose coordinate is a program of the master angle, which itself is a law of time: several axes on one master.

    Times -> position, velocity, acceleration by the chain rule. Where the acceleration jumps, the value belongs to the piece that
    ends there, as for all laws of time.
    """

    curve: MotionCurve
    master: Law
    phase: float = 0.0

    @cached_property
    def duration(self) -> float:
        """Time of one cycle [s]: of the master, or of the program where the master has constant speed."""
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
        """The jump at this time in words; empty where neither velocity nor acceleration jumps."""
        curve, theta = self.curve, float(self.master(np.array([t]))[0][0]) + self.phase
        steps = [*jumps(curve, (1,), VELOCITY_JUMP, ends=False), *jumps(curve, (2,), ends=False)]
        off = np.array([(theta - step.angle) / curve.length for step in steps])
        here = np.abs(off - np.round(off)) < SAME_PLACE
        return JUMPS[min(step.order for step, near in zip(steps, here, strict=True) if near) - 1] if here.any() else ""

    def _crossings(self, grid: Real, distance: Real, target: float) -> list[float]:
        from scipy.optimize import brentq

        def f(t: float) -> float:
            return float(self.master(np.array([t]))[0][0] + self.phase - target)

        sign = np.sign(distance)
        times = [float(t) for t in grid[sign == 0.0]]
        for k in np.flatnonzero(sign[:-1] * sign[1:] < 0.0):
            times.append(float(brentq(f, grid[k], grid[k + 1], xtol=1e-15, rtol=1e-15)))
        return times

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
