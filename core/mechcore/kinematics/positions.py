"""Positions of all blocks in order, for any number of drive positions at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mechcore.accuracy import DEFAULT
from mechcore.kinematics.blocks import Patch, State, apply, place
from mechcore.kinematics.model import Model
from mechcore.numerics.frames import rotation_of

Array = Any


def initial_state(
    model: Model,
    drives: Sequence[Array],
    constants: Sequence[float] = (),
    near: Mapping[str, Array] | None = None,
    tolerance: float = DEFAULT.position,
) -> State:
    """State with everything that the drives' positions alone decide: spins of the frame's group, driven slides.

    ``constants`` of the relations; ``near``: rough angles "angle <group>" that decide the turn where relations need it.
    """
    factor: dict[tuple[int, int], Array] = {}
    delta: list[Array] = [1 + 0j] * len(model.angles.spin_group)
    for spin, terms in model.driven_spins:
        total: Array = None
        for term in terms:
            if term not in factor:
                d, sign = term
                factor[term] = rotation_of(drives[d] if sign == 1 else sign * drives[d])
            total = factor[term] if total is None else total * factor[term]
        delta[spin] = total
    rot: list[Array] = [None] * len(delta)
    for spin in model.angles.spins_of[0]:
        rot[spin] = delta[spin]
    slide = {j: drives[d] for j, d in model.driven_slides}
    return State(drives=drives, delta=delta, rot=rot, slide=slide, constants=constants, near=near or {}, tolerance=tolerance)


def place_all(
    model: Model,
    drives: Sequence[Array],
    modes: Sequence[Array],
    starts: Mapping[str, Array] | None = None,
    patches: Mapping[int, Sequence[Patch]] | None = None,
    constants: Sequence[float] = (),
    tolerance: float = DEFAULT.position,
) -> State:
    """Positions for drive positions (...) each, with an assembly mode per block, Newton starts by block name, and frames at which
    a block's positions are given. ``tolerance``: residual at which Newton's method stops, in sizes of the mechanism."""
    state = initial_state(model, drives, constants, starts, tolerance)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # NaN, "out of reach", is an answer here
        for i, (block, mode) in enumerate(zip(model.blocks, modes, strict=True)):
            place(model, block, state, mode, None if starts is None else starts.get(block.name))
            if patches:
                for patch in patches.get(i, ()):
                    apply(model, block, state, patch, onto=True)
    return state
