"""Effects: forces that a scene can include. Each states what it needs and which wrenches it adds; others are not computed.

To add one: a subclass of `Effect` in the module of its family, one line in `EFFECTS` (effects that a scene names) or `LOADS` (loads
that it lists, by their spec in `mechcore.spec.loads`). All but inertia can be evaluated from positions, velocities and time alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mechcore.effects.base import Configuration, Effect, KnownLoad, PointLoad, Wrench, known_load, sum_up
from mechcore.effects.machines import ConstantPowerMachine, CylinderGas, DirectCurrent, Governed, Induction, PositionServo
from mechcore.effects.masses import Gravity, Inertia
from mechcore.effects.prescribed import AppliedForce, AppliedTorque, ConstantThrust
from mechcore.effects.resistance import BeltPull, DryFriction, JournalFriction, JournalPressure, MediumDrag, ViscousFriction
from mechcore.effects.springs import AngleDamper, AngleSpring, BushingDampers, BushingSprings, LineDamper, LineGasSpring, LineSpring
from mechcore.kinematics.model import Model
from mechcore.numerics.frames import QUIET, added, crossed, is_zero
from mechcore.spec.loads import (
    Actuator,
    BeltTension,
    Bushing,
    BushingDamper,
    ConstantPower,
    Damper,
    DcMotor,
    Drag,
    Force,
    GasPressure,
    GasSpring,
    Governor,
    InductionMotor,
    JournalContact,
    JournalLoss,
    Servo,
    Spring,
    Torque,
    TorsionDamper,
    TorsionSpring,
    Viscous,
)
from mechcore.spec.mechanism import Mechanism

EFFECTS: dict[str, Callable[[str], Effect]] = {
    "inertia": Inertia,
    "gravity": Gravity,
    "friction": DryFriction,
}
LOADS: dict[type, Callable[[Any], Effect]] = {
    Force: AppliedForce,
    Torque: AppliedTorque,
    Actuator: ConstantThrust,
    Spring: LineSpring,
    Damper: LineDamper,
    GasSpring: LineGasSpring,
    TorsionSpring: AngleSpring,
    TorsionDamper: AngleDamper,
    Bushing: BushingSprings,
    BushingDamper: BushingDampers,
    Drag: MediumDrag,
    Viscous: ViscousFriction,
    BeltTension: BeltPull,
    GasPressure: CylinderGas,
    JournalContact: JournalPressure,
    JournalLoss: JournalFriction,
    DcMotor: DirectCurrent,
    InductionMotor: Induction,
    ConstantPower: ConstantPowerMachine,
    Governor: Governed,
    Servo: PositionServo,
}


def effects_of(mechanism: Mechanism) -> tuple[Effect, ...]:
    """The effects that a mechanism names and the loads that it lists, as objects; nothing is computed."""
    named = [EFFECTS[name](name) for name in mechanism.effects if name in EFFECTS]
    return (*named, *(LOADS[type(load)](load) for load in mechanism.loads))


def applied_effects(model: Model) -> tuple[Effect, ...]:
    """The effects and loads that put wrenches on links without knowledge of the reactions; call it through `Model.cached`."""
    return tuple(effect for effect in effects_of(model.mechanism) if "reactions" not in effect.needs)


class KnownLoads(NamedTuple):
    """Loads at points that are known beforehand, summed by points."""

    loads: tuple[KnownLoad, ...]
    others: tuple[Effect, ...]  # applied effects that have to be evaluated


def known_loads(model: Model) -> KnownLoads:
    """The loads of a model that are known beforehand; call it through `Model.cached`."""
    stated = [(effect, effect.point_loads(model)) for effect in model.cached(applied_effects)]
    sums: dict[tuple[int, Any], PointLoad] = {}
    for a in (a for _, own in stated for a in own or () if a.link):
        key = a.link, a.point if isinstance(a.point, complex) else id(a.point)
        sums[key] = sums[key].together(a) if key in sums else a
    loads = tuple(known_load(model, a) for a in sums.values())
    return KnownLoads(loads, tuple(effect for effect, own in stated if own is None))


def wrenches(at: Any) -> list[Wrench]:
    """All wrenches that the mechanism's effects and loads put on its links, apart from those that need reactions."""
    return [w for effect in at.model.cached(applied_effects) for w in effect.wrenches(at)]


def totals(at: Any) -> tuple[list[Any], list[Any], Callable[[], list[Wrench]]]:
    """Force on every link and moment about its origin, as `sum_up` of the `wrenches`, and a function for these.

    Wrenches that the sums do not need (of inertia and constant forces) are formed only if that function is called.
    """
    model, rot = at.model, at.state.rot
    known = model.cached(known_loads)
    evaluated: dict[Effect, list[Wrench]] = {}
    if known.others:
        with np.errstate(**QUIET):
            evaluated = {effect: effect.wrenches(at) for effect in known.others}
    force, moment = sum_up([w for own in evaluated.values() for w in own], len(model.links))
    for load in known.loads:
        _, k, rotation_class, arm, *_ = load
        f, couple = load.acting(at)
        if arm is not None and not is_zero(f):
            couple = added(couple, crossed(arm * rot[rotation_class], f))
        force[k], moment[k] = added(force[k], f), added(moment[k], couple)

    def formed() -> list[Wrench]:
        return [
            w
            for effect in model.cached(applied_effects)
            for w in (evaluated[effect] if effect in evaluated else effect.wrenches(at))
        ]

    return force, moment, formed


def potential(at: Configuration) -> Any:
    """Potential energy of all effects that have one [J]."""
    return sum((effect.potential(at) for effect in effects_of(at.model.mechanism) if effect.stores), 0.0)
