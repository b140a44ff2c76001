"""All events of a run, in the order of time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.events import SINGULAR, Event, find_events
from mechcore.friction.events import friction_events
from mechcore.load_events import load_events
from mechcore.loads import BeltTension
from mechcore.texts import as_force, as_torque

from ..tables import joints_of, pair_unit, rounding_of_efforts
from .simulated import simulation_events

if TYPE_CHECKING:
    from ..run import Run

__all__ = ["events_of", "line_of", "peak_events"]


def events_of(run: Run) -> tuple[Event, ...]:
    """All events of a run, sorted by time, in the units of its scene."""
    found = (e.in_units(run.scene.units) for e in (*_course_events(run), *peak_events(run)))
    return tuple(sorted(found, key=lambda e: e.time))


def line_of(event: Event) -> str:
    """An event in a line: what it happens to, what happens, and when."""
    return f"{event.item}: {event.text} (t = {event.time:.6g} s)"


def _course_events(run: Run) -> list[Event]:
    """What happens in the course of the motion."""
    if run.simulation is not None:
        return [*simulation_events(run), *load_events(run.motion, run.scene.mechanism)]
    rubbing = [] if run.forces is None else friction_events(run.forces)
    return [*find_events(run.motion), *load_events(run.motion), *rubbing, *_cam_events(run), *_belt_events(run)]


def _cam_events(run: Run) -> list[Event]:
    """Events of the cams, where there are any."""
    if not any(r.geometry is not None for r in run.motion.model.relations):
        return []
    from mechcore.cams.happenings import cam_events

    return cam_events(run.motion, run.forces)


def _belt_events(run: Run) -> list[Event]:
    """Where belts slip, where one has a tension."""
    if run.forces is None or not any(isinstance(load, BeltTension) for load in run.motion.mechanism.loads):
        return []
    from mechcore.belts import belt_events

    return belt_events(run.forces)


def peak_events(run: Run) -> list[Event]:
    """The largest effort of each drive and the largest joint reaction, leaving out frames near singular positions."""
    motion, forces = run.motion, run.forces
    if forces is None or not motion.frames:
        return []
    sound = motion.condition <= SINGULAR
    found = []
    for drive in motion.mechanism.drives:
        what, shown = ("force", as_force) if pair_unit(motion, drive.pair) == "m" else ("torque", as_torque)
        effort = forces.effort(drive.pair)
        k = _largest(effort, sound, rounding_of_efforts(run, pair_unit(motion, drive.pair)))
        if k is not None:
            text = f"largest driving {what} of the run, {shown(float(effort[k]), 5)}"
            found.append(Event(float(motion.time[k]), "INFO", drive.pair, text))
    sizes = {j.name: np.hypot(*forces.reaction(j.name)[:, :2].T) for j in joints_of(motion)}
    places = {name: _largest(size, sound) for name, size in sizes.items()}
    known = [(float(sizes[name][k]), name, k) for name, k in places.items() if k is not None]
    if known:
        size, name, k = max(known)
        found.append(Event(float(motion.time[k]), "INFO", name, f"largest joint reaction of the run, {as_force(size, 5)}"))
    return found


def _largest(values: NDArray[np.float64], sound: NDArray[np.bool_], least: float = 0.0) -> int | None:
    size = np.where(sound & np.isfinite(values), np.abs(values), 0.0)
    k = int(np.argmax(size))
    return k if size[k] > least else None
