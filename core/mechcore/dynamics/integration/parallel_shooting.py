"""Many windows of collocation solved together instead of one after the other (parallel shooting).

The coupling of the windows is linear: a correction at a window's start changes its end by a matrix of the size of the state. All
nodes are evaluated in one call, their slopes in another, and one batch of linear systems corrects the whole trajectory; the
remaining error is of the order of its square (Hairer, Wanner, "Solving Ordinary Differential Equations I", II.7 and II.14).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.integration.collocation import Rule, System, Window, integrals, neglected_tails, tails
from mechcore.errors import MechanismError
from mechcore.records import dataclass

MOST_NODES = 4096  # nodes that are solved together
MOST_HALVINGS = 8  # of windows, at most
LINEAR_CORRECTION = 1e-5  # part of the scale: after a correction of this size the error is of the order of its square
SQUARE_LEFT = 1e-2  # part of the tolerance that this square may be
NEWTON_STEPS = 6  # of Newton's method, at most
CORRECTION_RATIO = 0.3  # largest ratio of a correction to the one before


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
        """The trajectory from q, v (f,) with accelerations ``a`` (k, s, f) at the nodes."""
        h = np.diff(boundaries)[:, None]
        once, twice = _ends(rule)
        gain = np.tensordot(a, once, (1, 0))
        speeds = np.concatenate([v[None], v + np.cumsum(h * gain, axis=0)])
        steps = h * speeds[:-1] + h * h * np.tensordot(a, twice, (1, 0))
        places = np.concatenate([q[None], q + np.cumsum(steps, axis=0)])
        h, start, rate = h[:, None], places[:-1, None], speeds[:-1, None]
        at = start + h * rule.nodes[:, None] * rate + h * h * (rule.double_integral @ a), rate + h * (rule.integral @ a)
        return cls(boundaries, places, speeds, at, a)

    def windows(self, rule: Rule) -> list[Window]:
        """The windows one by one."""
        series = rule.legendre @ self.a
        lengths = np.diff(self.boundaries)
        return [Window(float(self.boundaries[k]), float(lengths[k]), self.q[k], self.v[k], series[k]) for k in range(len(lengths))]


def _ends(rule: Rule) -> tuple[Real, Real]:
    """From the nodes' values (s,) to the first and the second integral over a window."""
    once, twice = integrals(len(rule.nodes), np.ones(1))
    return once[0] @ rule.legendre, twice[0] @ rule.legendre


class ParallelShooting:
    """Trajectories of windows from a start, by one rule and to one tolerance."""

    def __init__(self, system: System, rule: Rule, tolerance: float, scale: Real | float):
        self.system, self.rule, self.tolerance, self.scale = system, rule, tolerance, scale
        self.linear = min(LINEAR_CORRECTION, float(np.sqrt(SQUARE_LEFT * tolerance)))
        self.evaluations = 0
        self.longest = 0.0

    def solve(
        self, boundaries: Real, q: Real, v: Real, guess: Callable[[Real], Real], halvings: int = MOST_HALVINGS
    ) -> Trajectory | None:
        """Windows between ``boundaries``, halved where the guess is too rough; None where Newton's method does not converge."""
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # a trial may be anywhere
                started = self._fine(boundaries, q, v, guess, halvings)
                return None if started is None else self._newton(*started)
        except (MechanismError, np.linalg.LinAlgError):  # where the guess leads, the equations may have no solution
            return None

    def _fine(
        self, boundaries: Real, q: Real, v: Real, guess: Callable[[Real], Real], halvings: int
    ) -> tuple[Trajectory, Real] | None:
        """The guess on windows that are short enough, and the accelerations (k, s, f) by the equations of motion along it."""
        for _ in range(max(halvings, 1)):
            h = np.diff(boundaries)
            t = boundaries[:-1, None] + h[:, None] * self.rule.nodes
            trajectory = Trajectory.along(self.rule, boundaries, q, v, guess(t.ravel()).reshape(*t.shape, len(q)))
            force = self._evaluate(trajectory)
            if not np.isfinite(force).all():
                return None
            rough = self._missed(force, h)[0]
            if not halvings or rough.max() <= 4.0:
                return trajectory, force
            middle = 0.5 * (boundaries[1:] + boundaries[:-1])[rough > 4.0]
            boundaries = np.sort(np.concatenate([boundaries, middle]))
            if len(boundaries) * len(self.rule.nodes) > 4 * MOST_NODES:
                return None
        return None

    def resolved_windows(self, trajectory: Trajectory, margin: float) -> int:
        """Number of windows, from the first one on, that keep the tolerance; errors of high order may be ``margin`` times it, see
        `tails`."""
        last, low = self._missed(trajectory.a, np.diff(trajectory.boundaries))
        return int(np.argmax(np.append((last > margin) | (low > 1.0), True)))

    def _missed(self, a: Real, h: Real) -> tuple[Real, Real]:
        """Estimated errors of each window (k,) over the tolerance, see `tails`."""
        longest = np.maximum.accumulate(np.append(self.longest, h))[1:]
        series, share = self.rule.legendre @ a, (h * longest)[:, None]
        last, (low, _) = tails(series, share), neglected_tails(series, share)
        return tuple((x / (self.tolerance * self.scale)).max(axis=1) for x in (last, low))

    def _times(self, trajectory: Trajectory) -> Real:
        return (trajectory.boundaries[:-1, None] + np.diff(trajectory.boundaries)[:, None] * self.rule.nodes).ravel()

    def _evaluate(self, trajectory: Trajectory) -> Real:
        self.evaluations += 1
        q, v = (x.reshape(-1, x.shape[-1]) for x in trajectory.at)
        return np.asarray(self.system(q, v, self._times(trajectory))).reshape(trajectory.a.shape)

    def _newton(self, trajectory: Trajectory, force: Real) -> Trajectory | None:
        last = np.inf
        for _ in range(NEWTON_STEPS):
            better = self._corrected(trajectory, force)
            size = max(
                float((np.abs(x - y) / self.scale).max()) for x, y in ((better.q, trajectory.q), (better.at[0], trajectory.at[0]))
            )
            if not size <= CORRECTION_RATIO * last:
                return None
            trajectory, last = better, size
            if size <= self.linear:
                h = np.diff(trajectory.boundaries)
                if self._missed(trajectory.a, h)[0].max() > 16.0:
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
        matrix = np.einsum("kiab,ij->kiajb", -h4 * h4 * by_q, rule.double_integral) - np.einsum(
            "kiab,ij->kiajb", h4 * by_v, rule.integral
        )
        matrix = matrix.reshape(k, s * f, s * f) + np.eye(s * f)
        from_start = np.concatenate([by_q, by_v + h4 * rule.nodes[:, None, None] * by_q], axis=3)
        rhs = np.concatenate([(force - trajectory.a)[..., None], from_start], axis=3).reshape(k, s * f, 1 + 2 * f)
        corrections = np.linalg.solve(matrix, rhs).reshape(k, s, f, 1 + 2 * f)
        once, twice = _ends(rule)
        h3 = h[:, None, None]
        ends = np.concatenate(
            [h3 * h3 * np.einsum("s,ksfc->kfc", twice, corrections), h3 * np.einsum("s,ksfc->kfc", once, corrections)], axis=1
        )
        ends[:, :, 1:] += np.eye(2 * f)
        ends[:, range(f), range(1 + f, 1 + 2 * f)] += h[:, None]
        starts = np.zeros((k, 2 * f))
        state = starts[0]
        for i in range(1, k):
            state = starts[i] = ends[i - 1, :, 0] + ends[i - 1, :, 1:] @ state
        a = trajectory.a + corrections[..., 0] + (corrections[..., 1:] @ starts[:, None, :, None])[..., 0]
        return Trajectory.along(rule, trajectory.boundaries, trajectory.q[0], trajectory.v[0], a)
