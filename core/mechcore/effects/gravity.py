"""Gravity: the weight of every moving link that has a mass, at its centre of mass."""

from __future__ import annotations

from ..motion import Motion
from .wrench import Wrench


def wrenches(motion: Motion) -> list[Wrench]:
    model = motion.model
    g = complex(*model.mechanism.gravity)
    return [
        Wrench(
            name=f"gravity/{model.links[k]}",
            kind="gravity",
            link=k,
            force=mass * g,
            moment=0.0,
            arm=centre * motion.rotation(k),
            local=centre,
        )
        for k, (mass, centre, _) in enumerate(model.masses)
        if k and mass
    ]
