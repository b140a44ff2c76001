"""A free coordinate: a pair whose motion follows from the forces, with its position and speed at the start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Free"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Free:
    """Stands where a drive's law would: the mechanism is put together at ``start`` [rad or m], where it moves at ``speed``.

    As a law it is the straight way through the start; forward dynamics replaces it by the motion that it finds.
    """

    start: float
    speed: float = 0.0

    @property
    def duration(self) -> float:
        return 2.0 * np.pi / abs(self.speed) if self.speed else 2.0 * np.pi

    @property
    def breaks(self) -> tuple[float, ...]:
        return ()

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        t = np.asarray(t, float)
        return self.start + self.speed * t, np.full_like(t, self.speed), np.zeros_like(t)
