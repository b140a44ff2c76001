"""Numbers of a run or a recording read between its frames, by the order of interpolation that its accuracy states.

A pose has the recorded velocity and acceleration as slopes, a velocity the acceleration; coordinates of joints and drives have
their rates beside them in their own columns. What has no rates is joined by polynomials through the nearest frames.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mechcore.arrays import Real
from mechcore.numerics.interpolation import between

Path = tuple[str, ...]

_RATES = {"pose": ("velocity", "acceleration"), "position": ("velocity", "acceleration"), "velocity": ("acceleration", None)}


def slopes_of(path: Path) -> tuple[Path | None, Path | None]:
    """Entities that hold the first and the second derivative of one; None where there are none."""
    if path[:1] != ("data",) or path[1] not in ("links", "points") or path[-1] not in _RATES:
        return None, None
    first, second = _RATES[path[-1]]
    return (*path[:-1], first), (*path[:-1], second) if second else None


def read_between(path: Path, time: Real, values: Callable[[Path], Real | None], t: Real, order: int) -> Real:
    """Values (n, m) of an entity at times ``t`` (n,) [s] from those (F, m) at the frames' times (F,); ``values`` looks entities up.

    Outside the run the values are those of its ends. Raises KeyError for an entity that is not there.
    """
    own = values(path)
    if own is None:
        raise KeyError("/" + "/".join(path))
    t = np.clip(np.asarray(t, float), time[0], time[-1])
    if len(time) < 2:
        return np.repeat(own[:1], len(t), axis=0)
    first, second = (None if p is None else values(p) for p in slopes_of(path))
    drive = path[:2] == ("data", "drive") and len(path) == 3
    joint = path[:2] == ("data", "joints") and path[-1] == "motion"
    if not (drive or joint):
        return between(time, own, t, order, first, second)
    coordinate = between(time, own[:, :1], t, order, own[:, 1:2], own[:, 2:3])
    speed = between(time, own[:, 1:2], t, order, own[:, 2:3])
    return np.hstack([coordinate, speed, between(time, own[:, 2:], t, order)])
