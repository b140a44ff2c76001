"""Event triggers during a motion: when their values are passed, and whether one of them has ended the motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.equations.reduced import motion_at
from mechcore.dynamics.events import (
    EventFunction,
    EventKind,
    EventTrigger,
    Log,
    PossibleEvent,
    SimulationEvent,
    event_function_of,
    first_zero,
)
from mechcore.motion.compiled import Compiled


class Watch:
    """The triggers of a motion; their events are recorded in a ``log``. ``ended``: a trigger has ended the motion."""

    def __init__(self, triggers: Sequence[EventTrigger], log: Log):
        self.triggers, self._log = tuple(triggers), log
        self.ended = False

    def use(self, compiled: Compiled, coordinates: Mapping[str, int]) -> None:
        """Continue in another chart, ``coordinates``: the number of each free joint's coordinate."""
        self._compiled = compiled
        self._functions = [event_function_of(x, dict(coordinates), partial(motion_at, compiled)) for x in self.triggers]

    def possible_events(self, after: float) -> list[PossibleEvent]:
        """Passages later than ``after`` [s]."""
        return [
            PossibleEvent(partial(first_zero, function, after=after, rising=trigger.rising), partial(self._pass, trigger))
            for trigger, function in zip(self.triggers, self._functions, strict=True)
        ]

    def record_jumps(self, t: float, q: Real, before: Real, after: Real) -> None:
        """Record the velocity triggers that an impact at ``t`` [s] carries past their values, as it changes the rates (f,) at q
        (f,)."""
        for trigger, function in zip(self.triggers, self._functions, strict=True):
            if trigger.of == "velocity" and t > 0.0 and not self.ended:
                low, high = self._side(function, t, q, before), self._side(function, t, q, after)
                if low * high < 0.0 and (trigger.rising is None or (high > 0.0) == trigger.rising):
                    self._pass(trigger, t, q, after)

    @staticmethod
    def _side(function: EventFunction, t: float, q: Real, v: Real) -> float:
        return float(np.sign(function(q[None], v[None], np.array([t]))[0]))

    def _pass(self, trigger: EventTrigger, t: float, q: Real, v: Real) -> tuple[Real, Real]:
        rotary = trigger.joint is not None and self._compiled.model.rotary(trigger.joint)
        kind = EventKind.END if trigger.ends else EventKind.TRIGGER
        self._log.add(SimulationEvent(t, kind, trigger.name, trigger.passed(rotary=rotary)))
        self.ended = self.ended or trigger.ends
        return q, v
