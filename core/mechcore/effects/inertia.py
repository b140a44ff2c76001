"""Inertia: -m a_S at the centre of mass and -J_S alpha, for every moving link that has a mass (d'Alembert)."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Real
from mechcore.effects.base import Effect, PointLoad
from mechcore.kinematics.model import Model
from mechcore.motion.motion import Motion


class Inertia(Effect):
    """The only effect that needs accelerations; forward dynamics has the masses on the left-hand side instead."""

    cause = "inertia"
    needs = frozenset({"positions", "velocities", "accelerations"})

    def point_loads(self, model: Model) -> list[PointLoad]:
        named = zip(model.links, model.masses, strict=True)
        return [
            PointLoad(f"inertia/{link}", "inertia", k, centre, mass=mass, inertia=inertia)
            for k, (link, (mass, centre, inertia)) in enumerate(named)
            if k and (mass or inertia)
        ]


def kinetic_energy(motion: Motion) -> Real:
    """Kinetic energy of all links (F,) [J]; at a unit rate of a free coordinate half of the reduced inertia."""
    total = np.zeros(motion.frames)
    for k, (mass, centre, inertia) in enumerate(motion.model.masses):
        if k and mass:
            v = motion.of_point(k, centre, 1)
            total = total + 0.5 * mass * (v.real**2 + v.imag**2)
        if k and inertia:
            total = total + 0.5 * inertia * motion.speeds.angular[motion.model.angles.rotation_class[k]] ** 2
    return total
