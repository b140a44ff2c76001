"""Graphical constructions as drawings to scale: arrows with colours and labels in metres of a drawing plane, over all frames.

The functions depend on a `Run` alone; recorder and viewer use them.

The layout of a contour graph makes the distances of vertices as nearly as possible proportional to the number of edges between them
(stress majorization, Gansner, Koren and North 2004). Several starts are tried, and the layout with the fewest crossings is chosen.
Where edges cross in all layouts, those with the vertices of a loop on a circle and every other vertex at the mean of its neighbours
(Tutte 1963) are tried too. The frame is at the bottom.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.constructions.equations import ContourGraph, contour_graph
from mechcore.constructions.force_polygons import Funicular
from mechcore.constructions.polygons import Edge, Polygon
from mechcore.motion.structure import ROMAN
from mechcore.records import dataclass
from mechviz.picture.nodes import Color
from mechviz.scene.units import Units

if TYPE_CHECKING:
    from mechviz.runs import Run


VECTOR_COLORS: Mapping[str, Color] = {
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
"""Colours for a dark background."""

COLOR_LEGENDS: Mapping[str, Mapping[str, str]] = {
    "velocity": {"absolute": "absolute", "relative": "relative", "sliding": "sliding"},
    "acceleration": {
        "absolute": "absolute", "normal": "normal", "tangential": "tangential", "coriolis": "Coriolis", "sliding": "sliding",
    },
    "force": {"reaction": "reactions", "inner": "between links", "load": "loads", "inertia": "inertia", "gravity": "weights"},
    "shaking": {"before": "without counterweights", "after": "with counterweights"},
}  # fmt: skip
"""Meanings of the colours of a drawing, by the drawing's name."""

USUAL_FRAMES = 0.9  # quantile of the frames, on each side, that a view covers where some frames extend far out
FARTHEST_ROOM = 1.7  # in sizes of that view: a drawing that is no larger is covered at all frames
DRAWING_SIZE = 1.0  # size of a drawing, in sizes of the mechanism


@dataclass(frozen=True, eq=False)
class DrawnArrow:
    """An arrow (F,) in the drawing plane [m] with its label; ``headless``: a plain line; ``thin``: a thin arrow."""

    label: str
    color: Color
    start: Complex
    vector: Complex
    headless: bool = False
    thin: bool = False


@dataclass(frozen=True, eq=False)
class NamedPoint:
    """A named point (F,) of the drawing plane [m]."""

    label: str
    position: Complex


@dataclass(frozen=True, eq=False)
class Drawing:
    """Arrows and points in the drawing plane, and the scale ``per_metre``: units of the quantity per metre, 0 without a scale.
    ``closing`` (F,): closure error of the polygons, relative to the longest side."""

    name: str
    title: str
    arrows: tuple[DrawnArrow, ...]
    points: tuple[NamedPoint, ...]
    per_metre: float
    unit: str
    closing: Real | None = None

    least: float = 0.0  # least extent of a view [m]
    whole: bool = False  # whether a view covers all frames in any case

    @property
    def curves(self) -> list[tuple[Color, Complex]]:
        """Colours and points (F,) of the paths of the arrow tips, which only the polar plot shows; empty for other drawings."""
        polar = self.name == "shaking"
        return [(i.color, i.start + i.vector) for i in self.arrows if not i.headless] if polar else []

    @property
    def legend(self) -> list[tuple[str, Color]]:
        """Meaning and colour of the colours in the drawing; empty where there is only one."""
        there = {arrow.color for arrow in self.arrows}
        entries = [
            (words, VECTOR_COLORS[key]) for key, words in COLOR_LEGENDS.get(self.name, {}).items() if VECTOR_COLORS[key] in there
        ]
        return entries if len(entries) > 1 else []

    @property
    def bounds(self) -> Real:
        """Box (2, 2) [m] around the drawing at all frames; where some frames extend far out, around nine tenths of them on each
        side."""
        ends = [z for arrow in self.arrows for z in (arrow.start, arrow.start + arrow.vector)] + [m.position for m in self.points]
        if not ends:
            return np.zeros((2, 2))
        z = np.array(ends)
        z = z[:, np.isfinite(z).all(axis=0)]
        if not z.size:
            return np.zeros((2, 2))
        low = np.array([np.quantile(part.min(axis=0), 1.0 - USUAL_FRAMES) for part in (z.real, z.imag)])
        high = np.array([np.quantile(part.max(axis=0), USUAL_FRAMES) for part in (z.real, z.imag)])
        least, most = np.array([z.real.min(), z.imag.min()]), np.array([z.real.max(), z.imag.max()])
        if self.whole or np.max(most - least) <= FARTHEST_ROOM * np.max(high - low):
            low, high = least, most
        half = 0.5 * self.least
        return np.array([np.minimum(low, -half), np.maximum(high, half)]) if half else np.array([low, high])


def drawings_of(run: Run, size: float) -> dict[str, Drawing]:
    """All drawings that the scene of a run names, by the name of their entity under ``polygons``."""
    studies = run.studies
    drawings = {name: draw_polygons(name, polygons, size, run.scene.units) for name, polygons in studies.polygons.items()}
    if "graph" in run.motion.mechanism.studies.polygons:
        drawings["graph"] = draw_graph(contour_graph(run.motion.model), run.motion.frames, size)
    if studies.systems:
        drawings["funicular/forces"] = draw_funicular(run, size)
    if studies.shaking is not None:
        drawings["shaking"] = draw_shaking(run, size)
    return drawings


def draw_polygons(name: str, polygons: Sequence[Polygon], size: float, units: Units) -> Drawing:
    """Drawing of polygons side by side at one scale, together about as large as the mechanism (``size`` [m]); labels in
    ``units``."""
    shown = [_worth_drawing(polygon.edges) for polygon in polygons]
    boxes = [_box(edges) for edges in shown]
    widths = [float((high - low).real) for low, high in boxes]
    heights = [float((high - low).imag) for low, high in boxes]
    rows = grid_columns(widths, heights)
    gap = 0.12 * max([*widths, *heights, 1e-300])
    arrows: list[DrawnArrow] = []
    points: list[NamedPoint] = []
    whole = max(
        max(sum(widths[i] + gap for i in row) - gap for row in rows), sum(max(heights[i] for i in row) + gap for row in rows) - gap
    )
    per_metre = whole / (DRAWING_SIZE * size) if whole > 0.0 else 1.0
    y = 0.0
    for row in rows:
        x = 0.0
        top = max(heights[i] for i in row)
        for i in row:
            low, _ = boxes[i]
            shift = complex(x, y - top) - low
            for e in shown[i]:
                start, vector, thin = (
                    (e.start + shift) / per_metre,
                    e.vector / per_metre,
                    e.kind == "absolute" and name != "velocity",
                )
                arrows.append(DrawnArrow(pretty(e.name), VECTOR_COLORS[e.kind], start, vector, thin=thin))
            for label, at in polygons[i].images.items():
                points.append(NamedPoint(polygons[i].name if label == "start" else label, (at + shift) / per_metre))
            x += widths[i] + gap
        y -= top + gap
    closing = np.max([polygon.closing for polygon in polygons], axis=0) if polygons else None
    unit = polygons[0].unit if polygons else "1"
    title = f"{name.capitalize()} polygon: {scale_title(units, per_metre, unit)}"
    return Drawing(name, title, tuple(arrows), tuple(points), per_metre, unit, closing)


def draw_graph(graph: ContourGraph, frames: int, size: float) -> Drawing:
    """Drawing of the contour graph, about as large as the mechanism (``size`` [m]): edges with the names of joints, numbered links,
    loop numbers."""
    places = graph_layout(graph)
    ends = np.concatenate([places.vertices, *places.edges])
    scale = DRAWING_SIZE * size / max(float(np.ptp(ends.real)), float(np.ptp(ends.imag)), 1.0)
    still = np.ones(frames, complex)
    arrows = []
    for edge, z in zip(graph.edges, places.edges, strict=True):
        color = VECTOR_COLORS["reaction" if edge.driven else "load" if edge.higher else "ray"]
        for k, (a, b) in enumerate(pairwise(scale * z)):  # the middle segment has the label
            label = edge.joint if k == (len(z) - 1) // 2 else ""
            arrows.append(DrawnArrow(label, color, a * still, (b - a) * still, headless=True))
    points = [
        NamedPoint(f"{k} {name}", scale * z * still) for k, (name, z) in enumerate(zip(graph.links, places.vertices, strict=True))
    ]
    points += [NamedPoint(loop_number(k), scale * z * still) for k, z in enumerate(places.numbers)]
    return Drawing("graph", "Contour graph", tuple(arrows), tuple(points), 0.0, "1", whole=True)


def draw_funicular(run: Run, size: float) -> Drawing:
    """Drawing of the force polygons of all force systems, with poles and rays."""
    drawing = draw_polygons("funicular", [s.drawing.polygon() for s in run.studies.systems.values()], size, run.scene.units)
    systems = run.studies.systems.values()
    drawn = [s for s in systems if any(e.kind == "resultant" for e in _worth_drawing(s.drawing.polygon().edges))]
    aside = [_aside(s.drawing) * 0.02 * size for s in drawn]
    arrows: list[DrawnArrow] = []
    for i in drawing.arrows:  # the resultant of parallel forces is drawn beside them
        shift = aside.pop(0) if i.color == VECTOR_COLORS["resultant"] else 0j
        arrows.append(DrawnArrow(i.label, i.color, i.start + shift, i.vector, headless=i.color == VECTOR_COLORS["ray"]))
    title = f"Force polygon with pole and rays: {scale_title(run.scene.units, drawing.per_metre, 'N')}"
    closing = np.max([s.drawing.closing for s in run.studies.systems.values()], axis=0)
    return Drawing("funicular/forces", title, tuple(arrows), drawing.points, drawing.per_metre, "N", closing)


def draw_shaking(run: Run, size: float) -> Drawing:
    """Polar plot of the shaking force without and with counterweights: arrows from the origin."""
    shown = [("before", run.studies.shaking), ("after", run.studies.balanced)]
    forces = [(key, s.force @ np.array([1.0, 1.0j])) for key, s in shown if s is not None]
    largest = max(float(np.nanmax(np.abs(f), initial=0.0)) for _, f in forces)
    single = max(s.single for _, s in shown if s is not None)
    if largest <= 1e-9 * single:  # balanced: the scale is that of the links' own inertia forces, not that of rounding
        largest = single
    per_metre = largest / (0.5 * DRAWING_SIZE * size) if largest > 0.0 else 1.0
    names = {"before": "shaking force", "after": "with counterweights"}
    zero = np.zeros(run.motion.frames, complex)
    arrows = tuple(DrawnArrow(names[key], VECTOR_COLORS[key], zero, f / per_metre) for key, f in forces)
    title = f"Shaking force, polar: {scale_title(run.scene.units, per_metre, 'N')}"
    return Drawing("shaking", title, arrows, (), per_metre, "N", least=0.3 * DRAWING_SIZE * size, whole=True)


def _aside(f: Funicular) -> complex:
    """Unit direction away from the pole where all forces are parallel at every frame; else zero."""
    across = np.abs(np.imag(f.forces * np.conj(f.forces[:, :1])))
    if np.any(across > 1e-9 * np.abs(f.forces).max(initial=0.0) ** 2):
        return 0j
    away = complex((f.corners.mean(axis=1) - f.pole)[0])
    return away / abs(away) if away else 0j


def scale_title(units: Units, per_metre: float, si: str) -> str:
    """A scale of ``per_metre`` units ``si`` per metre in words, such as "1 m of the drawing = 48.7 kN"."""
    (unit, factor), (length, per) = units.display_unit(si), units.display_unit("m", small=True)
    value = per_metre * factor / per
    amount = f"{value / 1e3:.4g} kN" if unit == "N" and value >= 1e4 else f"{value:.4g} {unit}"
    return f"1 {length} of the drawing = {amount}"


def pretty(name: str) -> str:
    """A name such as ``a_CB^n`` with superscript characters."""
    return name.replace("^n", "ⁿ").replace("^t", "ᵗ").replace("^c", "ᶜ").replace("^r", "ʳ")


def _worth_drawing(edges: Sequence[Edge]) -> list[Edge]:
    """The sides of a polygon without those that are zero at all frames, and those that equal another one at all frames."""
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


def grid_columns(widths: Sequence[float], heights: Sequence[float]) -> list[list[int]]:
    """Rows of a grid of boxes, each the indices of its boxes; the number of columns makes the grid most nearly square."""
    n = len(widths)
    best, least = [list(range(n))], np.inf
    for columns in range(1, n + 1):
        rows = [list(range(i, min(i + columns, n))) for i in range(0, n, columns)]
        side = max(max(sum(widths[i] for i in row) for row in rows), sum(max(heights[i] for i in row) for row in rows))
        if side < least:
            best, least = rows, side
    return best


LAYOUT_STARTS, LAYOUT_ROUNDS = 24, 120
"""Number of layouts that are tried, and of iterations for each."""
EDGE_BEND = 0.22
"""Distance by which edges between the same two vertices bend apart, in edge lengths."""
LOOP_NUMBER_SPACING = 0.45
"""Least distance of loop numbers from each other, in edge lengths."""
VERTEX_CLEARANCE = 0.15
"""Distance from another vertex or an edge, in edge lengths, below which a vertex counts as lying on it."""
CURVE_POINTS = 15


@dataclass(frozen=True, eq=False)
class GraphLayout:
    """Layout of a graph in edge lengths, centred at the origin: positions of ``vertices`` (n,), points along each of the ``edges``,
    and positions of the loop ``numbers`` (m,)."""

    vertices: Complex
    edges: tuple[Complex, ...]
    numbers: Complex


def loop_number(k: int) -> str:
    """Roman numeral I, II, III, ... of the loop with index k."""
    return ROMAN[k + 1] if k + 1 < len(ROMAN) else str(k + 1)


def graph_layout(graph: ContourGraph) -> GraphLayout:
    """The layout of a graph; deterministic."""
    pairs = [edge.ends for edge in graph.edges]
    places = _spread(len(graph.links), pairs, [vertices for vertices, _ in graph.loops])
    curves: list[Complex] = []
    for k, (p, q) in enumerate(pairs):
        alike = [i for i, ends in enumerate(pairs) if set(ends) == {p, q}]
        aside = EDGE_BEND * (alike.index(k) - 0.5 * (len(alike) - 1)) * (1.0 if p < q else -1.0)
        along = np.linspace(0.0, 1.0, CURVE_POINTS if aside else 2)
        curves.append(places[p] + (along + 4j * aside * along * (1.0 - along)) * (places[q] - places[p]))
    numbers = np.array([_middle([curves[e] for e in edges]) for _, edges in graph.loops], complex)
    for _ in range(60):  # moves the numbers of nested loops apart
        for a, b in combinations(range(len(numbers)), 2):
            gap = numbers[b] - numbers[a]
            if abs(gap) < LOOP_NUMBER_SPACING:
                push = 0.5 * (LOOP_NUMBER_SPACING - abs(gap)) * (gap / abs(gap) if abs(gap) > 1e-9 else 1.0)
                numbers[a] -= push
                numbers[b] += push
    return GraphLayout(places, tuple(curves), numbers)


def _middle(curves: Sequence[Complex]) -> complex:
    return complex(np.mean([z[1:-1].mean() if len(z) > 2 else z.mean() for z in curves]))


def _spread(count: int, pairs: Sequence[tuple[int, int]], loops: Sequence[Sequence[int]]) -> Complex:
    """Positions (n,) of vertices, centred at the origin, the first vertex at the bottom."""
    far = _distances(count, pairs)
    random = np.random.default_rng(1)
    best, least = np.zeros(count, complex), (np.inf, np.inf)
    for start in range(LAYOUT_STARTS if count > 3 else 1):
        order = np.arange(count) if not start else random.permutation(count)
        z = _majorized(np.exp(2j * np.pi * np.argsort(order) / count) * count / (2.0 * np.pi), far)
        cost = (float(_crossings(z, pairs)), _stress(z, far))
        if cost[0] < least[0] or (cost[0] == least[0] and cost[1] < least[1] - 1e-6):
            best, least = z, cost
    for loop in loops if least[0] else ():
        z = _around(count, pairs, loop)
        if _crossings(z, pairs) < least[0]:
            best, least = z, (float(_crossings(z, pairs)), 0.0)
    best = best - best.mean()
    return np.asarray(best * np.exp(-1j * (np.angle(best[0]) + 0.5 * np.pi)) if abs(best[0]) > 1e-9 else best)


def _around(count: int, pairs: Sequence[tuple[int, int]], loop: Sequence[int]) -> Complex:
    """Positions (n,) with the vertices of a loop on a circle, and every other vertex at the mean of its neighbours."""
    z = np.zeros(count, complex)
    z[list(loop)] = 0.3 * count * np.exp(2j * np.pi * np.arange(len(loop)) / len(loop))
    inner = [k for k in range(count) if k not in loop]
    laplacian = np.zeros((count, count))
    for p, q in {(min(e), max(e)) for e in pairs}:
        laplacian[[p, q], [p, q]] += 1.0
        laplacian[[p, q], [q, p]] -= 1.0
    if inner:
        z[inner] = np.linalg.solve(laplacian[np.ix_(inner, inner)], -laplacian[np.ix_(inner, list(loop))] @ z[list(loop)])
    return z


def _distances(count: int, pairs: Sequence[tuple[int, int]]) -> Real:
    """Number of edges (n, n) on the shortest path between any two vertices (Floyd and Warshall)."""
    far = np.full((count, count), float(count))
    np.fill_diagonal(far, 0.0)
    for p, q in pairs:
        if p != q:
            far[p, q] = far[q, p] = 1.0
    for k in range(count):
        far = np.minimum(far, far[:, k : k + 1] + far[k])
    return far


def _majorized(z: Complex, far: Real) -> Complex:
    """Positions after iterations that reduce the stress, the sum of ((distance - ``far``) / ``far``)^2."""
    count = len(z)
    if count < 2:
        return z
    weights = np.divide(1.0, far * far, out=np.zeros_like(far), where=far > 0.0)
    laplacian = np.diag(weights.sum(axis=1)) - weights + np.ones((count, count)) / count
    inverse = np.linalg.inv(laplacian)
    for _ in range(LAYOUT_ROUNDS):
        apart = np.abs(z[:, None] - z)
        ratio = np.divide(weights * far, apart, out=np.zeros_like(far), where=apart > 1e-12)
        z = inverse @ (ratio.sum(axis=1) * z - ratio @ z)
        z = z - z.mean()
    return np.asarray(z)


def _stress(z: Complex, far: Real) -> float:
    some = far > 0.0
    return float((((np.abs(z[:, None] - z) - far)[some] / far[some]) ** 2).sum())


def _crossings(z: Complex, pairs: Sequence[tuple[int, int]]) -> int:
    """Number of crossings: of edges without a common end, of vertices on other vertices, and of vertices on edges of others."""
    apart = np.abs(z[:, None] - z) + len(z) * np.eye(len(z))
    count = int((apart < VERTEX_CLEARANCE).sum()) // 2
    for p, q in pairs:
        along = z[q] - z[p]
        for k in set(range(len(z))) - {p, q} if abs(along) > VERTEX_CLEARANCE else ():
            part = ((z[k] - z[p]) / along).real
            count += int(abs(z[p] + np.clip(part, 0.0, 1.0) * along - z[k]) < VERTEX_CLEARANCE)
    for (a, b), (c, d) in combinations({(min(e), max(e)) for e in pairs}, 2):
        if {a, b} & {c, d}:
            continue
        sides = [((z[q] - z[p]).conjugate() * (z[r] - z[p])).imag for p, q, r in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))]
        count += int(sides[0] * sides[1] < 0.0 and sides[2] * sides[3] < 0.0)
    return count
