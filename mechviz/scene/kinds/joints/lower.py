"""Joints that hold points of their links together: pins, guides, welds, pins in slots, cylinders, screws; and free bodies."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from mechcore.spec.mechanism import Cylinder, Joint, PinSlot, Planar, Prismatic, Revolute, Screw, Weld
from mechviz.scene.fields import Angle, DocumentTable, Length, Size, Text, value_or_list
from mechviz.scene.kinds.friction import PIN, PIN_IN_SLOT, SEALS, SLIDER, THREAD, ClearanceDocument
from mechviz.scene.kinds.kind import JointKind, JointMaker
from mechviz.scene.names import TwoLinks

TwoEnds = Annotated[list[Length], Field(min_length=2, max_length=2)]
Ends = Annotated[Annotated[Size, Tag("<value>")] | Annotated[TwoEnds, Tag("<list>")], Discriminator(value_or_list)]

MOTION = ("friction", "drive", "free", "stops")


class LowerKeys(DocumentTable):
    """The keywords of these joints, and the keys that only they have."""

    revolute: TwoLinks | None = None
    """The two links that a pin joins."""
    prismatic: TwoLinks | None = None
    """The two links of which one slides along the other."""
    weld: TwoLinks | None = None
    """The two links that are joined rigidly."""
    pin_slot: TwoLinks | None = None
    """The two links of which one has a straight slot for a pin of the other."""
    cylinder: TwoLinks | None = None
    """The two links between which a cylinder (hydraulic, electric ...) is pinned."""
    screw: TwoLinks | None = None
    """The two links of which one, the nut, is moved along the other by a screw, whose axis lies in the plane."""
    planar: TwoLinks | None = None
    """The two links of which the second moves freely in the plane of the first: a free body."""
    guide: Text | None = None
    """Prismatic, pin in slot, screw: the link that carries the guide, slot or spindle. Default: the first."""
    length: Ends | None = None
    """Pin in slot, prismatic: travel of the pin or slider along the slot or guide from its point, or [from, to]; cylinder: its
    greatest length, or [least, greatest]. Prescribed motion beyond is refused, free motion meets an end stop there. Default: no
    ends."""
    angle: Angle | None = None
    """Prismatic, weld, screw: constant angle from the first link's frame to the second's. Default 0, or as drawn."""
    lead: Size | None = None
    """Screw: travel of the nut along the guide in one turn of the spindle."""
    clearance: ClearanceDocument | None = None
    """Revolute: clearance between journal and bearing, whose motion forces decide."""


def _revolute(m: JointMaker) -> Joint:
    return Revolute(name=m.name, links=m.joint.links, points=m.points, friction=m.friction)


def _prismatic(m: JointMaker) -> Joint:
    return Prismatic(**_guided(m), angle=m.angle, ends=m.ends)


def _weld(m: JointMaker) -> Joint:
    return Weld(name=m.name, links=m.joint.links, points=m.points, angle=m.angle)


def _pin_slot(m: JointMaker) -> Joint:
    return PinSlot(**_guided(m), ends=m.ends)


def _cylinder(m: JointMaker) -> Joint:
    return Cylinder(name=m.name, links=m.joint.links, points=m.points, ends=m.ends, friction=m.friction)


def _screw(m: JointMaker) -> Joint:
    lead = math.nan if m.joint.lead is None else m.convert.si(m.joint.lead, "length", f"{m.path}.lead")
    return Screw(**_guided(m), angle=m.angle, lead=lead)


def _guided(m: JointMaker) -> dict[str, Any]:
    """Keys of all joints along a guide."""
    return {
        "name": m.name,
        "links": m.joint.links,
        "points": m.points,
        "along": m.along,
        "guide": m.guide,
        "friction": m.friction,
    }


def _planar(m: JointMaker) -> Joint:
    return Planar(name=m.name, links=m.joint.links, point=m.joint.at if isinstance(m.joint.at, str) else None)


LOWER = {
    "revolute": JointKind(
        words="a revolute joint",
        example='{ revolute = ["frame", "crank"], drive = { speed = "60 rpm" } }',
        make=_revolute,
        keys=("at", "side", "assembly", "branch", "clearance", *MOTION),
        modes=("side", "assembly", "branch"),
        synonyms=("hinge", "pin"),
        driven="angle",
        viscous="torsional damping",
        friction=PIN,
        coincide=True,
    ),
    "prismatic": JointKind(
        words="a prismatic joint",
        example='{ prismatic = ["frame", "piston"], at = ["O", "P"], along = [1, 0] }',
        make=_prismatic,
        keys=("at", "along", "guide", "angle", "length", "branch", *MOTION),
        modes=("branch",),
        synonyms=("slider", "slide", "translational"),
        driven="length",
        viscous="damping",
        friction=SLIDER,
        parallel=True,
    ),
    "weld": JointKind(
        words="a weld",
        example='{ weld = ["shaft", "arm"], angle = "30 deg" }',
        make=_weld,
        keys=("at", "angle"),
        synonyms=("fixed", "rigid"),
        undriven="A weld does not move: leave it out.",
        coincide=True,
        parallel=True,
    ),
    "pin_slot": JointKind(
        words="a pin in a slot",
        example='{ pin_slot = ["wheel", "crank"], at = ["O", "B"], along = [0, 1], length = "80 mm" }',
        make=_pin_slot,
        keys=("at", "along", "guide", "length", "branch", *MOTION),
        modes=("branch",),
        synonyms=("slot",),
        driven="length",
        viscous="damping",
        friction=PIN_IN_SLOT,
        higher=True,
    ),
    "cylinder": JointKind(
        words="a cylinder",
        example='{ cylinder = ["frame", "boom"], at = ["P", "Q"], length = ["0.4 m", "0.7 m"] }',
        make=_cylinder,
        keys=("at", "length", "side", *MOTION),
        modes=("side",),
        synonyms=("actuator", "piston"),
        driven="length",
        viscous="damping",
        friction=SEALS,
        own_mode=True,
        parts={"links": ("barrel", "rod"), "joints": ("base", "eye")},
    ),
    "screw": JointKind(
        words="a screw",
        example='{ screw = ["frame", "table"], at = ["O", "T"], lead = "5 mm", drive = { speed = "600 rpm" } }',
        make=_screw,
        keys=("at", "along", "guide", "angle", "lead", *MOTION),
        needs={"lead": '"5 mm", the travel in one turn'},
        synonyms=("spindle", "leadscrew", "ballscrew", "nut"),
        remedies={"pitch": "Write lead = ...", "length": "Give stops to the turn of the spindle."},
        driven="angle",
        viscous="torsional damping",
        friction=THREAD,
        parallel=True,
        parts={"links": ("spindle",), "joints": ("slide", "thread")},
    ),
    "planar": JointKind(
        words="a planar joint",
        example='{ planar = ["frame", "stone"], free = { y = "1 m", vx = "2 m/s" } }',
        make=_planar,
        keys=("at", "free"),
        needs={"free": '{ y = "1 m", vx = "2 m/s", omega = "60 rpm" }, its start'},
        undriven="Its start is free = { x = ..., vy = ... }.",
        joins_points=False,
        is_planar=True,
        parts={"links": ("x", "y"), "joints": ("x", "y")},
    ),
}
"""The kinds of joints that hold points of their links together, and the planar one, which leaves them free."""
