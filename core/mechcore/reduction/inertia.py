"""The inertia resultant of a rigid body: force and moment about S, the single force on its line, the centre of percussion."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import Fault, MechanismError

__all__ = ["acceleration_field", "inertia_of_points", "inertia_wrench", "percussion_centre", "single_resultant"]

Real = NDArray[np.float64]


def inertia_wrench(mass: float, inertia: float, a_s: ArrayLike, alpha: ArrayLike) -> tuple[Real, Real]:
    """Inertia force -m a_S (..., 2) [N] at the centre of mass S and inertia moment -J_S alpha (...) [N m] (d'Alembert)."""
    return -mass * np.asarray(a_s, float), -inertia * np.asarray(alpha, float)


def single_resultant(force: ArrayLike, moment: ArrayLike, at: ArrayLike = (0.0, 0.0)) -> tuple[Real, Real]:
    """The one force that replaces a force (..., 2) at a point ``at`` and a moment (...): the point of its line of action that is
    nearest to ``at`` (..., 2), and its distance |M| / |F| (...). NaN and inf where there is no force but a moment; ``at``
    where there is
    neither."""
    f, m, p = np.asarray(force, float), np.asarray(moment, float), np.asarray(at, float)
    square = (f**2).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        arm = np.stack([f[..., 1], -f[..., 0]], axis=-1) * (m / square)[..., None]
        far = np.abs(m) / np.sqrt(square)
    nothing = (square == 0.0) & (m == 0.0)
    arm = np.where(nothing[..., None], 0.0, np.where((square == 0.0)[..., None], np.nan, arm))
    return p + arm, np.where(nothing, 0.0, far)


def percussion_centre(mass: float, inertia: float, centre: ArrayLike, pivot: ArrayLike) -> Real:
    """Centre of percussion W (..., 2) [m] of a body that turns about a pivot: on the line pivot - S beyond S by e = i_S^2 / rho.

    The inertia resultant crosses that line in W, whatever angular velocity and acceleration are.
    """
    s, b = np.asarray(centre, float), np.asarray(pivot, float)
    rho = np.hypot(*np.moveaxis(s - b, -1, 0))
    if np.any(rho == 0.0):
        why = "the pivot is the centre of mass: the inertia forces come to a couple, which has no line of action."
        raise MechanismError(Fault("percussion_centre", why, "Give another pivot."))
    return s + (s - b) * (inertia / mass / rho**2)[..., None]


def acceleration_field(places: ArrayLike, a_s: ArrayLike, omega: ArrayLike, alpha: ArrayLike) -> Real:
    """Accelerations (..., n, 2) of points of a rigid body at places (n, 2) or (..., n, 2) from S, all in the same axes:
    a_S + alpha k x r - omega^2 r."""
    r = np.asarray(places, float)
    w, e = np.asarray(omega, float)[..., None, None], np.asarray(alpha, float)[..., None, None]
    turned = np.stack([-r[..., 1], r[..., 0]], axis=-1)
    return np.asarray(a_s, float)[..., None, :] + e * turned - w * w * r


def inertia_of_points(
    masses: ArrayLike, places: ArrayLike, a_s: ArrayLike, omega: ArrayLike, alpha: ArrayLike
) -> tuple[Real, Real]:
    """Force (..., 2) [N] and moment about S (...) [N m] of the inertia forces -m_i a_i of point masses (n,) at places (n, 2)
    from S."""
    r = np.asarray(places, float)
    single = -np.asarray(masses, float)[:, None] * acceleration_field(r, a_s, omega, alpha)
    return single.sum(axis=-2), (r[..., 0] * single[..., 1] - r[..., 1] * single[..., 0]).sum(axis=-1)
