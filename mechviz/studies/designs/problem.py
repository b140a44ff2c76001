"""The optimisation problem of a scene's goal: variables within bounds, objectives to be minimised, and constraints (limits), among
them Grashof's criterion of four-bar loops, evaluated by the formulas of the scene for many designs at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor as Pool

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechcore.compiled.motion import Executor
from mechcore.errors import Fault, MechanismError
from mechcore.motion.metrics import grashof
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism, Revolute
from mechviz.runs import Run, run_scene
from mechviz.scene.annotations import Place
from mechviz.scene.faults import under_other_names
from mechviz.scene.kinds.settings import GoalDocument, LimitDocument
from mechviz.scene.reading.formulas import formula_values, parameter_arrays
from mechviz.scene.scene import Scene
from mechviz.scene.units import QuantityError, split, unit_of
from mechviz.studies.designs.evaluate import Study, evaluate, reduced, study_of
from mechviz.studies.designs.goals import check_goal, goal_of, goal_variables, path_measures
from mechviz.studies.designs.measures import Measure, StartTurn, parse_measure
from mechviz.studies.designs.sampling import Variation
from mechviz.studies.designs.sensitivity import sensitivities
from mechviz.studies.designs.variables import Variable

SHORTEST = {"crank-rocker": 0, "double-rocker": 1, "double-crank": 3}
"""Index of the shortest link among crank, coupler, rocker and frame, by the type of the linkage; type "any" does not prescribe
one."""
DIFFERENCE_STEP = 1e-3  # step of differences relative to a variable's range; link lengths are smooth enough for it
EIGHTH_ORDER = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))  # steps and weights of central differences of eighth order
_OF_MASS = ("mass", "centre", "inertia")


@dataclass(frozen=True)
class FourBarLoop:
    """A four-bar loop and its required type. ``sides``: two points each of crank, coupler, rocker and frame."""

    name: str
    type: str
    sides: tuple[tuple[str, str, str], ...]  # link, point, point

    def margin(self, lengths: Real) -> Real:
        """Margin (...) [m] by which lengths (..., 4) [m] satisfy Grashof's criterion; negative where they violate it. Shortest plus
        longest link must be less than the sum of the other two, and the link that the type prescribes must be the shortest."""
        free = lengths.sum(axis=-1) - 2.0 * (lengths.min(axis=-1) + lengths.max(axis=-1))
        if self.type not in SHORTEST:
            return np.asarray(free)
        k = SHORTEST[self.type]
        return np.asarray(np.minimum(free, np.delete(lengths, k, axis=-1).min(axis=-1) - lengths[..., k]))

    def margins(self, scene: Scene, variables: Sequence[Variable], designs: Real) -> Real:
        """Margins (D,) of designs (D, n), in the scene's display unit of lengths; the designs are in the units of the variables."""
        _, factor = scene.units.display_unit("m")
        values = {v.name: v.factor * designs[:, k] for k, v in enumerate(variables)}
        document = scene.document
        if all(_known(place) for place in document.formulas if place[0] == "links"):
            wanted = [place for place in document.formulas if place[0] == "links" and place[2] == "points"]
            varied = formula_values(document, parameter_arrays(document, values), wanted)
            return factor * self.margin(self.lengths(scene.mechanism, varied, len(designs)))
        stated = [{v.name: v.stated(float(x)) for v, x in zip(variables, design, strict=True)} for design in designs]
        made = [self.lengths(scene.with_parameters(one).mechanism) for one in stated]
        return factor * self.margin(np.concatenate(made))

    def slopes(self, scene: Scene, variables: Sequence[Variable], design: Real) -> Real:
        """Derivatives (n,) of the margin of a design (n,), as in `margins`, with respect to the variables in their units."""
        steps = np.array([DIFFERENCE_STEP * (v.high - v.low) for v in variables])
        shifts = np.concatenate([sign * k * np.diag(steps) for k, _ in EIGHTH_ORDER for sign in (1.0, -1.0)])
        sides = self.margins(scene, variables, design + shifts).reshape(len(EIGHTH_ORDER), 2, len(design))
        return np.asarray(sum(w * (up - down) for (_, w), (up, down) in zip(EIGHTH_ORDER, sides, strict=True)) / steps)

    def lengths(self, mechanism: Mechanism, varied: Mapping[Place, Real] | None = None, count: int = 1) -> Real:
        """Lengths (D, 4) [m] of crank, coupler, rocker and frame of ``count`` designs. ``varied``: coordinates (D,) that differ
        between the designs, by place."""
        varied = {} if varied is None else varied
        points = {link.name: link.points for link in mechanism.links}

        def along(side: tuple[str, str, str], k: int) -> Real:
            link, first, second = side
            at = [varied.get(("links", link, "points", p, k), points[link][p][k]) for p in (first, second)]
            return np.broadcast_to(np.asarray(at[1]) - np.asarray(at[0]), (count,))

        return np.stack([np.hypot(along(side, 0), along(side, 1)) for side in self.sides], axis=-1)


def four_bar_loops(run: Run, type: str) -> list[FourBarLoop]:
    """The four-bar loops of a run, each with the required type. Raises `MechanismError` where there is none."""
    joints = {joint.name: joint for joint in run.motion.mechanism.joints}
    loops = []
    for loop in grashof(run.motion.model):
        points: dict[str, list[str]] = {link: [] for link in loop.links}
        for joint in (joints[name] for name in loop.joints):
            assert isinstance(joint, Revolute)
            for link, point in zip(joint.links, joint.points, strict=True):
                points[link].append(point)
        loops.append(FourBarLoop("-".join(loop.joints), type, tuple((link, own[0], own[1]) for link, own in points.items())))
    if not loops:
        raise MechanismError(Fault("goal.grashof", "the scene has no four-bar loop of revolute joints.", "Leave the key out."))
    return loops


def _known(place: Place) -> bool:
    """Whether an expression of a link states a single coordinate of a point, or does not affect points."""
    return place[2] in _OF_MASS or (place[2] == "points" and len(place) == 5)


LIMIT_ROUNDING = 1e-9  # relative: a limit that is violated by no more counts as kept
SCREENED_GENERATIONS = 8  # size of the screening sample, in generations
DESIGNS_AT_ONCE = 512  # designs per batch
RUNS_AT_ONCE = 4  # designs per portion of a process where each is run separately; progress is reported after each portion
GRASHOF_MARGIN = 1e-4  # relative to the mean length: with less, a four-bar is a change-point linkage in practice


@dataclass(frozen=True, eq=False)
class Term:
    """An objective, to be minimised: a function of the values of some measures.

    ``value``: arrays (D, ...) of its measures -> objective (D,); ``weights``: values of one design -> derivatives of the objective
    with respect to these values; ``sign``: -1 where the measure itself is maximised.
    """

    text: str
    unit: str
    measures: tuple[int, ...]
    value: Callable[[Sequence[Real]], Real]
    weights: Callable[[Sequence[Real]], list[Real]]
    sign: float = 1.0
    distance: bool = False  # whether it is a distance: never negative, with a kink at zero that its square does not have

    def shown(self, value: float) -> str:
        """A value of the objective as text, with its own sign and unit."""
        return f"{self.sign * value:.6g} {self.unit}"


def _signed_term(text: str, unit: str, measure: int, sign: float) -> Term:
    """The value of one measure, or its negative."""
    return Term(text, unit, (measure,), lambda own: sign * own[0], lambda own: [np.array([sign])], sign)


@dataclass(frozen=True, eq=False)
class Limit:
    """Least and greatest value of a measure, in the unit of its quantity, and the scale of its violation. With a ``loop`` it limits
    the margin of a four-bar loop by Grashof's criterion instead."""

    text: str
    unit: str
    measure: int
    least: float
    most: float
    scale: float
    loop: FourBarLoop | None = None

    def violation(self, values: Real) -> Real:
        """Relative violation (D,) of the limit by values (D,); 0 where they keep it."""
        low, high = (self.least - values) / self.scale, (values - self.most) / self.scale
        return np.asarray(np.maximum(np.maximum(low, high), 0.0))

    @property
    def words(self) -> str:
        """The limit in words."""
        least, most = (f"{x:.6g} {self.unit}".strip() for x in (self.least, self.most))
        if self.loop is not None:
            return self.text
        if np.isfinite(self.least) and np.isfinite(self.most):
            return f"{self.text} from {least} to {most}"
        return f"{self.text} at least {least}" if np.isfinite(self.least) else f"{self.text} at most {most}"


def violation_words(violation: float) -> str:
    """The violation of limits by a design, in words; "" where it keeps all."""
    if violation <= LIMIT_ROUNDING:
        return ""
    return f"limits missed by {100.0 * violation:.3g} %" if np.isfinite(violation) else "nothing assembled yet"


@dataclass(frozen=True, eq=False)
class ScoredDesigns:
    """Designs (D, n) with their ``objectives`` (D, m), to be minimised, and ``violations`` (D,) of limits, 0 where all are kept.

    Both are not finite where a design has no values. ``missing`` (D,): fraction of frames without values."""

    designs: Real
    objectives: Real
    violations: Real
    missing: Real

    @property
    def feasible(self) -> Flags:
        """Whether all limits are kept (D,)."""
        return np.asarray(self.violations <= LIMIT_ROUNDING)

    @property
    def infeasibility(self) -> Real:
        """Merit (D,) for ranking infeasible designs, the smaller the better: 0 where all limits are kept, below 1 where limits are
        violated, at least 1 where there are no values."""
        with np.errstate(invalid="ignore"):
            missed = np.where(np.isfinite(self.violations), self.violations / (1.0 + self.violations), 1.0 + self.missing)
        return np.where(self.feasible, 0.0, missed)

    def order(self, objective: int = 0) -> Index:
        """Indices of the designs (D,), the best first: sorted by `infeasibility`, feasible designs by an objective."""
        return np.lexsort((np.nan_to_num(self.objectives[:, objective], nan=np.inf), self.infeasibility))

    def best(self, objective: int = 0) -> int:
        """Index of the best design."""
        return int(self.order(objective)[0])


@dataclass(frozen=True, eq=False)
class Problem:
    """The optimisation problem of a goal. ``stated``: the scene with the goal, which `scene` changes to that of a design; the scene
    of ``study`` may trace more points."""

    stated: Scene
    study: Study
    variables: tuple[Variable, ...]
    terms: tuple[Term, ...]
    limits: tuple[Limit, ...]

    @property
    def bounds(self) -> Real:
        """Least and greatest values (n, 2) of the variables, in their units."""
        return np.array([(v.low, v.high) for v in self.variables])

    @property
    def start(self) -> Real:
        """The values (n,) of the variables in the scene, in their units."""
        return np.array([v.value for v in self.variables])

    def score(
        self, designs: Real, executor: Pool | None = None, progress: Callable[[int, int], None] = lambda *_: None
    ) -> ScoredDesigns:
        """Objectives and violations of designs (D, n), computed in portions, in parallel if there is an executor. ``progress`` gets
        the number of designs that are done and their total, after each portion except the last."""
        size = RUNS_AT_ONCE if self.study.batch is None else DESIGNS_AT_ONCE
        portions = [designs[k : k + size] for k in range(0, len(designs), size)]
        compute = map if executor is None else executor.map
        results = []
        for one in compute(evaluate, [self.study] * len(portions), portions):
            results.append(one)
            if len(results) < len(portions):
                progress(size * len(results), len(designs))
        values = [np.concatenate([a.values[k] for a in results]) for k in range(len(self.study.measures))]
        missing = np.concatenate([a.missing for a in results])
        with np.errstate(invalid="ignore"):
            objectives = np.stack([term.value([values[k] for k in term.measures]) for term in self.terms], axis=-1)
            limited = self.limited(designs, values).T
            violations = sum((limit.violation(x) for limit, x in zip(self.limits, limited, strict=True)), np.zeros(len(designs)))
        unfit = (missing > 0.0) | ~np.isfinite(objectives).all(axis=1) | ~np.isfinite(violations)
        return ScoredDesigns(designs, np.where(unfit[:, None], np.nan, objectives), np.where(unfit, np.inf, violations), missing)

    def limited(self, designs: Real, values: Sequence[Real]) -> Real:
        """The values (D, L) that the limits apply to, of designs (D, n). ``values``: those of the study's measures."""
        columns = [
            values[limit.measure] if limit.loop is None else limit.loop.margins(self.study.scene, self.variables, designs)
            for limit in self.limits
        ]
        return np.stack(columns, axis=-1) if columns else np.zeros((len(designs), 0))

    def scene(self, design: Real) -> Scene:
        """The scene of a design (n,)."""
        return self._of(self.stated, design)

    def _of(self, scene: Scene, design: Real) -> Scene:
        return scene.with_parameters({v.name: v.stated(float(x)) for v, x in zip(self.variables, design, strict=True)})

    def run(self, design: Real) -> Run:
        """The run of a design. Raises `MechanismError`."""
        return run_scene(self._of(self.study.scene, design), frames=self.study.frames, cycles=self.study.cycles)

    def differentiated(self, design: Real) -> tuple[Real, Real, Real, Real]:
        """Objectives (m,) and limited values (L,) of a design (n,), and their derivatives (m, n) and (L, n) with respect to the
        variables. Raises `MechanismError` where the design cannot be run, or has no derivatives."""
        run = self.run(design)
        moved = [v.at(float(x)) for v, x in zip(self.variables, design, strict=True)]
        slopes = sensitivities(run, self.study.measures, moved, self.study.start_turns)
        values = [np.asarray(s.number) if s.measure.reducer else s.curve for s in slopes]
        by = [s.derivatives[:, None] if s.measure.reducer else s.slopes for s in slopes]
        objectives, gradients = [], []
        for term in self.terms:
            own = [values[k] for k in term.measures]
            objectives.append(float(term.value([x[None] for x in own])[0]))
            weights = term.weights(own)
            parts = [by[k] @ np.atleast_1d(w) for k, w in zip(term.measures, weights, strict=True)]
            gradients.append(np.sum(parts, axis=0))
        limited = self.limited(design[None], [x[None] for x in values])[0]
        limited_by = [
            by[limit.measure][:, 0] if limit.loop is None else limit.loop.slopes(self.study.scene, self.variables, design)
            for limit in self.limits
        ]
        return np.array(objectives), limited, np.array(gradients), np.array(limited_by).reshape(len(self.limits), len(design))


def population_of(stated: int, variables: int) -> int:
    """Size of a generation: as stated, or where that is 0, a power of two that grows with the number of variables, at least 32."""
    return stated or max(32, 1 << int(np.ceil(np.log2(12 * variables))))


def problem_of(
    scene: Scene,
    *,
    frames: int | None = None,
    cycles: int | None = None,
    executor: Executor = "numpy",
    population: int = 0,
    generations: int = 0,
) -> Problem:
    """The optimisation problem of a scene's goal. ``executor`` computes its designs; ``population`` and ``generations`` give the
    number of designs of a search, which decides whether compiling pays. Raises `MechanismError`."""
    goal = goal_of(scene)
    try:
        check_goal(scene)
        count = population_of(population, len(goal_variables(scene, goal))) * (SCREENED_GENERATIONS + generations)
        return _problem(scene, goal, frames, cycles, executor, count)
    except MechanismError:
        check_goal(scene, run_scene(scene, frames=frames, cycles=cycles).catalogue)  # reports all faults of measures at once
        raise


def _problem(scene: Scene, goal: GoalDocument, frames: int | None, cycles: int | None, executor: Executor, count: int) -> Problem:
    """The problem of a goal that names only known parameters. ``count``: number of designs of a search."""
    variables = goal_variables(scene, goal)
    stated, limits_stated = scene, dict(goal.limits)
    if goal.box is not None:
        scene, within = _boxed(scene, goal.box)
        limits_stated |= within
    measures: list[Measure] = []

    def measure(text: str) -> int:
        wanted = parse_measure(scene, text)
        if wanted not in measures:
            measures.append(wanted)
        return measures.index(wanted)

    numbers = [(text, 1.0) for text in goal.minimise] + [(text, -1.0) for text in goal.maximise]
    simple = [(text, measure(text), sign) for text, sign in numbers]
    limited = [(text, measure(text), entry) for text, entry in limits_stated.items()]

    def at_places(text: str, places: Sequence[float | str], path: str) -> list[int]:
        """The measures of a curve at places of the first drive, which designs pass at instants of their own."""
        with under_other_names({"--of": path}):
            return [measure(f"{text}:at {place}") for place in places]

    follow, along = goal.follow, goal.path
    followed = [] if follow is None else at_places(follow.quantity, follow.drive, "goal.follow.drive")
    axes: list[list[int]] = []
    if along is not None:
        texts = path_measures(along.point)
        axes = [[measure(x)] if along.drive is None else at_places(x, along.drive, "goal.path.drive") for x in texts]
    varied = [Variation(v.name, v.unit, low=v.low, high=v.high) for v in variables]
    study = study_of(scene, varied, measures, frames=frames, cycles=cycles, executor=executor, count=count)
    quantities = study.quantities
    terms = [_signed_term(text, quantities[k].unit, k, sign) for text, k, sign in simple]
    if follow is not None:
        unit = quantities[followed[0]].unit
        wanted = np.array([_in_unit(x, unit, "goal.follow.values") for x in follow.values])
        terms.append(_following(follow.quantity, unit, followed, wanted, study.start_turns[followed[0]]))
    if along is not None:
        title, unit, through = f"distance of {along.point}", scene.units.display_unit("m")[0], np.array(along.through, float)
        x, y = axes
        terms.append(
            _passing(title, unit, (x[0], y[0]), through) if along.drive is None else _meeting(title, unit, (x, y), through)
        )
    limits, faults = [], list[Fault]()
    for text, k, entry in limited:
        path, unit = f"goal.limits.{text}", quantities[k].unit
        try:
            least = -np.inf if entry.least is None else _in_unit(entry.least, unit, path)
            most = np.inf if entry.most is None else _in_unit(entry.most, unit, path)
        except MechanismError as error:
            faults += error.faults
            continue
        if least > most:
            faults.append(Fault(path, "its least value is above the greatest.", "Give them the other way round."))
        nominal = float(reduced(measures[k], quantities[k], study.nominal))
        scale = max(abs(x) for x in (least, most) if np.isfinite(x)) or abs(np.nan_to_num(nominal)) or 1.0
        limits.append(Limit(text, quantities[k].unit, k, least, most, scale))
    if faults:
        raise MechanismError(faults)
    for loop in [] if goal.grashof is None else four_bar_loops(study.nominal, goal.grashof):
        text = f"Grashof {loop.name}" + (f", {loop.type}" if loop.type != "any" else "")
        unit, factor = scene.units.display_unit("m")
        size = float(np.mean(loop.lengths(scene.mechanism))) * factor
        limits.append(Limit(text, unit, -1, GRASHOF_MARGIN * size, np.inf, size, loop))
    return Problem(stated, study, variables, tuple(terms), tuple(limits))


def _boxed(scene: Scene, corners: tuple[Sequence[float], Sequence[float]]) -> tuple[Scene, dict[str, LimitDocument]]:
    """A scene in which the points of all moving links are traced (one for each revolute joint, none for joints on the frame), and
    limits that keep the points within the box given by two opposite corners."""
    mechanism = scene.mechanism
    pins = [list(zip(j.links, j.points, strict=True)) for j in mechanism.joints if isinstance(j, Revolute)]
    left_out = {end for ends in pins for end in ends[mechanism.frame not in (link for link, _ in ends) :]}
    ends = [(link.name, point) for link in mechanism.links if link.name != mechanism.frame for point in link.points]
    points = [f"{link}.{point}" for link, point in ends if (link, point) not in left_out]
    limits = {}
    for point in points:
        for axis, *sides in zip("xy", *corners, strict=True):
            limits[f"point.{point}.position[{axis}]:min"] = LimitDocument(least=f"{min(sides)!r} {scene.units.length}")
            limits[f"point.{point}.position[{axis}]:max"] = LimitDocument(most=f"{max(sides)!r} {scene.units.length}")
    return scene.changed({("trace",): points}), limits


def _in_unit(value: float | str, unit: str, path: str) -> float:
    """A stated value in the unit of a quantity. Raises `MechanismError`."""
    if not isinstance(value, str):
        return float(value)
    try:
        number, own = split(value)
        wanted = unit_of(unit) if unit not in ("", "1") else None
        given = unit_of(own)
        if wanted is None or wanted.powers != given.powers:
            raise QuantityError(f"'{own}' is no unit of a quantity in {unit or 'plain numbers'}.", "Give it in that.")
        return float(number) * float(given.factor / wanted.factor)
    except QuantityError as error:
        raise MechanismError(Fault(path, str(error), error.remedy)) from None


def _following(text: str, unit: str, measures: Sequence[int], wanted: Real, turns: StartTurn) -> Term:
    """Objective: root mean square deviation of values at places of the drive, those of M measures, from ``wanted`` (M,); of
    angles without whole turns."""

    def off(own: Sequence[Real]) -> Real:
        return turns.without_turns(np.stack(own, axis=-1) - wanted)

    def value(own: Sequence[Real]) -> Real:
        return np.asarray(np.sqrt(np.mean(off(own) ** 2, axis=-1)))

    def weights(own: Sequence[Real]) -> list[Real]:
        left = off(own)
        return list(left / (len(wanted) * max(float(np.sqrt(np.mean(left**2))), 1e-300)))

    return Term(f"deviation of {text}", unit, tuple(measures), value, weights, distance=True)


def _meeting(text: str, unit: str, measures: tuple[Sequence[int], Sequence[int]], through: Real) -> Term:
    """Objective: root mean square distance, in ``unit``, of the points ``through`` (M, 2) from a path at places of the drive, whose
    coordinates x and y are the values of M measures each."""
    count = len(through)

    def off(own: Sequence[Real]) -> Real:
        return np.stack(own, axis=-1) - through.T.ravel()

    def value(own: Sequence[Real]) -> Real:
        return np.asarray(np.sqrt(np.sum(off(own) ** 2, axis=-1) / count))

    def weights(own: Sequence[Real]) -> list[Real]:
        left = off(own)
        return list(left / (count * max(float(np.sqrt(np.sum(left**2) / count)), 1e-300)))

    return Term(text, unit, (*measures[0], *measures[1]), value, weights, distance=True)


def _passing(text: str, unit: str, measures: tuple[int, int], through: Real) -> Term:
    """Objective: root mean square distance, in ``unit``, of the points ``through`` (M, 2) from the nearest points of a path."""

    def distances(x: Real, y: Real) -> tuple[Real, Real, Real]:
        """Components x and y (..., M) of the vectors from the points to the path, and their weights of the frames (..., M, F)."""
        dx, dy = x[..., None, :] - through[:, 0, None], y[..., None, :] - through[:, 1, None]
        # the nearest point of the polygon through the frames
        ex, ey = np.diff(dx, axis=-1), np.diff(dy, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.clip(np.nan_to_num(-(dx[..., :-1] * ex + dy[..., :-1] * ey) / (ex**2 + ey**2)), 0.0, 1.0)
        px, py = dx[..., :-1] + share * ex, dy[..., :-1] + share * ey
        near = np.argmin(px**2 + py**2, axis=-1)[..., None]
        s = np.take_along_axis(share, near, -1)
        weights = np.zeros(dx.shape)
        np.put_along_axis(weights, near, 1.0 - s, -1)
        np.put_along_axis(weights, near + 1, s, -1)
        return np.take_along_axis(px, near, -1)[..., 0], np.take_along_axis(py, near, -1)[..., 0], weights

    def value(own: Sequence[Real]) -> Real:
        dx, dy, _ = distances(own[0], own[1])
        return np.asarray(np.sqrt(np.mean(dx**2 + dy**2, axis=-1)))

    def weights(own: Sequence[Real]) -> list[Real]:
        dx, dy, by = distances(own[0], own[1])
        size = len(through) * max(float(np.sqrt(np.mean(dx**2 + dy**2))), 1e-300)
        return [np.asarray((d[:, None] * by).sum(axis=0) / size) for d in (dx, dy)]

    return Term(text, unit, measures, value, weights, distance=True)
