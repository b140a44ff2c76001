"""Following a group that no closed form solves from its start over the whole range of the drives.

A coarse walk with adaptive steps follows the branch that the start lies on; a step counts only if Newton's first correction was
small and the determinant of the group's columns kept its sign, so the walk cannot jump to another assembly mode unseen. At a change
point, where branches cross, it goes on along the tangent, on the branch that runs straight through. The
frames that are wanted then start from the walk's interpolation, all at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.branches.assembly import Assembly
from mechcore.branches.limits import find_limit
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.columns import all_columns, all_vectors, matrix_of
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import place_all
from mechcore.kinematics.rates import velocities
from mechcore.kinematics.state import real_angle
from mechcore.numerics.interpolation import interpolant

Drives = Callable[[float], tuple[list[float], list[float]]]  # parameter -> drive positions and their derivatives by it

LARGEST_CORRECTION = 0.02  # [rad] of the first Newton correction of an accepted step
FOR_PASSING = 4  # rows from which the branch is extrapolated through a singular position
SMOOTH = 0.05  # part of the speed or of the way by which the branch may differ from that beyond it
WATCHED = 0.05  # smallest against largest singular value below which a group is looked after
REGULAR = 1e-8  # smallest against largest singular value of the columns of an accepted step
SMALLEST_STEP = 1e-7  # of the range: below, the walk has met a limit, whose place is then found exactly


@dataclass(frozen=True)
class Track:
    """Unknowns of the general blocks along the parameter. ``ends``: the range that was reached (all of it, or up to a limit);
    ``known``: the part of it that the walk's own rows cover, which ends just before a limit.

    ``passed``: singular positions on the way at which the motion goes on along its tangent, and the group that is singular there.
    ``loose``: the groups that have more than one freedom where the walk ended; ``singular``: whether it ended at a limit;
    ``flat_ends``: whether a followed group is all but singular where the walk was let end, so that more of the way should be known.
    """

    ends: tuple[float, float]
    known: tuple[float, float]
    splines: dict[str, Callable[[ArrayLike], Real]]
    passed: tuple[tuple[float, str], ...] = ()
    loose: tuple[str, ...] = ()
    singular: bool = False
    flat_ends: tuple[bool, bool] = (False, False)

    def starts(self, parameter: Real) -> dict[str, Real]:
        """Newton starts for parameters (F,)."""
        inside = np.clip(parameter, *self.known)
        return {name: spline(inside) for name, spline in self.splines.items()}


def follow(model: Model, assembly: Assembly, drives: Drives, start: float, low: float, high: float, step: float) -> Track:
    """Walk from ``start`` to ``low`` and to ``high`` with steps of at most ``step``."""
    passed: list[tuple[float, str]] = []
    forward = _walk(model, assembly, drives, start, high, step, passed)
    backward = _walk(model, assembly, drives, start, low, step, passed) if low < start else [forward[0]]
    stopped = [rows for rows, end in ((forward, high), (backward, low)) if (end - rows[-1][0]) * (end - start) > 0]
    limits = [
        find_limit(model, assembly, drives, rows[-1], high - low, sign) if any(rows is s for s in stopped) else rows[-1][0]
        for rows, sign in ((backward, -1.0), (forward, 1.0))
    ]
    loose = tuple(dict.fromkeys(name for rows in stopped for name in _loose(model, rows[-1])))
    rows = backward[:0:-1] + forward
    p = np.array([r[0] for r in rows])
    splines: dict[str, Callable[[ArrayLike], Real]] = {}
    for name in assembly.starts:
        x, slope = np.array([r[1][name] for r in rows]), np.array([r[2][name] for r in rows])
        if len(p) == 1:
            p1, x, slope = np.array([p[0], p[0] + 1.0]), np.repeat(x, 2, 0), np.zeros((2, *x.shape[1:]))
            splines[name] = interpolant(p1, x, slope)
        elif name.startswith("angle "):  # decides the turn only; next to a limit its slope has no bounds
            splines[name] = interpolant(p, x)
        else:
            splines[name] = interpolant(p, x, slope)
    beyond = (min(low, start), max(high, start))  # a step through a singular position may go a little too far
    known = (max(float(p[0]), beyond[0]), min(float(p[-1]), beyond[1]))
    ends = (max(min(known[0], limits[0]), beyond[0]), min(max(known[1], limits[1]), beyond[1]))
    low_end, high_end = (
        not any(rows is s for s in stopped) and min((_regularity(rows[-1], name) for name in rows[-1][4]), default=1.0) < WATCHED
        for rows in (backward, forward)
    )
    return Track(ends, known, splines, tuple(passed), loose, bool(stopped), (low_end, high_end))


Row = tuple[
    float, dict[str, Real], dict[str, Real], dict[str, float], dict[str, Real]
]  # place, unknowns, slopes, determinants, singular values


def _walk(
    model: Model, assembly: Assembly, drives: Drives, start: float, end: float, step: float, passed: list[tuple[float, str]]
) -> list[Row]:
    row = _at(model, assembly, drives, start, assembly.starts)
    if row is None:
        which = ", ".join(b.name for b in model.blocks if b.kind == "general") or "the groups that relations need"
        raise MechanismError(
            Fault(
                "drives",
                f"the start is a singular position of {which}: where two ways lead on, nothing says which one is meant.",
                "Start the drives a little before or after it.",
            )
        )
    rows = [row]
    if end == start:
        return rows
    direction = 1.0 if end > start else -1.0
    h, smallest = step, SMALLEST_STEP * max(abs(end - start), step)
    while direction * (end - rows[-1][0]) > 0:
        p = rows[-1][0]
        h = min(h, direction * (end - p))
        target = end if h == direction * (end - p) else p + direction * h
        new = None if _singular_before(rows, target) else _at(model, assembly, drives, target, _extrapolate(rows, target))
        if new is not None and _same_branch(rows[-1], new):
            rows.append(new)
            h = min(step, 2.0 * h)
        else:
            h *= 0.5
            if h < smallest:
                names = _pass(model, assembly, drives, rows, direction, step)
                if not names:
                    break
                passed += [(p, one) for one in names]
                h = step
    return rows


def _pass(model: Model, assembly: Assembly, drives: Drives, rows: list[Row], direction: float, step: float) -> list[str]:
    """Go through a singular position, next to which the walk has come to a stand, along the tangent of the configuration curve.

    The branch is extrapolated from rows that are well conditioned to a place on the other side; there Newton must find it close to
    where it was expected, and running on in the same direction. A limit of the motion, where nothing lies beyond, fails this. The
    ill-conditioned rows are taken out. Returns the names of the groups that were singular: those whose determinants have changed
    their signs, or, where one is singular in two ways at once, that which was nearest to it.
    """
    place = rows[-1][0]
    flattest = min(rows[-1][4], key=lambda name: _regularity(rows[-1], name), default=None)
    for part in (8.0, 32.0, 128.0):
        gap = step / part
        kept = [row for row in rows if direction * (place - row[0]) >= gap]
        if len(kept) < 2:
            continue
        last, target = kept[-1], place + direction * gap
        expected, slope = _along(kept[-FOR_PASSING:], target)
        new = _at(model, assembly, drives, target, expected)
        if new is None:
            continue
        flipped = [one for one in new[3] if last[3][one] * new[3][one] < 0]
        far = {n: np.abs(np.atleast_1d(new[1][n] - expected[n])).max() for n in new[1]}
        way = {n: np.abs(np.atleast_1d(expected[n] - last[1][n])).max() for n in new[1]}
        bend = {n: np.abs(np.atleast_1d(new[2][n] - slope[n])).max() for n in new[2]}
        speed = {n: np.abs(np.atleast_1d(last[2][n])).max() + np.abs(np.atleast_1d(slope[n])).max() for n in new[2]}
        smooth = all(bend[n] <= SMOOTH * max(speed.values()) and far[n] <= SMOOTH * max(way.values()) for n in far)
        if smooth and flattest is not None:
            rows[:] = [*kept, new]
            return flipped or [flattest]
    return []


def _regularity(row: Row, name: str) -> float:
    """Smallest against largest singular value of a group's columns."""
    s = row[4][name]
    return float(s[-1] / s[0])


def _singular_before(rows: Sequence[Row], p: float) -> bool:
    """Whether a group would be singular before ``p`` if its smallest singular value went on falling as it does: the way there is
    then taken in smaller steps, or a position that is singular in two ways at once would be stepped over unseen."""
    if len(rows) < 2:
        return False
    far = (p - rows[-1][0]) / (rows[-1][0] - rows[-2][0])
    for name in rows[-1][4]:
        now, before = _regularity(rows[-1], name), _regularity(rows[-2], name)
        if now < WATCHED and now + far * (now - before) < 0.0:
            return True
    return False


def _along(rows: Sequence[Row], p: float) -> tuple[dict[str, Real], dict[str, Real]]:
    """Position and slope at ``p`` by the polynomial through the positions and slopes of some rows."""
    places = np.array([row[0] for row in rows])
    h = float(np.ptp(places)) or 1.0
    u, at = (places - places[-1]) / h, (p - places[-1]) / h
    n = 2 * len(rows)
    power = np.arange(n)
    matrix = np.concatenate([u[:, None] ** power, power * u[:, None] ** np.maximum(power - 1, 0)])
    out: tuple[dict[str, Real], dict[str, Real]] = ({}, {})
    for name in rows[-1][1]:
        values = np.array([np.atleast_1d(row[1][name]) for row in rows])
        slopes = np.array([np.atleast_1d(row[2][name]) for row in rows]) * h
        c = np.linalg.solve(matrix, np.concatenate([values, slopes]))
        shape = np.shape(rows[-1][1][name])
        out[0][name] = np.reshape(at**power @ c, shape)
        out[1][name] = np.reshape((power * at ** np.maximum(power - 1, 0)) @ c / h, shape)
    return out


def _loose(model: Model, row: Row) -> list[str]:
    """Groups that have two freedoms or more at a row next to which a walk has come to a stand."""
    return [name for name, s in row[4].items() if len(s) > 1 and s[-2] < 1e-4 * s[0]]


def _extrapolate(rows: Sequence[Row], p: float) -> dict[str, Real]:
    """Hermite extrapolation through the last two points of the walk (tangent where there is only one)."""
    if len(rows) < 2:
        p0, x, slope, *_ = rows[-1]
        return {name: x[name] + (p - p0) * slope[name] for name in x}
    (p0, x0, s0, *_), (p1, x1, s1, *_) = rows[-2], rows[-1]
    h, u = p1 - p0, (p - p0) / (p1 - p0)
    a, b = u * u * (3.0 - 2.0 * u), u * (1.0 - u)  # cubic Hermite polynomial, here with u > 1
    return {n: x0[n] + a * (x1[n] - x0[n]) + h * b * ((1.0 - u) * s0[n] - u * s1[n]) for n in x0}


def _same_branch(old: Row, new: Row) -> bool:
    return all(old[3][name] * new[3][name] > 0 or old[3][name] == 0.0 for name in new[3])


def _at(model: Model, assembly: Assembly, drives: Drives, p: float, starts: dict[str, Real]) -> Row | None:
    """Solve one point of the walk; None where Newton ends too far from its start or nowhere."""
    q, speed = drives(p)
    state = place_all(model, [np.float64(v) for v in q], assembly.modes, starts, constants=assembly.constants)
    for result in state.newton.values():
        if not np.isfinite(result.x).all() or float(result.first) > LARGEST_CORRECTION:
            return None
    vectors = all_vectors(model, state)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        cols = all_columns(model, vectors)
        rates = velocities(model, vectors, cols, [np.float64(v) for v in speed], bends=state.bends)
    x, slope, det, singular = {}, {}, {}, {}
    for block, c in zip(model.blocks, cols, strict=True):
        if block.kind != "general":
            continue
        matrix, _ = matrix_of(c)
        matrix[..., : len(block.angles)] /= model.length_scale
        x[block.name] = state.newton[block.name].x
        classes = [model.angles.classes_of[g][0] for g in block.angles]
        extra = [sum(s * speed[d] for d, s in model.angles.class_drives[k]) for k in classes]
        turning = [rates.angular[k] - e for k, e in zip(classes, extra, strict=True)]
        slope[block.name] = np.array([*turning, *(rates.slide[j] for j in block.slides)], float)
        det[block.name] = float(np.linalg.det(matrix)) if matrix.shape[-1] == matrix.shape[-2] else 0.0
        if not np.isfinite(slope[block.name]).all():
            return None
        singular[block.name] = s = np.asarray(np.linalg.svd(matrix, compute_uv=False), float)
        if matrix.shape[-1] == matrix.shape[-2] and s[-1] < REGULAR * s[0]:
            return None  # the sign of its determinant says nothing
    for g in model.multi_turn:
        name = f"angle {g}"
        x[name], slope[name] = np.asarray(real_angle(model, state, g)), np.asarray(rates.group[g])
        if not np.isfinite(x[name]) or not np.isfinite(slope[name]) or abs(float(x[name] - starts[name])) > 0.5:
            return None
    return p, x, slope, det, singular
