"""Applied forces and torques: constant or by a factor, fixed in the world or turning with the link, on one link or two."""

from __future__ import annotations

from typing import Any

from mechcore.arrays import Index
from mechcore.effects.argument import bends, bends_in_time, breaks_of, counts_turns, factor_of, needs_of, phase_of
from mechcore.effects.base import Configuration, Effect, PointLoad, Wrench
from mechcore.kinematics.model import Model
from mechcore.spec.loads import Force, Torque


class Varied(Effect):
    """A load that a factor multiplies."""

    def __init__(self, load: Any):
        Effect.__init__(self, load.name)
        self.load = load
        self.needs = needs_of(load.factor)

    @property
    def piecewise(self) -> bool:
        return bends(self.load.factor) and not bends_in_time(self.load.factor)

    @property
    def breaks(self) -> tuple[float, ...]:
        return breaks_of(self.load.factor) or bends_in_time(self.load.factor)

    @property
    def counts_turns(self) -> bool:
        return counts_turns(self.load.factor)

    def phase(self, at: Configuration) -> Index:
        return phase_of(at, self.load.factor)


class AppliedForce(Varied):
    """A force at a named point of a link."""

    load: Force

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load, model = self.load, at.model
        k = model.index[load.link]
        local = model.points[k][load.point]
        vector = complex(*load.vector) * factor_of(at, load.factor, load.name)
        if load.axes == "link":
            vector = vector * at.rotation(k)
        arm = at.offset(k, local)
        if load.against is None:
            return [Wrench(load.name, "force", k, vector, 0.0, arm)]
        other = model.index[load.against]
        return [Wrench(load.name, "force", k, vector, 0.0, arm, other=other, other_arm=at.of_point(k, local) - at.origins[other])]

    def point_loads(self, model: Model) -> list[PointLoad] | None:
        load = self.load
        if load.factor is not None or load.axes == "link" or load.against is not None:
            return None
        k = model.index[load.link]
        return [PointLoad(load.name, "force", k, model.points[k][load.point], force=complex(*load.vector))]


class AppliedTorque(Varied):
    """A free moment on a link."""

    load: Torque

    def wrenches(self, at: Configuration) -> list[Wrench]:
        load = self.load
        moment = load.moment * factor_of(at, load.factor, load.name)
        other = None if load.against is None else at.model.index[load.against]
        return [Wrench(load.name, "torque", at.model.index[load.link], 0j, moment, 0j, other=other)]
