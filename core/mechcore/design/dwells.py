"""Dwell linkages: six-bars whose output dwells over a range of the crank, by a coupler curve that is nearly a circle there.

A four-bar draws the curve of E. Over the range E is nearly on a circle about M: with a link of the circle's radius from E to F, F
rests at M meanwhile, and so does the output lever F-G. Random four-bars are screened by circles fitted to all windows of their
curves, and the best are varied with a decreasing spread. For each of the results the lever is placed for the required swing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from mechcore.arrays import Complex, Index, Real
from mechcore.design.four_bars import TURN, FourBar, acute
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass

SAMPLES_A_TURN = 120  # crank angles of a turn
SCREENED_DESIGNS = 4000
KEPT_DESIGNS = 40  # designs that are varied in each round
VARIATION_ROUNDS = 7  # rounds of variation; the spread halves from one to the next
VARIATIONS_A_DESIGN = 24  # variations of a design in a round
RADIUS_RANGE = (0.4, 2.5)  # least and greatest radius of the circle over the size of the curve
COARSE_STEP = 6  # step between the samples by which the range of E's distance from the circle is measured
# Least distance of M from the pivots, over the frame: the coupler's own pins run on circles about these
PIVOT_DISTANCE = 0.5
PLACED_DESIGNS = 15  # designs for which a lever is searched
LEVER_DIRECTIONS = 48  # trial directions of the lever
EXACT_SAMPLES = 1440
TRANSMISSION = np.radians(30.0)  # least angle between link and lever, and of the four-bar


@dataclass(frozen=True)
class DwellLinkage:
    """A four-bar with crank O2, the link from its coupler point E to F, and the lever from F to the frame at G [m].

    ``side``: +1 where F lies left of E -> G. ``start`` [rad]: crank angle at which the dwell begins. ``swing``, ``drift`` [rad]: of
    the lever over a turn, and within the dwell.
    """

    four_bar: FourBar
    link: float
    lever: float
    pivot: complex
    side: int
    start: float
    swing: float
    drift: float

    def lever_angles(self, theta: Real) -> Real:
        """Angles of the lever G-F (K,) [rad], without jumps, at crank angles (K,) [rad]; NaN where it cannot be assembled."""
        return np.unwrap(
            np.angle(_pins(self.four_bar.positions(theta)[2], self.pivot, self.link, self.lever, self.side) - self.pivot)
        )


def dwell_linkages(
    dwell: float, swing: float, seed: int = 0, most: int = 5, screened: int = SCREENED_DESIGNS
) -> list[DwellLinkage]:
    """Six-bars of crank one whose lever has a swing [rad] and rests over a crank range ``dwell`` [rad], those of least drift first.

    At most ``most``, found from ``screened`` random four-bars; the same seed gives the same ones. Raises MechanismError if none is
    found.
    """
    if not 0.0 < dwell < 0.75 * TURN:
        raise MechanismError(
            Fault("dwell", f"a dwell of {np.degrees(dwell):g} deg.", "Give more than 0 and less than 270 degrees.")
        )
    if not 0.0 < swing < 0.5 * np.pi:
        raise MechanismError(Fault("swing", f"a swing of {np.degrees(swing):g} deg.", "Give more than 0 and less than 90 degrees."))
    rng = np.random.default_rng(seed)
    window = max(round(dwell / TURN * SAMPLES_A_TURN), 4) + 1
    designs = _random(rng, screened)
    misfit = _fits(designs, window)[0]
    width = 0.3
    for _ in range(VARIATION_ROUNDS):
        best = np.argsort(misfit, kind="stable")[:KEPT_DESIGNS]
        designs, misfit = designs[best], misfit[best]
        children = np.repeat(designs, VARIATIONS_A_DESIGN, axis=0)
        children[:, :3] *= np.exp(width * rng.normal(size=(len(children), 3)))
        children[:, 3:] += width * rng.normal(size=(len(children), 2)) * children[:, 1:2]
        designs = np.concatenate([designs, children])
        misfit = np.concatenate([misfit, _fits(children, window)[0]])
        width *= 0.5
    best = np.argsort(misfit, kind="stable")[:PLACED_DESIGNS]
    _, start, centre, radius = _fits(designs[best], window)
    linkages: list[DwellLinkage] = []
    for k, design in enumerate(designs[best]):
        if np.isfinite(misfit[best[k]]):
            linkages += _with_lever(_four_bar(design), start[k], centre[k], radius[k], dwell, swing)
    kept: list[DwellLinkage] = []
    for one in sorted(linkages, key=lambda one: one.drift):
        shape = _shape(one)
        if len(kept) < most and all(np.abs(shape / _shape(other) - 1.0).max() > 0.05 for other in kept):
            kept.append(one)
    if not kept:
        raise MechanismError(Fault("dwell", "no linkage was found.", "Ask for a shorter dwell, a smaller swing, or another seed."))
    return kept


def _shape(one: DwellLinkage) -> Real:
    return np.array([one.four_bar.frame, one.four_bar.coupler, one.four_bar.rocker, abs(one.four_bar.tracer), one.lever])


def _random(rng: np.random.Generator, count: int) -> Real:
    """Frame, coupler, rocker and coupler point (D, 5) of four-bars of crank one."""
    lengths = np.exp(rng.uniform(np.log(1.5), np.log(6.0), (count, 3)))
    return np.concatenate([lengths, rng.uniform(-1.8, 1.8, (count, 2)) * lengths[:, 1:2]], axis=1)


def _four_bar(design: Real) -> FourBar:
    frame, coupler, rocker, u, v = (float(x) for x in design)
    return FourBar(0j, complex(frame), 1.0, coupler, rocker, 1, complex(u, v))


def _fits(designs: Real, window: int) -> tuple[Real, Real, Complex, Real]:
    """The best window of each curve (D,): misfit of its circle over the range of E's distance from it, infinite where unusable; the
    crank angle at which it begins; the circle's centre and radius."""
    theta = np.arange(SAMPLES_A_TURN) * TURN / SAMPLES_A_TURN
    frame, coupler, rocker = (designs[:, k, None] for k in range(3))
    a = np.exp(1j * theta)
    h = frame - a
    square = np.abs(h) ** 2
    along = (square + coupler**2 - rocker**2) / (2.0 * square)
    height = coupler**2 / square - along**2
    usable = (height > 0.0).all(1)
    b = a + h * (along + 1j * np.sqrt(np.maximum(height, 0.0)))
    e = a + (designs[:, 3, None] + 1j * designs[:, 4, None]) * (b - a) / coupler
    usable &= acute(a - b, frame - b).min(1) > 0.6 * TRANSMISSION
    middle = e.mean(1, keepdims=True)
    size = np.abs(e - middle).max(1, keepdims=True)
    z = (e - middle) / size

    def summed(values: Real) -> Real:
        total = np.cumsum(np.concatenate([np.zeros((len(values), 1)), values, values[:, : window - 1]], axis=1), axis=1)
        return np.asarray(total[:, window:] - total[:, :-window])

    x, y, r = z.real, z.imag, np.abs(z) ** 2
    sx, sy, sr, sxx, syy, sxy = (summed(v) / window for v in (x, y, r, x * x, y * y, x * y))
    sxr, syr, srr = (summed(v) / window for v in (x * r, y * r, r * r))
    vxx, vyy, vxy, vxr, vyr, vrr = sxx - sx * sx, syy - sy * sy, sxy - sx * sy, sxr - sx * sr, syr - sy * sr, srr - sr * sr
    det = vxx * vyy - vxy * vxy
    with np.errstate(all="ignore"):
        cx, cy = 0.5 * (vxr * vyy - vyr * vxy) / det, 0.5 * (vyr * vxx - vxr * vxy) / det
        radius = np.sqrt(sr - 2.0 * (cx * sx + cy * sy) + cx * cx + cy * cy)
        misfit = np.sqrt(np.maximum(vrr - 2.0 * (cx * vxr + cy * vyr), 0.0)) / (2.0 * radius)
        away = np.abs(z[:, None, ::COARSE_STEP] - (cx + 1j * cy)[:, :, None]) - radius[:, :, None]
        misfit /= away.max(2) - away.min(2)  # travel of F in the dwell over its travel in a turn
    centre = middle + size * (cx + 1j * cy)
    bad = ~(np.isfinite(misfit) & (radius > RADIUS_RANGE[0]) & (radius < RADIUS_RANGE[1])) | ~usable[:, None]
    bad |= (np.abs(centre) < PIVOT_DISTANCE * frame) | (np.abs(centre - frame) < PIVOT_DISTANCE * frame)
    bad |= np.sqrt(np.maximum(vxx + vyy, 0.0)) < 0.15  # the point barely moves in the window
    misfit = np.where(bad, np.inf, misfit)
    rows: Index = np.arange(len(designs))
    k = misfit.argmin(1)
    return misfit[rows, k], theta[k], centre[rows, k], (radius * size)[rows, k]


def _with_lever(bar: FourBar, start: float, centre: complex, radius: float, dwell: float, swing: float) -> list[DwellLinkage]:
    """The linkage with the lever of least drift for a swing, of several directions from M, with sufficient transmission angles; an
    empty list where there is none."""
    theta = start + np.arange(SAMPLES_A_TURN) * TURN / SAMPLES_A_TURN
    e = bar.positions(theta)[2]
    away = np.abs(e - centre).max() + np.abs(e - centre).min()
    directions = np.exp(1j * np.arange(LEVER_DIRECTIONS) * TURN / LEVER_DIRECTIONS)[:, None]
    lengths = away * np.geomspace(0.15, 6.0, 12)

    def swings(length: Real | float, direction: Complex | complex, side: int) -> Real:
        """Swing of the lever; NaN where it cannot be assembled, or where F rests on the wrong side."""
        pivot = centre + np.asarray(length * direction)[..., None]
        f = _pins(e, pivot, radius, np.asarray(length)[..., None], side)
        right = np.abs(f[..., 0] - centre) < 0.2 * radius
        return np.where(right, np.ptp(np.unwrap(np.angle(f - pivot), axis=-1), axis=-1), np.nan)

    best: DwellLinkage | None = None
    for side in (1, -1):
        excess = swings(lengths, directions, side) - swing
        for row, k in zip(*np.nonzero(excess[:, :-1] * excess[:, 1:] < 0.0), strict=True):
            direction = complex(directions[row, 0])
            try:
                length = float(
                    brentq(lambda x, d=direction, s=side: float(swings(x, d, s)) - swing, lengths[k], lengths[k + 1], rtol=1e-9)
                )
            except ValueError:  # between the two it cannot be assembled
                continue
            pivot = complex(centre + length * direction)
            f = _pins(e, pivot, radius, length, side)
            if np.isnan(f).any() or acute(e - f, pivot - f).min() < TRANSMISSION:
                continue
            made = DwellLinkage(bar, float(radius), length, pivot, side, float(start), swing, 0.0)
            drift = float(np.ptp(made.lever_angles(start + np.linspace(0.0, dwell, 91))))
            if best is None or drift < best.drift:
                best = replace(made, drift=drift)
    if best is None:
        return []
    whole = best.lever_angles(np.linspace(0.0, TURN, EXACT_SAMPLES))
    return [replace(best, swing=float(np.ptp(whole)))]


def _pins(e: Complex, pivot: Complex | complex, link: float, lever: Real | float, side: int) -> Complex:
    """The pin F (K,) of link and lever, from E (K,) and the pivot; NaN where it cannot be assembled."""
    h = pivot - e
    square = np.abs(h) ** 2
    along = (square + link**2 - lever**2) / (2.0 * square)
    height = link**2 / square - along**2
    return np.asarray(e + h * (along + 1j * side * np.sqrt(np.where(height > 0.0, height, np.nan))))
