"""Analysis of given profiles: where any follower touches, found globally, and how it moves, exactly.

At every angle each point of the profile asks for a coordinate of the follower (the one at which the follower's face would touch it
coming from outside); the largest of them is the contact, wherever on the profile it lies: first contact wins. The
best samples are then refined to the tangency (or to the corner), and velocity, acceleration and jerk follow from the
contact conditions differentiated order by order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Flags, Index, Real
from mechcore.cams.contour import Contour
from mechcore.cams.followers import Arc, Flat, Follower, Translating
from mechcore.numerics import jets

THIN = 3.0  # distances of two samples below which the radius of a roller is small
NEAR_JOINT = 1e-9  # ends of two pieces nearer than this part of the contour are one point
AROUND = 12  # samples on either side of one about which the contact is known to lie
NEAR = 5e-15  # of a piece's range: roots are known to this; heights are level there, so that they are known to its square


@dataclass(frozen=True, eq=False)
class Task:
    contour: Contour
    follower: Follower
    turn: int
    wedge: bool

    # -- the cam's motion ---------------------------------------------------------------------------------------------

    def ground(self, z: Complex, angle: Real) -> Complex:
        return z - angle if self.wedge else z * np.exp(1j * self.turn * angle)

    def carried(self, c: Complex, angle: Real) -> Complex:
        """A point of the cam with derivatives (k, n) along the motion -> ground, with derivatives."""
        if self.wedge:
            out = c.copy()
            out[0] -= angle
            if len(out) > 1:
                out[1] -= 1.0
            return out
        frame = (1j * self.turn) ** np.arange(len(c))[:, None] * np.exp(1j * self.turn * angle)
        return jets.product(frame, c)

    # -- the coordinate that a point asks for -------------------------------------------------------------------------

    def height(self, z: Complex) -> Real:
        """Ground points -> the coordinate at which the face touches them from outside; -inf where it passes by."""
        guide, face = self.follower.guide, self.follower.face
        r = self.follower.radius
        with np.errstate(invalid="ignore", divide="ignore"):
            if isinstance(guide, Translating):
                if isinstance(face, Flat):
                    d = np.exp(1j * face.tilt)
                    q = np.imag(np.conj(d) * (z - guide.offset)) / np.cos(face.tilt)
                    if face.endless:
                        return np.where(np.isfinite(q), q, -np.inf)
                    return self._on_face(q, z, guide.offset + 1j * q, d)
                x = z.real - guide.offset
                q = z.imag + np.sqrt(r * r - x * x)
                q = np.where(self.on_arc(z, q), q, -np.inf)
                return np.where(np.isnan(q), -np.inf, q)
            w = (z - guide.pivot) / guide.home
            size, beta = np.abs(w), -guide.side * np.angle(w)
            if isinstance(face, Flat):
                lever = face.shift * np.cos(face.tilt) - guide.side * guide.arm * np.sin(face.tilt)
                q = beta + guide.side * face.tilt + np.arcsin(lever / size)
                if face.endless:
                    return np.where(np.isfinite(q), q, -np.inf)
                t = guide.pivot + (guide.arm + 1j * guide.side * face.shift) * guide.home * np.exp(-1j * guide.side * q)
                return self._on_face(q, z, t, self.follower.face_direction(q))
            c = (size**2 + guide.arm**2 - r * r) / (2.0 * size * guide.arm)
            q = beta + np.arccos(c)
            q = np.where(self.on_arc(z, q), q, -np.inf)
            return np.where(np.isnan(q), -np.inf, q)

    def on_arc(self, z: Complex, q: Real) -> Flags | bool:
        """Whether ground points that a mushroom of coordinate ``q`` touches lie on its arc."""
        guide, face = self.follower.guide, self.follower.face
        if not isinstance(face, Arc) or face.half_angle >= np.pi:
            return True
        if isinstance(guide, Translating):
            down, centre = -1j + 0.0 * q, guide.offset + 1j * q
        else:
            way = guide.home * np.exp(-1j * guide.side * q)
            down, centre = 1j * guide.side * way, guide.pivot + guide.arm * way
        return np.asarray(np.abs(np.angle((z - centre) / down)) <= face.half_angle)

    def _on_face(self, q: Real, z: Complex, t: Complex, d: Complex | complex) -> Real:
        face = self.follower.face
        assert isinstance(face, Flat)
        along = np.real(np.conj(d) * (z - t))
        good = (along >= -face.left) & (along <= face.right) & np.isfinite(q)
        return np.where(good, q, -np.inf)

    def touch_normal(self, z: Complex, q: Real) -> Complex:
        """Direction from a touched ground point to the follower (n)."""
        if isinstance(self.follower.face, Flat):
            return 1j * self.follower.face_direction(q)
        t = self.follower.reference(q[None])[0]
        return np.asarray((t - z) / self.follower.radius)

    def knife_gap(self, z: Complex) -> Real:
        """Signed distance of ground points from the path of a knife's tip."""
        guide = self.follower.guide
        return z.real - guide.offset if isinstance(guide, Translating) else np.abs(z - guide.pivot) - guide.arm

    def knife_height(self, z: Complex) -> Real:
        guide = self.follower.guide
        if isinstance(guide, Translating):
            return z.imag
        return -guide.side * np.angle((z - guide.pivot) / guide.home)


def root(f: Callable[[Real, Index], Real], a: Real, b: Real, fa: Real, fb: Real, live: Flags) -> tuple[Real, Real]:
    """Roots of many functions between ``a`` and ``b`` (n), where their values ``fa``, ``fb`` have opposite signs, and values there.

    ``f`` takes places and the indices of the functions that they belong to. Inverse quadratic interpolation where it is safe, else
    bisection (T. R. Chandrupatla, Advances in Engineering Software 28, 1997). Where not ``live``: the better end.
    """
    a, b, fa, fb = a.copy(), b.copy(), fa.copy(), fb.copy()
    c, fc = a.copy(), fa.copy()
    t = np.full(a.size, 0.5)
    m = np.flatnonzero(live & (fa != 0.0) & (fb != 0.0))
    for _ in range(60):
        if not m.size:
            break
        x = a[m] + t[m] * (b[m] - a[m])
        fx = f(x, m)
        same = (fx > 0.0) == (fa[m] > 0.0)
        keep, swap = m[same], m[~same]
        c[keep], fc[keep] = a[keep], fa[keep]
        c[swap], fc[swap] = b[swap], fb[swap]
        b[swap], fb[swap] = a[swap], fa[swap]
        a[m], fa[m] = x, fx
        best = np.where(np.abs(fa[m]) < np.abs(fb[m]), a[m], b[m])
        width = np.abs(b[m] - a[m])
        least = 4e-16 * np.abs(best) + NEAR
        m, width, least = (v[(width > 2.0 * least) & (fa[m] != 0.0)] for v in (m, width, least))
        with np.errstate(all="ignore"):
            p, q, r = fa[m], fb[m], fc[m]
            xi, phi = (a[m] - b[m]) / (c[m] - b[m]), (p - q) / (r - q)
            step = p / (q - p) * r / (q - r) + (c[m] - a[m]) / (b[m] - a[m]) * p / (r - p) * q / (r - q)
            safe = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi) & np.isfinite(step)
        edge = np.minimum(least / width, 0.5)
        t[m] = np.clip(np.where(safe, step, 0.5), edge, 1.0 - edge)
    nearer = np.abs(fa) < np.abs(fb)
    return np.where(nearer, a, b), np.where(nearer, fa, fb)


def locate(task: Task, angle: Real, each: int, near: Index | None = None) -> tuple[Index, Real, Real, Flags]:
    """Piece (n), parameter (n), coordinate (n) (NaN: none), on a corner (n).

    ``near`` (n): number of the sample about which the contact is known to lie, -1 where it is not known.
    """
    n = angle.size
    piece, u = np.zeros(n, int), np.zeros(n)
    q, corner = np.full(n, np.nan), np.zeros(n, bool)
    pieces, us, points = task.contour.samples(each)
    search = _round
    if _pointed(task, pieces, points):
        search, points = _knife, task.contour.on(pieces, us, 0, task.follower.radius)[0]
    whole = np.flatnonzero(near < 0) if near is not None else np.arange(n)
    block = max(1, 400_000 // points.size)
    rows = [(whole[a : a + block], np.arange(points.size)[None, :]) for a in range(0, whole.size, block)]
    if near is not None and whole.size < n:
        known = np.flatnonzero(near >= 0)
        rows.append((known, (near[known, None] + np.arange(-AROUND, AROUND + 1)) % points.size))
    for m, some in rows:
        piece[m], u[m], q[m], corner[m] = search(task, angle[m], pieces[some], us[some], points[some], each)
    return piece, u, q, corner


def _pointed(task: Task, pieces: Index, points: Complex) -> bool:
    """Whether the face is a knife, or a roller so thin that samples of the profile may miss it.

    Its centre is then the tip of a knife on the curve at the roller's radius; of all crossings the highest is the contact, as any
    lower one is a place where the roller touches elsewhere as well.
    """
    face, radius = task.follower.face, task.follower.radius
    if isinstance(face, Flat) or (isinstance(face, Arc) and face.half_angle < np.pi):
        return False
    if radius == 0.0:
        return True
    apart = np.where(pieces[1:] == pieces[:-1], np.abs(np.diff(points)), 0.0)
    return bool(radius < THIN * apart.max())


def _round(task: Task, angle: Real, pieces: Index, us: Real, points: Complex, each: int) -> tuple[Index, Real, Real, Flags]:
    """``pieces``, ``us``, ``points`` (n or 1, s): the samples that are compared at each angle, in their order along the contour."""
    z = task.ground(points, angle[:, None])
    h = task.height(z)
    # candidates: local maxima within a piece, its ends included
    joint = pieces[:, 1:] != pieces[:, :-1]
    before, after = np.full(h.shape, -np.inf), np.full(h.shape, -np.inf)
    before[:, 1:] = np.where(joint, -np.inf, h[:, :-1])
    after[:, :-1] = np.where(joint, -np.inf, h[:, 1:])
    top = np.where((h >= before) & (h >= after), h, -np.inf)
    pieces, us = np.broadcast_to(pieces, h.shape), np.broadcast_to(us, h.shape)
    many = min(3, top.shape[1])
    rank = np.argpartition(-top, many - 1, axis=1)[:, :many]
    rank = np.take_along_axis(rank, np.argsort(-np.take_along_axis(top, rank, axis=1), axis=1), axis=1)  # the highest first
    best = np.full(angle.size, -np.inf)
    out = np.zeros(angle.size, int), np.zeros(angle.size), np.zeros(angle.size, bool)
    for j in range(many):
        k = rank[:, j]
        rows = np.arange(angle.size)
        sample = top[rows, k]
        # a peak rises above its highest sample by less than that lies above the lower one of its neighbours
        with np.errstate(invalid="ignore"):
            gain = sample - np.minimum(before[rows, k], after[rows, k])
        m = np.flatnonzero((sample > -np.inf) & (sample + gain > best))
        if not m.size:
            continue
        p, middle = pieces[m, k[m]], us[m, k[m]]
        low, high = np.maximum(middle - 1.0 / (each - 1), 0.0), np.minimum(middle + 1.0 / (each - 1), 1.0)
        u, height, end = _climb(task, angle[m], p, low, high, middle)
        better = height > best[m]
        best[m] = np.where(better, height, best[m])
        for old, new in zip(out, (p, u, end), strict=True):
            old[m[better]] = new[better]
    return out[0], out[1], np.where(best > -np.inf, best, np.nan), out[2]


def _slope(task: Task, angle: Real, p: Index, u: Real) -> tuple[Real, Real]:
    """Sign of the change of the coordinate along the contour, and the coordinate itself."""
    c = task.contour.on(p, u, 1)
    z = task.ground(c[0], angle)
    q = task.height(z)
    tangent = c[1] if task.wedge else c[1] * np.exp(1j * task.turn * angle)
    with np.errstate(invalid="ignore"):
        n = task.touch_normal(z, np.where(np.isfinite(q), q, np.nan))
        return np.real(np.conj(n) * tangent) / np.abs(tangent), q


def _climb(task: Task, angle: Real, p: Index, low: Real, high: Real, middle: Real) -> tuple[Real, Real, Flags]:
    """The top of the coordinate along the contour within brackets: tangency, or an end of a piece."""
    g, q = _slope(task, angle, p, middle)
    a = np.where(g > 0.0, middle, low)
    b = np.where(g > 0.0, high, middle)
    ga, qa = _slope(task, angle, p, a)
    gb, qb = _slope(task, angle, p, b)
    # an end that the face cannot reach counts as rising towards the middle
    ga = np.where(np.isfinite(qa), ga, 1.0)
    gb = np.where(np.isfinite(qb), gb, -1.0)
    end_low, end_high = ga <= 0.0, gb >= 0.0

    def slope(x: Real, m: Index) -> Real:
        gx, qx = _slope(task, angle[m], p[m], x)
        return np.where(np.isfinite(qx), gx, np.where(x < middle[m], 1.0, -1.0))  # beyond the face: to the side of the middle

    x, _ = root(slope, a, b, ga, gb, ~(end_low | end_high))
    sharp = task.contour.sharp_joints  # a smooth joint of two pieces is no corner
    at_end = (end_low & (low <= 0.0) & (g <= 0.0) & sharp[p]) | (end_high & (high >= 1.0) & (g > 0.0) & sharp[p + 1])
    x = np.where(end_low & (g <= 0.0), low, np.where(end_high & (g > 0.0), high, x))
    _, best = _slope(task, angle, p, x)
    fallback = ~np.isfinite(best)
    x, best = np.where(fallback, middle, x), np.where(fallback, q, best)
    return x, best, at_end


def _knife(task: Task, angle: Real, pieces: Index, us: Real, points: Complex, each: int) -> tuple[Index, Real, Real, Flags]:
    radius = task.follower.radius
    pieces, us, points = (np.concatenate([row, row[:, :1]], axis=1) for row in (pieces, us, points))  # the contour is closed
    z = task.ground(points, angle[:, None])
    f, h = task.knife_gap(z), task.knife_height(z)
    s = f >= 0.0
    # two pieces that meet where the tip passes: rounding may leave the change of sign to neither of them
    joint = (pieces[:, 1:] != pieces[:, :-1]) & (np.abs(np.diff(points, axis=1)) < NEAR_JOINT * np.abs(points).max())
    cross = (s[:, 1:] != s[:, :-1]) & (joint | (pieces[:, 1:] == pieces[:, :-1]))
    joint = np.broadcast_to(joint, cross.shape)
    pieces, us = np.broadcast_to(pieces, h.shape), np.broadcast_to(us, h.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = f[:, :-1] / (f[:, :-1] - f[:, 1:])
        guess = np.where(cross, np.where(joint, h[:, :-1], h[:, :-1] + share * (h[:, 1:] - h[:, :-1])), -np.inf)
    best = np.full(angle.size, -np.inf)
    out = np.zeros(angle.size, int), np.zeros(angle.size)
    many = min(2, guess.shape[1])
    rank = np.argpartition(-guess, many - 1, axis=1)[:, :many]
    rows = np.arange(angle.size)
    for j in range(many):
        k = rank[:, j]
        live = guess[rows, k] > -np.inf
        after = np.minimum(k + 1, h.shape[1] - 1)
        p, a, b = pieces[rows, k], us[rows, k], us[rows, after]
        fa, fb = f[rows, k], f[rows, after]

        def gap(y: Real, m: Index, p: Index = p) -> Real:
            return task.knife_gap(task.ground(task.contour.on(p[m], y, 0, radius)[0], angle[m]))

        x = np.where(joint[rows, k], a, root(gap, a, b, fa, fb, live & ~joint[rows, k])[0])
        height = task.knife_height(task.ground(task.contour.on(p, x, 0, radius)[0], angle))
        better = live & (height > best)
        best = np.where(better, height, best)
        out[0][better], out[1][better] = p[better], x[better]
    corner = np.zeros(angle.size, bool)
    sharp = np.flatnonzero(task.contour.sharp_joints[:-1])
    if radius > 0.0 and sharp.size:  # there the curve at the roller's radius has a gap
        h = task.height(task.ground(task.contour.on(sharp, np.zeros(sharp.size), 0), angle[:, None]))
        k, height = h.argmax(axis=1), h.max(axis=1)
        corner = height > best
        best = np.where(corner, height, best)
        out[0][corner], out[1][corner] = sharp[k[corner]], 0.0
    return out[0], out[1], np.where(best > -np.inf, best, np.nan), corner


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
    ``near``: contacts at ascending angles that enclose these, found with as many samples: where those before and after lie close
    together, the contact is looked for between them.
    """
    task = Task(contour, follower, turn, wedge)
    angle = np.atleast_1d(np.asarray(angles, float))
    each = max(samples // contour.count, 9)
    piece, u, q, corner = locate(task, angle, each, None if near is None else _between(near, angle, contour.count, each))
    found = _differentiate(task, angle, piece, u, q, corner)
    spans: tuple[Bridge, ...] = ()
    if bridges and angle.size > 2 and np.all(np.diff(angle) > 0.0):
        spans = tuple(_bridges(task, found, each))
    return Contact(angle, found.motion, found.parameter, corner, found.point, found.normal, found.radius, spans)


def _between(near: Contact, angle: Real, count: int, each: int) -> Index:
    """Sample of the contour in the middle between the contacts before and after each angle; -1 where these lie far apart."""
    k = np.clip(np.searchsorted(near.angle, angle), 1, near.angle.size - 1)
    piece = np.minimum(near.parameter.astype(int), count - 1)
    sample = piece * each + np.rint((near.parameter - piece) * (each - 1)).astype(int)
    whole = count * each
    step = (sample[k] - sample[k - 1] + whole // 2) % whole - whole // 2
    return np.where(np.abs(step) < AROUND, (sample[k - 1] + step // 2) % whole, -1)


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
    gap = z - reference
    if isinstance(follower.face, Flat):
        turn = follower.guide.turning(q)
        turn = np.concatenate([np.zeros_like(turn[:1]), turn[1:]])
        d = jets.exponential(1j * turn) * follower.face_direction(q[0])
        first = jets.cross(d, gap)
        if fixed:
            return [first]
        tangent = jets.compose(c[1 : k + 1], t)
        if not task.wedge:
            tangent = jets.product((1j * task.turn) ** np.arange(k)[:, None] * np.exp(1j * task.turn * angle), tangent)
        return [first, jets.cross(d, tangent)]
    if fixed:  # constant distance from the corner
        return [jets.dot(gap, gap)]
    return [gap.real, gap.imag]


# --- bridges ------------------------------------------------------------------------------------------------------------------


def _bridges(task: Task, found: _Found, each: int) -> list[Bridge]:
    """Places where the contact leaps: the step along the profile is far more than its rate on either side explains."""
    z, rate, angle = found.point, found.rate, found.angle
    step = np.abs(np.diff(z))
    allowed = 4.0 * np.fmax(rate[1:], rate[:-1]) * np.diff(angle) + 1e-6 * task.contour.size
    out = _knife_corners(task, found, each)
    for k in np.flatnonzero(step > allowed):
        a, b = float(angle[k]), float(angle[k + 1])
        za, zb = z[k], z[k + 1]
        for _ in range(46):
            middle = 0.5 * (a + b)
            piece, u, q, _corner = locate(task, np.array([middle]), each)
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
            continue  # it only moved fast
        ends = []
        for x in (a, b):
            located = locate(task, np.array([x]), each)
            f = _differentiate(task, np.array([x]), *located, order=1)
            ends.append((float(f.parameter[0]), float(f.motion[1, 0])))
        out.append(Bridge(float(0.5 * (a + b)), ends[0][0], ends[1][0], (ends[0][1], ends[1][1])))
    return sorted(out, key=lambda b: b.angle)


def _knife_corners(task: Task, found: _Found, each: int) -> list[Bridge]:
    """A knife passes a corner: its velocity jumps although the contact does not leap. The angle is found by bisection."""
    if isinstance(task.follower.face, Flat) or task.follower.radius > 0.0:
        return []
    out: list[Bridge] = []
    count, sharp = task.contour.count, task.contour.sharp_joints
    piece = np.clip(np.floor(np.nan_to_num(found.parameter)), 0, count - 1).astype(int)
    ahead, back = (piece[:-1] + 1) % count == piece[1:], piece[:-1] == (piece[1:] + 1) % count
    joint = np.where(ahead, piece[1:], piece[:-1])
    both = np.isfinite(found.parameter[1:]) & np.isfinite(found.parameter[:-1])
    for k in np.flatnonzero((piece[1:] != piece[:-1]) & (ahead | back) & sharp[joint] & both):
        a, b = float(found.angle[k]), float(found.angle[k + 1])
        for _ in range(50):
            middle = 0.5 * (a + b)
            on = locate(task, np.array([middle]), each)[0][0]
            a, b = (middle, b) if on == piece[k] else (a, middle)
        ends = []
        for x in (a, b):
            f = _differentiate(task, np.array([x]), *locate(task, np.array([x]), each), order=1)
            ends.append((float(f.parameter[0]), float(f.motion[1, 0])))
        out.append(Bridge(float(0.5 * (a + b)), ends[0][0], ends[1][0], (ends[0][1], ends[1][1])))
    return out
