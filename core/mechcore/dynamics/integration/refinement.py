"""A motion computed again from one that is nearly right: many windows at once instead of one after the other.

`Integrator` marches because nothing is known of the next window before the last one is solved. Where a motion is known already and
its error is to be found, its accelerations start Newton's method on the collocation equations of many windows together
(`ParallelShooting`); the first step is deferred correction.

The equations that are solved are those of the new rule on the new windows, whatever they were started from. The known
motion only says where to begin, and how long the windows are at first: each is halved until the last coefficients of its own
series are below the new tolerance. Where that does not lead to a solution, `Integrator` finds the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.dynamics.integration.collocation import Window
from mechcore.dynamics.integration.parallel_shooting import MOST_NODES, ParallelShooting
from mechcore.dynamics.integration.windows import AT_START, BreakpointFinder, Integrator, Solution
from mechcore.records import dataclass

MORE_NODES = 3  # nodes beyond those of the tolerance: the windows are at first those of a looser one
WINDOW_END = 1e-10  # part of a window: a breakpoint so near to its end counts as its end
LEAST_WINDOW = 0.05  # part of the next window: a shorter remainder after a breakpoint is merged with it


@dataclass(frozen=True, eq=False)
class KnownMotion:
    """A known motion: ``boundaries`` (k + 1,) [s] of windows where it is smooth; ``cut`` (k,): those that end where the
    equations change their form; ``acceleration``: times (n,) -> (n, f)."""

    boundaries: Real
    cut: Flags
    acceleration: Callable[[Real], Real]


def _acceleration(window: Window, t: Real) -> Real:
    return window.acceleration(t)


def refine(by: Integrator, q: Real, v: Real, t0: float, t1: float, known: KnownMotion) -> Solution:
    """The solution of `Integrator.run`, started from the ``known`` motion; it raises the same errors."""
    rule, breakpoints = by.rule(MORE_NODES), by.breakpoints
    solver = ParallelShooting(by.system, rule, by.tolerance, by.scale)
    solution = Solution()
    t, q, v = t0, np.asarray(q, float), np.asarray(v, float)
    least = 1e-13 * max(abs(t0), abs(t1), 1e-300)
    keep = (known.boundaries[1:] > t0 + AT_START * least) & (known.boundaries[:-1] < t1 - least)
    ends, cut = np.minimum(known.boundaries[1:][keep], t1), known.cut[keep]
    if len(ends) and by.most is not None and np.diff(np.append(t0, ends)).max() > by.most:
        ends, cut = ends[:0], cut[:0]
    if breakpoints is not None:  # breakpoints that laws state in time have not moved
        cut = cut & np.array([abs(breakpoints.stated(end - 20.0 * least) - end) > 20.0 * least for end in ends], bool)
    block = max(1, MOST_NODES // len(rule.nodes))
    bent = 0
    while len(ends) and bent <= 2 * len(known.cut):
        count = int(np.argmax(cut[:block])) + 1 if breakpoints is not None and cut[:block].any() else min(block, len(ends))
        trajectory = solver.solve(np.append(t, ends[:count]), q, v, known.acceleration)
        if trajectory is None:
            if count == 1:
                break
            block = max(1, count // 4)
            continue
        ends, cut = ends[count:], cut[count:]
        for window in trajectory.windows(rule):
            break_time = None if breakpoints is None else breakpoints(window, window.start + AT_START * least)
            if (
                breakpoints is not None
                and break_time is not None
                and break_time < window.start + window.length * (1.0 - WINDOW_END)
            ):
                window = _until(solver, window, break_time, breakpoints, least)
                bent += 1
            else:
                break_time = None
            solution.windows.append(window)
            t = window.start + window.length
            if by.on_window is not None and by.on_window(window) is not None:
                solution.evaluations = solver.evaluations
                return solution
            if break_time is not None:
                later = trajectory.boundaries[trajectory.boundaries > t + AT_START * least]
                ends, cut = np.concatenate([later, ends]), np.concatenate([np.zeros(len(later), bool), cut])
                if len(ends) > 1 and ends[0] - t < LEAST_WINDOW * (ends[1] - ends[0]):
                    ends, cut = ends[1:], cut[1:]
                break
        end_q, end_v, _ = solution.windows[-1](np.array([t]))
        q, v = end_q[0], end_v[0] if by.speed_by_integral is None else by.speed_by_integral(end_q[0], end_v[0])
    solution.evaluations = solver.evaluations
    if t < t1 - least:
        rest = by.run(q, v, t, t1)
        solution.windows += rest.windows
        solution.evaluations += rest.evaluations
    return solution


def _until(solver: ParallelShooting, window: Window, break_time: float, breakpoints: BreakpointFinder, least: float) -> Window:
    """A window that ends at its first breakpoint. Where this window cannot be solved, the given one is cut at the estimated
    breakpoint."""
    for _ in range(5):
        boundaries = np.array([window.start, break_time])
        trajectory = solver.solve(boundaries, window.q, window.v, partial(_acceleration, window))
        if trajectory is None or len(trajectory.a) > 1:
            part = solver.rule.legendre @ _acceleration(window, window.start + (break_time - window.start) * solver.rule.nodes)
            return Window(window.start, break_time - window.start, window.q, window.v, part, True)
        (window,) = trajectory.windows(solver.rule)
        again = breakpoints(window, window.start + AT_START * least)
        if again is None or again >= break_time - WINDOW_END * window.length:
            break
        break_time = again
    return Window(window.start, window.length, window.q, window.v, window.a, True)
