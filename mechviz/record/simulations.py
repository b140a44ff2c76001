"""What a motion under forces adds to a recording: what happened on the way, lanes of stick, slip and contact, notes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.events import Event, find_events

from ..power_report import steady_lines
from .paths import entity
from .streams import Static, Timelines

if TYPE_CHECKING:
    from mechcore.dynamics import Simulation

    from ..run import Run

__all__ = ["LANES", "lanes_of", "send_lanes", "simulation_events", "simulation_notes", "simulation_styles"]

LANES = {
    "sticks": ("sticks", (230, 140, 60)),
    "slips +": ("slips +", (84, 168, 255)),
    "slips -": ("slips −", (60, 110, 180)),
    "free": ("free", (72, 160, 110)),
    "contact": ("rests on the stop", (230, 60, 60)),
    "touches": ("follower in contact", (72, 160, 110)),
    "flies": ("contact lost", (230, 60, 60)),
}
"""States of the lanes, with their labels and colours."""


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


def send_lanes(stream: Any, timelines: Timelines, simulation: Simulation) -> None:
    """One row for every change of state."""
    import rerun as rr

    for name, changes in lanes_of(simulation).items():
        times = np.array([t for t, _ in changes])
        stream.send_columns(
            entity("state", name), timelines.columns_at(times), rr.StateChange.columns(state=[s for _, s in changes])
        )


def simulation_styles(run: Run) -> Iterator[Static]:
    """How lanes look."""
    if run.simulation is None:
        return
    import rerun as rr

    look = rr.StateConfiguration(
        values=list(LANES), labels=[label for label, _ in LANES.values()], colors=[color for _, color in LANES.values()]
    )
    for name in lanes_of(run.simulation):
        yield Static(entity("state", name), look)


def simulation_notes(run: Run) -> list[str]:
    """How the motion was found, in lines of markdown."""
    s = run.simulation
    if s is None:
        return []
    drift = float(np.abs(s.drift(run.motion.time)).max(initial=0.0))
    how = {"energy": "by its energy, without steps in time", "gauss": "by Gauss collocation", "radau": "by Radau collocation"}
    lines = ["", "## Motion under forces", ""]
    lines.append(f"- found {how.get(s.method, s.method)}, tolerance {s.tolerance:.1e}, {s.evaluations} evaluations of windows")
    lines.append(f"- energy balance of the whole run: drift at most {drift:.1e} of the largest energy or work")
    if run.steady is not None:
        lines += [f"- {line}" for line in steady_lines(run.steady)]
    kinds: dict[str, int] = {}
    for h in s.happenings:
        kinds[h.kind] = kinds.get(h.kind, 0) + 1
    lines += [f"- {count} × {kind}" for kind, count in kinds.items()]
    return lines
