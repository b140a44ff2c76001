"""Groups that have to be followed from their start: those without a closed form, and those whose whole angle a relation needs.

One walk along the configuration curve serves all frames. Its parameter is the position of the only drive; where that drive turns
back at a dead point, or where there are several drives, it is time. Groups with a closed form that come to a flat position on the
way are followed too, because which of their modes is the smooth continuation depends on the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.branches.assembly import Assembly
from mechcore.branches.continuation import REGULAR, Drives, Track, follow
from mechcore.branches.modes import TWO_MODES
from mechcore.branches.singular_points import Change, Changes, flat_instants, needs_span, rounding_of
from mechcore.kinematics.columns import all_vectors, columns, matrix_of
from mechcore.kinematics.model import Model
from mechcore.kinematics.patching import FAR, NODES, TAIL, make_patches, tail_of, unknowns_of
from mechcore.kinematics.positions import dead_point_margin, place_all
from mechcore.kinematics.program import Block
from mechcore.kinematics.state import real_angle, value, wrapped_angle
from mechcore.laws.timed import ConstantSpeed, Law

TURN = 2.0 * np.pi
STEP = {"angle": np.radians(6.0), "slide": 0.05}  # largest step of a walk: angle, or part of the mechanism's size
SAMPLES = 720  # of a turn or a cycle, at which closed forms are looked at for flat positions
MOST_SAMPLES = 20_000
SAMPLES_OF_LAW = 2001
CLOSED = 1e-11  # of the size: what loops may be open at a dead point that a drive just reaches
STUCK = 1e-9  # flatness of a group that takes part in what a walk did not get through
BESIDE = 0.3  # of a step: where a walk begins whose start is flat (no power of two: halved steps shall not lead back onto it)
AHEAD = 2e-4  # relative growth of the flatness over a thousandth of a step: beyond, the flat position is not the start itself
FLAT = 1e-4  # flatness of a group below which a start counts as flat
EDGE = 1e-11  # relative: what a limit is known to, generously
CYCLES = (1, 2, 3, 4, 6, 12)  # turns after which groups may be back where they were


@dataclass(frozen=True, eq=False)
class Course:
    """A walk and what was met on it.

    ``model`` and ``assembly``: as compiled, but with those groups marked that are followed. ``start``: the parameter there.
    ``period``: after so much of the parameter the groups repeat, angles but for whole turns; None where the walk covers all.
    ``gaps``: ranges of the parameter in which a group (by number, -1 where the walk ended) cannot be put together.
    ``by_time``: the parameter is time. ``asked``: the range that the walk was to cover.
    """

    model: Model
    assembly: Assembly
    track: Track
    start: float
    period: float | None
    laws: tuple[Law, ...]
    changes: Changes | None
    gaps: tuple[tuple[float, float, int], ...]
    by_time: bool
    asked: tuple[float, float]
    edge: float

    def starts(self, parameter: Real) -> dict[str, Real]:
        """Newton starts, and angles beyond one turn, for parameters (F,)."""
        if self.period is None:
            return self.track.starts(parameter)
        turns = np.floor((parameter - self.start) / self.period)
        found = self.track.starts(parameter - turns * self.period)
        angles = {block.name: len(block.angles) for block in self.model.blocks if block.kind == "general"}
        for name, spline in self.track.splines.items():
            gain = np.round((spline(self.start + self.period) - spline(self.start)) / TURN) * TURN
            if name in angles:
                gain[angles[name] :] = 0.0
                found[name] = found[name] + turns[:, None] * gain
            else:
                found[name] = found[name] + turns * gain
        return found

    def reached(self, parameter: Real) -> Flags:
        """Whether the walk came as far as parameters (F,)."""
        if self.period is not None:
            return np.ones(np.shape(parameter), bool)
        return (parameter >= self.track.ends[0] - self.edge) & (parameter <= self.track.ends[1] + self.edge)

    def tells(self, parameter: Real) -> bool:
        """Whether nothing more of parameters (F,) is found by another walk: this one came as far, or met a limit before."""
        low, high = self.asked
        return bool(np.all(self.reached(parameter) | ((parameter >= low) & (parameter <= high))))


def course_of(
    model: Model, assembly: Assembly, start: Sequence[float], time: Real, positions: Sequence[Real], *, given: bool
) -> Course:
    """Walk over what the frames at times (F,) need. ``given``: the frames' drive positions are not those of the laws."""
    drives = model.mechanism.drives
    laws = tuple(d.law for d in drives)
    first, last = (float(np.min(time)), float(np.max(time))) if len(time) else (0.0, 0.0)
    if len(drives) > 1:
        return _in_time(model, assembly, laws, min(0.0, first), last)
    q0, q = start[0], positions[0]
    low, high = (min(q0, float(np.min(q))), max(q0, float(np.max(q)))) if len(q) else (q0, q0)
    if not given:
        least, most, stands = way_of(laws[0], first, last)
        low, high = min(low, least), max(high, most)
    turning = model.joints[model.joint_index[drives[0].joint]].coordinate == "angle"
    step = STEP["angle"] if turning else STEP["slide"] * model.length_scale
    unit = (ConstantSpeed(0.0, 1.0),)  # the parameter is the drive's position
    for turns in CYCLES if turning else ():
        if high - low <= 1.01 * TURN * turns:
            break
        course = walk(model, assembly, unit, q0, q0, q0 + turns * TURN, step, TURN / SAMPLES)
        if course.track.ends[1] < q0 + turns * TURN:
            break
        if _closes(course, q0 + turns * TURN):
            return _repeating(course, turns * TURN)
    course = walk(model, assembly, unit, q0, low, high, step, step / 12.0)
    near = 1e-5 * max(high - low, step)
    short = course.track.known[0] > low or course.track.known[1] < high  # it met a limit
    close = len(q) and (high > course.track.ends[1] - near or low < course.track.ends[0] + near)
    turns_back = not given and stands
    if turns_back and close and (short or _flat_at_ends(course)):
        through = _in_time(model, assembly, laws, min(0.0, first), last)
        if bool(through.reached(np.array(last))) and _reaches_dead_points(through):
            return through
    return course


def _flat_at_ends(course: Course) -> bool:
    """Whether a group with a closed form is all but flat where a walk ended."""
    model, p = course.model, np.array(course.track.known)
    state = place_all(
        model, _positions(course.laws, (), p), course.assembly.modes, course.track.starts(p), constants=course.assembly.constants
    )
    two = (b for b in model.blocks if b.kind in TWO_MODES)
    return any(float(np.min(np.broadcast_to(h, 2))) < STUCK for b in two for h in dead_point_margin(model, b, state))


def _reaches_dead_points(course: Course) -> bool:
    """Whether a walk in time goes through dead points that the drive just reaches: beyond them the loops would not close."""
    if course.changes is None:
        return False
    time = np.array([c.time for c in course.changes.found if c.dead])
    if not len(time):
        return False
    model, assembly = course.model, course.assembly
    patches = make_patches(model, course.changes, assembly.modes, time, (1.0, 0.0), assembly.constants, course.starts)
    positions = _positions(course.laws, (), time)
    state = place_all(model, positions, assembly.modes, course.starts(time), patches, assembly.constants)
    sums = (value(loop, state.rot, state.slide) for loop in model.loop_sums)
    return all(np.abs(left).max() <= CLOSED * model.length_scale for left in sums)


def way_of(law: Law, first: float, last: float) -> tuple[float, float, bool]:
    """Smallest and largest position of a law from ``first`` to ``last`` [s], between frames too; whether it stands still there."""
    time = np.linspace(first, last, SAMPLES_OF_LAW)
    q, v, a = (np.asarray(x, float) for x in law(time))
    turns = np.flatnonzero((v[:-1] * v[1:] <= 0.0) & ((a[:-1] != 0.0) | (a[1:] != 0.0)))
    at = time[turns]
    step = float(time[1] - time[0])
    for _ in range(4 if len(turns) else 0):  # where it turns back
        _, speed, bend = law(at)
        with np.errstate(divide="ignore", invalid="ignore"):
            move = np.where(bend != 0.0, -speed / bend, 0.0)
        at = np.clip(at + np.clip(move, -step, step), time[turns], time[turns + 1])
    reached = np.concatenate([q, np.asarray(law(at)[0], float)]) if len(turns) else q
    moves = float(np.abs(v).max(initial=0.0))
    return float(reached.min()), float(reached.max()), moves > 0.0 and float(np.abs(v).min()) < 1e-2 * moves


def _in_time(model: Model, assembly: Assembly, laws: tuple[Law, ...], low: float, high: float) -> Course:
    """Walk in time, over a few cycles where the laws and the groups repeat."""
    duration = min((law.duration for law in laws), default=1.0)
    high = max(high, 1e-9 * duration)
    step = duration / 60.0
    sample = duration / SAMPLES
    if low == 0.0 and not needs_span(model):
        for cycles in CYCLES[:4]:
            if high <= 1.01 * cycles * duration:
                break
            course = walk(model, assembly, laws, 0.0, 0.0, cycles * duration, step, sample, by_time=True)
            if course.track.ends[1] < cycles * duration:
                break
            if _closes(course, cycles * duration):
                return _repeating(course, cycles * duration)
    return walk(model, assembly, laws, 0.0, low, high, step, sample, by_time=True)


def _repeating(course: Course, period: float) -> Course:
    changes = course.changes
    if changes is not None:
        tiny = 1e-9 * period
        kept = tuple(c for c in changes.found if -tiny <= c.time < period - tiny)
        changes = replace(changes, period=period, found=kept)
    return replace(course, period=period, changes=changes)


def walk(
    model: Model,
    assembly: Assembly,
    laws: tuple[Law, ...],
    start: float,
    low: float,
    high: float,
    step: float,
    sample: float,
    *,
    by_time: bool = False,
    others: Sequence[float] = (),
) -> Course:
    """Walk from ``start`` to ``low`` and ``high``; groups with a closed form that come to a flat position are followed as well.

    ``laws`` lead the drives along the parameter; ``others``: positions of further drives that stand still.
    """
    rest = list(others)

    def drives(p: float) -> tuple[list[float], list[float]]:
        found = [law(p) for law in laws]
        return [*(float(f[0]) for f in found), *rest], [*(float(f[1]) for f in found), *([0.0] * len(rest))]

    gaps: list[tuple[float, float, int]] = []
    begin, behind, ahead, more = start, low, high, 2.0 * FAR * sample
    aside = _flat_start(model, assembly, drives, start, step)
    if aside:
        begin = start + aside * BESIDE * step
        assembly = _beside(model, assembly, drives, begin)
        behind, ahead = min(low, start - more), max(high, start + more)  # the way has to be known on both sides of the start
    for _ in range(len(model.blocks) + 3):
        track = follow(model, assembly, drives, begin, behind, ahead, step)
        flat, gaps = _flat_on(model, assembly, track, laws, rest, sample)
        wider = (behind == low and track.flat_ends[0], ahead == high and track.flat_ends[1])
        if not flat and not any(wider):
            break
        if flat:
            model, assembly = _followed(model, assembly, flat)
        behind, ahead = behind - more * wider[0], ahead + more * wider[1]
    edge = EDGE * max(10.0 * step, abs(low), abs(high))
    if track.ends[0] > low + edge:
        gaps.append((low, track.ends[0], -1))
    if track.ends[1] < high - edge:
        gaps.append((track.ends[1], high, -1))
    course = Course(model, assembly, track, start, None, laws, None, tuple(gaps), by_time, (low, high), edge)
    found = [c for p, name in track.passed for c in [_change(course, p, name, rest, sample)] if c is not None]
    if not found:
        return course
    lead = laws if by_time else (ConstantSpeed(start, 1.0), *(ConstantSpeed(q, 0.0) for q in rest))
    changes = Changes(period=1e150, found=tuple(found), laws=lead, by_drive=not by_time)
    return replace(course, changes=changes)


def _flat_start(model: Model, assembly: Assembly, drives: Drives, start: float, step: float) -> float:
    """Which way the stated modes lead on from a start at, or all but at, a flat position of groups with a closed form: 1, or -1
    where that position lies just ahead; 0 where none is near."""

    def margins(p: float) -> Real:
        positions = [np.float64(q) for q in drives(p)[0]]
        state = place_all(model, positions, assembly.modes, assembly.starts, constants=assembly.constants)
        found = [np.min([float(h) for h in dead_point_margin(model, b, state)]) for b in model.blocks if b.kind in TWO_MODES]
        return np.array(found)

    here = margins(start)
    if not (here < FLAT).any() or _singular(model, assembly, drives, start):
        return 0.0
    off = 1e-3 * step
    before, after = margins(start - off)[here < FLAT], margins(start + off)[here < FLAT]
    grows = after - before
    return -1.0 if (grows < -AHEAD * (abs(after) + abs(before))).any() else 1.0


def _singular(model: Model, assembly: Assembly, drives: Drives, p: float) -> bool:
    """Whether a group that no closed form solves, whose way on nothing states, is singular."""
    state = place_all(model, [np.float64(q) for q in drives(p)[0]], assembly.modes, assembly.starts, constants=assembly.constants)
    found = []
    for block in (b for b in model.blocks if b.kind == "general"):
        matrix, _ = matrix_of(columns(model, block, all_vectors(model, state)))
        s = np.linalg.svd(np.nan_to_num(matrix), compute_uv=False)
        found.append(bool(s[-1] < REGULAR * s[0]))
    return any(found)


def _beside(model: Model, assembly: Assembly, drives: Drives, p: float) -> Assembly:
    """The assembly next to a flat start, where the modes of the groups with a closed form say which way leads on."""
    positions = [np.float64(q) for q in drives(p)[0]]
    state = place_all(model, positions, assembly.modes, assembly.starts, constants=assembly.constants)
    starts = {name: np.asarray(found.x) for name, found in state.newton.items()}
    starts |= {f"angle {g}": np.asarray(real_angle(model, state, g)) for g in model.multi_turn}
    return replace(assembly, starts=starts, state=state)


def _followed(model: Model, assembly: Assembly, flat: set[int]) -> tuple[Model, Assembly]:
    """The same with some groups to be followed, by Newton's method, instead of solved by their closed form."""
    blocks: list[Block] = list(model.blocks)
    starts = dict(assembly.starts)
    for i in flat:
        block = blocks[i]
        blocks[i] = replace(block, kind="general")
        known = [(g, starts.get(f"angle {g}")) for g in block.angles]
        at = [float(wrapped_angle(model, assembly.state, g) if x is None else x) for g, x in known]
        starts[block.name] = np.array([*at, *(float(assembly.state.slide[j]) for j in block.slides)])
    return replace(model, blocks=tuple(blocks)), replace(assembly, starts=starts)


def _flat_on(
    model: Model, assembly: Assembly, track: Track, laws: tuple[Law, ...], rest: Sequence[float], sample: float
) -> tuple[set[int], list[tuple[float, float, int]]]:
    """Groups with a closed form that come to a flat position on a walk, and where they cannot be put together."""
    two = [i for i, b in enumerate(model.blocks) if b.kind in TWO_MODES]
    low, high = track.known
    count = int(min(max((high - low) / sample, 16), MOST_SAMPLES))
    if not two or high <= low:
        return set(), []
    p = np.linspace(low, high, count + 1)
    state = place_all(model, _positions(laws, rest, p), assembly.modes, track.starts(p), constants=assembly.constants)
    rough = np.full(len(p), any(b.kind == "general" for b in model.blocks))
    flat, gaps = set(), []
    for i in two:
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            instants, missing, _ = flat_instants(model, model.blocks[i], state, p, rough, rounding_of(model))
            ends = [
                min(float(np.broadcast_to(h, p.shape)[k]) for h in dead_point_margin(model, model.blocks[i], state))
                for k in (0, -1)
            ]
        if any(flips for _, flips in instants) or (track.singular and min(ends) < STUCK):
            flat.add(i)
        gaps += [(a, b, i) for a, b in missing]
    return flat, gaps


def _positions(laws: tuple[Law, ...], rest: Sequence[float], p: Real) -> list[Real]:
    return [*(np.asarray(law(p)[0]) for law in laws), *(np.full(np.shape(p), q) for q in rest)]


def _change(course: Course, p: float, name: str, rest: Sequence[float], sample: float) -> Change | None:
    """A passed singular position with its exact place and the step at which the motion next to it is resolved."""
    model, assembly, track = course.model, course.assembly, course.track
    number = next(i for i, b in enumerate(model.blocks) if b.name == name and b.kind == "general")
    block = model.blocks[number]

    def placed(at: Real) -> Any:
        return place_all(model, _positions(course.laws, rest, at), assembly.modes, track.starts(at), constants=assembly.constants)

    scale = np.where(np.arange(len(block.angles) + len(block.slides)) < len(block.angles), 1.0, model.length_scale)
    best: tuple[float, float, float] | None = None
    width = sample
    for _ in range(8):
        nodes = p + width * FAR * NODES
        state = placed(nodes)
        values = unknowns_of(model, block, state, np.arange(len(nodes)))
        if np.isfinite(values).all():
            tail = tail_of(values / scale)
            if best is None or tail < 0.5 * best[0]:
                best = tail, width, p + _zero(_determinant(model, block, state), NODES) * width * FAR
            if tail < TAIL:
                break
        width *= 0.5
    if best is None:
        return None
    _, width, place = best
    speeds = [float(law(place)[1]) for law in course.laws]
    fastest = max(float(np.abs(law(np.linspace(*track.ends, 101))[1]).max()) for law in course.laws)
    dead = course.by_time and max(abs(v) for v in speeds) < 1e-3 * fastest
    return Change(place - (0.0 if course.by_time else course.start), number, name, dead, True, width)


def _determinant(model: Model, block: Block, state: Any) -> Real:
    matrix, _ = matrix_of(columns(model, block, all_vectors(model, state)))
    matrix[..., : len(block.angles)] /= model.length_scale
    return np.linalg.det(matrix)


def _zero(values: Real, nodes: Real) -> float:
    """The zero nearest to 0 of a smooth quantity given at nodes on [-1, 1]."""
    fit = np.polynomial.Chebyshev.fit(nodes, values / np.abs(values).max(), 11, domain=[-1.0, 1.0])
    slope, at = fit.deriv(), 0.0
    for _ in range(20):
        at -= float(np.clip(fit(at) / slope(at), -0.1, 0.1)) if slope(at) != 0.0 else 0.0
    return at if abs(at) < 0.2 else 0.0


def _closes(course: Course, end: float) -> bool:
    """Whether every link and slide is back where it was; angles that relations need, but for whole turns."""
    model, assembly, track = course.model, course.assembly, course.track
    p = np.array([course.start, end])
    state = place_all(model, _positions(course.laws, (), p), assembly.modes, track.starts(p), constants=assembly.constants)
    away = [np.abs(np.diff(np.broadcast_to(rot, 2)))[0] for rot in state.rot]
    away += [np.abs(np.diff(np.broadcast_to(s, 2)))[0] / model.length_scale for s in state.slide.values()]
    return bool(max(away, default=0.0) < 1e-8)
