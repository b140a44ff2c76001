"""Resistance: of a medium, of oil in joints, dry friction; and the tension that belts need."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Plane, unit_vectors
from mechcore.effects.base import Configuration, Effect, LoadEffect, Wrench, joint_wrench, rate, relative_speed
from mechcore.spec.loads import BeltTension, Drag, Viscous

if TYPE_CHECKING:
    from mechcore.joints.base import Relation


class MediumDrag(LoadEffect[Drag]):
    """``-(linear + quadratic |v|) v`` at a point, or the same of the angular velocity as a free moment."""

    cause = "medium"
    needs = frozenset({"positions", "velocities"})

    @property
    def proportional(self) -> bool:
        return self.load.quadratic == 0.0

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load, model = self.load, at.model
        k = model.index[load.link]
        if load.point is None:
            w = at.speeds.angular[model.angles.rotation_class[k]]
            return [Wrench(self.name, "drag torque", k, 0j, -(load.linear + load.quadratic * np.abs(w)) * w, 0j, self.cause)]
        local = model.points[k][load.point]
        v = at.of_point(k, local, 1)
        force = -(load.linear + load.quadratic * np.abs(v)) * v
        return [Wrench(self.name, "drag", k, force, 0.0, local * at.rotation(k), self.cause)]


class ViscousFriction(LoadEffect[Viscous]):
    """The force or moment acts on the joint's second link, its opposite on the first.

    Revolute: a moment. Prismatic, pin in slot, cylinder: a force along the guide. Rolling, gear, rack: a couple against the
    relative rotation, as teeth and rims slide or roll over each other in proportion to it. Cam: a force along the common tangent
    where they touch, against the speed with which the profile passes the follower (a roller's rim turns with that speed on its
    pin). Belt, chain: its drag against the speed v with which it runs over its carrier, half of it at the rim of each pulley, as
    moments of ``coefficient v r / 2`` between pulley and carrier.
    """

    cause = "viscous"
    needs = frozenset({"positions", "velocities"})

    @property
    def proportional(self) -> bool:
        return True

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
        effort = -self.load.coefficient * relative_speed(at, first, second)
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
        out = []
        for link, radius in relation.angles[:2]:
            k = at.model.index[link]
            moment = -0.5 * self.load.coefficient * radius**2 * relative_speed(at, carrier, k)
            arm = at.origins[k] - at.origins[carrier]
            out.append(Wrench(f"{self.name}/{link}", "viscous torque", k, 0j, moment, 0j, self.cause, carrier, arm))
        return out


class DryFriction(Effect):
    """Stands for the friction of all joints where effects are listed; what it adds comes with the reactions, see `needs`."""

    cause = "dry friction"
    needs = frozenset({"positions", "velocities", "reactions"})


def spans(at: Configuration, relation: Relation) -> tuple[Plane, Plane, float]:
    """Place [m], force on the second pulley per newton in both spans, and by how much the spans' normals lean towards it.

    The two pulls are mirrored at the line of centres: their resultant lies on it. The lean is (r1 - r2) / distance of an open belt,
    (r1 + r2) / distance of a crossed one.
    """
    (one, up), (other, down) = (relation.contact(at, side) for side in (1.0, -1.0))  # type: ignore[arg-type]  # a configuration is all that it looks at
    pull = up - down
    lean = np.imag(np.conj(up) * pull) / np.abs(pull)
    return 0.5 * (one + other), pull, float(np.mean(lean))


class BeltPull(LoadEffect[BeltTension]):
    """A tensioner holds the slack span at a constant tension: both spans pull the pulleys together by it, whatever they carry.

    It does no work: it presses on the bearings, and is what the belt has to drive by friction
    (`mechcore.forces.load_events` tells where that is not enough).
    """

    cause = "elastic"
    needs = frozenset({"positions"})

    def wrenches(self, at: Configuration) -> list[Wrench]:
        relation = next(r for r in at.model.relations if r.name == self.load.joint)
        first, second = (at.model.index[k] for k in relation.links)
        place, pull, _ = spans(at, relation)
        force = self.load.slack * pull
        arms = place - at.origins[second], place - at.origins[first]
        return [Wrench(self.name, "belt tension", second, force, 0.0, arms[0], self.cause, first, arms[1])]
