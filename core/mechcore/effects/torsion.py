"""Moments by the angle between two links: torsion springs and torsion dampers."""

from __future__ import annotations

from mechcore.arrays import Real
from mechcore.effects.base import Configuration, Effect, Wrench
from mechcore.spec.loads import TorsionDamper, TorsionSpring


class AngleSpring(Effect):
    """Moment ``stiffness (angle - free_angle)`` on the first link; its energy is zero at the free angle."""

    cause = "elastic"

    def __init__(self, load: TorsionSpring):
        super().__init__(load.name)
        self.load = load

    def _turned(self, at: Configuration) -> Real:
        first, second = (at.model.index[k] for k in self.load.links)
        free = self.load.free_angle
        return at.angles.relative(first, second, (free, free)) - free

    @property
    def counts_turns(self) -> bool:
        return True

    def wrenches(self, at: Configuration) -> list[Wrench]:
        first, second = (at.model.index[k] for k in self.load.links)
        moment = self.load.stiffness * self._turned(at)
        return [Wrench(self.name, "torsion spring", first, 0j, moment, 0j, self.cause, second)]

    def potential(self, at: Configuration) -> Real:
        return 0.5 * self.load.stiffness * self._turned(at) ** 2


class AngleDamper(Effect):
    """Moment ``coefficient`` times the relative angular velocity on the first link."""

    cause = "viscous"
    needs = frozenset({"positions", "velocities"})

    def __init__(self, load: TorsionDamper):
        super().__init__(load.name)
        self.load = load

    def wrenches(self, at: Configuration) -> list[Wrench]:
        first, second = (at.model.index[k] for k in self.load.links)
        rotation_class = at.model.angles.rotation_class
        moment = self.load.coefficient * (at.speeds.angular[rotation_class[second]] - at.speeds.angular[rotation_class[first]])
        return [Wrench(self.name, "torsion damper", first, 0j, moment, 0j, self.cause, second)]
