"""Viscous friction in a pair: against the rate of its coordinate, between its two links."""

from __future__ import annotations

from ..loads import Viscous
from .argument import rate
from .base import Configuration, Effect
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
        model = at.model
        j = model.joint_index[self.load.pair]
        joint, (first, second) = model.joints[j], model.ends[j]
        effort = -self.load.coefficient * rate(at, self.load.pair)
        place = at.joint_point(j)
        arm, other_arm = place - at.origins[second], place - at.origins[first]
        if joint.coordinate == "angle":
            return [Wrench(self.name, "viscous torque", second, 0j, effort, arm, self.cause, first, other_arm)]
        along = at.guide(j) * (1.0 if joint.guide == 0 else -1.0)  # the coordinate grows where the link without the guide goes
        return [Wrench(self.name, "viscous", second, effort * along, 0.0, arm, self.cause, first, other_arm)]
