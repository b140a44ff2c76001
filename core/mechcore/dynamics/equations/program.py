"""Equations of motion as a compiled program, with what it is given: laws of prescribed drives, angles that it follows."""

from __future__ import annotations

from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.compiled.collocation import Batch, CollocationRule, CompiledEquations, WrittenEquations
from mechcore.compiled.motion import MOST_LINES
from mechcore.compiled.symbols import Untraceable
from mechcore.dynamics.equations.reduced import coordinate_scales, integrating, motion_at
from mechcore.dynamics.equations.written import written_equations
from mechcore.errors import MechanismError
from mechcore.kinematics.model import Model
from mechcore.kinematics.patching import NEAR
from mechcore.laws.timed import Free
from mechcore.motion.compiled import Compiled


class Program:
    """The equations of motion of a compiled mechanism, ready to run."""

    def __init__(self, compiled: Compiled, written: WrittenEquations, followed: tuple[int, ...]):
        self.compiled, self.followed = compiled, followed
        self._laws = [d.law for d in compiled.mechanism.drives if not isinstance(d.law, Free)]
        scales = np.append(coordinate_scales(compiled), np.ones(len(integrating(compiled))))
        self._equations = CompiledEquations(written, np.array(compiled.assembly.modes, float), scales)
        self._of_time = written.of_time
        points = compiled.singular_points
        self._singular = points if points is not None and points.by_drive and points.found else None
        self.partial = self._singular is not None  # next to singular points numpy has to do
        self.everywhere = not (self.partial or followed)  # any states at once
        self.alone = not (self._equations.given or self.partial)  # no values of drives or other functions of the time are needed

    def __call__(self, q: Real, v: Real, t: Real) -> Real:
        """Accelerations (n, f); where angles are followed, of states in order of time that are near each other."""
        return self._equations.accelerations(q, v, t, self._drives(t), self.near(q[:1], v[:1], t[:1]))

    def forms(self, q: Real, v: Real, t: Real) -> Real | None:
        """Forms of all laws that have several (k, n), at states (n, f) each; None where C does not have them."""
        known = self._equations.kinds and self.everywhere
        return self._equations.forms(q, v, t, self._drives(t)).T if known else None

    def strain(self, q: Real, v: Real, t: Real) -> float:
        """Largest rate of a joint per unit rate of a free coordinate at one state, see `charts.strain`."""
        return self._equations.strain(q, v, float(t[0]), self._drives(t), self.near(q, v, t))

    def _drives(self, t: Real) -> Real:
        values = [x for law in self._laws for x in law(t)] + [function(t) for function in self._of_time]
        return np.column_stack([np.zeros((len(t), 0)), *(np.broadcast_to(x, t.shape) for x in values)])

    def near(self, q: Real, v: Real, t: Real) -> Real:
        """The angles (a,) that the program follows, at one state."""
        if not self.followed:
            return np.zeros(0)
        motion = motion_at(self.compiled, q, v, t)
        return np.array([float(np.ravel(motion.group_angle(g))[0]) for g in self.followed])

    def window(
        self, rule: CollocationRule, t0: float, h: float, q: Real, v: Real, guess: Real, tolerance: float
    ) -> tuple[Real, int] | None:
        """Accelerations at the nodes of a window as `solve_window` of numpy; None, too, where it comes near a singular point."""
        if self._singular is not None:
            if not self._clear(q):
                return None
            away = q[0] - self.compiled.start[0]
            modes = [m * float(self._singular.signs(i, away)) for i, m in enumerate(self.compiled.assembly.modes)]
            self._equations.modes[: len(modes)] = modes
        near = self.near(q[None], v[None], np.array([t0]))
        found = self._equations.window(rule, (t0, h), (q, v), self._drives(t0 + h * rule.nodes), near, guess, tolerance)
        if found is None or self._singular is None:
            return found
        places = q + h * rule.nodes[:, None] * v + h * h * (rule.twice @ found[0])
        return found if self._clear(np.append(q[0], places[:, 0])) else None

    def _clear(self, q: Real) -> bool:
        """Whether no singular point is near the way over positions (n,) of the only drive."""
        assert self._singular is not None
        reach = NEAR * max(point.step for point in self._singular.found)
        away = q - self.compiled.start[0]
        return not self._singular.within(float(away.min()) - reach, float(away.max()) + reach)

    def windows(self, rule: CollocationRule, at: Real, bounds: tuple[float, float, float, float, float], count: int) -> Batch:
        """Windows one after the other, see `CompiledEquations.windows`; only where it is ``alone``."""
        return self._equations.windows(rule, at, bounds, count)


def compiled_program(compiled: Compiled) -> Program | None:
    """The program of a mechanism's equations of motion; None where C does not have them or there is no compiler that works.

    Ask for it by `Compiled.once`. Raises `MechanismError` where C is asked for and cannot be compiled.
    """
    written = _written(compiled)
    if isinstance(written, str):
        return None
    try:
        return Program(compiled, *written)
    except MechanismError:
        if compiled.executor == "c":
            raise
        return None


def missing_in_c(compiled: Compiled) -> str | None:
    """Why C does not have the equations of motion of a mechanism, in words; None where it has."""
    written = _written(compiled)
    return written if isinstance(written, str) else None


def written_source(compiled: Compiled) -> tuple[str, int]:
    """The program in C of equations that C has, and how many lines compute them."""
    written = _written(compiled)
    assert not isinstance(written, str), written
    return written[0].source, written[0].lines


def _written(compiled: Compiled) -> tuple[WrittenEquations, tuple[int, ...]] | str:
    known = compiled.model.once(_known)
    start = compiled.angles.start
    turned = tuple(float(x) for x in start.angles.values()), tuple(start.ranges.items()), compiled.angles.exact
    key = (*turned, tuple(compiled.assembly.modes), tuple(compiled.assembly.constants))
    if key not in known:
        try:
            found = written_equations(compiled)
            long = found[0].lines > MOST_LINES
            known[key] = f"the program would have {found[0].lines:,} lines" if long else found
        except Untraceable as reason:
            known[key] = str(reason)
    return known[key]


def _known(_: Model) -> dict[Any, tuple[WrittenEquations, tuple[int, ...]] | str]:
    return {}


class Programmed:
    """Equations of motion that numpy evaluates, or a compiled program where one is wanted."""

    compiled: Compiled

    def program(self, *, long: bool = False) -> Program | None:
        """The compiled program where C is asked for; where the executor is "auto", for a ``long`` motion, and once it is there."""
        executor, there = self.compiled.executor, compiled_program in self.compiled.kept
        return self.compiled.once(compiled_program) if executor == "c" or (executor == "auto" and (long or there)) else None
