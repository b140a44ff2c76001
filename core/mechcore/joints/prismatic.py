"""Prismatic joint: a point of one link on a straight guide of the other, the relative angle fixed."""

from __future__ import annotations

from mechcore.joints.base import Builder, LoopJoint, point_of
from mechcore.spec.mechanism import Prismatic


def build(joint: Prismatic, builder: Builder) -> None:
    first, second = builder.ends(joint)
    along = complex(*joint.along)
    builder.joints.append(
        LoopJoint(
            name=joint.name,
            kind="prismatic",
            links=joint.links,
            a=point_of(first, joint.points[0]),
            b=point_of(second, joint.points[1]),
            turns=False,
            angle=joint.angle,
            slide=along / abs(along),
            guide=joint.guide,
        )
    )
