"""Laws from conditions and from data: polynomials, B-splines, measured tables, given accelerations and velocities."""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve, Piece
from mechcore.records import dataclass
from mechcore.texts import Text, as_angle

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

REFINEMENTS = 4  # steps of iterative refinement: coefficients are corrected by residuals in extended precision


@dataclass(frozen=True)
class BoundaryCondition:
    """The derivative ``order`` (0 value, 1 velocity, 2 acceleration, 3 jerk, ...) is ``value`` at ``angle``."""

    angle: float
    value: float
    order: int = 0


def _sorted(conditions: Sequence[BoundaryCondition], least: int) -> tuple[Real, Real, Real]:
    if len(conditions) < least:
        raise MechanismError(
            Fault("law.conditions", f"{len(conditions)} conditions.", f"Give at least {least}, two of them at different angles.")
        )
    seen: set[tuple[float, int]] = set()
    for c in conditions:
        if c.order < 0 or not np.isfinite([c.angle, c.value]).all():
            raise MechanismError(Fault("law.conditions", f"{c} is none.", "Give finite numbers and an order from 0 on."))
        if (c.angle, c.order) in seen:
            raise MechanismError(
                Fault("law.conditions", f"two conditions for derivative {c.order} at the angle {c.angle:g}.", "Keep one of them.")
            )
        seen.add((c.angle, c.order))
    rows = sorted(conditions, key=lambda c: (c.angle, c.order))
    return (
        np.array([c.angle for c in rows]),
        np.array([c.order for c in rows]),
        np.array([c.value for c in rows], float),
    )


def polynomial_law(conditions: Sequence[BoundaryCondition], powers: Sequence[int] | None = None) -> MotionCurve:
    """The polynomial of least degree through any conditions at any angles (Hermite-Birkhoff interpolation).

    ``powers``: exponents of (x - x0)/(x1 - x0) to use instead of 0 ... n - 1, one for each condition (a 3-4-5 polynomial follows
    from three conditions at each end; names such as 2-10-18 state the powers). Raises where the conditions do not determine it.
    """
    x, k, y = _sorted(conditions, 2)
    exponents = np.arange(len(x)) if powers is None else np.asarray(powers, int)
    if len(exponents) != len(x) or len(set(exponents.tolist())) != len(x) or exponents.min() < 0:
        raise MechanismError(
            Fault("law.powers", f"{list(map(int, exponents))} for {len(x)} conditions.", "Give each its own exponent.")
        )
    length = x[-1] - x[0]
    if length <= 0.0:
        raise MechanismError(Fault("law.conditions", "all conditions are at one angle.", "Give one at another angle."))
    u = (x - x[0]) / np.longdouble(length)
    matrix = np.array(
        [[factorial(p) // factorial(p - d) * ui ** (p - d) if p >= d else 0.0 for p in exponents.tolist()]
         for ui, d in zip(u, k.tolist(), strict=True)], np.longdouble
    )  # fmt: skip
    scale = np.abs(matrix).max(axis=1)
    a = matrix / np.where(scale == 0.0, 1.0, scale)[:, None]
    rounded = a.astype(float)
    if np.any(scale == 0.0) or np.linalg.matrix_rank(rounded, 1e-13) < len(x):
        raise MechanismError(
            Fault("law.conditions", "they do not fix one polynomial.", "Add or move a condition, or state powers = [...].")
        )
    b, c = y * np.longdouble(length) ** k / scale, np.zeros(len(x), np.longdouble)
    for _ in range(REFINEMENTS):
        c += np.linalg.solve(rounded, (b - a @ c).astype(float))
    poly = np.zeros(exponents.max() + 1)
    poly[exponents] = c
    return MotionCurve((Piece(1.0, poly, np.zeros((0, 3))),)).scaled(float(x[0]), float(length), float(poly[0]), 1.0)


def _of_ppoly(spline: PPoly, repeats: bool = False) -> MotionCurve:
    keep = np.diff(spline.x) > 0.0
    knots = np.append(spline.x[:-1][keep], spline.x[-1])
    return MotionCurve.of(knots.tolist(), list(spline.c[::-1, keep].T), repeats=repeats)


def spline_law(conditions: Sequence[BoundaryCondition], degree: int = 5) -> MotionCurve:
    """A B-spline of the stated degree through points and any further conditions on derivatives, over their range of angles.

    There are as many basis functions as conditions. The inner knots are averages of neighbouring angles (as in interpolation of
    values), so that a solution exists where the Schoenberg-Whitney conditions hold. Derivatives up to ``degree - 1`` are
    continuous.
    """
    from scipy.interpolate import BSpline, PPoly

    x, k, y = _sorted(conditions, 2)
    n = len(x)
    degree = min(degree, n - 1)
    if x[-1] <= x[0]:
        raise MechanismError(Fault("law.conditions", "all conditions are at one angle.", "Give one at another angle."))
    if np.any(k >= max(degree, 1)):
        raise MechanismError(
            Fault("law.conditions", f"a condition on derivative {k.max()} of a spline of degree {degree}.", "Raise the degree.")
        )
    inner = np.array([x[i : i + degree].mean() for i in range(1, n - degree)])
    t = np.concatenate([np.full(degree + 1, x[0]), inner, np.full(degree + 1, x[-1])])
    length = x[-1] - x[0]
    basis = BSpline(t, np.eye(n), degree)
    matrix = np.array([basis(xi, int(d)) * length ** int(d) for xi, d in zip(x, k, strict=True)])
    if np.linalg.matrix_rank(matrix / np.abs(matrix).max(axis=1, keepdims=True), 1e-12) < n:
        raise MechanismError(
            Fault("law.conditions", "they do not fix one spline.", "Spread the points, or state fewer derivatives at one angle.")
        )
    return _of_ppoly(PPoly.from_spline((t, np.linalg.solve(matrix, y * length**k), degree)))


@dataclass(frozen=True)
class Smoothing:
    """How smoothing changed a measured table: pieces of the spline, root mean square of the corrections, the largest, its angle."""

    points: int
    pieces: int
    tolerance: float
    rms: float
    largest: float
    at: float

    def __str__(self) -> str:
        return (
            f"{self.points} points by a spline of {self.pieces} pieces: corrections {self.rms:.3g} rms, "
            f"{self.largest:.3g} at most, at {Text(as_angle(self.at))}"
        )


def measured_table(
    angles: ArrayLike, values: ArrayLike, tolerance: float = 0.0, repeats: bool = False, *, rest: bool = False
) -> tuple[MotionCurve, Smoothing]:
    """A quintic spline near measured points: the fewest knots whose root-mean-square correction stays within ``tolerance``.

    Tolerance 0 interpolates. ``repeats``: the last row is the end of the cycle (same value as the first up to an advance, which
    is kept as a uniform trend); the spline continues into the next cycle with continuous derivatives up to the fourth. P. Dierckx's
    smoothing spline (``scipy.interpolate.splrep``). ``rest``: it interpolates, with velocity and acceleration zero at both ends.
    """
    from scipy.interpolate import PPoly, make_interp_spline, splrep

    x, y = np.asarray(angles, float).ravel(), np.asarray(values, float).ravel()
    if x.size != y.size or x.size < 6:
        raise MechanismError(Fault("law.table", f"{x.size} angles and {y.size} values.", "Give at least six of each."))
    if not np.all(np.isfinite(x)) or not np.all(np.isfinite(y)) or np.any(np.diff(x) <= 0.0):
        raise MechanismError(Fault("law.table", "the angles do not increase.", "Sort the rows and leave out double ones."))
    if not tolerance >= 0.0:
        raise MechanismError(Fault("law.tolerance", f"{tolerance:g} is negative.", "Give zero or a positive number."))
    trend = (y[-1] - y[0]) * (x - x[0]) / (x[-1] - x[0]) if repeats else np.zeros_like(x)
    data = y - trend
    if repeats:
        data[-1] = data[0]
    size = np.ptp(data) or 1.0  # scaled: the fit's own stopping rule is absolute
    if rest:
        still = [(1, 0.0), (2, 0.0)]
        spline = make_interp_spline(x, data / size, 5, bc_type=(still, still))
        tck = spline.t, spline.c, spline.k
    else:
        tck = splrep(x, data / size, k=5, s=x.size * (tolerance / size) ** 2, per=repeats)
    curve = _of_ppoly(PPoly.from_spline(tck), repeats)
    curve = MotionCurve(tuple(p.scaled(1.0, size) for p in curve.pieces), curve.start, repeats)
    middles = 0.5 * (curve.knots[1:] + curve.knots[:-1])
    inside = [p for p, m in zip(curve.pieces, middles, strict=True) if x[0] < m < x[-1]]  # periodic knots extend beyond
    curve = MotionCurve(tuple(inside), float(x[0]), repeats)
    if repeats:
        rate = (y[-1] - y[0]) / (x[-1] - x[0])
        tilted, done = [], 0.0
        for p in curve.pieces:
            poly = p.poly.copy()
            poly[:2] += (rate * done, rate)
            tilted.append(Piece(p.length, poly, p.waves))
            done += p.length
        curve = MotionCurve(tuple(tilted), curve.start, True)
    error = MotionCurve(curve.pieces, curve.start)(x, 0)[0] - y
    worst = int(np.argmax(np.abs(error)))
    report = Smoothing(
        x.size,
        len(curve.pieces),
        tolerance,
        float(np.sqrt(np.mean(error**2))),
        float(abs(error[worst])),
        float(x[worst]),
    )
    return curve, report


def from_acceleration(acceleration: MotionCurve, value: float = 0.0, velocity: float | None = None) -> MotionCurve:
    """The law whose acceleration is given, integrated twice (the route of the lecture).

    ``velocity``: that at the start. Without it the value at the end is that at the start, as a profile needs. The velocity is then
    continuous, too, if the mean of the given acceleration is zero; otherwise it jumps, which ``jumps`` lists.
    """
    first = acceleration.integrated(0.0)
    if velocity is None:
        velocity = -first.integrated(0.0).advance / acceleration.length
    return first.raised(velocity).integrated(value)
