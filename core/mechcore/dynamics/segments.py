"""Segments of a motion in each of which one system of equations holds, and the reactions in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.contact.dry_friction import DrySystem, forces_with
from mechcore.dynamics.equations.chart import Chart, jacobian_of
from mechcore.dynamics.equations.curve import Curve
from mechcore.dynamics.equations.energy import EnergyMotion
from mechcore.dynamics.equations.reduced import free_of, motion_at, tangents
from mechcore.dynamics.events import Stop
from mechcore.dynamics.integration.collocation import System
from mechcore.dynamics.integration.refinement import Known
from mechcore.dynamics.integration.windows import Solution
from mechcore.effects.base import joint_wrench, sum_up
from mechcore.forces.equilibrium import transmit
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion

STOP = "stop"  # kind and cause of what an end stop holds


def stop_name(stop: Stop) -> str:
    """Name of an end stop among the loads."""
    return f"stop {stop.name}"


def segment_forces(motion: Motion, system: System, q: Real, v: Real, resting: Sequence[Stop]) -> Forces:
    """All reactions of a motion in which one system holds; q, v (n, f): free coordinates and their rates.

    ``resting``: stops that something rests on. What it takes to hold that is a load on the two links of the stop's joint; nothing
    is left for the free coordinates to do.
    """
    forces = forces_with(motion, system, q, v) if isinstance(system, DrySystem) else solve_forces(motion)
    if not resting:
        return forces
    free = [i for i, d in enumerate(motion.mechanism.drives) if isinstance(d.law, Free)]
    rows, _ = jacobian_of(motion, tangents(motion, free), [stop.joint for stop in resting])
    efforts = np.stack([forces.effort(motion.mechanism.drives[i].joint) for i in free], axis=1)
    inner = rows @ rows.swapaxes(1, 2)
    found = np.linalg.solve(inner, rows @ efforts[..., None])[..., 0]
    held = [
        joint_wrench(motion, stop.joint, effort, name=stop_name(stop), kind=STOP, cause=STOP)
        for stop, effort in zip(resting, found.T, strict=True)
    ]
    if isinstance(system, DrySystem):
        return forces_with(motion, system, q, v, held)
    applied = (*forces.applied, *held)
    loads = sum_up(list(applied), len(motion.model.links))
    return Forces(motion, applied, *transmit(motion, *loads)[:2], forces.friction)


SAMPLES = 257  # of a segment, by which it is measured


@dataclass(frozen=True, eq=False)
class Segment:
    """A segment of the motion on which the same system holds: ``solution(t)`` gives q, v, a (n, f) in the chart of ``compiled``."""

    start: float
    end: float
    compiled: Compiled
    solution: Solution | EnergyMotion
    system: System
    resting: tuple[Stop, ...] = ()  # stops that something rests on
    separated: tuple[str, ...] = ()  # cams that their followers have left: their guides' coordinates come after the others

    def __call__(self, t: Real) -> tuple[Real, Real, Real]:
        """Positions, speeds (n, f) by the dense output, accelerations by the equations of motion."""
        q, v, a = self.solution(t)
        return q, v, a if isinstance(self.solution, EnergyMotion) else self.system(q, v, t)

    def motion(self, t: Real) -> Motion:
        """The mechanism's motion at times (n,) within the segment; accelerations not from a table, so that links are in balance to
        the last digits."""
        q, v, _ = self.solution(t)
        system = Chart(self.compiled) if isinstance(self.system, Curve) else self.system
        return motion_at(self.compiled, q, v, t, system(q, v, t))

    def forces(self, t: Real, motion: Motion) -> Forces:
        """All reactions of the segment's motion at times (n,)."""
        q, v, _ = self.solution(t)
        return segment_forces(motion, self.system, q, v, self.resting)

    @property
    def independent(self) -> list[str]:
        """Joints whose coordinates are independent."""
        return [self.compiled.mechanism.drives[i].joint for i in free_of(self.compiled)]

    def known(self, scale: Real) -> Known:
        """What it says to one who looks for the same motion again; ``scale`` (f,): typical sizes of its coordinates."""
        if isinstance(self.solution, Solution):
            windows = self.solution.windows
            boundaries = np.array([*(w.start for w in windows), self.solution.end])
            return Known(boundaries, np.array([w.cut for w in windows]), lambda t: self.solution(t)[2])
        t = np.linspace(self.start, self.end, SAMPLES)
        far = float((np.abs(self.solution(t)[1]).mean(axis=0) / scale).max()) * (self.end - self.start)
        boundaries = np.linspace(self.start, self.end, int(np.ceil(far)) + 5)
        return Known(boundaries, np.zeros(len(boundaries) - 1, bool), lambda t: self.solution(t)[2])

    def goes_on(self, later: Segment) -> bool:
        """Whether a later segment is more of the same: windows of one integration."""
        if not (isinstance(self.solution, Solution) and isinstance(later.solution, Solution)):
            return False
        same = self.system is later.system and (self.resting, self.separated) == (later.resting, later.separated)
        return same and self.end == later.start

    def with_windows(self, later: Sequence[Segment]) -> Segment:
        """This segment and those in which it goes on."""
        if not later:
            return self
        windows = [w for s in (self, *later) if isinstance(s.solution, Solution) for w in s.solution.windows]
        return replace(self, end=later[-1].end, solution=Solution(windows))
