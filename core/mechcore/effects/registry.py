"""Effects: forces that a scene can ask for. Each says what it needs and which wrenches it adds; what is not named is not computed.

To add an effect: one file here with a subclass of `Effect`, one line in `EFFECTS` (effects that a scene names) or `LOADS` (loads
that it lists, by their spec in `mechcore.spec.loads`). All but inertia can be evaluated from positions, velocities and time alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mechcore.effects.actuator import ConstantThrust
from mechcore.effects.along_line import LineDamper, LineGasSpring, LineSpring
from mechcore.effects.base import Configuration, Effect, PointLoad, Wrench, sum_up
from mechcore.effects.belts import BeltPull
from mechcore.effects.bushing import BushingDampers, BushingSprings
from mechcore.effects.drag import MediumDrag
from mechcore.effects.dry_friction import DryFriction
from mechcore.effects.gas import CylinderGas
from mechcore.effects.gravity import Gravity
from mechcore.effects.inertia import Inertia
from mechcore.effects.journal import JournalFriction, JournalPressure
from mechcore.effects.machines import ConstantPowerMachine, DirectCurrent, Governed, Induction
from mechcore.effects.prescribed import AppliedForce, AppliedTorque
from mechcore.effects.servo import PositionServo
from mechcore.effects.torsion import AngleDamper, AngleSpring
from mechcore.effects.viscous import ViscousFriction
from mechcore.kinematics.model import Model
from mechcore.kinematics.terms import Terms, scaled
from mechcore.numerics.frames import crossed, nothing, plus
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
    """The effects and loads that put wrenches on links without knowing the reactions; ask for them by `Model.once`."""
    return tuple(effect for effect in effects_of(model.mechanism) if "reactions" not in effect.needs)


class KnownLoad(NamedTuple):
    """All `PointLoad`s at one point of a link. ``opposed``: -mass times its place as a sum, None where that is too long."""

    link: int
    point: Any
    arm: Any  # the point in the axes of its spin; None: the link's origin, about which forces have no moment
    force: complex
    mass: float
    inertia: float
    spin: int
    opposed: Terms | None


class KnownLoads(NamedTuple):
    """What effects put on links at points that are known beforehand. ``accelerated``: whether inertia is among it."""

    loads: tuple[KnownLoad, ...]
    accelerated: bool
    others: tuple[Effect, ...]  # applied effects that have to be evaluated


def known_loads(model: Model) -> KnownLoads:
    """The loads of a model that are known beforehand, all at one point in one sum; ask for them by `Model.once`."""
    stated = [(effect, effect.point_loads(model)) for effect in model.once(applied_effects)]
    sums: dict[tuple[int, Any], PointLoad] = {}
    for a in (a for _, own in stated for a in own or ()):
        key = a.link, a.point if isinstance(a.point, complex) else id(a.point)
        b = sums.get(key, PointLoad(a.link, a.point))
        sums[key] = PointLoad(a.link, a.point, a.force + b.force, a.mass + b.mass, a.inertia + b.inertia)
    known = []
    for (k, _), (_, point, force, mass, inertia) in sums.items():
        if k:
            opposed = scaled(model.terms(k, point), -mass) if mass else None
            still = isinstance(point, complex) and point == 0
            arm = None if still else point * model.turn[k]
            known.append(KnownLoad(k, point, arm, force, mass, inertia, model.angles.spin[k], opposed))
    accelerated = any(c.mass or c.inertia for c in known)
    return KnownLoads(tuple(known), accelerated, tuple(effect for effect, own in stated if own is None))


def wrenches(at: Any) -> list[Wrench]:
    """All wrenches that the mechanism's effects and loads put on its links, apart from those that need reactions."""
    return [w for effect in at.model.once(applied_effects) for w in effect.wrenches(at)]


def totals(at: Any) -> tuple[list[Any], list[Any], Callable[[], list[Wrench]]]:
    """Force on every link and moment about its origin, None for nothing, as `sum_up` of the `wrenches`, and a function for these.

    Wrenches that the sums did without (of inertia and constant forces) are formed if that function is called.
    """
    model = at.model
    known, _, others = model.once(known_loads)
    evaluated = {effect: effect.wrenches(at) for effect in others}
    force: list[Any] = [None] * len(model.links)
    moment: list[Any] = [None] * len(model.links)
    rot = at.state.rot
    for k, point, arm, f, mass, inertia, spin, opposed in known:
        if mass:
            inert = at.summed(opposed, 2) if opposed is not None else -mass * at.of_point(k, point, 2)
            f = inert + f if f else inert
        if isinstance(f, np.ndarray) or f:
            force[k] = f if force[k] is None else force[k] + f
            if arm is not None:
                moment[k] = plus(moment[k], crossed(arm * rot[spin], f))
        if inertia:
            alpha = at.accelerations.spin[spin]
            if isinstance(alpha, np.ndarray) or alpha:
                moment[k] = plus(moment[k], -inertia * alpha)
    if others:
        forces_and_moments = sum_up([w for own in evaluated.values() for w in own], len(model.links))
        for total, found in zip((force, moment), forces_and_moments, strict=True):
            for k, a in enumerate(found):
                if not nothing(a):
                    total[k] = plus(total[k], a)

    def formed() -> list[Wrench]:
        return [
            w for effect in model.once(applied_effects) for w in (evaluated[effect] if effect in evaluated else effect.wrenches(at))
        ]

    return force, moment, formed


def potential(at: Configuration) -> Any:
    """Potential energy of all effects that have one [J]."""
    return sum((effect.potential(at) for effect in effects_of(at.model.mechanism) if effect.stores), 0.0)
