"""Inertia: -m a_S at the centre of mass and -J_S alpha, for every moving link that has a mass (d'Alembert)."""

from __future__ import annotations

from ..motion import Motion
from .wrench import Wrench


def wrenches(motion: Motion) -> list[Wrench]:
    model = motion.model
    out = []
    for k in range(1, len(model.links)):
        mass, centre, inertia = model.masses[k]
        if mass or inertia:
            alpha = motion.accelerations.spin[model.angles.spin[k]]
            out.append(
                Wrench(
                    name=f"inertia/{model.links[k]}",
                    kind="inertia",
                    link=k,
                    force=-mass * motion.of_point(k, centre, 2),
                    moment=-inertia * alpha,
                    arm=centre * motion.rotation(k),
                    local=centre,
                )
            )
    return out
