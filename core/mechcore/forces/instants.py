"""Instants at which the powers of a run are integrated: its frames, and both sides of jumps of the powers between them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.cams.placement.plane import segment_of
from mechcore.effects.base import LOSSES
from mechcore.effects.registry import effects_of
from mechcore.forces.cam_rating import placed_cams
from mechcore.forces.kinetostatics import Forces
from mechcore.laws.factors import jumps
from mechcore.laws.timed import next_break, timed
from mechcore.motion.motion import Motion
from mechcore.numerics.interpolation import integral_so_far

LEAST_JUMP = 1e-3  # part of the largest velocity or acceleration of a cam's law: a smaller jump does not count
NEAR = 1e-9  # part of a frame's step between the two sides of a jump
NEAR_IN_RUN = 4e-12  # part of the run: arguments so close to a knot of a law are moved onto it
ROUNDING = 8.0  # units in the last place
MOST_CHANGES = 0.25  # part of the frames: more frequent changes are resolved by the frames, or rounding
LEAST_CHANGES = 8  # changes that are located even if there are few frames
_WITHIN = np.linspace(0.0, 1.0, 65)  # places in a step between which a change is located: 64^5 = 1e9


class Instants(NamedTuple):
    """``time`` (n,) [s]; ``before``: which of them are just before a jump, the next one being just after it. ``parts``: the forces
    at the frames, and at both sides of the jumps; ``order`` puts their concatenated values into the order of time."""

    time: Real
    before: Index
    parts: tuple[Forces, ...]
    order: Index

    def together(self, *values: Real) -> Real:
        """Values (n, ...) at all instants from those of the ``parts``."""
        return values[0] if len(values) == 1 else np.concatenate(values)[self.order]

    @property
    def frames(self) -> Index:
        """Which instants are frames."""
        return np.setdiff1d(np.arange(len(self.time)), [self.before, self.before + 1])


def instants(forces: Forces) -> Instants:
    """The frames of a run and both sides of its jumps; frames only where the motion is not available at other times."""
    time = forces.motion.time
    pairs = sides_of_jumps(forces.motion, forces.jumps)
    if not len(pairs):
        return Instants(time, np.zeros(0, int), (forces,), np.arange(len(time)))
    k = np.searchsorted(pairs[:, 1], time, side="left")
    apart = (k == len(pairs)) | (time < pairs[np.minimum(k, len(pairs) - 1), 0])  # others are replaced by the two sides
    every = np.concatenate([np.where(apart, time, np.nan), pairs.ravel()])
    order = np.argsort(every, kind="stable")[: int(apart.sum()) + pairs.size]  # NaN comes last
    return Instants(every[order], np.flatnonzero(np.isin(order, len(time) + 2 * np.arange(len(pairs)))),
                    (forces, forces.at_times(pairs.ravel())), order)  # fmt: skip


def energies(forces: Forces) -> Real:
    """Kinetic, potential, work done so far, dissipated so far (F, 4) [J], as `Forces.energy`; the powers of a prescribed motion are
    integrated from jump to jump."""
    if forces.jumps is not None or len((at := instants(forces)).before) == 0:
        return forces.energy
    sums = [np.column_stack([f.power_supplied + f.power_by_cause(["process"]), -f.power_by_cause(LOSSES)]) for f in at.parts]
    powers = at.together(*sums)
    known = np.isfinite(powers)
    parts, so_far = [], np.zeros(2)
    for rows in np.split(np.arange(len(at.time)), at.before + 1):
        parts.append(so_far + np.column_stack([integral_so_far(p, at.time[rows]) for p in np.where(known, powers, 0.0)[rows].T]))
        so_far = parts[-1][-1]
    sums_so_far = np.where(np.logical_and.accumulate(known), np.concatenate(parts), np.nan)
    at_frames = np.searchsorted(at.time, forces.motion.time, side="right") - 1
    return np.column_stack([forces.kinetic_energy, forces.potential_energy, sums_so_far[at_frames]])


def sides_of_jumps(motion: Motion, under_forces: Callable[[float], Real] | None = None) -> Real:
    """Times (n, 2) [s] just before and just after the jumps of a run, in order and apart from each other; none where the motion is
    not available at other times. ``under_forces``: gives those of a motion under forces up to a time, see `Simulation.jumps`."""
    if motion.at_times is None or motion.frames < 2:
        return np.zeros((0, 2))
    start, end = float(motion.time[0]), float(motion.time[-1])
    if under_forces is not None:
        pairs_of_run = under_forces(end)
        return pairs_of_run[pairs_of_run[:, 0] > start]
    near = max(NEAR * (end - start) / (motion.frames - 1), NEAR_IN_RUN * (end - start), ROUNDING * float(np.spacing(end)))
    pairs: list[list[float]] = []
    for t in sorted([*_breaks(motion, start, end), *_changes(motion, motion.at_times, near)]):
        low, high = max(t - near, start), min(t + near, end)
        if pairs and low <= pairs[-1][1]:
            pairs[-1][1] = high
        else:
            pairs.append([low, high])
    return np.array(pairs).reshape(-1, 2)


def _breaks(motion: Motion, start: float, end: float) -> Iterator[float]:
    """Times [s] within a run at which laws of time state breakpoints, except laws with more breakpoints than there are frames."""
    effects = effects_of(motion.mechanism)
    yield from (t for e in effects for t in e.breaks if start <= t <= end)
    for law in timed([*(d.law for d in motion.mechanism.drives), *(law for e in effects for law in e.laws)]):
        times = [start]
        while times[-1] < end and len(times) <= motion.frames:
            times.append(next_break(law, times[-1]))
        if times[-1] >= end:
            yield from times[1:-1]


def _forms(motion: Motion) -> list[Real]:
    """Numbers (F,) that change where the force of a load may have a jump or a kink, or the acceleration of a cam's law jumps."""
    numbers: list[Real | Index] = [e.phase(motion) for e in effects_of(motion.mechanism) if e.piecewise]
    for cam in placed_cams(motion):
        law = cam.cam.law
        places = np.unique([j.angle for j in jumps(law, (1, 2), LEAST_JUMP, law.repeats)])
        if len(places):
            numbers.append(segment_of(cam, motion, places))
    return [np.broadcast_to(x, motion.shape) for x in numbers]


def _changes(motion: Motion, motion_at: Callable[[Real], Motion], near: float) -> Iterator[float]:
    """Times [s] at which one of the `_forms` changes, except forms that change at many frames."""
    frames = _forms(motion)
    if not frames:
        return
    start, end = motion.time[0], motion.time[-1]
    ends = np.array([start, start + near, end - near, end])
    for number, (inner, outer) in enumerate(zip(frames, _forms(motion_at(ends)), strict=True)):
        t = np.concatenate([ends[:2], motion.time[1:-1], ends[2:]])
        form = np.concatenate([outer[:2], inner[1:-1], outer[2:]])
        while len(k := np.flatnonzero((form[1:] != form[:-1]) & np.isfinite(form[1:] - form[:-1]))):
            low, high = t[k], t[k + 1]
            if len(k) > max(MOST_CHANGES * motion.frames, LEAST_CHANGES):
                break
            if (high - low <= near).all():
                yield from 0.5 * (low + high)
                break
            t = (low[:, None] + (high - low)[:, None] * _WITHIN).ravel()
            form = _forms(motion_at(t))[number]
