"""Quantities whose errors are estimated, and their poles at singular positions that a motion passes between two frames.

Near a pole the forces or the rates of a group grow with the reciprocal of the distance from the singular position, so that they
have no bound between the frames. The unknowns of a group are N / D, where D is the determinant of its columns. Where D changes its
sign between two frames and N does not vanish with it, there is a pole, which no interpolation of the frames shows. Where both
vanish together (a parallelogram that passes straight through its flat position) there is none.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Real
from mechcore.forces.kinetostatics import Forces
from mechcore.kinematics.columns import matrix_of
from mechcore.motion.motion import Motion
from mechcore.numerics.interpolation import between
from mechcore.records import dataclass
from mechviz.quantities.items import joints_of, links_of

LEAST_SCALE = 1e-6  # smallest scale of a quantity, relative to the largest peak of its kind
STILL_TRAVEL = 1e-9  # relative to the mechanism's size, or [rad]: a smaller range of motion counts as rounding


@dataclass(frozen=True, eq=False)
class CheckedQuantity:
    """A quantity whose errors are estimated: its ``values`` (F, n), their first and second time derivatives (``rate``, ``second``)
    where they are known, and the ``scale`` to which errors are relative.

    ``kind``: "position", "velocity", "acceleration" or "reaction"; efforts of drives are of the last."""

    name: str
    kind: str
    values: Real
    scale: float
    rate: Real | None = None
    second: Real | None = None
    is_angle: bool = False  # an angle of a link

    def interpolated(self, time: Real, t: Real, order: int) -> Real:
        """Interpolated values (n, ...) at times between the frames."""
        return between(time, self.values, t, order, self.rate, self.second)


def quantities(motion: Motion, forces: Forces | None) -> list[CheckedQuantity]:
    """Poses, velocities and accelerations of all moving links, and positions of traced points; with forces also reactions and
    efforts.

    Errors of lengths are relative to the mechanism's size, those of angles to a radian, all others to the peak of the quantity, in
    which frames without a value are left out. Accelerations that are rounding relative to the squares of velocities are scaled by
    these squares. The rates of a mechanism at rest are rounding, and so is their peak: they are scaled by one mechanism size, or
    one radian, in the time of the run.
    """
    return list(each_quantity(motion, forces))


def each_quantity(motion: Motion, forces: Forces | None) -> Iterator[CheckedQuantity]:
    """The quantities of `quantities` one by one, which saves memory in long runs of many bodies."""
    yield from _kinematics(motion)
    yield from _points(motion)
    if forces is not None:
        yield from reactions(motion, forces)


def _kinematics(motion: Motion) -> Iterator[CheckedQuantity]:
    moving, parts = links_of(motion)[1:], {"place": slice(0, 2), "angle": slice(2, 3)}
    peaks = {what: [0.0, 0.0] for what in parts}
    for k in moving:
        for d, rows in enumerate((motion.velocity(k), motion.acceleration(k))):
            for what, part in parts.items():
                peaks[what][d] = max(peaks[what][d], _peak(rows[:, part]))
    pace = rest_rate_scale(motion) if stands_still(motion) else 0.0
    for k in moving:
        every = motion.pose(k), motion.velocity(k), motion.acceleration(k)
        for what, part in parts.items():
            unit, (fast, strong) = motion.model.length_scale if what == "place" else 1.0, peaks[what]
            x, v, a = (rows[:, part] for rows in every)
            yield CheckedQuantity(f"{what} of {k}", "position", x, unit, v, a, is_angle=what == "angle")
            if fast:
                yield CheckedQuantity(f"velocity of {k} ({what})", "velocity", v, max(_peak(v), LEAST_SCALE * fast, unit * pace), a)
            if strong:
                scale = max(_peak(a), LEAST_SCALE * strong, LEAST_SCALE * fast**2 / unit, unit * pace * pace)
                yield CheckedQuantity(f"acceleration of {k} ({what})", "acceleration", a, scale)


def stands_still(motion: Motion) -> bool:
    """Whether no link moves by more than rounding in the run; False for a single frame."""
    if motion.frames < 2:
        return False
    unit = np.array([motion.model.length_scale, motion.model.length_scale, 1.0])
    return all(bool((np.ptp(motion.pose(k), axis=0) <= STILL_TRAVEL * unit).all()) for k in motion.model.links[1:])


def rest_rate_scale(motion: Motion) -> float:
    """The rate [1/s] that scales the rates of a mechanism at rest: one over the duration of the run, 1 for a single instant."""
    return 1.0 / (float(np.ptp(motion.time)) or 1.0)


def _points(motion: Motion) -> Iterator[CheckedQuantity]:
    """Positions of traced points. They are checked as well because even on a link in uniform rotation they move on an arc."""
    for link, point in motion.mechanism.traced:
        x, v, a = (np.asarray(motion.point(link, point, d)) for d in (0, 1, 2))
        yield CheckedQuantity(f"point {point} of {link}", "position", x, motion.model.length_scale, v, a)


def reactions(motion: Motion, forces: Forces) -> Iterator[CheckedQuantity]:
    """The quantities of reactions and of efforts of the drives."""
    names = [j.name for j in joints_of(motion)]
    peaks = [(_peak(r[:, :2]), _peak(r[:, 2:])) for r in map(forces.reaction, names)]
    largest = max((force for force, _ in peaks), default=0.0)
    moment = max([LEAST_SCALE * largest * motion.model.length_scale, *(couple for _, couple in peaks)])
    for name, (force, couple) in zip(names, peaks, strict=True):
        r = forces.reaction(name)
        if largest:
            yield CheckedQuantity(f"reaction {name}", "reaction", r[:, :2], max(force, LEAST_SCALE * largest))
        if couple > LEAST_SCALE * moment:
            yield CheckedQuantity(f"couple {name}", "reaction", r[:, 2:], couple)
    for drive in motion.mechanism.drives:
        effort = forces.effort(drive.joint)[:, None]
        if (peak := _peak(effort)) > 0.0:
            yield CheckedQuantity(f"effort {drive.joint}", "reaction", effort, peak)


def _peak(values: Real) -> float:
    """Largest absolute value, without values that are not finite."""
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


def measured_interpolation_errors(
    coarse: list[CheckedQuantity], time: Real, fine: list[CheckedQuantity], t: Real, order: int
) -> dict[str, Real]:
    """Relative errors (n,) by quantity: interpolation of ``coarse`` from frames at ``time`` to the times ``t`` (n,), compared with
    the values of ``fine`` there."""
    out = {}
    for a, b in zip(coarse, fine, strict=True):
        error = np.abs(a.interpolated(time, t, order) - b.values)
        out[a.name] = np.max(error, axis=1) / a.scale
    return out


MARKED_JUMP = 1e-3  # relative to the scale: smaller jumps may be rounding next to the singular position
NEAREST_POLE = 0.01  # distance from a pole at which values are stated, in spacings of frames: at the pole itself they are infinite


@dataclass(frozen=True)
class Passage:
    """A singular position between a frame and the next, at the ``fraction`` of their spacing."""

    frame: int
    fraction: float


def passages_of(motion: Motion) -> list[Passage]:
    """The singular positions between the frames of a motion."""
    return [passage for rows, part in motion.parts for passage in _passages(np.asarray(rows), part)]


def _passages(rows: NDArray[np.intp], part: Motion) -> Iterator[Passage]:
    for block, cols in zip(part.model.blocks, part.columns, strict=True):
        if block.kind in ("check", "relation"):
            continue
        if cols.direct is not None:
            determinant: Any = 1.0 / cols.inverse
        else:
            matrix, _ = matrix_of(cols)
            if matrix.shape[-1] != matrix.shape[-2]:
                continue
            determinant = np.linalg.det(matrix)
        d = np.broadcast_to(determinant, (part.frames,))
        for k in np.flatnonzero((d[:-1] * d[1:] < 0.0) & (np.diff(rows) == 1)):
            yield Passage(int(rows[k]), float(d[k] / (d[k] - d[k + 1])))


def pole_size(passage: Passage, q: CheckedQuantity) -> float:
    """Size of a quantity at the distance `NEAREST_POLE` from a singular position, relative to its scale; 0 where it has no pole
    there.

    A pole shows as a jump that is larger than the changes before and after it, and of the opposite sign.
    """
    k = passage.frame
    if q.kind == "position" or not 0 < k < len(q.values) - 2:
        return 0.0
    before, jump, after = np.diff(q.values[k - 1 : k + 3], axis=0)
    marked = np.abs(jump) > np.maximum(np.maximum(np.abs(before), np.abs(after)), MARKED_JUMP * q.scale)
    pole = marked & (jump * before < 0.0) & (jump * after < 0.0)
    if not pole.any():
        return 0.0
    strength = np.abs(jump[pole]).max() * passage.fraction * (1.0 - passage.fraction)  # A of A / x, x in spacings of frames
    return float(strength / NEAREST_POLE / q.scale)
