"""Settings that a target error needs (frames, tolerance, chordal error of drawings, recorded digits), found by measurement; and, as
text, whether the target is reached and what prevents it.

A run of N frames is compared with the motion itself half way between the frames. The error of interpolation of order p falls as
N^-(p+1), so that a few runs suffice to find the smallest sufficient number of frames. Picture and recording of a run have settings
of their own: facets, points of cam profiles, digits, frames with arrows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from mechcore.accuracy import Accuracy
from mechcore.arrays import Index, Real
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.motion import Motion
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechcore.records import dataclass
from mechviz.accuracy.estimate import integration_error
from mechviz.accuracy.quantities import CheckedQuantity, measured_interpolation_errors, quantities
from mechviz.scene.limits import check_frames

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechviz.runs import Run
    from mechviz.scene.scene import Scene

QuantityFunction = Callable[[Real], list[CheckedQuantity]]

FEWEST_FRAMES, MOST_FRAMES_FITTED = 16, 200_000  # frames per cycle
MOST_FRAMES = 1_000_000  # of a run
MOST_POSES = 2_000_000  # frames times links: a gigabyte
FIT_ROUNDS = 7
FRAMES_SHARE = 0.9  # share of the target error for the frames; digits and tolerances have the rest
NEAR_ENOUGH = 0.25  # of the error allowed for the frames: the search ends above this
STANDS_OUT = 30.0  # ratio to the errors around it, above which an interval holds a jump or a bend
MOST_LEFT_OUT = 0.1  # largest fraction of intervals that are left out; closer jumps are separated by more frames
MOST_REFINEMENT = 16.0  # largest increase of the number of frames for bends
LEAST_ORDER = 0.7  # least order of convergence at a bend; a bend has order 1, a jump order 0
ENOUGH_ERROR = 1e-13  # rounding
NEARLY_ROUNDING = 1e-9  # rounding error of reactions in ill-conditioned positions, at most


@dataclass(frozen=True)
class Fit:
    """The fit of a number of ``frames`` over the whole run, with the largest relative ``error`` between them.

    ``jumps``: number of jumps and bends, where more frames hardly help. Their intervals are left out of ``error``: they are the
    fraction ``left_out`` (0 to 1) of all, with errors of up to ``jump_error``. ``needed_frames``: estimated number of frames that
    would reach the target where ``frames`` does not."""

    frames: int
    error: float
    jumps: int
    needed_frames: int | None = None
    jump_error: float = 0.0
    left_out: float = 0.0


def quantity_function(scene: Scene, accuracy: Accuracy, simulation: Simulation | None = None) -> QuantityFunction:
    """A function of times (F,) [s] that gives the quantities of a scene's motion, with forces where the scene has some."""
    with_forces = bool(scene.mechanism.effects or scene.mechanism.loads)
    if simulation is not None:

        def simulated_at(t: Real) -> list[CheckedQuantity]:
            motion = simulation.view(t)
            return quantities(motion, simulation.forces(motion) if with_forces else None)

        return simulated_at
    exact = accuracy if accuracy.differentiation == "exact" else replace(accuracy, differentiation="exact")
    compiled = compile_mechanism(scene.mechanism, exact)

    def at(t: Real) -> list[CheckedQuantity]:
        motion = solve_motion(compiled, t)
        return quantities(motion, solve_forces(motion) if with_forces else None)

    return at


def duration(scene: Scene, simulation: Simulation | None = None) -> float:
    """Duration of a scene's run [s]."""
    if simulation is not None:
        return simulation.duration
    return float(default_times(scene.mechanism, 1, scene.cycles)[-1])


def measure_fit(at: QuantityFunction, end: float, frames: int, order: int) -> Fit:
    """The error of a run of ``frames`` intervals over ``end`` [s], probed where it is largest: half way between frames, or for
    order 0 just before the next frame."""
    time = np.linspace(0.0, end, frames + 1)
    probe = time[:-1] + (0.5 if order else 1.0 - 1e-6) * np.diff(time)
    whole = at(np.sort(np.concatenate([time, probe])))
    coarse = [_rows(q, slice(0, None, 2)) for q in whole]
    fine = [_rows(q, slice(1, None, 2)) for q in whole]
    errors = measured_interpolation_errors(coarse, time, fine, probe, order)
    worst = np.nan_to_num(np.max([*errors.values()], axis=0)) if errors else np.zeros(frames)
    bad = is_outlier(worst)
    jumps = int(np.count_nonzero(np.diff(np.concatenate([[0], bad.astype(int)])) == 1))
    jump_error = float(np.max(worst[bad], initial=0.0))
    return Fit(frames, float(np.max(worst[~bad], initial=0.0)), jumps, jump_error=jump_error, left_out=float(np.mean(bad)))


def _rows(q: CheckedQuantity, rows: Index | slice) -> CheckedQuantity:
    return replace(
        q,
        values=q.values[rows],
        rate=None if q.rate is None else q.rate[rows],
        second=None if q.second is None else q.second[rows],
    )


def is_outlier(errors: Real) -> NDArray[np.bool_]:
    """Whether the error of each interval is far above those around it; includes up to two intervals on either side that
    interpolation spoils too."""
    n = len(errors)
    if n < 24:
        return np.zeros(n, bool)
    reach = min(12, n // 3)
    padded = np.pad(errors, reach, mode="reflect")
    around = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1), axis=1)
    bad = errors > np.maximum(STANDS_OUT * around, 1e-12)
    for shift in (1, 2):
        bad[shift:] |= bad[:-shift] & (errors[shift:] > 3.0 * around[shift:])
        bad[:-shift] |= bad[shift:] & (errors[:-shift] > 3.0 * around[:-shift])
    return np.asarray(bad)


def fit_frames(scene: Scene, accuracy: Accuracy, simulation: Simulation | None = None) -> Fit:
    """The number of frames with which the interpolation error is within the target of an accuracy, and not far below it.

    Where the largest possible number does not suffice, it is returned with an estimate of the number that would
    (``needed_frames``). Where rounding prevents the target, the result is the last number that reduced the error.
    """
    assert accuracy.target is not None
    at, end, order = quantity_function(scene, accuracy, simulation), duration(scene, simulation), accuracy.interpolation
    parts = scene.cycles if simulation is None else 1
    goal = max(FRAMES_SHARE * accuracy.target, ENOUGH_ERROR)
    frames, best, crowded = 48 * parts, None, None
    links = len(scene.mechanism.links)
    check_frames(links, frames)
    most = min(MOST_FRAMES_FITTED * parts, MOST_FRAMES, MOST_POSES // links)
    low, high = FEWEST_FRAMES * parts, most
    last: Fit | None = None
    for _ in range(FIT_ROUNDS):
        fit = measure_fit(at, end, frames, order)
        if _rounding(last, fit, goal):
            return last or fit
        last = fit
        dense = fit.left_out / MOST_LEFT_OUT
        if fit.error <= goal and dense > 1.0:
            low = max(low, frames + 1)
            crowded = fit
        elif fit.error <= goal:
            best = fit if best is None or fit.frames < best.frames else best
            high = min(high, frames)
            if fit.error >= NEAR_ENOUGH * goal or frames <= FEWEST_FRAMES * parts:
                break
        else:
            low = max(low, frames + 1)
        change = 1.06 * (max(fit.error, 1e-16) / goal) ** (1.0 / (order + 1))
        if fit.error <= goal:
            change = max(change, 1.06 * dense)
        wanted = int(np.ceil(frames * float(np.clip(change, 1.0 / 12.0, 12.0))))
        if best is None and frames >= high:
            return replace(fit, needed_frames=int(np.ceil(frames * change)))
        frames = int(np.clip(wanted, low, max(low, high)))
        if best is not None and frames >= best.frames:
            break
    chosen = best or crowded
    if chosen is None:
        return replace(fit, needed_frames=max(frames, fit.frames + 1))
    return _past_bends(at, end, order, chosen, accuracy.target, most)


def _past_bends(at: QuantityFunction, end: float, order: int, fit: Fit, target: float, most: int) -> Fit:
    """A fit with more frames, where an interval that stands out holds a bend or a narrow peak, whose error falls with the number of
    frames, and no jump: as many frames as reach the target there too, if at most `MOST_REFINEMENT` times as many suffice. Else the
    given fit."""
    now, limit = fit, min(most, int(MOST_REFINEMENT * fit.frames))
    for _ in range(3):
        if now.jump_error <= target:
            return now
        finer = measure_fit(at, end, min(2 * now.frames, limit), order)
        slope = np.log(max(now.jump_error / max(finer.jump_error, 1e-300), 1e-300)) / np.log(
            max(finer.frames / now.frames, 1.0 + 1e-9)
        )
        if slope < LEAST_ORDER:
            return fit
        wanted = int(np.ceil(now.frames * (1.1 * now.jump_error / (FRAMES_SHARE * target)) ** (1.0 / slope)))
        if wanted > limit:
            return fit
        now = measure_fit(at, end, wanted, order)
    return now if now.jump_error <= target else fit


def _rounding(last: Fit | None, fit: Fit, goal: float) -> bool:
    """Whether the error is near rounding and hardly falls although there are many more frames."""
    return last is not None and goal < last.error < NEARLY_ROUNDING and fit.error > goal and fit.frames >= 1.3 * last.frames and (
        fit.error > last.error / 1.2
    )  # fmt: skip


def simulate_to_target(accuracy: Accuracy, simulate: Callable[..., Simulation]) -> Simulation:
    """The motion under forces, with a tolerance that is tightened (at most three times) until the estimated error is within the
    target."""
    assert accuracy.target is not None and accuracy.integrator is not None
    tolerance = accuracy.integrator
    for _ in range(4):
        simulation = simulate(tolerance)
        error = integration_error(simulation, np.linspace(0.0, simulation.duration, 65), simulate).max(initial=0.0)
        if error <= accuracy.target or tolerance <= 1e-14:
            break
        tolerance = max(0.3 * tolerance * accuracy.target / error, 1e-14)
    return simulation


FINEST_CHORD = 1e-5
"""Smallest chordal error that a target gives, relative to the mechanism's size. It is a twenty-fifth of a pixel where the mechanism
fills a screen of 4,000. Meshes are kept in float32, and finer facets would cost far more than everything else."""

PROFILE_POINTS = 1080  # default number of points of a cam's profile
MOST_POINTS = 20_000
PICTURES_A_CYCLE = 720
"""Number of frames per cycle up to which every frame has arrows, which serve display only."""
DIGITS_SHARE = 0.1  # share of the target error for the digits; the frames have the rest, see `FRAMES_SHARE`
SINGLE_ROUNDING = 2.0**-24  # largest relative error of rounding a number to float32


def resolve_accuracy(run: Run) -> Accuracy:
    """The settings of a run, with chord [m], profile, numbers and pictures filled in from its target; without a target profile and
    numbers have their defaults."""
    settings = run.accuracy
    filled: dict[str, Any] = {}
    if settings.target is None:
        filled = {"profile": settings.profile or PROFILE_POINTS, "numbers": settings.numbers or "float64"}
        return replace(settings, **filled)
    chord = settings.chord if settings.chord is not None else max(settings.target, FINEST_CHORD) * run.motion.model.length_scale
    every = quantities(run.motion, run.forces)
    return replace(
        settings,
        chord=float(np.clip(chord, 1e-9, 1.0)),
        profile=settings.profile or _points(run, chord),
        numbers=settings.numbers or _digits(every, settings.target, balanced=run.forces is not None),
        pictures=settings.pictures or _pictures(every, run.motion, settings.target, settings.decimation),
    )


def rounding(every: Sequence[CheckedQuantity]) -> float:
    """The largest relative error of quantities by rounding to float32."""
    sizes = [float(np.abs(q.values[np.isfinite(q.values)]).max(initial=0.0)) / q.scale for q in every]
    return SINGLE_ROUNDING * max(sizes, default=0.0)


def _digits(every: Sequence[CheckedQuantity], target: float, *, balanced: bool) -> Literal["float64", "float32"]:
    """The number format: float32 where its rounding is at most a tenth of the target. With forces (``balanced``) float64, because
    readers of recordings check the equilibrium of every link to 1e-8, which float32 does not reach."""
    return "float32" if not balanced and rounding(every) <= DIGITS_SHARE * target else "float64"


def default_stride(motion: Motion) -> int:
    """Default stride of the frames with arrows: 1 up to 720 frames per cycle of the first drive (or per run, if that is
    shorter)."""
    if motion.frames < 2:
        return 1
    step = float(np.ptp(motion.time)) / (motion.frames - 1)
    frames_a_cycle = min(motion.mechanism.cycle / step, motion.frames) if step > 0.0 else 1.0
    return max(1, int(frames_a_cycle / PICTURES_A_CYCLE))


def _pictures(every: Sequence[CheckedQuantity], motion: Motion, target: float, thin: int) -> int:
    """Stride of the recorded frames with arrows: the largest one whose frames, joined by straight lines, stay within the target and
    include the last frame. It is at most the default stride, as viewers hold the last arrows while the mechanism moves on."""
    time = motion.time
    last = (len(time) - 1) // thin
    best = 1
    for stride in range(2, min(last // 2, default_stride(motion) // thin) + 1):
        if last % stride == 0:
            if not _joined(every, time, stride * thin, last * thin, target):
                break
            best = stride
    return best


def _joined(every: Sequence[CheckedQuantity], time: Real, step: int, last: int, target: float) -> bool:
    """Whether straight lines between every ``step``-th frame are within the target at all frames up to ``last``."""
    nodes, frames = np.arange(0, last + 1, step), np.arange(last + 1)
    for q in every:
        values = q.values.reshape(len(q.values), -1)
        if q.is_angle:  # points of a rotating link move on arcs
            values = np.column_stack([np.cos(values), np.sin(values)])
        joined = np.column_stack([np.interp(time[frames], time[nodes], column[nodes]) for column in values.T])
        error = np.abs(joined - values[frames])
        if not float(np.nanmax(error, initial=0.0)) <= target * q.scale:
            return False
    return True


def _points(run: Run, chord: float) -> int:
    """Number of points with which the profiles of all planar cams are within ``chord`` [m]; the error falls with the square of the
    number."""
    contours = [p.contour for p in planar_cams(run)]
    if not contours:
        return PROFILE_POINTS
    count = 360
    for _ in range(4):
        away = max(profile_deviation(c, count) for c in contours)
        wanted = int(np.ceil(count * 1.05 * np.sqrt(away / (0.9 * chord))))
        if 0.5 * chord <= away <= 0.95 * chord or (away <= chord and count <= 180) or count >= MOST_POINTS:
            break
        count = int(np.clip(wanted, 180, MOST_POINTS))
    return count


def planar_cams(run: Run) -> list[Any]:
    """The planar cams of a run, which have a contour; includes the second cams of conjugate pairs."""
    placed = [p for r in run.compiled.model.relations for p in (r.geometry, getattr(r.geometry, "mate", None))]
    return [p for p in placed if getattr(p, "contour", None) is not None]


def profile_deviation(contour: Any, count: int) -> float:
    """Largest distance [m] between a contour and the polygon through ``count`` of its points, measured half way between the
    points."""
    each = max(count // contour.count, 8)
    t = np.arange(2 * contour.count * each + 1) / (2 * each)
    z = np.asarray(contour(t)[0])
    a, b, middle = z[:-1:2], z[2::2], z[1::2]
    return float(np.max(np.abs(np.imag((middle - a) * np.conj(b - a))) / np.maximum(np.abs(b - a), 1e-300)))


ORDERS = {0: "held values", 1: "straight lines", 3: "cubics", 5: "quintics"}
"""Names of the interpolation between frames, by its order."""


def target_lines(run: Run) -> list[str]:
    """Whether a run reaches its target error, and with which settings, as lines of text. The run must have a target."""
    target = run.accuracy.target
    assert target is not None
    motion = [] if run.simulation is None else [_motion(run, target)]
    return [_frames(run, target), *motion, _outputs(run, target)]


def _frames(run: Run, target: float) -> str:
    order, fit = ORDERS[run.accuracy.interpolation], run.fit
    if fit is None:
        stated, worst = run.motion.frames - 1, float(np.nanmax(run.errors.interpolation, initial=0.0))
        start = f"accuracy {target:g} with the {stated} frames that are stated, joined by {order}: "
        if worst <= target:
            return start + "reached between the frames"
        return f"warning: {start}not reached: about {worst:.1e} is left between frames. Leave the number of frames to the accuracy."
    start = f"accuracy {target:g} with {fit.frames} frames joined by {order}: "
    jumps = ""
    if fit.jumps and fit.jump_error > target:
        holds = f"{fit.jumps} intervals that hold" if fit.jumps > 1 else "one interval that holds"
        jumps = (
            f", but in {holds} a jump or a bend: up to {fit.jump_error:.1e} of the peak is left there, and more frames hardly help"
        )
    if fit.error <= target:
        return f"{start}reached{jumps}"
    warning = f"warning: {start}not reached: {fit.error:.1e} is left between frames"
    if fit.needed_frames is None:
        return f"{warning}, and more frames do not help: it is rounding{_besides(fit)}. Ask for a larger error."
    remedy = "Ask for a larger error."
    if run.accuracy.interpolation < 5:
        remedy = 'Choose interpolation = "quintic", or ask for a larger error.'
    most, needed = f"{MOST_FRAMES_FITTED} a cycle, {MOST_FRAMES} in all, {MOST_POSES} of all links", fit.needed_frames
    return f"{warning}; about {needed} frames would be needed, and no more than {most} are computed{_besides(fit)}. {remedy}"


def _besides(fit: Fit) -> str:
    """Intervals with a jump or a bend, where interpolation is inexact in any case, in words."""
    return (
        f"; {fit.jumps} intervals besides hold a jump or a bend, with up to {fit.jump_error:.1e} of the peak" if fit.jumps else ""
    )


def _motion(run: Run, target: float) -> str:
    """Integration error, estimated with a companion run, in words."""
    assert run.simulation is not None
    left = float("nan")
    if run.resimulate is not None:
        left = float(integration_error(run.simulation, np.array([run.simulation.duration]), run.resimulate)[0])
    if left <= target:
        return f"motion under forces: within {left:.1e}, by a run with another tolerance"
    if np.isnan(left):
        return "warning: motion under forces: no second run succeeds, so that its error is unknown"
    words = f"warning: motion under forces: about {left:.1e} is left, and smaller tolerances do not help: its positions part from"
    return f"{words} their neighbours, rounding with them. Ask for a larger error, or a shorter duration."


def _outputs(run: Run, target: float) -> str:
    """Settings of drawing and recording, in words."""
    settings = run.resolved_accuracy
    assert settings.chord is not None
    relative = settings.chord / run.motion.model.length_scale
    finer = "" if relative <= target * (1 + 1e-9) else f", no finer than {FINEST_CHORD:g} of the size unless chord says so"
    forces = " (links are to be in balance to 1e-8)" if run.forces is not None and settings.numbers == "float64" else ""
    every = "every recorded frame" if settings.pictures == 1 else f"every {settings.pictures}th recorded frame"
    chord = run.scene.units.show(settings.chord, "length", 3)
    return f"drawn and kept: facets within {chord}{finer}; numbers in {settings.numbers}{forces}; arrows at {every}"
