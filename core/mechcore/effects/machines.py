"""Machines: motors by their characteristic, machines of constant power, governors, and position servos."""

from __future__ import annotations

from functools import partial
from typing import Any, TypeVar, cast

import numpy as np

from mechcore.arrays import Index, Real, Values
from mechcore.compiled.symbols import Symbol
from mechcore.effects.base import Configuration, LoadEffect, Wrench, coordinate, joint_wrench, rate
from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import Law
from mechcore.spec.loads import ConstantPower, DcMotor, Governor, InductionMotor, Machine, Servo

Driving = TypeVar("Driving", bound=Machine)


class _ByCharacteristic(LoadEffect[Driving]):
    """Subclasses say the torque [N m] at an angular velocity [rad/s]."""

    kind = "motor"
    needs = frozenset({"positions", "velocities"})

    def torque(self, speed: Values) -> Values:
        raise TypeError(f"{type(self).__name__} has no characteristic")

    def speed(self, at: Configuration) -> Values:
        """Angular velocity of the link, or rate of the joint [rad/s]."""
        if self.load.joint is not None:
            return rate(at, self.load.joint)
        assert self.load.link is not None
        return at.speeds.angular[at.model.angles.rotation_class[at.model.index[self.load.link]]]

    def wrenches(self, at: Configuration) -> list[Wrench]:
        effort = self.torque(self.speed(at))
        if self.load.joint is not None:
            return [joint_wrench(at, self.load.joint, effort, name=self.name, kind=self.kind, cause=self.cause)]
        assert self.load.link is not None
        return [Wrench(self.name, self.kind, at.model.index[self.load.link], 0j, effort, 0j, self.cause)]


class DirectCurrent(_ByCharacteristic[DcMotor]):
    """A straight line from the stall torque to the no-load speed; beyond, it brakes."""

    def torque(self, speed: Values) -> Values:
        return self.load.stall_torque * (1.0 - speed / self.load.no_load_speed)


class Induction(_ByCharacteristic[InductionMotor]):
    """Slip curve of Kloss (stator resistance neglected); beyond the synchronous speed it brakes as a generator."""

    def torque(self, speed: Values) -> Values:
        load = self.load
        slip, most = 1.0 - speed / load.synchronous_speed, load.breakdown_slip
        size = np.sign(load.synchronous_speed) * load.breakdown_torque
        torque: Values = size * 2.0 * slip * most / (slip * slip + most * most)
        return torque


class ConstantPowerMachine(_ByCharacteristic[ConstantPower]):
    """A hyperbola, cut off at the torque limit: at low speeds, and while it still turns the other way."""

    def torque(self, speed: Values) -> Values:
        load = self.load
        forward = np.maximum(speed * np.sign(load.torque_limit), load.power / abs(load.torque_limit))
        torque: Values = np.sign(load.torque_limit) * load.power / forward
        return torque

    @property
    def piecewise(self) -> bool:
        return True

    def phase(self, at: Configuration) -> Index:
        load = self.load
        phase: Index = 1 * np.greater(self.speed(at) * np.sign(load.torque_limit), load.power / abs(load.torque_limit))
        return phase


class Governed(_ByCharacteristic[Governor]):
    """Proportional to what is missing of the set speed, within its limits."""

    def torque(self, speed: Values) -> Values:
        load = self.load
        return np.minimum(np.maximum(load.gain * (load.set_speed - speed), load.least), load.most)

    @property
    def piecewise(self) -> bool:
        return True

    def phase(self, at: Configuration) -> Index:
        load = self.load
        wanted = load.gain * (load.set_speed - self.speed(at))
        return 1 * np.greater(wanted, load.least) + np.greater(wanted, load.most)


class PositionServo(LoadEffect[Servo]):
    """Effort by the error of the coordinate, its rate, and its integral since the start, which is a state of the motion."""

    def __init__(self, load: Servo):
        super().__init__(load)
        self.needs = frozenset({"positions", "time", *(["velocities"] if load.derivative else [])})
        self._targets = [partial(_component, load.target, k) for k in range(2)]

    def _target(self, at: Configuration, derivative: int) -> Real:
        """Where the coordinate should be, or its rate."""
        time: Any = at.time
        wanted = self._targets[derivative]
        values: Any = time.code.value_of(wanted) if isinstance(time, Symbol) else wanted(time)
        return cast(Real, values)

    @property
    def laws(self) -> tuple[Law, ...]:
        return (self.load.target,)

    @property
    def counts_turns(self) -> bool:
        return True

    @property
    def integrates(self) -> bool:
        return self.load.integral != 0.0

    def state_rate(self, at: Configuration) -> Real:
        return self._target(at, 0) - coordinate(at, self.load.joint)

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load = self.load
        effort = load.proportional * self.state_rate(at)
        if load.derivative:
            effort = effort + load.derivative * (self._target(at, 1) - rate(at, load.joint))
        if self.integrates:
            if self.name not in at.states:
                why = "the integral of its error is known in motions under forces only."
                raise MechanismError(Fault(f"loads.{self.name}", why, "Let its joint be free, or leave the integral out."))
            effort = effort + load.integral * at.states[self.name]
        return [joint_wrench(at, load.joint, effort, name=self.name, kind="servo", cause=self.cause)]


def _component(law: Law, derivative: int, time: Real) -> Real:
    """Position or rate of a law at times."""
    return law(time)[derivative]
