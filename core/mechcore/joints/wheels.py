"""Wheels: rolling on an edge, gears, pinion and rack, belts and chains. Each is a relation of coordinates with a contact force."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Plane, Real, Values
from mechcore.errors import Fault, MechanismError
from mechcore.joints.base import Builder, LoopJoint, Relation, point_of
from mechcore.spec.mechanism import Belt, Gear, Prismatic, Rack, Rolling
from mechcore.texts import as_length

if TYPE_CHECKING:
    from mechcore.motion.motion import Motion


def build_rolling(joint: Rolling, builder: Builder) -> None:
    edge, wheel = builder.ends(joint)
    along = complex(*joint.along) / abs(complex(*joint.along))
    side = 1.0 if joint.side == "left" else -1.0
    towards = -1j * along * side
    builder.joints.append(
        LoopJoint(
            name=joint.name,
            kind="rolling",
            links=joint.links,
            a=point_of(edge, joint.points[0]),
            b=point_of(wheel, joint.points[1]),
            turns=True,
            slide=along,
            guide=0,
        )
    )

    def contact(motion: Motion, multiplier: Values) -> tuple[Plane, Plane]:
        k = motion.model.index[joint.links[0]]
        turn = motion.rotation(k)
        centre = motion.joint_point(motion.model.joint_index[joint.name])
        # the relation's first link is the edge, whose point moves backwards as the wheel's coordinate grows
        return centre + joint.radius * towards * turn, -along * turn

    builder.relations.append(
        Relation(
            name=joint.name,
            kind="rolling",
            links=joint.links,
            angles=((joint.links[1], side * joint.radius), (joint.links[0], -side * joint.radius)),
            slides=((joint.name, 1.0),),
            contact=contact,
        )
    )


def build_gear(joint: Gear, builder: Builder) -> None:
    c1, c2 = (builder.axis_between(joint, link, joint.carrier)[0] for link in joint.links)
    distance = abs(c2 - c1)
    n1, n2 = joint.sizes
    total = n2 - n1 if joint.internal else n1 + n2
    if distance == 0.0 or total <= 0.0:
        raise MechanismError(
            Fault(
                f"joints.{joint.name}",
                f"the axes are {as_length(distance)} apart and the sizes {n1:g} and {n2:g}: the gears cannot mesh.",
                "An internal gear pair lists the pinion first and the larger ring second; axes must not coincide.",
            )
        )
    r1 = n1 * distance / total
    sense = -1.0 if joint.internal else 1.0
    r2 = n2 * distance / total
    # unit vector towards the pitch point as seen from the first gear's axis, in the carrier's frame
    outward = (c2 - c1) / distance * sense
    pitch = c1 + r1 * outward

    def contact(motion: Motion, multiplier: Values) -> tuple[Plane, Plane]:
        k = motion.model.index[joint.carrier]
        turn = motion.rotation(k)
        push = _sign(multiplier)  # the driving flank presses the gears apart
        lean = 1j + np.tan(joint.pressure_angle) * push
        return motion.of_point(k, pitch), lean * outward * turn

    builder.relations.append(
        Relation(
            name=joint.name,
            kind="gear",
            links=joint.links,
            angles=((joint.links[0], r1), (joint.links[1], sense * r2), (joint.carrier, -r1 - sense * r2)),
            slides=(),
            contact=contact,
        )
    )


def build_rack(joint: Rack, builder: Builder) -> None:
    pinion, rack = joint.links
    slider = next((p for p in builder.mechanism.joints if p.name == joint.slider and isinstance(p, Prismatic)), None)
    if slider is None or rack not in slider.links:
        raise MechanismError(
            Fault(
                f"joints.{joint.name}",
                f"'{joint.slider}' is not a prismatic joint that guides '{rack}'.",
                "Name the prismatic joint between the rack and the link that carries the pinion.",
            )
        )
    carrier = slider.links[0] if slider.links[1] == rack else slider.links[1]
    centre, _ = builder.axis_between(joint, pinion, carrier)
    along = complex(*slider.along) / abs(complex(*slider.along))
    owner = slider.links[slider.guide]
    # the slider's coordinate grows as the link without the guide moves along it; `along` in the carrier's axes
    moves = 1.0 if owner == carrier else -1.0
    if owner == rack:
        along = along * np.exp(1j * (slider.angle if slider.links[1] == rack else -slider.angle))
    side = 1.0 if joint.side == "left" else -1.0
    towards = -1j * along * side  # from the pinion's axis to the rack

    def contact(motion: Motion, multiplier: Values) -> tuple[Plane, Plane]:
        k = motion.model.index[carrier]
        push = _sign(multiplier)
        lean = along + np.tan(joint.pressure_angle) * push * towards
        return motion.of_point(k, centre + joint.radius * towards), lean * motion.rotation(k)

    builder.relations.append(
        Relation(
            name=joint.name,
            kind="rack",
            links=joint.links,
            angles=((pinion, side * joint.radius), (carrier, -side * joint.radius)),
            slides=((joint.slider, -moves),),
            contact=contact,
        )
    )


def build_belt(joint: Belt, builder: Builder) -> None:
    c1, c2 = (builder.axis_between(joint, link, joint.carrier)[0] for link in joint.links)
    distance = abs(c2 - c1)
    r1, r2 = joint.radii
    sense = 1.0 if joint.crossed else -1.0
    if min(r1, r2) <= 0.0 or distance <= (r1 + r2 if joint.crossed else abs(r1 - r2)):
        raise MechanismError(
            Fault(
                f"joints.{joint.name}",
                f"pulleys of radius {as_length(r1)} and {as_length(r2)} do not fit on axes {as_length(distance)} apart.",
                "Move the axes apart or make the pulleys smaller.",
            )
        )
    axis = (c2 - c1) / distance
    lean = (r1 + sense * r2) / distance

    def contact(motion: Motion, multiplier: Values) -> tuple[Plane, Plane]:
        """Tangent point of the tight span on the first pulley, and the force direction. A belt only pulls: one span carries a
        positive multiplier, the other a negative one.

        The multiplier is positive in the direction in which the first pulley's rim moves when it turns counter-clockwise.
        """
        k = motion.model.index[joint.carrier]
        turn = motion.rotation(k)
        side = _sign(multiplier)
        out = (lean + side * 1j * np.sqrt(1.0 - lean**2)) * axis  # at its tangent point the rim moves away from the second pulley
        return motion.origins[k] + (c1 + r1 * out) * turn, 1j * out * turn

    builder.relations.append(
        Relation(
            name=joint.name,
            kind="belt",
            links=joint.links,
            angles=((joint.links[0], r1), (joint.links[1], sense * r2), (joint.carrier, -r1 - sense * r2)),
            slides=(),
            contact=contact,
        )
    )


def _sign(multiplier: Values) -> Real:
    """1 where a multiplier is not negative, else -1: selects the flank or span that carries."""
    return np.where(multiplier.real >= 0.0, 1.0, -1.0)
