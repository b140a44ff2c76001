"""Graphical constructions in a recording: plans in views of their own, strings and polodes on the mechanism, closing errors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechcore.reduction.systems import KINDS

from ..drawings import COLORS, Drawing
from .paths import entity
from .streams import Index, Static, Stream

if TYPE_CHECKING:
    from ..meshes import Solids
    from ..run import Run

__all__ = ["OVERLAYS", "overlay_box", "polygon_shapes", "polygon_streams", "polygon_views"]

Array = NDArray[np.complex128]
OVERLAYS = ("polygons/funicular", "polygons/polodes", "polygons/substitutes")
"""Entities that belong into the picture of the mechanism."""

FIXED, MOVING = (255, 206, 92), (92, 214, 255)  # polodes
NEGATIVE, POSITIVE = (255, 96, 150), (236, 238, 244)  # substitute masses
REACH = 1.5  # sizes of the mechanism beyond its bounds, where polodes are cut off


def polygon_streams(run: Run, drawings: dict[str, Drawing], solids: Solids, every: int) -> Iterator[Stream]:
    """Rows of all constructions that move; labels and colours are static."""
    import rerun as rr

    for name, drawing in drawings.items():
        path = entity("polygons", *name.split("/"))
        arrows = [i for i in drawing.inks if not i.plain]
        if arrows:
            yield Stream(path, _arrows([(i.start, i.vector) for i in arrows]), every)
        lines = [i for i in drawing.inks if i.plain]
        if lines:
            yield Stream(f"{path}/rays", _strips([np.stack([i.start, i.start + i.vector], axis=1) for i in lines]), every)
        if drawing.marks:
            places = np.stack([m.at for m in drawing.marks], axis=1)

            def points(frames: Index, places: Array = places) -> Any:
                z = places[frames]
                return rr.Points3D.columns(positions=_space(z.reshape(-1))).partition(np.full(len(z), z.shape[1]))

            yield Stream(f"{path}/points", points, every)
    z_top = solids.z_top + 0.01 * solids.size
    if run.studies.systems:
        yield Stream("/polygons/funicular", _strips(_strings(run, solids.size), z_top), every)
        yield Stream("/polygons/funicular/resultant", _arrows(_resultants(run, solids.size), z_top), every)
    for name, found in run.studies.substitutes.items():
        places = found.places @ np.array([1.0, 1.0j])

        def masses(frames: Index, places: Array = places) -> Any:
            z = places[frames]
            return rr.Points3D.columns(positions=_space(z.reshape(-1), z_top)).partition(np.full(len(z), z.shape[1]))

        yield Stream(entity("polygons", "substitutes", name), masses, every)
        forces = found.forces @ np.array([1.0, 1.0j])
        scale = _substitute_scale(run, solids.size)
        vectors = [(places[:, k], forces[:, k] / scale) for k in range(places.shape[1])]
        yield Stream(entity("polygons", "substitutes", name, "forces"), _arrows(vectors, z_top), every)


def polygon_shapes(run: Run, drawings: dict[str, Drawing], solids: Solids) -> Iterator[Static]:
    """How the constructions look, and those that do not move."""
    import rerun as rr

    size = solids.size
    for name, drawing in drawings.items():
        path = entity("polygons", *name.split("/"))
        arrows, lines = [i for i in drawing.inks if not i.plain], [i for i in drawing.inks if i.plain]
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
        if name == "shaking":
            curves = [_space(i.vector) for i in arrows]
            faded = [tuple(int(0.6 * c) for c in i.color) for i in arrows]
            yield Static(f"{path}/polar", rr.LineStrips3D(curves, colors=faded, radii=[0.0035 * size]))
    if run.studies.systems:
        colors, names, radii = [], [], []
        for s in run.studies.systems.values():
            n = s.drawing.forces.shape[1]
            colors += [COLORS["string"]] * (n + 1) + [COLORS["line"]] * n
            names += [*(str(i) for i in range(n + 1)), *s.drawing.names]
            radii += [0.0028 * size] * (n + 1) + [0.0014 * size] * n
        yield Static("/polygons/funicular", rr.LineStrips3D.from_fields(colors=colors, labels=names, show_labels=True, radii=radii))
        many = len(run.studies.systems)
        labels = [
            "" if not np.any(s.drawing.kind == KINDS[2]) else "R" if many == 1 else f"R {name}"
            for name, s in run.studies.systems.items()
        ]
        style = {"colors": [(255, 255, 255)] * many, "labels": labels, "show_labels": True, "radii": [0.007 * size] * many}
        yield Static("/polygons/funicular/resultant", rr.Arrows3D.from_fields(**style))
    z_top = solids.z_top + 0.006 * size
    for name, found in run.studies.polodes.items():
        fixed = _pieces(found.fixed, solids, name, run, z=z_top)
        moving = _pieces(found.moving, solids, name, run, z=z_top)
        yield Static(entity("polygons", "polodes", name), rr.LineStrips3D(fixed, colors=[FIXED], radii=[0.0032 * size]))
        # under the link's own transform: it moves with it and rolls on the fixed one
        path = entity("mechanism", "links", name, "polode")
        yield Static(path, rr.LineStrips3D(moving, colors=[MOVING], radii=[0.0032 * size]))
    for name, body in run.studies.substitutes.items():
        share = np.sqrt(np.abs(body.masses) / np.abs(body.masses).max())
        labels = [f"{m:.4g} kg" for m in body.masses]
        colors = [NEGATIVE if m < 0.0 else POSITIVE for m in body.masses]
        points = rr.Points3D.from_fields(colors=colors, radii=list((0.012 + 0.028 * share) * size), labels=labels, show_labels=True)
        yield Static(entity("polygons", "substitutes", name), points)
        forces = rr.Arrows3D.from_fields(colors=[(244, 178, 255)], radii=[0.005 * size])
        yield Static(entity("polygons", "substitutes", name, "forces"), forces)


def polygon_views(run: Run, drawings: dict[str, Drawing], enlarged: float, background: tuple[int, ...]) -> list[Any]:
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


def overlay_box(run: Run, solids: Solids) -> NDArray[np.float64]:
    """The box (2, 3) [m] around the mechanism with what is drawn on it: strings, resultants, polodes, substitute masses."""
    low, high = (np.array(b, float) for b in solids.bounds)
    size = solids.size
    spots: list[NDArray[np.float64]] = []
    for body in run.studies.substitutes.values():
        spots.append(body.places.reshape(-1, 2))
        spots.append((body.places + body.forces / _substitute_scale(run, size)).reshape(-1, 2))
    if run.studies.systems:
        z = np.concatenate([strip.reshape(-1) for strip in _strings(run, size)])
        spots.append(np.column_stack([z.real, z.imag]))
        spots += [np.column_stack([w.real, w.imag]) for a, v in _resultants(run, size) for w in (a, a + v)]
    for name in run.studies.polodes:
        spots += [p[:, :2].astype(float) for p in _pieces(run.studies.polodes[name].fixed, solids, name, run, z=0.0)]
    for xy in spots:
        xy = xy[np.isfinite(xy).all(axis=1)]
        if len(xy):
            near, far = np.quantile(xy, [0.03, 0.97], axis=0)  # a knot that runs far out in a few frames may leave the picture
            low[:2] = np.minimum(low[:2], np.maximum(near, low[:2] - 0.5 * size))
            high[:2] = np.maximum(high[:2], np.minimum(far, high[:2] + 0.5 * size))
    return np.array([low, high])


def _space(z: Array, height: float = 0.0) -> NDArray[np.float32]:
    z = np.nan_to_num(z, nan=0.0, posinf=0.0, neginf=0.0)
    return np.column_stack([z.real, z.imag, np.full(len(z), height)]).astype(np.float32)


def _arrows(items: list[tuple[Array, Array]], height: float = 0.0) -> Any:
    """Columns of arrows, the same number in every row."""
    import rerun as rr

    starts = np.stack([a for a, _ in items], axis=1)
    vectors = np.stack([v for _, v in items], axis=1)

    def columns(frames: Index) -> Any:
        a, v = starts[frames].reshape(-1), vectors[frames].reshape(-1)
        counts = np.full(len(frames), starts.shape[1])
        return rr.Arrows3D.columns(origins=_space(a, height), vectors=_space(v)).partition(counts)

    return columns


def _strips(items: list[Array], height: float = 0.0) -> Any:
    """Columns of strips (F, points) of the plane, the same number in every row."""
    import rerun as rr

    def columns(frames: Index) -> Any:
        rows = [_space(strip[f], height) for f in frames for strip in items]
        return rr.LineStrips3D.columns(strips=rows).partition(np.full(len(frames), len(items)))

    return columns


def _strings(run: Run, size: float) -> list[Array]:
    """Strings between the knots, the outer ones out to where they meet, and the lines of the forces."""
    out: list[Array] = []
    for s in run.studies.systems.values():
        d = s.drawing
        n = d.forces.shape[1]
        rays = d.rays / np.maximum(np.abs(d.rays), 1e-300)
        first, last = (_outer(d.knots[:, i], rays[:, j], d.meeting, size) for i, j in ((0, 0), (n - 1, n)))
        out.append(first)
        out += [np.stack([d.knots[:, i], d.knots[:, i + 1]], axis=1) for i in range(n - 1)]
        out.append(last)
        with np.errstate(invalid="ignore", divide="ignore"):
            along = np.nan_to_num(d.forces / np.abs(d.forces))
        for i in range(n):
            reach = np.real((d.knots[:, i] - d.points[:, i]) * np.conj(along[:, i]))
            low, high = np.minimum(reach, 0.0) - 0.08 * size, np.maximum(reach, 0.0) + 0.08 * size
            out.append(np.stack([d.points[:, i] + low * along[:, i], d.points[:, i] + high * along[:, i]], axis=1))
    return out


def _outer(knot: Array, ray: Array, meeting: Array, size: float) -> Array:
    """An outer string: through its knot, and out to where the outer strings meet if that is near enough to be drawn."""
    away = np.where(np.isfinite(meeting), np.real((meeting - knot) * np.conj(ray)), 0.0)
    away = np.clip(np.nan_to_num(away), -2.0 * size, 2.0 * size)
    low, high = np.minimum(away, 0.0) - 0.15 * size, np.maximum(away, 0.0) + 0.15 * size
    return np.stack([knot + low * ray, knot + high * ray], axis=1)


def _resultants(run: Run, size: float) -> list[tuple[Array, Array]]:
    """Arrows of the resultants through the places where the outer strings meet, the largest 0.4 of the mechanism long; nothing
    where there is no single force, or far outside the picture."""
    drawings = [s.drawing for s in run.studies.systems.values()]
    largest = max(float(np.abs(d.resultant).max(initial=0.0)) for d in drawings) or 1.0
    out = []
    for d in drawings:
        near = np.isfinite(d.meeting) & (np.abs(d.meeting - d.points[:, 0]) < 4.0 * size)
        out.append((np.where(near, d.meeting, np.nan), np.where(near, d.resultant * (0.4 * size / largest), 0.0)))
    return out


def _substitute_scale(run: Run, size: float) -> float:
    """Newtons per metre of the arrows at substitute masses: the largest is a third of the mechanism."""
    largest = max(float(np.abs(f.forces @ np.array([1.0, 1.0j])).max(initial=0.0)) for f in run.studies.substitutes.values())
    return largest / (size / 3.0) if largest > 0.0 else 1.0


def _pieces(way: NDArray[np.float64], solids: Solids, link: str, run: Run, *, z: float) -> list[NDArray[np.float32]]:
    """A polode as strips, cut where it runs far out of the picture or jumps through infinity."""
    low, high = np.asarray(solids.bounds)[:, :2]
    room = REACH * solids.size
    place = run.studies.polodes[link].fixed  # judged in the world, so that both are cut at the same frames
    inside = np.isfinite(place).all(axis=1) & (place > low - room).all(axis=1) & (place < high + room).all(axis=1)
    step = np.hypot(*np.diff(np.where(inside[:, None], place, 0.0), axis=0).T)
    joined = inside[1:] & inside[:-1] & (step < 0.5 * solids.size)
    pieces: list[NDArray[np.float32]] = []
    start = 0
    for k in range(len(way)):
        if k + 1 == len(way) or not joined[k]:
            if k > start:
                pieces.append(np.column_stack([way[start : k + 1], np.full(k + 1 - start, z)]).astype(np.float32))
            start = k + 1
    return pieces
