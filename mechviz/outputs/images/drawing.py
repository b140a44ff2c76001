"""A front view of the mechanism at an instant as a drawing (SVG), without a browser: parts, paths, arrows and names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from shapely import Polygon, polygons, union_all

from mechcore.arrays import Real
from mechviz.files import replacing
from mechviz.outputs.page.pack import MOST_FRAMES, PackProgress, no_progress, unpack
from mechviz.outputs.page.page import page_data
from mechviz.outputs.presentation import Presentation

LEAST_FACING = 0.2  # least z of the normal of a face that is drawn: it faces the viewer
LIGHT_DIRECTION = np.array([-0.30, 0.50, 0.81])
LIGHT_INK = "#e8ecf2"  # on a dark background
SHADE_ON_LIGHT = 0.62  # brightness of colours, chosen for a dark background, on a light one: as on the page
ARROW_HEAD = 9.0  # size of an arrowhead; its length is 0.3 times this, in hundredths of the picture's height


def write_svg(
    shown: Presentation,
    path: Path,
    *,
    time: float | None = None,
    width: int = 1280,
    height: int = 800,
    dark: bool = False,
    progress: PackProgress = no_progress,
) -> Path:
    """Write the drawing at a time [s], by default that at which a page opens. ``progress`` is called while nodes are packed."""
    text = svg_of(shown, time=time, width=width, height=height, dark=dark, progress=progress)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def svg_of(
    shown: Presentation,
    *,
    time: float | None = None,
    width: int = 1280,
    height: int = 800,
    dark: bool = False,
    progress: PackProgress = no_progress,
) -> str:
    """The drawing as SVG text, ``width`` by ``height`` in size, to scale."""
    most = MOST_FRAMES if time is None else 2
    header, arrays = unpack(page_data(shown, most=most, keep=time, plots=False, progress=progress)[0])
    times = arrays[header["time"]]
    frame = header["opening"] if time is None else float(np.interp(time, times, np.arange(len(times))))
    low, high = np.array(header["drawn"])[:, :2]
    scale = 0.94 * min(width / (high[0] - low[0]), height / (high[1] - low[1]))
    middle = 0.5 * (low + high)

    def place(xy: Real) -> Real:
        return np.asarray(np.array([0.5 * width, 0.5 * height]) + (np.asarray(xy, float) - middle) * scale * np.array([1.0, -1.0]))

    on = {g["name"]: g.get("dark" if dark else "light") for g in header["groups"] if g["shown"]}
    pieces = sorted(_solids(header, arrays, frame, on), key=lambda piece: piece[0])
    ground, stroke = ("#1b212b", LIGHT_INK) if dark else ("#fbfcfd", "#1b2330")
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
        'font-family="system-ui, sans-serif">',
        f"<title>{escape(header['title'])}</title>",
        f'<rect width="100%" height="100%" fill="{ground}"/>',
    ]
    for _, color, edge, shape in pieces:
        lines.append(f'<path d="{_path(shape, place)}" fill="{color}" stroke="{edge}" stroke-width="0.7" stroke-linejoin="round"/>')
    lines += [line for d in header["drawables"] for line in _drawn(d, header, arrays, frame, place, on, scale, stroke, height)]
    return "\n".join([*lines, "</svg>"]) + "\n"


def _solids(header: dict[str, Any], arrays: list[Any], frame: float, shown: Any) -> Iterator[tuple[float, str, str, Any]]:
    """Height [m], fill colour, edge colour and outline of the visible faces of the solids in the front view at a frame."""
    for link in [*header["links"], *header["bodies"]]:
        mesh = link["mesh"]
        if mesh is None or link.get("group", "surface_marks") not in {*shown, "surface_marks"}:
            continue
        x, y, angle = _at(arrays[link["pose"]].reshape(-1, 3), frame)
        vertices, normals = (arrays[mesh[k]].reshape(-1, 3) for k in ("vertices", "normals"))
        if "stretch" in link:
            long = float(_at(arrays[link["stretch"]].reshape(-1, 1), frame)[0])
            vertices, normals = vertices * [long, 1.0, 1.0], normals / [long, 1.0, 1.0]
            normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        if "spin" in link:
            vx, vy, vz, *quaternion = _at(arrays[link["spin"]].reshape(-1, 7), frame)
            vertices, normals = turned(vertices, quaternion) + np.array([vx, vy, vz]), turned(normals, quaternion)
        faces = arrays[mesh["faces"]].reshape(-1, 3)
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s], [s, c]])
        normal = normals[faces].mean(axis=1)
        least, steps = (0.0, 24.0) if "spin" in link else (LEAST_FACING, 4.0)  # spatial cams have curved faces
        facing = normal[:, 2] > least
        flat = vertices[:, :2] @ turn.T + [x, y]
        heights = vertices[faces, 2].max(axis=1)
        normal[:, :2] = normal[:, :2] @ turn.T
        light = np.round(steps * (0.55 + 0.5 * np.clip(normal @ LIGHT_DIRECTION, 0.0, 1.0))) / steps
        key = np.column_stack([arrays[mesh["colors"]][faces[:, 0]], np.round(heights * 1e6), light])[facing]
        groups, number = np.unique(key, axis=0, return_inverse=True)
        triangles = polygons(flat[faces[facing]])
        for k, (color, z, bright) in enumerate(groups):
            shape = union_all(triangles[number.reshape(-1) == k])
            if not shape.is_empty:
                inside = _shaded(mesh["palette"][int(color)], float(bright))
                yield float(z) * 1e-6, inside, inside if "spin" in link else _shaded(inside, 0.62), shape


def turned(points: Real, quaternion: list[float]) -> Any:
    """Points (n, 3) rotated by a quaternion (x, y, z, w), which need not have unit length."""
    *v, w = np.asarray(quaternion) / np.linalg.norm(quaternion)
    return points + 2.0 * np.cross(v, np.cross(v, points) + w * points)


def _drawn(
    d: dict[str, Any],
    header: dict[str, Any],
    arrays: list[Any],
    frame: float,
    place: Any,
    shown: dict[str, str | None],
    scale: float,
    stroke: str,
    height: int,
) -> Iterator[str]:
    """Arrows, lines, points and names as SVG elements; those in the frame of a link move with it."""
    if "link" in d:
        place = _carried(place, _at(arrays[header["links"][d["link"]]["pose"]].reshape(-1, 3), frame))
    frames, name = header["frames"], d["group"]
    if d["kind"] == "points" and name == "joints":
        if d["labels"] and d["labels"][0]:
            x, y = place(_at(arrays[d["points"]].reshape(frames, -1), frame)[:2]) if d["moves"] else place(arrays[d["points"]][:2])
            position = f'x="{x + 7:.1f}" y="{y - 7:.1f}"'
            yield f'<text {position} fill="{stroke}" font-size="13" font-weight="600">{escape(d["labels"][0])}</text>'
        return
    if name not in shown:
        return
    colors = [shown[name] or _shaded(c, 1.0 if stroke == LIGHT_INK else SHADE_ON_LIGHT) for c in d["colors"]] or [stroke]
    widths = [max(1.2, 2.0 * r * scale) for r in d["radii"]] or [1.5]
    if d["kind"] == "arrows":
        starts = _at(arrays[d["origins"]].reshape(frames, -1), frame).reshape(-1, 2)
        vectors = _at(arrays[d["vectors"]].reshape(frames, -1), frame).reshape(-1, 2)
        for k, (start, vector) in enumerate(zip(starts, vectors, strict=True)):
            if np.isfinite(start).all() and np.isfinite(vector).all():
                yield from _arrow(
                    place(start), place(start + vector), colors[k % len(colors)], widths[k % len(widths)], 0.01 * height
                )
        return
    if d["kind"] == "points":
        places = place(_at(arrays[d["points"]].reshape(frames if d["moves"] else 1, -1), frame).reshape(-1, 2))
        for k, (x, y) in enumerate(places):
            if np.isfinite([x, y]).all():
                radius, color = 0.5 * widths[k % len(widths)], colors[k % len(colors)]
                yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{color}"/>'
                if d["labels"] and d["labels"][k]:
                    yield f'<text x="{x + 6:.1f}" y="{y + 16:.1f}" fill="{stroke}" font-size="12">{escape(d["labels"][k])}</text>'
        return
    strips: list[Real] = []
    if d["kind"] == "strips":
        strips = list(_at(arrays[d["points"]].reshape(frames, -1), frame).reshape(d["count"], d["length"], 2))
    elif d["kind"] == "still strips":
        strips = np.split(arrays[d["points"]].reshape(-1, 2), np.cumsum(d["lengths"])[:-1])
    for k, strip in enumerate(strips):
        xy = place(strip[np.isfinite(strip).all(axis=1)])
        if len(xy) > 1:
            points = " ".join(f"{x:.1f},{y:.1f}" for x, y in xy)
            look = f'stroke="{colors[k % len(colors)]}" stroke-width="{widths[k % len(widths)]:.1f}" stroke-linejoin="round"'
            yield f'<polyline points="{points}" fill="none" {look}/>'


def _carried(place: Callable[[Real], Real], pose: Real) -> Callable[[Real], Real]:
    """A function that maps points in the frame of a link at a pose (x, y, angle) to the drawing."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[c, s], [-s, c]])
    return lambda xy: place(np.asarray(xy, float) @ turn + pose[:2])


def _arrow(start: Real, tip: Real, color: str, width: float, unit: float) -> Iterator[str]:
    length = float(np.hypot(*(tip - start)))
    if length < 1.0:
        return
    along = (tip - start) / length
    across = np.array([-along[1], along[0]])
    head = min(ARROW_HEAD * unit * 0.3, 0.45 * length)
    neck = tip - head * along
    shaft = f"M{start[0]:.1f} {start[1]:.1f}L{neck[0]:.1f} {neck[1]:.1f}"
    yield f'<path d="{shaft}" stroke="{color}" stroke-width="{width:.1f}" fill="none"/>'
    corners = [tip, neck + 0.38 * head * across, neck - 0.38 * head * across]
    yield f'<path d="M{"L".join(f"{x:.1f} {y:.1f}" for x, y in corners)}Z" fill="{color}"/>'


def _at(values: Real, frame: float) -> Real:
    """Values (frames, n) at a frame, interpolated linearly for fractions."""
    k = min(int(frame), len(values) - 1)
    after, part = min(k + 1, len(values) - 1), frame - k
    return np.asarray(values[k] if part < 1e-9 or after == k else (1.0 - part) * values[k] + part * values[after])


def _path(shape: Any, place: Any) -> str:
    """The data of an SVG path of a polygon, or of several."""
    moves = []
    for polygon in getattr(shape, "geoms", [shape]):
        if isinstance(polygon, Polygon):
            for ring in (polygon.exterior, *polygon.interiors):
                corners = place(np.asarray(ring.coords)[:-1])
                moves.append("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in corners) + "Z")
    return "".join(moves)


def _shaded(color: str, factor: float) -> str:
    return "#" + "".join(f"{min(255, round(int(color[k : k + 2], 16) * factor)):02x}" for k in (1, 3, 5))
