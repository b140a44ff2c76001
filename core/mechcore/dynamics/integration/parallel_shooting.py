"""A motion found anew from one that is nearly right: many windows at once instead of one after the other.

`integrate` marches because nothing is known of the next window before the last one is solved. Where a motion is known already and
its error is to be found, its accelerations start Newton's method on the collocation equations of many windows together. What
couples the windows is linear: a correction at a window's start changes its end by a matrix of the size of the state. All nodes are
evaluated in one call, their slopes in another, and one batch of linear systems corrects the whole trajectory; what is left of the
error is of the order of its square (parallel shooting; the first step is deferred correction: Hairer, Wanner, "Solving Ordinary
Differential Equations I", II.7 and II.14).

The equations that are solved are those of the new rule on the new windows, whatever they were started from. What is known only
says where to begin, and how long the windows are at first: each is halved until the last coefficients of its own series are below
the new tolerance. Where that does not lead to a solution, `integrate` finds the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.dynamics.integration.collocation import Rule, Window, gauss, integrals, radau
from mechcore.dynamics.integration.windows import BreakpointFinder, Solution, System, integrate, nodes_for, tails
from mechcore.errors import MechanismError

MORE = 3  # nodes beyond those of the tolerance: the windows are at first those of a looser one
MOST = 4096  # nodes that are solved together
HALVINGS = 8  # of windows, before they are too many
LINEAR = 1e-5  # of the scale: what a correction of this size leaves is of the order of its square
STEPS = 6  # of Newton's method
SHRINKS = 0.3  # part of a correction that the next one may have
NEAR = 1e-10  # of a window: a breakpoint so near to its end is there
SLIVER = 0.05  # of the window after it: what a breakpoint has left of one goes with that


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of a motion: ``boundaries`` (k + 1,) [s] of windows where it is smooth; ``cut`` (k,): those that end where the
    equations change their form; ``acceleration``: times (n,) -> (n, f)."""

    boundaries: Real
    cut: Flags
    acceleration: Callable[[Real], Real]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Windows in a row: ``boundaries`` (k + 1,) [s], position and speed ``q``, ``v`` (k + 1, f) there, and at the nodes ``at``
    (2, k, s, f), with accelerations ``a`` (k, s, f)."""

    boundaries: Real
    q: Real
    v: Real
    at: tuple[Real, Real]
    a: Real

    @classmethod
    def along(cls, rule: Rule, boundaries: Real, q: Real, v: Real, a: Real) -> Trajectory:
        """The way on which accelerations ``a`` lead from q, v (f,)."""
        h = np.diff(boundaries)[:, None]
        once, twice = _ends(rule)
        gain = np.tensordot(a, once, (1, 0))
        speeds = np.concatenate([v[None], v + np.cumsum(h * gain, axis=0)])
        steps = h * speeds[:-1] + h * h * np.tensordot(a, twice, (1, 0))
        places = np.concatenate([q[None], q + np.cumsum(steps, axis=0)])
        h, start, rate = h[:, None], places[:-1, None], speeds[:-1, None]
        at = start + h * rule.nodes[:, None] * rate + h * h * (rule.twice @ a), rate + h * (rule.once @ a)
        return cls(boundaries, places, speeds, at, a)

    def windows(self, rule: Rule) -> list[Window]:
        """The windows one by one."""
        series = rule.legendre @ self.a
        lengths = np.diff(self.boundaries)
        return [Window(float(self.boundaries[k]), float(lengths[k]), self.q[k], self.v[k], series[k]) for k in range(len(lengths))]


def _acceleration(window: Window, t: Real) -> Real:
    return window(t)[2]


def _ends(rule: Rule) -> tuple[Real, Real]:
    """From the nodes' values (s,) to the first and the second integral over a window."""
    once, twice = integrals(len(rule.nodes), np.ones(1))
    return once[0] @ rule.legendre, twice[0] @ rule.legendre


def refine(
    system: System,
    q: Real,
    v: Real,
    t0: float,
    t1: float,
    *,
    known: Known,
    tolerance: float = 1e-9,
    scale: Real | float = 1.0,
    stiff: bool = False,
    nodes: int | None = None,
    most: float | None = None,
    after: Callable[[Window], float | None] | None = None,
    breakpoints: BreakpointFinder | None = None,
    keeps: Callable[[Real, Real], Real] | None = None,
) -> Solution:
    """What `integrate` does, by what is ``known``; the other arguments and what it raises are those of that."""
    s = (nodes or nodes_for(tolerance)) + MORE
    rule: Rule = radau(s) if stiff else gauss(s)
    solver = _Solver(system, rule, tolerance, scale)
    found = Solution()
    t, q, v = t0, np.asarray(q, float), np.asarray(v, float)
    least = 1e-13 * max(abs(t0), abs(t1), 1e-300)
    keep = (known.boundaries[1:] > t0 + 20.0 * least) & (known.boundaries[:-1] < t1 - least)
    ends, cut = np.minimum(known.boundaries[1:][keep], t1), known.cut[keep]
    if len(ends) and most is not None and np.diff(np.append(t0, ends)).max() > most:
        ends, cut = ends[:0], cut[:0]
    if breakpoints is not None:  # what a law states in time is where it was
        cut = cut & np.array([abs(breakpoints.stated(end - 20.0 * least) - end) > 20.0 * least for end in ends], bool)
    block = max(1, MOST // s)
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
            break_time = None if breakpoints is None else breakpoints(window, window.start + 10.0 * least)
            if breakpoints is not None and break_time is not None and break_time < window.start + window.length * (1.0 - NEAR):
                window = solver.until(window, break_time, breakpoints, least)
                bent += 1
            else:
                break_time = None
            found.windows.append(window)
            t = window.start + window.length
            if after is not None and after(window) is not None:
                found.evaluations = solver.evaluations
                return found
            if break_time is not None:
                later = trajectory.boundaries[trajectory.boundaries > t + 20.0 * least]
                ends, cut = np.concatenate([later, ends]), np.concatenate([np.zeros(len(later), bool), cut])
                if len(ends) > 1 and ends[0] - t < SLIVER * (ends[1] - ends[0]):
                    ends, cut = ends[1:], cut[1:]
                break
        end_q, end_v, _ = found.windows[-1](np.array([t]))
        q, v = end_q[0], end_v[0] if keeps is None else keeps(end_q[0], end_v[0])
    found.evaluations = solver.evaluations
    if t < t1 - least:
        rest = integrate(
            system,
            q,
            v,
            t,
            t1,
            tolerance=tolerance,
            scale=scale,
            stiff=stiff,
            nodes=nodes,
            most=most,
            after=after,
            breakpoints=breakpoints,
            keeps=keeps,
        )
        found.windows += rest.windows
        found.evaluations += rest.evaluations
    return found


class _Solver:
    """Trajectories of windows from a start, by one rule and to one tolerance."""

    def __init__(self, system: System, rule: Rule, tolerance: float, scale: Real | float):
        self.system, self.rule, self.tolerance, self.scale = system, rule, tolerance, scale
        self.evaluations = 0
        self.longest = 0.0

    def solve(self, boundaries: Real, q: Real, v: Real, guess: Callable[[Real], Real]) -> Trajectory | None:
        """Windows between ``boundaries``, halved where needed; None where Newton's method does not converge."""
        try:
            started = self._fine(boundaries, q, v, guess)
            return None if started is None else self._newton(*started)
        except MechanismError:  # some equations say it where they have no solution; what is known may have led there
            return None

    def until(self, window: Window, break_time: float, breakpoints: BreakpointFinder, least: float) -> Window:
        """A window that ends at its first breakpoint. Where that is not found, the window as long as it was guessed."""
        for _ in range(5):
            boundaries = np.array([window.start, break_time])
            found = self.solve(boundaries, window.q, window.v, partial(_acceleration, window))
            if found is None or len(found.a) > 1:
                return Window(window.start, break_time - window.start, window.q, window.v, self._part(window, break_time), True)
            (window,) = found.windows(self.rule)
            again = breakpoints(window, window.start + 10.0 * least)
            if again is None or again >= break_time - NEAR * window.length:
                break
            break_time = again
        return Window(window.start, window.length, window.q, window.v, window.a, True)

    def _part(self, window: Window, end: float) -> Real:
        """Series of a window's acceleration until an earlier end."""
        return self.rule.legendre @ window(window.start + (end - window.start) * self.rule.nodes)[2]

    def _fine(self, boundaries: Real, q: Real, v: Real, guess: Callable[[Real], Real]) -> tuple[Trajectory, Real] | None:
        """The guess on windows that are short enough, and what the equations say of the accelerations on it."""
        for _ in range(HALVINGS):
            h = np.diff(boundaries)
            t = boundaries[:-1, None] + h[:, None] * self.rule.nodes
            trajectory = Trajectory.along(self.rule, boundaries, q, v, guess(t.ravel()).reshape(*t.shape, len(q)))
            force = self._evaluate(trajectory)
            if not np.isfinite(force).all():
                return None
            rough = self._missed(force, h)
            if rough.max() <= 4.0:
                return trajectory, force
            middle = 0.5 * (boundaries[1:] + boundaries[:-1])[rough > 4.0]
            boundaries = np.sort(np.concatenate([boundaries, middle]))
            if len(boundaries) * len(self.rule.nodes) > 4 * MOST:
                return None
        return None

    def _missed(self, a: Real, h: Real) -> Real:
        """Estimated error of each window (k,) over the tolerance."""
        longest = np.maximum.accumulate(np.append(self.longest, h))[1:]
        return np.asarray((tails(self.rule.legendre @ a, h, longest)[0] / (self.tolerance * self.scale)).max(axis=1))

    def _times(self, trajectory: Trajectory) -> Real:
        return (trajectory.boundaries[:-1, None] + np.diff(trajectory.boundaries)[:, None] * self.rule.nodes).ravel()

    def _evaluate(self, trajectory: Trajectory) -> Real:
        self.evaluations += 1
        q, v = (x.reshape(-1, x.shape[-1]) for x in trajectory.at)
        return np.asarray(self.system(q, v, self._times(trajectory))).reshape(trajectory.a.shape)

    def _newton(self, trajectory: Trajectory, force: Real) -> Trajectory | None:
        last = np.inf
        for _ in range(STEPS):
            better = self._corrected(trajectory, force)
            size = max(
                float((np.abs(x - y) / self.scale).max()) for x, y in ((better.q, trajectory.q), (better.at[0], trajectory.at[0]))
            )
            if not size <= SHRINKS * last:
                return None
            trajectory, last = better, size
            if size <= LINEAR:
                h = np.diff(trajectory.boundaries)
                if self._missed(trajectory.a, h).max() > 16.0:
                    return None
                self.longest = max(self.longest, float(h.max()))
                return trajectory
            force = self._evaluate(trajectory)
            if not np.isfinite(force).all():
                return None
        return None

    def _corrected(self, trajectory: Trajectory, force: Real) -> Trajectory:
        """One step of Newton's method on all windows, their starts corrected with the ends before them."""
        rule, h = self.rule, np.diff(trajectory.boundaries)
        k, s, f = trajectory.a.shape
        q, v = (x.reshape(-1, f) for x in trajectory.at)
        slopes = self.system.slopes(q, v, self._times(trajectory), force.reshape(-1, f))
        self.evaluations += 2 * f
        by_q, by_v = (x.reshape(k, s, f, f) for x in slopes)
        h4 = h[:, None, None, None]
        matrix = np.einsum("kiab,ij->kiajb", -h4 * h4 * by_q, rule.twice) - np.einsum("kiab,ij->kiajb", h4 * by_v, rule.once)
        matrix = matrix.reshape(k, s * f, s * f) + np.eye(s * f)
        from_start = np.concatenate([by_q, by_v + h4 * rule.nodes[:, None, None] * by_q], axis=3)
        rhs = np.concatenate([(force - trajectory.a)[..., None], from_start], axis=3).reshape(k, s * f, 1 + 2 * f)
        found = np.linalg.solve(matrix, rhs).reshape(k, s, f, 1 + 2 * f)
        once, twice = _ends(rule)
        h3 = h[:, None, None]
        ends = np.concatenate(
            [h3 * h3 * np.einsum("s,ksfc->kfc", twice, found), h3 * np.einsum("s,ksfc->kfc", once, found)], axis=1
        )
        ends[:, :, 1:] += np.eye(2 * f)
        ends[:, range(f), range(1 + f, 1 + 2 * f)] += h[:, None]
        starts = np.zeros((k, 2 * f))
        state = starts[0]
        for i in range(1, k):
            state = starts[i] = ends[i - 1, :, 0] + ends[i - 1, :, 1:] @ state
        a = trajectory.a + found[..., 0] + (found[..., 1:] @ starts[:, None, :, None])[..., 0]
        return Trajectory.along(rule, trajectory.boundaries, trajectory.q[0], trajectory.v[0], a)
