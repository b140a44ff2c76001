"""Point masses that a scene fixes to its links (counterweights, lumped models), drawn as balls that move with the link."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..scene.bodies import lumps_of
from ..scene.convert import Converter
from .paths import entity
from .streams import Static

if TYPE_CHECKING:
    from ..meshes import Solids
    from ..run import Run

__all__ = ["lump_shapes"]

BALL = (228, 196, 96)
LARGEST = 0.045  # radius of the heaviest, in sizes of the mechanism


def lump_shapes(run: Run, solids: Solids) -> Iterator[Static]:
    """Balls under the links' own transforms, their volumes in the ratio of the masses."""
    import rerun as rr

    document = run.scene.document
    points = {link.name: link.points for link in run.motion.mechanism.links}
    convert = Converter.of(document.units, run.scene.folder)
    found = {k: lumps_of(link.lumps, points[k], convert, k) for k, link in document.links.items() if link.lumps}
    heaviest = max((b.mass for bodies in found.values() for b in bodies), default=0.0)
    if heaviest <= 0.0:
        return
    for name, bodies in found.items():
        at = np.array([(*b.centre, solids.z_top) for b in bodies], np.float32)
        radii = [LARGEST * solids.size * (b.mass / heaviest) ** (1.0 / 3.0) for b in bodies]
        labels = [f"{b.mass:.4g} kg" for b in bodies]
        yield Static(
            entity("mechanism", "links", name, "lumps"),
            rr.Points3D(at, colors=[BALL], radii=radii, labels=labels, show_labels=True),
        )
