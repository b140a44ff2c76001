"""Unwrapped angles of links: fixed at the start pose and followed from there along the motion, over waypoints where needed."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import field, replace
from functools import partial
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Index, Real, Values
from mechcore.branches.paths import COARSE, CYCLES, Waypoint, WaypointPath, largest_steps, repeats
from mechcore.constants import TURN
from mechcore.kinematics.model import Model
from mechcore.kinematics.state import State, wrapped_angle
from mechcore.laws.timed import Law, Table, moves
from mechcore.numerics.frames import lazy
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism

AngleRange = tuple[float, float]

STOP_DISTANCE = 1e-6  # [rad] a joint that is closer than this to its only stop starts at it, not a turn away from it
BORDER_WIDTH = 1e-9  # of a turn: angles closer than this to a border of their range count as on it


@dataclass(frozen=True)
class StartPose:
    """Angles of the links at the start.

    ``angles`` [rad] by link, a number or one for each design (d, 1). Links with the same number in ``stated`` have a relative angle
    that drives and rigid joints state. ``ranges`` [rad] by joint: its coordinate starts in or nearest to this range.
    """

    angles: Mapping[str, Values]
    stated: Mapping[str, int]
    ranges: Mapping[str, AngleRange] = field(default_factory=dict)

    def turns(self, first: str, second: str, about: AngleRange | None) -> Values:
        """Whole turns to add to the angle of the second link minus that of the first: so that it starts within half a turn of zero,
        or, if that is outside the range ``about``, of the middle of this range; none if the relative angle is stated."""
        if self.stated[first] == self.stated[second]:
            return 0.0
        angle = self.angles[second] - self.angles[first]
        turns = _turns_about(angle, 0.0)
        if about is None:
            return turns
        started = angle + TURN * turns
        low, high = about
        inside = (started >= low - BORDER_WIDTH) & (started <= high + BORDER_WIDTH) & (high - low > 0.0)
        return np.where(inside, turns, _turns_about(angle, 0.5 * (low + high)))

    def with_stops(self, stops: Iterable[tuple[str, str, float]]) -> StartPose:
        """A copy with the ranges between ``stops`` (joint, side, coordinate), which replace other ranges of these joints. At a
        single stop the range is one turn."""
        limits: dict[str, list[float]] = {}
        for joint, side, at in stops:
            low, high = limits.setdefault(joint, [-math.inf, math.inf])
            limits[joint] = [low, min(high, at)] if side == "upper" else [max(low, at), high]
        ranges = dict(self.ranges)
        for joint, (low, high) in limits.items():
            if high == math.inf:
                high = low + TURN - STOP_DISTANCE
            elif low == -math.inf:
                low = high - TURN + STOP_DISTANCE
            ranges[joint] = low, high
        return replace(self, ranges=ranges)


def _turns_about(angle: Values, about: float) -> Values:
    """Whole turns that bring an angle within half a turn of ``about``; a difference of half a turn comes out positive."""
    return np.floor((about + math.pi - angle) / TURN + BORDER_WIDTH)


def _ranges_of_tables(mechanism: Mechanism) -> dict[str, AngleRange]:
    """By joint, the range of the coordinate that the tables of the mechanism's loads over it cover together."""
    ranges: dict[str, AngleRange] = {}
    for load in mechanism.loads:
        factor = getattr(load, "factor", None)
        table = None if factor is None else factor.function
        if factor is not None and factor.of == "position" and factor.joint and isinstance(table, Table) and table.period is None:
            low, high = ranges.get(factor.joint, (math.inf, -math.inf))
            ranges[factor.joint] = min(low, table.x[0]), max(high, table.x[-1])
    return ranges


def start_pose(model: Model, class_angles: Real) -> StartPose:
    """The start pose of a mechanism with the angles ``class_angles`` (s, ...) of its rotation classes."""
    turning = model.angles
    return StartPose(
        {link: class_angles[turning.rotation_class[k]] + turning.offset[k] for k, link in enumerate(model.links)},
        dict(zip(model.links, turning.group, strict=True)),
        _ranges_of_tables(model.mechanism),
    )


# Positions of the drives, the state solved there, shape of the results
SolvedFrames = tuple[Sequence[Values], State, tuple[int, ...]]
PathFunction = Callable[[Real], SolvedFrames]  # points (n, c) on the path -> solved frames there

LARGEST_TURN = 1.0  # [rad] that a link may turn from one point to the next; beyond, points are inserted between them
FARTHEST_STEPS = 4096.0  # steps from one point to the next; a point farther off is a trial of the integrator, not on the path
MOST_STEPS = 4_000_000  # steps of a table from the start: 100,000 turns; a trial of the integrator may lie anywhere
MOST_HALVINGS = 14  # halvings of a step in which a link turns too far: at a true jump no step is short enough
PLACES_AT_ONCE = 100_000  # points evaluated together
SAMPLES_A_CYCLE = 256  # of a law's cycle, for its largest speed


def raw_angles(model: Model, drives: Sequence[Values], state: State, shape: tuple[int, ...]) -> Real:
    """Angles of all rotation classes (s, *shape) [rad] at solved positions; those of groups with a closed form within one turn."""
    turning = model.angles
    out = np.zeros((len(turning.class_group), *shape))
    for group, classes in enumerate(turning.classes_of):
        angle: Values = 0.0
        if group in state.angle:
            angle = state.angle[group]
        elif group:
            angle = wrapped_angle(model, state, group)
        for rotation_class in classes:
            terms, shorter = turning.class_drives[rotation_class], model.program.shorter[rotation_class]
            if shorter < 0 or turning.class_group[shorter] != group:
                out[rotation_class] = angle
            else:
                out[rotation_class], terms = out[shorter], terms[-1:]
            for d, sign in terms:
                out[rotation_class] += sign * drives[d]
    return out


def _steps(start: Real | float, values: Real) -> Real:
    """Differences (..., n) between successive values, the first to ``start`` (...): `numpy.diff` with its prepend, at a fifth of
    the cost."""
    out = np.empty(values.shape)
    np.subtract(values[..., 1:], values[..., :-1], out=out[..., 1:])
    np.subtract(values[..., :1], np.asarray(start)[..., None], out=out[..., :1])
    return out


def _followed(raw: Real) -> Real:
    """Angles (..., n) unwrapped along the last axis; in place of a NaN stands the last known angle before it."""
    known = np.isfinite(raw)
    if not known.all():
        last = np.maximum.accumulate(np.where(known, np.arange(raw.shape[-1]), 0), axis=-1)
        raw = np.take_along_axis(raw, last, axis=-1)
    turns = np.cumsum(np.round(np.diff(raw) / TURN), axis=-1)
    return np.concatenate([raw[..., :1], raw[..., 1:] - TURN * turns], axis=-1)


def _turned(model: Model, change: Real) -> Real:
    """How far links turn (s, ..., n) by changes of their raw angles: up to whole turns, except where relations or Newton's method
    count these. A fast wheel of a gear train may turn by nearly whole turns from one point to the next."""
    counting = {group for block in model.blocks if block.kind in ("relation", "general") for group in block.angles}
    counted = np.array([group in counting for group in model.angles.class_group])
    up_to_turns = np.abs(change - TURN * np.round(change / TURN))
    return np.where(counted[: len(change)].reshape(-1, *[1] * (change.ndim - 1)), np.abs(change), up_to_turns)


def _follow(
    model: Model, place: Callable[[Real], Real], x: Real, raw: Real, steps: Real, fresh: Flags | None = None
) -> tuple[Real, Real, Real, Index]:
    """Unwrap angles along the path through points ``x`` (n, c), with points inserted between them where needed.

    Returns all points (m, c), their angles (s, ..., m) up to whole turns, these unwrapped along the path from its first point, and
    the numbers of ``x`` among the points (n,). ``raw`` (s, ..., n): the angles at ``x`` up to whole turns; ``place`` gives them at
    inserted points. Points are inserted where ``x`` advances by more than ``steps`` (c,) or links turn by more than
    ``LARGEST_TURN``. ``fresh`` (n,): points that no path connects to the one before.
    """
    own = np.arange(len(x))
    fresh = np.zeros(len(x), bool) if fresh is None else fresh
    for k in range(MOST_HALVINGS):
        if k == 0:
            far = np.nan_to_num(np.abs(np.diff(x, axis=0)) / steps).max(axis=1, initial=0.0)
            parts = np.where(far > FARTHEST_STEPS, 1.0, np.maximum(np.ceil(far - 1e-9), 1.0)).astype(int)
        else:
            turned = np.nan_to_num(_turned(model, np.diff(raw)))
            parts = np.where(turned.reshape(-1, len(x) - 1).max(axis=0, initial=0.0) > LARGEST_TURN, 2, 1)
        parts[fresh[1:]] = 1
        if (parts > 1).any():
            left = np.repeat(np.arange(len(parts)), parts - 1)
            share = np.concatenate([np.arange(1, p) / p for p in parts[parts > 1]])
            between = x[left] + share[:, None] * (x[left + 1] - x[left])
            x, raw = np.insert(x, left + 1, between, axis=0), np.insert(raw, left + 1, place(between), axis=-1)
            fresh = np.insert(fresh, left + 1, False)
            own = own + np.searchsorted(left + 1, own, side="right")
        elif k:
            break
    return x, raw, _followed(raw), own


class LinkAngles:
    """Unwrapped angles of the links at the frames of a motion.

    ``raw``: angles of the rotation classes (s, ...) up to whole turns; ``near``: these -> angles followed along the path, accurate
    to within half a turn. ``exact``: the drives' positions are the coordinates of their joints; else these differ by whole turns.
    """

    def __init__(self, model: Model, start: StartPose, raw: Callable[[], Real], near: Callable[[Real], Real], exact: bool = True):
        self.model, self.start, self.exact = model, start, exact
        self._raw, self._near = raw, near

    @lazy
    def class_angles(self) -> Real:
        """Angles of the rotation classes (s, ...) [rad]."""
        raw = self._raw()
        near = self._near(raw)
        return raw if near is raw else np.asarray(raw + TURN * np.round((near - raw) / TURN))

    def link(self, k: int) -> Real:
        """Angle of the frame of link ``k`` in the world [rad]."""
        turning = self.model.angles
        return np.asarray(self.class_angles[turning.rotation_class[k]] + turning.offset[k])

    def relative(self, p: int, q: int, about: AngleRange | None = None) -> Real:
        """Angle of link ``q`` minus that of link ``p`` [rad]; ``about``: it starts in or nearest to this range."""
        turns = self.start.turns(self.model.links[p], self.model.links[q], about)
        angle: Real = self.link(q) - self.link(p) + TURN * turns
        return angle

    def joint(self, name: str) -> Real:
        """Relative angle of the links of a turning joint, gear, belt or rack [rad]."""
        links = next(c.links for c in self.model.connections if c.name == name)
        p, q = (self.model.index[k] for k in links)
        return self.relative(p, q, self.start.ranges.get(name))


class GivenLinkAngles(LinkAngles, ABC):
    """Unwrapped angles from another source than rotation classes: a subclass gives the angle of each link."""

    def __init__(self, model: Model, start: StartPose, exact: bool = True):
        self.model, self.start, self.exact = model, start, exact

    @abstractmethod
    def link(self, k: int) -> Any:
        """Angle of a link [rad]."""


class UnwrappedAngles:
    """Angles of the rotation classes of a compiled mechanism along its motion, from the point ``at`` where they are known."""

    def __init__(self, model: Model, start: StartPose, at: Waypoint, exact: bool = True):
        self.model, self.start, self.at, self.exact = model, start, at, exact
        self.steps = largest_steps(model, COARSE)
        self._tables: dict[tuple[int, ...], _Table] = {}
        self.path = WaypointPath(at)

    def fresh(self, start: StartPose | None = None) -> UnwrappedAngles:
        """A copy for another motion, with waypoints of its own."""
        other = copy(self)
        other.start, other.path, other._tables = start or self.start, WaypointPath(self.at), {}
        return other

    def at_frames(self, frames: SolvedFrames, near: Callable[[Real], Real]) -> LinkAngles:
        """Angles of the links at frames; ``near``: raw angles of the classes -> followed angles, `along_parameter`, `along_drives`
        or `at_rest`."""
        return LinkAngles(self.model, self.start, partial(raw_angles, self.model, *frames), near, self.exact)

    def at_rest(self, raw: Real) -> Real:
        """Followed angles of a mechanism without moving drives: those of the point ``at``."""
        return np.asarray(self.at.class_angles)[:, None]

    # -- along one parameter ------------------------------------------------------------------------------------------
    def along_parameter(self, raw: Real, parameter: Real, place: PathFunction, laws: tuple[Law, ...] = ()) -> Real:
        """Followed angles at frames along a parameter (F,): the position of the only drive, or with ``laws`` the time.
        ``place``: parameters (n, 1) -> solved frames."""
        key = tuple(map(id, laws))  # the table keeps them alive
        table = self._tables.get(key)
        if table is None:
            table = self._tables[key] = self._table(laws)
        return table.near(parameter, raw, place)

    def _table(self, laws: tuple[Law, ...]) -> _Table:
        class_angles = np.asarray(self.at.class_angles)
        if laws:
            return _Table(self.model, 0.0, class_angles, _time_step(laws, self.steps), math.inf, laws)
        (drive,) = self.model.mechanism.drives
        turns = self.model.joints[self.model.joint_index[drive.joint]].coordinate == "angle"
        return _Table(self.model, float(self.at.drives[0]), class_angles, float(self.steps[0]), TURN if turns else math.inf)

    # -- several coordinates driven by forces -------------------------------------------------------------------------
    def along_drives(self, raw: Real, drives: Sequence[Values], time: Real, place: PathFunction) -> Real:
        """Followed angles at frames (F,) with any positions of the drives: from the waypoint before each frame, and from frame to
        frame in order of time. ``place``: times and positions of drives (n, 1 + d) -> solved frames."""
        order = np.argsort(time, kind="stable")
        x = np.column_stack([time, *drives])[order]
        points, before = self.path.before(x[:, 0])
        used, which = np.unique(before, return_inverse=True)
        known = self._known(points, used, place)
        at = np.searchsorted(which, np.arange(len(used)))  # where each waypoint is inserted
        places = np.insert(x, at, [_row(points[k]) for k in used], axis=0)
        fresh = np.insert(np.zeros(len(x), bool), at, True)
        followed = self._followed(places, np.insert(raw[:, order], at, known, axis=-1), fresh, place)
        starts = np.flatnonzero(fresh)
        shift = TURN * np.round((known - followed[:, starts]) / TURN)
        out = np.empty_like(raw)
        out[:, order] = (followed + np.repeat(shift, np.diff(np.append(starts, len(places))), axis=1))[:, ~fresh]
        return out

    def _followed(self, x: Real, raw: Real, fresh: Flags | None, place: PathFunction) -> Real:
        """Angles at times and positions of drives (n, 1 + d), followed from each point to the next, except to ``fresh`` ones."""
        *_, followed, own = _follow(
            self.model, lambda y: raw_angles(self.model, *place(y)), x, raw, np.append(math.inf, self.steps), fresh
        )
        return np.asarray(followed[:, own])

    def _known(self, points: list[Waypoint], used: Index, place: PathFunction) -> Real:
        """Angles (s, n) at the waypoints ``used`` (n,); unknown ones are followed from the last known waypoint and stored."""
        last = next(k for k in range(int(used[-1]), -1, -1) if points[k].class_angles is not None)
        if last < used[-1]:
            x = np.array([_row(w) for w in points[last : used[-1] + 1]])
            raw = np.column_stack([np.asarray(points[last].class_angles), raw_angles(self.model, *place(x[1:]))])
            for k, class_angles in enumerate(self._followed(x, raw, None, place).T, last):
                points[k] = replace(points[k], class_angles=class_angles)
        return np.array([points[k].class_angles for k in used]).T


def _row(at: Waypoint) -> Real:
    return np.append(at.time if math.isfinite(at.time) else 0.0, at.drives)


def _time_step(laws: Sequence[Law], steps: Real) -> float:
    """A step of time [s] in which no drive moves farther than its own step; infinite if none moves."""
    lengths = []
    for law, step in zip(laws, steps, strict=True):
        if not moves(law):
            continue
        t = np.linspace(0.0, law.duration, SAMPLES_A_CYCLE + 1)
        fastest = float(np.abs(law(t)[1]).max())
        lengths.append(min(law.duration / 32.0, step / fastest if fastest > 0.0 else math.inf))
    return min(lengths, default=math.inf)


class _Table:
    """Angles of the rotation classes along one parameter, tabulated on demand around ``at``, where they are known.

    ``turn``: interval of the parameter after which the mechanism may be back in its first position.
    """

    def __init__(self, model: Model, at: float, class_angles: Real, step: float, turn: float, laws: tuple[Law, ...] = ()):
        self.model, self.at, self.class_angles, self.step, self.turn, self.laws = model, at, class_angles, step, turn, laws
        self.known = np.array([at]), class_angles[:, None]  # replaced in one assignment: other threads may read it
        self.ends = [False, False]  # whether the table can go no farther down, up
        self.period: float | None = None
        self.tried = 0  # multiples of ``turn`` already checked as a period

    def near(self, parameter: Real, raw: Real, place: PathFunction) -> Real:
        """Followed angles (s, n) at parameters (n,), to within half a turn.

        Frames that form a fine enough path from the start are unwrapped directly; others are read from the table.
        """
        x = parameter
        if np.abs(_steps(self.at, x)).max(initial=0.0) <= self.step * (1.0 + 1e-9):
            turned = _steps(self.class_angles, raw)
            turns = np.round(turned / TURN)
            first, others = np.abs(turned - TURN * turns)[:, :1], _turned(self.model, turned[:, 1:])
            if max(first.max(initial=0.0), others.max(initial=0.0)) <= LARGEST_TURN:
                return np.asarray(raw - TURN * np.cumsum(turns, axis=1)) if turns.any() else raw
        known = np.clip(x[np.isfinite(x)], self.at - MOST_STEPS * self.step, self.at + MOST_STEPS * self.step)
        low, high = float(known.min(initial=self.at)), float(known.max(initial=self.at))
        self._look_for_period(high - low, place)
        if self.period is None:
            self._cover(low, high, place)
            return self._read(x)
        turns = np.floor((x - self.at) / self.period)
        gain = self._read(np.array([self.at, self.at + self.period]))
        return self._read(x - turns * self.period) + turns * TURN * np.round(np.diff(gain) / TURN)

    def _read(self, parameter: Real) -> Real:
        p, angles = self.known
        return np.array([np.interp(parameter, p, row) for row in angles])

    def _follow(self, x: Real, raw: Real, place: PathFunction) -> tuple[Real, Real, Real, Index]:
        return _follow(self.model, lambda y: raw_angles(self.model, *place(y)), x[:, None], raw, np.array([self.step]))

    def _look_for_period(self, span: float, place: PathFunction) -> None:
        for turns in CYCLES if self.period is None else ():
            if turns <= self.tried or span <= 1.01 * turns * self.turn:
                continue
            self.tried, end = turns, self.at + turns * self.turn
            self._cover(self.at, end, place)
            if self.ends[1]:
                return
            _, state, _ = place(np.array([[self.at], [end]]))
            if repeats(self.model, state, 0, 1):
                self.period = turns * self.turn
                return

    def _cover(self, low: float, high: float, place: PathFunction) -> None:
        """Extend the table to the range from ``low`` to ``high``, or as far as the mechanism can be assembled."""
        for up, wanted in ((1, high), (0, low)):
            sign = 1.0 if up else -1.0
            while not self.ends[up] and sign * (wanted - self.known[0][-up]) > 0.0:
                p, angles = self.known
                last = float(p[-up])
                count = math.ceil(abs(wanted - last) / self.step)
                x = np.linspace(
                    last,
                    wanted if count <= PLACES_AT_ONCE else last + sign * PLACES_AT_ONCE * self.step,
                    min(count, PLACES_AT_ONCE) + 1,
                )
                raw = np.concatenate([angles[:, -up, None], raw_angles(self.model, *place(x[1:, None]))], axis=-1)
                places, raw, followed_by, _ = self._follow(x, raw, place)
                lost = ~np.isfinite(raw).all(axis=0)
                if lost.any():
                    self.ends[up] = True
                new = slice(1, int(np.argmax(lost)) if lost.any() else None)
                more, followed = places[new, 0], followed_by[:, new]
                self.known = (
                    (np.append(p, more), np.append(angles, followed, axis=1))
                    if up
                    else (np.append(more[::-1], p), np.append(followed[:, ::-1], angles, axis=1))
                )


def along_designs(model: Model, time: Real, frames: SolvedFrames, laws: tuple[Law, ...], place: PathFunction) -> LinkAngles:
    """Angles at times (F,) of a mechanism computed for several designs together; ``place``: times (n, 1) -> solved frames."""

    def raw_at(x: Real) -> Real:
        return raw_angles(model, *place(x))

    start = raw_at(np.zeros((1, 1)))

    def near(raw: Real) -> Real:
        x, steps = np.append(0.0, time)[:, None], _steps_of_designs(model, laws)
        *_, followed, own = _follow(model, raw_at, x, np.concatenate([start, raw], axis=-1), steps)
        return np.asarray(followed[..., own[1:]])

    return LinkAngles(model, start_pose(model, start), partial(raw_angles, model, *frames), near)


def times_of_designs(model: Model, time: Real, laws: tuple[Law, ...]) -> tuple[Real, Index]:
    """Times (n,) from the start through those of the frames (F,), close enough to follow angles unless links turn by more than
    `LARGEST_TURN` between them; and the numbers of the frames among them (F,)."""
    x = np.append(0.0, time)[:, None]
    places, *_, own = _follow(model, lambda y: np.zeros((0, len(y))), x, np.zeros((0, len(x))), _steps_of_designs(model, laws))
    return places[:, 0], own[1:]


def _steps_of_designs(model: Model, laws: tuple[Law, ...]) -> Real:
    return np.array([_time_step(laws, largest_steps(model, COARSE))])
