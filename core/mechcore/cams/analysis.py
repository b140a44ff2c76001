"""Analysis of given profiles: how any follower moves, exactly.

Where the follower touches is found globally (`mechcore.cams.contact`); velocity, acceleration and jerk follow from the contact
conditions differentiated order by order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Flags, Index, Real, numbers
from mechcore.cams.contact import SAMPLES_AROUND, Task, locate_contact
from mechcore.cams.contour import Contour
from mechcore.cams.followers import Flat, Follower
from mechcore.numerics import jets
from mechcore.records import dataclass


@dataclass(frozen=True)
class Bridge:
    """The contact leaps over a part of the profile that the follower never touches (hollow too tight, undercut), or a knife
    passes a corner (it leaves and lands at one place).

    ``angle``: when; ``leaves``, ``lands``: parameters of the contour; ``velocity``: derivative of the coordinate before and after.
    """

    angle: float
    leaves: float
    lands: float
    velocity: tuple[float, float]

    @property
    def shock(self) -> bool:
        """The velocity jumps: the follower is knocked."""
        a, b = self.velocity
        return abs(b - a) > 1e-6 * (abs(a) + abs(b))


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact over angles (n). ``motion`` (4, n): the coordinate and three derivatives with respect to the angle, NaN where the
    follower does not reach the cam. ``parameter``: of the contour; ``corner``: on a corner of the profile. ``point``, ``normal``:
    in the cam's axes; ``radius``: of the profile, positive convex, 0 on a corner.
    """

    angle: Real
    motion: Real
    parameter: Real
    corner: Flags
    point: Complex
    normal: Complex
    radius: Real
    bridges: tuple[Bridge, ...]

    @property
    def lost(self) -> Flags:
        """Angles at which the follower touches nothing."""
        return np.asarray(np.isnan(self.motion[0]))


def analyse(
    contour: Contour,
    follower: Follower,
    angles: ArrayLike,
    turn: int = 1,
    wedge: bool = False,
    samples: int = 1024,
    bridges: bool = True,
    near: Contact | None = None,
) -> Contact:
    """Angles (n) of the cam (lengths of a wedge) -> contact and motion of the follower. Ordered angles give the bridges too.

    ``samples``: points of the whole contour that are compared at each angle; a bump narrower than the distance of two is missed.
    ``near``: contacts at ascending angles that enclose these, found with as many samples: where those before and after are close
    together, the contact is searched for between them only.
    """
    task = Task(contour, follower, turn, wedge)
    angle = numbers(angles)
    each = max(samples // contour.count, 9)
    piece, u, q, corner = locate_contact(task, angle, each, None if near is None else _between(near, angle, contour.count, each))
    derived = _differentiate(task, angle, piece, u, q, corner)
    spans: tuple[Bridge, ...] = ()
    if bridges and angle.size > 2 and np.all(np.diff(angle) > 0.0):
        spans = tuple(_bridges(task, derived, each))
    return Contact(angle, derived.motion, derived.parameter, corner, derived.point, derived.normal, derived.radius, spans)


def _between(near: Contact, angle: Real, count: int, each: int) -> Index:
    """Sample of the contour in the middle between the contacts before and after each angle; -1 where these lie far apart."""
    k = np.clip(np.searchsorted(near.angle, angle), 1, near.angle.size - 1)
    piece = np.minimum(near.parameter.astype(int), count - 1)
    sample = piece * each + np.rint((near.parameter - piece) * (each - 1)).astype(int)
    whole = count * each
    step = (sample[k] - sample[k - 1] + whole // 2) % whole - whole // 2
    return np.where(np.abs(step) < SAMPLES_AROUND, (sample[k - 1] + step // 2) % whole, -1)


# --- derivatives --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Found:
    angle: Real
    motion: Real
    parameter: Real
    point: Complex
    normal: Complex
    radius: Real
    rate: Real  # how fast the contact moves along the profile [m per unit of angle]


def _differentiate(task: Task, angle: Real, piece: Index, u: Real, q: Real, corner: Flags, order: int = 3) -> _Found:
    """Contact conditions differentiated along the motion: unknown derivatives of parameter and coordinate, one order after
    another."""
    n = angle.size
    motion = np.full((order + 1, n), np.nan)
    t = np.zeros((order + 1, n))
    live = np.isfinite(q)
    motion[0], t[0] = q, u
    distance = task.follower.radius
    curve = np.zeros((order + 1, n), complex)
    base = task.contour.on(piece, u, 2)
    flat = isinstance(task.follower.face, Flat)
    smooth = live & ~corner
    with np.errstate(all="ignore"):
        for mask, fixed in ((smooth, False), (live & corner, True)):
            if not mask.any():
                continue
            m = np.flatnonzero(mask)
            c = (
                np.concatenate([base[:1, m], np.zeros((order, m.size))])
                if fixed
                else task.contour.on(piece[m], u[m], order + (1 if flat else 0), 0.0 if flat else distance)
            )
            curve[: order + 1, m] = c[: order + 1]
            tm, qm = _orders(task, angle[m], c, t[:, m], motion[:, m], fixed, order)
            t[:, m], motion[:, m] = tm, qm
        d = base[1]
        size = np.abs(d)
        normal = -1j * d / size
        radius = size**3 / np.imag(np.conj(d) * base[2])
        radius = np.where(np.isnan(radius), np.inf, radius)
        if corner.any():
            z = task.ground(base[0], angle)
            back = np.ones(n) if task.wedge else np.exp(-1j * task.turn * angle)
            normal = np.where(corner, task.touch_normal(z, q) * back, normal)
            radius = np.where(corner, 0.0, radius)
    lost = ~live
    point = np.where(lost, np.nan, base[0])
    return _Found(
        angle,
        motion,
        np.where(lost, np.nan, piece + u),
        point,
        np.where(lost, np.nan, normal),
        np.where(lost, np.nan, radius),
        np.where(corner, 0.0, size * np.abs(t[1])),
    )


def _orders(task: Task, angle: Real, c: Complex, t: Real, q: Real, fixed: bool, order: int) -> tuple[Real, Real]:
    t, q = t.copy(), q.copy()
    t[1:], q[1:] = 0.0, 0.0
    plain = _residual(task, angle, c, t[:2], q[:2], fixed)
    columns = []
    for which in (0, 1):
        tt, qq = t[:2].copy(), q[:2].copy()
        (tt, qq)[which][1] = 1.0
        columns.append([r[1] - p[1] for r, p in zip(_residual(task, angle, c, tt, qq, fixed), plain, strict=True)])
    for k in range(1, order + 1):
        rest = [r[k] for r in _residual(task, angle, c, t[: k + 1], q[: k + 1], fixed)]
        if fixed:
            q[k] = -rest[0] / columns[1][0]
            continue
        (a, b), (e, f) = columns
        det = a * f - b * e
        t[k] = -(rest[0] * f - rest[1] * e) / det
        q[k] = -(rest[1] * a - rest[0] * b) / det
    return t, q


def _residual(task: Task, angle: Real, c: Complex, t: Real, q: Real, fixed: bool) -> list[Real]:
    """Contact conditions with derivatives (k, n): two of a smooth contact, one of a corner."""
    k = len(t)
    follower = task.follower
    place = c[:k] if fixed else jets.compose(c[:k], t)
    z = task.carried(place, angle)
    reference = follower.reference(q)
    distance = z - reference
    if isinstance(follower.face, Flat):
        turn = follower.guide.turning(q)
        turn = np.concatenate([np.zeros_like(turn[:1]), turn[1:]])
        d = jets.exponential(1j * turn) * follower.face_direction(q[0])
        first = jets.jet_cross(d, distance)
        if fixed:
            return [first]
        tangent = jets.compose(c[1 : k + 1], t)
        if not task.wedge:
            tangent = jets.jet_product((1j * task.turn) ** np.arange(k)[:, None] * np.exp(1j * task.turn * angle), tangent)
        return [first, jets.jet_cross(d, tangent)]
    if fixed:  # constant distance from the corner
        return [jets.dot(distance, distance)]
    return [distance.real, distance.imag]


# --- bridges ------------------------------------------------------------------------------------------------------------------


def _bridges(task: Task, derived: _Found, each: int) -> list[Bridge]:
    """The leaps of the contact: steps along the profile that are far larger than the rates on either side explain."""
    z, rate, angle = derived.point, derived.rate, derived.angle
    step = np.abs(np.diff(z))
    allowed = 4.0 * np.fmax(rate[1:], rate[:-1]) * np.diff(angle) + 1e-6 * task.contour.size
    out = _knife_corners(task, derived, each)
    for k in np.flatnonzero(step > allowed):
        a, b = float(angle[k]), float(angle[k + 1])
        za, zb = z[k], z[k + 1]
        for _ in range(46):
            middle = 0.5 * (a + b)
            piece, u, q, _corner = locate_contact(task, np.array([middle]), each)
            if np.isnan(q[0]):
                break
            zm = task.contour.on(piece, u, 0)[0, 0]
            if abs(zm - za) <= abs(zm - zb):
                a, za = middle, zm
            else:
                b, zb = middle, zm
            if b - a < 1e-13:
                break
        if abs(zb - za) < 1e-4 * step[k]:
            continue  # a fast movement, no leap
        ends = []
        for x in (a, b):
            located = locate_contact(task, np.array([x]), each)
            f = _differentiate(task, np.array([x]), *located, order=1)
            ends.append((float(f.parameter[0]), float(f.motion[1, 0])))
        out.append(Bridge(float(0.5 * (a + b)), ends[0][0], ends[1][0], (ends[0][1], ends[1][1])))
    return sorted(out, key=lambda b: b.angle)


def _knife_corners(task: Task, derived: _Found, each: int) -> list[Bridge]:
    """A knife passes a corner: its velocity jumps although the contact does not leap. The angle is found by bisection."""
    if isinstance(task.follower.face, Flat) or task.follower.radius > 0.0:
        return []
    out: list[Bridge] = []
    count, sharp = task.contour.count, task.contour.sharp_joints
    piece = np.clip(np.floor(np.nan_to_num(derived.parameter)), 0, count - 1).astype(int)
    ahead, back = (piece[:-1] + 1) % count == piece[1:], piece[:-1] == (piece[1:] + 1) % count
    joint = np.where(ahead, piece[1:], piece[:-1])
    both = np.isfinite(derived.parameter[1:]) & np.isfinite(derived.parameter[:-1])
    for k in np.flatnonzero((piece[1:] != piece[:-1]) & (ahead | back) & sharp[joint] & both):
        a, b = float(derived.angle[k]), float(derived.angle[k + 1])
        for _ in range(50):
            middle = 0.5 * (a + b)
            on = locate_contact(task, np.array([middle]), each)[0][0]
            a, b = (middle, b) if on == piece[k] else (a, middle)
        ends = []
        for x in (a, b):
            f = _differentiate(task, np.array([x]), *locate_contact(task, np.array([x]), each), order=1)
            ends.append((float(f.parameter[0]), float(f.motion[1, 0])))
        out.append(Bridge(float(0.5 * (a + b)), ends[0][0], ends[1][0], (ends[0][1], ends[1][1])))
    return out
