"""Graphical constructions beside the mechanism, true to scale in its own metres, and those that are drawn on it.

Plans, force polygons and polar plots stand side by side with the mechanism, as lines with labels that move with the frame; strings,
polodes and substitute masses lie on the mechanism. Every construction has a switch of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from mechcore.reduction.systems import KINDS
from mechviz.outputs.viewer.view_model import Overlay, Rolling, ViewModel
from mechviz.outputs.viewer.words import scale
from mechviz.outputs.viewer.world.labels import LabelPlaces, half_sizes
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.picture.constructions import COLORS, Drawing, rows_of
from mechviz.picture.overlays import (
    FIXED,
    MOVING,
    chain_pins,
    chain_strips,
    polode_pieces,
    resultants,
    strings,
    substitute_scale,
)

Array = NDArray[np.complex128]
Real = NDArray[np.float64]
Color = tuple[int, int, int]

BARB = 0.035  # length of the lines of an arrow's head, in sizes of the mechanism; of short arrows a third of their length
BARB_ANGLE = 0.36  # [rad]
GAP = 0.22  # between the mechanism and what stands beside it, in its sizes
CAPTION = 0.1  # room for a caption above a drawing, in sizes of the mechanism
LEAST_LABEL = 0.035  # a side shorter than this, in sizes of the mechanism, has no label: it would hide its neighbours
SCREEN = np.array([700.0, 560.0])  # [px] part of an ordinary window that the view takes
EQUIVALENT = (0, 120, 90)  # colour of equivalent linkages
NEAR = 0.045  # a point this near to another one, in sizes of the mechanism, leaves the label to that one


def on_light(color: Color) -> Color:
    """A colour of the drawings, which are made for a dark ground, on the viewer's light one."""
    if min(color) > 200:  # white becomes black
        return (34, 38, 46)
    red, green, blue = (int(0.68 * c) for c in color)
    return red, green, blue


def _as_light(colors: Sequence[Color]) -> NDArray[np.uint8]:
    """Colours (n, 3) of single lines: viser's shader takes them as light, not as screen colours (gamma 2.2)."""
    return np.round(255.0 * (np.array(colors, float) / 255.0) ** 2.2).astype(np.uint8)


def arrow_lines(start: Array, vector: Array, heads: NDArray[np.bool_], barb: float) -> Array:
    """Lines (3 n, 2) of arrows (n,): shafts first, then both lines of each head, of no length where there is none."""
    finite = np.isfinite(start) & np.isfinite(vector)
    start, vector = np.where(finite, start, 0.0), np.where(finite, vector, 0.0)
    end = start + vector
    length = np.abs(vector)
    back = np.where(heads, -np.minimum(barb, length / 3.0) * vector / np.where(length > 0.0, length, 1.0), 0.0)
    sides = [np.stack([end, end + back * np.exp(sign * 1j * BARB_ANGLE)], axis=1) for sign in (1.0, -1.0)]
    return np.concatenate([np.stack([start, end], axis=1), *sides])


def placed(mechanism: Real, boxes: Sequence[Real], gap: float, caption: float) -> list[complex]:
    """Shifts that put boxes (2, 2) [m] beside and below that of the mechanism, in rows, none over another."""
    sizes = [mechanism[1] - mechanism[0], *(b[1] - b[0] for b in boxes)]
    widths, heights = [float(s[0]) + gap for s in sizes], [float(s[1]) + gap + caption for s in sizes]
    shifts: list[complex] = []
    y = float(mechanism[1, 1])
    for row in rows_of(widths, heights):
        x = float(mechanism[0, 0])
        for i in row:
            if i:
                low, high = boxes[i - 1]
                shifts.append(complex(x - low[0], y - high[1] - (caption if row[0] else 0.0)))
            x += widths[i]
        y -= max(heights[i] for i in row)
    return shifts


def _apart(z: Array, least: float) -> Array:
    """Points (n,), those that are nearer than ``least`` to one before them made NaN: that one has the label."""
    out = np.array(z, complex)
    for k in range(1, len(out)):
        with np.errstate(invalid="ignore"):
            if (np.abs(out[:k] - out[k]) < least).any():
                out[k] = np.nan
    return out


@dataclass(frozen=True, eq=False)
class Construction:
    """What one switch shows: ``nodes`` and how they are brought to a frame."""

    nodes: tuple[viser.LineSegmentsHandle | viser.LabelHandle | viser.IcosphereHandle, ...]
    show: Callable[[int], None]
    moves: bool = True


class PlanNodes:
    """All constructions of a run by the words of their switches; ``show`` brings those that are on to a frame."""

    def __init__(self, server: viser.ViserServer, show: ViewModel):
        self._server = server
        self._on: dict[str, bool] = {}
        self.constructions: dict[str, Construction] = {}
        self.update(show)

    def update(self, show: ViewModel) -> None:
        """Draw the constructions of ``show`` instead of those so far; of a recording as it holds them."""
        for construction in self.constructions.values():
            for node in construction.nodes:
                if not node._impl.removed:  # it goes with the node that it lies below
                    node.remove()
        self.constructions = {}
        self.bounds: Real | None = None
        """Box (2, 2) [m] around what stands beside the mechanism."""
        self.places: Mapping[str, complex] = {}
        self._show = show
        self._size = show.size
        self._z = show.z_top + 0.03 * show.size
        drawings = show.drawings()
        box = show.bounds[:, :2]
        shifts = placed(box, [d.bounds for d in drawings.values()], GAP * self._size, CAPTION * self._size)
        self.places = dict(zip(drawings, shifts, strict=True))
        if drawings:
            corners = [
                d.bounds + np.array([z.real, z.imag]) for (d, z) in zip(drawings.values(), self.places.values(), strict=True)
            ]
            high = np.max([c[1] for c in corners], axis=0) + np.array([0.0, CAPTION * self._size])
            self.bounds = np.array([np.min([c[0] for c in corners], axis=0), high])
        for name, drawing in drawings.items():
            self._add(drawing.title.split(":")[0], self._drawing(name, drawing, self.places[name]))
        polodes = show.polodes()
        if polodes:
            self._add("Polodes", self._polodes(polodes))
        for words, overlay in show.overlays().items():
            self._add(words, self._overlay(words, overlay))
        if show.run is None:
            return
        self._run = show.run
        if self._run.studies.systems:
            self._add("Funicular polygon", self._funicular())
        if self._run.studies.equivalents:
            self._add("Equivalent linkages", self._equivalents())
        if self._run.studies.substitutes:
            self._add("Substitute masses", self._substitutes())

    def __len__(self) -> int:
        return len(self.constructions)

    @property
    def moves(self) -> bool:
        """Whether something is drawn that changes from frame to frame."""
        return any(self._on[name] and c.moves for name, c in self.constructions.items())

    def switch(self, name: str, on: bool) -> None:
        """Draw a construction from the next ``show`` on, or no more."""
        self._on[name] = on
        for node in self.constructions[name].nodes:
            node.visible = on

    def show(self, frame: int) -> None:
        for name, construction in self.constructions.items():
            if self._on[name]:
                construction.show(frame)

    # -- inside -------------------------------------------------------------------------------------------------------
    def _add(self, name: str, construction: Construction) -> None:
        self.constructions[name] = construction
        if not self._on.setdefault(name, True):
            for node in construction.nodes:
                node.visible = False

    def _space(self, z: Array) -> NDArray[np.float32]:
        return np.stack([z.real, z.imag, np.full(z.shape, self._z)], axis=-1).astype(np.float32)

    def _lines(self, path: str, lines: Array, colors: Sequence[Color], width: float) -> viser.LineSegmentsHandle:
        shades = np.repeat(_as_light(colors)[:, None], 2, axis=1)
        return self._server.scene.add_line_segments(path, self._space(lines), shades, thickness=width, thickness_units="screen")

    def _label(self, path: str, text: str, large: float = 0.85, anchor: str = "center-center") -> viser.LabelHandle:
        return self._server.scene.add_label(path, text, anchor=anchor, font_screen_scale=large)

    def _per_pixel(self) -> float:
        """Metres in a pixel of the screen, about, in the view from the front that shows everything."""
        boxes = [self._show.bounds[:, :2]] + ([] if self.bounds is None else [self.bounds])
        low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
        return float(np.max((high - low) / SCREEN))

    def _drawing(self, name: str, drawing: Drawing, at: complex) -> Construction:
        """Arrows with labels at their middles, points with names, and a caption with the scale."""
        strokes, marks, size = drawing.strokes, drawing.marks, self._size
        path = f"/drawings/{name}"
        frames = self._show.frames
        starts = np.array([i.start for i in strokes], complex).reshape(len(strokes), frames) + at
        vectors = np.array([i.vector for i in strokes], complex).reshape(len(strokes), frames)
        heads = np.array([not i.plain for i in strokes], bool)
        shades = [on_light(i.color) for i in strokes] * 3
        nodes: list[viser.LineSegmentsHandle | viser.LabelHandle | viser.IcosphereHandle] = []
        arrows = None
        if strokes:
            arrows = self._lines(path, arrow_lines(starts[:, 0], vectors[:, 0], heads, BARB * size), shades, 2.0)
            nodes.append(arrows)
        words = [self._label(f"{path}/side {k}", i.label) for k, i in enumerate(strokes) if i.label]
        named = [k for k, i in enumerate(strokes) if i.label]
        points = [self._label(f"{path}/point {k}", m.label) for k, m in enumerate(marks)]
        per_pixel = self._per_pixel()
        texts = [strokes[k].label for k in named], [m.label for m in marks]
        stand = LabelPlaces(half_sizes(texts[0], per_pixel), half_sizes(texts[1], per_pixel), 3.0 * per_pixel)
        spots = np.array([m.at for m in marks], complex).reshape(len(marks), frames) + at
        low, high = drawing.bounds + np.array([at.real, at.imag])
        quantity = drawing.title.split(":")[0]
        caption = self._label(
            f"{path}/caption",
            f"{quantity}. {scale(drawing.unit.replace('^2', '²'), drawing.per_metre, size)}",
            1.0,
            "bottom-center",
        )
        caption.position = (0.5 * (low[0] + high[0]), high[1] + 0.4 * CAPTION * size, self._z)
        nodes += [*words, *points, caption]
        if name == "shaking":
            for k, stroke in enumerate(strokes):
                z = stroke.start + stroke.vector + at
                z = z[np.isfinite(z)]
                if len(z) > 1:
                    faded = tuple(int(128 + 0.5 * c) for c in on_light(stroke.color))
                    curve = np.stack([z[:-1], z[1:]], axis=1)
                    nodes.append(self._lines(f"{path}/polar {k}", curve, [faded] * len(curve), 2.0))  # type: ignore[list-item]  # three numbers

        def show(frame: int) -> None:
            if arrows is not None:
                arrows.points = self._space(arrow_lines(starts[:, frame], vectors[:, frame], heads, BARB * size))
            start, vector = starts[named, frame], vectors[named, frame]
            start = np.where(np.abs(vector) >= LEAST_LABEL * size, start, np.nan)
            marked = _apart(spots[:, frame], NEAR * size)
            for labels, places in zip((words, points), stand(start, vector, marked), strict=True):
                self._stand(labels, places)

        return Construction(tuple(nodes), show)

    def _stand(self, labels: Iterable[Any], places: Iterable[Any]) -> None:
        """Put labels at places x + iy of the plane; those without a place are hidden."""
        for label, z in zip(labels, places, strict=True):
            seen = bool(np.isfinite(z))
            if label.visible != seen:
                label.visible = seen
            if seen:
                label.position = (z.real, z.imag, self._z)

    def _funicular(self) -> Construction:
        """Strings, lines of the forces and resultants on the mechanism."""
        run, size = self._run, self._size
        systems = run.studies.systems
        colors: list[Color] = []
        names: list[str] = []
        for s in systems.values():
            n = s.drawing.forces.shape[1]
            colors += [COLORS["string"]] * (n + 1) + [COLORS["line"]] * n
            names += [*(str(i) for i in range(n + 1)), *([""] * n)]
        strips = np.nan_to_num(np.stack(strings(run, size), axis=1))  # (F, n, 2)
        found = resultants(run, size)
        starts, vectors = (np.stack([pair[k] for pair in found]) for k in (0, 1))
        heads = np.full(len(found), True)
        node = self._lines("/funicular", strips[0], [on_light(c) for c in colors], 2.0)
        arrows = self._lines(
            "/funicular/resultants",
            arrow_lines(starts[:, 0], vectors[:, 0], heads, 1.4 * BARB * size),
            [on_light((255, 255, 255))] * (3 * len(found)),
            4.0,
        )
        labelled = [k for k, name in enumerate(names) if name]
        labels = [self._label(f"/funicular/string {k}", names[k]) for k in labelled]
        single = [
            self._label(f"/funicular/resultant {k}", "R" if len(systems) == 1 else f"R {name}", 1.0)
            for k, (name, s) in enumerate(systems.items())
            if np.any(s.drawing.kind == KINDS[2])
        ]
        of = [k for k, s in enumerate(systems.values()) if np.any(s.drawing.kind == KINDS[2])]

        def show(frame: int) -> None:
            node.points = self._space(strips[frame])
            arrows.points = self._space(arrow_lines(starts[:, frame], vectors[:, frame], heads, 1.4 * BARB * size))
            for label, k in zip(labels, labelled, strict=True):
                z = strips[frame, k].mean()
                label.position = (z.real, z.imag, self._z)
            for label, k in zip(single, of, strict=True):
                z = starts[k, frame] + vectors[k, frame]
                seen = bool(np.isfinite(z) and vectors[k, frame] != 0)
                if label.visible != seen:
                    label.visible = seen
                if seen:
                    label.position = (z.real, z.imag, self._z)

        return Construction((node, arrows, *labels, *single), show)

    def _overlay(self, words: str, overlay: Overlay) -> Construction:
        """Lines, arrows and points on the mechanism, as a recording holds them."""
        path, size = f"/overlays/{words}", self._size
        frames = self._show.frames
        starts = np.array([i.start for i in overlay.strokes], complex).reshape(-1, frames)
        vectors = np.array([i.vector for i in overlay.strokes], complex).reshape(-1, frames)
        heads = np.array([not i.plain for i in overlay.strokes], bool)
        spots = np.array([m.at for m in overlay.marks], complex).reshape(-1, frames)
        nodes: list[viser.LineSegmentsHandle | viser.LabelHandle | viser.IcosphereHandle] = []
        lines = None
        if overlay.strokes:
            shades = [on_light(i.color) for i in overlay.strokes] * 3
            lines = self._lines(path, arrow_lines(starts[:, 0], vectors[:, 0], heads, BARB * size), shades, 2.5)
            nodes.append(lines)
        named = [k for k, i in enumerate(overlay.strokes) if i.label]
        labels = [self._label(f"{path}/line {k}", overlay.strokes[k].label) for k in named]
        pins = [self._label(f"{path}/point {k}", m.label or "•", 0.9, "bottom-left") for k, m in enumerate(overlay.marks)]
        nodes += [*labels, *pins]

        def show(frame: int) -> None:
            if lines is not None:
                lines.points = self._space(arrow_lines(starts[:, frame], vectors[:, frame], heads, BARB * size))
            middles = starts[named, frame] + 0.5 * vectors[named, frame]
            self._stand((*labels, *pins), (*middles, *spots[:, frame]))

        return Construction(tuple(nodes), show)

    def _polodes(self, polodes: Mapping[str, Rolling]) -> Construction:
        """The fixed polode in the world; the moving one below the node of its link, with which it goes."""
        nodes = []
        z = self._show.z_top + 0.006 * self._size
        for name, found in polodes.items():
            fixed = np.column_stack([found.fixed.real, found.fixed.imag])
            moving = np.column_stack([found.moving.real, found.moving.imag])
            for path, way, color in (
                (f"/polodes/{name.replace('/', '_')}", fixed, FIXED),
                (f"{link_path(name)}/polode", moving, MOVING),
            ):
                pieces = polode_pieces(way, fixed, self._show, z=z)
                lines = [np.stack([piece[:-1], piece[1:]], axis=1) for piece in pieces]
                if lines:
                    flat = np.concatenate(lines)
                    nodes.append(
                        self._server.scene.add_line_segments(path, flat, on_light(color), thickness=2.5, thickness_units="screen")
                    )
        return Construction(tuple(nodes), lambda frame: None, moves=False)

    def _equivalents(self) -> Construction:
        """Bars, blocks and new pins of equivalent linkages on the mechanism."""
        size = self._size
        nodes: list[viser.LineSegmentsHandle | viser.LabelHandle | viser.IcosphereHandle] = []
        moving: list[tuple[viser.LineSegmentsHandle, Array]] = []
        pins: list[tuple[viser.IcosphereHandle, viser.LabelHandle, Array]] = []
        named = dict(chain_pins(self._run, size))
        for name, strips in chain_strips(self._run, size):
            path = f"/equivalent/{name.replace('/', '_')}"
            lines = np.concatenate([np.stack([s[:, :-1], s[:, 1:]], axis=2) for s in strips], axis=1)  # (F, lines, 2)
            node = self._lines(path, lines[0], [EQUIVALENT] * lines.shape[1], 3.0)
            moving.append((node, lines))
            nodes.append(node)
            for label, z in named[name]:
                dot = self._server.scene.add_icosphere(
                    f"{path}/{label}", 0.011 * size, color=EQUIVALENT, cast_shadow=False, receive_shadow=False
                )
                text = self._label(f"{path}/pin {label}", label, 0.9, "bottom-left")
                pins.append((dot, text, z))
                nodes += [dot, text]

        def show(frame: int) -> None:
            for node, lines in moving:
                node.points = self._space(lines[frame])
            for dot, text, z in pins:
                seen = bool(np.isfinite(z[frame]))
                if dot.visible != seen:
                    dot.visible = text.visible = seen
                if seen:
                    dot.position = text.position = (z[frame].real, z[frame].imag, self._z)

        return Construction(tuple(nodes), show)

    def _substitutes(self) -> Construction:
        """Dots at substitute masses with their values, and the inertia forces of each."""
        size = self._size
        per_metre = substitute_scale(self._run, size)
        nodes: list[viser.LineSegmentsHandle | viser.LabelHandle | viser.IcosphereHandle] = []
        moving: list[tuple[viser.LineSegmentsHandle, list[viser.IcosphereHandle], list[viser.LabelHandle], Array, Array]] = []
        for name, found in self._run.studies.substitutes.items():
            path = f"/substitutes/{name.replace('/', '_')}"
            at, forces = (v @ np.array([1.0, 1.0j]) for v in (found.places, found.forces))  # (F, n)
            share = np.sqrt(np.abs(found.masses) / np.abs(found.masses).max())
            dots, labels = [], []
            for k, mass in enumerate(found.masses):
                color = (200, 40, 100) if mass < 0.0 else (60, 66, 78)
                dots.append(
                    self._server.scene.add_icosphere(
                        f"{path}/{k}", float(0.008 + 0.016 * share[k]) * size, color=color, cast_shadow=False, receive_shadow=False
                    )
                )
                labels.append(self._label(f"{path}/mass {k}", f"{mass:.4g} kg", 0.9, "bottom-left"))
            heads = np.full(at.shape[1], True)
            lines = arrow_lines(at[0], forces[0] / per_metre, heads, BARB * size)
            arrows = self._lines(f"{path}/forces", lines, [on_light((208, 112, 246))] * len(lines), 3.0)
            moving.append((arrows, dots, labels, at, forces / per_metre))
            nodes += [arrows, *dots, *labels]

        def show(frame: int) -> None:
            for arrows, dots, labels, at, vectors in moving:
                heads = np.full(at.shape[1], True)
                arrows.points = self._space(arrow_lines(at[frame], vectors[frame], heads, BARB * size))
                for k, (dot, label) in enumerate(zip(dots, labels, strict=True)):
                    dot.position = label.position = (at[frame, k].real, at[frame, k].imag, self._z)

        return Construction(tuple(nodes), show)
