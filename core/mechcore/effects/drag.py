"""Resistance of a medium at rest against the velocity of a point, or against the rotation of a link."""

from __future__ import annotations

import numpy as np

from mechcore.effects.base import Configuration, Effect, Wrench
from mechcore.spec.loads import Drag


class MediumDrag(Effect):
    """``-(linear + quadratic |v|) v`` at a point, or the same of the angular velocity as a free moment."""

    cause = "medium"
    needs = frozenset({"positions", "velocities"})

    def __init__(self, load: Drag):
        super().__init__(load.name)
        self.load = load

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
