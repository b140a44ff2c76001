"""What happened while a motion under forces was found: events, and lanes of stick, slip and contact."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mechcore.events import Event, find_events

from ..power_report import steady_lines

if TYPE_CHECKING:
    from mechcore.dynamics import Simulation

    from ..run import Run

__all__ = ["lanes_of", "simulation_events"]


def simulation_events(run: Run) -> list[Event]:
    """What happened while the motion was found, and what else is worth a word at the frames."""
    simulation = run.simulation
    assert simulation is not None
    found = [Event(float(h.time), "WARN" if h.kind == "lost" else "INFO", h.item, h.text) for h in simulation.happenings]
    # a coordinate that forces move turns back often, and where it hits a stop only seemingly between two frames
    if run.steady is not None:
        found.insert(0, Event(0.0, "INFO", run.steady.pair, steady_lines(run.steady)[0]))
    found += [e for e in find_events(run.motion) if not e.text.startswith("limit position")]
    return found + list(_cam_limits(run, simulation))


def _cam_limits(run: Run, simulation: Simulation) -> Iterator[Event]:
    """Pressure angles and faces of cams beyond their limits, while their followers touch them."""
    if not run.motion.frames or not any(r.geometry is not None for r in run.motion.model.relations):
        return
    from mechcore.cams.happenings import limit_events, placed_cams

    lanes, lifting = lanes_of(simulation), {each.pair for each in simulation.liftoffs}
    for cam in placed_cams(run.motion):
        changes = lanes[cam.name] if cam.name in lifting else [(0.0, "touches")]
        place = np.searchsorted([t for t, _ in changes], run.motion.time, side="right") - 1
        yield from limit_events(run.motion, cam, np.array([state == "touches" for _, state in changes])[np.maximum(place, 0)])


def lanes_of(simulation: Simulation) -> dict[str, list[tuple[float, str]]]:
    """Times [s] and states by lane: a pair with friction slips or sticks, a stop is free or rested on; at the start and at every
    change."""
    lanes: dict[str, list[tuple[float, str]]] = {}
    for stop in simulation.stops:
        lanes[f"stop {stop.name}"] = [(0.0, "free")]
    for liftoff in simulation.liftoffs:
        lanes[liftoff.pair] = [(0.0, "touches")]
    rubs = {pair: f"{pair} friction" if pair in lanes else pair for pair in simulation.rubbing}
    for lane in rubs.values():
        lanes[lane] = [(0.0, "sticks")]
    for h in simulation.happenings:
        if h.kind in ("contact", "release"):
            lanes[f"stop {h.item}"].append((float(h.time), "contact" if h.kind == "contact" else "free"))
        elif h.kind in ("lost", "regained"):
            lanes[h.item].append((float(h.time), "flies" if h.kind == "lost" else "touches"))
            if h.kind == "lost" and h.item in rubs:
                lanes[rubs[h.item]].append((float(h.time), "free"))
        elif h.kind in ("stick", "slip"):
            state = "sticks" if h.kind == "stick" else "slips +" if "+" in h.text else "slips -"
            lanes[rubs[h.item]].append((float(h.time), state))
    return {name: _last_of_each_time(changes) for name, changes in lanes.items()}


def _last_of_each_time(changes: list[tuple[float, str]]) -> list[tuple[float, str]]:
    out: list[tuple[float, str]] = []
    for t, state in changes:
        if out and out[-1][0] == t:
            out.pop()
        if not out or out[-1][1] != state:
            out.append((t, state))
    return out
