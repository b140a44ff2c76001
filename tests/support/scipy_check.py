"""A simulation against scipy's integrators, with the same equations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from scipy.integrate import solve_ivp

from mechcore.arrays import Real
from mechcore.dynamics.equations.reduced import coordinate_scales, free_of
from mechcore.dynamics.integration.collocation import System
from mechcore.dynamics.segments import MotionSegment
from mechcore.dynamics.simulation import Simulation


def right_hand_side(system: System, freedoms: int) -> Callable[[float, Real], Real]:
    """(t, y) -> y' of a system of accelerations, y = positions and speeds (2 f,): as scipy wants it, one state at a time."""

    def rhs(t: float, y: Real) -> Real:
        v = y[freedoms:]
        return np.concatenate([v, system(y[None, :freedoms], v[None], np.array([t]))[0]])

    return rhs


def cross_check(
    simulation: Simulation, *, method: Literal["DOP853", "Radau", "LSODA"] = "DOP853", tolerance: float = 1e-10, samples: int = 5
) -> float:
    """Largest difference of positions between a simulation and `scipy.integrate.solve_ivp`, relative to one radian or the
    mechanism's size.

    Every segment, between one event and the next, is integrated anew from where the simulation has it begin, with the same
    equations, and compared at ``samples`` moments; scipy's ``rtol`` is ``tolerance``.
    """
    moving = [s for s in simulation.segments if free_of(s.compiled)]
    return max((_differs(s, method, tolerance, samples) for s in moving), default=0.0)


def _differs(segment: MotionSegment, method: str, tolerance: float, samples: int) -> float:
    if segment.end - segment.start <= 1e-12 * max(abs(segment.end), 1e-300):
        return 0.0
    t = np.linspace(segment.start, segment.end, samples + 1)
    q, v, _ = segment(t)
    scale = coordinate_scales(segment.compiled)
    f = len(scale)
    solve: Any = solve_ivp  # stubs of scipy, where there are any, take real states for complex ones
    solution = solve(
        right_hand_side(segment.system, f),
        (segment.start, segment.end),
        np.concatenate([q[0], v[0]]),
        method=method,
        t_eval=t,
        rtol=tolerance,
        atol=tolerance * np.append(scale, scale / (segment.end - segment.start)) * 1e-2,
    )
    if not solution.success:
        return float("inf")
    return float(np.max(np.abs(solution.y[:f].T - q) / scale))
