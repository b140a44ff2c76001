"""The tab of diagrams: velocity, acceleration and force polygons, centrodes, paths, and diagrams of one quantity over another, such
as pressure over displacement. All move with the frame."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cached_property, partial
from html import escape
from typing import Any, get_args

import numpy as np
import viser

from mechcore.arrays import Complex, Real
from mechcore.records import dataclass
from mechcore.spec.mechanism import METRICS
from mechviz.outputs.drawings import Curve as ChartCurve
from mechviz.outputs.drawings import Diagram as Chart
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.panels.charts import moving_diagram_svg, svg_words
from mechviz.outputs.viewer.panels.controls import EditedControls
from mechviz.outputs.viewer.server import Callback
from mechviz.outputs.viewer.session import EditSession
from mechviz.outputs.viewer.view_model import RollingCentrodes, ViewModel
from mechviz.outputs.viewer.world.constructions import readable_color
from mechviz.outputs.viewer.world.labels import LabelPlacer, half_sizes, split_label
from mechviz.outputs.viewer.world.marks import PATH_COLORS
from mechviz.picture.constructions import Drawing
from mechviz.picture.nodes import Color
from mechviz.picture.overlays import FIXED_CENTRODE_COLOR, MOVING_CENTRODE_COLOR
from mechviz.quantities.vectors import round_value
from mechviz.scene.kinds.studies import PolygonName

DIAGRAM_WIDTH, DIAGRAM_HEIGHT, DIAGRAM_MARGIN = 330.0, 300.0, 26.0  # [px]
CENTRODE_RANGE = 1.5  # centrodes are cut off at this distance beyond the bounds of the mechanism, in its sizes
PICTURE_RATE = 12.0  # pictures a second while playing
LEAST_LABELLED = 4.0  # [px] shorter arrows have no label
ARROW_HEAD = 8.0  # [px]
ROOM_OF_LABELS = 3.0  # [px] distance of labels from their sides and points
NONE_OF_A_RUN = "The scene asks for no diagrams. Ask for polygons and centrodes below; click on points to trace them."
POLYGON_HINTS = {
    "velocity": "the images of the points, from a pole: what the method by hand draws",
    "acceleration": "with the centripetal, tangential and Coriolis parts",
    "force": "the closed polygon of the forces on each group; needs forces",
    "graph": "links as vertices, joints as edges, independent loops numbered",
}
POLYGON_TITLES = {"graph": "Contour graph"}
CENTRODE_HINT = "the fixed and the moving centrode: one rolls on the other"
SECTION_HINT = "normal force, shear force and bending moment along the link, to be seen on it and plotted; needs forces"
MOST_LINKS = 5  # with more links, the folders of their switches are closed at first
NONE_OF_A_RECORDING = "The recording holds no diagrams. Press 'Edit this scene', where it carries its own, to ask for some."


@dataclass(frozen=True, eq=False)
class PlaneCurve:
    """A plane curve ``points`` (n,), interrupted where not finite, with a dot at ``at`` (F,), in a ``color`` for a dark background.

    ``ride``: positions and rotations (F,), as complex numbers, of the link to which the curve is fixed.
    """

    label: str
    color: Color
    points: Complex
    at: Complex
    ride: tuple[Complex, Complex] | None = None

    def points_at(self, frame: int) -> Complex:
        """The points of the curve (n,) at a frame."""
        return self.points if self.ride is None else self.ride[0][frame] + self.ride[1][frame] * self.points


@dataclass(frozen=True, eq=False)
class MovingDiagram:
    """A plane diagram that moves: a drawing with arrows and points, or curves, in metres of the plane; one metre represents
    ``per_metre`` of ``unit``."""

    title: str
    bounds: Real  # (2, 2)
    per_metre: float
    unit: str
    drawing: Drawing | None = None
    curves: tuple[PlaneCurve, ...] = ()

    @cached_property
    def places(self) -> LabelPlacer:
        """Positions of the labels of the drawing: without overlap, and as before where possible."""
        strokes, marks = ((), ()) if self.drawing is None else (self.drawing.arrows, self.drawing.points)
        sides, points = [i.label for i in strokes if i.label], [m.label for m in marks]
        return LabelPlacer(half_sizes(sides, 1.0), half_sizes(points, 1.0), ROOM_OF_LABELS)


def diagrams_of(view_model: ViewModel) -> dict[str, MovingDiagram | Chart]:
    """All diagrams of a view model by title: the polygons of its scene, centrodes, paths of traced points, and charts."""
    diagrams: dict[str, MovingDiagram | Chart] = {}
    for drawing in view_model.drawings().values():
        title = drawing.title.split(":")[0]
        curves: tuple[PlaneCurve, ...] = ()
        if drawing.name == "shaking":
            strokes = [(i.label, i.color, i.start + i.vector) for i in drawing.arrows]
            curves = tuple(PlaneCurve(label, color, z[np.isfinite(z)], z) for label, color, z in strokes)
        unit, factor = view_model.units.display_unit(drawing.unit)
        diagrams[title] = MovingDiagram(title, drawing.bounds, factor * drawing.per_metre, unit, drawing, curves)
    for name, centrodes in view_model.centrodes().items():
        title = f"Centrodes of {name}"
        diagrams[title] = _centrodes(view_model, centrodes, title, name)
    for name, xyz in view_model.paths.items():
        z = xyz[:, 0] + 1j * xyz[:, 1]
        title = f"Path of {name}"
        unit, factor = view_model.units.display_unit("m")
        diagrams[title] = MovingDiagram(title, _box([z]), factor, unit, curves=(PlaneCurve(name, PATH_COLORS[True], z, z),))
    diagrams |= {chart.title: chart for chart in (*cam_charts(view_model), *view_model.charts())}
    return diagrams


def cam_charts(view_model: ViewModel) -> list[Chart]:
    """Charts of pressure angle and curvature of the profile, for every cam."""
    axis, charts = view_model.axes[0], []
    turn = axis.turn
    if turn is not None and not np.all((axis.values > -1e-8 * turn) & (axis.values < (1.0 + 1e-8) * turn)):
        turn = None
    for q in view_model.quantities:
        if q.item.startswith("cam ") and q.name in ("pressure angle", "curvature"):
            title = f"{q.name.capitalize()} [{q.unit}] of {q.item}"
            curve = ChartCurve(q.item, axis.values, q.values()[:, 0])
            charts.append(Chart(q.label, title, axis.title, f"[{q.unit}]", (curve,), turn=turn))
    return charts


def _centrodes(view_model: ViewModel, centrodes: RollingCentrodes, title: str, name: str) -> MovingDiagram:
    """Diagram of both centrodes of a link, and its outline: the moving centrode is fixed to the link and rolls on the fixed one."""
    pose, size = view_model.poses[name], view_model.size
    fixed, moving = centrodes.fixed, centrodes.moving
    low, high = (bound[0] + 1j * bound[1] for bound in view_model.bounds)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) + CENTRODE_RANGE * size * (1.0 + 1.0j)
    from_middle = np.where(np.isfinite(fixed), fixed - middle, np.inf)
    inside = (np.abs(from_middle.real) < half.real) & (np.abs(from_middle.imag) < half.imag)
    # in world coordinates, so that both are cut at the same frames: far outside, and where they pass through infinity
    jumps = np.append(np.abs(np.diff(np.where(inside, fixed, 0.0))) > 0.5 * size, False)
    ride = pose[:, 0] + 1j * pose[:, 1], np.exp(1j * pose[:, 2])
    parts = [np.where(inside & ~jumps, part, np.nan) for part in (fixed, moving)]
    nowhere = np.full(len(pose), np.nan + 0j)
    curves = (
        PlaneCurve(name, (188, 200, 220), centrodes.outline, nowhere, ride),
        PlaneCurve("fixed centrode", FIXED_CENTRODE_COLOR, parts[0], nowhere),
        PlaneCurve("moving centrode", MOVING_CENTRODE_COLOR, parts[1], np.where(inside, fixed, np.nan), ride),
    )
    some = np.linspace(0, len(pose) - 1, min(len(pose), 24)).round().astype(int)
    unit, factor = view_model.units.display_unit("m")
    return MovingDiagram(title, _box([parts[0], *(curves[0].points_at(int(k)) for k in some)]), factor, unit, curves=curves)


def diagram_svg(diagram: MovingDiagram | Chart, frame: int) -> str:
    """A diagram at a frame, as SVG."""
    if isinstance(diagram, Chart):
        return moving_diagram_svg(diagram, frame)
    low, high = diagram.bounds
    extent = np.maximum(high - low, 1e-300)
    scale = float(min((DIAGRAM_WIDTH - 2 * DIAGRAM_MARGIN) / extent[0], (DIAGRAM_HEIGHT - 2 * DIAGRAM_MARGIN) / extent[1]))
    middle = complex(*(0.5 * (low + high)))

    def at(z: Complex | complex) -> Any:
        return (np.asarray(z) - middle) * scale

    def place(z: complex) -> tuple[float, float]:
        return DIAGRAM_WIDTH / 2.0 + z.real, DIAGRAM_HEIGHT / 2.0 - z.imag

    parts = []
    for k, curve in enumerate(diagram.curves):
        points = at(_fewer(curve.points_at(frame)))
        for strip in np.split(points, np.flatnonzero(~np.isfinite(points))):
            drawn = " ".join("{:.1f},{:.1f}".format(*place(z)) for z in strip[np.isfinite(strip)])
            parts.append(
                f'<polyline points="{drawn}" fill="none" stroke="{readable_color(curve.color)}" stroke-width="1.5" opacity="0.75"/>'
            )
        if len(diagram.curves) > 1:
            parts.append(_text((DIAGRAM_WIDTH - 6.0, 12.0 + 13.0 * k), curve.label, readable_color(curve.color), "end"))
        now = complex(at(curve.at[frame]))
        if np.isfinite(now):
            x, y = place(now)
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{readable_color(curve.color)}"/>')
    if diagram.drawing is not None:
        for k, (words_of, color) in enumerate(diagram.drawing.legend):
            y = 12.0 + 13.0 * k
            parts.append(f'<path d="M{DIAGRAM_WIDTH - 20.0:g},{y:g} h14" stroke="{readable_color(color)}" stroke-width="2.5"/>')
            parts.append(_text((DIAGRAM_WIDTH - 24.0, y), words_of, "currentColor", "end"))
        strokes, marks = diagram.drawing.arrows, diagram.drawing.points
        starts = at(np.array([stroke.start[frame] for stroke in strokes], complex))
        vectors = np.asarray(scale * np.array([stroke.vector[frame] for stroke in strokes], complex), complex)
        for stroke, start, vector in zip(strokes, starts, vectors, strict=True):
            if np.isfinite(start + vector):
                width = 1.2 if stroke.thin else 2.0
                parts.append(_arrow(place(start), place(start + vector), readable_color(stroke.color), stroke.headless, width))
        named = [k for k, stroke in enumerate(strokes) if stroke.label]
        long: Complex = np.where(np.abs(vectors[named]) >= LEAST_LABELLED, starts[named], np.nan + 0j)
        corners = at(np.array([mark.position[frame] for mark in marks], complex))
        texts = [strokes[k].label for k in named], [mark.label for mark in marks]
        for labels, places in zip(texts, diagram.places(long, vectors[named], corners), strict=True):
            parts += [_text(place(z), label, "currentColor") for label, z in zip(labels, places, strict=True) if np.isfinite(z)]
    parts.append(_scale_bar(diagram, scale))
    return (
        f'<svg role="img" aria-label="{escape(diagram.title)}" viewBox="0 0 {DIAGRAM_WIDTH:g} {DIAGRAM_HEIGHT:g}" '
        f'style="display:block;width:100%;max-height:{DIAGRAM_HEIGHT:g}px;overflow:hidden">{"".join(parts)}</svg>'
    )


class Diagrams:
    """A tab with one diagram at a time; ``show`` moves it, ``update`` takes another run.

    While the browsers play on their own, the server draws nothing but a diagram, and only if a browser has reported through the
    hidden checkbox ``seen`` that its tab is open (see playback.js).
    """

    def __init__(
        self,
        server: viser.ViserServer,
        tab: viser.GuiTabHandle,
        view_model: ViewModel,
        callback: Callback,
        session: EditSession | None = None,
    ):
        self._moved = 0.0
        self._frame, self._wanted = 0, False
        self._diagrams, self._solved = diagrams_of(view_model), view_model.run is not None
        self._session = session
        self.asked: dict[tuple[str, str], viser.GuiCheckboxHandle] = {}
        gui = server.gui
        with tab:
            self.choice = gui.add_dropdown("Diagram", tuple(self._diagrams) or ("none",))
            self._picture = gui.add_html("")
            self.seen = gui.add_checkbox("The diagram is seen", False, visible=False)
            if session is not None and view_model.run is not None:
                with gui.add_folder("Construct"):
                    for name in get_args(PolygonName):
                        self.asked["polygons", name] = gui.add_checkbox(
                            POLYGON_TITLES.get(name, f"{name.capitalize()} polygon"), False, hint=POLYGON_HINTS[name]
                        )
                with gui.add_folder("Quantities to plot"):
                    for name, hint in METRICS.items():
                        words_of = name.replace("_", " ").capitalize()
                        self.asked["metrics", name] = gui.add_checkbox(words_of, False, hint=hint)
                moving, open_first = (
                    [link for link in view_model.poses if link != view_model.frame],
                    len(view_model.poses) <= MOST_LINKS,
                )
                with gui.add_folder("Section forces", expand_by_default=open_first):
                    for link in moving:
                        self.asked["sections", link] = gui.add_checkbox(f"Sections of {link}", False, hint=SECTION_HINT)
                with gui.add_folder("Pole curves", expand_by_default=open_first):
                    for link in moving:
                        self.asked["centrodes", link] = gui.add_checkbox(f"Centrodes of {link}", False, hint=CENTRODE_HINT)
        if session is not None:
            self._edited = EditedControls(session, callback)
            for (key, name), box in self.asked.items():
                self._edited.listen(f"{key} {name}", box, name, partial(self._ask, key, name))
        self.mirror(view_model)
        self._watchers: set[int] = set()
        self.seen.on_update(callback("Watching a diagram", self._watch))
        self.choice.on_update(callback("Choosing a diagram", lambda _: self.show(self._frame, False)))
        self.show(0, False)

    def update(self, view_model: ViewModel, frame: int) -> None:
        """Take another run."""
        before = tuple(self._diagrams)
        self._diagrams = diagrams_of(view_model)
        self.mirror(view_model)
        if tuple(self._diagrams) != before:
            kept = self.choice.value
            self.choice.options = tuple(self._diagrams) or ("none",)
            new = [title for title in self._diagrams if title not in before]
            if self._wanted and new:
                self.choice.value = new[0]  # show the requested diagram
            elif kept in self._diagrams:
                self.choice.value = kept
            self._wanted = False

    def mirror(self, view_model: ViewModel) -> None:
        """Set the switches to the state of the scene: a refused one is set back."""
        if view_model.run is None:
            return
        for (key, name), box in self.asked.items():
            self._edited.follow(f"{key} {name}", box, name in getattr(view_model.run.scene.document, key))

    def _ask(self, key: str, name: str, on: object) -> None:
        assert self._session is not None
        self._wanted = bool(on)
        self._session.change(f"{key} {name}", lambda draft: draft.with_named(key, name, bool(on)))

    @property
    def watched(self) -> bool:
        """Whether a browser that plays on its own has the tab open."""
        return bool(self._watchers)

    def forget(self, client: viser.ClientHandle) -> None:
        """Drop the state of a browser that has disconnected."""
        self._watchers.discard(client.client_id)

    def _watch(self, event: Any) -> None:
        if self.seen.value:
            self._watchers.add(event.client.client_id)
        else:
            self._watchers.discard(event.client.client_id)

    def show(self, frame: int, playing: bool) -> None:
        now = time.perf_counter()
        if playing and now - self._moved < 1.0 / PICTURE_RATE:
            return
        self._frame, self._moved = frame, now
        diagram = self._diagrams.get(self.choice.value)
        if diagram is None:
            content = words.hint(NONE_OF_A_RUN if self._solved else NONE_OF_A_RECORDING)
        else:
            content = f'<div class="mechviz-diagram">{diagram_svg(diagram, frame)}</div>'
        if content != self._picture.content:
            self._picture.content = content


def _scale_bar(diagram: MovingDiagram, scale: float) -> str:
    """A scale bar of a round value, about a quarter of the picture long; ``scale``: pixels per metre."""
    if not (diagram.per_metre > 0.0 and np.isfinite(diagram.per_metre)):
        return ""
    value = round_value(0.3 * DIAGRAM_WIDTH / scale * diagram.per_metre)
    long, y = value / diagram.per_metre * scale, DIAGRAM_HEIGHT - 9.0
    line = f'<path d="M8,{y - 4} v8 M8,{y} h{long:.1f} m0,-4 v8" stroke="currentColor" fill="none" stroke-width="1.2"/>'
    text = f"{words.format_number(value)} {diagram.unit}"
    return f'{line}<text x="{14 + long:.1f}" y="{y + 3.5}" font-size="11" fill="currentColor">{escape(text)}</text>'


def _arrow(start: tuple[float, float], end: tuple[float, float], color: str, plain: bool, width: float) -> str:
    (x0, y0), (x1, y1) = start, end
    line = f'<path d="M{x0:.1f},{y0:.1f} L{x1:.1f},{y1:.1f}" stroke="{color}" stroke-width="{width}"/>'
    along = complex(x1 - x0, y1 - y0)
    if plain or abs(along) < 2.0:
        return line
    back = -min(ARROW_HEAD, abs(along) / 2.0) * along / abs(along)
    tips = [complex(x1, y1) + back * np.exp(sign * 0.36j) for sign in (1.0, -1.0)]
    corners = " ".join(f"{z.real:.1f},{z.imag:.1f}" for z in (complex(x1, y1), *tips))
    return f'{line}<polygon points="{corners}" fill="{color}"/>'


def _text(at: tuple[float, float], text: str, color: str, anchor: str = "middle") -> str:
    return svg_words(*at, _written(text), 11, anchor=anchor, color=color)


def _written(label: str) -> str:
    """SVG markup of a label: ``a_CBⁿ`` with CB as a subscript."""
    letter, below, above = (escape(part) for part in split_label(label))
    below = f'<tspan dy="3" font-size="8.5">{below}</tspan>' if below else ""
    return letter + below + (f'<tspan dy="-3">{above}</tspan>' if above else "")


def _fewer(z: Complex, most: int = 400) -> Complex:
    return z if len(z) <= most else z[np.linspace(0, len(z) - 1, most).round().astype(int)]


def _box(curves: Sequence[Complex]) -> Real:
    z = np.concatenate(curves) if curves else np.zeros(1, complex)
    z = z[np.isfinite(z)]
    if not len(z):
        return np.array([[0.0, 0.0], [1.0, 1.0]])
    box = np.array([[z.real.min(), z.imag.min()], [z.real.max(), z.imag.max()]])
    least = 1e-6 + 0.02 * float(np.max(box[1] - box[0]))
    return np.array([box[0] - least, box[1] + least])
