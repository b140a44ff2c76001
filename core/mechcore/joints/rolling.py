"""A wheel rolling on a straight edge: its centre keeps its distance (a slot through the centre), and it does not slip."""

from __future__ import annotations

from typing import Any

from mechcore.joints.base import Builder, LoopJoint, Relation, point_of
from mechcore.spec.mechanism import Rolling


def build(joint: Rolling, builder: Builder) -> None:
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

    def contact(motion: Any, multiplier: Any) -> tuple[Any, Any]:
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
