"""Shaking force and shaking moment: what the inertia of all moving links does to the frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechcore.arrays import Real
from mechcore.kinematics.dyads import cross
from mechcore.motion.motion import Motion

Array = Any


@dataclass(frozen=True, eq=False)
class Shaking:
    """``force`` (F, 2) [N] and ``moment`` (F,) [N m] about ``about`` [m], on the frame.

    ``single``: the largest inertia force of a single link in the run [N], against which what is left of a balance is judged.
    """

    force: Real
    moment: Real
    about: tuple[float, float]
    single: float = 0.0

    @property
    def magnitude(self) -> Real:
        return np.hypot(self.force[:, 0], self.force[:, 1])

    @property
    def peak(self) -> float:
        """Largest shaking force [N]."""
        return float(np.nanmax(self.magnitude, initial=0.0))

    @property
    def rms(self) -> float:
        """Root mean square of the shaking force over the frames (the last, which closes a cycle, left out) [N]."""
        return _rms(self.magnitude)

    @property
    def peak_moment(self) -> float:
        return float(np.nanmax(np.abs(self.moment), initial=0.0))

    @property
    def rms_moment(self) -> float:
        return _rms(self.moment)


def _rms(values: Real) -> float:
    used = values[:-1] if len(values) > 1 else values
    return float(np.sqrt(np.nanmean(used**2)))


def shaking(motion: Motion, about: ArrayLike = (0.0, 0.0), masses: Sequence[tuple[float, complex, float]] | None = None) -> Shaking:
    """Shaking force -sum m a_S and shaking moment sum (r x (-m a_S) - J_S alpha) about a fixed point, over all moving links.

    ``masses``: (mass, centre, J_S) of every link, frame first, in place of the model's own. Equal to what all joints on the
    frame and the drives together exert on it under inertia alone.
    """
    model = motion.model
    o = complex(*np.asarray(about, float))
    force: Array = np.zeros(motion.frames, complex)
    moment: Array = np.zeros(motion.frames)
    most = 0.0
    for k, (mass, centre, inertia) in enumerate(masses or model.masses):
        if k and (mass or inertia):
            single = -mass * motion.of_point(k, centre, 2)
            force = force + single
            most = max(most, float(np.nanmax(np.abs(single), initial=0.0)))
            moment = moment + cross(motion.of_point(k, centre) - o, single)
            moment = moment - inertia * motion.accelerations.angular[model.angles.rotation_class[k]]
    rows = np.column_stack([force.real, force.imag])
    return Shaking(force=rows, moment=np.asarray(moment, float), about=(o.real, o.imag), single=most)
