"""Work-precision study: error and computing time of a scene at a series of values of each accuracy setting."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict, replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import mechcore
from mechcore.accuracy import DEFAULT, Accuracy
from mechcore.arrays import Real
from mechcore.errors import MechanismError
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import default_times, solve_motion
from mechcore.records import dataclass
from mechviz.accuracy.estimate import estimate_errors, pose_difference
from mechviz.accuracy.fit import (
    ORDERS,
    PROFILE_POINTS,
    duration,
    fit_frames,
    measure_fit,
    planar_cams,
    profile_deviation,
    quantity_function,
)
from mechviz.accuracy.quantities import quantities
from mechviz.meshes.kinds.cam_profiles import profile_points
from mechviz.picture.build import solids_of
from mechviz.runs import Run, package_version, run_scene
from mechviz.studies.cost import WallTime, machine, time_repeatedly

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechviz.scene.scene import Scene

Advance = Callable[[int, int], None]

FRAMES = (16, 32, 64, 128, 256, 512, 1024, 2048, 4096)
DIVISIONS = (24, 72, 180, 360, 1080, 3600)  # frames per cycle at which rates are compared
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
CHORDS = (3e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)  # [m] for a mechanism of size 0.2 m; scaled with the size
LEAST_ERROR = 1e-16
MOST_MEASURED = 1_000_000  # largest number of links times frames that is measured, as each point is computed several times


@dataclass(frozen=True)
class PrecisionPoint:
    """A point of the study: name of the setting, method, value in words, the options that reproduce it, relative error, median and
    spread of the time [s], number of repeats. ``current``: the run uses this value."""

    setting: str
    method: str
    value: str
    options: dict[str, Any]
    error: float
    seconds: float
    spread: float
    repeats: int
    current: bool = False
    note: str = ""

    @property
    def time_text(self) -> str:
        """The time in seconds or milliseconds, as text."""
        return f"{self.seconds:.3g} s" if self.seconds >= 1.0 else f"{1e3 * self.seconds:.3g} ms"

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


def pareto(points: Sequence[PrecisionPoint]) -> list[PrecisionPoint]:
    """The Pareto front: the points that no other beats in both time and error, the quickest first."""
    front: list[PrecisionPoint] = []
    for p in sorted(points, key=lambda p: (p.seconds, p.error)):
        if not front or p.error < front[-1].error:
            front.append(p)
    return front


def cheapest(points: Sequence[PrecisionPoint], target: float) -> PrecisionPoint | None:
    """The quickest point whose error is at most the target; None where there is none."""
    good = [p for p in points if p.error <= target]
    return min(good, key=lambda p: p.seconds) if good else None


def _at(
    setting: str, method: str, value: str, options: dict[str, Any], error: float, time: WallTime, **more: Any
) -> PrecisionPoint:
    error = max(float(error), LEAST_ERROR) if np.isfinite(error) else float("inf")
    return PrecisionPoint(setting, method, value, options, error, time.seconds, time.spread, time.repeats, **more)


def ladder(
    scene: Scene,
    target: float | None = None,
    advance: Advance = lambda *_: None,
    budget: float = 0.25,
    only: Collection[str] | None = None,
    record: Callable[..., object] | None = None,
) -> list[PrecisionPoint]:
    """The points of the study of a scene: of all settings, or of those named in ``only``.

    Settings that have no effect on the scene are left out, such as tolerances where nothing is iterated. ``target``: error for
    which the number of frames is fitted as well; ``budget``: time for the repeats of a point [s]; ``advance`` gets the number of
    settings that are done and their total. ``record(run, path, solids=...)`` writes a recording (`write_recording`); without it
    the settings of recordings are not measured.
    """
    base = run_scene(scene)
    general = any(b.kind == "general" for b in base.compiled.model.blocks)
    rubs = base.forces is not None and base.forces.friction is not None
    steps: dict[str, Callable[[], Iterator[PrecisionPoint]]] = {"frames": lambda: _frames(base, target, budget)}
    if base.simulation is None:
        steps["differentiation"] = lambda: _differentiation(base, budget)
        if general:
            stops = (1e-2, 1e-4, 1e-6, 1e-9, 1e-12, 2e-15)
            steps["position tolerance"] = lambda: _iterated(base, "position", "Newton's method", stops, budget)
        if rubs:
            steps["friction tolerance"] = lambda: _iterated(
                base, "friction", "Newton's method", (1e-2, 1e-4, 1e-6, 1e-9, 1e-13), budget
            )
    else:
        steps["integrator"] = lambda: _integrator(base, budget)
    steps["tessellation"] = lambda: _tessellation(base, budget)
    if record is not None:
        steps["recording"] = lambda: _recording(base, record)
    if planar_cams(base):
        steps["cam profile"] = lambda: _profiles(base, budget)
    chosen = [step for setting, step in steps.items() if only is None or setting in only]
    points: list[PrecisionPoint] = []
    for k, step in enumerate(chosen):
        advance(k, len(chosen))
        points += step()
    advance(len(chosen), len(chosen))
    return points


def _setting(name: str, value: Any, base: Accuracy = DEFAULT) -> Accuracy:
    """Accuracy settings with one of them changed."""
    return replace(base, **{name: value})


def _solve(run: Run, accuracy: Accuracy, time: Real) -> Any:
    """Motion with its rates, and forces where the scene has some, at times [s]. This is what is timed."""
    if run.simulation is not None:
        view = run.simulation.view(time)
        return view, run.simulation.forces(view) if run.forces is not None else None
    compiled = replace(run.compiled, accuracy=accuracy, paths=[])
    motion = solve_motion(compiled, time)
    _ = motion.origin_velocities, motion.origin_accelerations
    return motion, solve_forces(motion) if run.forces is not None else None


def _frames(run: Run, target: float | None, budget: float) -> Iterator[PrecisionPoint]:
    """Points for numbers of frames per cycle and orders of interpolation, and for the numbers that just reach the target."""
    scene = run.scene
    at, end = quantity_function(scene, run.accuracy, run.simulation), duration(scene, run.simulation)
    parts = scene.cycles if run.simulation is None else 1
    own = scene.frames // parts
    counts = sorted({*(n for n in FRAMES if n * parts * len(scene.mechanism.links) <= MOST_MEASURED), own})
    times = {n: time_repeatedly(partial(_solve, run, run.accuracy, np.linspace(0.0, end, n * parts + 1)), budget) for n in counts}
    for order, words in ORDERS.items():
        for n in counts:
            fit = measure_fit(at, end, n * parts, order)
            here = n == own and order == run.accuracy.interpolation
            note = f"{fit.jumps} jumps left out" if fit.jumps else ""
            options = {"frames": n * parts, "interpolation": order}
            yield _at("frames", words, f"{n} frames", options, fit.error, times[n], current=here, note=note)
        if target is not None and order:
            fit = fit_frames(scene, _setting("interpolation", order, replace(DEFAULT, target=target)), run.simulation)
            spent = time_repeatedly(partial(_solve, run, run.accuracy, np.linspace(0.0, end, fit.frames + 1)), budget)
            options = {"frames": fit.frames, "interpolation": order}
            yield _at("frames", words, f"{fit.frames // parts} frames", options, fit.error, spent, note="fitted to the target")


def _differentiation(run: Run, budget: float) -> Iterator[PrecisionPoint]:
    """Points for rates by linear equations, by finite differences and by graphical differentiation; errors relative to the peak."""
    scene = run.scene
    drawn = ("drawn by chords", {"differentiation": "graphical"})
    methods: list[tuple[str, dict[str, Any]]] = [
        ("exact", {"differentiation": "exact"}),
        *((f"differences of order {k}", {"differentiation": "differences", "differences": k}) for k in (2, 4, 6)),
        drawn,
    ]
    end = duration(scene)
    for words, options in methods:
        for n in DIVISIONS:
            if n * scene.cycles * len(scene.mechanism.links) > MOST_MEASURED:
                continue
            time = np.linspace(0.0, end, n * scene.cycles + 1)
            exact = quantities(solve_motion(replace(run.compiled, accuracy=DEFAULT), time), None)
            accuracy = Accuracy(**options)
            every = quantities(_solve(run, accuracy, time)[0], None)
            named = {q.name: q for q in every}
            joints = [(q, named[q.name]) for q in exact if q.kind != "position" and q.name in named]
            errors = [float(np.nanmax(np.abs(b.values - a.values))) / a.scale for a, b in joints]
            if words == "exact":
                errors = [float(np.nanmax(_rates_error(run, time)))]
            spent = time_repeatedly(partial(_solve, run, accuracy, time), budget)
            here = words == "exact" and n * scene.cycles == scene.frames
            yield _at(
                "differentiation",
                words,
                f"{n} frames",
                {**options, "frames": n * scene.cycles},
                max(errors, default=0.0),
                spent,
                current=here,
            )


def _rates_error(run: Run, time: Real) -> Real:
    """Estimated error (F,) of accelerations from the equations, which are the reference of the other methods."""
    motion = solve_motion(replace(run.compiled, accuracy=DEFAULT), time)
    return estimate_errors(replace(run, motion=motion, forces=None, accuracy=DEFAULT)).acceleration


def _iterated(run: Run, setting: str, method: str, tolerances: tuple[float, ...], budget: float) -> Iterator[PrecisionPoint]:
    """Points for the tolerance of an iteration; the reference is the tightest tolerance at the same frames."""
    scene = run.scene
    time = default_times(scene.mechanism, scene.frames, scene.cycles)
    kinds = ("position",) if setting == "position" else ("reaction",)
    best = {q.name: q for q in quantities(*_solve(run, _setting(setting, tolerances[-1]), time))}
    for tolerance in tolerances:
        accuracy = _setting(setting, tolerance)
        iterated = [q for q in quantities(*_solve(run, accuracy, time)) if q.kind in kinds and q.name in best]
        error = max(
            (float(np.nanmax(np.abs(q.values - best[q.name].values), initial=0.0)) / best[q.name].scale for q in iterated),
            default=0.0,
        )
        spent = time_repeatedly(partial(_solve, run, accuracy, time), budget)
        here = tolerance == getattr(run.accuracy, setting)
        yield _at(f"{setting} tolerance", method, f"{tolerance:.0e}", {setting: tolerance}, error, spent, current=here)


def _simulated(scene: Scene, accuracy: Accuracy) -> Simulation:
    """The motion under forces with given accuracy settings; no other stage is computed."""
    simulation = run_scene(scene, accuracy=accuracy, outputs=()).simulation
    assert simulation is not None
    return simulation


def _integrator(run: Run, budget: float) -> Iterator[PrecisionPoint]:
    """Points for method, order and tolerance of the integrator; the reference is collocation at its tightest tolerance."""
    assert run.resimulate is not None and run.simulation is not None
    resimulate, spec = run.resimulate, run.scene.simulation
    assert spec is not None
    try:
        best = resimulate(1e-13, "gauss")
    except MechanismError:
        best = resimulate(1e-11, "gauss")
    t = np.linspace(0.0, min(best.duration, run.simulation.duration), 257)
    truth = best.view(t)
    methods: list[tuple[str, str, int | None]] = [
        ("gauss", "Gauss", None),
        ("gauss", "Gauss, 4 nodes", 4),
        ("radau", "Radau", None),
    ]
    if run.simulation.method == "energy":
        methods.insert(0, ("energy", "energy", None))
    for method, words, nodes in methods:
        for tolerance in TOLERANCES if method != "radau" and nodes is None else TOLERANCES[:5]:
            accuracy = _setting("method", method, Accuracy(integrator=tolerance, nodes=nodes))

            work = partial(_simulated, run.scene, accuracy)
            try:
                result = work()
                shared = t[t <= result.duration]
                error = float(np.nanmax(pose_difference(result.view(shared), best.view(shared) if len(shared) < len(t) else truth)))
            except MechanismError:
                continue  # the integration fails at this tolerance
            spent = time_repeatedly(work, budget, least=1 if budget < 0.1 else 3)
            here = nodes is None and method == run.simulation.method and tolerance == run.simulation.tolerance
            options = {"method": method, "integrator": tolerance, **({"nodes": nodes} if nodes else {})}
            yield _at("integrator", words, f"{tolerance:.0e}", options, error, spent, current=here)
    if run.simulation.tolerance not in TOLERANCES:
        now = run.simulation.tolerance
        error = float(np.nanmax(pose_difference(run.simulation.view(t), truth)))
        words = next(w for m, w, n in methods if m == run.simulation.method and n is None)
        options = {"method": run.simulation.method, "integrator": now}
        work = partial(_simulated, run.scene, _setting("method", run.simulation.method, Accuracy(integrator=now)))
        yield _at("integrator", words, f"{now:.0e}", options, error, time_repeatedly(work, budget, least=1), current=True)


def _tessellation(run: Run, budget: float) -> Iterator[PrecisionPoint]:
    """Points for the chordal error of round shapes: largest error relative to the mechanism's size, and time to make the meshes."""
    size = run.motion.model.length_scale
    asked = [float(np.clip(chord * size / 0.2, 1e-9, 1.0)) for chord in CHORDS]
    for distance in [None, *asked]:
        chosen = run if distance is None else replace(run, accuracy=replace(run.accuracy, chord=distance))
        made = solids_of(chosen)
        spent = time_repeatedly(partial(solids_of, chosen), 0.0, least=1)
        note = f"{sum(len(s.faces) for s in made.links.values())} faces"
        words = "as it is" if distance is None else run.scene.units.show(distance, "length", 3)
        options = {"chord": distance} if distance is not None else {}
        yield _at("tessellation", "chords", words, options, made.chord / size, spent, current=distance is None, note=note)


def _recording(run: Run, record: Callable[..., object]) -> Iterator[PrecisionPoint]:
    """Points for the number format and the decimation of a recording: error when read with the run's interpolation, time to write
    it, and size of the file."""
    solids = solids_of(run)
    at, end, order = (
        quantity_function(run.scene, run.accuracy, run.simulation),
        duration(run.scene, run.simulation),
        run.accuracy.interpolation,
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.rrd"
        for numbers in ("float64", "float32"):
            for thin in (1, 2, 4, 8):
                if (run.motion.frames - 1) // thin < 16:
                    continue
                accuracy = replace(run.accuracy, numbers=numbers, decimation=thin)
                chosen = replace(run, accuracy=accuracy)
                spent = time_repeatedly(partial(record, chosen, path, solids=solids), 0.0, least=2)
                error = measure_fit(at, end, (run.motion.frames - 1) // thin, order).error + (6e-8 if numbers == "float32" else 0.0)
                note = f"{path.stat().st_size / 1e6:.2f} MB"
                here = (numbers, thin) == (run.resolved_accuracy.numbers, run.accuracy.decimation)
                options = {"numbers": numbers, "decimation": thin}
                words = "every frame" if thin == 1 else f"every {thin} frames"
                yield _at("recording", numbers, words, options, error, spent, current=here, note=note)


def _profiles(run: Run, budget: float) -> Iterator[PrecisionPoint]:
    """Points for the number of vertices of cam profiles: largest distance between polygon and profile, relative to the mechanism's
    size."""
    cams, size = planar_cams(run), run.motion.model.length_scale

    def draw(count: int) -> list[Any]:
        return [profile_points(placed, count) for placed in cams]

    for count in sorted({90, 180, 360, 720, 1080, 2160, 4320, run.resolved_accuracy.profile or PROFILE_POINTS}):
        worst = max(profile_deviation(placed.contour, count) for placed in cams) / size
        spent = time_repeatedly(partial(draw, count), budget)
        here = count == run.resolved_accuracy.profile
        yield _at("cam profile", "points of the contour", f"{count} points", {"profile": count}, worst, spent, current=here)


PROCESSOR_SHARE = 0.8  # ratio of processor time to wall time below which other programs disturbed the measurement


@dataclass(frozen=True)
class MeasuredStudy:
    """The points of a study with the scene, machine and day that they belong to.

    ``rough``: measured with few repeats; ``share``: ratio of processor time to wall time (0 to 1).
    """

    scene: str
    machine: str
    day: str
    points: tuple[PrecisionPoint, ...]
    rough: bool = False
    share: float = 1.0

    @property
    def foot(self) -> str:
        """When, where and how the study was measured, in one line."""
        words = f"measured {self.day} on {self.machine}; one thread, medians"
        words += " of few repeats" if self.rough else ""
        if self.share < PROCESSOR_SHARE:
            words += f"; rough: others had {100.0 * (1.0 - self.share):.0f} % of the time on this processor"
        return words


def _folder() -> Path:
    base = os.environ.get("MECHVIZ_CACHE") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "mechviz" / "accuracy"


def _file(scene: Scene, target: float | None) -> Path:
    files = {name: hashlib.sha256(data).hexdigest() for name, data in scene.files.items()}
    text = json.dumps([scene.to_toml(), files, package_version(), machine(), target, _code()])
    return _folder() / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}.json"


def _code() -> float:
    """Time of the last change of the program's source [s]. A study belongs to one state of the program."""
    roots = [Path(mechcore.__file__).parent, Path(__file__).parents[2]]
    return max(f.stat().st_mtime for root in roots for f in root.rglob("*.py"))


def load_study(scene: Scene, target: float | None, rough: bool = True) -> MeasuredStudy | None:
    """The stored study of this scene on this machine, or None. ``rough``: accept one with few repeats."""
    try:
        data: dict[str, Any] = json.loads(_file(scene, target).read_text(encoding="utf-8"))
        points = tuple(PrecisionPoint(**p) for p in data["points"])
        measured = MeasuredStudy(data["scene"], data["machine"], data["day"], points, data["rough"], data["share"])
    except (OSError, ValueError, KeyError, TypeError):  # no such file, or another format
        return None
    return measured if rough or not measured.rough else None


def store_study(
    scene: Scene, target: float | None, points: list[PrecisionPoint], rough: bool = False, share: float = 1.0
) -> MeasuredStudy:
    """Store a study in the cache folder, and return it. Where the folder cannot be written, it is not stored."""
    measured = MeasuredStudy(scene.name, machine(), date.today().isoformat(), tuple(points), rough, share)
    data = {**asdict(measured), "points": [p.as_dict() for p in points]}
    try:
        path = _file(scene, target)
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(".part")
        temporary.write_text(json.dumps(data, indent=1).replace("Infinity", "1e999"), encoding="utf-8")
        temporary.replace(path)
    except OSError:
        pass  # it is measured again next time
    return measured
