"""The contact of any follower with a given profile, found globally.

At every angle each point of the profile belongs to a coordinate of the follower: that at which its face, coming from outside, would
touch the point. The largest of these coordinates is that of the contact, wherever on the profile its point lies. The best samples
are then refined to the tangency, or to the corner.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mechcore.arrays import Complex, Flags, Index, Real
from mechcore.cams.contour import Contour
from mechcore.cams.followers import Arc, Flat, Follower, Translating
from mechcore.numerics import jets
from mechcore.records import dataclass

NEAR_JOINT = 1e-9  # distance, relative to the contour's size, below which the ends of two pieces coincide
SAMPLES_AROUND = 12  # samples on either side of one about which the contact is known to lie
THIN_ROLLER = 3.0  # radius, in distances of two samples, below which a roller is thin
ROOT_ACCURACY = 5e-15  # error of roots, as a part of a piece's range; heights are stationary there: their error is its square


@dataclass(frozen=True, eq=False)
class Task:
    """A given profile, its follower and the sense in which the cam turns; a ``wedge`` translates instead."""

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
        return jets.jet_product(frame, c)

    # -- the coordinate at which the face touches a point -------------------------------------------------------------

    def height(self, z: Complex) -> Real:
        """Ground points -> the coordinate at which the face touches them from outside; -inf where it cannot."""
        guide, face = self.follower.guide, self.follower.face
        r = self.follower.radius
        with np.errstate(invalid="ignore", divide="ignore"):
            if isinstance(guide, Translating):
                if isinstance(face, Flat):
                    d = np.exp(1j * face.tilt)
                    q = np.imag(np.conj(d) * (z - guide.offset)) / np.cos(face.tilt)
                    return np.where(np.isfinite(q), q, -np.inf)
                x = z.real - guide.offset
                q = z.imag + np.sqrt(r * r - x * x)
                q = np.where(self.on_arc(z, q), q, -np.inf)
                return np.where(np.isnan(q), -np.inf, q)
            w = (z - guide.pivot) / guide.home
            size, beta = np.abs(w), -guide.side * np.angle(w)
            if isinstance(face, Flat):
                lever = face.shift * np.cos(face.tilt) - guide.side * guide.arm * np.sin(face.tilt)
                q = beta + guide.side * face.tilt + np.arcsin(lever / size)
                return np.where(np.isfinite(q), q, -np.inf)
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
            arm = guide.home * np.exp(-1j * guide.side * q)
            down, centre = 1j * guide.side * arm, guide.pivot + guide.arm * arm
        return np.asarray(np.abs(np.angle((z - centre) / down)) <= face.half_angle)

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


def bracketed_roots(f: Callable[[Real, Index], Real], a: Real, b: Real, fa: Real, fb: Real, live: Flags) -> tuple[Real, Real]:
    """Roots (n) of many functions in brackets from ``a`` to ``b`` (n), whose values ``fa``, ``fb`` have opposite signs, and the
    functions' values (n) there.

    ``f`` takes arguments and the indices of their functions. Inverse quadratic interpolation where it is safe, else bisection
    (T. R. Chandrupatla, Advances in Engineering Software 28, 1997). Where not ``live``: the end with the smaller value.
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
        least = 4e-16 * np.abs(best) + ROOT_ACCURACY
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


def locate_contact(task: Task, angle: Real, each: int, near: Index | None = None) -> tuple[Index, Real, Real, Flags]:
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
        rows.append((known, (near[known, None] + np.arange(-SAMPLES_AROUND, SAMPLES_AROUND + 1)) % points.size))
    for m, some in rows:
        piece[m], u[m], q[m], corner[m] = search(task, angle[m], pieces[some], us[some], points[some], each)
    return piece, u, q, corner


def _pointed(task: Task, pieces: Index, points: Complex) -> bool:
    """Whether the face is a knife, or a roller so thin that samples of the profile may miss it.

    Its centre is then treated as the tip of a knife on the curve offset by the roller's radius. Of all crossings the highest is
    the contact: at a lower one the roller would overlap the profile elsewhere.
    """
    face, radius = task.follower.face, task.follower.radius
    if isinstance(face, Flat) or (isinstance(face, Arc) and face.half_angle < np.pi):
        return False
    if radius == 0.0:
        return True
    apart = np.where(pieces[1:] == pieces[:-1], np.abs(np.diff(points)), 0.0)
    return bool(radius < THIN_ROLLER * apart.max())


def _round(task: Task, angle: Real, pieces: Index, us: Real, points: Complex, each: int) -> tuple[Index, Real, Real, Flags]:
    """Contacts (see `locate_contact`) of a round or flat face. ``pieces``, ``us``, ``points`` (n or 1, s): the samples that are
    compared at each angle, in their order along the contour."""
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
        # a peak exceeds its highest sample by less than this exceeds the lower one of its neighbours
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
    """A number with the sign of the coordinate's change along the contour, and the coordinate itself."""
    c = task.contour.on(p, u, 1)
    z = task.ground(c[0], angle)
    q = task.height(z)
    tangent = c[1] if task.wedge else c[1] * np.exp(1j * task.turn * angle)
    with np.errstate(invalid="ignore"):
        n = task.touch_normal(z, np.where(np.isfinite(q), q, np.nan))
        return np.real(np.conj(n) * tangent) / np.abs(tangent), q


def _climb(task: Task, angle: Real, p: Index, low: Real, high: Real, middle: Real) -> tuple[Real, Real, Flags]:
    """The parameter at which the coordinate is largest along the contour within brackets, at a tangency or an end of a piece; the
    coordinate there; and whether it is a corner."""
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
        return np.where(np.isfinite(qx), gx, np.where(x < middle[m], 1.0, -1.0))  # beyond the face: rises towards middle

    x, _ = bracketed_roots(slope, a, b, ga, gb, ~(end_low | end_high))
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
    # where the tip passes a joint of two pieces, rounding may hide the change of sign from both
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

        def distance(y: Real, m: Index, p: Index = p) -> Real:
            return task.knife_gap(task.ground(task.contour.on(p[m], y, 0, radius)[0], angle[m]))

        x = np.where(joint[rows, k], a, bracketed_roots(distance, a, b, fa, fb, live & ~joint[rows, k])[0])
        height = task.knife_height(task.ground(task.contour.on(p, x, 0, radius)[0], angle))
        better = live & (height > best)
        best = np.where(better, height, best)
        out[0][better], out[1][better] = p[better], x[better]
    corner = np.zeros(angle.size, bool)
    sharp = np.flatnonzero(task.contour.sharp_joints[:-1])
    if radius > 0.0 and sharp.size:  # the offset curve has gaps at corners
        h = task.height(task.ground(task.contour.on(sharp, np.zeros(sharp.size), 0), angle[:, None]))
        k, height = h.argmax(axis=1), h.max(axis=1)
        corner = height > best
        best = np.where(corner, height, best)
        out[0][corner], out[1][corner] = sharp[k[corner]], 0.0
    return out[0], out[1], np.where(best > -np.inf, best, np.nan), corner
