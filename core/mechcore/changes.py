"""Change points and dead points that a run passes: where the two assembly modes of a group meet.

There the group's triangle is flat for an instant. A smooth motion goes through: what was on the left comes out on the right. The
mode therefore changes sign at every such time, or the motion would turn back with a kink onto the other branch. Near the
instant itself the contour equations are ill conditioned and at it singular; positions and rates there come from the branch on
both sides by interpolation of high order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from . import blocks as bl
from .blocks import Patch, State
from .kinematics import accelerations, velocities
from .model import Block, Model
from .positions import initial_state, place_all

__all__ = ["Change", "Changes", "find_changes", "make_patches"]

Array = Any
SAMPLES = 720  # of a cycle
FLAT = 3e-15  # below this `blocks.flatness` is rounding: the triangle is flat
WINDOW = 4  # samples on each side from which the instant is located
NEAR = 4.0  # frames closer than this many samples are interpolated: accelerations lose digits with the third power of closeness
FAR = 22
NODES = np.concatenate([np.arange(-FAR, -7), np.arange(8, FAR + 1)]) / FAR  # where the branch is solved for that, over FAR samples
DEGREE = 11  # of the polynomial fitted to them: more nodes than coefficients, because their rounding errors average out
FIT = np.linalg.pinv(chebyshev.chebvander(NODES, DEGREE))
TWO_MODES = ("theta_theta", "theta_slide", "arm_slide")


@dataclass(frozen=True)
class Change:
    """At ``time`` [s] the modes of block number ``block`` meet. ``dead``: the drive stands still there, at its limit."""

    time: float
    block: int
    name: str
    dead: bool


@dataclass(frozen=True)
class Changes:
    """All changes within ``[0, period)``; beyond, they repeat. ``step``: half width of the stretch that is interpolated."""

    period: float
    step: float
    found: tuple[Change, ...]

    def within(self, start: float, end: float) -> list[Change]:
        """All changes of a run from ``start`` to ``end`` [s], in order of time."""
        out = []
        for k in range(int(np.floor(start / self.period)), int(np.floor(end / self.period)) + 1):
            for c in self.found:
                t = c.time + k * self.period
                if start <= t <= end:
                    out.append(Change(t, c.block, c.name, c.dead))
        return sorted(out, key=lambda c: c.time)

    def signs(self, block: int, time: Array) -> Array:
        """+1 or -1 by how often the block's modes have met between the start and ``time`` (...)."""
        times = np.sort([c.time for c in self.found if c.block == block])
        if not len(times):
            return 1.0
        tiny = 1e-9 * self.period
        times = np.where(times > self.period - tiny, times - self.period, times)  # a change at the very end is one at the start
        times.sort()
        cycle = np.floor((time + 1e-12 * self.period) / self.period)
        local = time - cycle * self.period
        after_start = times[times > tiny]  # one at the start itself has been passed already
        count = cycle * len(times) + np.searchsorted(after_start, local, side="left")
        return np.where(np.mod(count, 2) == 0, 1.0, -1.0)


def find_changes(model: Model, modes: Sequence[float], starts: Mapping[str, Array]) -> Changes | None:
    """Changes over one cycle of the drives, or over as many as the mechanism needs to come back to its start; None if there are
    no drives, or groups without a closed form (those are followed by continuation)."""
    laws = [d.law for d in model.mechanism.drives]
    if not laws or starts or model.relations or not any(b.kind in TWO_MODES for b in model.blocks):
        return None
    cycle = laws[0].duration
    if not np.isfinite(cycle) or cycle <= 0:
        return None
    for cycles in (1, 2, 4):
        changes = _scan(model, modes, cycle, cycles)
        counts = np.bincount([c.block for c in changes.found], minlength=len(model.blocks))
        if not (counts % 2).any():
            break
    return changes


def _scan(model: Model, modes: Sequence[float], cycle: float, cycles: int) -> Changes:
    period = cycles * cycle
    step = cycle / SAMPLES
    time = step * np.arange(-FAR - WINDOW, cycles * SAMPLES + FAR + WINDOW + 1)
    laws = [d.law for d in model.mechanism.drives]
    values = [law(time) for law in laws]
    state = initial_state(model, [v[0] for v in values])
    still = np.max([np.abs(v[1]) for v in values], axis=0)
    speed = float(still.max(initial=0.0))
    found: list[Change] = []
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for i, (block, mode) in enumerate(zip(model.blocks, modes, strict=True)):
            sign: Array = 1.0
            if block.kind in TWO_MODES:
                own = [
                    Change(t, i, block.name, bool(np.interp(t, time, still) < 1e-6 * speed))
                    for t in _flat_instants(model, block, state, time)
                    if -1e-9 * period <= t < period * (1.0 - 1e-9)
                ]
                if own:
                    found += own
                    sign = Changes(period, step, tuple(own)).signs(i, time)
            bl.place(model, block, state, mode * sign)
            for c in found:
                if c.block == i:  # what hangs on this block must not see its ill-conditioned positions
                    for cycle_start in (-period, 0.0, period):
                        _smooth(model, block, state, time, c.time + cycle_start, step)
    return Changes(period=period, step=step, found=tuple(found))


def _smooth(model: Model, block: Block, state: State, time: Array, instant: float, step: float) -> None:
    """Replace a block's sampled positions next to an instant by the curve through the samples on both sides of it."""
    away = (time - instant) / (step * FAR)
    near = np.flatnonzero(np.abs(away) < NEAR / FAR)
    fit = np.flatnonzero((np.abs(away) <= 1.0) & (np.abs(away) >= 8.0 / FAR))
    if not len(near) or len(fit) < 2 or np.ptp(away[fit]) < 1.9:  # at the ends of the samples there is nothing on one side
        return
    rows = []
    for g in block.angles:
        spin = model.angles.spins_of[g][0]
        rows.append(np.unwrap(np.angle((state.rot[spin] * np.conj(state.delta[spin]))[fit])))
    rows += [state.slide[j][fit] for j in block.slides]
    basis = np.linalg.pinv(chebyshev.chebvander(away[fit], DEGREE))
    values = chebyshev.chebvander(away[near], DEGREE) @ (basis @ np.array(rows).T)
    bl.apply(model, block, state, Patch(near, values, values, values))


def _flat_instants(model: Model, block: Block, state: State, time: Array) -> list[float]:
    """Times at which a group's triangle touches its flat position without leaving its reach."""
    out = []
    for height in bl.flatness(model, block, state):
        h = np.broadcast_to(height, time.shape)
        inner = h[1:-1]
        low = (inner <= h[:-2]) & (inner < h[2:]) & (inner < 1e-2) & (inner > -1e-6)
        for k in np.flatnonzero(low) + 1:
            a, b = max(k - WINDOW, 0), min(k + WINDOW + 1, len(time))
            x = (time[a:b] - time[k]) / (time[1] - time[0])
            y = h[a:b]
            if not np.isfinite(y).all():
                continue
            fit = np.polynomial.Polynomial.fit(x, y, min(8, len(x) - 1))
            slope, curve = fit.deriv(), fit.deriv(2)
            at = 0.0
            for _ in range(8):
                bend = float(curve(at))
                if bend <= 0:
                    break
                at = float(np.clip(at - slope(at) / bend, -1.5, 1.5))
            if abs(float(fit(at))) <= FLAT:
                out.append(float(time[k] + at * (time[1] - time[0])))
    return out


def make_patches(
    model: Model, changes: Changes, modes: Sequence[float], time: Array, scale: Sequence[Array]
) -> dict[int, list[Patch]]:
    """Interpolations for the frames next to a change, by block. ``scale``: how fast the frames run against the law (1, 0 where
    they follow it): first and second derivative of law time by time."""
    near = [c for c in changes.found if _frames_near(changes, c, time).any()]
    if not near:
        return {}
    nodes = np.unique(np.concatenate([_nodes(changes, c) for c in near]))
    values = [d.law(nodes) for d in model.mechanism.drives]
    signs = [m * changes.signs(i, nodes) for i, m in enumerate(modes)]
    state = place_all(model, [v[0] for v in values], signs)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        contours = {c: bl.vectors(model, c, state) for c in range(len(model.contours))}
        cols = [bl.columns(model, b, contours) for b in model.blocks]
        speeds = velocities(model, contours, cols, [v[1] for v in values])
        seconds = accelerations(model, contours, cols, speeds, [v[2] for v in values])
    patches: dict[int, list[Patch]] = {}
    for c in near:
        block = model.blocks[c.block]
        x = np.searchsorted(nodes, _nodes(changes, c))
        rows: list[Array] = []
        for g in block.angles:
            spin = model.angles.spins_of[g][0]
            extra = [sum(s * v[k][x] for (d, s), v in _drives(model, spin, values)) for k in (1, 2)]
            angle = np.unwrap(np.angle((state.rot[spin] * np.conj(state.delta[spin]))[x]))
            rows.append([angle, speeds.spin[spin][x] - extra[0], seconds.spin[spin][x] - extra[1]])
        rows += [[state.slide[j][x], speeds.slide[j][x], seconds.slide[j][x]] for j in block.slides]
        frames = np.flatnonzero(_frames_near(changes, c, time))
        away = time[frames] - c.time
        away = (away - changes.period * np.round(away / changes.period)) / (changes.step * FAR)
        value, rate, bend = np.moveaxis(np.array(rows) @ FIT.T @ chebyshev.chebvander(away, DEGREE).T, 1, 0).swapaxes(1, 2)
        s1, s2 = (np.broadcast_to(s, time.shape)[frames, None] for s in scale)
        patches.setdefault(c.block, []).append(Patch(frames, value, rate * s1, bend * s1**2 + rate * s2))
    return patches


def _drives(model: Model, spin: int, values: Sequence[Any]) -> list[tuple[tuple[int, int], Any]]:
    return [(term, values[term[0]]) for term in model.angles.spin_drives[spin]]


def _nodes(changes: Changes, c: Change) -> Array:
    return c.time + changes.step * FAR * NODES


def _frames_near(changes: Changes, c: Change, time: Array) -> Array:
    away = time - c.time
    return np.abs(away - changes.period * np.round(away / changes.period)) < NEAR * changes.step
