"""The columns of a block (its Jacobian), and the linear equations for rates and forces made of them, for all frames at once.

A block's *columns* are the derivatives of its loops' sums by its unknowns: ``i Z`` for the angle of a group whose vectors add up
to ``Z``, the unit vector ``D`` for a sliding displacement. Velocities and accelerations are solved from the columns, joint forces
from their transpose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mechcore.arrays import Plane, Real, Values, modulus
from mechcore.kinematics.dyads import cross
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Block, LoopEquation, Unknown
from mechcore.kinematics.state import State
from mechcore.numerics.frames import determined, imaginary, is_zero, stacked, subtracted, summed
from mechcore.numerics.newton import solve_many


class LoopVectors(NamedTuple):
    """A loop's vectors in world axes at known positions.

    ``arms``: (class, Z) of the rotation classes that turn, displacements along guides included; ``slides``: (joint, class, D) of
    the guides.
    """

    arms: list[tuple[int, Plane]]
    slides: list[tuple[int, int, Plane]]


class Columns(NamedTuple):
    """A block's columns.

    ``table[c][u]`` is the derivative of the block's c-th loop by its u-th unknown, plain zero where the loop does not depend on it;
    ``constraints[r][u]`` is that of its r-th relation.

    For a dyad (one loop, two unknowns) ``direct``, ``dual`` and ``inverse`` replace the table, which is empty. ``direct``: the two
    columns, both turned back by a right angle; ``1 / inverse`` is their cross product. ``dual``: the dual basis; unknown k of
    ``columns @ x + r = 0`` is ``Im(r dual[k])``. The force that balances the generalised forces q is ``(q[0] direct[1] -
    q[1] direct[0]) inverse``.
    """

    table: tuple[tuple[Plane, ...], ...]
    constraints: tuple[tuple[Values, ...], ...] = ()
    direct: tuple[Any, Any] | None = None
    dual: tuple[Any, Any] | None = None
    inverse: Any = None


def all_vectors(model: Model, state: State) -> list[LoopVectors]:
    """The vectors of every loop at known positions."""
    return [_vectors(loop, state) for loop in model.program.loop_equations]


def _vectors(loop: LoopEquation, state: State) -> LoopVectors:
    rot, slide = state.rot, state.slide
    slides = [(j, s, d * rot[s]) for j, s, d in loop.guides]
    arms = []
    for rotation_class, a, carried in loop.vectors:
        z = a * rot[rotation_class]
        for i in carried:
            z = z + slide[slides[i][0]] * slides[i][2]
        arms.append((rotation_class, z))
    return LoopVectors(arms, slides)


def all_columns(model: Model, vectors: Sequence[LoopVectors]) -> list[Columns]:
    """The columns of every block."""
    return [columns(model, block, vectors) for block in model.blocks]


def columns(model: Model, block: Block, vectors: Sequence[LoopVectors]) -> Columns:
    """Derivatives of the block's loops by its unknowns, from the ``vectors`` of all loops."""
    loops = model.program.loop_equations
    if block.dyad:
        (c,) = block.loops
        (first, second), (moved, also) = block.unknowns, loops[c].columns
        u, v = _turned_back(vectors[c], first, moved), _turned_back(vectors[c], second, also)
        mirrored = u.conjugate()
        inverse = 1.0 / determined((mirrored * v).imag)
        over = imaginary(inverse)
        dual = (v * over).conjugate() if isinstance(v, np.ndarray) else -v.conjugate() * over  # a fixed guide's v is one number
        return Columns((), direct=(u, v), dual=(dual, mirrored * over), inverse=inverse)
    unknowns = block.unknowns
    table = tuple(
        tuple(column(vectors[c], x, numbers) for x, numbers in zip(unknowns, loops[c].columns, strict=True)) for c in block.loops
    )
    return Columns(table, tuple(tuple(constraint_coefficient(model, r, x) for x in unknowns) for r in block.relations))


def column(vectors: LoopVectors, unknown: Unknown, numbers: Sequence[int]) -> Plane:
    """Derivative of a loop by an unknown that moves the vectors with these ``numbers`` (see `program.moved_by`); plain zero if
    there are none."""
    if not numbers:
        return 0j
    return vectors.slides[numbers[0]][2] if unknown[0] == "slide" else 1j * summed([vectors.arms[i][1] for i in numbers])


def _turned_back(vectors: LoopVectors, unknown: Unknown, numbers: Sequence[int]) -> Plane:
    """`column` turned back by a right angle: for an angle, the sum of the vectors that it turns."""
    first, *others = numbers
    if unknown[0] == "slide":
        return -1j * vectors.slides[first][2]
    total = vectors.arms[first][1]
    for i in others:
        total = total + vectors.arms[i][1]
    return total


def constraint_coefficient(
    model: Model, relation: int, unknown: tuple[str, int], curve_values: Mapping[int, Real] | None = None
) -> Values:
    """Derivative of a relation by an unknown.

    With ``curve_values`` the derivative of its curve is included; unknowns of the relation's own block never enter its curve.
    """
    t = model.constraints[relation]
    c: Values = dict(t.groups if unknown[0] == "angle" else t.slides).get(unknown[1], 0.0)
    if t.curve is not None and curve_values is not None and (slope := t.curve.slope(unknown)):
        c = c + slope * curve_values[relation][1]
    return c


def rates(block: Block, cols: Columns, drift: Sequence[Plane], constraint_rhs: Sequence[Values] = ()) -> list[Values]:
    """Rates of the block's unknowns (angles, then slides) from ``columns @ rates + drift = 0`` and
    ``constraints @ rates = constraint_rhs``.

    ``drift``: for each loop, the rate of its sum that the known rates produce while those of the unknowns are zero.
    """
    if block.kind == "relation":
        return [constraint_rhs[0] / cols.constraints[0][0]]
    if cols.dual is not None:
        return [(drift[0] * d).imag for d in cols.dual]
    if len(drift) == 1 and len(cols.table[0]) == 1 and not constraint_rhs:
        ((c,),) = cols.table
        return [-(c.real * drift[0].real + c.imag * drift[0].imag) / determined(c.real**2 + c.imag**2)]
    matrix, shape = matrix_of(cols)
    shape = np.broadcast_shapes(shape, *(np.shape(r) for r in (*drift, *constraint_rhs)))  # guides on the frame: constant columns
    rhs = [part for r in drift for part in (-r.real, -r.imag)]
    x = solve_many(matrix, stacked([*rhs, *constraint_rhs], shape))
    return [x[..., k] for k in range(x.shape[-1])]


def transposed(block: Block, cols: Columns, q: list[Values]) -> tuple[list[Plane], list[Values]]:
    """Loop forces (complex) and relation forces that balance the generalised forces ``q`` of the block's unknowns."""
    if block.kind == "relation":
        return [], [q[0] / cols.constraints[0][0]]
    if cols.direct is not None:
        (u, v), (a, b) = cols.direct, q
        return [subtracted(0j if is_zero(a) else v * (a * cols.inverse), 0j if is_zero(b) else u * (b * cols.inverse))], []
    if len(cols.table) == 1 and len(cols.table[0]) == 1 and not cols.constraints:  # one redundant equation: minimum-norm force
        ((c,),) = cols.table
        return [c * (q[0] / determined(c.real**2 + c.imag**2))], []
    matrix, shape = matrix_of(cols)
    shape = np.broadcast_shapes(shape, *(np.shape(value) for value in q))
    x = solve_many(np.swapaxes(matrix, -1, -2), stacked(q, shape))
    n = len(cols.table)
    return [x[..., 2 * i] + 1j * x[..., 2 * i + 1] for i in range(n)], [x[..., 2 * n + i] for i in range(len(cols.constraints))]


def matrix_of(cols: Columns) -> tuple[Real, tuple[int, ...]]:
    """The columns as real matrices (..., 2 loops + relations, unknowns), and their leading shape (...)."""
    if cols.direct is not None:
        shape = np.broadcast_shapes(*(np.shape(c) for c in cols.direct))
        matrix = np.empty((*shape, 2, 2))
        for k, c in enumerate(cols.direct):  # turned back by a right angle: i c is the column
            matrix[..., 0, k], matrix[..., 1, k] = -np.imag(c), np.real(c)
        return matrix, shape
    shape = np.broadcast_shapes(*(np.shape(c) for row in cols.table for c in row if not is_zero(c)))
    width = len(cols.table[0] if cols.table else cols.constraints[0])
    rows = [[part(c) for c in row] for row in cols.table for part in (np.real, np.imag)]
    entries: list[Any] = [x for row in (*rows, *cols.constraints) for x in row]
    return stacked(entries, shape).reshape(*shape, len(rows) + len(cols.constraints), width), shape


def condition(model: Model, block: Block, cols: Columns) -> Values:
    """Condition number of a block's columns, lengths in units of the mechanism's size (inf where singular)."""
    k = len(block.angles)
    if cols.direct is not None:
        first: list[Any] = [c / model.length_scale if i < k else c for i, c in enumerate(cols.direct)]
        total: Any = sum(np.real(c) ** 2 + np.imag(c) ** 2 for c in first)
        product = modulus(cross(first[0], first[1]))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            largest2 = 0.5 * (total + np.sqrt(np.maximum((total - 2.0 * product) * (total + 2.0 * product), 0.0)))
            return np.where(product > 0, largest2 / product, np.inf)
    if not cols.table or not cols.table[0]:
        return 1.0
    matrix, _ = matrix_of(cols)
    matrix = matrix.copy()
    matrix[..., :k] /= model.length_scale
    s = np.linalg.svd(np.nan_to_num(matrix), compute_uv=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(s[..., -1] > 0, s[..., 0] / s[..., -1], np.inf)
