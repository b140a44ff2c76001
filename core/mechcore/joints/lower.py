"""Lower pairs and the like: revolute, prismatic, pin in slot, weld; and joints made of several: planar joint, cylinder, screw."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Plane, Values
from mechcore.joints.base import Bearing, Builder, LoopJoint, Relation, point_of
from mechcore.spec.mechanism import Cylinder, Link, PinSlot, Planar, Prismatic, Revolute, Screw, Weld

if TYPE_CHECKING:
    from mechcore.motion.motion import Motion


def build_pinned(joint: Revolute | Weld, builder: Builder) -> None:
    """Two points coincide; the angle is free, or fixed by a weld."""
    first, second = builder.ends(joint)
    a, b = point_of(first, joint.points[0]), point_of(second, joint.points[1])
    if isinstance(joint, Weld):
        made = LoopJoint(name=joint.name, kind="weld", links=joint.links, a=a, b=b, turns=False, angle=joint.angle)
    else:
        made = LoopJoint(name=joint.name, kind="revolute", links=joint.links, a=a, b=b, turns=True)
    builder.joints.append(made)


def build_guided(joint: Prismatic | PinSlot, builder: Builder) -> None:
    """A point of one link on a straight guide of the other; the angle is fixed, or free for a pin in a slot."""
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
    """Two slides and a pin in series, which leave the second link all three degrees of freedom."""
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
    """A barrel and a rod between two points, pinned at their ends and sliding in each other."""
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


def build_screw(joint: Screw, builder: Builder) -> None:
    """A slide, a spindle that turns in the link with the guide, and the thread, a relation between travel and rotation."""
    owner, nut = joint.links[joint.guide], joint.links[1 - joint.guide]
    spindle, slide, along = f"{joint.name}.spindle", f"{joint.name}.slide", complex(*joint.along)
    builder.links[spindle] = Link(name=spindle, points={"axis": (0.0, 0.0)})
    ends = [point_of(link, point) for link, point in zip(builder.ends(joint), joint.points, strict=True)]
    builder.joints += [
        LoopJoint(name=joint.name, kind="screw", links=(owner, spindle), a=ends[joint.guide], b=0j, turns=True),
        LoopJoint(
            name=slide, kind="prismatic", links=joint.links, a=ends[0], b=ends[1], turns=False, angle=joint.angle,
            slide=along / abs(along), guide=joint.guide,
        ),
    ]  # fmt: skip

    def contact(motion: Motion, multiplier: Values) -> tuple[Plane, Plane]:
        j = motion.model.joint_index[slide]
        return motion.joint_point(j), motion.guide(j)

    def couple(motion: Motion, place: Plane, force: Plane) -> Values:
        """The torque of the thread about the spindle's axis, which lies in the plane; it balances that of the drive."""
        return -joint.radius * (np.conj(motion.guide(motion.model.joint_index[slide])) * force).real

    builder.relations.append(
        Relation(
            name=f"{joint.name}.thread",
            kind="screw",
            links=(spindle, nut),
            angles=((spindle, joint.radius), (owner, -joint.radius)),
            slides=((slide, -1.0),),
            contact=contact,
            constant=0.0,
            bearing=Bearing(carrier=owner, couple=couple, joints=((joint.name, 1.0),)),
        )
    )
