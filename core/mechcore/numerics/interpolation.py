"""Functions known at frames: values between them, derivatives and integrals.

Order 0 holds the last frame's value, as viewers do. Order 1 joins frames by straight lines. Orders 3 and 5 are Hermite polynomials
through the values and rates of the two frames next to a time, or, if no rates are given, polynomials through the nearest 4 or 6
frames.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Index, Real


def between(time: Real, values: Any, t: Real, order: int, rate: Any = None, second: Any = None) -> Real:
    """Values (n, ...) at times ``t`` (n,) [s] from those at frames ``time`` (F,); ``rate``, ``second``: derivatives at the frames.

    Cubics need rates, quintics rates and second derivatives; without them the polynomial goes through the nearest frames.
    """
    values = np.asarray(values, float)
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(time) - 2)
    if order == 0:
        hold = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(time) - 1)
        return np.asarray(values[hold])
    h = time[k + 1] - time[k]
    shape = (-1,) + (1,) * (values.ndim - 1)
    u = ((t - time[k]) / h).reshape(shape)
    h = h.reshape(shape)
    a, b = values[k], values[k + 1]
    if order == 1:
        return np.asarray(a + u * (b - a))
    if order == 3 and rate is not None:
        w = 1.0 - u
        return np.asarray(w * w * ((1.0 + 2.0 * u) * a + u * h * rate[k]) + u * u * ((1.0 + 2.0 * w) * b - w * h * rate[k + 1]))
    if order == 5 and rate is not None and second is not None:
        return _quintic(u, a, b, h * rate[k], h * rate[k + 1], h * h * second[k], h * h * second[k + 1])
    return _through_neighbours(time, values, t, k, order + 1)


def interpolant(nodes: Real, values: Real, slopes: Real | None = None) -> Callable[[ArrayLike], Real]:
    """The function through values (n, ...) at increasing nodes (n,): piecewise cubic Hermite with slopes (n, ...), else piecewise
    linear. It takes an argument of any shape; beyond the nodes the outermost pieces are extrapolated."""

    def at(x: ArrayLike) -> Real:
        x = np.asarray(x, float)
        y = between(nodes, values, x.ravel(), 1 if slopes is None else 3, slopes)
        return y.reshape((*x.shape, *values.shape[1:]))

    return at


def _quintic(u: Real, a: Real, b: Real, va: Real, vb: Real, wa: Real, wb: Real) -> Real:
    """Hermite quintic on [0, 1] with values, slopes and second derivatives at the ends."""
    c3 = 10.0 * (b - a) - 6.0 * va - 4.0 * vb - 1.5 * wa + 0.5 * wb
    c4 = -15.0 * (b - a) + 8.0 * va + 7.0 * vb + 1.5 * wa - wb
    c5 = 6.0 * (b - a) - 3.0 * (va + vb) - 0.5 * (wa - wb)
    return np.asarray(a + u * (va + u * (0.5 * wa + u * (c3 + u * (c4 + u * c5)))))


def lagrange_weights(x: Real, t: Real) -> Real:
    """Weights (n, m) of the values at nodes ``x`` (n, m) in the polynomial through them, at ``t`` (n,)."""
    m = x.shape[1]
    weights = np.ones_like(x)
    for i in range(m):
        for j in range(m):
            if i != j:
                weights[:, i] *= (t - x[:, j]) / (x[:, i] - x[:, j])
    return weights


def _neighbours(time: Real, k: Any, count: int) -> Index:
    """Numbers (n, count) of the frames nearest to the intervals that begin at frames ``k`` (n,); all where these are fewer."""
    count = min(count, len(time))
    return np.asarray(np.clip(k - count // 2 + 1, 0, len(time) - count)[:, None] + np.arange(count))


def _through_neighbours(time: Real, values: Real, t: Real, k: Any, count: int) -> Real:
    places = _neighbours(time, k, count)
    weights = lagrange_weights(time[places], t)
    return np.asarray(np.einsum("nm,nm...->n...", weights, values[places]))


def rate_between(time: Real, values: Real, t: float, order: int) -> Real:
    """Rate (...) at a time ``t`` [s] of the polynomial through the nearest frames that `between` takes; ``values`` (F, ...)."""
    k = np.clip(np.searchsorted(time, [t], side="right") - 1, 0, len(time) - 2)
    (places,) = _neighbours(time, k, order + 1)
    return np.asarray(np.tensordot(_weights(time[places] - t, 1), values[places], 1))


def differentiate(time: Real, values: Real, order: int, derivative: int = 1) -> Real:
    """First or second derivative by time (F,) of values (..., F), from polynomials through ``order`` + 1 neighbouring frames."""
    count = min(order + 1, len(time))
    if count < 2 or (derivative == 2 and count < 3):
        return np.zeros_like(values)
    first = np.clip(np.arange(len(time)) - count // 2, 0, len(time) - count)
    places = first[:, None] + np.arange(count)
    x = time[places]
    h = (x[:, -1] - x[:, 0]) / (count - 1)
    even = np.abs(np.diff(x, axis=1) - h[:, None]).max() < 1e-9 * h.min()
    if even:
        table = _even_weights(count, derivative)
        weights = table[np.arange(len(time)) - first] / h[:, None] ** derivative
    else:
        weights = np.array([_weights(row - t, derivative) for row, t in zip(x, time, strict=True)])
    return np.asarray(np.einsum("fm,...fm->...f", weights, values[..., places]))


@lru_cache
def _even_weights(count: int, derivative: int) -> Real:
    """Weights (count, count) of the derivative at each of ``count`` nodes with spacing 1."""
    nodes = np.arange(count, dtype=float)
    return np.array([_weights(nodes - node, derivative) for node in nodes])


def _weights(x: Real, derivative: int) -> Real:
    """Weights of values at offsets ``x`` for a derivative at zero: exact for all polynomials through the nodes."""
    scale = float(np.abs(x).max())
    rows = np.vander(x / scale, increasing=True).T
    rhs = np.zeros(len(x))
    rhs[derivative] = float(derivative) / scale**derivative  # 1! = 1, 2! = 2
    return np.asarray(np.linalg.solve(rows, rhs), float)


def integral_so_far(y: Real, t: Real) -> Real:
    """Cumulative integral (F,) of values (F,) over strictly increasing times (F,); 0 at the first frame.

    Simpson's rule for unequal steps: each step uses the parabola through its ends and the next frame or, for every other step and
    the last, the frame before. With two frames it is the trapezoidal rule. Source: Cartwright, "Simpson's rule cumulative
    integration with MS Excel and irregularly-spaced data", J. Math. Sci. Math. Educ. 12 (2017) no. 2, eq. (8); the same as
    ``scipy.integrate.cumulative_simpson``, whose import takes longer than that of this whole package.
    """
    h = np.diff(t)
    if len(y) < 3:
        return np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * h)])[: len(y)]
    parts = np.empty(len(h))
    onwards, back = _first_step(y, h), _first_step(y[::-1], h[::-1])[::-1]
    parts[:-1:2], parts[1::2], parts[-1] = onwards[::2], back[::2], back[-1]
    return np.concatenate([[0.0], np.cumsum(parts)])


def _first_step(y: Real, h: Real) -> Real:
    """Integrals (F - 2,) of the parabola through three successive values, over the first of its two steps."""
    first, both = h[:-1], h[:-1] + h[1:]
    share, bent = first / both, (first / both) * (first / h[1:])
    return first / 6.0 * ((3.0 - share) * y[:-2] + (3.0 + bent + share) * y[1:-1] - bent * y[2:])
