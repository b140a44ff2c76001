"""Bushings: springs and dampers in x, y and angle between two links that no joint needs to hold together."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.effects.base import Configuration, Effect, Wrench
from mechcore.effects.torsion import AngleDamper, AngleSpring
from mechcore.spec.loads import Bushing, BushingDamper, TorsionDamper, TorsionSpring


class _Bushed(Effect):
    """What acts on the first link acts at the second link's point, and the opposite on the second link there."""

    kind = ""

    def __init__(self, load: Bushing | BushingDamper):
        super().__init__(load.name)
        self.ends = tuple(zip(load.links, load.points, strict=True))

    def apart(self, at: Configuration, derivative: int = 0) -> Complex:
        """From the first point to the second in the first link's axes, or its rate there."""
        (k, first), (m, second) = ((at.model.index[link], at.model.points[at.model.index[link]][p]) for link, p in self.ends)
        away = at.of_point(m, second, derivative) - at.of_point(k, first, derivative)
        if derivative:
            omega = at.speeds.angular[at.model.angles.rotation_class[k]]
            away = away - 1j * omega * (at.of_point(m, second) - at.of_point(k, first))
        return away * np.conj(at.rotation(k))

    def between(self, at: Configuration, x: Real, y: Real, moment: Real) -> list[Wrench]:
        """Force (x, y) in the first link's axes, and moment, on the first link; the opposite on the second."""
        (k, _), (m, point) = ((at.model.index[link], point) for link, point in self.ends)
        arm = at.offset(m, at.model.points[m][point])
        here = at.of_point(m, at.model.points[m][point]) - at.origins[k]
        return [Wrench(self.name, self.kind, k, (x + 1j * y) * at.rotation(k), moment, here, self.cause, m, arm)]


class BushingSprings(_Bushed):
    """Force and moment by the distance of the points and the angle; its energy is zero where it is free of load."""

    cause, kind = "elastic", "bushing"

    def __init__(self, load: Bushing):
        super().__init__(load)
        self.stiffness = load.stiffness
        self.torsion = AngleSpring(
            TorsionSpring(name=load.name, links=load.links, stiffness=load.stiffness[2], free_angle=load.free_angle)
        )

    @property
    def counts_turns(self) -> bool:
        return self.torsion.counts_turns

    def wrenches(self, at: Configuration) -> list[Wrench]:
        d = self.apart(at)
        return self.between(at, self.stiffness[0] * d.real, self.stiffness[1] * d.imag, self.torsion.wrenches(at)[0].moment)

    def potential(self, at: Configuration) -> Real:
        d = self.apart(at)
        return 0.5 * (self.stiffness[0] * d.real**2 + self.stiffness[1] * d.imag**2) + self.torsion.potential(at)


class BushingDampers(_Bushed):
    """Force and moment by the rates of these, as they are seen from the first link."""

    cause, kind = "viscous", "bushing damper"
    needs = frozenset({"positions", "velocities"})

    def __init__(self, load: BushingDamper):
        super().__init__(load)
        self.damping = load.damping
        self.torsion = AngleDamper(TorsionDamper(name=load.name, links=load.links, coefficient=load.damping[2]))

    def wrenches(self, at: Configuration) -> list[Wrench]:
        v = self.apart(at, 1)
        return self.between(at, self.damping[0] * v.real, self.damping[1] * v.imag, self.torsion.wrenches(at)[0].moment)
