"""The solids of a solved scene."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mechcore.clearance import journals_of

from .accuracy.kept import PROFILE

if TYPE_CHECKING:
    from .meshes import Solids
    from .run import Run

__all__ = ["solids_of"]

LOOKS = 721
"""Frames that the search for colliding solids looks at; more would cost time and find nothing else."""


def solids_of(run: Run) -> Solids:
    """Meshes of all links, in layers that do not collide during the run."""
    from .meshes import build_solids
    from .tables import links_of

    motion = run.motion
    frames = np.unique(np.linspace(0, motion.frames - 1, min(motion.frames, LOOKS)).round().astype(int))
    dials = run.kept
    poses = {link: motion.pose(link)[frames] for link in links_of(motion)}
    solids = build_solids(motion.mechanism, poses, chord=dials.chord, profile=dials.profile or PROFILE)
    loose = [{load.links[0], load.links[2]} for load in journals_of(motion.model.mechanism).values()]
    # a journal strikes its bearing, and is drawn as wide as that
    return replace(solids, clashes=tuple(c for c in solids.clashes if set(c) not in loose)) if loose else solids
