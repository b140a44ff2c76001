"""A force and a moment on a link, or between two links, over all frames."""

from __future__ import annotations

from collections.abc import Iterable
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


def sum_up(wrenches: Iterable[Wrench], links: int) -> tuple[list[Array], list[Array]]:
    """Force on every link and moment about every link's origin.

    Forces at the same arm are summed first, one moment for all, and constants before arrays.
    """
    force: list[Array] = [0j] * links
    moment: list[Array] = [0.0] * links
    acting: dict[tuple[int, int], list[Array]] = {}  # (link, arm by identity): link, arm, constant force, force
    for w in wrenches:
        for k, arm, sign in ((w.link, w.arm, 1), (w.other, w.other_arm, -1)):
            if k is None:
                continue
            moment[k] = added(moment[k], w.moment, sign)
            at = acting.setdefault((k, 0 if nothing(arm) else id(arm)), [k, arm, 0j, 0j])
            which = 3 if isinstance(w.force, np.ndarray) else 2
            at[which] = added(at[which], w.force, sign)
    for k, arm, constant, f in acting.values():
        f = added(f, constant)
        if not nothing(f):
            force[k] = added(force[k], f)
            if not nothing(arm):
                moment[k] = added(moment[k], crossed(arm, f))
    return force, moment
