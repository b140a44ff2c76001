"""Cam and follower in the plane: the follower's coordinate is a function of the cam's; the force acts along the common normal."""

from __future__ import annotations

import cmath
import math
from functools import lru_cache
from typing import Any

import numpy as np

from mechcore.cams.closures import SecondRoller
from mechcore.cams.contour import Contour, moved_contour
from mechcore.cams.followers import Flat, Follower, Oscillating, Roller, Translating
from mechcore.cams.limits import Requirement, find_limits
from mechcore.cams.placement.inverse import PlacedInverse
from mechcore.cams.placement.plane import PlacedCam
from mechcore.cams.placement.spatial import PlacedSpatial
from mechcore.cams.real_profiles import CutProfile, GivenLift, cut_profile, lift_of
from mechcore.cams.sizing import least_base, outer_flank
from mechcore.cams.spatial import InverseCam
from mechcore.cams.synthesis import Cam, cam_on_base
from mechcore.errors import MechanismError
from mechcore.joints.base import Bearing, Builder, point_of
from mechcore.joints.spatial_cam import (
    Terms,
    bed_of,
    check_shaft,
    fault_of,
    guide_in,
    levelled,
    place_on,
    place_spatial,
    relate,
    renamed,
)
from mechcore.laws.curve import MotionCurve
from mechcore.spec.mechanism import CamJoint, Prismatic, Revolute
from mechcore.texts import as_angle, as_coordinate, as_length


def build_cam(joint: CamJoint, builder: Builder) -> None:
    guide = next((p for p in builder.mechanism.joints if p.name == joint.guide), None)
    if not isinstance(guide, Prismatic | Revolute) or joint.links[1] not in guide.links:
        raise fault_of(
            joint,
            "guide",
            f"'{joint.guide}' is no revolute or prismatic joint of '{joint.links[1]}'.",
            "Name the joint that guides it.",
        )
    carrier = guide.links[0] if guide.links[1] == joint.links[1] else guide.links[1]
    if carrier == joint.links[0]:
        raise fault_of(joint, "guide", "it guides the follower on the cam itself.", "Guide both on one link.")
    follower = builder.links[joint.links[1]]
    if joint.inverse:
        _build_inverse(joint, builder, carrier, guide)
        return
    if joint.point not in follower.points:
        known = ", ".join(follower.points)
        raise fault_of(joint, "point", f"link '{follower.name}' has no point '{joint.point}'.", f"Its points: {known}.")
    try:
        placed: PlacedCam | PlacedSpatial
        if joint.spatial is not None:
            placed = place_spatial(joint, builder, carrier, guide)
        else:
            made = _wedge(joint, builder, carrier, guide) if joint.bed else _disc(joint, builder, carrier, guide)
            placed = PlacedCam(**made)
            placed.check()
    except MechanismError as error:
        raise MechanismError([renamed(joint, f) for f in error.faults]) from None
    if isinstance(placed, PlacedSpatial):
        check_shaft(joint, builder, placed.mount_origin)
    if isinstance(guide, Prismatic):
        sign, zero = _along_guide(joint, builder, carrier, guide, placed)
        angles: tuple[tuple[str, float], ...] = ()
        slides: tuple[tuple[str, float], ...] = ((guide.name, -sign),)
        constant = zero
    else:
        pivot, own = builder.axis_between(joint, joint.links[1], carrier)
        c = placed.scale * placed.side
        angles = ((joint.links[1], c), (carrier, -c))
        slides = ()
        towards = placed.centre - pivot if joint.spatial is None else -placed.axes  # direction of the arm at coordinate zero
        home = cmath.phase(towards / (point_of(follower, joint.point) - own))
        constant = c * home
        if (
            joint.spatial is not None and placed.mean_slope
        ):  # a turret never returns: the curve is the deviation from its mean speed
            step = placed.scale * placed.sense * placed.mean_slope
            angles += ((joint.links[0], step), (carrier, -step))
            constant -= placed.scale * placed.mean_slope * placed.phase
    cam_angles: tuple[tuple[str, float], ...] = ()
    cam_slides: tuple[tuple[str, float], ...] = ()
    if joint.bed:
        cam_slides = ((joint.bed, float(placed.sense)),)
    else:
        cam_angles = ((joint.links[0], float(placed.sense)), (carrier, -float(placed.sense)))
    relate(joint, builder, placed, (angles, slides, constant), (cam_angles, cam_slides), _bearing(joint, builder, carrier, placed))


def _bearing(joint: CamJoint, builder: Builder, carrier: str, placed: PlacedCam | PlacedSpatial) -> Bearing | None:
    """The bearing of the shaft of a cam whose axis lies in the plane; None for plane cams."""
    if isinstance(placed, PlacedCam):
        return None
    return Bearing(carrier=carrier, couple=placed.couple, joints=builder.bearings_between(joint, joint.links[0], carrier))


def _along_guide(
    joint: CamJoint, builder: Builder, carrier: str, guide: Prismatic, placed: PlacedCam | PlacedSpatial
) -> tuple[float, float]:
    """(sign, zero) of the follower's height ``sign * s + zero`` as a function of the guide's coordinate s."""
    at = place_on(builder, carrier, guide, point_of(builder.links[joint.links[1]], joint.point))
    _, sign = guide_in(carrier, guide)
    # the lift is along the guide's direction in the carrier's axes
    return sign, float(((at - placed.centre) / placed.axes).imag)


def _guide_of(joint: CamJoint, builder: Builder, carrier: str, guide: Prismatic | Revolute) -> tuple[complex, complex, float]:
    """Position on the carrier of the follower's point at coordinate zero (translating) or of its pivot (oscillating), direction of
    lift (0 if oscillating), length of arm (0 if translating)."""
    follower = builder.links[joint.links[1]]
    at = point_of(follower, joint.point)
    if isinstance(guide, Prismatic):
        return place_on(builder, carrier, guide, at), guide_in(carrier, guide)[0], 0.0
    pivot, own = builder.axis_between(joint, joint.links[1], carrier)
    arm = abs(at - own)
    if arm == 0.0:
        raise fault_of(joint, "point", "it is the follower's own pivot.", "Name the point that touches the cam.")
    return pivot, 0j, arm


def _disc(joint: CamJoint, builder: Builder, carrier: str, guide: Prismatic | Revolute) -> dict[str, Any]:
    centre, own = builder.axis_between(joint, joint.links[0], carrier)
    place, up, arm = _guide_of(joint, builder, carrier, guide)
    if isinstance(guide, Prismatic):
        axes = up / 1j
        face_guide: Translating | Oscillating = Translating(float(((place - centre) / axes).real))
    else:
        axes = 1 + 0j
        if place == centre:
            raise fault_of(joint, "guide", "the follower's pivot lies on the cam's axis.", "Move it away from there.")
        face_guide = Oscillating(place - centre, arm, -1 if joint.side == "left" else 1)
    follower = Follower(face_guide, joint.face)
    if joint.contour is not None:
        if joint.closure == "form" and not isinstance(joint.face, Flat):
            raise fault_of(joint, "closure", "a given profile has no groove.", "Give closure = 'force', or a yoke with flat faces.")
        profile, given = _given(joint.contour, own, axes, follower)
        made = _common(joint, carrier, Cam(given.law, follower), centre, axes)
        return made | {
            "mount_origin": own, "mount": axes, "arm": arm, "given": profile, "bridges": given.bridges, "knot_angles": given.ends,
            "sense": 1, "phase": 0.0,
        }  # fmt: skip
    law = joint.lift
    assert law is not None
    if abs(law.length - 2.0 * math.pi) > 1e-9:
        short = 2.0 * math.pi - law.length
        remedy = f"Add a dwell of {as_angle(short)}." if short > 0 else f"Take {as_angle(-short)} off."
        raise fault_of(joint, "lift", f"the segments cover {as_angle(law.length)}, a whole turn is wanted.", remedy)
    if abs(law.advance) > 1e-12 * float(np.abs(law.limits(0)[0]).max()):
        higher = as_coordinate(law.advance, rotary=isinstance(guide, Revolute))
        raise fault_of(joint, "lift", f"after a turn the lift is {higher} higher than before.", "Let it return to its start.")
    law = law if law.repeats else law.repeating()
    base, decides = joint.base, None
    second = None if joint.second is None else _second_roller(joint, builder, carrier, guide, follower, axes)
    if "base" in joint.least:
        groove = joint.closure == "form" and second is None and not isinstance(joint.face, Flat)
        base, decides = _least_base(law, follower, required(joint), joint.sense, joint.hub, second, groove)
    cam = cam_on_base(law, follower, base, turn=joint.sense)
    mount = axes * cmath.exp(1j * joint.sense * joint.phase)
    made = _common(joint, carrier, cam, centre, axes) | {
        "mount_origin": own,
        "mount": mount,
        "arm": arm,
        "base": base,
        "decides": decides,
    }
    if second is not None:
        flip = -1.0 if second.arm is None else 1.0  # rotated by half a turn, the lower roller is an ordinary follower
        other = {"cam": second.cam(cam), "axes": axes * flip, "mount": mount * flip, "form_closed": False, "arm": second.arm or 0.0}
        made |= {"mate": PlacedCam(**(made | other)), "second": second}
    if joint.undercut == "cut" and find_limits(cam, count=720).undercut:
        if joint.closure == "form":
            raise fault_of(joint, "undercut", "a groove or yoke is not followed where it is undercut.", "Leave it out.")
        left, given = _as_cut(law, follower, base, joint.sense)
        made |= {
            "cam": Cam(given.law, follower, joint.sense), "given": left.contour, "bridges": given.bridges,
            "knot_angles": given.ends, "intended": cam, "lost_ranges": left.lost,
        }  # fmt: skip
    return made


def required(joint: CamJoint) -> Requirement:
    """The limits that a cam states."""
    return Requirement(radius=joint.curvature_limit, pressure_rise=joint.pressure_limit, pressure_fall=joint.pressure_limit)


def _second_roller(
    joint: CamJoint, builder: Builder, carrier: str, guide: Prismatic | Revolute, placed: Follower, axes: complex
) -> SecondRoller:
    """The second roller of a conjugate pair, which is fixed on the follower like the first."""
    assert joint.second is not None
    name, radius = joint.second
    follower = builder.links[joint.links[1]]
    if name not in follower.points:
        raise fault_of(
            joint, "second", f"link '{follower.name}' has no point '{name}'.", f"Its points: {', '.join(follower.points)}."
        )
    first, second = point_of(follower, joint.point), point_of(follower, name)
    theory = placed.guide
    if isinstance(theory, Oscillating):
        _, own = builder.axis_between(joint, joint.links[1], carrier)
        apart = -theory.side * cmath.phase((second - own) / (first - own))  # as the coordinate grows
        arm = abs(second - own)
        total = -apart
        if not 0.0 < total < math.pi:
            raise fault_of(joint, "second", f"the second arm lies {as_angle(apart)} from the first, on its far side.", "Swap them.")
        return SecondRoller(radius, arm=arm, angle=total)
    assert isinstance(guide, Prismatic)
    away = (place_on(builder, carrier, guide, second) - place_on(builder, carrier, guide, first)) / axes
    if not away.imag < 0.0:
        raise fault_of(
            joint, "second", "the second roller does not lie below the first, on the far side of the cam's axis.", "Move it."
        )
    return SecondRoller(radius, span=-away.imag, offset=theory.offset + away.real)


@lru_cache(maxsize=16)
def _given(contour: Contour, own: complex, axes: complex, follower: Follower) -> tuple[Contour, GivenLift]:
    """A profile in link axes transformed to the axes of the theory, and its lift; cached because a run builds a mechanism several
    times."""
    profile = moved_contour(contour, -own / axes, 1.0 / axes)
    return profile, lift_of(profile, follower)


@lru_cache(maxsize=16)
def _least_base(
    law: MotionCurve, follower: Follower, want: Requirement, sense: int, hub: float, second: SecondRoller | None, groove: bool
) -> tuple[float, str]:
    beside = None if second is None else lambda cam: (second.cam(cam),)
    least = least_base(law, follower, want, sense, hub, beside=outer_flank if groove else beside)
    return least.base, least.decides


@lru_cache(maxsize=16)
def _as_cut(law: MotionCurve, follower: Follower, base: float, sense: int) -> tuple[CutProfile, GivenLift]:
    left = cut_profile(cam_on_base(law, follower, base, turn=sense))
    return left, lift_of(left.contour, follower, sense)


def _wedge(joint: CamJoint, builder: Builder, carrier: str, guide: Prismatic | Revolute) -> dict[str, Any]:
    bed = bed_of(joint, builder, carrier, "the follower")
    if isinstance(joint.face, Flat):
        raise fault_of(joint, "", "a flat face slides on a wedge's highest points only.", "Give a roller or a knife.")
    place, up, arm = _guide_of(joint, builder, carrier, guide)
    direction, sign = guide_in(carrier, bed)
    direction *= sign  # of the cam as the bed's coordinate grows
    cam_link = builder.links[joint.links[0]]
    start = place_on(builder, carrier, bed, point_of(cam_link, bed.points[bed.links.index(joint.links[0])]))
    radius = joint.face.radius
    if isinstance(guide, Prismatic):
        axes = up / 1j
        across = abs((direction / axes).imag)
        if across > 1e-9:
            apart = 0.5 * math.pi - math.asin(min(across, 1.0))
            raise fault_of(
                joint, "bed", f"the cam's and the follower's guides are {as_angle(apart)} apart.", "Make them perpendicular."
            )
        face_guide: Translating | Oscillating = Translating(0.0)
    else:
        axes = direction if ((place - start) / direction).imag > 0 else -direction
    centre = start + axes * ((place - start) / axes).real
    if isinstance(guide, Revolute):
        height = ((place - centre) / axes).imag
        face_guide = Oscillating(1j * height, arm, -1 if joint.side == "left" else 1)
        c = (height - joint.base - radius) / arm
        if not -1.0 < c < 1.0:
            least, most = max(height - radius - arm, 0.0), height - radius + arm
            raise fault_of(
                joint, "base", f"the arm does not reach a height of {as_length(joint.base)}.",
                f"Give between {as_length(least)} and {as_length(most)}.",
            )  # fmt: skip
        zero = math.acos(c)
    else:
        zero = joint.base + radius
    assert joint.lift is not None
    # the wedge of the theory moves by -x: if the cam moves in the other direction, the law is mirrored
    ahead = -float((direction / axes).real) * joint.sense
    law = levelled(joint.lift) if ahead > 0 else levelled(_mirror(joint.lift))
    cam = Cam(law.raised(zero), Follower(face_guide, joint.face), wedge=True)
    own = point_of(cam_link, bed.points[bed.links.index(joint.links[0])])
    first = bed.links.index(carrier) == 0
    turn = cmath.exp(1j * (-bed.angle if first else bed.angle))  # from the carrier's axes to the cam's
    # the cam's point is at start + s direction, a point z of the profile at centre + axes (z - x), x = ahead (s sense + phase)
    own += turn * (centre - start - axes * ahead * joint.phase)
    return _common(joint, carrier, cam, centre, axes) | {"mount_origin": own, "mount": turn * axes, "arm": arm, "law_scale": ahead}


def _common(joint: CamJoint, carrier: str, cam: Cam, centre: complex, axes: complex) -> dict[str, Any]:
    return {
        "name": joint.name,
        "links": joint.links,
        "carrier": carrier,
        "guide": joint.guide,
        "cam": cam,
        "base": joint.base,
        "centre": centre,
        "axes": axes,
        "form_closed": joint.closure == "form",
        "bed": joint.bed,
        "sense": joint.sense,
        "phase": joint.phase,
        "pressure_limit": joint.pressure_limit,
        "curvature_limit": joint.curvature_limit,
    }


def _mirror(law: MotionCurve) -> MotionCurve:
    """The law x -> law(-x)."""
    return MotionCurve(law.reversed().pieces, -law.end)


def _build_inverse(joint: CamJoint, builder: Builder, carrier: str, guide: Prismatic | Revolute) -> None:
    """Inverse cam: the roller is on the driving link, a crank or a slide, and the groove is in the driven link."""
    driving = builder.links[joint.links[0]]
    if joint.point not in driving.points:
        known = ", ".join(driving.points)
        raise fault_of(joint, "point", f"link '{driving.name}' has no point '{joint.point}'.", f"Its points: {known}.")
    law = joint.lift
    assert law is not None
    if joint.bed is None and not law.length < 2.0 * math.pi:
        raise fault_of(
            joint, "lift", f"the segments cover {as_angle(law.length)}: where the crank turns round, it cannot drive.",
            "Let the crank swing, and give its range.",
        )  # fmt: skip
    if not isinstance(joint.face, Roller):
        raise fault_of(joint, "follower", "a groove without a roller.", "Give groove = ...")
    if joint.sense < 0:
        raise fault_of(joint, "sense", "an inverse cam's law is read counter-clockwise.", "Leave it out, and mirror the segments.")
    travel = (-joint.phase, law.length - joint.phase)
    law = levelled(MotionCurve(law.raised(joint.base).pieces, -joint.phase))
    tip, straight = point_of(driving, joint.point), None
    if joint.bed is None:
        axis, own = builder.axis_between(joint, joint.links[0], carrier)
        tip -= own
        if tip == 0.0:
            raise fault_of(joint, "point", "it is the crank's own axis.", "Name the roller's centre.")
        arm = abs(tip)
        terms: tuple[Terms, Terms] = ((joint.links[0], 1.0), (carrier, -1.0)), ()
    else:
        bed = bed_of(joint, builder, carrier, "the driven link")
        forward, sign = guide_in(carrier, bed)
        straight, axis = sign * forward, place_on(builder, carrier, bed, tip)
        arm, terms = 0.0, ((), ((bed.name, 1.0),))
    angles: Terms = ()
    joints: Terms = ()
    if isinstance(guide, Prismatic):
        up, sign = guide_in(carrier, guide)
        axes, centre, hub = up / 1j, axis, 0j
        side = guide.links.index(carrier)
        turn = cmath.exp(1j * (-guide.angle if side == 0 else guide.angle))
        # position of the driven link's axes at coordinate zero
        start = place_on(builder, carrier, guide, 0j)
        origin, mount = turn * (centre - start), turn * axes
        joints = ((guide.name, -sign),)
        if sign < 0.0:
            law = MotionCurve(tuple(p.scaled(1.0, -1.0) for p in law.pieces), law.start)
    else:
        pivot, origin = builder.axis_between(joint, joint.links[1], carrier)
        if straight is None and pivot == axis:
            raise fault_of(joint, "guide", "the driven link's pivot lies on the crank's axis.", "Move it away from there.")
        axes, centre, hub, mount = 1 + 0j, pivot, axis - pivot, 1 + 0j
        if straight is not None:  # metres per unit of the driven link's angle: distance to the middle of the roller's travel
            arm = abs(hub + straight * 0.5 * (travel[0] + travel[1])) or 0.5 * (travel[1] - travel[0])
        angles = ((joint.links[1], -arm), (carrier, arm))
    phase = cmath.phase(tip) - cmath.phase(axes) if straight is None else 0.0
    straight = None if straight is None else straight / axes
    cam = InverseCam(law, hub, arm, joint.face.radius, not isinstance(guide, Prismatic), phase, straight)
    placed = PlacedInverse(
        name=joint.name, links=joint.links, carrier=carrier, guide=joint.guide, cam=cam, travel=travel, centre=centre, axes=axes,
        mount_origin=origin,
        mount=mount, tip=point_of(driving, joint.point), sense=joint.sense, bed=joint.bed, pressure_limit=joint.pressure_limit,
    )  # fmt: skip
    try:
        placed.check()
    except MechanismError as error:
        raise MechanismError([renamed(joint, f) for f in error.faults]) from None
    relate(joint, builder, placed, (angles, joints, 0.0), terms)
