"""Continuation of the branch on which a mechanism has been assembled, along a parameter that its drives depend on.

All continuation with a predictor, Newton's method as corrector and step size control is here. A step is accepted only if Newton's
first correction was small and the determinants of the groups' columns kept their signs, so that the path cannot jump to another
assembly mode unnoticed. At a change point, where branches cross, the path continues along the tangent, on the smooth branch. Where
the path stops next to a limit, the limit is located exactly. Newton's method at the frames then starts from the interpolated path,
for all frames together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.branches.assembly import Assembly
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.columns import all_columns, all_vectors, matrix_of
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import equations, place_all, place_block
from mechcore.kinematics.program import Block
from mechcore.kinematics.rates import velocities
from mechcore.kinematics.state import Interpolant, State, initial_state, real_angle
from mechcore.laws.timed import Law
from mechcore.numerics.interpolation import interpolant
from mechcore.records import dataclass

LARGEST_CORRECTION = 0.02  # [rad] of the first Newton correction of an accepted step
LARGEST_TURN = 0.5  # [rad] by which an angle beyond one turn may differ from its prediction
FOR_PASSING = 4  # rows from which the branch is extrapolated through a singular position
SMOOTH_CHANGE = 0.05  # relative difference of speed or travel allowed between the extrapolated branch and the one found beyond
WATCHED_RATIO = 0.05  # of smallest to largest singular value: below, a group is monitored
REGULAR_RATIO = 1e-8  # of smallest to largest singular value of the columns: least of an accepted step
SECOND_FREEDOM_RATIO = 1e-4  # of second smallest to largest singular value: below, a group has two degrees of freedom or more
SMALLEST_STEP = 1e-7  # of the range: below, the path has met a limit, which is then located exactly
# Of the range: a limit farther than this from the last row is not the one at which the path stopped
LIMIT_DISTANCE = 1e-5
SECOND_PLACE = 1e-3  # along the curve, relative: second starting point of the search for a fold
FARTHEST_FOLD = 0.2  # along the curve: a fold farther off is not the one at which the path stopped
LIMIT_TOLERANCE = 1e-13  # relative
MOST_HALVINGS = 60


@dataclass(frozen=True, eq=False)
class Branch:
    """The curve to be continued: a mechanism as assembled, whose first drives follow ``laws`` of a parameter; the others are held
    at ``fixed_positions``.

    Continued are the groups of ``model`` of the kind "general", and the angles of its ``multi_turn`` groups.
    """

    model: Model
    assembly: Assembly
    laws: tuple[Law, ...]
    fixed_positions: tuple[float, ...] = ()

    def drives(self, parameter: Real | float) -> tuple[list[Real], list[Real]]:
        """Positions of all drives at parameters (...), and their derivatives by the parameter."""
        drives = [law(parameter) for law in self.laws]
        positions, speeds = [np.asarray(q, float)[()] for q, _, _ in drives], [np.asarray(v, float)[()] for _, v, _ in drives]
        if self.fixed_positions:
            none = np.zeros(np.shape(parameter))
            positions, speeds = positions + [none + q for q in self.fixed_positions], speeds + [none] * len(self.fixed_positions)
        return positions, speeds

    def placed(
        self, parameter: Real | float, starts: Mapping[str, Real], interpolants: Mapping[int, Sequence[Interpolant]] | None = None
    ) -> State:
        """Positions of all groups at parameters (...) from Newton ``starts`` there."""
        positions, _ = self.drives(parameter)
        return place_all(self.model, positions, self.assembly.modes, starts, interpolants, constants=self.assembly.constants)


@dataclass(frozen=True, eq=False)
class PathPoint:
    """A point of a path: unknowns of the continued groups and their slopes, determinants and singular values of their columns."""

    parameter: float
    unknowns: dict[str, Real]
    slopes: dict[str, Real]
    determinants: dict[str, float]
    singular_values: dict[str, Real]

    def regularity(self, name: str) -> float:
        """Ratio of the smallest to the largest singular value of a group's columns."""
        s = self.singular_values[name]
        return float(s[-1] / s[0])

    @property
    def underdetermined(self) -> list[str]:
        """Names of the groups that have two degrees of freedom or more here."""
        return [name for name, s in self.singular_values.items() if len(s) > 1 and s[-2] < SECOND_FREEDOM_RATIO * s[0]]

    def same_branch(self, new: PathPoint) -> bool:
        """Whether no determinant has changed its sign."""
        return all(old * new.determinants[name] > 0 or old == 0.0 for name, old in self.determinants.items())


@dataclass(frozen=True, eq=False)
class ContinuationPath:
    """Unknowns of the continued groups along the parameter.

    ``ends``: the range that was reached (all of it, or up to a limit); ``covered_range``: the part of it that the path's rows
    cover, which ends just before a limit. ``passed``: singular positions through which the motion continues along its tangent, and
    the group that is singular there. ``underdetermined``: the groups that have more than one degree of freedom where the path
    stopped; ``singular``: whether it stopped at a limit; ``nearly_singular_ends``: whether, at each end of the range reached
    without a limit, a continued group is nearly singular, so that the path should be extended.
    """

    ends: tuple[float, float]
    covered_range: tuple[float, float]
    splines: dict[str, Callable[[ArrayLike], Real]]
    passed: tuple[tuple[float, str], ...] = ()
    underdetermined: tuple[str, ...] = ()
    singular: bool = False
    nearly_singular_ends: tuple[bool, bool] = (False, False)

    def starts(self, parameter: Real) -> dict[str, Real]:
        """Newton starts for parameters (F,)."""
        inside = np.clip(parameter, *self.covered_range)
        return {name: spline(inside) for name, spline in self.splines.items()}


def continuation_path(branch: Branch, start: float, low: float, high: float, step: float) -> ContinuationPath:
    """The branch from ``low`` to ``high``, or as far as it reaches, continued from ``start`` in steps of at most ``step``.

    Raises `MechanismError` if the start is singular, so that the branch is ambiguous.
    """
    passed: list[tuple[float, str]] = []
    forward = _continued(branch, start, high, step, passed)
    backward = _continued(branch, start, low, step, passed) if low < start else [forward[0]]
    stopped = [rows for rows, end in ((forward, high), (backward, low)) if (end - rows[-1].parameter) * (end - start) > 0]
    limits = [
        _limit(branch, rows[-1], high - low, sign) if any(rows is s for s in stopped) else rows[-1].parameter
        for rows, sign in ((backward, -1.0), (forward, 1.0))
    ]
    underdetermined = tuple(dict.fromkeys(name for rows in stopped for name in rows[-1].underdetermined))
    rows = backward[:0:-1] + forward
    p = np.array([row.parameter for row in rows])
    splines: dict[str, Callable[[ArrayLike], Real]] = {}
    for name in branch.assembly.starts:
        x, slope = np.array([row.unknowns[name] for row in rows]), np.array([row.slopes[name] for row in rows])
        if len(p) == 1:
            p1, x, slope = np.array([p[0], p[0] + 1.0]), np.repeat(x, 2, 0), np.zeros((2, *x.shape[1:]))
            splines[name] = interpolant(p1, x, slope)
        elif name.startswith("angle "):  # selects the turn only; next to a limit its slope is unbounded
            splines[name] = interpolant(p, x)
        else:
            splines[name] = interpolant(p, x, slope)
    beyond = (min(low, start), max(high, start))  # a step through a singular position may overshoot
    covered_range = (max(float(p[0]), beyond[0]), min(float(p[-1]), beyond[1]))
    ends = (max(min(covered_range[0], limits[0]), beyond[0]), min(max(covered_range[1], limits[1]), beyond[1]))
    low_end, high_end = (
        not any(rows is s for s in stopped)
        and min((rows[-1].regularity(name) for name in rows[-1].singular_values), default=1.0) < WATCHED_RATIO
        for rows in (backward, forward)
    )
    return ContinuationPath(ends, covered_range, splines, tuple(passed), underdetermined, bool(stopped), (low_end, high_end))


# -- steps --------------------------------------------------------------------------------------------------------------------
def _continued(branch: Branch, start: float, end: float, step: float, passed: list[tuple[float, str]]) -> list[PathPoint]:
    """Rows from ``start`` to ``end``, or to the limit before it; singular positions passed on the way are added to ``passed``."""
    row = _row_at(branch, start, branch.assembly.starts)
    if row is None:
        which = ", ".join(b.name for b in branch.model.blocks if b.kind == "general") or "the groups that relations need"
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
    while direction * (end - rows[-1].parameter) > 0:
        p = rows[-1].parameter
        h = min(h, direction * (end - p))
        target = end if h == direction * (end - p) else p + direction * h
        new = None if _singular_before(rows, target) else _row_at(branch, target, _extrapolated(rows[-2:], target))
        if new is not None and rows[-1].same_branch(new):
            rows.append(new)
            h = min(step, 2.0 * h)
        else:
            h *= 0.5
            if h < smallest:
                names = _pass(branch, rows, direction, step)
                if not names:
                    break
                passed += [(p, one) for one in names]
                h = step
    return rows


def _row_at(branch: Branch, p: float, starts: Mapping[str, Real]) -> PathPoint | None:
    """The point of the path at ``p``; None if Newton's method does not converge or ends too far from its start, or if a group is
    singular."""
    model, assembly = branch.model, branch.assembly
    positions, speeds = branch.drives(p)
    state = place_all(model, positions, assembly.modes, starts, constants=assembly.constants)
    for result in state.newton.values():
        if not np.isfinite(result.x).all() or float(result.first) > LARGEST_CORRECTION:
            return None
    vectors = all_vectors(model, state)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        cols = all_columns(model, vectors)
        rates = velocities(model, vectors, cols, speeds, curve_values=state.curve_values)
    row = PathPoint(p, {}, {}, {}, {})
    for block, c in zip(model.blocks, cols, strict=True):
        if block.kind != "general":
            continue
        matrix, _ = matrix_of(c)
        matrix[..., : len(block.angles)] /= model.length_scale
        square = matrix.shape[-1] == matrix.shape[-2]
        classes = [model.angles.classes_of[g][0] for g in block.angles]
        extra = [sum(s * speeds[d] for d, s in model.angles.class_drives[k]) for k in classes]
        turning = [rates.angular[k] - e for k, e in zip(classes, extra, strict=True)]
        row.unknowns[block.name] = state.newton[block.name].x
        row.slopes[block.name] = np.array([*turning, *(rates.slide[j] for j in block.slides)], float)
        row.determinants[block.name] = float(np.linalg.det(matrix)) if square else 0.0
        if not np.isfinite(row.slopes[block.name]).all():
            return None
        row.singular_values[block.name] = np.asarray(np.linalg.svd(matrix, compute_uv=False), float)
        if square and row.regularity(block.name) < REGULAR_RATIO:
            return None  # the sign of its determinant is meaningless
    for g in model.multi_turn:
        name = f"angle {g}"
        x, slope = np.asarray(real_angle(model, state, g)), np.asarray(rates.group[g])
        if not np.isfinite(x) or not np.isfinite(slope) or abs(float(x - starts[name])) > LARGEST_TURN:
            return None
        row.unknowns[name], row.slopes[name] = x, slope
    return row


def _extrapolated(rows: Sequence[PathPoint], p: float, derivative: int = 0) -> dict[str, Real]:
    """Unknowns at ``p``, or their derivatives, by the Hermite polynomial through ``rows``: for two a cubic, for one the tangent."""
    places = [row.parameter for row in rows]
    weights = []
    for i, at in enumerate(places):  # with the Lagrange polynomial that is 1 at this node and 0 at the others
        lagrange, slope, bend = 1.0, 0.0, 0.0  # at p, its logarithmic derivative at p, and its derivative at its own node
        for k, x in enumerate(places):
            if k != i:
                lagrange *= (p - x) / (at - x)
                slope += 1.0 / (p - x)
                bend += 1.0 / (at - x)
        square, away = lagrange * lagrange, p - at
        own = 1.0 - 2.0 * away * bend
        if derivative:
            weights.append((2.0 * square * (own * slope - bend), square * (1.0 + 2.0 * away * slope)))
        else:
            weights.append((own * square, away * square))
    out = {}
    for name in rows[0].unknowns:
        terms = [x * row.unknowns[name] + s * row.slopes[name] for row, (x, s) in zip(rows, weights, strict=True)]
        out[name] = sum(terms[1:], terms[0])
    return out


def _singular_before(rows: Sequence[PathPoint], p: float) -> bool:
    """Whether linear extrapolation of its regularity predicts a singular group before ``p``.

    The step size is then reduced. Otherwise a step could pass unnoticed over a position at which a group is singular in two
    directions at once, where its determinant keeps its sign.
    """
    if len(rows) < 2:
        return False
    last, before = rows[-1], rows[-2]
    far = (p - last.parameter) / (last.parameter - before.parameter)
    for name in last.singular_values:
        now = last.regularity(name)
        if now < WATCHED_RATIO and now + far * (now - before.regularity(name)) < 0.0:
            return True
    return False


def _pass(branch: Branch, rows: list[PathPoint], direction: float, step: float) -> list[str]:
    """Pass the singular position next to which the path has stopped, along the tangent of the configuration curve.

    The branch is extrapolated from well-conditioned rows to a point on the other side. There Newton's method must find it close to
    the prediction and with nearly the same slope. A limit of the motion, beyond which there is no branch, fails this test. The
    ill-conditioned rows are removed. Returns the names of the groups that were singular: those whose determinants changed sign, or,
    where one was singular in two directions at once, the one nearest to singular; an empty list if the position was not passed.
    """
    end = rows[-1]
    flattest = min(end.singular_values, key=end.regularity, default=None)
    for part in (8.0, 32.0, 128.0):
        spacing = step / part
        kept = [row for row in rows if direction * (end.parameter - row.parameter) >= spacing]
        if len(kept) < 2:
            continue
        last, target = kept[-1], end.parameter + direction * spacing
        expected, slope = (_extrapolated(kept[-FOR_PASSING:], target, derivative) for derivative in (0, 1))
        new = _row_at(branch, target, expected)
        if new is None:
            continue
        names = list(new.unknowns)
        far = {n: np.abs(np.atleast_1d(new.unknowns[n] - expected[n])).max() for n in names}
        travel = max((np.abs(np.atleast_1d(expected[n] - last.unknowns[n])).max() for n in names), default=0.0)
        bend = {n: np.abs(np.atleast_1d(new.slopes[n] - slope[n])).max() for n in names}
        speeds = [np.abs(np.atleast_1d(last.slopes[n])).max() + np.abs(np.atleast_1d(slope[n])).max() for n in names]
        smooth = all(bend[n] <= SMOOTH_CHANGE * max(speeds) and far[n] <= SMOOTH_CHANGE * travel for n in names)
        if smooth and flattest is not None:
            rows[:] = [*kept, new]
            return [n for n, d in new.determinants.items() if last.determinants[n] * d < 0] or [flattest]
    return []


# -- limits -------------------------------------------------------------------------------------------------------------------
# At a limit of a continued group the configuration curve has a fold: along the curve the parameter has an extremum. Parametrised by
# pseudo-arclength the curve is regular there, and the extremum is the zero of a smooth function. The limit at which a group with a
# closed form can no longer be assembled is found by bisection.
def _limit(branch: Branch, row: PathPoint, span: float, direction: float) -> float:
    """The parameter at which a path over the range ``span`` ends, beyond its last ``row``; that of the row if none is found."""
    p = row.parameter
    reach = p + direction * LIMIT_DISTANCE * span
    with np.errstate(all="ignore"):
        limits = [_missing(branch, row, reach)]
        for block in branch.model.blocks:
            if block.kind == "general" and block.name in row.singular_values:
                limits.append(_fold(branch, block, row, LIMIT_DISTANCE * span))
    ahead = [q for q in limits if q is not None and 0.0 <= direction * (q - p) <= LIMIT_DISTANCE * span]
    return min(ahead, key=lambda q: direction * q, default=p)


def _placed_before(branch: Branch, row: PathPoint, p: float, block: Block | None) -> State:
    """Positions at ``p`` of the groups before ``block`` (None: before the first continued group)."""
    model, assembly = branch.model, branch.assembly
    state = initial_state(model, branch.drives(p)[0], assembly.constants, row.unknowns)
    for b, mode in zip(model.blocks, assembly.modes, strict=True):
        if b is block or (block is None and b.kind == "general"):
            break
        place_block(model, b, state, mode, row.unknowns.get(b.name))
    return state


def _missing(branch: Branch, row: PathPoint, far: float) -> float | None:
    """The last parameter between ``row`` and ``far`` at which the groups before the first continued one can be assembled; None if
    they can at ``far``, or cannot at ``row``."""

    def fits(at: float) -> bool:
        state = _placed_before(branch, row, at, None)
        values = [*(r for r in state.rot if r is not None), *state.slide.values()]
        return bool(np.isfinite(np.array([complex(v) for v in values])).all())

    p = row.parameter
    if fits(far) or not fits(p):
        return None
    for _ in range(MOST_HALVINGS):
        middle = 0.5 * (p + far)
        p, far = (middle, far) if fits(middle) else (p, middle)
    return p


def _fold(branch: Branch, block: Block, row: PathPoint, near: float) -> float | None:
    """The parameter at a fold of a continued group's curve next to a ``row`` of its path; None if no fold is found."""
    model, p0 = branch.model, row.parameter
    scale = np.concatenate([np.ones(len(block.angles)), np.full(len(block.slides), model.length_scale)])
    start = np.asarray(row.unknowns[block.name], float) / scale
    h = 0.1 * near

    def residual(x: Real, p: float) -> tuple[Real, Real]:
        r, jacobian = equations(model, block, _placed_before(branch, row, p, block))(x)
        return r, jacobian

    _, jacobian = residual(start, p0)
    if jacobian.shape[0] != jacobian.shape[1]:
        return None
    along = np.linalg.svd(jacobian)[2][-1]

    def on_curve(s: float, x: Real, p: float) -> tuple[Real, float, float] | None:
        """The point of the curve at distance ``s`` from the start along its tangent (unknowns, parameter), and the parameter's
        derivative by ``s`` there."""
        for _ in range(12):
            r, jacobian = residual(x, p)
            by_p = (residual(x, p + h)[0] - residual(x, p - h)[0]) / (2.0 * h)
            matrix = np.block([[jacobian, by_p[:, None]], [along[None], np.zeros((1, 1))]])
            both = np.column_stack([np.append(-r, s - along @ (x - start)), np.append(np.zeros(len(r)), 1.0)])
            if not np.isfinite(matrix).all() or not np.isfinite(both).all():
                return None
            step, tangent = np.linalg.lstsq(matrix, both, rcond=None)[0].T
            x, p = x + step[:-1], p + float(step[-1])
            if np.abs(step[:-1]).max() < LIMIT_TOLERANCE and abs(step[-1]) < LIMIT_TOLERANCE * max(near / LIMIT_DISTANCE, abs(p)):
                break
        return x, p, float(tangent[-1])

    first = on_curve(0.0, start, p0)
    if first is None:
        return None
    x, p, speed = first
    s, other = 0.0, SECOND_PLACE
    for _ in range(40):  # secant method: the parameter's derivative along the curve is zero at the fold
        point = on_curve(other, x, p)
        if point is None:
            return None
        x, p, now = point
        if abs(other - s) < 1e-9 or now == speed:
            break
        s, other, speed = other, other - now * (other - s) / (now - speed), now
        if abs(other) > FARTHEST_FOLD:
            return None
    return p
