"""Change points and dead points that a run passes: where the two assembly modes of a group meet.

There the group's triangle is flat for an instant. A smooth motion passes through: a joint on the left comes out on the right. The
mode therefore changes sign at every such instant; otherwise the motion would turn back with a kink onto the other branch. Near the
instant the loop equations are ill conditioned, at it they are singular: see `singular_interpolation`.

Where the sides violate the triangle inequality, the group cannot be assembled. Such a range, however narrow, is found in the same
manner.
"""

from __future__ import annotations

import cmath
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mechcore.arrays import Flags, Index, Real
from mechcore.branches.dead_points import WINDOW_SAMPLES, dead_point_instants, rounding_of
from mechcore.branches.modes import TWO_MODES
from mechcore.kinematics.columns import all_vectors, columns, matrix_of
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import LoopTerms, dead_point_margin, loop_terms, place_block
from mechcore.kinematics.program import Block
from mechcore.kinematics.singular_interpolation import (
    FAR_STEPS,
    FIT_NODES,
    FIT_TAIL,
    SmoothedSamples,
    smoothed,
    tail_of,
    unknowns_of,
)
from mechcore.kinematics.state import State, initial_state
from mechcore.laws.timed import ConstantSpeed, Law, moves
from mechcore.records import dataclass

SAMPLES_A_CYCLE = 720  # at least, per cycle and per turn of the fastest drive
MOST_SAMPLES = 400_000  # samples of a whole run
FINER_SAMPLING = (1, 8, 64)  # times as many samples, if a group moves too fast next to a singular point for the polynomial


@dataclass(frozen=True)
class SingularPoint:
    """At ``time`` the modes of block number ``block`` meet. ``dead``: the drives are at rest there, at a limit. ``flips``: the
    motion passes through; else it only touches the dead point and turns back."""

    time: float
    block: int
    name: str
    dead: bool
    flips: bool = True
    step: float = 0.0  # unit of the distances from it at which positions are interpolated, see `singular_interpolation`


@dataclass(frozen=True)
class UnreachableRange:
    """From ``start`` to ``end`` [s] the block cannot be assembled."""

    start: float
    end: float
    block: int


@dataclass(frozen=True)
class SingularPoints:
    """All singular points within ``[0, period)``; beyond, they repeat. ``unreachable``: where a group cannot be assembled.

    ``by_drive``: "time" is the travel of the only drive from its start [rad or m], not in seconds; ``laws`` are functions of it.
    """

    period: float
    points: tuple[SingularPoint, ...]
    laws: tuple[Law, ...]
    by_drive: bool = False
    unreachable: tuple[UnreachableRange, ...] = ()

    def within(self, start: float, end: float) -> list[SingularPoint]:
        """All singular points of a run from ``start`` to ``end`` [s], in order of time."""
        out = []
        for k in range(int(np.floor(start / self.period)), int(np.floor(end / self.period)) + 1):
            for c in self.points:
                t = c.time + k * self.period
                if start <= t <= end:
                    out.append(replace(c, time=t))
        return sorted(out, key=lambda c: c.time)

    def unreachable_within(self, start: float, end: float) -> list[UnreachableRange]:
        """Unreachable ranges that a run from ``start`` to ``end`` [s] meets, within its first two periods only."""
        turns = np.floor(start / self.period)
        moved = [
            replace(g, start=g.start + k * self.period, end=g.end + k * self.period)
            for g in self.unreachable
            for k in (turns, turns + 1)
        ]
        return [g for g in moved if g.end > start and g.start < end]

    @cached_property
    def _flips(self) -> dict[int, _Flips]:
        """For each block, the instants at which its modes are exchanged."""
        times: dict[int, list[float]] = {}
        for c in self.points:
            if c.flips:
                times.setdefault(c.block, []).append(c.time)
        return {block: _flips_of(t, self.period) for block, t in times.items()}

    def signs(self, block: int, time: Real) -> Real | float:
        """+1 or -1 by the number of times that the block's modes are exchanged between the start and ``time`` (...)."""
        flips = self._flips.get(block)
        return 1.0 if flips is None else flips.signs(*_cycles(time, self.period))

    def all_signs(self, time: Real) -> Iterator[tuple[int, Real]]:
        """The blocks whose modes are exchanged, each with its `signs` (...)."""
        cycles = _cycles(time, self.period) if self._flips else None
        return ((block, flips.signs(*cycles)) for block, flips in self._flips.items() if cycles is not None)

    def near(self, time: Real, steps: float) -> bool:
        """Whether any of the times (n,) is closer to a singular point than ``steps`` times the step of that point."""
        times, widths = self._places
        far = (time - times) / self.period
        return bool((np.abs(far - np.round(far)) < steps / self.period * widths).any())

    @cached_property
    def _places(self) -> tuple[Real, Real]:
        """Times and steps (p, 1) of the points."""
        return np.array([[c.time] for c in self.points]), np.array([[c.step] for c in self.points])


class _Flips(NamedTuple):
    """The instants in a period at which modes are exchanged; one at the start of the period counts as passed and has no instant.

    ``odd``: whether they are exchanged an odd number of times; ``alternating``: +1 and -1 in turn.
    """

    odd: bool
    times: Real
    alternating: Real

    def signs(self, parity: Index, local: Real) -> Real:
        """+1 or -1 by the number of exchanges before times (...), given as `_cycles` returns them."""
        count = self.times.searchsorted(local, side="left")
        return np.asarray(self.alternating[count + parity if self.odd else count])


def _flips_of(times: Sequence[float], period: float) -> _Flips:
    tiny = 1e-9 * period
    within = sorted(t - period if t > period - tiny else t for t in times)  # one at the very end is one at the start
    passed = [t for t in within if t > tiny]
    return _Flips(len(within) % 2 == 1, np.array(passed), np.array([1.0, -1.0] * (len(passed) // 2 + 2)))


def _cycles(time: Real, period: float) -> tuple[Index, Real]:
    """For times (...): the parity of the number of the period, and the time since the start of that period [s]."""
    cycle = np.floor((time + 1e-12 * period) / period)
    return (cycle % 2.0).astype(int), time - cycle * period


def find_singular_points(
    model: Model, modes: Sequence[float], starts: Mapping[str, Real], *, span: float | None = None
) -> SingularPoints | None:
    """All singular points of a mechanism under its drives' laws; None if there can be none, or if groups are continued.

    With one rotary drive that can turn fully, the singular points depend on the configuration alone: one turn of the drive is
    searched, or two or four until the modes repeat. Otherwise they depend on the laws: one cycle is searched, or two or four, if it
    closes. If it does not close, ``span`` [s] is searched; without ``span`` the result is None although there may be singular
    points: see `needs_span`.
    """
    drives = model.mechanism.drives
    if not drives or starts or model.relations or not any(b.kind in TWO_MODES for b in model.blocks):
        return None
    first = model.joints[model.joint_index[drives[0].joint]]
    if len(drives) == 1 and first.coordinate == "angle":
        turn = (ConstantSpeed(float(drives[0].law(0.0)[0]), 1.0),)
        points = _until_closed(model, modes, 2.0 * np.pi, turn, by_drive=True)
        if points is not None:
            return points
    laws = tuple(d.law for d in drives)
    cycle = model.mechanism.cycle
    if not np.isfinite(cycle) or cycle <= 0:
        return None
    if not needs_span(model):
        return _until_closed(model, modes, cycle, laws, by_drive=False)
    if span is None:
        return None
    return _scan(model, modes, cycle, max(1, int(np.ceil(span / cycle - 1e-9))), laws, by_drive=False)


def needs_span(model: Model) -> bool:
    """Whether a cycle of the laws does not return the drives to their first positions (as with a sliding drive that advances)."""
    for d in model.mechanism.drives:
        if not moves(d.law):
            continue
        travel = float(d.law(d.law.duration)[0] - d.law(0.0)[0])
        if model.joints[model.joint_index[d.joint]].coordinate == "angle":
            travel -= 2.0 * np.pi * round(travel / (2.0 * np.pi))
        if abs(travel) > 1e-9 or abs(d.law.duration - model.mechanism.cycle) > 1e-12 * d.law.duration:
            return True
    return False


def _until_closed(
    model: Model, modes: Sequence[float], cycle: float, laws: tuple[Law, ...], *, by_drive: bool
) -> SingularPoints | None:
    """Search one, two or four cycles, until every group changes its mode an even number of times."""
    singular_points = None
    for cycles in (1, 2, 4):
        singular_points = _scan(model, modes, cycle, cycles, laws, by_drive=by_drive)
        if singular_points is None:
            return None
        counts = np.bincount([c.block for c in singular_points.points if c.flips], minlength=len(model.blocks))
        if not (counts % 2).any():
            break
    return singular_points


def _scan(
    model: Model, modes: Sequence[float], cycle: float, cycles: int, laws: tuple[Law, ...], *, by_drive: bool
) -> SingularPoints | None:
    """Search cycles of the laws, with finer samples if needed; None if ``by_drive`` and the drive cannot turn fully."""
    for finer in FINER_SAMPLING:
        singular_points, resolved = _sampled(model, modes, cycle, cycles, laws, finer, by_drive=by_drive)
        if resolved:
            break
    return singular_points


def _sampled(
    model: Model, modes: Sequence[float], cycle: float, cycles: int, laws: tuple[Law, ...], finer: int, *, by_drive: bool
) -> tuple[SingularPoints | None, bool]:
    """Sample cycles of the laws block by block.

    The flag says whether the samples resolve the motion next to every singular point; if the result is None, whether finer samples
    would not change that.
    """
    period = cycles * cycle
    probe = np.linspace(0.0, period, 2001)
    rotary = [model.joints[model.joint_index[d.joint]].coordinate == "angle" for d in model.mechanism.drives]
    fastest = max((float(np.max(np.abs(law(probe)[1]))) for law, r in zip(laws, rotary, strict=True) if r), default=0.0)
    count = min(
        max(SAMPLES_A_CYCLE, int(np.ceil(cycle * fastest * SAMPLES_A_CYCLE / (2.0 * np.pi)))),
        max(SAMPLES_A_CYCLE, MOST_SAMPLES // cycles),
    )
    coarse, step = cycle / count, cycle / count / finer
    ends = (FAR_STEPS + WINDOW_SAMPLES) * finer
    time: Real = step * np.arange(-ends, cycles * count * finer + ends + 1, dtype=float)
    values = [law(time) for law in laws]
    state = initial_state(model, [v[0] for v in values])
    still = np.max([np.abs(v[1]) for v in values], axis=0)
    slow = 20.0 * coarse / cycle * float(still.max(initial=0.0))
    points: list[SingularPoint] = []
    unreachable: list[UnreachableRange] = []
    resolved, rounding, sampled_cycles = True, rounding_of(model), _cycles(time, period)
    samples = _Samples(model, state, time, period, step, finer, np.zeros(len(time), bool))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for i, (block, mode) in enumerate(zip(model.blocks, modes, strict=True)):
            sign: Real | float = 1.0
            terms: LoopTerms | None = None
            own: list[tuple[float, bool]] = []
            if block.kind in TWO_MODES:
                terms = loop_terms(model, block, state)
                margins = dead_point_margin(model, block, state, terms)
                instants, missing, sharp = dead_point_instants(margins, time, samples.blurred, rounding)
                if sharp and finer < FINER_SAMPLING[-1]:
                    return None, False
                if by_drive and missing:
                    return None, True
                unreachable += [UnreachableRange(a, b, i) for a, b in missing if b > 0.0 and a < period]
                own = [(t, flips) for t, flips in instants if -1e-9 * period <= t < period * (1.0 - 1e-9)]
                exchanged = [t for t, flips in own if flips]
                if exchanged:
                    sign = _flips_of(exchanged, period).signs(*sampled_cycles)
            place_block(model, block, state, mode * sign, terms=terms)
            if own:  # later blocks must not see its ill-conditioned positions
                steps, fine = _smoothed(samples, block, [t for t, _ in own])
                for (t, flips), resolving in zip(own, steps, strict=True):
                    dead = not by_drive and float(np.interp(t, time, still)) < slow
                    points.append(SingularPoint(t, i, block.name, dead, flips, resolving))
                resolved &= fine
            if by_drive and block.angles:
                rotation = state.rot[model.angles.classes_of[block.angles[0]][0]]
                if not cmath.isfinite(np.add.reduce(rotation, axis=None)):
                    return None, True
    return SingularPoints(
        period=period, points=tuple(points), laws=laws, by_drive=by_drive, unreachable=tuple(unreachable)
    ), resolved


class _Samples(NamedTuple):
    """Positions at equidistant times (n,) [s], which ``state`` holds for the blocks solved so far.

    ``step``: of the times [s]; ``finer``: number of steps in one of the coarsest sampling; ``blurred`` (n,): where positions of an
    earlier group are interpolated.
    """

    model: Model
    state: State
    time: Real
    period: float
    step: float
    finer: int
    blurred: Flags


def _smoothed(samples: _Samples, block: Block, instants: Sequence[float]) -> tuple[list[float], bool]:
    """Interpolate a block's sampled positions next to instants at which its modes meet.

    Returns for each instant the largest step that resolves the motion there, or the best one tried, and whether they resolve it.
    """
    model, state, time, period, step, finer, blurred = samples
    first, last = float(time[0]), float(time[-1])
    places = [at for t in instants for at in (t - period, t, t + period) if first < at < last]
    best: SmoothedSamples | None = None
    width = resolving = finer
    while width >= 1:
        found = smoothed(model, block, state, time, places, step * width)
        if found is not None and not found.tail < FIT_TAIL and len(instants) > 1:  # each has a step of its own
            each = [_smoothed(samples, block, [t]) for t in instants]
            return [own for (own,), _ in each], all(fine for _, fine in each)
        if found is not None and (best is None or found.tail < 0.5 * best.tail):
            best, resolving = found, width
        if found is None or found.tail < FIT_TAIL:
            break
        width //= 2
    if best is not None:
        best.into(model, block, state)
        blurred[best.samples] = True
    return [step * resolving] * len(instants), best is None or best.tail < FIT_TAIL


def locate_singular(
    model: Model, block: Block, placed: Callable[[Real], State], p: float, sample: float
) -> tuple[float, float] | None:
    """The parameter of a continued group's singular position next to ``p``, and the step, at most ``sample``, that resolves the
    motion around it; None if positions are unknown there. ``placed``: parameters (n,) -> positions."""
    scale = np.where(np.arange(len(block.angles) + len(block.slides)) < len(block.angles), 1.0, model.length_scale)
    best: tuple[float, float, float] | None = None
    width = sample
    for _ in range(8):
        state = placed(p + width * FAR_STEPS * FIT_NODES)
        values = unknowns_of(model, block, state, np.arange(len(FIT_NODES)))
        if np.isfinite(values).all():
            tail = tail_of(values / scale)
            if best is None or tail < 0.5 * best[0]:
                best = tail, p + _zero(_determinant(model, block, state), FIT_NODES) * width * FAR_STEPS, width
            if tail < FIT_TAIL:
                break
        width *= 0.5
    return None if best is None else best[1:]


def _determinant(model: Model, block: Block, state: State) -> Real:
    matrix, _ = matrix_of(columns(model, block, all_vectors(model, state)))
    matrix[..., : len(block.angles)] /= model.length_scale
    return np.asarray(np.linalg.det(matrix), float)


def _zero(values: Real, nodes: Real) -> float:
    """The zero near 0 of a smooth quantity given at nodes on [-1, 1], by Newton's method on a fit; 0 if none lies within 0.2."""
    fit = np.polynomial.Chebyshev.fit(nodes, values / np.abs(values).max(), 11, domain=[-1.0, 1.0])
    slope, at = fit.deriv(), 0.0
    for _ in range(20):
        at -= float(np.clip(fit(at) / slope(at), -0.1, 0.1)) if slope(at) != 0.0 else 0.0
    return at if abs(at) < 0.2 else 0.0


def passages(singular_points: SingularPoints, drive: Law, time: Real, q: Real) -> list[SingularPoint]:
    """The singular points along the only drive that a run passes, at its times [s]; from ``time`` (F,) [s], the drive's law and its
    positions ``q`` (F,)."""
    start = float(singular_points.laws[0](0.0)[0])
    travel = q - start
    along = singular_points.within(float(np.min(travel)), float(np.max(travel)))
    place = np.array([c.time + start for c in along])
    behind = np.searchsorted(place, q)  # number of places that each frame is beyond
    many = np.abs(np.diff(behind))
    k = np.repeat(np.arange(len(many)), many)
    order = np.arange(len(k)) - np.repeat(np.cumsum(many) - many, many)
    which = np.minimum(behind[k], behind[k + 1]) + order
    low, high, ahead = time[k], time[k + 1], behind[k] > which
    for _ in range(50 if len(which) else 0):  # bisection of all passages at once
        middle = 0.5 * (low + high)
        same = (drive(middle)[0] > place[which]) == ahead
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    out = [replace(along[i], time=float(t)) for i, t in zip(which, 0.5 * (low + high), strict=True)]
    return sorted(out, key=lambda c: c.time)
