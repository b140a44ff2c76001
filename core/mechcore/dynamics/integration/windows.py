"""Windows of collocation, one after the other, with control of their length to a requested tolerance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from mechcore.arrays import Real
from mechcore.compiled.collocation import Batch, CollocationRule
from mechcore.dynamics.integration.collocation import (
    Rule,
    System,
    Window,
    gauss,
    integrals_and_values,
    radau,
    solve_window,
    tails,
)
from mechcore.dynamics.integration.parallel_shooting import MOST, ParallelShooting
from mechcore.errors import Fault, MechanismError

MARGIN = 4.0  # times the tolerance: a tail of high order may be as large, a little shorter a window meets it; none of low order may
ROUNDED = 1e-15  # of the scale: no window is solved to more digits
FEW = 3  # windows in a row that end at stated breakpoints: so many, or more, are solved together
FARTHER, NEARER, RECOVERED = 2.0, 0.3, 1.2  # how far the next ones reach: where the last were solved, were not, or one of them was
CHATTER, MOST_CUT = 1e-5, 400  # windows shorter than this part of the longest; so many in a row, cut at breakpoints, get nowhere


SETTLED, MANY = 8, 250  # windows after which their length tells how many are left; so many are worth compiling
BATCH = 64  # windows that a compiled program solves before anybody looks at them


class WindowProgram(Protocol):
    """Equations of motion as a compiled program, with the windows around them; ``alone``: nothing else is needed for them;
    ``partial``: where it has no answer numpy may have one."""

    @property
    def alone(self) -> bool: ...
    @property
    def partial(self) -> bool: ...
    def near(self, q: Real, v: Real, t: Real) -> Real: ...
    def window(
        self, rule: CollocationRule, t0: float, h: float, q: Real, v: Real, guess: Real, tolerance: float
    ) -> tuple[Real, int] | None: ...
    def windows(self, rule: CollocationRule, at: Real, bounds: tuple[float, float, float, float, float], count: int) -> Batch: ...


class BreakpointFinder(Protocol):
    """Where the equations change their form: the first time [s] in a window that is later than another one, or None; and the
    first one, later than another, that is known without a window."""

    def __call__(self, window: Window, after: float) -> float | None: ...

    def stated(self, after: float) -> float: ...


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
        t = np.atleast_1d(np.asarray(t, float))
        x, length, q, v, a = self._within(t)
        first, second, values = integrals_and_values(a.shape[1], x)
        moved = (length * length)[:, None] * (second[:, None, :] @ a)[:, 0]
        return (
            q + (length * x)[:, None] * v + moved,
            v + length[:, None] * (first[:, None, :] @ a)[:, 0],
            (values[:, None, :] @ a)[:, 0],
        )

    def _within(self, t: Real) -> tuple[Real, ...]:
        """Where times (n,) are in their windows, and the windows' lengths, starts and series."""
        starts, lengths, q, v, a = self._stacked()
        k = np.clip(np.searchsorted(starts, t, side="left") - 1, 0, len(starts) - 1)
        length = lengths[k]
        return (t - starts[k]) / length, length, q[k], v[k], a[k]

    def _stacked(self) -> tuple[Real, ...]:
        """Starts, lengths (w,), positions, speeds (w, f) and series (w, s, f) of all windows, those with fewer nodes filled up."""
        if len(self._stack) == 0 or len(self._stack[0]) != len(self.windows):
            most = max(len(w.a) for w in self.windows)
            a = np.zeros((len(self.windows), most, len(self.windows[0].q)))
            for row, w in zip(a, self.windows, strict=True):
                row[: len(w.a)] = w.a
            self._stack = (
                np.array([w.start for w in self.windows]),
                np.array([w.length for w in self.windows]),
                np.array([w.q for w in self.windows]),
                np.array([w.v for w in self.windows]),
                a,
            )
        return self._stack


def nodes_for(tolerance: float) -> int:
    """Nodes a window for a relative tolerance: about as many as digits are wanted (measured: flat between 8 and 14)."""
    return int(np.clip(round(-np.log10(max(tolerance, 1e-15))) + 2, 5, 14))


def integrate(
    system: System,
    q: Real,
    v: Real,
    t0: float,
    t1: float,
    *,
    tolerance: float = 1e-9,
    scale: Real | float = 1.0,
    stiff: bool = False,
    first: float | None = None,
    nodes: int | None = None,
    most: float | None = None,
    after: Callable[[Window], float | None] | None = None,
    breakpoints: BreakpointFinder | None = None,
    keeps: Callable[[Real, Real], Real] | None = None,
) -> Solution:
    """Integrate from ``t0`` to ``t1`` [s], starting at q, v (f,).

    Where many breakpoints are stated within the length that one window would have, the windows between them are solved together.

    ``tolerance``: local error of the position, relative to ``scale`` (a typical size of q, one or (f,)). ``after`` is called
    with every accepted window; a time that it returns ends the integration there. ``breakpoints`` finds the first time in a
    window, later than a given one, at which the equations change their form: windows end there. ``keeps``: position and speed at
    the end of a window -> the speed that a first integral gives there. ``nodes``: of a window, ``most``: longest window [s]. Raises
    `MechanismError` where no window however short succeeds.
    """
    s = nodes or nodes_for(tolerance)
    rule: Rule = radau(s) if stiff else gauss(s)
    q, v = np.asarray(q, float), np.asarray(v, float)
    solution = Solution()
    end_a = system(q[None], v[None], np.array([t0]))
    solution.evaluations += 1
    h = first or _first_window(q, v, end_a[0], t1 - t0, scale)
    guess = np.repeat(end_a, s, axis=0)
    t = t0
    least = 1e-13 * max(abs(t0), abs(t1), 1e-300)
    longest = 0.0  # window so far
    chatter = 0  # windows in a row that a breakpoint has cut to almost nothing
    starts = breakpoints is not None  # at a breakpoint, or where one may be
    cuts, uncut = 0, 0.0  # of the present window at breakpoints, and how long it would have been

    def accept(window: Window) -> bool:
        solution.windows.append(window)
        return after is None or after(window) is None

    def end_of(window: Window) -> tuple[float, Real, Real, Real]:
        end = window.start + window.length
        q, v, a = window(np.array([end]))
        return end, q[0], v[0] if keeps is None else keeps(q[0], v[0]), a

    offered: Callable[..., WindowProgram | None] = getattr(system, "program", lambda **_: None)
    program, settled = offered(), False
    small = max(1e-3 * tolerance, ROUNDED) * float(np.min(scale))
    rows = None if breakpoints is None else _Rows(ParallelShooting(system, rule, tolerance, scale), breakpoints, h, least, most)
    while t < t1 - least:
        if not settled and len(solution.windows) >= SETTLED:
            settled = True
            program = offered(long=True) if program is None and t1 - t > MANY * h else program
        if program is not None and program.alone and breakpoints is None and keeps is None:
            near = program.near(q[None], v[None], np.array([t]))
            at = np.concatenate([[t, h, longest, 0.0, 0.0], q, v, end_a[0], guess.ravel(), near])
            batch = program.windows(rule, at, (t1, least, np.inf if most is None else most, tolerance, small), BATCH)
            solution.evaluations, solution.rejected = solution.evaluations + int(at[3]), solution.rejected + int(at[4])
            if not all(accept(window) for window in map(Window, *batch[:5])):
                break
            (t, h, longest), f = (float(x) for x in at[:3]), len(q)
            q, v, end_a, guess = at[5 : 5 + f], at[5 + f : 5 + 2 * f], at[None, 5 + 2 * f : 5 + 3 * f], at[5 + 3 * f :][: s * f]
            guess = guess.reshape(s, f)
            if batch.stuck:
                raise _stuck(t, h)
            continue
        row = [] if rows is None or cuts else rows.solve(t, t1, q, v, end_a, longest)
        if row:
            if not all(accept(window) for window in row):
                break
            t, q, v, end_a = end_of(row[-1])
            longest = max(longest, *(window.length for window in row))
            guess, starts = np.repeat(end_a, s, axis=0), True
            continue
        h = min(h, t1 - t) if most is None else min(h, most, t1 - t)
        if t + 1.9 * h > t1 and t + h < t1:
            h = 0.5 * (t1 - t)  # no sliver at the end
        stated = breakpoints.stated(t + 10.0 * least) if breakpoints is not None and not cuts else np.inf
        if t + 20.0 * least < stated < t + h * (1.0 - 1e-10):
            cuts, uncut, h = 1, h, stated - t
        solved = None if program is None else program.window(rule, t, h, q, v, guess, small)
        if program is None or (solved is None and program.partial):
            solved = solve_window(rule, system, t, h, q, v, guess, small)
        if solved is not None:
            nodes_a, count = solved
            solution.evaluations += count
            window = Window(t, h, q, v, rule.legendre @ nodes_a, cuts > 0)
            break_time = breakpoints(window, t + 10.0 * least) if breakpoints is not None and cuts < 5 else None
            if break_time is not None and t + 20.0 * least < break_time < t + h * (1.0 - 1e-10):
                cuts, uncut, h = cuts + 1, max(uncut, h), break_time - t
                guess = window(t + h * rule.nodes)[2]
                continue
            left, rough, power = tails(window.a, np.array(h), np.array(max(longest, h)))
            worst = float(np.max(left / (tolerance * scale)))
            order = float(s + 1)
            missed = MARGIN * float(np.max(rough / (tolerance * scale))) if starts or cuts else 0.0
            if missed > worst:
                worst, order = missed, float(power)
            if worst > MARGIN and h < 1e4 * least:
                worst = MARGIN  # the equations jump here without saying so; as near to the jump as time can be told
        else:
            solution.evaluations += 8
            worst, order = np.inf, float(s + 1)
        if worst > MARGIN:
            solution.rejected += 1
            h *= float(np.clip(0.8 * (1.0 / worst) ** (1.0 / order), 0.1, 0.7)) if np.isfinite(worst) else 0.3
            if h < 1e3 * least:
                raise _stuck(t, h)
            guess = np.repeat(guess[:1], s, axis=0)
            cuts = 0  # what is left of it does not reach the breakpoint
            continue
        longest = max(longest, h)
        chatter = chatter + 1 if breakpoints is not None and h < CHATTER * longest else 0
        if chatter > MOST_CUT:
            raise MechanismError(
                Fault(
                    "dynamics",
                    f"at t = {t:.9g} s a force changes its law again and again: at rest it pushes back whichever way the mechanism "
                    "moves.",
                    "An indicator diagram in the middle of a stroke holds like dry friction: give a joint a brake, or let the "
                    "machine run through.",
                )
            )
        if not accept(window):
            break
        t, q, v, end_a = end_of(window)
        longer = h * float(np.clip(0.9 * (1.0 / max(worst, 1e-12)) ** (1.0 / order), 0.3, 1.6))
        guess = np.repeat(end_a, s, axis=0) if uncut else _extrapolated(window, t + longer * rule.nodes, end_a)
        h = max(longer, 0.5 * uncut)
        if rows is not None:
            rows.reach, rows.natural = max(h, RECOVERED * rows.reach if cuts else 0.0), h
        starts, cuts, uncut = cuts > 0, 0, 0.0
    solution.evaluations += 0 if rows is None else rows.shooting.evaluations
    return solution


class _Rows:
    """Rows of windows between breakpoints that are stated, each row solved together. ``natural`` [s]: how long a window would be,
    ``least``, ``most`` [s]: how short and how long it may be; ``reach`` [s]: how far the next row may go."""

    def __init__(self, shooting: ParallelShooting, breakpoints: BreakpointFinder, natural: float, least: float, most: float | None):
        self.shooting, self.breakpoints, self.natural, self.reach = shooting, breakpoints, natural, natural
        self.least, self.most = least, np.inf if most is None else most

    def solve(self, t: float, t1: float, q: Real, v: Real, a: Real, longest: float) -> list[Window]:
        """The windows from ``t`` on, before ``t1`` [s]: as many as keep the tolerance and hold no other breakpoints.

        There are none where breakpoints are not close to each other, or Newton's method fails: then one window has to do alone.
        ``q``, ``v`` (f,) and ``a`` (1, f) are those at the start, ``longest`` [s] is the longest window so far.
        """
        boundaries, shooting = self._boundaries(t, min(t + self.reach, t1)), self.shooting
        if len(boundaries) <= FEW:
            return []
        shooting.longest = longest
        found = shooting.solve(boundaries, q, v, lambda t: np.repeat(a, len(t), axis=0), halvings=0)
        good = [] if found is None else found.windows(shooting.rule)[: shooting.sound(found, MARGIN)]
        for k, window in enumerate(good):
            end = window.start + window.length
            other = self.breakpoints(window, window.start + 10.0 * self.least)
            if other is not None and other < end - max(20.0 * self.least, 1e-10 * window.length):
                good = good[:k]
                break
        self.reach = (FARTHER if len(good) == len(boundaries) - 1 else NEARER) * float(boundaries[-1] - t)
        return good

    def _boundaries(self, t: float, end: float) -> Real:
        """The time and the breakpoints after it, as many as can be solved together, none too far from the one before."""
        found, longest = [t], min(self.natural, self.most)
        while len(found) <= MOST // len(self.shooting.rule.nodes):
            stated = self.breakpoints.stated(found[-1] + 20.0 * self.least)
            if not stated < min(end, found[-1] + longest):
                break
            found.append(stated)
        return np.array(found)


def _stuck(t: float, h: float) -> MechanismError:
    why = f"the motion cannot be continued beyond t = {t:.9g} s: windows shorter than {h:.1g} s fail."
    remedy = "Look at the events before that time: a limit of the motion, a force without bound, or a jam."
    return MechanismError(Fault("dynamics", why, remedy))


def _first_window(q: Real, v: Real, a: Real, span: float, scale: Any) -> float:
    speed, change = float(np.max(np.abs(v) / scale)), float(np.max(np.abs(a) / scale))
    h = span
    if speed:
        h = min(h, 0.2 / speed)
    if change:
        h = min(h, np.sqrt(0.2 / change))
    return h


def _extrapolated(window: Window, t: Real, end: Real) -> Real:
    """Start for the next window: the last polynomial continued, if that stays near, else its value at the end."""
    guess = window(t)[2]
    spread = float(np.abs(window.a).sum())
    if np.abs(guess - end).max() > 4.0 * spread + 1e-300:
        return np.repeat(end, len(t), axis=0)
    return guess
