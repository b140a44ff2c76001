"""The equivalent linkage: the higher pair of cam and follower replaced by two lower pairs at the centres of curvature.

At one position the link from the cam's centre of curvature K to the follower's reference point T has the same velocities and
accelerations as the cam (not the same jerk). Where the cam is straight K goes to infinity and a sliding joint takes its
place; under a flat face the link is a block on the face that is pivoted at K.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Real
from mechcore.cams.followers import Flat, Oscillating
from mechcore.cams.synthesis import Synthesis
from mechcore.laws.curve import MotionCurve


@dataclass(frozen=True, eq=False)
class EquivalentLinkage:
    """Arrays (n). ``centre``: K in ground axes (NaN where at infinity), ``crank`` = |OK|, ``coupler`` = signed |KT| (radius of
    curvature), ``coupler_rate``, ``coupler_acceleration``: of the coupler's angle (0 for a block on a flat face: that of the
    face), ``rate``,
    ``acceleration``: of the follower's coordinate, all with respect to the cam's angle (times w, w^2 in time).
    """

    centre: Complex
    crank: Real
    coupler: Real
    coupler_rate: Real
    coupler_acceleration: Real
    rate: Real
    acceleration: Real


def equivalent_linkage(s: Synthesis, straight: float = 1e9) -> EquivalentLinkage:
    """The linkage and its motion, solved as a linkage from the geometry alone (K, T and the guide; not from the law's derivatives).

    ``straight``: radii larger than this many times the distance of the reference point count as straight.
    """
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
    endless = ~(np.abs(rho) < straight * (np.abs(t) + 1e-300))
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
        bend = by_qq * q1**2 + 2j * turning * q1 * u1 * d - (turning * q1) ** 2 * (along * d + arm)
        q2, _ = _solve(a, d, k2 - bend)
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
