"""Four-bars whose coupler point runs nearly straight: how straight, over which travel; Hoecken's best proportions."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from mechcore.arrays import Real
from mechcore.design.four_bars import FourBar
from mechcore.records import dataclass

SAMPLES = 721
COARSE = 4001  # points of the range over which Hoecken's proportions are chosen


@dataclass(frozen=True)
class StraightLine:
    """A four-bar, the range of its crank [rad] in which the point runs straight, and the line's direction (unit)."""

    four_bar: FourBar
    start: float
    end: float
    direction: complex
    about: str = ""


@dataclass(frozen=True)
class Straightness:
    """Over a range: how far a point moves along a line [m], and the least and greatest distance to its left [m]."""

    travel: float
    least: float
    greatest: float

    @property
    def ratio(self) -> float:
        """Width of the path over its travel."""
        return (self.greatest - self.least) / self.travel


_ROBERTS = FourBar(0j, 2.0 + 0j, 1.2, 1.0, 1.2, 1, complex(0.5, -np.sqrt(1.19)))
_ROBERTS_ENDS = float(np.arccos(1.0 / 1.2)), 1.4452364060662064  # the tip in the two frame pivots
_SWING = float(np.radians(25.0))
STRAIGHT_LINES = {
    "watt": StraightLine(
        FourBar(0j, 4.0 - 1.0j, 2.0, 1.0, 2.0, -1, 0.5 + 0j), -_SWING, _SWING, 1j, "two equal cranks, the middle of a short coupler"
    ),
    "chebyshev": StraightLine(
        FourBar(0j, 4.0 + 0j, 5.0, 2.0, 5.0, -1, 1.0 + 0j), float(np.arctan2(3.0, 4.0)), np.pi / 2.0, 1.0 + 0j,
        "two equal crossed cranks, the middle of the coupler",
    ),
    "roberts": StraightLine(_ROBERTS, *_ROBERTS_ENDS, 1.0 + 0j, "a triangle hung between two equal cranks, its tip"),
    "hoecken": StraightLine(
        FourBar(0j, 2.0 + 0j, 1.0, 2.5, 2.5, 1, 5.0 + 0j), np.pi / 2.0, 3.0 * np.pi / 2.0, 1.0 + 0j,
        "a crank that turns fully, a point at twice the coupler's length",
    ),
    "evans": StraightLine(
        FourBar(0j, 1.9 - 4.0j, 1.0, 1.0, 4.0, 1, -1.0 + 0j), -_SWING, _SWING, 1j,
        "the grasshopper: a long rocker, a point behind the crank",
    ),
}  # fmt: skip
"""Well-known straight-line linkages with the proportions of the textbooks."""


def straightness(line: StraightLine) -> Straightness:
    """How straight the coupler point of a linkage runs over its range, extremes to rounding."""
    theta = np.linspace(line.start, line.end, SAMPLES)

    def at(angle: Real) -> tuple[Real, Real]:
        turned = line.four_bar.positions(angle)[2] * np.conj(line.direction)
        return turned.real, turned.imag

    along, across = at(theta)

    def extreme(values: Real, part: int, sign: float) -> float:
        k = int((sign * values).argmax())
        ends = theta[max(k - 1, 0)], theta[min(k + 1, SAMPLES - 1)]
        optimum = minimize_scalar(
            lambda x: -sign * at(np.array([x]))[part][0], bounds=ends, method="bounded", options={"xatol": 1e-10}
        )
        return sign * max(sign * float(values[k]), -float(optimum.fun))

    travel = extreme(along, 0, 1.0) - extreme(along, 0, -1.0)
    return Straightness(travel, extreme(across, 1, -1.0), extreme(across, 1, 1.0))


def hoecken(straight: float) -> StraightLine:
    """Hoecken's linkage of crank one that is straightest over a crank range [rad] about the crank pointing away from the frame.

    Frame and coupler (= rocker) are chosen by a simplex search for the least width over travel.
    """
    theta = np.pi + np.linspace(-0.5, 0.5, COARSE) * straight

    def cost(lengths: Real) -> float:
        _, _, p = FourBar(0j, complex(lengths[0]), 1.0, lengths[1], lengths[1], 1, 2.0 * complex(lengths[1])).positions(theta)
        return float(np.ptp(p.imag) / np.ptp(p.real)) if np.isfinite(p).all() else 1.0

    optimum = minimize(cost, (2.6, 3.4), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-15, "maxiter": 2000}).x
    four_bar = FourBar(0j, complex(optimum[0]), 1.0, float(optimum[1]), float(optimum[1]), 1, 2.0 * complex(optimum[1]))
    return StraightLine(four_bar, float(theta[0]), float(theta[-1]), 1.0 + 0j, STRAIGHT_LINES["hoecken"].about)
