"""The least base circle and the best offset with which a cam meets its limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mechcore.arrays import Real
from mechcore.cams.followers import Arc, Face, Flat, Follower, Knife, Oscillating, Roller, Translating
from mechcore.cams.limits import CamLimits, Requirement, Verdict, find_limits, judge_limits
from mechcore.cams.synthesis import Cam, cam_on_base
from mechcore.errors import Fault, MechanismError
from mechcore.laws.curve import MotionCurve
from mechcore.records import dataclass
from mechcore.texts import as_angle, as_length

Beside = Callable[[Cam], tuple[Cam, ...]]  # from a cam to the other profiles that its follower touches


def outer_flank(cam: Cam) -> tuple[Cam, ...]:
    """The outer flank of a groove whose inner flank is ``cam``."""
    return (replace(cam, outer=True),)


_EXACT = 1e-9  # largest negative margin, relative to its limit, that counts as rounding
_FIRST_STEP, _WIDER, _STEPS = 1e-3, 1.25, 60  # first step between base circles that are tried, over the size; growth; number


@dataclass(frozen=True, eq=False)
class Design:
    """A cam of least base circle: radius of the base circle [m], coordinate at zero lift, offset [m], limits reached, verdicts.

    ``decides``: the condition that is met with equality.
    """

    cam: Cam
    base: float
    start: float
    offset: float
    decides: str
    limits: CamLimits
    verdicts: tuple[Verdict, ...]


def greatest(lift: MotionCurve, cost: Callable[[Real], Real], count: int = 720) -> tuple[float, float]:
    """The largest value along a law of a cost of its value and derivatives (4, n) -> (n), and its angle: on a grid, at the knots,
    and on finer grids about the best point."""
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
    # finer and finer grids about the best sample: unlike a parabola they are not disturbed by a knot of the law nearby
    center, width = float(angle[k]), step
    for _ in range(6):
        near = center + width * np.linspace(-1.0, 1.0, 33)
        values = cost(lift(near, 3))
        m = int(np.argmax(values))
        center, width = float(near[m]), width / 12.0
        if values[m] > best:
            best, where = float(values[m]), center
    return best, where


def axis_distance(cam: Cam) -> float:
    """Least distance [m] of a disc cam's profile from its axis, for a knife, roller or mushroom follower; zero or negative where
    the profile reaches the axis, or where a translating follower passes through it."""
    follower, reach = cam.follower, cam.flank * cam.follower.radius

    def nearness(s: Real) -> Real:
        off: Real = np.abs(follower.reference(s[:1])[0]) - reach
        return -(np.minimum(off, s[0]) if isinstance(follower.guide, Translating) else off)

    return -greatest(cam.law, nearness)[0]


def _pitch_curvature(q: Real, e: float) -> Real:
    """Curvature of the pitch curve of a translating follower from heights and derivatives (>= 3, ...), offset e (theory 5.3)."""
    h, v = q[0], q[1] - e
    size = h * h + v * v
    return np.asarray((h * h - h * q[2] + v * (2.0 * q[1] - e)) / (size * np.sqrt(size)))


def _pressure_bounds(lift: MotionCurve, want: Requirement) -> list[tuple[float, float, str]]:
    """Least heights at zero lift for the limits of the pressure angles: (height for offset 0, its change per offset, name)."""
    out = []
    if want.pressure_rise is not None:
        t = float(np.tan(want.pressure_rise))
        out.append((greatest(lift, lambda s: s[1] / t - s[0])[0], -1.0 / t, "pressure angle on the rise"))
    if want.pressure_fall is not None:
        t = float(np.tan(want.pressure_fall))
        out.append((greatest(lift, lambda s: -s[1] / t - s[0])[0], 1.0 / t, "pressure angle on the return"))
    return out


def _heights(
    bounds: list[tuple[float, float, str]],
    e: float,
    radius: float,
    want: Requirement,
    least: float,
    samples: Real,
    groove: bool = False,
) -> tuple[float, str]:
    """Least height at zero lift of a translating round follower on a cam that turns counter-clockwise, and the condition that
    decides. The outer flank of a ``groove`` has the pitch curve's curvature with opposite sign, and the same limit."""
    from scipy.optimize import brentq

    s = samples
    hub = float(np.sqrt(max((least + radius) ** 2 - e * e, 0.0))), "base circle"
    stroke, below = float(np.ptp(s[0])) or 1.0, -float(s[0].min())
    clear = [(float(np.sqrt(max(radius**2 - e * e, 0.0))) + below, "distance from the axis")] if below > 1e-9 * stroke else []
    height, decides = max([hub, *clear, *((b + c * e, name) for b, c, name in bounds)])
    limit = radius + (want.radius or 0.0)
    if limit <= 0.0:
        return height, decides

    def excess(h0: float) -> float:
        q = s[:3].copy()
        q[0] += h0
        bent = _pitch_curvature(q, e)
        return float(np.max(np.abs(bent) if groove else bent)) * limit - 1.0

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
    """The height and what decides it, without the sampling error of the curvature: its extreme is taken between samples too."""
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
        if low > 1e6 * limit:  # a corner of the pitch curve at any size: the limits report it
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
    lift: MotionCurve,
    follower: Follower,
    want: Requirement,
    turn: int = 1,
    at_least: float = 0.0,
    count: int = 720,
    beside: Beside | None = None,
) -> Design:
    """The cam of least base circle that meets the limits with the given follower.

    ``lift``: program that starts at zero (metres, or radians of the arm). ``at_least``: least base circle for the hub [m];
    ``beside``: the other profiles that the follower of a cam touches, which have to meet the limits too. Undercut is never
    allowed. Raises where no base circle meets the limits.
    """
    alone = _least_alone(lift, follower, want, turn, at_least, count)
    return alone if beside is None else _least_together(alone, lift, want, beside)


def _least_together(alone: Design, lift: MotionCurve, want: Requirement, beside: Beside) -> Design:
    """The design of the first base circle, from that of ``alone`` on, with which the other profiles meet the limits too."""
    from scipy.optimize import brentq

    follower, turn = alone.cam.follower, alone.cam.turn

    def worst(base: float) -> tuple[float, Verdict, str]:
        cam = cam_on_base(lift, follower, base, turn)
        margins = [
            (-1.0 if least <= 0.0 else v.margin / (abs(v.allowed) or 1.0), v, v.condition + whose)
            for each, whose in ((cam, ""), *((other, " of the other profile") for other in beside(cam)))
            for least in [float(each.law.limits(0)[0].min())]  # beyond the axis there is no cam
            for v in judge_limits(find_limits(each, count=360), want)
        ]
        return min(margins, key=lambda margin: margin[0])

    margin, verdict, _ = worst(alone.base)
    if margin >= -_EXACT:
        return alone
    before, metres = alone.base, follower.guide.arm if isinstance(follower.guide, Oscillating) else 1.0
    size = max(alone.base, follower.radius, metres * float(np.ptp(lift.limits(0)[0])))
    for k in range(_STEPS):
        base = alone.base + _FIRST_STEP * size * _WIDER**k
        try:
            if worst(base)[0] >= 0.0:
                root = float(brentq(lambda b: worst(b)[0], before, base, xtol=1e-12 * size, rtol=1e-12))
                decides = worst(before + 0.999 * (root - before))[2]
                return _finish(cam_on_base(lift, follower, root, turn), root, alone.offset, decides, want)
        except MechanismError:  # the follower does not reach
            break
        before = base
    reached = as_length(verdict.reached) if verdict.allowed == want.radius else as_angle(verdict.reached, 4)
    raise MechanismError(
        Fault(
            "cam.base",
            f"no base circle keeps both profiles to the limits: on one of {as_length(alone.base)}, the least for the first, the "
            + ("other is undercut" if verdict.condition == "no undercut" else f"other reaches {reached}")
            + f" at {as_angle(verdict.angle, 4)}.",
            "Move the second roller, or loosen a limit.",
        )
    )


def _least_alone(lift: MotionCurve, follower: Follower, want: Requirement, turn: int, at_least: float, count: int) -> Design:
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
    return Design(cam, base, start, offset, decides, limits, tuple(judge_limits(limits, want)))


def _scan(lift: MotionCurve, follower: Follower, want: Requirement, turn: int, at_least: float) -> Design:
    """The design for any other follower: the first base circle, from below, at which no margin is negative."""
    from scipy.optimize import brentq

    d, arm = abs(follower.guide.pivot), follower.guide.arm  # type: ignore[union-attr]  # oscillating here
    r = follower.radius
    if isinstance(follower.face, Flat):
        low, high = 0.0, d
    else:
        low, high = max(abs(d - arm) - r, 0.0), d + arm - r
    low = max(low, at_least, 1e-6 * d)

    def worst(base: float) -> tuple[float, str]:
        cam = cam_on_base(lift, follower, base, turn)
        top = lift(lift.start + lift.length * np.arange(64) / 64.0, 0)[0].max() + follower.base_coordinate(base)
        if top >= np.pi:
            return -1.0, "reach of the arm"
        if not isinstance(follower.face, Flat) and axis_distance(cam) <= 0.0:
            return -1.0, "distance from the axis"
        verdicts = judge_limits(find_limits(cam, count=360), want)
        scale = [v.margin / (abs(v.allowed) or 1.0) for v in verdicts]
        k = int(np.nanargmin(scale))
        return scale[k], verdicts[k].condition

    grid = low + (high - low) * np.linspace(1e-6, 1.0 - 1e-6, 17) ** 1.5
    before = None
    for base in grid:
        if worst(float(base))[0] >= 0.0:
            if before is None:
                return _finish(cam_on_base(lift, follower, float(low) or float(base), turn), float(low), 0.0, "base circle", want)
            root = float(brentq(lambda b: worst(b)[0], before, base, xtol=1e-12 * d, rtol=1e-12))
            decides = worst(before + 0.999 * (root - before))[1]
            return _finish(cam_on_base(lift, follower, root, turn), root, 0.0, decides, want)
        before = float(base)
    raise MechanismError(
        Fault("cam.base", "no base circle keeps to the limits with this pivot and arm.", "Move the pivot, or loosen a limit.")
    )


def best_offset(
    lift: MotionCurve,
    face: Face,
    want: Requirement,
    turn: int = 1,
    at_least: float = 0.0,
    count: int = 720,
    beside: Beside | None = None,
) -> Design:
    """The design whose offset gives the least base circle that the limits allow (translating round follower). With `outer_flank`
    as ``beside`` it is the least for both flanks of a groove.

    Where the rise is the harder stroke, the offset is towards the side of the cam that moves up: positive for a cam that turns
    counter-clockwise, negative for one that turns clockwise. Where the return is, it is zero or towards the other side.
    """
    if isinstance(face, Flat):
        raise MechanismError(Fault("follower.offset", "of a flat face it changes nothing but the stem's load.", "Leave it out."))
    r = _round_radius(face)
    s = _samples(lift, count)
    bounds = _pressure_bounds(lift, want)

    def base_of(e: float) -> float:
        height, _ = _heights(bounds, e, r, want, at_least, s, beside is outer_flank)
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
    return least_base(lift, Follower(Translating(turn * e), face), want, turn, at_least, count, beside)
