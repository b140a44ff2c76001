"""What a page draws in space: solids with their poses, arrows, lines and points, from the entities of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechviz.outputs.page.frames import Frames, Progress, quiet, rows_at
from mechviz.outputs.page.pack import Pack
from mechviz.outputs.rerun.paths import entity as _path
from mechviz.outputs.rerun.paths import parts_of
from mechviz.picture.surface_marks import KINDS
from mechviz.quantities.vectors import FAMILIES

if TYPE_CHECKING:
    from mechviz.outputs.rerun.reader import Recording


Real = NDArray[np.float64]

OVERLAYS = ("funicular", "polodes", "substitutes", "equivalent")  # constructions that belong into the picture of the mechanism
ASIDE = ("rays", "points", "polar")  # parts of a construction that stands by itself


def find_links(recording: Recording, frames: Frames, pack: Pack) -> list[dict[str, Any]]:
    """Links with their poses (frames, 3: x, y [m], angle [rad]) and their solids."""
    found = []
    for name in recording.model["links"]:
        poses = rows_at(recording, frames, _path("data", "links", name, "pose"), "Scalars:scalars")
        assert poses is not None
        pose = np.array(poses[0], float)
        moves = bool(np.ptp(pose, axis=0).max(initial=0.0) > 0.0)
        found.append({"name": name, "pose": pack.floats(pose if moves else pose[:1]), "moves": moves, "mesh": None})
        spin = _spin(recording, frames, name)
        if spin is not None:
            found[-1]["spin"] = pack.floats(spin)
        mesh = _mesh(recording, _path("mechanism", "links", name, "mesh"))
        if mesh is not None:
            found[-1]["mesh"] = _packed(mesh, pack)
    return found


def find_bodies(recording: Recording, frames: Frames, pack: Pack) -> list[dict[str, Any]]:
    """Solids beside those of the links, as links are packed: springs, with their stretch along their axes (frames), and
    marks on rollers and belts. ``group``: what shows and hides them."""
    found = []
    for path in recording.entities:
        parts = parts_of(path)
        match parts:
            case ("mechanism", "springs", name):
                group, link = "springs", None
            case ("mechanism", "links", link, name) if name.split(" ")[0] in KINDS:
                group = "riders"
            case _:
                continue
        mesh = _mesh(recording, path)
        rows = rows_at(recording, frames, path, "Transform3D:translation", "Transform3D:quaternion")
        if mesh is None or rows is None:
            continue
        at, turns = (np.array([row.reshape(-1) for row in part], float) for part in rows)
        pose = np.column_stack([at[:, :2], np.unwrap(2.0 * np.arctan2(turns[:, 2], turns[:, 3]))])
        height = float(np.nanmean(at[:, 2]))
        spin: dict[str, Any] = {}
        if link is not None:  # below its link
            own = rows_at(recording, frames, _path("data", "links", link, "pose"), "Scalars:scalars")
            assert own is not None
            x, y, angle = np.array(own[0], float).T
            c, s = np.cos(angle), np.sin(angle)
            if np.abs(turns[:, :2]).max(initial=0.0) > 1e-3:  # about an axis in the plane
                moved = _spin_of([at, turns])
                spin, height, pose = {"spin": pack.floats(moved)}, 0.0, np.column_stack([x, y, angle])
            else:
                pose = np.column_stack([x + c * at[:, 0] - s * at[:, 1], y + s * at[:, 0] + c * at[:, 1], angle + pose[:, 2]])
        vertices = mesh[0] + [0.0, 0.0, height]
        body: dict[str, Any] = {"name": name, "group": group, "pose": pack.floats(pose), "moves": True, "box": None, **spin}
        scales = rows_at(recording, frames, path, "Transform3D:scale")
        if scales is not None:
            stretch = np.array([row.reshape(-1)[0] for row in scales[0]], float)
            long, wide = stretch * vertices[:, 0].max(), float(vertices[:, 1].max())
            end = pose[:, :2] + long[:, None] * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
            spots = np.concatenate([pose[:, :2], end])
            box = _box(np.concatenate([spots - wide, spots + wide]))
            body |= {"stretch": pack.floats(stretch), "box": box}
        found.append({**body, "mesh": _packed((vertices, *mesh[1:]), pack)})
    return found


def _packed(mesh: tuple[Any, Any, Any, Any], pack: Pack) -> dict[str, Any]:
    vertices, normals, faces, colors = mesh
    palette, number = np.unique(colors, return_inverse=True)
    return {
        "vertices": pack.places(vertices),
        "normals": pack.directions(normals),
        "faces": pack.indices(faces),
        "colors": pack.octets(number),
        "palette": [_hex(c) for c in palette],
    }


def _spin(recording: Recording, frames: Frames, name: str) -> Real | None:
    """Shift [m] and quaternion (frames, 7) of a solid in its link's frame, where it turns about an axis in the plane."""
    path = _path("mechanism", "links", name, "mesh")
    rows = rows_at(recording, frames, path, "Transform3D:translation", "Transform3D:quaternion")
    if rows is None:
        return None
    return _spin_of([np.array([row.reshape(-1) for row in part], float) for part in rows])


def _spin_of(rows: list[Real]) -> Real:
    """Shifts (frames, 3) and quaternions (frames, 4) side by side."""
    shifts, turns = rows[0], rows[1].copy()
    signs = np.cumprod(np.where(np.einsum("fi,fi->f", turns[1:], turns[:-1]) < 0.0, -1.0, 1.0))
    turns[1:] *= signs[:, None]  # neighbours on one side, so that the page can go straight from one to the next
    return np.column_stack([shifts, turns])


def bounds_of(recording: Recording, frames: Frames) -> Real:
    """The box (2, 3) [m] around all solids over the run."""
    boxes = []
    for name in recording.model["links"]:
        mesh = _mesh(recording, _path("mechanism", "links", name, "mesh"))
        poses = rows_at(recording, frames, _path("data", "links", name, "pose"), "Scalars:scalars")
        if mesh is None or poses is None:
            continue
        rim = mesh[0][_corners(mesh[0][:, :2])]
        x, y, angle = np.array(poses[0], float).T[:, :, None]
        if _spin(recording, frames, name) is not None:
            angle = np.zeros_like(angle)  # it turns about its own axis instead
        c, s = np.cos(angle), np.sin(angle)
        flat = np.stack([x + c * rim[:, 0] - s * rim[:, 1], y + s * rim[:, 0] + c * rim[:, 1]])
        z = mesh[0][:, 2]
        boxes.append([[*np.nanmin(flat, axis=(1, 2)), z.min()], [*np.nanmax(flat, axis=(1, 2)), z.max()]])
    if not boxes:
        return np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 0.1]])
    every = np.array(boxes)
    return np.array([every[:, 0].min(axis=0), every[:, 1].max(axis=0)])


def find_drawables(recording: Recording, frames: Frames, pack: Pack, progress: Progress = quiet) -> list[dict[str, Any]]:
    """Arrows, strips and points; ``group`` says what shows and hides them, ``view`` in which construction they stand."""
    numbers = {name: k for k, name in enumerate(recording.model["links"])}
    found = []
    for done, path in enumerate(recording.entities):
        progress(done, len(recording.entities))
        place = _placed(parts_of(path), numbers)
        if place is None:
            continue
        for shape in (_arrows, _strips, _points):
            drawn = shape(recording, frames, pack, path)
            if drawn is not None:
                found.append({**place, **drawn, "box": None if "link" in place else drawn["box"]})
    return found


def _placed(parts: tuple[str, ...], numbers: dict[str, int]) -> dict[str, Any] | None:
    """Group, name, link under whose pose an entity is drawn, and the construction it belongs to; None for what is not drawn."""
    match parts:
        case ("vectors", family, *rest) if family in FAMILIES:
            return {"group": family, "name": rest[0] if rest else family}
        case ("mechanism", "paths" | "springs" | "joints" as group, name):
            return {"group": group, "name": name}
        case ("mechanism", "links", link, what) if what != "mesh" and link in numbers:
            return {"group": "masses" if what == "lumps" else what, "name": link, "link": numbers[link]}
        case ("polygons", "funicular", "forces", *_):
            return {"group": "construction", "name": "funicular/forces", "view": "Force polygon with pole and rays"}
        case ("polygons", name, *rest) if name in OVERLAYS:
            return {"group": name, "name": rest[0] if rest else name}
        case ("polygons", *names):
            name = "/".join(n for n in names if n not in ASIDE)
            word = "Shaking force, polar" if name == "shaking" else f"{name.capitalize()} plan"
            return {"group": "construction", "name": name, "view": word}
    return None


def _arrows(recording: Recording, frames: Frames, pack: Pack, path: str) -> dict[str, Any] | None:
    rows = rows_at(recording, frames, path, "Arrows3D:origins", "Arrows3D:vectors")
    if rows is None:
        return None
    origins, vectors = _stacked(rows[0], 3), _stacked(rows[1], 3)
    if not np.isfinite(origins).any():
        return None
    look = _look(recording, path, "Arrows3D", origins.shape[1])
    places = {"origins": pack.places(origins[..., :2]), "vectors": pack.places(vectors[..., :2])}
    box = _box(np.concatenate([origins, origins + vectors]))
    return {"kind": "arrows", "count": origins.shape[1], "z": _height(origins), "box": box, **places, **look}


def _strips(recording: Recording, frames: Frames, pack: Pack, path: str) -> dict[str, Any] | None:
    rows = rows_at(recording, frames, path, "LineStrips3D:strips")
    if rows is None:
        still = recording.static(path, component="LineStrips3D:strips")
        if still is None or not len(still):
            return None
        points = np.concatenate([np.asarray(strip, float) for strip in still])
        look = _look(recording, path, "LineStrips3D", len(still))
        return {
            "kind": "still strips",
            "lengths": [len(strip) for strip in still],
            "points": pack.places(points[:, :2]),
            "z": _height(points),
            "box": _box(points),
            **look,
        }
    count = max((len(strips) for strips in rows[0]), default=0)
    length = max((len(strip) for strips in rows[0] for strip in strips), default=0)
    if not count or not length:
        return None
    points = np.full((len(frames.ns), count, length, 3), np.nan)
    for k, strips in enumerate(rows[0]):
        for i, strip in enumerate(strips):
            points[k, i, : len(strip)] = strip
            points[k, i, len(strip) :] = strip[-1]  # shorter ones end where they end
    look = _look(recording, path, "LineStrips3D", count)
    return {
        "kind": "strips",
        "count": count,
        "length": length,
        "points": pack.places(points[..., :2]),
        "z": _height(points),
        "box": _box(points),
        **look,
    }


def _points(recording: Recording, frames: Frames, pack: Pack, path: str) -> dict[str, Any] | None:
    rows = rows_at(recording, frames, path, "Points3D:positions")
    if rows is None:
        still = recording.static(path, component="Points3D:positions")
        if still is None or not len(still):
            return None
        look = _look(recording, path, "Points3D", len(still))
        places = {"points": pack.places(still[:, :2]), "z": _height(still)}
        return {"kind": "points", "count": len(still), "moves": False, "box": None, **places, **look}
    points = _stacked(rows[0], 3)
    if not np.isfinite(points).any():
        return None
    look = _look(recording, path, "Points3D", points.shape[1])
    return {
        "kind": "points",
        "count": points.shape[1],
        "moves": True,
        "points": pack.places(points[..., :2]),
        "z": _height(points),
        "box": _box(points),
        **look,
    }


def _look(recording: Recording, path: str, archetype: str, count: int) -> dict[str, Any]:
    """Colours, radii and labels of the instances; one stands for all."""

    def values(name: str) -> list[Any]:
        found = recording.static(path, component=f"{archetype}:{name}")
        given = [] if found is None else list(found)
        return given if len(given) == count or not given else [given[0]] * count

    shown = recording.static(path, component=f"{archetype}:show_labels")
    return {
        "colors": [_hex(c) for c in values("colors")],
        "radii": [float(r) for r in values("radii")],
        "labels": [str(t) for t in values("labels")] if shown is not None and len(shown) and shown[0] else [],
    }


def _mesh(recording: Recording, path: str) -> tuple[Any, Any, Any, Any] | None:
    """Vertices (n, 3) and unit normals (n, 3), faces (m, 3), colours (n,) as red, green, blue, alpha in one number."""
    names = ("vertex_positions", "vertex_normals", "triangle_indices", "vertex_colors")
    vertices, normals, faces, colors = (recording.static(path, component=f"Mesh3D:{name}") for name in names)
    if vertices is None or normals is None or faces is None or colors is None:
        return None
    return vertices.astype(float), normals.astype(float), faces, colors


def _stacked(rows: list[NDArray[Any]], width: int) -> Real:
    """Instances (frames, most, width) of rows that need not have the same number; NaN where there is none."""
    count = max((len(row) for row in rows), default=0)
    out = np.full((len(rows), count, width), np.nan)
    for k, row in enumerate(rows):
        out[k, : len(row)] = row
    return out


def _height(points: Real) -> float:
    """Height z [m] at which something planar lies."""
    z = points[..., 2]
    return float(np.nanmean(z)) if np.isfinite(z).any() else 0.0


def _box(points: Real) -> Real | None:
    """The box (2, 2) around points in the plane, without the outermost in a hundred; None where there are none."""
    flat = points.reshape(-1, points.shape[-1])[:, :2]
    flat = flat[np.isfinite(flat).all(axis=1)]
    return np.quantile(flat, [0.005, 0.995], axis=0) if len(flat) else None


def _corners(xy: Real) -> NDArray[np.int64]:
    """Points of a set that bound it at any angle: those furthest in 64 directions."""
    angle = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    return np.unique(np.argmax(xy @ np.stack([np.cos(angle), np.sin(angle)]), axis=0))


def _hex(color: Any) -> str:
    return f"#{int(color) >> 8:06x}"
