"""How many frames, and how small a tolerance, a wanted error needs: found by measuring, not by guessing.

A run of N frames is compared with the motion itself half way between them; the error of an interpolation of order p falls as
N^-(p+1), so that a few runs lead to the number of frames that is just enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechcore.accuracy import Accuracy
from mechcore.arrays import Real
from mechcore.forces.kinetostatics import solve_forces
from mechcore.motion.solve import compile_mechanism, default_times, solve_motion
from mechviz.accuracy.estimate import integration_error
from mechviz.accuracy.quantities import Quantity, errors_between, quantities
from mechviz.scene.limits import check_frames

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechviz.scene.scene import Scene


Provider = Callable[[Real], list[Quantity]]

FEWEST, MOST = 16, 200_000  # frames a cycle
MOST_FRAMES = 1_000_000  # of a run
MOST_POSES = 2_000_000  # frames of all links: a gigabyte
ROUNDS = 7
SHARE = 0.9  # of the wanted error for the frames: digits and tolerances have the rest
NEAR = 0.25  # of that: nearer than this is near enough
STANDS_OUT = 30.0  # times the errors around it: an interval that holds a jump or a bend
MOST_LEFT_OUT = 0.1  # of the intervals: where jumps are closer to each other, more frames tell them apart
WORTH = 16.0  # times as many frames for what stands out, at most
SLOWEST = 0.7  # order by which its error has to fall: that of a bend is 1, that of a jump 0
ENOUGH = 1e-13  # rounding
NEARLY_ROUNDING = 1e-9  # where reactions of ill-conditioned positions may lie


@dataclass(frozen=True)
class Fit:
    """Frames over the whole run, the largest relative error between them, and how many jumps and bends there are, where no number
    of frames helps: their intervals are left out of the error, ``left_out`` of all (0 to 1), with errors of up to ``there``.
    ``needed``: frames that would do where these do not."""

    frames: int
    error: float
    jumps: int
    needed: int | None = None
    there: float = 0.0
    left_out: float = 0.0


def provider(scene: Scene, accuracy: Accuracy, simulation: Simulation | None = None) -> Provider:
    """Quantities of a scene's motion at any times, with forces where it has some."""
    with_forces = bool(scene.mechanism.effects or scene.mechanism.loads)
    if simulation is not None:

        def simulated_at(t: Real) -> list[Quantity]:
            motion = simulation.view(t)
            return quantities(motion, simulation.forces(motion) if with_forces else None)

        return simulated_at
    exact = accuracy if accuracy.differentiation == "exact" else replace(accuracy, differentiation="exact")
    compiled = compile_mechanism(scene.mechanism, exact)

    def at(t: Real) -> list[Quantity]:
        motion = solve_motion(compiled, t)
        return quantities(motion, solve_forces(motion) if with_forces else None)

    return at


def duration(scene: Scene, simulation: Simulation | None = None) -> float:
    """How long a scene's run takes [s]."""
    if simulation is not None:
        return simulation.duration
    return float(default_times(scene.mechanism, 1, scene.cycles)[-1])


def achieved(at: Provider, end: float, frames: int, order: int) -> Fit:
    """The error of a run of some frames (over ``end`` [s]) between its frames, where it is largest: half way, or at their end."""
    time = np.linspace(0.0, end, frames + 1)
    probe = time[:-1] + (0.5 if order else 1.0 - 1e-6) * np.diff(time)
    whole = at(np.sort(np.concatenate([time, probe])))
    coarse = [_rows(q, slice(0, None, 2)) for q in whole]
    fine = [_rows(q, slice(1, None, 2)) for q in whole]
    errors = errors_between(coarse, time, fine, probe, order)
    worst = np.nan_to_num(np.max([*errors.values()], axis=0)) if errors else np.zeros(frames)
    bad = stand_out(worst)
    jumps = int(np.count_nonzero(np.diff(np.concatenate([[0], bad.astype(int)])) == 1))
    there = float(np.max(worst[bad], initial=0.0))
    return Fit(frames, float(np.max(worst[~bad], initial=0.0)), jumps, there=there, left_out=float(np.mean(bad)))


def _rows(q: Quantity, rows: Any) -> Quantity:
    return replace(
        q,
        values=q.values[rows],
        rate=None if q.rate is None else q.rate[rows],
        second=None if q.second is None else q.second[rows],
    )


def stand_out(errors: Real) -> NDArray[np.bool_]:
    """Intervals whose error is far above that of those around, with the two on either side that interpolation spoils too."""
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
    """The number of frames with which interpolation of the accuracy's order stays within its target, and not far below.

    Where even the largest number does not do, it is that number, with an estimate of what would be needed; where rounding is in the
    way, the last number that helped.
    """
    assert accuracy.target is not None
    at, end, order = provider(scene, accuracy, simulation), duration(scene, simulation), accuracy.interpolation
    parts = scene.cycles if simulation is None else 1
    goal = max(SHARE * accuracy.target, ENOUGH)
    frames, best, crowded = 48 * parts, None, None
    links = len(scene.mechanism.links)
    check_frames(links, frames)
    most = min(MOST * parts, MOST_FRAMES, MOST_POSES // links)
    low, high = FEWEST * parts, most
    last: Fit | None = None
    for _ in range(ROUNDS):
        fit = achieved(at, end, frames, order)
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
            if fit.error >= NEAR * goal or frames <= FEWEST * parts:
                break
        else:
            low = max(low, frames + 1)
        change = 1.06 * (max(fit.error, 1e-16) / goal) ** (1.0 / (order + 1))
        if fit.error <= goal:
            change = max(change, 1.06 * dense)
        wanted = int(np.ceil(frames * float(np.clip(change, 1.0 / 12.0, 12.0))))
        if best is None and frames >= high:
            return replace(fit, needed=int(np.ceil(frames * change)))
        frames = int(np.clip(wanted, low, max(low, high)))
        if best is not None and frames >= best.frames:
            break
    chosen = best or crowded
    if chosen is None:
        return replace(fit, needed=max(frames, fit.frames + 1))
    return _past_bends(at, end, order, chosen, accuracy.target, most)


def _past_bends(at: Provider, end: float, order: int, fit: Fit, target: float, most: int) -> Fit:
    """More frames where what stands out is no jump but a bend, or a narrow peak, whose error falls with them: as many as reach the
    target there too, where that is at most `WORTH` times as many. Else the frames that were found."""
    now, limit = fit, min(most, int(WORTH * fit.frames))
    for _ in range(3):
        if now.there <= target:
            return now
        finer = achieved(at, end, min(2 * now.frames, limit), order)
        slope = np.log(max(now.there / max(finer.there, 1e-300), 1e-300)) / np.log(max(finer.frames / now.frames, 1.0 + 1e-9))
        if slope < SLOWEST:
            return fit
        wanted = int(np.ceil(now.frames * (1.1 * now.there / (SHARE * target)) ** (1.0 / slope)))
        if wanted > limit:
            return fit
        now = achieved(at, end, wanted, order)
    return now if now.there <= target else fit


def _rounding(last: Fit | None, fit: Fit, goal: float) -> bool:
    """Whether far more frames have made an error near rounding hardly any smaller."""
    return last is not None and goal < last.error < NEARLY_ROUNDING and fit.error > goal and fit.frames >= 1.3 * last.frames and (
        fit.error > last.error / 1.2
    )  # fmt: skip


def simulated(accuracy: Accuracy, simulate: Callable[..., Simulation]) -> Simulation:
    """The motion under forces with the tolerance tightened until its estimated error is within the target."""
    assert accuracy.target is not None and accuracy.integrator is not None
    tolerance = accuracy.integrator
    for _ in range(4):
        simulation = simulate(tolerance)
        error = integration_error(simulation, np.linspace(0.0, simulation.duration, 65), simulate).max(initial=0.0)
        if error <= accuracy.target or tolerance <= 1e-14:
            break
        tolerance = max(0.3 * tolerance * accuracy.target / error, 1e-14)
    return simulation
