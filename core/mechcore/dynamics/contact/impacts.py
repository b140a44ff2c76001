"""End stops at an instant: how fast a stop's coordinate moves, and Newton's impact on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.equations.chart import jacobian_of
from mechcore.dynamics.equations.reduced import free_of, motion_at, moving, reduce, shifted
from mechcore.errors import Fault, MechanismError
from mechcore.motion.compiled import Compiled

HELD = 1e-11  # part of the largest rate per unit rate of a coordinate, below which prescribed drives or other stops hold a pair


def rates_at(compiled: Compiled, system: Any, pair: str, q: Real, v: Real, t: float) -> tuple[float, float]:
    """Rate and second rate of a pair's coordinate, in which prescribed drives have their share; q, v (f,), ``system`` of the
    accelerations."""
    row = np.array([t])
    a = np.asarray(system(q[None], v[None], row))
    free = [compiled.mechanism.drives[i].pair for i in free_of(compiled)]
    if pair in free:
        i = free.index(pair)
        return float(v[i]), float(a[0, i])
    _, rate, second = motion_at(compiled, q[None], v[None], row, a).coordinate(pair)[0]
    return float(rate), float(second)


def jacobian_at(compiled: Compiled, pairs: Sequence[str], q: Real, v: Real, t: float) -> Real:
    """Rates of pairs' coordinates per unit rate of each free coordinate (p, f), prescribed drives standing still."""
    return jacobian_of(*moving(compiled, q[None], v[None], np.array([t])), pairs)[0][0]


def impact(
    compiled: Compiled, pair: str, resting: Sequence[str], restitution: float, hit: float, q: Real, v: Real, t: float
) -> tuple[Real, float]:
    """Rates (f,) after the impact of a pair's coordinate, at the rate ``hit``, on its stop; energy that is lost [J].

    Its impulse spreads over all coordinates by the reduced masses; pairs ``resting`` on other stops stay there. Raises
    `MechanismError` where prescribed drives or those stops lead the pair.
    """
    inertia = reduce(compiled, q[None], v[None], np.array([t])).inertia[0]
    jacobian = jacobian_at(compiled, [pair, *resting], q, v, t)
    if np.linalg.matrix_rank(jacobian, tol=HELD * float(np.abs(jacobian).max(initial=1e-300))) < len(jacobian):
        side = "upper" if hit > 0.0 else "lower"
        why = f"at t = {t:.6g} s {pair} strikes its {side} stop, but prescribed drives or other stops lead it: no impulse stops it."
        raise MechanismError(Fault(f"joints.{pair}.stops", why, "Move the stop beyond the motion, or leave it out."))
    change, lost = newton_impact(inertia, jacobian, hit, restitution)
    return shifted(v, change), lost


def newton_impact(inertia: Real, jacobian: Real, hit: float, restitution: float) -> tuple[Real, float]:
    """Change of the rates (f,) by an impact after Newton, and energy that is lost [J]; ``inertia`` (f, f).

    ``jacobian`` (1 + c, f): of what comes at the rate ``hit`` and leaves at minus ``restitution`` times it, then of what keeps
    its rate.
    """
    mobility = np.linalg.solve(inertia, jacobian.T)
    push = mobility[:, 0]
    if len(jacobian) > 1:
        others = mobility[:, 1:]
        push = push - others @ np.linalg.solve(jacobian[1:] @ others, jacobian[1:] @ push)
    mass = 1.0 / float(jacobian[0] @ push)
    return np.asarray(-push * ((1.0 + restitution) * hit * mass)), 0.5 * mass * hit * hit * (1.0 - restitution**2)
