"""Waypoints of a motion whose drives have any positions, as forces lead them where a mechanism has several freedoms.

Where groups have no closed form, or relations need whole turns, positions alone do not say where the mechanism is: it depends on
the path. The integration leaves waypoints; a place between two of them is reached in small steps from the one before it.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import blocks as bl
from .assembly import Assembly
from .model import Model
from .positions import place_all

__all__ = ["Starts", "Way", "Waypoint", "steps_of"]

Array = Any
Real = NDArray[np.float64]
Starts = Mapping[str, Real]

STEP = {"angle": 0.2, "slide": 0.1}  # of a drive, between two places on a path: [rad], or part of the mechanism's size
MOST = 200  # steps from a waypoint: what lies farther off is a trial of the integrator's


def steps_of(model: Model) -> Real:
    """Steps of the drives (d,) [rad or m] that are short enough to follow positions and angles."""
    joints = [model.joints[model.joint_index[d.pair]] for d in model.mechanism.drives]
    return np.array([STEP["angle"] if j.coordinate == "angle" else STEP["slide"] * model.size for j in joints])


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A place of a motion: time [s] and positions of the drives (d,). Once they are known: angles of the spins (s,), and starts of
    the groups that have to be followed, as in `Assembly`."""

    time: float
    drives: Real
    spins: Real | None = None
    starts: Starts | None = None


class Way:
    """Waypoints in order of time, the first of which is known."""

    def __init__(self, at: Waypoint):
        self._points: tuple[list[float], list[Waypoint]] = [at.time], [at]  # replaced as one: another thread may ask

    def leave(self, waypoints: Sequence[Waypoint]) -> None:
        """Go on through waypoints; those of a later time than the first of them are given up."""
        times, points = self._points
        keep = max(bisect_right(times, waypoints[0].time), 1)
        if keep < len(times):
            times, points = times[:keep], points[:keep]
            self._points = times, points
        points.extend(waypoints)
        times.extend(w.time for w in waypoints)

    def before(self, time: Real) -> tuple[list[Waypoint], NDArray[np.intp]]:
        """All waypoints, and the number of the last one before each of the times (n,); the first one where there is none."""
        times, points = self._points
        first = max(bisect_left(times, float(time.min())) - 1, 0)
        later = np.array(times[first : bisect_left(times, float(time.max()))] or times[:1])
        return points, first + np.maximum(np.searchsorted(later, time, side="left") - 1, 0)

    def starts(self, model: Model, assembly: Assembly, time: Real, drives: Real) -> Starts:
        """Starts of the groups that have to be followed, at times (n,) and positions of the drives (n, d)."""
        points, before = self.before(time)
        last = int(before.max())
        known = next(k for k in range(last, -1, -1) if points[k].starts is not None)
        for k in range(known, last):
            a, b = points[k], points[k + 1]
            first = {name: np.asarray(x)[None] for name, x in (a.starts or {}).items()}
            found = _reached(model, assembly, a.drives[None], first, b.drives[None])
            points[k + 1] = replace(b, starts={name: x[0] for name, x in found.items()})
        used, which = np.unique(before, return_inverse=True)
        at = [points[k].starts or {} for k in used]
        starts = {name: np.array([s[name] for s in at])[which] for name in at[0]}
        return _reached(model, assembly, np.array([points[k].drives for k in used])[which], starts, drives)


def _reached(model: Model, assembly: Assembly, first: Real, starts: Starts, drives: Real) -> Starts:
    """Starts at positions of the drives (n, d), reached from others (n, d) whose ``starts`` are known, all in as many steps."""
    with np.errstate(invalid="ignore"):
        far = np.nan_to_num(np.abs(drives - first) / steps_of(model)).max(initial=0.0)
    count = int(np.clip(np.ceil(far), 1, MOST))
    for k in range(1, count + 1):
        q = first + k / count * (drives - first)
        state = place_all(model, list(q.T), assembly.modes, starts, constants=assembly.constants)
        found = {name: newton.x for name, newton in state.newton.items()}
        starts = found | {f"angle {g}": np.broadcast_to(bl.real_angle(model, state, g), len(q)) for g in model.wound}
    return starts
