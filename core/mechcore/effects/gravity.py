"""Gravity: the weight of every moving link that has a mass, at its centre of mass."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Real
from mechcore.effects.base import Configuration, Effect, PointLoad
from mechcore.kinematics.model import Model


def weights(model: Model) -> tuple[tuple[int, complex, complex], ...]:
    """(link, weight [N], centre of mass in link axes [m]) of every moving link that has a weight."""
    found = []
    for k, (mass, centre, _) in enumerate(model.masses):
        own = model.bodies[model.links[k]].gravity
        if k and mass:
            found.append((k, mass * complex(*(model.mechanism.gravity if own is None else own)), centre))
    return tuple(found)


class Gravity(Effect):
    """Uniform, in the mechanism's direction, or in a link's own where it states one. Zero potential at the world's origin."""

    cause = "gravity"

    def point_loads(self, model: Model) -> list[PointLoad]:
        return [
            PointLoad(f"gravity/{model.links[k]}", "gravity", k, centre, force=weight) for k, weight, centre in model.once(weights)
        ]

    def potential(self, at: Configuration) -> Real | float:
        return sum((-np.real(np.conj(w) * at.of_point(k, centre)) for k, w, centre in at.model.once(weights)), 0.0)
