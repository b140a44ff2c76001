"""The same right-hand side by other hands: scipy's integrators on every stretch of a simulation."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .pieces import Piece
from .reduced import free_of
from .simulation import Simulation

__all__ = ["cross_check", "right_hand_side"]

Array = NDArray[np.float64]


def right_hand_side(system: Any, freedoms: int) -> Any:
    """(t, y) -> y' of a system of accelerations, y = positions and speeds (2 f,): as scipy wants it, one state at a time."""

    def rhs(t: float, y: Array) -> Array:
        v = y[freedoms:]
        return np.concatenate([v, system(y[None, :freedoms], v[None], np.array([t]))[0]])

    return rhs


def cross_check(
    simulation: Simulation, *, method: Literal["DOP853", "Radau", "LSODA"] = "DOP853", tolerance: float = 1e-10, samples: int = 5
) -> float:
    """Largest difference of positions between a simulation and `scipy.integrate.solve_ivp`, relative to one radian or the
    mechanism's size.

    Every stretch, between one happening and the next, is integrated anew from where the simulation has it begin, with the same
    equations, and compared at ``samples`` moments; scipy's ``rtol`` is ``tolerance``.
    """
    return max((_differs(piece, method, tolerance, samples) for piece in simulation.pieces if free_of(piece.compiled)), default=0.0)


def _differs(piece: Piece, method: str, tolerance: float, samples: int) -> float:
    from scipy.integrate import solve_ivp

    if piece.end - piece.start <= 1e-12 * max(abs(piece.end), 1e-300):
        return 0.0
    t = np.linspace(piece.start, piece.end, samples + 1)
    q, v, _ = piece(t)
    model = piece.compiled.model
    pairs = [piece.compiled.mechanism.drives[i].pair for i in free_of(piece.compiled)]
    scale = np.array([1.0 if model.joints[model.joint_index[p]].coordinate == "angle" else model.size for p in pairs])
    solve: Any = solve_ivp  # stubs of scipy, where there are any, take real states for complex ones
    found = solve(
        right_hand_side(piece.system, len(pairs)),
        (piece.start, piece.end),
        np.concatenate([q[0], v[0]]),
        method=method,
        t_eval=t,
        rtol=tolerance,
        atol=tolerance * np.tile(scale, 2) * 1e-2,
    )
    if not found.success:
        return float("inf")
    return float(np.max(np.abs(found.y[: len(pairs)].T - q) / scale))
