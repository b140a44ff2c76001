"""Results of a mechanism and of the same one described otherwise, and by how much they differ."""

from __future__ import annotations

from typing import Any

import numpy as np
from metamorphosis import Change
from random_mechanisms import FRAME, TURN, Case

from mechcore import spec as sp
from mechcore.dynamics.simulate import simulate
from mechcore.forces.kinetostatics import solve_forces
from mechcore.laws.timed import Free
from mechcore.motion.events import find_events
from mechcore.motion.solve import compile_mechanism, solve_motion

TOLERANCE = 1e-12  # of motions under forces


class Result:
    """Everything that is compared, of a case that was solved."""

    def __init__(self, case: Case, tolerance: float = TOLERANCE):
        self.case, self.events = case, []
        m = case.mechanism
        if case.free:
            run = simulate(m, float(case.time[-1]), tolerance=tolerance, stops=case.stops, triggers=case.triggers)
            self.events = [(h.time, h.kind, h.item) for h in run.events]
            self.motion = run.motion(case.time)
            self.forces = run.forces(self.motion)
        else:
            self.motion = solve_motion(compile_mechanism(m), case.time)
            self.forces = solve_forces(self.motion)
            self.events = [(e.time, e.level, e.item) for e in find_events(self.motion)]


def plane(rows: Any) -> Any:
    return rows[:, 0] + 1j * rows[:, 1]


def differences(change: Change, base: Result, other: Result) -> dict[str, float]:
    """What is not as it has to be, relative to the largest of its sort."""
    back = change.back is not None
    m, L, F, s = base.case.mechanism, change.length, change.force, change.sense
    out: dict[str, float] = {}

    def note(name: str, got: Any, want: Any, least: float = 0.0) -> None:
        got = got[::-1] if back else got
        peak = max(float(np.abs(want).max(initial=0.0)), least, 1e-300)
        deviation = float(np.abs(got - want).max(initial=0.0)) / peak
        out[name] = deviation if np.isfinite(deviation) else np.inf

    length = base.motion.model.length_scale * L
    rate = abs(change.pace)
    fast = max(float(np.abs(base.motion.velocity(k.name)[:, 2]).max()) for k in m.links if k.name != FRAME)
    fast = max(fast, *(float(np.abs(base.motion.velocity(k.name)[:, :2]).max()) / base.motion.model.length_scale for k in m.links))
    for k in m.links:
        if k.name == FRAME:
            continue
        name = change.names[k.name]
        for n, ask in enumerate(("pose", "velocity", "acceleration")):
            was, now = getattr(base.motion, ask)(k.name), getattr(other.motion, ask)(name)
            per = change.pace**n
            least = max(fast, float(np.abs(was[:, 2]).max())) if n else 1.0
            note(f"{ask} {k.name}", plane(now), L / per * change.vector(plane(was)), length * least / rate**n)
            angle = s / per * was[:, 2] + (change.turn if n == 0 else 0.0)
            if n == 0:
                angle += TURN * np.round(((now[::-1] if back else now)[0, 2] - angle[0]) / TURN)
            note(f"{ask} angle {k.name}", now[:, 2], angle, least / rate**n)
    strongest = max(
        [1e-9, *(float(np.abs(r.values[:, :2]).max()) for r in base.forces.loads.values())]
        + [float(np.abs(base.forces.reaction(p.name)[:, :2]).max()) for p in m.joints if not isinstance(p, sp.Cylinder)]
    )
    arm = base.motion.model.length_scale
    strongest = max(strongest, *(float(np.abs(r.values[:, 2]).max(initial=0.0)) / arm for r in base.forces.loads.values()), 1e-9)
    strongest = max(strongest, *(damping(x, fast, arm) for x in m.loads), 0.0)
    for p in m.joints:
        name = change.names[p.name]
        sign = -1.0 if p.name in change.swapped else 1.0
        if not isinstance(p, sp.CamJoint | sp.Weld):
            gain, shift = change.coordinate(p.name)
            was, now = base.motion.coordinate(p.name), other.motion.coordinate(name)
            slides = isinstance(p, sp.Prismatic | sp.PinSlot | sp.Rolling | sp.Cylinder)
            if back and not slides:
                shift += TURN * np.round((now[-1, 0] - gain * was[0, 0] - shift) / TURN)
            note(f"coordinate {p.name}", now[:, 0], gain * was[:, 0] + shift, length if slides else 1.0)
            note(f"rate {p.name}", now[:, 1], gain / change.pace * was[:, 1], (length if slides else 1.0) * fast / rate)
        parts = [p.name] if not isinstance(p, sp.Cylinder) else [f"{p.name}.base", f"{p.name}.eye"]
        for part in parts:
            there = part.replace(p.name, name, 1)
            was, now = base.forces.reaction(part), other.forces.reaction(there)
            note(f"reaction {part}", plane(now), sign * F * change.vector(plane(was)), F * strongest)
            note(f"couple {part}", now[:, 2], sign * s * F * L * was[:, 2], F * L * arm * strongest)
    for d in m.drives:
        p = next(p for p in m.joints if p.name == d.joint)
        slides = isinstance(p, sp.Prismatic | sp.PinSlot | sp.Rolling | sp.Cylinder)
        sign = 1.0 if slides else (-1.0 if d.joint in change.swapped else 1.0) * s * L
        if not isinstance(d.law, Free):
            least = F * strongest * (1.0 if slides else L * arm)
            note(f"effort {d.joint}", other.forces.effort(change.names[d.joint]), sign * F * base.forces.effort(d.joint), least)
    for name, was in base.forces.loads.items():
        key = change.names.get(name, name)
        if name.startswith("gravity/"):
            key = "gravity/" + change.names[name[8:]]
        if name.startswith("stop "):
            key = name
        now = other.forces.loads[key]
        joint, dot, part = was.links[0].partition(".")  # of a cylinder: barrel or rod
        sign = 1.0 if now.links[0] == change.names[joint] + dot + part else -1.0
        note(f"load {name} {was.kind}", plane(now.values), sign * F * change.vector(plane(was.values)), F * 1e-6 * strongest)
        note(f"moment {name} {was.kind}", now.values[:, 2], sign * s * F * L * was.values[:, 2], F * L * arm * 1e-6 * strongest)
    work = F * L
    held = max(float(np.abs(base.forces.potential_energy).max()), float(np.abs(base.forces.kinetic_energy).max()))
    for what in ("kinetic_energy", "potential_energy"):
        note(what, getattr(other.forces, what), work * getattr(base.forces, what), work * held)
    if not back:
        out["events"] = happened(change, base, other)
    return out


def damping(load: Any, rate: float, size: float) -> float:
    """What a damper brakes with at the speeds of the mechanism: beside it, that between two welded links is rounding."""
    if isinstance(load, sp.Damper):
        return (load.linear + load.quadratic * rate * size) * rate * size
    return load.coefficient * rate / size if isinstance(load, sp.TorsionDamper) else 0.0


def happened(change: Change, base: Result, other: Result) -> float:
    """By how much of the duration events differ in time; infinite where they are not the same."""
    kinds = {"INFO", "WARN", "impact", "contact", "release", "watch"}
    was = sorted((change.time * t, kind, change.names.get(item, item)) for t, kind, item in base.events if kind in kinds)
    now = sorted((t, kind, item) for t, kind, item in other.events if kind in kinds)
    if sorted(x[1:] for x in was) != sorted(x[1:] for x in now):
        return np.inf
    duration = float(other.case.time[-1])
    far = 0.0
    for label in {x[1:] for x in was}:
        joints = zip([x[0] for x in was if x[1:] == label], [x[0] for x in now if x[1:] == label], strict=True)
        far = max(far, *(abs(a - b) / duration for a, b in joints))
    return far
