"""Viscous friction in a joint: against the relative motion of its two links, in proportion to its speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import unit_vectors
from mechcore.effects.argument import rate
from mechcore.effects.base import Configuration, Effect, Wrench, joint_wrench
from mechcore.spec.loads import Viscous

if TYPE_CHECKING:
    from mechcore.joints.base import Relation


class ViscousFriction(Effect):
    """What is stated acts on the joint's second link, its opposite on the first.

    Revolute: a moment. Prismatic, pin in slot, cylinder: a force along the guide. Rolling, gear, rack: a couple against the
    relative rotation, as teeth and rims slide or roll over each other in proportion to it. Cam: a force along the common tangent
    where they touch, against the speed with which the profile passes the follower (a roller's rim turns with that speed on its
    pin). Belt, chain: its drag against the speed v with which it runs over its carrier, half of it at the rim of each pulley, as
    moments of ``coefficient v r / 2`` between pulley and carrier.
    """

    cause = "viscous"
    needs = frozenset({"positions", "velocities"})

    def __init__(self, load: Viscous):
        super().__init__(load.name)
        self.load = load

    def wrenches(self, at: Configuration) -> list[Wrench]:
        model, joint = at.model, self.load.joint
        relation = next((r for r in model.relations if r.name == joint), None)
        if relation is None:
            turns = model.joints[model.joint_index[joint]].coordinate == "angle"
            kind = "viscous torque" if turns else "viscous"
            effort = -self.load.coefficient * rate(at, joint)
            return [joint_wrench(at, joint, effort, name=self.name, kind=kind, cause=self.cause)]
        if relation.kind == "belt":
            return self._belt(at, relation)
        return [self._cam(at, relation) if relation.kind == "cam" else self._wheels(at, relation)]

    def _wheels(self, at: Configuration, relation: Relation) -> Wrench:
        first, second = (at.model.index[k] for k in relation.links)
        rotation_class = at.model.angles.rotation_class
        effort = -self.load.coefficient * (at.speeds.angular[rotation_class[second]] - at.speeds.angular[rotation_class[first]])
        place = relation.contact(at, 1.0)[0]  # type: ignore[arg-type]  # a configuration is all that it looks at
        arms = place - at.origins[second], place - at.origins[first]
        return Wrench(self.name, "viscous torque", second, 0j, effort, arms[0], self.cause, first, arms[1])

    def _cam(self, at: Configuration, relation: Relation) -> Wrench:
        first, second = (at.model.index[k] for k in relation.links)
        place, normal = relation.contact(at, 1.0)  # type: ignore[arg-type]  # a configuration is all that it looks at
        tangent = 1j * unit_vectors(normal)
        arms = [place - at.origins[k] for k in (first, second)]
        speeds = [
            at.origin_velocities[k] + 1j * at.speeds.angular[at.model.angles.rotation_class[k]] * arm
            for k, arm in zip((first, second), arms, strict=True)
        ]
        slip = np.real(np.conj(tangent) * (speeds[1] - speeds[0]))
        force = -self.load.coefficient * slip * tangent
        return Wrench(self.name, "viscous", second, force, 0.0, arms[1], self.cause, first, arms[0])

    def _belt(self, at: Configuration, relation: Relation) -> list[Wrench]:
        carrier = at.model.index[relation.angles[2][0]]
        rotation_class = at.model.angles.rotation_class
        found = []
        for link, radius in relation.angles[:2]:
            k = at.model.index[link]
            turning = at.speeds.angular[rotation_class[k]] - at.speeds.angular[rotation_class[carrier]]
            moment = -0.5 * self.load.coefficient * radius**2 * turning
            arm = at.origins[k] - at.origins[carrier]
            found.append(Wrench(f"{self.name}/{link}", "viscous torque", k, 0j, moment, 0j, self.cause, carrier, arm))
        return found
