"""The moving mechanism as a binary glTF 2.0 file (GLB): solids, springs, arrows of forces, traced paths and an animation.

Any viewer of glTF plays it. Not in it: names and plots, of which glTF knows nothing, and constructions such as plans and polodes.
Belts are solids that stand still.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .coils import COLOR as COIL
from .coils import find_coils
from .files import replacing
from .gltf_marks import ARROWS, Mark, Shape, find_marks
from .heights import path_height
from .rollers import COLOR as ROLLER
from .rollers import find_rollers
from .solids import solids_of
from .vectors import point_name

if TYPE_CHECKING:
    from .meshes import Solid, Solids
    from .run import Run

__all__ = ["ARROWS", "export_glb", "glb_bytes"]

Array = NDArray[Any]

FLOAT, SHORT, INT = 5126, 5123, 5125  # component types
VERTICES, INDICES = 34962, 34963  # what a buffer view is for
LINE_STRIP = 3
TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
METALLIC, ROUGH = 0.25, 0.55


def export_glb(run: Run, path: Path | str, *, solids: Solids | None = None, arrows: Iterable[str] = ARROWS) -> Path:
    """Write a run as GLB: metres, y up, one node a link, one animation over the whole run in its own time. ``arrows``: families."""
    data = glb_bytes(run, solids=solids, arrows=arrows)
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(data)
    return Path(path)


def glb_bytes(run: Run, *, solids: Solids | None = None, arrows: Iterable[str] = ARROWS) -> bytes:
    """The GLB file of a run (glTF 2.0 specification, sections 3 and 4)."""
    solids = solids or solids_of(run)
    motion = run.motion
    out = _Writer()
    times = out.accessor(_rising(motion.time), bounds=True)
    nodes: list[dict[str, Any]] = [{"name": run.scene.name, "children": []}]
    channels: list[dict[str, Any]] = []
    samplers: list[dict[str, Any]] = []
    for name, solid in solids.links.items():
        pose = motion.pose(name)
        node: dict[str, Any] = {"name": name, **_placed(pose[0])}
        mesh = out.mesh(name, list(_primitives(out, solid))) if len(solid.faces) else None
        if mesh is not None and solid.spin is None:
            node["mesh"] = mesh
        nodes[0]["children"].append(len(nodes))
        if len(pose) > 1 and np.any(pose != pose[0]):
            for path, values in (("translation", _translations(pose)), ("rotation", _rotations(pose[:, 2]))):
                channels.append({"sampler": len(samplers), "target": {"node": len(nodes), "path": path}})
                samplers.append({"input": times, "output": out.accessor(values), "interpolation": "LINEAR"})
        nodes.append(node)
        if mesh is not None and solid.spin is not None:  # below its link the solid turns about an axis in the plane
            from .meshes.spatial import spin_transforms

            shifts, turns = spin_transforms(solid.spin, pose[:, 2] - motion.pose(solid.spin.carrier)[:, 2])
            node["children"] = [len(nodes)]
            for path, values in (("translation", shifts), ("rotation", turns)):
                channels.append({"sampler": len(samplers), "target": {"node": len(nodes), "path": path}})
                samplers.append({"input": times, "output": out.accessor(values), "interpolation": "LINEAR"})
            nodes.append({"name": f"{name} solid", "mesh": mesh, "translation": shifts[0].tolist(), "rotation": turns[0].tolist()})
    numbers = {node["name"]: k for k, node in enumerate(nodes)}
    for mark in find_rollers(run, solids):  # they turn below the links that carry the rollers
        shape = out.mesh(f"roller {mark.name}", [_primitive(out, mark.vertices, mark.normals, mark.faces, ROLLER)])
        for path, values in (("rotation", mark.turns()),) if len(mark.angle) > 1 else ():
            channels.append({"sampler": len(samplers), "target": {"node": len(nodes), "path": path}})
            samplers.append({"input": times, "output": out.accessor(values), "interpolation": "LINEAR"})
        nodes[numbers[mark.link]].setdefault("children", []).append(len(nodes))
        nodes.append({"name": f"roller {mark.name}", "mesh": shape, "translation": list(mark.centre)})
    for coil in find_coils(run, solids):
        moves = {"translation": coil.places(), "rotation": _rotations(coil.pose[:, 2]), "scale": coil.scales()}
        shape = out.mesh(f"spring {coil.name}", [_primitive(out, coil.vertices, coil.normals, coil.faces, COIL)])
        for path, values in moves.items() if len(coil.pose) > 1 else ():
            channels.append({"sampler": len(samplers), "target": {"node": len(nodes), "path": path}})
            samplers.append({"input": times, "output": out.accessor(values), "interpolation": "LINEAR"})
        nodes[0]["children"].append(len(nodes))
        nodes.append({"name": f"spring {coil.name}", "mesh": shape, **{key: v[0].tolist() for key, v in moves.items()}})

    def add(mark: Mark, parent: int) -> None:
        """A node with what moves it, and those below it."""
        number = len(nodes)
        node: dict[str, Any] = {"name": mark.name}
        nodes[parent].setdefault("children", []).append(number)
        nodes.append(node)
        turns = None if mark.turns is None else _rotations(mark.turns)
        for path, values in (("translation", mark.places), ("rotation", turns), ("scale", mark.scales), ("weights", mark.weights)):
            if values is None:
                continue
            if path != "weights":
                node[path] = values[0].tolist()
            if len(values) > 1 and np.any(values != values[0]):
                channels.append({"sampler": len(samplers), "target": {"node": number, "path": path}})
                flat = values.ravel() if path == "weights" else values
                samplers.append({"input": times, "output": out.accessor(flat), "interpolation": "LINEAR"})
        if mark.shape is not None:
            node["mesh"] = out.mesh(mark.name, [_shown(out, mark.shape)])
            if mark.weights is not None:
                out.weigh(node["mesh"], mark.weights[0].tolist())
        for below in mark.below:
            add(below, number)

    for item in find_marks(run, solids, arrows):
        add(item, 0)
    for link, point in motion.mechanism.traced:
        xy = motion.point(link, point)
        places = np.column_stack([xy, np.full(len(xy), path_height(run, solids.heights, link, point))])
        if len(places) < 2:
            continue
        ink = out.material(solids.links[link].color, line=True)
        line = {"attributes": {"POSITION": out.accessor(places, target=VERTICES, bounds=True)}, "mode": LINE_STRIP, "material": ink}
        nodes[0]["children"].append(len(nodes))
        nodes.append({"name": f"path of {point_name(link, point)}", "mesh": out.mesh(f"path of {point_name(link, point)}", [line])})
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "mechviz"},
        "scene": 0,
        "scenes": [{"name": run.scene.title, "nodes": [0]}],
        "nodes": nodes,
    }
    if channels:
        document["animations"] = [{"name": "run", "channels": channels, "samplers": samplers}]
    return out.file(document)


class _Writer:
    """Collects the binary data of a file with what describes them."""

    def __init__(self) -> None:
        self._binary = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._meshes: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []

    def accessor(self, values: Array, *, target: int | None = None, bounds: bool = False) -> int:
        """Values (n,) or (n, width) as float32, or as indices where they are integers; ``bounds``: with least and greatest."""
        values = np.asarray(values)
        if values.dtype.kind in "ui":
            kind = SHORT if values.max(initial=0) < 65535 else INT  # 65535 itself would restart a strip
            data = values.astype("<u2" if kind == SHORT else "<u4")
        else:
            kind, data = FLOAT, values.astype("<f4")
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": data.nbytes}
        if target is not None:
            view["target"] = target
        self._binary += data.tobytes()
        self._binary += b"\0" * (-len(self._binary) % 4)  # every view starts at a multiple of four
        width = data.shape[1] if data.ndim > 1 else 1
        entry: dict[str, Any] = {"bufferView": len(self._views), "componentType": kind, "count": len(data), "type": TYPES[width]}
        if bounds:  # of the values as they are stored
            flat = data.reshape(-1, width)
            entry |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        self._views.append(view)
        self._accessors.append(entry)
        return len(self._accessors) - 1

    def weigh(self, mesh: int, weights: list[float]) -> None:
        """How much of its targets a mesh shows at first."""
        self._meshes[mesh]["weights"] = weights

    def mesh(self, name: str, primitives: list[dict[str, Any]]) -> int:
        self._meshes.append({"name": name, "primitives": primitives})
        return len(self._meshes) - 1

    def material(self, color: tuple[int, ...], *, line: bool = False, both: bool = False) -> int:
        """A material of a colour (0-255); a line shines by itself, for it has no normals; ``both``: seen from both sides."""
        linear = [round(_linear(c / 255.0), 6) for c in color[:3]]
        look: dict[str, Any] = {
            "pbrMetallicRoughness": {"baseColorFactor": [*linear, 1.0], "metallicFactor": METALLIC, "roughnessFactor": ROUGH}
        }
        if line:
            look = {"pbrMetallicRoughness": {"baseColorFactor": [0.0, 0.0, 0.0, 1.0]}, "emissiveFactor": linear}
        if both:
            look["doubleSided"] = True
        if look not in self._materials:
            self._materials.append(look)
        return self._materials.index(look)

    def file(self, document: dict[str, Any]) -> bytes:
        """The whole file: header, JSON and binary chunk, each padded to multiples of four."""
        parts = {"meshes": self._meshes, "materials": self._materials, "accessors": self._accessors, "bufferViews": self._views}
        document = {**document, **{k: v for k, v in parts.items() if v}, "buffers": [{"byteLength": len(self._binary)}]}
        text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        length = 12 + 8 + len(text) + 8 + len(self._binary)
        head = b"glTF" + np.array([2, length, len(text)], "<u4").tobytes() + b"JSON"
        return head + text + np.array([len(self._binary)], "<u4").tobytes() + b"BIN\0" + bytes(self._binary)


def _primitives(out: _Writer, solid: Solid) -> Iterator[dict[str, Any]]:
    """A solid in pieces of one colour each, which are of one material each."""
    colors, piece = np.unique(solid.colors[:, :3], axis=0, return_inverse=True)
    piece = piece.reshape(-1)
    for k, color in enumerate(colors):
        chosen = np.flatnonzero(piece == k)
        place = np.zeros(len(piece), np.uint32)
        place[chosen] = np.arange(len(chosen), dtype=np.uint32)
        faces = place[solid.faces[piece[solid.faces[:, 0]] == k]]
        yield _primitive(out, solid.vertices[chosen], solid.normals[chosen], faces, tuple(int(c) for c in color))


def _primitive(out: _Writer, vertices: Array, normals: Array, faces: Array, color: tuple[int, ...]) -> dict[str, Any]:
    return {
        "attributes": {
            "POSITION": out.accessor(vertices, target=VERTICES, bounds=True),
            "NORMAL": out.accessor(normals, target=VERTICES),
        },
        "indices": out.accessor(faces.reshape(-1), target=INDICES),
        "material": out.material(color),
    }


def _shown(out: _Writer, shape: Shape) -> dict[str, Any]:
    """What a mark looks like; flat ones are seen from both sides."""
    primitive = _primitive(out, shape.vertices, shape.normals, shape.faces, shape.color)
    primitive["material"] = out.material(shape.color, both=bool(np.ptp(shape.vertices[:, 2]) == 0.0))
    if shape.targets is not None:
        primitive["targets"] = [{"POSITION": out.accessor(target, target=VERTICES, bounds=True)} for target in shape.targets]
    return primitive


def _rising(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Times of key frames: from zero, as animations are."""
    return np.asarray(time, float) - float(time[0])


def _translations(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([pose[:, :2], np.zeros(len(pose))])


def _rotations(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternions x, y, z, w (n, 4) of turns about z, without jumps of sign from frame to frame."""
    nothing = np.zeros(len(angle))
    return np.column_stack([nothing, nothing, np.sin(0.5 * angle), np.cos(0.5 * angle)])


def _placed(pose: NDArray[np.float64]) -> dict[str, Any]:
    return {"translation": _translations(pose[None])[0].tolist(), "rotation": _rotations(pose[None, 2])[0].tolist()}


def _linear(value: float) -> float:
    """A channel of sRGB (0 to 1) as light (IEC 61966-2-1)."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
