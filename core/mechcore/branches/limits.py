"""Where a walk ends: the exact place of the limit next to which it came to a stand.

At a limit of a followed group the configuration curve turns back: along the curve the parameter has an extremum there. Followed by
its own length instead of by the parameter the curve is regular, and the extremum is the zero of a smooth function. Where a group
with a closed form can no longer be put together, the place is found by bisection.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.branches.assembly import Assembly
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import equations, place
from mechcore.kinematics.program import Block
from mechcore.kinematics.state import State, initial_state

Drives = Callable[[float], tuple[list[float], list[float]]]
NEAR = 1e-5  # of the walk's range: what is farther away than this from its last row is not what it came to a stand at
STEP = 1e-3  # along the curve, relative: the second place from which the extremum is looked for
CLOSE = 1e-13  # relative
HALVINGS = 60


def find_limit(model: Model, assembly: Assembly, drives: Drives, row: Any, span: float, direction: float) -> float:
    """The parameter at which the way of a walk ends, beyond its last row; the row's own where that cannot be told.

    ``row``: parameter, unknowns, slopes, determinants and singular values of the groups (see `continuation`); ``span``: the
    walk's range; ``direction`` +1 or -1.
    """
    p = float(row[0])
    reach = p + direction * NEAR * span
    with np.errstate(all="ignore"):
        found = [_missing(model, assembly, drives, row, p, reach)]
        for block in model.blocks:
            if block.kind == "general" and block.name in row[4]:
                found.append(_fold(model, assembly, drives, block, row, NEAR * span))
    ahead = [q for q in found if q is not None and 0.0 <= direction * (q - p) <= NEAR * span]
    return min(ahead, key=lambda q: direction * q, default=p)


def _placed_before(model: Model, assembly: Assembly, drives: Drives, row: Any, p: float, block: Block | None) -> State:
    """Positions of the groups before one that is looked at (None: of all with a closed form before the first followed one)."""
    state = initial_state(model, [np.float64(q) for q in drives(p)[0]], assembly.constants, row[1])
    for b, mode in zip(model.blocks, assembly.modes, strict=True):
        if b is block or (block is None and b.kind == "general"):
            break
        place(model, b, state, mode, row[1].get(b.name))
    return state


def _missing(model: Model, assembly: Assembly, drives: Drives, row: Any, p: float, far: float) -> float | None:
    """Where groups with closed forms, before any followed one, stop fitting together; None where they do at both ends."""

    def fits(at: float) -> bool:
        state = _placed_before(model, assembly, drives, row, at, None)
        values = [*(r for r in state.rot if r is not None), *state.slide.values()]
        return bool(np.isfinite(np.array([complex(v) for v in values])).all())

    if fits(far) or not fits(p):
        return None
    for _ in range(HALVINGS):
        middle = 0.5 * (p + far)
        p, far = (middle, far) if fits(middle) else (p, middle)
    return p


def _fold(model: Model, assembly: Assembly, drives: Drives, block: Block, row: Any, near: float) -> float | None:
    """Where the curve of a followed group turns back, next to a row of its walk."""
    scale = np.concatenate([np.ones(len(block.angles)), np.full(len(block.slides), model.length_scale)])
    start, p0 = np.asarray(row[1][block.name], float) / scale, float(row[0])
    h = 0.1 * near

    def left(x: Real, p: float) -> tuple[Real, Real]:
        state = _placed_before(model, assembly, drives, row, p, block)
        r, jacobian = equations(model, block, state)(x)
        return r, jacobian

    _, jacobian = left(start, p0)
    if jacobian.shape[0] != jacobian.shape[1]:
        return None
    along = np.linalg.svd(jacobian)[2][-1]

    def on_curve(s: float, x: Real, p: float) -> tuple[Real, float, float] | None:
        """The point of the curve that lies ``s`` along from the start, and how fast the parameter changes there."""
        for _ in range(12):
            r, jacobian = left(x, p)
            by_p = (left(x, p + h)[0] - left(x, p - h)[0]) / (2.0 * h)
            matrix = np.block([[jacobian, by_p[:, None]], [along[None], np.zeros((1, 1))]])
            both = np.column_stack([np.append(-r, s - along @ (x - start)), np.append(np.zeros(len(r)), 1.0)])
            if not np.isfinite(matrix).all() or not np.isfinite(both).all():
                return None
            step, tangent = np.linalg.lstsq(matrix, both, rcond=None)[0].T
            x, p = x + step[:-1], p + float(step[-1])
            if np.abs(step[:-1]).max() < CLOSE and abs(step[-1]) < CLOSE * max(near / NEAR, abs(p)):
                break
        return x, p, float(tangent[-1])

    first = on_curve(0.0, start, p0)
    if first is None:
        return None
    x, p, speed = first
    s, other = 0.0, STEP
    for _ in range(40):
        point = on_curve(other, x, p)
        if point is None:
            return None
        x, p, now = point
        if abs(other - s) < 1e-9 or now == speed:
            break
        s, other, speed = other, other - now * (other - s) / (now - speed), now
        if abs(other) > 0.2:
            return None
    return p
