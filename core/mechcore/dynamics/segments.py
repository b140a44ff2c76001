"""Segments of a motion in each of which one system of equations holds, the reactions in them, and breakpoints: where the law of a
force changes its form. Windows of the integration end there, so that in each all forces are smooth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.contact.dry_friction import DrySystem, forces_with
from mechcore.dynamics.contact.friction_state import senses
from mechcore.dynamics.equations.charts import Chart, jacobian_of
from mechcore.dynamics.equations.curve import CurveEquations
from mechcore.dynamics.equations.energy import EnergyMotion
from mechcore.dynamics.equations.program import Programmed
from mechcore.dynamics.equations.reduced import forms_of, free_of, motion_at, tangents
from mechcore.dynamics.events import EndStop
from mechcore.dynamics.integration.collocation import System, Window
from mechcore.dynamics.integration.refinement import KnownMotion
from mechcore.dynamics.integration.windows import Solution
from mechcore.effects.base import joint_wrench, sum_up
from mechcore.effects.registry import effects_of
from mechcore.forces.equilibrium import transmit
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.laws.timed import next_break, timed
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.records import dataclass

STOP_CAUSE = "stop"  # kind and cause of the load of an end stop
SEGMENT_SAMPLES = 257  # samples of a segment, for its mean speed
WINDOW_PLACES = 33  # samples of a window; a form of a law that holds for less than a thirtieth of it may be missed
MOST_ROUNDS = 8  # of refinement: 96^8 = 7e15 places between two samples; many places cost hardly more than few
_X = (np.arange(WINDOW_PLACES) + 0.5) / WINDOW_PLACES
_FINE = np.linspace(0.0, 1.0, 97)


def stop_load(stop: EndStop) -> str:
    """Name of an end stop among the loads."""
    return f"stop {stop.name}"


def segment_forces(motion: Motion, system: System, q: Real, v: Real, resting: Sequence[EndStop]) -> Forces:
    """All reactions of a motion in which one system holds; q, v (n, f): free coordinates and their rates.

    ``resting``: stops on which joints rest. The holding force is a load on the two links of the stop's joint, so that the free
    coordinates' efforts vanish.
    """
    forces = forces_with(motion, system, q, v) if isinstance(system, DrySystem) else solve_forces(motion)
    if not resting:
        return forces
    free = free_of(motion)
    rows, _ = jacobian_of(motion, tangents(motion, free), [stop.joint for stop in resting])
    efforts = np.stack([forces.effort(motion.mechanism.drives[i].joint) for i in free], axis=1)
    inner = rows @ rows.swapaxes(1, 2)
    holding = np.linalg.solve(inner, rows @ efforts[..., None])[..., 0]
    held = [
        joint_wrench(motion, stop.joint, effort, name=stop_load(stop), kind=STOP_CAUSE, cause=STOP_CAUSE)
        for stop, effort in zip(resting, holding.T, strict=True)
    ]
    if isinstance(system, DrySystem):
        return forces_with(motion, system, q, v, held)
    applied = (*forces.applied, *held)
    loads = sum_up(list(applied), len(motion.model.links))
    return Forces(motion, applied, *transmit(motion, *loads)[:2], forces.friction)


@dataclass(frozen=True, eq=False)
class MotionSegment:
    """A segment of the motion on which the same system holds: ``solution(t)`` gives q, v, a (n, f) in the chart of ``compiled``."""

    start: float
    end: float
    compiled: Compiled
    solution: Solution | EnergyMotion
    system: System
    resting: tuple[EndStop, ...] = ()  # stops on which joints rest
    separated: tuple[str, ...] = ()  # cams that their followers have left: their guides' coordinates come after the others

    def __call__(self, t: Real) -> tuple[Real, Real, Real]:
        """Positions, speeds (n, f) by the dense output, accelerations by the equations of motion."""
        q, v, a = self.solution(t)
        return q, v, a if isinstance(self.solution, EnergyMotion) else self.system(q, v, t)

    def motion(self, t: Real) -> Motion:
        """The mechanism's motion at times (n,) within the segment; accelerations not from a table, so that links are in balance to
        the last digits."""
        q, v, _ = self.solution(t)
        system = Chart(self.compiled) if isinstance(self.system, CurveEquations) else self.system
        return motion_at(self.compiled, q, v, t, system(q, v, t))

    def forces(self, t: Real, motion: Motion) -> Forces:
        """All reactions of the segment's motion at times (n,)."""
        q, v, _ = self.solution(t)
        return segment_forces(motion, self.system, q, v, self.resting)

    @property
    def independent(self) -> list[str]:
        """Joints whose coordinates are independent."""
        return [self.compiled.mechanism.drives[i].joint for i in free_of(self.compiled)]

    def as_known_motion(self, scale: Real) -> KnownMotion:
        """The segment as a start for `refine`; ``scale`` (f,): typical sizes of its coordinates."""
        if isinstance(self.solution, Solution):
            windows = self.solution.windows
            boundaries = np.array([*(w.start for w in windows), self.solution.end])
            return KnownMotion(boundaries, np.array([w.cut for w in windows]), lambda t: self.solution(t)[2])
        t = np.linspace(self.start, self.end, SEGMENT_SAMPLES)
        far = float((np.abs(self.solution(t)[1]).mean(axis=0) / scale).max()) * (self.end - self.start)
        boundaries = np.linspace(self.start, self.end, int(np.ceil(far)) + 5)
        return KnownMotion(boundaries, np.zeros(len(boundaries) - 1, bool), lambda t: self.solution(t)[2])

    def is_continued_by(self, later: MotionSegment) -> bool:
        """Whether a ``later`` segment continues this one: windows of the same integration."""
        if not (isinstance(self.solution, Solution) and isinstance(later.solution, Solution)):
            return False
        same = self.system is later.system and (self.resting, self.separated) == (later.resting, later.separated)
        return same and self.end == later.start

    def with_windows(self, later: Sequence[MotionSegment]) -> MotionSegment:
        """This segment joined with the ``later`` ones that continue it."""
        if not later:
            return self
        windows = [w for s in (self, *later) if isinstance(s.solution, Solution) for w in s.solution.windows]
        return replace(self, end=later[-1].end, solution=Solution(windows))


class Breakpoints(Programmed):
    """Finds breakpoints, where the law of some force or cam changes its form. Switching times that loads and laws of drives state
    are used directly; other breakpoints are searched for along a window."""

    def __init__(self, compiled: Compiled):
        self.compiled, effects = compiled, effects_of(compiled.mechanism)
        self.laws = timed([*(d.law for d in compiled.mechanism.drives), *(law for e in effects for law in e.laws)])
        self.breaks = np.array(sorted({t for e in effects for t in e.breaks}))
        self.driven = "friction" in compiled.mechanism.effects and not free_of(compiled)  # else the phases of friction end segments
        several = any(e.piecewise for e in effects) or any(r.kind == "cam" for r in compiled.model.relations)
        self.searched = several or self.driven

    def stated(self, after: float) -> float:
        """The first breakpoint [s] later than ``after`` that a law states; infinite where there is none."""
        k = int(np.searchsorted(self.breaks, after, side="right"))
        first = float(min([*self.breaks[k : k + 1], *(next_break(law, after) for law in self.laws)], default=np.inf))
        if not np.isfinite(first):
            return first
        return first - 2.0 * float(np.spacing(first))  # the last node of a window that ends there lies before it despite rounding

    def _forms(self, window: Window, t: Real) -> Real:
        q, v, _ = window(t)
        program = None if self.driven else self.program()
        forms = None if program is None else program.forms(q, v, t)
        if forms is not None:
            return forms
        motion = motion_at(self.compiled, q, v, t)
        numbers = [*forms_of(motion), *(senses(motion).T if self.driven else ())]
        return np.stack([np.broadcast_to(x, t.shape) for x in numbers])

    def __call__(self, window: Window, after: float) -> float | None:
        """The first breakpoint [s] in a window later than ``after``; None where there is none."""
        low, high = max(after, window.start), window.start + window.length
        stated = self.stated(low)
        known = stated if low < stated < high else None
        if not self.searched:
            return known
        high = high if known is None else known
        t = np.concatenate([[low], low + (high - low) * _X, [high]])
        for _ in range(MOST_ROUNDS):
            forms = self._forms(window, t)
            changed = np.flatnonzero((forms[:, 1:] != forms[:, :-1]).any(axis=0))
            if not len(changed):
                return known
            k = int(changed[0])
            if not t[k] < t[k + 1] or t[k + 1] - t[k] <= 4.0 * np.spacing(t[k + 1]):
                break
            t = t[k] + (t[k + 1] - t[k]) * _FINE
        return float(t[min(int(changed[0]) + 1, len(t) - 1)])


def breakpoint_finder(compiled: Compiled) -> Breakpoints | None:
    """Finder of the breakpoints of a mechanism's laws; None where every law has a single form."""
    finder = Breakpoints(compiled)
    return finder if finder.searched or len(finder.breaks) or finder.laws else None
