"""The lecture's simplified profile of an offset knife follower, and what leaving out the phase costs.

The lecture takes rho = sqrt(h^2 + m^2) at the polar angle theta; exactly the polar angle is theta +- atan(m/h(theta)), of
which only
the constant part is a mounting angle. ``Cam`` has the exact profile; here are the simplified one and the difference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..laws.curve import MotionCurve

__all__ = ["OffsetError", "neglected_phase", "simplified_offset_error", "simplified_profile"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


def simplified_profile(law: MotionCurve, offset: float, angle: ArrayLike) -> Complex:
    """The lecture's profile sqrt(h^2 + m^2) exp(i theta) at angles (n) [m]."""
    theta = np.asarray(angle, float)
    return np.hypot(law(theta, 0)[0], offset) * np.exp(1j * theta)


def neglected_phase(law: MotionCurve, offset: float, angle: ArrayLike) -> Real:
    """The phase atan(m/h) that the lecture leaves out, at angles (n) [rad]."""
    return np.arctan2(offset, law(np.asarray(angle, float), 0)[0])


@dataclass(frozen=True, eq=False)
class OffsetError:
    """Heights wanted and obtained (n) with the simplified profile, and the largest difference with its angle."""

    wanted: Real
    obtained: Real
    largest: float
    angle: float


def simplified_offset_error(law: MotionCurve, offset: float, angle: ArrayLike) -> OffsetError:
    """Heights of a follower that really is offset by m, on the simplified profile mounted to be right at theta = 0.

    The point of polar angle psi is presented at theta = psi + atan(m/h(0)) - atan(m/h(psi)); psi is found by bisection. Heights
    reached are unchanged, the timing is not.
    """
    theta = np.atleast_1d(np.asarray(angle, float))
    fixed = float(np.arctan2(offset, law(law.start, 0)[0]))
    low = theta - 0.5 * np.pi
    high = theta + 0.5 * np.pi
    for _ in range(64):
        middle = 0.5 * (low + high)
        late = middle + fixed - neglected_phase(law, offset, middle) > theta
        low, high = np.where(late, low, middle), np.where(late, middle, high)
    wanted, obtained = law(theta, 0)[0], law(0.5 * (low + high), 0)[0]
    k = int(np.argmax(np.abs(obtained - wanted)))
    return OffsetError(wanted, obtained, float(abs(obtained[k] - wanted[k])), float(theta[k]))
