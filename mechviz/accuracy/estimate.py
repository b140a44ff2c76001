"""Estimates of a run's own errors (at the frames, of the integrator, between the frames; all relative), and warnings where the
results cannot be trusted.

- Positions: the closure error of the loops, plus the rounding that it does not show, times the condition number of the groups. A
  misplaced frame has the velocities and accelerations of another position, so that their errors follow from that of the position.
  Reactions are solved with the transposed matrices; small reactions carry the rounding of the largest force.
- Motion under forces: the distance from a companion, which is the same motion integrated with a hundredth of the tolerance. For the
  method "energy" the companion is collocation at its tightest tolerance. Extrapolation from a looser companion is wrong by a factor
  of up to a hundred, because the error does not follow the tolerance closely. The companion starts from the motion that it checks
  (`refine`), which makes it cheap, but it does not rely on that motion: it solves the equations of motion, evaluated anew, by a
  rule with other nodes and of higher order, on windows that the last coefficients of its own series have to allow, from the given
  start to the end. Events are located anew, and tables are made anew. The solution of Newton's method does not depend on where the
  iteration starts: from a falsified motion it converges to the same solution, and then shows the error of the false one. Both
  motions share the errors that no tolerance reduces: the model, and the rounding of the same formulas. A vibration that the
  integrator stepped over, because it is smaller than the tolerance, counts in full.
- Discontinuities: an angle that jumps by whole turns against its rates counts in full. Half of the imbalance of the energies is an
  error of the rates, and so of the positions.
- Between frames: every second frame is interpolated from the others. The error at the actual spacing follows from the order of
  convergence that the errors at twice and four times the spacing show nearby, which is at most that of the interpolation. Next to a
  singular position frames have lost digits, and more frames do not reduce that error. A quantity that has a pole between two frames
  is stated with its value at a hundredth of the spacing from the pole (see `quantities`).
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
    passages_of,
    pole_size,
    reactions,
    rest_rate_scale,
    stands_still,
)
from mechviz.quantities.items import ERROR_COLUMNS

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechviz.runs import Run

ROUNDING = 2.2e-16
FORCE_ROUNDINGS = 4.0  # rounding errors of the largest force that add up in a small one
SMALL_FORCE = 1e-9  # relative to the largest force: a smaller force is rounding
LARGEST_CONDITION = 1e6  # above it the frame is interpolated from the branch on both sides
COMPANION_TOLERANCE = 0.01  # tolerance of the companion of a motion under forces, relative to that of the motion
LEAST_TOLERANCE = 1e-13
SAMPLED_FRAMES = 257  # frames at which a companion is compared
QUADRATURE_ERROR = 1e-4  # relative to the largest energy: a smaller imbalance may be quadrature error of works at stiff contacts
UNSURE_TURN = 2.0  # [rad] largest step of an angle between frames at which a lost turn can be told from a motion
PLACES_AROUND = 1  # neighbours on both sides, at four times the spacing, from which the order of convergence is taken


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """Error estimates (F,) at every frame, relative to the mechanism's size or the peak of the quantity; NaN where there is
    none."""

    position: Real
    velocity: Real
    acceleration: Real
    reaction: Real
    interpolation: Real  # largest of all quantities between each frame and the next, read with the run's interpolation
    order: int

    def table(self) -> Real:
        """The estimates as columns (F, 5), in the order of `ERROR_COLUMNS`."""
        return np.column_stack([self.position, self.velocity, self.acceleration, self.reaction, self.interpolation])

    def worst(self) -> dict[str, float]:
        """The largest estimate of each column that has a finite one, by its name."""
        columns = zip(ERROR_COLUMNS, self.table().T, strict=True)
        return {name: float(np.nanmax(values)) for name, values in columns if np.isfinite(values).any()}


def estimate_errors(run: Run) -> ErrorEstimate:
    """Error estimates of a run, from its own results; for a motion under forces also from a companion run."""
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
    if run.simulation is not None and run.resimulate is not None:
        error = np.maximum(integration_error(run.simulation, motion.time, run.resimulate), _unbalanced(run))
        position, velocity = position + error, velocity + error
        acceleration, reaction = acceleration + error, reaction + error
        amplitude, frequency = run.simulation.skipped_vibration
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
    """Sum of the whole turns [rad] by which an angle of a link or a coordinate of a joint has jumped up to each frame (F,), the
    largest of all of them. A jump is a step that differs by whole turns from the one that the rates at both frames give. Loads that
    depend on such an angle are wrong from there on."""
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
    """Error (F,) of a motion under forces from its energy balance, the largest up to each frame: the rates are wrong by at least
    half of the imbalance, relative to the largest energy. It reveals a force that jumps without a cause."""
    assert run.simulation is not None
    kinetic, potential, work, lost = run.simulation.energies(np.append(run.simulation.start, run.motion.time)).T
    total = kinetic + potential - work + lost
    size = max(float(np.abs(x).max()) for x in (kinetic, potential - potential[0], work, lost))
    missing = np.nan_to_num(np.abs(total[1:] - total[0])) / max(size, 1e-300)
    return np.asarray(0.5 * np.maximum.accumulate(np.where(missing > QUADRATURE_ERROR, missing, 0.0)))


def _travel(motion: Motion, size: float) -> Real:
    """Magnitude (F,) of the numbers that positions are computed from, relative to the mechanism's size and to a radian, at least 1:
    digits are lost far from the origin and after many turns."""
    far = np.ones(motion.frames)
    for link in motion.model.links[1:]:
        pose = motion.pose(link)
        far = np.maximum(far, np.maximum(np.abs(pose[:, :2]).max(axis=1) / size, np.abs(pose[:, 2])))
    return far


def _bend(motion: Motion) -> float:
    """Largest acceleration over the square of the largest velocity, lengths in sizes of the mechanism: the relative error of rates
    per error of the position, since a misplaced frame has the rates of another position. 1 for a mechanism at rest."""
    speed, acceleration = _peaks(motion)
    return acceleration / speed**2 if speed > 0.0 else 0.0


def _peaks(motion: Motion) -> tuple[float, float]:
    """Largest velocity and acceleration, lengths in sizes of the mechanism; for a mechanism at rest the scales of
    `rest_rate_scale`."""
    if stands_still(motion):
        pace = rest_rate_scale(motion)
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
    """Relative error of reactions and efforts by the rounding of the largest force or moment, which is large relative to the peak
    of a much smaller reaction. Reactions below a billionth of the largest force are nothing but rounding: their error is their
    size.
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
        elif scale > 10.0 * own:  # otherwise the scale is the quantity itself
            worst = max(worst, own / scale)
    return worst


def _friction_residual(run: Run) -> Real:
    forces = run.forces
    friction = getattr(forces, "friction", None)
    residual = getattr(friction, "residual", None)
    return np.zeros(run.motion.frames) if residual is None else np.asarray(residual)


def _difference_errors(run: Run) -> tuple[float, float]:
    """Relative errors of velocities and accelerations by differences, from those at twice the spacing of frames and the order of
    the method (Richardson)."""
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
    """Estimated error (F,) of the interpolation between each frame and the next, the largest of all quantities; NaN with fewer than
    nine frames. ``passages``: singular positions between the frames. See the module docstring."""
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
            worst[passage.frame] = max(worst[passage.frame], pole_size(passage, q))
    return worst


def _gain(twice: Real, four: Real, order: int) -> Real:
    """Factor (n,) by which halving the spacing reduces the errors ``twice`` (n,), from the errors ``four`` (m,) at twice their
    spacing nearby. Next to the ends polynomials are one-sided and local errors are no guide: the factor is taken from the largest
    errors."""
    twice, four = np.nan_to_num(twice), np.nan_to_num(four)
    places = np.minimum(np.arange(len(twice)) // 2, len(four) - 1)
    around, other = _largest_around(twice, 2 * PLACES_AROUND), _largest_around(four, PLACES_AROUND)[places]
    edge = order // 2 + 1
    for part in (slice(None, edge), slice(-edge, None)):
        around[part], other[part] = twice.max(), four.max()
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.clip(np.where(around > 0.0, other / around, 1.0), 1.0, 2.0 ** (order + 1)))


def _largest_around(x: Real, reach: int) -> Real:
    """Largest value (n,) within ``reach`` neighbours on both sides."""
    return np.array(np.lib.stride_tricks.sliding_window_view(np.pad(x, reach), 2 * reach + 1).max(axis=1))


def _left_out(q: CheckedQuantity, time: Real, order: int, step: int) -> Real:
    """Relative errors at the frames half way between every ``step``-th frame, interpolated from these; for order 0, which holds
    values, those just before the next of them."""
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
"""Companion of each motion, kept no longer than the run: a long one takes hundreds of megabytes."""


def _companion(simulation: Simulation, simulate: Callable[..., Simulation]) -> Simulation | None:
    """The companion of a motion (see the module docstring), computed once; None where its integration fails."""
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
            max(COMPANION_TOLERANCE * simulation.tolerance, 4.0 * simulation.skipped_vibration[0], LEAST_TOLERANCE),
            method,
            simulation,
        )
    except MechanismError:
        return None


def integration_error(simulation: Simulation, time: Real, simulate: Callable[..., Simulation]) -> Real:
    """Estimated error (F,) of a motion under forces: the largest of all links up to each frame, angles in radians, lengths in sizes
    of the mechanism; NaN where the integration of the companion fails. Rates have about the same error relative to their peaks,
    except at impacts.

    ``simulate(tolerance, method, start)`` integrates the motion anew; ``start``: the motion that it starts from.
    """
    companion = _companion(simulation, simulate)
    if companion is None:
        return np.full(len(time), np.nan)
    some = np.unique(np.linspace(0.0, simulation.duration, SAMPLED_FRAMES))
    some = some[some <= companion.duration]
    apart = pose_difference(simulation.view(some), companion.view(some))
    return np.asarray(
        np.interp(time, some, np.maximum.accumulate(np.nan_to_num(apart))) + ROUNDING + simulation.skipped_vibration[0]
    )


def pose_difference(one: Motion, other: Motion) -> Real:
    """Largest difference (F,) between the poses of links in two motions at the same times; lengths in sizes of the mechanism,
    angles in radians."""
    worst = np.zeros(one.frames)
    for link in one.model.links[1:]:
        error = np.abs(one.pose(link) - other.pose(link))
        worst = np.maximum(worst, np.maximum(error[:, :2].max(axis=1) / one.model.length_scale, error[:, 2]))
    return worst


LARGEST_ERROR = 0.1  # relative: a larger estimated error at the frames gives a warning


def check_finite(run: Run) -> None:
    """Raise `MechanismError` where a load or inertia force is not finite at a frame at which friction does not jam, with a fault
    for each of them."""
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
    """Reasons why the results of a run cannot be trusted, a sentence each; empty where they can. ``errors``: include large
    estimated errors, which for a motion under forces takes a second run."""
    moves = _moves(run)
    sums = (health.warning(moves) for health in run.catalogue.health)
    return [*filter(None, sums), *(_large_errors(run) if errors else ())]


def _large_errors(run: Run) -> Iterator[str]:
    for name, error in run.errors.worst().items():
        if name != "between_frames" and not error < LARGEST_ERROR and not np.isnan(error):
            yield f"the estimated error of the {name} is {error:.2g} of its largest value."


def _moves(run: Run) -> NDArray[np.bool_]:
    """Whether the mechanism is free of jams at each frame (F,)."""
    friction = None if run.forces is None else run.forces.friction
    jammed = np.zeros(len(run.motion.time), bool) if friction is None else np.asarray(friction.jammed)
    return ~jammed
