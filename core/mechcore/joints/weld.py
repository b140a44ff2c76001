"""Weld: two points coincide and the angle is fixed."""

from __future__ import annotations

from mechcore.joints.base import Builder, LoopJoint, point_of
from mechcore.spec.mechanism import Weld


def build(joint: Weld, builder: Builder) -> None:
    first, second = builder.ends(joint)
    builder.joints.append(
        LoopJoint(
            name=joint.name,
            kind="weld",
            links=joint.links,
            a=point_of(first, joint.points[0]),
            b=point_of(second, joint.points[1]),
            turns=False,
            angle=joint.angle,
        )
    )
