"""An applied force at a point of a link, fixed in the world or turning with the link, constant or by a drive's position."""

from __future__ import annotations

from typing import Any

from ..motion import Motion
from ..spec import Force, Torque
from .wrench import Wrench


def factor(motion: Motion, load: Force | Torque) -> Any:
    """The load's factor over the frames."""
    if load.factor is None:
        return 1.0
    pairs = [d.pair for d in motion.mechanism.drives]
    return load.factor(motion.drives[pairs.index(load.drive) if load.drive is not None else 0][0])


def wrench(motion: Motion, load: Force) -> Wrench:
    k = motion.model.index[load.link]
    local = motion.model.points[k][load.point]
    vector = complex(*load.vector) * factor(motion, load)
    if load.axes == "link":
        vector = vector * motion.rotation(k)
    return Wrench(name=load.name, kind="force", link=k, force=vector, moment=0.0, arm=local * motion.rotation(k), local=local)
