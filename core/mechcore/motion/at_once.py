"""Velocities and accelerations of all links at once, from the equations of all joints in absolute coordinates.

Nothing is split into loops or Assur groups: every joint, relation and drive gives its equations in the velocities (x, y, angle)
of its two links, and all are solved together. That is the usual account of multibody dynamics, and a check of the other way.
Lengths are in units of the mechanism's size.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.constants import SINGULAR
from mechcore.kinematics.program import LinearConstraint
from mechcore.motion.motion import Motion
from mechcore.records import dataclass

Row = dict[int, Any]
"""Coefficients by the numbers of coordinates, three of each link: numbers, or arrays over frames."""

WORK = 200_000_000  # third powers of the unknowns, over the frames at which rates are checked: seconds
MOST = int(WORK ** (1.0 / 3.0))  # unknowns of a motion of which one frame is checked
RANK = 1e-12  # of the least singular value to the largest


class Rows:
    """The equations of a motion's joints at ``frames``, one number or a slice."""

    def __init__(self, motion: Motion, frames: Any):
        self.motion, self.model, self.frames = motion, motion.model, frames

    def at(self, values: Any) -> Any:
        """Values of the motion at the frames."""
        return np.broadcast_to(values, self.motion.frames)[self.frames]

    def joint(self, j: int) -> Iterator[Row]:
        """What a joint ties: two equations of its point, or one across its guide; one more where it does not turn."""
        joint, (p, q) = self.model.joints[j], self.model.ends[j]
        x, y = self._point(j, {p: 1.0, q: -1.0})
        if joint.slide is None:
            yield from (x, y)
        else:
            d = self.at(self.motion.guide(j))
            yield {c: d.real * y.get(c, 0.0) - d.imag * x.get(c, 0.0) for c in x | y}
        if not joint.turns:
            yield {3 * p + 2: 1.0, 3 * q + 2: -1.0}

    def slide(self, j: int) -> Row:
        """The rate of a sliding joint's coordinate: relative velocity along the guide at the sliding point."""
        d = self.at(self.motion.guide(j))
        owner, other = self.owner(j)
        x, y = self._point(j, {other: 1.0, owner: -1.0})
        return {c: d.real * x.get(c, 0.0) + d.imag * y.get(c, 0.0) for c in x | y}

    def coordinate(self, j: int) -> Row:
        """The rate of the coordinate that a drive on this joint prescribes."""
        p, q = self.model.ends[j]
        return self.slide(j) if self.model.joints[j].slide is not None else {3 * q + 2: 1.0, 3 * p + 2: -1.0}

    def relation(self, constraint: LinearConstraint) -> Row:
        """The rate of a relation between coordinates."""
        relation = next(r for r in self.model.relations if r.name == constraint.name)
        angles, slides = list(relation.angles), list(constraint.slides)
        if relation.curve is not None and constraint.curve is not None:
            slope = self.at(self.motion.state.bends[self.model.relations.index(relation)][1])
            angles += [(link, slope * c) for link, c in relation.curve.angles]
            slides += [(j, slope * c) for j, c in constraint.curve.slides]
        return self.sum(angles, slides)

    def sum(self, angles: Any, slides: Any) -> Row:
        """A sum of angular rates (link, factor [m]) and rates of slides (joint, factor)."""
        row: Row = {}
        for link, c in angles:
            k = 3 * self.model.index[link] + 2
            row[k] = row.get(k, 0.0) + c / self.model.length_scale
        for j, c in slides:
            for k, value in self.slide(j).items():
                row[k] = row.get(k, 0.0) + c * value
        return row

    def owner(self, j: int) -> tuple[int, int]:
        """The link with the guide, and the other."""
        p, q = self.model.ends[j]
        return (p, q) if self.model.joints[j].guide == 0 else (q, p)

    def _point(self, j: int, signs: Mapping[int, float]) -> tuple[Row, Row]:
        """Velocity of the joint's point as a point of links, added up with signs."""
        x: Row = {}
        y: Row = {}
        for k, sign in signs.items():
            arm = self.arm(j, k) / self.model.length_scale
            x |= {3 * k: sign, 3 * k + 2: -sign * arm.imag}
            y |= {3 * k + 1: sign, 3 * k + 2: sign * arm.real}
        return x, y

    def arm(self, j: int, k: int) -> Any:
        """From the origin of a link to the joint's point, where it is at the moment [m]."""
        return self.at(self.motion.arm(k, j, self.model.ends[j].index(k)))


def rates_at_once(motion: Motion, frames: slice) -> tuple[Real, Real, int]:
    """Velocities and accelerations (frames, links, 3) [m/s, rad/s; m/s^2, rad/s^2] of moving links, and the number of equations.

    Where they do not decide all rates, at singular positions, those that are shortest.
    """
    rows, model = Rows(motion, frames), motion.model
    scale, size = model.length_scale, 3 * len(model.links)
    count = len(rows.at(0.0))
    table: list[Row] = []
    driven: list[tuple[int, int]] = []  # number of the row, joint
    for j in range(len(model.joints)):
        table += rows.joint(j)
    table += [rows.relation(constraint) for constraint in model.constraints]
    for j in model.driven:
        driven.append((len(table), j))
        table.append(rows.coordinate(j))
    matrix = np.zeros((count, len(table), size))
    for r, row in enumerate(table):
        for c, value in row.items():
            matrix[:, r, c] += value
    inverse = np.linalg.pinv(matrix[:, :, 3:], rcond=RANK)

    def solved(right: Real) -> Real:
        rates = np.zeros((count, size))
        rates[:, 3:] = (inverse @ right[..., None])[..., 0]
        return rates

    def prescribed(right: Real, derivative: int) -> Real:
        for r, j in driven:
            unit = scale if model.joints[j].slide is not None else 1.0
            right[:, r] += motion.coordinate(model.joints[j].name)[frames, derivative] / unit
        return right

    first = solved(prescribed(np.zeros((count, len(table))), 1))
    second = solved(prescribed(_quadratic(rows, first, len(table)), 2))
    unit = np.tile([scale, scale, 1.0], len(model.links))
    shape = (count, len(model.links), 3)
    return (first * unit).reshape(shape)[:, 1:], (second * unit).reshape(shape)[:, 1:], len(table)


def _quadratic(rows: Rows, first: Real, equations: int) -> Real:
    """What centripetal and Coriolis accelerations, and the bends of curves, leave to the accelerations (frames, equations)."""
    model, scale = rows.model, rows.model.length_scale
    right = np.zeros((len(first), equations))
    turn = first[:, 2::3]
    rate = {j: _times(rows.slide(j), first) for j, joint in enumerate(model.joints) if joint.slide is not None}

    def drawn_in(j: int, plus: int, minus: int) -> Any:
        """Centripetal acceleration of the joint's point on one link more than on the other, in units of the size."""
        a, b = (turn[:, k] ** 2 * rows.arm(j, k) for k in (plus, minus))
        return (a - b) / scale

    def along(j: int) -> Any:
        owner, other = rows.owner(j)
        return np.real(np.conj(rows.at(rows.motion.guide(j))) * drawn_in(j, other, owner))

    r = 0
    for j, joint in enumerate(model.joints):
        p, q = model.ends[j]
        pull = drawn_in(j, p, q)
        if joint.slide is None:
            right[:, r], right[:, r + 1] = pull.real, pull.imag
            r += 2
        else:
            owner, other = rows.owner(j)
            sign = 1.0 if other == p else -1.0
            across = np.imag(np.conj(rows.at(rows.motion.guide(j))) * pull)
            right[:, r] = across + sign * 2.0 * turn[:, owner] * rate[j]
            r += 1
        r += not joint.turns
    for constraint in model.constraints:
        relation = next(t for t in model.relations if t.name == constraint.name)
        right[:, r] = sum(c * along(j) for j, c in constraint.slides)
        if relation.curve is not None and constraint.curve is not None:
            _, slope, bend = (rows.at(b) for b in rows.motion.state.bends[model.relations.index(relation)])
            argument = scale * _times(rows.sum(relation.curve.angles, constraint.curve.slides), first)
            right[:, r] += slope * sum(c * along(j) for j, c in constraint.curve.slides) - bend * argument**2 / scale
        r += 1
    for j in model.driven:
        if model.joints[j].slide is not None:
            right[:, r] = along(j)
        r += 1
    return right


def _times(row: Row, rates: Real) -> Real:
    return np.asarray(sum(value * rates[:, c] for c, value in row.items()))


@dataclass(frozen=True)
class Agreement:
    """How far the rates by groups are from those by all equations at once: largest differences, as parts of the largest velocity
    and of the largest acceleration, over ``frames`` that are not singular. None where all are."""

    equations: int
    unknowns: int
    velocity: float | None
    acceleration: float | None
    frames: int


def agreement(motion: Motion, most: int = WORK) -> Agreement | None:
    """The rates of a motion checked by all equations at once, at as many frames, evenly, as ``most`` operations allow; None where
    they do not allow one."""
    model = motion.model
    unknowns = 3 * len(model.links) - 3
    count = min(most // max(unknowns, 1) ** 3, motion.frames)
    if not count or not unknowns:
        return None
    frames = slice(0, None, -(-motion.frames // count))
    regular = np.broadcast_to(motion.condition, motion.frames)[frames] <= SINGULAR
    *solved, equations = rates_at_once(motion, frames)
    unit = np.array([model.length_scale, model.length_scale, 1.0])
    differences: list[float | None] = []
    for read, rates in zip((motion.velocity, motion.acceleration), solved, strict=True):
        known = np.stack([read(link)[frames] for link in model.links[1:]], axis=1) / unit
        kept = regular & np.isfinite(known).all(axis=(1, 2))
        largest = float(np.abs(known[kept]).max(initial=0.0)) or 1.0
        differences.append(float(np.abs(rates[kept] / unit - known[kept]).max()) / largest if kept.any() else None)
    return Agreement(equations, unknowns, differences[0], differences[1], int(regular.sum()))
