"""All events of a run, in the order of time."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechcore.constants import SINGULAR
from mechcore.dynamics.events import EventKind
from mechcore.forces.cam_events import cam_events
from mechcore.forces.friction.events import friction_events
from mechcore.forces.load_events import belt_events, load_events
from mechcore.motion.between_frames import EQUAL
from mechcore.motion.events import Event, find_events
from mechcore.spec.loads import BeltTension
from mechcore.texts import as_force, as_torque
from mechviz.quantities.items import joint_unit, joints_of
from mechviz.quantities.power_table import steady_lines
from mechviz.quantities.tables import rounding_of_efforts

if TYPE_CHECKING:
    from mechcore.dynamics.simulation import Simulation
    from mechcore.motion.motion import Motion
    from mechviz.runs import Run


class LaneState(StrEnum):
    """States of the lanes (stops, followers, joints with friction) of a motion under forces, by their names in recordings."""

    FREE = "free"
    CONTACT = "contact"
    TOUCHES = "touches"
    FLIES = "flies"
    STICKS = "sticks"
    SLIPS_FORWARD = "slips +"
    SLIPS_BACK = "slips -"


Lanes = dict[str, list[tuple[float, LaneState]]]  # by lane: time [s] from which on a state holds, and the state


def simulation_events(run: Run) -> list[Event]:
    """Events of a motion under forces that the integration located, and those that are found at its frames."""
    simulation = run.simulation
    assert simulation is not None
    events = [Event(float(h.time), "WARN" if h.kind == EventKind.SEPARATION else "INFO", h.item, h.text) for h in simulation.events]
    # limit positions are left out: a free coordinate reverses often, and an impact between two frames looks like one
    if run.steady is not None:
        events.insert(0, Event(0.0, "INFO", run.steady.joint, steady_lines(run.steady)[0]))
    return events + [e for e in find_events(run.motion) if not e.text.startswith("limit position")]


def _touching(motion: Motion, simulation: Simulation) -> dict[str, NDArray[np.bool_]]:
    """Whether each follower that may leave its cam touches it, at the frames (F,), by the name of the cam's joint."""
    lanes, out = lanes_of(simulation), {}
    for each in simulation.separable_cams:
        times, states = zip(*lanes[each.joint], strict=True)
        place = np.searchsorted(times, motion.time, side="right") - 1
        out[each.joint] = np.array([state == LaneState.TOUCHES for state in states])[np.maximum(place, 0)]
    return out


def lanes_of(simulation: Simulation) -> Lanes:
    """Times [s] and states of each lane, at the start and at every change: a joint with friction sticks or slips, a stop is free or
    in contact, a follower touches its cam or has left it."""
    lanes: Lanes = {}
    for stop in simulation.stops:
        lanes[f"stop {stop.name}"] = [(0.0, LaneState.FREE)]
    for cam in simulation.separable_cams:
        lanes[cam.joint] = [(0.0, LaneState.TOUCHES)]
    rubs = {joint: f"{joint} friction" if joint in lanes else joint for joint in simulation.joints_with_friction}
    for lane in rubs.values():
        lanes[lane] = [(0.0, LaneState.STICKS)]
    for h in simulation.events:
        if h.kind in (EventKind.CONTACT, EventKind.RELEASE):
            at_stop = LaneState.CONTACT if h.kind == EventKind.CONTACT else LaneState.FREE
            lanes[f"stop {h.item}"].append((float(h.time), at_stop))
        elif h.kind in (EventKind.SEPARATION, EventKind.LANDING):
            follower = LaneState.FLIES if h.kind == EventKind.SEPARATION else LaneState.TOUCHES
            lanes[h.item].append((float(h.time), follower))
            if h.kind == EventKind.SEPARATION and h.item in rubs:
                lanes[rubs[h.item]].append((float(h.time), LaneState.FREE))
        elif h.kind in (EventKind.STICK, EventKind.SLIP):
            state = (LaneState.STICKS, LaneState.SLIPS_FORWARD, LaneState.SLIPS_BACK)[h.direction]
            lanes[rubs[h.item]].append((float(h.time), state))
    return {name: _last_of_each_time(changes) for name, changes in lanes.items()}


def _last_of_each_time(changes: list[tuple[float, LaneState]]) -> list[tuple[float, LaneState]]:
    out: list[tuple[float, LaneState]] = []
    for t, state in changes:
        if out and out[-1][0] == t:
            out.pop()
        if not out or out[-1][1] != state:
            out.append((t, state))
    return out


def events_of(run: Run) -> tuple[Event, ...]:
    """All events of a run, sorted by time, in the units of its scene."""
    events = (e.in_units(run.scene.units) for e in (*_motion_events(run), *peak_events(run)))
    return tuple(sorted(events, key=lambda e: e.time))


def line_of(event: Event) -> str:
    """An event in one line of text: item, description and time."""
    return f"{event.item}: {event.text} (t = {event.time:.6g} s)"


def _motion_events(run: Run) -> list[Event]:
    """All events of a run except its peaks, unsorted, in SI units."""
    contacts = [*_cam_events(run), *_belt_events(run)]
    if run.simulation is not None:
        return [*simulation_events(run), *load_events(run.motion, run.scene.mechanism), *contacts]
    rubbing = [] if run.forces is None else friction_events(run.forces)
    return [*find_events(run.motion), *load_events(run.motion), *rubbing, *contacts]


def _cam_events(run: Run) -> list[Event]:
    """Events of the cams; none where the mechanism has no cam."""
    if not any(r.geometry is not None for r in run.motion.model.relations):
        return []
    touches = None if run.simulation is None else _touching(run.motion, run.simulation)
    return cam_events(run.motion, run.forces, touches)


def _belt_events(run: Run) -> list[Event]:
    """Slip of belts; none where no belt has a tension."""
    if run.forces is None or not any(isinstance(load, BeltTension) for load in run.motion.mechanism.loads):
        return []
    return belt_events(run.forces)


def peak_events(run: Run) -> list[Event]:
    """Events at the largest effort of each drive and at the largest joint reaction. Frames near singular positions are left out."""
    motion, forces = run.motion, run.forces
    if forces is None or not motion.frames:
        return []
    well_conditioned = motion.condition <= SINGULAR
    events = []
    for drive in motion.mechanism.drives:
        what, shown = ("force", as_force) if joint_unit(motion, drive.joint) == "m" else ("torque", as_torque)
        effort = forces.effort(drive.joint)
        k = _largest(effort, well_conditioned, rounding_of_efforts(run, joint_unit(motion, drive.joint)))
        if k is not None:
            text = f"largest driving {what} of the run, {shown(float(effort[k]), 5)}"
            events.append(Event(float(motion.time[k]), "INFO", drive.joint, text))
    sizes = {j.name: np.hypot(*forces.reaction(j.name)[:, :2].T) for j in joints_of(motion)}
    places = {name: _largest(size, well_conditioned) for name, size in sizes.items()}
    known = [(float(sizes[name][k]), name, k) for name, k in places.items() if k is not None]
    if known:
        most = max(size for size, *_ in known)
        size, name, k = next(found for found in known if found[0] >= (1.0 - EQUAL) * most)  # of equal ones the first
        events.append(Event(float(motion.time[k]), "INFO", name, f"largest joint reaction of the run, {as_force(size, 5)}"))
    return events


def _largest(values: NDArray[np.float64], well_conditioned: NDArray[np.bool_], least: float = 0.0) -> int | None:
    size = np.where(well_conditioned & np.isfinite(values), np.abs(values), 0.0)
    k = int(np.argmax(size >= (1.0 - EQUAL) * size.max()))  # the first of equal ones
    return k if size[k] > least else None
