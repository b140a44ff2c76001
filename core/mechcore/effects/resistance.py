"""Resistance: of a medium, of oil in joints, of journals in their bearings, dry friction; and the tension that belts need.

Where a journal with clearance touches its bearing, the normal force is that of Hunt and Crossley (Coefficient of restitution
interpreted as damping in vibroimpact, 1975), F = k d^n (1 + a d'), d the indentation; it needs no history of the impact, never
pulls, and starts and ends at zero. The effects act on the massless journal of a `mechcore.spec.clearance` joint, so that the
revolute joint that holds it transmits the whole force.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from mechcore.arrays import Complex, Index, Plane, Real, unit_vectors
from mechcore.effects.base import Configuration, Effect, LoadEffect, Wrench, couple_between, joint_wrench, rate, relative_speed
from mechcore.numerics.tape import value_of
from mechcore.spec.loads import BeltTension, Drag, JournalContact, JournalLoss, Viscous

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
        place = relation.contact(at, 1.0)[0]  # type: ignore[arg-type]  # a configuration is all that it needs
        arms = place - at.origins[second], place - at.origins[first]
        return Wrench(self.name, "viscous torque", second, 0j, effort, arms[0], self.cause, first, arms[1])

    def _cam(self, at: Configuration, relation: Relation) -> Wrench:
        first, second = (at.model.index[k] for k in relation.links)
        place, normal = relation.contact(at, 1.0)  # type: ignore[arg-type]  # a configuration is all that it needs
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
            name = f"{self.name}/{link}"
            out.append(couple_between(at, k, carrier, moment, name=name, kind="viscous torque", cause=self.cause))
        return out


class DryFriction(Effect):
    """Represents the friction of all joints in the list of effects; its wrenches follow with the reactions, see `needs`."""

    cause = "dry friction"
    needs = frozenset({"positions", "velocities", "reactions"})


def spans(at: Configuration, relation: Relation) -> tuple[Plane, Plane, float]:
    """Point of action [m], force on the second pulley per newton in both spans, and sine of the inclination of the spans to the
    line of centres.

    The two pulls are mirror images at the line of centres: their resultant lies on it. The sine is (r1 - r2) / distance for an open
    belt, (r1 + r2) / distance for a crossed one.
    """
    (one, up), (other, down) = (relation.contact(at, side) for side in (1.0, -1.0))  # type: ignore[arg-type]  # a configuration is all that it needs
    pull = up - down
    lean = np.imag(np.conj(up) * pull) / np.abs(pull)
    return 0.5 * (one + other), pull, float(np.mean(value_of(lean)))


class BeltPull(LoadEffect[BeltTension]):
    """A tensioner holds the slack span at a constant tension: both spans pull the pulleys together by it, independent of the load.

    It does no work: it loads the bearings, and provides the grip by which the belt drives by friction
    (`mechcore.forces.load_events` reports where that is not sufficient).
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


AnyContact = TypeVar("AnyContact", bound=JournalContact)

PRESSING, LOSING, RUBBING = "contact", "contact loss", "contact friction"
IN_PAIRS = (PRESSING, LOSING, RUBBING)
"""Kinds of these wrenches: their sum is the reaction of their joint."""


def rubbing_name(joint: str) -> str:
    """Name of the moment of friction in the bearing of a joint with clearance."""
    return f"{joint} friction"


def loss_factor(restitution: float, speed: float) -> float:
    """The factor a [s/m] of F = k d^n (1 + a d') for which an impact at ``speed`` [m/s] rebounds with ``restitution`` (0 to 1) of
    it, independent of the masses, k and n.

    From m v dv = -F dd in approach and rebound: x (1 + e) = ln((1 + x) / (1 - e x)) with x = a v.
    """
    from scipy.optimize import brentq

    if restitution >= 1.0:
        return 0.0
    e = restitution

    def left(x: float) -> float:
        return x * (1.0 + e) - math.log1p(x) + math.log1p(-e * x)

    low, high = 0.5 * (1.0 - e), (1.0 - 1e-15) / e  # the root lies above (1 - e), close to it for small losses
    while left(low) < 0.0:
        low *= 0.5
    return float(brentq(left, low, high, xtol=1e-15, rtol=1e-14)) / speed


class _Journal(LoadEffect[AnyContact]):
    """Position of the journal in its bearing; results have a leading frame axis."""

    def eccentricity(self, at: Configuration, derivative: int = 0) -> Complex:
        """Vector from the bearing's centre to the journal's, or its rate, in the axes of the bearing's link (complex)."""
        x, y = (at.drives[at.model.driven[at.model.joint_index[joint]]][derivative] for joint in self.load.slides)
        return x + 1j * y

    def indentation(self, at: Configuration) -> tuple[Real, Complex, Real]:
        """Indentation [m] (negative: no contact), unit normal from bearing to journal, and k d^n [N]."""
        e = self.eccentricity(at)
        load, centred = self.load, value_of(e) == 0.0  # there, and without contact, distances and powers have no slope
        off = np.where(centred, 1.0, e)
        away = np.where(centred, 0.0, np.abs(off))
        depth = away - load.radial
        touches = value_of(depth) > 0.0
        pressed = np.where(touches, depth, load.radial)
        force = load.stiffness * pressed * (pressed / load.radial) ** (load.exponent - 1.0)
        return depth, e / np.abs(off), np.where(touches, force, 0.0)

    def between(self, at: Configuration, force: Complex, name: str, kind: str, moment: Real | float = 0.0) -> list[Wrench]:
        """``force`` (axes of the bearing's link) at the journal's centre on the journal, the opposite on the bearing; ``moment`` on
        the shaft, the opposite on the bearing."""
        model, load = at.model, self.load
        bearing, journal, shaft = (model.index[k] for k in load.links)
        place = at.origins[journal]
        turned = force * at.rotation(bearing)
        wrenches = [Wrench(name, kind, journal, turned, 0.0, 0j, self.cause, bearing, place - at.origins[bearing])]
        if moment is not None and np.any(moment):
            arms = place - at.origins[shaft], place - at.origins[bearing]
            wrenches.append(Wrench(rubbing_name(load.joint), RUBBING, shaft, 0j, moment, arms[0], self.cause, bearing, arms[1]))
        return wrenches

    @property
    def piecewise(self) -> bool:
        return True

    def phase(self, at: Configuration) -> Index:
        """1 where journal and bearing touch."""
        return 1 * (self.indentation(at)[0] > 0.0)


class JournalPressure(_Journal[JournalContact]):
    """The elastic part of the contact, k d^n; its energy is zero where they do not touch."""

    cause = "elastic"

    def wrenches(self, at: Configuration) -> list[Wrench]:
        _, normal, force = self.indentation(at)
        return self.between(at, -force * normal, self.name, PRESSING)

    def potential(self, at: Configuration) -> Real:
        depth, _, force = self.indentation(at)
        return force * np.maximum(depth, 0.0) / (self.load.exponent + 1.0)


class JournalFriction(_Journal[JournalLoss]):
    """Losses in the contact: the part a d' of the normal force, and friction of the coefficient mu between the surfaces,
    smooth at rest: mu N v / sqrt(v^2 + slow^2)."""

    cause = "viscous"
    needs = frozenset({"positions", "velocities"})

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load = self.load
        _, normal, force = self.indentation(at)
        rate = self.eccentricity(at, 1)
        inward = np.real(np.conj(normal) * rate)
        lost = force * np.maximum(load.loss * inward, -1.0)  # surfaces do not pull
        on_journal = -lost * normal
        moment: Real | float = 0.0
        if load.friction:
            bearing, _, shaft = (at.model.index[k] for k in load.links)
            slip = np.real(np.conj(1j * normal) * rate) + load.radius * relative_speed(at, bearing, shaft)
            rub = load.friction * (force + lost) * slip / np.sqrt(slip * slip + load.slow**2)
            on_journal = on_journal - rub * 1j * normal
            moment = -load.radius * rub
        return self.between(at, on_journal, self.name, LOSING, moment)

    def phase(self, at: Configuration) -> Index:
        """1 where they touch, 2 where they separate so fast that the force is zero."""
        depth, normal, _ = self.indentation(at)
        parting = self.load.loss * np.real(np.conj(normal) * self.eccentricity(at, 1)) < -1.0
        return np.where(depth > 0.0, 1 + parting, 0)
