"""Graphical constructions in a recording that stand beside the mechanism: plans in views of their own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Integers, Single
from mechviz.outputs.rerun.paths import entity, line_strips
from mechviz.outputs.rerun.streams import Static, Stream
from mechviz.picture.constructions import Drawing

OVERLAYS = ("polygons/funicular", "polygons/polodes", "polygons/substitutes", "polygons/equivalent")
"""Entities that belong into the picture of the mechanism."""


def polygon_streams(drawings: dict[str, Drawing], every: int) -> Iterator[Stream]:
    """Rows of all constructions that move; labels and colours are static."""
    import rerun as rr

    for name, drawing in drawings.items():
        path = entity("polygons", *name.split("/"))
        arrows = [i for i in drawing.strokes if not i.plain]
        if arrows:
            yield Stream(path, _arrows([(i.start, i.vector) for i in arrows]), every)
        lines = [i for i in drawing.strokes if i.plain]
        if lines:
            yield Stream(f"{path}/rays", _strips([np.stack([i.start, i.start + i.vector], axis=1) for i in lines]), every)
        if drawing.marks:
            places = np.stack([m.at for m in drawing.marks], axis=1)

            def points(frames: Integers, places: Complex = places) -> Any:
                z = places[frames]
                return rr.Points3D.columns(positions=_space(z.reshape(-1))).partition(np.full(len(z), z.shape[1]))

            yield Stream(f"{path}/points", points, every)


def polygon_shapes(drawings: dict[str, Drawing], size: float) -> Iterator[Static]:
    """How the constructions look, and those that do not move."""
    import rerun as rr

    for name, drawing in drawings.items():
        path = entity("polygons", *name.split("/"))
        arrows, lines = [i for i in drawing.strokes if not i.plain], [i for i in drawing.strokes if i.plain]
        known = {"title": drawing.title, "unit": drawing.unit, "per_metre": float(drawing.per_metre)}
        yield Static(path, rr.AnyValues(**known, least=float(drawing.least), whole=drawing.whole))
        labels = [i.label for i in arrows]
        style = {
            "colors": [i.color for i in arrows],
            "labels": labels,
            "show_labels": True,
            "radii": [(0.003 if i.fine else 0.0055) * size for i in arrows],
        }
        if arrows:
            yield Static(path, rr.Arrows3D.from_fields(**style))
        if lines:
            style = {"colors": [i.color for i in lines], "labels": [i.label for i in lines], "show_labels": True}
            yield Static(f"{path}/rays", rr.LineStrips3D.from_fields(radii=[0.002 * size] * len(lines), **style))
        if drawing.marks:
            marks = rr.Points3D.from_fields(
                colors=[(240, 240, 240)], radii=[0.009 * size], labels=[m.label for m in drawing.marks], show_labels=True
            )
            yield Static(f"{path}/points", marks)
        if drawing.curves:
            curves = [_space(z) for _, z in drawing.curves]
            faded = [tuple(int(0.6 * c) for c in color) for color, _ in drawing.curves]
            yield Static(f"{path}/polar", rr.LineStrips3D(curves, colors=faded, radii=[0.0035 * size]))


def polygon_views(drawings: dict[str, Drawing], enlarged: float, background: tuple[int, ...]) -> list[Any]:
    """One view for every drawing, its scale in its name."""
    import rerun.blueprint as rrb

    views = []
    aspect = 0.93 if len(drawings) == 1 else 1.9 if len(drawings) == 2 else 1.2  # of the views in the blueprint, about
    for name, drawing in drawings.items():
        low, high = enlarged * drawing.bounds
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        away = 1.16 * max(half[1], half[0] / aspect, 1e-6) / np.tan(0.5 * np.radians(55.0))
        eye = rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(float(middle[0]), float(middle[1]), float(away)),
            look_target=(float(middle[0]), float(middle[1]), 0.0),
            eye_up=(0.0, 1.0, 0.0),
        )
        views.append(
            rrb.Spatial3DView(
                origin="/",
                contents=[f"+ {entity('polygons', *name.split('/'))}/**"],
                name=drawing.title,
                background=list(background),
                line_grid=rrb.LineGrid3D(visible=False),
                eye_controls=eye,
            )
        )
    return views


def _space(z: Complex, height: float = 0.0) -> Single:
    """Places of the plane, complex of any shape -> that shape with x, y, z; a coordinate that is not finite becomes 0."""
    out = np.full((*z.shape, 3), height, np.float32)
    for k, part in enumerate((z.real, z.imag)):
        out[..., k] = np.where(np.isfinite(part), part, 0.0)
    return out


def _arrows(items: list[tuple[Complex, Complex]], height: float = 0.0) -> Any:
    """Columns of arrows, the same number in every row."""
    import rerun as rr

    starts = np.stack([a for a, _ in items], axis=1)
    vectors = np.stack([v for _, v in items], axis=1)

    def columns(frames: Integers) -> Any:
        a, v = starts[frames].reshape(-1), vectors[frames].reshape(-1)
        counts = np.full(len(frames), starts.shape[1])
        return rr.Arrows3D.columns(origins=_space(a, height), vectors=_space(v)).partition(counts)

    return columns


def _strips(items: list[Complex], height: float = 0.0) -> Any:
    """Columns of strips (F, points) of the plane, the same number in every row."""
    import rerun as rr

    def columns(frames: Integers) -> Any:
        rows = line_strips([_space(strip[frames], height) for strip in items])
        return rr.LineStrips3D.columns(strips=rows).partition(np.full(len(frames), len(items)))

    return columns
