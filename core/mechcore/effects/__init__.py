"""Effects: forces that a scene can ask for. Each says what it needs and which wrenches it adds; what is not named is not computed.

To add an effect: one file here with a subclass of `Effect`, one line in `EFFECTS` (effects that a scene names) or `LOADS` (loads
that it lists, by their spec in `mechcore.loads`). All but inertia can be evaluated from positions, velocities and time alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..loads import (
    BeltTension,
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
    Spring,
    Torque,
    TorsionDamper,
    TorsionSpring,
    Viscous,
)
from ..spec import Mechanism
from .along_line import LineDamper, LineGasSpring, LineSpring
from .base import CAUSES, NEEDS, Configuration, Effect
from .belts import BeltPull
from .drag import MediumDrag
from .dry_friction import DryFriction
from .gas import CylinderGas
from .gravity import Gravity
from .inertia import Inertia
from .journal import JournalFriction, JournalPressure
from .machines import ConstantPowerMachine, DirectCurrent, Governed, Induction
from .prescribed import AppliedForce, AppliedTorque
from .torsion import AngleDamper, AngleSpring
from .viscous import ViscousFriction
from .wrench import Totals, Wrench, point_of, power_of, sum_up

__all__ = [
    "CAUSES",
    "EFFECTS",
    "LOADS",
    "NEEDS",
    "Configuration",
    "Effect",
    "Totals",
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
    Spring: LineSpring,
    Damper: LineDamper,
    GasSpring: LineGasSpring,
    TorsionSpring: AngleSpring,
    TorsionDamper: AngleDamper,
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
}


def effects_of(mechanism: Mechanism) -> tuple[Effect, ...]:
    """The effects that a mechanism names and the loads that it lists, as objects; nothing is computed."""
    named = [EFFECTS[name](name) for name in mechanism.effects if name in EFFECTS]
    return (*named, *(LOADS[type(load)](load) for load in mechanism.loads))


def wrenches(at: Any) -> list[Wrench]:
    """All wrenches that the mechanism's effects and loads put on its links, apart from those that need reactions."""
    return [w for effect in at.model.applied for w in effect.wrenches(at)]


def totals(at: Any) -> tuple[list[Any], list[Any], Callable[[], list[Wrench]]]:
    """Force on every link and moment about its origin, as `sum_up` of the `wrenches`, and a function that gives these.

    Wrenches that the sums did without (of inertia and gravity) are formed if that function is called.
    """
    model = at.model
    total = Totals(len(model.links))
    found = [(effect, effect.sum_into(at, total)) for effect in model.applied]

    def formed() -> list[Wrench]:
        return [w for effect, own in found for w in (effect.wrenches(at) if own is None else own)]

    return (*total.sums(), formed)


def potential(at: Configuration) -> Any:
    """Potential energy of all effects that have one [J]."""
    return sum((effect.potential(at) for effect in effects_of(at.model.mechanism) if effect.stores), 0.0)
