"""Collocation of q'' = a(q, q', t) in windows of time: Gauss nodes, or Radau IIA nodes where it is stiff.

In a window the acceleration is a polynomial through the nodes; speed and position are its exact integrals (direct Nystroem
collocation). With Radau nodes the positions at the nodes are those of the first-order equations q' = v, v' = a instead, by the
matrix of Radau IIA squared: only so is the method L-stable (the direct integral lets the speed of a stiff vibration grow by a
factor of up to ten a window); at the windows' ends both are the same. All nodes of a window are evaluated in one call, and the
nodes' accelerations follow by Newton's method. Order 2s with Gauss nodes, 2s - 1 with Radau nodes, at the ends of the windows
(Hairer, Wanner, "Solving Ordinary Differential Equations II", IV.5 and IV.8, and I, II.14); the polynomials are the dense output.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import legendre

from mechcore.arrays import Real
from mechcore.compiled.collocation import WindowTrial
from mechcore.records import dataclass

ROUNDING = 1e-15  # part of the largest term of a position: a smaller correction is rounding
NO_PART = 1e-11  # part of the acceleration: smaller last coefficients are rounding


class System(Protocol):
    """Accelerations (n, f) of free coordinates at positions (n, f), speeds (n, f), times (n,), and their slopes (n, f, f) by
    both."""

    def __call__(self, q: Real, v: Real, t: Real) -> Real: ...

    def slopes(self, q: Real, v: Real, t: Real, a: Real) -> tuple[Real, Real]: ...


@dataclass(frozen=True, eq=False)
class Rule:
    """Nodes (s,) on [0, 1] and what integrates polynomials through them.

    ``integral`` (s, s), ``double_integral`` (s, s): from the nodes' values to the first and the second integral at the nodes;
    ``legendre`` (s, s): to the coefficients in Legendre polynomials of 2 x - 1, highest last.
    """

    nodes: Real
    integral: Real
    double_integral: Real
    legendre: Real
    stiff: bool

    @property
    def order(self) -> int:
        """Order of the values at the windows' ends."""
        return 2 * len(self.nodes) - (1 if self.stiff else 0)


def _rule(nodes: Real, stiff: bool) -> Rule:
    s = len(nodes)
    to_legendre = np.linalg.inv(legendre.legvander(2.0 * nodes - 1.0, s - 1))
    first, second = integrals(s, nodes)
    integral, double_integral = first @ to_legendre, second @ to_legendre
    if stiff:
        double_integral = integral @ integral
    return Rule(nodes, integral, double_integral, np.asarray(to_legendre, float), stiff)


def integrals(s: int, x: Real) -> tuple[Real, Real]:
    """First and second integral from 0 to ``x`` (n,) of the Legendre polynomials P_0 .. P_(s-1) of 2 x - 1, (n, s) each."""
    return integrals_and_values(s, x)[:2]


def integrals_and_values(s: int, x: Real) -> tuple[Real, Real, Real]:
    """`integrals`, and the polynomials themselves (n, s)."""
    p = _polynomials(2.0 * np.asarray(x, float) - 1.0, s + 2)
    first = np.empty((len(x), s + 1))
    first[:, 0] = 0.5 * (p[:, 1] + 1.0)
    first[:, 1:] = 0.5 * (p[:, 2:] - p[:, :-2]) * _over_odd(s)
    second = np.empty((len(x), s))
    # the integral of P_k is (P_(k+1) - P_(k-1)) / (2 (2k + 1)): integrate that once more with the same formula
    second[:, 0] = 0.5 * (first[:, 1] + first[:, 0])
    second[:, 1:] = 0.5 * (first[:, 2:] - first[:, :-2]) * _over_odd(s - 1)
    return first[:, :s], second, p[:, :s]


@lru_cache
def _over_odd(n: int) -> Real:
    """1 / (2 k + 1) for k = 1 .. n."""
    return np.asarray(1.0 / (2.0 * np.arange(1, n + 1) + 1.0))


def _polynomials(z: Real, n: int) -> Real:
    """Legendre polynomials P_0 .. P_(n-1) at z (m,): (m, n)."""
    out = np.empty((n, len(z)))
    out[0], out[1] = 1.0, z
    for k in range(2, n):
        np.multiply(z, out[k - 1], out=out[k])
        out[k] *= (2.0 * k - 1.0) / k
        out[k] -= ((k - 1.0) / k) * out[k - 2]
    return out.T


@lru_cache
def gauss(s: int) -> Rule:
    """Gauss-Legendre nodes: order 2s, symplectic, for problems that are not stiff."""
    x, _ = legendre.leggauss(s)
    return _rule(0.5 * (x + 1.0), stiff=False)


@lru_cache
def radau(s: int) -> Rule:
    """Radau IIA nodes (the end of the window is one): order 2s - 1, L-stable."""
    c = np.zeros(s + 1)
    c[s - 1], c[s] = -1.0, 1.0  # P_s - P_(s-1) vanishes at the right Radau nodes
    x = np.sort(np.real(legendre.legroots(c)))
    d = legendre.legder(c)
    for _ in range(3):
        x = x - legendre.legval(x, c) / legendre.legval(x, d)
    x[-1] = 1.0
    return _rule(np.asarray(0.5 * (x + 1.0), float), stiff=True)


class Window(NamedTuple):
    """One window of a solution: times ``start`` to ``start + length`` [s]; ``q``, ``v`` (f,) at its start, Legendre coefficients
    ``a`` (s, f) of the acceleration. ``cut``: it ends where the equations change their form; ``strain``: largest rate of a joint
    per unit rate of the coordinates in it, where that is known."""

    start: float
    length: float
    q: Real
    v: Real
    a: Real
    cut: bool = False
    strain: float | None = None

    def __call__(self, t: Real) -> tuple[Real, Real, Real]:
        """Position, speed and acceleration (n, f) at times (n,)."""
        h, s = self.length, len(self.a)
        x = (np.atleast_1d(t) - self.start) / h
        first, second, values = integrals_and_values(s, x)
        return self.q + h * x[:, None] * self.v + h * h * (second @ self.a), self.v + h * (first @ self.a), values @ self.a

    def acceleration(self, t: Real) -> Real:
        """Acceleration (n, f) at times (n,), also beyond its ends."""
        return np.asarray(_polynomials(2.0 * ((t - self.start) / self.length) - 1.0, len(self.a)) @ self.a)

    def end(self) -> tuple[Real, Real]:
        """Position and speed (f,) at its end: only the first two polynomials are not zero on the whole."""
        first, second = self.a[0], self.a[1] if len(self.a) > 1 else 0.0
        return self.q + self.length * self.v + self.length**2 * (0.5 * first - second / 6.0), self.v + self.length * first


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a trial may be anywhere
def solve_window(rule: Rule, system: System, trial: WindowTrial) -> tuple[Real, int] | None:
    """Accelerations at the nodes (s, f) of one window, and the number of evaluations; None where Newton's method does not converge.

    ``system(q, v, t)`` gives the accelerations (s, f) at nodes, ``system.slopes(q, v, t, a)`` their derivatives by position and
    speed, (s, f, f) each; a system whose slopes are differences may give both in one call, ``system.with_slopes(q, v, t, near)``,
    with approximate accelerations ``near``.

    The iteration ends when a step moves no position by more than the trial's tolerance, or than the rounding of the sums that make
    the positions: the accelerations themselves may keep far fewer digits. Over a stiff vibration they are as large as the inverse
    of the collocation matrix makes them (1e4 times the position for 12 nodes), and rounding of a position moves them as much.
    """
    t0, h, q0, v0, a, tolerance = trial
    s, f = a.shape
    together = getattr(system, "with_slopes", None)
    t = t0 + h * rule.nodes
    drift = q0 + h * rule.nodes[:, None] * v0
    matrix = None
    last, reach = np.inf, float(np.abs(drift).max())
    for count in range(1, 16):
        q, v = drift + h * h * (rule.double_integral @ a), v0 + h * (rule.integral @ a)
        if matrix is None and together is not None:
            force, *slopes = together(q, v, t, a)
        else:
            force = system(q, v, t)
        residual = force - a
        if matrix is None:
            if not np.isfinite(force).all():
                return None
            by_q, by_v = system.slopes(q, v, t, force) if together is None else slopes
            if f == 1:
                matrix = np.eye(s) - h * h * by_q[:, :, 0] * rule.double_integral - h * by_v[:, :, 0] * rule.integral
            else:
                full = -h * h * np.einsum("iab,ij->iajb", by_q, rule.double_integral) - h * np.einsum(
                    "iab,ij->iajb", by_v, rule.integral
                )
                matrix = full.reshape(s * f, s * f) + np.eye(s * f)
            inverse = np.linalg.inv(matrix)
        step = (inverse @ residual.reshape(s * f)).reshape(s, f)
        a = a + step
        moved = h * h * np.abs(rule.double_integral @ step)
        size = float(moved.max())
        if size <= tolerance:
            return a, count
        if not size < np.inf:
            return None
        if size <= ROUNDING * (reach + h * h * float(np.abs(a).max())):  # no coordinate's terms are larger
            terms = np.abs(drift) + h * h * (np.abs(rule.double_integral) @ np.abs(a))
            if (moved.max(axis=0) <= ROUNDING * terms.max(axis=0)).all():
                return a, count
        if count > 2 and size > 0.5 * last:
            if size > 0.9 * last or count > 8:
                return None
            matrix = None  # the slopes have changed too much within the window
        last = size
    return None


def tails(a: Real, share: Real | float) -> Real:
    """Estimated error (..., f) in windows with Legendre coefficients ``a`` (..., s, f) of the acceleration; ``share`` (..., 1):
    their length times that of the longest window [s^2].

    The last two coefficients of the acceleration count as a position, and as a speed that is kept for the longest
    window: where the equations jump, windows become so short that a wrong speed is no error of the position within them, but it is
    one of all that follows.
    """
    s, last = a.shape[-2], np.abs(a[..., -2:, :])
    return np.asarray(share * np.maximum(last[..., 0, :] / (4.0 * (s - 2) ** 2), last[..., 1, :] / (4.0 * (s - 1) ** 2)))


def neglected_tails(a: Real, share: Real | float) -> tuple[Real, Real]:
    """The error (..., f) of the speed that the quadrature misses, and its order (...); arguments as of `tails`.

    Those are the coefficients from 2 s on. Where the acceleration is smooth, they are negligible; next to a Hertz contact, which
    starts as the power 3/2 of time, the k-th falls as C / k^m only, so that their sum counts. C and m follow from the last
    coefficients and those of half their number.
    """
    s, size = a.shape[-2], np.abs(a)
    last, middle = size[..., -2:, :].max(axis=-2), size[..., (s - 1) // 2 : (s + 3) // 2, :].max(axis=-2)
    ratio = 0.25 * last / np.maximum(np.maximum(0.25 * middle, last), 1e-300)  # at most a quarter
    m = -np.log2(np.maximum(ratio, 1e-300))
    neglected = np.where(last > NO_PART * size.max(axis=-2), 2.0 * s * last * ratio / (m - 1.0), 0.0)
    return share * neglected, 0.5 * (m.min(axis=-1) + 1.0)
