"""Positions of all blocks in order, for any number of drive positions at once.

A dyad has a closed form; any other block is solved by Newton's method on all its loops and relations together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from mechcore.accuracy import DEFAULT
from mechcore.arrays import Index, Plane, Real, Values, modulus
from mechcore.kinematics import dyads
from mechcore.kinematics.model import Model
from mechcore.kinematics.program import Block
from mechcore.kinematics.state import Interpolant, Newton, State, initial_state, relation_sum, value
from mechcore.numerics.frames import QUIET, is_zero
from mechcore.numerics.newton import newton

LoopTerms: TypeAlias = tuple[Plane, list[Plane], list[Plane]]
DETERMINED_RATIO = 1e-3  # relative singular value below which the interpolation, not the loops, decides a direction


def place_all(
    model: Model,
    drives: Sequence[Values],
    modes: Sequence[Values],
    starts: Mapping[str, Real] | None = None,
    interpolants: Mapping[int, Sequence[Interpolant]] | None = None,
    constants: Sequence[float] = (),
    tolerance: float = DEFAULT.position,
) -> State:
    """Positions for drive positions (...) each, with an assembly mode per block and Newton starts by block name.

    ``interpolants``: by block, positions given at some frames. ``tolerance``: residual at which Newton's method stops, in units of
    the mechanism's size.
    """
    state = initial_state(model, drives, constants, starts, tolerance)
    for i, (block, mode) in enumerate(zip(model.blocks, modes, strict=True)):
        place_block(model, block, state, mode, None if starts is None else starts.get(block.name))
        for interpolant in interpolants.get(i, ()) if interpolants else ():
            apply(model, block, state, interpolant, onto=True)
    return state


def place_block(
    model: Model, block: Block, state: State, mode: Values, start: Real | None = None, terms: LoopTerms | None = None
) -> None:
    """Solve a block's positions into ``state``; NaN where its links do not meet.

    ``start``: unknowns (..., n) from which Newton's method starts (general blocks only). ``terms``: the block's `loop_terms`, if
    already computed (blocks of one loop only).
    """
    if block.kind == "general":
        with np.errstate(**QUIET):
            _place_general(model, block, state, start)
    elif block.kind == "relation":
        _place_relation(model, block, state)
    elif block.kind == "check":
        for r in block.relations:  # stores the values of its curve in ``state``
            relation_sum(model, r, state)
    else:
        put_unknowns(model, block, state, closed_form(block, terms or loop_terms(model, block, state), mode))


def closed_form(block: Block, terms: LoopTerms, mode: Values) -> Sequence[Plane | Values]:
    """The unknowns of a block of one loop, from its `loop_terms`: rotations of its angles, then displacements."""
    target, arms, guides = terms
    if block.kind == "theta_theta":
        return dyads.theta_theta(arms[0], arms[1], target, mode)
    if block.kind == "theta_slide":
        return dyads.theta_slide(arms[0], guides[0], target, mode)
    if block.kind == "arm_slide":
        return dyads.arm_slide(arms[0], guides[0], target, mode)
    if block.kind == "slide_slide":
        return dyads.slide_slide(guides[0], guides[1], target)
    if block.kind == "angle":
        with np.errstate(**QUIET):
            e = target / arms[0]
            return (e / np.abs(e),)
    return ((target * guides[0].conjugate()).real,)


def put_unknowns(model: Model, block: Block, state: State, solved: Sequence[Plane | Values]) -> None:
    """Put the unknowns of a block, as `closed_form` returns them, into ``state``."""
    for group, rotation in zip(block.angles, solved, strict=False):
        _turn(model, state, group, rotation)
    for j, s in zip(block.slides, solved[len(block.angles) :], strict=True):
        state.slide[j] = s  # type: ignore[assignment]  # real, as the order of unknowns says


def loop_terms(model: Model, block: Block, state: State, number: int = 0) -> LoopTerms:
    """The terms of the equation of a block's ``number``-th loop: target, arms, guides.

    Target: the sum that the unknown vectors must have. Arms: for each unknown angle the vector that it turns, in axes that turn
    with it. Guides: the directions of the unknown slides, in such axes where an unknown angle turns them, else in world axes.
    """
    loop = model.program.loop_equations[block.loops[number]]
    rot, delta, slide = state.rot, state.delta, state.slide
    arms = [value(arm, delta, slide) if arm.arms or arm.slides else arm.constant for arm in loop.arms]
    guides = [d * (rot if carrier < 0 else delta)[rotation_class] for _, carrier, rotation_class, d in loop.slides]
    return value(loop.target, rot, slide), arms, guides


def _place_relation(model: Model, block: Block, state: State) -> None:
    r = block.relations[0]
    known, unknown = relation_sum(model, r, state, block)
    ((what, i), c), *_ = unknown.items()
    if what == "angle":
        state.angle[i] = -known / c
        _turn(model, state, i, np.exp(1j * state.angle[i]))
    else:
        state.slide[i] = -known / c


def _place_general(model: Model, block: Block, state: State, start: object) -> None:
    """Newton's method on all loops and relations of the block; lengths in units of the mechanism's size."""
    size = model.length_scale
    n_angles = len(block.angles)
    residual = equations(model, block, state)
    scale = np.concatenate([np.ones(n_angles), np.full(len(block.slides), size)])
    x, error, first = newton(residual, start / scale, tolerance=state.tolerance)
    x = np.where((error < max(1e-9, 10.0 * state.tolerance))[..., None], x, np.nan)
    for i, g in enumerate(block.angles):
        state.angle[g] = x[..., i]
        _turn(model, state, g, np.exp(1j * x[..., i]))
    for i, j in enumerate(block.slides):
        state.slide[j] = x[..., n_angles + i] * size
    state.newton[block.name] = Newton(x=x * scale, residual=error * size, first=first)


def _turn(model: Model, state: State, group: int, e: Plane | Values) -> None:
    for rotation_class in model.angles.classes_of[group]:
        delta = state.delta[rotation_class]
        state.rot[rotation_class] = e if isinstance(delta, complex) and delta == 1 else e * delta


def equations(model: Model, block: Block, state: State, frames: Index | None = None) -> Callable[[Real], tuple[Real, Real]]:
    """A block's loops and relations as a function of its unknowns (..., n): residuals (..., m) and their Jacobian (..., m, n).

    All lengths, slides included, are in units of the mechanism's size. ``frames``: at these only.
    """
    n_angles = len(block.angles)
    loops, linear = block_equations(model, block, state, frames)

    def residual(x: Real) -> tuple[Real, Real]:
        e = np.exp(1j * x[..., :n_angles])
        rows = 2 * len(loops) + len(linear)
        r = np.empty((*x.shape[:-1], rows))
        jac = np.zeros((*x.shape[:-1], rows, x.shape[-1]))
        total: Any
        for i, (total, unknowns) in enumerate(linear, 2 * len(loops)):
            for k, c in unknowns:
                total = total + c * x[..., k]
                jac[..., i, k] = c
            r[..., i] = total
        for i, (total, turned, slid) in enumerate(loops):
            for k, a in turned:
                z = a * e[..., k]
                total = total + z
                jac[..., 2 * i, k] -= z.imag
                jac[..., 2 * i + 1, k] += z.real
            for k, carrier, d in slid:
                along = d if carrier < 0 else d * e[..., carrier]
                moved = x[..., k] * along
                total = total + moved
                jac[..., 2 * i, k] += along.real
                jac[..., 2 * i + 1, k] += along.imag
                if carrier >= 0:
                    jac[..., 2 * i, carrier] -= moved.imag
                    jac[..., 2 * i + 1, carrier] += moved.real
            r[..., 2 * i], r[..., 2 * i + 1] = total.real, total.imag
        return r, jac

    return residual


class OpenLoop(NamedTuple):
    """A loop of a block for Newton's method.

    ``rest``: the known part of its sum. ``turned``: (number of an unknown angle, vector that it turns). ``slid``: (number of an
    unknown slide, number of the unknown angle that turns its guide or -1, direction of the guide).
    """

    rest: Plane
    turned: list[tuple[int, Plane]]
    slid: list[tuple[int, int, Plane]]


class OpenRelation(NamedTuple):
    """A relation of a block: ``rest``, the known part of its sum, and the ``unknowns`` (number, coefficient)."""

    rest: Values
    unknowns: list[tuple[int, float]]


def block_equations(
    model: Model, block: Block, state: State, frames: Index | None = None
) -> tuple[list[OpenLoop], list[OpenRelation]]:
    """A block's loops and relations with all known terms evaluated, lengths in units of the mechanism's size, see `equations`."""
    size = model.length_scale

    def at(value: Any, unit: float = size) -> Any:
        return value / unit if frames is None or not np.ndim(value) else value[frames] / unit

    column = {u: k for k, u in enumerate(block.unknowns)}
    loops = []
    for number, c in enumerate(block.loops):
        target, arms, guides = loop_terms(model, block, state, number)
        own = model.program.loop_equations[c]
        turned = [(k, at(a)) for k, a in enumerate(arms) if not is_zero(a)]
        slid = [(column["slide", s.joint], s.carrier, at(d, 1.0)) for s, d in zip(own.slides, guides, strict=True)]
        loops.append(OpenLoop(-at(target), turned, slid))
    linear = []
    for r in block.relations:
        known, unknown = relation_sum(model, r, state, block)
        linear.append(OpenRelation(at(known), [(column[u], c / size if u[0] == "angle" else c) for u, c in unknown.items()]))
    return loops, linear


def apply(model: Model, block: Block, state: State, interpolant: Interpolant, *, onto: bool = False) -> None:
    """Put an interpolant's positions into ``state``.

    ``onto``: first project them onto the loops by one Gauss-Newton step, in the directions that these determine.
    """
    values = interpolant.values
    if onto and len(interpolant.frames):
        scale = np.concatenate([np.ones(len(block.angles)), np.full(len(block.slides), model.length_scale)])
        left, jacobian = equations(model, block, state, interpolant.frames)(values / scale)
        correction = (np.linalg.pinv(np.nan_to_num(jacobian), rcond=DETERMINED_RATIO) @ left[..., None])[..., 0]
        values = values - np.where(np.isfinite(correction), correction, 0.0) * scale
    rotations = np.exp(1j * values[:, : len(block.angles)])
    for i, g in enumerate(block.angles):
        if g in state.angle:
            whole = np.array(state.angle[g])
            known = np.flatnonzero(np.isfinite(whole))
            rough = np.interp(interpolant.frames, known, whole[known]) if len(known) else values[:, i]
            whole[interpolant.frames] = values[:, i] + 2.0 * np.pi * np.round((rough - values[:, i]) / (2.0 * np.pi))
            state.angle[g] = whole
        e = rotations[:, i]
        for rotation_class in model.angles.classes_of[g]:
            rot, delta = np.array(state.rot[rotation_class]), state.delta[rotation_class]
            rot[interpolant.frames] = e * (delta[interpolant.frames] if isinstance(delta, np.ndarray) else delta)
            state.rot[rotation_class] = rot
    for i, j in enumerate(block.slides, len(block.angles)):
        slide = np.array(state.slide[j])
        slide[interpolant.frames] = values[:, i]
        state.slide[j] = slide


def dead_point_margin(model: Model, block: Block, state: State, terms: LoopTerms | None = None) -> list[Values]:
    """Distance of a dyad from the dead points at which its two assembly modes meet: smooth functions that are 0 there.

    They are relative differences of squared lengths, two for a theta_theta group (stretched, folded), else one. ``terms``: the
    block's `loop_terms`, if already computed.
    """
    target, arms, guides = terms or loop_terms(model, block, state)
    if block.kind == "theta_theta":
        ra, rb, d2 = modulus(arms[0]), modulus(arms[1]), (target * target.conjugate()).real
        total2, difference2 = (ra + rb) ** 2, (ra - rb) ** 2
        unit = 1.0 / total2
        return [(total2 - d2) * unit, (d2 - difference2) * unit]
    if block.kind == "theta_slide":
        r, y = np.abs(arms[0]), (target * np.conj(guides[0])).imag
        return [(r - y) * (r + y) / r**2]
    r2, y = target.real**2 + target.imag**2, (arms[0] * np.conj(guides[0])).imag
    return [(r2 - y * y) / model.length_scale**2]


def group_closure_error(block: Block, terms: LoopTerms) -> Values:
    """Closure error of a block with a closed form (...) [m]: the gap between its links, 0 where they meet; from its
    `loop_terms`."""
    target, arms, guides = terms
    if block.kind == "theta_theta":
        return dyads.error_theta_theta(arms[0], arms[1], target)
    if block.kind == "theta_slide":
        return dyads.error_theta_slide(arms[0], guides[0], target)
    if block.kind == "arm_slide":
        return dyads.error_arm_slide(arms[0], guides[0], target)
    return np.zeros(np.shape(target))
