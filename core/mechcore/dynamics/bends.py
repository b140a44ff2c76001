"""Where the law of a force changes its form: windows of the integration end there, so that in each all forces are smooth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..effects import effects_of
from ..laws import Law, Piecewise
from ..solve import Compiled
from .collocation import Window
from .free import Free
from .phases import senses
from .reduced import free_of, motion_at

__all__ = ["bend_finder"]

Array = NDArray[np.float64]
SAMPLES = 33  # of a window; a form of the law that holds for less than a thirtieth of it may be missed
_X = (np.arange(SAMPLES) + 0.5) / SAMPLES
_FINE = np.linspace(0.0, 1.0, 97)
ROUNDS = 8  # 96^8 = 7e15 places in a sample; many places cost hardly more than few


def bend_finder(compiled: Compiled) -> Callable[[Window, float], float | None] | None:
    """Window, time -> the first time [s] in it, later than that, at which the law of some force or cam changes its form; None where
    none does. None at once where nothing in the mechanism has several forms. Switching points in time that loads and the laws of
    drives state are taken as they are; all else is looked for."""
    laws = [d.law for d in compiled.mechanism.drives if not isinstance(d.law, Free)]
    laws += [law for e in effects_of(compiled.mechanism) for law in e.laws]
    laws = [law for law in laws if law.breaks or isinstance(law, Piecewise)]
    breaks = np.unique([t for e in effects_of(compiled.mechanism) for t in e.breaks])
    effects = [e for e in effects_of(compiled.mechanism) if e.piecewise]
    cams = [r.geometry for r in compiled.model.relations if r.kind == "cam"]
    driven = "friction" in compiled.mechanism.effects and not free_of(compiled)  # else friction's phases end pieces
    searched = bool(effects or cams or driven)
    if not (searched or len(breaks) or laws):
        return None

    def forms(window: Window, t: Array) -> Array:
        q, v, _ = window(t)
        motion = motion_at(compiled, q, v, t)
        found = [*(e.phase(motion) for e in effects), *(c.segment(motion) for c in cams)]
        found += list(senses(motion).T) if driven else []
        return np.stack([np.broadcast_to(x, t.shape) for x in found])

    def first(window: Window, after: float) -> float | None:
        low, high = max(after, window.start), window.start + window.length
        stated = min([*breaks[breaks > low][:1], *(_next_break(law, low) for law in laws)], default=np.inf)
        stated -= 2.0 * np.spacing(stated)  # so that the last node of the window is before it, whichever way its time is rounded
        known = float(stated) if low < stated < high else None
        if not searched:
            return known
        high = high if known is None else known
        t = np.concatenate([[low], low + (high - low) * _X, [high]])
        for _ in range(ROUNDS):
            found = forms(window, t)
            changed = np.flatnonzero((found[:, 1:] != found[:, :-1]).any(axis=0))
            if not len(changed):
                return known
            k = int(changed[0])
            if not t[k] < t[k + 1] or t[k + 1] - t[k] <= 4.0 * np.spacing(t[k + 1]):
                break
            t = t[k] + (t[k + 1] - t[k]) * _FINE
        return float(t[min(int(changed[0]) + 1, len(t) - 1)])

    return first


def _next_break(law: Law, after: float) -> float:
    """The first time [s] later than ``after`` at which a prescribed drive's acceleration may jump, within cycles or between."""
    begun = np.floor(after / law.duration) * law.duration if np.isfinite(law.duration) else 0.0
    times = begun + np.array([0.0, law.duration])[:, None] + np.array([0.0, *law.breaks])
    return float(times[times > after].min(initial=np.inf))
