"""Checks of a mechanism before it is compiled: items that exist, links with a length, angles decided once."""

from __future__ import annotations

import math

from mechcore.errors import Fault, MechanismError
from mechcore.joints.base import LoopJoint
from mechcore.spec.load_checks import load_faults
from mechcore.spec.mechanism import Mechanism, coordinates_of
from mechcore.texts import as_angle
from mechcore.topology.graph import Angles


def check_items(m: Mechanism) -> None:
    """Names stand once, what is named is there. Raises `MechanismError`."""
    faults = []
    links = {link.name: link for link in m.links}
    if len(links) != len(m.links):
        faults.append(Fault("links", "two links have the same name.", "Rename one of them."))
    if len({p.name for p in m.joints}) != len(m.joints):
        faults.append(Fault("joints", "two joints have the same name.", "Rename one of them."))
    if m.frame not in links:
        faults.append(Fault("frame", f"there is no link '{m.frame}'.", f"There are: {', '.join(links)}."))
    for p in m.joints:
        points: tuple[str | None, str | None] = getattr(p, "points", (None, None))  # relations join no points
        for link, point in zip(p.links, points, strict=True):
            if link not in links:
                faults.append(Fault(f"joints.{p.name}", f"there is no link '{link}'.", f"There are: {', '.join(links)}."))
            elif point is not None and point not in links[link].points:
                faults.append(
                    Fault(f"joints.{p.name}", f"link '{link}' has no point '{point}'.", "Add it to the link, or name another.")
                )
        if p.links[0] == p.links[1]:
            faults.append(Fault(f"joints.{p.name}", "joins a link to itself.", "Name two links."))
    joints = {name for p in m.joints for name in coordinates_of(p)}
    unknown = [d.joint for d in m.drives if d.joint not in joints]
    faults += [Fault(f"drives.{name}", "drives a joint that does not exist.", "Name a joint that does.") for name in unknown]
    if len({d.joint for d in m.drives}) != len(m.drives):
        faults.append(Fault("drives", "a joint has two drives.", "Leave out one of them."))
    if not faults:
        faults += load_faults(m)
    if faults:
        raise MechanismError(faults)


def check_lengths(
    joints: tuple[LoopJoint, ...], ends: tuple[tuple[int, int], ...], names: tuple[str, ...], decided: set[str]
) -> None:
    """A moving link that is only pinned, all pins at one point, leaves its own angle to nothing: it has no length.

    Shafts and wheels are such links too: their angle is ``decided``, and passed on, by gears, belts or drives at both ends.
    """
    pins: dict[int, list[tuple[str, complex]]] = {}
    others: set[int] = set()
    for joint, (p, q) in zip(joints, ends, strict=True):
        for k, at in ((p, joint.a), (q, joint.b)):
            if joint.kind == "revolute":
                pins.setdefault(k, []).append((joint.name, at))
            else:
                others.add(k)
    faults = []
    for k, own in pins.items():
        if k == 0 or k in others or names[k] in decided or len(own) < 2:
            continue
        if all(abs(z - own[0][1]) <= 1e-14 * max(abs(own[0][1]), 1e-300) for _, z in own):
            which = " and ".join(name for name, _ in own)
            why = f"it has no length: its pins {which} are at the same point."
            faults.append(Fault(f"links.{names[k]}", why, "Move one of the pins, or join the neighbours directly."))
    if faults:
        raise MechanismError(faults)


def check_spare_angles(m: Mechanism, turning: Angles, joints: tuple[LoopJoint, ...], ends: tuple[tuple[int, int], ...]) -> None:
    """Joints that fix an angle which others have fixed already must agree with them."""
    faults = []
    for j in turning.spare:
        p, q = ends[j]
        if turning.rotation_class[p] != turning.rotation_class[q] or joints[j].turns:
            why = "its angle is decided twice: by its own drive or guide and by other drives."
            faults.append(Fault(f"joints.{joints[j].name}", why, "Take one of these drives away."))
            continue
        off = (turning.offset[p] + joints[j].angle - turning.offset[q] + math.pi) % (2.0 * math.pi) - math.pi
        if abs(off) > 1e-9:
            why = f"its angle contradicts that of the other guides between the same links by {as_angle(off)}."
            faults.append(Fault(f"joints.{joints[j].name}", why, "Make the guides parallel."))
    if faults:
        raise MechanismError(faults)
