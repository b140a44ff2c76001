"""Peaks of drive efforts and reactions as events."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.events import SINGULAR, Event

from ..tables import joints_of, pair_unit, rounding_of_efforts

if TYPE_CHECKING:
    from ..run import Run

__all__ = ["peak_events"]


def peak_events(run: Run) -> list[Event]:
    """The largest effort of each drive and the largest joint reaction, leaving out frames near singular positions."""
    motion, forces = run.motion, run.forces
    if forces is None or not motion.frames:
        return []
    sound = motion.condition <= SINGULAR
    found = []
    for drive in motion.mechanism.drives:
        what, unit = ("force", "N") if pair_unit(motion, drive.pair) == "m" else ("torque", "N m")
        effort = forces.effort(drive.pair)
        k = _largest(effort, sound, rounding_of_efforts(run, pair_unit(motion, drive.pair)))
        if k is not None:
            text = f"largest driving {what} of the run, {effort[k]:.5g} {unit}"
            found.append(Event(float(motion.time[k]), "INFO", drive.pair, text))
    sizes = {j.name: np.hypot(*forces.reaction(j.name)[:, :2].T) for j in joints_of(motion)}
    places = {name: _largest(size, sound) for name, size in sizes.items()}
    known = [(float(sizes[name][k]), name, k) for name, k in places.items() if k is not None]
    if known:
        size, name, k = max(known)
        found.append(Event(float(motion.time[k]), "INFO", name, f"largest joint reaction of the run, {size:.5g} N"))
    return found


def _largest(values: NDArray[np.float64], sound: NDArray[np.bool_], least: float = 0.0) -> int | None:
    size = np.where(sound & np.isfinite(values), np.abs(values), 0.0)
    k = int(np.argmax(size))
    return k if size[k] > least else None
