"""Kinematic pairs: what each kind allows, in the common forms that the rest of the core works with.

A lower pair is a `LoopJoint` (points that coincide or slide); gears, belts, racks, rolling and cams add a `Relation`.
To add a joint: its spec in ``mechcore.spec.mechanism``, one file here with a function ``build(joint, builder)``, one line in
`KINDS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mechcore.joints import belt, cam, cylinder, gear, pin_slot, planar, prismatic, rack, revolute, rolling, weld
from mechcore.joints.base import Builder
from mechcore.spec.mechanism import (
    Belt,
    CamJoint,
    Cylinder,
    Gear,
    Mechanism,
    PinSlot,
    Planar,
    Prismatic,
    Rack,
    Revolute,
    Rolling,
    Weld,
)

KINDS: dict[type, Callable[[Any, Builder], None]] = {
    Revolute: revolute.build,
    Prismatic: prismatic.build,
    Weld: weld.build,
    PinSlot: pin_slot.build,
    Rolling: rolling.build,
    Gear: gear.build,
    Belt: belt.build,
    Rack: rack.build,
    Cylinder: cylinder.build,
    Planar: planar.build,
    CamJoint: cam.build,
}


def build_joints(mechanism: Mechanism) -> Builder:
    """Joints, relations and links of a whole mechanism."""
    builder = Builder(mechanism=mechanism, links={link.name: link for link in mechanism.links})
    for joint in mechanism.joints:
        KINDS[type(joint)](joint, builder)
    return builder
