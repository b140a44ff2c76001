"""Effects: forces that a scene can ask for. Each says which wrench it puts on which link; what is not named is not computed.

To add an effect: one file here with a function ``wrenches(motion) -> list[Wrench]``, one line in `REGISTRY` or `LOADS`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..motion import Motion
from ..spec import Force, Torque
from . import force, gravity, inertia, torque
from .wrench import Wrench

__all__ = ["LOADS", "REGISTRY", "Wrench", "wrenches"]

REGISTRY: dict[str, Callable[[Motion], list[Wrench]]] = {
    "inertia": inertia.wrenches,
    "gravity": gravity.wrenches,
}
LOADS: dict[type, Callable[[Motion, Any], Wrench]] = {
    Force: force.wrench,
    Torque: torque.wrench,
}


def wrenches(motion: Motion) -> list[Wrench]:
    """All wrenches that the mechanism's effects and loads put on its links."""
    out: list[Wrench] = []
    for name in motion.mechanism.effects:
        out += REGISTRY[name](motion)
    return out + [LOADS[type(load)](motion, load) for load in motion.mechanism.loads]
