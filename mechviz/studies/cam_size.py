"""What `mechviz cams --size` prints: least base circle, best offset and least roller of each disc cam for stated limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mechcore.cams.followers import Flat, Roller, Translating
from mechcore.cams.forces import roller_range
from mechcore.cams.limits import Requirement, best_offset, find_limits, least_base
from mechcore.cams.placed import PlacedCam
from mechcore.errors import MechanismError
from mechcore.forces.cam_rating import contact_force, joint_of, placed_cams
from mechcore.texts import Text, UnitSystem, as_angle, as_length

if TYPE_CHECKING:
    from mechcore.forces.kinetostatics import Forces
    from mechcore.motion.motion import Motion

USUAL_ANGLES = {True: math.radians(30.0), False: math.radians(45.0)}  # of translating and oscillating followers


def size_lines(motion: Motion, forces: Forces | None, units: UnitSystem, want: Requirement) -> list[str]:
    """Every disc cam with a lift: what it has, and the least that keeps to the limits: those of ``want``, else of the scene."""
    lines: list[str] = []
    for cam in placed_cams(motion):
        if isinstance(cam, PlacedCam) and not cam.cam.wedge and (cam.given is None or cam.intended is not None):
            own = _limits(cam, want)
            lines += ["", Text(f"cam {cam.name}: {_limit_words(cam, own, want)}", units)]
            lines += [f"  {what:<12} {Text(words).in_units(units)}" for what, words in _sizes(cam, motion, forces, own)]
    return lines[1:]


def _limits(cam: PlacedCam, want: Requirement) -> Requirement:
    angle = want.pressure_rise or cam.pressure_limit
    radius = want.radius or cam.curvature_limit
    if angle is None and radius is None:
        angle = USUAL_ANGLES[cam.arm == 0.0]
    return Requirement(radius=radius, pressure_rise=angle, pressure_fall=angle)


def _limit_words(cam: PlacedCam, own: Requirement, want: Requirement) -> str:
    stated = (want.pressure_rise or cam.pressure_limit or want.radius or cam.curvature_limit) is not None
    words = [] if own.pressure_rise is None else [f"pressure angles up to {as_angle(own.pressure_rise, 4)}"]
    words += [] if own.radius is None else [f"radii of the convex profile from {as_length(own.radius, 4)} on"]
    return " and ".join(words) + ("" if stated else " (usual; the scene states no limit)")


def _sizes(cam: PlacedCam, motion: Motion, forces: Forces | None, want: Requirement) -> Iterator[tuple[str, str]]:
    made = cam.cam if cam.intended is None else cam.intended
    follower, turn = made.follower, made.turn
    lift = made.law.raised(-follower.base_coordinate(cam.base))
    hub = joint_of(motion, cam).hub
    try:
        found = least_base(lift, follower, want, turn, hub)
        yield "base circle", f"{as_length(cam.base, 6)} now, least {as_length(found.base, 6)}; decided by: {found.decides}"
    except MechanismError as error:
        yield "base circle", "; ".join(Text.of(f"{f.message} {f.remedy}").source for f in error.faults)
    guide = follower.guide
    if isinstance(guide, Translating) and not isinstance(follower.face, Flat):
        try:
            best = best_offset(lift, follower.face, want, turn, hub)
            words = (
                f"{as_length(guide.offset)} now, best {as_length(best.offset, 6)} with a base circle of {as_length(best.base, 6)}"
            )
            yield "offset", f"{words}; decided by: {best.decides}"
        except MechanismError as error:
            yield "offset", "; ".join(Text.of(f"{f.message} {f.remedy}").source for f in error.faults)
    if isinstance(follower.face, Roller):
        yield "roller", _roller_words(cam, motion, forces, want)


def _roller_words(cam: PlacedCam, motion: Motion, forces: Forces | None, want: Requirement) -> str:
    """The rollers that fit on the pitch curve as it is: the base circle grows by as much as the roller shrinks."""
    made = cam.cam if cam.intended is None else cam.intended
    greatest = find_limits(made).greatest_roller
    most = math.inf if greatest is None else max(greatest.value - (want.radius or 0.0), 0.0)
    rating = joint_of(motion, cam).rating
    words = f"{as_length(made.follower.radius)} now, on the same pitch curve"
    upper = "" if math.isinf(most) else f"up to {as_length(most, 6)}"
    if forces is None or rating is None or rating.width is None or rating.limit is None or cam.form:
        why = "no least one: the scene states no width and limit of the Hertz pressure"
        return f"{words} {upper or 'of any size'}; {why if not cam.form else 'no least one: two flanks'}"
    force = contact_force(forces, cam)
    known = np.isfinite(force)
    low, high = roller_range(
        force[known], cam.at(motion).pitch_radius[known], rating.width, rating.limit, rating.modulus, rating.poisson
    )
    limit = f"a Hertz pressure of {1e-6 * rating.limit:.5g} MPa"
    if low > min(high, most):
        return f"{words} {upper}; none keeps to {limit}: enlarge the base circle"
    top = min(high, most)
    return f"{words} {'' if math.isinf(top) else f'up to {as_length(top, 6)}, '}least {as_length(low, 6)} for {limit}"
