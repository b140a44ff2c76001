"""Position servos on joints: proportional, derivative and integral control of a coordinate in a motion under forces."""

from __future__ import annotations

from mechcore.arrays import Real
from mechcore.effects.argument import coordinate, rate
from mechcore.effects.base import Configuration, Effect, Wrench, joint_wrench
from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import Law
from mechcore.spec.loads import Servo


class PositionServo(Effect):
    """Effort by the error of the coordinate, its rate, and its integral since the start, which is a state of the motion."""

    def __init__(self, load: Servo):
        super().__init__(load.name)
        self.load = load
        self.needs = frozenset({"positions", "time", *(["velocities"] if load.derivative else [])})

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
        return self.load.target(at.time)[0] - coordinate(at, self.load.joint)

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load = self.load
        effort = load.proportional * self.state_rate(at)
        if load.derivative:
            effort = effort + load.derivative * (load.target(at.time)[1] - rate(at, load.joint))
        if self.integrates:
            if self.name not in at.states:
                why = "the integral of its error is known in motions under forces only."
                raise MechanismError(Fault(f"loads.{self.name}", why, "Let its joint be free, or leave the integral out."))
            effort = effort + load.integral * at.states[self.name]
        return [joint_wrench(at, load.joint, effort, name=self.name, kind="servo", cause=self.cause)]
