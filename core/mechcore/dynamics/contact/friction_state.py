"""Dry friction in the course of a motion: what slides which way at present, whatever contacts come and go."""

from __future__ import annotations

from typing import Any

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.contact.dry_friction import DrySystem
from mechcore.dynamics.contact.phases import WORDS, Key, Phases, keys_of, rubbing, senses
from mechcore.dynamics.equations.reduced import motion_at
from mechcore.dynamics.events import Log, SimulationEvent
from mechcore.dynamics.integration.collocation import Window
from mechcore.forces.friction.elements import elements_of
from mechcore.motion.compiled import Compiled

BACK = 10.0  # windows shorter than so many times `soon` are those of prescribed drives that turn back


class FrictionState:
    """The phases of the present mechanism's friction, and which way every element slides (0: sticks), told in a ``log``.

    ``counts``: whether the mechanism names friction among its effects. ``soon`` [s]: as in `Phases`.
    """

    def __init__(self, counts: bool, soon: float, log: Log):
        self.counts, self._soon, self._log = counts, soon, log
        self._phases: Phases | None = None
        self._sliding: dict[Key, float] = {}

    def begin(self, compiled: Compiled, t: float, q: Real, v: Real) -> None:
        """Friction of a mechanism that has other contacts than before: what slides goes on. Where every drive is prescribed
        nothing has to be found; statics tells friction. Raises `MechanismError`."""
        self._phases = self._phases_of(compiled, t, q, v)

    def _phases_of(self, compiled: Compiled, t: float, q: Real, v: Real) -> Phases | None:
        return rubbing(compiled, q, v, t, self._sliding, self._soon) if self.counts and len(q) else None

    def system(self) -> DrySystem | None:
        """The equations of motion at present; None where friction decides nothing."""
        return None if self._phases is None else self._phases.system()

    def equations_of(self, compiled: Compiled, q: Real, v: Real, t: float, *, rests: tuple[str, ...]) -> DrySystem | None:
        """The equations of motion at an instant of a mechanism with other contacts; None where it has no friction."""
        phases = self._phases_of(compiled, t, q, v)
        if phases is None:
            return None
        phases.decide(t, q, v, rests=rests)
        return phases.system()

    def slip_ends(self) -> tuple[list[tuple[Any, bool]], list[Any]]:
        """What ends the slip of elements, and that of prescribed ones: as `Phases.slip_ends` and
        `Phases.independent_event_functions` say it."""
        return ([], []) if self._phases is None else (self._phases.slip_ends(), self._phases.independent_event_functions())

    def stick_ends(self, q: Real, v: Real, t: float) -> list[tuple[Any, float, tuple[int, float]]]:
        """What ends the sticking of elements, as in `Phases.stick_ends`."""
        return [] if self._phases is None else self._phases.stick_ends(q, v, t)

    def settle(self, t: float, q: Real, v: Real, rests: tuple[str, ...], loose: tuple[int, float] | None = None) -> Real:
        """Decide what slides and what sticks from now on, joints ``rests`` resting on stops, ``loose`` as in `Phases.decide`;
        speeds (f,) after it: nothing is left of what sticks."""
        if self._phases is None:
            return v
        for joint, word in self._phases.decide(t, q, v, loose, rests):
            self._tell(t, joint, word)
        self._sliding |= dict(zip(self._phases.keys, self._phases.signs, strict=True))
        return self._phases.at_rest(t, q, v)

    def follow(self, compiled: Compiled, window: Window) -> None:
        """Where every drive is prescribed, say which way joints slide in a window; it ends where that changes."""
        if not self.counts:
            return
        middle = np.array([window.start + 0.5 * window.length])
        motion = motion_at(compiled, *window(middle)[:2], middle)
        turning = window.length < BACK * self._soon  # there it is at rest for nothing but an instant
        for key, sign in zip(keys_of(elements_of(motion)), senses(motion)[0], strict=True):
            if sign != self._sliding.get(key, 0.0) and not (turning and sign == 0.0):
                self._tell(window.start, key[0], WORDS[float(sign)])
                self._sliding[key] = float(sign)

    def _tell(self, t: float, joint: str, word: str) -> None:
        """A joint begins to stick or to slide."""
        kind = "stick" if word == "stick" else "slip"
        text = f"{joint} sticks" if kind == "stick" else f"{joint} slides in the {word[-1]} direction"
        found = SimulationEvent(t, kind, joint, text)
        if found not in self._log.events[-4:]:  # a joint may have friction of several kinds
            self._log.tell(found)
