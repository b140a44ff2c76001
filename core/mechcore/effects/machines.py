"""Machines that drive by a characteristic: torque as a function of speed, on a link or between the links of a revolute joint."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Index, Real
from mechcore.effects.argument import rate
from mechcore.effects.base import Configuration, Effect, Wrench, joint_wrench
from mechcore.spec.loads import ConstantPower, DcMotor, Governor, InductionMotor, Machine


class _ByCharacteristic(Effect):
    """Subclasses say the torque [N m] at an angular velocity [rad/s]."""

    kind = "motor"
    needs = frozenset({"positions", "velocities"})

    def __init__(self, load: Machine):
        super().__init__(load.name)
        self.on = load

    def torque(self, speed: Real) -> Real:
        raise TypeError(f"{type(self).__name__} has no characteristic")

    def speed(self, at: Configuration) -> Real:
        """Angular velocity of the link, or rate of the joint [rad/s]."""
        if self.on.joint is not None:
            return np.asarray(rate(at, self.on.joint))
        assert self.on.link is not None
        return np.asarray(at.speeds.angular[at.model.angles.rotation_class[at.model.index[self.on.link]]])

    def wrenches(self, at: Configuration) -> list[Wrench]:
        effort = self.torque(self.speed(at))
        if self.on.joint is not None:
            return [joint_wrench(at, self.on.joint, effort, name=self.name, kind=self.kind, cause=self.cause)]
        assert self.on.link is not None
        return [Wrench(self.name, self.kind, at.model.index[self.on.link], 0j, effort, 0j, self.cause)]


class DirectCurrent(_ByCharacteristic):
    """A straight line from the stall torque to the no-load speed; beyond, it brakes."""

    def __init__(self, load: DcMotor):
        super().__init__(load)
        self.load = load

    def torque(self, speed: Real) -> Real:
        return self.load.stall_torque * (1.0 - speed / self.load.no_load_speed)


class Induction(_ByCharacteristic):
    """Slip curve of Kloss (stator resistance neglected); beyond the synchronous speed it brakes as a generator."""

    def __init__(self, load: InductionMotor):
        super().__init__(load)
        self.load = load

    def torque(self, speed: Real) -> Real:
        load = self.load
        slip, most = 1.0 - speed / load.synchronous_speed, load.breakdown_slip
        size = np.sign(load.synchronous_speed) * load.breakdown_torque
        return size * 2.0 * slip * most / (slip * slip + most * most)


class ConstantPowerMachine(_ByCharacteristic):
    """A hyperbola, cut off at the torque limit: at low speeds, and while it still turns the other way."""

    def __init__(self, load: ConstantPower):
        super().__init__(load)
        self.load = load

    def torque(self, speed: Real) -> Real:
        load = self.load
        forward = np.maximum(speed * np.sign(load.torque_limit), load.power / abs(load.torque_limit))
        return np.sign(load.torque_limit) * load.power / forward

    @property
    def piecewise(self) -> bool:
        return True

    def phase(self, at: Configuration) -> Index:
        load = self.load
        return (self.speed(at) * np.sign(load.torque_limit) > load.power / abs(load.torque_limit)).astype(int)


class Governed(_ByCharacteristic):
    """Proportional to what is missing of the set speed, within its limits."""

    def __init__(self, load: Governor):
        super().__init__(load)
        self.load = load

    def torque(self, speed: Real) -> Real:
        load = self.load
        return np.clip(load.gain * (load.set_speed - speed), load.least, load.most)

    @property
    def piecewise(self) -> bool:
        return True

    def phase(self, at: Configuration) -> Index:
        load = self.load
        wanted = load.gain * (load.set_speed - self.speed(at))
        return (wanted > load.least).astype(int) + (wanted > load.most)
