"""The loads of a solved mechanism as one of its links feels them."""

from __future__ import annotations

from dataclasses import dataclass

from mechcore.arrays import Plane, Values
from mechcore.forces.kinetostatics import Forces

LABELS = {"inertia": "B", "gravity": "G"}


@dataclass(frozen=True, eq=False)
class Acting:
    """A load as one link feels it: ``force`` (complex) [N] at ``place`` (complex, world) [m], free ``moment`` [N m]."""

    name: str
    label: str  # short, for drawings
    kind: str
    force: Plane
    moment: Values
    place: Plane


def acting_on(forces: Forces, link: int) -> list[Acting]:
    """All loads on a link, inertia and gravity included; of loads between two links the part that acts on this one."""
    motion = forces.motion
    out = []
    for w in forces.applied:
        label = f"{LABELS[w.kind]} {motion.model.links[link]}" if w.kind in LABELS else w.name
        for k, arm, sign in ((w.link, w.arm, 1.0), (w.other, w.other_arm, -1.0)):
            if k == link:
                out.append(Acting(w.name, label, w.kind, sign * w.force, sign * w.moment, motion.origins[k] + arm))
    return out
