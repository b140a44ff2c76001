"""Do the loads of a mechanism name what exists, with values that make sense?"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields

from mechcore.errors import Fault
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
from mechcore.spec.mechanism import EFFECTS, Belt, Cylinder, Mechanism, PinSlot, Planar, Prismatic, Revolute, Weld
from mechcore.texts import as_length, as_torque

_POSITIVE = ("radial", "gas_length", "solid_length", "extended", "exponent", "area", "breakdown_torque", "breakdown_slip", "power",
             "gain")  # fmt: skip
_NOT_ZERO = ("stall_torque", "no_load_speed", "synchronous_speed", "torque_limit")
_NOT_NEGATIVE = ("stiffness", "free_length", "linear", "quadratic", "coefficient", "damping", "back", "slack",
                 "proportional", "derivative", "integral")  # fmt: skip


def load_faults(mechanism: Mechanism) -> list[Fault]:
    """Every fault of the loads and effects of a mechanism; its links and joints are known to be sound."""
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
