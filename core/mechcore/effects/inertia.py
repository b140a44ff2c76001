"""Inertia: -m a_S at the centre of mass and -J_S alpha, for every moving link that has a mass (d'Alembert)."""

from __future__ import annotations

from mechcore.effects.base import Effect, PointLoad, Wrench
from mechcore.kinematics.model import Model
from mechcore.motion.motion import Motion


class Inertia(Effect):
    """The only effect that needs accelerations; forward dynamics has the masses on the left-hand side instead."""

    cause = "inertia"
    needs = frozenset({"positions", "velocities", "accelerations"})

    def wrenches(self, at: Motion) -> list[Wrench]:
        model = at.model
        out = []
        for k in range(1, len(model.links)):
            mass, centre, inertia = model.masses[k]
            if mass or inertia:
                alpha = at.accelerations.spin[model.angles.spin[k]]
                out.append(
                    Wrench(
                        name=f"inertia/{model.links[k]}",
                        kind="inertia",
                        cause=self.cause,
                        link=k,
                        force=-mass * at.of_point(k, centre, 2),
                        moment=-inertia * alpha,
                        arm=at.offset(k, centre),
                    )
                )
        return out

    def point_loads(self, model: Model) -> list[PointLoad]:
        return [PointLoad(k, s, mass=mass, inertia=j) for k, (mass, s, j) in enumerate(model.masses) if k and (mass or j)]
