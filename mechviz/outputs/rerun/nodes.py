"""The nodes of a picture as entities of a recording, and the legend of its arrows."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Real, Single
from mechviz.outputs.rerun.entities import Static, Stream, archetype_columns, entity, line_strips, packed_colors
from mechviz.picture.arrows import SHORTEST_ARROW, visible
from mechviz.picture.nodes import Arrow, ArrowSet, Body, Lines, MomentArc, Node, Picture, Points
from mechviz.picture.proportions import in_space
from mechviz.quantities.vectors import LARGEST_ARC, LARGEST_ARROW, VECTOR_FAMILIES, Moment, Scales, Vector, round_value
from mechviz.scene.units import Units

MOTION_FAMILIES = ("velocity", "acceleration")
ARC_POINTS = 24
LEGEND_ROOM = 0.2  # height, in sizes of the mechanism, for the legend below solids and arrows


def is_visible(item: Vector | Moment, scales: Scales, size: float) -> bool:
    """Whether an arrow or arc is drawn in any frame."""
    if isinstance(item, Vector):
        return bool(visible(item.value, scales.per_metre(item.family), size).any())
    return bool(arc_lengths(item, scales, size).any())


def sweep_of(arc: MomentArc, scales: Scales, size: float) -> Real:
    """Signed angles (F,) [rad] subtended by an arc; 0 where it is not drawn."""
    return arc_lengths(arc.moment, scales, size) / arc.radius


def extent(vectors: Sequence[Vector], scales: Scales, bounds: Real, size: float) -> Real:
    """The box (2, 3) [m] around the mechanism, its arrows and the legend; arrows extend it by at most `LARGEST_ARROW` sizes."""
    low, high = np.array(bounds[0]), np.array(bounds[1])
    room = LARGEST_ARROW * size
    for vector in vectors:
        scale = scales.per_metre(vector.family)
        shown = visible(vector.value, scale, size)
        if shown.any():
            for k in (0, 1):  # by columns: ten times faster than by rows of two
                tips = vector.origin[:, k][shown] + vector.value[:, k][shown] / scale
                low[k] = min(low[k], max(tips.min(), bounds[0][k] - room))
                high[k] = max(high[k], min(tips.max(), bounds[1][k] + room))
    if vectors:
        low[1] -= LEGEND_ROOM * size  # for the legend
    return np.array([low, high])


def arc_lengths(moment: Moment, scales: Scales, size: float) -> Real:
    """Signed lengths (F,) [m] of the arcs of a moment; 0 where it is not drawn."""
    length = np.clip(np.nan_to_num(moment.value / scales.newton_metres_per_metre), -LARGEST_ARC * size, LARGEST_ARC * size)
    drawn = np.abs(length) > SHORTEST_ARROW * size
    return np.where(drawn if moment.shown is None else drawn & moment.shown, length, 0.0)


def arc_strips(centres: Real, sweep: Real, z: float, radius: float) -> Single:
    """Arcs with arrowheads of a radius [m] about centres (n, 2), through angles (n,) [rad], each as one strip (n, points, 3)
    [m]."""
    # symmetric about the vertical
    angles = 0.5 * np.pi + sweep[:, None] * np.linspace(-0.5, 0.5, ARC_POINTS)
    arc = centres[:, None] + radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    end = angles[:, -1]
    along = np.sign(sweep)[:, None] * np.column_stack([-np.sin(end), np.cos(end)])
    across = np.column_stack([np.cos(end), np.sin(end)])
    head = 0.3 * radius
    tip = arc[:, -1] + 0.5 * head * along
    barbs = [tip - head * along + side * 0.6 * head * across for side in (1, -1)]
    strip = np.concatenate([arc, np.stack([tip, barbs[0], tip, barbs[1]], axis=1)], axis=1)
    return np.concatenate([strip, np.full((*strip.shape[:2], 1), z)], axis=-1).astype(np.float32)


FORCE_RADIUS, MOTION_RADIUS = 0.0055, 0.004  # radii of arrows of forces and of motion, in sizes of the mechanism
EVERY_FRAME = ("solids", "joints", "roller", "belt")  # groups that move with their links


def nodes_json(picture: Picture) -> str:
    """The nodes as JSON: what a reader needs in addition to their entities."""
    return json.dumps([_entry(node) for node in picture.nodes], ensure_ascii=False)


def _entry(node: Node) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "key": node.key,
        "kind": node.KIND.value,
        "entity": entity(*node.entity),
        "owner": list(node.owner),
        "group": node.group,
        "height": node.height,
    }
    if isinstance(node, Body | Points | Lines):
        entry["parent"] = node.parent
    if isinstance(node, Arrow | MomentArc):
        entry["beside"] = node.offset if isinstance(node, Arrow) else node.radius
    return entry


def picture_streams(picture: Picture, every: int) -> Iterator[Stream]:
    """Streams of all nodes that move; nodes that do not move with a link have rows at every ``every``-th frame only."""
    for node in picture.nodes:
        yield from node_streams(node, picture, 1 if node.group in EVERY_FRAME else every)


def picture_statics(picture: Picture) -> Iterator[Static]:
    """Static archetypes of all nodes: their look, and positions of nodes at rest."""
    for node in picture.nodes:
        yield from node_statics(node, picture)


def node_streams(node: Node, picture: Picture, every: int) -> Iterator[Stream]:
    """The stream of a node; none if it is at rest."""
    draw: Any = None
    match node:
        case Body(poses=poses) if poses is not None:
            draw = partial(_placed, node)
        case Lines() if node.moves:
            draw = partial(_bent, node)
        case Points() if len(node.places) > 1:
            draw = partial(_dotted, node)
        case ArrowSet():
            draw = partial(_pointed_together, node)
        case Arrow():
            scale = picture.scales.per_metre(node.vector.family)
            draw = partial(_pointed, node, scale, visible(node.vector.value, scale, picture.size))
        case MomentArc():
            draw = partial(_curved, node, sweep_of(node, picture.scales, picture.size))
    if draw is not None:
        yield Stream(entity(*node.entity), draw, every)


def _placed(node: Body, frames: slice) -> Any:
    import rerun as rr

    poses = node.poses
    assert poses is not None
    scales = {} if poses.scales is None else {"scale": poses.scales[frames]}
    return archetype_columns(
        rr.Transform3D.from_fields(translation=poses.places[frames], quaternion=poses.quaternions[frames], **scales)
    )


def _bent(node: Lines, frames: slice) -> Any:
    import rerun as rr

    if node.visible is None:
        return archetype_columns(
            rr.LineStrips3D.from_fields(strips=line_strips([s[frames] for s in node.strips])), len(node.strips)
        )
    there = node.visible[frames]
    return archetype_columns(
        rr.LineStrips3D.from_fields(strips=line_strips([s[frames][there] for s in node.strips])), len(node.strips) * there
    )


def _dotted(node: Points, frames: slice) -> Any:
    import rerun as rr

    places, count = node.places[frames], node.places.shape[1]
    if np.isfinite(places.sum()):  # if the sum is finite, all are
        return archetype_columns(rr.Points3D.from_fields(positions=places.reshape(-1, 3)), count)
    there = np.isfinite(places).all(axis=(1, 2))
    return archetype_columns(rr.Points3D.from_fields(positions=places[there].reshape(-1, 3)), count * there)


def _pointed_together(node: ArrowSet, frames: slice) -> Any:
    import rerun as rr

    origins, vectors = (np.ascontiguousarray(a[frames]).reshape(-1, 3) for a in (node.origins, node.vectors))
    return archetype_columns(rr.Arrows3D.from_fields(origins=origins, vectors=vectors), node.origins.shape[1])


def _pointed(node: Arrow, scale: float, seen: Flags, frames: slice) -> Any:
    """Rows of an arrow; where it is too short to be seen, the row has no instance."""
    import rerun as rr

    there, origin, value = seen[frames], node.origin_at(frames), node.vector.value[frames]
    counts: Any = 1
    if not there.all():
        counts, origin, value = there, origin[there], value[there]
    arrows = rr.Arrows3D.from_fields(origins=in_space(origin, node.height), vectors=in_space(value / scale, 0.0))
    return archetype_columns(arrows, counts)


def _curved(node: MomentArc, sweep: Real, frames: slice) -> Any:
    import rerun as rr

    there = sweep[frames] != 0
    strips = arc_strips(node.moment.origin[frames][there], sweep[frames][there], node.height, node.radius)
    return archetype_columns(rr.LineStrips3D.from_fields(strips=line_strips([strips])), there)


def node_statics(node: Node, picture: Picture) -> Iterator[Static]:
    """The static archetype of a node: its look, and its position if it is at rest. Raises ValueError for a broken mesh."""
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
            yield Static(path, rr.LineStrips3D.from_fields(**_look(node.colors, node.radii, node.labels), **where))
        case Points():
            where = {"positions": node.places[0]} if len(node.places) == 1 else {}
            named = picture.marks or node.group != "joints"
            yield Static(path, rr.Points3D.from_fields(**_look(node.colors, node.radii, node.labels, shown=named), **where))
        case ArrowSet():
            yield Static(path, rr.Arrows3D.from_fields(**_look(node.colors, (node.radius,), node.labels)))
        case Arrow(group=family):
            radius = (MOTION_RADIUS if family in MOTION_FAMILIES else FORCE_RADIUS) * picture.size
            yield Static(path, rr.Arrows3D.from_fields(colors=packed_colors([VECTOR_FAMILIES[family].on_dark]), radii=[radius]))
        case MomentArc(group=family):
            yield Static(
                path,
                rr.LineStrips3D.from_fields(
                    colors=packed_colors([VECTOR_FAMILIES[family].on_dark]), radii=[FORCE_RADIUS * picture.size]
                ),
            )


def _look(colors: Sequence[Sequence[int]], radii: Sequence[float], labels: Sequence[str], *, shown: bool = True) -> dict[str, Any]:
    """Look of lines, points or arrows; labels only if any is not empty, ``shown``: whether they are visible at first."""
    words = {"labels": list(labels), "show_labels": shown} if any(labels) else {}
    return {"colors": packed_colors(colors), "radii": list(radii), **words}


def _check(node: Body) -> None:
    """Raise ValueError for a mesh with invalid indices or NaN: rerun accepts them silently, and its viewer then shows nothing."""
    mesh = node.mesh
    if not (np.isfinite(mesh.vertices).all() and np.isfinite(mesh.normals).all() and mesh.faces.max() < len(mesh.vertices)):
        raise ValueError(f"the mesh of {node.owner[0]} '{node.owner[1]}' is broken")


# -- the legend -------------------------------------------------------------------------------------------------------
LEGEND_LENGTH = 0.14  # longest arrow of the legend, in sizes of the mechanism
LEGEND_COLUMN = 0.26  # distance of the arrows, in sizes of the mechanism
LEGEND_LABEL = (0.19, 0.22)  # least and largest width of a label, in widths of the picture
LEGEND_ROW = 0.9  # width of all labels together, if the least width allows it
LEGEND_ASPECT = 1.5  # approximate width of the picture over its height


def legend_shapes(picture: Picture, around: Real, units: Units) -> Iterator[Static]:
    """``/legend/forces/<family>`` and ``/legend/motion/<family>``: static arrows and their labels.

    A family without anything long enough to be drawn in any frame is left out; a family of moments alone has no value. ``around``:
    the box (2, 3) [m] around other drawings on the mechanism; the legend stands below that as well. ``units``: display units of the
    values.
    """
    scales, size = picture.scales, picture.size
    vectors, moments = [a.vector for a in picture.nodes_of(Arrow)], [a.moment for a in picture.nodes_of(MomentArc)]
    pointing = {v.family for v in vectors if is_visible(v, scales, size)}
    shown = pointing | {m.family for m in moments if is_visible(m, scales, size)}
    for view in ("forces", "motion"):
        drawn = [v for v in vectors if (v.family in MOTION_FAMILIES) == (view == "motion")]
        low, high = extent(drawn, scales, picture.bounds, size)[:, :2]
        bottom = min(low[1], around[0, 1] - LEGEND_ROOM * size) + 0.25 * LEGEND_ROOM * size
        families = [f for f in VECTOR_FAMILIES if f in shown and (f in MOTION_FAMILIES) == (view == "motion")]
        room = float(np.clip(LEGEND_ROW / max(len(families), 1), *LEGEND_LABEL))
        column = max(LEGEND_COLUMN * size, room * max(high[0] - low[0], LEGEND_ASPECT * (high[1] - low[1])))
        for k, family in enumerate(families):
            per_metre = scales.per_metre(family)
            words, length = VECTOR_FAMILIES[family].label, LEGEND_LENGTH * size
            if family in pointing:
                unit, factor = units.display_unit(VECTOR_FAMILIES[family].unit)
                value = round_value(length * per_metre * factor)
                length = value / (per_metre * factor)
                words += f": {value:g} {unit}"
            start = _legend_place((k - 0.5 * (len(families) - 1)) * column, bottom, picture)
            yield from _legend_entry(("legend", view, family), start, length, words, VECTOR_FAMILIES[family].on_dark, size)


def _legend_place(across: float, y: float, picture: Picture) -> Real:
    """Start (3,) [m] of an arrow of the legend; ``across`` [m]: offset of the arrow's middle from that of the mechanism."""
    middle = 0.5 * (picture.bounds[0, 0] + picture.bounds[1, 0])
    return np.array([middle + across - 0.5 * LEGEND_LENGTH * picture.size, y, picture.top])


def _legend_entry(
    path: tuple[str, ...], start: Real, length: float, words: str, color: tuple[int, int, int], size: float
) -> Iterator[Static]:
    import rerun as rr

    arrow: Any = rr.Arrows3D(origins=[start], vectors=[[length, 0.0, 0.0]], colors=packed_colors([color]), radii=[0.0055 * size])
    yield Static(entity(*path), arrow)
    under = start + np.array([0.5 * length, -0.01 * size, 0.0])
    yield Static(
        entity(*path, "label"),
        rr.Points3D([under], radii=[1e-4 * size], colors=packed_colors([color]), labels=[words], show_labels=True),
    )
