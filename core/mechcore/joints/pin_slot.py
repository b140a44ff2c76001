"""Pin in slot: the pin slides along the slot and turns in it."""

from __future__ import annotations

from mechcore.joints.base import Builder, LoopJoint, point_of
from mechcore.spec.mechanism import PinSlot


def build(joint: PinSlot, builder: Builder) -> None:
    first, second = builder.ends(joint)
    along = complex(*joint.along)
    builder.joints.append(
        LoopJoint(
            name=joint.name,
            kind="pin_slot",
            links=joint.links,
            a=point_of(first, joint.points[0]),
            b=point_of(second, joint.points[1]),
            turns=True,
            slide=along / abs(along),
            guide=joint.guide,
        )
    )
