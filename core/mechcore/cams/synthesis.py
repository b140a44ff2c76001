"""Synthesis of plane cams: pitch curve and working curve from a law and a follower, exactly, with derivatives.

Conventions (theory of the lecture, corrected): the cam turns counter-clockwise by theta about O, the cam's axes coincide with the
ground's at theta = 0, so that a ground point q is the cam point exp(-i theta) q; ``turn = -1`` is a cam that turns clockwise
by theta.
A wedge moves by -x along the x axis, so that x is its length under the follower. Normals point from the cam to the
follower; radii of curvature are positive where the cam is convex.

Formulas by kinematic inversion: the derivatives of the pitch curve in rotated axes are those of the reference point plus those
of the turning frame; the working curve is the offset by the roller's radius, or the envelope of the face's lines.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Flags, Real
from mechcore.cams.followers import Arc, Flat, Follower, Translating
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve, Side
from mechcore.numerics import jets
from mechcore.texts import as_length


@dataclass(frozen=True, eq=False)
class Synthesis:
    """A cam evaluated at angles (n). Nothing is computed before it is asked for; all arrays are (n)."""

    cam: Cam
    angle: Real  # theta [rad], or x [m] of a wedge
    motion: Real  # (k, n): the follower's coordinate and its derivatives with respect to the angle

    @cached_property
    def _frame(self) -> Complex:
        """Turns ground axes into the cam's."""
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
        return t[1] + 1.0 if self.cam.wedge else t[1] - 1j * self.cam.turn * t[0]

    @cached_property
    def _d2(self) -> Complex:
        t = self.reference
        return t[2] if self.cam.wedge else t[2] - (2j * self.cam.turn) * t[1] - t[0]

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
        """Path of the reference point in the cam's axes."""
        t = self.reference[0]
        return t + self.angle if self.cam.wedge else self._frame * t

    @cached_property
    def normal(self) -> Complex:
        """Outward unit normal of the working curve in the cam's axes."""
        return self._frame * self._normal

    @property
    def ground_normal(self) -> Complex:
        """Unit normal from the cam to the follower in ground axes."""
        return self._normal

    @cached_property
    def working(self) -> Complex:
        """The profile in the cam's axes."""
        if isinstance(self.cam.follower.face, Flat):
            d, along, _ = self._face
            return self.pitch + self._frame * (along * d)
        r = self.cam.follower.radius
        return self.pitch if r == 0.0 else self.pitch - self.cam.flank * r * self.normal

    @cached_property
    def contact(self) -> Complex:
        """The touching point in ground axes."""
        if isinstance(self.cam.follower.face, Flat):
            d, along, _ = self._face
            return self.reference[0] + along * d
        return self.reference[0] - self.cam.flank * self.cam.follower.radius * self._normal

    # -- what a designer looks at -------------------------------------------------------------------------------------

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
        """Radius of curvature of the pitch curve [m]; infinite where it is straight. Flat faces have none: that of the profile."""
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
            return (run + shift) / rate

    @cached_property
    def distance(self) -> Real:
        """Flat faces: pressure distance, of the contact from the reference point along the face [m] (theory: h' - e); else NaN."""
        if isinstance(self.cam.follower.face, Flat):
            return self._face[1]
        return np.full(self.angle.shape, np.nan)

    @cached_property
    def sharpness(self) -> Real:
        """Regularity of the working curve: 1 where the profile follows the pitch curve, 0 at a cusp, negative where undercut.

        1 - r/rho for round faces (finite where rho is infinite); for a flat face its radius over the face's distance from O.
        """
        if isinstance(self.cam.follower.face, Flat):
            height = np.abs(np.imag(np.conj(self._face[0]) * self.reference[0]))
            return self.radius / np.maximum(height, 1e-300)
        r = self.cam.flank * self.cam.follower.radius
        if r == 0.0:
            return np.ones(self.angle.shape)
        with np.errstate(divide="ignore"):
            return 1.0 - r / self.pitch_radius

    def cutter_path(self, tool: float) -> Complex:
        """Centres of a milling cutter of radius ``tool`` [m] in the cam's axes: the working curve offset outwards."""
        return self.working + self.cam.flank * tool * self.normal


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

    def at(self, angle: ArrayLike, side: Side = "right", order: int = 2) -> Synthesis:
        """Angles (n) -> everything about the cam there. ``side``: which one-sided derivatives hold at the law's knots."""
        angle = np.atleast_1d(np.asarray(angle, float))
        return Synthesis(self, angle, self.law(angle, order, side))

    def pitch_curve(self, angle: ArrayLike, order: int = 3, side: Side = "right") -> Complex:
        """The pitch curve and its derivatives with respect to the angle, (order + 1, n), in the cam's axes."""
        angle = np.atleast_1d(np.asarray(angle, float))
        return self._pitch(angle, self.law(angle, order, side))

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
        return jets.product(self._frame(angle, len(t)), t)

    def _frame(self, angle: Real, n: int) -> Complex:
        if self.wedge:
            out = np.zeros((n, angle.size), complex)
            out[0] = 1.0
            return out
        return (-1j * self.turn) ** np.arange(n)[:, None] * np.exp(-1j * self.turn * angle)

    def working_curve(self, angle: ArrayLike, order: int = 2, side: Side = "right") -> Complex:
        """The profile and its derivatives with respect to the angle, (order + 1, n), order <= 3, in the cam's axes."""
        angle = np.atleast_1d(np.asarray(angle, float))
        motion = self.law(angle, order + 1, side)
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
        along = jets.quotient(jets.cross(d[:-1], d1), rate)
        return self._into_cam(t[: order + 1] + jets.product(along, d), angle)

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
