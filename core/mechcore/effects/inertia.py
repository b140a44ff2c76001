"""Inertia: -m a_S at the centre of mass and -J_S alpha, for every moving link that has a mass (d'Alembert)."""

from __future__ import annotations

from mechcore.effects.base import Effect, PointLoad
from mechcore.kinematics.model import Model


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
