"""Polodes (centrodes): the way of the instant centre of a link on the frame and on the link itself.

The moving polode rolls on the fixed one without slipping: that is the motion of the link.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mechcore.arrays import Real
from mechcore.constructions.polygons import frames_of
from mechcore.errors import Fault, MechanismError
from mechcore.motion.metrics import per_unit
from mechcore.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class Polodes:
    """``fixed`` (F, 2) [m] in the frame's axes, ``moving`` (F, 2) [m] in the link's; NaN where the link does not turn."""

    link: str
    fixed: Real
    moving: Real


def polodes(motion: Motion, link: str) -> Polodes:
    """Fixed and moving polode of a link against the frame, from the motion per unit of the first drive (it may stand still)."""
    model = motion.model
    if link not in model.index or link == model.mechanism.frame:
        raise MechanismError(Fault("polodes", f"'{link}' is no moving link.", "Name a moving link."))
    k, n = model.index[link], motion.frames
    unit = per_unit(motion)
    turn = np.real(frames_of(unit.speeds.angular[model.angles.rotation_class[k]], n))
    rate = frames_of(unit.origin_velocities[k], n)
    with np.errstate(invalid="ignore", divide="ignore"):
        arm = 1j * rate / turn  # from the link's origin
    size = model.length_scale
    rigid = ~np.isfinite(arm) | (np.abs(turn) * size <= 1e-12 * np.fmax(np.abs(rate), np.abs(turn) * size))
    arm[rigid] = np.nan + 1j * np.nan
    fixed = frames_of(motion.origins[k], n) + arm
    moving = arm * np.conj(frames_of(motion.rotation(k), n))
    return Polodes(link, np.column_stack([fixed.real, fixed.imag]), np.column_stack([moving.real, moving.imag]))
