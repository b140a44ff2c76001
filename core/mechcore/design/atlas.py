"""An atlas of coupler curves: which four-bars draw a curve similar to a given one, in any place, size, direction and timing.

Closed curves are stored as Fourier descriptors over the arc length, arcs as points at equal distances. Both are centred and of unit
size, so that a complex product gives the best similarity transformation between two of them (Procrustes), for closed curves with
all start points at once. One side and one sense of the crank are stored: the others give the mirrored or the reversed curve. The
atlas is made once, from a fixed seed, and kept in the user's cache.
"""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mechcore.arrays import Complex, Index, Real
from mechcore.cache import cached_file, digest
from mechcore.design.four_bars import TURN, coupler_direction, grashof_cranks
from mechcore.records import dataclass

CURVE_COUNT, ARC_COUNT = 12_000, 30_000
LARGEST_RATIO = 8.0  # largest ratio of a link to the crank
FARTHEST_POINT = 1.5  # largest distance of a traced point from the middle of the coupler, over the coupler's length
NARROWEST_ARC, WIDEST_ARC = 0.3, 5.5  # crank ranges of arcs [rad]
HARMONICS, SHIFTS = 12, 96  # harmonics of either sign in the descriptors; trial start points along a curve
ARC_PLACES = 20  # points of an arc
FINE_ANGLES = 128  # intervals of crank angles by which arc lengths are measured
CURVES_AT_ONCE = 4_000  # curves that are made in one array call
EDITION = 1  # version of the stored format: an atlas of another version is made again


@dataclass(frozen=True, eq=False)
class Atlas:
    """Curves (C, 5) and arcs (A, 7): the ratios of frame, coupler and rocker to the crank, the traced point over the coupler (real,
    imaginary), of arcs also the first crank angle and the range [rad]; their ``descriptors`` (C, 2 H) and ``places`` (A, P)."""

    curves: Real
    descriptors: Complex
    arcs: Real
    places: Complex


class FourBarCandidates(NamedTuple):
    """Four-bars that draw a curve: ratios (D, 3), crank angles from the frame line at the first point (D,), and the angles that the
    crank has turned since then (D, K), positive [rad]."""

    ratios: Real
    start: Real
    steps: Real


def nearest_linkages(
    points: Complex, closed: bool, side: int, sense: int, count: int, atlas: Atlas | None = None
) -> FourBarCandidates:
    """The ``count`` four-bars of a side and a sense of rotation whose curves are most similar to points (K,) in order: closed
    curves where ``closed``, else arcs. By default from the user's atlas."""
    atlas = stored_atlas() if atlas is None else atlas
    forwards = side * sense > 0
    wanted = points if side > 0 else np.conj(points)
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(wanted)))])
    along /= along[-1]
    part = along if forwards else 1.0 - along
    if closed:
        nearest, shift = _curves_like(atlas, wanted, part, count)
        designs = atlas.curves[nearest].astype(float)
        first, span = np.zeros(len(nearest)), np.full(len(nearest), TURN)
    else:
        nearest = _arcs_like(atlas, wanted, part, count)
        designs, shift = atlas.arcs[nearest].astype(float), np.zeros(len(nearest))
        first, span = designs[:, 5], designs[:, 6]
    theta, _, length = _measured(designs, first, span)
    angles = np.empty((len(nearest), len(points)))
    for k, own in enumerate(shift):
        turns = np.floor(part + own) if closed else 0.0
        angles[k] = np.interp(part + own - turns, length[k], theta[k]) + TURN * turns
    angles *= side
    return FourBarCandidates(designs[:, :3], angles[:, 0], sense * (angles - angles[:, :1]))


def _curves_like(atlas: Atlas, points: Complex, part: Real, count: int) -> tuple[Index, Real]:
    """Indices (D,) of the curves most similar to points (K,) at parts of the arc length, and the part of the arc length (D,) of
    each curve at which the points begin."""
    own = _descriptors(_evenly(points, part, np.arange(4 * HARMONICS) / (4 * HARMONICS)))[0]
    shifts = np.arange(SHIFTS) / SHIFTS
    turned = (own[:, None] * np.exp(-1j * TURN * _orders()[:, None] * shifts)).astype(np.complex64)
    likeness = np.abs(np.conj(atlas.descriptors) @ turned)
    nearest = np.argsort(-likeness.max(axis=1), kind="stable")[:count]
    return nearest, shifts[likeness[nearest].argmax(axis=1)]


def _arcs_like(atlas: Atlas, points: Complex, part: Real, count: int) -> Index:
    """Indices (D,) of the arcs most similar to points (K,) at parts of the arc length."""
    own = _unit(_evenly(points, part, np.linspace(0.0, 1.0, ARC_PLACES)))[0]
    likeness = np.abs(np.conj(atlas.places) @ own.astype(np.complex64))
    return np.asarray(np.argsort(-likeness, kind="stable")[:count])


def _evenly(points: Complex, part: Real, even: Real) -> Complex:
    """Points (1, P) at parts (P,) of the length, by linear interpolation between points (K,) at increasing or decreasing parts."""
    order = slice(None) if part[-1] > part[0] else slice(None, None, -1)
    x, z = part[order], points[order]
    return np.asarray((np.interp(even, x, z.real) + 1j * np.interp(even, x, z.imag))[None])


# -- making -----------------------------------------------------------------------------------------------------------
@lru_cache(1)
def stored_atlas() -> Atlas:
    """The atlas from the user's cache, in which it is made if there is none."""
    recipe = (
        EDITION,
        CURVE_COUNT,
        ARC_COUNT,
        LARGEST_RATIO,
        FARTHEST_POINT,
        NARROWEST_ARC,
        WIDEST_ARC,
        HARMONICS,
        ARC_PLACES,
        FINE_ANGLES,
        np.__version__,
    )
    names = [f.name for f in fields(Atlas)]

    def make(path: Path) -> None:
        made = make_atlas()
        with path.open("wb") as file:
            np.savez(file, **{name: getattr(made, name) for name in names})

    try:
        with cached_file(f"atlas-{digest(repr(recipe).encode())}", ".npz", make) as path, np.load(path) as stored:
            return Atlas(*(stored[name] for name in names))
    except (OSError, ValueError, KeyError):  # a full disk: it is made again next time
        return make_atlas()


def make_atlas(seed: int = 0, curves: int = CURVE_COUNT, arcs: int = ARC_COUNT) -> Atlas:
    """An atlas of random four-bars whose crank turns fully; the same seed gives the same atlas."""
    rng = np.random.default_rng(seed)
    whole, of_curves, parts, of_arcs = [], [], [], []
    for first in range(0, curves, CURVES_AT_ONCE):
        designs = _designs(rng, min(CURVES_AT_ONCE, curves - first))
        _, points, length = _measured(designs, np.zeros(len(designs)), np.full(len(designs), TURN))
        even = _at_lengths(points, length, np.arange(4 * HARMONICS) / (4 * HARMONICS))
        whole.append(designs)
        of_curves.append(_descriptors(even))
    for first in range(0, arcs, CURVES_AT_ONCE):
        designs = _designs(rng, min(CURVES_AT_ONCE, arcs - first))
        size = len(designs)
        start, span = rng.uniform(0.0, TURN, size), rng.uniform(NARROWEST_ARC, WIDEST_ARC, size)
        _, points, length = _measured(designs, start, span)
        parts.append(np.column_stack([designs, start, span]))
        of_arcs.append(_unit(_at_lengths(points, length, np.linspace(0.0, 1.0, ARC_PLACES))))
    return Atlas(
        np.concatenate(whole).astype(np.float32),
        np.concatenate(of_curves).astype(np.complex64),
        np.concatenate(parts).astype(np.float32),
        np.concatenate(of_arcs).astype(np.complex64),
    )


def _designs(rng: np.random.Generator, count: int) -> Real:
    """Random ratios and traced points (D, 5)."""
    radius, angle = FARTHEST_POINT * np.sqrt(rng.random(count)), rng.uniform(0.0, TURN, count)
    return np.column_stack([grashof_cranks(rng, count, LARGEST_RATIO), 0.5 + radius * np.cos(angle), radius * np.sin(angle)])


def _measured(designs: Real, first: Real, span: Real) -> tuple[Real, Complex, Real]:
    """Crank angles (D, F), the points traced there (D, F) over the crank's length, and the part of the arc length up to each of
    them (D, F)."""
    theta = first[:, None] + span[:, None] * np.linspace(0.0, 1.0, FINE_ANGLES + 1)
    crank = np.exp(1j * theta)
    frame, coupler, rocker = (designs[:, k, None] for k in range(3))
    direction, _ = coupler_direction(frame, 1.0, coupler, rocker, crank, 1)
    points = crank + (designs[:, 3] + 1j * designs[:, 4])[:, None] * coupler * direction
    length = np.concatenate([np.zeros((len(designs), 1)), np.cumsum(np.abs(np.diff(points)), axis=1)], axis=1)
    return theta, points, length / length[:, -1:]


def _at_lengths(points: Complex, length: Real, parts: Real) -> Complex:
    """Points (D, P) at parts (P,) of the arc lengths (D, F)."""
    rows = np.arange(len(points))[:, None]
    k = np.clip((length[:, None, :] <= parts[:, None]).sum(axis=2) - 1, 0, length.shape[1] - 2)
    low, high = length[rows, k], length[rows, k + 1]
    share = (parts - low) / np.maximum(high - low, 1e-300)
    resampled: Complex = points[rows, k] + share * (points[rows, k + 1] - points[rows, k])
    return resampled


def _orders() -> Index:
    return np.concatenate([np.arange(1, HARMONICS + 1), np.arange(-HARMONICS, 0)])


def _descriptors(points: Complex) -> Complex:
    """Fourier coefficients (D, 2 H) of closed curves through points (D, P), of unit size without the mean."""
    return _unit(np.fft.fft(points, axis=1)[:, _orders()], centred=False)


def _unit(rows: Complex, *, centred: bool = True) -> Complex:
    """Rows divided by their norms, by default about their means."""
    own = rows - rows.mean(axis=1, keepdims=True) if centred else rows
    return np.asarray(own / np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-300))
