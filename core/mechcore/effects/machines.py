"""Machines: motors by their characteristic, machines of constant power, governors, position servos, and the pressure of a gas on a
piston."""

from __future__ import annotations

from functools import partial
from typing import Any, TypeVar, cast

import numpy as np

from mechcore.arrays import Flags, Index, Real, Values
from mechcore.compiled.symbols import Symbol
from mechcore.effects.base import Configuration, LoadEffect, Wrench, coordinate, joint_wrench, rate
from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import Law
from mechcore.spec.loads import ConstantPower, DcMotor, GasPressure, Governor, InductionMotor, Machine, Servo
from mechcore.texts import as_length

Driving = TypeVar("Driving", bound=Machine)


class _ByCharacteristic(LoadEffect[Driving]):
    """Subclasses give the torque [N m] at an angular velocity [rad/s]."""

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
    """A hyperbola, cut off at the torque limit at low speeds and in reverse rotation."""

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
    """Proportional to the speed error, set speed less speed, within its limits."""

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
        """Target of the coordinate, or its rate."""
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


STROKE_ROUNDING = 1e-6  # part of the stroke by which rounding may carry the piston past its dead centres


class CylinderGas(LoadEffect[GasPressure]):
    """Gas force on the piston, and the opposite on the cylinder's head. The sense of motion selects the branch of the diagram."""

    needs = frozenset({"positions", "velocities"})

    limited = True

    def _from_top(self, at: Configuration) -> Values:
        """Distance of the piston from top dead centre [m]."""
        away = self.load.top - coordinate(at, self.load.joint)
        return away if self.load.head == "ahead" else -away

    def displacement(self, at: Configuration) -> Real:
        """Distance of the piston from top dead centre [m], within the stroke."""
        within: Real = np.clip(self._from_top(at), 0.0, self.load.cycle.stroke)
        return within

    def check(self, at: Configuration) -> None:
        load, x = self.load, self._from_top(at)
        low, high = float(np.nanmin(x)), float(np.nanmax(x))
        stroke = load.cycle.stroke
        if low < -STROKE_ROUNDING * stroke or high > (1.0 + STROKE_ROUNDING) * stroke:
            sign = -1.0 if load.head == "ahead" else 1.0
            why = (
                f"the piston leaves its stroke: the coordinate of {load.joint} runs from {as_length(load.top + sign * low)} to "
                f"{as_length(load.top + sign * high)}; stated are top = {as_length(load.top)}, stroke = {as_length(stroke)}, "
                f"head {load.head}."
            )
            raise MechanismError(Fault(f"loads.{self.name}", why, "Give the dead centres of this mechanism as top and stroke."))

    def _strokes(self, at: Configuration) -> tuple[Real, Flags, Flags]:
        """Displacement [m], whether the piston moves away from the head, whether the gas fires in this turn."""
        load = self.load
        x = self.displacement(at)
        speed = rate(at, load.joint)
        outward: Flags = np.less_equal(speed, 0.0) if load.head == "ahead" else np.greater_equal(speed, 0.0)
        firing = np.ones(np.shape(outward), bool)
        if load.cycle.strokes == 4:
            # the piston determines where a stroke ends, the crank only which turn it is: from a quarter of a turn before the top
            # dead centre in strokes away from it, and up to a quarter of a turn after it in strokes towards it
            joint = load.drive if load.drive is not None else at.model.mechanism.drives[0].joint
            turned = (coordinate(at, joint) - load.fires) * np.where(rate(at, joint) < 0.0, -1.0, 1.0)
            firing = np.mod(turned + np.where(outward, 0.5 * np.pi, 1.5 * np.pi), 4.0 * np.pi) < 2.0 * np.pi
        return x, outward, firing

    def pressure(self, at: Configuration) -> Real:
        """Absolute pressure in the cylinder [Pa]."""
        return self.load.cycle.pressure(*self._strokes(at))

    @property
    def piecewise(self) -> bool:
        return True

    def phase(self, at: Configuration) -> Index:
        x, outward, firing = self._strokes(at)
        part = getattr(self.load.cycle, "part", None)
        return 2 * outward + firing + (0 if part is None else 4 * part(x, outward, firing))

    def switch(self, at: Configuration) -> Values | None:
        return rate(at, self.load.joint)  # branches of the diagram meet at dead centres; valves open without a jump

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load, model = self.load, at.model
        j = model.joint_index[load.joint]
        guide = model.joints[j].guide
        piston, cylinder = model.ends[j][1 - guide], model.ends[j][guide]
        push = (self.pressure(at) - load.back) * load.area
        along = at.guide(j) * (-1.0 if load.head == "ahead" else 1.0)
        place = at.joint_point(j)
        arm, other_arm = place - at.origins[piston], place - at.origins[cylinder]
        return [Wrench(self.name, "gas", piston, push * along, 0.0, arm, self.cause, cylinder, other_arm)]
