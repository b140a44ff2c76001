"""Checks of a mechanism before it is compiled: named items exist, links have a length, angles are determined once, loads have valid
values."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields

from mechcore.errors import Fault, MechanismError
from mechcore.joints.base import LoopJoint
from mechcore.spec.loads import (
    Actuator,
    BeltTension,
    Bushing,
    BushingDamper,
    Damper,
    Drag,
    Factor,
    Force,
    GasPressure,
    GasSpring,
    Governor,
    Load,
    Machine,
    Prescribed,
    Servo,
    Spring,
    Viscous,
)
from mechcore.spec.mechanism import EFFECTS, Belt, Cylinder, Mechanism, PinSlot, Planar, Prismatic, Revolute, Weld, coordinates_of
from mechcore.texts import as_angle, as_length, as_torque
from mechcore.topology.graph import Angles

_POSITIVE = ("radial", "gas_length", "solid_length", "extended", "exponent", "area", "breakdown_torque", "breakdown_slip", "power",
             "gain")  # fmt: skip
_NOT_ZERO = ("stall_torque", "no_load_speed", "synchronous_speed", "torque_limit")
_NOT_NEGATIVE = ("stiffness", "free_length", "linear", "quadratic", "coefficient", "damping", "back", "slack",
                 "proportional", "derivative", "integral")  # fmt: skip


def load_faults(mechanism: Mechanism) -> list[Fault]:
    """Every fault of the loads and effects of a mechanism; its links and joints are known to be valid."""
    faults = [
        Fault("effects", f"there is no effect '{name}'.", f"Known: {', '.join(EFFECTS)}.")
        for name in mechanism.effects
        if name not in EFFECTS
    ]
    names = [load.name for load in mechanism.loads]
    twice = sorted(name for name, times in Counter(names).items() if times > 1)
    faults += [Fault(f"loads.{name}", "two loads have this name.", "Rename one of them.") for name in twice]
    for load in mechanism.loads:
        path = f"loads.{load.name}"
        faults += [Fault(path, *words) for words in (*_values(load), *_names(mechanism, load))]
    return faults


def _values(load: Load) -> Iterator[tuple[str, str]]:
    for f in fields(load):
        stated = getattr(load, f.name)
        for value in stated if isinstance(stated, tuple) else (stated,):
            if not isinstance(value, float | int) or isinstance(value, bool):
                continue
            if not math.isfinite(value):
                yield f"its {f.name} is {value}.", "Give a finite number."
            elif (f.name in _POSITIVE and value <= 0) or (f.name in _NOT_NEGATIVE and value < 0):
                yield f"its {f.name} of {value:g} is {'negative' if value < 0 else 'zero'}.", "Give a positive one."
            elif f.name in _NOT_ZERO and value == 0:
                yield f"its {f.name} is zero.", "Give one; its sign is the direction."
    if isinstance(load, Governor) and not load.least < load.most:
        why = f"its least torque of {as_torque(load.least)} is no less than its greatest of {as_torque(load.most)}."
        yield why, "Give [least, most]."
    if isinstance(load, Spring) and load.solid_length is not None and load.solid_length > (load.free_length or math.inf):
        solid, free = as_length(load.solid_length), as_length(load.free_length)
        yield f"its solid length of {solid} is more than its free length of {free}.", "Give a smaller solid_length."
    if isinstance(load, Damper | Drag) and not (load.linear or load.quadratic):
        yield "it has neither a linear nor a quadratic coefficient.", "Give one of them."


def _names(m: Mechanism, load: Load) -> Iterator[tuple[str, str]]:
    links = {link.name: link for link in m.links}
    used = list(getattr(load, "links", ()))
    used += [k for k in (getattr(load, "link", None), getattr(load, "against", None)) if k is not None]
    for link in used:
        if link not in links:
            yield f"there is no link '{link}'.", ""
    if len(used) == 2 and used[0] == used[1]:
        yield f"acts between '{used[0]}' and itself.", "Name two different links."
    places: list[tuple[str, str]] = []
    if isinstance(load, Spring | Damper | GasSpring | Actuator | Bushing | BushingDamper):
        places = list(zip(load.links, load.points, strict=False))
    elif isinstance(load, Force | Drag) and load.point is not None:
        places = [(load.link, load.point)]
    factor = load.factor if isinstance(load, Prescribed) else None
    if factor is not None:
        places += [factor.point] if factor.point is not None else []
        yield from _factor(m, factor)
    for link, point in places:
        if link in links and point not in links[link].points:
            yield f"link '{link}' has no point '{point}'.", ""
    joints = {p.name: p for p in m.joints}
    if isinstance(load, Viscous | GasPressure):
        gas = isinstance(load, GasPressure)
        if load.joint not in joints:
            yield f"there is no joint '{load.joint}'.", ""
        elif isinstance(joints[load.joint], Weld | Planar) or (gas and not isinstance(joints[load.joint], Prismatic | Cylinder)):
            what = "sliding joint" if gas else "joint that moves"
            yield f"'{load.joint}' is no {what}.", f"Name a {what}."
    if isinstance(load, Servo) and not isinstance(joints.get(load.joint), Revolute | Prismatic | PinSlot | Cylinder):
        yield f"'{load.joint}' is no revolute or sliding joint.", "Name a revolute or sliding joint."
    if isinstance(load, Actuator):
        if (load.joint is None) != (len(load.links) == len(load.points) == 2):
            yield "it has to act between two points or along a joint.", "Give one of them."
        elif load.joint is not None and not isinstance(joints.get(load.joint), Prismatic | PinSlot | Cylinder):
            yield f"'{load.joint}' is no sliding joint.", "Name a sliding joint, or two points."
    if isinstance(load, BeltTension) and not isinstance(joints.get(load.joint), Belt):
        yield f"'{load.joint}' is no belt or chain.", "Name a belt or chain."
    if isinstance(load, Machine):
        if (load.link is None) == (load.joint is None):
            yield "it has to act on a link or on a joint.", "Give one of them."
        elif load.joint is not None and not isinstance(joints.get(load.joint), Revolute):
            yield f"'{load.joint}' is no revolute joint.", "Name a revolute joint, or a link."
    if isinstance(load, GasPressure) and load.drive is not None and load.drive not in joints:
        yield f"there is no joint '{load.drive}'.", ""


def _factor(m: Mechanism, factor: Factor) -> Iterator[tuple[str, str]]:
    if factor.of in ("x", "y", "vx", "vy", "speed"):
        if factor.point is None:
            yield f"its factor depends on {factor.of}, but of which point?", "Give its point."
    elif factor.of in ("position", "velocity"):
        if factor.joint is None and not m.drives:
            yield "its factor depends on the position of a drive, and there is none.", "Name a joint."
        elif factor.joint is not None and factor.joint not in {p.name for p in m.joints}:
            yield f"there is no joint '{factor.joint}'.", ""


def check_items(m: Mechanism) -> None:
    """Check that names are unique and that named items exist. Raises `MechanismError`."""
    faults = []
    links = {link.name: link for link in m.links}
    if len(links) != len(m.links):
        faults.append(Fault("links", "two links have the same name.", "Rename one of them."))
    if len({p.name for p in m.joints}) != len(m.joints):
        faults.append(Fault("joints", "two joints have the same name.", "Rename one of them."))
    if m.frame not in links:
        faults.append(Fault("frame", f"there is no link '{m.frame}'.", f"There are: {', '.join(links)}."))
    for p in m.joints:
        points: tuple[str | None, str | None] = getattr(p, "points", (None, None))  # some joints name no points
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


def missing_joint(m: Mechanism) -> str:
    """Text of a joint that may be missing: at points of the same name, one of which no joint connects; "" if there is none."""
    joined: dict[str, list[set[str]]] = {}
    for joint in m.joints:
        first, second = getattr(joint, "points", (None, None))
        if first is not None and first == second:
            own = set(joint.links)
            apart = [links for links in joined.get(first, ()) if links.isdisjoint(own)]
            joined[first] = [*apart, own.union(*(links for links in joined.get(first, ()) if links & own))]
    for point in dict.fromkeys(point for link in m.links for point in link.points):
        owners = [link.name for link in m.links if point in link.points]
        one = next((links for links in joined.get(point, ()) if owners[0] in links), {owners[0]})
        other = next((owner for owner in owners if owner not in one), None)
        if other is not None:
            others = " or ".join(f"'{owner}'" for owner in owners if owner in one)
            return f"a joint at {point}, where none joins '{other}' to {others}"
    return ""


def check_lengths(
    joints: tuple[LoopJoint, ...], ends: tuple[tuple[int, int], ...], names: tuple[str, ...], decided: set[str]
) -> None:
    """Raise `MechanismError` for moving links without length: only pinned, all pins at one point, so that their angle is
    undetermined.

    Shafts and wheels are pinned in this manner too, but gears, belts or drives at both ends determine their angle: they are in
    ``decided``.
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


def check_redundant_angles(m: Mechanism, turning: Angles, joints: tuple[LoopJoint, ...], ends: tuple[tuple[int, int], ...]) -> None:
    """Raise `MechanismError` if a joint that fixes an angle contradicts other joints that fix the same angle."""
    faults = []
    for j in turning.redundant:
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
