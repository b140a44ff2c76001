"""Graphical constructions as drawings to scale: arrows with colours and labels in metres of a drawing plane, over all frames.

Pure functions of a `Run`; the recorder and the viewer draw what they find here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.constructions.contour_graph import ContourGraph, contour_graph
from mechcore.constructions.force_polygons import Funicular
from mechcore.constructions.polygons import Edge, Polygon
from mechviz.picture.contour_graph import layout, loop_number

if TYPE_CHECKING:
    from mechviz.runs import Run


Color = tuple[int, int, int]

COLORS: Mapping[str, Color] = {
    "absolute": (84, 168, 255),
    "relative": (255, 190, 84),
    "normal": (255, 190, 84),
    "tangential": (126, 224, 130),
    "coriolis": (255, 110, 170),
    "sliding": (190, 150, 255),
    "reaction": (255, 72, 84),
    "reaction normal": (255, 72, 84),
    "reaction tangential": (255, 140, 150),
    "inner": (150, 160, 178),
    "load": (255, 158, 40),
    "inertia": (208, 112, 246),
    "gravity": (214, 178, 130),
    "resultant": (255, 255, 255),
    "ray": (120, 150, 178),
    "string": (120, 200, 230),
    "line": (214, 170, 104),
    "before": (255, 110, 96),
    "after": (96, 222, 132),
}
"""Colours on a dark ground."""

INSIDE = 0.9  # of the frames, on each side, for which a view has room where some frames run far out
FAR = 1.7  # times the room of these frames: a drawing that reaches less far has room in all frames
FILL = 1.0  # size of a drawing in sizes of the mechanism


@dataclass(frozen=True, eq=False)
class Stroke:
    """An arrow (F,) in the drawing plane [m] with its label; ``plain``: a line without a head; ``fine``: a thin arrow."""

    label: str
    color: Color
    start: Complex
    vector: Complex
    plain: bool = False
    fine: bool = False


@dataclass(frozen=True, eq=False)
class Mark:
    """A named point (F,) of the drawing plane [m]."""

    label: str
    at: Complex


@dataclass(frozen=True, eq=False)
class Drawing:
    """Arrows and points, their size ``bounds`` (2, 2) [m] over the run, and the scale: units of the quantity per metre, 0 where it
    has none."""

    name: str
    title: str
    strokes: tuple[Stroke, ...]
    marks: tuple[Mark, ...]
    per_metre: float
    unit: str
    closing: Real | None = None

    least: float = 0.0  # [m] extent for which a view has room at least
    whole: bool = False  # a view has room for all frames, however far they reach

    @property
    def curves(self) -> list[tuple[Color, Complex]]:
        """Colours and points (F,) of the curves along which tips go: of a polar plot, the one drawing that shows them."""
        polar = self.name == "shaking"
        return [(i.color, i.start + i.vector) for i in self.strokes if not i.plain] if polar else []

    @property
    def bounds(self) -> Real:
        """Box (2, 2) [m] that holds the drawing in all frames; of one that runs far out in some, in nine of ten on every side."""
        ends = [z for stroke in self.strokes for z in (stroke.start, stroke.start + stroke.vector)] + [m.at for m in self.marks]
        if not ends:
            return np.zeros((2, 2))
        z = np.array(ends)
        z = z[:, np.isfinite(z).all(axis=0)]
        if not z.size:
            return np.zeros((2, 2))
        low = np.array([np.quantile(part.min(axis=0), 1.0 - INSIDE) for part in (z.real, z.imag)])
        high = np.array([np.quantile(part.max(axis=0), INSIDE) for part in (z.real, z.imag)])
        least, most = np.array([z.real.min(), z.imag.min()]), np.array([z.real.max(), z.imag.max()])
        if self.whole or np.max(most - least) <= FAR * np.max(high - low):
            low, high = least, most
        half = 0.5 * self.least
        return np.array([np.minimum(low, -half), np.maximum(high, half)]) if half else np.array([low, high])


def drawings_of(run: Run, size: float) -> dict[str, Drawing]:
    """All drawings that a run's scene asks for, by the name of their entity under ``polygons``."""
    studies = run.studies
    drawings = {name: draw_polygons(name, polygons, size) for name, polygons in studies.polygons.items()}
    if "graph" in run.motion.mechanism.studies.polygons:
        drawings["graph"] = draw_graph(contour_graph(run.motion.model), run.motion.frames, size)
    if studies.systems:
        drawings["funicular/forces"] = draw_funicular(run, size)
    if studies.shaking is not None:
        drawings["shaking"] = draw_shaking(run, size)
    return drawings


def draw_polygons(name: str, polygons: Sequence[Polygon], size: float) -> Drawing:
    """Polygons side by side in one scale, so that the whole is about as large as the mechanism (``size`` [m])."""
    shown = [_worth_drawing(polygon.edges) for polygon in polygons]
    boxes = [_box(edges) for edges in shown]
    widths = [float((high - low).real) for low, high in boxes]
    heights = [float((high - low).imag) for low, high in boxes]
    rows = rows_of(widths, heights)
    gap = 0.12 * max([*widths, *heights, 1e-300])
    strokes: list[Stroke] = []
    marks: list[Mark] = []
    whole = max(
        max(sum(widths[i] + gap for i in row) - gap for row in rows), sum(max(heights[i] for i in row) + gap for row in rows) - gap
    )
    per_metre = whole / (FILL * size) if whole > 0.0 else 1.0
    y = 0.0
    for row in rows:
        x = 0.0
        top = max(heights[i] for i in row)
        for i in row:
            low, _ = boxes[i]
            shift = complex(x, y - top) - low
            for e in shown[i]:
                start, vector, fine = (
                    (e.start + shift) / per_metre,
                    e.vector / per_metre,
                    e.kind == "absolute" and name != "velocity",
                )
                strokes.append(Stroke(pretty(e.name), COLORS[e.kind], start, vector, fine=fine))
            for label, at in polygons[i].images.items():
                marks.append(Mark(polygons[i].name if label == "start" else label, (at + shift) / per_metre))
            x += widths[i] + gap
        y -= top + gap
    closing = np.max([polygon.closing for polygon in polygons], axis=0) if polygons else None
    unit = polygons[0].unit if polygons else "1"
    title = f"{name.capitalize()} plan: 1 m of the drawing = {amount(per_metre, unit)}"
    return Drawing(name, title, tuple(strokes), tuple(marks), per_metre, unit, closing)


def draw_graph(graph: ContourGraph, frames: int, size: float) -> Drawing:
    """The contour graph, about as large as the mechanism: edges with the names of joints, numbered links, numbers of loops."""
    places = layout(graph)
    ends = np.concatenate([places.vertices, *places.edges])
    scale = FILL * size / max(float(np.ptp(ends.real)), float(np.ptp(ends.imag)), 1.0)
    still = np.ones(frames, complex)
    strokes = []
    for edge, z in zip(graph.edges, places.edges, strict=True):
        color = COLORS["reaction" if edge.driven else "load" if edge.higher else "ray"]
        for k, (a, b) in enumerate(pairwise(scale * z)):  # the name stands in the middle
            label = edge.joint if k == (len(z) - 1) // 2 else ""
            strokes.append(Stroke(label, color, a * still, (b - a) * still, plain=True))
    marks = [Mark(f"{k} {name}", scale * z * still) for k, (name, z) in enumerate(zip(graph.links, places.vertices, strict=True))]
    marks += [Mark(loop_number(k), scale * z * still) for k, z in enumerate(places.numbers)]
    return Drawing("graph", "Contour graph", tuple(strokes), tuple(marks), 0.0, "1", whole=True)


def draw_funicular(run: Run, size: float) -> Drawing:
    """Force polygons with poles and rays of all force systems."""
    drawing = draw_polygons("funicular", [s.drawing.polygon() for s in run.studies.systems.values()], size)
    systems = run.studies.systems.values()
    drawn = [s for s in systems if any(e.kind == "resultant" for e in _worth_drawing(s.drawing.polygon().edges))]
    aside = [_aside(s.drawing) * 0.02 * size for s in drawn]
    strokes: list[Stroke] = []
    for i in drawing.strokes:  # where all forces are parallel the resultant stands beside them
        shift = aside.pop(0) if i.color == COLORS["resultant"] else 0j
        strokes.append(Stroke(i.label, i.color, i.start + shift, i.vector, plain=i.color == COLORS["ray"]))
    title = f"Force polygon with pole and rays: 1 m of the drawing = {amount(drawing.per_metre, 'N')}"
    closing = np.max([s.drawing.closing for s in run.studies.systems.values()], axis=0)
    return Drawing("funicular/forces", title, tuple(strokes), drawing.marks, drawing.per_metre, "N", closing)


def draw_shaking(run: Run, size: float) -> Drawing:
    """The shaking force as an arrow from the origin of its polar plot, without and with counterweights."""
    shown = [("before", run.studies.shaking), ("after", run.studies.balanced)]
    forces = [(key, s.force @ np.array([1.0, 1.0j])) for key, s in shown if s is not None]
    largest = max(float(np.nanmax(np.abs(f), initial=0.0)) for _, f in forces)
    single = max(s.single for _, s in shown if s is not None)
    if largest <= 1e-9 * single:  # balanced: drawn in the scale of the links' own inertia forces, not of the rounding
        largest = single
    per_metre = largest / (0.5 * FILL * size) if largest > 0.0 else 1.0
    names = {"before": "shaking force", "after": "with counterweights"}
    zero = np.zeros(run.motion.frames, complex)
    strokes = tuple(Stroke(names[key], COLORS[key], zero, f / per_metre) for key, f in forces)
    title = f"Shaking force, polar: 1 m of the drawing = {amount(per_metre, 'N')}"
    return Drawing("shaking", title, strokes, (), per_metre, "N", least=0.3 * FILL * size, whole=True)


def _aside(f: Funicular) -> complex:
    """The direction away from the pole where all forces are parallel in every frame, else zero."""
    across = np.abs(np.imag(f.forces * np.conj(f.forces[:, :1])))
    if np.any(across > 1e-9 * np.abs(f.forces).max(initial=0.0) ** 2):
        return 0j
    away = complex((f.corners.mean(axis=1) - f.pole)[0])
    return away / abs(away) if away else 0j


def amount(value: float, unit: str) -> str:
    """A scale for people: 48.7 kN, 12.4 m/s."""
    if unit == "N" and value >= 1e4:
        return f"{value / 1e3:.4g} kN"
    return f"{value:.4g} {unit.replace('^2', '²')}"


def pretty(name: str) -> str:
    """``a_CB^n`` as it is written by hand, as far as plain text can."""
    return name.replace("^n", "ⁿ").replace("^t", "ᵗ").replace("^c", "ᶜ").replace("^r", "ʳ")


def _worth_drawing(edges: Sequence[Edge]) -> list[Edge]:
    """Sides without those that vanish all the time and those that repeat another one."""
    largest = max((float(np.nanmax(np.abs(e.vector), initial=0.0)) for e in edges), default=0.0)
    kept: list[Edge] = []
    for e in edges:
        if not np.nanmax(np.abs(e.vector), initial=0.0) > 1e-9 * largest:
            continue
        same = [
            k for k in kept if np.nanmax(np.abs(k.start - e.start) + np.abs(k.vector - e.vector), initial=0.0) <= 1e-9 * largest
        ]
        if not same:
            kept.append(e)
    return kept


def _box(edges: Sequence[Edge]) -> tuple[complex, complex]:
    ends = [z for e in edges for z in (e.start, e.end)]
    z = np.concatenate(ends) if ends else np.zeros(1, complex)
    z = z[np.isfinite(z)]
    if not len(z):
        return 0j, 0j
    return complex(z.real.min(), z.imag.min()), complex(z.real.max(), z.imag.max())


def rows_of(widths: Sequence[float], heights: Sequence[float]) -> list[list[int]]:
    """Which boxes of these sizes stand beside each other: the number of columns that makes the whole most nearly square."""
    n = len(widths)
    best, least = [list(range(n))], np.inf
    for columns in range(1, n + 1):
        rows = [list(range(i, min(i + columns, n))) for i in range(0, n, columns)]
        side = max(max(sum(widths[i] for i in row) for row in rows), sum(max(heights[i] for i in row) for row in rows))
        if side < least:
            best, least = rows, side
    return best
