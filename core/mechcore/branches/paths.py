"""Branch paths: the branch that the start lies on, as far as the frames of a run need it, with the singular points on it.

One path along the configuration curve serves all frames. Its parameter is the position of the only drive; if that drive reverses at
a dead point, or if there are several drives, it is time. Continued are the groups without a closed form, the angles that a relation
needs beyond one turn, and the groups with a closed form that come to a dead point on the path, because it depends on the path which
of their modes is the smooth continuation.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechcore.branches.assembly import Assembly, starts_of
from mechcore.branches.continuation import REGULAR_RATIO, Branch, ContinuationPath, continuation_path
from mechcore.branches.dead_points import dead_point_instants, rounding_of
from mechcore.branches.modes import TWO_MODES
from mechcore.branches.singular_points import SingularPoint, SingularPoints, locate_singular, needs_span
from mechcore.constants import TURN
from mechcore.kinematics.columns import all_vectors, columns, matrix_of
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import dead_point_margin, place_all
from mechcore.kinematics.program import Block
from mechcore.kinematics.singular_interpolation import FAR_STEPS, make_interpolants
from mechcore.kinematics.state import Interpolant, State, value, wrapped_angle
from mechcore.laws.timed import ConstantSpeed, Law
from mechcore.records import dataclass

FINE = {"angle": math.radians(6.0), "slide": 0.05}  # largest step of a continuation: [rad], or fraction of the mechanism's size
COARSE = {"angle": 0.2, "slide": 0.1}  # the same, between points over which Newton's method or the angles of links are followed
SAMPLES_A_TURN = 720  # per turn or cycle, at which groups with a closed form are checked for dead points
SAMPLES_OF_STEP = 12  # the same, per step
MOST_SAMPLES = 20_000
MOST_WAYPOINT_STEPS = 200  # most steps from a waypoint; a point farther off is a trial of the integrator
SAMPLES_OF_LAW = 2001
CLOSURE_AT_DEAD_POINT = 1e-11  # of the size: largest closure error of the loops at a dead point that a drive just reaches
STUCK_MARGIN = 1e-9  # `dead_point_margin` below which a group is involved in what stopped a path
# Of a step: where a path begins if its start is a dead point (no power of two, or halved steps would return to the start)
START_BESIDE = 0.3
# Relative decrease of `dead_point_margin` from a thousandth of a step before to one after: beyond, the dead point lies ahead
MARGIN_GROWTH = 2e-4
START_AT_DEAD_POINT = 1e-4  # `dead_point_margin` of a group below which a start counts as a dead point
LIMIT_ERROR = 1e-11  # relative: a generous bound of the error of a located limit
CYCLES = (1, 2, 3, 4, 6, 12)  # turns after which groups may be back in their first position
SAME_POSITION = 1e-8  # largest difference of rotations, and of displacements over the size, that are the same after a cycle


@dataclass(frozen=True, eq=False)
class BranchPath:
    """A branch, continued over a range of its parameter, and the singular points and limits found there.

    ``branch``: its model marks the continued groups. ``start``: the parameter at the start. ``requested_range``: the range to be
    covered; ``end_tolerance``: accuracy of the ends reached. ``by_time``: the parameter is time. ``period``: interval of the
    parameter after which the groups repeat, angles up to whole turns; None if the path covers all of it. ``unreachable``: ranges of
    the parameter in which a group (by number; -1: beyond the end of the path) cannot be assembled. ``singular_points``: those that
    are passed.
    """

    branch: Branch
    continuation: ContinuationPath
    start: float
    requested_range: tuple[float, float]
    end_tolerance: float
    by_time: bool = False
    period: float | None = None
    unreachable: tuple[tuple[float, float, int], ...] = ()
    singular_points: SingularPoints | None = None

    @property
    def model(self) -> Model:
        """The model in which the continued groups are marked."""
        return self.branch.model

    def placed(self, parameter: Real, interpolants: Mapping[int, Sequence[Interpolant]] | None = None) -> State:
        """Positions of all groups at parameters (F,) within one period."""
        return self.branch.placed(parameter, self.continuation.starts(parameter), interpolants)

    def starts(self, parameter: Real) -> dict[str, Real]:
        """Newton starts, and angles beyond one turn, for parameters (F,)."""
        path = self.continuation
        if self.period is None:
            return path.starts(parameter)
        turns = np.floor((parameter - self.start) / self.period)
        starts = path.starts(parameter - turns * self.period)
        angles = {block.name: len(block.angles) for block in self.model.blocks if block.kind == "general"}
        for name, spline in path.splines.items():
            gain = np.round((spline(self.start + self.period) - spline(self.start)) / TURN) * TURN
            if name in angles:
                gain[angles[name] :] = 0.0
                starts[name] = starts[name] + turns[:, None] * gain
            else:
                starts[name] = starts[name] + turns * gain
        return starts

    def reached(self, parameter: Real) -> Flags:
        """Whether the path reaches the parameters (F,)."""
        if self.period is not None:
            return np.ones(np.shape(parameter), bool)
        low, high = self.continuation.ends
        return (parameter >= low - self.end_tolerance) & (parameter <= high + self.end_tolerance)

    def covers(self, parameter: Real) -> bool:
        """Whether a new path would reach no more of the parameters (F,): this one reaches each, or met a limit before it."""
        low, high = self.requested_range
        return bool(np.all(self.reached(parameter) | ((parameter >= low) & (parameter <= high))))


# -- the path that the frames need ----------------------------------------------------------------------------------------------
def path_for(
    model: Model, assembly: Assembly, start: Sequence[float], time: Real, positions: Sequence[Real], *, given: bool
) -> BranchPath:
    """The path that the frames at times (F,) need. ``given``: the frames' drive ``positions`` are not those of the laws."""
    drives = model.mechanism.drives
    in_time = Branch(model, assembly, tuple(d.law for d in drives))
    first, last = (float(np.min(time)), float(np.max(time))) if len(time) else (0.0, 0.0)
    if len(drives) > 1:
        return _path_in_time(in_time, min(0.0, first), last)
    q0, q = start[0], positions[0]
    low, high = (min(q0, float(np.min(q))), max(q0, float(np.max(q)))) if len(q) else (q0, q0)
    if not given:
        least, most, stands = travel_of(drives[0].law, first, last)
        low, high = min(low, least), max(high, most)
    step, branch = float(largest_steps(model)[0]), branch_by_drive(model, assembly)
    if model.rotary(drives[0].joint):
        repeating = _repeating(
            lambda end: branch_path(branch, q0, q0, q0 + end, step, TURN / SAMPLES_A_TURN), CYCLES, TURN, high - low
        )
        if repeating is not None:
            return repeating
    path = branch_path(branch, q0, low, high, step)
    (lowest, highest), known = path.continuation.ends, path.continuation.covered_range
    near = 1e-5 * max(high - low, step)
    short = known[0] > low or known[1] < high  # it met a limit
    close = len(q) and (high > highest - near or low < lowest + near)
    turns_back = not given and stands
    if turns_back and close and (short or _dead_point_at_ends(path)):
        through = _path_in_time(in_time, min(0.0, first), last)
        if bool(through.reached(np.array(last))) and _reaches_dead_points(through):
            return through
    return path


def branch_by_drive(model: Model, assembly: Assembly, others: Sequence[float] = ()) -> Branch:
    """The branch along the position of the first drive; ``others``: fixed positions of further drives."""
    return Branch(model, assembly, (ConstantSpeed(0.0, 1.0),), tuple(others))


def largest_steps(model: Model, steps: Mapping[str, float] = FINE) -> Real:
    """Largest steps of the drives (d,) [rad or m] over which positions and angles can be followed."""
    rotary = [model.rotary(d.joint) for d in model.mechanism.drives]
    return np.array([steps["angle"] if turns else steps["slide"] * model.length_scale for turns in rotary])


def _path_in_time(branch: Branch, low: float, high: float) -> BranchPath:
    """The path in time, over a few cycles where the laws and the groups repeat."""
    duration = min((law.duration for law in branch.laws), default=1.0)
    high = max(high, 1e-9 * duration)

    def until(high: float, low: float = 0.0) -> BranchPath:
        return branch_path(branch, 0.0, low, high, duration / 60.0, duration / SAMPLES_A_TURN, by_time=True)

    if low == 0.0 and not needs_span(branch.model):
        repeating = _repeating(until, CYCLES[:4], duration, high)
        if repeating is not None:
            return repeating
    return until(high, low)


def _repeating(until: Callable[[float], BranchPath], cycles: Sequence[int], cycle: float, span: float) -> BranchPath | None:
    """The path over the first of ``cycles`` after which every link and slide is back in its first position.

    None if the whole ``span`` is not longer, if a path meets a limit, or if no number of cycles fits. ``until``: length of the
    range -> path from the start over it.
    """
    for count in cycles:
        period = count * cycle
        if span <= 1.01 * period:
            return None
        path = until(period)
        end = path.start + period
        if path.continuation.ends[1] < end:
            return None
        if not repeats(path.model, path.placed(np.array([path.start, end])), 0, 1):
            continue
        singular_points = path.singular_points
        if singular_points is not None:
            tiny = 1e-9 * period
            kept = tuple(c for c in singular_points.points if -tiny <= c.time < period - tiny)
            singular_points = replace(singular_points, period=period, points=kept)
        return replace(path, period=period, singular_points=singular_points)
    return None


def repeats(model: Model, state: State, before: Index | int, after: Index | int) -> bool:
    """Whether every link and slide has the same position at solved frames ``after`` (n,) as at ``before`` (n,), up to whole turns;
    False if a position is unknown at one of them."""
    slides = [np.asarray(slide) / model.length_scale for slide in state.slide.values()]
    away = [np.abs(x[after] - x[before]) for x in (*state.rot, *slides) if np.ndim(x)]
    return bool(np.max(away, initial=0.0) < SAME_POSITION)


def travel_of(law: Law, first: float, last: float) -> tuple[float, float, bool]:
    """Smallest and largest position of a law from ``first`` to ``last`` [s], reversals between samples included, and whether a
    moving law comes to rest there, or nearly."""
    time = np.linspace(first, last, SAMPLES_OF_LAW)
    q, v, a = (np.asarray(x, float) for x in law(time))
    turns = np.flatnonzero((v[:-1] * v[1:] <= 0.0) & ((a[:-1] != 0.0) | (a[1:] != 0.0)))
    at = time[turns]
    step = float(time[1] - time[0])
    for _ in range(4 if len(turns) else 0):  # Newton's method for the instants of reversal
        _, speed, bend = law(at)
        with np.errstate(divide="ignore", invalid="ignore"):
            move = np.where(bend != 0.0, -speed / bend, 0.0)
        at = np.clip(at + np.clip(move, -step, step), time[turns], time[turns + 1])
    reached = np.concatenate([q, np.asarray(law(at)[0], float)]) if len(turns) else q
    moves = float(np.abs(v).max(initial=0.0))
    return float(reached.min()), float(reached.max()), moves > 0.0 and float(np.abs(v).min()) < 1e-2 * moves


def _dead_point_at_ends(path: BranchPath) -> bool:
    """Whether a group with a closed form is nearly at a dead point where a path ended."""
    state = path.placed(np.array(path.continuation.covered_range))
    two = (b for b in path.model.blocks if b.kind in TWO_MODES)
    return any(float(np.min(np.broadcast_to(h, 2))) < STUCK_MARGIN for b in two for h in dead_point_margin(path.model, b, state))


def _reaches_dead_points(path: BranchPath) -> bool:
    """Whether a path in time passes dead points that the drive just reaches; where the drive went beyond, the loops are open."""
    if path.singular_points is None:
        return False
    time = np.array([c.time for c in path.singular_points.points if c.dead])
    if not len(time):
        return False
    model, assembly = path.model, path.branch.assembly
    interpolants = make_interpolants(model, path.singular_points, assembly.modes, time, (1.0, 0.0), assembly.constants, path.starts)
    state = path.branch.placed(time, path.starts(time), interpolants)
    sums = (value(loop, state.rot, state.slide) for loop in model.loop_sums)
    return all(np.abs(total).max() <= CLOSURE_AT_DEAD_POINT * model.length_scale for total in sums)


# -- following a branch ---------------------------------------------------------------------------------------------------------
def branch_path(
    branch: Branch, start: float, low: float, high: float, step: float, sample: float | None = None, *, by_time: bool = False
) -> BranchPath:
    """The branch from ``low`` to ``high``, or as far as it reaches, continued from ``start`` in steps of at most ``step``.

    Groups with a closed form that come to a dead point are continued as well; dead points are searched in steps of ``sample``.
    Raises `MechanismError` if the start is singular, so that the branch is ambiguous.
    """
    sample = step / SAMPLES_OF_STEP if sample is None else sample
    unreachable: list[tuple[float, float, int]] = []
    begin, behind, ahead, more = start, low, high, 2.0 * FAR_STEPS * sample
    aside = _start_at_dead_point(branch, start, step)
    if aside:
        begin = start + aside * START_BESIDE * step
        branch = _beside(branch, begin)
        behind, ahead = min(low, start - more), max(high, start + more)  # the path must cover both sides of the start
    edge = LIMIT_ERROR * max(10.0 * step, abs(low), abs(high))
    for _ in range(len(branch.model.blocks) + 3):
        continuation = continuation_path(branch, begin, behind, ahead, step)
        path = BranchPath(branch, continuation, start, (low, high), edge, by_time)
        dead_point, unreachable = _dead_point_groups(path, sample)
        wider = (behind == low and continuation.nearly_singular_ends[0], ahead == high and continuation.nearly_singular_ends[1])
        if not dead_point and not any(wider):
            break
        if dead_point:
            branch = _with_continued(branch, dead_point)
        behind, ahead = behind - more * wider[0], ahead + more * wider[1]
    path = replace(path, branch=branch)
    if continuation.ends[0] > low + edge:
        unreachable.append((low, continuation.ends[0], -1))
    if continuation.ends[1] < high - edge:
        unreachable.append((continuation.ends[1], high, -1))
    passed = [c for p, name in continuation.passed for c in [_singular_point(path, p, name, sample)] if c is not None]
    if not passed:
        return replace(path, unreachable=tuple(unreachable))
    still = tuple(ConstantSpeed(q, 0.0) for q in branch.fixed_positions)
    laws = branch.laws if by_time else (ConstantSpeed(start, 1.0), *still)
    singular_points = SingularPoints(period=1e150, points=tuple(passed), laws=laws, by_drive=not by_time)
    return replace(path, unreachable=tuple(unreachable), singular_points=singular_points)


def _start_at_dead_point(branch: Branch, start: float, step: float) -> float:
    """The side of a dead point on which the stated modes hold, for a start at or nearly at a dead point of groups with a closed
    form: 1 (after the start), or -1 if the dead point lies just ahead; 0 if there is none near or a general block is singular."""
    model = branch.model

    def margins(p: float) -> Real:
        state = branch.placed(p, branch.assembly.starts)
        least = [np.min([float(h) for h in dead_point_margin(model, b, state)]) for b in model.blocks if b.kind in TWO_MODES]
        return np.array(least)

    here = margins(start)
    if not (here < START_AT_DEAD_POINT).any() or _singular(branch, start):
        return 0.0
    off = 1e-3 * step
    before, after = margins(start - off)[here < START_AT_DEAD_POINT], margins(start + off)[here < START_AT_DEAD_POINT]
    grows = after - before
    return -1.0 if (grows < -MARGIN_GROWTH * (abs(after) + abs(before))).any() else 1.0


def _singular(branch: Branch, p: float) -> bool:
    """Whether a general block, for which no mode is stated, is singular at ``p``."""
    model = branch.model
    state = branch.placed(p, branch.assembly.starts)
    for block in (b for b in model.blocks if b.kind == "general"):
        matrix, _ = matrix_of(columns(model, block, all_vectors(model, state)))
        s = np.linalg.svd(np.nan_to_num(matrix), compute_uv=False)
        if s[-1] < REGULAR_RATIO * s[0]:
            return True
    return False


def _beside(branch: Branch, p: float) -> Branch:
    """The branch with its assembly at ``p``, next to a dead point, where the modes of groups with a closed form are distinct."""
    state = branch.placed(p, branch.assembly.starts)
    return replace(branch, assembly=replace(branch.assembly, starts=starts_of(branch.model, state), state=state))


def _with_continued(branch: Branch, numbers: set[int]) -> Branch:
    """The branch with some groups, by number, continued by Newton's method instead of solved by their closed form."""
    model, assembly = branch.model, branch.assembly
    blocks: list[Block] = list(model.blocks)
    starts = dict(assembly.starts)
    for i in numbers:
        block = blocks[i]
        blocks[i] = replace(block, kind="general")
        known = [(g, starts.get(f"angle {g}")) for g in block.angles]
        at = [float(wrapped_angle(model, assembly.state, g) if x is None else x) for g, x in known]
        starts[block.name] = np.array([*at, *(float(assembly.state.slide[j]) for j in block.slides)])
    return replace(branch, model=replace(model, blocks=tuple(blocks)), assembly=replace(assembly, starts=starts))


def _dead_point_groups(path: BranchPath, sample: float) -> tuple[set[int], list[tuple[float, float, int]]]:
    """Numbers of the groups with a closed form that pass a dead point on a path, or that stop it there; and the ranges (from, to,
    number) in which groups cannot be assembled."""
    model, continuation = path.model, path.continuation
    two = [i for i, b in enumerate(model.blocks) if b.kind in TWO_MODES]
    low, high = continuation.covered_range
    count = int(min(max((high - low) / sample, 16), MOST_SAMPLES))
    if not two or high <= low:
        return set(), []
    p = np.linspace(low, high, count + 1)
    state = path.placed(p)
    rough = np.full(len(p), any(b.kind == "general" for b in model.blocks))
    dead_point, unreachable = set(), []
    for i in two:
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            margins = dead_point_margin(model, model.blocks[i], state)
            instants, missing, _ = dead_point_instants(margins, p, rough, rounding_of(model))
            ends = [min(float(np.broadcast_to(h, p.shape)[k]) for h in margins) for k in (0, -1)]
        if any(flips for _, flips in instants) or (continuation.singular and min(ends) < STUCK_MARGIN):
            dead_point.add(i)
        unreachable += [(a, b, i) for a, b in missing]
    return dead_point, unreachable


def _singular_point(path: BranchPath, p: float, name: str, sample: float) -> SingularPoint | None:
    """The singular position that a path has passed next to ``p``; None if the motion around it is not known."""
    number = next(i for i, b in enumerate(path.model.blocks) if b.name == name and b.kind == "general")
    located = locate_singular(path.model, path.model.blocks[number], path.placed, p, sample)
    if located is None:
        return None
    place, width = located
    laws = path.branch.laws
    speed = max(abs(float(law(place)[1])) for law in laws)
    fastest = max(float(np.abs(law(np.linspace(*path.continuation.ends, 101))[1]).max()) for law in laws)
    dead = path.by_time and speed < 1e-3 * fastest
    return SingularPoint(place - (0.0 if path.by_time else path.start), number, name, dead, True, width)


# -- several free drives ----------------------------------------------------------------------------------------------------------
# The frames of a collocation window of the integrator may lie anywhere near the motion. Each is reached from the last waypoint
# before it, all together and in the same number of steps. The windows are short, so that no step size control is needed.
Starts = Mapping[str, Real]


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A point of a motion: time [s] and positions of the drives (d,). Once computed: angles of the rotation classes (s,), and
    Newton starts of the continued groups, as in `Assembly`."""

    time: float
    drives: Real
    class_angles: Real | None = None
    starts: Starts | None = None


class WaypointPath:
    """Waypoints in order of time; angles and starts of the first are known."""

    def __init__(self, at: Waypoint):
        self._points: tuple[list[float], list[Waypoint]] = [at.time], [at]  # replaced in one assignment: other threads may read it
        self._later: list[Any] = []
        self._resolve: Callable[[list[Any]], Sequence[Waypoint]] | None = None

    def leave_later(self, items: Sequence[Any], resolve: Callable[[list[Any]], Sequence[Waypoint]]) -> None:
        """Defer the waypoints of ``items``: at the next access, ``resolve`` makes them of all deferred items, in order."""
        self._resolve = resolve
        self._later += items

    def _resolved(self) -> None:
        later, self._later = self._later, []
        if later and self._resolve is not None:
            self.leave(self._resolve(later))

    def leave(self, waypoints: Sequence[Waypoint]) -> None:
        """Append waypoints; existing ones later than the first of them are discarded."""
        self._resolved()
        times, points = self._points
        keep = max(bisect_right(times, waypoints[0].time), 1)
        if keep < len(times):
            times, points = times[:keep], points[:keep]
            self._points = times, points
        points.extend(waypoints)
        times.extend(w.time for w in waypoints)

    def before(self, time: Real) -> tuple[list[Waypoint], Index]:
        """All waypoints, and the number of the last one before each of the times (n,), or of the first if there is none."""
        self._resolved()
        times, points = self._points
        first = max(bisect_left(times, float(time.min())) - 1, 0)
        later = np.array(times[first : bisect_left(times, float(time.max()))] or times[:1])
        return points, first + np.maximum(np.searchsorted(later, time, side="left") - 1, 0)

    def starts(self, model: Model, assembly: Assembly, time: Real, drives: Real) -> Starts:
        """Newton starts of the continued groups, at times (n,) and positions of the drives (n, d)."""
        points, before = self.before(time)
        last = int(before.max())
        known = next(k for k in range(last, -1, -1) if points[k].starts is not None)
        for k in range(known, last):
            a, b = points[k], points[k + 1]
            first = {name: np.asarray(x)[None] for name, x in (a.starts or {}).items()}
            continued = _continued(model, assembly, a.drives[None], first, b.drives[None])
            points[k + 1] = replace(b, starts={name: x[0] for name, x in continued.items()})
        used, which = np.unique(before, return_inverse=True)
        at = [points[k].starts or {} for k in used]
        starts = {name: np.array([s[name] for s in at])[which] for name in at[0]}
        return _continued(model, assembly, np.array([points[k].drives for k in used])[which], starts, drives)


def _continued(model: Model, assembly: Assembly, first: Real, starts: Starts, drives: Real) -> Starts:
    """Starts at ``drives`` (n, d), continued from positions ``first`` (n, d) with known ``starts``, all in the same number of
    steps."""
    with np.errstate(invalid="ignore"):
        far = np.nan_to_num(np.abs(drives - first) / largest_steps(model, COARSE)).max(initial=0.0)
    count = int(np.clip(np.ceil(far), 1, MOST_WAYPOINT_STEPS))
    for k in range(1, count + 1):
        q = first + k / count * (drives - first)
        state = place_all(model, list(q.T), assembly.modes, starts, constants=assembly.constants)
        starts = starts_of(model, state, (len(q),))
    return starts
