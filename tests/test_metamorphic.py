"""The same results however a random mechanism is described: turned, mirrored, scaled, renamed and reordered, run backwards.

A moderate sample by default; all of it: pytest tests/test_metamorphic.py --random-cases 2000.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from metamorphosis import Change
from random_mechanisms import FRAME, KINDS, TURN, Case, draw

from mechcore import MechanismError, compile_mechanism, solve_forces, solve_motion
from mechcore import spec as sp
from mechcore.dynamics import Free, simulate
from mechcore.events import find_events

SAME = 1e-9  # of the largest value of each quantity, at mechanisms whose equations are well conditioned
WELL = 100.0  # condition number up to which that holds; beyond it the bound grows with its square
HOPELESS = 1e6
REACHES = (TURN, 1.0, 0.3)
TOLERANCE = 1e-12  # of motions under forces
RATED = (sp.Damper, sp.TorsionDamper, sp.Drag, sp.Viscous, sp.DcMotor, sp.GasPressure)  # know which way time runs
CHANGES = ("turned", "mirrored", "small", "large", "renamed", "backwards")


class Result:
    """Everything that is compared, of a case that was solved."""

    def __init__(self, case: Case):
        self.case, self.happenings = case, []
        m = case.mechanism
        if case.free:
            run = simulate(m, float(case.time[-1]), tolerance=TOLERANCE, stops=case.stops, watches=case.watches)
            self.happenings = [(h.time, h.kind, h.item) for h in run.happenings]
            self.motion = run.motion(case.time)
            self.forces = run.forces(self.motion)
        else:
            self.motion = solve_motion(compile_mechanism(m), case.time)
            self.forces = solve_forces(self.motion)
            self.happenings = [(e.time, e.level, e.item) for e in find_events(self.motion)]


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

    length = base.motion.model.size * L
    rate = abs(change.pace)
    fast = max(float(np.abs(base.motion.velocity(k.name)[:, 2]).max()) for k in m.links if k.name != FRAME)
    fast = max(fast, *(float(np.abs(base.motion.velocity(k.name)[:, :2]).max()) / base.motion.model.size for k in m.links))
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
        + [float(np.abs(base.forces.reaction(p.name)[:, :2]).max()) for p in m.pairs if not isinstance(p, sp.Cylinder)]
    )
    arm = base.motion.model.size
    strongest = max(strongest, *(float(np.abs(r.values[:, 2]).max(initial=0.0)) / arm for r in base.forces.loads.values()), 1e-9)
    for p in m.pairs:
        name = change.names[p.name]
        sign = -1.0 if p.name in change.swapped else 1.0
        if not isinstance(p, sp.CamPair | sp.Weld):
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
        p = next(p for p in m.pairs if p.name == d.pair)
        slides = isinstance(p, sp.Prismatic | sp.PinSlot | sp.Rolling | sp.Cylinder)
        sign = 1.0 if slides else (-1.0 if d.pair in change.swapped else 1.0) * s * L
        if not isinstance(d.law, Free):
            least = F * strongest * (1.0 if slides else L * arm)
            note(f"effort {d.pair}", other.forces.effort(change.names[d.pair]), sign * F * base.forces.effort(d.pair), least)
    for name, was in base.forces.loads.items():
        key = change.names.get(name, name)
        if name.startswith("gravity/"):
            key = "gravity/" + change.names[name[8:]]
        if name.startswith("stop "):
            key = name
        now = other.forces.loads[key]
        sign = 1.0 if now.links[0] == change.names[was.links[0]] else -1.0
        note(f"load {name} {was.kind}", plane(now.values), sign * F * change.vector(plane(was.values)), F * 1e-6 * strongest)
        note(f"moment {name} {was.kind}", now.values[:, 2], sign * s * F * L * was.values[:, 2], F * L * arm * 1e-6 * strongest)
    work = F * L
    held = max(float(np.abs(base.forces.potential_energy).max()), float(np.abs(base.forces.kinetic_energy).max()))
    for what in ("kinetic_energy", "potential_energy"):
        note(what, getattr(other.forces, what), work * getattr(base.forces, what), work * held)
    if not back:
        out["events"] = happened(change, base, other)
    return out


def happened(change: Change, base: Result, other: Result) -> float:
    """By how much of the duration events differ in time; infinite where they are not the same."""
    kinds = {"INFO", "WARN", "impact", "contact", "release", "watch"}
    was = sorted((change.time * t, kind, change.names.get(item, item)) for t, kind, item in base.happenings if kind in kinds)
    now = sorted((t, kind, item) for t, kind, item in other.happenings if kind in kinds)
    if sorted(x[1:] for x in was) != sorted(x[1:] for x in now):
        return np.inf
    duration = float(other.case.time[-1])
    far = 0.0
    for label in {x[1:] for x in was}:
        pairs = zip([x[0] for x in was if x[1:] == label], [x[0] for x in now if x[1:] == label], strict=True)
        far = max(far, *(abs(a - b) / duration for a, b in pairs))
    return far


def changed(case: Case, how: str, base: Result) -> tuple[Change, Result]:
    """A change of a kind and what it starts from: time runs backwards for what does not know its direction only."""
    rng = np.random.default_rng([case.seed, CHANGES.index(how)])
    if how == "turned":
        plain = Change(case)
        turn = np.pi / 2 * int(rng.integers(1, 4)) if plain.exact_turns else float(rng.uniform(-np.pi, np.pi))
        return Change(case, turn=turn), base
    if how == "mirrored":
        return Change(case, mirrored=True, turn=np.pi / 2 * int(rng.integers(4))), base
    if how in ("small", "large"):
        length = 1e-6 if how == "small" else 1e6
        return Change(case, length=length, mass=length**3, time=float(rng.choice([1.0, np.sqrt(length)]))), base
    if how == "renamed":
        return Change(case, mixed=case.seed), base
    m = case.mechanism
    rated = [x for x in m.loads if isinstance(x, RATED) or (getattr(x, "factor", None) and x.factor.of in ("velocity", "vx", "vy"))]
    drop = list(rated)
    start = Result(timeless(case, drop)) if "friction" in m.effects or rated or case.stops else base
    for x in start.case.mechanism.loads:  # a spring that is wound by more than half a turn would start elsewhere
        if isinstance(x, sp.TorsionSpring) and np.abs(start.forces.loads[x.name].values[-1, 2]) > 3.0 * x.stiffness:
            drop.append(x)
    if any(x not in rated for x in drop):
        start = Result(timeless(case, drop))
    return Change(start.case, back=start.motion), start


def timeless(case: Case, drop: list[Any]) -> Case:
    loads = tuple(x for x in case.mechanism.loads if x not in drop)
    effects = tuple(e for e in case.mechanism.effects if e != "friction")
    return replace(case, mechanism=replace(case.mechanism, loads=loads, effects=effects), stops=(), watches=())


def search(kind: str, seed: int) -> tuple[str, str, float, float]:
    """The change and the quantity with the worst deviation, that over what is allowed, and the condition of the equations."""
    for travel in REACHES:
        case = draw(kind, seed, travel=travel)
        try:
            base = Result(case)
        except MechanismError:
            continue
        condition = float(np.nanmax(base.motion.condition))
        if not condition < HOPELESS:
            continue
        break
    else:
        return "refused", "", 0.0, np.inf
    allowed = SAME * max(1.0, condition / WELL) ** 2
    worst = ("", "", 0.0)
    for how in CHANGES:
        change, start = changed(case, how, base)
        try:
            found = differences(change, start, Result(change.made()))
        except MechanismError as error:
            if how == "backwards" and "dead point" in str(error):  # where it ends no motion can start by that coordinate
                continue
            return how, f"refused: {error}", np.inf, condition
        name, deviation = max(found.items(), key=lambda x: x[1])
        if deviation / allowed > worst[2]:
            worst = (how, name, deviation / allowed)
    return (*worst, condition)


@pytest.mark.parametrize("kind", KINDS)
def test_results_do_not_depend_on_how_a_mechanism_is_described(kind: str, random_seeds: Any) -> None:
    results = [(seed, *search(kind, seed)) for seed in random_seeds(len(KINDS), KINDS.index(kind))]
    wrong = [f"{kind} {seed}: {how}, {name} {ratio:.1e} of what is allowed" for seed, how, name, ratio, _ in results if ratio > 1.0]
    assert not wrong, wrong
    assert sum(how == "refused" for _, how, *_ in results) <= 0.4 * len(results) + 2
