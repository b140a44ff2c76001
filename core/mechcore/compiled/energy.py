"""Motions by their energy in C: the time of a turn, and the position of a motion at a time; `energy.c` from Python."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.compiled.kernels import address
from mechcore.compiled.toolchain import library
from mechcore.errors import MechanismError
from mechcore.numerics.chebyshev import FIT, NODES, PANEL_NODES, TAIL_NOISE, Panels

MOST_PANELS = 4096  # MOST of energy.c
LAST_STEP = 1e-10  # after a shorter last step of Newton's method the error is of the order of its square


@cache
def _functions() -> ctypes.CDLL | None:
    """The functions of `energy.c`; None where they cannot be compiled."""
    try:
        loaded = library(Path(__file__).with_name("energy.c").read_text(encoding="utf-8"))
    except MechanismError:
        return None
    whole, number, place = ctypes.c_long, ctypes.c_double, ctypes.c_void_p
    loaded.rounds.restype = whole
    loaded.rounds.argtypes = [whole, number, number, place, number, number, place, place, place, whole, place]
    loaded.clocked.restype = None
    loaded.clocked.argtypes = [whole, place, place, place, number, whole, place, place]
    return loaded


def time_of_turn(
    table: Panels, q: float, v: float, tolerance: float, first: int, limits: tuple[float, float, float]
) -> Panels | None:
    """dt/du and t(u) of a turn from q on, u in [0, 1], where a motion that starts there at a rate v rotates continually; None where
    it does not, or where that is not found.

    ``table``: inertia and force over a turn, on equal panels. ``limits``, relative to the largest work: the gain of a turn that
    counts as rounding, the least kinetic energy, and the least kinetic energy left everywhere.
    """
    functions = _functions()
    if functions is None:
        return None
    out = np.empty(MOST_PANELS + 1 + 2 * (PANEL_NODES + 1) * MOST_PANELS)
    coefficients, given = np.ascontiguousarray(table.coefficients), np.array([tolerance, TAIL_NOISE, *limits])
    at = address(coefficients), q, v, address(FIT), address(NODES), address(given)
    count: int = functions.rounds(table.count, table.low, table.width, *at, first, address(out))
    if not count:
        return None
    series = out[count + 1 : count + 1 + 2 * (PANEL_NODES + 1) * count].reshape(count, PANEL_NODES + 1, 2).copy()
    return Panels(0.0, np.nan, series, False, out[: count + 1].copy())


def parameters_at(clock: Panels, edges: Real, t: Real) -> Real | None:
    """The parameter u and dt/du (n, 2) at times (n,) since a leg began, whose panels begin at times ``edges`` (p + 1,)."""
    functions = _functions()
    if functions is None:
        return None
    boundaries: Any = clock.boundaries
    out, times = np.empty((len(t), 2)), np.ascontiguousarray(t)
    at = address(boundaries), address(edges), address(clock.coefficients)
    functions.clocked(clock.count, *at, LAST_STEP, len(times), address(times), address(out))
    return out
