"""Inverse tasks of lectures: angular rates of a link, from accelerations of two of its points; its inertia, from periods of swings.

Accelerations: a_B - a_A = (i alpha - omega^2) (B - A), so that one division of complex numbers gives alpha and omega^2; omega
without its sign. A swing about a horizontal axis at the distance d from the centre of mass, with the amplitude a, has the period
T = 4 sqrt(J / (m g d)) K(sin(a / 2)), K being the complete elliptic integral: 2 pi sqrt(J / (m g d)) where a is small. Two axes on
a line through the centre of mass also give its position, as in Kater's pendulum.
"""

from __future__ import annotations

import math

from scipy.special import ellipkm1

from mechcore.constants import ZERO_SUM
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass

GRAVITY = 9.81
"""[m/s^2]"""


@dataclass(frozen=True)
class PlaneRates:
    """Acceleration field of a rigid body: ``omega_squared`` [rad^2/s^2], ``alpha`` [rad/s^2] counter-clockwise, and the
    ``acceleration`` [m/s^2] of the point at ``place`` [m], both complex."""

    omega_squared: float
    alpha: float
    place: complex
    acceleration: complex

    def at(self, place: complex) -> complex:
        """Acceleration [m/s^2] of the body's point at a position [m]."""
        return self.acceleration + (1j * self.alpha - self.omega_squared) * (place - self.place)

    @property
    def pole(self) -> complex | None:
        """The acceleration pole [m], the point without acceleration; None where all points have the same acceleration."""
        factor = 1j * self.alpha - self.omega_squared
        return None if abs(factor) == 0.0 else self.place - self.acceleration / factor


def rates_from_accelerations(a: complex, b: complex, of_a: complex, of_b: complex) -> PlaneRates:
    """Rates of a rigid body by its points ``a`` and ``b`` [m] with accelerations ``of_a`` and ``of_b`` [m/s^2], all complex.

    Raises `MechanismError` where they coincide, or where no rigid body has these accelerations: omega^2 would be negative.
    """
    if a == b:
        raise MechanismError(Fault("points", "both points are at one place.", "Give two places of the body."))
    factor = (of_b - of_a) / (b - a)
    squared = -factor.real
    if squared < -1e3 * ZERO_SUM * (abs(of_a) + abs(of_b)) / abs(b - a):
        why = f"no rigid body has these accelerations: along the line of the points they need omega^2 = {squared:.5g}."
        remedy = "The acceleration of B against A must not point away from A; check sizes and directions."
        raise MechanismError(Fault("accelerations", why, remedy))
    return PlaneRates(max(squared, 0.0), factor.imag, a, of_a)


def inertia_from_swing(
    mass: float, distance: float, period: float, amplitude: float = 0.0, gravity: float = GRAVITY
) -> tuple[float, float]:
    """Moments of inertia [kg m^2] about the axis and about the centre of mass, from the period [s] of a swing with an amplitude
    [rad].

    Raises `MechanismError` where no body has this period: its inertia about its centre of mass would be negative.
    """
    _positive(mass=mass, distance=distance, period=period, gravity=gravity)
    reduced = _reduced(period, amplitude, gravity)
    about_axis = mass * distance * reduced
    central = about_axis - mass * distance**2
    if central < 0.0:
        least = 4.0 * math.sqrt(distance / gravity) * float(ellipkm1(math.cos(0.5 * amplitude) ** 2))
        why = f"a period of {period:.6g} s is shorter than that of a point mass at this distance, {least:.6g} s."
        raise MechanismError(Fault("period", why, "Check the distance, and that the period is a swing to and fro."))
    return about_axis, central


def inertia_from_two_swings(
    mass: float, apart: float, periods: tuple[float, float], amplitude: float = 0.0, gravity: float = GRAVITY
) -> tuple[float, float]:
    """Distance [m] of the centre of mass from the first axis, and J_S [kg m^2], from the periods [s] about two parallel axes.

    The axes are ``apart`` [m], with the centre of mass on the line between them. Raises `MechanismError` where the data are
    inconsistent, or where they leave the position undetermined: both periods with a reduced length equal to the distance of the
    axes.
    """
    _positive(mass=mass, apart=apart, first=periods[0], second=periods[1], gravity=gravity)
    first, second = (_reduced(period, amplitude, gravity) for period in periods)
    below = 2.0 * apart - first - second
    if abs(below) <= 1e-9 * apart:
        why = "both periods have the reduced length that the axes are apart: any place of the centre of mass between them fits."
        raise MechanismError(Fault("periods", why, "Take another axis, or find the centre of mass by weighing."))
    distance = apart * (apart - second) / below
    if not 0.0 < distance < apart:
        why = f"the centre of mass would be {1e3 * distance:.5g} mm from the first axis, not between both."
        raise MechanismError(Fault("periods", why, "Check the periods, and which belongs to which axis."))
    central = mass * distance * (first - distance)
    if central < 0.0:
        why = f"J_S would be {central:.5g} kg m^2."
        raise MechanismError(Fault("periods", why, "Check the periods and the distance of the axes."))
    return distance, central


def _reduced(period: float, amplitude: float, gravity: float) -> float:
    """Length [m] of the simple pendulum with the same period, J / (m d)."""
    if not 0.0 <= amplitude < math.pi:
        why = f"an amplitude of {math.degrees(amplitude):.5g}°."
        raise MechanismError(Fault("amplitude", why, "Give the angle from the lowest position, below 180°."))
    return gravity * (period / (4.0 * float(ellipkm1(math.cos(0.5 * amplitude) ** 2)))) ** 2


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise MechanismError(Fault(name, f"{value:g} is not above zero.", "Give a positive number."))
