"""Everything that is drawn in 3D: solids, arrows, paths, names, the grid; and the camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
import viser

from mechcore.arrays import Real
from mechviz.outputs.viewer.playback import PointTrack, SentPoses
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.viser_adapter import NodePose, send_poses
from mechviz.outputs.viewer.world.arrows import ArrowNodes
from mechviz.outputs.viewer.world.bodies import BodyNodes, LineNodes
from mechviz.outputs.viewer.world.camera import Backdrop, FittedCameras
from mechviz.outputs.viewer.world.constructions import ConstructionNodes
from mechviz.outputs.viewer.world.labels import prepare
from mechviz.outputs.viewer.world.marks import JointMarks, Masses, Paths, path_segments
from mechviz.outputs.viewer.world.solids import SolidNodes, quaternions
from mechviz.picture.nodes import Body

NAMES_SWITCH = "Joint names"
SHOWN_FIRST = ("reaction", "applied", "inertia", "friction", "drive")
ARROW_ROOM = 0.15  # of the size: arrows widen the view by at most this beyond the solids, ...
FIRST_ARROW_ROOM = 0.4  # ... and the arrows of the frame that is shown first by at most this
FITS_STILL = 0.7  # a view is kept if the mechanism's box has at least this fraction of its extent


def _ignore(_what: object, _event: object) -> None:
    """Ignore a click."""


class Scene3D:
    """The 3D picture; ``show`` brings it to a frame, ``update`` takes another motion. Only the player's thread calls ``show``; the
    caller must not draw during an update."""

    def __init__(
        self,
        server: viser.ViserServer,
        view_model: ViewModel,
        clicked_link: Callable[[str, Any], None] = _ignore,
        clicked_joints: Callable[[tuple[str, ...], Any], None] = _ignore,
        compared: Mapping[str, ViewModel] | None = None,
    ):
        self._server = server
        self.current = view_model
        compared = {} if compared is None else compared
        prepare(server)
        with server.atomic():
            self.stage = Backdrop(server, view_model.bounds, view_model.size, view_model.units)
            self.ghosts = {name: Ghost(server, other, f"/beside_{k}") for k, (name, other) in enumerate(compared.items())}
            self.links = SolidNodes(server, view_model, clicked_link)
            self.arrows = ArrowNodes(server, view_model)
            self._paths = Paths(server, view_model)
            self._lines = LineNodes(server, view_model)
            self._bodies = BodyNodes(server, view_model)
            self._masses = Masses(server, view_model)
            self.joints = JointMarks(server, view_model, clicked_joints)
            self.polygons = ConstructionNodes(server, view_model)
        self._posed: tuple[Any, ...] = (self.links, *self.ghosts.values(), self._paths, self.joints, self._bodies)
        for family in self.arrows.families:
            self.switch_family(family, view_model.picture.marks and family in SHOWN_FIRST)
        self.joints.switch(view_model.picture.marks)
        self.bounds = self._box(view_model)
        self.marks: Mapping[str, Callable[[bool], None]] = {
            "Paths": self._paths.switch,
            **({"Springs and dampers": self._switch_springs} if "springs" in self._lines.groups | self._bodies.groups else {}),
            **({"Point masses": self._masses.switch} if len(self._masses) else {}),
            **{name: partial(self.polygons.switch, name) for name in self.polygons.constructions},
            NAMES_SWITCH: self.joints.switch,
            "Grid": self.stage.switch,
        }
        self._screens: dict[int, tuple[int, int]] = {}
        self.cameras = FittedCameras(server, self.bounds, self._core(view_model), self.stage)
        server.on_client_connect(self._on_connect)
        server.on_client_disconnect(self._on_disconnect)

    @property
    def size(self) -> float:
        """The mechanism's size [m]."""
        return self.current.size

    def update(self, view_model: ViewModel) -> None:
        """Take the solids, the motion and the forces of ``view_model``, that of the same scene with other values."""
        self.current = view_model
        self.links.update(view_model)
        self.arrows.update(view_model)
        self._paths.update(view_model)
        self._lines.update(view_model)
        self._bodies.update(view_model)
        self._masses.update(view_model)
        self.joints.update(view_model)
        self.polygons.update(view_model)

    def refit(self) -> None:
        """After an edit, fit the cameras that no user has moved to the new extent, if the old view no longer fits it."""
        box = self._box(self.current)
        inside = (box[0, :2] >= self.bounds[0, :2] - 1e-12).all() and (box[1, :2] <= self.bounds[1, :2] + 1e-12).all()
        part = np.max((box[1] - box[0])[:2] / (self.bounds[1] - self.bounds[0])[:2])
        if not inside or part < FITS_STILL:
            self.bounds = box
            self.cameras.set_bounds(box, self._core(self.current))

    def fit(self, browser: int, screen: tuple[int, int]) -> None:
        """Take the size [px] of a browser's picture; the drawings beside the mechanism are arranged for the smallest picture."""
        self._screens[browser] = screen
        if self.polygons.fit(min(self._screens.values(), key=min)):
            self.bounds = self._box(self.current)
            self.cameras.set_bounds(self.bounds, self._core(self.current))

    def show(self, frame: int) -> None:
        """Bring everything to a frame, in one piece for the browsers."""
        send_poses(self._server, chain.from_iterable(nodes.poses(frame) for nodes in self._posed))
        self.arrows.show(frame)
        self._lines.show(frame)
        self._bodies.show(frame)
        self.polygons.show(frame)

    def tracks(self) -> tuple[tuple[SentPoses, ...], tuple[PointTrack, ...]] | None:
        """Tracks of everything that moves; None if a construction moves, which only the server can draw."""
        if self.polygons.moves:
            return None
        poses = {name: track for nodes in self._posed for name, track in nodes.tracks().items()}
        frames = self.current.frames
        moving = tuple(SentPoses(name, *track) for name, track in poses.items() if len(track[0]) == frames)
        return moving, (*self.arrows.tracks(), *self._lines.tracks(frames), *self._bodies.stretches())

    def switch_family(self, family: str, on: bool) -> None:
        """Show or hide the arrows of a family and the lines that belong to them."""
        self.arrows.switch(family, on)
        if family in self._lines.groups:
            self._lines.switch(family, on)

    def _switch_springs(self, on: bool) -> None:
        self._lines.switch("springs", on)
        self._bodies.switch("springs", on)

    def cut(self, height: float | None) -> None:
        """Cut away the parts above a height z [m]; None: nothing. Bodies other than plates are hidden as a whole."""
        self.links.cut(height)
        self._bodies.cut(height)

    def darken(self, dark: bool) -> None:
        """Use the colours for a dark or a light page."""
        for part in (self.stage, self._paths, self._lines, self.arrows, self.polygons):
            part.darken(dark)

    def set_preset(self, client: viser.ClientHandle, preset: str) -> None:
        """Move a browser's camera to one of the presets, fitted to the present mechanism."""
        self.bounds = self._box(self.current)
        self.cameras.set_bounds(self.bounds, self._core(self.current))
        self.cameras.set_preset(client, preset)

    def is_marked(self, name: str) -> bool:
        """Whether one of ``marks`` is shown at first."""
        return self.current.picture.marks if name == NAMES_SWITCH else self.polygons.is_on(name)

    def switch_mark(self, name: str, on: bool) -> None:
        """Show or hide one of ``marks``."""
        self.marks[name](on)

    def _box(self, view_model: ViewModel) -> Real:
        box = _joined(view_model.bounds, self.arrows.bounds(), ARROW_ROOM * view_model.size)
        first = _joined(view_model.bounds, self.arrows.bounds(view_model.opening), FIRST_ARROW_ROOM * view_model.size)
        box = np.array([np.minimum(box[0], first[0]), np.maximum(box[1], first[1])])
        for spring in view_model.picture.nodes_of(Body, "springs"):
            low, high = spring.bounds()
            box[0, :2] = np.minimum(box[0, :2], np.maximum(low, view_model.bounds[0, :2] - 0.5 * view_model.size))
            box[1, :2] = np.maximum(box[1, :2], np.minimum(high, view_model.bounds[1, :2] + 0.5 * view_model.size))
        if self.polygons.bounds is not None:
            box[0, :2] = np.minimum(box[0, :2], self.polygons.bounds[0])
            box[1, :2] = np.maximum(box[1, :2], self.polygons.bounds[1])
        return box

    def _core(self, view_model: ViewModel) -> Real:
        """The box that a view must show large: the solids, and the drawings beside them."""
        if self.polygons.bounds is None:
            return view_model.bounds
        beside = np.column_stack([self.polygons.bounds, view_model.bounds[:, 2]])
        return np.array([np.minimum(view_model.bounds[0], beside[0]), np.maximum(view_model.bounds[1], beside[1])])

    async def _on_connect(self, client: viser.ClientHandle) -> None:
        self.cameras.start_fitting(client)

    async def _on_disconnect(self, client: viser.ClientHandle) -> None:
        self.cameras.forget(client)
        self._screens.pop(client.client_id, None)


def _joined(bounds: Real, arrows: Real | None, most: float) -> Real:
    """The box of the solids (2, 3), widened to that of the arrows (2, 2) by at most ``most`` [m] on each side."""
    wider = np.array(bounds, float)
    if arrows is not None:
        wider[0, :2] = np.minimum(bounds[0, :2], np.maximum(arrows[0], bounds[0, :2] - most))
        wider[1, :2] = np.maximum(bounds[1, :2], np.minimum(arrows[1], bounds[1, :2] + most))
    return wider


GHOST_COLOR = (120, 128, 140)
GHOST_OPACITY = 0.28


class Ghost:
    """The links and paths of ``view_model`` in pale grey; made when ``switch`` shows them for the first time."""

    def __init__(self, server: viser.ViserServer, view_model: ViewModel, base: str):
        self._server, self._view_model, self._path = server, view_model, base
        self._nodes: dict[str, viser.FrameHandle] = {}
        self._base: viser.FrameHandle | None = None
        self.on = False

    def switch(self, on: bool) -> None:
        """Show or hide the ghost."""
        self.on = on
        if on and self._base is None:
            self._make()
        if self._base is not None:
            self._base.visible = on

    def poses(self, frame: int) -> Iterator[NodePose]:
        """Poses of its links at a frame, if it is on."""
        if self.on:
            for link, node in self._nodes.items():
                pose = self._view_model.poses[link][min(frame, self._view_model.frames - 1)]
                yield node, np.array([pose[0], pose[1], 0.0]), quaternions(pose[2:])[0]

    def tracks(self) -> dict[str, tuple[Real, Real | None]]:
        """By name of the node: positions (F, 3) and orientations (F, 4) over the frames."""
        if not self.on:
            return {}
        poses = {node.name: self._view_model.poses[link] for link, node in self._nodes.items()}
        return {n: (np.column_stack([p[:, :2], np.zeros(len(p))]), quaternions(p[:, 2])) for n, p in poses.items()}

    def _make(self) -> None:
        scene, view_model = self._server.scene, self._view_model
        self._base = scene.add_frame(self._path, show_axes=False)
        for link, body in view_model.bodies.items():
            if link == view_model.frame:
                continue
            path = f"{self._path}/{link.replace('/', '_')}"
            self._nodes[link] = scene.add_frame(path, show_axes=False)
            for k, piece in enumerate(body.pieces):
                scene.add_mesh_simple(
                    f"{path}/part_{k}",
                    piece.vertices,
                    piece.faces,
                    color=GHOST_COLOR,
                    opacity=GHOST_OPACITY,
                    cast_shadow=False,
                    receive_shadow=False,
                )
        for name, xyz in view_model.paths.items():
            path = f"{self._path}/path {name.replace('/', '_')}"
            scene.add_line_segments(path, path_segments(xyz), GHOST_COLOR, thickness=1.5, thickness_units="screen")
