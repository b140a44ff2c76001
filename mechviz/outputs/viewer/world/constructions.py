"""Graphical constructions beside the mechanism, to scale in the coordinates of the scene, and constructions drawn on it.

Velocity and acceleration polygons, force polygons and polar plots stand beside the mechanism, as lines with labels that move with
the frame; funicular polygons, centrodes and substitute masses lie on the mechanism. Every construction has its own switch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from mechcore.arrays import Complex, Flags, Real, Single
from mechcore.records import dataclass
from mechviz.outputs.viewer.view_model import ViewModel
from mechviz.outputs.viewer.words import scale_line
from mechviz.outputs.viewer.world.bodies import segments
from mechviz.outputs.viewer.world.labels import LabelPlacer, half_sizes, typeset
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.picture.centres import CENTRE_GROUPS
from mechviz.picture.constructions import Drawing, grid_columns
from mechviz.picture.nodes import ArrowSet, Color, Lines, Node, Points
from mechviz.picture.overlays import HIDDEN_DIAGRAMS, INVERSION_GROUP, INVERSION_TITLE, SECTION_DIAGRAMS

BARB_LENGTH = 0.035  # length of the lines of an arrowhead, in sizes of the mechanism; at most a third of the arrow's length
BARB_ANGLE = 0.36  # [rad]
DRAWING_GAP = 0.22  # between the mechanism and the drawings beside it, in sizes of the mechanism
HEADING_LINE = 17.0  # [px] height of a line of the heading above a drawing
HEADING_LINES = 4  # lines of a heading: title, scale, a legend in up to two rows
SWATCH_LENGTH = 10.0  # [px] length of a line of the legend
LAYOUT_ROUNDS = 3  # iterations of the layout: the room for headings and the scale of the picture depend on each other
LEAST_LABEL = 0.035  # a side shorter than this, in sizes of the mechanism, has no label: it would hide its neighbours
LEAST_SCREEN = 400  # [px] a picture less wide or high than this has no room for legends
USUAL_SCREEN = (560, 520)  # [px] assumed size of the picture, until a browser has sent its own
SAME_LABEL_DISTANCE = 0.045  # a point this near to an earlier one, in sizes of the mechanism, has no label of its own


DIAGRAM_ANCHORS = dict(zip(SECTION_DIAGRAMS, ("bottom-left", "top-left", "bottom-right"), strict=True))
"""Anchors of the labels of section diagrams, whose largest ordinates may lie beside each other."""
OVERLAY_GROUPS = {
    "Centrodes": ("polodes", "polode"),
    "Funicular polygon": ("funicular",),
    "Equivalent linkages": ("equivalent",),
    INVERSION_TITLE: (INVERSION_GROUP,),
    "Substitute masses": ("substitutes",),
    **{words: (group,) for group, (words, _) in CENTRE_GROUPS.items()},
    **{diagram.title: (group,) for group, diagram in SECTION_DIAGRAMS.items()},
}
"""Groups of the picture by the label of their switch."""


def on_light(color: Color) -> Color:
    """A colour of the drawings, which is chosen for a dark background, for a light background."""
    if min(color) > 200:  # white becomes black
        return (34, 38, 46)
    red, green, blue = (int(0.68 * c) for c in color)
    return red, green, blue


def readable_color(color: Color) -> str:
    """A colour of the drawings for a stylesheet, by whether the page is light or dark."""
    return "light-dark(#{:02x}{:02x}{:02x},#{:02x}{:02x}{:02x})".format(*on_light(color), *color)


def faint(color: Color, dark: bool) -> Color:
    """A colour half way to that of the background."""
    red, green, blue = (int(0.5 * c + (12 if dark else 128)) for c in color)
    return red, green, blue


def _as_light(colors: Sequence[Color] | NDArray[Any]) -> NDArray[np.uint8]:
    """Colours (n, 3) for lines: viser's shader takes them as linear light, not as screen colours (gamma 2.2)."""
    return np.round(255.0 * (np.array(colors, float) / 255.0) ** 2.2).astype(np.uint8)


def arrow_lines(start: Complex, vector: Complex, heads: Flags, barb: float) -> Complex:
    """Line segments (3 n, 2) of arrows (n,): shafts, then both lines of each head, of zero length for arrows without head."""
    finite = np.isfinite(start) & np.isfinite(vector)
    start, vector = np.where(finite, start, 0.0), np.where(finite, vector, 0.0)
    end = start + vector
    length = np.abs(vector)
    back = np.where(heads, -np.minimum(barb, length / 3.0) * vector / np.where(length > 0.0, length, 1.0), 0.0)
    sides = [np.stack([end, end + back * np.exp(sign * 1j * BARB_ANGLE)], axis=1) for sign in (1.0, -1.0)]
    return np.concatenate([np.stack([start, end], axis=1), *sides])


def placed(mechanism: Real, boxes: Sequence[Real], gap: float, caption: float, aspect: float = 1.0) -> list[complex]:
    """Shifts (complex) [m] that place boxes (2, 2) [m] beside and below that of the mechanism, in rows, without overlap, arranged
    so that they are as large as possible in a picture of width over height ``aspect``."""
    sizes = [mechanism[1] - mechanism[0], *(b[1] - b[0] for b in boxes)]
    widths, heights = [float(s[0]) + gap for s in sizes], [float(s[1]) + gap + caption for s in sizes]
    shifts: list[complex] = []
    y = float(mechanism[1, 1])
    for row in grid_columns([width / aspect for width in widths], heights):
        x = float(mechanism[0, 0])
        for i in row:
            if i:
                low, high = boxes[i - 1]
                shifts.append(complex(x - low[0], y - high[1] - (caption if row[0] else 0.0)))
            x += widths[i]
        y -= max(heights[i] for i in row)
    return shifts


def _room(drawing: Drawing, heading: Mapping[str, float], per_pixel: float) -> Real:
    """The box (2, 2) [m] of a drawing, at least as wide as its heading; ``heading``: letter sizes by line."""
    widths = half_sizes(list(heading), per_pixel)[:, 0] * list(heading.values())
    middle, half = drawing.bounds[:, 0].mean(), float(widths.max())
    return np.array(
        [np.minimum(drawing.bounds[0], [middle - half, np.inf]), np.maximum(drawing.bounds[1], [middle + half, -np.inf])]
    )


def _apart(z: Complex, least: float) -> Complex:
    """Points (n,), with NaN for those that are nearer than ``least`` to an earlier one, which has the label."""
    out = np.array(z, complex)
    for k in range(1, len(out)):
        with np.errstate(invalid="ignore"):
            if (np.abs(out[:k] - out[k]) < least).any():
                out[k] = np.nan
    return out


@dataclass(frozen=True, eq=False)
class Construction:
    """The ``nodes`` of one switch, and the function ``show`` that moves them to a frame; ``moves``: whether they change at all."""

    nodes: tuple[viser.LineSegmentsHandle | viser.LabelHandle | viser.IcosphereHandle, ...]
    show: Callable[[int], None]
    moves: bool = True


class ConstructionNodes:
    """All constructions of a run by the labels of their switches; ``show`` moves those that are on to a frame."""

    def __init__(self, server: viser.ViserServer, view_model: ViewModel):
        self._server = server
        self._on: dict[str, bool] = {}
        self._dark = False
        self._lines_painted: list[tuple[viser.LineSegmentsHandle, Sequence[Color], bool]] = []
        self._balls_painted: list[tuple[viser.IcosphereHandle, Color]] = []
        self.screen, self._per_pixel = USUAL_SCREEN, 1.0
        self.constructions: dict[str, Construction] = {}
        self.update(view_model)

    def fit(self, screen: tuple[int, int]) -> bool:
        """Arrange the drawings for a picture of this width and height [px]; return whether they were arranged anew."""
        moved = bool(self.places) and self.screen != screen
        self.screen = screen
        if moved:
            self.update(self._view_model)
        return moved

    def update(self, view_model: ViewModel) -> None:
        """Replace the constructions by those of ``view_model``."""
        for construction in self.constructions.values():
            for node in construction.nodes:
                if self._server.scene.get_handle_by_name(node.name) is node:  # a child node is removed with its parent
                    node.remove()
        self.constructions = {}
        self._lines_painted, self._balls_painted = [], []
        self.bounds: Real | None = None
        """Box (2, 2) [m] around the drawings beside the mechanism."""
        self.places: Mapping[str, complex] = {}
        self._view_model = view_model
        self._size, self._units = view_model.size, view_model.units
        self._z = view_model.z_top + 0.03 * view_model.size
        drawings = view_model.drawings()
        self._lay_out(drawings)
        for name, drawing in drawings.items():
            self._add(drawing.title.split(":")[0], self._drawing(name, drawing, self.places[name]))
        for words, groups in OVERLAY_GROUPS.items():
            drawn = [node for node in view_model.picture.nodes if node.group in groups]
            if drawn:
                self._on.setdefault(words, drawn[0].group not in HIDDEN_DIAGRAMS)
                self._add(words, self._overlay(drawn))

    def __len__(self) -> int:
        return len(self.constructions)

    @property
    def moves(self) -> bool:
        """Whether any construction that is on changes from frame to frame."""
        return any(self._on[name] and c.moves for name, c in self.constructions.items())

    def is_on(self, name: str) -> bool:
        """Whether a construction is on; True for unknown names."""
        return self._on.get(name, True)

    def switch(self, name: str, on: bool) -> None:
        """Show or hide a construction."""
        self._on[name] = on
        for node in self.constructions[name].nodes:
            node.visible = on

    def darken(self, dark: bool) -> None:
        """Use the colours for a dark or a light page."""
        self._dark = dark
        for lines, colors, pale in self._lines_painted:
            lines.colors = self._shades(colors, pale)
        for ball, color in self._balls_painted:
            ball.color = self._shade(color)

    def show(self, frame: int) -> None:
        for name, construction in self.constructions.items():
            if self._on[name]:
                construction.show(frame)

    # -- inside -------------------------------------------------------------------------------------------------------
    def _lay_out(self, drawings: Mapping[str, Drawing]) -> None:
        """Find the positions of the drawings beside the mechanism, with room for headings, whose letters have a fixed size [px]."""
        box = self._view_model.bounds[:, :2]
        per_pixel = float(np.max(np.ptp(box, axis=0) / self.screen))
        for _ in range(LAYOUT_ROUNDS if drawings else 0):
            heading = (HEADING_LINES if self._large else 2) * HEADING_LINE * per_pixel
            aspect = self.screen[0] / self.screen[1]
            rooms = [_room(d, self._titles(d), per_pixel) for d in drawings.values()]
            shifts = placed(box, rooms, DRAWING_GAP * self._size, heading, aspect)
            boxes = [room + np.array([z.real, z.imag]) for room, z in zip(rooms, shifts, strict=True)]
            low = np.min([b[0] for b in boxes], axis=0)
            self.bounds = np.array([low, np.max([b[1] for b in boxes], axis=0) + np.array([0.0, heading])])
            self.places = dict(zip(drawings, shifts, strict=True))
            whole = np.maximum(self.bounds[1], box[1]) - np.minimum(low, box[0])
            per_pixel = float(np.max(whole / self.screen))
        self._per_pixel = per_pixel

    def _titles(self, drawing: Drawing) -> dict[str, float]:
        """Sizes of letters by line of text: the scale of a drawing, if it has one, and its title."""
        lines = {scale_line(self._units, drawing.unit, drawing.per_metre, self._size): 0.8} if drawing.per_metre else {}
        return lines | {drawing.title.split(":")[0]: 1.0}

    @property
    def _large(self) -> bool:
        return min(self.screen) >= LEAST_SCREEN

    def _add(self, name: str, construction: Construction) -> None:
        self.constructions[name] = construction
        if not self._on.setdefault(name, True):
            for node in construction.nodes:
                node.visible = False

    def _space(self, z: Complex) -> Single:
        return np.stack([z.real, z.imag, np.full(z.shape, self._z)], axis=-1).astype(np.float32)

    def _shade(self, color: Color) -> Color:
        return color if self._dark else on_light(color)

    def _shades(self, colors: Sequence[Color], pale: bool) -> NDArray[np.uint8]:
        """Colours (n, 2, 3) of lines at both ends."""
        shades = [self._shade(color) for color in colors]
        return np.repeat(_as_light([faint(c, self._dark) for c in shades] if pale else shades)[:, None], 2, axis=1)

    def _lines(
        self, path: str, points: Single, colors: Sequence[Color], width: float, *, pale: bool = False
    ) -> viser.LineSegmentsHandle:
        """A node of line segments (n, 2, 3) [m] in ``colors`` for a dark background; ``pale``: half way to the background."""
        node = self._server.scene.add_line_segments(
            path, points, self._shades(colors, pale), thickness=width, thickness_units="screen"
        )
        self._lines_painted.append((node, colors, pale))
        return node

    def _label(self, path: str, text: str, large: float = 0.85, anchor: str = "center-center") -> viser.LabelHandle:
        return self._server.scene.add_label(path, typeset(text), anchor=anchor, font_screen_scale=large)

    def _drawing(self, name: str, drawing: Drawing, at: complex) -> Construction:
        """Nodes of a drawing: arrows with labels at their middles, labelled points, curves, and a heading with the scale."""
        strokes, marks, size = drawing.arrows, drawing.points, self._size
        path = f"/drawings/{name}"
        frames = self._view_model.frames
        starts = np.array([i.start for i in strokes], complex).reshape(len(strokes), frames) + at
        vectors = np.array([i.vector for i in strokes], complex).reshape(len(strokes), frames)
        heads = np.array([not i.headless for i in strokes], bool)
        shades = [i.color for i in strokes] * 3
        nodes: list[viser.LineSegmentsHandle | viser.LabelHandle | viser.IcosphereHandle] = []
        arrows = None
        if strokes:
            arrows = self._lines(
                path, self._space(arrow_lines(starts[:, 0], vectors[:, 0], heads, BARB_LENGTH * size)), shades, 2.0
            )
            nodes.append(arrows)
        words = [self._label(f"{path}/side {k}", i.label) for k, i in enumerate(strokes) if i.label]
        named = [k for k, i in enumerate(strokes) if i.label]
        points = [self._label(f"{path}/point {k}", m.label) for k, m in enumerate(marks)]
        per_pixel = self._per_pixel
        texts = [strokes[k].label for k in named], [m.label for m in marks]
        heading, taken = self._heading(path, drawing, at)
        stand = LabelPlacer(half_sizes(texts[0], per_pixel), half_sizes(texts[1], per_pixel), 3.0 * per_pixel, taken)
        anchors = np.array([m.position for m in marks], complex).reshape(len(marks), frames) + at
        nodes += [*words, *points, *heading]
        for k, (color, tips) in enumerate(drawing.curves):
            z = tips[np.isfinite(tips)] + at
            if len(z) > 1:
                curve = self._space(np.stack([z[:-1], z[1:]], axis=1))
                nodes.append(self._lines(f"{path}/polar {k}", curve, [color] * len(curve), 2.0, pale=True))

        def set_frame(frame: int) -> None:
            if arrows is not None:
                arrows.points = self._space(arrow_lines(starts[:, frame], vectors[:, frame], heads, BARB_LENGTH * size))
            start, vector = starts[named, frame], vectors[named, frame]
            start = np.where(np.abs(vector) >= LEAST_LABEL * size, start, np.nan)
            marked = _apart(anchors[:, frame], SAME_LABEL_DISTANCE * size)
            for labels, places in zip((words, points), stand(start, vector, marked), strict=True):
                self._stand(labels, places)

        return Construction(tuple(nodes), set_frame)

    def _heading(
        self, path: str, drawing: Drawing, at: complex
    ) -> tuple[list[viser.LineSegmentsHandle | viser.LabelHandle], list[tuple[complex, Real]]]:
        """Nodes of the title of a drawing, its scale and its legend, in lines above it; and the boxes that they occupy, as centres
        and half sizes."""
        low, high = drawing.bounds + np.array([at.real, at.imag])
        per_pixel = self._per_pixel
        middle, line, swatch = 0.5 * (low[0] + high[0]), HEADING_LINE * per_pixel, SWATCH_LENGTH * per_pixel

        def wide(words: Sequence[str], room: float = 0.0) -> float:
            return float(np.sum(2.0 * half_sizes(list(words), per_pixel)[:, 0] + room))

        legend = drawing.legend if self._large else []
        rows: list[list[tuple[str, Color]]] = [[]]
        most = max(high[0] - low[0] + DRAWING_GAP * self._size, 0.55 * wide([words for words, _ in legend], 2.0 * swatch))
        for entry in legend:
            if rows[-1] and wide([words for words, _ in (*rows[-1], entry)], 2.0 * swatch) > most:
                rows.append([])
            rows[-1].append(entry)
        nodes: list[viser.LineSegmentsHandle | viser.LabelHandle] = []
        taken, height = [], high[1] + 0.5 * line
        ends, colors = [], []
        for row in reversed([row for row in rows if row]):
            x = middle - 0.5 * wide([words for words, _ in row], 2.0 * swatch)
            for words, color in row:
                ends.append([complex(x, height), complex(x + swatch, height)])
                colors.append(color)
                label = self._label(f"{path}/legend {words}", words, 0.8, "center-left")
                label.position = (x + 1.3 * swatch, height, self._z)
                nodes.append(label)
                x += wide([words], 2.0 * swatch)
            taken.append((complex(middle, height), np.array([x - middle, 0.5 * line])))
            height += line
        if ends:
            nodes.append(self._lines(f"{path}/legend", self._space(np.array(ends)), colors, 3.0))
        for text, large in self._titles(drawing).items():
            label = self._label(f"{path}/{'caption' if large == 1.0 else 'scale'}", text, large)
            label.position = (middle, height, self._z)
            nodes.append(label)
            taken.append((complex(middle, height), np.array([0.5 * wide([text]), 0.5 * line])))
            height += line
        return nodes, taken

    def _stand(self, labels: Iterable[Any], places: Iterable[Any]) -> None:
        """Move labels to points x + iy of the plane; labels whose point is NaN are hidden."""
        for label, z in zip(labels, places, strict=True):
            seen = bool(np.isfinite(z))
            if label.visible != seen:
                label.visible = seen
            if seen:
                label.position = (z.real, z.imag, self._z)

    def _overlay(self, drawn: Sequence[Node]) -> Construction:
        """The construction of lines, arrows and points of the picture that are drawn on the mechanism."""
        nodes: list[viser.LineSegmentsHandle | viser.LabelHandle | viser.IcosphereHandle] = []
        shows: list[Callable[[int], None]] = []
        for node in drawn:
            path = f"/overlays/{node.key.replace('/', '_')}"
            match node:
                case Lines() if node.moves:
                    counts = [strip.shape[1] - 1 for strip in node.strips]
                    colors = node.colors if len(node.colors) > 1 else node.colors * len(counts)
                    shades = [c for color, count in zip(colors, counts, strict=True) for c in [color] * count]
                    lines = self._lines(path, segments(node, 0), shades, 2.5)
                    named = [(k, self._label(f"{path}/line {k}", text)) for k, text in enumerate(node.labels) if text]
                    nodes += [lines, *(label for _, label in named)]
                    shows.append(partial(_bend, node, lines, named, self._view_model.bounds[:, :2].mean(axis=0)))
                case Lines():
                    below = f"{link_path(node.parent)}/{node.key.replace('/', '_')}" if node.parent else path
                    flat = segments(node, 0)
                    nodes.append(self._lines(below, flat, [node.colors[0]] * len(flat), 2.5))
                case ArrowSet():
                    shades = [*node.colors] * (node.origins.shape[1] // len(node.colors)) * 3
                    arrows = self._lines(path, _arrow_segments(node, 0, self._size), shades, 3.0)
                    named = [(k, self._label(f"{path}/arrow {k}", text, 1.0)) for k, text in enumerate(node.labels) if text]
                    nodes += [arrows, *(label for _, label in named)]
                    shows.append(partial(_point, node, arrows, named, self._size, HEADING_LINE * self._per_pixel))
                case Points():
                    shades = [*node.colors] * (node.places.shape[1] // len(node.colors))
                    dots = []
                    for k, (radius, color, text) in enumerate(zip(node.radii, shades, node.labels, strict=True)):
                        ball = self._server.scene.add_icosphere(
                            f"{path}/{k}", 0.6 * radius, color=self._shade(color), cast_shadow=False, receive_shadow=False
                        )
                        self._balls_painted.append((ball, color))
                        dots.append(
                            (ball, self._label(f"{path}/{k} name", text, 0.9, DIAGRAM_ANCHORS.get(node.group, "bottom-left")))
                        )
                    nodes += [handle for joint in dots for handle in joint]
                    shows.append(partial(_dot, node, dots))

        def set_frame(frame: int) -> None:
            for bring in shows:
                bring(frame)

        return Construction(tuple(nodes), set_frame, moves=bool(shows))


def _arrow_segments(node: ArrowSet, frame: int, size: float) -> Single:
    starts, vectors = (a[frame, :, 0] + 1j * a[frame, :, 1] for a in (node.origins, node.vectors))
    flat = arrow_lines(starts, vectors, np.full(len(starts), True), BARB_LENGTH * size)
    return np.stack([flat.real, flat.imag, np.full(flat.shape, node.height)], axis=-1).astype(np.float32)


def _bend(node: Lines, lines: Any, named: Sequence[tuple[int, Any]], middle: Real, frame: int) -> None:
    """Move lines to a frame; labels go to the middles of straight lines, on other lines to the point nearest to ``middle`` (2,)."""
    lines.points = segments(node, frame)
    for k, label in named:
        strip = node.strips[k][frame]
        nearest = np.argmin(np.hypot(*(strip[:, :2] - middle).T))
        label.position = tuple(strip.mean(axis=0) if len(strip) == 2 else strip[nearest])


def _point(node: ArrowSet, arrows: Any, named: Sequence[tuple[int, Any]], size: float, room: float, frame: int) -> None:
    """Move arrows to a frame; labels go ``room`` [m] beyond their tips, those of arrows of zero length are hidden."""
    arrows.points = _arrow_segments(node, frame, size)
    for k, label in named:
        vector = node.vectors[frame, k]
        length = float(np.linalg.norm(vector))
        if label.visible != (length > 0.0):
            label.visible = length > 0.0
        if length > 0.0:
            label.position = tuple(node.origins[frame, k] + (1.0 + room / length) * vector)


def _dot(node: Points, dots: Sequence[tuple[Any, Any]], frame: int) -> None:
    """Move balls and their labels to a frame; those without a position are hidden."""
    for k, (ball, label) in enumerate(dots):
        place = node.places[frame, k]
        seen = bool(np.isfinite(place).all())
        if ball.visible != seen:
            ball.visible = label.visible = seen
        if seen:
            ball.position = label.position = tuple(place)
