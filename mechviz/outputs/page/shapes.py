"""Drawables of a page: the nodes of a picture as arrays, with heights, colours, radii and labels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Flags, Real, Single
from mechviz.outputs.page.pack import ChosenFrames, Pack, PackProgress, no_progress
from mechviz.outputs.rerun.nodes import FORCE_RADIUS, MOTION_FAMILIES, MOTION_RADIUS, arc_strips, sweep_of
from mechviz.picture.arrows import visible
from mechviz.picture.constructions import Drawing
from mechviz.picture.nodes import Arrow, ArrowSet, Body, Color, Lines, Mesh, MomentArc, Node, Picture, Points, PoseTrack
from mechviz.picture.surface_marks import MARK_KINDS
from mechviz.quantities.vectors import VECTOR_FAMILIES

PageShape = dict[str, Any]
MOST_CARRIED = 36  # approximate number of poses of a link at which the box around drawables fixed to it is evaluated


def pack_links(picture: Picture, frames: ChosenFrames, pack: Pack) -> list[PageShape]:
    """Links with their poses (frames, 3: x, y [m], angle [rad]) and their solids; ``spin``: displacement [m] and quaternion
    (frames, 7) of a solid in its link's frame, if it turns about an axis in the plane of motion."""
    solids = {body.parent: body for body in picture.nodes_of(Body, "solids")}
    shapes = []
    for name, poses in picture.poses.items():
        pose = poses[frames.rows]
        moves = bool(np.ptp(pose, axis=0).max(initial=0.0) > 0.0)
        link: PageShape = {"name": name, "pose": pack.floats(pose if moves else pose[:1]), "moves": moves, "mesh": None}
        if name in solids:
            link["mesh"] = _mesh(solids[name].mesh, pack)
            spin = solids[name].poses
            if spin is not None:
                link["spin"] = pack.floats(_spin(spin, frames))
        shapes.append(link)
    return shapes


def pack_bodies(picture: Picture, frames: ChosenFrames, pack: Pack) -> list[PageShape]:
    """Solids other than those of the links, in the same form: springs, with ``stretch``, the scale along their axes (frames,),
    marks on rollers and belts, and sheets of paper. ``group``: name of the group that shows and hides them."""
    shapes = []
    for body in picture.nodes_of(Body, "springs", "sheet", *MARK_KINDS):
        poses = body.poses
        if poses is None:
            still = {"pose": pack.floats(np.zeros((1, 3))), "moves": False, "mesh": _mesh(body.mesh, pack)}
            shapes.append({"name": body.owner[1], "group": body.group, **still})
            continue
        at, turns = (a[frames.rows].astype(float) for a in (poses.places, poses.quaternions))
        pose = np.column_stack([at[:, :2], np.unwrap(2.0 * np.arctan2(turns[:, 2], turns[:, 3]))])
        height = float(at[:, 2].mean())
        more: PageShape = {}
        if body.parent:
            x, y, angle = picture.poses[body.parent][frames.rows].T
            c, s = np.cos(angle), np.sin(angle)
            if np.abs(turns[:, :2]).max(initial=0.0) > 1e-3:  # about an axis in the plane of motion
                more, height, pose = {"spin": pack.floats(_spin(poses, frames))}, 0.0, np.column_stack([x, y, angle])
            else:
                pose = np.column_stack([x + c * at[:, 0] - s * at[:, 1], y + s * at[:, 0] + c * at[:, 1], angle + pose[:, 2]])
        if poses.scales is not None:
            more |= {"stretch": pack.floats(poses.scales[frames.rows, 0])}
        shape = _mesh(body.mesh, pack, height)
        group = "springs" if body.group == "springs" else "surface_marks"
        shapes.append({"name": body.owner[1], "group": group, "pose": pack.floats(pose), "moves": True, "mesh": shape, **more})
    return shapes


def pack_drawables(
    picture: Picture, frames: ChosenFrames, pack: Pack, progress: PackProgress = no_progress
) -> list[tuple[PageShape, Real | None]]:
    """Arrows, strips and points with the box (2, 2) [m] around each; ``group``: name of the group that shows and hides them;
    ``link``: number of the link to which they are fixed."""
    numbers = {name: k for k, name in enumerate(picture.poses)}
    shapes = []
    for done, node in enumerate(picture.nodes):
        progress(done, len(picture.nodes))
        drawn = None if isinstance(node, Body) else _drawable(node, picture, frames, pack)
        if drawn is None or not np.isfinite(drawn[1]).any():
            continue
        shape, points = drawn
        parent = node.parent if isinstance(node, Points | Lines) else ""
        place = {"link": numbers[parent]} if parent else {}
        if parent:
            points = _carried(points, picture.poses[parent])
        shapes.append(({"group": node.group, "name": node.owner[1], **place, **shape}, _box(points)))
    progress(len(picture.nodes), len(picture.nodes))
    return shapes


def pack_drawing(drawing: Drawing, size: float, frames: ChosenFrames, pack: Pack) -> PageShape:
    """A construction beside the mechanism, as parts in the form of drawables."""
    arrows, lines = ([i for i in drawing.arrows if i.headless is plain] for plain in (False, True))
    parts: list[PageShape] = []
    if drawing.curves:
        strips = [_plane(z)[None].astype(np.float32) for _, z in drawing.curves]
        parts.append(_strips(strips, [c for c, _ in drawing.curves], [0.0035 * size], [], None, frames, pack)[0])
    for strokes in (arrows, lines):
        if not strokes:
            continue
        start, vector = (np.stack([getattr(i, k) for i in strokes], axis=1)[frames.rows] for k in ("start", "vector"))
        words = [i.label for i in strokes]
        colors = [i.color for i in strokes]
        radii = [(0.003 if i.thin or i.headless else 0.0055) * size for i in strokes]
        if strokes is arrows:
            parts.append(_arrows(_plane(start), _plane(vector), colors, radii, words, pack)[0])
        else:
            both = np.stack([start, start + vector], axis=2)  # (F, n, 2)
            parts.append(_strips([_plane(both[:, k]) for k in range(len(lines))], colors, radii, words, None, frames, pack)[0])
    if drawing.points:
        at = np.stack([m.position for m in drawing.points], axis=1)[frames.rows]
        parts.append(_points(_plane(at), [(240, 240, 240)], [0.009 * size], [m.label for m in drawing.points], pack)[0])
    return {"title": drawing.title.partition(":")[0], "caption": drawing.title, "parts": parts}


def _drawable(node: Node, picture: Picture, frames: ChosenFrames, pack: Pack) -> tuple[PageShape, Real] | None:
    """The drawable of a node, and all its points (..., 2) [m]; None for nodes that are not drawables."""
    rows, size = frames.rows, picture.size
    match node:
        case Lines():
            there = None if node.visible is None else node.visible[rows]
            strips = [strip[rows] if node.moves else strip for strip in node.strips]
            return _strips(strips, node.colors, node.radii, node.labels, there, frames, pack)
        case Points():
            return _points(node.places[rows] if len(node.places) > 1 else node.places, node.colors, node.radii, node.labels, pack)
        case ArrowSet():
            return _arrows(node.origins[rows], node.vectors[rows], node.colors, [node.radius], node.labels, pack)
        case Arrow(vector=vector, group=family):
            scale = picture.scales.per_metre(family)
            seen = visible(vector.value, scale, size)[rows, None]
            origin, value = (np.where(seen, a[rows], np.nan) for a in (node.origin, vector.value / scale))
            radius = (MOTION_RADIUS if family in MOTION_FAMILIES else FORCE_RADIUS) * size
            starts, vectors = (np.column_stack([a, np.full(len(rows), node.height)])[:, None] for a in (origin, value))
            return _arrows(starts, vectors, [VECTOR_FAMILIES[family].on_dark], [radius], [], pack)
        case MomentArc(moment=moment, group=family):
            sweep = sweep_of(node, picture.scales, size)[rows]
            strip = arc_strips(moment.origin[rows], sweep, node.height, node.radius)
            return _strips([strip], [VECTOR_FAMILIES[family].on_dark], [FORCE_RADIUS * size], [], sweep != 0.0, frames, pack)
    return None


def _strips(
    strips: Sequence[Any],
    colors: Sequence[Color],
    radii: Sequence[float],
    labels: Sequence[str],
    there: Flags | None,
    frames: ChosenFrames,
    pack: Pack,
) -> tuple[PageShape, Real]:
    """The drawable of strips (F, n, 3), or (1, n, 3) at rest, and their points; ``there`` (F,): frames in which they exist."""
    look = _look(len(strips), colors, radii, labels)
    if len(strips[0]) == 1 and len(frames.rows) > 1:
        points = np.concatenate([strip[0] for strip in strips]).astype(float)
        shape = {"kind": "still strips", "lengths": [strip.shape[1] for strip in strips], "points": pack.quantised(points[:, :2])}
        return {**shape, "z": _height(points), **look}, points[:, :2]
    length = max(strip.shape[1] for strip in strips)
    every = np.stack([np.concatenate([s, *([s[:, -1:]] * (length - s.shape[1]))], axis=1) for s in strips], axis=1).astype(float)
    if there is not None:
        every[~there] = np.nan
    shape = {"kind": "strips", "count": len(strips), "length": length, "points": pack.quantised(every[..., :2])}
    return {**shape, "z": _height(every), **look}, every[..., :2]


def _arrows(
    origins: Any, vectors: Any, colors: Sequence[Color], radii: Sequence[float], labels: Sequence[str], pack: Pack
) -> tuple[PageShape, Real]:
    """The drawable of arrows from ``origins`` (F, n, 3) along ``vectors`` (F, n, 3), and their ends."""
    count = origins.shape[1]
    starts, vectors = (np.asarray(a, float)[..., :2] for a in (origins, vectors))
    shape = {
        "kind": "arrows",
        "count": count,
        "z": _height(origins),
        "origins": pack.quantised(starts),
        "vectors": pack.quantised(vectors),
    }
    return {**shape, **_look(count, colors, radii, labels)}, np.concatenate([starts, starts + vectors])


def _points(
    places: Real | Single, colors: Sequence[Color], radii: Sequence[float], labels: Sequence[str], pack: Pack
) -> tuple[PageShape, Real]:
    """The drawable of points (F, n, 3), or (1, n, 3) at rest, and their positions."""
    count, flat = places.shape[1], np.asarray(places, float)[..., :2]
    shape = {"kind": "points", "count": count, "moves": len(places) > 1, "z": _height(places), "points": pack.quantised(flat)}
    return {**shape, **_look(count, colors, radii, labels)}, flat


def _look(count: int, colors: Sequence[Color], radii: Sequence[float], labels: Sequence[str]) -> Mapping[str, Any]:
    """Colours, radii and labels of the instances; a single colour or radius applies to all."""
    shades, sizes = ([*values] * count if len(values) == 1 else [*values] for values in ([hex_of(c) for c in colors], radii))
    return {"colors": shades, "radii": sizes, "labels": [*labels] if any(labels) else []}


def _mesh(mesh: Mesh, pack: Pack, height: float = 0.0) -> PageShape:
    palette, number = np.unique(mesh.colors, axis=0, return_inverse=True)
    return {
        "vertices": pack.quantised(mesh.vertices + np.array([0.0, 0.0, height])),
        "normals": pack.directions(mesh.normals),
        "faces": pack.indices(mesh.faces),
        "colors": pack.octets(number),
        "palette": [hex_of(c) for c in palette],
    }


def _spin(poses: PoseTrack, frames: ChosenFrames) -> Real:
    """Displacements [m] and quaternions (frames, 7); successive quaternions have a positive scalar product, so that the page can
    interpolate linearly."""
    shifts, turns = (a[frames.rows].astype(float) for a in (poses.places, poses.quaternions))
    turns[1:] *= np.cumprod(np.where(np.einsum("fi,fi->f", turns[1:], turns[:-1]) < 0.0, -1.0, 1.0))[:, None]
    return np.column_stack([shifts, turns])


def _plane(z: Complex) -> Real:
    """Points x + iy (...) as (..., 3) with z = 0."""
    return np.stack([z.real, z.imag, np.zeros(z.shape)], axis=-1)


def _height(points: Real | Single) -> float:
    """Height z [m] of planar points (..., 3)."""
    z = np.asarray(points, float)[..., 2]
    return float(np.nanmean(z)) if np.isfinite(z).any() else 0.0


def _carried(points: Real, poses: Real) -> Real:
    """World coordinates (n, ..., 2) of points (..., 2) in the frame of a link, at some of its poses (F, 3)."""
    x, y, angle = poses[:: max(1, len(poses) // MOST_CARRIED)].T
    z = np.multiply.outer(np.exp(1j * angle), points[..., 0] + 1j * points[..., 1])
    z += (x + 1j * y).reshape(-1, *[1] * (z.ndim - 1))
    return np.stack([z.real, z.imag], axis=-1)


def _box(points: Real) -> Real | None:
    """The box (2, 2) around points of the plane, from the 0.5 % to the 99.5 % quantile; None if there are none."""
    flat = points.reshape(-1, 2)
    flat = flat[np.isfinite(flat).all(axis=1)]
    return np.quantile(flat, [0.005, 0.995], axis=0) if len(flat) else None


def spring_boxes(picture: Picture) -> Iterator[Real]:
    """Boxes (2, 2) [m] around the springs over the run."""
    return (body.bounds() for body in picture.nodes_of(Body, "springs"))


def hex_of(color: Iterable[int]) -> str:
    """A colour in HTML notation."""
    return "#{:02x}{:02x}{:02x}".format(*(int(c) for c in color))
