"""Extremes, zeros and exceedances of a quantity between the frames of a motion, by solving the mechanism again at other times."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from mechcore.arrays import Flags, Index, Real
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import runs
from mechcore.records import dataclass

Metric = Callable[[Motion], Real]  # motion -> a smooth quantity (F,)
AtTimes = Callable[[Real], Real]  # ascending times (n,) [s] -> a quantity (n,)
WINDOW_NODES = -np.cos(
    np.pi * np.arange(9) / 8
)  # Chebyshev points: the polynomial through them approximates a smooth quantity to many digits
FIT = np.linalg.inv(chebyshev.chebvander(WINDOW_NODES, 8))
SEARCH_ROUNDS = 2  # each in a window that is narrower than the one before by NARROWING
NARROWING = 8.0
MOST_MAXIMA = 24  # largest local maxima of the frames that are refined
MOST_PEAKS = 1_000  # largest local maxima about a limit that are refined, all at once
PEAK_ROUNDS = 5  # of the search for the largest value of an exceedance, each in a quarter of the interval before
PEAK_RISE = 0.25  # share of its drop to a neighbour by which a maximum may exceed the highest frame; an eighth for a parabola
EQUAL = 1e-9  # relative difference up to which maxima are equal: the first counts
NEWTON_STEPS = 3  # for a zero, from the estimate by a cubic; then its two frames are divided
ABOUT_ZERO = np.array([-1e-2, -1e-4, -1e-6, 1e-6, 1e-4, 1e-2])  # parts of an interval, about the estimated zero of an excess
APART = 0.01  # part of an interval about a zero of higher order between the values that lead to it
SAME_ZERO = 0.01  # of that distance, by which the zeros found from both sides may differ
SECTION_ROUNDS, SECTIONS = 12, np.linspace(0.0, 1.0, 9)  # 8^12 = 7e10 places


def largest_maximum(motion: Motion, metric: Metric) -> tuple[float, float]:
    """Time [s] and value of the largest maximum of a run, to about 1e-9 of the interval between frames; NaN if there is none.

    Only a motion that follows laws can be solved again between frames. For others, and where the quantity is not finite next to the
    maximum, the result is the largest value at the frames.
    """
    values = np.asarray(metric(motion), float)
    if not np.isfinite(values).any():
        return np.nan, np.nan
    highest = _first_highest(motion.time, values)
    if motion.at_times is None or motion.frames < 3 or np.nanmin(values) >= highest[1] - EQUAL * abs(highest[1]):
        return highest
    filled = np.where(np.isfinite(values), values, -np.inf)
    around = np.concatenate([[-np.inf], filled, [-np.inf]])
    local = np.flatnonzero((filled >= around[:-2]) & (filled >= around[2:]) & np.isfinite(filled))
    tops = np.sort(local[np.argsort(-filled[local], kind="stable")[:MOST_MAXIMA]])
    low = motion.time[np.maximum(tops - 1, 0)]
    high = motion.time[np.minimum(tops + 1, motion.frames - 1)]
    first, last = low, high
    at = motion.time[tops]
    solved = _at_other_times(motion, metric)
    for _ in range(SEARCH_ROUNDS):
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        inner = _again(solved, middle[:, None] + half[:, None] * WINDOW_NODES)
        where = np.array([_highest(row) for row in inner])
        at = np.where(np.isfinite(where), middle + half * where, at)
        low, high = np.maximum(at - half / NARROWING, first), np.minimum(at + half / NARROWING, last)
    refined = _again(solved, at)
    return _first_highest(np.append(at, highest[0]), np.append(refined, highest[1]))


def _first_highest(time: Real, values: Real) -> tuple[float, float]:
    """The first of the times (n,) [s] at which values (n,), not all of them NaN, are largest, and this value."""
    known = np.where(np.isnan(values), -np.inf, values)
    highest = known.max()
    first = int(np.argmax(known >= highest - EQUAL * abs(highest) if np.isfinite(highest) else known == highest))
    return float(time[first]), float(values[first])


def _highest(values: Real) -> float:
    """The point of [-1, 1] at which the polynomial through values at the nodes is highest; NaN if a value is not finite."""
    if not np.isfinite(values).all():
        return np.nan
    coefficients = FIT @ values
    extremes = chebyshev.chebroots(chebyshev.chebder(coefficients)) if np.ptp(values) > 0.0 else np.zeros(1)
    inside = extremes.real[(np.abs(extremes.imag) < 1e-6) & (np.abs(extremes.real) < 1.0)]
    places = np.concatenate([[-1.0], inside, [1.0]])
    return float(places[np.argmax(chebyshev.chebval(places, coefficients))])


def _at_other_times(motion: Motion, metric: Metric) -> AtTimes:
    return lambda t: metric(motion.at_times(t)) if motion.at_times is not None else np.full(len(t), np.nan)


def _again(solved: Callable[[Real], Any], times: Real) -> Any:
    """A quantity at times (...) [s] in any order; values of several parts have these as their last axes."""
    flat = np.ravel(times)
    order = np.argsort(flat, kind="stable")
    values = solved(flat[order])
    out = np.empty_like(values)
    out[order] = values
    return out.reshape((*np.shape(times), *values.shape[1:]))


def zeros(motion: Motion, rows: Metric, places: Real, which: Index | None = None) -> Real:
    """Times (n,) [s] at which quantities pass through zero or jump past it, to the accuracy of events.

    ``places`` (n, 3) [s]: the last frame before, an estimate, and the first frame behind; ``rows``: motion -> value and rate
    (F, 2), or of several quantities (F, k, 2), of which ``which`` (n,) names the one of each place. Newton's method finds simple
    zeros; where it does not settle between the two frames, as at jumps and at zeros of higher order, these are divided again and
    again.
    """
    low, at, high = np.array(places, float).reshape(-1, 3).T
    if motion.at_times is None or not len(at) or motion.frames < 2:
        return at
    tolerance, solved = _tolerance(motion), _at_other_times(motion, rows)

    def there(t: Real, chosen: Index) -> Real:
        found: Real = _again(solved, t)
        return found if which is None else found[np.arange(len(t)), which[chosen]]

    every, moved = np.arange(len(at)), np.full(len(at), np.inf)
    for _ in range(NEWTON_STEPS):
        value, rate = there(at, every).T
        with np.errstate(divide="ignore", invalid="ignore"):
            to = at - value / rate
        inside = (to >= low - tolerance) & (to <= high + tolerance)
        to = np.where(inside, np.clip(to, low, high), at)
        moved, at = np.where(inside, np.abs(to - at), np.inf), to
        if moved.max() <= tolerance:
            return at
    late = np.flatnonzero(moved > tolerance)
    side, other = (np.sign(there(ends[late], late)[:, 0]) for ends in (low, high))
    late, side = late[side * other < 0.0], side[side * other < 0.0]

    def excess(t: Real) -> Real:
        """Values (n, m) on the other side of zero; where a rest begins, a least one."""
        values = there(t.ravel(), np.repeat(late, t.shape[1]))[:, 0].reshape(t.shape)
        return np.where(values == 0.0, np.finfo(float).tiny, -side[:, None] * values)

    if len(late):
        at[late] = _crossings(low[late], high[late], excess, tolerance)
        apart = APART * (high[late] - low[late])
        at[late] = _multiple_zeros(at[late], apart, motion.time[[0, -1]], lambda t, n: there(t, late[n])[:, 0])
    return at


def _multiple_zeros(at: Real, apart: Real, ends: Real, values: Callable[[Real, Index], Real]) -> Real:
    """Zeros (n,) near the times ``at`` to more digits where they are of higher order, as at the end of a cam's rise.

    Rounding hides the values next to such a zero; on either side, roots of values at multiples of ``apart`` (n,) [s] from it lead
    to it. ``values``: times (m,) and the numbers of their zeros. Other zeros are unchanged, as are those nearer to the ``ends`` of
    the run.
    """
    steps = apart[:, None] * np.arange(1, 5)
    number = np.repeat(np.arange(len(at)), steps.shape[1])
    found = []
    for side in (-1.0, 1.0):
        t = at[:, None] + side * steps
        inside = (t[:, -1] >= ends[0]) & (t[:, -1] <= ends[1])
        size = np.abs(values(np.where(inside[:, None], t, at[:, None]).ravel(), number)).reshape(t.shape)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            order = np.rint(np.log2(size[:, 1] / size[:, 0]))
            root: Real = np.power(size, 1.0 / order[:, None])
            others = root[:, None, :] - root[:, :, None]
            np.einsum("nii->ni", others)[:] = root
            place = (t * np.prod(root[:, None, :] / others, axis=2)).sum(axis=1)  # inverse interpolation: where the root is 0
        found.append(np.where(inside & (order >= 2.0), place, np.where(inside & (size == 0.0).all(axis=1), np.inf, np.nan)))
    first, last = (np.where(np.isinf(own), other, own) for own, other in (found, found[::-1]))  # a rest begins or ends there
    zero = 0.5 * (first + last)
    with np.errstate(invalid="ignore"):
        known = (np.abs(last - first) <= SAME_ZERO * apart) & (np.abs(zero - at) <= apart)
    return np.where(known, zero, at)


def _tolerance(motion: Motion) -> float:
    """The accuracy of events in time [s]."""
    return motion.accuracy.event * float(np.max(np.diff(motion.time), initial=0.0))


@dataclass(frozen=True)
class Exceedance:
    """An interval of time [s] in which a quantity exceeds a limit, and its largest ``value``, at the time ``at`` [s]."""

    start: float
    end: float
    at: float
    value: float


def exceedances(motion: Motion, metric: Metric, limit: float, within: Flags | None = None) -> list[Exceedance]:
    """Intervals in which a quantity exceeds a limit, also those between two frames, in order of time; see `exceedances_of`."""
    return exceedances_of(motion, metric(motion), limit, _at_other_times(motion, metric), within)


def exceedances_of(motion: Motion, values: Real, limit: float, solved: AtTimes, within: Flags | None = None) -> list[Exceedance]:
    """Intervals in which a quantity exceeds a limit, also those between two frames, in order of time.

    ``values`` (F,): the quantity at the frames, NaN where it is unknown; ``solved``: the same at other times, where the motion can
    be solved there (else it is linear between the frames); ``within`` (F,): the frames that count. The ends have the accuracy of
    events, at jumps too; the largest value is that of a smooth quantity to about 1e-9 of its change between two frames. What
    exceeds the limit by less than ``EQUAL`` of it is rounding.
    """
    time, known = motion.time, np.ones(motion.frames, bool) if within is None else within
    if motion.at_times is None:
        solved = partial(_linear, time, values)
    elif len(tops := _tops(np.where(known, values, np.nan), limit)):
        at, highest = _peaks(time, tops, solved)
        place = np.searchsorted(time, at)
        fresh = time[np.minimum(place, len(time) - 1)] != at
        place, at, highest = place[fresh], at[fresh], highest[fresh]
        time, values, known = np.insert(time, place, at), np.insert(values, place, highest), np.insert(known, place, True)
    with np.errstate(invalid="ignore"):
        above = known & (values > limit)
        ends = _intervals(time, above, known, lambda t: _again(solved, t) - limit, _tolerance(motion))
    tops = np.array([a + int(np.argmax(values[a : b + 1])) for a, b in runs(above)], int)
    found = zip(ends, time[tops].tolist(), values[tops].tolist(), strict=True)
    return [Exceedance(*interval, at, value) for interval, at, value in found if value > limit + EQUAL * abs(limit)]


def intervals(motion: Motion, flags: Flags, excess: AtTimes) -> list[tuple[float, float]]:
    """Starts and ends [s] of the intervals in which a condition holds, to the accuracy of events.

    ``flags`` (F,): whether it holds at the frames; ``excess``: a quantity at other times that is positive where it holds, where the
    motion can be solved there.
    """
    known = np.ones(motion.frames, bool) if motion.at_times is not None else flags
    return _intervals(motion.time, flags, known, partial(_again, excess), _tolerance(motion))


def _intervals(
    time: Real, flags: Flags, known: Flags, excess: Callable[[Real], Real], tolerance: float
) -> list[tuple[float, float]]:
    """Starts and ends of the intervals in which an excess, times (n, m) -> values (n, m), is positive: between the frames at which
    it is and next ones, if these are ``known``, at which it is not."""
    spans = runs(flags)
    if not spans:
        return []
    first, last = np.array(spans).T
    before, behind = np.maximum(first - 1, 0), np.minimum(last + 1, len(time) - 1)
    before, behind = np.where(known[before], before, first), np.where(known[behind], behind, last)
    outside, inside = time[np.concatenate([before, behind])], time[np.concatenate([first, last])]
    start, end = _crossings(outside, inside, excess, tolerance).reshape(2, -1).tolist()
    return list(zip(start, end, strict=True))


def _linear(time: Real, values: Real, t: Real) -> Real:
    return np.interp(t, time, values)


def _tops(values: Real, limit: float) -> Index:
    """The frames at which values (F,) are local maxima that may exceed a limit, if only between the frames; the highest ones. What
    is constant but for rounding has none."""
    around = np.pad(values, 1, mode="edge")
    before, behind = around[:-2], around[2:]
    with np.errstate(invalid="ignore"):
        drop = values - np.minimum(before, behind)
        high = (values >= before) & (values >= behind) & (drop > EQUAL * np.abs(values))
        tops = np.flatnonzero(high & np.isfinite(drop) & (values + PEAK_RISE * drop > limit))
    return tops[np.argsort(-values[tops], kind="stable")[:MOST_PEAKS]]


def _peaks(time: Real, tops: Index, solved: AtTimes) -> tuple[Real, Real]:
    """Times (n,) [s], ascending and distinct, and values of the maxima next to the frames ``tops``."""
    low, high = time[np.maximum(tops - 1, 0)], time[np.minimum(tops + 1, len(time) - 1)]
    row = np.arange(len(tops))
    for _ in range(PEAK_ROUNDS):
        t = low[:, None] + (high - low)[:, None] * SECTIONS
        values = _again(solved, t)
        best = np.argmax(np.where(np.isnan(values), -np.inf, values), axis=1)
        low, high = t[row, np.maximum(best - 1, 0)], t[row, np.minimum(best + 1, len(SECTIONS) - 1)]
    beside = np.clip(best - 1, 0, len(SECTIONS) - 3)[:, None] + np.arange(3)
    at, highest = t[row, best], values[row, best]
    vertex = _vertex(np.take_along_axis(t, beside, axis=1), np.take_along_axis(values, beside, axis=1), at)
    there = _again(solved, vertex)
    at, highest = np.where(there > highest, vertex, at), np.fmax(there, highest)
    at, which = np.unique(at, return_index=True)
    return at, highest[which]


def _vertex(t: Real, values: Real, otherwise: Real) -> Real:
    """The times (n,) of the vertices of parabolas through three values each (n, 3), where these lie between the outer ones."""
    (a, b, c), (p, q, r) = t.T, values.T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        left, right = (q - p) / (b - a), (r - q) / (c - b)
        vertex = 0.5 * (a + b) - 0.5 * left * (c - a) / (right - left)
    return np.where((vertex > a) & (vertex < c), vertex, otherwise)


def _crossings(outside: Real, inside: Real, excess: Callable[[Real], Real], tolerance: float) -> Real:
    """Times (n,) [s] at which excesses become positive, each between a time at which its own is not and one at which it is;
    ``excess``: times (n, m) -> values (n, m).

    In every round the interval is divided into equal sections, and more finely about the zero of a straight line.
    """
    row, zero = np.arange(len(inside)), np.full(len(inside), 0.5)
    for _ in range(SECTION_ROUNDS):
        if np.abs(inside - outside).max() <= tolerance:
            break
        about = np.clip(zero[:, None] + ABOUT_ZERO, 0.0, 1.0)
        places = np.sort(np.column_stack([np.broadcast_to(SECTIONS, (len(row), len(SECTIONS))), about]), axis=1)
        t = outside[:, None] + (inside - outside)[:, None] * places
        values = excess(t)
        with np.errstate(invalid="ignore"):
            exceeds = values > 0.0
        exceeds[:, 0], exceeds[:, -1] = False, True  # as is known
        first = np.argmax(exceeds, axis=1)
        before, behind = values[row, first - 1], values[row, first]
        with np.errstate(divide="ignore", invalid="ignore"):
            zero = np.clip(np.nan_to_num(before / (before - behind), nan=0.5), 0.0, 1.0)
        outside, inside = t[row, first - 1], t[row, first]
    return inside
