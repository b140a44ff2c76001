"""A mechanism ready to run, and its motion where it can be assembled."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from mechcore.accuracy import DEFAULT, Accuracy
from mechcore.arrays import Flags, Real, Values, numbers
from mechcore.branches.assembly import Assembly
from mechcore.branches.modes import TWO_MODES
from mechcore.branches.paths import BranchPath, path_for
from mechcore.branches.singular_points import SingularPoints, find_singular_points, needs_span, passages
from mechcore.branches.unwrapped import SolvedFrames, UnwrappedAngles
from mechcore.compiled.motion import Executor, motion_program
from mechcore.constants import MOST_TURNS, TURN
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import place_all
from mechcore.kinematics.singular_interpolation import make_interpolants
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.motion import Motion
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism

T = TypeVar("T")
DriveValues = list[tuple[Real, Real | float, Real | float]]  # position, speed, acceleration (F,) of each drive


@dataclass(frozen=True, eq=False)
class Compiled:
    """A mechanism ready to run: its model and its assembly at the start of its drives."""

    model: Model
    assembly: Assembly
    start: tuple[float, ...]  # drive positions for which the assembly was made
    angles: UnwrappedAngles  # of its links, computed on demand
    singular_points: SingularPoints | None = None  # where assembly modes meet along the drives' laws
    paths: list[BranchPath] = field(default_factory=list)  # already followed, kept for further frames on them
    accuracy: Accuracy = DEFAULT
    executor: Executor = "numpy"  # of the program of steps
    cache: dict[Callable[[Compiled], Any], Any] = field(default_factory=dict, init=False, repr=False)  # see `cached`

    @cached_property
    def travel_bound(self) -> float:
        """Bound of drive positions [rad or m] below which no drive can have travelled too far from its start for a run."""
        return TURN * MOST_TURNS * min(1.0, self.model.length_scale) - max((abs(q) for q in self.start), default=0.0)

    @cached_property
    def needs_path(self) -> bool:
        """Whether groups must be followed along a path; with gears a turn of the drive need not return all links to their start."""
        return bool(self.assembly.starts) or (bool(self.model.relations) and any(b.kind in TWO_MODES for b in self.model.blocks))

    @property
    def mechanism(self) -> Mechanism:
        return self.model.mechanism

    def cached(self, work: Callable[[Compiled], T]) -> T:
        """``work(self)``, computed at the first call and stored in ``cache``, like `Model.cached`."""
        if work not in self.cache:
            self.cache[work] = work(self)
        result: T = self.cache[work]
        return result


def drive_values(
    mechanism: Mechanism, time: Real, given: Mapping[str, tuple[ArrayLike, ArrayLike, ArrayLike]] | None = None
) -> DriveValues:
    """Positions, speeds and accelerations of the drives at times (F,) by their laws, or as ``given`` by names of joints."""
    values: DriveValues = []
    for d in mechanism.drives:
        if given is None and isinstance(d.law, ConstantSpeed):  # constant rates stay single numbers
            turned = d.law.speed * time
            values.append((turned + d.law.start if d.law.start else turned, float(d.law.speed), 0.0))
            continue
        q, v, a = (np.asarray(x, float) for x in (given[d.joint] if given is not None and d.joint in given else d.law(time)))
        if not q.shape == v.shape == a.shape == time.shape:
            q, v, a = (np.broadcast_to(x, time.shape) for x in (q, v, a))
        values.append((q, v, a))
    return values


def motion_or_nan(
    compiled: Compiled, time: ArrayLike, drives: Mapping[str, tuple[ArrayLike, ArrayLike, ArrayLike]] | None = None
) -> Motion:
    """Motion at times (F,) [s], or at given ``drives`` as in `solve_motion`; frames that cannot be assembled are NaN."""
    time = numbers(time)
    return place(compiled, time, drive_values(compiled.mechanism, time, drives), given=drives is not None).motion


class PlacedMotion(NamedTuple):
    """A motion; if groups are followed, their path and the ``parameter`` of the frames on it; the known singular points."""

    motion: Motion
    path: BranchPath | None
    parameter: Real | None
    singular_points: SingularPoints | None


def place(compiled: Compiled, time: Real, values: DriveValues, *, given: bool) -> PlacedMotion:
    """The motion at times (F,) [s] and values of the drives; ``given``: these are not those of the laws."""
    model = compiled.model
    positions = [v[0] for v in values]
    constants = compiled.assembly.constants
    solved, parameter, path = model, None, None
    starts: Mapping[str, Real] | None = None
    modes: Sequence[Real | float] = compiled.assembly.modes
    interpolants, passed = None, []
    singular_points = compiled.singular_points
    still = not given and not model.mechanism.moving
    if still:
        starts = {name: np.broadcast_to(x, (len(time), *np.shape(x))) for name, x in compiled.assembly.starts.items()}
    elif compiled.needs_path and given and len(positions) > 1 and len(time):
        starts = compiled.angles.path.starts(model, compiled.assembly, time, np.stack(positions, axis=-1))
    elif compiled.needs_path and len(time):
        path = _path(compiled, time, positions, given=given)
        solved, singular_points = path.model, path.singular_points
        parameter = time if path.by_time else positions[0]
        starts = path.starts(parameter)
    elif not given and len(time) and model.cached(needs_span) and _beyond(singular_points, span := float(np.max(time))):
        singular_points = find_singular_points(model, compiled.assembly.modes, compiled.assembly.starts, span=span)
        compiled = replace(compiled, singular_points=singular_points)  # for further times within that span
    if singular_points is not None and singular_points.points:
        law_time, scale = _law_time(compiled, singular_points, time, values, given=given)
        if law_time is not None:
            modes = [m * singular_points.signs(i, law_time) for i, m in enumerate(modes)]
            own = None if path is None else partial(_own_starts, path)
            interpolants = make_interpolants(solved, singular_points, compiled.assembly.modes, law_time, scale, constants, own)
            if not given and singular_points.by_drive:
                passed = passages(singular_points, model.mechanism.drives[0].law, time, positions[0])
            elif not given:
                passed = singular_points.within(float(np.min(law_time)), float(np.max(law_time)))
    program = None if interpolants or solved is not model else motion_program(model, compiled.executor, len(time))
    if program is None:
        state = place_all(solved, positions, modes, starts, interpolants, constants, compiled.accuracy.position)
    else:
        state, origins = program.place_all(positions, modes, starts, constants, len(time), compiled.accuracy.position)
    source = compiled if compiled.accuracy.differentiation == "exact" else replace(compiled, accuracy=DEFAULT)  # at any times
    at_times: Callable[[Real], Motion] | None = None if given else lambda t: motion_or_nan(source, t)
    in_time = path.by_time if path is not None else len(positions) > 1 or not (singular_points is None or singular_points.by_drive)
    frames = positions, state, (*model.designs, len(time))
    near = source.angles.at_rest if still else partial(_angles, source, frames[0], time, in_time=not given and in_time)
    angles = source.angles.at_frames(frames, near)
    by_c = None if program is None else (program, origins)
    motion = Motion(model, time, values, state, angles, interpolants, passed, at_times, compiled.accuracy, by_c)
    return PlacedMotion(motion, path, parameter, singular_points)


def _beyond(known: SingularPoints | None, span: float) -> bool:
    return known is None or span > known.period


def _angles(compiled: Compiled, positions: Sequence[Values], time: Real, raw: Real, *, in_time: bool) -> Real:
    """Followed angles of the rotation classes for ``raw`` ones at positions of the drives; ``in_time``: the drives follow their
    laws, so the angles depend on time alone."""
    drives, unwrapped = compiled.mechanism.drives, compiled.angles

    def placed(time: Real, given: Real | None = None) -> SolvedFrames:
        rest = np.zeros(len(time))
        wanted = None if given is None else {d.joint: (q, rest, rest) for d, q in zip(drives, given.T, strict=True)}
        motion = motion_or_nan(compiled, time, wanted)
        return [d[0] for d in motion.drives], motion.state, motion.shape

    if in_time:
        return unwrapped.along_parameter(raw, time, lambda x: placed(x[:, 0]), tuple(d.law for d in drives))
    if len(drives) > 1:
        return unwrapped.along_drives(raw, positions, time, lambda x: placed(x[:, 0], x[:, 1:]))
    return unwrapped.along_parameter(raw, np.asarray(positions[0]), lambda x: placed(np.zeros(len(x)), x))


def _path(compiled: Compiled, time: Real, positions: Sequence[Real], *, given: bool) -> BranchPath:
    """The path that the frames need: a kept one if it covers them, else a new one."""
    for path in compiled.paths:
        if not (path.by_time and given):
            wanted = time if path.by_time else positions[0]
            one = len(positions) == 1 and not path.by_time
            if one and given and path.covers(wanted):
                return path
            if (path.by_time or (one and not path.continuation.singular)) and bool(np.all(path.reached(wanted))):
                return path
    path = path_for(compiled.model, compiled.assembly, compiled.start, time, positions, given=given)
    compiled.paths[:] = [path, *compiled.paths[:3]]
    return path


def reached(compiled: Compiled, q: Real) -> Flags:
    """Whether the followed branch reaches positions (n,) of the only drive, which have been solved.

    Beyond a limit of a continued group Newton's method may have found another branch. All True if no path covers the positions.
    """
    for path in compiled.paths:
        if not path.by_time and path.covers(q):
            return path.reached(q)
    return np.ones(np.shape(q), bool)


def _own_starts(path: BranchPath, law_time: Real) -> dict[str, Real]:
    """Newton starts on a path at law times (F,)."""
    return path.starts(law_time if path.by_time else law_time + path.start)


def _law_time(
    compiled: Compiled, singular_points: SingularPoints, time: Real, values: DriveValues, *, given: bool
) -> tuple[Real | None, tuple[Real | float, Real | float]]:
    """The frames' law time, along which the singular points are given, and its first two derivatives by time.

    It is the travel of the only drive, or time; None if it is time and the frames' drive positions are ``given``.
    """
    if singular_points.by_drive:
        q, v, a = values[0]
        return q - compiled.start[0], (v, a)
    return (None, (1.0, 0.0)) if given else (time, (1.0, 0.0))
