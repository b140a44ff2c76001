"""Dead points of a group, where its two assembly modes meet, from samples of its margin from them.

The margin (`mechcore.kinematics.positions.dead_point_margin`) is a smooth function of time that is 0 at a dead point. Where it is
negative, the group cannot be assembled.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from mechcore.arrays import Flags, Real, Values
from mechcore.kinematics.model import Model

DEAD_POINT = 3e-15  # below this `dead_point_margin` is rounding: the triangle is flat
NEAR_DEAD_POINT = 1e-2  # minima of `dead_point_margin` above this are no dead points
CLOSURE_LIMIT = 1e-14  # where `dead_point_margin` is below minus this, the closed forms give NaN: the links do not meet
ROUNDING = 1e-14  # `dead_point_margin` that varies by less within a window is constant: nothing moves
WINDOW_SAMPLES = 4  # samples on each side from which the instant is located
INTERPOLATED_DEAD_POINT = 3e-12  # instead of DEAD_POINT where an earlier group's positions come from such a polynomial


def rounding_of(model: Model) -> float:
    """Uncertainty of lengths, relative to the mechanism's size, due to rounding of the largest coordinate of a point.

    With coordinates of 10 km, lengths are known to 2e-12 m at best, and so is whether a parallelogram is one.
    """
    return float(8.0 * np.finfo(float).eps * model.cached(_farthest) / model.length_scale)


def _farthest(model: Model) -> float:
    return max((abs(x) for link in model.bodies.values() for xy in link.points.values() for x in xy), default=0.0)


def dead_point_instants(
    margins: Sequence[Values], time: Real, blurred: Flags, rounding: float
) -> tuple[list[tuple[float, bool]], list[tuple[float, float]], bool]:
    """Dead points of a group from samples of its `dead_point_margin`: (time, whether the motion passes through), ranges of time in
    which the group cannot be assembled, and whether the samples are too few to decide somewhere.

    The margin, the squared height of the triangle, grows with the second power of time where the motion passes through, and with
    the fourth where the drive reverses at the dead point. Between samples it is the polynomial through the neighbours, whose last
    terms estimate its error (the margin is far from a polynomial where an arm of the triangle is as short as the travel between
    samples). ``blurred``: samples at which an earlier group's positions are interpolated; ``rounding``: relative uncertainty of
    lengths.
    """
    out: list[tuple[float, bool]] = []
    unreachable: list[tuple[float, float]] = []
    sharp, count = False, len(time)
    first, step = float(time[0]), float(time[1] - time[0])
    dead_point, reach_limit = max(DEAD_POINT, rounding), max(CLOSURE_LIMIT, rounding)
    lowest = -max(INTERPOLATED_DEAD_POINT, rounding)
    varying = [height for height in margins if np.ndim(height)]
    if any(height < lowest for height in margins if not np.ndim(height)):
        unreachable.append((first, float(time[-1])))
    if not varying:
        return out, unreachable, sharp
    heights = np.array(varying)
    numbers, before = (heights[:, 1:-1] < NEAR_DEAD_POINT).nonzero()
    if not len(before):
        return out, unreachable, sharp
    before += numbers * count
    h = heights.ravel()
    inner = h[before + 1]
    if np.minimum.reduce(inner) < lowest:
        for height in heights:
            unreachable += _ranges_below(time, height, lowest)
    for place in (before[(inner <= h[before]) & (inner < h[before + 2])] + 1).tolist():
        k = place % count
        a, b = max(k - WINDOW_SAMPLES, 0), min(k + WINDOW_SAMPLES + 1, count)
        window = h[place - k + a : place - k + b]
        y = window.tolist()
        if y[k - a] <= lowest or not max(y) - min(y) >= ROUNDING or not math.isfinite(sum(y)):  # constant, or not all are known
            continue
        fit = _LocalPolynomial(window, k - a, b - 1 - k)
        at, curvature = fit.least()
        least, rough = fit(at), True in blurred[a:b].tolist()
        truncation = abs(fit.terms[-1]) + abs(fit.terms[-2])
        sharp |= not rough and dead_point < abs(least) < 10.0 * truncation
        if -max(reach_limit, INTERPOLATED_DEAD_POINT * rough) <= least <= max(dead_point, INTERPOLATED_DEAD_POINT * rough):
            near, far = abs(fit(at - 1.5) + fit(at + 1.5)), abs(fit(at - 3.0) + fit(at + 3.0))
            out.append((float(time[k]) + at * step, far < 8.0 * near))
        elif least < 0.0 and y[k - a] > -reach_limit and curvature > 0.0:
            half = math.sqrt(-2.0 * least / curvature)
            unreachable.append((float(time[k]) + (at - half) * step, float(time[k]) + (at + half) * step))
    return out, unreachable, sharp


class _LocalPolynomial:
    """The polynomial of eighth degree through values at samples: ``before`` of them before, ``after`` after the sample at 0.

    It uses plain numbers and Horner's scheme written out, because arrays and loops are slower for so few terms.
    """

    def __init__(self, values: Real, before: int, after: int):
        self.middle, self.half = 0.5 * (after - before), 0.5 * (after + before)
        self.terms: list[float] = (_inverse(before, after) @ values).tolist()

    def __call__(self, x: float) -> float:
        """Value at ``x``, in samples from 0."""
        u = (x - self.middle) / self.half
        a, b, c, d, e, f, g, h, i = self.terms
        return (((((((i * u + h) * u + g) * u + f) * u + e) * u + d) * u + c) * u + b) * u + a

    def least(self) -> tuple[float, float]:
        """The place of the minimum next to 0, at most 1.5 samples from it, and the curvature there, by Newton's method; where the
        curve is not convex, the last place before."""
        middle, half, (_, b, c, d, e, f, g, h, i) = self.middle, self.half, self.terms
        c, d, e, f, g, h, i = 2.0 * c, 3.0 * d, 4.0 * e, 5.0 * f, 6.0 * g, 7.0 * h, 8.0 * i
        d2, e3, f4, g5, h6, i7 = 2.0 * d, 3.0 * e, 4.0 * f, 5.0 * g, 6.0 * h, 7.0 * i
        at, last, curvature = 0.0, math.inf, 0.0
        for _ in range(8):
            u = (at - middle) / half
            slope = ((((((i * u + h) * u + g) * u + f) * u + e) * u + d) * u + c) * u + b
            curvature = ((((((i7 * u + h6) * u + g5) * u + f4) * u + e3) * u + d2) * u + c) / half**2
            if curvature <= 0 or abs(at - last) < 1e-8:  # the next step would be below rounding
                break
            last, at = at, min(max(at - slope / half / curvature, -1.5), 1.5)
        return at, curvature


@cache
def _inverse(before: int, after: int) -> Real:
    """The matrix (9, samples) from values to coefficients of a polynomial on [-1, 1]; the last are 0 where there are fewer samples
    than coefficients."""
    places = np.linspace(-1.0, 1.0, before + after + 1)
    inverse = np.zeros((9, len(places)))
    inverse[: len(places)] = np.linalg.pinv(np.vander(places, min(9, len(places)), increasing=True))
    return inverse


def _ranges_below(time: Real, h: Real, limit: float) -> list[tuple[float, float]]:
    """Ranges of time whose samples lie below a limit, extended at each end to the zero of a straight line to the next sample, if
    that is not negative."""
    below = h < limit
    edges = np.flatnonzero(np.diff(np.concatenate([[0], below.astype(int), [0]])))
    out = []
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        ends = []
        for inside, beyond in ((a, a - 1), (b - 1, b)):
            t = float(time[inside])
            if 0 <= beyond < len(time) and h[beyond] >= 0.0:
                t += float((time[beyond] - time[inside]) * h[inside] / (h[inside] - h[beyond]))
            ends.append(t)
        out.append((ends[0], ends[1]))
    return out
