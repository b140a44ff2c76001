"""Optimisation: the design of a scene that is best by its goal.

The search samples the ranges, runs differential evolution, and refines the best design by sequential quadratic programming with
exact derivatives. With several objectives it finds the Pareto front.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Real
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechviz.figures import chart, over_decades
from mechviz.scene.scene import Scene
from mechviz.studies.designs.evaluate import evaluate
from mechviz.studies.designs.problem import LIMIT_ROUNDING, SCREENED_GENERATIONS, Limit, Problem, ScoredDesigns, population_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AT_BOUND = 1e-6  # relative to its range: a variable that is closer to a bound is at it
COMPROMISE_SLACK = 1e-6  # relative slack on the bound of one objective, so that there is room to improve the other
VALUE_DIGITS = 9  # of values in the scene that is written

MOST_TRIES = 2  # evaluations per step of the refinement, on average; beyond that it stagnates


class _Enough(Exception):
    """Ends a search along derivatives."""


SearchProgress = Callable[[str, int, float, float], None]
"""Called with the stage of the search, the index of the objective, its best value so far, and the violation of that design."""


@dataclass
class Search:
    """The search for the best designs of a problem, with all designs that it has evaluated.

    ``progress`` is called after each stage and generation; ``advance`` gets the number of designs of a portion that are evaluated,
    and their total; ``archive``: all evaluated designs, in portions; ``evaluations``: their number; ``refused``: why no derivatives
    were used; ``interrupted``: whether the user ended the search.
    """

    problem: Problem
    seed: int = 0
    population: int = 0
    generations: int = 60
    executor: Executor | None = None
    progress: SearchProgress = lambda *_: None
    advance: Callable[[int, int], None] = lambda *_: None
    archive: list[ScoredDesigns] = field(default_factory=list)
    evaluations: int = 0
    refused: str = ""
    interrupted: bool = False

    def score(self, designs: Real) -> ScoredDesigns:
        """Objectives and violations of designs (D, n), which are added to the archive."""
        judgement = self.problem.score(designs, self.executor, self.advance)
        self.archive.append(judgement)
        self.evaluations += len(designs)
        return judgement

    @property
    def all(self) -> ScoredDesigns:
        """All designs that have been evaluated."""
        parts = self.archive
        return ScoredDesigns(
            *(np.concatenate([getattr(p, name) for p in parts]) for name in ("designs", "objectives", "violations", "missing"))
        )

    def best(self, objective: int = 0) -> tuple[Real, float, float]:
        """The best design (n,) so far, its objective and its violation."""
        known = self.all
        k = known.best(objective)
        return known.designs[k], float(known.objectives[k, objective]), float(known.violations[k])

    def report_progress(self, stage: str, objective: int = 0) -> None:
        """Call ``progress`` with the best design so far."""
        _, value, violation = self.best(objective)
        self.progress(stage, objective, value, violation)

    # -- global -------------------------------------------------------------------------------------------------------
    def search_globally(self, objective: int = 0) -> None:
        """Global search: Sobol points over the ranges and the scene's own design, then differential evolution from the best of
        these."""
        from scipy.optimize import differential_evolution
        from scipy.stats import qmc

        bounds = self.problem.bounds
        n = len(bounds)
        count = population_of(self.population, n)
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, objective]))
        points = qmc.Sobol(n, rng=rng).random_base2(int(np.ceil(np.log2(SCREENED_GENERATIONS * count))))
        designs = bounds[:, 0] + (bounds[:, 1] - bounds[:, 0]) * points
        start = np.clip(self.problem.start, bounds[:, 0], bounds[:, 1])
        screened = self.score(np.vstack([start, designs]))
        self.report_progress("samples", objective)
        worst = float(np.nanmax(np.where(screened.feasible, np.abs(screened.objectives[:, objective]), 0.0), initial=0.0)) or 1.0

        def merit(x: Real) -> Real:
            own = self.score(np.atleast_2d(x.T))
            penalised = 10.0 * worst * (1.0 + own.infeasibility)  # every infeasible design is worse than any feasible one
            return np.asarray(np.where(own.feasible, own.objectives[:, objective], penalised))

        def report(intermediate_result: object) -> None:
            self.report_progress("differential evolution", objective)

        first = screened.designs[screened.order(objective)[:count]]
        differential_evolution(
            merit, list(map(tuple, bounds)), init=first, maxiter=self.generations, tol=1e-6,
            vectorized=True, updating="deferred", polish=False, rng=rng, callback=report, mutation=(0.4, 0.9),
        )  # fmt: skip

    # -- along derivatives --------------------------------------------------------------------------------------------
    def refine(self, objective: int = 0, most: dict[int, float] | None = None, start: Real | None = None, steps: int = 40) -> None:
        """Local search: sequential quadratic programming with exact derivatives, from ``start`` or the best design so far.

        ``most``: upper bounds of other objectives, by index. Without derivatives nothing happens, and `refused` states why."""
        from scipy.optimize import minimize

        problem = self.problem
        bounds = problem.bounds
        low, span = bounds[:, 0], bounds[:, 1] - bounds[:, 0]
        begin = self.best(objective)[0] if start is None else start
        size = max(abs(float(self.problem.score(begin[None]).objectives[0, objective])), 1e-12)
        known: dict[bytes, tuple[Real, Real, Real, Real] | None] = {}

        def at(u: Real) -> tuple[Real, Real, Real, Real] | None:
            key = u.tobytes()
            if key not in known:
                if len(known) > MOST_TRIES * steps:
                    raise _Enough
                try:
                    known[key] = problem.differentiated(low + span * np.clip(u, 0.0, 1.0))
                except MechanismError:
                    known[key] = None
                self.score((low + span * np.clip(u, 0.0, 1.0))[None])
                self.report_progress("along derivatives", objective)
            return known[key]

        rows = [(limit.measure, k, side) for k, limit in enumerate(problem.limits) for side in _sides(limit)]
        ends = most or {}

        squared = problem.terms[objective].distance

        def value(u: Real) -> float:
            state = at(u)
            if state is None:
                return 1e3
            own = float(state[0][objective]) / size
            return own * own if squared else own

        def slope(u: Real) -> Real:
            state = at(u)
            if state is None:
                return np.zeros(len(u))
            own = np.nan_to_num(state[2][objective] * span) / size
            return np.asarray(2.0 * state[0][objective] / size * own if squared else own)

        def slack(u: Real) -> Real:
            state = at(u)
            if state is None:
                return np.full(len(rows) + len(ends), -1.0)
            own = [side * (state[1][k] - end) / problem.limits[k].scale for _, k, (side, end) in rows]
            return np.array(own + [(end - state[0][m]) / max(abs(end), 1e-12) for m, end in ends.items()])

        def slack_slope(u: Real) -> Real:
            state = at(u)
            if state is None:
                return np.zeros((len(rows) + len(ends), len(u)))
            own = [side * state[3][k] * span / problem.limits[k].scale for _, k, (side, _) in rows]
            return np.asarray(np.nan_to_num(own + [-state[2][m] * span / max(abs(end), 1e-12) for m, end in ends.items()]))

        first = (begin - low) / span
        try:
            known[first.tobytes()] = problem.differentiated(begin)
        except MechanismError as error:
            self.refused = str(error.faults[0].message)
            return
        constraints = [{"type": "ineq", "fun": slack, "jac": slack_slope}] if rows or ends else []
        with suppress(_Enough):
            options = {"maxiter": steps, "ftol": 1e-10}
            box = [(0.0, 1.0)] * len(first)
            minimize(value, first, jac=slope, bounds=box, constraints=constraints, method="SLSQP", options=options)


def _sides(limit: Limit) -> Iterator[tuple[float, float]]:
    if np.isfinite(limit.least):
        yield 1.0, limit.least
    if np.isfinite(limit.most):
        yield -1.0, limit.most


@dataclass(frozen=True, eq=False)
class Optimum:
    """Result of a search: the best ``design`` (n,) and the Pareto ``front`` (K, n), sorted by the first objective; with a single
    objective the front is the best design. Values are rounded as they are written, see `rounded`."""

    search: Search
    design: Real
    front: Real

    @property
    def scene(self) -> Scene:
        """The scene of the best design."""
        return self.search.problem.scene(self.design)

    def lines(self) -> Iterator[tuple[str, ...]]:
        """Rows of a table: objectives, limits and variables, before and after."""
        problem = self.search.problem
        designs = np.stack([problem.start, self.design])
        both = problem.score(designs)
        values = problem.limited(designs, evaluate(problem.study, designs).values)
        yield "", "before", "after", ""
        for k, term in enumerate(problem.terms):
            old, new = both.objectives[:, k]
            change = f"{100.0 * term.sign * (new - old) / abs(old):+.3g} %" if np.isfinite(new - old) and old else ""
            yield term.text, *(term.shown(x) if np.isfinite(x) else "none" for x in (old, new)), change
        for k, limit in enumerate(problem.limits):
            violation = float(limit.violation(values[1:, k])[0])
            state = "missed" if not violation <= LIMIT_ROUNDING else "reached" if _reached(limit, values[1, k]) else "kept"
            row = [f"{x:.6g} {limit.unit}".strip() if np.isfinite(x) else "none" for x in values[:, k]]
            yield limit.words, row[0], row[1], state
        for v, x in zip(problem.variables, self.design, strict=True):
            close = AT_BOUND * (v.high - v.low)
            end = "at its least value" if x - v.low < close else "at its greatest value" if v.high - x < close else ""
            yield v.name, f"{v.value:.6g} {v.unit}".strip(), f"{x:.6g} {v.unit}".strip(), end


def rounded(problem: Problem, designs: Real) -> Real:
    """Designs (K, n) as they are written: rounded to nine digits, or unrounded where rounding violates a limit."""
    short = np.array([[float(f"{x:.{VALUE_DIGITS}g}") for x in design] for design in designs])
    return np.where(problem.score(short).feasible[:, None], short, designs)


def _reached(limit: Limit, value: float) -> bool:
    return bool(min(abs(value - limit.least), abs(limit.most - value)) <= 1e-4 * limit.scale)


def optimise(search: Search, *, points: int = 9) -> Optimum:
    """The best design of a problem; with several objectives also a front of about ``points`` designs. Ctrl-C ends the search with
    the best design so far (`Search.interrupted`). Raises `MechanismError` where no design is found that keeps the limits."""
    objectives = len(search.problem.terms)
    try:
        for k in range(objectives):
            search.search_globally(k)
            search.refine(k, steps=40 if search.best(k)[2] <= LIMIT_ROUNDING else 10)
        if objectives > 1:
            _spread(search, points)
    except KeyboardInterrupt:
        search.interrupted = True
        if not search.archive:
            raise
    design, _, violation = search.best()
    if violation > LIMIT_ROUNDING and not search.interrupted:
        why = f"no design was found that keeps all limits: the best misses them by {100.0 * violation:.3g} % in sum."
        if not np.isfinite(violation):
            why = "no design was found that can be assembled in all frames of the run."
        raise MechanismError(Fault("goal", why, "Widen limits or ranges, or look longer: --generations, --population."))
    if objectives == 1:
        front = rounded(search.problem, design[None])
        return Optimum(search, front[0], front)
    front = rounded(search.problem, _front(search, points))
    middle = len(front) // 2 if objectives == 2 else int(_shortfalls(search.problem.score(front).objectives).max(axis=1).argmin())
    return Optimum(search, front[middle], front)


def _levels(known: ScoredDesigns, points: int) -> list[Real]:
    """Upper bounds (m - 1,) of the objectives after the first, about ``points`` combinations: each bound runs from the value at the
    least first objective down to the least value of its own objective."""
    count = known.objectives.shape[1]
    best = known.objectives[[known.best(k) for k in range(count)]]
    each = points if count == 2 else max(3, round(points ** (1.0 / (count - 1))))
    axes = [np.linspace(best[0, k], best[k, k], each) for k in range(1, count)]
    return [np.array(level) for level in product(*axes)]


def _below(known: ScoredDesigns, level: Real) -> int | None:
    """Index of the design with the least first objective among feasible ones whose other objectives are at most a level (m - 1,);
    None where there is none. A slack admits designs that were refined to this level, in spite of rounding."""
    kept = np.flatnonzero(
        known.feasible & np.all(known.objectives[:, 1:] <= level + 2.0 * COMPROMISE_SLACK * np.abs(level), axis=1)
    )
    return int(kept[np.lexsort(known.objectives[kept].T[::-1])[0]]) if len(kept) else None


def _spread(search: Search, points: int) -> None:
    """Find compromises: minimise the first objective under upper bounds of the others (epsilon-constraint method)."""
    first = search.best(0)
    for k in range(1, len(search.problem.terms)):
        search.refine(k, {0: first[1] + COMPROMISE_SLACK * abs(first[1])}, first[0], steps=8)
    for level in _levels(search.all, points)[1:]:
        begin = _below(search.all, level)
        if begin is not None:
            most = {k: float(x) + COMPROMISE_SLACK * abs(float(x)) for k, x in enumerate(level, 1)}
            search.refine(0, most, search.all.designs[begin], steps=8)


def _front(search: Search, points: int) -> Real:
    """The Pareto front (K, n), sorted by the first objective. With two objectives it has one design for each of ``points`` levels
    of the second; with more, up to ``points`` of all nondominated designs, chosen to be far apart."""
    known = search.all
    if len(search.problem.terms) == 2:
        chosen = [k for level in _levels(known, points) if (k := _below(known, level)) is not None]
        undominated = [k for k in dict.fromkeys(chosen) if not _is_dominated(known.objectives[chosen], known.objectives[k])]
        return np.asarray(known.designs[undominated])
    some = np.flatnonzero(known.feasible)
    some = some[np.lexsort(known.objectives[some].T[::-1])]  # in this order no design is dominated by a later one
    front: list[int] = []
    for one in some.tolist():
        if not _is_dominated(known.objectives[front], known.objectives[one]):
            front.append(one)
    scaled = _shortfalls(known.objectives[front])
    kept: list[int] = list(dict.fromkeys(scaled.argmin(axis=0).tolist()))
    while len(kept) < min(points, len(front)):
        apart = np.linalg.norm(scaled[:, None] - scaled[kept], axis=-1).min(axis=1)
        kept.append(int(apart.argmax()))
    return np.asarray(known.designs[[front[k] for k in sorted(kept)]])


def _is_dominated(others: Real, own: Real) -> bool:
    """Whether objectives ``own`` (m,) are dominated by one of ``others`` (K, m): nowhere worse, and better in at least one."""
    return bool(np.any(np.all(others <= own, axis=1) & np.any(others < own, axis=1)))


def _shortfalls(objectives: Real) -> Real:
    """Distances (K, m) of objectives from the least value of each, relative to their ranges."""
    low, high = objectives.min(axis=0), objectives.max(axis=0)
    return np.asarray((objectives - low) / np.where(high > low, high - low, 1.0))


def front_chart(optimum: Optimum, title: str) -> Figure:
    """Figure of the front among all feasible designs: the second objective over the first, a third one as colour."""
    problem, known = optimum.search.problem, optimum.search.all
    first, second = problem.terms[:2]
    some = known.objectives[known.feasible]
    front = problem.score(optimum.front).objectives
    with chart(6.5, 4.5) as figure:
        axes = figure.subplots()
        axes.plot(first.sign * some[:, 0], second.sign * some[:, 1], ".", markersize=2.0, color="#c3c9d0", label="looked at")
        if len(problem.terms) == 2:
            axes.plot(first.sign * front[:, 0], second.sign * front[:, 1], "o-", color="#1b6ca8", label="front")
        else:
            third = problem.terms[2]
            values = third.sign * front[:, 2]
            marks = axes.scatter(
                first.sign * front[:, 0], second.sign * front[:, 1], c=values, cmap="viridis", zorder=3, label="front"
            )
            figure.colorbar(marks, ax=axes, label=f"{third.text} [{third.unit}]")
        axes.set_xscale("log" if over_decades(first.sign * some[:, 0]) else "linear")
        axes.set_yscale("log" if over_decades(second.sign * some[:, 1]) else "linear")
        axes.set_xlabel(f"{first.text} [{first.unit}]")
        axes.set_ylabel(f"{second.text} [{second.unit}]")
        axes.legend()
        figure.suptitle(f"{title}: compromises")
    return figure
