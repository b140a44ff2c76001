"""Limits of plane cams, and the least base circle and the best offset that keep to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.cams.followers import Arc, Face, Flat, Follower, Knife, Roller, Translating
from mechcore.cams.synthesis import Cam, Synthesis, cam_on_base
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve
from mechcore.texts import as_angle, as_length


@dataclass(frozen=True)
class Reached:
    """An extreme value and the angle at which it is reached."""

    value: float
    angle: float


@dataclass(frozen=True)
class Limits:
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


def _grid(cam: Cam, given: Synthesis | None, count: int) -> tuple[Synthesis, Synthesis]:
    """The cam on a grid of one cycle, and its one-sided values at the law's knots."""
    law = cam.law
    if given is None:
        given = cam.at(law.start + law.length * (np.arange(count) / count))
    left, right = law.limits(2)
    knots = Synthesis(cam, np.concatenate([law.knots[1:], law.knots[:-1]]), np.vstack([left, right]).T.copy())
    return given, knots


def _vertex(x: Real, y: Real) -> Real:
    """Lowest points of the parabolas through three points each, x (m, 3) evenly spaced; kept within them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = 0.5 * (y[:, 0] - y[:, 2]) / (y[:, 0] - 2.0 * y[:, 1] + y[:, 2])
    shift = np.where(np.isfinite(shift), np.clip(shift, -1.0, 1.0), 0.0)
    return x[:, 1] + shift * (x[:, 2] - x[:, 1])


_QUANTITIES = ("rise", "fall", "sharp", "convex", "concave", "pitch", "left", "right")


def _costs(s: Synthesis, flat: bool) -> list[Real]:
    """Rows to be made least: one for each quantity of ``_QUANTITIES``; infinite where it does not exist."""
    alpha = s.cam.turn * s.pressure_angle
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = s.radius
        bend = 1.0 / radius
        critical = 1.0 / (s.cam.flank * s.pitch_radius)
    # curvature instead of radius: finite where the profile is straight, and least radius = greatest curvature
    rows = [
        -alpha,
        alpha,
        s.sharpness,
        np.where(radius > 0.0, -bend, np.inf),
        np.where(radius < 0.0, bend, np.inf),
        -critical,
    ]
    if flat:
        rows += [s.distance, -s.distance]
    return [np.where(np.isnan(row), np.inf, row) for row in rows]


def find_limits(cam: Cam, on: Synthesis | None = None, count: int = 3600) -> Limits:
    """Extremes over a cycle: on a grid (that of ``on``, even over the cycle, else ``count`` angles), then on finer grids and a
    parabola about each best point, and at the law's knots from both sides. Values are right to about 1e-12; angles to 1e-6.
    """
    flat = isinstance(cam.follower.face, Flat)
    grid, knots = _grid(cam, on, count)
    rows = _costs(grid, flat)
    width = cam.law.length / max(grid.angle.size, 2)
    center = np.array([grid.angle[int(np.argmin(row))] for row in rows])
    # finer grids about each best sample, then the vertex of the parabola through the best three points of the finest
    for _ in range(2):
        spread = width * np.linspace(-1.0, 1.0, 17)
        where = center[:, None] + spread
        close = [row.reshape(-1, 17)[m] for m, row in enumerate(_costs(cam.at(where.ravel()), flat))]
        spots = np.array([int(np.clip(np.argmin(row), 1, 15)) for row in close])
        center, width = where[np.arange(len(spots)), spots], width / 8.0
    three = np.array([row[m - 1 : m + 2] for row, m in zip(close, spots, strict=True)])
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
    return Limits(
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
    """The angle of a knot at which the velocity jumps so that the pitch curve has a convex corner (the profile a fold);
    None: nowhere."""
    n = len(cam.law.pieces)
    left = np.arange(n) if cam.law.repeats else np.arange(n - 1)
    right = n + (left + 1) % n
    if isinstance(cam.follower.face, Flat):
        step = knots.distance[right] - knots.distance[left]
        turning, size = -cam.turn * step, np.abs(knots.reference[0][left])
    else:
        a, b = knots._d1[left], knots._d1[right]
        turning, size = -cam.turn * cam.flank * np.imag(np.conj(a) * b), np.abs(a) * np.abs(b)
    folded = turning > 1e-9 * size
    return float(knots.angle[left[int(np.argmax(folded))]]) if folded.any() else None


def undercut_ranges(cam: Cam, angles: ArrayLike) -> list[tuple[float, float]]:
    """Ranges of the cam's angle, between the given ordered ones, over which the profile runs backwards (undercut)."""
    s = cam.at(angles)
    bad = s.sharpness < 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]]).astype(int)))
    return [(float(s.angle[a]), float(s.angle[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


@dataclass(frozen=True)
class Requirement:
    """What a cam is to keep to; ``None`` is not asked. Angles [rad], lengths [m].

    The lecture's three conditions: the smallest radius of curvature (strength and wear), the largest pressure angle (bending of
    the follower, load of the guide), for flat faces the largest pressure distance (bending of the stem).
    """

    radius: float | None = None
    pressure_rise: float | None = None
    pressure_fall: float | None = None
    distance: float | None = None


@dataclass(frozen=True)
class Verdict:
    """One condition: what was allowed, what is reached and where, and by how much it passes (negative: fails)."""

    condition: str
    allowed: float
    reached: float
    angle: float
    margin: float

    @property
    def passed(self) -> bool:
        return bool(self.margin >= -1e-12 * max(abs(self.allowed), abs(self.reached)))


def judge(limits: Limits, want: Requirement) -> list[Verdict]:
    """The conditions that are asked for, and no undercut, which always is."""
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
    """``judge`` on the extremes of ``find_limits``."""
    return judge(find_limits(cam, count=count), want)


@dataclass(frozen=True, eq=False)
class Design:
    """A cam of least base circle: its radius [m], the coordinate at zero lift, the offset, the limits it reaches, the verdicts.

    ``decides``: the condition that holds with equality.
    """

    cam: Cam
    base: float
    start: float
    offset: float
    decides: str
    limits: Limits
    verdicts: tuple[Verdict, ...]


def greatest(lift: MotionCurve, cost: Callable[[Real], Real], count: int = 720) -> tuple[float, float]:
    """The largest value along a law of a cost of its derivatives (4, n) -> (n), and its angle: grid, then parabolas, and the
    knots."""
    step = lift.length / count
    angle = lift.start + step * np.arange(count)
    y = cost(lift(angle, 3))
    k = int(np.argmax(y))
    best, where = float(y[k]), float(angle[k])
    left, right = lift.limits(3)
    for values, angles in ((cost(left.T), lift.knots[1:]), (cost(right.T), lift.knots[:-1])):
        m = int(np.argmax(values))
        if values[m] > best:
            best, where = float(values[m]), float(angles[m])
    # ever finer grids about the best sample: pieces of the law that meet nearby do not disturb them, as they would a parabola
    center, width = float(angle[k]), step
    for _ in range(6):
        near = center + width * np.linspace(-1.0, 1.0, 33)
        values = cost(lift(near, 3))
        m = int(np.argmax(values))
        center, width = float(near[m]), width / 12.0
        if values[m] > best:
            best, where = float(values[m]), center
    return best, where


def _pitch_curvature(q: Real, e: float) -> Real:
    """Curvature of the pitch curve of a translating follower from heights and derivatives (>= 3, ...), offset e (theory 5.3)."""
    h, v = q[0], q[1] - e
    size = h * h + v * v
    return np.asarray((h * h - h * q[2] + v * (2.0 * q[1] - e)) / (size * np.sqrt(size)))


def _pressure_bounds(lift: MotionCurve, want: Requirement) -> list[tuple[float, float, str]]:
    """Least height at zero lift that either pressure angle asks for: (height for offset 0, its change per offset, name)."""
    out = []
    if want.pressure_rise is not None:
        t = float(np.tan(want.pressure_rise))
        out.append((greatest(lift, lambda s: s[1] / t - s[0])[0], -1.0 / t, "pressure angle on the rise"))
    if want.pressure_fall is not None:
        t = float(np.tan(want.pressure_fall))
        out.append((greatest(lift, lambda s: -s[1] / t - s[0])[0], 1.0 / t, "pressure angle on the return"))
    return out


def _heights(
    bounds: list[tuple[float, float, str]], e: float, radius: float, want: Requirement, least: float, samples: Real
) -> tuple[float, str]:
    """Least height at zero lift of a translating round follower on a cam that turns counter-clockwise, and what decides."""
    from scipy.optimize import brentq

    s = samples
    hub = float(np.sqrt(max((least + radius) ** 2 - e * e, 0.0))), "base circle"
    height, decides = max([hub, *((b + c * e, name) for b, c, name in bounds)])
    limit = radius + (want.radius or 0.0)
    if limit <= 0.0:
        return height, decides

    def excess(h0: float) -> float:
        q = s[:3].copy()
        q[0] += h0
        return float(np.max(_pitch_curvature(q, e))) * limit - 1.0

    stroke = float(np.ptp(s[0])) or 1.0
    if height > 0.0 and excess(height) <= 0.0:
        return height, decides
    low = max(height, 1e-6 * stroke)
    if excess(low) <= 0.0:
        return low, decides
    high = low + 0.25 * stroke
    while excess(high) > 0.0:
        low, high = high, high + 1.5 * (high - low)
        if high > 1e6 * (stroke + limit):
            raise MechanismError(Fault("cam.radius", f"no base circle gives a radius of {as_length(limit)}.", "Loosen the limit."))
    return float(brentq(excess, low, high, xtol=1e-12 * high)), "least radius of curvature"


def _exact_height(lift: MotionCurve, e: float, radius: float, want: Requirement, height: float, decides: str) -> tuple[float, str]:
    """The answer with the sampling's error in the curvature removed: its extreme taken between the samples too."""
    from scipy.optimize import brentq

    limit = radius + (want.radius or 0.0)
    if limit <= 0.0:
        return height, decides
    height = max(height, 1e-9 * limit)

    def excess(h0: float) -> float:
        def cost(s: Real) -> Real:
            q = s[:3].copy()
            q[0] += h0
            return _pitch_curvature(q, e)

        return greatest(lift, cost)[0] * limit - 1.0

    if excess(height) <= 0.0:
        return height, decides
    low, step = height, 1e-4 * height
    while excess(low + step) > 0.0:
        low, step = low + step, 2.0 * step
        if low > 1e6 * limit:  # a corner of the pitch curve: no size helps, which the limits then say
            return height, decides
    return float(brentq(excess, low, low + step, xtol=1e-15, rtol=1e-14)), "least radius of curvature"


def _samples(lift: MotionCurve, count: int) -> Real:
    left, right = lift.limits(2)
    grid = lift(lift.start + lift.length * np.arange(count) / count, 2)
    return np.hstack([grid, left[:, :3].T, right[:, :3].T])


def _round_radius(face: Face) -> float:
    assert isinstance(face, Knife | Roller | Arc)
    return face.radius


def least_base(
    lift: MotionCurve, follower: Follower, want: Requirement, turn: int = 1, at_least: float = 0.0, count: int = 720
) -> Design:
    """The cam of least base circle that keeps to the limits, for the follower as it is.

    ``lift``: program that starts at zero (metres, or radians of the arm). ``at_least``: least base circle for the hub [m]. No
    undercut is always asked for. Raises where no base circle does it.
    """
    if isinstance(follower.guide, Translating) and not isinstance(follower.face, Flat):
        e = turn * follower.guide.offset  # a cam that turns clockwise is the mirror image
        r = follower.radius
        height, decides = _heights(_pressure_bounds(lift, want), e, r, want, at_least, _samples(lift, count))
        height, decides = _exact_height(lift, e, r, want, height, decides)
        return _translating(lift, follower, want, turn, max(height, 0.0), decides)
    if isinstance(follower.guide, Translating):
        assert isinstance(follower.face, Flat)
        c = np.cos(follower.face.tilt)
        need = greatest(lift, lambda s: -(s[0] + s[2]) * c)[0] + (want.radius or 0.0)
        base = max(need, at_least, 0.0)
        decides = "base circle" if base > need else "least radius of curvature"
        return _finish(cam_on_base(lift, follower, base, turn), base, 0.0, decides, want)
    return _scan(lift, follower, want, turn, at_least)


def _translating(lift: MotionCurve, follower: Follower, want: Requirement, turn: int, height: float, decides: str) -> Design:
    assert isinstance(follower.guide, Translating)
    e = follower.guide.offset
    cam = Cam(lift.raised(height), follower, turn)
    return _finish(cam, float(np.hypot(height, e)) - follower.radius, e, decides, want)


def _finish(cam: Cam, base: float, offset: float, decides: str, want: Requirement) -> Design:
    limits = find_limits(cam)
    corner = limits.sharpness.value == -np.inf or (limits.convex is not None and limits.convex.value == 0.0)
    if corner and (want.radius or limits.undercut):
        at = as_angle((limits.convex or limits.sharpness).angle)
        raise MechanismError(
            Fault("cam.law", f"its velocity jumps down at {at}: a corner on a cam of any size.", "Take a smoother law.")
        )
    start = float(cam.law.pieces[0].at(0.0, 0)[0])
    return Design(cam, base, start, offset, decides, limits, tuple(judge(limits, want)))


def _scan(lift: MotionCurve, follower: Follower, want: Requirement, turn: int, at_least: float) -> Design:
    """Any other follower: the first base circle, from below, at which all margins are positive."""
    from scipy.optimize import brentq

    d, arm = abs(follower.guide.pivot), follower.guide.arm  # type: ignore[union-attr]  # oscillating here
    r = follower.radius
    if isinstance(follower.face, Flat):
        low, high = 0.0, d
    else:
        low, high = max(abs(d - arm) - r, 0.0), d + arm - r
    low = max(low, at_least, 1e-6 * d)

    def worst(base: float, count: int = 144) -> tuple[float, str]:
        cam = cam_on_base(lift, follower, base, turn)
        top = lift(lift.start + lift.length * np.arange(64) / 64.0, 0)[0].max() + follower.base_coordinate(base)
        if top >= np.pi:
            return -1.0, "reach of the arm"
        verdicts = judge(find_limits(cam, count=count), want)
        scale = [v.margin / (abs(v.allowed) or 1.0) for v in verdicts]
        k = int(np.nanargmin(scale))
        return scale[k], verdicts[k].condition

    grid = low + (high - low) * np.linspace(1e-6, 1.0 - 1e-6, 17) ** 1.5
    before = None
    for base in grid:
        value, _ = worst(float(base))
        if value >= 0.0:
            if before is None:
                return _finish(cam_on_base(lift, follower, float(low) or float(base), turn), float(low), 0.0, "base circle", want)
            root = float(brentq(lambda b: worst(b, 360)[0], before, base, xtol=1e-12 * d, rtol=1e-12))
            decides = worst(before + 0.999 * (root - before))[1]
            return _finish(cam_on_base(lift, follower, root, turn), root, 0.0, decides, want)
        before = float(base)
    raise MechanismError(
        Fault("cam.base", "no base circle keeps to the limits with this pivot and arm.", "Move the pivot, or loosen a limit.")
    )


def best_offset(lift: MotionCurve, face: Face, want: Requirement, turn: int = 1, at_least: float = 0.0, count: int = 720) -> Design:
    """Offset and base circle together, the base circle as small as the limits allow (translating round follower).

    The offset comes out towards the side that moves up under a rise: positive for a cam that turns counter-clockwise, negative for
    one that turns clockwise, when the rise is the harder stroke; it is zero or on the other side when the return is.
    """
    if isinstance(face, Flat):
        raise MechanismError(Fault("follower.offset", "of a flat face it changes nothing but the stem's load.", "Leave it out."))
    r = _round_radius(face)
    s = _samples(lift, count)
    bounds = _pressure_bounds(lift, want)

    def base_of(e: float) -> float:
        height, _ = _heights(bounds, e, r, want, at_least, s)
        return float(np.hypot(max(height, 0.0), e))

    reach = float(np.abs(s[1]).max()) + float(np.ptp(s[0]))
    grid = np.linspace(-reach, reach, 25)
    values = [base_of(float(e)) for e in grid]
    k = int(np.argmin(values))
    a, b = float(grid[max(k - 1, 0)]), float(grid[min(k + 1, len(grid) - 1)])
    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    x1, x2 = b - ratio * (b - a), a + ratio * (b - a)
    f1, f2 = base_of(x1), base_of(x2)
    for _ in range(46):
        if f1 <= f2:
            b, x2, f2 = x2, x1, f1
            x1 = b - ratio * (b - a)
            f1 = base_of(x1)
        else:
            a, x1, f1 = x1, x2, f2
            x2 = a + ratio * (b - a)
            f2 = base_of(x2)
        if b - a < 1e-10 * reach:
            break
    e = 0.5 * (a + b)
    if base_of(0.0) <= base_of(e) * (1.0 + 1e-12):
        e = 0.0
    return least_base(lift, Follower(Translating(turn * e), face), want, turn, at_least, count)
