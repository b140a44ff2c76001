"""Forces of masses: weight and inertia."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Real, Values
from mechcore.effects.base import Configuration, Effect, PointLoad
from mechcore.kinematics.model import Model
from mechcore.motion.motion import Motion
from mechcore.numerics.frames import is_zero, plane


def weights(model: Model) -> tuple[tuple[int, complex, complex], ...]:
    """(link, weight [N], centre of mass in link axes [m]) of every moving link that has a weight."""
    out = []
    for k, (mass, centre, _) in enumerate(model.masses):
        own = model.bodies[model.links[k]].gravity
        if k and not is_zero(mass):
            out.append((k, mass * plane(*(model.mechanism.gravity if own is None else own)), centre))
    return tuple(out)


class Gravity(Effect):
    """Uniform gravity, that of the mechanism, or a link's own where it states one. The potential is zero at the world's origin."""

    cause = "gravity"

    def point_loads(self, model: Model) -> list[PointLoad]:
        return [
            PointLoad(f"gravity/{model.links[k]}", "gravity", k, centre, force=weight)
            for k, weight, centre in model.cached(weights)
        ]

    def potential(self, at: Configuration) -> Real | float:
        return sum((-np.real(np.conj(w) * at.of_point(k, centre)) for k, w, centre in at.model.cached(weights)), 0.0)


class Inertia(Effect):
    """Inertia forces: the only effect that needs accelerations. Forward dynamics has the masses on the left-hand side instead."""

    cause = "inertia"
    needs = frozenset({"positions", "velocities", "accelerations"})

    def point_loads(self, model: Model) -> list[PointLoad]:
        named = zip(model.links, model.masses, strict=True)
        return [
            PointLoad(f"inertia/{link}", "inertia", k, centre, mass=mass, inertia=inertia)
            for k, (link, (mass, centre, inertia)) in enumerate(named)
            if k and not (is_zero(mass) and is_zero(inertia))
        ]


def kinetic_energy(motion: Motion) -> Real:
    """Kinetic energy of all links (F,) [J]; at a unit rate of a free coordinate it is half of the reduced inertia."""
    total: Real = sum(link_energies(motion), start=np.zeros(motion.shape))  # type: ignore[arg-type] # numbers, too
    return total


def link_energies(motion: Motion) -> list[Values]:
    """Kinetic energy of every link (F,) [J]."""
    energies: list[Values] = []
    for k, (mass, centre, inertia) in enumerate(motion.model.masses):
        own: Values = 0.0
        if k and not is_zero(mass):
            v = motion.of_point(k, centre, 1)
            own = 0.5 * mass * (v.real**2 + v.imag**2)
        if k and not is_zero(inertia):
            own = own + 0.5 * inertia * motion.speeds.angular[motion.model.angles.rotation_class[k]] ** 2
        energies.append(own)
    return energies
