"""Where a mechanism can be assembled: the reachable range of its drive; elsewhere the closure error of a group.

The closure error is the least distance by which one joint of the group stays open while all its others are closed: one link next to
it must be longer or shorter by this length. Dyads have closed forms for it. In any other group each joint is opened in turn, and
the distance is minimised by the method of Levenberg and Marquardt from many starts.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Index, Real, Values, ascending
from mechcore.branches.assembly import Assembly
from mechcore.branches.dead_points import dead_point_instants, rounding_of
from mechcore.branches.modes import TWO_MODES
from mechcore.branches.paths import branch_by_drive, branch_path, largest_steps
from mechcore.constants import TURN
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import dead_point_margin, equations, group_closure_error, loop_terms, place_all, place_block
from mechcore.kinematics.program import Block
from mechcore.kinematics.state import State, initial_state
from mechcore.motion.between_frames import largest_maximum
from mechcore.motion.compiled import Compiled, motion_or_nan
from mechcore.motion.motion import Motion
from mechcore.numerics.newton import Residual, least_squares
from mechcore.records import dataclass
from mechcore.spec.mechanism import Cylinder

REACH_SAMPLES = 1441  # samples of the first drive's position for its reachable ranges
POSITION_SAMPLES, MOST_SAMPLES = 361, 2001  # samples of the first drive's position, and of time
MOST_HALVINGS = 40
SLOT_SLACK = 1e-9  # of the mechanism's size: largest overrun of a slot's end that counts as rounding
RANGE_INSET = 1e-6  # relative: a proposed range is narrower by this at each end, because it is shown with seven digits


def reachable_ranges(compiled: Compiled) -> list[tuple[float, float]]:
    """Ranges of the first drive's position [rad or m] in which every group can be assembled, with other drives held at their start.

    A rotary drive is examined over one turn about its start, a sliding one within five sizes of the mechanism. Ends are located
    to 1e-10 of that range. If groups must be followed (see `branches.paths`), only the range around the start is found. The range
    that contains the start comes first.
    """
    ranges = _ranges(compiled)
    joints = compiled.mechanism.joints
    if any(isinstance(joint, Cylinder) and joint.name == compiled.mechanism.drives[0].joint for joint in joints):
        return [(max(low, 0.0), high) for low, high in ranges if high > 0.0]  # its coordinate is the distance of two points
    return ranges


def _ranges(compiled: Compiled) -> list[tuple[float, float]]:
    model = compiled.model
    q0 = compiled.start[0]
    rotary = model.joints[model.joint_index[model.mechanism.drives[0].joint]].coordinate == "angle"
    half = 0.5 * TURN if rotary else 5.0 * model.length_scale
    if compiled.needs_path:
        full = half * (2.0 if rotary else 1.0)
        branch = branch_by_drive(model, compiled.assembly, compiled.start[1:])
        path = branch_path(branch, q0, q0 - full, q0 + full, float(largest_steps(model)[0]))
        low, high = path.continuation.ends
        low = max([low, *(end for _, end, _ in path.unreachable if end < q0)])
        high = min([high, *(start for start, _, _ in path.unreachable if start > q0)])
        if rotary and low <= q0 - full and high >= q0 + full:  # with a limit on one side a turn leads to another mode
            low, high = q0 - half, q0 + half
        if not model.mechanism.ends:
            return [(low, high)]
    else:
        low, high = q0 - half, q0 + half

    def solved(q: Real) -> Motion:
        given = {d.joint: (np.full_like(q, s), np.zeros_like(q), np.zeros_like(q)) for d, s in zip(
            model.mechanism.drives, compiled.start, strict=True)}  # fmt: skip
        given[model.mechanism.drives[0].joint] = (q, np.ones_like(q), np.zeros_like(q))
        return motion_or_nan(compiled, np.zeros(len(q)), given)

    def assembled(q: Real) -> Flags:
        motion = solved(q)
        fits = np.isfinite(np.sum([np.broadcast_to(np.abs(r), len(q)) for r in motion.state.rot], axis=0)) & np.isfinite(
            np.sum([np.zeros(len(q)), *(np.broadcast_to(s, len(q)) for s in motion.state.slide.values())], axis=0)
        )
        return np.asarray(fits & within_slots(motion), bool)

    grid = np.linspace(low, high, REACH_SAMPLES)
    state, places = solved(grid).state, [grid]
    for block in model.blocks:
        if block.kind in TWO_MODES:  # unreachable ranges narrower than the grid
            margins = dead_point_margin(model, block, state)
            for start, end in dead_point_instants(margins, grid, np.zeros(len(grid), bool), rounding_of(model))[1]:
                places.append(np.clip([start, 0.5 * (start + end), end], low, high))
    grid = ascending(np.concatenate(places))
    ok = assembled(grid)
    edges = np.flatnonzero(ok[1:] != ok[:-1])
    before, after = grid[edges].copy(), grid[edges + 1].copy()
    for _ in range(40):  # bisection of all edges at once
        if not len(edges):
            break
        middle = 0.5 * (before + after)
        same = assembled(middle) == ok[edges]
        before, after = np.where(same, middle, before), np.where(same, after, middle)
    cuts = [grid[0], *np.where(ok[edges], before, after), grid[-1]] if len(edges) else [grid[0], grid[-1]]
    out = []
    inside = bool(ok[0])
    for a, b in itertools.pairwise(cuts):
        if inside:
            out.append((float(a), float(b)))
        inside = not inside
    if (
        rotary and not compiled.needs_path and len(out) > 1 and out[0][0] == low and out[-1][1] == high
    ):  # both meet half a turn away
        (_, end), (begin, _) = out[0], out.pop()
        out[0] = (begin, end + TURN) if begin <= q0 else (begin - TURN, end)
    return sorted(out, key=lambda r: not r[0] <= q0 <= r[1])


def nearest_range(compiled: Compiled, time: Real) -> tuple[float, float] | None:
    """The range of the first drive's position [rad or m] about its start in which every group can be assembled at all positions
    that the laws of the other drives give from the first of ``time`` to the last.

    None if there is none, or if groups must be followed.
    """
    model = compiled.model
    if compiled.needs_path:
        return None
    first, *others = model.mechanism.drives
    rotary, q0 = model.rotary(first.joint), compiled.start[0]
    half = 0.5 * TURN if rotary else 5.0 * model.length_scale
    t = np.linspace(float(np.min(time)), float(np.max(time)), int(np.clip(2 * len(time), POSITION_SAMPLES, MOST_SAMPLES)))
    places = [np.broadcast_to(np.asarray(d.law(t)[0], float), t.shape) for d in others]

    def fits(q: Real) -> Flags:
        state = place_all(
            model, [q[:, None], *places], compiled.assembly.modes, compiled.assembly.starts, constants=compiled.assembly.constants
        )
        shape = len(q), len(t)
        rows = [h for b in model.blocks if b.kind in TWO_MODES for h in dead_point_margin(model, b, state)]
        rows += room_in_slots(model, state)
        values = [*(r for r in state.rot if r is not None), *state.slide.values()]
        ok = np.all([np.broadcast_to(np.isfinite(v), shape).all(axis=1) for v in values], axis=0)
        return np.asarray(np.all([ok, *(_least(np.broadcast_to(row, shape)) >= 0.0 for row in rows)], axis=0))

    step = 2.0 * half / (POSITION_SAMPLES - 1)
    ends = []
    for sign in (-1.0, 1.0):
        ok = fits(q0 + sign * step * np.arange(POSITION_SAMPLES // 2 + 1, dtype=float))
        if not ok[0]:
            return None
        steps = len(ok) - 1 if ok.all() else int(np.argmin(ok)) - 1
        inside, outside = q0 + sign * step * steps, q0 + sign * step * (steps + 1)
        for _ in range(0 if ok.all() else MOST_HALVINGS):
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if fits(np.array([middle]))[0] else (inside, middle)
        ends.append(inside - sign * RANGE_INSET * abs(inside))
    low, high = ends
    return (low, high) if low < q0 < high else None


def _least(rows: Real) -> Real:
    """Least values of smooth functions sampled evenly, (..., t) -> (...), including minima of parabolas between the samples."""
    before, here, after = rows[..., :-2], rows[..., 1:-1], rows[..., 2:]
    slope, curvature = 0.5 * (after - before), after - 2.0 * here + before
    with np.errstate(divide="ignore", invalid="ignore"):
        dip = np.where((curvature > 0.0) & (np.abs(slope) <= curvature), here - 0.5 * slope**2 / curvature, here)
    return np.asarray(np.minimum(rows.min(axis=-1), dip.min(axis=-1)))


@dataclass(frozen=True)
class SlotOverrun:
    """A pin or slider beyond an end of its slot or guide: the joint, the coordinate of that end [m], the largest overrun [m], the
    frames beyond (F,), and the time of the largest overrun [s], which may lie between two frames."""

    joint: str
    end: float
    beyond: float
    frames: Flags
    time: float


def _excesses(motion: Motion) -> Iterator[tuple[str, float, Any]]:
    """For each end of a slot: joint, coordinate of the end [m], and the function motion -> overrun of that end (F,) [m], negative
    within the slot."""
    model = motion.model
    for name, ends in motion.mechanism.ends.items():
        j = model.joint_index[name]
        for end, sign in zip(ends, (-1.0, 1.0), strict=True):

            def excess(at: Motion, j: int = j, end: float = end, sign: float = sign) -> Real:
                beyond = sign * (np.asarray(at.state.slide[j]) - end)
                return np.broadcast_to(beyond, np.broadcast_shapes(beyond.shape, (at.frames,)))

            yield name, end, excess


def room_in_slots(model: Model, state: State) -> list[Values]:
    """For each end of a slot or guide, the distance of its pin or slider from it [m] (...), negative beyond."""
    joints = [(state.slide[model.joint_index[name]], ends) for name, ends in model.mechanism.ends.items()]
    return [room for slide, (low, high) in joints for room in (slide - low, high - slide)]


def within_slots(motion: Motion) -> Flags:
    """Whether all pins and sliders are between their ends (F,)."""
    slack = SLOT_SLACK * motion.model.length_scale
    within: Flags = np.ones(motion.frames, bool)
    for _, _, excess in _excesses(motion):
        within = within & ~(excess(motion) > slack)
    return within


def slot_overruns(motion: Motion) -> list[SlotOverrun]:
    """The overruns of pins and sliders beyond their ends in a motion, those between frames included."""
    slack, beyond_ends = SLOT_SLACK * motion.model.length_scale, []
    for joint, end, excess in _excesses(motion):
        values = excess(motion)
        outside = values > slack
        farthest = int(np.argmax(np.where(np.isfinite(values), values, -np.inf)))
        time, beyond = float(motion.time[farthest]), float(values.flat[farthest])
        step = float(np.max(np.abs(np.diff(values)), initial=0.0))
        if beyond > -step:  # the largest overrun may lie between two frames
            time, beyond = largest_maximum(motion, excess)
        if beyond > slack:
            beyond_ends.append(SlotOverrun(joint, end, beyond, outside, time))
    return beyond_ends


MOST_FRAMES = 25  # at which groups without a closed form are examined, and again next to the worst of these
START_COUNT = 32
MOST_ITERATIONS = 60
CLOSED_WEIGHT = 1e3  # of the closed joints relative to the open one: their closure errors stay below 1e-6 of its error


def greatest_closure_error(assembly: Assembly, block: Block, motion: Motion, failed: Flags) -> float:
    """Largest closure error of a block at ``failed`` frames (F,) [m]: the gap between its links.

    0 if they would meet at all of them, infinite if more than one joint must stay open at one of them.
    """

    def errors(at: Motion) -> Real:
        return np.broadcast_to(group_closure_error(block, loop_terms(at.model, block, at.state)), at.frames)

    if block.kind != "general":
        at_frames = float(np.fmax.reduce(np.where(failed, errors(motion), 0.0), initial=0.0))
        return float(np.fmax(at_frames, largest_maximum(motion, errors)[1])) if at_frames else 0.0
    frames = np.flatnonzero(failed)
    first, last, greatest = 0, len(frames) - 1, 0.0
    while True:
        chosen = np.unique(np.linspace(first, last, MOST_FRAMES).astype(int))
        drives = [np.broadcast_to(d[0], motion.frames)[frames[chosen], None] for d in motion.drives]
        sampled = _least_closure_errors(motion.model, assembly, block, drives)
        greatest, k = max(greatest, float(sampled.max())), int(np.argmax(sampled))
        if len(chosen) < MOST_FRAMES or greatest == np.inf:
            return greatest
        first, last = int(chosen[max(k - 1, 0)]), int(chosen[min(k + 1, len(chosen) - 1)])


def _least_closure_errors(model: Model, assembly: Assembly, block: Block, drives: Sequence[Real]) -> Real:
    """`least_closure_error` (F,) at positions of the drives (F, 1); 0 where earlier groups cannot be assembled."""
    state = initial_state(model, drives, assembly.constants, assembly.starts)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for b, mode in zip(model.blocks, assembly.modes, strict=True):
            if b is block:
                break
            place_block(model, b, state, mode, assembly.starts.get(b.name))
        return np.nan_to_num(least_closure_error(model, block, state), nan=0.0, posinf=np.inf)


def least_closure_error(model: Model, block: Block, state: State) -> Real:
    """Closure error of a general block (F,) [m]: the gap between its links, 0 where they meet, infinite where more than one joint
    must stay open. ``state`` must hold the earlier blocks, at positions of the drives (F, 1)."""
    rng = np.random.default_rng(1)
    closing = equations(model, block, state)
    n, k = len(block.angles), len(block.slides)
    frames = np.broadcast_shapes(*(np.shape(q)[:1] for q in state.drives))
    starts = np.concatenate([rng.uniform(-np.pi, np.pi, (START_COUNT, n)), rng.uniform(-2.0, 2.0, (START_COUNT, k))], axis=-1)
    least: Real = np.full(frames, np.inf)
    for signs in _openings(model, block):
        x = np.broadcast_to(starts, (*frames, *starts.shape))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            open_by = _minimised(partial(_opened, closing, signs), x)
        least = np.fmin(least, np.fmin.reduce(open_by, axis=-1))
    return least * model.length_scale


def _openings(model: Model, block: Block) -> list[Index]:
    """For each joint of a block's loops: the sign with which the distance of its two points enters each loop (loops,), +1, -1 or
    0. Joints with equal or opposite signs are listed once."""
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
    """Residuals (..., m) and derivatives (..., m, n) of a block with one open joint: those of the open joint first, the others
    weighted."""
    r, jacobian = equations(x)
    loops = len(signs)
    first = int(np.flatnonzero(signs)[0])
    mix = np.eye(r.shape[-1])
    for c in range(loops):
        if c != first:
            mix[2 * c : 2 * c + 2, 2 * first : 2 * first + 2] -= signs[c] * signs[first] * np.eye(2)
    closed = np.delete(np.arange(r.shape[-1]), [2 * first, 2 * first + 1])
    mix[closed] *= CLOSED_WEIGHT
    mix = mix[[2 * first, 2 * first + 1, *closed]]
    return r @ mix.T, mix @ jacobian


def _minimised(function: Residual, x: Real) -> Real:
    """Norm (...) of the first two of the residuals (..., m) at least squares, from starts (..., n); infinite where the other
    residuals do not vanish."""
    r = least_squares(function, x, iterations=MOST_ITERATIONS)
    open_ = np.hypot(r[..., 0], r[..., 1])
    left = np.abs(r[..., 2:]).max(axis=-1, initial=0.0) / CLOSED_WEIGHT
    return np.where(left <= 1e-4 * open_ + 1e-9, open_, np.inf)
