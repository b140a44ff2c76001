"""Whether a machine has returned to its initial state after a cycle: its masses and loads do the same in the next one.

The powers of all forces are compared at the same positions in two cycles. They show what matters: a balanced wheel may be in any
position, a crank may not; gas and tables must have returned, too.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.errors import Fault, MechanismError
from mechcore.forces.kinetostatics import Forces
from mechcore.laws.signals import Sine
from mechcore.laws.timed import Table, TableLaw
from mechcore.spec.loads import Load, Prescribed

SAMPLES = 240  # positions in a span that are compared
FEW = 8  # of them, at which all numbers of cycles are tested
BETWEEN = 0.618  # part of a step by which they lie off even steps, away from jumps
SAME = 1e-6  # part of the largest power: a smaller difference is rounding
SETTLED = 0.05  # part of the mechanism's size and of the largest velocity: a motion under forces has returned within it
MOST_CYCLES = 120  # numbers of cycles that are tested for a return


def check_back(
    forces: Callable[[Real], Forces],
    span: float,
    cycle: float,
    fault: Callable[[str, int | None], Fault],
    beside: frozenset[str] = frozenset(),
) -> None:
    """Refuse a ``span`` after which a machine has not returned to its initial state. ``forces``: gives those at positions (n,) from
    0 on; loads in ``beside`` do not count. ``fault`` gets words for what has not returned, and the least number of cycles after
    which it has, or None."""
    x = span * (np.arange(SAMPLES) + BETWEEN) / SAMPLES
    first = forces(x)
    before, limit = _powers(first, beside), SAME * first.power_residual[1]

    def same(power: Real, there: Real) -> Flags:
        return np.isclose(power, there, rtol=0.0, atol=limit, equal_nan=True)

    def moved(later: float) -> str | None:
        after = _powers(forces(x + later), beside)
        return next((words for (words, p), (_, q) in zip(before, after, strict=True) if not same(q, p).all()), None)

    words = moved(span)
    if words is None:
        return
    few = slice(None, None, SAMPLES // FEW)
    later = _powers(forces((x[few] + cycle * np.arange(1, MOST_CYCLES + 1)[:, None]).ravel()), beside)
    back = [same(q.reshape(MOST_CYCLES, FEW), p[few]).all(axis=1) for (_, p), (_, q) in zip(before, later, strict=True)]
    cycles = (int(k) for k in np.flatnonzero(np.all(back, axis=0)) + 1)
    raise MechanismError(fault(words, next((k for k in cycles if moved(k * cycle) is None), None)))


def _powers(forces: Forces, beside: frozenset[str]) -> list[tuple[str, Real]]:
    """Powers (n,) [W] of inertia, weights, friction and loads but those ``beside``, each with words for what it acts on."""
    links, powers = forces.motion.model.links, []
    for w, power in forces.powers():
        if w.name not in beside:
            own = w.kind in ("inertia", "gravity")
            powers.append((f"link {links[w.link]}" if own else f"load {w.name} on link {links[w.link]}", power))
    if forces.friction is not None and not beside:  # it depends on all the others
        powers += [(f"friction in joint {joint}", forces.friction.losses(joint)) for joint in forces.friction.joints]
    return powers


def check_run_back(forces: Forces) -> None:
    """Refuse a run for a flywheel after which the machine has not returned to its initial state.

    Loads of time, or of an angle, that do not repeat are taken to repeat with the run. A motion under forces, and one with a drive
    by a table that does not repeat, cannot be followed further: there the masses' positions and velocities are compared."""
    motion = forces.motion
    start, span = float(motion.time[0]), float(np.ptp(motion.time))

    def fault(words: str, cycles: int | None) -> Fault:
        why = f"after the run, of {span:.6g} s, {words} is not as it was at its start: the machine has another period."
        if cycles is None:
            return Fault(
                "flywheel", why, f"No number of cycles up to {MOST_CYCLES} brings it back: change the ratios of its gears."
            )
        return Fault("flywheel", why, f"Run {cycles} cycles of the drive: mechviz forces --cycles {cycles}.")

    laws = [d.law for d in motion.mechanism.drives]
    if forces.jumps is None and motion.at_times and not any(isinstance(x, TableLaw) and not x.periodic for x in laws):
        beside = frozenset(load.name for load in motion.mechanism.loads if _runs_out(load, forces))
        check_back(lambda x: forces.at_times(start + x), span, motion.mechanism.cycle, fault, beside)
        return
    model = motion.model
    masses = [link for link, (mass, *_) in zip(model.links[1:], model.masses[1:], strict=True) if np.any(mass)]
    speeds = {link: motion.centre_of_mass(link, 1) for link in masses}
    fastest = max((float(np.abs(v).max()) for v in speeds.values()), default=0.0)
    for link, v in speeds.items():
        c = motion.centre_of_mass(link)
        if np.abs(c[-1] - c[0]).max() > SETTLED * model.length_scale or np.abs(v[-1] - v[0]).max() > SETTLED * fastest:
            why = f"at the end of the run, of {span:.6g} s, link {link} is not where it was at its start."
            raise MechanismError(Fault("flywheel", why, "Let the run be one cycle of the machine after it has settled."))


def _runs_out(load: Load, forces: Forces) -> bool:
    """Whether a load depends on time, or on an angle, by a function that does not repeat."""
    factor = load.factor if isinstance(load, Prescribed) else None
    if factor is None or isinstance(factor.function, Sine) or getattr(factor.function, "period", None) is not None:
        return False
    if factor.of == "time":
        return True
    model = forces.motion.model
    joint = factor.joint or model.mechanism.drives[0].joint
    return factor.of == "position" and isinstance(factor.function, Table) and model.rotary(joint)
