"""Content of a recording for views: its numbers, picture, constructions and diagrams, as recorded."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Flags, Index, Integers, Real, Single
from mechcore.records import dataclass
from mechviz.outputs.drawings import DRAWING_HEIGHT, DRAWING_WIDTH, Curve
from mechviz.outputs.drawings import Diagram as Chart
from mechviz.outputs.rerun.contract import NodePart
from mechviz.outputs.rerun.entities import parts_of, unpacked
from mechviz.outputs.rerun.reader import Recording
from mechviz.picture.arrows import with_scales
from mechviz.picture.centres import CENTRE_GROUPS
from mechviz.picture.constructions import Drawing, DrawnArrow, NamedPoint
from mechviz.picture.nodes import ArrowSet, Body, Color, Lines, Mesh, Node, NodeKind, Picture, Points, PoseTrack
from mechviz.picture.overlays import INVERSION_GROUP
from mechviz.picture.surface_marks import MARK_KINDS
from mechviz.quantities.items import ItemTable, JointInfo
from mechviz.quantities.numbers import TOLERANCE, LoadInfo, Numbers
from mechviz.quantities.vectors import Scales

# -- numbers ----------------------------------------------------------------------------------------------------------
TABLE_ROOTS = ("data", "health", "polygons")


def recorded_numbers(recording: Recording) -> Numbers:
    """The numbers of a recording, complete or interrupted."""
    properties = recording.parsed_properties
    model = properties.model
    ticks, _ = recording.scalars("data", "links", model.frame, "pose")
    time = np.asarray(1e-9 * ticks.astype(float), float)
    tables = {t.path: t for path in recording.entities if (t := _table(recording, path)) is not None}
    joints = {}
    for name, joint in model.joints.items():
        unit = tables["data", "joints", name, "motion"].columns[0][1]
        joints[name] = JointInfo(name, joint.type, joint.links, unit)
    paths = [parts_of(path) for path in recording.entities]
    traced = [p[2] for p in paths if p[:2] == ("mechanism", "paths")] if model.traced is None else model.traced
    return Numbers(
        time=time,
        frame=model.frame,
        links=model.links,
        joints=joints,
        drives=model.drives,
        loads={name: LoadInfo(load.kind, load.links, load.points) for name, load in model.loads.items()},
        traced=tuple(traced),
        tables=tables,
        units=properties.units,
        cycle=properties.cycle or float(np.ptp(time)) or 1.0,
        length_scale=properties.length_scale or properties.tolerance / TOLERANCE,
        tolerance=properties.tolerance,
    )


def _table(recording: Recording, path: str) -> ItemTable | None:
    """A table, whose values are read on demand; None for an entity that is not a table."""
    parts = parts_of(path)
    names = recording.static(path, component="SeriesLines:names")
    if parts[0] not in TABLE_ROOTS or names is None or not recording.has(path):
        return None
    columns = tuple(_column(str(name), parts) for name in names)
    return ItemTable(parts, "", columns, lambda: recording.scalars(path)[1])


def _column(header: str, parts: tuple[str, ...]) -> tuple[str, str]:
    """Name and unit of a column from its name in a plot, such as ``crank.x [m]``."""
    match = re.fullmatch(r"(.*) \[([^\]]*)\]", header)
    name, unit = (match[1], match[2]) if match else (header, "1")
    named = parts[0] == "data" and parts[1:] == ("power",)
    return name.removeprefix("power.") if named else name.rsplit(".", 1)[-1], unit.replace("²", "^2")


# -- the picture ------------------------------------------------------------------------------------------------------
EXTENT_FRAMES = 48  # number of poses at which the extent of the mechanism is evaluated


def picture_in(recording: Recording, numbers: Numbers) -> Picture:
    """The picture of a recording."""
    properties = recording.parsed_properties
    reader = _Reader(recording, numbers)
    entries = [*_guessed(recording)] if properties.picture is None else properties.picture
    nodes = [node for entry in entries if (node := reader.node(entry)) is not None]
    bounds = _bounds(nodes, numbers) if properties.bounds is None else np.array(properties.bounds)
    size = properties.size or float(np.ptp(bounds[:, :2], axis=0).max()) or 1.0
    scales = Scales(
        properties.newtons_per_metre, properties.newton_metres_per_metre, properties.mps_per_metre, properties.mps2_per_metre
    )
    circles = [n.owner[1] for n in nodes if n.entity[:2] == ("vectors", "friction") and n.entity[-1] == "circle"]
    beside = {e.key: e.beside for e in entries if e.beside is not None}
    arrows = with_scales(numbers, size, scales, circles).nodes({e.key: e.height for e in entries}, float(bounds[1, 2]), beside)
    order = {entry.key: k for k, entry in enumerate(entries)}
    nodes = sorted([*nodes, *arrows], key=lambda node: order.get(node.key, len(order)))
    top = float(bounds[1, 2] + 0.01 * size) if properties.top is None else properties.top
    return Picture(numbers.time, numbers.frame, numbers.poses, tuple(nodes), scales, size, bounds, top, marks=properties.marks)


def _guessed(recording: Recording) -> Iterator[NodePart]:
    """The nodes of a recording that does not list them, derived from its entities: a recording of an older version."""
    for path in recording.entities:
        match parts_of(path):
            case ("mechanism", "links", link, "mesh"):
                facts = ("body", f"link.{link}", ["link", link], "solids", link)
            case ("mechanism", "links", link, "lumps"):
                facts = ("points", f"masses.{link}", ["link", link], "masses", link)
            case ("mechanism", "links", link, name) if (kind := name.split(" ")[0]) in MARK_KINDS:
                facts = ("body", f"{kind}.{name[len(kind) + 1 :]}", ["link", link], kind, link)
            case ("mechanism", "springs", name):
                solid = recording.static(path, component="Mesh3D:triangle_indices") is not None
                facts = ("body" if solid else "lines", f"spring.{name}", ["load", name], "springs", "")
            case ("mechanism", "paths", name):
                facts = ("lines", f"path.{name}", ["point", name], "paths", "")
            case ("mechanism", "joints", name):
                facts = ("points", f"joint.{name}", ["joint", name], "joints", "")
            case ("polygons", "funicular"):
                facts = ("lines", "funicular.strings", ["construction", "funicular"], "funicular", "")
            case ("polygons", "funicular", "resultant"):
                facts = ("arrowset", "funicular.resultants", ["construction", "funicular"], "funicular", "")
            case ("polygons", "polodes", link):
                facts = ("lines", f"polode.{link}.fixed", ["link", link], "polodes", "")
            case ("mechanism", "links", link, name) if name.startswith(f"{INVERSION_GROUP} "):
                joint, what = name.removeprefix(f"{INVERSION_GROUP} ").rsplit(" ", 1)
                facts = ("lines", f"{INVERSION_GROUP}.{joint}.{what}", ["joint", joint], INVERSION_GROUP, link)
            case ("mechanism", "links", link, "polode"):
                facts = ("lines", f"polode.{link}.moving", ["link", link], "polode", link)
            case ("polygons", "equivalent", joint):
                facts = ("lines", f"equivalent.{joint}", ["joint", joint], "equivalent", "")
            case ("polygons", "equivalent", joint, "pins"):
                facts = ("points", f"equivalent.{joint}.pins", ["joint", joint], "equivalent", "")
            case ("polygons", group, item, what) if group in CENTRE_GROUPS:
                archetypes = {"LineStrips3D": "lines", "Points3D": "points", "Arrows3D": "arrowset"}
                looks = (k for name, k in archetypes.items() if recording.static(path, component=f"{name}:colors") is not None)
                facts = (next(looks, "lines"), f"{group}.{item}.{what}", [CENTRE_GROUPS[group][1], item], group, "")
            case ("sections", group, link):
                facts = ("lines", f"section.{link}.{group}", ["link", link], group, "")
            case ("sections", group, link, "largest"):
                facts = ("points", f"section.{link}.{group}.largest", ["link", link], group, "")
            case ("polygons", "substitutes", link):
                facts = ("points", f"substitutes.{link}", ["link", link], "substitutes", "")
            case ("polygons", "substitutes", link, "forces"):
                facts = ("arrowset", f"substitutes.{link}.forces", ["link", link], "substitutes", "")
            case ("vectors", "friction", joint, ("circle" | "line") as what):
                facts = ("lines", f"friction.{joint}.{what}", ["joint", joint], "friction", "")
            case _:
                continue
        part: dict[str, Any] = dict(zip(("kind", "key", "owner", "group", "parent"), facts, strict=True))
        yield NodePart(entity=path, height=0.0, **part)


class _Reader:
    """Makes nodes from the entities of a recording."""

    def __init__(self, recording: Recording, numbers: Numbers):
        self.recording = recording
        self.ticks = np.round(1e9 * numbers.time).astype(np.int64)

    def node(self, entry: NodePart) -> Node | None:
        """The node of an entry; None for arrows, which follow from the numbers, and for nodes that were never drawn."""
        path = entry.entity
        common: dict[str, Any] = {
            "key": entry.key,
            "owner": entry.owner,
            "group": entry.group,
            "entity": parts_of(path),
            "height": entry.height,
        }
        match entry.kind:
            case NodeKind.BODY:
                mesh = self._mesh(path)
                return None if mesh is None else Body(**common, parent=entry.parent, mesh=mesh, poses=self._poses(path))
            case NodeKind.LINES:
                return self._lines(path, {**common, "parent": entry.parent})
            case NodeKind.POINTS:
                return self._points(path, common, entry.parent)
            case NodeKind.ARROWS:
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

    def _poses(self, path: str) -> PoseTrack | None:
        places, quaternions, scales = (self._columns(path, f"Transform3D:{name}", n) for name, n in _TRANSFORM_PARTS)
        return None if places is None or quaternions is None else PoseTrack(places, quaternions, scales)

    def _columns(self, path: str, component: str, width: int) -> Single | None:
        """Values (F, width) of a component at the frames: those of the last row at or before each frame."""
        try:
            rows = self.recording.rows(path, component=component)
        except KeyError:
            return None
        return np.asarray(rows.values, np.float32).reshape(-1, width)[_rows_at(rows.time, self.ticks)] if len(rows.time) else None

    def _rows(self, path: str, component: str) -> tuple[Flags, list[Single]] | None:
        """Flags (F,) of the frames that have instances, and the values of each instance over the frames, NaN at the others. None if
        there are no values, or if rows have different numbers of instances other than 0."""
        try:
            rows = self.recording.rows(path, component=component)
        except KeyError:
            return None
        count = int(rows.lengths.max(initial=0))
        if not count or not np.isin(rows.lengths, (0, count)).all():
            return None
        there, row_of, strips = rows.lengths > 0, _rows_at(rows.time, self.ticks), []
        for k in range(count):
            drawn = np.stack([np.asarray(value, np.float32) for value in rows.values[k::count]])
            every = np.full((len(there), *drawn.shape[1:]), np.nan, np.float32)
            every[there] = drawn
            strips.append(every[row_of])
        return there[row_of], strips

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
        return Lines(strips=tuple(strips), visible=None if there.all() else there, **look)

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
        starts, arrows = (np.stack(rows[1], axis=1) for rows in (origins, vectors))
        colors, radii, labels = self._look(path, "Arrows3D")
        return ArrowSet(**common, origins=starts, vectors=arrows, colors=colors, radius=radii[0] if radii else 0.0, labels=labels)

    def _look(self, path: str, archetype: str) -> tuple[tuple[Color, ...], tuple[float, ...], tuple[str, ...]]:
        """Colours, radii and labels."""
        colors, radii, labels = (self.recording.static(path, component=f"{archetype}:{n}") for n in ("colors", "radii", "labels"))
        shades = [int(c) for c in colors] if colors is not None and len(colors) else [0x808080FF]
        shown = tuple(unpacked(c) for c in shades)
        sizes = tuple(float(r) for r in (radii if radii is not None else ()))
        return shown, sizes, tuple(str(text) for text in (labels if labels is not None else ()))


_TRANSFORM_PARTS = (("translation", 3), ("quaternion", 4), ("scale", 3))


def _bounds(nodes: list[Node], numbers: Numbers) -> Real:
    """The box (2, 3) [m] around the solids at `EXTENT_FRAMES` poses."""
    lows, highs = [], []
    some = np.unique(np.linspace(0, len(numbers.time) - 1, EXTENT_FRAMES).round().astype(int))
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


# -- constructions and diagrams ---------------------------------------------------------------------------------------
FINE_ARROW = 0.8  # an arrow thinner than this, relative to the thickest one, is a fine one
FIRST_POLYGONS = ("velocity", "acceleration", "force", "indicator", "phase")  # these come first, then the others by name


@dataclass(frozen=True, eq=False)
class RecordedDrawings:
    """Reads a recording's drawings at frames with times ``ticks`` (F,) [ns]; a row is valid until the next one of its entity."""

    recording: Recording
    ticks: Integers

    def drawings(self) -> dict[str, Drawing]:
        """Drawings by the name of their entity; those whose scale is not recorded are left out."""
        drawings = {}
        for path in self._below("/polygons/"):
            known = {name: self.recording.static(path, component=name) for name in ("title", "unit", "per_metre", "least", "whole")}
            if any(value is None for value in known.values()):
                continue
            title, unit, per_metre, least, whole = (value[0] for value in known.values() if value is not None)
            name = "/".join(parts_of(path)[1:])
            arrows = (*self._arrows(path), *self._lines(f"{path}/rays"))
            lost = np.all([(i.start == 0) & (i.vector == 0) for i in arrows], axis=0) if arrows else np.zeros(len(self.ticks), bool)
            at = self._points(f"{path}/points")
            points = [NamedPoint(label, np.where(lost, np.nan, z)) for label, z in at]
            drawings[name] = Drawing(
                name, str(title), arrows, tuple(points), float(per_metre), str(unit), least=float(least), whole=bool(whole)
            )
        return drawings

    def charts(self) -> list[Chart]:
        """Diagrams of one quantity over another; their curves are recovered from the recorded positions of their moving points."""
        charts = []
        for path in self._below("/diagrams/"):
            part = partial(self.recording.static, path)
            ranges = part(component="ranges")
            if ranges is None or len(ranges) != 4:
                continue
            names = [parts_of(p)[-1] for p in self._below(f"{path}/curves/")]
            positions = self._rows(f"{path}/now", "Points2D:positions")
            colors = self.recording.static(f"{path}/now", component="Points2D:colors")
            if positions is None or colors is None or positions.shape[1] != len(colors):
                continue
            x0, x1, y0, y1 = (float(r) for r in ranges)
            x, y = x0 + (x1 - x0) * positions[..., 0] / DRAWING_WIDTH, y0 - (y1 - y0) * positions[..., 1] / DRAWING_HEIGHT
            order = self._in_order(path, names, x.shape[1])
            curves = tuple(Curve(name, x[:, k], y[:, k]) for k, name in enumerate(order))
            title, across, up, equal, turn = (part(component=c) for c in ("title", "x_title", "y_title", "equal", "turn"))
            if title is None or across is None or up is None or equal is None or turn is None:
                continue
            said = str(title[0]), str(across[0]), str(up[0])
            charts.append(Chart(parts_of(path)[-1], *said, curves, equal=bool(equal[0]), turn=float(turn[0]) or None))
        return charts

    # -- inside -------------------------------------------------------------------------------------------------------
    def _below(self, start: str) -> list[str]:
        """Entities whose path begins with ``start``, at any depth, `FIRST_POLYGONS` first."""
        paths = [path for path in self.recording.entities if path.startswith(start)]
        return sorted(
            paths,
            key=lambda path: FIRST_POLYGONS.index(name) if (name := parts_of(path)[1]) in FIRST_POLYGONS else len(FIRST_POLYGONS),
        )

    def _rows(self, path: str, component: str) -> Real | None:
        """Vectors (F, n, 2) of an entity, NaN where a row has fewer than n, the largest count; None if there are none."""
        try:
            rows = self.recording.rows(path, component=component)
        except KeyError:
            return None
        if not len(rows.time) or not rows.lengths.max(initial=0):
            return None
        count = int(rows.lengths.max())
        full = rows.lengths == count
        out = np.full((len(rows.time), count, 2), np.nan)
        kept = np.repeat(full, rows.lengths)
        out[full] = np.asarray(rows.values, float)[kept][:, :2].reshape(-1, count, 2)
        return np.asarray(out[_rows_at(rows.time, self.ticks)])

    def _looks(self, path: str, kind: str, count: int) -> tuple[list[str], list[Color], list[bool]]:
        """Labels, colours and flags of fine lines, of each of ``count`` items."""
        part = partial(self.recording.static, path)
        labels, packed, radii = (part(component=f"{kind}:{name}") for name in ("labels", "colors", "radii"))
        texts = [str(x) for x in labels] if labels is not None and len(labels) == count else [""] * count
        shades = np.full(1, 0x808080FF, np.uint32) if packed is None or not len(packed) else packed.astype(np.uint32)
        shades = np.resize(shades, count) if len(shades) != count else shades
        colors = [unpacked(c) for c in shades]
        thick = np.ones(count) if radii is None or len(radii) != count else np.abs(np.asarray(radii, float))
        return texts, colors, [bool(r < FINE_ARROW * thick.max()) for r in thick]

    def _arrows(self, path: str) -> tuple[DrawnArrow, ...]:
        starts, vectors = self._rows(path, "Arrows3D:origins"), self._rows(path, "Arrows3D:vectors")
        if starts is None or vectors is None or starts.shape != vectors.shape:
            return ()
        z, along = _complex(starts), _complex(vectors)
        looks = zip(*self._looks(path, "Arrows3D", z.shape[1]), strict=True)
        return tuple(DrawnArrow(label, color, z[:, k], along[:, k], thin=thin) for k, (label, color, thin) in enumerate(looks))

    def _lines(self, path: str) -> tuple[DrawnArrow, ...]:
        """Strips as plain lines, one for each segment; the first of a strip has the label."""
        try:
            rows = self.recording.rows(path, component="LineStrips3D:strips")
        except KeyError:
            return ()
        count = int(rows.lengths[0]) if len(rows.lengths) else 0
        if not count or not (rows.lengths == count).all():
            return ()
        row_of = _rows_at(rows.time, self.ticks)
        arrows = []
        for k, (label, color, _) in enumerate(zip(*self._looks(path, "LineStrips3D", count), strict=True)):
            strips: list[Any] = list(rows.values[k::count])
            if len({len(strip) for strip in strips}) != 1:
                continue
            z = np.stack([_complex(np.asarray(strip, float)) for strip in strips])[row_of]
            for part in range(z.shape[1] - 1):
                arrows.append(DrawnArrow(label if not part else "", color, z[:, part], z[:, part + 1] - z[:, part], headless=True))
        return tuple(arrows)

    def _points(self, path: str) -> list[tuple[str, Complex]]:
        positions = self._rows(path, "Points3D:positions")
        if positions is None:
            return []
        labels, _, _ = self._looks(path, "Points3D", positions.shape[1])
        return [(label, _complex(positions[:, k])) for k, label in enumerate(labels)]

    def _in_order(self, path: str, names: list[str], count: int) -> list[str]:
        """Names of the curves in the order of their moving points: a curve and its point have the same colour."""
        colors = self.recording.static(f"{path}/now", component="Points2D:colors")
        by_color = {}
        for name, entity in zip(names, self._below(f"{path}/curves/"), strict=True):
            own = self.recording.static(entity, component="LineStrips2D:colors")
            if own is not None and len(own):
                by_color[int(own[0])] = name
        return [by_color.get(int(colors[k]), "") if colors is not None else "" for k in range(count)]


def _rows_at(time: Integers, ticks: Integers) -> Index:
    """Index of the last row, of rows at ``time`` (n,), at or before each of the ``ticks`` (F,); 0 before the first row."""
    return np.clip(np.searchsorted(time, ticks, side="right") - 1, 0, len(time) - 1)


def _complex(xy: Real) -> Complex:
    """Points (..., 2 or 3) as complex numbers x + iy (...)."""
    return np.asarray(xy[..., 0] + 1j * xy[..., 1], complex)
