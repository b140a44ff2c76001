"""Closure of cam and follower: yokes of constant breadth, conjugate cams, springs; jamming of the guide, Hertz stress."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.cams.followers import Follower, Oscillating, Roller, Translating
from mechcore.cams.synthesis import Cam
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve
from mechcore.records import dataclass
from mechcore.texts import as_angle, as_length


@dataclass(frozen=True)
class Breadth:
    """Distance of the two faces (or roller centres) of a yoke [m]: mean, largest deviation from it and its angle."""

    mean: float
    deviation: float
    angle: float

    def constant(self, tolerance: float = 1e-9) -> bool:
        """Whether both faces of the yoke stay in contact: the deviation is at most ``tolerance`` times the breadth."""
        return self.deviation <= tolerance * abs(self.mean)


def breadth(law: MotionCurve, count: int = 1440) -> Breadth:
    """The breadth h(theta) + h(theta + pi) over half a turn; a yoke of parallel faces or opposite rollers needs a constant one."""
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


@dataclass(frozen=True)
class SecondRoller:
    """The second roller of a conjugate pair, with its place on the follower; fields as the arguments of `conjugate`."""

    radius: float
    span: float | None = None
    offset: float = 0.0
    arm: float | None = None
    angle: float | None = None

    def cam(self, first: Cam) -> Cam:
        """The cam of this roller, conjugate to the ``first``."""
        return conjugate(first, self.radius, span=self.span, offset=self.offset, arm=self.arm, angle=self.angle)[0]


@dataclass(frozen=True)
class Closure:
    """Closure of a translating follower: mass [kg], spring rate [N/m], its deflection at zero lift [m], weight
    and load.

    ``gravity`` [m/s2] acts against the lift where positive; ``load`` [N] likewise. For an oscillating follower: moment of
    inertia, torsion rate, angle, and ``load`` a moment, ``gravity`` 0.
    """

    mass: float
    stiffness: float
    preload: float
    gravity: float = 9.81
    load: float = 0.0

    @property
    def dead(self) -> float:
        """Force at zero lift, at rest [N]."""
        return self.stiffness * self.preload + self.mass * self.gravity + self.load


def closing_force(closure: Closure, lift: ArrayLike, acceleration: ArrayLike, speed: float) -> Real:
    """Force between cam and follower along the follower's motion [N]: k (d0 + s) + m g + P + m w^2 s''; negative: contact lost.

    The contact force is this over the cosine of the pressure angle; the drive torque of the cam this times s'.
    """
    s, a = np.asarray(lift, float), np.asarray(acceleration, float)
    return closure.dead + closure.stiffness * s + closure.mass * speed**2 * a


@dataclass(frozen=True)
class Separation:
    """The least speed [rad/s] at which contact is lost, and the cam angle at which that happens first."""

    speed: float
    angle: float


def _samples(lift: MotionCurve, count: int) -> tuple[Real, Real, Real]:
    """Lift and second derivative on a grid of each piece, ends included from inside."""
    angles, s, a = [], [], []
    share = max(count // len(lift.pieces), 65)
    for piece, x0 in zip(lift.pieces, lift.knots, strict=False):
        u = np.linspace(0.0, piece.length, share)
        f = np.empty((3, share))
        piece.fill(u, f)
        angles.append(x0 + u)
        s.append(f[0])
        a.append(f[2])
    return np.concatenate(angles), np.concatenate(s), np.concatenate(a)


def _refined(lift: MotionCurve, cost: Callable[[Real, Real], Real], count: int = 2048) -> tuple[float, float]:
    """Least value of a cost of s and s'' along a lift and its angle, to rounding: grid, then nested grids around the best point."""
    angles, s, a = _samples(lift, count)
    values = cost(s, a)
    k = int(np.argmin(values))
    best, where = float(values[k]), float(angles[k])
    share = len(angles) // len(lift.pieces)
    piece, x0 = lift.pieces[k // share], lift.knots[k // share]
    low, high = max(k % share - 1, 0), min(k % share + 1, share - 1)
    u0, u1 = angles[k - k % share + low] - x0, angles[k - k % share + high] - x0
    for _ in range(8):
        u = np.linspace(u0, u1, 33)
        f = np.empty((3, 33))
        piece.fill(u, f)
        values = cost(f[0], f[2])
        k = int(np.argmin(values))
        if values[k] < best:
            best, where = float(values[k]), float(x0 + u[k])
        u0, u1 = u[max(k - 1, 0)], u[min(k + 1, 32)]
    return best, where


def first_separation(closure: Closure, lift: MotionCurve) -> Separation | None:
    """The speed at which contact is first lost and where; None if no speed does (theory: w^2 = min (k(d0 + s) + mg + P)/(-m
    s''))."""
    if closure.mass <= 0.0:
        return None

    def cost(s: Real, a: Real) -> Real:
        force = closure.dead + closure.stiffness * s
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(a < 0.0, np.maximum(force, 0.0) / (-closure.mass * np.minimum(a, -1e-300)), np.inf)

    value, angle = _refined(lift, cost)
    return Separation(float(np.sqrt(value)), angle) if np.isfinite(value) else None


@dataclass(frozen=True)
class HertzContact:
    """Largest pressure [Pa] and half width of the contact strip [m], arrays like the force."""

    pressure: Real
    half_width: Real


def hertz(
    force: ArrayLike,
    cam_radius: ArrayLike,
    follower_radius: float,
    width: float,
    modulus: tuple[float, float] = (2.1e11, 2.1e11),
    poisson: tuple[float, float] = (0.3, 0.3),
) -> HertzContact:
    """Line contact of two cylinders (H. Hertz): force (n) [N], radius of the cam (n) [m] (negative: concave, infinite: flat).

    ``follower_radius`` [m]: roller or arc, infinite for a flat face. 0 for a knife or a cusp: infinite pressure. Where the cam's
    hollow is tighter than the roller, no contact is possible: NaN. Lost contact (force <= 0): no pressure.
    """
    f, rho = np.broadcast_arrays(np.asarray(force, float), np.asarray(cam_radius, float))
    if not width > 0.0:
        raise MechanismError(Fault("cam.width", f"{as_length(width)}.", "Give a positive width of the contact."))
    stiff = contact_modulus(modulus, poisson)
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = 1.0 / rho + (1.0 / follower_radius if follower_radius != 0.0 else np.inf)
        curvature = np.where(curvature < 0.0, np.nan, curvature)
        load = np.maximum(f, 0.0) / width
        pressure = np.where(load == 0.0, 0.0, np.sqrt(load * stiff * curvature / np.pi))
        half = np.where(load == 0.0, 0.0, np.sqrt(4.0 * load / (np.pi * stiff * curvature)))
    return HertzContact(pressure, half)


def contact_modulus(modulus: tuple[float, float], poisson: tuple[float, float]) -> float:
    """Elastic modulus of the contact of two bodies [Pa], after Hertz."""
    return 1.0 / sum((1.0 - n**2) / e for e, n in zip(modulus, poisson, strict=True))


def rollers_for(
    force: ArrayLike,
    pitch_radius: ArrayLike,
    width: float,
    limit: float,
    modulus: tuple[float, float] = (2.1e11, 2.1e11),
    poisson: tuple[float, float] = (0.3, 0.3),
) -> tuple[Real, Real]:
    """The least and greatest radii (n) [m] of rollers with which the Hertz pressure on a pitch curve is at most ``limit`` [Pa].

    ``force`` (n) [N] along the normal, ``pitch_radius`` (n) [m], negative where it is hollow: neither depends on the roller as
    long as the pitch curve is the same. A roller r has the reduced radius r (rho - r) / rho, at most rho / 4. Where the pitch
    curve is too sharp for any roller, the least radius is infinite.
    """
    f, rho = np.broadcast_arrays(np.maximum(np.asarray(force, float), 0.0), np.asarray(pitch_radius, float))
    stiff = contact_modulus(modulus, poisson)
    need = f * stiff / (np.pi * width * limit**2)  # reduced radius
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(1.0 - 4.0 * need / rho)
        low = np.where(need == 0.0, 0.0, 2.0 * need / (1.0 + root))
        high = np.where(rho > 0.0, 0.5 * rho * (1.0 + root), np.inf)
    return np.where(np.isnan(low), np.inf, low), np.where(np.isnan(high), 0.0, high)


def roller_range(
    force: ArrayLike,
    pitch_radius: ArrayLike,
    width: float,
    limit: float,
    modulus: tuple[float, float] = (2.1e11, 2.1e11),
    poisson: tuple[float, float] = (0.3, 0.3),
) -> tuple[float, float]:
    """The least and the greatest radius [m] of a roller that meets the limit everywhere; arguments as those of `rollers_for`."""
    low, high = rollers_for(force, pitch_radius, width, limit, modulus, poisson)
    return float(low.max()), float(high.min())
