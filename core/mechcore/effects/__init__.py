"""Effects: forces that a scene can ask for. Each says what it needs and which wrenches it adds; what is not named is not computed.

To add an effect: one file here with a subclass of `Effect`, one line in `EFFECTS` (effects that a scene names) or `LOADS` (loads
that it lists, by their spec in `mechcore.loads`). All but inertia can be evaluated from positions, velocities and time alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..frames import crossed, nothing, plus
from ..loads import (
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
from ..spec import Mechanism
from .actuator import ConstantThrust
from .along_line import LineDamper, LineGasSpring, LineSpring
from .base import CAUSES, NEEDS, Configuration, Effect
from .belts import BeltPull
from .bushing import BushingDampers, BushingSprings
from .drag import MediumDrag
from .dry_friction import DryFriction
from .gas import CylinderGas
from .gravity import Gravity
from .inertia import Inertia
from .journal import JournalFriction, JournalPressure
from .machines import ConstantPowerMachine, DirectCurrent, Governed, Induction
from .prescribed import AppliedForce, AppliedTorque
from .servo import PositionServo
from .torsion import AngleDamper, AngleSpring
from .viscous import ViscousFriction
from .wrench import Wrench, point_of, power_of, sum_up

__all__ = [
    "CAUSES",
    "EFFECTS",
    "LOADS",
    "NEEDS",
    "Configuration",
    "Effect",
    "Wrench",
    "effects_of",
    "point_of",
    "potential",
    "power_of",
    "sum_up",
    "totals",
    "wrenches",
]

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


def wrenches(at: Any) -> list[Wrench]:
    """All wrenches that the mechanism's effects and loads put on its links, apart from those that need reactions."""
    return [w for effect in at.model.applied for w in effect.wrenches(at)]


def totals(at: Any) -> tuple[list[Any], list[Any], Callable[[], list[Wrench]]]:
    """Force on every link and moment about its origin, None for nothing, as `sum_up` of the `wrenches`, and a function for these.

    Wrenches that the sums did without (of inertia and constant forces) are formed if that function is called.
    """
    model = at.model
    known, _, others = model.told
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
        return [w for effect in model.applied for w in (evaluated[effect] if effect in evaluated else effect.wrenches(at))]

    return force, moment, formed


def potential(at: Configuration) -> Any:
    """Potential energy of all effects that have one [J]."""
    return sum((effect.potential(at) for effect in effects_of(at.model.mechanism) if effect.stores), 0.0)
