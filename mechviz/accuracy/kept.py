"""Accuracy of what is drawn and kept of a run: facets, points of cam profiles, digits, frames with pictures; and in words whether
a wanted error is reached and what is in the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mechcore.accuracy import Accuracy
from mechcore.arrays import Real
from mechviz.accuracy.estimate import integration_error
from mechviz.accuracy.fit import MOST, MOST_FRAMES, MOST_POSES, Fit
from mechviz.accuracy.quantities import Quantity, quantities

if TYPE_CHECKING:
    from mechviz.runs import Run

FINEST = 1e-5
"""Of the mechanism's size: meshes get no finer by themselves. It is a twenty-fifth of a pixel where the mechanism fills a screen of
4,000; meshes are kept in float32, and below that their facets cost far more than everything else."""

PROFILE = 1080  # points of a cam's profile where nothing else is asked for
MOST_POINTS = 20_000
PICTURES_A_CYCLE = 720
"""Arrows are for looking: where a cycle has more frames than this, not every frame gets its own."""
SHARE = 0.1  # of the target for the digits: the frames have the rest, see `fit`
SINGLE = 2.0**-24  # largest relative error of a number that is rounded to float32


def kept_dials(run: Run) -> Accuracy:
    """The run's dials with chord [m], profile, numbers and pictures as they follow from its target."""
    dials = run.accuracy
    filled: dict[str, Any] = {}
    if dials.target is None:
        filled = {"profile": dials.profile or PROFILE, "numbers": dials.numbers or "float64"}
        return replace(dials, **filled)
    chord = dials.chord if dials.chord is not None else max(dials.target, FINEST) * run.motion.model.length_scale
    every = quantities(run.motion, run.forces)
    return replace(
        dials,
        chord=float(np.clip(chord, 1e-9, 1.0)),
        profile=dials.profile or _points(run, chord),
        numbers=dials.numbers or _digits(every, dials.target, balanced=run.forces is not None),
        pictures=dials.pictures or _pictures(every, run.motion, dials.target, dials.decimation),
    )


def rounding(every: Sequence[Quantity]) -> float:
    """The largest relative error that rounding to float32 makes of quantities."""
    sizes = [float(np.abs(q.values[np.isfinite(q.values)]).max(initial=0.0)) / q.scale for q in every]
    return SINGLE * max(sizes, default=0.0)


def _digits(every: Sequence[Quantity], target: float, *, balanced: bool) -> Literal["float64", "float32"]:
    """float32 where its rounding is a tenth of the target at most. Not where there are forces: readers of recordings check
    that every link is in balance to 1e-8, which float32 is not."""
    return "float32" if not balanced and rounding(every) <= SHARE * target else "float64"


def plain_stride(motion: Any) -> int:
    """Every how many frames arrows are drawn where nothing else is asked for: all up to 720 frames a cycle of the first drive."""
    if motion.frames < 2:
        return 1
    step = float(np.ptp(motion.time)) / (motion.frames - 1)
    frames_a_cycle = motion.mechanism.cycle / step if step > 0 else 1.0
    return max(1, int(frames_a_cycle / PICTURES_A_CYCLE))


def _pictures(every: Sequence[Quantity], motion: Any, target: float, thin: int) -> int:
    """Every so many recorded frames have pictures: as few as joined by straight lines stay within the target, the last one among
    them; not fewer than without a target, as viewers hold the last picture while the mechanism moves on."""
    time = motion.time
    last = (len(time) - 1) // thin
    best = 1
    for stride in range(2, min(last // 2, plain_stride(motion) // thin) + 1):
        if last % stride == 0:
            if not _joined(every, time, stride * thin, last * thin, target):
                break
            best = stride
    return best


def _joined(every: Sequence[Quantity], time: Real, step: int, last: int, target: float) -> bool:
    """Whether straight lines between every ``step``-th frame are within the target at all frames in between, up to ``last``."""
    nodes, frames = np.arange(0, last + 1, step), np.arange(last + 1)
    for q in every:
        values = q.values.reshape(len(q.values), -1)
        if q.turns:  # what is drawn on a link that turns goes along an arc
            values = np.column_stack([np.cos(values), np.sin(values)])
        joined = np.column_stack([np.interp(time[frames], time[nodes], column[nodes]) for column in values.T])
        miss = np.abs(joined - values[frames])
        if not float(np.nanmax(miss, initial=0.0)) <= target * q.scale:
            return False
    return True


def _points(run: Run, chord: float) -> int:
    """Points with which the profiles of all planar cams are within ``chord`` [m]: their error falls with their square."""
    contours = [p.contour for p in plane_cams(run)]
    if not contours:
        return PROFILE
    count = 360
    for _ in range(4):
        away = max(profile_away(c, count) for c in contours)
        wanted = int(np.ceil(count * 1.05 * np.sqrt(away / (0.9 * chord))))
        if 0.5 * chord <= away <= 0.95 * chord or (away <= chord and count <= 180) or count >= MOST_POINTS:
            break
        count = int(np.clip(wanted, 180, MOST_POINTS))
    return count


def plane_cams(run: Run) -> list[Any]:
    """The planar cams of a run, second ones of conjugate pairs among them: those that have a contour."""
    placed = [p for r in run.compiled.model.relations for p in (r.geometry, getattr(r.geometry, "mate", None))]
    return [p for p in placed if getattr(p, "contour", None) is not None]


def profile_away(contour: Any, count: int) -> float:
    """How far a profile with so many points is from the contour that they lie on [m]: half way between them."""
    each = max(count // contour.count, 8)
    t = np.arange(2 * contour.count * each + 1) / (2 * each)
    z = np.asarray(contour(t)[0])
    a, b, middle = z[:-1:2], z[2::2], z[1::2]
    return float(np.max(np.abs(np.imag((middle - a) * np.conj(b - a))) / np.maximum(np.abs(b - a), 1e-300)))


ORDERS = {0: "held values", 1: "straight lines", 3: "cubics", 5: "quintics"}
"""How frames are joined, by the order of the interpolation."""


def target_words(run: Run) -> list[str]:
    """Lines of a run that has a target."""
    target = run.accuracy.target
    assert target is not None
    motion = [] if run.simulation is None else [_motion(run, target)]
    return [_frames(run, target), *motion, _kept(run, target)]


def _frames(run: Run, target: float) -> str:
    order, fit = ORDERS[run.accuracy.interpolation], run.fit
    if fit is None:
        stated, worst = run.motion.frames - 1, float(np.nanmax(run.errors.between, initial=0.0))
        start = f"accuracy {target:g} with the {stated} frames that are stated, joined by {order}: "
        if worst <= target:
            return start + "reached between the frames"
        return f"warning: {start}not reached: about {worst:.1e} is left between frames. Leave the number of frames to the accuracy."
    start = f"accuracy {target:g} with {fit.frames} frames joined by {order}: "
    jumps = ""
    if fit.jumps and fit.there > target:
        holds = f"{fit.jumps} intervals that hold" if fit.jumps > 1 else "one interval that holds"
        jumps = f", but in {holds} a jump or a bend: up to {fit.there:.1e} of the peak is left there, and more frames hardly help"
    if fit.error <= target:
        return f"{start}reached{jumps}"
    missed = f"warning: {start}not reached: {fit.error:.1e} is left between frames"
    if fit.needed is None:
        return f"{missed}, and more frames do not help: it is rounding{_besides(fit)}. Ask for a larger error."
    remedy = "Ask for a larger error."
    if run.accuracy.interpolation < 5:
        remedy = 'Choose interpolation = "quintic", or ask for a larger error.'
    most = f"{MOST} a cycle, {MOST_FRAMES} in all, {MOST_POSES} of all links"
    return f"{missed}; about {fit.needed} frames would be needed, and no more than {most} are computed{_besides(fit)}. {remedy}"


def _besides(fit: Fit) -> str:
    """Where interpolation is not exact in any case."""
    return f"; {fit.jumps} intervals besides hold a jump or a bend, with up to {fit.there:.1e} of the peak" if fit.jumps else ""


def _motion(run: Run, target: float) -> str:
    """Error of the integration, by its companion."""
    assert run.simulation is not None
    left = float("nan")
    if run.again is not None:
        left = float(integration_error(run.simulation, np.array([run.simulation.duration]), run.again)[0])
    if left <= target:
        return f"motion under forces: within {left:.1e}, by a run with another tolerance"
    if np.isnan(left):
        return "warning: motion under forces: no second run comes through that would tell its error"
    words = f"warning: motion under forces: about {left:.1e} is left, and smaller tolerances do not help: its positions part from"
    return f"{words} their neighbours, rounding with them. Ask for a larger error, or a shorter duration."


def _kept(run: Run, target: float) -> str:
    kept = run.kept
    assert kept.chord is not None
    relative = kept.chord / run.motion.model.length_scale
    finer = "" if relative <= target * (1 + 1e-9) else f", no finer than {FINEST:g} of the size unless chord says so"
    forces = " (links are to be in balance to 1e-8)" if run.forces is not None and kept.numbers == "float64" else ""
    every = "every recorded frame" if kept.pictures == 1 else f"every {kept.pictures}th recorded frame"
    chord = run.scene.units.show(kept.chord, "length", 3)
    return f"drawn and kept: facets within {chord}{finer}; numbers in {kept.numbers}{forces}; arrows at {every}"
