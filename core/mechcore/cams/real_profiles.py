"""Real profiles: the lift that a given profile gives its follower, and the shape that the cutter leaves of an undercut profile.

Lift: it is analytic between the angles at which the contact passes a joint of the profile's pieces or leaps over a part that it
never touches. There its exact second derivative (``analyse``) is interpolated by polynomials at Chebyshev nodes and integrated
twice, from the exact values and velocities at the nodes; ranges are halved until the polynomials fit. A polynomial through the
values would have a second derivative as rough as their rounding over the square of the range. `graphical` gives the lift as it is
drawn in the lecture.

Undercut: the inner offset of a pitch curve that is too sharp crosses itself. Points of the loop are closer to another point of the
pitch curve than the roller's radius (or lie beyond another position of a flat face): the cutter removes them. The remaining ranges
of the working curve meet in corners, found as double points W(a) = W(b).
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np

from mechcore.arrays import Complex, Flags, Real
from mechcore.cams.analysis import Bridge, Contact, analyse
from mechcore.cams.contour import Contour, cam_contour, joined_ranges
from mechcore.cams.followers import Flat, Follower, Oscillating, Translating
from mechcore.cams.pieces import CamPiece
from mechcore.cams.synthesis import Cam
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve, Piece
from mechcore.records import dataclass
from mechcore.texts import as_angle

STEP = np.radians(6.0)  # largest distance of two knots
LEAP_ANGLES = 1440  # angles between which leaps of the contact are searched for
MOST_HALVINGS = 7  # passes of the fit; ranges whose polynomials do not fit are halved between them
FIT_ACCURACY = 1e-12  # misfit, relative to the largest coordinate, velocity and second derivative
FIT_NODES = 0.5 - 0.5 * np.cos(np.pi * (np.arange(10) + 0.5) / 10)  # places in a range: nodes of the second derivative
CHECKS = np.array([0.028, 0.5, 0.972])  # places in a range, between the nodes, at which the misfit is measured


@dataclass(frozen=True, eq=False)
class GivenLift:
    """The lift of a given profile: the follower's absolute coordinate over one turn, the leaps of the contact, and the ends of the
    ranges that contain no joint and no leap."""

    law: MotionCurve
    bridges: tuple[Bridge, ...]
    ends: tuple[float, ...]


def lift_of(contour: Contour, follower: Follower, turn: int = 1) -> GivenLift:
    """The lift of a closed profile in its cam's axes, the cam turning by ``turn * theta``.

    Raises where the outline is open, where the follower does not reach the profile, or where no contact can be found.
    """
    if not contour.closed:
        raise MechanismError(Fault("cam.profile", "an outline that is not closed.", "Close it."))
    grid = 2.0 * np.pi * np.arange(LEAP_ANGLES + 1) / LEAP_ANGLES
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
    for k in range(MOST_HALVINGS):
        table, errors = _fitted(contour, follower, turn, low, high, seen)
        good = errors.max(axis=0) < FIT_ACCURACY if k + 1 < MOST_HALVINGS else np.ones(low.size, bool)
        done.append((low[good], high[good], table[:, good]))
        if good.all():
            break
        a, b = low[~good], high[~good]
        low, high = np.concatenate([a, 0.5 * (a + b)]), np.concatenate([0.5 * (a + b), b])
    low, high = (np.concatenate([d[k] for d in done]) for k in (0, 1))
    table = np.concatenate([d[2] for d in done], axis=1)
    order = np.argsort(low)
    pieces = tuple(Piece(float(high[k] - low[k]), table[:, k].copy(), np.zeros((0, 3))) for k in order)
    return GivenLift(MotionCurve(pieces, 0.0, True), seen.bridges, tuple(knots.tolist()))


def _fitted(contour: Contour, follower: Follower, turn: int, low: Real, high: Real, seen: Contact) -> tuple[Real, Real]:
    """Coefficients (m, n) of the lift over ranges of angles (n) that contain no joint or leap, and its misfit (3, n) in value,
    velocity and second derivative between the nodes, relative to the largest of each over the turn."""
    h, u = high - low, np.concatenate([FIT_NODES, CHECKS])
    angle = low + u[:, None] * h
    m = analyse(contour, follower, angle.ravel(), turn, bridges=False, near=seen).motion
    if not np.isfinite(m).all():
        at = as_angle(angle.ravel()[int(np.argmax(~np.isfinite(m).all(axis=0)))])
        raise MechanismError(
            Fault("cam.profile", f"no contact can be found at {at}.", "Smooth the profile there, or move the follower.")
        )
    wanted = (m[:3].reshape(3, *angle.shape).T * h[:, None, None] ** np.arange(3)).T  # value and derivatives by u
    n, power = len(FIT_NODES), np.arange(len(FIT_NODES) + 2)
    table = np.zeros((n + 2, h.size))
    table[2:] = np.linalg.solve(np.vander(FIT_NODES, n, increasing=True), wanted[2, :n]) / (power[2:] * (power[2:] - 1.0))[:, None]
    values = np.vander(u, n + 2, increasing=True)
    slopes = np.column_stack([np.zeros(u.size), power[1:] * values[:, :-1]])
    second = np.column_stack([np.zeros((u.size, 2)), (power[2:] * (power[2:] - 1.0)) * values[:, :-2]])
    table[1] = (wanted[1] - slopes @ table)[:n].mean(axis=0)
    table[0] = (wanted[0] - values @ table)[:n].mean(axis=0)
    errors = np.abs(np.stack([values @ table, slopes @ table, second @ table]) - wanted)[:, n:].max(axis=1)
    sizes = np.abs(seen.motion[:3]).max(axis=1)[:, None] * h ** np.arange(3)[:, None]
    return table / h ** power[:, None], errors / np.where(sizes > 0.0, sizes, np.inf)


def joint_angles(contour: Contour, follower: Follower, turn: int = 1) -> Real:
    """Angles of the cam within a turn at which the contact can pass a joint of the profile, from either side; in closed form.

    In the cam's axes the follower's reference point lies on the offset of the joint along the normal of either piece; the
    cam's angle is where the turned guide passes through it: cos(angle + a) = k.
    """
    guide, face, r = follower.guide, follower.face, follower.radius
    angles: list[float] = []
    for k in range(contour.count):
        for piece, end in ((contour.pieces[k - 1], 1.0), (contour.pieces[k], 0.0)):
            z, d, bend = piece(np.array([end]), 2)[:, 0]
            d = d or (1.0 - 2.0 * end) * bend  # where the derivative vanishes at an end, the direction just inside
            if d == 0.0:
                continue
            normal = -1j * d / abs(d)
            if isinstance(face, Flat):
                if isinstance(guide, Translating):
                    up = 1j * np.exp(1j * face.tilt)
                    angles.append(float(np.angle(up / normal)) * turn)
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
                angles += [turn * (lean - swing), turn * (lean + swing)]
    return np.asarray(np.mod(np.array(angles), 2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class Graphical:
    """The graphical solution: angles (n); coordinate, velocity and acceleration as ``drawn`` and ``exact``, each (3, n)."""

    angle: Real
    drawn: Real
    exact: Real

    @property
    def error(self) -> Real:
        return self.drawn - self.exact

    @property
    def largest(self) -> Real:
        """Largest error of each row, relative to the largest exact value of the row (3)."""
        return np.asarray(np.abs(self.error).max(axis=1) / np.maximum(np.abs(self.exact).max(axis=1), 1e-300))


def graphical(
    contour: Contour,
    follower: Follower,
    divisions: int = 24,
    method: Literal["chord", "tangent"] = "chord",
    resolution: float = 0.0,
    turn: int = 1,
) -> Graphical:
    """The graphical solution over one turn: the cam is turned in steps, the lift laid off at each of them and differentiated twice.

    "chord": slopes of the chords belong to the middles of the steps; the velocity drawn at a division is the mean of both
    neighbours, the acceleration the slope between them. "tangent": the slope at a division is that of the line through both
    neighbours, twice. ``resolution`` [m or rad]: smallest difference that can be read off the drawing; lifts are rounded to it.
    """
    if divisions < 4:
        raise MechanismError(Fault("graphical.divisions", f"{divisions}", "Divide the turn into at least 4 steps."))
    angle = 2.0 * np.pi * np.arange(divisions) / divisions
    exact = analyse(contour, follower, angle, turn, bridges=False).motion[:3]
    s = exact[0].copy()
    if resolution > 0.0:
        s = resolution * np.round(s / resolution)
    step = 2.0 * np.pi / divisions
    if method == "chord":
        chord = (np.roll(s, -1) - s) / step  # at the middle of the step that follows
        v, a = 0.5 * (chord + np.roll(chord, 1)), (chord - np.roll(chord, 1)) / step
    elif method == "tangent":
        v = (np.roll(s, -1) - np.roll(s, 1)) / (2.0 * step)
        a = (np.roll(v, -1) - np.roll(v, 1)) / (2.0 * step)
    else:
        raise MechanismError(Fault("graphical.method", f"'{method}' is none.", "Give 'chord' or 'tangent'."))
    return Graphical(angle, np.array([s, v, a]), exact)


@dataclass(frozen=True, eq=False)
class CutProfile:
    """The profile as cut: its contour, the ranges of the cam's angle that the cutter removes, its corners, the error of the lift.

    ``lost``: (from, to) of the law's angle in the order in which the cam turns; ``corners``: complex points in the cam's axes;
    ``error``: largest difference between the actual coordinate and the law, at ``angle``. Without undercut: no ranges, error 0.
    """

    contour: Contour
    lost: tuple[tuple[float, float], ...]
    corners: tuple[complex, ...]
    error: float
    angle: float


def cut_profile(cam: Cam, count: int = 2880) -> CutProfile:
    """The real profile of a disc cam, whose follower may be too large for its law.

    ``count``: angles at which loops are searched for. Raises where nothing remains, or where the remaining ranges do not meet.
    """
    if cam.wedge or cam.outer:
        raise MechanismError(Fault("cam", "only disc cams with an inner profile are cut.", "Check others with find_limits."))
    law = cam.law
    theta = law.start + law.length * (np.arange(count) + 0.5) / count
    s = cam.at(theta)
    kept = _outside(s.working, cam, theta)
    if kept.all():
        return CutProfile(cam_contour(cam), (), (), 0.0, law.start)
    if not kept.any():
        raise MechanismError(Fault("cam", "the cutter leaves nothing of the profile.", "Enlarge the base circle."))
    # start the cycle inside a kept range, so that no lost range wraps
    first = int(np.argmax(kept & ~np.roll(kept, 1)))
    order = (np.arange(count) + first) % count
    turns = np.where(np.arange(count) + first >= count, law.length, 0.0)
    angle, good = theta[order] + turns, kept[order]
    edges = np.flatnonzero(np.diff(good.astype(int)))
    starts = [float(angle[0])] + [float(angle[k + 1]) for k in edges[1::2]]
    ends = [float(angle[k]) for k in edges[0::2]]
    if len(ends) < len(starts):
        ends.append(float(angle[-1]))
    lost, corners = [], []
    for k in range(len(starts)):
        a, b = ends[k], starts[(k + 1) % len(starts)] + (law.length if k + 1 == len(starts) else 0.0)
        a, b, point = _double_point(cam, a, b)
        lost.append((a, b))
        corners.append(point)
    ranges = [(lost[k - 1][1] - (law.length if k == 0 else 0.0), lost[k][0]) for k in range(len(lost))]
    backwards = cam.turn == 1
    pieces: list[CamPiece] = []
    for a, b in reversed(ranges) if backwards else ranges:
        parts = _parts(cam, a, b, backwards)
        pieces += parts[::-1] if backwards else parts
    contour = Contour(tuple(joined_ranges(cam, pieces)))
    probe = law.start + law.length * np.arange(360) / 360.0
    got = analyse(contour, cam.follower, probe, cam.turn, samples=4096, bridges=False).motion[0]
    error = np.abs(got - law(probe, 0)[0])
    worst = int(np.nanargmax(error))
    shift = [law.length * np.floor((a - law.start) / law.length) for a, _ in lost]
    lost = [(float(a - d), float(b - d)) for (a, b), d in zip(lost, shift, strict=True)]
    return CutProfile(contour, tuple(lost), tuple(corners), float(error[worst]), float(probe[worst]))


def _outside(points: Complex, cam: Cam, theta: Real) -> Flags:
    """Which points of the working curve no position of the follower covers."""
    from scipy.spatial import cKDTree

    s = cam.at(theta)
    size = float(np.abs(s.pitch).max())
    if not isinstance(cam.follower.face, Flat):
        r = cam.follower.radius
        near, _ = cKDTree(np.column_stack([s.pitch.real, s.pitch.imag])).query(np.column_stack([points.real, points.imag]))
        return np.asarray(near >= r - 1e-9 * size)
    normal, level = s.normal, np.real(np.conj(s.normal) * s.pitch)
    worst = np.full(points.size, -np.inf)
    for k in range(0, theta.size, 256):
        beyond = np.real(np.conj(normal[k : k + 256, None]) * points[None, :]) - level[k : k + 256, None]
        worst = np.maximum(worst, beyond.max(axis=0))
    return worst <= 1e-9 * size


def _double_point(cam: Cam, a: float, b: float) -> tuple[float, float, complex]:
    """W(a) = W(b) by Newton's method from both sides of a loop."""
    first, second = a, b
    size = float(np.abs(cam.at(np.array([a])).working[0]))
    for _ in range(60):
        w = cam.working_curve(np.array([a, b]), 1)
        distance = w[0, 0] - w[0, 1]
        if abs(distance) < 1e-15 * size:
            break
        u, v = w[1, 0], -w[1, 1]
        det = float(np.imag(np.conj(u) * v))
        if det == 0.0:
            break
        limit = 0.1 * (second - first)
        a += float(np.clip(-np.imag(np.conj(distance) * v) / det, -limit, limit))
        b += float(np.clip(-np.imag(np.conj(u) * distance) / det, -limit, limit))
    w = cam.working_curve(np.array([a, b]), 0)[0]
    if abs(w[0] - w[1]) > 1e-9 * size or not (a < b):
        raise MechanismError(
            Fault("cam", f"the profile does not close again where it is undercut at {as_angle(first)}.", "Enlarge it.")
        )
    return a, b, complex(w[0])


def _parts(cam: Cam, a: float, b: float, backwards: bool) -> list[CamPiece]:
    """The working curve over a range of angles, cut at the law's knots."""
    law = cam.law
    out = []
    for turn in (-1, 0, 1):
        for k, piece in enumerate(law.pieces):
            low = float(law.knots[k]) + turn * law.length
            x, y = max(a, low), min(b, low + piece.length)
            if y - x > 1e-12 * law.length:
                out.append(CamPiece(cam, k, backwards, (x - low) / piece.length, (y - low) / piece.length))
    return out
