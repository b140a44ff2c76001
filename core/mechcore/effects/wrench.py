"""A force and a moment on a link, over all frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

__all__ = ["Wrench"]

Array = Any


@dataclass(frozen=True, eq=False)
class Wrench:
    """``force`` (complex, (F,) or one value) [N] acting at ``arm`` from the link's origin (world axes) [m], and a free moment."""

    name: str
    kind: str  # "inertia", "gravity", "force", "torque"
    link: int
    force: Array
    moment: Array
    arm: Array
    local: complex  # the point of action in link axes [m]
