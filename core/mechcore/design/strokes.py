"""Crank mechanisms for a given stroke or swing and a given time ratio (slider-cranks, crank-rockers, slotted levers); straight-line
four-bars, their straightness and travel, and Hoecken's best proportions.

The time ratio Q >= 1 of a crank at constant speed is ``(pi + alpha)/(pi - alpha)``, with alpha between the lines of the crank at
its dead centres.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from mechcore.arrays import Real
from mechcore.design.four_bars import FourBar, Grashof
from mechcore.errors import Fault, MechanismError
from mechcore.kinematics.dyads import cross
from mechcore.numerics.frames import QUIET
from mechcore.records import dataclass

PIVOT_PLACES = 1440  # trial places of the crank's pivot on a circle; the best one is refined


@dataclass(frozen=True)
class SliderCrank:
    """Crank, rod and offset [m] of the slide's line y = offset; ``alpha`` [rad]: between the crank's lines at its dead centres."""

    crank: float
    rod: float
    offset: float
    alpha: float

    @property
    def turns(self) -> bool:
        """Whether the crank turns fully."""
        return self.rod >= self.crank + self.offset

    @property
    def pressure_angle(self) -> float:
        """Largest angle between the rod and the slide's line [rad]; pi/2 where the crank does not turn fully."""
        return float(np.arcsin(min((self.crank + self.offset) / self.rod, 1.0)))


def alpha_of(ratio: float) -> float:
    """The angle between the crank's lines at its dead centres [rad] for a time ratio. Raises MechanismError below one."""
    if not 1.0 <= ratio < np.inf:
        raise MechanismError(Fault("ratio", f"a time ratio of {ratio:g}.", "Give slow over fast: one or more."))
    return float(np.pi * (ratio - 1.0) / (ratio + 1.0))


def slider_crank(stroke: float, ratio: float, offset: float) -> SliderCrank:
    """The offset slider-crank of a stroke [m], a time ratio and an offset [m], by the triangle of the two dead centres."""
    alpha = alpha_of(ratio)
    most = largest_offset(stroke, ratio)
    if not 0.0 < offset < most:
        raise MechanismError(
            Fault("offset", f"{offset:g} m does not give a time ratio of {ratio:g} with a stroke of {stroke:g} m.",
                  f"Give one between 0 and {most:g} m." if ratio > 1.0 else "Without an offset the crank is half the stroke.")
        )  # fmt: skip
    crank = 0.5 * np.sqrt(stroke**2 - 2.0 * stroke * offset * np.tan(alpha / 2.0))
    return SliderCrank(float(crank), float(np.sqrt(crank**2 + stroke * offset / np.sin(alpha))), offset, alpha)


def largest_offset(stroke: float, ratio: float) -> float:
    """The largest offset [m] with which the crank of a stroke and time ratio turns fully; there the inner dead centre lies below
    the crank's pivot. Zero for a ratio of one. Raises MechanismError from a ratio of three on, for which there is none."""
    alpha = alpha_of(ratio)
    if alpha >= 0.5 * np.pi * (1.0 - 1e-12):
        why = f"a slider-crank whose crank turns fully has a time ratio below 3, not {ratio:g}."
        raise MechanismError(Fault("ratio", why, "Ask for less, or take a Whitworth mechanism or a slotted lever."))
    return 0.0 if alpha == 0.0 else float(stroke / np.tan(alpha))


def best_slider_crank(stroke: float, ratio: float) -> SliderCrank:
    """The slider-crank of a stroke and time ratio whose largest pressure angle is least, with a crank that turns fully."""
    most = largest_offset(stroke, ratio)
    if most == 0.0:
        raise MechanismError(Fault("ratio", "a time ratio of one leaves the rod free.", "Take crank = stroke/2 without an offset."))

    def cost(part: float) -> float:
        made = slider_crank(stroke, ratio, part * most)
        return (made.crank + made.offset) / made.rod

    optimum = minimize_scalar(cost, bounds=(1e-9, 1.0 - 1e-9), method="bounded", options={"xatol": 1e-12})
    return slider_crank(stroke, ratio, float(optimum.x) * most)


# -- crank-rockers ----------------------------------------------------------------------------------------------------
def best_crank_rocker(swing: float, ratio: float, rocker: float = 1.0) -> FourBar:
    """The crank-rocker with the greatest least transmission angle for a rocker's swing [rad], a time ratio and a rocker length (the
    optimum of Alt's chart, VDI 2130).

    From the crank's pivot the rocker's pin is seen at its two dead points B1 and B2 under the angle alpha: all such pivots lie on a
    circle. Frame along x, rocker pivot on the right.
    """
    alpha = alpha_of(ratio)
    if not 0.0 < swing < np.pi:
        raise MechanismError(
            Fault("swing", f"a swing of {np.degrees(swing):g} deg.", "Give more than 0 and less than 180 degrees.")
        )
    if alpha == 0.0:
        raise MechanismError(
            Fault("ratio", "with a time ratio of one the transmission angle grows with the coupler's length, without a best one.",
                  "Ask for a little more, or take crank = rocker sin(swing/2), frame^2 = coupler^2 + rocker^2 - crank^2.")
        )  # fmt: skip

    def cost(at: float, side: int) -> float:
        made = _crank_rocker(swing, alpha, rocker, side, at)
        return 0.0 if made is None else -made.least_transmission()

    angles = np.linspace(0.0, 2.0 * np.pi, PIVOT_PLACES, endpoint=False)
    step = 2.0 * np.pi / PIVOT_PLACES
    best, place, side = min((cost(float(at), side), float(at), side) for side in (-1, 1) for at in angles)
    if best == 0.0:
        raise MechanismError(
            Fault(
                "swing",
                f"no crank-rocker swings by {np.degrees(swing):g} deg with a time ratio of {ratio:g}.",
                "Ask for less of either.",
            )
        )
    low, high = place - step, place + step
    golden = 0.5 * (np.sqrt(5.0) - 1.0)  # the optimum may be a kink, where parabolas fail
    while high - low > 1e-13:
        inner = high - golden * (high - low), low + golden * (high - low)
        low, high = (low, inner[1]) if cost(inner[0], side) < cost(inner[1], side) else (inner[0], high)
    made = _crank_rocker(swing, alpha, rocker, side, 0.5 * (low + high))
    assert made is not None
    return made


def _crank_rocker(swing: float, alpha: float, rocker: float, side: int, at: float) -> FourBar | None:
    """The crank-rocker whose crank pivot is at an angle of the circle on one side of the chord; None where there is none."""
    first, second = rocker * np.exp(0.5j * swing), rocker * np.exp(-0.5j * swing)  # rocker pivot at the origin
    chord = abs(first - second)
    radius = chord / (2.0 * np.sin(alpha))
    pivot = complex(0.5 * (first + second) + side * radius * np.cos(alpha) + radius * np.exp(1j * at))
    with np.errstate(**QUIET):  # the pivot may coincide with the pin
        seen = np.angle((first - pivot) / (second - pivot))
    if not abs(abs(seen) - alpha) <= 1e-9 or cross(-pivot, first - pivot) * cross(-pivot, second - pivot) <= 0.0:
        return None
    near, far = sorted((abs(first - pivot), abs(second - pivot)))
    made = FourBar(0j, complex(abs(pivot)), float(far - near) / 2.0, float(far + near) / 2.0, rocker)
    return made if made.crank > 1e-12 and made.grashof is Grashof.CRANK_ROCKER else None


# -- slotted levers ---------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class SlottedLever:
    """Quick return by a slotted lever (crank shaper): crank, distance of the pivots and length of the lever [m]."""

    crank: float
    frame: float
    lever: float

    @property
    def swing(self) -> float:
        """Swing of the lever [rad]."""
        return float(2.0 * np.arcsin(self.crank / self.frame))


def slotted_lever(stroke: float, ratio: float, frame: float) -> SlottedLever:
    """The slotted lever whose end has a stroke [m] between its dead points, for a time ratio and a distance of the pivots [m]."""
    beta = np.pi / (ratio + 1.0)
    if alpha_of(ratio) == 0.0:
        raise MechanismError(Fault("ratio", "a slotted lever always returns faster.", "Ask for a time ratio above one."))
    crank = float(frame * np.cos(beta))
    return SlottedLever(crank, frame, stroke * frame / (2.0 * crank))


@dataclass(frozen=True)
class Whitworth:
    """Whitworth's quick return, whose lever turns fully: crank, distance of the pivots, arm of the lever and rod to the slider [m].
    The slider's line passes through the lever's pivot, perpendicular to the line of the pivots."""

    crank: float
    frame: float
    arm: float
    rod: float


ROD_RATIO = 4.0  # rod over arm: the slider then moves nearly as the arm's end does


def whitworth(stroke: float, ratio: float, crank: float) -> Whitworth:
    """Whitworth's quick return of a stroke [m], a time ratio and a crank [m]."""
    if alpha_of(ratio) == 0.0:
        raise MechanismError(Fault("ratio", "with pivots in one place the lever turns as the crank.", "Ask for more than one."))
    return Whitworth(crank, float(crank * np.cos(np.pi / (ratio + 1.0))), 0.5 * stroke, 0.5 * ROD_RATIO * stroke)


STROKE_SAMPLES = 721
RANGE_POINTS = 4001  # points of the range over which Hoecken's proportions are chosen


@dataclass(frozen=True)
class StraightLine:
    """A four-bar, the range of its crank [rad] in which the point's path is straight, and the line's direction (unit)."""

    four_bar: FourBar
    start: float
    end: float
    direction: complex
    about: str = ""


@dataclass(frozen=True)
class Straightness:
    """Over a range: travel of a point along a line [m], and the least and greatest distance to its left [m]."""

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
    """The straightness of a linkage's coupler path over its range, with extremes exact to rounding."""
    theta = np.linspace(line.start, line.end, STROKE_SAMPLES)

    def at(angle: Real) -> tuple[Real, Real]:
        turned = line.four_bar.positions(angle)[2] * np.conj(line.direction)
        return turned.real, turned.imag

    along, across = at(theta)

    def extreme(values: Real, part: int, sign: float) -> float:
        k = int((sign * values).argmax())
        ends = theta[max(k - 1, 0)], theta[min(k + 1, STROKE_SAMPLES - 1)]
        optimum = minimize_scalar(
            lambda x: -sign * at(np.array([x]))[part][0], bounds=ends, method="bounded", options={"xatol": 1e-10}
        )
        return sign * max(sign * float(values[k]), -float(optimum.fun))

    travel = extreme(along, 0, 1.0) - extreme(along, 0, -1.0)
    return Straightness(travel, extreme(across, 1, -1.0), extreme(across, 1, 1.0))


def hoecken(straight: float) -> StraightLine:
    """Hoecken's linkage of crank one with the straightest path over a crank range [rad], in whose middle the crank points away from
    the frame.

    A simplex search finds the frame and the coupler (= rocker) for the least width over travel.
    """
    theta = np.pi + np.linspace(-0.5, 0.5, RANGE_POINTS) * straight

    def cost(lengths: Real) -> float:
        _, _, p = FourBar(0j, complex(lengths[0]), 1.0, lengths[1], lengths[1], 1, 2.0 * complex(lengths[1])).positions(theta)
        return float(np.ptp(p.imag) / np.ptp(p.real)) if np.isfinite(p).all() else 1.0

    optimum = minimize(cost, (2.6, 3.4), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-15, "maxiter": 2000}).x
    four_bar = FourBar(0j, complex(optimum[0]), 1.0, float(optimum[1]), float(optimum[1]), 1, 2.0 * complex(optimum[1]))
    return StraightLine(four_bar, float(theta[0]), float(theta[-1]), 1.0 + 0j, STRAIGHT_LINES["hoecken"].about)
