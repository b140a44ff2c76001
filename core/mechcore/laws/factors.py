"""Jumps, extremes and peak factors of a motion curve."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Real
from mechcore.laws.curve import MotionCurve, Piece
from mechcore.records import dataclass
from mechcore.texts import Text, as_angle

VELOCITY_JUMP = 1e-6  # least jump, relative to the largest velocity; smaller ones may be rounding of tables or given profiles
ORDER_NAMES = ("position", "velocity", "acceleration", "jerk", "snap")


@dataclass(frozen=True)
class Jump:
    """A step of one derivative. ``shock``: a step of the acceleration or below, where the jerk is infinite."""

    angle: float
    order: int
    left: float
    right: float

    @property
    def size(self) -> float:
        return self.right - self.left

    @property
    def shock(self) -> bool:
        return self.order <= 2

    def __str__(self) -> str:
        what = f"{ORDER_NAMES[self.order]} jumps from {self.left:.6g} to {self.right:.6g}"
        return f"{what} at {Text(as_angle(self.angle))}" + (" (infinite jerk)" if self.shock else "")


@dataclass(frozen=True)
class LawExtreme:
    """A stationary point, or an end of a piece where the derivative jumps."""

    angle: float
    value: float


def jumps(curve: MotionCurve, orders: tuple[int, ...] = (0, 1, 2, 3), tolerance: float = 1e-9, ends: bool = True) -> list[Jump]:
    """All steps of the stated derivatives, by angle.

    A step counts when it exceeds ``tolerance`` times the largest size of its derivative at any knot, or, if that is larger, times
    the stroke over the curve's length to the power of the order. ``ends``: the two ends count too: against each other where the
    curve repeats, else against dwells (all derivatives zero) that are assumed before and after it.
    """
    top = max(orders)
    left, right = curve.limits(top)
    before = np.vstack([np.zeros(top + 1), left[:-1]])
    after = right
    angles = curve.knots[:-1]
    if curve.repeats:
        before[0] = left[-1]
        before[0, 0] -= curve.advance
    elif ends:
        before[0, 0] = right[0, 0]
        rest = np.zeros(top + 1)
        rest[0] = left[-1, 0]
        before, after = np.vstack([before, left[-1]]), np.vstack([after, rest])
        angles = curve.knots
    samples = curve(np.linspace(curve.knots[0], curve.knots[-1], 33), top)
    stroke = max(np.ptp(samples[0]), np.abs(samples[0]).max() * 1e-3)
    steps = []
    for k in orders:
        size = max(np.abs(left[:, k]).max(), np.abs(right[:, k]).max(), stroke / curve.length**k)
        step = after[:, k] - before[:, k]
        for i in np.flatnonzero(np.abs(step) > tolerance * size):
            if i == 0 and not (ends or curve.repeats):
                continue
            steps.append(Jump(float(angles[i]), k, float(before[i, k]), float(after[i, k])))
    return sorted(steps, key=lambda j: (j.angle, j.order))


def _stationary(piece: Piece, order: int) -> Real:
    """Distances within the piece at which the derivative ``order`` is stationary, to rounding."""
    if len(piece.poly) <= order + 1 and not len(piece.waves):
        return np.zeros(0)
    turns = sum(abs(w) for w in piece.waves[:, 0]) * piece.length / (2.0 * np.pi) if len(piece.waves) else 0.0
    u = np.linspace(0.0, piece.length, int(33 + 32 * turns) + 8 * len(piece.poly))
    f = np.empty((1, u.size))
    piece.fill(u, f, order + 1)
    s = np.sign(f[0])
    k = np.flatnonzero(s[:-1] * s[1:] < 0.0)
    exact: Real = u[1:-1][(s[1:-1] == 0.0) & (s[:-2] * s[2:] < 0.0)]
    if not k.size:
        return exact
    a, b, sa = u[k].copy(), u[k + 1].copy(), s[k]
    value = np.empty((2, k.size))
    x = 0.5 * (a + b)
    for _ in range(60):  # Newton, kept inside the bracket
        piece.fill(x, value, order + 1)
        same = np.sign(value[0]) == sa
        a, b = np.where(same, x, a), np.where(same, b, x)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = x - value[0] / value[1]
        new = np.where((step > a) & (step < b), step, 0.5 * (a + b))
        if np.all(np.abs(new - x) <= 4e-16 * piece.length):
            x = new
            break
        x = new
    return np.sort(np.concatenate([exact, x]))


def extremes(curve: MotionCurve, order: int) -> list[LawExtreme]:
    """Stationary points of the derivative ``order`` and its one-sided values at every knot, by angle."""
    out: list[LawExtreme] = []
    for piece, x0 in zip(curve.pieces, curve.knots, strict=False):
        u = np.concatenate([[0.0], _stationary(piece, order), [piece.length]])
        value = np.empty((1, u.size))
        piece.fill(u, value, order)
        out += [LawExtreme(float(x0 + ui), float(v)) for ui, v in zip(u, value[0], strict=True)]
    return out


def peak(curve: MotionCurve, order: int, sign: int = 0) -> LawExtreme:
    """The largest (``sign`` 1), smallest (-1) or in size largest (0) value of a derivative and its first angle."""
    all_extremes = extremes(curve, order)
    sizes = np.array([abs(e.value) if sign == 0 else sign * e.value for e in all_extremes])
    best = int(np.argmax(sizes >= sizes.max() * (1.0 - 1e-14) if sizes.max() > 0 else sizes == sizes.max()))
    return all_extremes[best]


@dataclass(frozen=True)
class PeakFactors:
    """Peaks of the normalised law: Cv, Ca, Cj (infinite where the derivative below jumps inside), Cvm = max |s' s''|.

    Multiply by H w/b, H (w/b)^2, H (w/b)^3 for stroke H over the range b at the cam's speed w. ``end_steps``: derivatives
    (1 velocity, 2 acceleration, 3 jerk) that step where a dwell joins on.
    """

    velocity: float
    acceleration: float
    jerk: float
    power: float
    end_steps: tuple[int, ...]
    inner_steps: tuple[int, ...]


def peak_factors(curve: MotionCurve) -> PeakFactors:
    """Peak factors of a rise; any stroke and length are normalised to one."""
    unit = curve.scaled(0.0, 1.0, 0.0, 1.0 / curve.advance) if curve.advance else curve.scaled(0.0, 1.0, 0.0, 1.0)
    steps = jumps(unit, (1, 2, 3))
    ends = tuple(sorted({j.order for j in steps if j.angle in (0.0, float(unit.knots[-1]))}))
    inner = tuple(sorted({j.order for j in steps if 0.0 < j.angle < float(unit.knots[-1])}))
    values = [np.inf if any(i < k for i in inner) else abs(peak(unit, k).value) for k in (1, 2, 3)]
    return PeakFactors(values[0], values[1], values[2], np.inf if 1 in inner else _peak_power(unit), ends, inner)


def _peak_power(curve: MotionCurve) -> float:
    """max |s' s''|, to rounding: stationary where s''^2 + s' s''' = 0, found by a refined search piece by piece."""
    best = 0.0
    for piece in curve.pieces:
        a, b = 0.0, piece.length
        for _ in range(9):
            u = np.linspace(a, b, 65)
            f = np.empty((2, u.size))
            piece.fill(u, f, 1)
            p = np.abs(f[0] * f[1])
            k = int(np.argmax(p))
            best = max(best, float(p[k]))
            a, b = u[max(k - 1, 0)], u[min(k + 1, 64)]
    return best
