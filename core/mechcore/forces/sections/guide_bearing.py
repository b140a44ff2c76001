"""Loads on the bearing of a sliding joint: forces at its two ends, or a pressure that is linear along it.

The bearing's length and place are those of the joint's friction (`mechcore.spec.mechanism.Friction`), whether it rubs or not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.forces.kinetostatics import Forces
from mechcore.motion.motion import Motion
from mechcore.spec.mechanism import Mechanism, Prismatic


@dataclass(frozen=True, eq=False)
class GuideLoad:
    """What the bearing of a guide exerts on the joint's second link, in the world, over frames (F,).

    ``middle`` of the bearing and the guide's ``direction`` are complex; ``normal`` force across the guide [N], to the left of its
    direction; ``couple`` of the pressure about the middle [N m]; of friction the force ``along`` the guide [N] and the couple
    ``rubbing`` [N m].
    """

    middle: Complex
    direction: Complex
    length: float
    normal: Real
    couple: Real
    along: Real
    rubbing: Real

    @property
    def ends(self) -> Real:
        """Forces across the guide at the bearing's two ends (F, 2) [N]: at the end behind in the guide's direction, and ahead."""
        half, turn = 0.5 * self.normal, self.couple / self.length
        return np.column_stack([half - turn, half + turn])


def bearings(mechanism: Mechanism) -> tuple[Prismatic, ...]:
    """The sliding joints whose bearings have a length."""
    return tuple(p for p in mechanism.joints if isinstance(p, Prismatic) and p.friction is not None and p.friction.length)


def guide_load(forces: Forces, joint: Prismatic) -> GuideLoad:
    """What the bearing of a sliding joint carries; the force of a drive of the joint is not part of it."""
    assert joint.friction is not None
    motion, bearing = forces.motion, joint.friction
    j = motion.model.joint_index[joint.name]
    direction = over_frames(motion, motion.guide(j))
    slider = forces.position(joint.name) @ np.array([1.0, 1.0j])
    slide = over_frames(motion, motion.state.slide[j]) if bearing.bearing == "guide" else 0.0
    from_middle = slide - bearing.offset  # to the sliding point
    reaction = forces.reaction(joint.name)
    rubbing = np.zeros(motion.frames)
    if forces.friction is not None and joint.name in forces.friction.joints:
        rubbing = forces.friction.wrench(joint.name)[:, 2]
    force = (reaction[:, 0] + 1j * reaction[:, 1]) * np.conj(direction)
    couple = reaction[:, 2] - rubbing + from_middle * force.imag
    middle = slider - from_middle * direction
    return GuideLoad(middle, direction, bearing.length, force.imag, couple, force.real, rubbing)


def bearing_ends(forces: Forces, joint: Prismatic) -> Real:
    """Forces across the guide at the two ends of a sliding joint's bearing (F, 2) [N], as `GuideLoad.ends`."""
    out = np.empty((forces.motion.frames, 2))
    for rows, part in forces.parts:
        out[rows] = guide_load(part, joint).ends
    return out


def over_frames(motion: Motion, value: Any) -> Any:
    """A value, or one for all frames, over the frames (F,)."""
    return np.broadcast_to(np.asarray(value), (motion.frames,))
