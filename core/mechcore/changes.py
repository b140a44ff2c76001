"""Change points and dead points that a run passes: where the two assembly modes of a group meet.

There the group's triangle is flat for an instant. A smooth motion goes through: what was on the left comes out on the right. The
mode therefore changes sign at every such time, or the motion would turn back with a kink onto the other branch. Near the
instant itself the contour equations are ill conditioned and at it singular; positions and rates there come from the branch on
both sides by interpolation of high order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from . import blocks as bl
from .blocks import Patch, State
from .kinematics import accelerations, velocities
from .laws import ConstantSpeed, Law
from .model import Block, Model
from .positions import initial_state, place_all

__all__ = ["Change", "Changes", "find_changes", "make_patches", "needs_span", "passages"]

Array = Any
SAMPLES = 720  # of a cycle, at least, and of a turn of the fastest drive
MOST = 400_000  # samples of a whole run
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
    """At ``time`` the modes of block number ``block`` meet. ``dead``: the drive stands still there, at its limit. ``flips``: the
    motion goes through; else it only touches the flat position and turns back."""

    time: float
    block: int
    name: str
    dead: bool
    flips: bool = True


@dataclass(frozen=True)
class Changes:
    """All changes within ``[0, period)``; beyond, they repeat. ``step``: distance of the samples.

    ``by_drive``: "time" means the way of the only drive from its start [rad], not seconds; ``laws`` lead the drives along it.
    """

    period: float
    step: float
    found: tuple[Change, ...]
    laws: tuple[Law, ...]
    by_drive: bool = False

    def within(self, start: float, end: float) -> list[Change]:
        """All changes of a run from ``start`` to ``end`` [s], in order of time."""
        out = []
        for k in range(int(np.floor(start / self.period)), int(np.floor(end / self.period)) + 1):
            for c in self.found:
                t = c.time + k * self.period
                if start <= t <= end:
                    out.append(replace(c, time=t))
        return sorted(out, key=lambda c: c.time)

    def signs(self, block: int, time: Array) -> Array:
        """+1 or -1 by how often the block's modes have met between the start and ``time`` (...)."""
        times = np.sort([c.time for c in self.found if c.block == block and c.flips])
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


def find_changes(model: Model, modes: Sequence[float], starts: Mapping[str, Array], *, span: float | None = None) -> Changes | None:
    """All changes of a mechanism under its drives' laws; None where there can be none, or where groups are followed by a walk.

    With one rotary drive that can turn fully the configuration alone decides: one turn of the drive is looked at (or as many as the
    mechanism needs to come back). Else the laws decide, over one cycle if that closes. If it does not, ``span`` [s] says how far to
    look, and without it the answer is None although there may be changes: see `needs_span`.
    """
    drives = model.mechanism.drives
    if not drives or starts or model.relations or not any(b.kind in TWO_MODES for b in model.blocks):
        return None
    first = model.joints[model.joint_index[drives[0].pair]]
    if len(drives) == 1 and first.coordinate == "angle":
        turn = (ConstantSpeed(float(drives[0].law(0.0)[0]), 1.0),)
        found = _until_closed(model, modes, 2.0 * np.pi, turn, by_drive=True)
        if found is not None:
            return found
    laws = tuple(d.law for d in drives)
    cycle = laws[0].duration
    if not np.isfinite(cycle) or cycle <= 0:
        return None
    if not needs_span(model):
        return _until_closed(model, modes, cycle, laws, by_drive=False)
    if span is None:
        return None
    return _scan(model, modes, cycle, max(1, int(np.ceil(span / cycle - 1e-9))), laws, by_drive=False)


def needs_span(model: Model) -> bool:
    """Whether a cycle of the laws does not bring the drives back to where they were (a sliding drive that goes on, say)."""
    drives = model.mechanism.drives
    for d in drives:
        way = float(d.law(d.law.duration)[0] - d.law(0.0)[0])
        if model.joints[model.joint_index[d.pair]].coordinate == "angle":
            way -= 2.0 * np.pi * round(way / (2.0 * np.pi))
        if abs(way) > 1e-9 or abs(d.law.duration - drives[0].law.duration) > 1e-12 * d.law.duration:
            return True
    return False


def _until_closed(model: Model, modes: Sequence[float], cycle: float, laws: tuple[Law, ...], *, by_drive: bool) -> Changes | None:
    """Look at one, two or four cycles, until every group has changed its mode an even number of times."""
    changes = None
    for cycles in (1, 2, 4):
        changes = _scan(model, modes, cycle, cycles, laws, by_drive=by_drive)
        if changes is None:
            return None
        counts = np.bincount([c.block for c in changes.found if c.flips], minlength=len(model.blocks))
        if not (counts % 2).any():
            break
    return changes


def _scan(
    model: Model, modes: Sequence[float], cycle: float, cycles: int, laws: tuple[Law, ...], *, by_drive: bool
) -> Changes | None:
    """Sample cycles of the laws block by block; None where the drive alone decides but cannot turn fully."""
    period = cycles * cycle
    probe = np.linspace(0.0, period, 2001)
    rotary = [model.joints[model.joint_index[d.pair]].coordinate == "angle" for d in model.mechanism.drives]
    fastest = max((float(np.max(np.abs(law(probe)[1]))) for law, r in zip(laws, rotary, strict=True) if r), default=0.0)
    samples = min(max(SAMPLES, int(np.ceil(cycle * fastest * SAMPLES / (2.0 * np.pi)))), max(SAMPLES, MOST // cycles))
    step = cycle / samples
    time = step * np.arange(-FAR - WINDOW, cycles * samples + FAR + WINDOW + 1)
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
                    Change(t, i, block.name, bool(np.interp(t, time, still) < 20.0 * step / cycle * speed), flips)
                    for t, flips in _flat_instants(model, block, state, time)
                    if -1e-9 * period <= t < period * (1.0 - 1e-9)
                ]
                if own:
                    found += own
                    sign = Changes(period, step, tuple(own), laws).signs(i, time)
            bl.place(model, block, state, mode * sign)
            if by_drive and block.angles and not np.isfinite(np.sum(state.rot[model.angles.spins_of[block.angles[0]][0]])):
                return None
            for c in found:
                if c.block == i:  # what hangs on this block must not see its ill-conditioned positions
                    for cycle_start in (-period, 0.0, period):
                        _smooth(model, block, state, time, c.time + cycle_start, step)
    return Changes(period=period, step=step, found=tuple(found), laws=laws, by_drive=by_drive)


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


def _flat_instants(model: Model, block: Block, state: State, time: Array) -> list[tuple[float, bool]]:
    """Times at which a group's triangle touches its flat position without leaving its reach, and whether it goes through.

    The height squared grows with the second power of the time where the motion goes through, with the fourth where the drive turns
    back just there.
    """
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
                near, far = (0.5 * abs(float(fit(at - w) + fit(at + w))) for w in (1.5, 3.0))
                out.append((float(time[k] + at * (time[1] - time[0])), far < 8.0 * near))
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
    values = [law(nodes) for law in changes.laws]
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


def passages(changes: Changes, drive: Law, time: Array, q: Array) -> list[Change]:
    """When a run passes the changes that lie along its only drive: ``time`` (F,) [s], the drive's law and positions (F,)."""
    out = []
    way = q - changes.laws[0](0.0)[0]
    for c in changes.within(float(np.min(way)), float(np.max(way))):
        place = c.time + float(changes.laws[0](0.0)[0])
        beyond = q > place
        k = np.flatnonzero(beyond[1:] != beyond[:-1])
        low, high = time[k], time[k + 1]
        for _ in range(50):
            middle = 0.5 * (low + high)
            same = (drive(middle)[0] > place) == beyond[k]
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        out += [replace(c, time=float(t)) for t in 0.5 * (low + high)]
    return sorted(out, key=lambda c: c.time)
