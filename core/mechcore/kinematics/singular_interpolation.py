"""Positions and rates next to an instant at which a group's equations are singular.

The motion itself is smooth there; only its equations are ill conditioned. Positions and rates are interpolated along the branch on
both sides, by a polynomial fitted at nodes that are far enough away to be accurate. The spacing of the nodes is the ``step`` of
each singular point: a group that moves fast has its nodes close, otherwise the polynomial could not follow it. Groups are treated
in solving order, because the nodes of a later group may lie where an earlier one is singular.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from mechcore.arrays import Complex, Flags, Index, Real, Values
from mechcore.constants import TURN
from mechcore.kinematics.columns import all_columns, all_vectors
from mechcore.kinematics.model import Model
from mechcore.kinematics.positions import apply, place_block
from mechcore.kinematics.program import Block
from mechcore.kinematics.rates import accelerations, velocities
from mechcore.kinematics.state import Interpolant, State, group_rotation, initial_state
from mechcore.numerics.frames import QUIET
from mechcore.records import dataclass

if TYPE_CHECKING:
    from mechcore.branches.singular_points import SingularPoint, SingularPoints


NEAR_STEPS = 4.0  # frames closer than this many steps are interpolated: accelerations lose digits with the third power of closeness
FAR_STEPS = 22
FIT_NODES = (
    np.concatenate([np.arange(-FAR_STEPS, -7), np.arange(8, FAR_STEPS + 1)]) / FAR_STEPS
)  # where the branch is solved for the fit, in units of FAR_STEPS steps
FIT_DEGREE = 11  # of the polynomial fitted to them: fewer coefficients than nodes, so that rounding errors average out
FIT = np.linalg.pinv(chebyshev.chebvander(FIT_NODES, FIT_DEGREE))
FRACTIONS = 256  # of a sample interval, to which an instant is rounded: the fitted curve does not depend on that
FIT_TAIL = 1e-12  # largest last coefficient of that polynomial at which its truncation error is rounding


def unknowns_of(model: Model, block: Block, state: State, at: Index) -> Real:
    """A block's positions (n, unknowns) at the frames ``at``: unwrapped angles [rad], then slides [m]."""
    rotations = np.array([group_rotation(model, state, g, at) for g in block.angles])
    angles = np.arctan2(rotations.imag, rotations.real)
    turns = np.rint((angles[..., 1:] - angles[..., :-1]) * (1.0 / TURN))
    if turns.any():  # like `np.unwrap`, which takes four times as long for few angles
        angles[:, 1:] -= TURN * np.cumsum(turns, axis=1)
    return np.array([*angles, *(np.asarray(state.slide[j])[at] for j in block.slides)]).T if block.slides else angles.T


class SmoothedSamples(NamedTuple):
    """A block's positions at samples too near some instants, by interpolation from samples on both sides of each.

    ``samples`` (m,); ``positions`` (m, unknowns): rotations of its groups, then slides over the mechanism's size, as complex
    numbers. ``tail``: size of the polynomials' last coefficients, infinite where samples are NaN.
    """

    tail: float
    samples: Index
    positions: Complex

    def into(self, model: Model, block: Block, state: State) -> None:
        """Replace the positions in ``state``, whose arrays are changed in place."""
        samples, unknowns = self.samples, self.positions.T
        rotations = unknowns[: len(block.angles)]
        for g, rotation in zip(block.angles, rotations / np.abs(rotations), strict=True):
            for rotation_class in model.angles.classes_of[g]:
                delta = state.delta[rotation_class]
                state.rot[rotation_class][samples] = rotation * (delta[samples] if isinstance(delta, np.ndarray) else delta)
        for j, slide in zip(block.slides, unknowns[len(block.angles) :], strict=True):
            np.asarray(state.slide[j])[samples] = slide.real * model.length_scale


def smoothed(
    model: Model, block: Block, state: State, time: Real, instants: Sequence[float], step: float
) -> SmoothedSamples | None:
    """A block's positions next to instants, by polynomials through its equidistant samples on both sides of each, at ``time``.

    None if these extend far enough at none of the instants.
    """
    first, apart = float(time[0]), float(time[1] - time[0])
    width = round(step / apart)
    fit, near = _samples(width)
    places = [(instant - first) / apart for instant in instants]
    places = [place for place in places if width * FAR_STEPS <= round(place) < len(time) - width * FAR_STEPS]
    if not places:
        return None
    nearest = [round(place) for place in places]
    middles = np.array(nearest)[:, None]
    at = middles + fit
    values = np.empty((*at.shape, len(block.angles) + len(block.slides)), complex)
    for k, g in enumerate(block.angles):
        values[..., k] = group_rotation(model, state, g, at)
    for k, j in enumerate(block.slides, len(block.angles)):
        values[..., k] = np.asarray(state.slide[j])[at] / model.length_scale
    matrices = [_fit_at(round((place - middle) * FRACTIONS), width) for place, middle in zip(places, nearest, strict=True)]
    rows = np.array([matrix @ value for matrix, value in zip(matrices, values.view(float), strict=True)])
    tail = float(np.maximum.reduce(np.abs(rows[:, :2]), axis=None))
    return SmoothedSamples(
        tail if tail < np.inf else np.inf, (middles + near).ravel(), rows[:, 2:].view(complex).reshape(-1, values.shape[-1])
    )


@lru_cache(16)
def _samples(width: int) -> tuple[Index, Index]:
    """The samples of the fit next to an instant, and those too near it, counted from the nearest one; ``width``: samples per
    step."""
    samples = np.arange(-width * FAR_STEPS, width * FAR_STEPS + 1)
    away = np.abs(samples)
    return samples[away >= 8 * width], samples[away <= NEAR_STEPS * width]


@lru_cache(64)
def _fit_at(fraction: int, width: int) -> Real:
    """The matrix (2 + m, n) from values at the samples of the fit (n,) to the polynomial's last two coefficients and its values at
    the samples too near the instant (m,).

    ``fraction``: distance of the instant from the nearest sample, in units of 1 / ``FRACTIONS``; ``width``: samples per step.
    """
    fit, near = ((samples - fraction / FRACTIONS) / (width * FAR_STEPS) for samples in _samples(width))
    inverse = np.linalg.pinv(chebyshev.chebvander(fit, FIT_DEGREE))
    return np.concatenate([inverse[-2:], chebyshev.chebvander(near, FIT_DEGREE) @ inverse])


def tail_of(values: Real) -> float:
    """Size of the last coefficients of the polynomials fitted to values (nodes, unknowns)."""
    with np.errstate(**QUIET):
        return float(np.abs((FIT @ values)[-2:]).max(initial=0.0))


@dataclass
class _SingularFit:
    """The fit at a singular point ``change``, by numbers of nodes: ``own`` are its nodes, ``near`` those of other points at which
    its group is ill conditioned."""

    change: SingularPoint
    own: Index
    near: Index
    away: Real  # of the near ones, distance from the singular point in units of the half window
    curves: list[Real] = field(default_factory=list)  # coefficients of positions, first and second rates (terms, unknowns)

    def fit(self, values: Real) -> Real:
        """Fit a curve to values (nodes, unknowns); returns it at the near nodes."""
        self.curves.append(FIT @ values)
        return chebyshev.chebvander(self.away, FIT_DEGREE) @ self.curves[-1]

    def into(self, rates: list[Any], derivative: int) -> None:
        """Fit the solved rates of a block, and replace them where they are ill conditioned."""
        width = max((np.size(r) for r in rates), default=1)
        for u, r in enumerate(rates):
            rates[u] = np.array(np.broadcast_to(r, width))
        given = self.fit(np.array([r[self.own] for r in rates]).T)
        for u, r in enumerate(rates):
            r[self.near] = given[:, u]


def make_interpolants(
    model: Model,
    singular_points: SingularPoints,
    modes: Sequence[float],
    time: Real,
    scale: Sequence[Values],
    constants: Sequence[float] = (),
    starts: Callable[[Real], Mapping[str, Real]] | None = None,
) -> dict[int, list[Interpolant]]:
    """Interpolants for the frames next to singular points, by block.

    ``time``: law time of the frames. ``scale``: its first and second derivative by real time (1, 0 where frames follow the law).
    ``starts``: law times -> Newton starts.
    """
    asked = [c for c in singular_points.points if _frames_near(singular_points, c, time).any()]
    if not asked:
        return {}
    nodes, needed = _nodes_of(singular_points, asked)
    values = [law(nodes) for law in singular_points.laws]
    near = starts(nodes) if starts is not None else {}
    state = initial_state(model, [v[0] for v in values], constants, near)
    throughs: dict[int, list[_SingularFit]] = {}
    for c in needed:
        beside = np.flatnonzero(_distance(singular_points, c, nodes) < NEAR_STEPS * c.step)
        away = _signed(singular_points, c, nodes[beside]) / (c.step * FAR_STEPS)
        own = np.searchsorted(nodes, _nodes(c))
        throughs.setdefault(c.block, []).append(_SingularFit(c, own, beside, away))
    with np.errstate(**QUIET):
        for i, (block, mode) in enumerate(zip(model.blocks, modes, strict=True)):
            place_block(model, block, state, mode * singular_points.signs(i, nodes), near.get(block.name))
            for through in throughs.get(i, ()):
                given = through.fit(unknowns_of(model, block, state, through.own))
                apply(model, block, state, Interpolant(through.near, given, given, given))
        vectors = all_vectors(model, state)
        cols = all_columns(model, vectors)
        speeds = velocities(model, vectors, cols, [v[1] for v in values], throughs, state.curve_values)
        accelerations(model, vectors, cols, speeds, [v[2] for v in values], throughs)
    interpolants: dict[int, list[Interpolant]] = {}
    for c in asked:
        (through,) = (x for x in throughs[c.block] if x.change is c)
        frames = np.flatnonzero(_frames_near(singular_points, c, time))
        basis = chebyshev.chebvander(_signed(singular_points, c, time[frames]) / (c.step * FAR_STEPS), FIT_DEGREE)
        s1, s2 = (np.broadcast_to(s, time.shape)[frames, None] for s in scale)
        with np.errstate(**QUIET):
            value, rate, second = (basis @ curve for curve in through.curves)
            interpolants.setdefault(c.block, []).append(Interpolant(frames, value, rate * s1, second * s1**2 + rate * s2))
    return interpolants


def _nodes(c: SingularPoint) -> Real:
    return c.time + c.step * FAR_STEPS * FIT_NODES


def _nodes_of(singular_points: SingularPoints, asked: Sequence[SingularPoint]) -> tuple[Real, list[SingularPoint]]:
    """Nodes of the singular points ``asked``, of those near which such nodes lie, and so on; and all these points."""
    needed = list(asked)
    fresh, nodes = needed, np.zeros(0)
    while fresh:
        nodes = np.unique(np.concatenate([nodes, *(_nodes(c) for c in fresh)]))
        have = {id(c) for c in needed}
        fresh = [
            c
            for c in singular_points.points
            if id(c) not in have and (_distance(singular_points, c, nodes) < NEAR_STEPS * c.step).any()
        ]
        needed = needed + fresh
    return nodes, needed


def _signed(singular_points: SingularPoints, c: SingularPoint, time: Real) -> Real:
    away = time - c.time
    return away - singular_points.period * np.round(away / singular_points.period)


def _distance(singular_points: SingularPoints, c: SingularPoint, time: Real) -> Real:
    return np.abs(_signed(singular_points, c, time))


def _frames_near(singular_points: SingularPoints, c: SingularPoint, time: Real) -> Flags:
    return _distance(singular_points, c, time) < NEAR_STEPS * c.step
