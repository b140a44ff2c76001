"""Given profiles in mechanisms: the lift that a profile gives to its follower, as a law with exact derivatives at its knots.

Between the angles at which the contact passes a joint of the profile's pieces, or leaps over a part that it never touches, the lift
is analytic. There it is interpolated by polynomials of degree seven through the exact value and three derivatives
(``analyse``) at every knot (Hermite interpolation): its error is far below 1e-9 of the profile's size.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..errors import Fault, MechanismError
from ..laws.curve import MotionCurve, Piece
from ..texts import as_angle
from .analysis import Bridge, Contact, analyse
from .contour import Contour
from .followers import Flat, Follower, Oscillating, Translating

__all__ = ["GivenLift", "joint_angles", "lift_of"]

Real = NDArray[np.float64]

STEP = np.radians(2.0)  # between the knots
GRID = 1440  # angles at which leaps of the contact are looked for
ROUNDS = 6  # of halving ranges whose middle is not met
FINE, FINE_SECOND = 1e-12, 1e-8  # misses there that are left, in parts of the largest coordinate and second derivative
_SECOND = np.array([2.0, 6.0, 12.0, 20.0, 30.0, 42.0])
INSIDE = 1e-6  # how far inside of a range its one-sided derivatives are taken [rad], carried to the end by Taylor's series


@dataclass(frozen=True, eq=False)
class GivenLift:
    """The follower's absolute coordinate over a turn, where the contact leaps, and the ends of the ranges without joint or leap."""

    law: MotionCurve
    bridges: tuple[Bridge, ...]
    ends: tuple[float, ...]


def lift_of(contour: Contour, follower: Follower, turn: int = 1) -> GivenLift:
    """The lift of a closed profile in its cam's axes, the cam turning by ``turn * theta``.

    Raises where the follower does not reach the profile, or where the profile does not enclose the cam's axis.
    """
    if not contour.closed:
        raise MechanismError(Fault("cam.profile", "an outline that is not closed.", "Close it."))
    grid = 2.0 * np.pi * np.arange(GRID + 1) / GRID
    seen = analyse(contour, follower, grid, turn)
    if seen.lost.any():
        at = as_angle(grid[int(np.argmax(seen.lost))])
        raise MechanismError(
            Fault("cam.profile", f"at {at} the follower does not reach the profile.", "Check its offset, pivot and arm.")
        )
    leaps = [b.angle for b in seen.bridges]
    knots = np.concatenate([[0.0, 2.0 * np.pi], np.asarray(leaps, float), joint_angles(contour, follower, turn)])
    knots = np.sort(knots[(knots >= 0.0) & (knots <= 2.0 * np.pi)])
    knots = knots[np.concatenate([[True], np.diff(knots) > 1e-9])]
    knots[-1] = 2.0 * np.pi
    fine = [np.linspace(a, b, max(int(np.ceil((b - a) / STEP)), 1) + 1)[:-1] for a, b in pairwise(knots)]
    x = np.append(np.concatenate(fine), 2.0 * np.pi)
    low, high = x[:-1], x[1:]
    done: list[tuple[Real, Real, Real]] = []
    for k in range(ROUNDS):
        table = _fitted(contour, follower, turn, low, high, seen)
        if k + 1 == ROUNDS:
            done.append((low, high, table))
            break
        middle = 0.5 * (low + high)
        wanted = analyse(contour, follower, middle, turn, bridges=False, near=seen).motion
        if k == 0:
            sizes = np.abs(wanted).max(axis=1)
        u = (0.5 * (high - low)) ** np.arange(8)[:, None]
        value, second = (table * u).sum(axis=0), (_SECOND[:, None] * table[2:] * u[:6]).sum(axis=0)
        good = (np.abs(value - wanted[0]) < FINE * sizes[0]) & (np.abs(second - wanted[2]) < FINE_SECOND * sizes[2])
        done.append((low[good], high[good], table[:, good]))
        if good.all():
            break
        a, b, c = low[~good], middle[~good], high[~good]
        low, high = np.concatenate([a, b]), np.concatenate([b, c])
    low, high = (np.concatenate([d[k] for d in done]) for k in (0, 1))
    table = np.concatenate([d[2] for d in done], axis=1)
    order = np.argsort(low)
    pieces = tuple(Piece(float(high[k] - low[k]), table[:, k].copy(), np.zeros((0, 3))) for k in order)
    return GivenLift(MotionCurve(pieces, 0.0, True), seen.bridges, tuple(knots.tolist()))


def _fitted(contour: Contour, follower: Follower, turn: int, low: Real, high: Real, seen: Contact) -> Real:
    """Coefficients (8, n) of the lift over ranges of angles (n) without a joint or a leap inside."""
    inside = np.minimum(INSIDE, 0.25 * (high - low))
    states = []
    for angle, shift in ((low + inside, -inside), (high - inside, inside)):
        m = analyse(contour, follower, angle, turn, bridges=False, near=seen).motion
        if not np.isfinite(m).all():
            at = as_angle(angle[int(np.argmax(~np.isfinite(m).all(axis=0)))])
            raise MechanismError(
                Fault("cam.profile", f"no contact can be found at {at}.", "Smooth the profile there, or move the follower.")
            )
        states.append(_carried(m, shift))
    return _septic(states[0], states[1], high - low)


def _carried(m: Real, dx: Real) -> Real:
    """Value and three derivatives (4, n) a little further, by Taylor's series."""
    s, v, a, j = m
    return np.stack([s + dx * (v + dx * (a / 2.0 + dx * j / 6.0)), v + dx * (a + dx * j / 2.0), a + dx * j, j])


def _septic(left: Real, right: Real, h: Real) -> Real:
    """Coefficients (8, n) in ascending powers of x through value and three derivatives at 0 and ``h`` (n)."""
    low = left / np.array([1.0, 1.0, 2.0, 6.0])[:, None]
    n = np.arange(8)
    rows = np.array([[np.prod(np.arange(p, p - d, -1)) if p >= d else 0.0 for p in n] for d in range(4)], float)  # at u = 1
    u_left = low * h ** np.arange(4)[:, None]
    target = right * h ** np.arange(4)[:, None] - rows[:, :4] @ u_left
    high = np.linalg.solve(rows[:, 4:], target)
    return np.concatenate([low, high / h ** np.arange(4, 8)[:, None]])


def joint_angles(contour: Contour, follower: Follower, turn: int = 1) -> Real:
    """Angles of the cam within a turn at which the contact can pass a joint of the profile, from either side; in closed form.

    In the cam's axes the follower's reference point lies on the offset of the joint along the normal of either piece; the
    cam's angle is where the turned guide passes through it: cos(angle + a) = k.
    """
    guide, face, r = follower.guide, follower.face, follower.radius
    found: list[float] = []
    for k in range(contour.count):
        for piece, end in ((contour.pieces[k - 1], 1.0), (contour.pieces[k], 0.0)):
            z, d = piece(np.array([end]), 1)[:, 0]
            normal = -1j * d / abs(d)
            if isinstance(face, Flat):
                if isinstance(guide, Translating):
                    up = 1j * np.exp(1j * face.tilt)
                    found.append(float(np.angle(up / normal)) * turn)
                    continue
                assert isinstance(guide, Oscillating)
                # distance of the pivot from the tangent: n . (joint - pivot e^{-i turn theta}) is that of the face from the pivot
                sine, cosine = np.sin(face.tilt), np.cos(face.tilt)
                lever = guide.side * guide.arm * sine - face.shift * cosine
                target = float(np.real(np.conj(normal) * z)) + lever
                size, lean = abs(guide.pivot), float(np.angle(guide.pivot / normal))
            else:
                p = z + r * normal
                if isinstance(guide, Translating):
                    size, lean, target = abs(p), -float(np.angle(p)), guide.offset
                else:
                    size, lean = 1.0, float(np.angle(guide.pivot / p)) if p != 0.0 else 0.0
                    q = 2.0 * abs(p) * abs(guide.pivot)
                    target = (abs(p) ** 2 + abs(guide.pivot) ** 2 - guide.arm**2) / q if q else 2.0
            if size > 0.0 and abs(target) <= size:  # cos(lean - turn theta) = target/size
                swing = float(np.arccos(target / size))
                found += [turn * (lean - swing), turn * (lean + swing)]
    return np.mod(np.array(found), 2.0 * np.pi)
