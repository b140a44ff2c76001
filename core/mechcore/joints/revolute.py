"""Revolute joint: two points coincide, the angle is free."""

from __future__ import annotations

from mechcore.joints.base import Builder, LoopJoint, point_of
from mechcore.spec.mechanism import Revolute


def build(joint: Revolute, builder: Builder) -> None:
    first, second = builder.ends(joint)
    builder.joints.append(
        LoopJoint(
            name=joint.name,
            kind="revolute",
            links=joint.links,
            a=point_of(first, joint.points[0]),
            b=point_of(second, joint.points[1]),
            turns=True,
        )
    )
