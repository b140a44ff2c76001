"""How a law of time goes on beyond its first cycle: whether it ends, and when its velocity jumps, within a cycle or between two."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from mechcore.errors import Fault
from mechcore.laws.factors import VELOCITY_JUMP
from mechcore.laws.program import CurveOverMaster
from mechcore.laws.timed import ConstantSpeed, Law, TableLaw

BESIDE = 1e-11  # of a cycle: times at which a law changes its form are known better than that
SAMPLES = 257  # of a cycle, for its largest velocity


def end_time(law: Law) -> float:
    """Time [s] beyond which a law says nothing, as a table that does not repeat; infinite where it goes on."""
    if isinstance(law, CurveOverMaster):
        return end_time(law.master)
    ends = (isinstance(law, TableLaw) and not law.periodic) or (isinstance(law, ConstantSpeed) and law.ends)
    return law.duration if ends else math.inf


def first_velocity_jump(law: Law, until: float) -> float | None:
    """The first time [s], later than zero and before ``until``, at which the velocity of a law jumps; None where it does not."""
    cycle = law.duration
    if not math.isfinite(cycle):
        return None
    times = np.unique([*law.breaks, cycle])  # a cycle like the first follows
    times = times[(times > 0.0) & (times < until * (1.0 - BESIDE))]
    if not len(times):
        return None
    step = BESIDE * cycle
    size = np.abs(law(np.linspace(0.0, cycle, SAMPLES))[1]).max()
    (_, before, rising), (_, after, risen) = law(times - step), law(times + step)
    leap = np.abs((after - step * risen) - (before + step * rising))
    knocks = times[leap > VELOCITY_JUMP * size]
    return float(knocks[0]) if len(knocks) else None


def early_end_faults(laws: Mapping[str, Law], duration: float) -> Iterator[Fault]:
    """Laws, by what follows them, that end before a motion under forces of a ``duration`` [s] does."""
    for path, law in laws.items():
        end = end_time(law)
        if duration > end * (1.0 + 1e-9):
            why = f"{duration:.6g} s are wanted, and {path} ends after {end:.6g} s."
            yield Fault("run.duration", why, f"Give at most {end:.6g} s, or a law that goes on.")


def velocity_jump_faults(laws: Mapping[str, Law], duration: float) -> Iterator[Fault]:
    """Laws of drives whose velocity jumps within a motion under forces of a ``duration`` [s]: the impact is not computed."""
    for path, law in laws.items():
        knock = first_velocity_jump(law, min(duration, end_time(law)))
        if knock is not None:
            why = f"its speed jumps at {knock:.6g} s: on what forces move it would be an impact, which is not computed."
            remedy = f"Choose laws of continuous velocity, end at the speed of the start, or run at most {knock:.6g} s."
            yield Fault(path, why, remedy)
