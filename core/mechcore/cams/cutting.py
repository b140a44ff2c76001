"""What the cutter really leaves of an undercut profile: the working curve without its loops, as an exact contour.

The inner offset of a pitch curve that is too sharp crosses itself. Points of the loop lie nearer to another place of the pitch
curve than the roller's radius (or beyond another position of a flat face): the cutter takes them away. What remains are ranges of
the same working curve that meet in corners, found as double points W(a) = W(b).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Flags, Real
from mechcore.cams.analysis import analyse
from mechcore.cams.contour import CamPiece, Contour, cam_contour, joined
from mechcore.cams.followers import Flat
from mechcore.cams.synthesis import Cam
from mechcore.errors import Fault, MechanismError
from mechcore.texts import as_angle


@dataclass(frozen=True, eq=False)
class CutProfile:
    """The profile as cut, ranges of the cam's angle that the cutter took away, corners between them, error of the lift.

    ``lost``: (from, to) of the law's angle in order of the cam's turning; ``corners``: complex points in the cam's axes; ``error``:
    largest difference between the coordinate obtained and the law, at ``angle``. Without undercut: no ranges, error 0.
    """

    contour: Contour
    lost: tuple[tuple[float, float], ...]
    corners: tuple[complex, ...]
    error: float
    angle: float


def cut_profile(cam: Cam, count: int = 2880) -> CutProfile:
    """The real profile of a disc cam whose law its follower may be too large for.

    ``count``: angles at which loops are looked for. Raises where nothing is left, or where the remaining ranges do not meet.
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
    contour = Contour(tuple(joined(cam, pieces)))
    probe = law.start + law.length * np.arange(360) / 360.0
    got = analyse(contour, cam.follower, probe, cam.turn, samples=4096, bridges=False).motion[0]
    error = np.abs(got - law(probe, 0)[0])
    worst = int(np.nanargmax(error))
    shift = [law.length * np.floor((a - law.start) / law.length) for a, _ in lost]
    lost = [(float(a - d), float(b - d)) for (a, b), d in zip(lost, shift, strict=True)]
    return CutProfile(contour, tuple(lost), tuple(corners), float(error[worst]), float(probe[worst]))


def _outside(points: NDArray, cam: Cam, theta: Real) -> Flags:
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
        gap = w[0, 0] - w[0, 1]
        if abs(gap) < 1e-15 * size:
            break
        u, v = w[1, 0], -w[1, 1]
        det = float(np.imag(np.conj(u) * v))
        if det == 0.0:
            break
        limit = 0.1 * (second - first)
        a += float(np.clip(-np.imag(np.conj(gap) * v) / det, -limit, limit))
        b += float(np.clip(-np.imag(np.conj(u) * gap) / det, -limit, limit))
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
