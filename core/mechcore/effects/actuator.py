"""An actuator of constant force: between two points along their line, or along a sliding joint."""

from __future__ import annotations

from mechcore.effects.along_line import Line
from mechcore.effects.argument import factor_of
from mechcore.effects.base import Configuration, Wrench, joint_wrench
from mechcore.effects.prescribed import Varied
from mechcore.spec.loads import Actuator


class ConstantThrust(Varied, Line):
    """``force`` times the factor pushes the two points apart, or the joint's links in the direction of its coordinate."""

    kind = "actuator"

    def __init__(self, load: Actuator):
        Varied.__init__(self, load)
        Line.__init__(self, load)

    def wrenches(self, at: Configuration) -> list[Wrench]:
        thrust = self.load.force * factor_of(at, self.load.factor, self.name)
        if self.load.joint is not None:
            return [joint_wrench(at, self.load.joint, thrust, name=self.name, kind=self.kind, cause=self.cause)]
        return self.between(at, -thrust * self.direction(at, self.vector(at)))
