"""The nodes of a picture as entities of a recording: rows over the frames, and static archetypes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..picture.arrows import visible
from ..picture.nodes import Arc, Arrow, Body, Lines, Node, Picture, Points
from .arrows import COLORS, arc_strips, sweep_of
from .colors import packed
from .paths import entity
from .streams import Index, Static, Stream, in_space

__all__ = ["listed", "node_statics", "node_streams", "picture_statics", "picture_streams"]

MOTION = ("velocity", "acceleration")
THICK, THIN = 0.0055, 0.004  # radii of arrows of forces and of motion, in sizes of the mechanism
EVERY_FRAME = ("solids", "joints", "roller", "belt")  # groups that move with their links


def listed(picture: Picture) -> str:
    """The nodes as JSON: what a reader needs to know of each beside what its entity says."""
    return json.dumps([_entry(node) for node in picture.nodes], ensure_ascii=False)


def _entry(node: Node) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "key": node.key,
        "kind": type(node).__name__.lower(),
        "entity": entity(*node.entity),
        "owner": list(node.owner),
        "group": node.group,
        "height": node.height,
    }
    if isinstance(node, Body | Points):
        entry["parent"] = node.parent
    if isinstance(node, Lines):
        entry["style"] = {"color": list(node.color), "radius": node.radius}
    if isinstance(node, Points):
        entry["style"] = {"color": list(node.color), "radii": list(node.radii)}
    return entry


def picture_streams(picture: Picture, every: int) -> Iterator[Stream]:
    """All that moves; what does not go with a link at every ``every``-th frame."""
    for node in picture.nodes:
        yield from node_streams(node, picture, 1 if node.group in EVERY_FRAME else every)


def picture_statics(picture: Picture) -> Iterator[Static]:
    """How all nodes look."""
    for node in picture.nodes:
        yield from node_statics(node, picture)


def node_streams(node: Node, picture: Picture, every: int) -> Iterator[Stream]:
    """The rows of a node; none where it stands still."""
    draw: Any = None
    match node:
        case Body(poses=poses) if poses is not None:
            draw = partial(_placed, node)
        case Lines() if node.moves:
            draw = partial(_bent, node)
        case Points() if len(node.places) > 1:
            draw = partial(_dotted, node)
        case Arrow():
            scale = picture.scales.per_metre(node.vector.family)
            draw = partial(_pointed, node, scale, visible(node.vector.value, scale, picture.size))
        case Arc():
            draw = partial(_curved, node, sweep_of(node.moment, picture.scales, picture.size), picture.size)
    if draw is not None:
        yield Stream(entity(*node.entity), draw, every)


def _placed(node: Body, frames: Index) -> Any:
    import rerun as rr

    poses = node.poses
    assert poses is not None
    scales = {} if poses.scales is None else {"scale": poses.scales[frames]}
    return rr.Transform3D.columns(translation=poses.places[frames], quaternion=poses.turns[frames], **scales)


def _bent(node: Lines, frames: Index) -> Any:
    import rerun as rr

    there = frames if node.shown is None else frames[node.shown[frames]]
    strips: Any = [strip[k] for k in there for strip in node.strips] if len(node.strips) > 1 else node.strips[0][there]
    counts = np.full(len(frames), len(node.strips)) if node.shown is None else len(node.strips) * node.shown[frames]
    return rr.LineStrips3D.columns(strips=strips).partition(counts.astype(np.int64))


def _dotted(node: Points, frames: Index) -> Any:
    import rerun as rr

    count = node.places.shape[1]
    columns = rr.Points3D.columns(positions=node.places[frames].reshape(-1, 3))
    return columns if count == 1 else columns.partition(np.full(len(frames), count))


def _pointed(node: Arrow, scale: float, seen: NDArray[np.bool_], frames: Index) -> Any:
    """Arrows that are long enough to be seen: of the others a row has no instance."""
    import rerun as rr

    shown, vector = frames[seen[frames]], node.vector
    return rr.Arrows3D.columns(
        origins=in_space(vector.origin[shown], node.height), vectors=in_space(vector.value[shown] / scale, 0.0)
    ).partition(seen[frames].astype(np.int64))


def _curved(node: Arc, sweep: NDArray[np.float64], size: float, frames: Index) -> Any:
    import rerun as rr

    shown = frames[sweep[frames] != 0]
    strips = arc_strips(node.moment.origin[shown], sweep[shown], node.height, size)
    return rr.LineStrips3D.columns(strips=strips).partition((sweep[frames] != 0).astype(np.int64))


def node_statics(node: Node, picture: Picture) -> Iterator[Static]:
    """How a node looks, and where it is, where it stands still."""
    import rerun as rr

    path = entity(*node.entity)
    match node:
        case Body(mesh=mesh):
            _check(node)
            colors = np.column_stack([mesh.colors, np.full(len(mesh.colors), 255, np.uint8)])
            yield Static(
                path,
                rr.Mesh3D(
                    vertex_positions=mesh.vertices, triangle_indices=mesh.faces, vertex_normals=mesh.normals, vertex_colors=colors
                ),
            )
        case Lines():
            where = {} if node.moves else {"strips": [strip[0] for strip in node.strips]}
            yield Static(path, rr.LineStrips3D.from_fields(colors=[node.color], radii=[node.radius], **where))
        case Points():
            where = {"positions": node.places[0]} if len(node.places) == 1 else {}
            labels = {"labels": list(node.labels), "show_labels": any(node.labels)}
            yield Static(path, rr.Points3D.from_fields(colors=packed([node.color]), radii=list(node.radii), **labels, **where))
        case Arrow(group=family):
            radius = (THIN if family in MOTION else THICK) * picture.size
            yield Static(path, rr.Arrows3D.from_fields(colors=packed([COLORS[family]]), radii=[radius]))
        case Arc(group=family):
            yield Static(path, rr.LineStrips3D.from_fields(colors=packed([COLORS[family]]), radii=[THICK * picture.size]))


def _check(node: Body) -> None:
    """rerun takes any indices and NaN coordinates without a word, and the viewer then shows nothing."""
    mesh = node.mesh
    if not (np.isfinite(mesh.vertices).all() and np.isfinite(mesh.normals).all() and mesh.faces.max() < len(mesh.vertices)):
        raise ValueError(f"the mesh of {node.owner[0]} '{node.owner[1]}' is broken")
