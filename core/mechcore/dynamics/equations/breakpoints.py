"""Where the law of a force changes its form: windows of the integration end there, so that in each all forces are smooth."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Real
from mechcore.dynamics.contact.friction_state import senses
from mechcore.dynamics.equations.program import Programmed
from mechcore.dynamics.equations.reduced import free_of, motion_at
from mechcore.dynamics.integration.collocation import Window
from mechcore.effects.registry import effects_of
from mechcore.laws.timed import Free, Law, Piecewise
from mechcore.motion.compiled import Compiled

SAMPLES = 33  # of a window; a form of the law that holds for less than a thirtieth of it may be missed
_X = (np.arange(SAMPLES) + 0.5) / SAMPLES
_FINE = np.linspace(0.0, 1.0, 97)
ROUNDS = 8  # 96^8 = 7e15 places in a sample; many places cost hardly more than few


class Breakpoints(Programmed):
    """Where the law of some force or cam changes its form. Switching points in time that loads and the laws of drives state are
    taken as they are; all else is looked for along a window."""

    def __init__(self, compiled: Compiled):
        self.compiled = compiled
        laws = [d.law for d in compiled.mechanism.drives if not isinstance(d.law, Free)]
        laws += [law for e in effects_of(compiled.mechanism) for law in e.laws]
        self.laws = [law for law in laws if law.breaks or isinstance(law, Piecewise)]
        self.breaks = np.unique([t for e in effects_of(compiled.mechanism) for t in e.breaks])
        self.effects = [e for e in effects_of(compiled.mechanism) if e.piecewise]
        self.cams = [r.geometry for r in compiled.model.relations if r.kind == "cam"]
        self.driven = "friction" in compiled.mechanism.effects and not free_of(compiled)  # else friction's phases end segments
        self.searched = bool(self.effects or self.cams or self.driven)

    def stated(self, after: float) -> float:
        """The first time [s] later than another one at which a law says that it changes its form; infinite where none does."""
        k = int(np.searchsorted(self.breaks, after, side="right"))
        found = float(min([*self.breaks[k : k + 1], *(_next_break(law, after) for law in self.laws)], default=np.inf))
        if not np.isfinite(found):
            return found
        return found - 2.0 * float(np.spacing(found))  # the last node of a window that ends there is before it, however rounded

    def _forms(self, window: Window, t: Real) -> Real:
        q, v, _ = window(t)
        program = None if self.cams or self.driven else self.program()
        forms = None if program is None else program.forms(q, v, t)
        if forms is not None:
            return forms
        motion = motion_at(self.compiled, q, v, t)
        found = [*(e.phase(motion) for e in self.effects), *(c.segment(motion) for c in self.cams)]
        found += list(senses(motion).T) if self.driven else []
        return np.stack([np.broadcast_to(x, t.shape) for x in found])

    def __call__(self, window: Window, after: float) -> float | None:
        """The first time [s] in a window, later than another one, at which a law changes its form; None where none does."""
        low, high = max(after, window.start), window.start + window.length
        stated = self.stated(low)
        known = stated if low < stated < high else None
        if not self.searched:
            return known
        high = high if known is None else known
        t = np.concatenate([[low], low + (high - low) * _X, [high]])
        for _ in range(ROUNDS):
            found = self._forms(window, t)
            changed = np.flatnonzero((found[:, 1:] != found[:, :-1]).any(axis=0))
            if not len(changed):
                return known
            k = int(changed[0])
            if not t[k] < t[k + 1] or t[k + 1] - t[k] <= 4.0 * np.spacing(t[k + 1]):
                break
            t = t[k] + (t[k + 1] - t[k]) * _FINE
        return float(t[min(int(changed[0]) + 1, len(t) - 1)])


def breakpoint_finder(compiled: Compiled) -> Breakpoints | None:
    """What finds the breakpoints of a mechanism's laws; None where nothing in it has several forms."""
    found = Breakpoints(compiled)
    return found if found.searched or len(found.breaks) or found.laws else None


def _next_break(law: Law, after: float) -> float:
    """The first time [s] later than ``after`` at which a prescribed drive's acceleration may jump, within cycles or between."""
    begun = np.floor(after / law.duration) * law.duration if np.isfinite(law.duration) else 0.0
    times = begun + np.array([0.0, law.duration])[:, None] + np.array([0.0, *law.breaks])
    return float(times[times > after].min(initial=np.inf))
