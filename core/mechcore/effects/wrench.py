"""A force and a moment on a link, or between two links, over all frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..frames import added, crossed, nothing

if TYPE_CHECKING:
    from .base import Configuration

__all__ = ["Wrench", "point_of", "power_of", "sum_up"]

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


def sum_up(wrenches: list[Wrench], links: int) -> tuple[list[Array], list[Array]]:
    """Force on every link and moment about every link's origin."""
    force: list[Array] = [0j] * links
    moment: list[Array] = [0.0] * links
    for w in wrenches:
        k, f, m = w.link, w.force, w.moment
        by_force = not nothing(f)
        if by_force:
            force[k] = added(force[k], f)
            if not nothing(w.arm):
                moment[k] = added(moment[k], crossed(w.arm, f))
        if not nothing(m):
            moment[k] = added(moment[k], m)
        if w.other is not None:
            k = w.other
            force[k] = added(force[k], f, -1)
            moment[k] = added(moment[k], m, -1)
            if by_force and not nothing(w.other_arm):
                moment[k] = added(moment[k], crossed(w.other_arm, f), -1)
    return force, moment
