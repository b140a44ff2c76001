"""Rollers that roll on their cams without slip: how fast they turn, and how far they have turned."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .followers import Roller
from .placed import PlacedCam

if TYPE_CHECKING:
    from ..motion import Motion

__all__ = ["roller_angle", "roller_speed"]

Real = NDArray[np.float64]


def roller_speed(motion: Motion, cam: PlacedCam, force: Any = 1.0) -> Real:
    """Angular velocity of the roller in the world (F) [rad/s]: its surface moves with the cam's where they touch.

    ``force``: along the normal (F); where it is negative the far flank of a groove carries, and the roller turns the other way.
    Of a conjugate pair: the first roller. Raises ``ValueError`` for a face that is none.
    """
    if not isinstance(cam.face, Roller):
        raise ValueError(f"'{cam.name}' has no roller")
    radius = cam.face.radius
    s = cam.at(motion)
    world = cam.axes * motion.rotation(motion.model.index[cam.carrier])
    normal, centre = s.ground_normal * world, cam.place(motion, s.reference[0])
    flank = np.where(np.asarray(force) < 0.0, -1.0, 1.0) if cam.groove else 1.0
    place = centre - flank * radius * normal
    spin = motion.model.angles.spin
    k, f = (motion.model.index[name] for name in cam.links)

    def velocity(link: int, at: Any) -> Any:
        return motion.origin_velocities[link] + 1j * motion.speeds.spin[spin[link]] * (at - motion.origins[link])

    tangent = 1j * normal
    slip = np.real(np.conj(tangent) * (velocity(f, centre) - velocity(k, place)))
    return np.array(np.broadcast_to(flank * slip / radius, (motion.frames,)))


def roller_angle(motion: Motion, cam: PlacedCam, force: Any = 1.0) -> Real:
    """How far the roller has turned against its follower since the first frame (F) [rad]: trapezoids between the frames."""
    own = np.broadcast_to(np.asarray(motion.velocity(cam.links[1])[:, 2], float), (motion.frames,))
    rate = roller_speed(motion, cam, force) - own
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(motion.time)
    return np.concatenate([[0.0], np.cumsum(steps)])
