"""Form closure and relatives of the plane cam: constant breadth, conjugate pairs, inverse cams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Real
from mechcore.cams.followers import Follower, Oscillating, Roller, Translating
from mechcore.cams.synthesis import Cam
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve
from mechcore.numerics import jets
from mechcore.texts import as_angle


@dataclass(frozen=True)
class Breadth:
    """Distance of the two faces (or roller centres) of a yoke [m]: mean, largest deviation from it and its angle."""

    mean: float
    deviation: float
    angle: float

    def constant(self, tolerance: float = 1e-9) -> bool:
        """The yoke's faces stay in contact: deviation within the tolerance of the breadth."""
        return self.deviation <= tolerance * abs(self.mean)


def breadth(law: MotionCurve, count: int = 1440) -> Breadth:
    """h(theta) + h(theta + pi) over half a turn: constant for a yoke follower with parallel faces or opposite rollers."""
    if abs(law.length - 2.0 * np.pi) > 1e-9 or not law.repeats:
        raise MechanismError(Fault("cam.law", f"a cycle of {as_angle(law.length)}.", "A yoke needs a law that repeats every turn."))
    x = law.start + np.pi * np.arange(count) / count
    both = np.concatenate([law(x, 0, s)[0] + law(x + np.pi, 0, s)[0] for s in ("left", "right")])
    mean = 0.5 * (both.max() + both.min())
    k = int(np.argmax(np.abs(both - mean)))
    return Breadth(float(mean), float(abs(both[k] - mean)), float(x[k % count]))


def conjugate(
    cam: Cam, radius: float, *, span: float | None = None, offset: float = 0.0, arm: float | None = None, angle: float | None = None
) -> tuple[Cam, float]:
    """The second cam of a form-closed joint on the same shaft, and the angle [rad] by which its own axes are turned on the shaft.

    Translating follower: a second roller ``span`` below the first, on the line x = ``offset``; oscillating: on a second ``arm`` at
    the fixed ``angle`` from the first, on the other side of O.
    """
    guide, law = cam.follower.guide, cam.law
    first = float(law.pieces[0].at(0.0, 0)[0])

    def rest(total: float) -> MotionCurve:
        return law.scaled(law.start, law.length, total - first, -1.0)

    if isinstance(guide, Translating):
        if span is None:
            raise MechanismError(Fault("cam.span", "missing.", "Give the distance of the two rollers."))
        # seen upside down the lower roller is an ordinary follower
        return Cam(rest(span), Follower(Translating(-offset), Roller(radius)), cam.turn), np.pi
    if arm is None or angle is None:
        raise MechanismError(Fault("cam.angle", "missing.", "Give the second arm's length and its angle from the first."))
    return Cam(rest(angle), Follower(Oscillating(guide.pivot, arm, -guide.side), Roller(radius)), cam.turn), 0.0


@dataclass(frozen=True, eq=False)
class InverseCam:
    """The roller sits on the driving crank or slide, the cam (a slot) on the driven link.

    The crank of length ``crank`` turns by theta about ``centre`` (complex, [m]), its pin at centre + crank exp(i (theta + phase)).
    Or the pin is on a slide that moves by x along the unit vector ``straight``, at centre + x straight; the law is one of x [m],
    and ``crank`` is the arm that makes lengths of the angles of a driven link that turns.

    The driven link slides by the law along y (``turns`` False), or turns by the law about the origin.
    """

    law: MotionCurve
    centre: complex
    crank: float
    radius: float
    turns: bool = True
    phase: float = 0.0
    straight: complex | None = None

    def pin(self, angle: ArrayLike, order: int = 2) -> Complex:
        """The pin in ground axes with derivatives (order + 1, n)."""
        theta = np.atleast_1d(np.asarray(angle, float))
        if self.straight is not None:
            t = np.zeros((order + 1, theta.size), complex)
            t[0] = self.centre + self.straight * theta
            t[1:2] = self.straight
            return t
        t = (1j ** np.arange(order + 1))[:, None] * self.crank * np.exp(1j * (theta + self.phase))
        t[0] += self.centre
        return t

    def pitch(self, angle: ArrayLike, order: int = 2) -> Complex:
        """Centre line of the slot in the driven link's axes with derivatives (order + 1, n)."""
        theta = np.atleast_1d(np.asarray(angle, float))
        t, q = self.pin(theta, order), self.law(theta, order)
        return jets.product(jets.exponential(-1j * q), t) if self.turns else t - 1j * q

    def normal(self, angle: ArrayLike) -> Complex:
        """Unit normal of the slot to the left of the pin's travel, in the driven link's axes (n)."""
        d = self.pitch(angle, 1)[1]
        return 1j * d / np.abs(d)

    def flank(self, angle: ArrayLike, side: int = 1) -> Complex:
        """Flank of the slot to the left (1) or right (-1) of the pin's travel, in the driven link's axes (n)."""
        return self.pitch(angle, 0)[0] + side * self.radius * self.normal(angle)

    def flank_radius(self, angle: ArrayLike, side: int = 1) -> Real:
        """Radius of curvature of a flank (n) [m], positive where the link's material on that side is convex.

        The centre line's radius (positive when it bends towards that side) less the roller's; undercut where the centre line bends
        towards the side and this is negative.
        """
        d = self.pitch(angle, 2)
        with np.errstate(divide="ignore"):
            rho = np.abs(d[1]) ** 3 / np.imag(np.conj(d[1]) * d[2])
        return side * rho - self.radius

    def pressure_angle(self, angle: ArrayLike) -> Real:
        """Angle between the slot's normal and the motion of the driven link at the pin (n) [rad], 0 ... pi/2."""
        theta = np.atleast_1d(np.asarray(angle, float))
        q = self.law(theta, 0)[0]
        if self.turns:
            n, away = np.exp(1j * q) * self.normal(theta), 1j * self.pin(theta, 0)[0]
        else:
            n, away = self.normal(theta), np.full(theta.shape, 1j)
        return np.arccos(np.clip(np.abs(np.real(np.conj(n) * away)) / np.abs(away), 0.0, 1.0))
