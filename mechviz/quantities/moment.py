"""A moment of a run, as people name it: by a time, a frame or the angle of a drive."""

from __future__ import annotations

import numpy as np

from mechviz.files import OutputError
from mechviz.quantities.catalogue import Catalogue

NANOSECOND, ROUNDING = 1e-9, 1e-9  # [s], [rad]: so exactly are the ends of a run told


def time_at(catalogue: Catalogue, *, at: float | None = None, frame: int | None = None, angle: float | None = None) -> float | None:
    """The time [s] that is meant by a time, a frame, or the angle [rad] that the first turning drive reaches then; None by none.

    Raises `OutputError` outside the run.
    """
    numbers = catalogue.numbers
    time = numbers.time
    if at is not None:
        if not time[0] - NANOSECOND <= at <= time[-1] + NANOSECOND:
            raise OutputError(
                f"The time {at:g} s is outside the run, which goes from {time[0]:g} s to {time[-1]:g} s.", "Name a time in it."
            )
        return at
    if frame is not None:
        if not 0 <= frame < len(time):
            raise OutputError(f"Frame {frame} is not in the run, whose frames are 0 to {len(time) - 1}.", "Name one of them.")
        return float(time[frame])
    if angle is None:
        return None
    turning = [name for name in numbers.drives if not numbers.slides(name)]
    if not turning:
        raise OutputError("There is no angle to go to: no drive of this mechanism turns.", "Name a time or a frame.")
    position = catalogue.coordinate(turning[0])
    low, high = np.minimum(position[:-1], position[1:]), np.maximum(position[:-1], position[1:])
    reached = np.flatnonzero((low - ROUNDING <= angle) & (angle <= high + ROUNDING))
    if not len(reached):
        span = f"{np.degrees(position.min()):g}° to {np.degrees(position.max()):g}°"
        raise OutputError(f"The angle {np.degrees(angle):g}° is outside what the drive does, {span}.", "Name an angle in it.")
    k = int(reached[0])
    part = 0.0 if position[k + 1] == position[k] else (angle - position[k]) / (position[k + 1] - position[k])
    part = min(max(part, 0.0), 1.0)
    return float(time[k] + part * (time[k + 1] - time[k]))
