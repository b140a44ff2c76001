"""Windows of collocation, one after the other, with control of their length to a requested tolerance."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import field
from typing import Any, Protocol

import numpy as np

from mechcore.arrays import Real, numbers
from mechcore.compiled.collocation import BatchLimits, CollocationRule, WindowBatch, WindowTrial
from mechcore.dynamics.integration.collocation import (
    Rule,
    System,
    Window,
    gauss,
    integrals_and_values,
    neglected_tails,
    radau,
    solve_window,
    tails,
)
from mechcore.dynamics.integration.parallel_shooting import MOST_NODES, ParallelShooting
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass

# Times the tolerance: a tail of high order may be so large, as a slightly shorter window meets the tolerance; none of low order may
TAIL_MARGIN = 4.0
SCALE_ROUNDING = 1e-15  # part of the scale: the smallest tolerance of Newton's method
LONGER_WINDOW = 1.6  # largest ratio of a window's length to that of the one before
FEW_WINDOWS = 3  # consecutive windows that end at stated breakpoints: this many or more are solved together
# Factors of the reach of a row: if the last row was solved, if it was not, and after a single window
FARTHER_REACH, NEARER_REACH, RECOVERED_REACH = 2.0, 0.3, 1.2
AT_START = 20.0  # shortest lengths: a breakpoint nearer to a window's start is the one at which it begins, and hides no later one
# Windows shorter than this part of the longest are chatter; more than so many in a row, cut at breakpoints, are an error
CHATTER_LENGTH, MOST_CUT = 1e-5, 400
# Windows after which the length of the next predicts the number left; for more than so many, compiling a program pays
SETTLED_WINDOWS, MANY_WINDOWS = 8, 250
BATCH_WINDOWS = 64  # windows that a compiled program solves in a call


class WindowProgram(Protocol):
    """Equations of motion and their windows as a compiled program. ``alone``: it solves windows without other input; ``has_forms``:
    it evaluates the forms of laws; ``partial``: where it has no result, numpy may have one."""

    @property
    def alone(self) -> bool: ...
    @property
    def partial(self) -> bool: ...
    @property
    def has_forms(self) -> bool: ...
    def near(self, q: Real, v: Real, t: Real) -> Real: ...
    def window(self, rule: CollocationRule, trial: WindowTrial) -> tuple[Real, int] | None: ...
    def windows(self, rule: CollocationRule, at: Real, limits: BatchLimits) -> WindowBatch: ...


class BreakpointFinder(Protocol):
    """Finds breakpoints, where the equations change their form. A call returns the first one [s] in a window later than ``after``,
    or None; ``stated`` the first one that is known without a window. ``searched``: there may be others than the stated ones."""

    def __call__(self, window: Window, after: float) -> float | None: ...

    def stated(self, after: float) -> float: ...
    @property
    def searched(self) -> bool: ...


@dataclass
class Solution:
    """Windows in order of time: the dense output. ``evaluations``: calls of the system, all nodes of a window in each."""

    windows: list[Window] = field(default_factory=list)
    evaluations: int = 0
    rejected: int = 0
    _stack: tuple[Real, ...] = field(default=(), repr=False, compare=False)

    @property
    def end(self) -> float:
        last = self.windows[-1]
        return last.start + last.length

    def __call__(self, t: Any) -> tuple[Real, Real, Real]:
        """Position, speed and acceleration (n, f) at times (n,); a time on the boundary belongs to the earlier window."""
        t = numbers(t)
        x, length, q, v, a = self._within(t)
        first, second, values = integrals_and_values(a.shape[1], x)
        moved = (length * length)[:, None] * (second[:, None, :] @ a)[:, 0]
        return (
            q + (length * x)[:, None] * v + moved,
            v + length[:, None] * (first[:, None, :] @ a)[:, 0],
            (values[:, None, :] @ a)[:, 0],
        )

    def state(self, t: float) -> tuple[Real, Real]:
        """Position and speed (f,) at a time near the end, as `__call__` has them, without looking at all windows."""
        q, v, _ = next((w for w in reversed(self.windows) if w.start < t), self.windows[0])(np.array([t]))
        return q[0], v[0]

    def _within(self, t: Real) -> tuple[Real, ...]:
        """Positions (n,) of times in their windows, from 0 to 1, and the lengths, initial positions and speeds, and series of these
        windows."""
        starts, lengths, q, v, a = self._stacked()
        k = np.clip(np.searchsorted(starts, t, side="left") - 1, 0, len(starts) - 1)
        length = lengths[k]
        return (t - starts[k]) / length, length, q[k], v[k], a[k]

    def _stacked(self) -> tuple[Real, ...]:
        """Starts, lengths (w,), positions, speeds (w, f) and series (w, s, f) of all windows, shorter series padded with zeros."""
        if len(self._stack) == 0 or len(self._stack[0]) != len(self.windows):
            starts, lengths, q, v, series, *_ = zip(*self.windows, strict=True)
            n, most = len(starts), max(map(len, series))
            filled = [a if len(a) == most else np.pad(a, ((0, most - len(a)), (0, 0))) for a in series]
            f = len(q[0])
            shapes = (n, f), (n, f), (n, most, f)
            self._stack = (
                np.array(starts),
                np.array(lengths),
                *(np.concatenate(x).reshape(shape) for x, shape in zip((q, v, filled), shapes, strict=True)),
            )
        return self._stack


def nodes_for(tolerance: float) -> int:
    """Nodes per window for a relative tolerance: two more than its digits, 5 to 14 (measured: the cost is flat between 8 and
    14)."""
    return min(max(round(-math.log10(max(tolerance, 1e-15))) + 2, 5), 14)


@dataclass(frozen=True, eq=False)
class Integrator:
    """How a system is integrated by collocation, window by window.

    ``tolerance``: local error of the position, relative to ``scale`` (a typical size of q, a number or (f,)). ``nodes``: of a
    window, ``most``: longest window [s]. ``on_window`` is called with every accepted window; a time that it returns ends the
    integration there. ``on_windows`` is called first with several consecutive windows: it returns False where ``on_window`` has to
    be called with each. ``breakpoints`` finds the first time in a window, later than a given one, at which the equations change
    their form: windows end there. ``speed_by_integral``: position and speed at the end of a window -> the speed that a first
    integral gives there.
    """

    system: System
    tolerance: float = 1e-9
    scale: Real | float = 1.0
    stiff: bool = False
    nodes: int | None = None
    most: float | None = None
    on_window: Callable[[Window], float | None] | None = None
    on_windows: Callable[[Sequence[Window]], bool] | None = None
    breakpoints: BreakpointFinder | None = None
    speed_by_integral: Callable[[Real, Real], Real] | None = None

    def rule(self, more: int = 0) -> Rule:
        """The collocation rule of its windows, with ``more`` additional nodes."""
        nodes = (self.nodes or nodes_for(self.tolerance)) + more
        return radau(nodes) if self.stiff else gauss(nodes)

    @property
    def newton_tolerance(self) -> float:
        """Error of positions that Newton's method leaves, in units of q."""
        return max(1e-3 * self.tolerance, SCALE_ROUNDING) * float(np.min(self.scale))

    @property
    def longest(self) -> float:
        """Longest window that is allowed [s]."""
        return np.inf if self.most is None else self.most

    @property
    def searches_breakpoints(self) -> bool:
        """Whether a window may contain breakpoints that are not stated in advance."""
        return self.breakpoints is not None and self.breakpoints.searched

    def limits(self, t: float, end: float, shortest: float, count: int) -> BatchLimits:
        """The limits of a compiled program from a time ``t`` to an ``end`` [s], with ``count`` windows at the most."""
        breaks = _breaks_from(self.breakpoints, t, end, count)
        bounds = end, shortest, self.longest, self.tolerance, self.newton_tolerance
        return BatchLimits(*bounds, count, self.searches_breakpoints, breaks)

    @staticmethod
    def least(t0: float, t1: float) -> float:
        """Shortest window of an integration between two times [s]."""
        return 1e-13 * max(abs(t0), abs(t1), 1e-300)

    def run(self, q: Real, v: Real, t0: float, t1: float) -> Solution:
        """The solution from ``t0`` to ``t1`` [s], starting at q, v (f,).

        Where many breakpoints are stated within the length that one window would have, the windows between them are solved
        together. Raises `MechanismError` where even the shortest window fails.
        """
        return _Integration(self, np.asarray(q, float), np.asarray(v, float), t0, t1).run()


class _Integration:
    """An integration under way: time ``t``, position and speed there, and the length ``h`` of the next window."""

    def __init__(self, by: Integrator, q: Real, v: Real, t0: float, t1: float):
        self.by, self.rule = by, by.rule()
        self.t, self.t1, self.q, self.v = t0, t1, q, v
        self.solution = Solution(evaluations=1)
        self.end_a = by.system(q[None], v[None], np.array([t0]))
        self.h = _first_window(q, v, self.end_a[0], t1 - t0, by.scale)
        self.guess = np.repeat(self.end_a, len(self.rule.nodes), axis=0)
        self.least = by.least(t0, t1)
        self.longest = 0.0  # window so far
        self.chatter = 0  # consecutive windows that a breakpoint has cut to almost nothing
        self.starts = by.breakpoints is not None  # at a breakpoint, or where one may be
        self.cuts, self.uncut = 0, 0.0  # of the present window at breakpoints, and its length without them
        self.shortened = False  # the last trial was too long
        self.offered: Callable[..., WindowProgram | None] = getattr(by.system, "program", lambda **_: None)
        self.program, self.settled = self.offered(), False
        self.rows: _Rows | None = None
        if by.breakpoints is not None:
            shooting = ParallelShooting(by.system, self.rule, by.tolerance, by.scale)
            self.rows = _Rows(shooting, by.breakpoints, self.h, self.least, by.most)

    def run(self) -> Solution:
        while self.t < self.t1 - self.least and self._advance():
            pass
        self.solution.evaluations += 0 if self.rows is None else self.rows.shooting.evaluations
        return self.solution

    def _advance(self) -> bool:
        """One step: many windows by a compiled program, a row of them together, or a trial of one. False where the integration
        ends."""
        if not self.settled and len(self.solution.windows) >= SETTLED_WINDOWS:
            self.settled = True
            if self.program is None and self.t1 - self.t > MANY_WINDOWS * self.h:
                self.program = self.offered(long=True)
        program = self.program
        in_program = program is not None and (not self.by.searches_breakpoints or program.has_forms)
        if program is not None and in_program and program.alone and self.by.speed_by_integral is None:
            return self._batch(program)
        row: list[Window] = []
        if self.rows is not None and not self.cuts:
            row = self.rows.solve(self.t, self.t1, self.q, self.v, self.end_a, self.longest)
        return self._row(row) if row else self._one()

    def _accept(self, window: Window) -> bool:
        self.solution.windows.append(window)
        return self.by.on_window is None or self.by.on_window(window) is None

    def _go_to_end(self, window: Window) -> None:
        self.t = window.start + window.length
        q, v = window.end()
        self.end_a = window.a.sum(axis=0)[None]  # all polynomials are 1 there
        self.q, self.v = q, v if self.by.speed_by_integral is None else self.by.speed_by_integral(q, v)

    def _batch(self, program: WindowProgram) -> bool:
        """Windows that a compiled program solves one after the other."""
        solution, f, s = self.solution, len(self.q), len(self.rule.nodes)
        near = program.near(self.q[None], self.v[None], np.array([self.t]))
        head = [self.t, self.h, self.longest, 0.0, 0.0, self.starts, self.cuts, self.uncut, self.chatter, self.shortened]
        at = np.concatenate([head, self.q, self.v, self.end_a[0], self.guess.ravel(), near])
        batch = program.windows(self.rule, at, self.by.limits(self.t, self.t1, self.least, BATCH_WINDOWS))
        solution.evaluations, solution.rejected = solution.evaluations + int(at[3]), solution.rejected + int(at[4])
        windows = windows_of(batch)
        if self.by.on_windows is not None and self.by.on_windows(windows):
            solution.windows += windows
        elif not all(map(self._accept, windows)):
            return False
        self.t, self.h, self.longest = (float(x) for x in at[:3])
        self.starts, self.cuts, self.uncut, self.chatter, self.shortened = (
            bool(at[5]),
            int(at[6]),
            float(at[7]),
            int(at[8]),
            bool(at[9]),
        )
        k = len(head)
        self.q, self.v, self.end_a = at[k : k + f], at[k + f : k + 2 * f], at[None, k + 2 * f : k + 3 * f]
        self.guess = at[k + 3 * f :][: s * f].reshape(s, f)
        self._still()
        if batch.stuck:
            raise _stuck(self.t, self.h)
        return True

    def _row(self, row: list[Window]) -> bool:
        if not all(self._accept(window) for window in row):
            return False
        self._go_to_end(row[-1])
        self.longest = max(self.longest, *(window.length for window in row))
        self.guess, self.starts = np.repeat(self.end_a, len(self.rule.nodes), axis=0), True
        return True

    def _one(self) -> bool:
        """A trial of one window: it is accepted, cut at a breakpoint, or made shorter."""
        t, least, nodes = self.t, self.least, self.rule.nodes
        breakpoints = self.by.breakpoints
        self._fit()
        solved = self._solved()
        if solved is None:
            self.solution.evaluations += 8
            return self._shorten(np.inf, 1.0)
        nodes_a, count = solved
        self.solution.evaluations += count
        window = Window(t, self.h, self.q, self.v, self.rule.legendre @ nodes_a, self.cuts > 0)
        break_time = breakpoints(window, t + AT_START * least) if breakpoints is not None and self.cuts < 5 else None
        if break_time is not None and break_time < t + self.h * (1.0 - 1e-10):
            self.cuts, self.uncut, self.h = self.cuts + 1, max(self.uncut, self.h), break_time - t
            self.guess = window.acceleration(t + self.h * nodes)
            return True
        worst, order = self._error(window)
        return self._shorten(worst, order) if worst > TAIL_MARGIN else self._go_on(window, worst, order)

    def _fit(self) -> None:
        """Limit the window's length by the time left, by the longest allowed window, and by the next stated breakpoint."""
        t, t1, breakpoints = self.t, self.t1, self.by.breakpoints
        h = min(self.h, t1 - t) if self.by.most is None else min(self.h, self.by.most, t1 - t)
        if t + 1.9 * h > t1 and t + h < t1:
            h = 0.5 * (t1 - t)  # no sliver at the end
        stated = breakpoints.stated(t + AT_START * self.least) if breakpoints is not None and not self.cuts else np.inf
        if stated < t + h * (1.0 - 1e-10):
            self.cuts, self.uncut, h = 1, h, stated - t
        self.h = h

    def _solved(self) -> tuple[Real, int] | None:
        """Accelerations at the nodes of the window, and how often the system was called; None where the solver fails."""
        trial = WindowTrial(self.t, self.h, self.q, self.v, self.guess, self.by.newton_tolerance)
        solved = None if self.program is None else self.program.window(self.rule, trial)
        if self.program is None or (solved is None and self.program.partial):
            solved = solve_window(self.rule, self.by.system, trial)
        return solved

    def _error(self, window: Window) -> tuple[float, float]:
        """The window's error over the tolerance, and the power of the window's length to which it is proportional."""
        allowed = self.by.tolerance * self.by.scale
        share = self.h * max(self.longest, self.h)
        worst, order = float((tails(window.a, share) / allowed).max()), float(len(self.rule.nodes) + 1)
        if self.starts or self.cuts:
            rough, power = neglected_tails(window.a, share)
            neglected = TAIL_MARGIN * float((rough / allowed).max())
            if neglected > worst:
                worst, order = neglected, float(power)
        if worst > TAIL_MARGIN and self.h < 1e4 * self.least:
            worst = TAIL_MARGIN  # the equations jump here without a stated breakpoint: as near to the jump as times are resolved
        return worst, order

    def _shorten(self, worst: float, order: float) -> bool:
        """Try a shorter window, by the error ``worst`` of this one, which is infinite where it has no solution."""
        self.solution.rejected += 1
        self.shortened = True
        self.h *= min(max(0.8 * (1.0 / worst) ** (1.0 / order), 0.1), 0.7) if np.isfinite(worst) else 0.3
        if self.h < 1e3 * self.least:
            raise _stuck(self.t, self.h)
        self.guess = np.repeat(self.guess[:1], len(self.rule.nodes), axis=0)
        self.cuts = 0  # the shorter window does not reach the breakpoint
        return True

    def _go_on(self, window: Window, worst: float, order: float) -> bool:
        """Accept a window, and choose the length and the starting guess of the next one."""
        self.longest = max(self.longest, self.h)
        self.chatter = self.chatter + 1 if self.by.breakpoints is not None and self.h < CHATTER_LENGTH * self.longest else 0
        self._still()
        if not self._accept(window):
            return False
        self._go_to_end(window)
        growth = 1.0 if self.shortened else LONGER_WINDOW  # a length that was just too long often is so again
        longer = self.h * min(max(0.9 * (1.0 / max(worst, 1e-12)) ** (1.0 / order), 0.3), growth)
        self.shortened = False
        nodes = self.rule.nodes
        if self.uncut:
            self.guess = np.repeat(self.end_a, len(nodes), axis=0)
        else:
            self.guess = _extrapolated(window, self.t + longer * nodes, self.end_a)
        self.h = max(longer, 0.5 * self.uncut)
        if self.rows is not None:
            self.rows.reach, self.rows.natural = max(self.h, RECOVERED_REACH * self.rows.reach if self.cuts else 0.0), self.h
        self.starts, self.cuts, self.uncut = self.cuts > 0, 0, 0.0
        return True

    def _still(self) -> None:
        """Raise `MechanismError` where breakpoints have cut too many consecutive windows to almost nothing."""
        if self.chatter > MOST_CUT:
            why = (
                f"at t = {self.t:.9g} s a force changes its law again and again: at rest it pushes back whichever way the "
                "mechanism moves."
            )
            remedy = (
                "An indicator diagram in the middle of a stroke holds like dry friction: give a joint a brake, or let the machine "
                "run through."
            )
            raise MechanismError(Fault("dynamics", why, remedy))


class _Rows:
    """Rows of windows between breakpoints that are stated, each row solved together. ``natural`` [s]: length of a window without
    breakpoints; ``least``, ``most`` [s]: shortest and longest allowed window; ``reach`` [s]: longest extent of the next row."""

    def __init__(self, shooting: ParallelShooting, breakpoints: BreakpointFinder, natural: float, least: float, most: float | None):
        self.shooting, self.breakpoints, self.natural, self.reach = shooting, breakpoints, natural, natural
        self.least, self.most = least, np.inf if most is None else most

    def solve(self, t: float, t1: float, q: Real, v: Real, a: Real, longest: float) -> list[Window]:
        """The windows from ``t`` on, before ``t1`` [s]: as many as keep the tolerance and hold no other breakpoints.

        There are none where breakpoints are not close to each other, or Newton's method fails: then a single window is tried.
        ``q``, ``v`` (f,) and ``a`` (1, f) are those at the start, ``longest`` [s] is the longest window so far.
        """
        boundaries, shooting = self._boundaries(t, min(t + self.reach, t1)), self.shooting
        if len(boundaries) <= FEW_WINDOWS:
            return []
        shooting.longest = longest
        trajectory = shooting.solve(boundaries, q, v, lambda t: np.repeat(a, len(t), axis=0), halvings=0)
        good = [] if trajectory is None else trajectory.windows(shooting.rule)[: shooting.resolved_windows(trajectory, TAIL_MARGIN)]
        for k, window in enumerate(good):
            end = window.start + window.length
            other = self.breakpoints(window, window.start + AT_START * self.least)
            if other is not None and other < end - max(20.0 * self.least, 1e-10 * window.length):
                good = good[:k]
                break
        self.reach = (FARTHER_REACH if len(good) == len(boundaries) - 1 else NEARER_REACH) * float(boundaries[-1] - t)
        return good

    def _boundaries(self, t: float, end: float) -> Real:
        """The time ``t`` and the stated breakpoints after it: as many as can be solved together, each within a window of the one
        before."""
        boundaries, longest = [t], min(self.natural, self.most)
        while len(boundaries) <= MOST_NODES // len(self.shooting.rule.nodes):
            stated = self.breakpoints.stated(boundaries[-1] + AT_START * self.least)
            if not stated < min(end, boundaries[-1] + longest):
                break
            boundaries.append(stated)
        return np.array(boundaries)


def windows_of(batch: WindowBatch) -> list[Window]:
    """The windows that a compiled program has made."""
    starts, lengths, cut, strain = (x.tolist() for x in (batch.starts, batch.lengths, batch.cut > 0.0, batch.strain))
    return list(map(Window, starts, lengths, batch.q, batch.v, batch.a, cut, strain))


def _breaks_from(breakpoints: BreakpointFinder | None, t: float, until: float, most: int) -> Real:
    """Stated breakpoints [s] from ``t`` on, up to the first one not before ``until``, ``most`` of them at most."""
    out = [t]
    while breakpoints is not None and len(out) <= most and out[-1] < until:
        out.append(breakpoints.stated(out[-1] + 4.0 * np.spacing(out[-1])))
    return np.array(out[1:])


def _stuck(t: float, h: float) -> MechanismError:
    why = f"the motion cannot be continued beyond t = {t:.9g} s: windows shorter than {h:.1g} s fail."
    remedy = "Look at the events before that time: a limit of the motion, a force without bound, or a jam."
    return MechanismError(Fault("dynamics", why, remedy))


def _first_window(q: Real, v: Real, a: Real, span: float, scale: object) -> float:
    speed, change = float(np.max(np.abs(v) / scale)), float(np.max(np.abs(a) / scale))
    h = span
    if speed:
        h = min(h, 0.2 / speed)
    if change:
        h = min(h, np.sqrt(0.2 / change))
    return h


def _extrapolated(window: Window, t: Real, end: Real) -> Real:
    """Starting guess of the next window: the last polynomial extrapolated, if that stays near, else its value at the end."""
    guess = window.acceleration(t)
    total = float(np.abs(window.a).sum())
    if np.abs(guess - end).max() > 4.0 * total + 1e-300:
        return np.repeat(end, len(t), axis=0)
    return guess
