"""The solids of the links in the browser, and their poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from mechcore.arrays import Integers, Real, Single
from mechviz.meshes.shading import components
from mechviz.outputs.viewer.view_model import ColoredPart, LinkSolid, ViewModel
from mechviz.outputs.viewer.viser_adapter import NodePose
from mechviz.picture.nodes import Body as BodyNode
from mechviz.picture.proportions import about_z

NOTHING = LinkSolid(())  # of a link that is not drawn
CUT_SHADE = 0.8  # brightness of the cut surface over that of the rest of the part


def shells(piece: ColoredPart) -> Integers:
    """The number of the closed shell to which each vertex (V,) of a piece belongs; coincident vertices belong together."""
    places, same = np.unique(piece.vertices, axis=0, return_inverse=True)
    corners = same.reshape(-1)[piece.faces.astype(np.int64)]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]]])
    return np.asarray(components(len(places), edges[:, 0], edges[:, 1])[same.reshape(-1)], np.int64)


def sectioned(body: LinkSolid, height: float) -> LinkSolid:
    """A body without its parts above z = ``height`` [m].

    All parts are plates: the vertices of a part that the plane intersects are moved down onto the plane, which closes the part with
    its own outline; a part above the plane is left out. The cut surface is a darker piece. Spatial cams, which turn about an axis
    in the plane of motion, stay whole.
    """
    pieces = []
    for piece in () if body.whole else body.pieces:
        z = piece.vertices[:, 2]
        if z.max() <= height:
            pieces.append(piece)
            continue
        shell = shells(piece)
        lowest = np.full(shell.max() + 1, np.inf)
        np.minimum.at(lowest, shell, z)
        kept = lowest[shell] < height
        vertices = piece.vertices.copy()
        vertices[:, 2] = np.minimum(z, np.float32(height))
        faces = piece.faces[kept[piece.faces[:, 0]]]
        flat = (vertices[faces, 2] == np.float32(height)).all(axis=1)  # in the plane
        red, green, blue = (int(CUT_SHADE * c) for c in piece.color)
        pieces += [_part(vertices, faces[~flat], piece.color), _part(vertices, faces[flat], (red, green, blue))]
    return body if body.whole else LinkSolid(tuple(piece for piece in pieces if len(piece.faces)))


def _part(vertices: Single, faces: NDArray[np.uint32], color: tuple[int, int, int]) -> ColoredPart:
    """Some faces with the vertices that they use."""
    used, own = np.unique(faces, return_inverse=True)
    return ColoredPart(vertices[used], own.reshape(-1, 3).astype(np.uint32), color)


HAIRLINE = 2e-4  # of the mechanism's size
HIGHLIGHT_COLOR, HIGHLIGHT_SHARE = (194, 37, 92), 0.5  # colour of the selected link, and its share in the blend


def link_path(link: str) -> str:
    """Name of a link's node in the scene tree: its pose is the pose of the link's frame."""
    return f"/mechanism/{link.replace('/', '_')}"


def quaternions(angle: Real) -> Real:
    """Unit quaternions w, x, y, z (F, 4) of rotations about z by ``angle`` (F,) [rad]."""
    return np.roll(about_z(angle), 1, axis=-1)


def composed(pose: Real, shift: Real, q: Real) -> tuple[Real, Real]:
    """Orientations (F, 4), w first, and positions (F, 3) of a body that is displaced by ``shift`` (F, 3) [m] and rotated by
    quaternions ``q`` (F, 4), w last, relative to a link with poses (F, 3)."""
    half, c, s = 0.5 * pose[:, 2], np.cos(pose[:, 2]), np.sin(pose[:, 2])
    k, w = np.sin(half), np.cos(half)
    x, y, z, r = q.T
    turn = np.column_stack([w * r - k * z, w * x - k * y, w * y + k * x, w * z + k * r])  # rotation about z after q
    place = np.column_stack(
        [pose[:, 0] + c * shift[:, 0] - s * shift[:, 1], pose[:, 1] + s * shift[:, 0] + c * shift[:, 1], shift[:, 2]]
    )
    return turn, place


class SolidNodes:
    """A node for every link, with its solid as a child; ``poses`` gives the poses of the links, ``update`` takes another run.

    ``clicked(link, event)`` is called on a click on a solid.
    """

    def __init__(self, server: viser.ViserServer, view_model: ViewModel, clicked: Callable[[str, Any], None] | None = None):
        self._server, self._clicked = server, clicked
        self._opacity: float | None = None
        self._picked = ""
        self._height: float | None = None
        self._size = view_model.size
        self._drawn: dict[str, LinkSolid] = {}
        self._nodes: dict[str, viser.FrameHandle] = {}
        self._meshes: dict[str, list[viser.MeshHandle]] = {}
        self._bodies: Mapping[str, LinkSolid] = {}
        self._moving: dict[str, tuple[Real, Real]] = {}
        self.update(view_model)

    def update(self, view_model: ViewModel) -> None:
        """Take the solids and the motion of ``view_model``; only what differs is sent."""
        for link in [name for name in self._nodes if name not in view_model.poses]:
            self._nodes.pop(link).remove()
            self._meshes.pop(link, None)
        for link, pose in view_model.poses.items():
            if link not in self._nodes:
                self._nodes[link] = self._server.scene.add_frame(link_path(link), show_axes=False)
            body = view_model.bodies.get(link, NOTHING)
            if self._bodies.get(link, NOTHING) is not body:
                self._shape(link, self._cut_body(link, body))
            self._moving[link] = quaternions(pose[:, 2]), np.column_stack([pose[:, :2], np.zeros(len(pose))])
        for solid in view_model.picture.nodes_of(BodyNode, "solids"):
            if solid.poses is not None:  # it turns about an axis in the plane of motion
                shift, turn = (np.asarray(values, float) for values in (solid.poses.places, solid.poses.quaternions))
                self._moving[solid.parent] = composed(view_model.poses[solid.parent], shift, turn)
        self._moving = {link: self._moving[link] for link in view_model.poses if link != view_model.frame}
        self._bodies = view_model.bodies

    def fade(self, opacity: float) -> None:
        """Draw all solids with an opacity from 0 to 1 (opaque)."""
        self._opacity = None if opacity >= 1.0 else max(opacity, 0.0)
        for mesh in (mesh for meshes in self._meshes.values() for mesh in meshes):
            if mesh.opacity != self._opacity:
                mesh.opacity = self._opacity

    def cut(self, height: float | None) -> None:
        """Cut away the parts above a height z [m]; None: nothing."""
        if height != self._height:
            self._height = height
            for link, body in self._bodies.items():
                if link in self._nodes:
                    self._shape(link, self._cut_body(link, body))

    def _cut_body(self, link: str, body: LinkSolid) -> LinkSolid:
        """A body without its parts above the cut. Cuts of different links differ by `HAIRLINE`: coplanar faces would flicker."""
        if self._height is None:
            return body
        return sectioned(body, self._height - HAIRLINE * self._size * list(self._nodes).index(link))

    def pick(self, link: str) -> None:
        """Mark a link as selected, by its colour; the others have their own colours."""
        self._picked = link
        for name, meshes in self._meshes.items():
            for mesh, piece in zip(meshes, self._drawn[name].pieces, strict=True):
                color = self._color_of(name, piece)
                if tuple(mesh.color) != color:
                    mesh.color = color

    def _color_of(self, link: str, piece: ColoredPart) -> tuple[int, int, int]:
        if link != self._picked:
            return piece.color
        red, green, blue = (round(c + HIGHLIGHT_SHARE * (m - c)) for c, m in zip(piece.color, HIGHLIGHT_COLOR, strict=True))
        return red, green, blue

    def poses(self, frame: int) -> Iterator[NodePose]:
        """Poses of the links at a frame."""
        for link, (turn, position) in self._moving.items():
            yield self._nodes[link], position[frame], turn[frame]

    def tracks(self) -> dict[str, tuple[Real, Real]]:
        """By name of the node: positions (F, 3) and orientations (F, 4) over the frames."""
        return {link_path(link): (position, turn) for link, (turn, position) in self._moving.items()}

    def _shape(self, link: str, body: LinkSolid) -> None:
        """Draw a link's pieces: only the vertices are sent if the faces are the same, otherwise new meshes."""
        meshes = self._meshes.get(link, [])
        old, self._drawn[link] = self._drawn.get(link), body
        if old is not None and len(meshes) == len(body.pieces) and _same_faces(old, body):
            for mesh, before, piece in zip(meshes, old.pieces, body.pieces, strict=True):
                if before.vertices is not piece.vertices:
                    mesh.vertices = piece.vertices
            return
        for mesh in meshes[len(body.pieces) :]:
            mesh.remove()
        self._meshes[link] = []
        for k, piece in enumerate(body.pieces):
            mesh = self._server.scene.add_mesh_simple(
                f"{link_path(link)}/part_{k}",
                piece.vertices,
                piece.faces,
                color=self._color_of(link, piece),
                opacity=self._opacity,
                cast_shadow=False,
                receive_shadow=False,
            )
            if self._clicked is not None:
                self._listen(mesh, link, self._clicked)
            self._meshes[link].append(mesh)

    def _listen(self, mesh: viser.MeshHandle, link: str, clicked: Callable[[str, Any], None]) -> None:
        async def hit(event: viser.SceneNodePointerEvent[viser.MeshHandle]) -> None:
            clicked(link, event)

        mesh.on_click(hit)


def _same_faces(a: LinkSolid, b: LinkSolid) -> bool:
    """Whether two bodies differ only in the positions of their vertices."""
    return len(a.pieces) == len(b.pieces) and all(
        p.faces is q.faces and p.color == q.color for p, q in zip(a.pieces, b.pieces, strict=True)
    )
