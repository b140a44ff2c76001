"""The solids of a solved scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mechviz.accuracy.kept import PROFILE
from mechviz.picture.meshes.solids import Solids, build_solids
from mechviz.quantities.items import links_of

if TYPE_CHECKING:
    from mechviz.runs import Run


LOOKS = 721
"""Frames that the search for colliding solids looks at; more would cost time and find nothing else."""


def solids_of(run: Run) -> Solids:
    """Meshes of all links, in layers that do not collide during the run."""
    motion = run.motion
    frames = np.unique(np.linspace(0, motion.frames - 1, min(motion.frames, LOOKS)).round().astype(int))
    dials = run.kept
    poses = {link: motion.pose(link)[frames] for link in links_of(motion)}
    return build_solids(motion.mechanism, poses, chord=dials.chord, profile=dials.profile or PROFILE)
