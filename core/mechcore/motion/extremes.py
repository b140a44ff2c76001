"""Where a quantity of a motion becomes extreme or zero, between the frames: by solving the mechanism again at times close to it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev

from mechcore.arrays import Real
from mechcore.motion.motion import Motion

Metric = Callable[[Motion], Real]  # motion -> a smooth quantity (F,)
NODES = -np.cos(np.pi * np.arange(9) / 8)  # Chebyshev points: the polynomial through them follows a smooth quantity to many digits
FIT = np.linalg.inv(chebyshev.chebvander(NODES, 8))
ROUNDS = 2  # the second one in a window that is narrower by
NARROWER = 8.0
MOST = 4  # local maxima of the frames that are looked at


def peak(motion: Motion, metric: Metric) -> tuple[float, float]:
    """Time [s] and value of the largest maximum of a run, to about 1e-9 of the distance of the frames; NaN where there is none.

    Between frames only a motion that laws lead can be solved again; else, and where the quantity is not finite next to the
    maximum, it is that of the frames.
    """
    values = np.asarray(metric(motion), float)
    if not np.isfinite(values).any():
        return np.nan, np.nan
    best = int(np.nanargmax(values))
    found = float(motion.time[best]), float(values[best])
    if motion.again is None or motion.frames < 3:
        return found
    filled = np.where(np.isfinite(values), values, -np.inf)
    around = np.concatenate([[-np.inf], filled, [-np.inf]])
    local = np.flatnonzero((filled >= around[:-2]) & (filled >= around[2:]) & np.isfinite(filled))
    tops = local[np.argsort(-filled[local], kind="stable")[:MOST]]
    low = motion.time[np.maximum(tops - 1, 0)]
    high = motion.time[np.minimum(tops + 1, motion.frames - 1)]
    first, last = low, high
    at = motion.time[tops]
    for _ in range(ROUNDS):
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        inner = _again(motion, metric, middle[:, None] + half[:, None] * NODES)
        where = np.array([_highest(row) for row in inner])
        at = np.where(np.isfinite(where), middle + half * where, at)
        low, high = np.maximum(at - half / NARROWER, first), np.minimum(at + half / NARROWER, last)
    refined = _again(motion, metric, at)
    top = int(np.argmax(np.where(np.isfinite(refined), refined, -np.inf)))
    return (float(at[top]), float(refined[top])) if refined[top] >= found[1] else found


def _highest(values: Real) -> float:
    """Where on [-1, 1] the polynomial through values at the nodes is highest; NaN where these are not finite."""
    if not np.isfinite(values).all():
        return np.nan
    coefficients = FIT @ values
    bends = chebyshev.chebroots(chebyshev.chebder(coefficients)) if np.ptp(values) > 0.0 else np.zeros(1)
    inside = bends.real[(np.abs(bends.imag) < 1e-6) & (np.abs(bends.real) < 1.0)]
    places = np.concatenate([[-1.0], inside, [1.0]])
    return float(places[np.argmax(chebyshev.chebval(places, coefficients))])


def _again(motion: Motion, metric: Metric, times: Real) -> Real:
    """A quantity at other times (...)."""
    assert motion.again is not None
    flat = np.ravel(times)
    order = np.argsort(flat, kind="stable")
    out = np.empty(flat.shape)
    out[order] = metric(motion.again(flat[order]))
    return out.reshape(np.shape(times))


def zeros(motion: Motion, rows: Callable[[Motion], Real], times: Real) -> Real:
    """Zeros (n,) [s] of a quantity, from good estimates, by Newton's method; ``rows``: motion -> its value and rate (F, 2)."""
    if motion.again is None or not len(times) or motion.frames < 2:
        return times
    step = float(np.max(np.diff(motion.time)))
    found = np.array(times)
    for _ in range(3):
        value = rows(motion.again(found))
        with np.errstate(divide="ignore", invalid="ignore"):
            move = -value[:, 0] / value[:, 1]
        move = np.where(np.isfinite(move) & (np.abs(found + move - times) < 0.5 * step), move, 0.0)
        found = found + move
        if np.abs(move).max(initial=0.0) <= motion.accuracy.event * step:
            break
    return found
