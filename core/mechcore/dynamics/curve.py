"""One freedom: the mechanism on its configuration curve, with masses and forces reduced to one coordinate once and for all.

J(q), and the reduced force Q(q) of all loads that depend on the position alone, are tabulated over the whole way (one turn where
it is periodic); J' and the work of Q follow from the same polynomials, so that the energy balance of the tabulated system is
exact. Loads that depend on speed or time are evaluated where they are needed. Then J q'' + J' q'^2 / 2 = Q.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..effects import Effect, effects_of, power_of
from ..motion import Motion
from ..solve import Compiled
from .panels import Panels, fit_panels
from .reduced import motion_at, with_rates

__all__ = ["TURN", "Curve", "tabulate"]

Array = NDArray[np.float64]
TURN = 2.0 * np.pi
STEP = 1e-7  # of a finite difference; slopes only steer Newton's method


@dataclass(frozen=True, eq=False)
class Curve:
    """``table``: J and the tabulated part of Q; ``both``: J, Q, J', Q', J''; ``rest``: effects that are not in the table."""

    compiled: Compiled
    table: Panels
    both: Panels
    rest: tuple[Effect, ...] = ()

    def __call__(self, q: Array, v: Array, t: Array) -> Array:
        f = self.both(q[:, 0])
        w = v[:, 0]
        force = f[:, 1] + self.changing(q, v, t) if self.rest else f[:, 1]
        return ((force - 0.5 * f[:, 2] * w * w) / f[:, 0])[:, None]

    def changing(self, q: Array, v: Array, t: Array) -> Array:
        """The part of Q (n,) that depends on speed or time."""
        unit = motion_at(self.compiled, q, np.ones_like(v), t)
        moving = with_rates(unit, [v[:, 0]])
        total: Any = np.zeros(len(t))
        for effect in self.rest:
            for w in effect.wrenches(moving):
                total = total + power_of(unit, w)
        return np.asarray(total)

    def slopes(self, q: Array, v: Array, t: Array, a: Array) -> tuple[Array, Array]:
        f = self.both(q[:, 0])
        w = v[:, 0]
        by_q = f[:, 3] - 0.5 * f[:, 4] * w * w - a[:, 0] * f[:, 2]
        by_v = -f[:, 2] * w
        if self.rest:
            n = len(t)
            steps = STEP * max(1.0, float(np.abs(q).max())), STEP * max(1.0, float(np.abs(v).max()))
            found = self.changing(
                np.concatenate([q, q + steps[0], q]), np.concatenate([v, v, v + steps[1]]), np.concatenate([t, t, t])
            ).reshape(3, n)
            by_q, by_v = by_q + (found[1] - found[0]) / steps[0], by_v + (found[2] - found[0]) / steps[1]
        return (by_q / f[:, 0])[:, None, None], (by_v / f[:, 0])[:, None, None]


def tabulate(compiled: Compiled, low: float, high: float, *, periodic: bool, tolerance: float = 1e-13) -> Curve:
    """Reduce the mechanism to its free coordinate between ``low`` and ``high``, one turn where it is ``periodic``."""
    effects = [e for e in effects_of(compiled.mechanism) if "accelerations" not in e.needs]
    rest = tuple(
        e for e in effects if e.piecewise or not e.needs <= {"positions"} or not _repeats(e, compiled, low, high, periodic)
    )
    fixed = [e for e in effects if e not in rest]

    def values(q: Array) -> Array:
        unit = motion_at(compiled, q[:, None], np.ones((len(q), 1)), np.zeros(len(q)))
        force: Any = np.zeros(len(q))
        for effect in fixed:
            for w in effect.wrenches(unit):
                force = force + power_of(unit, w)
        return np.column_stack([inertia_of(unit), force])

    table = fit_panels(values, low, high, periodic=periodic, tolerance=tolerance)
    first = table.derivative()
    second = first.derivative()
    both = table.stacked(first).stacked(Panels(table.low, table.width, second.coefficients[:, :, :1], table.periodic))
    return Curve(compiled, table, both, rest)


def _repeats(effect: Effect, compiled: Compiled, low: float, high: float, periodic: bool) -> bool:
    """Whether an effect is the same after a turn (torsion springs, and tables over an angle that goes on, are not)."""
    if not periodic:
        return True
    q = np.linspace(low, high, 7)[:-1] + 0.1234
    forces = []
    for turn in (0.0, high - low):
        unit = motion_at(compiled, (q + turn)[:, None], np.ones((len(q), 1)), np.zeros(len(q)))
        forces.append(sum((power_of(unit, w) for w in effect.wrenches(unit)), np.zeros(len(q))))
    return bool(np.abs(forces[1] - forces[0]).max() <= 1e-9 * np.abs(forces[0]).max())


def inertia_of(unit: Motion) -> Array:
    """Reduced inertia (n,) at a motion with unit rate of the free coordinate."""
    total: Any = np.zeros(unit.frames)
    model = unit.model
    for k in range(1, len(model.links)):
        mass, centre, moment = model.masses[k]
        if mass:
            v = unit.of_point(k, centre, 1)
            total = total + mass * (v.real**2 + v.imag**2)
        if moment:
            total = total + moment * unit.speeds.spin[model.angles.spin[k]] ** 2
    return np.asarray(total)
