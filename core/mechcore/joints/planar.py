"""A planar joint: two slides and a pin in a row, which leave the second link all its freedoms."""

from __future__ import annotations

from mechcore.joints.base import Builder, LoopJoint, point_of
from mechcore.spec.mechanism import Link, Planar


def build(joint: Planar, builder: Builder) -> None:
    (first, second), (x, y) = joint.links, joint.made
    for name in (x, y):
        builder.links[name] = Link(name=name, points={})
    b = 0j if joint.point is None else point_of(builder.links[second], joint.point)
    builder.joints += [
        LoopJoint(name=x, kind="planar", links=(first, x), a=0j, b=0j, turns=False, slide=1 + 0j),
        LoopJoint(name=y, kind="planar", links=(x, y), a=0j, b=0j, turns=False, slide=1j),
        LoopJoint(name=joint.name, kind="planar", links=(y, second), a=0j, b=b, turns=True),
    ]
