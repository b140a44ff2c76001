"""Errors that the program states of its own results: at the frames, of the integrator, between the frames, all relative; and
whether the results can be trusted.

- Positions: the residual of the loops, and the rounding that it cannot show, times the condition of the groups. Velocities and
  accelerations are those of the place where the frame is instead; reactions are solved with the transposed matrices, and small ones
  have the rounding of the largest force.
- Motion under forces: its distance from a companion, the same motion with a hundredth of the tolerance; of a motion that its energy
  gave, from collocation at its tightest. Extrapolating from a looser companion is wrong by up to a hundred, as the error does not
  follow the tolerance so well. The companion starts from the motion that it judges (`refine`), which makes it
  cheap, but does not believe it: it solves the equations of motion themselves, evaluated anew, by a rule with other nodes and of a
  higher order, on windows that the last coefficients of its own series have to allow, from the given start to the end; events are
  looked for anew, and tables are made anew. Newton's method forgets where it started: from a motion that was falsified it comes to
  the same solution, and then shows the error of the false one. Both share errors that no tolerance reduces: the model, and the
  rounding of the same formulas. A vibration that was stepped over, because it is smaller than the tolerance, counts in full.
- Discontinuities: an angle that goes on by a turn more or less than its rates say is counted in full. Half of what is missing in
  the balance of energies is an error of the rates, and so of the positions.
- Between frames: every second frame interpolated from the others; the error of half the distance follows from the order that the
  error at twice and four times the distance shows around there, at most that of the interpolation: where frames lie next to a
  singular position, what is left of their digits does not get better with their number. Values that have a pole between two frames
  are stated as they are a hundredth of the distance beside it (see `poles`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Real
from mechcore.constants import TURN
from mechcore.errors import Fault, MechanismError
from mechcore.motion.motion import Motion
from mechcore.numerics.interpolation import between, differentiate
from mechcore.records import dataclass
from mechviz.accuracy.quantities import (
    CheckedQuantity,
    Passage,
    each_quantity,
    pace_of_rest,
    passages_of,
    reactions,
    size_at,
    stands_still,
)
from mechviz.quantities.items import ERROR_COLUMNS

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechviz.runs import Run

ROUNDING = 2.2e-16
FORCE_ROUNDINGS = 4.0  # roundings of the largest force on the way to a small one
SMALL_FORCE = 1e-9  # of the largest force: what is smaller is rounding
LARGEST_CONDITION = 1e6  # beyond it the branch on both sides gives the frame
COMPANION_TOLERANCE = 0.01  # tolerance of the companion of a motion under forces
LEAST_TOLERANCE = 1e-13
SAMPLED_FRAMES = 257  # frames at which a companion is compared
QUADRATURE_ERROR = 1e-4  # of the largest energy: less may be missing in the works, where contacts are stiff, and not in the motion
UNSURE_TURN = 2.0  # [rad] that an angle may go from a frame to the next for a lost turn to be distinguished from a motion
PLACES_AROUND = 1  # places at four times the distance, on both sides, that show how errors fall


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """Estimates (F,) at every frame, relative to the mechanism's size or the peak of the quantity; NaN where there is nothing."""

    position: Real
    velocity: Real
    acceleration: Real
    reaction: Real
    between: Real  # the largest of all quantities from each frame to the next, read with the run's interpolation
    order: int

    def table(self) -> Real:
        """The columns (F, 5)."""
        return np.column_stack([self.position, self.velocity, self.acceleration, self.reaction, self.between])

    def worst(self) -> dict[str, float]:
        """The largest estimate of each column that has one."""
        columns = zip(ERROR_COLUMNS, self.table().T, strict=True)
        return {name: float(np.nanmax(values)) for name, values in columns if np.isfinite(values).any()}


def estimate_errors(run: Run) -> ErrorEstimate:
    """The estimates of a run, from what it has computed; of a motion under forces also from a companion."""
    motion = run.motion
    condition = np.minimum(np.nan_to_num(np.asarray(motion.condition, float), nan=np.inf), LARGEST_CONDITION)
    size = motion.model.length_scale
    position = condition * (np.asarray(motion.closure) / size + ROUNDING * _travel(motion, size))
    if run.accuracy.differentiation == "exact":
        bend = 1.0 + _bend(motion)
        velocity, acceleration = position * bend, position * bend * bend
    else:
        velocity, acceleration = (np.full(motion.frames, e) for e in _difference_errors(run))
    reaction = np.full(motion.frames, np.nan)
    if run.forces is not None:
        reaction = condition * (np.abs(np.nan_to_num(run.forces.power_balance)) + ROUNDING) + acceleration + _cancelled(run)
        if run.forces.friction is not None:
            reaction = reaction + np.nan_to_num(_friction_residual(run))
    if run.simulation is not None and run.again is not None:
        error = np.maximum(integration_error(run.simulation, motion.time, run.again), _unbalanced(run))
        position, velocity = position + error, velocity + error
        acceleration, reaction = acceleration + error, reaction + error
        amplitude, frequency = run.simulation.unseen
        if amplitude:
            omega = 2.0 * np.pi * frequency
            fast = [amplitude * omega**k / max(peak, 1e-300) for k, peak in enumerate(_peaks(motion), 1)]
            velocity, acceleration, reaction = velocity + fast[0], acceleration + fast[1], reaction + fast[1]
    lost = lost_turns(motion)
    position, reaction = position + lost, reaction + lost
    order = run.accuracy.interpolation
    apart = interpolation_error(each_quantity(motion, run.forces), motion.time, order, passages_of(motion))
    return ErrorEstimate(position, velocity, acceleration, reaction, apart, order)


def lost_turns(motion: Motion) -> Real:
    """Whole turns [rad] by which angles of links and coordinates of joints have jumped until each frame (F,), the largest of all:
    where one goes on by a turn more or less than its rates at both frames say. Loads by such an angle are wrong from there on."""
    worst, step = np.zeros(motion.frames), np.diff(motion.time)
    rows = [motion.coordinate(c.name).T for c in motion.model.connections]
    rows += [np.stack([x(k)[:, 2] for x in (motion.pose, motion.velocity, motion.acceleration)]) for k in motion.model.links[1:]]
    for q, v, a in rows:
        with np.errstate(invalid="ignore"):
            gone = step * (0.5 * (v[1:] + v[:-1]) - step / 12.0 * np.diff(a))
            missing = np.diff(q) - gone
            turns = np.round(missing / TURN)
            unsure = np.abs(missing - TURN * turns) + step * (np.abs(v[1:]) + np.abs(v[:-1])) > UNSURE_TURN
        jumps = np.nan_to_num(np.where(unsure, 0.0, turns))
        worst[1:] = np.maximum(worst[1:], TURN * np.abs(np.cumsum(jumps)))
    return worst


def _unbalanced(run: Run) -> Real:
    """Error of a motion under forces by its balance of energies (F,), largest so far: rates are off by at least half
    of what is missing, relative to the largest change of an energy. A force that jumps without a reason shows here."""
    assert run.simulation is not None
    kinetic, potential, work, lost = run.simulation.energies(np.append(run.simulation.start, run.motion.time)).T
    total = kinetic + potential - work + lost
    size = max(float(np.abs(x).max()) for x in (kinetic, potential - potential[0], work, lost))
    missing = np.nan_to_num(np.abs(total[1:] - total[0])) / max(size, 1e-300)
    return np.asarray(0.5 * np.maximum.accumulate(np.where(missing > QUADRATURE_ERROR, missing, 0.0)))


def _travel(motion: Motion, size: float) -> Real:
    """How large the numbers are that positions come from (F,): far from the origin and after many turns digits are lost."""
    far = np.ones(motion.frames)
    for link in motion.model.links[1:]:
        pose = motion.pose(link)
        far = np.maximum(far, np.maximum(np.abs(pose[:, :2]).max(axis=1) / size, np.abs(pose[:, 2])))
    return far


def _bend(motion: Motion) -> float:
    """How much rates change where positions change by one: largest acceleration over the square of the largest velocity, lengths in
    sizes of the mechanism. A frame that is misplaced has the rates of another place. 1 where nothing moves."""
    speed, acceleration = _peaks(motion)
    return acceleration / speed**2 if speed > 0.0 else 0.0


def _peaks(motion: Motion) -> tuple[float, float]:
    """Largest velocity and acceleration, lengths in sizes of the mechanism; where nothing moves, those of `quantities`."""
    if stands_still(motion):
        pace = pace_of_rest(motion)
        return pace, pace * pace
    size = motion.model.length_scale
    speed = acceleration = 0.0
    for link in motion.model.links[1:]:
        for k in (0, 1, 2):
            unit = 1.0 if k == 2 else size
            speed = max(speed, float(np.nanmax(np.abs(motion.velocity(link)[:, k]), initial=0.0)) / unit)
            acceleration = max(acceleration, float(np.nanmax(np.abs(motion.acceleration(link)[:, k]), initial=0.0)) / unit)
    return speed, acceleration


def _cancelled(run: Run) -> float:
    """Rounding of the largest force or moment, seen from reactions and efforts that are much smaller: relative to their own peaks
    it is large. Values below a billionth are rounding only: their error is their size.
    """

    def peak(values: Real) -> float:
        return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))

    assert run.forces is not None
    loads = [(peak(v[:, :2]), peak(v[:, 2])) for v in (load.values for load in run.forces.loads.values())]
    peaks = [(q.name.startswith("reaction"), q.scale, peak(q.values)) for q in reactions(run.motion, run.forces)]
    force = max([*(own for is_force, _, own in peaks if is_force), *(pull for pull, _ in loads)], default=0.0)
    moments = [*(own for is_force, _, own in peaks if not is_force), *(turn for _, turn in loads)]
    moment = max([*moments, force * run.motion.model.length_scale])
    worst = 0.0
    for is_force, scale, own in peaks:
        largest = force if is_force else moment
        if own > SMALL_FORCE * largest:
            worst = max(worst, FORCE_ROUNDINGS * ROUNDING * largest / scale)
        elif scale > 10.0 * own:  # else it is compared with itself
            worst = max(worst, own / scale)
    return worst


def _friction_residual(run: Run) -> Real:
    forces = run.forces
    friction = getattr(forces, "friction", None)
    residual = getattr(friction, "residual", None)
    return np.zeros(run.motion.frames) if residual is None else np.asarray(residual)


def _difference_errors(run: Run) -> tuple[float, float]:
    """Errors of rates by differences: those with twice the distance of frames beside them, by the order of the method."""
    motion, accuracy = run.motion, run.accuracy
    drawn = accuracy.differentiation == "graphical"
    order = 2 if drawn else accuracy.differences
    out = []
    for derivative in (1, 2):
        worst = 0.0
        for link in motion.model.links[1:]:
            values = motion.pose(link)[:, 2]
            one = differentiate(motion.time, values, order, derivative)[::2]
            two = differentiate(motion.time[::2], values[::2], order, derivative)
            peak = float(np.abs(one).max(initial=0.0))
            if peak > 0.0:
                worst = max(worst, float(np.abs(one - two).max()) / peak / (2.0**order - 1.0))
        out.append(worst + (accuracy.resolution * 4.0**derivative if drawn else 0.0))
    return out[0], out[1]


def interpolation_error(every: Iterable[CheckedQuantity], time: Real, order: int, passages: Sequence[Passage] = ()) -> Real:
    """Estimated error of the interpolation from each frame to the next (F,), the largest of all quantities; ``passages`` of
    singular positions between the frames. See the module."""
    frames = len(time)
    if frames < 9:
        return np.full(frames, np.nan)
    worst = np.zeros(frames)
    for q in every:
        twice, four = (_left_out(q, time, order, step) for step in (2, 4))
        if not (np.isfinite(twice).any() and np.isfinite(four).any()):
            continue
        local = np.nan_to_num(twice) / _gain(twice, four, order)
        each = np.interp(np.arange(frames), np.arange(1, 1 + 2 * len(local), 2)[: len(local)], local)
        worst = np.maximum(worst, np.maximum(each, local.max() * 1e-3 if len(local) else 0.0))
        for passage in passages:
            worst[passage.frame] = max(worst[passage.frame], size_at(passage, q))
    return worst


def _gain(twice: Real, four: Real, order: int) -> Real:
    """By what half the distance makes errors smaller at the places of ``twice`` (n,), from those at twice that (m,) around there;
    next to the ends, where polynomials are one-sided and errors of different distances say little of each other, on the whole."""
    twice, four = np.nan_to_num(twice), np.nan_to_num(four)
    places = np.minimum(np.arange(len(twice)) // 2, len(four) - 1)
    around, other = _largest_around(twice, 2 * PLACES_AROUND), _largest_around(four, PLACES_AROUND)[places]
    edge = order // 2 + 1
    for part in (slice(None, edge), slice(-edge, None)):
        around[part], other[part] = twice.max(), four.max()
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.clip(np.where(around > 0.0, other / around, 1.0), 1.0, 2.0 ** (order + 1)))


def _largest_around(x: Real, reach: int) -> Real:
    """Largest of the neighbours within a reach on both sides (n,)."""
    return np.array(np.lib.stride_tricks.sliding_window_view(np.pad(x, reach), 2 * reach + 1).max(axis=1))


def _left_out(q: CheckedQuantity, time: Real, order: int, step: int) -> Real:
    """Relative errors at the frames half way between every ``step``-th frame, interpolated from those."""
    frames = len(time)
    last = (frames - 1) // step * step
    keep = np.arange(0, last + 1, step)
    middle = keep[:-1] + step // 2
    if len(keep) < order + 2:
        return np.full(1, np.nan)
    rate = None if q.rate is None else q.rate[keep]
    second = None if q.second is None else q.second[keep]
    t = time[middle] if order else time[keep[1:]] - 1e-9 * (time[1] - time[0])
    truth = q.values[middle] if order else q.values[keep[1:]]
    error = np.abs(between(time[keep], q.values[keep], t, order, rate, second) - truth)
    return np.asarray(np.max(error, axis=1) / q.scale)


_companions: WeakKeyDictionary[Callable[..., Simulation], WeakKeyDictionary[Simulation, Simulation | None]] = WeakKeyDictionary()
"""The motion that each run was compared with, kept as long as the run lives: long ones take hundreds of megabytes."""


def _companion(simulation: Simulation, simulate: Callable[..., Simulation]) -> Simulation | None:
    """The same motion with a hundredth of the tolerance, made once; None where it does not come through."""
    known = _companions.setdefault(simulate, WeakKeyDictionary())
    if simulation not in known:
        known[simulation] = _tighter(simulation, simulate)
    return known[simulation]


def _tighter(simulation: Simulation, simulate: Callable[..., Simulation]) -> Simulation | None:
    try:
        if simulation.method == "energy":
            return simulate(LEAST_TOLERANCE, "gauss", simulation)
        method = "radau" if simulation.method == "radau" else None
        return simulate(
            max(COMPANION_TOLERANCE * simulation.tolerance, 4.0 * simulation.unseen[0], LEAST_TOLERANCE), method, simulation
        )
    except MechanismError:
        return None


def integration_error(simulation: Simulation, time: Real, simulate: Callable[..., Simulation]) -> Real:
    """Estimated error (F,) of a motion under forces: largest so far of all links, angles in radians, lengths in sizes of the
    mechanism; NaN where no companion comes through. Rates are about as wrong, relative to their peaks, but for impacts.

    ``simulate`` makes the motion with a given tolerance and, where the energy gave it, by a given method.
    """
    companion = _companion(simulation, simulate)
    if companion is None:
        return np.full(len(time), np.nan)
    some = np.unique(np.linspace(0.0, simulation.duration, SAMPLED_FRAMES))
    some = some[some <= companion.duration]
    apart = poses_apart(simulation.view(some), companion.view(some))
    return np.asarray(np.interp(time, some, np.maximum.accumulate(np.nan_to_num(apart))) + ROUNDING + simulation.unseen[0])


def poses_apart(one: Motion, other: Motion) -> Real:
    """Largest distance (F,) of the links in two motions at the same times, lengths in sizes of the mechanism, angles in radians."""
    worst = np.zeros(one.frames)
    for link in one.model.links[1:]:
        error = np.abs(one.pose(link) - other.pose(link))
        worst = np.maximum(worst, np.maximum(error[:, :2].max(axis=1) / one.model.length_scale, error[:, 2]))
    return worst


LARGEST_ERROR = 0.1  # estimated, relative; of all but what is read between frames


def check_finite(run: Run) -> None:
    """Refuses a run whose loads are not finite where nothing jams. Raises `MechanismError` with each of them."""
    if run.forces is None:
        return
    moves, time, faults = _moves(run), run.motion.time, []
    stated = {f"links.{x.links[0]}" if x.kind == "gravity" else f"loads.{name}": x.values for name, x in run.forces.loads.items()}
    inertia = {f"links.{link}": run.forces.inertia(link) for link in run.motion.model.links}
    for what, known in (("force", stated), ("inertia force", inertia)):
        for path, values in known.items():
            lost = np.flatnonzero(moves & ~np.isfinite(values[:, :3]).all(axis=1))
            if len(lost):
                words = f"its {what} is no finite number at {len(lost)} of {len(time)} frames, first at {time[lost[0]]:.6g} s."
                faults.append(Fault(path, words, "Check its values: one of them is beyond what can be computed with."))
    if faults:
        raise MechanismError(faults)


def accuracy_warnings(run: Run, *, errors: bool = False) -> list[str]:
    """Why the results of a run cannot be trusted, a sentence each; none where they can. ``errors``: also where its estimated errors
    are large, which of a motion under forces takes a second run."""
    moves = _moves(run)
    sums = (health.warning(moves) for health in run.catalogue.health)
    return [*filter(None, sums), *(_large_errors(run) if errors else ())]


def _large_errors(run: Run) -> Iterator[str]:
    for name, error in run.errors.worst().items():
        if name != "between_frames" and not error < LARGEST_ERROR and not np.isnan(error):
            yield f"the estimated error of the {name} is {error:.2g} of its largest value."


def _moves(run: Run) -> NDArray[np.bool_]:
    """Frames (F,) at which nothing jams."""
    friction = None if run.forces is None else run.forces.friction
    jammed = np.zeros(len(run.motion.time), bool) if friction is None else np.asarray(friction.jammed)
    return ~jammed
