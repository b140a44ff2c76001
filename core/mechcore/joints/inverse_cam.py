"""Inverse cams: where the driving link with its roller and the driven link with its groove lie."""

from __future__ import annotations

import cmath
import math

from mechcore.cams.closures import InverseCam
from mechcore.cams.followers import Roller
from mechcore.cams.placed_spatial import PlacedInverse
from mechcore.errors import MechanismError
from mechcore.joints.base import Builder, point_of
from mechcore.joints.cam_guides import Terms, bed_of, fault_of, guide_in, levelled, place_on, relate, renamed
from mechcore.laws.curve import MotionCurve
from mechcore.spec.mechanism import CamJoint, Prismatic, Revolute
from mechcore.texts import as_angle


def build_inverse(joint: CamJoint, builder: Builder, carrier: str, guide: Prismatic | Revolute) -> None:
    """The roller on the driving link, a crank or a slide, the groove on the driven link."""
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
    way = (-joint.phase, law.length - joint.phase)
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
        # at coordinate zero the driven link's axes lie where the guide puts them
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
        if straight is not None:  # metres per unit of the driven link's angle: to the middle of the roller's way
            arm = abs(hub + straight * 0.5 * (way[0] + way[1])) or 0.5 * (way[1] - way[0])
        angles = ((joint.links[1], -arm), (carrier, arm))
    phase = cmath.phase(tip) - cmath.phase(axes) if straight is None else 0.0
    straight = None if straight is None else straight / axes
    cam = InverseCam(law, hub, arm, joint.face.radius, not isinstance(guide, Prismatic), phase, straight)
    placed = PlacedInverse(
        name=joint.name, links=joint.links, carrier=carrier, guide=joint.guide, cam=cam, way=way, centre=centre, axes=axes,
        own=origin,
        mount=mount, tip=point_of(driving, joint.point), sense=joint.sense, bed=joint.bed, pressure_limit=joint.pressure_limit,
    )  # fmt: skip
    try:
        placed.check()
    except MechanismError as error:
        raise MechanismError([renamed(joint, f) for f in error.faults]) from None
    relate(joint, builder, placed, (angles, joints, 0.0), terms)
