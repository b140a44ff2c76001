"""Evaluation of designs: in batches where the core supports it, otherwise one run per design; in this or another process."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import field
from functools import lru_cache
from pathlib import Path
from threading import Lock

import numpy as np

from mechcore.arrays import Real
from mechcore.compiled.kernels import cores
from mechcore.compiled.motion import Executor
from mechcore.constants import TURN
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechviz.accuracy.estimate import accuracy_warnings
from mechviz.quantities.catalogue import Quantity
from mechviz.runs import Run, run_scene
from mechviz.scene.folder import SceneFolder
from mechviz.scene.scene import Scene, loads
from mechviz.studies.designs.batches import NOT_FINITE, DesignBatch, batch_of
from mechviz.studies.designs.measures import OWN_TURNS, Measure, StartTurn, needs_forces, quantity_of
from mechviz.studies.designs.sampling import Variation

ONE_AT_A_TIME = Lock()  # threads of one process (as in workers of clusters) share its prepared studies
TRIED_DESIGNS = 3  # designs that are computed both ways before a batch is used
BATCH_AGREEMENT = 1e-9  # relative difference allowed between a batch and single runs
SINGULAR_RATIO = 1e6  # ratio to the median of all designs above which a result is taken as singular, and the design is run singly
_PLAIN = ("pose", "velocity", "acceleration", "position", "reaction", "motion", "inertia")


@dataclass(frozen=True)
class Study:
    """A study of many designs, described by plain values so that it can be passed to other processes."""

    text: str  # of the scene
    name: str
    folder: str
    variations: tuple[Variation, ...]
    measures: tuple[Measure, ...]
    frames: int | None = None
    cycles: int | None = None
    files: tuple[tuple[str, bytes], ...] = field(default=(), repr=False)
    executor: Executor = "numpy"  # executor of batches of designs
    count: int = 0  # total number of designs, which decides whether compiling pays

    @property
    def scene(self) -> Scene:
        """The nominal scene, read once in each process."""
        return _prepared(self).scene

    @property
    def nominal(self) -> Run:
        """The run of the nominal scene, solved once in each process."""
        return _prepared(self).run

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """The quantity of each measure in the nominal run."""
        return tuple(quantity_of(measure, self.nominal.catalogue) for measure in self.measures)

    @property
    def start_turns(self) -> tuple[StartTurn, ...]:
        """The whole turns of each measure, counted from the nominal run."""
        return _turns(self)

    @property
    def batch(self) -> DesignBatch | None:
        """The batch that computes many designs at once; None where each design is run singly."""
        return _batch(self)

    @property
    def computed_by(self) -> str:
        """The executor of the designs, in words for the user."""
        if self.batch is None:
            return "numpy, each design by itself: what varies, or what is asked for, is not computed side by side"
        program = self.batch.program
        if isinstance(program, str):
            return "numpy, many designs at once" + ("" if self.executor == "numpy" else f": {program}")
        return f"C, {program.lines:,} lines, {cores()} thread{'s' * (cores() > 1)}"

    @property
    def compiled(self) -> bool:
        """Whether a C program computes the designs, in its own threads."""
        return self.batch is not None and not isinstance(self.batch.program, str)


@dataclass(frozen=True, eq=False)
class DesignResults:
    """Results of designs: numbers (D,) or curves (D, F) of each measure. A design without values has NaN and a reason; the reason
    is "" otherwise. ``missing`` (D,): fraction of the frames without values, 1 where that is not known."""

    values: tuple[Real, ...]
    reasons: tuple[str, ...]
    missing: Real = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, eq=False)
class _Prepared:
    scene: Scene
    run: Run


def study_of(
    scene: Scene,
    variations: Sequence[Variation],
    measures: Sequence[Measure],
    *,
    frames: int | None = None,
    cycles: int | None = None,
    executor: Executor = "numpy",
    count: int = 0,
) -> Study:
    """A study of a scene; ``count``: total number of its designs. Raises `MechanismError` where a variation exceeds the range of
    its parameter, or where the nominal design cannot be run or lacks a quantity."""
    for v in variations:
        known = scene.parameters[v.name]
        ends = (*v.values, v.low, v.high) if not v.values else v.values
        if not known.allows(np.array([x * v.factor for x in ends if np.isfinite(x)])).all():
            remedy = "Vary it inside of that, or widen its range in the scene."
            low, high = (f"{end / v.factor:.6g}" for end in (known.low, known.high))
            why = f"goes beyond the range that the scene gives '{v.name}', {low} to {high} {v.unit}".rstrip()
            raise MechanismError(Fault(f"--vary {v.name}", f"{why}.", remedy))
    twice = {v.name for v in variations if sum(v.name == other.name for other in variations) > 1}
    if twice:
        raise MechanismError(Fault(f"--vary {min(twice)}", "varies twice.", "Give each parameter once."))
    study = Study(
        scene.text,
        scene.name,
        str(scene.folder.path),
        tuple(variations),
        tuple(measures),
        frames,
        cycles,
        tuple(scene.files.items()),
        executor,
        count,
    )
    for measure, quantity in zip(study.measures, study.quantities, strict=True):
        reduced(measure, quantity, study.nominal)
    return study


@lru_cache(maxsize=4)
def _prepared(study: Study) -> _Prepared:
    folder = SceneFolder(Path(study.folder), dict(study.files))
    scene = loads(study.text, study.name, folder)
    return _Prepared(scene, run_scene(scene, frames=study.frames, cycles=study.cycles))


@lru_cache(maxsize=4)
def _turns(study: Study) -> tuple[StartTurn, ...]:
    return tuple(start_turn(m, q, study.nominal) for m, q in zip(study.measures, study.quantities, strict=True))


@lru_cache(maxsize=4)
def _batch(study: Study) -> DesignBatch | None:
    """The batch of a study; None where there is none, or where it does not agree with single runs of a few random designs."""
    run = study.nominal
    how = study.executor, study.count
    batch = batch_of(study.scene, study.variations, study.measures, run.catalogue, (run.scene.frames, run.scene.cycles), how)
    if batch is None:
        return None
    rng = np.random.default_rng(0)
    ends = np.array([(min(v.values), max(v.values)) if v.values else (v.low, v.high) for v in study.variations])
    designs = ends[:, 0] + (ends[:, 1] - ends[:, 0]) * rng.random((TRIED_DESIGNS, len(ends)))
    curves, reasons = batch.curves(designs)
    for k, design in enumerate(designs):
        alone = _run_alone(study, design)
        if isinstance(alone, str):
            continue  # a single run also detects failures between the frames, which a batch does not
        if reasons[k] == NOT_FINITE and batch.has_friction:
            continue
        if reasons[k]:
            return None
        for (_, quantity, column), curve in zip(batch.columns, curves, strict=True):
            wanted = alone.catalogue[quantity.key].values()[:, column]
            if not np.max(np.abs(curve[k] - wanted)) <= BATCH_AGREEMENT * max(float(np.max(np.abs(wanted))), 1e-300):
                return None
    return batch


def _run_alone(study: Study, design: Real) -> Run | str:
    """The run of one design (n,), or the reason why there is none."""
    values = {v.name: v.stated(float(x)) for v, x in zip(study.variations, design, strict=True)}
    simple = all(q.path[-1] in _PLAIN or q.path[1] == "drive" for q in study.quantities)
    outputs = ("accelerations", "forces") if any(needs_forces(q.path) for q in study.quantities) else ("accelerations",)
    try:
        scene = study.scene.with_parameters(values)
        if simple:
            return run_scene(scene, frames=study.frames, cycles=study.cycles, outputs=outputs)
        return run_scene(scene, frames=study.frames, cycles=study.cycles)
    except MechanismError as error:
        first = error.faults[0]
        return f"{first.path}: {first.message}"


def reduced(measure: Measure, quantity: Quantity, run: Run, turns: StartTurn = OWN_TURNS) -> Real:
    """Value of a measure in a run, a number or a curve (F,); ``quantity``: that of the measure."""
    values = turns.aligned(quantity.values()[:, measure.column(quantity)])
    drives = run.motion.mechanism.drives
    drive = run.catalogue.coordinate(drives[0].joint) if drives else None
    return np.asarray(measure.reduced(values, run.catalogue.numbers.time, drive))


def start_turn(measure: Measure, quantity: Quantity, run: Run) -> StartTurn:
    """The whole turns of a measure of a nominal run."""
    motion = run.motion
    while (first := motion.parts[0][1]) is not motion:
        motion = first
    start, links = motion.angles.start, [motion.mechanism.frame]
    match quantity.path[1:]:
        case ("links", link, "pose"):
            links.append(link)
        case ("joints", joint, "motion") if joint not in start.ranges:
            links = next((list(c.links) for c in motion.model.connections if c.name == joint), links)
    if not quantity.key.endswith(".angle") or len({start.stated[link] for link in links}) == 1:
        return OWN_TURNS
    turn = TURN * run.scene.units.display_unit("rad")[1]
    return StartTurn(turn, float(quantity.values()[0, measure.column(quantity)]))


def evaluate(study: Study, designs: Real) -> DesignResults:
    """Results of designs (D, n), the values of the study's variations in their units."""
    with ONE_AT_A_TIME:
        return _evaluated(study, designs)


def expected_seconds(study: Study, count: int) -> float:
    """Expected time [s] of ``count`` designs that are run one after the other, from a run of the nominal scene; 0 for batches."""
    if study.batch is not None:
        return 0.0
    run = study.nominal  # made before the clock starts: the first run includes one-time work
    begun = time.perf_counter()
    run_scene(run.scene)
    return count * (time.perf_counter() - begun)


def _evaluated(study: Study, designs: Real) -> DesignResults:
    batch = study.batch
    if batch is not None:
        curves, reasons = batch.curves(designs)
        drive = batch.drive
        values = []
        missing = np.mean([~np.isfinite(curve) for curve in curves], axis=(0, 2))
        missing = np.where([not reason for reason in reasons], 0.0, np.where(missing > 0.0, missing, 1.0))
        for (measure, _, _), curve, turns in zip(batch.columns, curves, study.start_turns, strict=True):
            known = np.array([not reason for reason in reasons])
            curve[~known] = np.nan
            with np.errstate(invalid="ignore"):
                values.append(measure.reduced(turns.aligned(curve), batch.time, drive))
        unsolved = [k for k, reason in enumerate(reasons) if batch.has_friction and reason == NOT_FINITE]
        for k in (*_out_of_proportion(values), *unsolved):
            row, reasons[k] = _alone(study, designs[k], [np.full_like(v[k], np.nan) for v in values])
            missing[k] = 1.0 if reasons[k] else 0.0
            for v, own in zip(values, row, strict=True):
                v[k] = own
        return DesignResults(tuple(values), tuple(reasons), missing)
    rows: list[list[Real]] = []
    said: list[str] = []
    empty = [np.full_like(reduced(m, q, study.nominal), np.nan) for m, q in zip(study.measures, study.quantities, strict=True)]
    for design in designs:
        row, reason = _alone(study, design, empty)
        rows.append(row)
        said.append(reason)
    missing = np.array([1.0 if reason else 0.0 for reason in said])
    return DesignResults(tuple(np.array(column) for column in zip(*rows, strict=True)), tuple(said), missing)


def _out_of_proportion(values: Sequence[Real]) -> list[int]:
    """Numbers of the designs whose values (D, ...) exceed the median of all designs by a factor of more than ``SINGULAR_RATIO``."""
    beyond = np.zeros(len(values[0]), bool)
    for each in values:
        peaks = np.abs(each).reshape(len(each), -1).max(axis=1)
        known = peaks[np.isfinite(peaks)]
        if len(known):
            beyond |= peaks > SINGULAR_RATIO * float(np.quantile(known, 0.5, method="lower"))
    return np.flatnonzero(beyond).tolist()


def _alone(study: Study, design: Real, empty: list[Real]) -> tuple[list[Real], str]:
    """Values of each measure for one design from a single run, and the reason why there are none, or ""."""
    run = _run_alone(study, design)
    if isinstance(run, str):
        return empty, run
    if words := accuracy_warnings(run):
        return empty, f"not to be trusted: {words[0]}"
    row = []
    try:
        for measure, turns in zip(study.measures, study.start_turns, strict=True):
            row.append(reduced(measure, quantity_of(measure, run.catalogue), run, turns))
    except MechanismError as error:
        return empty, f"{error.faults[0].path}: {error.faults[0].message}"
    if any(len(np.atleast_1d(value)) != len(np.atleast_1d(none)) for value, none in zip(row, empty, strict=True)):
        return empty, "run.frames: differs from design to design, so that curves do; ask for numbers of them"
    if not all(np.all(np.isfinite(value)) for value in row):
        return row, "the values are not finite: the mechanism jams, or they are not determined"
    return row, ""
