"""All joints of a mechanism at once, in absolute coordinates, instead of by loops and Assur groups: velocities and accelerations of
all links, and reactions where constraints are redundant.

Every joint, relation and drive gives its equations in the velocities (x, y, angle) of its two links, and all are solved together.
This is the usual formulation of multibody dynamics; it checks the solution by groups. Lengths are in units of the mechanism's size.

Equilibrium under redundant constraints has many solutions. The minimum-norm solution is taken: all joint forces and couples
together, link by link (Newton-Euler), by the pseudo-inverse; couples are in units of force times the mechanism's size. The null
space shows which joints are indeterminate: they can be stressed against each other without load.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Plane, Real, Values
from mechcore.constants import SINGULAR
from mechcore.kinematics.program import LinearConstraint
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import added, crossed, stacked
from mechcore.numerics.tape import value_of
from mechcore.numerics.tape_functions import without_slope
from mechcore.records import dataclass

EquationRow = dict[int, Any]
"""Coefficients by the numbers of coordinates, three for each link: numbers, or arrays over frames."""

MOST_OPERATIONS = 200_000_000  # for all frames at which rates are checked: takes seconds
DENSE_UNKNOWNS = 150  # unknowns up to which all frames are solved together by full matrices
SPARSE_OPERATIONS = 4_000  # per unknown of a sparse matrix
RANK_RATIO = 1e-12  # of the smallest singular value to the largest


class JointEquations:
    """The equations of a motion's joints at ``frames``, one number or a slice."""

    def __init__(self, motion: Motion, frames: Any):
        self.motion, self.model, self.frames = motion, motion.model, frames

    def at(self, values: Any) -> Any:
        """Values of the motion at the frames."""
        return np.broadcast_to(values, self.motion.frames)[self.frames]

    def joint(self, j: int) -> Iterator[EquationRow]:
        """Equations of a joint: two for its point, or one across its guide; one more if it does not turn."""
        joint, (p, q) = self.model.joints[j], self.model.ends[j]
        x, y = self._point(j, {p: 1.0, q: -1.0})
        if joint.slide is None:
            yield from (x, y)
        else:
            d = self.at(self.motion.guide(j))
            yield {c: d.real * y.get(c, 0.0) - d.imag * x.get(c, 0.0) for c in x | y}
        if not joint.turns:
            yield {3 * p + 2: 1.0, 3 * q + 2: -1.0}

    def slide(self, j: int) -> EquationRow:
        """The rate of a sliding joint's coordinate: relative velocity along the guide at the sliding point."""
        d = self.at(self.motion.guide(j))
        owner, other = self.owner(j)
        x, y = self._point(j, {other: 1.0, owner: -1.0})
        return {c: d.real * x.get(c, 0.0) + d.imag * y.get(c, 0.0) for c in x | y}

    def coordinate(self, j: int) -> EquationRow:
        """The rate of the coordinate that a drive on this joint prescribes."""
        p, q = self.model.ends[j]
        return self.slide(j) if self.model.joints[j].slide is not None else {3 * q + 2: 1.0, 3 * p + 2: -1.0}

    def relation(self, constraint: LinearConstraint) -> EquationRow:
        """The rate of a relation between coordinates."""
        relation = next(r for r in self.model.relations if r.name == constraint.name)
        angles, slides = list(relation.angles), list(constraint.slides)
        if relation.curve is not None and constraint.curve is not None:
            slope = self.at(self.motion.state.curve_values[self.model.relations.index(relation)][1])
            angles += [(link, slope * c) for link, c in relation.curve.angles]
            slides += [(j, slope * c) for j, c in constraint.curve.slides]
        return self.sum(angles, slides)

    def sum(self, angles: Any, slides: Any) -> EquationRow:
        """The row of a sum of angular rates (link, factor [m]) and rates of slides (joint, factor)."""
        row: EquationRow = {}
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

    def _point(self, j: int, signs: Mapping[int, float]) -> tuple[EquationRow, EquationRow]:
        """Rows of the x and y velocity of the joint's point as a point of each link, summed with ``signs`` (link -> sign)."""
        x: EquationRow = {}
        y: EquationRow = {}
        for k, sign in signs.items():
            arm = self.arm(j, k) / self.model.length_scale
            x |= {3 * k: sign, 3 * k + 2: -sign * arm.imag}
            y |= {3 * k + 1: sign, 3 * k + 2: sign * arm.real}
        return x, y

    def arm(self, j: int, k: int) -> Any:
        """Vector from the origin of link ``k`` to its point of joint ``j`` at the frames [m]."""
        return self.at(self.motion.arm(k, j, self.model.ends[j].index(k)))


def rates_at_once(motion: Motion, frames: slice) -> tuple[Real, Real, int]:
    """Velocities and accelerations (frames, links, 3) [m/s, rad/s; m/s^2, rad/s^2] of moving links, and the number of equations.

    At singular positions, where the equations do not determine all rates, these are the minimum-norm rates, or NaN if there are
    more unknowns than ``DENSE_UNKNOWNS``.
    """
    rows, model = JointEquations(motion, frames), motion.model
    scale, size = model.length_scale, 3 * len(model.links)
    count = len(rows.at(0.0))
    table: list[EquationRow] = []
    driven: list[tuple[int, int]] = []  # number of the row, joint
    for j in range(len(model.joints)):
        table += rows.joint(j)
    table += [rows.relation(constraint) for constraint in model.constraints]
    for j in model.driven:
        driven.append((len(table), j))
        table.append(rows.coordinate(j))
    solve = (_full if size - 3 <= DENSE_UNKNOWNS else _sparse)(table, count, size)

    def solved(right: Real) -> Real:
        return np.pad(solve(right), ((0, 0), (3, 0)))

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


Solve = Callable[[Real], Real]
"""Right-hand sides (frames, equations) -> rates (frames, unknowns) of moving links."""


def _full(table: Sequence[EquationRow], count: int, size: int) -> Solve:
    matrix = np.zeros((count, len(table), size))
    for r, row in enumerate(table):
        for c, value in row.items():
            matrix[:, r, c] += value
    inverse = np.linalg.pinv(matrix[:, :, 3:], rcond=RANK_RATIO)
    return lambda right: np.asarray((inverse @ right[..., None])[..., 0])


def _sparse(table: Sequence[EquationRow], count: int, size: int) -> Solve:
    """Least squares frame by frame, as one square system augmented by the residuals (Bjorck 1967), for as many equations as
    unknowns or more."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    entries = [(r, c - 3, value) for r, row in enumerate(table) for c, value in row.items() if c >= 3]
    r, c = np.array([entry[:2] for entry in entries]).T
    values = np.array([np.broadcast_to(value, count) for *_, value in entries])
    n, unknowns = len(table), size - 3
    at = np.concatenate([np.arange(n), r, n + c]), np.concatenate([np.arange(n), n + c, r])
    factors: list[Any] = []
    for frame in values.T:
        whole = coo_array((np.concatenate([np.ones(n), frame, frame]), at), shape=(n + unknowns, n + unknowns))
        try:
            factors.append(splu(whole.tocsc()))
        except RuntimeError:  # exactly singular
            factors.append(None)

    def solve(right: Real) -> Real:
        sides = np.pad(right, ((0, 0), (0, unknowns)))
        nothing = np.full(n + unknowns, np.nan)
        return np.array([nothing if f is None else f.solve(side) for f, side in zip(factors, sides, strict=True)])[:, n:]

    return solve


def _quadratic(rows: JointEquations, first: Real, equations: int) -> Real:
    """Right-hand sides of the acceleration equations that are quadratic in the rates (frames, equations): centripetal and Coriolis
    terms, and those of the second derivatives of curves."""
    model, scale = rows.model, rows.model.length_scale
    right = np.zeros((len(first), equations))
    turn = first[:, 2::3]
    rate = {j: _times(rows.slide(j), first) for j, joint in enumerate(model.joints) if joint.slide is not None}

    def drawn_in(j: int, plus: int, minus: int) -> Any:
        """Centripetal acceleration of the joint's point on link ``plus`` minus that on link ``minus``, in units of the size."""
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
            _, slope, second = (rows.at(b) for b in rows.motion.state.curve_values[model.relations.index(relation)])
            argument = scale * _times(rows.sum(relation.curve.angles, constraint.curve.slides), first)
            right[:, r] += slope * sum(c * along(j) for j, c in constraint.curve.slides) - second * argument**2 / scale
        r += 1
    for j in model.driven:
        if model.joints[j].slide is not None:
            right[:, r] = along(j)
        r += 1
    return right


def _times(row: EquationRow, rates: Real) -> Real:
    return np.asarray(sum(value * rates[:, c] for c, value in row.items()))


@dataclass(frozen=True)
class Agreement:
    """Largest differences between the rates by groups and those by all equations at once, relative to the largest velocity and
    acceleration, over the ``frames`` frames that are not singular; None if all are singular."""

    equations: int
    unknowns: int
    velocity: float | None
    acceleration: float | None
    frames: int


def agreement(motion: Motion, most: int = MOST_OPERATIONS) -> Agreement:
    """Compare the rates of a motion with those by all equations at once, at evenly spaced frames, as many as ``most`` operations
    allow, at least one."""
    model = motion.model
    unknowns = 3 * len(model.links) - 3
    each = unknowns**3 if unknowns <= DENSE_UNKNOWNS else SPARSE_OPERATIONS * unknowns
    count = min(max(most // max(each, 1), 1), motion.frames)
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


INDEPENDENT_RATIO = 1e-10  # singular values below this fraction of the largest are zero
LEAST_SHARE = 1e-9  # of an unknown in a combination of unit length in the null space
ZERO_UNKNOWN = 1e-12  # unknowns that stay below this fraction of the largest in all frames are zero


def least_norm(
    motion: Motion, force: Sequence[Plane], moment: Sequence[Values], flanks: Mapping[int, Values] | None = None
) -> tuple[list[tuple[Plane, Values]], dict[str, tuple[Plane, Plane]], dict[int, Values]]:
    """Minimum-norm reactions: transmitted force and couple on the second link of every joint, contact position and force of every
    relation, and its multiplier.

    ``force`` and ``moment`` (about each link's origin) are the loads on the links, (F,) or with axes before that of the frames.
    ``flanks``: multipliers whose signs select the flank or span of each relation that carries; by default the loads decide.
    """
    model = motion.model
    if flanks is None and model.relations:  # the multiplier does the same work on either flank: find its sign first
        first = least_norm(motion, force, moment, dict.fromkeys(range(len(model.relations)), 1.0))
        if all(np.all(m >= 0.0) for m in first[2].values()):
            return first
        flanks = first[2]
    flanks = flanks or {}
    matrix, labels = equilibrium_matrix(motion, flanks)
    n = len(model.links) - 1
    shape = np.broadcast_shapes((motion.frames,), *(np.shape(v) for v in (*force, *moment)))
    loads = [part for k in range(1, n + 1) for part in (-force[k].real, -force[k].imag, -moment[k] / model.length_scale)]
    rhs = stacked(loads, shape)
    x = _balanced(matrix, rhs) if isinstance(matrix, np.ndarray) and isinstance(rhs, np.ndarray) else _traced(matrix, rhs)
    transmitted: list[tuple[Plane, Values]] = [(0j, 0.0)] * len(model.joints)
    contacts: dict[str, tuple[Plane, Plane]] = {}
    multipliers: dict[int, Values] = {}
    for column, (what, i, direction) in enumerate(labels):
        value = x[..., column]
        if what == "force":
            transmitted[i] = (transmitted[i][0] + value * direction, transmitted[i][1])
        elif what == "couple":
            transmitted[i] = (transmitted[i][0], transmitted[i][1] + value * model.length_scale)
        else:
            place, along = model.relations[i].contact(motion, flanks[i])
            contacts[model.relations[i].name] = (place, value * along)
            multipliers[i] = value
    return transmitted, contacts, multipliers


def _balanced(matrix: Real, rhs: Real) -> Real:
    """The minimum-norm unknowns (..., n) that balance loads (..., m); NaN where there is no equilibrium."""
    known = np.asarray(np.isfinite(matrix).all(axis=(-2, -1)))  # not so where no position was found, as an integrator may try
    matrix = np.where(known[..., None, None], matrix, 0.0)
    x = (np.linalg.pinv(matrix, rcond=INDEPENDENT_RATIO) @ rhs[..., None])[..., 0]
    left = np.abs((matrix @ x[..., None])[..., 0] - rhs).max(axis=-1)
    size = float(np.fmax.reduce(np.abs(rhs), axis=None, initial=0.0)) or 1.0
    x = np.where((known & (left < 1e-7 * size))[..., None], x, np.nan)  # as is possible at a singular position
    largest = np.fmax.reduce(np.abs(x), axis=-2, initial=0.0)  # of each unknown over the run
    idle = largest <= ZERO_UNKNOWN * np.fmax.reduce(largest, axis=-1, initial=0.0)[..., None]
    return np.where(idle[..., None, :] & np.isfinite(x), 0.0, x)  # otherwise unloaded links would carry rounding errors of others


def _traced(matrix: Any, rhs: Any) -> Any:
    """As `_balanced`, with derivatives of the unknowns that statics determines; those of the others are NaN."""
    plain = value_of(matrix)
    x = _balanced(plain, value_of(rhs))
    left: Any = np.sum(matrix * x[..., None, :], axis=-1) - rhs
    inverse = np.linalg.pinv(plain, rcond=INDEPENDENT_RATIO)
    changes = left.tape.implicit([left[..., k] for k in range(plain.shape[-2])], plain, inverse)
    free = undetermined(plain)
    return np.stack(
        [x[..., k] + (without_slope(own) if free[k] else own) for k, own in enumerate(changes)],
        axis=-1,
    )


def undetermined(matrix: Real) -> Flags:
    """Which unknowns (n,) of the equilibria (F, m, n) statics does not determine at one frame or more."""
    _, s, vt = np.linalg.svd(matrix)
    independent = np.zeros(vt.shape[:-1], bool)
    independent[..., : s.shape[-1]] = s > INDEPENDENT_RATIO * s[..., :1]
    free = np.where(independent[..., None], 0.0, np.abs(vt))  # the null space: combinations that need no load
    return np.asarray(free.reshape(-1, vt.shape[-1]).max(axis=0, initial=0.0) > LEAST_SHARE)


def indeterminate(motion: Motion) -> tuple[str, ...]:
    """Names of the joints whose reactions statics does not determine, at the run's best conditioned frame."""
    return tuple(dict.fromkeys(name for name, _ in indeterminate_parts(motion)))


def indeterminate_parts(motion: Motion) -> tuple[tuple[str, str], ...]:
    """The parts of reactions that statics does not determine there: name of the joint, and "force", "couple" or "tie" (the force
    of a relation)."""
    model = motion.model
    matrix, labels = equilibrium_matrix(motion, {})
    frame = int(np.argmin(np.where(np.isfinite(motion.condition), motion.condition, np.inf)))
    loose = undetermined(matrix[frame : frame + 1])
    parts = [(model.relations[i].name if what == "tie" else model.joints[i].name, what) for what, i, _ in labels]
    return tuple(dict.fromkeys(part for part, free in zip(parts, loose, strict=True) if free))


Cells = dict[tuple[int, int], Values]
"""The non-zero entries of a large matrix, by row and column."""


def equilibrium_matrix(motion: Motion, flanks: Mapping[int, Values]) -> tuple[Real, list[tuple[str, int, Plane]]]:
    """Matrix (F, 3 links, unknowns) of the equilibrium of all links, moments divided by the size, and labels of its unknowns."""
    entries, labels = equilibrium_cells(motion, flanks)
    rows = 3 * (len(motion.model.links) - 1)
    filled = stacked([*entries.values(), 0.0], (motion.frames,))  # most entries of a large matrix are empty: the last value
    cells = np.full((rows, len(labels)), len(entries))
    for k, cell in enumerate(entries):
        cells[cell] = k
    return filled[:, cells], labels


def equilibrium_cells(motion: Motion, flanks: Mapping[int, Values]) -> tuple[Cells, list[tuple[str, int, Plane]]]:
    """The entries of `equilibrium_matrix`, and the labels of its unknowns: ("force", joint, direction), ("couple", joint, 0) or
    ("tie", relation, 0)."""
    model = motion.model
    labels: list[tuple[str, int, Plane]] = []
    for j, joint in enumerate(model.joints):
        along = motion.guide(j) if joint.slide is not None else None
        driven = j in model.driven
        if along is None:
            labels += [("force", j, 1 + 0j), ("force", j, 1j)]
        else:
            labels.append(("force", j, 1j * along))
            if driven:
                labels.append(("force", j, along))
        if not joint.turns or (driven and joint.coordinate == "angle"):
            labels.append(("couple", j, 0j))
    labels += [("tie", i, 0j) for i in range(len(model.relations))]
    entries: Cells = {}

    def add(row: int, column: int, x: Values) -> None:
        entries[row, column] = added(entries.get((row, column), 0.0), x)

    def add_cell(column: int, k: int, f: Plane, arm: Plane, sign: float) -> None:
        if k == 0:
            return
        add(3 * k - 3, column, sign * f.real)
        add(3 * k - 2, column, sign * f.imag)
        add(3 * k - 1, column, sign * crossed(arm, f) / model.length_scale)

    for column, (what, i, direction) in enumerate(labels):
        if what == "force":
            (p, q) = model.ends[i]
            add_cell(column, q, direction, motion.arm(q, i, 1), 1.0)
            add_cell(column, p, direction, motion.arm(p, i, 0), -1.0)
        elif what == "couple":
            p, q = model.ends[i]
            for k, sign in ((q, 1.0), (p, -1.0)):
                if k:
                    add(3 * k - 1, column, sign)
        else:
            relation = model.relations[i]
            place, along = relation.contact(motion, flanks.get(i, 1.0))
            for link, sign in zip(relation.links, (-1.0, 1.0), strict=True):
                k = model.index[link]
                add_cell(column, k, along, place - motion.origins[k], sign)
            if relation.bearing is not None:
                couple = relation.bearing.couple(motion, place, along)
                for link, sign in ((relation.links[0], 1.0), (relation.bearing.carrier, -1.0)):
                    if (k := model.index[link]) != 0:
                        add(3 * k - 1, column, sign * couple / model.length_scale)
    return entries, labels
