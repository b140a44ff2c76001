"""Rollers that roll on their cams without slip: how fast they turn, and how far they have turned."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .followers import Roller
from .placed import PlacedCam
from .placed_inverse import PlacedInverse
from .placed_spatial import PlacedSpatial

if TYPE_CHECKING:
    from ..motion import Motion

__all__ = ["roller_angle", "roller_speed"]

Real = NDArray[np.float64]


def roller_speed(motion: Motion, cam: PlacedCam | PlacedInverse | PlacedSpatial, force: Any = 1.0, above: int = 0) -> Real:
    """Angular velocity of the roller in the world (F) [rad/s]: its surface moves with the cam's where they touch.

    ``force``: along the normal (F); where it is negative the far flank of a groove carries, and the roller turns the other way.
    Of a conjugate pair: the first roller; that of its second cam is the roller of ``cam.mate``. Of an inverse cam the roller on
    the crank. Of barrel, rib and end cams: about the axis towards the viewer, half way along the roller; ``above`` 1 or -1 says
    on which side of a rib it lies, along the axis. Of a globoid: against the arm, about the direction from its pivot to the
    roller. Raises ``ValueError`` for a face that is none.
    """
    if not isinstance(cam.face, Roller):
        raise ValueError(f"'{cam.name}' has no roller")
    if isinstance(cam, PlacedInverse):
        return _in_slot(motion, cam, force)
    if isinstance(cam, PlacedSpatial):
        return _in_space(motion, cam, force, above)
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


def _moved(motion: Motion, link: str, at: Any) -> Any:
    """Velocity [m/s] of a link's material at a place of the world."""
    k = motion.model.index[link]
    return motion.origin_velocities[k] + 1j * motion.speeds.spin[motion.model.angles.spin[k]] * (at - motion.origins[k])


def _in_slot(motion: Motion, cam: PlacedInverse, force: Any) -> Real:
    crank, driven = cam.links
    k = motion.model.index[crank]
    centre = motion.origins[k] + motion.rotation(k) * cam.tip
    place = cam.contact(motion, np.broadcast_to(np.asarray(force, float), (motion.frames,)))[0]
    slip = _moved(motion, driven, place) - _moved(motion, crank, centre)
    out = (place - centre) / cam.face.radius
    return np.array(np.broadcast_to(np.real(np.conj(1j * out) * slip) / cam.face.radius, (motion.frames,)))


def _in_space(motion: Motion, cam: PlacedSpatial, force: Any, above: int) -> Real:
    """What slides past the roller across its axis is rolled off; an arm beside a barrel carries the roller round."""
    flank = np.broadcast_to(np.asarray(above or force, float), (motion.frames,))
    across, _, _ = cam.rubbing(motion, flank)
    side = np.where(flank < 0.0, -1.0, 1.0) if cam.form else 1.0
    arm = 0.0 if cam.blank.kind == "globoid" else motion.speeds.spin[motion.model.angles.spin[motion.model.index[cam.links[1]]]]
    return np.array(np.broadcast_to(side * across.rate / cam.face.radius + arm, (motion.frames,)))


def roller_angle(motion: Motion, cam: PlacedCam | PlacedInverse | PlacedSpatial, force: Any = 1.0, above: int = 0) -> Real:
    """How far the roller has turned against the link that carries it since the first frame (F) [rad]: trapezoids between frames."""
    link = cam.links[0] if isinstance(cam, PlacedInverse) else cam.links[1]
    own = np.broadcast_to(np.asarray(motion.velocity(link)[:, 2], float), (motion.frames,))
    if isinstance(cam, PlacedSpatial) and cam.blank.kind == "globoid":
        own = np.zeros(motion.frames)  # the arm turns about another axis
    rate = roller_speed(motion, cam, force, above) - own
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(motion.time)
    return np.concatenate([[0.0], np.cumsum(steps)])
