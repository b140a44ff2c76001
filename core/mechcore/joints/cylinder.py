"""A cylinder between two points: barrel and rod, pinned at their ends, sliding in each other."""

from __future__ import annotations

from mechcore.joints.base import Builder, LoopJoint, point_of
from mechcore.spec.mechanism import Cylinder, Link


def build(joint: Cylinder, builder: Builder) -> None:
    first, second = builder.ends(joint)
    barrel, rod = f"{joint.name}.barrel", f"{joint.name}.rod"
    builder.links[barrel] = Link(name=barrel, points={"base": (0.0, 0.0)})
    builder.links[rod] = Link(name=rod, points={"eye": (0.0, 0.0)})

    def pin(name: str, link: str, at: complex, own: str) -> LoopJoint:
        return LoopJoint(name=f"{joint.name}.{name}", kind="revolute", links=(link, own), a=at, b=0j, turns=True)

    builder.joints += [
        pin("base", joint.links[0], point_of(first, joint.points[0]), barrel),
        pin("eye", joint.links[1], point_of(second, joint.points[1]), rod),
        LoopJoint(name=joint.name, kind="prismatic", links=(barrel, rod), a=0j, b=0j, turns=False, slide=1 + 0j, guide=0),
    ]
