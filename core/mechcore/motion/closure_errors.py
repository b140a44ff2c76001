"""By how much the links of a group miss each other where it cannot be assembled.

The miss is the least distance by which one joint of the group has to stay open while all its others are closed: so much longer or
shorter one link next to it has to be. Dyads have closed forms for it; in any other group each joint is opened in turn and the
distance minimised by the method of Levenberg and Marquardt from many starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechcore.branches.assembly import Assembly
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import equations, gap, place
from mechcore.kinematics.program import Block
from mechcore.kinematics.state import State, initial_state
from mechcore.motion.metrics import peak
from mechcore.motion.motion import Motion
from mechcore.numerics.newton import Residual, least_squares

MOST_FRAMES = 25  # at which groups without a closed form are looked at, and again next to the worst of them
STARTS = 32
ITERATIONS = 60
WEIGHT = 1e3  # of the closed joints against the open one: their gaps stay below 1e-6 of its


def greatest_miss(assembly: Assembly, block: Block, motion: Motion, failed: Flags) -> float:
    """By how much the links of a block miss each other at ``failed`` frames (F,) at the most [m]; 0 where they would meet, infinite
    where more than one joint has to stay open."""

    def misses(at: Motion) -> Real:
        return np.broadcast_to(gap(at.model, block, at.state), at.frames)

    if block.kind != "general":
        at_frames = float(np.fmax.reduce(np.where(failed, misses(motion), 0.0), initial=0.0))
        return float(np.fmax(at_frames, peak(motion, misses)[1])) if at_frames else 0.0
    frames = np.flatnonzero(failed)
    first, last, greatest = 0, len(frames) - 1, 0.0
    while True:
        chosen = np.unique(np.linspace(first, last, MOST_FRAMES).astype(int))
        drives = [np.broadcast_to(d[0], motion.frames)[frames[chosen], None] for d in motion.drives]
        misses_there = _misses(motion.model, assembly, block, drives)
        greatest, k = max(greatest, float(misses_there.max())), int(np.argmax(misses_there))
        if len(chosen) < MOST_FRAMES or greatest == np.inf:
            return greatest
        first, last = int(chosen[max(k - 1, 0)]), int(chosen[min(k + 1, len(chosen) - 1)])


def _misses(model: Model, assembly: Assembly, block: Block, drives: Sequence[Real]) -> Real:
    """`least_miss` (F,) at drives (F, 1), 0 where the groups before it cannot be assembled."""
    state = initial_state(model, drives, assembly.constants, assembly.starts)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for b, mode in zip(model.blocks, assembly.modes, strict=True):
            if b is block:
                break
            place(model, b, state, mode, assembly.starts.get(b.name))
        return np.nan_to_num(least_miss(model, block, state), nan=0.0, posinf=np.inf)


def least_miss(model: Model, block: Block, state: State) -> Real:
    """By how much the links of a general block miss each other [m] (F,), 0 where they meet; infinite where more than one joint has
    to stay open. Needs the earlier blocks in ``state``, at drives (F, 1)."""
    rng = np.random.default_rng(1)
    closing = equations(model, block, state)
    n, k = len(block.angles), len(block.slides)
    frames = np.broadcast_shapes(*(np.shape(q)[:1] for q in state.drives))
    starts = np.concatenate([rng.uniform(-np.pi, np.pi, (STARTS, n)), rng.uniform(-2.0, 2.0, (STARTS, k))], axis=-1)
    least: Real = np.full(frames, np.inf)
    for signs in _openings(model, block):
        x = np.broadcast_to(starts, (*frames, *starts.shape))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            open_by = _minimised(partial(_opened, closing, signs), x)
        least = np.fmin(least, np.fmin.reduce(open_by, axis=-1))
    return least * model.length_scale


def _openings(model: Model, block: Block) -> list[Index]:
    """For each joint of a block's loops: how the distance of its two points enters them (loops,), +1, -1 or 0."""
    depth = [0] * len(model.links)
    for link in model.tree.order:
        depth[link] = depth[model.tree.parent[link]] + 1
    rows: dict[int, list[int]] = {}
    for row, c in enumerate(block.loops):
        closing = model.loops[c].closing
        rows.setdefault(closing, [0] * len(block.loops))[row] = 1
        up, down = model.ends[closing]
        while up != down:
            sign, link = (1, up) if depth[up] >= depth[down] else (-1, down)
            rows.setdefault(model.tree.joint[link], [0] * len(block.loops))[row] = sign
            up, down = (model.tree.parent[link], down) if sign == 1 else (up, model.tree.parent[link])
    unique = {max(tuple(signs), tuple(-s for s in signs)) for signs in rows.values()}
    return [np.array(signs) for signs in sorted(unique)]


def _opened(equations: Residual, signs: Index, x: Real) -> tuple[Real, Real]:
    """Equations (..., m) and derivatives (..., m, n) with those of the open joint first, the others weighted."""
    r, jacobian = equations(x)
    loops = len(signs)
    first = int(np.flatnonzero(signs)[0])
    mix = np.eye(r.shape[-1])
    for c in range(loops):
        if c != first:
            mix[2 * c : 2 * c + 2, 2 * first : 2 * first + 2] -= signs[c] * signs[first] * np.eye(2)
    closed = np.delete(np.arange(r.shape[-1]), [2 * first, 2 * first + 1])
    mix[closed] *= WEIGHT
    mix = mix[[2 * first, 2 * first + 1, *closed]]
    return r @ mix.T, mix @ jacobian


def _minimised(function: Residual, x: Real) -> Real:
    """Length (...) of the first two of the values (..., m) of a function where their sum of squares is least, from starts
    (..., n); infinite where the others are not closed there."""
    r = least_squares(function, x, iterations=ITERATIONS)
    open_ = np.hypot(r[..., 0], r[..., 1])
    left = np.abs(r[..., 2:]).max(axis=-1, initial=0.0) / WEIGHT
    return np.where(left <= 1e-4 * open_ + 1e-9, open_, np.inf)
