"""One block of the contour equations, for all frames at once: position, then the same columns for rates and for forces.

A block's *columns* are the derivatives of its contour sums by its unknowns: ``i Z`` for the angle of a group whose vectors add up
to ``Z``, the unit vector ``D`` for a sliding displacement. Velocities and accelerations solve with the columns, joint forces with
their transpose.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from mechcore.accuracy import DEFAULT
from mechcore.kinematics import dyads as cf
from mechcore.kinematics.model import Block, Model, NonlinearTerm
from mechcore.numerics.frames import added, imaginary, minus, nothing, plus
from mechcore.numerics.newton import newton, solve_many

Array = Any
DETERMINED = 1e-3  # singular values below this part of the largest leave a direction to the interpolation


@dataclass
class State:
    """Rotations of all spins and displacements of all sliding joints, filled in block by block.

    ``delta``: rotation of each spin against its group (from drives); ``rot``: rotation of each spin, None while unknown.
    ``newton`` says, by block name, how Newton ended where it was used.
    """

    drives: Sequence[Array]
    delta: list[Array]
    rot: list[Array]
    slide: dict[int, Array]
    newton: dict[str, Newton] = field(default_factory=dict)
    constants: Sequence[float] = ()  # of the relations
    angle: dict[int, Array] = field(default_factory=dict)  # angles beyond one turn, of groups that relations need
    near: Mapping[str, Array] = field(default_factory=dict)  # rough angles "angle <group>" that decide the turn
    tolerance: float = DEFAULT.position  # residual at which Newton's method stops, in sizes of the mechanism
    bends: dict[int, Array] = field(default_factory=dict)  # relation -> value and two derivatives of its curve (3, ...)

    def copy(self) -> State:
        """A state that can be filled in further without changing this one."""
        return replace(
            self,
            rot=list(self.rot),
            slide=dict(self.slide),
            newton=dict(self.newton),
            angle=dict(self.angle),
            bends=dict(self.bends),
        )


@dataclass(frozen=True)
class Newton:
    """Unknowns (..., n) of a general block (angles [rad], then slides [m]), what is left of the contours [m], and the size of
    the first correction (relative), which tells how good the start was."""

    x: Array
    miss: Array
    first: Array


@dataclass(frozen=True, eq=False)
class Patch:
    """A block's unknowns at some frames, by interpolation along the branch, in place of an ill-conditioned solve.

    ``frames`` (k,); ``values``, ``first``, ``second`` (k, unknowns): angles [rad] and slides [m], and their rates.
    """

    frames: Array
    values: Array
    first: Array
    second: Array

    def into(self, rates: list[Array], derivative: int) -> None:
        """Put the patch's first or second rates in place of a block's solved ones."""
        given = self.first if derivative == 1 else self.second
        for u in range(len(rates)):
            rates[u] = np.array(rates[u])
            rates[u][self.frames] = given[:, u]


class Vectors(NamedTuple):
    """A contour's vectors in the world, all known: (spin, Z) of the spins that turn, slides included, (joint, spin, D) of the
    slides; what rests with the frame, and the state, are there for the contour's sum only."""

    arms: list[tuple[int, Array]]
    slides: Sequence[tuple[int, int, Array]]
    resting: tuple[Array, tuple[tuple[int, Array], ...]]
    state: State

    def total(self) -> Array:
        """Sum of all vectors: by how much the contour does not close."""
        still, guides = self.resting
        return sum((d * self.state.slide[j] for j, d in guides), sum((z for _, z in self.arms), still))


class Columns(NamedTuple):
    """``table[c][u]``: derivative of the c-th contour of a block by its u-th unknown, or None where it is zero;
    ``constraints[r][u]``: of its r-th relation. Where there is one contour and two unknowns (every dyad) ``pair`` and ``dual``
    stand for the table: the two columns, both turned back by a right angle, and the dual basis, such that unknown k of ``columns @
    x + r = 0`` is ``Im(r dual[k])``; the force that balances the generalised forces q is ``(q[0] pair[1] - q[1] pair[0]) inverse``,
    where ``1 / inverse`` is their cross product."""

    table: tuple[tuple[Array, ...], ...]
    constraints: tuple[tuple[float, ...], ...] = ()
    pair: tuple[Array, Array] | None = None
    dual: tuple[Array, Array] | None = None
    inverse: Array = None


def place(model: Model, block: Block, state: State, mode: Array, start: Array | None = None) -> None:
    """Solve a block's positions into ``state``. ``start``: unknowns (..., n) to start Newton from (general blocks only)."""
    if block.kind == "general":
        _place_general(model, block, state, start)
        return
    if block.kind == "check":
        return
    if block.kind == "relation":
        _place_relation(model, block, state)
        return
    target, arms, slides = _split(model, block, block.contours[0], state)
    if block.kind == "theta_theta":
        u, v = block.angles
        e1, e2 = cf.theta_theta(arms[u], arms[v], target, mode)
        _turn(model, state, u, e1)
        _turn(model, state, v, e2)
    elif block.kind == "theta_slide":
        ((j, along),) = slides
        e, s = cf.theta_slide(arms[block.angles[0]], along, target, mode)
        _turn(model, state, block.angles[0], e)
        state.slide[j] = s
    elif block.kind == "arm_slide":
        ((j, d),) = slides
        e, s = cf.arm_slide(arms.get(block.angles[0], 0j), d, target, mode)
        _turn(model, state, block.angles[0], e)
        state.slide[j] = s
    elif block.kind == "slide_slide":
        (j1, d1), (j2, d2) = slides
        state.slide[j1], state.slide[j2] = cf.slide_slide(d1, d2, target)
    elif block.kind == "angle":
        e = target / arms[block.angles[0]]
        _turn(model, state, block.angles[0], e / abs(e))
    else:  # slide
        ((j, d),) = slides
        state.slide[j] = (target * d.conjugate()).real


def _place_relation(model: Model, block: Block, state: State) -> None:
    r = block.relations[0]
    known, unknown = relation_sum(model, r, state, block)
    ((what, i), c), *_ = unknown.items()
    if what == "angle":
        state.angle[i] = -known / c
        _turn(model, state, i, np.exp(1j * state.angle[i]))
    else:
        state.slide[i] = -known / c


def relation_sum(
    model: Model, relation: int, state: State, block: Block | None = None
) -> tuple[Array, dict[tuple[str, int], float]]:
    """A relation's known terms [m], its constant subtracted, and the coefficients of the unknowns of ``block``."""
    t = model.constraints[relation]
    known: Array = -state.constants[relation] if state.constants else 0.0
    unknown: dict[tuple[str, int], float] = {}
    for d, c in t.drives:
        known = known + c * state.drives[d]
    for g, c in t.groups:
        if block is not None and g in block.angles:
            unknown["angle", g] = c
        else:
            known = known + c * real_angle(model, state, g)
    for j, c in t.slides:
        if block is not None and j in block.slides:
            unknown["slide", j] = c
        else:
            known = known + c * state.slide[j]
    if t.curve is not None:
        state.bends[relation] = bend = t.curve.function(_argument(model, t.curve, state))
        known = known + bend[0]
    return known, unknown


def _argument(model: Model, curve: NonlinearTerm, state: State) -> Array:
    """The argument of a relation's curve, which is known before the relation is solved."""
    total: Array = curve.shift
    for d, c in curve.drives:
        total = total + c * state.drives[d]
    for g, c in curve.groups:
        total = total + c * (state.angle[g] if g in state.angle else wrapped_angle(model, state, g))
    for j, c in curve.slides:
        total = total + c * state.slide[j]
    return total


def wrapped_angle(model: Model, state: State, group: int) -> Array:
    """A group's angle within one turn."""
    spin = model.angles.spins_of[group][0]
    return np.angle(state.rot[spin] * np.conj(state.delta[spin]))


def real_angle(model: Model, state: State, group: int) -> Array:
    """A group's angle beyond one turn; the rough angle in ``state.near`` says which turn, where a closed form does not."""
    if group not in state.angle:
        angle = wrapped_angle(model, state, group)
        near = state.near.get(f"angle {group}")
        if near is not None:
            angle = angle + 2.0 * np.pi * np.round((near - angle) / (2.0 * np.pi))
        state.angle[group] = angle
    return state.angle[group]


def apply(model: Model, block: Block, state: State, patch: Patch, *, onto: bool = False) -> None:
    """Put a patch's positions into ``state``; ``onto`` the contours, as far as these determine them."""
    values = patch.values
    if onto and len(patch.frames):
        scale = np.concatenate([np.ones(len(block.angles)), np.full(len(block.slides), model.size)])
        left, jacobian = equations(model, block, state, patch.frames)(values / scale)
        correction = (np.linalg.pinv(np.nan_to_num(jacobian), rcond=DETERMINED) @ left[..., None])[..., 0]
        values = values - np.where(np.isfinite(correction), correction, 0.0) * scale
    for i, g in enumerate(block.angles):
        if g in state.angle:
            whole = np.array(state.angle[g])
            known = np.flatnonzero(np.isfinite(whole))
            rough = np.interp(patch.frames, known, whole[known]) if len(known) else values[:, i]
            whole[patch.frames] = values[:, i] + 2.0 * np.pi * np.round((rough - values[:, i]) / (2.0 * np.pi))
            state.angle[g] = whole
        e = np.exp(1j * values[:, i])
        for spin in model.angles.spins_of[g]:
            rot, delta = np.array(state.rot[spin]), state.delta[spin]
            rot[patch.frames] = e * (delta[patch.frames] if np.ndim(delta) else delta)
            state.rot[spin] = rot
    for i, j in enumerate(block.slides, len(block.angles)):
        slide = np.array(state.slide[j])
        slide[patch.frames] = values[:, i]
        state.slide[j] = slide


def dead_point_margin(model: Model, block: Block, state: State) -> list[Array]:
    """How far a group with two modes is from where they meet: smooth functions (squares of lengths, relative) that touch 0."""
    target, arms, slides = _split(model, block, block.contours[0], state)
    if block.kind == "theta_theta":
        ra, rb, d2 = abs(arms[block.angles[0]]), abs(arms[block.angles[1]]), target.real**2 + target.imag**2
        d, total, difference = np.sqrt(d2), ra + rb, abs(ra - rb)
        return [(total - d) * (total + d) / total**2, (d - difference) * (d + difference) / total**2]
    if block.kind == "theta_slide":
        r, y = abs(arms[block.angles[0]]), (target * np.conj(slides[0][1])).imag
        return [(r - y) * (r + y) / r**2]
    r2, y = target.real**2 + target.imag**2, (arms.get(block.angles[0], 0j) * np.conj(slides[0][1])).imag
    return [(r2 - y * y) / model.size**2]


def gap(model: Model, block: Block, state: State) -> Array:
    """By how much the links of a block with a closed form miss each other [m] (...), 0 where they meet; needs the earlier blocks in
    ``state``."""
    target, arms, slides = _split(model, block, block.contours[0], state)
    if block.kind == "theta_theta":
        return cf.gap_theta_theta(arms[block.angles[0]], arms[block.angles[1]], target)
    if block.kind == "theta_slide":
        return cf.gap_theta_slide(arms[block.angles[0]], slides[0][1], target)
    if block.kind == "arm_slide":
        return cf.gap_arm_slide(arms.get(block.angles[0], 0j), slides[0][1], target)
    return np.zeros(np.shape(target))


def span(model: Model, block: Block, state: State) -> float:
    """Distance of a group's outer pins [m], which its two links have to bridge."""
    return float(np.max(np.abs(_split(model, block, block.contours[0], state)[0])))


def _turn(model: Model, state: State, group: int, e: Array) -> None:
    for spin in model.angles.spins_of[group]:
        delta = state.delta[spin]
        state.rot[spin] = e if isinstance(delta, complex) and delta == 1 else e * delta


def _split(model: Model, block: Block, contour: int, state: State) -> tuple[Array, dict[int, Array], list[tuple[int, Array]]]:
    """What a contour's unknown vectors have to add up to, its vectors along each unknown group (in the group's axes), and its
    unknown slides.

    The slides' directions are in the group's axes where the group is unknown, else in the world's.
    """
    rot, found = state.rot, model.splits[contour]
    target: Array = None
    for spin, vector in found.known:
        target = plus(target, vector * rot[spin])
    if target is None:
        target = 0j
    for j, spin, d in found.known_slides:
        if model.angles.spin_group[spin] not in block.angles:
            target = added(target, (d * rot[spin]) * state.slide[j], -1)
    arms = found.arms
    if arms is None or found.known_slides:
        arms = {}
        for group, spin, vector in found.unknown:
            arms[group] = added(arms.get(group, 0j), vector * state.delta[spin])
        for j, spin, d in found.known_slides:
            group = model.angles.spin_group[spin]
            if group in block.angles:
                arms[group] = added(arms.get(group, 0j), (d * state.delta[spin]) * state.slide[j])
    slides = [(j, d * (state.delta if model.angles.spin_group[spin] in block.angles else rot)[spin]) for j, spin, d in found.slides]
    return target, arms, slides


def equations(model: Model, block: Block, state: State, frames: Any = None) -> Callable[[Array], tuple[Array, Array]]:
    """A block's contours and relations as a function of its unknowns (..., n), slides in units of the size: what is left of them
    (..., m), lengths in units of the mechanism's size, and the derivatives (..., m, n). ``frames``: at these only."""
    size = model.size

    def at(value: Array) -> Array:
        return value if frames is None or not np.ndim(value) else value[frames]

    parts = []
    for c in block.contours:
        known, arms, slides = _split(model, block, c, state)
        parts.append((at(known), {g: at(a) for g, a in arms.items()}, [(j, at(d)) for j, d in slides]))
    constraints = [(at(known), unknown) for known, unknown in (relation_sum(model, k, state, block) for k in block.relations)]
    n_angles = len(block.angles)
    angle_at = {g: k for k, g in enumerate(block.angles)}
    slide_at = {j: k for k, j in enumerate(block.slides, n_angles)}
    carrier = {j: model.angles.spin_group[g] for c in block.contours for j, g, _ in model.spin_contours[c].slides}
    # in units of the size: what a relation has, and the place and the factor of each of its unknowns; likewise of the contours
    linear = [
        (known / size, [(angle_at[g], c / size) if what == "angle" else (slide_at[g], c) for (what, g), c in unknown.items()])
        for known, unknown in constraints
    ]
    contours = [
        (-target / size, [(angle_at[g], a / size) for g, a in arms.items()], [(slide_at[j], carrier[j], d) for j, d in slides])
        for target, arms, slides in parts
    ]

    def residual(x: Array) -> tuple[Array, Array]:
        e = np.exp(1j * x[..., :n_angles])
        rows = 2 * len(parts) + len(constraints)
        r = np.empty((*x.shape[:-1], rows))
        jac = np.zeros((*x.shape[:-1], rows, x.shape[-1]))
        for i, (total, unknowns) in enumerate(linear, 2 * len(parts)):
            for k, c in unknowns:
                total = total + c * x[..., k]
                jac[..., i, k] = c
            r[..., i] = total
        for i, (total, arms, slides) in enumerate(contours):
            for k, a in arms:
                z = a * e[..., k]
                total = total + z
                jac[..., 2 * i, k] -= z.imag
                jac[..., 2 * i + 1, k] += z.real
            for k, g, d in slides:
                along = d * e[..., angle_at[g]] if g in angle_at else d
                moved = x[..., k] * along
                total = total + moved
                jac[..., 2 * i, k] += along.real
                jac[..., 2 * i + 1, k] += along.imag
                if g in angle_at:
                    jac[..., 2 * i, angle_at[g]] -= moved.imag
                    jac[..., 2 * i + 1, angle_at[g]] += moved.real
            r[..., 2 * i], r[..., 2 * i + 1] = total.real, total.imag
        return r, jac

    return residual


def _place_general(model: Model, block: Block, state: State, start: Array) -> None:
    """Newton on all contours of the block; lengths in units of the mechanism's size."""
    size = model.size
    n_angles = len(block.angles)
    residual = equations(model, block, state)
    scale = np.concatenate([np.ones(n_angles), np.full(len(block.slides), size)])
    x, miss, first = newton(residual, start / scale, tolerance=state.tolerance)
    x = np.where((miss < max(1e-9, 10.0 * state.tolerance))[..., None], x, np.nan)
    for i, g in enumerate(block.angles):
        state.angle[g] = x[..., i]
        _turn(model, state, g, np.exp(1j * x[..., i]))
    for i, j in enumerate(block.slides):
        state.slide[j] = x[..., n_angles + i] * size
    state.newton[block.name] = Newton(x=x * scale, miss=miss * size, first=first)


def vectors(model: Model, contour: int, state: State) -> Vectors:
    """The vectors of a contour whose positions are known."""
    found, rot = model.turning[contour], state.rot
    arms = [(spin, vector * rot[spin]) for spin, vector in found.arms]
    slides: Sequence[tuple[int, int, Array]] = found.slides
    if found.carried:
        slides = list(slides)
        for i, j, spin, d, place in found.carried:
            along = d * rot[spin]
            slides[i] = j, spin, along
            if place < len(arms):
                arms[place] = spin, arms[place][1] + state.slide[j] * along
            else:
                arms.append((spin, state.slide[j] * along))
    return Vectors(arms, slides, found.resting, state)


def columns(model: Model, block: Block, contours: dict[int, Vectors]) -> Columns:
    """Derivatives of the block's contours by its unknowns."""
    if block.dyad:
        (c,) = block.contours
        u, v = _turned_back(contours[c], model.splits[c].places, len(block.angles))
        mirrored = u.conjugate()
        inverse = 1.0 / (mirrored * v).imag
        over = imaginary(inverse)
        first = (v * over).conjugate() if isinstance(v, np.ndarray) else -v.conjugate() * over  # a resting guide's is one number
        return Columns((), pair=(u, v), dual=(first, mirrored * over), inverse=inverse)
    unknowns = block.unknowns
    table = tuple(tuple(column(model, contours[c], x) for x in unknowns) for c in block.contours)
    constraints = tuple(tuple(constraint_coefficient(model, r, x) for x in unknowns) for r in block.relations)
    return Columns(table, constraints)


def constraint_coefficient(
    model: Model, relation: int, unknown: tuple[str, int], bends: Mapping[int, Array] | None = None
) -> Array:
    """Derivative of a relation by an unknown; with ``bends`` that of its curve too, which unknowns of its own block never have."""
    t = model.constraints[relation]
    c: Array = dict(t.groups if unknown[0] == "angle" else t.slides).get(unknown[1], 0.0)
    if t.curve is not None and bends is not None and (slope := t.curve.slope(unknown)):
        c = c + slope * bends[relation][1]
    return c


def column(model: Model, v: Vectors, unknown: tuple[str, int]) -> Array:
    """Derivative of one contour by one unknown, None where it is zero."""
    what, i = unknown
    if what == "slide":
        return next((along for j, _, along in v.slides if j == i), None)
    total = None
    for spin, z in v.arms:
        if model.angles.spin_group[spin] == i:
            total = z if total is None else total + z
    return None if total is None else 1j * total


def _turned_back(v: Vectors, places: Sequence[tuple[Sequence[int], Array]], angles: int) -> list[Array]:
    """`column` of every unknown, turned back by a right angle: for an angle simply the sum of the vectors that it turns."""
    out = []
    for i, ((first, *others), total) in enumerate(places):
        if i < angles:
            total = v.arms[first][1]
            for k in others:
                total = total + v.arms[k][1]
        elif total is None:
            total = -1j * v.slides[first][2]
        out.append(total)
    return out


def rates(block: Block, cols: Columns, drift: list[Array], constraint_rhs: Sequence[Array] = ()) -> list[Array]:
    """Unknown rates (angles, then slides) from ``columns @ rates + drift = 0``, one drift per contour (what is known makes of it
    while the unknowns rest), and from ``constraints @ rates = constraint_rhs``."""
    if block.kind == "relation":
        return [constraint_rhs[0] / cols.constraints[0][0]]
    if cols.dual is not None:
        return [(drift[0] * d).imag for d in cols.dual]
    first = cols.table[0]
    if len(drift) == 1 and len(first) == 1 and not constraint_rhs:
        (c,) = first
        return [-(c.real * drift[0].real + c.imag * drift[0].imag) / (c.real**2 + c.imag**2)]
    matrix, shape = matrix_of(cols)
    shape = np.broadcast_shapes(shape, *(np.shape(r) for r in (*drift, *constraint_rhs)))  # guides on the frame: constant columns
    flat = np.empty((*shape, matrix.shape[-2]))
    for i, r in enumerate(drift):
        flat[..., 2 * i], flat[..., 2 * i + 1] = -r.real, -r.imag
    for i, value in enumerate(constraint_rhs, 2 * len(drift)):
        flat[..., i] = value
    x = solve_many(matrix, flat)
    return [x[..., k] for k in range(x.shape[-1])]


def transposed(block: Block, cols: Columns, q: list[Array]) -> tuple[list[Array], list[Array]]:
    """Contour forces (complex) and relation forces that balance the generalised forces ``q`` of the block's unknowns."""
    if block.kind == "relation":
        return [], [q[0] / cols.constraints[0][0]]
    if cols.pair is not None:
        (u, v), (a, b) = cols.pair, q
        total = None if nothing(a) else v * (a * cols.inverse)
        if not nothing(b):
            total = minus(total, u * (b * cols.inverse))
        return [0j if total is None else total], []
    first = cols.table[0]
    if len(cols.table) == 1 and len(first) == 1 and not cols.constraints:  # one left over: the shortest force that balances
        (c,) = first
        return [c * (q[0] / (c.real**2 + c.imag**2))], []
    matrix, shape = matrix_of(cols)
    shape = np.broadcast_shapes(shape, *(np.shape(value) for value in q))
    flat = np.empty((*shape, len(q)))
    for i, value in enumerate(q):
        flat[..., i] = value
    x = solve_many(np.swapaxes(matrix, -1, -2), flat)
    n = len(cols.table)
    return [x[..., 2 * i] + 1j * x[..., 2 * i + 1] for i in range(n)], [x[..., 2 * n + i] for i in range(len(cols.constraints))]


def matrix_of(cols: Columns) -> tuple[Array, tuple[int, ...]]:
    """The columns as real matrices (..., 2 contours + relations, unknowns)."""
    if cols.pair is not None:
        shape = np.broadcast_shapes(*(np.shape(c) for c in cols.pair))
        matrix = np.empty((*shape, 2, 2))
        for k, c in enumerate(cols.pair):  # turned back by a right angle: i c is the column
            matrix[..., 0, k], matrix[..., 1, k] = -np.imag(c), np.real(c)
        return matrix, shape
    shape = np.broadcast_shapes(*(np.shape(c) for row in cols.table for c in row if c is not None))
    width = len(cols.table[0] if cols.table else cols.constraints[0])
    matrix = np.zeros((*shape, 2 * len(cols.table) + len(cols.constraints), width))
    for i, row in enumerate(cols.constraints, 2 * len(cols.table)):
        matrix[..., i, :] = row
    for i, row in enumerate(cols.table):
        for k, c in enumerate(row):
            if c is not None:
                matrix[..., 2 * i, k], matrix[..., 2 * i + 1, k] = np.real(c), np.imag(c)
    return matrix, shape


def condition(model: Model, block: Block, cols: Columns) -> Array:
    """Condition number of a block's columns, lengths in units of the mechanism's size (inf where singular)."""
    k = len(block.angles)
    if cols.pair is not None:
        first: list[Array] = [c / model.size if i < k else c for i, c in enumerate(cols.pair)]
        total: Array = sum(np.real(c) ** 2 + np.imag(c) ** 2 for c in first if c is not None)
        product = abs(cf.cross(first[0], first[1]))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            largest2 = 0.5 * (total + np.sqrt(np.maximum((total - 2.0 * product) * (total + 2.0 * product), 0.0)))
            return np.where(product > 0, largest2 / product, np.inf)
    if not cols.table or not cols.table[0]:
        return 1.0
    matrix, _ = matrix_of(cols)
    matrix = matrix.copy()
    matrix[..., :k] /= model.size
    s = np.linalg.svd(np.nan_to_num(matrix), compute_uv=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(s[..., -1] > 0, s[..., 0] / s[..., -1], np.inf)
