"""How far a value can be moved until the mechanism cannot be assembled, is undercut, or is no scene at all."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mechcore.errors import MechanismError
from mechcore.motion.solve import compile_mechanism, solve_motion
from mechviz.runs import run_scene
from mechviz.scene.scene import Scene

STEPS = 12  # from the good value to each end of the range
HALVINGS = 11
FRAMES = 90


def assembles(scene: Scene) -> bool:
    """Whether a scene can be put together and solved over its run, looked at at a few frames; of one in which forces decide the
    motion only the start."""
    try:
        if scene.simulation is not None:
            solve_motion(compile_mechanism(scene.mechanism), np.zeros(1))
            return True
        motion = run_scene(scene, frames=min(FRAMES, scene.frames), outputs=("positions", "forces")).motion
        return all(bool(np.isfinite(motion.pose(link.name)).all()) for link in scene.mechanism.links)
    except MechanismError:
        return False


def reachable(
    good: float, low: float, high: float, holds: Callable[[float], bool], given_up: Callable[[], bool] = lambda: False
) -> tuple[float, float] | None:
    """The range around a ``good`` value, within ``low`` to ``high``, over which ``holds(value)``; None if it was given up.

    Each side is walked in steps until one does not hold; the limit is then found by bisection, from the inside.
    """
    ends = []
    for end in (low, high):
        inside, outside = good, None
        for value in np.linspace(good, end, STEPS + 1)[1:]:
            if given_up():
                return None
            if not holds(float(value)):
                outside = float(value)
                break
            inside = float(value)
        for _ in range(HALVINGS if outside is not None else 0):
            assert outside is not None
            if given_up():
                return None
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if holds(middle) else (inside, middle)
        ends.append(inside)
    return ends[0], ends[1]
