"""Synthesis of plane cams: pitch curve and working curve from a law and a follower, exactly, with derivatives.

Conventions (theory of the lecture, corrected): the cam turns counter-clockwise by theta about O, the cam's axes coincide with the
ground's at theta = 0, so that a ground point q is the cam point exp(-i theta) q; ``turn = -1`` is a cam that turns clockwise by
theta. A wedge moves by -x along the x axis, so that x is its length under the follower. Normals point from the cam to the follower;
radii of curvature are positive where the cam is convex.

Formulas by kinematic inversion: the derivatives of the pitch curve in rotated axes are those of the reference point plus those
of the turning frame; the working curve is the offset by the roller's radius, or the envelope of the face's lines.

The equivalent linkage replaces the higher pair of cam and follower by two lower pairs at the centres of curvature. At one position
the link from the cam's centre of curvature K to the follower's reference point T has the same velocities and accelerations as the
cam (not the same jerk). Where the cam is straight K goes to infinity and a sliding joint takes its place; under a flat face the
link is a block on the face that is pivoted at K.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Flags, Index, Real, numbers
from mechcore.cams.followers import Arc, Flat, Follower, Oscillating, Translating
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve, Side
from mechcore.numerics import jets
from mechcore.numerics.frames import keep_freed_memory
from mechcore.records import dataclass
from mechcore.texts import as_length

STRAIGHT = 1e9  # distances of the reference point: larger radii of curvature count as straight


@dataclass(frozen=True, eq=False)
class Synthesis:
    """A cam evaluated at angles (n). Values are computed on first access; all arrays are (n) unless stated otherwise."""

    cam: Cam
    angle: Real  # theta [rad], or x [m] of a wedge
    motion: Real  # (k, n): the follower's coordinate and its derivatives with respect to the angle

    @cached_property
    def _frame(self) -> Complex:
        """Unit numbers that turn ground axes into the cam's."""
        if self.cam.wedge:
            return np.ones(self.angle.shape, complex)
        out = np.empty(self.angle.shape, complex)
        np.cos(self.angle, out=out.real)
        np.sin(self.angle, out=out.imag)
        if self.cam.turn > 0:
            np.negative(out.imag, out=out.imag)
        return out

    @cached_property
    def reference(self) -> Complex:
        """The follower's reference point and its derivatives in ground axes (k, n)."""
        return self.cam.follower.reference(self.motion)

    @cached_property
    def _d1(self) -> Complex:
        """First derivative of the pitch curve, in ground axes."""
        t = self.reference
        return cast(Complex, t[1] + 1.0 if self.cam.wedge else t[1] - 1j * self.cam.turn * t[0])

    @cached_property
    def _d2(self) -> Complex:
        t = self.reference
        return np.asarray(t[2] if self.cam.wedge else t[2] - (2j * self.cam.turn) * t[1] - t[0])

    @cached_property
    def _speed(self) -> Real:
        d = self._d1
        return np.sqrt(d.real**2 + d.imag**2)

    @cached_property
    def _resting(self) -> Flags | None:
        """Where the pitch curve is a point (a knife that dwells on O): no normal, no pressure angle. None: nowhere."""
        s = self._speed
        least = 1e-13 * float(s.max())
        return s <= least if float(s.min()) <= least else None

    @cached_property
    def _normal(self) -> Complex:
        """Unit normal from the cam to the follower, ground axes."""
        if isinstance(self.cam.follower.face, Flat):
            return 1j * self.cam.follower.face_direction(self.motion[0])
        with np.errstate(invalid="ignore"):  # no direction where the pitch curve rests
            return (1j * self.cam.turn) * self._d1 / self._speed

    @cached_property
    def _face(self) -> tuple[Complex, Real, Real]:
        """Flat face: direction, distance of the contact along it from the reference point, how fast the cam turns under it."""
        d = self.cam.follower.face_direction(self.motion[0])
        rate = self.cam.turn - self.cam.follower.guide.turning(self.motion)[1] if not self.cam.wedge else (
            -self.cam.follower.guide.turning(self.motion)[1]
        )  # fmt: skip
        with np.errstate(divide="ignore", invalid="ignore"):
            return d, np.imag(np.conj(d) * self._d1) / rate, rate

    # -- curves in the cam's own axes ---------------------------------------------------------------------------------

    @cached_property
    def pitch(self) -> Complex:
        """Path of the reference point in the cam's axes [m]."""
        t = self.reference[0]
        return np.asarray(t + self.angle if self.cam.wedge else self._frame * t)

    @cached_property
    def normal(self) -> Complex:
        """Outward normal, a unit vector, of the working curve in the cam's axes."""
        return self._frame * self._normal

    @property
    def ground_normal(self) -> Complex:
        """Normal from the cam to the follower in ground axes, a unit vector."""
        return self._normal

    @cached_property
    def working(self) -> Complex:
        """The profile in the cam's axes [m]."""
        if isinstance(self.cam.follower.face, Flat):
            d, along, _ = self._face
            return self.pitch + self._frame * (along * d)
        r = self.cam.follower.radius
        return self.pitch if r == 0.0 else self.pitch - self.cam.flank * r * self.normal

    @cached_property
    def contact(self) -> Complex:
        """The touching point in ground axes [m]."""
        if isinstance(self.cam.follower.face, Flat):
            d, along, _ = self._face
            return cast(Complex, self.reference[0] + along * d)
        return cast(Complex, self.reference[0] - self.cam.flank * self.cam.follower.radius * self._normal)

    # -- design quantities --------------------------------------------------------------------------------------------

    @cached_property
    def pressure_angle(self) -> Real:
        """Signed angle from the direction in which the follower moves to the normal [rad]; theory: tan alpha = (h' - e)/h."""
        guide, n = self.cam.follower.guide, self._normal
        if isinstance(guide, Translating):
            if not isinstance(self.cam.follower.face, Flat):
                d = self._d1 if self.cam.turn > 0 else -self._d1
                alpha = np.arctan2(d.imag, d.real)
                return alpha if self._resting is None else np.where(self._resting, np.nan, alpha)
            return np.arctan2(-n.real, n.imag)
        point = self.contact if isinstance(self.cam.follower.face, Flat) else self.reference[0]
        ratio = n * np.conj(guide.away(point))
        return np.arctan2(ratio.imag, ratio.real)

    @cached_property
    def pitch_radius(self) -> Real:
        """Radius of curvature of the pitch curve [m]; infinite where it is straight. For flat faces it is that of the profile."""
        if isinstance(self.cam.follower.face, Flat):
            return self.radius
        a, b = self._d1, self._d2
        s = self._speed
        with np.errstate(divide="ignore", invalid="ignore"):
            rho = -self.cam.turn * (s * s * s) / (a.real * b.imag - a.imag * b.real)
        return rho if self._resting is None else np.where(self._resting, 0.0, rho)

    @cached_property
    def radius(self) -> Real:
        """Radius of curvature of the working curve [m], positive where the cam is convex, zero at a cusp."""
        if not isinstance(self.cam.follower.face, Flat):
            return self.cam.flank * (self.pitch_radius - self.cam.flank * self.cam.follower.radius)
        d, along, rate = self._face
        t, turning = self.reference, self.cam.follower.guide.turning(self.motion)
        e = t[2] if self.cam.wedge else t[2] - 1j * self.cam.turn * t[1]
        run = np.real(np.conj(d) * self._d1)
        with np.errstate(divide="ignore", invalid="ignore"):
            shift = (np.imag(np.conj(d) * e) - turning[1] * run + along * turning[2]) / rate
            return np.asarray((run + shift) / rate)

    @cached_property
    def distance(self) -> Real:
        """Flat faces: pressure distance, of the contact from the reference point along the face [m] (theory: h' - e); else NaN."""
        if isinstance(self.cam.follower.face, Flat):
            return self._face[1]
        return np.full(self.angle.shape, np.nan)

    @cached_property
    def sharpness(self) -> Real:
        """Regularity of the working curve, dimensionless: 1 where the profile follows the pitch curve, 0 at a cusp, negative where
        undercut.

        1 - r/rho for round faces (finite where rho is infinite); for a flat face its radius over the face's distance from O.
        """
        if isinstance(self.cam.follower.face, Flat):
            height = np.abs(np.imag(np.conj(self._face[0]) * self.reference[0]))
            return np.asarray(self.radius / np.maximum(height, 1e-300))
        r = self.cam.flank * self.cam.follower.radius
        if r == 0.0:
            return np.ones(self.angle.shape)
        with np.errstate(divide="ignore"):
            return 1.0 - r / self.pitch_radius


@dataclass(frozen=True, eq=False)
class Cam:
    """A plane cam by its law: the follower's coordinate (height, or angle of the arm) over the cam's angle or length.

    ``law`` has the absolute coordinate, base included (see ``cam_on_base``). ``turn``: 1 counter-clockwise, -1 clockwise.
    ``wedge``: the cam translates. ``outer``: the roller runs inside the cam's material, on the far flank of a groove or in a
    ring: the profile is the outer offset of the pitch curve.
    """

    law: MotionCurve
    follower: Follower
    turn: int = 1
    wedge: bool = False
    outer: bool = False

    def __post_init__(self) -> None:
        if self.turn not in (1, -1):
            raise MechanismError(Fault("cam.turn", f"{self.turn}", "Give 1 (counter-clockwise) or -1."))
        if self.wedge and self.turn != 1:
            raise MechanismError(Fault("cam.turn", "a wedge does not turn.", "Leave it out; mirror the law instead."))
        if self.outer and isinstance(self.follower.face, Flat | Arc):
            raise MechanismError(Fault("cam.outer", "a groove with a face that is no roller.", "Give a roller."))
        if self.wedge and isinstance(self.follower.face, Flat) and isinstance(self.follower.guide, Translating):
            raise MechanismError(
                Fault(
                    "cam.wedge", "a flat face that only translates slides on a wedge's highest point.", "Give a roller or a knife."
                )
            )

    @property
    def flank(self) -> float:
        """1: the profile lies inside the pitch curve; -1: outside."""
        return -1.0 if self.outer else 1.0

    @property
    def period(self) -> float:
        return self.law.length

    def at(self, angle: ArrayLike, side: Side = "right", order: int = 2, piece: Index | None = None) -> Synthesis:
        """Angles (n) -> the cam evaluated there. ``side``: which one-sided derivatives are taken at the law's knots; ``piece``
        (n): the pieces of the law that are evaluated, also beyond their ends."""
        keep_freed_memory()
        angle = numbers(angle)
        return Synthesis(self, angle, self._motion(angle, order, piece, side))

    def pitch_curve(self, angle: ArrayLike, order: int = 3, piece: Index | None = None) -> Complex:
        """The pitch curve and its derivatives with respect to the angle, (order + 1, n), in the cam's axes; ``piece``: as
        in ``at``."""
        angle = numbers(angle)
        return self._pitch(angle, self._motion(angle, order, piece))

    def _motion(self, angle: Real, order: int, piece: Index | None, side: Side = "right") -> Real:
        return self.law(angle, order, side) if piece is None else self.law.on_pieces(piece, angle, order)

    def _pitch(self, angle: Real, motion: Real) -> Complex:
        t = self.follower.reference(motion)
        return self._into_cam(t, angle)

    def _into_cam(self, t: Complex, angle: Real) -> Complex:
        """Ground vectors with derivatives -> the cam's axes (positions: of a wedge the shift too)."""
        if self.wedge:
            out = t.copy()
            out[0] += angle
            if len(out) > 1:
                out[1] += 1.0
            return out
        return jets.jet_product(self._frame(angle, len(t)), t)

    def _frame(self, angle: Real, n: int) -> Complex:
        if self.wedge:
            out = np.zeros((n, angle.size), complex)
            out[0] = 1.0
            return out
        return np.asarray((-1j * self.turn) ** np.arange(n)[:, None] * np.exp(-1j * self.turn * angle))

    def working_curve(self, angle: ArrayLike, order: int = 2, piece: Index | None = None) -> Complex:
        """The profile and its derivatives with respect to the angle, (order + 1, n), order <= 3, in the cam's axes; ``piece``: as
        in ``at``."""
        angle = numbers(angle)
        motion = self._motion(angle, order + 1, piece)
        follower = self.follower
        if not isinstance(follower.face, Flat):
            p = self._pitch(angle, motion)
            if follower.radius == 0.0:
                return p[: order + 1]
            n = 1j * self.turn * jets.unit(p[1:])
            return p[: order + 1] - self.flank * follower.radius * n
        phi = follower.guide.turning(motion)
        d = jets.exponential(1j * np.concatenate([np.zeros((1, angle.size)), phi[1:]])) * follower.face_direction(motion[0])
        t = follower.reference(motion)
        rate = -phi[1:]
        if not self.wedge:
            rate[0] += self.turn
        d1 = t[1:] - (0.0 if self.wedge else 1j * self.turn * t[:-1])
        if self.wedge:
            d1[0] += 1.0
        along = jets.quotient(jets.jet_cross(d[:-1], d1), rate)
        return self._into_cam(t[: order + 1] + jets.jet_product(along, d), angle)

    def raised(self, base: float) -> Cam:
        """The same cam with all coordinates larger by ``base``."""
        return replace(self, law=self.law.raised(base))


def cam_on_base(
    lift: MotionCurve,
    follower: Follower,
    base: float,
    turn: int = 1,
    outer: bool = False,
) -> Cam:
    """A disc cam from a lift program that starts at zero and the radius of its base circle [m] (of the profile, not the
    pitch curve)."""
    if not base >= 0.0:
        raise MechanismError(Fault("cam.base", f"a base circle of {as_length(base)}.", "Give a positive radius."))
    return Cam(lift.raised(follower.base_coordinate(base)), follower, turn, outer=outer)


@dataclass(frozen=True, eq=False)
class EquivalentLinkage:
    """The equivalent linkage and its motion, arrays (n). ``centre``: K in ground axes (NaN where at infinity), ``crank`` = |OK|,
    ``coupler`` = signed |KT| (radius of curvature), ``coupler_rate``, ``coupler_acceleration``: of the coupler's angle (of a block
    on a flat face: of the face's angle), ``rate``, ``acceleration``: of the follower's coordinate, all with respect to the cam's
    angle (times w, w^2 in time).
    """

    centre: Complex
    crank: Real
    coupler: Real
    coupler_rate: Real
    coupler_acceleration: Real
    rate: Real
    acceleration: Real


def equivalent_linkage(s: Synthesis) -> EquivalentLinkage:
    """The linkage and its motion, solved as a linkage from its geometry: K, T and the guide, not the law's derivatives."""
    cam, follower = s.cam, s.cam.follower
    t = s.reference[0]
    # how T moves with the coordinate
    if isinstance(follower.guide, Oscillating):
        by_q = -1j * follower.guide.side * (t - follower.guide.pivot)
        by_qq = -(t - follower.guide.pivot)
        turning = -float(follower.guide.side)
    else:
        by_q, by_qq, turning = np.full(t.shape, 1j), np.zeros(t.shape, complex), 0.0
    rho = s.pitch_radius
    flat = isinstance(follower.face, Flat)
    endless = ~(np.abs(rho) < STRAIGHT * (np.abs(t) + 1e-300))
    n = s._normal
    with np.errstate(invalid="ignore"):
        k = (s.contact if flat else t) - np.where(endless, np.nan, rho) * n
    k1 = np.full(t.shape, -1.0 + 0.0j) if cam.wedge else 1j * cam.turn * k
    k2 = np.zeros(t.shape, complex) if cam.wedge else -k
    zero = np.zeros(t.shape)
    if flat:
        d = follower.face_direction(s.motion[0])
        along, arm = s.distance, -rho * n
        # K = T + u d - rho n: unknown rates of q and u
        a = by_q + 1j * turning * (along * d + arm)
        q1, u1 = _solve(a, d, k1)
        centripetal = by_qq * q1**2 + 2j * turning * q1 * u1 * d - (turning * q1) ** 2 * (along * d + arm)
        q2, _ = _solve(a, d, k2 - centripetal)
        return EquivalentLinkage(k, np.abs(k), rho, turning * q1, turning * q2, q1, q2)
    arm = t - k
    # T = K + arm: unknown rates of q and of the coupler's angle
    q1, w1 = _solve(by_q, -1j * arm, k1)
    q2, w2 = _solve(by_q, -1j * arm, k2 - w1**2 * arm - by_qq * q1**2)
    if endless.any():
        tangent = -1j * n
        base1 = np.full(t.shape, -1.0 + 0.0j) if cam.wedge else 1j * cam.turn * t
        spin = 0.0 if cam.wedge else float(cam.turn)
        p1, u1 = _solve(by_q, -tangent, base1)
        acc = (zero if cam.wedge else -t) + 2j * spin * u1 * tangent - by_qq * p1**2
        p2, _ = _solve(by_q, -tangent, acc)
        q1, q2 = np.where(endless, p1, q1), np.where(endless, p2, q2)
        w1, w2 = np.where(endless, spin, w1), np.where(endless, 0.0, w2)
    return EquivalentLinkage(k, np.abs(k), np.where(endless, np.inf, rho), w1, w2, q1, q2)


def _solve(a: Complex, b: Complex, c: Complex) -> tuple[Real, Real]:
    """Real x, y with a x + b y = c."""
    with np.errstate(invalid="ignore", divide="ignore"):
        det = np.imag(np.conj(a) * b)
        return np.imag(np.conj(c) * b) / det, np.imag(np.conj(a) * c) / det


def neglected_phase(law: MotionCurve, offset: float, angle: ArrayLike) -> Real:
    """The phase atan(m/h) that the lecture neglects, at angles (n) [rad]."""
    return np.asarray(np.arctan2(offset, law(np.asarray(angle, float), 0)[0]))


@dataclass(frozen=True, eq=False)
class OffsetError:
    """Heights of the law and heights reached (n) with the simplified profile, and the largest difference with its angle."""

    wanted: Real
    obtained: Real
    largest: float
    angle: float


def simplified_offset_error(law: MotionCurve, offset: float, angle: ArrayLike) -> OffsetError:
    """Heights of a follower that really is offset by m, on the simplified profile mounted to be right at theta = 0.

    The point of polar angle psi is presented at theta = psi + atan(m/h(0)) - atan(m/h(psi)); psi is found by bisection. Heights
    reached are unchanged, the timing is not.
    """
    theta = numbers(angle)
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
