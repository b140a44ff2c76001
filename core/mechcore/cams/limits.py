"""Limits of plane cams: what a cam reaches, what is required, and the verdict."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.cams.followers import Flat
from mechcore.cams.synthesis import Cam, Synthesis
from mechcore.laws.factors import VELOCITY_JUMP
from mechcore.records import dataclass


@dataclass(frozen=True)
class Reached:
    """An extreme value and the angle at which it is reached."""

    value: float
    angle: float


@dataclass(frozen=True)
class CamLimits:
    """Extremes over a cycle, each with its angle. Radii: of the working curve; ``None`` where there is none of that kind.

    ``rise``: largest pressure angle of the sign that a rise has, ``fall``: of the opposite sign, both positive numbers (a
    dwell of an offset follower has one too); the larger of them is the largest in size.
    ``distance_left``, ``distance_right``: extremes of the contact on a flat face from the reference point; their difference
    is ``face_length``, the least length of the face. ``convex``, ``concave``: smallest radius of curvature in size where the
    profile is convex, concave. ``sharpness``: least regularity of the profile; below zero it is undercut, at zero it has a cusp, at
    minus infinity a fold where the velocity of the law jumps down.
    ``greatest_roller``: the largest radius that does not undercut: the pitch curve's smallest radius on the critical side.
    """

    rise: Reached
    fall: Reached
    convex: Reached | None
    concave: Reached | None
    sharpness: Reached
    greatest_roller: Reached | None
    distance_left: Reached | None
    distance_right: Reached | None

    @property
    def face_length(self) -> float | None:
        if self.distance_left is None or self.distance_right is None:
            return None
        return self.distance_right.value - self.distance_left.value

    @property
    def undercut(self) -> bool:
        """The profile folds back on itself; a cusp (sharpness zero up to rounding) is not yet undercut."""
        return self.sharpness.value < -1e-9

    def mirrored(self) -> CamLimits:
        """The limits as the law is read backwards: of the law -x, with rise and return exchanged."""

        def there(reached: Reached | None) -> Reached | None:
            return None if reached is None else Reached(reached.value, -reached.angle)

        back: dict[str, Any] = {f.name: there(getattr(self, f.name)) for f in fields(self)}
        return CamLimits(**(back | {"rise": back["fall"], "fall": back["rise"]}))


def _grid(cam: Cam, given: Synthesis | None, count: int) -> tuple[Synthesis, Synthesis]:
    """The cam on a grid of one cycle, and its one-sided values at the law's knots."""
    law = cam.law
    if given is None:
        given = cam.at(law.start + law.length * (np.arange(count) / count))
    left, right = law.limits(2)
    knots = Synthesis(cam, np.concatenate([law.knots[1:], law.knots[:-1]]), np.vstack([left, right]).T.copy())
    return given, knots


def _vertex(x: Real, y: Real) -> Real:
    """Places of the extremes (m) of parabolas through three points each, x (m, 3) evenly spaced, clipped to the range of x."""
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = 0.5 * (y[:, 0] - y[:, 2]) / (y[:, 0] - 2.0 * y[:, 1] + y[:, 2])
    shift = np.where(np.isfinite(shift), np.clip(shift, -1.0, 1.0), 0.0)
    return x[:, 1] + shift * (x[:, 2] - x[:, 1])


_QUANTITIES = ("rise", "fall", "sharp", "convex", "concave", "pitch", "left", "right")


def _costs(s: Synthesis, flat: bool) -> list[Real]:
    """Rows to be minimised, one for each quantity of ``_QUANTITIES``; infinite where a quantity does not exist."""
    alpha = s.cam.turn * s.pressure_angle
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = s.radius
        curvatures = 1.0 / radius
        critical = 1.0 / (s.cam.flank * s.pitch_radius)
    # curvature instead of radius: finite where the profile is straight, and least radius = greatest curvature
    rows = [
        -alpha,
        alpha,
        s.sharpness,
        np.where(radius > 0.0, -curvatures, np.inf),
        np.where(radius < 0.0, curvatures, np.inf),
        -critical,
    ]
    if flat:
        rows += [s.distance, -s.distance]
    return [np.where(np.isnan(row), np.inf, row) for row in rows]


def find_limits(cam: Cam, on: Synthesis | None = None, count: int = 3600) -> CamLimits:
    """Extremes over a cycle: on a grid (that of ``on``, even over the cycle, else ``count`` angles), then on finer grids and a
    parabola about each best point, and at the law's knots from both sides. Values are exact to about 1e-12, angles to 1e-6.
    """
    flat = isinstance(cam.follower.face, Flat)
    grid, knots = _grid(cam, on, count)
    rows = _costs(grid, flat)
    width = cam.law.length / max(grid.angle.size, 2)
    center = np.array([grid.angle[int(np.argmin(row))] for row in rows])
    # finer grids about each best sample, then the vertex of the parabola through the best three points of the finest
    for _ in range(2):
        offsets = width * np.linspace(-1.0, 1.0, 17)
        where = center[:, None] + offsets
        close = [row.reshape(-1, 17)[m] for m, row in enumerate(_costs(cam.at(where.ravel()), flat))]
        lowest = np.array([int(np.clip(np.argmin(row), 1, 15)) for row in close])
        center, width = where[np.arange(len(lowest)), lowest], width / 8.0
    three = np.array([row[m - 1 : m + 2] for row, m in zip(close, lowest, strict=True)])
    vertex = _vertex(center[:, None] + width * np.array([-1.0, 0.0, 1.0]), three)
    fine = cam.at(np.concatenate([center, vertex]))
    rows_fine, rows_knots = _costs(fine, flat), _costs(knots, flat)
    out: dict[str, Reached | None] = {}
    for name, row, row_fine, row_knots in zip(_QUANTITIES, rows, rows_fine, rows_knots, strict=False):
        best, angle = np.inf, 0.0
        for values, angles in ((row, grid.angle), (row_fine, fine.angle), (row_knots, knots.angle)):
            k = int(np.argmin(values))
            if values[k] < best:
                best, angle = float(values[k]), float(angles[k])
        out[name] = Reached(best, angle) if np.isfinite(best) or (name == "concave" and best == -np.inf) else None

    fold = _fold(cam, knots)
    if fold is not None:
        for name in ("convex", "pitch") if cam.follower.radius == 0.0 and not flat else ("sharp", "convex", "pitch"):
            out[name] = Reached(-np.inf, fold)

    def flip(name: str) -> Reached:
        r = out[name]
        return Reached(-r.value, r.angle) if r is not None else Reached(0.0, cam.law.start)

    def radius(name: str) -> Reached | None:
        r = out[name]
        return Reached(-1.0 / r.value, r.angle) if r is not None and r.value != 0.0 else None

    pitch = out["pitch"]
    concave = radius("concave")
    return CamLimits(
        rise=flip("rise"),
        fall=flip("fall"),
        convex=radius("convex"),
        concave=concave,
        sharpness=out["sharp"] or Reached(-np.inf, cam.law.start),
        greatest_roller=Reached(-1.0 / pitch.value, pitch.angle) if pitch is not None and pitch.value < 0.0 and not flat else None,
        distance_left=out.get("left"),
        distance_right=flip("right") if flat else None,
    )


def _fold(cam: Cam, knots: Synthesis) -> float | None:
    """The angle of a knot at which the velocity jumps so that the pitch curve has a convex corner (the profile a fold); None: there
    is none. Jumps too small for a knock do not count: at a corner of d radians a roller misses its law by r d^2 / 8."""
    n = len(cam.law.pieces)
    left = np.arange(n) if cam.law.repeats else np.arange(n - 1)
    right = n + (left + 1) % n
    if isinstance(cam.follower.face, Flat):
        step = knots.distance[right] - knots.distance[left]
        turning, size = -cam.turn * step, np.abs(knots.reference[0][left])
    else:
        a, b = knots._d1[left], knots._d1[right]
        turning, size = -cam.turn * cam.flank * np.imag(np.conj(a) * b), np.abs(a) * np.abs(b)
    speeds = knots.motion[1]
    knock = np.abs(speeds[right] - speeds[left]) > VELOCITY_JUMP * np.abs(speeds).max()
    folded = knock & (turning > 1e-9 * size)
    return float(knots.angle[left[int(np.argmax(folded))]]) if folded.any() else None


def undercut_ranges(cam: Cam, angles: ArrayLike) -> list[tuple[float, float]]:
    """Ranges of the cam's angle, between the given ordered ones, over which the profile runs backwards (undercut)."""
    s = cam.at(angles)
    bad = s.sharpness < 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(int)))
    return [(float(s.angle[a]), float(s.angle[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


@dataclass(frozen=True)
class Requirement:
    """Limits that a cam has to meet; ``None``: no limit. Angles [rad], lengths [m].

    The lecture's three conditions: the smallest radius of curvature (strength and wear), the largest pressure angle (bending of
    the follower, load of the guide), for flat faces the largest pressure distance (bending of the stem).
    """

    radius: float | None = None
    pressure_rise: float | None = None
    pressure_fall: float | None = None
    distance: float | None = None


@dataclass(frozen=True)
class Verdict:
    """One condition: the allowed value, the value reached and its angle, and the margin (negative: the condition fails)."""

    condition: str
    allowed: float
    reached: float
    angle: float
    margin: float

    @property
    def passed(self) -> bool:
        return bool(self.margin >= -1e-12 * max(abs(self.allowed), abs(self.reached)))


def judge_limits(limits: CamLimits, want: Requirement) -> list[Verdict]:
    """Verdicts on the conditions that ``want`` states, and on undercut, which is never allowed."""
    out = [Verdict("no undercut", 0.0, limits.sharpness.value, limits.sharpness.angle, limits.sharpness.value)]
    if want.radius is not None:
        if limits.undercut:
            out.append(Verdict("least radius of curvature", want.radius, 0.0, limits.sharpness.angle, -want.radius))
        elif limits.convex is not None:
            r = limits.convex
            out.append(Verdict("least radius of curvature", want.radius, r.value, r.angle, r.value - want.radius))
    for name, allowed, reached in (
        ("pressure angle on the rise", want.pressure_rise, limits.rise),
        ("pressure angle on the return", want.pressure_fall, limits.fall),
    ):
        if allowed is not None:
            out.append(Verdict(name, allowed, reached.value, reached.angle, allowed - reached.value))
    if want.distance is not None and limits.distance_left is not None and limits.distance_right is not None:
        worst = max((limits.distance_left, limits.distance_right), key=lambda r: abs(r.value))
        out.append(Verdict("pressure distance", want.distance, abs(worst.value), worst.angle, want.distance - abs(worst.value)))
    return out


def check_limits(cam: Cam, want: Requirement, count: int = 3600) -> list[Verdict]:
    """``judge_limits`` on the extremes of ``find_limits``."""
    return judge_limits(find_limits(cam, count=count), want)
