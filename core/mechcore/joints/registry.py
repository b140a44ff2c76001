"""The kinds of joints, and their conversion to the common forms that the rest of the core works with.

A lower pair is a `LoopJoint` (points that coincide or slide); gears, belts, racks, rolling and cams add a `Relation`.
To add a kind of joint: add its spec to `mechcore.spec.mechanism`, a function that builds it to the module of its family, and a line
to `JOINT_KINDS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mechcore.joints.base import Builder
from mechcore.joints.cam import build_cam
from mechcore.joints.lower import build_cylinder, build_guided, build_pinned, build_planar, build_screw
from mechcore.joints.wheels import build_belt, build_gear, build_rack, build_rolling
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
    Screw,
    Weld,
)

JOINT_KINDS: dict[type, Callable[[Any, Builder], None]] = {
    Revolute: build_pinned,
    Prismatic: build_guided,
    Weld: build_pinned,
    PinSlot: build_guided,
    Rolling: build_rolling,
    Gear: build_gear,
    Belt: build_belt,
    Rack: build_rack,
    Cylinder: build_cylinder,
    Screw: build_screw,
    Planar: build_planar,
    CamJoint: build_cam,
}


def build_joints(mechanism: Mechanism) -> Builder:
    """Joints, relations and links of a whole mechanism."""
    builder = Builder(mechanism=mechanism, links={link.name: link for link in mechanism.links})
    for joint in mechanism.joints:
        JOINT_KINDS[type(joint)](joint, builder)
    return builder
