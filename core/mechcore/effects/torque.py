"""An applied free moment on a link, constant or by a drive's position."""

from __future__ import annotations

from ..motion import Motion
from ..spec import Torque
from .force import factor
from .wrench import Wrench


def wrench(motion: Motion, load: Torque) -> Wrench:
    k = motion.model.index[load.link]
    return Wrench(
        name=load.name,
        kind="torque",
        link=k,
        force=0j,
        moment=load.moment * factor(motion, load),
        arm=0j,
        local=0j,
    )
