"""A mechanism in a chart of its configurations: joint coordinates that, taken as drives, decide the configuration."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.equations.program import Program, Programmed
from mechcore.dynamics.equations.reduced import (
    constrained,
    free_of,
    moving,
    reduced_equations,
    steps_of_differences,
    with_states,
)
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion


def jacobian_of(motion: Motion, units: Sequence[Motion], joints: Sequence[str]) -> tuple[Real, Real]:
    """Rates of joints' coordinates per unit rate of each free coordinate (n, p, f), and their second rates at q'' = 0 (n, p), which
    are also those of prescribed drives; ``motion`` with q'' = 0, ``units`` its tangents."""
    free = [motion.mechanism.drives[i].joint for i in _free_in(motion)]
    rows, second = np.zeros((motion.frames, len(joints), len(units))), np.zeros((motion.frames, len(joints)))
    for k, joint in enumerate(joints):
        if joint in free:
            rows[:, k, free.index(joint)] = 1.0
        else:
            second[:, k] = motion.coordinate(joint)[:, 2]
            for i, unit in enumerate(units):
                rows[:, k, i] = unit.coordinate(joint)[:, 1]
    return rows, second


def _free_in(motion: Motion) -> list[int]:
    return [i for i, d in enumerate(motion.mechanism.drives) if isinstance(d.law, Free)]


class Chart(Programmed):
    """Accelerations of all coordinates (n, f). Joints that ``rest`` keep their coordinates, and `holding` gives what that takes."""

    def __init__(self, compiled: Compiled, rests: Sequence[str] = ()):
        self.compiled, self.rests = compiled, tuple(rests)
        free = [compiled.mechanism.drives[i].joint for i in free_of(compiled)]
        self.held = [free.index(joint) for joint in self.rests if joint in free]

    def program(self, *, long: bool = False) -> Program | None:
        return None if self.rests else super().program(long=long)

    def __call__(self, q: Real, v: Real, t: Real) -> Real:
        program = self.program()
        return self._solve(q, v, t)[0] if program is None or not program.everywhere else program(q, v, t)

    def _solve(self, q: Real, v: Real, t: Real) -> tuple[Real, Real]:
        """Accelerations (n, f + s), see `with_states`, and what holds the joints at rest (n, p).

        From M q'' + h = Q + G' p, G q'' + b = 0.
        """
        motion, units = moving(self.compiled, q, v, t)
        r = reduced_equations(motion, units)
        if not self.rests:
            return with_states(r.acceleration(), motion), np.zeros((len(t), 0))
        rows, second = jacobian_of(motion, units, self.rests)
        found, holding = constrained(r.inertia, r.force - r.bias, rows, second)
        found[:, self.held] = 0.0
        return with_states(found, motion), holding

    def holding(self, q: Real, v: Real, t: Real) -> Real:
        """What keeps the joints at rest (n, p): torque [N m] or force [N] in the direction of each one's coordinate."""
        return self._solve(q, v, t)[1]

    def slopes(self, q: Real, v: Real, t: Real, a: Real) -> tuple[Real, Real]:
        """Derivatives of the accelerations by position and speed (n, f, f) each, by differences, all in one call."""
        return differences(self, q, v, t, a, steps_of_differences(self.compiled, q, v, a))


def differences(
    system: Callable[[Real, Real, Real], Real], q: Real, v: Real, t: Real, a: Real, steps: tuple[Real, Real]
) -> tuple[Real, Real]:
    """Slopes of a system's accelerations by position and speed (n, f, f) each, by differences with steps (f,), all in one call."""
    n, f = q.shape
    many_q, many_v = np.tile(q, (2 * f, 1)), np.tile(v, (2 * f, 1))
    step_q, step_v = steps
    for k in range(f):
        many_q[k * n : (k + 1) * n, k] += step_q[k]
        many_v[(f + k) * n : (f + k + 1) * n, k] += step_v[k]
    changed = system(many_q, many_v, np.tile(t, 2 * f)).reshape(2 * f, n, f) - a
    by_q = np.moveaxis(changed[:f] / step_q[:, None, None], 0, -1)
    by_v = np.moveaxis(changed[f:] / step_v[:, None, None], 0, -1)
    return by_q, by_v
