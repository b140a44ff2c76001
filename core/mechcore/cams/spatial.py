"""Spatial cams with cylindrical rollers: barrel (groove and rib), end (face) and globoidal cams, their real flank surfaces; inverse
cams, whose roller drives.

The cam turns by ``turn * theta`` about the z axis. The roller's axis is the line X(theta, l) = A + l a; the flank is the envelope
of the roller in the cam's axes. With v the velocity of X against the cam, the contact normal is perpendicular to the axis and to v,
so that it is exactly +-(v x a)/|v x a|; the surface S = X - r N, its derivatives and curvatures follow in closed form
(Weingarten), and 1 - c1 r + c2 r^2 = 0 is the roller radius at which the surface becomes singular (undercut).
"""

from __future__ import annotations

from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Real, numbers
from mechcore.cams.limits import Reached
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve
from mechcore.numerics import jets
from mechcore.records import dataclass
from mechcore.texts import as_length


def _stack(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Real:
    return np.stack(np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float), np.asarray(z, float)), axis=-1)


LAYERS = 9  # places along the roller at which limits are evaluated


@dataclass(frozen=True)
class Barrel:
    """The follower slides parallel to the cam's axis, its roller's axis radial (along x); the law is the height z. Barrel,
    rib, end cams."""

    def axis(self, q: Real) -> tuple[Real, Real]:
        """Coordinate with derivatives (3, n) -> A and a with derivatives, each (3, n, 3)."""
        zero = np.zeros_like(q)
        a = np.zeros((*q.shape, 3))
        a[0, :, 0] = 1.0
        return _stack(zero, zero, q), a

    def away(self, x: Real, q: Real) -> Real:
        """Unit direction in which points (n, m, 3) of the follower move when the coordinate grows."""
        return np.broadcast_to([0.0, 0.0, 1.0], x.shape)

    def carried(self, x: Real) -> Real:
        """Velocity of points (..., 3) of the follower for a unit rate of its coordinate."""
        return np.broadcast_to([0.0, 0.0, 1.0], x.shape)


@dataclass(frozen=True)
class BarrelArm:
    """An arm swings about a line parallel to x through (y, z) = ``pivot``, parallel to the barrel; the roller's axis stays
    parallel to x.

    The law is the angle psi of the arm: roller centre (y, z) = pivot + arm (-cos psi, sin psi).
    """

    pivot: tuple[float, float]
    arm: float

    def axis(self, q: Real) -> tuple[Real, Real]:
        c, s = np.cos(q[0]), np.sin(q[0])
        y = [-c, s * q[1], c * q[1] ** 2 + s * q[2]]
        z = [s, c * q[1], -s * q[1] ** 2 + c * q[2]]
        point = _stack(0.0, self.arm * np.array(y), self.arm * np.array(z))
        point[0] += (0.0, *self.pivot)
        a = np.zeros_like(point)
        a[0, :, 0] = 1.0
        return point, a

    def away(self, x: Real, q: Real) -> Real:
        d = self.carried(x)
        return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))

    def carried(self, x: Real) -> Real:
        r = x - np.array([0.0, *self.pivot])
        return _stack(0.0, r[..., 2], -r[..., 1])


@dataclass(frozen=True)
class Globoid:
    """An arm swings about a line parallel to y through (``distance``, 0, 0), the roller's axis along the arm, towards the cam.

    The law is the angle psi of the arm from the perpendicular of the two axes; l is measured from the pivot. A positive sense
    lifts the roller along z. (The concave globoid of roller gears; the turret of an indexing drive is several such rollers.)
    """

    distance: float

    def axis(self, q: Real) -> tuple[Real, Real]:
        c, s = np.cos(q[0]), np.sin(q[0])
        x = np.array([-c, s * q[1], c * q[1] ** 2 + s * q[2]])
        z = np.array([s, c * q[1], -s * q[1] ** 2 + c * q[2]])
        a = _stack(x, 0.0, z)
        point = np.zeros_like(a)
        point[0, :, 0] = self.distance
        return point, a

    def away(self, x: Real, q: Real) -> Real:
        d = _stack(np.sin(q)[:, None], 0.0, np.cos(q)[:, None])
        return np.broadcast_to(d, x.shape)

    def carried(self, x: Real) -> Real:
        return _stack(x[..., 2], 0.0, self.distance - x[..., 0])


Mount = Barrel | BarrelArm | Globoid


def _cross(a: Real, b: Real) -> Real:
    return np.cross(a, b)


def _about_z(x: Real, turn: int) -> Real:
    """turn * k x x."""
    return turn * np.stack([-x[..., 1], x[..., 0], np.zeros_like(x[..., 0])], axis=-1)


def _dot(a: Real, b: Real) -> Real:
    return np.asarray(np.einsum("...i,...i->...", a, b))


@dataclass(frozen=True, eq=False)
class Flank:
    """One flank over angles (n) and lengths along the roller (m); arrays (n, m) or (n, m, 3)."""

    cam: SpatialCam
    angle: Real
    along: Real
    motion: Real
    side: int

    @cached_property
    def _axis(self) -> tuple[Real, ...]:
        """X, v, a and the derivatives of v and a that the surface needs, all in ground axes and relative to the cam."""
        turn = self.cam.turn
        point, a = self.cam.mount.axis(self.motion)
        along = self.along[None, :, None]
        x, x1, x2 = (p[:, None, :] + along * d[:, None, :] for p, d in zip(point, a, strict=True))
        a0, a1 = (np.broadcast_to(d[:, None, :], x.shape) for d in a[:2])
        v = x1 - _about_z(x, turn)
        v_angle = x2 - 2.0 * _about_z(x1, turn) + _about_z(_about_z(x, turn), turn)  # in the cam's axes
        a_angle = a1 - _about_z(a0, turn)
        return x, v, a0, v_angle, a_angle

    @cached_property
    def _normals(self) -> tuple[Real, Real, Real, Real]:
        """N (from the cam to the roller), its derivatives by angle and along the axis in the cam's axes, and |v x a|."""
        _, v, a, v_angle, a_angle = self._axis
        w = _cross(v, a)
        size = np.linalg.norm(w, axis=-1, keepdims=True)
        n = w / size
        w_angle = _cross(v_angle, a) + _cross(v, a_angle)
        w_along = _cross(a_angle, a)  # v changes by a's own velocity along the axis
        n_angle = (w_angle - n * _dot(n, w_angle)[..., None]) / size
        n_along = (w_along - n * _dot(n, w_along)[..., None]) / size
        s = float(self.side)
        return s * n, s * n_angle, s * n_along, size[..., 0]

    def _into_cam(self, x: Real) -> Real:
        c, s = np.cos(self.angle)[:, None], self.cam.turn * np.sin(self.angle)[:, None]
        return np.stack([c * x[..., 0] + s * x[..., 1], -s * x[..., 0] + c * x[..., 1], x[..., 2]], axis=-1)

    @cached_property
    def point(self) -> Real:
        """Points of the flank in the cam's axes [m]."""
        return self._into_cam(self._axis[0] - self.cam.radius * self._normals[0])

    @cached_property
    def normal(self) -> Real:
        """Unit normals from the cam to the roller, in the cam's axes."""
        return self._into_cam(self._normals[0])

    @cached_property
    def axis_point(self) -> Real:
        """The pitch surface: points of the roller's axis in the cam's axes [m]."""
        return self._into_cam(self._axis[0])

    @cached_property
    def pressure_angle(self) -> Real:
        """Angle between the normal and the direction of the follower's motion, positive on a rise [rad]; barrel: tan = s'/l."""
        x, _, a, *_ = self._axis
        away = self.cam.mount.away(x, self.motion[0])
        n = self._normals[0] * self.side  # along +away for a roller that rises
        across = _cross(a, away)
        ahead = np.sign(_dot(across, _about_z(x, self.cam.turn)))  # sense in which the cam's surface moves
        return np.arctan2(ahead * _dot(n, across) * np.sign(_dot(n, away)), np.abs(_dot(n, away)))

    @cached_property
    def _coefficients(self) -> tuple[Real, Real]:
        """c1, c2 of sharpness = 1 - c1 r + c2 r^2."""
        _, v, a, *_ = self._axis
        n, n_angle, n_along, size = self._normals
        whole = self.side * size
        c1 = _dot(_cross(v, n_along) + _cross(n_angle, a), n) / whole
        c2 = _dot(_cross(n_angle, n_along), n) / whole
        return c1, c2

    @cached_property
    def sharpness(self) -> Real:
        """1 where the flank follows the pitch surface, 0 where it is singular, negative where it is undercut."""
        c1, c2 = self._coefficients
        r = self.cam.radius
        return 1.0 - c1 * r + c2 * r * r

    @cached_property
    def greatest_roller(self) -> Real:
        """The roller radius at which each point becomes singular [m], infinite where none does."""
        c1, c2 = self._coefficients
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(c1 * c1 - 4.0 * c2)
            # both roots without cancellation
            q = 0.5 * (c1 + np.where(c1 >= 0.0, 1.0, -1.0) * root)
            roots = np.stack([q / c2, 1.0 / q])
        roots = np.where(np.isfinite(roots) & (roots > 0.0), roots, np.inf)
        return np.asarray(roots.min(axis=0))

    @cached_property
    def _curvatures(self) -> tuple[Real, Real, Real]:
        """Mean and Gaussian curvature of the flank, and its curvature along the line of contact."""
        _, v, a, *_ = self._axis
        _, n_angle, n_along, _ = self._normals
        r = self.cam.radius
        s_angle, s_along = v - r * n_angle, a - r * n_along
        e, f, g = _dot(s_angle, s_angle), _dot(s_angle, s_along), _dot(s_along, s_along)
        e2, f2, g2 = _dot(n_angle, s_angle), _dot(n_angle, s_along), _dot(n_along, s_along)  # second fundamental form
        det = e * g - f * f
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = 0.5 * (e * g2 + g * e2 - 2.0 * f * f2) / det
            gauss = (e2 * g2 - f2 * f2) / det
            return mean, gauss, g2 / g

    @property
    def principal_curvatures(self) -> tuple[Real, Real]:
        """Larger and smaller principal curvature of the flank [1/m], positive where the cam is convex."""
        mean, gauss, _ = self._curvatures
        root = np.sqrt(np.maximum(mean * mean - gauss, 0.0))
        return mean + root, mean - root

    @property
    def curvature_across(self) -> Real:
        """Curvature of the flank across its line of contact with the roller [1/m], positive where the cam is convex."""
        mean, _, along = self._curvatures
        return 2.0 * mean - along

    @property
    def curvature_sum(self) -> Real:
        """Sum of the principal curvatures [1/m]. Along the line of contact the relative curvature of flank and roller is zero, so
        that this sum plus the roller's curvature is their relative curvature across that line."""
        return 2.0 * self._curvatures[0]


@dataclass(frozen=True, eq=False)
class SpatialCam:
    """A spatial cam: law of the follower's coordinate, how the follower is mounted, roller radius, range of the roller's
    axis [m]."""

    law: MotionCurve
    mount: Mount
    radius: float
    inner: float
    outer: float
    turn: int = 1

    def __post_init__(self) -> None:
        if not self.radius > 0.0:
            raise MechanismError(Fault("follower.radius", f"a roller of {as_length(self.radius)}.", "Give a positive radius."))
        if not self.inner < self.outer:
            raise MechanismError(
                Fault(
                    "cam.depth",
                    f"a roller from {as_length(self.inner)} to {as_length(self.outer)} along its axis.",
                    "Give the smaller first.",
                )
            )
        if self.turn not in (1, -1):
            raise MechanismError(Fault("cam.turn", f"{self.turn}", "Give 1 or -1."))

    def places(self, layers: int) -> Real:
        """Places along the roller's axis from one end to the other [m]."""
        return np.linspace(self.inner, self.outer, layers)

    def flank(self, angle: ArrayLike, along: ArrayLike, side: int = 1) -> Flank:
        """Angles (n), places along the roller's axis (m); ``side`` 1: the flank that lifts the follower, -1: the other one
        of a groove."""
        angle = numbers(angle)
        along = numbers(along)
        lifts = -1 if isinstance(self.mount, Globoid) else 1  # which sign of v x a points along the follower's motion
        return Flank(self, angle, along, self.law(angle, 2), side * lifts * self.turn)


@dataclass(frozen=True)
class SpatialLimits:
    """Extremes over a cycle and the roller's length; radii [m], angles of the cam where they are reached."""

    pressure: Reached
    sharpness: Reached
    greatest_roller: Reached
    convex: Reached | None

    @property
    def undercut(self) -> bool:
        return self.sharpness.value < 0.0


def spatial_limits(cam: SpatialCam, sides: tuple[int, ...] = (1, -1), count: int = 720, layers: int = LAYERS) -> SpatialLimits:
    """Extremes on a grid of angles and of places along the roller, over the stated flanks (one for a rib's side or an end cam)."""
    angle = cam.law.start + cam.law.length * np.arange(count) / count
    along = cam.places(layers)
    best: list[Reached | None] = [None] * 4
    for side in sides:
        f = cam.flank(angle, along, side)
        rows = (np.abs(f.pressure_angle), -f.sharpness, -f.greatest_roller, f.principal_curvatures[0])
        for k, row in enumerate(rows):
            i = int(np.argmax(row)) // layers
            value, old = float(row.max()), best[k]
            if old is None or value > old.value:
                best[k] = Reached(value, float(angle[i]))
    pressure, sharp, roller, convex = best
    assert pressure is not None and sharp is not None and roller is not None and convex is not None
    return SpatialLimits(
        pressure,
        Reached(-sharp.value, sharp.angle),
        Reached(-roller.value, roller.angle),
        Reached(1.0 / convex.value, convex.angle) if convex.value > 0.0 else None,
    )


@dataclass(frozen=True, eq=False)
class InverseCam:
    """The roller sits on the driving crank or slide, the cam (a slot) on the driven link.

    The crank of length ``crank`` turns by theta about ``centre`` (complex, [m]), its pin at centre + crank exp(i (theta + phase)).
    Or the pin is on a slide that moves by x along the unit vector ``straight``, at centre + x straight; the law is one of x [m],
    and ``crank`` is the arm that converts angles of a turning driven link to lengths.

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
        theta = numbers(angle)
        if self.straight is not None:
            still = [self.straight + 0.0 * theta, *(0j * theta for _ in range(order - 1))]
            return np.stack([self.centre + self.straight * theta, *still[:order]])
        turned = self.crank * np.exp(1j * (theta + self.phase))
        t = np.stack([turned * 1j**k for k in range(order + 1)])
        t[0] += self.centre
        return t

    def pitch(self, angle: ArrayLike, order: int = 2) -> Complex:
        """Centre line of the slot in the driven link's axes with derivatives (order + 1, n)."""
        theta = numbers(angle)
        t, q = self.pin(theta, order), self.law(theta, order)
        return jets.jet_product(jets.exponential(-1j * q), t) if self.turns else t - 1j * q

    def normal(self, angle: ArrayLike) -> Complex:
        """Unit normal of the slot to the left of the pin's travel, in the driven link's axes (n)."""
        theta = numbers(angle)
        t, q = self.pin(theta, 1), self.law(theta, 1)
        d = np.exp(-1j * q[0]) * (t[1] - 1j * q[1] * t[0]) if self.turns else t[1] - 1j * q[1]
        return cast(Complex, 1j * d / np.abs(d))

    def flank(self, angle: ArrayLike, side: int = 1) -> Complex:
        """Flank of the slot to the left (1) or right (-1) of the pin's travel, in the driven link's axes (n)."""
        return np.asarray(self.pitch(angle, 0)[0] + side * self.radius * self.normal(angle))

    def flank_radius(self, angle: ArrayLike, side: int = 1) -> Real:
        """Radius of curvature of a flank (n) [m], positive where the link's material on that side is convex.

        The centre line's radius (positive when it bends towards that side) less the roller's; undercut where the centre line bends
        towards the side and this is negative.
        """
        d = self.pitch(angle, 2)
        with np.errstate(divide="ignore"):
            rho = np.abs(d[1]) ** 3 / np.imag(np.conj(d[1]) * d[2])
        return np.asarray(side * rho - self.radius)

    def pressure_angle(self, angle: ArrayLike) -> Real:
        """Angle between the slot's normal and the motion of the driven link at the pin (n) [rad], 0 ... pi/2."""
        theta = numbers(angle)
        q = self.law(theta, 0)[0]
        if self.turns:
            n, away = np.exp(1j * q) * self.normal(theta), 1j * self.pin(theta, 0)[0]
        else:
            n, away = self.normal(theta), np.full(theta.shape, 1j)
        return np.asarray(np.arccos(np.clip(np.abs(np.real(np.conj(n) * away)) / np.abs(away), 0.0, 1.0)))
