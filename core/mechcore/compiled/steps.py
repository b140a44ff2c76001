"""The steps of a mechanism's program on symbols: the operations that numpy executes over frames are traced once, as a program in
C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mechcore.accuracy import DEFAULT
from mechcore.cams.placement.spatial import PlacedSpatial
from mechcore.compiled.symbols import Code, Symbol, Untraceable, called, plane_vector, rotation
from mechcore.kinematics.dyads import ROUNDING, cross
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import block_equations, loop_terms, place_block
from mechcore.kinematics.program import Block
from mechcore.kinematics.state import State

TURN = 6.283185307179586


def check_traceable(model: Model) -> None:
    """Raise `Untraceable`, with the reason, where a step cannot be written in C."""
    if model.designs:
        raise Untraceable("several designs side by side")
    for block in model.blocks:
        if block.kind == "general" and block.redundant:
            raise Untraceable(f"the group of {block.name} has more constraints than unknowns")


def check_forces_traceable(model: Model) -> None:
    """Raise `Untraceable`, with the reason, where reactions and efforts cannot be written in C."""
    check_traceable(model)
    if model.needs_global_solve:
        raise Untraceable("reactions that constraints do not determine are solved for all joints together")
    for relation in model.relations:
        if isinstance(relation.geometry, PlacedSpatial):
            raise Untraceable(f"the cam of {relation.name} touches its roller in space")


def place_all_symbols(model: Model, state: State, modes: list[Any], *, tied: bool = False) -> None:
    """Positions of all blocks, filled into a state of symbols; ``modes``: assembly mode of each block. Newton's method starts from
    ``state.near``; ``tied``: only a solution near that start, on its branch, is accepted."""
    for block, mode in zip(model.blocks, modes, strict=True):
        if block.kind == "relation":
            place_block(model, block, state, mode)
        elif block.kind == "general":
            _place_general(model, block, state, mode.code, tied=tied)
            continue
        elif block.kind != "check":
            _place_loop(model, block, state, mode)
        for group in block.angles:
            if group in model.multi_turn:
                state.angle[group] = followed_angle(model, state, group)


def placed_state(
    model: Model,
    drives: Sequence[Sequence[Any]],
    delta: list[Any],
    *,
    constants: Sequence[Any],
    near: Mapping[str, Any] | None = None,
    modes: list[Any],
    tolerance: Any = DEFAULT.position,
) -> Any:
    """Positions of all blocks at ``drives`` (position first) that turn rotation classes by ``delta``, all on symbols. ``near`` and
    ``tolerance`` as of `State`."""
    state: Any = State(
        drives=[q for q, *_ in drives],
        delta=delta,
        rot=[delta[s] if g == 0 else None for s, g in enumerate(model.angles.class_group)],
        slide={j: drives[d][0] for j, d in model.program.driven_slides},
        constants=constants,
        near=near or {},
        tolerance=tolerance,
    )
    place_all_symbols(model, state, modes)
    return state


def origins(model: Model, turned: Sequence[Any], slid: Mapping[int, Any]) -> list[Any]:
    """Positions of all links' origins from rotations E of the rotation classes and s E of the sliding joints; or the origins'
    rates, from the rates of these."""
    places: list[Any] = [0j] * len(model.links)

    def arm(k: int, j: int, side: int) -> Any:
        joint = model.joints[j]
        vector = (joint.b if side else joint.a) * model.turn[k]
        reach = vector * turned[model.angles.rotation_class[k]] if vector else 0j
        return reach + model.guides[j][1] * slid[j] if joint.slide is not None and joint.guide == side else reach

    for link in model.tree.order:
        if link:
            p, j = model.tree.parent[link], model.tree.joint[link]
            side = 1 if model.ends[j][1] == link else 0
            places[link] = places[p] + arm(p, j, 1 - side) - arm(link, j, side)
    return places


def followed_angle(model: Model, state: State, group: int) -> Any:
    """A group's unwrapped angle: the turn is that of the approximate angle in ``state.near``."""
    rotation_class = model.angles.classes_of[group][0]
    e: Any = state.rot[rotation_class] * state.delta[rotation_class].conjugate()
    angle = called("atan2", e.imag, e.real)
    near: Any = state.near.get(f"angle {group}")
    return angle if near is None else angle + TURN * called("rint", (near - angle) / TURN)


def _place_loop(model: Model, block: Block, state: State, mode: Symbol) -> None:
    """A block of one loop by its closed form, see `mechcore.kinematics.dyads`."""
    target, arms, guides = loop_terms(model, block, state)
    c: Any = target
    solved: tuple[Any, ...]
    if block.kind == "theta_theta":
        solved = _theta_theta(arms[0], arms[1], c, mode)
    elif block.kind == "theta_slide":
        solved = _theta_slide(arms[0], guides[0], c, mode)
    elif block.kind == "arm_slide":
        solved = _arm_slide(arms[0], guides[0], c, mode)
    elif block.kind == "slide_slide":
        first, second = guides
        determinant = cross(first, second)
        solved = cross(c, second) / determinant, cross(first, c) / determinant
    elif block.kind == "angle":
        e = c / arms[0]
        solved = (e / abs(e),)
    else:  # slide
        solved = ((c * guides[0].conjugate()).real,)
    for (what, i), x in zip(block.unknowns, solved, strict=True):
        if what == "slide":
            state.slide[i] = x
            continue
        for rotation_class in model.angles.classes_of[i]:
            state.rot[rotation_class] = x * state.delta[rotation_class]


def _place_general(model: Model, block: Block, state: State, code: Code, *, tied: bool) -> None:
    """A block by Newton's method, lengths in units of the mechanism's size."""
    start: Any = state.near.get(block.name)
    if start is None:
        raise Untraceable(f"the group of {block.name} is solved by Newton's method")
    size, count = model.length_scale, len(block.angles)
    loops, linear = block_equations(model, block, state)
    shape = [count, len(block.unknowns), len(loops), len(linear), int(tied)]
    numbers: list[Any] = [x if k < count else x / size for k, x in enumerate(start)] + [state.tolerance]
    for rest, turned, slid in loops:
        shape += [len(turned), *(k for k, _ in turned), len(slid), *(k for n, carrier, _ in slid for k in (n, carrier))]
        vectors = [rest, *(a for _, a in turned), *(d for *_, d in slid)]
        numbers += [part for z in vectors for part in (z.real, z.imag)]
    for total, unknowns in linear:
        shape += [len(unknowns), *(k for k, _ in unknowns)]
        numbers += [total, *(c for _, c in unknowns)]
    solved = code.filled("newton", len(block.unknowns), shape, numbers)
    for group, x in zip(block.angles, solved, strict=False):
        state.angle[group] = x  # type: ignore[assignment]  # symbols replace arrays
        for rotation_class in model.angles.classes_of[group]:
            state.rot[rotation_class] = rotation(x) * state.delta[rotation_class]
    for j, x in zip(block.slides, solved[count:], strict=True):
        state.slide[j] = size * x


def _theta_theta(a: Any, b: Any, c: Any, mode: Symbol) -> tuple[Any, Any]:
    ra, rb, squared = abs(a), abs(b), (c * c.conjugate()).real
    half = 0.5 / squared
    distance = mode.code.called("sqrt", squared)
    across = half * mode.code.called("four_areas", ra, rb, distance, ROUNDING) * mode
    shift = (ra - rb) * (ra + rb) * half
    return plane_vector(0.5 + shift, across) * c * (1.0 / a), plane_vector(0.5 - shift, -across) * c * (1.0 / b)


def _theta_slide(a: Any, along: Any, c: Any, mode: Symbol) -> tuple[Any, Any]:
    turned = c * along.conjugate()
    x = mode.code.called("leg", abs(a), turned.imag, ROUNDING) * mode
    return plane_vector(x, turned.imag) * (along / a), turned.real - x


def _arm_slide(a: Any, d: Any, c: Any, mode: Symbol) -> tuple[Any, Any]:
    foot = a * d.conjugate()
    x = mode.code.called("leg", abs(c), foot.imag, ROUNDING) * mode
    return c * d.conjugate() / plane_vector(x, foot.imag), x - foot.real
