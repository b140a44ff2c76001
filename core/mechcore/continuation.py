"""Following a group that no closed form solves from its start over the whole range of the drives.

A coarse walk with adaptive steps follows the branch that the start lies on; a step counts only if Newton's first correction was
small and the determinant of the group's columns kept its sign, so the walk cannot jump to another assembly mode unseen. The
frames that are wanted then start from the walk's interpolation, all at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from . import blocks as bl
from .assembly import Assembly
from .kinematics import velocities
from .model import Model
from .positions import place_all

__all__ = ["Track", "follow"]

Array = Any
Drives = Callable[[float], tuple[list[float], list[float]]]  # parameter -> drive positions and their derivatives by it

LARGEST_CORRECTION = 0.02  # [rad] of the first Newton correction of an accepted step
SMALLEST_STEP = 1e-7  # of the range: below, the walk has met a limit


@dataclass(frozen=True)
class Track:
    """Unknowns of the general blocks along the parameter. ``ends``: the range that was reached (all of it, or up to a limit)."""

    ends: tuple[float, float]
    splines: dict[str, CubicHermiteSpline]

    def starts(self, parameter: Array) -> dict[str, Array]:
        """Newton starts for parameters (F,)."""
        inside = np.clip(parameter, *self.ends)
        return {name: spline(inside) for name, spline in self.splines.items()}


def follow(model: Model, assembly: Assembly, drives: Drives, start: float, low: float, high: float, step: float) -> Track:
    """Walk from ``start`` to ``low`` and to ``high`` with steps of at most ``step``."""
    forward = _walk(model, assembly, drives, start, high, step)
    backward = _walk(model, assembly, drives, start, low, step) if low < start else [forward[0]]
    rows = backward[:0:-1] + forward
    p = np.array([r[0] for r in rows])
    splines = {}
    for name in assembly.starts:
        x, slope = np.array([r[1][name] for r in rows]), np.array([r[2][name] for r in rows])
        if len(p) == 1:
            p1, x, slope = np.array([p[0], p[0] + 1.0]), np.repeat(x, 2, 0), np.zeros((2, x.shape[1]))
            splines[name] = CubicHermiteSpline(p1, x, slope)
        else:
            splines[name] = CubicHermiteSpline(p, x, slope)
    return Track(ends=(p[0], p[-1]), splines=splines)


Row = tuple[float, dict[str, Array], dict[str, Array], dict[str, float]]


def _walk(model: Model, assembly: Assembly, drives: Drives, start: float, end: float, step: float) -> list[Row]:
    row = _at(model, assembly, drives, start, assembly.starts)
    assert row is not None
    rows = [row]
    if end == start:
        return rows
    direction = 1.0 if end > start else -1.0
    h, smallest = step, SMALLEST_STEP * max(abs(end - start), step)
    while direction * (end - rows[-1][0]) > 0:
        p = rows[-1][0]
        h = min(h, direction * (end - p))
        target = end if h == direction * (end - p) else p + direction * h
        new = _at(model, assembly, drives, target, _extrapolate(rows, target))
        if new is not None and _same_branch(rows[-1], new):
            rows.append(new)
            h = min(step, 2.0 * h)
        else:
            h *= 0.5
            if h < smallest:
                break
    return rows


def _extrapolate(rows: Sequence[Row], p: float) -> dict[str, Array]:
    """Hermite extrapolation through the last two points of the walk (tangent where there is only one)."""
    if len(rows) < 2:
        p0, x, slope, _ = rows[-1]
        return {name: x[name] + (p - p0) * slope[name] for name in x}
    (p0, x0, s0, _), (p1, x1, s1, _) = rows[-2], rows[-1]
    h, u = p1 - p0, (p - p0) / (p1 - p0)
    a, b = u * u * (3.0 - 2.0 * u), u * (1.0 - u)  # cubic Hermite polynomial, here with u > 1
    return {n: x0[n] + a * (x1[n] - x0[n]) + h * b * ((1.0 - u) * s0[n] - u * s1[n]) for n in x0}


def _same_branch(old: Row, new: Row) -> bool:
    return all(old[3][name] * new[3][name] > 0 or old[3][name] == 0.0 for name in new[3])


def _at(model: Model, assembly: Assembly, drives: Drives, p: float, starts: dict[str, Array]) -> Row | None:
    """Solve one point of the walk; None where Newton ends too far from its start or nowhere."""
    q, speed = drives(p)
    state = place_all(model, [np.float64(v) for v in q], assembly.modes, starts, constants=assembly.constants)
    for result in state.newton.values():
        if not np.isfinite(result.x).all() or float(result.first) > LARGEST_CORRECTION:
            return None
    contours = {c: bl.vectors(model, c, state) for c in range(len(model.contours))}
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        cols = [bl.columns(model, b, contours) for b in model.blocks]
        rates = velocities(model, contours, cols, [np.float64(v) for v in speed])
    x, slope, det = {}, {}, {}
    for block, c in zip(model.blocks, cols, strict=True):
        if block.kind != "general":
            continue
        matrix, _ = bl.matrix_of(c)
        matrix[..., : len(block.angles)] /= model.size
        x[block.name] = state.newton[block.name].x
        spins = [model.angles.spins_of[g][0] for g in block.angles]
        extra = [sum(s * speed[d] for d, s in model.angles.spin_drives[k]) for k in spins]
        slope[block.name] = np.array(
            [rates.spin[k] - e for k, e in zip(spins, extra, strict=True)] + [rates.slide[j] for j in block.slides]
        )
        det[block.name] = float(np.linalg.det(matrix)) if matrix.shape[-1] == matrix.shape[-2] else 0.0
        if not np.isfinite(slope[block.name]).all():
            return None
    for g in model.wound:
        name = f"angle {g}"
        x[name], slope[name] = np.asarray(bl.real_angle(model, state, g)), np.asarray(rates.group[g])
        if not np.isfinite(x[name]) or abs(float(x[name] - starts[name])) > 0.5:
            return None
    return p, x, slope, det
