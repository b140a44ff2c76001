"""Inertia: -m a_S at the centre of mass and -J_S alpha, for every moving link that has a mass (d'Alembert)."""

from __future__ import annotations

from ..motion import Motion
from .base import Effect
from .wrench import Totals, Wrench

__all__ = ["Inertia"]


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

    def sum_into(self, at: Motion, totals: Totals) -> None:
        alpha = at.accelerations.spin
        for k, mass, centre, inertia, spin, terms in at.model.moved:
            if mass:
                force = at.summed(terms, 2) if terms is not None else -mass * at.of_point(k, centre, 2)
                totals.put(k, at.offset(k, centre), force)
            if inertia:
                totals.turn(k, -inertia * alpha[spin])
