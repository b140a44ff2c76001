"""Machines: motors by their characteristic, machines of constant power, governors, and servos."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Discriminator, Field, Tag

from mechcore.errors import Fault
from mechcore.laws.signals import SignalPosition
from mechcore.laws.timed import ConstantSpeed, Law
from mechcore.spec.loads import ConstantPower, DcMotor, Governor, InductionMotor, Load, Servo
from mechcore.texts import as_torque
from mechviz.scene.fields import (
    AngularSpeed,
    Coefficient,
    Coordinate,
    DocumentTable,
    IntegralGain,
    Power,
    Stiffness,
    Text,
    TorsionalGain,
    table_or_value,
)
from mechviz.scene.fields import Torque as TorqueValue
from mechviz.scene.kinds.drive_laws import law_of
from mechviz.scene.kinds.drives import DriveDocument
from mechviz.scene.kinds.kind import LoadKind, LoadMaker, Positive, known_shaft
from mechviz.scene.kinds.signals import SIGNALS, signal_of
from mechviz.scene.names import Reference

if TYPE_CHECKING:
    from mechviz.scene.reading.recovery import Reading


ServoTarget = Annotated[
    Annotated[Coordinate, Tag("<value>")] | Annotated[DriveDocument, Tag("<table>")], Discriminator(table_or_value)
]


ServoName = Annotated[Text, Reference("joint", ("revolute", "prismatic", "pin_slot", "cylinder"), "revolute or sliding joint")]


class MachineKeys(DocumentTable):
    """The keywords of these loads, and the keys that only they have."""

    dc_motor: Text | None = None
    """The revolute joint or the link that a DC motor drives: a straight characteristic."""
    induction_motor: Text | None = None
    """The revolute joint or the link that an induction motor drives: slip curve of Kloss."""
    constant_power: Text | None = None
    """The revolute joint or the link that a machine of constant power drives."""
    governor: Text | None = None
    """The revolute joint or the link that a machine with a proportional speed governor drives."""
    servo: ServoName | None = None
    """The revolute or sliding joint whose coordinate a servo controls to a target, in a motion under forces."""
    stall_torque: TorqueValue | None = None
    """DC motor: torque at rest; its sign is the direction."""
    no_load_speed: AngularSpeed | None = None
    """DC motor: speed without load, of the same sign."""
    breakdown_torque: TorqueValue | None = None
    """Induction motor: greatest torque."""
    breakdown_slip: Positive | None = None
    """Induction motor: slip at the breakdown torque."""
    synchronous_speed: AngularSpeed | None = None
    """Induction motor: speed of the field; its sign is the direction."""
    power: Power | None = None
    """Constant power: the power."""
    torque_limit: TorqueValue | None = None
    """Constant power: greatest torque, at low speeds; its sign is the direction."""
    set_speed: AngularSpeed | None = None
    """Governor: speed without load."""
    gain: TorsionalGain | None = None
    """Governor: torque per speed below the set speed."""
    limits: Annotated[list[TorqueValue], Field(min_length=2, max_length=2)] | None = None
    """Governor: least and greatest torque."""
    target: ServoTarget | None = None
    """Servo: the target coordinate, times a signal if one is given; or a law of motion, by the keys of a drive."""
    proportional: Stiffness | None = None
    """Servo: torque per angle, or force per length, of the error (target less coordinate)."""
    derivative: Coefficient | None = None
    """Servo: torque per angular speed, or force per speed, of the rate of the error. Default 0."""
    integral: IntegralGain | None = None
    """Servo: torque per angle and time, or force per length and time, of the integral of the error since the start. Default 0."""


def _driven(m: LoadMaker, name: str) -> dict[str, Any]:
    """The joint or the link that a machine drives."""
    return {"joint": name} if name in m.document.joints else {"link": name}


def _not_zero(m: LoadMaker, **values: float) -> None:
    for key, value in values.items():
        if value == 0.0:
            m.convert.note(f"{m.path}.{key}", "is zero.", "Give a value; its sign is the direction.")


def _dc_motor(m: LoadMaker) -> Load | None:
    assert m.load.dc_motor is not None
    stall, speed = m.si("stall_torque", "torque"), m.si("no_load_speed", "angular speed")
    if m.load.stall_torque is not None and m.load.no_load_speed is not None:
        _not_zero(m, stall_torque=stall, no_load_speed=speed)
        if stall * speed < 0.0:
            why = "stall torque and no-load speed point in opposite directions."
            m.convert.note(f"{m.path}.no_load_speed", why, "Give both the same sign.")
    return DcMotor(**m.common, **_driven(m, m.load.dc_motor), stall_torque=stall, no_load_speed=speed)


def _induction_motor(m: LoadMaker) -> Load | None:
    assert m.load.induction_motor is not None
    torque, speed = m.si("breakdown_torque", "torque"), m.si("synchronous_speed", "angular speed")
    if m.load.breakdown_torque is not None and torque <= 0.0:
        why = f"{as_torque(torque)} is not positive."
        m.convert.note(f"{m.path}.breakdown_torque", why, "The sign of the synchronous speed is the direction.")
    if m.load.synchronous_speed is not None:
        _not_zero(m, synchronous_speed=speed)
    return InductionMotor(
        **m.common,
        **_driven(m, m.load.induction_motor),
        breakdown_torque=torque,
        breakdown_slip=m.load.breakdown_slip or math.nan,
        synchronous_speed=speed,
    )


def _constant_power(m: LoadMaker) -> Load | None:
    assert m.load.constant_power is not None
    power, limit = m.si("power", "power"), m.si("torque_limit", "torque")
    if m.load.torque_limit is not None:
        _not_zero(m, torque_limit=limit)
    return ConstantPower(**m.common, **_driven(m, m.load.constant_power), power=power, torque_limit=limit)


def _governor(m: LoadMaker) -> Load | None:
    assert m.load.governor is not None
    least, most = m.convert.row(m.load.limits or (math.nan, math.nan), "torque", f"{m.path}.limits")
    if least >= most:
        why = f"{as_torque(least)} is no less than {as_torque(most)}."
        m.convert.note(f"{m.path}.limits", why, "Write [least, greatest].")
    return Governor(
        **m.common,
        **_driven(m, m.load.governor),
        set_speed=m.si("set_speed", "angular speed"),
        gain=m.si("gain", "torsional damping"),
        least=least,
        most=most,
    )


def _servo(m: LoadMaker) -> Load | None:
    load = m.load
    assert load.servo is not None
    joint = m.document.joints.get(load.servo)
    if joint is None or len(joint.kinds) > 1:
        return None
    torsional = "torsional " if joint.coordinate == "angle" else ""
    gains: dict[str, Any] = {
        "proportional": m.si("proportional", f"{torsional}stiffness"),
        "derivative": m.si("derivative", f"{torsional}damping"),
        "integral": m.si("integral", f"{torsional}integral gain"),
    }
    if load.proportional is not None and not any(gains.values()):
        m.convert.note(f"{m.path}.proportional", "all gains are zero: it does nothing.", "Give one of them a value.")
    target = _target(m, joint.coordinate)
    return None if target is None else Servo(**m.common, joint=load.servo, target=target, **gains)


def _target(m: LoadMaker, coordinate_kind: str) -> Law | None:
    """The law that a servo follows, None where a fault was noted."""
    given, path = m.load.target, f"{m.path}.target"
    if given is None or isinstance(given, DriveDocument):
        return None if given is None else law_of(given, coordinate_kind, m.convert, path)
    value = m.convert.si(given, coordinate_kind, path)
    key = next((key for key in SIGNALS if getattr(m.load, key) is not None), None)
    if key is None:
        return ConstantSpeed(start=value, speed=0.0)
    signal = signal_of(key, getattr(m.load, key), m.convert, f"{m.path}.{key}")
    return None if signal is None else SignalPosition(value, signal)


def _check_servo(reading: Reading, path: str, name: str) -> Iterator[Fault]:
    joint = reading.document.joints.get(name)
    if joint is not None and joint.drive is not None:
        why = f"the drive of '{name}' decides its motion, whatever a servo does."
        yield Fault(path, why, "Let the joint be free, and make its drive the target of the servo.")


_DC = {"stall_torque": '"20 N m", its torque at rest', "no_load_speed": '"1500 rpm"'}
_INDUCTION = {
    "breakdown_torque": '"60 N m", the greatest one',
    "breakdown_slip": "0.2, the slip at the breakdown torque",
    "synchronous_speed": '"1500 rpm"',
}
_POWER = {"power": '"2 kW"', "torque_limit": '"50 N m"; its sign is the direction'}
_GOVERNOR = {
    "set_speed": '"300 rpm"',
    "gain": '"5 N m s/rad"',
    "limits": '["0 N m", "50 N m"], the least and the greatest torque',
}

MACHINES = {
    "dc_motor": LoadKind(
        words="a DC motor",
        example='{ dc_motor = "A", stall_torque = "20 N m", no_load_speed = "1500 rpm" }',
        make=_dc_motor,
        check=known_shaft,
        keys=tuple(_DC),
        needs=_DC,
    ),
    "induction_motor": LoadKind(
        words="an induction motor",
        example='{ induction_motor = "A", breakdown_torque = "60 N m", breakdown_slip = 0.2, synchronous_speed = "1500 rpm" }',
        make=_induction_motor,
        check=known_shaft,
        keys=tuple(_INDUCTION),
        needs=_INDUCTION,
    ),
    "constant_power": LoadKind(
        words="a machine of constant power",
        example='{ constant_power = "A", power = "2 kW", torque_limit = "50 N m" }',
        make=_constant_power,
        check=known_shaft,
        keys=tuple(_POWER),
        needs=_POWER,
    ),
    "servo": LoadKind(
        words="a servo",
        example='{ servo = "A", target = "30 deg", proportional = "200 N m/rad" }',
        make=_servo,
        check=_check_servo,
        keys=("target", "proportional", "derivative", "integral", *SIGNALS),
        needs={"target": '"30 deg", or the keys of a drive', "proportional": '"200 N m/rad" (or "5 N/mm" for a sliding joint)'},
    ),
    "governor": LoadKind(
        words="a speed governor",
        example='{ governor = "A", set_speed = "300 rpm", gain = "5 N m s/rad", limits = ["0 N m", "50 N m"] }',
        make=_governor,
        check=known_shaft,
        keys=tuple(_GOVERNOR),
        needs=_GOVERNOR,
    ),
}
"""The kinds of loads of machines."""
