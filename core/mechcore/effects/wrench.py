"""A force and a moment on a link, or between two links, over all frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..frames import added, crossed, nothing

if TYPE_CHECKING:
    from .base import Configuration

__all__ = ["Wrench", "apparent_power", "point_of", "power_of", "sum_up"]

Array = Any


@dataclass(eq=False, slots=True)
class Wrench:
    """``force`` (complex, (F,) or one value) [N] and a free ``moment`` [N m] on a link.

    The force acts at ``arm`` from the link's origin (world axes) [m]. On the link ``other``, where there is one, the opposite
    force and moment act at the same point, ``other_arm`` from that link's origin.
    """

    name: str
    kind: str  # "inertia", "gravity", "force", "torque", "spring" ...
    link: int
    force: Array
    moment: Array
    arm: Array
    cause: str = "process"
    other: int | None = None
    other_arm: Array = 0j

    @property
    def links(self) -> tuple[int, ...]:
        """The link that the wrench acts on, then the one that its opposite acts on."""
        return (self.link,) if self.other is None else (self.link, self.other)


def point_of(at: Configuration, wrench: Wrench) -> Array:
    """Where a wrench acts in the world."""
    origin = at.origins[wrench.link]
    return origin if nothing(wrench.arm) else origin + wrench.arm


def power_of(at: Configuration, wrench: Wrench) -> Array:
    """Power that a wrench puts into its link, and into the other one [W]: force times velocity plus moment times spin."""
    total: Array = 0.0
    for k, arm, sign in ((wrench.link, wrench.arm, 1.0), (wrench.other, wrench.other_arm, -1.0)):
        if not k:  # there is no other link, or it is the frame
            continue
        spin = at.speeds.spin[at.model.angles.spin[k]]
        if not nothing(wrench.force):
            velocity = at.origin_velocities[k]
            if not nothing(arm):
                velocity = velocity + 1j * spin * arm
            total = total + sign * np.real(np.conj(wrench.force) * velocity)
        total = total + sign * wrench.moment * spin
    return total


def apparent_power(at: Configuration, wrench: Wrench) -> float:
    """Largest |force| |velocity| + |moment spin| of a wrench over the frames [W]: what its power would be along the motion."""
    most = 0.0
    for k, arm in ((wrench.link, wrench.arm), (wrench.other, wrench.other_arm)):
        if k:
            spin = at.speeds.spin[at.model.angles.spin[k]]
            velocity = at.origin_velocities[k] + 1j * spin * arm
            value = np.abs(wrench.force) * np.abs(velocity) + np.abs(wrench.moment * spin)
            most = max(most, float(np.nanmax(value, initial=0.0)))
    return most


def sum_up(wrenches: list[Wrench], links: int) -> tuple[list[Array], list[Array]]:
    """Force on every link and moment about every link's origin."""
    force: list[Array] = [0j] * links
    moment: list[Array] = [0.0] * links
    acting: dict[tuple[int, int], tuple[int, Array, Array]] = {}  # forces at the same arm are summed first: one moment for all

    def put(k: int, arm: Array, f: Array, sign: int) -> None:
        if nothing(arm):
            force[k] = added(force[k], f, sign)
        else:
            _, _, before = acting.get((k, id(arm)), (k, arm, 0j))
            acting[k, id(arm)] = (k, arm, added(before, f, sign))

    for w in wrenches:
        moment[w.link] = added(moment[w.link], w.moment)
        put(w.link, w.arm, w.force, 1)
        if w.other is not None:
            moment[w.other] = added(moment[w.other], w.moment, -1)
            put(w.other, w.other_arm, w.force, -1)
    for k, arm, f in acting.values():
        if not nothing(f):
            force[k] = added(force[k], f)
            moment[k] = added(moment[k], crossed(arm, f))
    return force, moment
