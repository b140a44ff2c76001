"""Everything that is drawn in 3D: solids, arrows, paths, names, ground, and the camera that looks at it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import viser
from numpy.typing import NDArray

from ..linkers import find_linkers
from ..meshes import build_solids
from ..run import Run
from ..vectors import calm_frames, find_moments, find_scales, find_vectors
from .arrows3d import ArrowNodes
from .camera import FittedCameras, set_first_view
from .linkers3d import LinkerNodes
from .marks3d import JointNames, Paths
from .plans3d import PlanNodes
from .solids3d import SolidNodes
from .stage import set_stage

__all__ = ["Scene3D"]

FRAMES_FOR_LAYERS = 721
SHOWN_FIRST = ("reaction", "applied", "inertia", "friction", "drive")


class Scene3D:
    """The picture of a run; ``show`` brings it to a frame. Only the player's thread calls ``show``."""

    def __init__(self, server: viser.ViserServer, run: Run):
        motion = run.motion
        # the order of the layers follows from how the links pass each other; for that a part of a long run is enough
        some = np.unique(np.linspace(0, motion.frames - 1, min(motion.frames, FRAMES_FOR_LAYERS)).round().astype(int))
        solids = build_solids(motion.mechanism, {link.name: motion.pose(link.name)[some] for link in motion.mechanism.links})
        self.size = solids.size
        self.traced = tuple(point for _, point in motion.mechanism.traced)
        vectors, moments = find_vectors(run), find_moments(run)
        self.scales = find_scales(vectors, moments, solids.size, calm_frames(run))
        with server.atomic():
            grid = set_stage(server, solids.bounds, solids.size)
            self._links = SolidNodes(server, motion, solids)
            self.arrows = ArrowNodes(server, run, vectors, moments, self.scales, solids.heights)
            self._paths = Paths(server, run, solids.heights)
            self._linkers = LinkerNodes(server, list(find_linkers(run, solids.size)), solids.z_top + 0.01 * solids.size)
            self._names = JointNames(server, motion, solids.size, solids.z_top + 0.04 * solids.size)
            self.plans = PlanNodes(server, run, solids)
        for family in SHOWN_FIRST:
            if family in self.arrows.families:
                self.arrows.switch(family, True)
        self.bounds = _joined(solids.bounds, self.arrows.reach(), 0.15 * solids.size)
        if self.plans.bounds is not None:
            self.bounds[0, :2] = np.minimum(self.bounds[0, :2], self.plans.bounds[0])
            self.bounds[1, :2] = np.maximum(self.bounds[1, :2], self.plans.bounds[1])
        set_first_view(server, self.bounds)
        self.marks: Mapping[str, Callable[[bool], None]] = {
            **({"Paths": self._paths.switch} if len(self._paths) else {}),
            **({"Springs and dampers": self._linkers.switch} if len(self._linkers) else {}),
            **{name: partial(self.plans.switch, name) for name in self.plans.constructions},
            "Joint names": self._names.switch,
            "Grid": lambda on: setattr(grid, "visible", on),
        }
        self._cameras = FittedCameras(server, self.bounds)
        server.on_client_connect(self._greet)
        server.on_client_disconnect(self._part)

    def show(self, frame: int) -> None:
        """Bring everything to a frame, in one piece for the browsers."""
        self._links.show(frame)
        self.arrows.show(frame)
        self._paths.show(frame)
        self._linkers.show(frame)
        self._names.show(frame)
        self.plans.show(frame)

    def switch_mark(self, name: str, on: bool) -> None:
        """Show or hide one of ``marks``."""
        self.marks[name](on)

    def look_from_front(self, client: viser.ClientHandle) -> None:
        """Bring a browser's camera back to the front, fitted to its window."""
        self._cameras.look_from_front(client)

    async def _greet(self, client: viser.ClientHandle) -> None:
        self._cameras.follow(client)

    async def _part(self, client: viser.ClientHandle) -> None:
        self._cameras.forget(client)


def _joined(bounds: NDArray[np.float64], arrows: NDArray[np.float64] | None, most: float) -> NDArray[np.float64]:
    """The box of the solids (2, 3) with that of the arrows (2, 2), as far as that reaches beyond it by no more than ``most``."""
    wider = np.array(bounds, float)
    if arrows is not None:
        wider[0, :2] = np.minimum(bounds[0, :2], np.maximum(arrows[0], bounds[0, :2] - most))
        wider[1, :2] = np.maximum(bounds[1, :2], np.minimum(arrows[1], bounds[1, :2] + most))
    return wider
