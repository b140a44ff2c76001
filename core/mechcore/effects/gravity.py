"""Gravity: the weight of every moving link that has a mass, at its centre of mass."""

from __future__ import annotations

from typing import Any

import numpy as np

from mechcore.effects.base import Configuration, Effect, Wrench
from mechcore.kinematics.model import Model
from mechcore.kinematics.statics import Acting

Array = Any


class Gravity(Effect):
    """Uniform, in the mechanism's direction, or in a link's own where it states one. Zero potential at the world's origin."""

    cause = "gravity"

    def wrenches(self, at: Configuration) -> list[Wrench]:
        return [
            Wrench(
                name=f"gravity/{at.model.links[k]}",
                kind="gravity",
                cause=self.cause,
                link=k,
                force=weight,
                moment=0.0,
                arm=at.offset(k, centre),
            )
            for k, weight, centre in at.model.weights
        ]

    def acting(self, model: Model) -> list[Acting]:
        return [Acting(k, centre, force=weight) for k, weight, centre in model.weights]

    def potential(self, at: Configuration) -> Array:
        return sum((-np.real(np.conj(w) * at.of_point(k, centre)) for k, w, centre in at.model.weights), 0.0)
