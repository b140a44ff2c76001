"""Positions of all blocks in order, for any number of drive positions at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .blocks import Patch, State, apply, place
from .frames import rotation_of
from .model import Model

__all__ = ["drive_rates", "initial_state", "place_all"]

Array = Any


def initial_state(
    model: Model, drives: Sequence[Array], constants: Sequence[float] = (), near: Mapping[str, Array] | None = None
) -> State:
    """State with everything that the drives' positions alone decide: spins of the frame's group, driven slides.

    ``constants`` of the relations; ``near``: rough angles "angle <group>" that decide the turn where relations need it.
    """
    factor: dict[tuple[int, int], Array] = {}

    def rotation(d: int, sign: int) -> Array:
        if (d, sign) not in factor:
            q = drives[d] if sign == 1 else sign * drives[d]
            factor[d, sign] = rotation_of(q)
        return factor[d, sign]

    delta: list[Array] = []
    for terms in model.angles.spin_drives:
        total: Array = None
        for d, sign in terms:
            total = rotation(d, sign) if total is None else total * rotation(d, sign)
        delta.append(1 + 0j if total is None else total)
    rot = [r if g == 0 else None for r, g in zip(delta, model.angles.spin_group, strict=True)]
    slide = {j: drives[d] for j, d in model.driven.items() if model.joints[j].coordinate == "slide"}
    return State(drives=drives, delta=delta, rot=rot, slide=slide, constants=constants, near=near or {})


def place_all(
    model: Model,
    drives: Sequence[Array],
    modes: Sequence[Array],
    starts: Mapping[str, Array] | None = None,
    patches: Mapping[int, Sequence[Patch]] | None = None,
    constants: Sequence[float] = (),
) -> State:
    """Positions for drive positions (...) each, with an assembly mode per block, Newton starts by block name, and frames at which
    a block's positions are given."""
    state = initial_state(model, drives, constants, starts)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # NaN, "out of reach", is an answer here
        for i, (block, mode) in enumerate(zip(model.blocks, modes, strict=True)):
            place(model, block, state, mode, None if starts is None else starts.get(block.name))
            for patch in patches.get(i, ()) if patches else ():
                apply(model, block, state, patch, onto=True)
    return state


def drive_rates(model: Model, rates: Sequence[Array]) -> tuple[list[Array], dict[int, Array]]:
    """What the drives' rates alone decide: extra speed of each spin over its group, and the rates of driven slides."""
    extra: list[Array] = []
    for terms in model.angles.spin_drives:
        total: Array = 0.0
        for d, sign in terms:
            total = total + sign * rates[d]
        extra.append(total)
    return extra, {j: rates[d] for j, d in model.driven.items() if model.joints[j].coordinate == "slide"}
