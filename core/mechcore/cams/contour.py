"""Given profiles: closed or open outlines of smooth pieces, each with exact derivatives; plane vectors as complex numbers.

Pieces: straight lines, circular arcs, pieces of splines, polar curves r(phi), and the working curve of a synthesised cam. The
parameter of a contour runs from 0 to its number of pieces; piece k has [k, k + 1].
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Complex, Flags, Index, Real, numbers
from mechcore.cams.followers import Flat
from mechcore.cams.pieces import (
    ArcPiece,
    CamPiece,
    PolarPiece,
    PolynomialPiece,
    SmoothPiece,
    StraightPiece,
    ends_of,
    moved_piece,
    on_cam,
)
from mechcore.cams.synthesis import Cam
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve
from mechcore.numerics import jets
from mechcore.records import dataclass
from mechcore.texts import as_angle, as_length


@dataclass(frozen=True, eq=False)
class Contour:
    """Pieces end to end, the outside on the right of the direction of travel (a closed one runs counter-clockwise)."""

    pieces: tuple[SmoothPiece, ...]
    closed: bool = True

    @property
    def count(self) -> int:
        return len(self.pieces)

    def _split(self, t: Real) -> tuple[Index, Real]:
        t = np.asarray(t, float)
        k = np.clip(np.floor(t), 0, self.count - 1).astype(int)
        return k, t - k

    def on(self, piece: Index, u: Real, order: int, distance: float = 0.0) -> Complex:
        """Pieces (n) and their own parameters (n) -> points of the curve offset outwards by ``distance`` [m], with derivatives
        (order + 1, n)."""
        out = np.empty((order + 1, np.size(u)), complex)
        kinds, _, _, ranges = self._rows
        of_cam = np.flatnonzero(kinds[piece] == 3)
        if of_cam.size and self._cam is not None:
            k = piece[of_cam]
            out[:, of_cam] = on_cam(self._cam, ranges[0, k].astype(int), ranges[1:, k], np.asarray(u)[of_cam], distance, order)
        kinds = kinds[piece]
        plain = (kinds == 1) | (kinds == 2)
        if plain.any():
            c = self._plain(piece[plain], kinds[plain], np.asarray(u)[plain], order + (1 if distance else 0))
            out[:, plain] = c[: order + 1] - 1j * distance * jets.unit(c[1:]) if distance else c
        for k in np.unique(piece[kinds == 0]):
            m = piece == k
            p = self.pieces[int(k)]
            out[:, m] = p.offset(u[m], distance, order) if distance else p(u[m], order)
        return out

    @cached_property
    def _cam(self) -> Cam | None:
        """The cam whose working curve pieces are ranges of; None where there is none."""
        return next((p.cam for p in self.pieces if isinstance(p, CamPiece)), None)

    @cached_property
    def _rows(self) -> tuple[Index, Complex, Complex, Real]:
        """Tables by which many pieces are evaluated at once: kinds (1 polynomial, lines included; 2 arc; 3 range of the cam; 0
        other), coefficients of polynomials, centre, radius, start and sweep of arcs, piece of the law and both ends of ranges."""
        kinds = np.zeros(len(self.pieces), int)
        longest = max([2, *(len(p.c) for p in self.pieces if isinstance(p, PolynomialPiece))])
        powers = np.zeros((len(self.pieces), longest), complex)
        arcs = np.zeros((len(self.pieces), 4), complex)
        ranges = np.zeros((3, len(self.pieces)))
        for k, p in enumerate(self.pieces):
            if isinstance(p, StraightPiece):
                kinds[k], powers[k, :2] = 1, (p.a, p.b - p.a)
            elif isinstance(p, PolynomialPiece):
                kinds[k], powers[k, : len(p.c)] = 1, p.c
            elif isinstance(p, ArcPiece):
                kinds[k], arcs[k] = 2, (p.centre, p.radius, p.start, p.sweep)
            elif isinstance(p, CamPiece) and p.cam is self._cam:
                kinds[k], ranges[:, k] = 3, (p.piece, *p.ends)
        return kinds, powers, arcs, ranges

    def _plain(self, piece: Index, kinds: Index, u: Real, order: int) -> Complex:
        """Points and derivatives (order + 1, n) of polynomials and arcs."""
        out = np.zeros((order + 1, u.size), complex)
        m = np.flatnonzero(kinds == 1)
        if m.size:
            table, x = self._rows[1][piece[m]].T, u[m]
            for d in range(order + 1):
                row = np.zeros(m.size, complex)
                for j in range(len(table) - 1, d - 1, -1):
                    row = row * x + (factorial(j) // factorial(j - d)) * table[j]
                out[d, m] = row
        m = np.flatnonzero(kinds == 2)
        if m.size:
            centre, radius, start, sweep = self._rows[2][piece[m]].T
            sweep = sweep.real
            point = radius * np.exp(1j * (start.real + sweep * u[m]))
            for d in range(order + 1):
                out[d, m] = (1j * sweep) ** d * point
            out[0, m] += centre
        return out

    def __call__(self, t: ArrayLike, order: int = 0) -> Complex:
        """Parameters (n) in [0, count] -> points and derivatives (order + 1, n)."""
        k, u = self._split(numbers(t))
        return self.on(k, u, order)

    def normal(self, t: ArrayLike) -> Complex:
        """Outward unit normals (n)."""
        d = self(t, 1)[1]
        return np.asarray(-1j * d / np.abs(d))

    def curvature(self, t: ArrayLike) -> Real:
        """Signed curvature (n) [1/m], positive where convex."""
        d = self(t, 2)
        return np.asarray(np.imag(np.conj(d[1]) * d[2]) / np.abs(d[1]) ** 3)

    def samples(self, each: int) -> tuple[Index, Real, Complex]:
        """``each`` evenly spaced parameters on every piece, ends included: pieces (m), parameters (m), points (m)."""
        u = np.linspace(0.0, 1.0, each)
        pieces, us = np.repeat(np.arange(self.count), each), np.tile(u, self.count)
        return pieces, us, self.on(pieces, us, 0)[0]

    @cached_property
    def sharp_joints(self) -> Flags:
        """Whether joint k, where piece k begins, is a corner (count + 1); the ends of an open contour count as corners."""
        out = np.zeros(self.count + 1, bool)
        for k, _ in self.corners():
            out[k] = True
        if self.closed:
            out[-1] = out[0]
        else:
            out[0] = out[-1] = True
        return out

    @cached_property
    def size(self) -> float:
        """Largest distance of samples from the origin [m]."""
        return float(np.abs(self.samples(33)[2]).max())

    @cached_property
    def area(self) -> float:
        """Enclosed area [m2] from samples, positive where the contour runs counter-clockwise."""
        z = self.samples(129)[2]
        return float(0.5 * np.sum(np.imag(np.conj(z) * np.roll(z, -1))))

    def corners(self, tolerance: float = 1e-6) -> list[tuple[int, float]]:
        """Joints where the direction jumps: (index of the piece that begins there, angle [rad], positive where convex)."""
        ends = [p(np.array([0.0, 1.0]), 1) for p in self.pieces]
        out = []
        for k in range(0 if self.closed else 1, self.count):
            a, b = ends[k - 1][1, 1], ends[k][1, 0]
            turn = float(np.angle(b * np.conj(a)))
            if abs(turn) > tolerance:
                out.append((k, turn))
        return out


def moved_contour(contour: Contour, shift: complex, turn: complex) -> Contour:
    """A contour turned by a unit number and shifted [m]: ``shift + turn z``."""
    if shift == 0.0 and turn == 1.0:
        return contour
    return Contour(tuple(moved_piece(p, shift, turn / abs(turn)) for p in contour.pieces), contour.closed)


def _checked(pieces: Sequence[SmoothPiece], closed: bool = True) -> Contour:
    """The contour of pieces that join. Raises at gaps; the caller orients a closed contour counter-clockwise."""
    contour = Contour(tuple(pieces), closed)
    ends = [p(np.array([0.0, 1.0]), 0)[0] for p in pieces]
    for k in range(0 if closed else 1, len(pieces)):
        distance = abs(ends[k][0] - ends[k - 1][1])
        if distance > 1e-7 * contour.size:
            raise MechanismError(
                Fault(
                    f"contour[{k}]",
                    f"a gap of {as_length(distance, 3)} before this piece.",
                    "Join the pieces, or close the contour.",
                )
            )
    return contour


def line(a: complex, b: complex) -> SmoothPiece:
    """A straight piece from ``a`` to ``b``."""
    if a == b:
        raise MechanismError(Fault("contour", "a line of no length.", "Leave it out."))
    return StraightPiece(complex(a), complex(b))


def arc(centre: complex, radius: float, start: float, sweep: float) -> SmoothPiece:
    """A circular piece from the polar angle ``start`` over ``sweep`` (counter-clockwise positive) [rad]."""
    if not radius > 0.0 or sweep == 0.0:
        raise MechanismError(Fault("contour", f"an arc of radius {as_length(radius)} over {as_angle(sweep)}.", "Leave it out."))
    return ArcPiece(complex(centre), float(radius), float(start), float(sweep))


def circle(radius: float, centre: complex = 0.0) -> Contour:
    """A circular (eccentric) disc, of four arcs."""
    return Contour(tuple(arc(centre, radius, k * np.pi / 2, np.pi / 2) for k in range(4)))


def bulged(vertices: ArrayLike, bulges: ArrayLike | None = None, closed: bool = True) -> Contour:
    """Lines and arcs as in a DXF polyline: complex vertices (n), tangents of a quarter of each arc's angle (n), 0: a line.

    A closed outline may be given in either sense.
    """
    z = np.asarray(vertices, complex).ravel()
    b = np.zeros(len(z)) if bulges is None else np.asarray(bulges, float).ravel()
    if closed and len(z) > 1 and abs(z[0] - z[-1]) <= 1e-12 * np.abs(z).max():
        z, b = z[:-1], b[:-1]
    following = np.roll(z, -1) if closed else z[1:]
    pieces = [_bulge(p, q, k) for p, q, k in zip(z, following, b, strict=False) if p != q]
    if not pieces or (closed and len(pieces) < 2):
        raise MechanismError(Fault("contour", f"{len(z)} vertices make no outline.", "Give at least two, and arcs or a third."))
    contour = Contour(tuple(pieces), closed)
    if closed and contour.area < -1e-12 * contour.size**2:  # a figure of eight of equal lobes has area zero in either sense
        return bulged(z[::-1], -np.roll(b[::-1], -1), closed)
    return _checked(pieces, closed)


def _bulge(p: complex, q: complex, bulge: float) -> SmoothPiece:
    if abs(bulge) < 1e-12:
        return StraightPiece(complex(p), complex(q))
    sweep = 4.0 * np.arctan(bulge)
    centre = 0.5 * (p + q) + 1j * (q - p) * (1.0 - bulge**2) / (4.0 * bulge)
    return ArcPiece(complex(centre), float(abs(p - centre)), float(np.angle(p - centre)), float(sweep))


def polygon(vertices: ArrayLike) -> Contour:
    """Straight lines between complex vertices."""
    return bulged(vertices)


def spline_contour(points: ArrayLike, tolerance: float = 0.0, closed: bool = True, degree: int = 5) -> tuple[Contour, float]:
    """A spline through measured points (complex), or near them within ``tolerance`` (root mean square) [m]: (contour, rms
    correction).

    Raises for fewer than degree + 2 points, for a point twice in a row, and for a tolerance as large as a closed outline's scatter.
    """
    from scipy.interpolate import BSpline, PPoly, splprep

    z = np.asarray(points, complex).ravel()
    if closed and len(z) > 1 and z[0] == z[-1]:
        z = z[:-1]
    if len(z) < degree + 2:
        raise MechanismError(Fault("contour", f"{len(z)} measured points.", f"Give at least {degree + 2}."))
    if closed and np.sum(np.imag(np.conj(z) * np.roll(z, -1))) < 0.0:
        z = z[::-1]
    if np.any(np.abs(np.diff(z)) == 0.0):
        raise MechanismError(Fault("contour", "a measured point twice in a row.", "Leave one out."))
    scatter = float(np.sqrt(np.mean(np.abs(z - z.mean()) ** 2)))
    if closed and tolerance >= scatter:  # then the smoothest periodic spline is a single point
        why = f"{as_length(tolerance)}: the points themselves scatter by {as_length(scatter, 4)}, so that nothing of them is left."
        raise MechanismError(Fault("contour.tolerance", why, "Give the scatter of the measurement."))
    data = np.append(z, z[0]) if closed else z
    allowed = len(z) * tolerance**2
    tck: Any
    for part in (1.0, 0.5, 0.0):  # where the smoothest spline found is too far from the points: less tolerance, at last none
        (tck, u), off, ier, _ = splprep([data.real, data.imag], k=degree, s=part * allowed, per=closed, full_output=True)
        if ier <= 0 or off <= allowed:
            break
    t, (cx, cy), k = tck
    spline = BSpline(t, np.array([cx, cy]).T, k)
    fit = spline(u)
    rms = float(np.sqrt(np.mean(np.abs(fit[:, 0] + 1j * fit[:, 1] - data) ** 2)))
    x, y = (PPoly.from_spline((t, np.asarray(c), k)) for c in (cx, cy))
    pieces: list[SmoothPiece] = []
    for i in range(len(x.x) - 1):
        h = x.x[i + 1] - x.x[i]
        if h > 0.0 and -1e-12 < x.x[i] < 1.0 - 1e-12:  # periodic knots extend beyond
            pieces.append(PolynomialPiece((x.c[::-1, i] + 1j * y.c[::-1, i]) * h ** np.arange(k + 1)))
    return Contour(tuple(pieces), closed), rms


def polar_contour(radius: MotionCurve) -> Contour:
    """The contour r(phi) over one turn (polynomial cams); each piece of the curve is one piece of the contour."""
    if abs(radius.length - 2.0 * np.pi) > 1e-9:
        raise MechanismError(Fault("contour", f"a polar curve over {as_angle(radius.length)}.", "Give it over one turn."))
    knots = radius.knots
    values = radius(np.append(np.linspace(0.0, radius.length, LEAST_CHORDS), knots), 0)[0]
    if not values.min() > LEAST_RADIUS * values.max():  # no tangent at zero; below it the curve is opposite
        what = f"its radius falls to {as_length(float(values.min()))}: the cam's axis is not inside of the profile."
        raise MechanismError(Fault("contour", what, "Keep it above zero."))
    return _checked([PolarPiece(radius, float(a), float(b - a)) for a, b in pairwise(knots)])


def joined_ranges(cam: Cam, pieces: Sequence[CamPiece]) -> list[SmoothPiece]:
    """Ranges of a working curve, joined by the curves that the follower cuts where its velocity jumps.

    A round face rests on the corner of the pitch curve and cuts an arc of its own radius about it; a flat face cuts a straight
    line. Where such a corner is convex, the arc (or line) runs backwards: the profile is undercut (``find_limits`` reports it).
    """
    out: list[SmoothPiece] = []
    flat, r = isinstance(cam.follower.face, Flat), cam.follower.radius
    starts, ends = ends_of(cam, pieces, 0.0)
    for k, piece in enumerate(pieces):
        out.append(piece)
        if cam.wedge and k + 1 == len(pieces):
            break
        a, b = complex(ends[k]), complex(starts[(k + 1) % len(pieces)])
        if abs(a - b) <= 1e-9 * abs(a) or not (flat or r > 0.0):
            continue
        if flat:
            out.append(StraightPiece(a, b))
            continue
        centre = complex(piece.offset(np.ones(1), r, 0)[0, 0])
        out.append(ArcPiece(centre, r, float(np.angle(a - centre)), float(np.angle((b - centre) / (a - centre)))))
    return out


def cam_contour(cam: Cam) -> Contour:
    """The working curve of a synthesised cam as a given profile, a piece for each piece of its law.

    Pitch curves of disc cams run against the rotation of the cam; the pieces are reversed where that is needed.
    """
    if cam.outer:
        raise MechanismError(Fault("cam.outer", "the far flank of a groove is no outline.", "Analyse the near flank."))
    backwards = not cam.wedge and cam.turn == 1
    if cam.wedge:
        backwards = True  # the outside (above) has to be on the right
    order = range(len(cam.law.pieces))
    pieces = [CamPiece(cam, k, backwards) for k in (reversed(order) if backwards else order)]
    return Contour(tuple(joined_ranges(cam, pieces)), not cam.wedge)


LEAST_RADIUS = 1e-6  # least radius of a polar curve, relative to its largest
LEAST_CHORDS = 720  # least number of chords around the profile
_TOUCHING = 1e-9  # tolerance of chords that touch, over their length; distance of points that coincide, over the size


def self_crossing(contour: Contour) -> complex | None:
    """A point [m] where a closed contour crosses or touches itself, found by its chords; None where the contour is simple.

    Two chords that are not neighbours meet where ``a + t r = b + s q`` has both parameters in [0, 1]. Chords whose midpoints are
    farther apart than the longest chord cannot meet.
    """
    from scipy.spatial import cKDTree

    z = contour.samples(max(2, -(-LEAST_CHORDS // contour.count) + 1))[2]
    z = z[np.abs(z - np.roll(z, 1)) > _TOUCHING * contour.size]
    sides = np.roll(z, -1) - z
    middle = z + 0.5 * sides
    tree = cKDTree(np.column_stack([middle.real, middle.imag]))
    i, j = tree.query_pairs(float(np.abs(sides).max(initial=0.0)) * (1.0 + _TOUCHING), output_type="ndarray").T
    apart = j - i  # i < j
    i, j = (k[(apart > 1) & (apart < len(z) - 1)] for k in (i, j))
    distance, det = z[j] - z[i], np.imag(np.conj(sides[i]) * sides[j])
    clear = np.abs(det) > _TOUCHING * np.abs(sides[i] * sides[j])  # not parallel
    i, distance, det, other, own = i[clear], distance[clear], det[clear], sides[j[clear]], sides[i[clear]]
    t, s = np.imag(np.conj(distance) * other) / det, np.imag(np.conj(distance) * own) / det
    met = np.flatnonzero((np.abs(t - 0.5) <= 0.5 + _TOUCHING) & (np.abs(s - 0.5) <= 0.5 + _TOUCHING))
    return complex(z[i[met[0]]] + t[met[0]] * own[met[0]]) if met.size else None
