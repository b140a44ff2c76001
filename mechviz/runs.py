"""A run of a scene: compilation, motion, forces and studies, with the wall time of each stage."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import field
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, get_args

import numpy as np

from mechcore.accuracy import DEFAULT, Accuracy, accuracy_for
from mechcore.arrays import Real
from mechcore.compiled.motion import Executor
from mechcore.constructions.studies import StudyResults
from mechcore.constructions.studies import compute as compute_studies
from mechcore.dynamics.joined import JoinedForces, JoinedMotion
from mechcore.dynamics.rest.steady import SteadyRun
from mechcore.dynamics.simulate import simulate
from mechcore.effects.plan import OUTPUTS, Plan, StageKind, make_plan
from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces, solve_forces
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.records import dataclass
from mechcore.texts import Text
from mechviz.accuracy.estimate import ErrorEstimate, check_finite, estimate_errors
from mechviz.accuracy.fit import Fit, fit_frames, resolve_accuracy, simulate_to_target
from mechviz.quantities.catalogue import Catalogue
from mechviz.quantities.numbers import Numbers, numbers_of
from mechviz.scene.assembly.under_forces import steady_state
from mechviz.scene.faults import in_scene_words
from mechviz.scene.limits import check_frames

if TYPE_CHECKING:
    from mechcore.dynamics.event_integrator import Method
    from mechcore.dynamics.simulation import Simulation
    from mechviz.scene.annotations import Place
    from mechviz.scene.scene import Scene

    Resimulate = Callable[..., Simulation]  # of a tolerance, optionally a method and an earlier simulation to start from


@dataclass(frozen=True)
class Stage:
    """A finished stage and its wall time [s]."""

    name: str
    seconds: float


@dataclass(frozen=True)
class Run:
    """A solved scene. ``forces`` is None where the scene names no effects and no loads.

    ``simulation`` is set where forces determine the motion; ``motion`` and ``forces`` are then its values at the frames. ``steady``
    is the steady state in which the run starts, where the scene requires it.
    """

    scene: Scene
    compiled: Compiled
    motion: Motion
    forces: Forces | None
    plan: Plan
    stages: tuple[Stage, ...]
    studies: StudyResults = field(default_factory=StudyResults)
    simulation: Simulation | None = None
    steady: SteadyRun | None = None
    accuracy: Accuracy = DEFAULT
    fit: Fit | None = None  # of the number of frames, where the accuracy determined it
    resimulate: Resimulate | None = None  # repeats the simulation with another tolerance

    @cached_property
    def numbers(self) -> Numbers:
        """The numbers that are recorded, exported, drawn and plotted."""
        return numbers_of(self)

    @cached_property
    def catalogue(self) -> Catalogue:
        """All quantities that can be plotted."""
        return Catalogue(self.numbers)

    @cached_property
    def errors(self) -> ErrorEstimate:
        """Estimate of the numerical errors of the run."""
        return estimate_errors(self)

    @cached_property
    def resolved_accuracy(self) -> Accuracy:
        """The accuracy settings, including those of drawing and recording, which follow from the target: chord, profile, numbers,
        pictures."""
        return resolve_accuracy(self)


def with_frames_and_cycles(scene: Scene, frames: int | None, cycles: int | None) -> Scene:
    """The scene with another number of frames or cycles, validated like any scene (not every drive can repeat)."""
    given = {"frames": frames, "cycles": cycles}
    changes: dict[Place, int] = {("run", key): value for key, value in given.items() if value is not None}
    return scene.changed(changes) if changes else scene


@contextmanager
def stopwatch(stages: list[Stage], name: str) -> Iterator[None]:
    """Append the wall time of a block of code to ``stages``."""
    start = time.perf_counter()
    yield
    stages.append(Stage(name, time.perf_counter() - start))


@in_scene_words
def run_scene(
    scene: Scene,
    *,
    frames: int | None = None,
    cycles: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
    outputs: Iterable[str] = OUTPUTS,
    advance: Callable[[float, float], None] = lambda *_: None,
    accuracy: Accuracy | float | None = None,
    observe: Callable[[Simulation, float], None] | None = None,
    warn: Callable[[str], None] | None = None,
    executor: Executor = "auto",
) -> Run:
    """Solve a scene over its frames and cycles (by default those of the scene). Raises `MechanismError`.

    ``progress`` gets the name of each stage as it begins. Where forces determine the motion, it is simulated first, over the
    scene's duration: ``advance`` gets the time that is reached and the end time [s]; ``observe`` gets each segment as soon as it is
    known, and the whole duration; ``warn`` gets a message before a long computation begins.

    Only the stages that the plan for ``outputs`` (of `OUTPUTS`) requires are computed; by default all that the scene requires.

    ``accuracy``: the target relative error or the settings, instead of the scene's. A target also determines the number of frames,
    unless ``frames`` or the settings state it; the scene's own target leaves frames in the scene's [run] unchanged. See
    `mechcore.accuracy`.

    ``executor``: "numpy", "c" (a program generated for the mechanism, compiled once), or "auto": C only where compiling pays; see
    `mechcore.compiled`.

    The scene of the run is the one that was solved, with the frames and cycles that were used.
    """
    if executor not in get_args(Executor):
        raise MechanismError(Fault("executor", f"'{executor}' is none.", f"There are: {', '.join(get_args(Executor))}."))
    stages: list[Stage] = []
    settings = _settings(scene, accuracy)
    counted = frames is not None or (accuracy is None and "frames" in scene.document.run.model_fields_set)
    scene = with_frames_and_cycles(scene, settings.frames if frames is None else frames, cycles)
    mechanism = scene.mechanism
    check_frames(len(mechanism.links), scene.frames)
    wanted = set(outputs)
    plan = make_plan(mechanism, wanted)

    def stage(name: str) -> AbstractContextManager[None]:
        progress(name)
        return stopwatch(stages, name)

    with stage("compile"):
        compiled = compile_mechanism(mechanism, settings, executor)
    simulation, steady, resimulate = None, None, None
    if scene.simulation is not None:
        if scene.simulation.steady is not None:
            with stage("steady run"):
                steady, compiled = steady_state(scene.simulation.steady, compiled)
        with stage(StageKind.SIMULATION.value):
            resimulate = _resimulate(scene, compiled, advance, steady, observe, warn)
            simulation = _simulate(scene, settings, resimulate, asked=accuracy is not None)
    fit = None
    if settings.target is not None and not counted and settings.frames is None:
        with stage("frames for the accuracy"):
            fit = _fit(scene, settings, simulation)
        scene = with_frames_and_cycles(scene, fit.frames, None)
    with stage(StageKind.POSITIONS.value):
        motion = _motion(scene, compiled, simulation)
        _read(motion, "origins")
    if plan.has(StageKind.VELOCITIES):
        with stage(StageKind.VELOCITIES.value):
            _read(motion, "origin_velocities")
    if plan.has(StageKind.ACCELERATIONS):
        with stage(StageKind.ACCELERATIONS.value):
            _read(motion, "origin_accelerations")
    forces = None
    if plan.has(StageKind.FORCES):
        with stage(StageKind.FORCES.value):
            forces = solve_forces(motion) if simulation is None else simulation.forces(motion)
    if forces is not None and plan.has(StageKind.ENERGY):
        with stage(StageKind.ENERGY.value):
            _ = forces.energy, forces.power_balance
    studies = StudyResults()
    if mechanism.studies.items() and {"accelerations", "forces"} <= wanted:
        with stage("studies"):
            studies = compute_studies(motion, forces)
    if plan.has(StageKind.HEALTH):
        with stage(StageKind.HEALTH.value):
            _ = motion.closure, motion.velocity_closure, motion.acceleration_closure, motion.condition
    run = Run(
        scene=scene,
        compiled=compiled,
        motion=motion,
        forces=forces,
        plan=plan,
        stages=tuple(stages),
        studies=studies,
        simulation=simulation,
        steady=steady,
        accuracy=settings,
        fit=fit,
        resimulate=resimulate,
    )
    check_finite(run)
    return run


def _resimulate(
    scene: Scene,
    compiled: Compiled,
    advance: Callable[[float, float], None],
    steady: SteadyRun | None,
    observe: Callable[[Simulation, float], None] | None,
    warn: Callable[[str], None] | None,
) -> Resimulate:
    """A function that simulates a scene's free coordinates with a tolerance, optionally with another method and from an earlier
    simulation. Only its first simulation is observed; a warning of long computation is issued once."""
    spec = scene.simulation
    assert spec is not None
    duration = steady.period if steady is not None and np.isnan(spec.duration) else spec.duration

    unseen = [] if observe is None else [observe]
    unwarned = [] if warn is None else [warn]

    def once(words: str) -> None:
        if unwarned:
            unwarned.pop()(Text.of(words).in_units(scene.units))

    def resimulate(tolerance: float, method: Method | None = None, like: Simulation | None = None) -> Simulation:
        look = unseen.pop() if unseen else None
        return simulate(
            compiled,
            duration,
            tolerance=tolerance,
            method=method or compiled.accuracy.method or spec.method,
            stops=spec.stops,
            triggers=spec.triggers,
            separable_cams=spec.separable_cams,
            progress=lambda t: advance(t, duration),
            observe=None if look is None else lambda segment: look(segment, duration),
            initial_guess=like,
            warn=once if unwarned else None,
        )

    return resimulate


def _simulate(scene: Scene, settings: Accuracy, resimulate: Resimulate, *, asked: bool) -> Simulation:
    """The simulation of a scene. ``asked``: the accuracy comes from the caller and overrides the scene's tolerance."""
    assert scene.simulation is not None
    if settings.target is not None and (asked or scene.document.run.tolerance is None):
        return simulate_to_target(settings, resimulate)
    return resimulate(settings.integrator if asked and settings.integrator is not None else scene.simulation.tolerance)


def _settings(scene: Scene, accuracy: Accuracy | float | None) -> Accuracy:
    """The accuracy settings of a run: those of the caller, else the scene's."""
    if accuracy is None:
        return scene.accuracy
    return accuracy if isinstance(accuracy, Accuracy) else accuracy_for(accuracy)


def _fit(scene: Scene, settings: Accuracy, simulation: Simulation | None) -> Fit:
    """The number of frames that an accuracy requires."""
    return fit_frames(scene, settings, simulation)


def _motion(scene: Scene, compiled: Compiled, simulation: Simulation | None) -> Motion:
    """The motion at the frames of a scene."""
    if simulation is None:
        return solve_motion(compiled, default_times(scene.mechanism, scene.frames, scene.cycles))
    return simulation.view(np.linspace(0.0, simulation.duration, scene.frames + 1))


def _read(motion: Motion, stage: str) -> None:
    """Compute a stage, which is an attribute evaluated on access, for each part of a motion."""
    for _, part in motion.parts:
        getattr(part, stage)


@cache
def package_version() -> str:
    """The version of mechviz."""
    try:
        return version("mechviz")
    except PackageNotFoundError:  # run from a source folder that was never installed
        return "unknown"


BLOCKS = 40  # into which the frames of a whole run are divided


@dataclass(frozen=True, eq=False)
class _Block:
    """Frames at ``times`` (F,) [s] with their motion and, where the scene has forces, their forces."""

    times: Real
    motion: Motion
    forces: Forces | None


class Running:
    """Runs built from the segments of a motion, which are taken in order as `mechcore.dynamics.simulate` finds them.

    Every frame is solved once, in a block; a run of all frames so far is joined from the blocks. ``sent`` is the number of frames
    in blocks. A block is a fortieth of the run, or, with ``due``, all new frames as soon as ``due()`` is true.
    """

    def __init__(self, scene: Scene, due: Callable[[], bool] | None = None):
        self.scene = scene
        self.due = due
        self.plan = make_plan(scene.mechanism, set(OUTPUTS))
        self.sent = 0
        self.times: Real = np.zeros(0)  # of all frames of the whole run
        self.duration = 0.0
        self._segments: list[Simulation] = []
        self._joined: tuple[tuple[_Block, ...], Simulation] | None = None  # assigned as one object: another thread may read it

    def take(self, segment: Simulation, duration: float) -> Run | None:
        """Add a segment. Returns the run of the new frames if they are enough for a block, else None. ``duration`` of the whole
        motion [s]."""
        if not len(self.times):
            self.duration = duration
            self.times = np.linspace(0.0, duration, self.scene.frames + 1)
        self._segments.append(segment)
        known = int(np.searchsorted(self.times, segment.duration, side="right"))
        enough = max(len(self.times) // BLOCKS, 2)
        if self.due is not None:
            enough = 2 if self.due() else len(self.times)
        if known - self.sent < enough and not (known == len(self.times) and known > self.sent):
            return None
        return self._block(self.times[self.sent : known])

    def _block(self, times: Real) -> Run:
        first, *others = self._segments
        new = first.followed_by(others)
        self._segments = []
        motion = new.view(times)
        forces = None
        if self.plan.has(StageKind.FORCES):
            forces = new.forces(motion)
            _ = new.energies(times)  # computed here, so that the whole run need not repeat it
        block = _Block(times, motion, forces)
        if self._joined is None:
            self._joined = (block,), new
        else:
            self._joined = (*self._joined[0], block), self._joined[1].followed_by([new])
        self.sent += len(times)
        return self._run((block,), self._joined[1])

    def so_far(self) -> Run:
        """The run of all frames in blocks so far; there must be at least one block. Another thread may call it."""
        assert self._joined is not None
        return self._run(*self._joined)

    def _run(self, blocks: tuple[_Block, ...], whole: Simulation) -> Run:
        assert self._joined is not None
        first = blocks[0]
        times = np.concatenate([b.times for b in blocks])
        starts = np.cumsum([0, *(len(b.times) for b in blocks)])
        parts = [(rows + at, m) for b, at in zip(blocks, starts, strict=False) for rows, m in b.motion.parts]
        motion = JoinedMotion(
            times,
            parts,
            mechanism=self._joined[0][0].motion.mechanism,  # the same object in all runs: solids are made for it
            at_times=whole.view,
            coordinates=whole.coordinates(times),
            model=first.motion.model,
        )
        forces: JoinedForces | None = None
        if first.forces is not None:
            solved = [part for b in blocks if b.forces is not None for part in b.forces.parts]
            by_part = [(rows, f) for (rows, _), (_, f) in zip(parts, solved, strict=True)]
            forces = JoinedForces(motion, by_part, stops=whole.stops, energies=whole.energies)
        return Run(
            scene=self.scene,
            compiled=whole.compiled,
            motion=motion,
            forces=forces,
            plan=self.plan,
            stages=(),
            simulation=whole,
            accuracy=self.scene.accuracy,
        )
