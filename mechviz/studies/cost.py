"""Cost of each stage and effect of a scene: median and spread of repeated wall times after a warm-up, the machine that they were
measured on, and whether numpy or a compiled program runs a stage."""

from __future__ import annotations

import gc
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.compiled.motion import LEAST_FRAMES_TO_COMPILE, Executor, written_motion
from mechcore.compiled.toolchain import cached, compiler, required_compiler
from mechcore.dynamics.equations.contacts import has_dry_friction, missing_in_c, written_source
from mechcore.dynamics.events import with_slot_ends
from mechcore.dynamics.integration.windows import MANY_WINDOWS
from mechcore.effects.base import sum_up
from mechcore.effects.plan import Plan, PlannedStage, StageKind, make_plan
from mechcore.effects.registry import effects_of, wrenches
from mechcore.forces.friction.solve import solve_friction
from mechcore.forces.kinetostatics import solve_forces
from mechcore.forces.program import forces_program
from mechcore.motion.compiled import Compiled
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.records import dataclass
from mechviz.runs import run_scene
from mechviz.scene.faults import in_scene_words

if TYPE_CHECKING:
    from mechviz.scene.scene import Scene

HEALTH = ("closure", "velocity_closure", "acceleration_closure", "condition")


@dataclass(frozen=True)
class Cost:
    """A stage or effect of the plan and the median of its wall times [s]. ``part``: the time of the reactions includes it."""

    name: str
    seconds: float
    part: bool = False


@in_scene_words
def measure(scene: Scene, *, repeats: int = 7, outputs: Any = None, executor: Executor = "auto") -> list[Cost]:
    """Median wall times of all that the plan of a scene computes. Each repeat compiles and solves the mechanism anew."""
    mechanism = scene.mechanism
    plan: Plan = make_plan(mechanism) if outputs is None else make_plan(mechanism, outputs)
    frames = None if scene.simulation is not None else default_times(mechanism, scene.frames, scene.cycles)
    walls: dict[str, list[float]] = {}

    def clocked(name: str, work: Callable[[], object]) -> Any:
        start = time.perf_counter()
        result = work()
        walls.setdefault(name, []).append(time.perf_counter() - start)
        return result

    parts: set[str] = set()

    def part(kind: StageKind, item: str) -> str:
        """Name of a stage; marks its time as part of the time of the reactions."""
        name = PlannedStage(kind, item, "").name
        parts.add(name)
        return name

    effects = effects_of(mechanism)
    named = len(mechanism.effects)
    for _ in range(repeats + 1):
        if scene.simulation is not None:
            for spent in run_scene(scene, executor=executor).stages:
                walls.setdefault(spent.name, []).append(spent.seconds)
            continue
        compiled = clocked("compile", partial(compile_mechanism, mechanism, executor=executor))
        motion = clocked("positions", partial(_positions, compiled, frames))
        for kind in (StageKind.VELOCITIES, StageKind.ACCELERATIONS):
            if plan.has(kind):
                clocked(kind.value, partial(getattr, motion, f"origin_{kind.value}"))
        if plan.has(StageKind.FORCES):
            for k, effect in enumerate(effects):
                if "reactions" not in effect.needs:
                    clocked(part(StageKind.EFFECT if k < named else StageKind.LOAD, effect.name), partial(effect.wrenches, motion))
            if plan.has(StageKind.EFFECT, "friction"):
                clocked(part(StageKind.EFFECT, "friction"), partial(_friction, motion))
            forces = clocked(StageKind.FORCES.value, partial(solve_forces, motion))
            if plan.has(StageKind.ENERGY):
                clocked(StageKind.ENERGY.value, partial(_read, forces, ("energy", "power_balance")))
        if plan.has(StageKind.HEALTH):
            clocked(StageKind.HEALTH.value, partial(_read, motion, HEALTH))
    return [Cost(name, statistics.median(times[1:]), name in parts) for name, times in walls.items()]  # the first one warms up


def _positions(compiled: Compiled, frames: Any) -> Motion:
    motion = solve_motion(compiled, frames)
    _ = motion.origins
    return motion


def _friction(motion: Motion) -> None:
    """Compute dry friction and the reactions that it depends on."""
    applied = wrenches(motion)
    solve_friction(motion, *sum_up(applied, len(motion.model.links)))


def _read(result: object, names: tuple[str, ...]) -> None:
    """Read lazy attributes, so that they are computed."""
    for name in names:
        getattr(result, name)


def cost_lines(costs: list[Cost], frames: int) -> list[str]:
    """The costs as lines of a table: milliseconds, microseconds per frame, share of the total."""
    total = sum(c.seconds for c in costs if not c.part)
    width = max(len(c.name) for c in costs)
    lines = [f"cost (median, {frames} frames; effects and loads are part of the reactions' time)"]
    lines.append(f"  {'':<{width}}  {'ms':>9}  {'us/frame':>9}  {'share':>6}")
    lines += [
        f"  {c.name:<{width}}  {1e3 * c.seconds:>9.3f}  {1e6 * c.seconds / frames:>9.3f}  {100 * c.seconds / total:>5.1f}%"
        for c in costs
    ]
    return [*lines, f"  {'in all':<{width}}  {1e3 * total:>9.3f}  {1e6 * total / frames:>9.3f}"]


LEAST_REPEATS, MOST_REPEATS = 3, 25
REPEAT_SECONDS = 0.25  # [s] spent on repeats: quick work is repeated more often


@dataclass(frozen=True)
class WallTime:
    """Median [s] and interquartile range [s] of the wall times of ``repeats`` runs after one warm-up run."""

    seconds: float
    spread: float
    repeats: int


def time_repeatedly(work: Callable[[], object], budget: float = REPEAT_SECONDS, least: int = LEAST_REPEATS) -> WallTime:
    """Wall times of a function: it runs once to warm up, then until the budget [s] is spent, at least ``least`` times and otherwise
    at most 25 times."""
    work()
    times: list[float] = []
    collecting = gc.isenabled()
    gc.disable()
    try:
        while len(times) < least or (sum(times) < budget and len(times) < MOST_REPEATS):
            start = time.perf_counter()
            work()
            times.append(time.perf_counter() - start)
    finally:
        if collecting:
            gc.enable()
    return _wall_time(times)


def _wall_time(times: list[float]) -> WallTime:
    low, _, high = statistics.quantiles(times, n=4) if len(times) > 1 else (times[0],) * 3
    return WallTime(statistics.median(times), high - low, len(times))


def time_alternately(
    first: Callable[[], object], second: Callable[[], object], budget: float = REPEAT_SECONDS, least: int = LEAST_REPEATS
) -> tuple[WallTime, WallTime]:
    """Wall times of two functions that run alternately, so that other load on the machine affects both equally."""
    for work in (first, second):
        work()
    times: tuple[list[float], list[float]] = ([], [])
    while len(times[0]) < least or (sum(times[0]) < budget and len(times[0]) < MOST_REPEATS):
        for work, own in ((first, times[0]), (second, times[1])):
            start = time.perf_counter()
            work()
            own.append(time.perf_counter() - start)
    return _wall_time(times[0]), _wall_time(times[1])


@contextmanager
def processor_share() -> Iterator[Callable[[], float]]:
    """Context manager that yields a function. After the block this returns the ratio of processor time to wall time of the block,
    at most 1; before that 1."""
    wall, own = time.perf_counter(), time.process_time()
    share = [1.0]
    yield lambda: share[0]
    share[0] = min(1.0, (time.process_time() - own) / max(time.perf_counter() - wall, 1e-9))


def machine() -> str:
    """The machine in one line: processor, cores, operating system, versions of Python and numpy."""
    cpu = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                cpu = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass  # no such file on this system
    return f"{cpu}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}, numpy {np.__version__}"


START, EACH = 0.3, 5e-4  # [s] to compile a program: fixed, and for each line


@in_scene_words
def executor_lines(scene: Scene, executor: Executor) -> list[str]:
    """Executor of each stage of a scene, as lines for the plan. Raises `MechanismError` where the executor is "c" and there is no
    compiler."""
    if executor == "numpy":
        return ["executor", "  numpy, as asked for"]
    if executor == "c":
        required_compiler()
    if compiler() is None:
        return ["executor", "  numpy: there is no C compiler (pip install 'mechviz[fast]' brings one)"]
    compiled = compile_mechanism(scene.mechanism)
    lines = ["executor", f"  {'positions and rates':<21}{_of_motion(compiled, executor, scene.frames + 1)}"]
    if _forces_of(scene):
        lines.append(f"  {'reactions, efforts':<21}{_of_forces(compiled, executor, scene.frames + 1)}")
    if scene.simulation is not None:
        lines.append(f"  {'motion under forces':<21}{_of_simulation(compiled, executor, _stopped(scene))}")
    return lines


@in_scene_words
def missing_lines(scene: Scene) -> list[str]:
    """Stages of a scene that cannot be written in C, so that numpy runs them, each with the reason, as lines of text."""
    compiled = compile_mechanism(scene.mechanism)
    reasons = {"positions and rates": _not_written(compiled)}
    if _forces_of(scene) and reasons["positions and rates"] is None:
        program = forces_program(compiled.model, exact=compiled.angles.exact)
        reasons["reactions and efforts"] = program if isinstance(program, str) else None
    if scene.simulation is not None:
        reasons["the motion under forces"] = missing = missing_in_c(compiled)
        reasons["the motion while a stop holds"] = None if missing else _missing_at_rest(compiled, _stopped(scene))
    return [f"numpy runs {what}: {why}." for what, why in reasons.items() if why is not None]


def _not_written(compiled: Compiled) -> str | None:
    program = compiled.model.cached(written_motion)
    if isinstance(program, str):
        return program
    return (
        "frames near change points are interpolated"
        if compiled.singular_points is not None and compiled.singular_points.points
        else None
    )


def _of_motion(compiled: Compiled, executor: Executor, frames: int) -> str:
    missing, program = _not_written(compiled), compiled.model.cached(written_motion)
    if missing is not None or isinstance(program, str):
        return f"numpy: {missing}"
    if not program.lines:
        return "numpy: nothing is left to solve"
    if executor == "auto" and frames < LEAST_FRAMES_TO_COMPILE:
        return f"numpy: {frames:,} frames; compiling {program.lines:,} lines of C pays from about {LEAST_FRAMES_TO_COMPILE:,} on"
    return f"C, {_price(program.source, program.lines)}"


def _forces_of(scene: Scene) -> bool:
    """Whether reactions and efforts of a scene are computed: it has effects or loads."""
    return bool(scene.mechanism.effects or scene.mechanism.loads)


def _of_forces(compiled: Compiled, executor: Executor, frames: int) -> str:
    if _of_motion(compiled, executor, frames).startswith("numpy"):
        return "numpy, as the positions"
    program = forces_program(compiled.model, exact=compiled.angles.exact)
    if isinstance(program, str):
        return f"numpy: {program}"
    where = "; numpy where friction jams, or turns a flank" if program.rubs else ""
    return f"C, {_price(program.source, program.lines)}{where}"


def _stopped(scene: Scene) -> list[str]:
    """Names of the joints of a scene that have stops, slot ends among them."""
    stated = () if scene.simulation is None else scene.simulation.stops
    return list(dict.fromkeys(stop.joint for stop in with_slot_ends(scene.mechanism, stated)))


def _missing_at_rest(compiled: Compiled, joints: Sequence[str]) -> str | None:
    return next((why for joint in joints if (why := missing_in_c(compiled, (joint,))) is not None), None)


def _of_simulation(compiled: Compiled, executor: Executor, stopped: Sequence[str]) -> str:
    missing = missing_in_c(compiled)
    if missing is not None:
        return f"numpy: {missing}"
    price = _price(*written_source(compiled))
    price += "; numpy where friction jams" if has_dry_friction(compiled) else ""
    if stopped:
        at_rest = _missing_at_rest(compiled, stopped)
        price += "; another program while a stop holds" if at_rest is None else f"; numpy while a stop holds: {at_rest}"
    return f"C, {price}" if executor == "c" else f"numpy; C where more than {MANY_WINDOWS} windows are left to integrate, {price}"


def _price(source: str, lines: int) -> str:
    kept = "kept from before" if cached(source) else f"to be compiled once, in about {START + EACH * lines:.1f} s"
    return f"{lines:,} lines, {kept}"
