"""The picture of a recording, as it was drawn."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.arrays import Flags, Integers, Real, Single
from mechviz.outputs.rerun.contract import NodePart
from mechviz.outputs.rerun.paths import parts_of
from mechviz.picture.arrows import with_scales
from mechviz.picture.nodes import ArrowSet, Body, Color, Lines, Mesh, Node, Picture, Points, Poses
from mechviz.picture.surface_marks import KINDS
from mechviz.quantities.numbers import Numbers
from mechviz.quantities.vectors import Scales

if TYPE_CHECKING:
    from mechviz.outputs.rerun.reader import Recording


LOOKS = 48  # poses at which the extent of the mechanism is looked at


def picture_in(recording: Recording, numbers: Numbers) -> Picture:
    """What a recording shows."""
    said = recording.said
    reader = _Reader(recording, numbers)
    entries = [*_guessed(recording)] if said.picture is None else said.picture
    nodes = [node for entry in entries if (node := reader.node(entry)) is not None]
    bounds = _bounds(nodes, numbers) if said.bounds is None else np.array(said.bounds)
    size = said.size or float(np.ptp(bounds[:, :2], axis=0).max()) or 1.0
    scales = Scales(said.newtons_per_metre, said.newton_metres_per_metre, said.mps_per_metre, said.mps2_per_metre)
    circles = [n.owner[1] for n in nodes if n.entity[:2] == ("vectors", "friction") and n.entity[-1] == "circle"]
    found = with_scales(numbers, size, scales, circles).nodes({e.key: e.height for e in entries}, float(bounds[1, 2]))
    order = {entry.key: k for k, entry in enumerate(entries)}
    nodes = sorted([*nodes, *found], key=lambda node: order.get(node.key, len(order)))
    top = float(bounds[1, 2] + 0.01 * size) if said.top is None else said.top
    return Picture(numbers.time, numbers.frame, numbers.poses, tuple(nodes), scales, size, bounds, top)


def _guessed(recording: Recording) -> Iterator[NodePart]:
    """The nodes of a recording that does not list them: one that is not complete, or is older."""
    for path in recording.entities:
        match parts_of(path):
            case ("mechanism", "links", link, "mesh"):
                found = ("body", f"link.{link}", ["link", link], "solids", link)
            case ("mechanism", "links", link, "lumps"):
                found = ("points", f"masses.{link}", ["link", link], "masses", link)
            case ("mechanism", "links", link, name) if (kind := name.split(" ")[0]) in KINDS:
                found = ("body", f"{kind}.{name[len(kind) + 1 :]}", ["link", link], kind, link)
            case ("mechanism", "springs", name):
                solid = recording.static(path, component="Mesh3D:triangle_indices") is not None
                found = ("body" if solid else "lines", f"spring.{name}", ["load", name], "springs", "")
            case ("mechanism", "paths", name):
                found = ("lines", f"path.{name}", ["point", name], "paths", "")
            case ("mechanism", "joints", name):
                found = ("points", f"joint.{name}", ["joint", name], "joints", "")
            case ("polygons", "funicular"):
                found = ("lines", "funicular.strings", ["construction", "funicular"], "funicular", "")
            case ("polygons", "funicular", "resultant"):
                found = ("arrowset", "funicular.resultants", ["construction", "funicular"], "funicular", "")
            case ("polygons", "polodes", link):
                found = ("lines", f"polode.{link}.fixed", ["link", link], "polodes", "")
            case ("mechanism", "links", link, "polode"):
                found = ("lines", f"polode.{link}.moving", ["link", link], "polode", link)
            case ("polygons", "equivalent", joint):
                found = ("lines", f"equivalent.{joint}", ["joint", joint], "equivalent", "")
            case ("polygons", "equivalent", joint, "pins"):
                found = ("points", f"equivalent.{joint}.pins", ["joint", joint], "equivalent", "")
            case ("sections", group, link):
                found = ("lines", f"section.{link}.{group}", ["link", link], group, "")
            case ("sections", group, link, "largest"):
                found = ("points", f"section.{link}.{group}.largest", ["link", link], group, "")
            case ("polygons", "substitutes", link):
                found = ("points", f"substitutes.{link}", ["link", link], "substitutes", "")
            case ("polygons", "substitutes", link, "forces"):
                found = ("arrowset", f"substitutes.{link}.forces", ["link", link], "substitutes", "")
            case ("vectors", "friction", joint, ("circle" | "line") as what):
                found = ("lines", f"friction.{joint}.{what}", ["joint", joint], "friction", "")
            case _:
                continue
        part: dict[str, Any] = dict(zip(("kind", "key", "owner", "group", "parent"), found, strict=True))
        yield NodePart(entity=path, height=0.0, **part)


class _Reader:
    """Makes nodes of what the entities of a recording hold."""

    def __init__(self, recording: Recording, numbers: Numbers):
        self.recording = recording
        self.ticks = np.round(1e9 * numbers.time).astype(np.int64)

    def node(self, entry: NodePart) -> Node | None:
        """The node of an entry; None of arrows, which follow from the numbers, and of what was never drawn."""
        path = entry.entity
        common: dict[str, Any] = {
            "key": entry.key,
            "owner": entry.owner,
            "group": entry.group,
            "entity": parts_of(path),
            "height": entry.height,
        }
        match entry.kind:
            case "body":
                mesh = self._mesh(path)
                return None if mesh is None else Body(**common, parent=entry.parent, mesh=mesh, poses=self._poses(path))
            case "lines":
                return self._lines(path, {**common, "parent": entry.parent})
            case "points":
                return self._points(path, common, entry.parent)
            case "arrowset":
                return self._arrows(path, common)
        return None

    def _mesh(self, path: str) -> Mesh | None:
        names = ("vertex_positions", "triangle_indices", "vertex_normals", "vertex_colors")
        vertices, faces, normals, shades = (self.recording.static(path, component=f"Mesh3D:{name}") for name in names)
        if vertices is None or faces is None or normals is None or shades is None:
            return None
        packed = shades.astype(np.uint32)  # 0xRRGGBBAA
        colors = np.column_stack([(packed >> shift) & 255 for shift in (24, 16, 8)]).astype(np.uint8)
        return Mesh(vertices.astype(np.float32), faces.astype(np.uint32), normals.astype(np.float32), colors)

    def _poses(self, path: str) -> Poses | None:
        places, turns, scales = (self._columns(path, f"Transform3D:{name}", n) for name, n in _TRANSFORM)
        return None if places is None or turns is None else Poses(places, turns, scales)

    def _columns(self, path: str, component: str, width: int) -> Single | None:
        """Values (F, width) of a component at the frames; the newest, where a frame has no row of its own."""
        try:
            rows = self.recording.rows(path, component=component)
        except KeyError:
            return None
        return np.asarray(rows.values, np.float32).reshape(-1, width)[self._row_of(rows.time)] if len(rows.time) else None

    def _row_of(self, time: Integers) -> Integers:
        return np.clip(np.searchsorted(time, self.ticks, side="right") - 1, 0, len(time) - 1)

    def _rows(self, path: str, component: str) -> tuple[Flags, list[Single]] | None:
        """At which frames there are instances (F,), and the values of each over the frames, NaN at the others: instances are all
        there, or none. None where there is nothing."""
        try:
            rows = self.recording.rows(path, component=component)
        except KeyError:
            return None
        count = int(rows.lengths.max(initial=0))
        if not count or not np.isin(rows.lengths, (0, count)).all():
            return None
        there, row_of, found = rows.lengths > 0, self._row_of(rows.time), []
        for k in range(count):
            drawn = np.stack([np.asarray(value, np.float32) for value in rows.values[k::count]])
            every = np.full((len(there), *drawn.shape[1:]), np.nan, np.float32)
            every[there] = drawn
            found.append(every[row_of])
        return there[row_of], found

    def _lines(self, path: str, common: dict[str, Any]) -> Lines | None:
        colors, radii, labels = self._look(path, "LineStrips3D")
        look = {**common, "colors": colors, "radii": radii, "labels": labels}
        still = self.recording.static(path, component="LineStrips3D:strips")
        if still is not None and len(still):
            return Lines(strips=tuple(np.asarray(s, np.float32)[None] for s in still), **look)
        rows = self._rows(path, "LineStrips3D:strips")
        if rows is None:
            return None
        there, strips = rows
        return Lines(strips=tuple(strips), shown=None if there.all() else there, **look)

    def _points(self, path: str, common: dict[str, Any], parent: str) -> Points | None:
        colors, radii, labels = self._look(path, "Points3D")
        still = self.recording.static(path, component="Points3D:positions")
        if still is not None and len(still):
            places = np.asarray(still, np.float32)[None]
        elif (rows := self._rows(path, "Points3D:positions")) is not None:
            places = np.stack(rows[1], axis=1)
        else:
            return None
        return Points(**common, parent=parent, places=places, colors=colors, radii=radii, labels=labels or ("",) * places.shape[1])

    def _arrows(self, path: str, common: dict[str, Any]) -> ArrowSet | None:
        origins, vectors = (self._rows(path, f"Arrows3D:{name}") for name in ("origins", "vectors"))
        if origins is None or vectors is None:
            return None
        starts, ways = (np.stack(rows[1], axis=1) for rows in (origins, vectors))
        colors, radii, labels = self._look(path, "Arrows3D")
        return ArrowSet(**common, origins=starts, vectors=ways, colors=colors, radius=radii[0] if radii else 0.0, labels=labels)

    def _look(self, path: str, archetype: str) -> tuple[tuple[Color, ...], tuple[float, ...], tuple[str, ...]]:
        """Colours, radii and labels."""
        colors, radii, labels = (self.recording.static(path, component=f"{archetype}:{n}") for n in ("colors", "radii", "labels"))
        shades = [int(c) for c in colors] if colors is not None and len(colors) else [0x808080FF]
        found = tuple(((c >> 24) & 255, (c >> 16) & 255, (c >> 8) & 255) for c in shades)
        sizes = tuple(float(r) for r in (radii if radii is not None else ()))
        return found, sizes, tuple(str(text) for text in (labels if labels is not None else ()))


_TRANSFORM = (("translation", 3), ("quaternion", 4), ("scale", 3))


def _bounds(nodes: list[Node], numbers: Numbers) -> Real:
    """The box (2, 3) [m] around the solids, looked at at some poses."""
    lows, highs = [], []
    some = np.unique(np.linspace(0, len(numbers.time) - 1, LOOKS).round().astype(int))
    for node in nodes:
        if not isinstance(node, Body) or node.group != "solids":
            continue
        vertices = node.mesh.vertices.astype(float)
        z = vertices[:, 0] + 1j * vertices[:, 1]
        pose = numbers.poses[node.parent][some]
        placed = z * np.exp(1j * pose[:, 2:]) + (pose[:, 0] + 1j * pose[:, 1])[:, None]
        lows.append([placed.real.min(), placed.imag.min(), vertices[:, 2].min()])
        highs.append([placed.real.max(), placed.imag.max(), vertices[:, 2].max()])
    if not lows:
        flat = np.concatenate([pose[:, :2] for pose in numbers.poses.values()])
        return np.array([[*flat.min(axis=0), 0.0], [*(flat.max(axis=0) + 1e-3), 1e-3]])
    return np.array([np.min(lows, axis=0), np.max(highs, axis=0)])
