"""Springs, marks that move with rollers and belts, and lines that deform, in addition to the solids of the links."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import viser

from mechcore.arrays import Real, Single
from mechviz.outputs.viewer.playback import PointTrack
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.viser_adapter import NodePose
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.picture.nodes import Body, Lines, Mesh
from mechviz.picture.proportions import STRUT_COLOR
from mechviz.picture.surface_marks import SHEET_COLOR
from mechviz.quantities.vectors import VECTOR_FAMILIES

BODY_GROUPS = ("springs", "roller", "belt", "sheet")


class BodyNodes:
    """A node for every body, a child of the link's node where the body has a link; ``poses`` gives their poses, ``show`` scales
    them, ``update`` takes the bodies of another run."""

    def __init__(self, server: viser.ViserServer, view_model: ViewModel):
        self._server = server
        self._on = dict.fromkeys(BODY_GROUPS, True)
        self._height: float | None = None
        self._bodies: dict[str, Body] = {}
        self._nodes: dict[str, viser.MeshHandle] = {}
        self._turns: dict[str, Real] = {}
        self.update(view_model)

    @property
    def groups(self) -> frozenset[str]:
        """Groups of which there is anything to draw."""
        return frozenset(body.group for body in self._bodies.values())

    def update(self, view_model: ViewModel) -> None:
        """Take the bodies of ``view_model``; a mesh is sent again only if its vertices differ."""
        before, self._bodies = self._bodies, {body_path(body): body for body in view_model.picture.nodes_of(Body, *BODY_GROUPS)}
        for path in [p for p in self._nodes if p not in self._bodies or not _same(before[p].mesh, self._bodies[p].mesh)]:
            self._nodes.pop(path).remove()
        for path, body in self._bodies.items():
            if body.poses is not None:
                self._turns[path] = np.roll(np.asarray(body.poses.quaternions, float), 1, axis=1)  # w first
            if path not in self._nodes:
                red, green, blue = (int(c) for c in body.mesh.colors[0])
                self._nodes[path] = self._server.scene.add_mesh_simple(
                    path,
                    body.mesh.vertices,
                    body.mesh.faces,
                    color=(red, green, blue),
                    side="double" if body.parent else "front",
                    visible=self._seen(body),
                    cast_shadow=False,
                    receive_shadow=False,
                )

    def switch(self, group: str, on: bool) -> None:
        """Show or hide a group."""
        self._on[group] = on
        self.cut(self._height)

    def cut(self, height: float | None) -> None:
        """Hide the bodies above a height z [m]; None: hide none."""
        self._height = height
        for path, node in self._nodes.items():
            seen = self._seen(self._bodies[path])
            if node.visible != seen:
                node.visible = seen

    def _seen(self, body: Body) -> bool:
        return self._on[body.group] and (self._height is None or body.height <= self._height)

    def poses(self, frame: int) -> Iterator[NodePose]:
        """Poses at a frame of the bodies that are on."""
        for path, (places, turns) in self.tracks().items():
            if self._on[self._bodies[path].group]:
                k = min(frame, len(places) - 1)
                yield self._nodes[path], places[k], turns[k]

    def show(self, frame: int) -> None:
        """Set the scale factors of the bodies at a frame."""
        for path, body in self._bodies.items():
            if self._on[body.group] and body.poses is not None and body.poses.scales is not None:
                x, y, z = body.poses.scales[min(frame, len(body.poses.scales) - 1)]
                self._nodes[path].scale = (float(x), float(y), float(z))

    def tracks(self) -> dict[str, tuple[Single, Real]]:
        """By name of the node: positions (F, 3) and orientations (F, 4) over the frames."""
        return {path: (body.poses.places, self._turns[path]) for path, body in self._bodies.items() if body.poses is not None}

    def stretches(self) -> Iterator[PointTrack]:
        """Tracks of the scale factors of the bodies that are on."""
        for path, body in self._bodies.items():
            if self._on[body.group] and body.poses is not None and body.poses.scales is not None:
                yield PointTrack(path, "scale", body.poses.scales, np.full(len(body.poses.scales), 3))


def body_path(body: Body) -> str:
    """Name of a body's node in the scene tree."""
    return f"{link_path(body.parent) if body.parent else '/bodies'}/{body.key.replace('/', '_')}"


def _same(a: Mesh, b: Mesh) -> bool:
    return a.vertices is b.vertices or (a.vertices.shape == b.vertices.shape and np.array_equal(a.vertices, b.vertices))


LINE_COLORS = {
    "springs": (STRUT_COLOR, (176, 188, 204)),
    "friction": (VECTOR_FAMILIES["friction"].color, VECTOR_FAMILIES["friction"].on_dark),
    "ink": ((28, 44, 96), (70, 100, 190)),
    "sheet": ((150, 156, 168), SHEET_COLOR),
}
"""Colours of groups on a light and on a dark page."""
LINE_WIDTHS = {"springs": 3.0, "friction": 1.8, "ink": 3.0, "sheet": 1.5}  # [px]


def segments(node: Lines, frame: int) -> Single:
    """Line segments (n, 2, 3) [m] between successive points of all strips at a frame."""
    strips = (strip[min(frame, len(strip) - 1)] for strip in node.strips)
    return np.concatenate([np.stack([strip[:-1], strip[1:]], axis=1) for strip in strips])


class LineNodes:
    """The lines of some groups; ``show`` bends them to a frame, ``update`` takes those of another run."""

    def __init__(self, server: viser.ViserServer, view_model: ViewModel):
        self._server = server
        self._on, self._dark = dict.fromkeys(LINE_COLORS, True), False
        self._nodes: dict[str, viser.LineSegmentsHandle] = {}
        self._lines: dict[str, Lines] = {}
        self.update(view_model)

    @property
    def groups(self) -> frozenset[str]:
        """Groups of which there is anything to draw."""
        return frozenset(lines.group for lines in self._lines.values())

    def update(self, view_model: ViewModel) -> None:
        self._lines = {_path(lines.key): lines for lines in view_model.picture.nodes_of(Lines, *LINE_COLORS)}
        for path, lines in self._lines.items():
            if path not in self._nodes:
                color, width = LINE_COLORS[lines.group][self._dark], LINE_WIDTHS[lines.group]
                first = np.nan_to_num(segments(lines, 0))
                self._nodes[path] = self._server.scene.add_line_segments(
                    path, first, color, thickness=width, thickness_units="screen", visible=self._on[lines.group]
                )
        for path, node in self._nodes.items():
            node.visible = path in self._lines and self._on[self._lines[path].group]

    def switch(self, group: str, on: bool) -> None:
        """Show or hide a group."""
        self._on[group] = on
        for path, lines in self._lines.items():
            if lines.group == group:
                self._nodes[path].visible = on

    def darken(self, dark: bool) -> None:
        """Take the colours for a dark page or for a light one."""
        self._dark = dark
        for path, lines in self._lines.items():
            self._nodes[path].colors = np.array(LINE_COLORS[lines.group][dark], np.uint8)

    def show(self, frame: int) -> None:
        for path, lines in self._lines.items():
            if self._on[lines.group]:
                node, there = self._nodes[path], lines.visible is None or bool(lines.visible[min(frame, len(lines.visible) - 1)])
                node.visible = there
                if there:
                    node.points = segments(lines, frame)

    def tracks(self, frames: int) -> Iterator[PointTrack]:
        """Tracks of the moving lines that are on."""
        for path, lines in self._lines.items():
            if self._on[lines.group] and lines.moves:
                flat = [np.stack([s[:, :-1], s[:, 1:]], axis=2).reshape(frames, -1) for s in lines.strips]
                values = np.concatenate(flat, axis=1)
                counts = np.full(frames, values.shape[1])
                there = np.ones(frames, bool) if lines.visible is None else lines.visible
                yield PointTrack(path, "points", np.nan_to_num(values), np.where(there, counts, 0))


def _path(key: str) -> str:
    return f"/lines/{key.replace('/', '_')}"
