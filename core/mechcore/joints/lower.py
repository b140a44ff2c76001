"""Joints of surfaces: revolute, prismatic, pin in slot, weld; and those made of several, the planar joint and the cylinder."""

from __future__ import annotations

from mechcore.joints.base import Builder, LoopJoint, point_of
from mechcore.spec.mechanism import Cylinder, Link, PinSlot, Planar, Prismatic, Revolute, Weld


def build_pinned(joint: Revolute | Weld, builder: Builder) -> None:
    """Two points coincide; the angle is free, or fixed where they are welded."""
    first, second = builder.ends(joint)
    a, b = point_of(first, joint.points[0]), point_of(second, joint.points[1])
    if isinstance(joint, Weld):
        made = LoopJoint(name=joint.name, kind="weld", links=joint.links, a=a, b=b, turns=False, angle=joint.angle)
    else:
        made = LoopJoint(name=joint.name, kind="revolute", links=joint.links, a=a, b=b, turns=True)
    builder.joints.append(made)


def build_guided(joint: Prismatic | PinSlot, builder: Builder) -> None:
    """A point of one link on a straight guide of the other; the angle is fixed, or free where a pin slides in a slot."""
    first, second = builder.ends(joint)
    along = complex(*joint.along)
    pin = isinstance(joint, PinSlot)
    builder.joints.append(
        LoopJoint(
            name=joint.name,
            kind="pin_slot" if pin else "prismatic",
            links=joint.links,
            a=point_of(first, joint.points[0]),
            b=point_of(second, joint.points[1]),
            turns=pin,
            angle=0.0 if isinstance(joint, PinSlot) else joint.angle,
            slide=along / abs(along),
            guide=joint.guide,
        )
    )


def build_planar(joint: Planar, builder: Builder) -> None:
    """Two slides and a pin in a row, which leave the second link all its freedoms."""
    (first, second), (x, y) = joint.links, joint.made
    for name in (x, y):
        builder.links[name] = Link(name=name, points={})
    b = 0j if joint.point is None else point_of(builder.links[second], joint.point)
    builder.joints += [
        LoopJoint(name=x, kind="planar", links=(first, x), a=0j, b=0j, turns=False, slide=1 + 0j),
        LoopJoint(name=y, kind="planar", links=(x, y), a=0j, b=0j, turns=False, slide=1j),
        LoopJoint(name=joint.name, kind="planar", links=(y, second), a=0j, b=b, turns=True),
    ]


def build_cylinder(joint: Cylinder, builder: Builder) -> None:
    """Between two points: barrel and rod, pinned at their ends, sliding in each other."""
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
