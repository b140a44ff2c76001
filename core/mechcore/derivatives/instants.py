"""Breakpoints of laws, by load and by drive; and mechanisms in which some laws keep the form that they had before a breakpoint.

Several laws may have a breakpoint at one instant, and a parameter may move only one of these. Between the two the motion then
continues with one change of form and without the other. Without friction and contacts accelerations are sums over the forces, so
that the effect of each change does not depend on the order.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.equations.charts import Chart
from mechcore.dynamics.equations.reduced import motion_at
from mechcore.dynamics.segments import segment_forces
from mechcore.dynamics.simulation import powers_of
from mechcore.effects.registry import effects_of
from mechcore.laws.timed import Free, Law, Piecewise, next_break
from mechcore.motion.compiled import Compiled
from mechcore.records import dataclass
from mechcore.spec.loads import Prescribed, Servo
from mechcore.spec.mechanism import Mechanism

Source = tuple[str, str]  # "drive" and its joint, or "load" and its name


def stated_instants(compiled: Compiled, until: float) -> dict[Source, Real]:
    """Breakpoints (n,) [s] of laws, after the start and before ``until``, by source, for each source that has some."""
    mechanism = compiled.mechanism
    found: dict[Source, set[float]] = {}
    for drive in mechanism.drives:
        if not isinstance(drive.law, Free):
            found["drive", drive.joint] = _breaks(drive.law, until)
    for effect in effects_of(mechanism):
        times = {float(t) for t in effect.breaks if 0.0 < t < until}
        found["load", effect.name] = times.union(*(_breaks(law, until) for law in effect.laws))
    return {source: np.array(sorted(times)) for source, times in found.items() if times}


def _breaks(law: Law, until: float) -> set[float]:
    times: set[float] = set()
    if not (law.breaks or isinstance(law, Piecewise)):
        return times
    t = next_break(law, 0.0)
    while t < until:
        times.add(t)
        t = next_break(law, t)
    return times


@dataclass(frozen=True, eq=False)
class _Held:
    """A law that from the time ``until`` on keeps its values of that time."""

    law: Any
    until: float

    @property
    def breaks(self) -> tuple[float, ...]:
        return ()

    @property
    def duration(self) -> float:
        return float(self.law.duration)

    def __call__(self, t: Any, *derivative: int) -> Any:
        return self.law(np.minimum(t, self.until), *derivative)


def _held(mechanism: Mechanism, sources: Collection[Source], until: float) -> Mechanism:
    def load(x: Any) -> Any:
        if ("load", x.name) not in sources:
            return x
        if isinstance(x, Servo):
            return replace(x, target=_Held(x.target, until))
        assert isinstance(x, Prescribed) and x.factor is not None  # nothing else depends on time
        return replace(x, factor=replace(x.factor, function=_Held(x.factor.function, until)))

    drives = tuple(replace(d, law=_Held(d.law, until)) if ("drive", d.joint) in sources else d for d in mechanism.drives)
    return replace(mechanism, loads=tuple(map(load, mechanism.loads)), drives=drives)


def with_changes(compiled: Compiled, t: float, q: Real, v: Real) -> Callable[[Collection[Source]], tuple[Real, Real]]:
    """A function from sources to accelerations (f + s,) and powers (3,), see `powers_of`, just after an instant at a state
    (f + s,), with these sources in the form that they had before it."""
    before, after = t - 8.0 * np.spacing(t), t + 8.0 * np.spacing(t)
    rows = q[None], v[None], np.array([after])

    def those(held: Collection[Source]) -> tuple[Real, Real]:
        model = replace(compiled.model, mechanism=_held(compiled.mechanism, held, float(before)))
        own = replace(compiled, model=model, executor="numpy")
        system = Chart(own)
        a = np.asarray(system(*rows), float)
        motion = motion_at(own, *rows, a)
        return a[0], powers_of(motion, segment_forces(motion, system, *rows[:2], ()))[0]

    return those
