"""Constructions and diagrams of a recording that stand beside the mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Integers, Real
from mechviz.outputs.rerun.diagrams import HEIGHT, WIDTH, Curve
from mechviz.outputs.rerun.diagrams import Diagram as Chart
from mechviz.outputs.rerun.paths import parts_of
from mechviz.outputs.rerun.reader import Recording
from mechviz.picture.constructions import Drawing, Mark, Stroke

Color = tuple[int, int, int]

FINE = 0.8  # an arrow thinner than this, in radii of the thickest one, is a fine one
ORDER = ("velocity", "acceleration", "force", "indicator", "phase")  # these come first, the others by their names


@dataclass(frozen=True, eq=False)
class RecordedDrawings:
    """Reads a recording's drawings at the frames at ``ticks`` (F,) [ns]; of entities with fewer rows the newest one counts."""

    recording: Recording
    ticks: Integers

    def drawings(self) -> dict[str, Drawing]:
        """Plans and polygons by the name of their entity; recordings that do not say their scale have none."""
        found = {}
        for path in self._below("/polygons/"):
            known = {name: self.recording.static(path, component=name) for name in ("title", "unit", "per_metre", "least", "whole")}
            if any(value is None for value in known.values()):
                continue
            title, unit, per_metre, least, whole = (value[0] for value in known.values() if value is not None)
            name = "/".join(parts_of(path)[1:])
            strokes = (*self._arrows(path), *self._lines(f"{path}/rays"))
            lost = (
                np.all([(i.start == 0) & (i.vector == 0) for i in strokes], axis=0) if strokes else np.zeros(len(self.ticks), bool)
            )
            at = self._points(f"{path}/points")
            marks = [Mark(label, np.where(lost, np.nan, z)) for label, z in at]
            found[name] = Drawing(
                name, str(title), strokes, tuple(marks), float(per_metre), str(unit), least=float(least), whole=bool(whole)
            )
        return found

    def charts(self) -> list[Chart]:
        """Diagrams of one quantity against another: where their moving points were drawn says what they show."""
        found = []
        for path in self._below("/diagrams/"):
            part = partial(self.recording.static, path)
            ranges = part(component="ranges")
            if ranges is None or len(ranges) != 4:
                continue
            names = [parts_of(p)[-1] for p in self._below(f"{path}/curves/")]
            spots = self._rows(f"{path}/now", "Points2D:positions")
            colors = self.recording.static(f"{path}/now", component="Points2D:colors")
            if spots is None or colors is None or spots.shape[1] != len(colors):
                continue
            x0, x1, y0, y1 = (float(r) for r in ranges)
            x, y = x0 + (x1 - x0) * spots[..., 0] / WIDTH, y0 - (y1 - y0) * spots[..., 1] / HEIGHT
            order = self._in_order(path, names, x.shape[1])
            curves = tuple(Curve(name, x[:, k], y[:, k]) for k, name in enumerate(order))
            title, across, up, equal, turn = (part(component=c) for c in ("title", "x_title", "y_title", "equal", "turn"))
            if title is None or across is None or up is None or equal is None or turn is None:
                continue
            said = str(title[0]), str(across[0]), str(up[0])
            found.append(Chart(parts_of(path)[-1], *said, curves, equal=bool(equal[0]), turn=float(turn[0]) or None))
        return found

    # -- inside -------------------------------------------------------------------------------------------------------
    def _below(self, start: str) -> list[str]:
        """Entities whose path begins so, however deep."""
        found = [path for path in self.recording.entities if path.startswith(start)]
        return sorted(found, key=lambda path: ORDER.index(name) if (name := parts_of(path)[1]) in ORDER else len(ORDER))

    def _rows(self, path: str, component: str) -> Real | None:
        """Vectors (F, n, 2) of an entity, NaN where a row has not as many as most; None where there are none."""
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
        return np.asarray(out[self._row_of(rows.time)])

    def _row_of(self, time: Integers) -> Integers:
        return np.clip(np.searchsorted(time, self.ticks, side="right") - 1, 0, len(time) - 1)

    def _looks(self, path: str, kind: str, count: int) -> tuple[list[str], list[Color], list[bool]]:
        """Labels, colours and whether it is a fine one, of each of ``count`` things."""
        part = partial(self.recording.static, path)
        labels, packed, radii = (part(component=f"{kind}:{name}") for name in ("labels", "colors", "radii"))
        texts = [str(x) for x in labels] if labels is not None and len(labels) == count else [""] * count
        shades = np.full(1, 0x808080FF, np.uint32) if packed is None or not len(packed) else packed.astype(np.uint32)
        shades = np.resize(shades, count) if len(shades) != count else shades
        colors = [(int(c >> 24) & 255, int(c >> 16) & 255, int(c >> 8) & 255) for c in shades]
        thick = np.ones(count) if radii is None or len(radii) != count else np.abs(np.asarray(radii, float))
        return texts, colors, [bool(r < FINE * thick.max()) for r in thick]

    def _arrows(self, path: str) -> tuple[Stroke, ...]:
        starts, vectors = self._rows(path, "Arrows3D:origins"), self._rows(path, "Arrows3D:vectors")
        if starts is None or vectors is None or starts.shape != vectors.shape:
            return ()
        z, along = _complex(starts), _complex(vectors)
        looks = zip(*self._looks(path, "Arrows3D", z.shape[1]), strict=True)
        return tuple(Stroke(label, color, z[:, k], along[:, k], fine=fine) for k, (label, color, fine) in enumerate(looks))

    def _lines(self, path: str) -> tuple[Stroke, ...]:
        """Strips as plain lines, one for each of their parts; the first has the label."""
        try:
            rows = self.recording.rows(path, component="LineStrips3D:strips")
        except KeyError:
            return ()
        count = int(rows.lengths[0]) if len(rows.lengths) else 0
        if not count or not (rows.lengths == count).all():
            return ()
        row_of = self._row_of(rows.time)
        found = []
        for k, (label, color, _) in enumerate(zip(*self._looks(path, "LineStrips3D", count), strict=True)):
            strips: list[Any] = list(rows.values[k::count])
            if len({len(strip) for strip in strips}) != 1:
                continue
            z = np.stack([_complex(np.asarray(strip, float)) for strip in strips])[row_of]
            for part in range(z.shape[1] - 1):
                found.append(Stroke(label if not part else "", color, z[:, part], z[:, part + 1] - z[:, part], plain=True))
        return tuple(found)

    def _points(self, path: str) -> list[tuple[str, Complex]]:
        spots = self._rows(path, "Points3D:positions")
        if spots is None:
            return []
        labels, _, _ = self._looks(path, "Points3D", spots.shape[1])
        return [(label, _complex(spots[:, k])) for k, label in enumerate(labels)]

    def _in_order(self, path: str, names: list[str], count: int) -> list[str]:
        """Names of curves in the order of their points: of a curve the colour says which point runs along it."""
        colors = self.recording.static(f"{path}/now", component="Points2D:colors")
        by_color = {}
        for name, entity in zip(names, self._below(f"{path}/curves/"), strict=True):
            own = self.recording.static(entity, component="LineStrips2D:colors")
            if own is not None and len(own):
                by_color[int(own[0])] = name
        return [by_color.get(int(colors[k]), "") if colors is not None else "" for k in range(count)]


def _complex(xy: Real) -> Complex:
    """Places (..., 2 or 3) of the plane as complex numbers (...)."""
    return np.asarray(xy[..., 0] + 1j * xy[..., 1], complex)
