"""Kinematic metrics: instant centres, transmission angles, velocity ratios, mechanical advantage, Grashof type, curvature.

All of them describe geometry, not speed: they use the motion per unit of a drive's coordinate, so that they exist while the drive
is at rest. Ratios are those of the first drive while all others are at rest. Instant centres and curvatures are those of the actual
motion: where several drives move, or forces drive several freedoms, they exist while something moves. Everything is vectorised over
the frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial, reduce, wraps
from itertools import combinations
from typing import Any, TypeVar

import numpy as np

from mechcore.arrays import Complex, Flags, Plane, Real
from mechcore.constants import REST
from mechcore.kinematics.model import Model
from mechcore.kinematics.rates import Rates
from mechcore.kinematics.state import Interpolant
from mechcore.laws.timed import Free, moves
from mechcore.motion.motion import Motion
from mechcore.numerics.tape import value_of
from mechcore.records import dataclass

T = TypeVar("T")
CHANGE_POINT = 1e-12  # of the perimeter: below, a Grashof margin is rounding


def over_parts(compute: Callable[..., T]) -> Callable[..., T]:
    """Decorator: compute a result of a motion part by part and join the results frame by frame."""

    @wraps(compute)
    def joined(motion: Motion, *args: object) -> T:
        return motion.over_parts(lambda part: compute(part, *args))

    return joined


def per_unit_drive_speed(motion: Motion, lead: int = 0, sense: Real | float = 1.0) -> Motion:
    """The same positions moved by drive number ``lead`` alone, at unit speed in a ``sense`` (F,) without acceleration; all others
    are at rest."""
    zero = np.zeros(motion.frames)
    drives = [(d[0], zero + (sense if i == lead else 0.0), zero) for i, d in enumerate(motion.drives)]
    beside = [value_of(d[1]) != 0.0 for i, d in enumerate(motion.drives) if i != lead]
    pace = motion.drives[lead][1] * sense  # next to change points only the rates of the whole motion are known
    return _at_pace(motion, drives, np.where(np.any(beside, axis=0), np.nan, pace), motion.drives[lead][2] * sense)


def ratio_in_time(motion: Motion, joint: str) -> Real:
    """Velocity ratio of a joint to the first drive, and its rate (F, 2) [1/s], whichever drives move.

    The rate has the mixed derivatives by the first drive and each other. Accelerations are a quadratic form of the drives' speeds,
    so that they are a quarter of the difference of two: with a speed of the first drive that is greater and less by one.
    """
    unit = per_unit_drive_speed(motion).coordinate(joint)
    if not any(np.any(v) for _, v, _ in motion.drives[1:]):
        return np.stack([unit[:, 1], unit[:, 2] * motion.drives[0][1]], axis=-1)
    (first, speed, _), *others = motion.drives
    zero, unknown = np.zeros(motion.frames), np.full(motion.frames, np.nan)
    ahead, behind = (
        _at_pace(motion, [(first, speed + more, zero), *((q, v, zero) for q, v, _ in others)], unknown, zero).coordinate(joint)
        for more in (1.0, -1.0)
    )
    return np.stack([unit[:, 1], 0.25 * (ahead[:, 2] - behind[:, 2])], axis=-1)


def along_motion(motion: Motion) -> Motion:
    """The same positions passed as in the motion itself, but at unit speed.

    If one drive moves, it has unit speed, even while it is at rest. If several move, the norm of their speeds (angles in rad,
    displacements in units of the mechanism's size) is 1; at rest they are NaN. A motion driven by forces keeps its sense.
    """
    moving = [i for i, d in enumerate(motion.mechanism.drives) if moves(d.law)]
    if len(moving) < 2:
        lead = moving[0] if moving else 0
        free = isinstance(motion.mechanism.drives[lead].law, Free)  # parts of its motion may be driven by other coordinates
        return per_unit_drive_speed(motion, lead, np.where(value_of(motion.drives[lead][1]) < 0.0, -1.0, 1.0) if free else 1.0)
    units = [1.0 if motion.model.rotary(d.joint) else motion.model.length_scale for d in motion.mechanism.drives]
    rates = [(v / unit, a / unit) for (_, v, a), unit in zip(motion.drives, units, strict=True)]
    square = sum(v * v for v, _ in rates)
    rest = value_of(square) <= REST**2 * np.fmax.reduce(value_of(square), axis=-1, initial=0.0)
    pace = np.sqrt(np.where(rest, np.nan, square))
    change = sum(v * a for v, a in rates) / pace
    drives = [(q, v / pace, (a - v * change / pace) / pace**2) for q, v, a in motion.drives]
    return _at_pace(motion, drives, pace, change)


def _at_pace(motion: Motion, drives: Sequence[tuple[Real, Real, Real]], pace: Real, change: Real) -> Motion:
    """A motion with other rates ``drives``: derivatives by a parameter whose first and second derivatives by time are ``pace`` and
    ``change`` (F,)."""
    interpolants: dict[int, list[Interpolant]] = {}
    with np.errstate(divide="ignore", invalid="ignore"):
        for block, given in (motion.interpolants or {}).items():
            for interpolant in given:  # frames next to a change point: from rates in time to derivatives by the parameter
                v, a = (np.broadcast_to(x, motion.frames)[interpolant.frames, None] for x in (pace, change))
                first = interpolant.first / v
                interpolants.setdefault(block, []).append(
                    replace(interpolant, first=first, second=(interpolant.second - first * a) / v**2)
                )
    return Motion(motion.model, motion.time, drives, motion.state, motion.angles, interpolants, accuracy=motion.accuracy)


def metric_items(metric: str, m: Model) -> list[Any]:
    """Items that a metric is computed for: names of joints or blocks, pairs of links, or traced points; known beforehand."""
    match metric:
        case "transmission_angle":
            return [block.name for block in m.blocks if block.kind == "theta_theta"]
        case "velocity_ratio":
            return [c.name for c in m.connections if c.kind != "weld"]
        case "mechanical_advantage":
            first = m.mechanism.drives[0].joint
            return [c.name for c in m.connections if c.kind != "weld" and m.mechanism.frame in c.links and c.name != first]
        case "instant_centre":
            return [(m.links[a], m.links[b]) for a, b in pairs_in_plane(m)]
        case "curvature":
            return list(m.mechanism.traced)
    raise ValueError(f"there is no answer '{metric}'")


def pairs_in_plane(m: Model) -> list[tuple[int, int]]:
    """All pairs of links that move in the plane; without those that turn about a shaft lying in it."""
    return list(combinations([k for k in range(len(m.links)) if k not in m.shafts], 2))


@over_parts
def relative_turns(motion: Motion) -> dict[tuple[str, str], tuple[Real, Complex]]:
    """Relative motion of every pair of links in the plane, at the rates of `along_motion`: the angular velocity (F,) of the first
    minus that of the second, 0 where that is rounding, and the velocity (F,) of the second relative to the first at the world's
    origin. The latter divided by i times the former is the instant centre."""
    unit = along_motion(motion)
    m, n = motion.model, motion.frames
    rates: Rates = unit.speeds
    turns = [np.broadcast_to(rates.angular[m.angles.rotation_class[k]], (n,)) for k in range(len(m.links))]
    still = [np.broadcast_to(v - 1j * w * o, (n,)) for v, w, o in zip(unit.origin_velocities, turns, unit.origins, strict=True)]
    # by frame: at a dead point of the drive rates are unbounded
    least = 1e-12 * np.fmax.reduce([np.abs(value_of(w)) for w in turns])
    out = {}
    for a, b in pairs_in_plane(m):
        turn = turns[a] - turns[b]
        out[m.links[a], m.links[b]] = np.where(np.abs(value_of(turn)) <= least, 0.0, turn), still[b] - still[a]
    return out


def instant_centres(motion: Motion) -> dict[tuple[str, str], Real]:
    """Instant centre (F, 2) [m] of every pair of links in the plane, the point at which their velocities agree.

    There are n (n - 1) / 2 pairs. Where two links do not turn relative to each other, it is infinite, with the signs of its
    direction.
    """
    out = {}
    for pair, (turn, shift) in relative_turns(motion).items():
        parallel = value_of(turn) == 0.0
        with np.errstate(invalid="ignore"):
            centre = shift / (1j * np.where(parallel, 1.0, turn))
        x, y = (np.where(parallel, np.copysign(np.inf, value_of(part)), part) for part in (centre.real, centre.imag))
        out[pair] = np.stack([x, y], axis=-1)
    return out


def transmission_angles(motion: Motion) -> dict[str, Real]:
    """Angle (F,) [rad], 0 to pi, between the two links of every RRR group at the pin that joins them; best at pi/2.

    NaN where a motion under forces uses another joint as its coordinate, so that the mechanism has other groups.
    """
    names = metric_items("transmission_angle", motion.model)
    return motion.over_parts(partial(_transmission_angles, names=names))


def _transmission_angles(motion: Motion, names: Sequence[str]) -> dict[str, Real]:
    m = motion.model
    out: dict[str, Real] = {name: np.full(motion.shape, np.nan) for name in names}
    for block in (b for b in m.blocks if b.kind == "theta_theta" and b.name in out):
        arms: dict[int, Plane] = dict.fromkeys(block.angles, 0j)
        for rotation_class, z in motion.loop_vectors[block.loops[0]].arms:
            group = m.angles.class_group[rotation_class]
            if group in arms:
                arms[group] = arms[group] + z
        a, b = (arms[g] for g in block.angles)
        angle = np.abs(np.angle(-a * np.conj(b)))  # both seen from the common pin
        out[block.name] = np.broadcast_to(angle, motion.shape)
    return out


def transmission_rows(motion: Motion) -> dict[str, Real]:
    """Angles (F, 2) [rad] of `transmission_angles`, and the acute ones between the same lines: the smaller of each and its
    supplement, at most pi/2."""
    return {name: np.stack([x, np.minimum(x, np.pi - x)], axis=-1) for name, x in transmission_angles(motion).items()}


def velocity_ratios(motion: Motion) -> dict[str, Real]:
    """Rate of every joint's coordinate per unit rate of the first drive (F,) [rad/rad, m/rad ...]."""
    unit = per_unit_drive_speed(motion)
    return {name: unit.coordinate(name)[:, 1] for name in metric_items("velocity_ratio", motion.model)}


def ratio_units(model: Model, joint: str) -> tuple[str, str]:
    """SI units of a joint's velocity ratio to the first drive, and of its mechanical advantage, which is a force per torque where a
    crank drives a slide: "1" where both turn or both slide."""
    turns = model.rotary(joint)
    if turns == model.rotary(model.mechanism.drives[0].joint):
        return "1", "1"
    return ("rad/m", "m") if turns else ("m/rad", "1/m")


def mechanical_advantage(motion: Motion) -> dict[str, Real]:
    """Output torque or force per input torque or force of an ideal mechanism (F,), for every joint at the frame link, in the units
    of `ratio_units`.

    By the power balance it is the reciprocal of the velocity ratio; infinite where the output is at rest (dead point, toggle).
    """
    ratios = velocity_ratios(motion)
    with np.errstate(divide="ignore"):
        return {name: 1.0 / np.abs(ratios[name]) for name in metric_items("mechanical_advantage", motion.model)}


@over_parts
def curvature(motion: Motion, link: str, point: str) -> Real:
    """Signed curvature (F,) [1/m] of the path of a point: positive where it bends to the left; NaN where the point is at rest, but
    for rounding, while others move.

    (x' y'' - y' x'') / (x'^2 + y'^2)^(3/2), with the rates of `along_motion`: with one drive the path is traversed in the sense in
    which the drive's coordinate grows.
    """
    unit = along_motion(motion)
    v, a = unit.point(link, point, 1), unit.point(link, point, 2)
    speed, turns = np.hypot(v[:, 0], v[:, 1]), (motion.model.length_scale * w for w in map(value_of, unit.speeds.angular))
    fastest = reduce(np.fmax, map(np.abs, (*turns, *map(value_of, unit.origin_velocities))), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        known: Flags = value_of(speed) > REST * fastest
        bend: Real = np.where(known, (v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / speed**3, np.nan)
    return bend


@dataclass(frozen=True)
class GrashofLoop:
    """A four-bar loop: its joints, its links (crank, coupler, rocker, frame) with their lengths [m], its margin and its type.

    ``margin``: p + q - s - l [m]; positive if the shortest link can turn fully (Grashof), 0 for a change-point linkage.
    """

    joints: tuple[str, ...]
    links: tuple[str, ...]
    lengths: tuple[float, ...]
    margin: float
    type: str


def grashof(model: Model) -> tuple[GrashofLoop, ...]:
    """The four-bar loops (four links, four revolute joints) among the model's loops."""
    out = []
    at: dict[int, set[int]] = {}
    for j, e in enumerate(model.ends):
        for k in e:
            at.setdefault(k, set()).add(j)
    for c in model.loops:
        arms = [(k, abs(v)) for k, v in c.links if abs(v) > 0]
        if len(arms) != 4 or c.slides:
            continue
        inside = {k for k, _ in arms}
        near = sorted(set().union(*(at[k] for k in inside - {0})))
        joints = [j for j in near if set(model.ends[j]) <= inside and model.joints[j].turns]
        if len(joints) != 4:
            continue
        length = dict(arms)
        drive = next((d for d in model.driven if d in joints), None)
        ground = 0 if 0 in inside else min(inside)
        beside = [k for j in joints for k in model.ends[j] if ground in model.ends[j] and k != ground]
        crank = next((k for k in beside if drive is not None and k in model.ends[drive]), beside[0])
        rocker = next(k for k in beside if k != crank)
        coupler = next(k for k in inside if k not in (ground, crank, rocker))
        order = (crank, coupler, rocker, ground)
        a, b, c_, d = (length[k] for k in order)
        s = sorted((a, b, c_, d))
        out.append(
            GrashofLoop(
                joints=tuple(model.joints[j].name for j in joints),
                links=tuple(model.links[k] for k in order),
                lengths=(a, b, c_, d),
                margin=s[1] + s[2] - s[0] - s[3],
                type=grashof_type(a, b, c_, d),
            )
        )
    return tuple(out)


def grashof_type(crank: float, coupler: float, rocker: float, frame: float) -> str:
    """Type of a four-bar by Grashof's rule: the shortest link turns fully if s + l <= p + q."""
    s, p, q, longest = sorted((crank, coupler, rocker, frame))
    margin = p + q - s - longest
    if abs(margin) <= CHANGE_POINT * (s + p + q + longest):
        return "change point"
    if margin < 0:
        return "triple-rocker (non-Grashof)"
    if s == frame:
        return "double-crank"
    if s == coupler:
        return "double-rocker (Grashof)"
    return "crank-rocker" if s == crank else "rocker-crank"
