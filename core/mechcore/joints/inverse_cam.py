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
from mechcore.spec.mechanism import CamPair, Prismatic, Revolute
from mechcore.texts import as_angle


def build_inverse(pair: CamPair, builder: Builder, carrier: str, guide: Prismatic | Revolute) -> None:
    """The roller on the driving link, a crank or a slide, the groove on the driven link."""
    driving = builder.links[pair.links[0]]
    if pair.point not in driving.points:
        known = ", ".join(driving.points)
        raise fault_of(pair, "point", f"link '{driving.name}' has no point '{pair.point}'.", f"Its points: {known}.")
    law = pair.lift
    assert law is not None
    if pair.bed is None and not law.length < 2.0 * math.pi:
        raise fault_of(
            pair, "lift", f"the segments cover {as_angle(law.length)}: where the crank turns round, it cannot drive.",
            "Let the crank swing, and give its range.",
        )  # fmt: skip
    if not isinstance(pair.face, Roller):
        raise fault_of(pair, "follower", "a groove without a roller.", "Give groove = ...")
    if pair.sense < 0:
        raise fault_of(pair, "sense", "an inverse cam's law is read counter-clockwise.", "Leave it out, and mirror the segments.")
    way = (-pair.phase, law.length - pair.phase)
    law = levelled(MotionCurve(law.raised(pair.base).pieces, -pair.phase))
    tip, straight = point_of(driving, pair.point), None
    if pair.bed is None:
        axis, own = builder.axis_between(pair, pair.links[0], carrier)
        tip -= own
        if tip == 0.0:
            raise fault_of(pair, "point", "it is the crank's own axis.", "Name the roller's centre.")
        arm = abs(tip)
        terms: tuple[Terms, Terms] = ((pair.links[0], 1.0), (carrier, -1.0)), ()
    else:
        bed = bed_of(pair, builder, carrier, "the driven link")
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
        pivot, origin = builder.axis_between(pair, pair.links[1], carrier)
        if straight is None and pivot == axis:
            raise fault_of(pair, "guide", "the driven link's pivot lies on the crank's axis.", "Move it away from there.")
        axes, centre, hub, mount = 1 + 0j, pivot, axis - pivot, 1 + 0j
        if straight is not None:  # metres per unit of the driven link's angle: to the middle of the roller's way
            arm = abs(hub + straight * 0.5 * (way[0] + way[1])) or 0.5 * (way[1] - way[0])
        angles = ((pair.links[1], -arm), (carrier, arm))
    phase = cmath.phase(tip) - cmath.phase(axes) if straight is None else 0.0
    straight = None if straight is None else straight / axes
    cam = InverseCam(law, hub, arm, pair.face.radius, not isinstance(guide, Prismatic), phase, straight)
    placed = PlacedInverse(
        name=pair.name, links=pair.links, carrier=carrier, guide=pair.guide, cam=cam, way=way, centre=centre, axes=axes, own=origin,
        mount=mount, tip=point_of(driving, pair.point), sense=pair.sense, bed=pair.bed, pressure_limit=pair.pressure_limit,
    )  # fmt: skip
    try:
        placed.check()
    except MechanismError as error:
        raise MechanismError([renamed(pair, f) for f in error.faults]) from None
    relate(pair, builder, placed, (angles, joints, 0.0), terms)
