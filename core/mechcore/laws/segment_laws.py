"""Laws of one segment of a motion program: each makes the curve over the segment's range from the states at its two ends.

A state is (value, velocity, acceleration, jerk ...) with respect to the master, as far as it is prescribed; ``None`` is free.

Rises of least peak acceleration, jerk or contact force for given conditions come from linear programmes. The highest derivative is
constant over equal steps. The states at the steps follow exactly, so that a limit on the derivative below it holds everywhere, not
only at the steps. The result is a ``MotionCurve`` of polynomial pieces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from math import factorial
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.errors import Fault, MechanismError
from mechcore.laws.boundary_conditions import BoundaryCondition, from_acceleration, polynomial_law, spline_law
from mechcore.laws.curve import MotionCurve, Piece
from mechcore.laws.factors import peak
from mechcore.records import dataclass

Goal = Literal["velocity", "acceleration", "jerk", "snap", "force"]
_SHORT = 1e-9  # part of a piece that a change of sign by rounding may cut off
_VANISHING = 1e-9  # factor of a part of a given acceleration: a smaller one leaves only rounding
_LOPSIDED = 1e12  # condition number of two equations for two sizes: beyond it they are dependent
_ORDER = {"velocity": 1, "acceleration": 2, "jerk": 3, "snap": 4}


@dataclass(frozen=True, eq=False)
class OptimalLaw:
    """The law, its peak (of the goal), and the peaks of velocity, acceleration and jerk."""

    curve: MotionCurve
    peak: float
    velocity: float
    acceleration: float
    jerk: float


def least_peak(
    goal: Goal = "acceleration",
    *,
    start: Sequence[float | None] = (0.0, 0.0, 0.0),
    end: Sequence[float | None] = (1.0, 0.0, 0.0),
    over: float = 1.0,
    limits: Mapping[int, float] | None = None,
    smooth: int | None = None,
    mass: float = 1.0,
    stiffness: float = 0.0,
    load: float = 0.0,
    least_force: float | None = None,
    steps: int = 64,
) -> OptimalLaw:
    """The rise over ``over`` between two states with the least peak of the goal.

    ``start``, ``end``: (value, velocity, acceleration, ...) with respect to the master; missing entries and None are free.
    ``limits``: {order: largest size} of other derivatives. ``smooth``: the derivative that is constant over each step (all below
    are continuous); default the goal's own (bang-bang), 3 for force. Goal "force": the contact force
    ``mass s'' + stiffness s + load`` (mass in force per unit of s'', that is m w^2), whose largest value is minimised while it
    stays above ``least_force`` (contact kept with that margin). Raises where no law satisfies the conditions.
    """
    from scipy.optimize import linprog

    control = smooth if smooth is not None else (3 if goal == "force" else _ORDER[goal])
    order = 2 if goal == "force" else _ORDER[goal]
    limits = dict(limits or {})
    if control < order or control < max(limits, default=1) or control > 6:
        raise MechanismError(
            Fault(
                "law.smooth",
                f"derivative {control} is constant over each step, below one that is least or limited.",
                f"Let derivative {max([order, *limits])} to 6 be the constant one: 2 is the acceleration, 3 the jerk, 4 the snap.",
            )
        )
    if len(start) > control or len(end) > control:
        start, end = start[:control], end[:control]
    n = steps
    h = 1.0 / n  # everything is scaled to the unit range
    # states at the steps as linear functions of the controls and of the state at the start
    size = n + control  # unknowns: controls, start state
    state = np.zeros((n + 1, control, size))
    state[0, :, n:] = np.eye(control)
    shift = np.array([[h ** (j - i) / factorial(j - i) if j >= i else 0.0 for j in range(control)] for i in range(control)])
    gain = np.array([h ** (control - i) / factorial(control - i) for i in range(control)])
    for k in range(n):
        state[k + 1] = shift @ state[k]
        state[k + 1, :, k] += gain
    eq, eq_value = [], []
    for k, given in ((0, start), (n, end)):
        for i, value in enumerate(given):
            if value is None:
                continue
            eq.append(np.append(state[k, i], 0.0))
            eq_value.append(value * over**i)
    low: list[Real] = []
    low_value: list[float] = []

    def rows_of(i: int) -> Real:
        if i == control:
            return np.hstack([np.eye(n), np.zeros((n, control))])
        return state[:, i, :]

    def bound(rows: Real, t: float, value: float) -> None:
        """rows @ x + t * peak <= value"""
        low.extend(np.hstack([rows, np.full((len(rows), 1), t)]))
        low_value.extend([value] * len(rows))

    for i, value in limits.items():
        bound(rows_of(i), 0.0, value * over**i)
        bound(-rows_of(i), 0.0, value * over**i)
    if goal == "force":
        if control == 2:  # the acceleration is two-sided at the steps
            value_rows = np.vstack([state[:-1, 0], state[1:, 0]])
            rows = mass / over**2 * np.vstack([rows_of(2), rows_of(2)]) + stiffness * value_rows
        else:
            rows = mass / over**2 * state[:, 2] + stiffness * state[:, 0]
        bound(rows, -1.0, -load)
        if least_force is not None:
            bound(-rows, 0.0, load - least_force)
    else:
        bound(rows_of(order), -1.0, 0.0)
        bound(-rows_of(order), -1.0, 0.0)
    cost = np.zeros(size + 1)
    cost[-1] = 1.0
    solution = linprog(
        cost, A_ub=np.array(low), b_ub=low_value, A_eq=np.array(eq), b_eq=eq_value, bounds=(None, None), method="highs"
    )
    if not solution.success or solution.x is None:
        raise MechanismError(
            Fault("law.limits", f"no law keeps to the limits {limits} between these states.", "Loosen a limit or a condition.")
        )
    x = np.asarray(solution.x)[:size]
    # scaled states come out of the same linear maps, so the pieces join exactly up to rounding
    states = state @ x
    pieces = []
    for k in range(n):
        c = np.array([states[k, i] / factorial(i) for i in range(control)] + [x[k] / factorial(control)])
        pieces.append(Piece(h, c, np.zeros((0, 3))))
    curve = MotionCurve(tuple(pieces)).scaled(0.0, over, float(states[0, 0]), 1.0)
    peaks = [abs(peak(curve, i).value) for i in (1, 2, 3)]
    top = float(np.asarray(solution.x)[-1]) if goal == "force" else abs(peak(curve, order).value)
    return OptimalLaw(curve, top, *peaks)


BoundaryState = tuple[float | None, ...]


class SegmentLaw(Protocol):
    """Any law of a segment."""

    @property
    def meets(self) -> bool:
        """Whether the law meets prescribed velocities, accelerations ... at the ends; else they follow from its shape."""
        ...

    def end(self, start: float) -> float | None:
        """The value at the end, from that at the start, where the law determines it; None where it is prescribed."""
        ...

    def join(self, start: BoundaryState, end: BoundaryState, over: float) -> MotionCurve:
        """The curve from one state to the other over 0 ... ``over``, with absolute values."""
        ...


@dataclass(frozen=True, eq=False)
class NormalisedLaw:
    """A normalised law, scaled from the value at the start to that at the end; ``mirrored``: used as 1 - s(1 - x)."""

    curve: MotionCurve
    mirrored: bool = False
    meets: bool = field(default=False, init=False)

    def end(self, start: float) -> float | None:
        return None

    def join(self, start: BoundaryState, end: BoundaryState, over: float) -> MotionCurve:
        if abs(self.curve.advance) < 1e-12:
            raise MechanismError(Fault("law", "the curve returns to its start.", "Give it as a table of positions."))
        shape = self.curve.mirrored() if self.mirrored else self.curve
        return shape.scaled(0.0, over, _value(start), (_value(end) - _value(start)) / shape.advance)


@dataclass(frozen=True)
class Dwell:
    """A dwell: the value is constant."""

    meets: bool = field(default=False, init=False)

    def end(self, start: float) -> float | None:
        return start

    def join(self, start: BoundaryState, end: BoundaryState, over: float) -> MotionCurve:
        return MotionCurve((Piece(over, np.array([_value(start)]), np.zeros((0, 3))),))


@dataclass(frozen=True)
class BoundaryPolynomial:
    """The polynomial of least degree through both states and any conditions between them (at distances from the start)."""

    conditions: tuple[BoundaryCondition, ...] = ()
    powers: tuple[int, ...] | None = None
    meets: bool = field(default=True, init=False)

    def end(self, start: float) -> float | None:
        return None

    def join(self, start: BoundaryState, end: BoundaryState, over: float) -> MotionCurve:
        return polynomial_law(_conditions(start, end, over, self.conditions), self.powers)


@dataclass(frozen=True)
class Spline:
    """A B-spline through both states and conditions between them (at distances from the start)."""

    conditions: tuple[BoundaryCondition, ...]
    degree: int = 5
    meets: bool = field(default=True, init=False)

    def end(self, start: float) -> float | None:
        return None

    def join(self, start: BoundaryState, end: BoundaryState, over: float) -> MotionCurve:
        return spline_law(_conditions(start, end, over, self.conditions), self.degree)


@dataclass(frozen=True, eq=False)
class GivenAcceleration:
    """A given acceleration, integrated twice to meet the values at both ends.

    The velocity at the start follows from these values. ``scaled``: the velocity at the start is prescribed, and a factor of the
    acceleration follows. ``balanced``: it is prescribed, too, and the positive and the negative acceleration have a factor each
    (where the law leads back, every interval of one sign) by which the law ends at rest. Without a value at the end the law
    returns to where it starts.
    """

    curve: MotionCurve
    scaled: bool = False
    balanced: bool = False
    meets: bool = field(default=False, init=False)

    def end(self, start: float) -> float | None:
        return None if self.scaled or self.balanced else start

    def join(self, start: BoundaryState, end: BoundaryState, over: float) -> MotionCurve:
        value, change = _value(start), _value(end) - _value(start)
        if self.balanced:
            velocity = (start[1] if len(start) > 1 else None) or 0.0
            return from_acceleration(_balanced(self.curve, -velocity, change - velocity * over), value, velocity)
        if not self.scaled:
            twice = self.curve.integrated(0.0).integrated(0.0).advance
            return from_acceleration(self.curve, value, (change - twice) / over)
        velocity = (start[1] if len(start) > 1 else None) or 0.0
        gain = self.curve.integrated(0.0).integrated(0.0).advance
        if abs(gain) < 1e-12 * over**2 * max(np.abs(self.curve(np.linspace(0.0, over, 65), 0)).max(), 1e-300):
            raise MechanismError(Fault("law.acceleration", "it leads nowhere: no size of it reaches the end.", "Change its shape."))
        return from_acceleration(_times(self.curve, (change - velocity * over) / gain), value, velocity)


@dataclass(frozen=True, eq=False)
class GivenVelocity:
    """A given velocity, integrated once; where the value at the end is prescribed, a factor of the velocity follows."""

    curve: MotionCurve
    meets: bool = field(default=False, init=False)

    def end(self, start: float) -> float | None:
        return start + self.curve.integrated(0.0).advance

    def join(self, start: BoundaryState, end: BoundaryState, over: float) -> MotionCurve:
        value, change, own = _value(start), _value(end) - _value(start), self.curve.integrated(0.0).advance
        nothing = 1e-12 * over * max(np.abs(self.curve(np.linspace(0.0, over, 65), 0)).max(), 1e-300)
        if abs(own - change) < nothing:
            return self.curve.integrated(value)
        if abs(own) < nothing:
            raise MechanismError(Fault("law.velocity", "it leads nowhere: no size of it reaches the end.", "Change its shape."))
        return _times(self.curve, change / own).integrated(value)


@dataclass(frozen=True, eq=False)
class GivenPosition:
    """The positions themselves, such as a measured table: a curve over the segment's range."""

    curve: MotionCurve
    meets: bool = field(default=False, init=False)

    def end(self, start: float) -> float | None:
        return float(self.curve.pieces[0].at(0.0, 0)[0]) + self.curve.advance

    def join(self, start: BoundaryState, end: BoundaryState, over: float) -> MotionCurve:
        return self.curve


@dataclass(frozen=True)
class LeastPeak:
    """The law between the states with the least peak of a derivative; see `least_peak`.

    ``limits``: largest sizes of other derivatives, by order, as factors of stroke over range to that power.
    """

    goal: Goal = "acceleration"
    limits: Mapping[int, float] = field(default_factory=dict)
    smooth: int | None = None
    steps: int = 64
    meets: bool = field(default=True, init=False)

    def end(self, start: float) -> float | None:
        return None

    def join(self, start: BoundaryState, end: BoundaryState, over: float) -> MotionCurve:
        stroke = _value(end) - _value(start)
        size = stroke or max([abs(v or 0.0) * over**k for s in (start, end) for k, v in enumerate(s) if k], default=0.0) or 1.0
        first, last = ([None if v is None else v * over**k / size for k, v in enumerate(s)] for s in (start, end))
        first[0], last[0] = 0.0, stroke / size
        optimum = least_peak(self.goal, start=first, end=last, limits=self.limits, smooth=self.smooth, steps=self.steps)
        return optimum.curve.scaled(0.0, over, _value(start), size)


def _value(state: BoundaryState) -> float:
    if state[0] is None:
        raise MechanismError(Fault("to", "a free position beside a law that starts or ends there.", "Give it."))
    return state[0]


def _conditions(
    start: BoundaryState, end: BoundaryState, over: float, inner: Sequence[BoundaryCondition]
) -> list[BoundaryCondition]:
    ends = [BoundaryCondition(at, v, k) for at, state in ((0.0, start), (over, end)) for k, v in enumerate(state) if v is not None]
    return [*ends, *inner]


def _balanced(curve: MotionCurve, gain: float, travel: float) -> MotionCurve:
    """A curve whose positive and negative parts are multiplied by a factor each, so that its integral is ``gain`` and the integral
    of that ``travel``. Where that fails (as where the law leads back) every interval of one sign has a factor, as near to one as
    possible."""
    pieces = [part for piece in curve.pieces for part in _of_one_sign(piece)]
    signs = np.array([np.sign(p.at(0.5 * p.length, 0)[0]) for p in pieces])
    stretches = np.cumsum(np.append(False, signs[1:] != signs[:-1]))
    parts = [[signs == sign for sign in (1.0, -1.0)], [stretches == k for k in np.unique(stretches[signs != 0.0])]]
    for members in parts:
        firsts = [
            MotionCurve(tuple(p.scaled(1.0, float(own)) for p, own in zip(pieces, some, strict=True))).integrated(0.0)
            for some in members
        ]
        table = np.array([[first.advance for first in firsts], [first.integrated(0.0).advance for first in firsts]])
        sizes = np.abs(table).max(axis=1, initial=0.0)
        if not sizes.all() or np.linalg.cond(table / sizes[:, None]) > _LOPSIDED:
            continue
        factors = 1.0 + np.linalg.pinv(table / sizes[:, None]) @ ((np.array([gain, travel]) - table.sum(axis=1)) / sizes)
        if np.all(factors > _VANISHING):
            sized = np.where(signs == 0.0, 1.0, factors @ np.array(members))
            return MotionCurve(tuple(p.scaled(1.0, float(factor)) for p, factor in zip(pieces, sized, strict=True)))
    why = "no sizes of its positive and its negative parts let it end at rest where it shall."
    raise MechanismError(Fault("law.acceleration", why, "Let it be positive first and negative then, or the other way round."))


def _of_one_sign(piece: Piece) -> list[Piece]:
    """A straight piece, split in two where its sign changes; any other piece unchanged."""
    ends = [float(piece.at(u, 0)[0]) for u in (0.0, piece.length)]
    if len(piece.waves) or len(piece.poly) > 2 or ends[0] * ends[1] >= 0.0:
        return [piece]
    first = piece.length * ends[0] / (ends[0] - ends[1])
    if min(first, piece.length - first) < _SHORT * piece.length:
        return [piece]
    slope = float(piece.poly[1])
    return [Piece(u, np.array([c, slope]), piece.waves) for u, c in ((first, ends[0]), (piece.length - first, 0.0))]


def _times(curve: MotionCurve, factor: float) -> MotionCurve:
    return MotionCurve(tuple(p.scaled(1.0, factor) for p in curve.pieces), curve.start)


def joined_table(at: ArrayLike, values: ArrayLike, steps: bool = False) -> MotionCurve:
    """Straight lines between points, or ``steps``: each value holds up to the next argument. Two rows at one argument jump."""
    x, y = np.asarray(at, float), np.asarray(values, float)
    if x.size < 2 or y.size != x.size or np.any(np.diff(x) < 0.0) or not x[-1] > x[0]:
        raise MechanismError(Fault("law.at", "the arguments do not grow.", "Put the rows in increasing order."))
    keep = np.diff(x) > 0.0
    slopes = np.zeros(x.size - 1) if steps else np.divide(np.diff(y), np.diff(x), out=np.zeros(x.size - 1), where=keep)
    knots = np.append(x[:-1][keep], x[-1])
    return MotionCurve.of(knots.tolist(), [(a, b) for a, b in zip(y[:-1][keep], slopes[keep], strict=True)])


def fourier_curve(length: float, mean: float, harmonics: Sequence[tuple[float, float, float]]) -> MotionCurve:
    """``mean + sum (a sin(2 pi k x / length) + b cos(2 pi k x / length))`` over 0 ... ``length``, for rows (k, a, b)."""
    waves = np.array([[2.0 * np.pi * k / length, a, b] for k, a, b in harmonics], float).reshape(-1, 3)
    return MotionCurve((Piece(length, np.array([mean]), waves),))
