"""Path generation: four-bars whose coupler point passes through points, with prescribed timing (crank angles) or without.

With the crank at theta from the frame line the point is at ``z0 + p e^(i theta) + q e^(i theta3)``. This is linear in three complex
numbers, the place z0, ``p = crank e^(i beta)`` and ``q = tracer e^(i beta)``; theta3 depends only on the ratios of the lengths and
the start angle. Designs of random ratios, and without timing those of an atlas with similar curves, are screened by linear least
squares in one array call (variable projection; Golub and Pereyra 1973). The best are refined in all variables at once, with exact
derivatives. The crank turns fully: it is the shortest link.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mechcore.arrays import Complex, Flags, Index, Real
from mechcore.design.atlas import nearest_linkages
from mechcore.design.four_bars import TURN, FourBar, coupler_direction, follow_in_order, grashof_cranks
from mechcore.errors import Fault, MechanismError
from mechcore.numerics.newton import fit_all
from mechcore.records import dataclass
from mechcore.texts import as_length

ALIKE_CURVES = 400  # most similar curves that are taken from the atlas, for each side and sense of rotation
LARGEST_RATIO = 20.0  # largest ratio of a link to the crank in the designs that are screened
DESIGNS_AT_ONCE = 4000  # designs that are screened in one array call
MOST_ITERATIONS = 1500  # bounds and cognates make long valleys
GRASHOF_WEIGHT = 3.0  # penalty of the length by which Grashof's rule is violated
NARROWEST_RANGE, WIDEST_RANGE = 0.3, 5.5  # trial crank ranges [rad] for an open path without timing
DENSE_POINTS = 20  # with more points without timing, designs are found from so many and the best refined at all points
DENSE_REFINED, DENSE_KEPT, DENSE_ITERATIONS = 40, 8, 400  # designs refined at few points, at all points; iterations of both
RELATED_DESIGNS = 0.02  # relative difference of lengths below which only one of two designs is refined at all points
SAME_DESIGN = 1e-5  # relative difference of lengths below which two designs count as one

X0, Y0, BETA, FRAME, CRANK, COUPLER, ROCKER, U, V, START = range(10)


@dataclass(frozen=True, eq=False)
class PathTask:
    """Points (K,) [m] in order. ``steps`` (K,): crank angles since the first point [rad]; None leaves them free.

    ``start``: the crank's angle from the frame line at the first point, None leaves it free. ``pivot``: the crank's pivot,
    ``frame_angle``: the direction from it to the rocker's, None leaves them free. ``lengths``: bounds of the four links [m];
    ``farthest``: largest coordinate of the crank's pivot and of the point in the coupler's frame, to either side [m].
    """

    points: Complex
    steps: Real | None = None
    start: float | None = None
    pivot: complex | None = None
    frame_angle: float | None = None
    lengths: tuple[float, float] = (0.0, np.inf)
    farthest: float = np.inf
    senses: tuple[int, ...] = (1, -1)

    def __post_init__(self) -> None:
        if len(self.points) < 3:
            raise MechanismError(Fault("points", f"{len(self.points)} points.", "Give three or more."))
        if self.size <= 1e-12 * float(np.abs(self.points).max()):
            raise MechanismError(Fault("points", "all points are the same.", "Give points that differ."))
        if self.steps is not None and len(self.steps) != len(self.points):
            raise MechanismError(
                Fault("steps", f"{len(self.steps)} crank angles for {len(self.points)} points.", "Give one for each point.")
            )
        if not 0.0 <= self.lengths[0] < self.lengths[1]:
            raise MechanismError(
                Fault("lengths", f"bounds of {' and '.join(map(as_length, self.lengths))}.", "Give the smaller one first.")
            )

    @property
    def size(self) -> float:
        """Largest distance of the points from their mean [m]."""
        return float(np.abs(self.points - self.points.mean()).max())

    @property
    def closed(self) -> bool:
        """Whether the last point coincides with the first."""
        return bool(abs(self.points[-1] - self.points[0]) < 1e-9 * self.size)


@dataclass(frozen=True, eq=False)
class PathDesign:
    """A four-bar, its crank angles (K,) at the points [rad, from x], the sum of squared distances [m^2] and the largest one [m]."""

    four_bar: FourBar
    theta: Real
    error: float
    largest: float


def path_designs(task: PathTask, seed: int = 0, screened: int = 20000, refined: int = 48) -> list[PathDesign]:
    """Distinct four-bars whose paths fit the points best, the best first: at most ``refined``, without order defects.

    For each branch and sense of rotation ``screened`` designs are tried and the best refined. The same seed gives the same
    designs. Raises MechanismError where no start satisfies the bounds.
    """
    if task.steps is None and len(task.points) > DENSE_POINTS:
        return _dense(task, seed, screened)
    return _sparse(task, seed, screened, refined, MOST_ITERATIONS)


def _dense(task: PathTask, seed: int, screened: int) -> list[PathDesign]:
    """Designs for many points without timing: found from fewer points, then refined at all of them."""
    count = len(task.points)
    chosen: Index = np.unique(np.linspace(0, count - 1, DENSE_POINTS).round().astype(int))
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(task.points)))])
    coarse = replace(task, points=task.points[chosen])
    designs: list[PathDesign] = []
    for one in _sparse(coarse, seed, screened, DENSE_REFINED, DENSE_ITERATIONS):
        if len(designs) < DENSE_KEPT and all(relative_difference(one, other) > RELATED_DESIGNS for other in designs):
            designs.append(one)
    if not designs:
        return []
    rows = []
    for one in designs:
        theta = np.array(one.theta)
        if task.closed:  # the last point is the first, one turn later
            theta[-1] = theta[0] + np.sign(theta[-2] - theta[0]) * TURN
        bar = one.four_bar
        shape = [bar.frame, bar.crank, bar.coupler, bar.rocker, bar.tracer.real, bar.tracer.imag]
        angles = np.interp(along, along[chosen], theta) - bar.frame_angle
        rows.append([bar.crank_pivot.real, bar.crank_pivot.imag, bar.frame_angle, *shape, *angles])
    problem = PathProblem(task, np.array([one.four_bar.side for one in designs]), np.ones(len(designs), int))
    x = np.array(rows)
    return problem.designs(fit_all(problem.evaluate, x, *problem.bounds(x), DENSE_ITERATIONS).x)


def _sparse(task: PathTask, seed: int, screened: int, refined: int, iterations: int) -> list[PathDesign]:
    rng = np.random.default_rng(seed)
    modes = [(side, sense) for side in (1, -1) for sense in task.senses]
    share = max(refined // len(modes), 1)
    starts, sides, senses, timings = [], [], [], []
    for side, sense in modes:
        x, steps = _screen(task, rng, side, sense, screened, share)
        starts.append(x)
        timings.append(steps)
        sides += [side] * len(x)
        senses += [sense] * len(x)
    x = np.concatenate(starts)
    if not len(x):
        raise MechanismError(Fault("lengths", "no four-bar within the bounds was found.", "Widen the bounds of the lengths."))
    problem = PathProblem(task, np.array(sides), np.array(senses))
    if task.steps is None:
        x = np.concatenate([x[:, :START], x[:, START:] + np.array(senses)[:, None] * np.concatenate(timings)], axis=1)
    fits = fit_all(problem.evaluate, x, *problem.bounds(x), iterations)
    return problem.designs(fits.x)


def relative_difference(first: PathDesign, second: PathDesign) -> float:
    """Largest difference of the lengths of two designs over the largest length of the first."""
    a, b = (
        np.array([x.frame, x.crank, x.coupler, x.rocker, x.tracer.real, x.tracer.imag]) for x in (first.four_bar, second.four_bar)
    )
    return float(np.abs(a - b).max() / np.abs(a).max())


# -- screening --------------------------------------------------------------------------------------------------------
def _screen(task: PathTask, rng: np.random.Generator, side: int, sense: int, count: int, kept: int) -> tuple[Real, Real]:
    """The best designs of a branch and a sense, fitted by linear least squares: variables (kept, 10), steps (kept, K). With no
    timing and no start angle half of them are from the atlas, the others random."""
    best: list[tuple[Real, Real, Real]] = []
    tried: list[tuple[Real, Real, Real]] = []
    most = min(LARGEST_RATIO, task.lengths[1] / task.lengths[0] if task.lengths[0] else np.inf)
    if task.steps is None and task.start is None:
        candidates = nearest_linkages(task.points, task.closed, side, sense, ALIKE_CURVES)
        best.append(_best([(*_linear(task, *candidates, side, sense), candidates.steps)], kept // 2))
        kept -= kept // 2
    for first in range(0, count, DESIGNS_AT_ONCE):
        size = min(DESIGNS_AT_ONCE, count - first)
        ratios = grashof_cranks(rng, size, most)
        start = rng.uniform(0.0, TURN, size) if task.start is None else np.full(size, task.start)
        steps = _steps(task, rng, size)
        tried.append(_best([(*_linear(task, ratios, start, steps, side, sense), steps)], kept))
    best.append(_best(tried, kept))
    return np.concatenate([x for x, _, _ in best]), np.concatenate([steps for _, _, steps in best])


def _best(tried: Sequence[tuple[Real, Real, Real]], kept: int) -> tuple[Real, Real, Real]:
    """Variables, sums of squared distances and steps of the ``kept`` best designs."""
    x, cost, steps = (np.concatenate(part) for part in zip(*tried, strict=True))
    best = np.argsort(cost, kind="stable")[:kept]
    best = best[np.isfinite(cost[best])]
    return x[best], cost[best], steps[best]


def _steps(task: PathTask, rng: np.random.Generator, count: int) -> Real:
    """Crank angles since the first point (D, K): as prescribed, or in proportion to the chords over a turn or a random range."""
    if task.steps is not None:
        return np.broadcast_to(task.steps, (count, len(task.points)))
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(task.points)))])
    ranges = np.full(count, TURN) if task.closed else rng.uniform(NARROWEST_RANGE, WIDEST_RANGE, count)
    return np.asarray(ranges[:, None] * along / along[-1])


def _linear(task: PathTask, ratios: Real, start: Real, steps: Real, side: int, sense: int) -> tuple[Real, Real]:
    """Variables (D, 10) that fit best for given ratios, and sums of squared distances (D,), infinite where bounds are violated."""
    crank = np.exp(1j * (start[:, None] + sense * steps))
    coupler, _ = coupler_direction(ratios[:, :1], 1.0, ratios[:, 1:2], ratios[:, 2:], crank, side)
    turn = np.exp(1j * task.frame_angle) if task.frame_angle is not None else 1.0
    place = [] if task.pivot is not None else [np.ones_like(crank), 1j * np.ones_like(crank)]
    scale = [turn * crank] if task.frame_angle is not None else [crank, 1j * crank]
    tracer = [turn * coupler, 1j * turn * coupler]
    target = np.broadcast_to(task.points - (task.pivot or 0.0), crank.shape)

    def solved(columns: list[Complex], right: Complex) -> Real:
        stacked = np.stack(columns, axis=-1)
        rows = np.concatenate([stacked.real, stacked.imag], axis=1)
        both = np.concatenate([right.real, right.imag], axis=1)
        across = np.swapaxes(rows, 1, 2)
        normal = across @ rows
        normal += 1e-13 * np.einsum("dii->d", normal)[:, None, None] * np.eye(len(columns))
        return np.asarray(np.linalg.solve(normal, across @ both[..., None])[..., 0])

    full = solved(place + scale + tracer, target)
    own = len(place)
    p = full[:, own] * turn if task.frame_angle is not None else full[:, own] + 1j * full[:, own + 1]
    length = np.abs(p) if task.frame_angle is None else full[:, own]
    low, high = task.lengths[0], task.lengths[1] / np.maximum(ratios.max(1), 1.0)
    limited = np.clip(length, max(low, 1e-6 * task.size), high)
    cut = (limited != length) & (low <= high)
    direction = turn if task.frame_angle is not None else p / np.maximum(np.abs(p), 1e-300)
    p = limited * direction
    rest = solved(place + tracer, target - p[:, None] * crank)
    full = np.where(
        cut[:, None], np.concatenate([rest[:, :own], rest[:, own:]], axis=1), np.delete(full, slice(own, own + len(scale)), axis=1)
    )
    z0 = full[:, 0] + 1j * full[:, 1] if place else np.full(len(p), task.pivot, complex)
    q = (full[:, own] + 1j * full[:, own + 1]) * turn
    deviation = z0[:, None] + p[:, None] * crank + q[:, None] * coupler - task.points
    cost = np.where(low <= high, np.einsum("dk,dk->d", deviation, np.conj(deviation)).real, np.inf)
    u = q * limited / p
    columns = [z0.real, z0.imag, np.angle(p), ratios[:, 0] * limited, limited, ratios[:, 1] * limited, ratios[:, 2] * limited]
    return np.stack([*columns, u.real, u.imag, start], axis=1), np.where(np.isfinite(cost), cost, np.inf)


# -- refinement -------------------------------------------------------------------------------------------------------
class PathProblem:
    """The deviations from the points and their derivatives by all variables, for many designs."""

    def __init__(self, task: PathTask, sides: Index, senses: Index):
        self.task, self.sides, self.senses = task, sides, senses

    def bounds(self, x: Real) -> tuple[Real, Real]:
        """Lower and upper bounds of the variables; equal for given ones."""
        lower, upper = np.full(x.shape[1], -np.inf), np.full(x.shape[1], np.inf)
        least = max(self.task.lengths[0], 1e-6 * self.task.size)
        lower[FRAME : ROCKER + 1], upper[FRAME : ROCKER + 1] = least, self.task.lengths[1]
        for place in (X0, Y0, U, V):
            lower[place], upper[place] = -self.task.farthest, self.task.farthest
        given = [(BETA, self.task.frame_angle), (START, self.task.start)]
        if self.task.pivot is not None:
            given += [(X0, self.task.pivot.real), (Y0, self.task.pivot.imag)]
        for place, value in given:
            if value is not None:
                lower[place] = upper[place] = value
        return lower, upper

    def theta(self, x: Real, numbers: Index) -> Real:
        """Crank angles from the frame line (D, K)."""
        if self.task.steps is None:
            return x[:, START:]
        return np.asarray(x[:, START, None] + self.senses[numbers, None] * self.task.steps)

    def evaluate(self, x: Real, numbers: Index) -> tuple[Real, Real]:
        """Residuals (D, 2K + 3), deviations and violations of Grashof's rule, and derivatives (D, 2K + 3, N).

        The change of the coupler's angle follows from the closed loop in the direction of the rocker, independent of its rotation:
        ``d(theta3) = (d(rocker) - Re(conj(e4) (d(a) + e3 d(coupler) - d(frame))))/(coupler Re(i e3 conj(e4)))``.
        """
        frame, crank, coupler, rocker = (x[:, k, None] for k in (FRAME, CRANK, COUPLER, ROCKER))
        turned = np.exp(1j * self.theta(x, numbers))
        with np.errstate(all="ignore"):
            e3, e4 = coupler_direction(frame, crank, coupler, rocker, turned, self.sides[numbers, None])
            below = coupler * np.real(1j * e3 * np.conj(e4))
            back = np.conj(e4) / below
        u = (x[:, U] + 1j * x[:, V])[:, None]
        rho = np.exp(1j * x[:, BETA])[:, None]
        arm = crank * turned + u * e3
        deviation = (x[:, X0] + 1j * x[:, Y0])[:, None] + rho * arm - self.task.points
        swing = rho * u * 1j * e3  # derivative by the coupler's angle
        by_theta = rho * 1j * crank * turned - swing * np.real(back * 1j * crank * turned)
        columns = [
            np.ones_like(deviation),
            np.full_like(deviation, 1j),
            rho * 1j * arm,
            swing * np.real(back),
            rho * turned - swing * np.real(back * turned),
            -swing * np.real(back * e3),
            swing * np.real(1.0 / below),
            rho * e3,
            rho * 1j * e3,
        ]
        count, size = deviation.shape
        slopes = np.zeros((count, 2 * size + 3, x.shape[1]))
        for k, column in enumerate(columns):
            slopes[:, :size, k], slopes[:, size:-3, k] = column.real, column.imag
        if self.task.steps is None:
            each = np.arange(size)
            slopes[:, each, START + each], slopes[:, size + each, START + each] = by_theta.real, by_theta.imag
        else:
            slopes[:, :size, START], slopes[:, size:-3, START] = by_theta.real, by_theta.imag
        broken = x[:, FRAME : ROCKER + 1] @ _GRASHOF.T
        slopes[:, -3:, FRAME : ROCKER + 1] = GRASHOF_WEIGHT * _GRASHOF * (broken > 0.0)[:, :, None]
        slopes[:, -3:, START:] = 0.0
        return np.concatenate([deviation.real, deviation.imag, GRASHOF_WEIGHT * np.maximum(broken, 0.0)], axis=1), slopes

    def designs(self, x: Real) -> list[PathDesign]:
        """The distinct linkages found, the best first, without those whose crank does not turn fully or has an order defect."""
        numbers = np.arange(len(x))
        residual, _ = self.evaluate(x, numbers)
        size = len(self.task.points)
        squares = residual[:, :size] ** 2 + residual[:, size:-3] ** 2
        theta = self.theta(x, numbers)
        every: Flags = np.ones(len(x), bool)
        usable = np.isfinite(squares).all(1) & (x[:, FRAME : ROCKER + 1] @ _GRASHOF.T <= 1e-9 * self.task.size).all(1)
        usable &= self._ordered(theta, every)
        designs: list[PathDesign] = []
        taken: list[Real] = []
        for k in sorted(np.flatnonzero(usable), key=lambda k: float(squares[k].sum())):
            shape = np.array([*x[k, [FRAME, CRANK, COUPLER, ROCKER, U, V]], *x[k, :2]]) / self.task.size
            if any(np.abs(shape - other).max() < SAME_DESIGN * np.abs(shape).max() for other in taken):
                continue
            taken.append(shape)
            o2 = complex(x[k, X0], x[k, Y0])
            o4 = o2 + x[k, FRAME] * np.exp(1j * x[k, BETA])
            bar = FourBar(
                o2,
                complex(o4),
                float(x[k, CRANK]),
                float(x[k, COUPLER]),
                float(x[k, ROCKER]),
                int(self.sides[k]),
                complex(x[k, U], x[k, V]),
            )
            designs.append(PathDesign(bar, x[k, BETA] + theta[k], float(squares[k].sum()), float(np.sqrt(squares[k].max()))))
        return designs

    def _ordered(self, theta: Real, every: Flags) -> Flags:
        """Designs whose crank passes the points in their order within one turn."""
        if self.task.steps is not None:
            return every
        own = theta[:, :-1] if self.task.closed else theta
        return follow_in_order(own, every)


_GRASHOF = np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, 1.0, -1.0, 1.0], [1.0, 1.0, -1.0, -1.0]])
"""Rows on frame, crank, coupler and rocker that are negative where the crank is the shortest link and turns fully."""
