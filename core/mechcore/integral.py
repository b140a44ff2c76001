"""Integrals over frames, so far."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["integral_so_far"]

Real = NDArray[np.float64]


def integral_so_far(y: Real, t: Real) -> Real:
    """Integral (F,) of values (F,) over times (F,), strictly increasing, from the first frame on: 0 there.

    By Simpson's rule for uneven steps, each step with the parabola through its ends and the next frame or, every other one and the
    last, the one before; with two frames by the trapezoidal rule. Cartwright, "Simpson's rule cumulative integration with MS Excel
    and irregularly-spaced data", J. Math. Sci. Math. Educ. 12 (2017) no. 2, eq. (8), as ``scipy.integrate.cumulative_simpson`` has
    it: that takes longer to load than all of this package.
    """
    h = np.diff(t)
    if len(y) < 3:
        return np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * h)])[: len(y)]
    parts = np.empty(len(h))
    onwards, back = _first_step(y, h), _first_step(y[::-1], h[::-1])[::-1]
    parts[:-1:2], parts[1::2], parts[-1] = onwards[::2], back[::2], back[-1]
    return np.concatenate([[0.0], np.cumsum(parts)])


def _first_step(y: Real, h: Real) -> Real:
    """Integrals (F - 2,) over the first step of each two in a row of the parabolas through three values."""
    first, both = h[:-1], h[:-1] + h[1:]
    share, bent = first / both, (first / both) * (first / h[1:])
    return first / 6.0 * ((3.0 - share) * y[:-2] + (3.0 + bent + share) * y[1:-1] - bent * y[2:])
