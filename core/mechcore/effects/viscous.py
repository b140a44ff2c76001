"""Viscous friction in a pair: against the rate of its coordinate, between its two links."""

from __future__ import annotations

from ..loads import Viscous
from .argument import rate
from .base import Configuration, Effect
from .pair_effort import pair_wrench
from .wrench import Wrench

__all__ = ["ViscousFriction"]


class ViscousFriction(Effect):
    """A moment in a revolute pair, a force along the guide in a sliding one; what is stated acts on the pair's second link."""

    cause = "viscous"
    needs = frozenset({"positions", "velocities"})

    def __init__(self, load: Viscous):
        super().__init__(load.name)
        self.load = load

    def wrenches(self, at: Configuration) -> list[Wrench]:
        turns = at.model.joints[at.model.joint_index[self.load.pair]].coordinate == "angle"
        effort = -self.load.coefficient * rate(at, self.load.pair)
        kind = "viscous torque" if turns else "viscous"
        return [pair_wrench(at, self.load.pair, effort, name=self.name, kind=kind, cause=self.cause)]
