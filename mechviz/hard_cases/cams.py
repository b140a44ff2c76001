"""Hard cases of cams: offset rollers, undercut, cusps, pressure angles, jumps of laws, follower separation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mechcore.cams.analysis import analyse
from mechcore.cams.closures import Closure, closing_force, first_separation
from mechcore.cams.contour import cam_contour, polygon
from mechcore.cams.followers import Flat, Follower, Knife, Oscillating, Roller, Translating
from mechcore.cams.limits import Requirement, find_limits, undercut_ranges
from mechcore.cams.real_profiles import cut_profile
from mechcore.cams.sizing import least_base
from mechcore.cams.synthesis import Cam, cam_on_base
from mechcore.constants import TURN
from mechcore.forces.cam_events import cam_events
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.catalogue import rise
from mechcore.laws.factors import jumps
from mechcore.laws.program import Segment, program
from mechcore.laws.timed import ConstantSpeed
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechcore.spec.loads import Spring
from mechcore.spec.mechanism import CamJoint, Drive, Link, Mechanism, Prismatic, Revolute
from mechviz.hard_cases.case import Case, Outcome, check_that, compare, motion_outcome, refusal_outcome

STROKE, UP = 0.02, 2.0
LIFT = program([Segment(UP, STROKE, "cycloidal"), Segment(1.0), Segment(1.6, 0.0, "cycloidal"), Segment(TURN - 4.6)])


def _cycloidal(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lift, first and second derivative of `LIFT` by hand: h (x - sin(2 pi x) / (2 pi)) on the rise, backwards on the return."""
    s, s1, s2 = np.zeros_like(theta), np.zeros_like(theta), np.zeros_like(theta)
    for low, length, sign in ((0.0, UP, 1.0), (3.0, 1.6, -1.0)):
        x = (theta - low) / length
        on = (x >= 0.0) & (x <= 1.0)
        s[on] = STROKE * (x - np.sin(TURN * x) / TURN)[on] if sign > 0 else STROKE * (1.0 - x + np.sin(TURN * x) / TURN)[on]
        s1[on] = sign * (STROKE / length * (1.0 - np.cos(TURN * x)))[on]
        s2[on] = sign * (STROKE / length**2 * TURN * np.sin(TURN * x))[on]
    s[(theta > UP) & (theta < 3.0)] = STROKE
    return s, s1, s2


def _offset_roller(theta: np.ndarray, e: float, roller: float, base: float) -> dict[str, np.ndarray]:
    """Profile, pressure angle and radius of an offset roller follower by hand; ``base`` is the pitch circle's radius.

    Pitch curve p = exp(-i theta) (e + i (h0 + s)); tan(alpha) = (s' - e) / (h0 + s); radius of p by its two derivatives.
    """
    s, s1, s2 = _cycloidal(theta)
    h = np.sqrt(base**2 - e**2) + s
    z, turn = e + 1j * h, np.exp(-1j * theta)
    p1 = turn * (1j * s1 - 1j * z)
    p2 = turn * (1j * s2 + 2.0 * s1 - z)
    normal = -1j * p1 / np.abs(p1)  # the curve runs clockwise: to its left is outside
    normal = np.where(np.real(np.conj(normal) * turn * z) < 0.0, -normal, normal)
    radius = np.abs(p1) ** 3 / np.imag(np.conj(p1) * p2)
    return {
        "pitch": turn * z,
        "working": turn * z - roller * normal,
        "pressure": np.arctan2(s1 - e, h),
        "radius": np.abs(radius) * np.sign(-radius),
    }


def _profile_case(what: str) -> Outcome:
    e, roller, base = 0.01, 0.008, 0.04
    theta = np.linspace(0.0, TURN, 3600, endpoint=False) + 1e-4
    s = cam_on_base(LIFT, Follower(Translating(e), Roller(roller)), base - roller).at(theta)
    want = _offset_roller(theta, e, roller, base)
    if what == "pressure":
        checks = [compare("pressure angle", s.pressure_angle, want["pressure"], 1e-12)]
        return Outcome(f"up to {np.degrees(np.abs(s.pressure_angle).max()):.8g}°", tuple(checks))
    checks = [
        compare("pitch curve", np.abs(s.pitch - want["pitch"]) / base, 0.0, 1e-12),
        compare("profile", np.abs(s.working - want["working"]) / base, 0.0, 1e-12),
        compare("curvature of the pitch curve", base / s.pitch_radius, base / want["radius"], 1e-11),
    ]
    return Outcome(f"largest relative error {max(c.error for c in checks):.1e}", tuple(checks))


def _modified_trapezoid() -> Outcome:
    """Acceleration 8 pi / (2 + pi) times sine quarters and constants; its integral, the velocity, by Gauss quadrature."""
    law = rise("modified-trapezoid")
    peak = 8.0 * np.pi / (2.0 + np.pi)
    x = np.linspace(0.0, 1.0, 801)

    def wanted(u: np.ndarray) -> np.ndarray:
        v = np.minimum(u, 1.0 - u)
        return (
            np.where(u < 0.5, 1.0, -1.0)
            * peak
            * np.where(v < 0.125, np.sin(4 * np.pi * v), np.where(v > 0.375, np.sin(4 * np.pi * (0.5 - v)), 1.0))
        )

    nodes, weights = np.polynomial.legendre.leggauss(20)
    width = np.diff(x)
    inner = x[:-1, None] + 0.5 * width[:, None] * (nodes + 1.0)
    speed = np.concatenate([[0.0], np.cumsum(0.5 * width * (wanted(inner) @ weights))])
    got = law(x, 2)
    checks = [
        compare("acceleration", got[2][1:-1], wanted(x)[1:-1], 1e-12),
        compare("velocity", got[1], speed, 1e-12),
        compare("whole rise", got[0][-1], 1.0, 1e-14),
        check_that("no jump of position, velocity, acceleration", not jumps(law, (0, 1, 2))),
    ]
    return Outcome(f"peak acceleration {np.abs(got[2]).max():.10g}", tuple(checks))


def _cusp() -> Outcome:
    """A roller as large as the least radius of the pitch curve makes a cusp; a thousandth more undercuts."""
    theta = np.linspace(0.0, TURN, 100_001)
    radius = _offset_roller(theta, 0.004, 0.0, 0.03)["radius"]
    least = float(np.min(np.where(radius > 0.0, radius, np.inf)))
    limits = find_limits(
        Cam(cam_on_base(LIFT, Follower(Translating(0.004), Knife()), 0.03).law, Follower(Translating(0.004), Roller(0.001)))
    )
    assert limits.greatest_roller is not None
    greatest = float(limits.greatest_roller.value)
    law = cam_on_base(LIFT, Follower(Translating(0.004), Knife()), 0.03).law
    states = [find_limits(Cam(law, Follower(Translating(0.004), Roller(part * greatest)))).undercut for part in (0.999, 1.001)]
    ranges = undercut_ranges(Cam(law, Follower(Translating(0.004), Roller(1.001 * greatest))), np.linspace(0.0, TURN, 20_000))
    checks = [
        compare("greatest roller", greatest, least, 1e-6),
        check_that("undercut above, not below", states == [False, True]),
        check_that("its range is named", len(ranges) >= 1),
    ]
    return Outcome(f"greatest roller {1e3 * greatest:.9g} mm", tuple(checks), events=("undercut",) if states[1] else ())


def _flat_undercut() -> Outcome:
    """A flat follower needs r0 + s + s'' > 0: the least base circle is -min(s + s'')."""
    theta = np.linspace(0.0, TURN, 100_001)
    s, _, s2 = _cycloidal(theta)
    least = -float(np.min(s + s2))
    below, above = (
        find_limits(cam_on_base(LIFT, Follower(Translating(), Flat()), part * least)).undercut for part in (1.0 - 1e-6, 1.0 + 1e-6)
    )
    exact = find_limits(cam_on_base(LIFT, Follower(Translating(), Flat()), 0.05))
    _, s1, _ = _cycloidal(theta)
    checks = [
        check_that("undercut below, not above", below and not above),
        compare("length of the face", exact.face_length, np.ptp(s1), 1e-8),
    ]
    return Outcome(f"least base circle {1e3 * least:.8g} mm", tuple(checks), events=("undercut",))


def _cut() -> Outcome:
    """The profile that a cutter leaves where it undercuts: it lies inside the nominal one, and the roller cannot follow the law
    there."""
    law = program([Segment(0.8, 0.03), Segment(0.4, 0.03), Segment(0.8, 0.0), Segment(TURN - 2.0)])
    follower = Follower(Translating(), Roller(0.02))
    cam = cam_on_base(law, follower, 0.02)
    limits = find_limits(cam)
    cut = cut_profile(cam)
    contact = analyse(cut.contour, follower, np.linspace(0.0, TURN, 721))
    home = cam.law(np.linspace(0.0, TURN, 721))[0]
    lost = home - contact.motion[0]
    checks = [
        check_that("undercut", limits.undercut),
        check_that("never above the law", lost > -1e-9),
        check_that("below it somewhere", lost.max() > 1e-5),
        compare("as far as it says", cut.error, lost.max(), 0.01),
    ]
    return Outcome(f"the follower falls short by {1e3 * lost.max():.4g} mm", tuple(checks), events=("undercut",))


def _separation() -> Outcome:
    """A spring that is too weak: contact is lost where k (d0 + s) + m g + m w^2 s'' = 0 at the lowest speed, found by a fine scan
    by hand."""
    closure = Closure(mass=0.4, stiffness=2000.0, preload=0.01)
    lost = first_separation(closure, LIFT)
    assert lost is not None
    theta = np.linspace(0.0, TURN, 500_001)
    s, _, s2 = _cycloidal(theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        speeds = np.where(s2 < 0.0, np.sqrt((2000.0 * (0.01 + s) + 0.4 * 9.81) / (-0.4 * s2)), np.inf)
    k = int(np.argmin(speeds))
    there = LIFT(np.array([lost.angle]), 2)
    force = closing_force(closure, there[0], there[2], lost.speed)
    checks = [
        compare("speed", lost.speed, speeds[k], 1e-9),
        compare("angle", lost.angle, theta[k], 1e-5),
        compare("no force there", force[0], 0.0, 1e-9),
    ]
    return Outcome(f"lost at {lost.speed:.9g} rad/s, {np.degrees(lost.angle):.6g}°", tuple(checks), events=("contact lost",))


def _joint(face: Any, **more: object) -> Mechanism:
    """A translating follower with its spring, driven at 20 rad/s; ``more``: values of the joint that a case varies."""
    own: dict[str, Any] = {"lift": LIFT, "base": 0.04, **more}
    return Mechanism(
        name="cam",
        frame="frame",
        links=(
            Link(name="frame", points={"O": (0.0, 0.0), "G": (0.0, 0.0), "H": (0.0, 0.2)}),
            Link(name="cam", points={"O": (0.0, 0.0)}, mass=1.2, centre=(0.003, 0.002), inertia=2e-3),
            Link(name="follower", points={"T": (0.0, 0.0), "E": (0.0, 0.06)}, mass=0.4, centre=(0.0, 0.03)),
        ),
        joints=(
            Revolute(name="O", links=("frame", "cam"), points=("O", "O")),
            Prismatic(name="S", links=("frame", "follower"), points=("G", "T"), along=(0.0, 1.0)),
            CamJoint(name="K", links=("cam", "follower"), guide="S", point="T", face=face, **own),
        ),
        drives=(Drive(joint="O", law=ConstantSpeed(0.3, 20.0)),),
        loads=(Spring(name="spring", links=("frame", "follower"), points=("H", "E"), stiffness=4e3, free_length=0.2),),
        effects=("inertia", "gravity"),
    )  # fmt: skip


def _loses_contact() -> Outcome:
    """The joint reports the interval in which its contact force would have to pull; the force along the guide by hand."""
    m = _joint(Roller(0.01))
    m = replace(m, drives=(Drive(joint="O", law=ConstantSpeed(0.0, 200.0)),))
    motion = solve_motion(compile_mechanism(m), np.linspace(0.0, TURN / 200.0, 721))
    forces = solve_forces(motion)
    theta = np.linspace(0.0, TURN, 721)
    s, _, s2 = _cycloidal(theta)
    geometry = next(r.geometry for r in motion.model.relations if r.geometry is not None)
    height = motion.coordinate("S")[:, 0]
    along = 4e3 * (0.2 - (0.2 - height - 0.06)) + 0.4 * 9.81 + 0.4 * 200.0**2 * s2
    said = [e for e in cam_events(motion, forces) if e.text.startswith("contact lost")]
    checks = [
        compare("force along the guide", forces.reaction("K")[:, 1], along, 1e-9),
        check_that("pulls somewhere", along.min() < 0.0),
        check_that("an event says so", len(said) > 0),
        check_that("on the law", np.abs(geometry.rows(motion).lift - s).max() < 1e-12),
    ]
    return motion_outcome(motion, f"{along.min():.5g} N at least", checks, forces, [e.text.split(":")[0] for e in said])


def _knife_on_a_square() -> Outcome:
    """A knife on a square cam that turns about its centre: r = a / cos(theta) up to the corners, at which it is carried over the
    corner."""
    contour = polygon([0.03 + 0.03j, -0.03 + 0.03j, -0.03 - 0.03j, 0.03 - 0.03j])
    theta = np.linspace(0.0, TURN, 361)
    contact = analyse(contour, Follower(Translating(), Knife()), theta)
    folded = (theta + np.pi / 4) % (np.pi / 2) - np.pi / 4
    checks = [
        compare("height", contact.motion[0], 0.03 / np.cos(folded), 1e-12),
        check_that("four corners", sum(b.shock for b in contact.bridges) in (3, 4)),
    ]
    return Outcome(
        f"{1e3 * np.ptp(contact.motion[0]):.8g} mm lift", tuple(checks), events=(f"{len(contact.bridges)} corners passed",)
    )


def _round_trip() -> Outcome:
    """The profile from synthesis, analysed as a given contour, moves the follower by the same law."""
    cam = cam_on_base(LIFT, Follower(Oscillating(0.1 + 0.0j, 0.09), Roller(0.012)), 0.04)
    theta = np.linspace(0.0, TURN, 361) + 1e-3
    contact = analyse(cam_contour(cam), cam.follower, theta)
    want = cam.law(theta, 2)
    checks = [
        compare(n, contact.motion[k], want[k], b)
        for k, (n, b) in enumerate((("position", 1e-9), ("velocity", 1e-6), ("acceleration", 1e-4)))
    ]
    return Outcome(f"law found again to {checks[0].error:.1e}", tuple(checks))


def _high_pressure() -> Outcome:
    """A base circle so small that the pressure angle exceeds 56 degrees: tan(alpha) = s' / (r0 + s) by a fine scan."""
    theta = np.linspace(0.0, TURN, 200_001)
    s, s1, _ = _cycloidal(theta)
    limits = find_limits(cam_on_base(LIFT, Follower(Translating(), Knife()), 0.006))
    want = float(np.arctan2(s1, 0.006 + s).max())
    fall = float(np.arctan2(-s1, 0.006 + s).max())
    checks = [compare("rise", limits.rise.value, want, 1e-8), compare("return", limits.fall.value, fall, 1e-8)]
    return Outcome(f"{np.degrees(limits.rise.value):.9g}° at {np.degrees(limits.rise.angle):.6g}°", tuple(checks))


def _jerk() -> Outcome:
    """Parabolic rises: the acceleration jumps by 4 h / beta^2 at the ends and by 8 h / beta^2 in the middle, without any
    smoothing."""
    law = program([Segment(UP, STROKE, "parabolic"), Segment(1.0), Segment(1.6, 0.0, "parabolic"), Segment(TURN - 4.6)])
    steps = jumps(law, (0, 1, 2))
    sizes = sorted(abs(j.size) for j in steps)
    unit, other = 4 * STROKE / UP**2, 4 * STROKE / 1.6**2
    want = sorted([unit, 2 * unit, unit, other, 2 * other, other])
    checks = [
        check_that("six jumps, all of the acceleration", [j.order for j in steps] == [2] * 6),
        compare("sizes", sizes if len(sizes) == 6 else [np.nan] * 6, want, 1e-12),
    ]
    return Outcome(f"{len(steps)} jumps of the acceleration", tuple(checks), events=(f"{len(steps)} jumps",))


def _unreachable() -> Outcome:
    return refusal_outcome(
        lambda: compile_mechanism(_joint(Roller(0.05), base=0.002)), "undercut.*radius of 50 mm on a pitch curve"
    )


def _not_closed() -> Outcome:
    lift = program([Segment(2.0, 0.01), Segment(2.0, 0.0)])
    return refusal_outcome(lambda: compile_mechanism(_joint(Roller(0.01), lift=lift)), r"229\.183°", r"Add a dwell of 130\.817")


def _base_circle() -> Outcome:
    """At 30 degrees on rise and return: h0 = max(|s' - e| / tan 30 - s) by a fine scan, the pitch circle hypot(e, h0)."""
    e, roller, limit = 0.01, 0.004, np.radians(30.0)
    least = least_base(LIFT, Follower(Translating(e), Roller(roller)), Requirement(pressure_rise=limit, pressure_fall=limit))
    theta = np.linspace(0.0, 4.6, 400_001)
    s, s1, _ = _cycloidal(theta)
    want = float(np.hypot(e, np.max(np.abs(s1 - e) / np.tan(limit) - s))) - roller
    checks = [compare("base circle", least.base, want, 1e-8)]
    return Outcome(f"least base circle {1e3 * least.base:.8g} mm", tuple(checks))


CASES = (
    Case(
        "P5 base circle for a pressure angle",
        "cams",
        "the least base circle for 30 degrees with an offset: rise and return differ",
        "a fine scan of (s' - e) / (h0 + s)",
        _base_circle,
        "mechanism is off by 3 %",
    ),
    Case(
        "P5 offset roller: profile",
        "cams",
        "pitch curve, profile and curvature of an offset roller follower, 3600 points",
        "by hand, to 1e-12",
        lambda: _profile_case("profile"),
        "mechanism ignores roller and offset: 8 % of the lift",
    ),
    Case(
        "P5 offset roller: pressure angle",
        "cams",
        "it depends on the offset's sign",
        "tan(alpha) = (s' - e)/(h0 + s)",
        lambda: _profile_case("pressure"),
        "pylinkage is off by 11.8 degrees",
    ),
    Case(
        "P5 modified trapezoid",
        "cams",
        "five pieces that must fit to the second derivative",
        "quadrature of its acceleration; no jump",
        _modified_trapezoid,
        "pylinkage's jumps",
    ),
    Case(
        "a roller that makes a cusp",
        "cams",
        "the roller is as large as the least radius of the pitch curve",
        "radius of curvature by hand",
        _cusp,
        "no open Python peer finds undercut",
    ),
    Case(
        "flat follower at its threshold",
        "cams",
        "a millionth below the least base circle",
        "-min(s + s'')",
        _flat_undercut,
        "no open Python peer finds undercut",
    ),
    Case(
        "what the cutter leaves",
        "cams",
        "an undercut profile is not what was drawn",
        "analysed as a contour, the follower falls short",
        _cut,
    ),
    Case("speed at which contact is lost", "cams", "least over angles of a quotient with poles", "fine scan by hand", _separation),
    Case(
        "contact lost in the machine",
        "cams",
        "a force-closed follower would have to be pulled",
        "k (d0 + s) + m g + m w^2 s''",
        _loses_contact,
    ),
    Case("knife on a square", "cams", "corners: velocity jumps, contact stands still", "a / cos(theta)", _knife_on_a_square),
    Case("law found again", "cams", "contact found globally on a given profile", "the law that made it", _round_trip),
    Case("steep cam", "cams", "pressure angles beyond 56 degrees", "fine scan by hand", _high_pressure),
    Case("jumps of acceleration", "cams", "parabolic law: jerk without bound", "4 h / beta^2", _jerk),
    Case("roller larger than its cam", "cams", "no profile makes this motion", "refused with the radius", _unreachable),
    Case(
        "a program of 229 degrees",
        "cams",
        "the law does not close after a turn",
        "refused with the dwell that is missing",
        _not_closed,
    ),
)
