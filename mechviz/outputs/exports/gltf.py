"""The moving mechanism as a binary glTF 2.0 file (GLB): solids, springs, arrows of forces, traced paths and an animation.

Any glTF viewer plays it. It does not contain names and plots, which glTF does not support, nor constructions such as polygons and
centrodes. Belts are solids at rest, with marks that run along them.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Real
from mechviz.files import replacing
from mechviz.outputs.exports.gltf_marks import ARROW_FAMILIES, MarkNode, MarkShape, find_marks
from mechviz.outputs.presentation import Presentation
from mechviz.picture.nodes import Body, Lines, Mesh
from mechviz.picture.proportions import about_z

Array = NDArray[Any]

FLOAT_TYPE, SHORT_TYPE, INT_TYPE = 5126, 5123, 5125  # component types
VERTEX_BUFFER, INDEX_BUFFER = 34962, 34963  # targets of buffer views
LINE_STRIP = 3
ACCESSOR_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
METALLIC_FACTOR, ROUGHNESS_FACTOR = 0.25, 0.55


def export_glb(shown: Presentation, path: Path | str, *, arrows: Iterable[str] = ARROW_FAMILIES) -> Path:
    """Write the presentation of a run or a recording as GLB: metres, y up, one node per link, one animation over the whole run in
    real time. ``arrows``: families."""
    data = glb_bytes(shown, arrows=arrows)
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(data)
    return Path(path)


def glb_bytes(shown: Presentation, *, arrows: Iterable[str] = ARROW_FAMILIES) -> bytes:
    """The GLB file of a presentation (glTF 2.0 specification, sections 3 and 4)."""
    picture = shown.picture
    out = _Writer()
    tree = _Tree(out, out.accessor(_rising(picture.time), bounds=True), shown.name)
    numbers: dict[str, int] = {}
    bodies = {body.parent: body for body in picture.nodes_of(Body, "solids")}
    for name, pose in picture.poses.items():
        body = bodies.get(name)
        mesh = None if body is None else out.mesh(name, list(_primitives(out, body.mesh)))
        moves = {"translation": _translations(pose), "rotation": about_z(pose[:, 2])}
        spins = None if body is None else body.poses
        numbers[name] = tree.add(name, 0, mesh if spins is None else None, **moves)
        if spins is not None:  # a child node for the solid, which turns about an axis in the plane of motion
            tree.add(f"{name} solid", numbers[name], mesh, translation=spins.places, rotation=spins.quaternions)
    shapes: dict[Any, int] = {}  # marks of a belt have the same mesh
    for body in picture.nodes_of(Body, "roller", "belt", "springs", "sheet"):
        name, poses = body.key.replace(".", " ", 1), body.poses
        key = (body.group, body.mesh.vertices.tobytes())
        if key not in shapes:
            shapes[key] = out.mesh(name, list(_primitives(out, body.mesh)))
        placed = {} if poses is None else {"translation": poses.places, "rotation": poses.quaternions}
        scaled = {} if poses is None or poses.scales is None else {"scale": poses.scales}
        tree.add(name, numbers[body.parent] if body.parent else 0, shapes[key], **placed, **scaled)
    for mark in find_marks(shown, arrows):
        _add_mark(tree, mark, 0)
    for path in picture.nodes_of(Lines, "paths", "ink"):  # of ink the final drawing
        stroke = out.material(path.colors[0], line=True)
        lines = [
            {
                "attributes": {"POSITION": out.accessor(strip[-1], target=VERTEX_BUFFER, bounds=True)},
                "mode": LINE_STRIP,
                "material": stroke,
            }
            for strip in path.strips
            if strip.shape[1] > 1
        ]
        if lines:
            name = f"{path.group.removesuffix('s')} of {path.owner[1]}"
            tree.add(name, 0, out.mesh(name, lines))
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "mechviz"},
        "scene": 0,
        "scenes": [{"name": shown.title, "nodes": [0]}],
        "nodes": tree.nodes,
    }
    if tree.channels:
        document["animations"] = [{"name": "run", "channels": tree.channels, "samplers": tree.samplers}]
    return out.file(document)


def _add_mark(tree: _Tree, mark: MarkNode, parent: int) -> None:
    """Add a node with its animation, and its children."""
    mesh = None
    if mark.shape is not None:
        mesh = tree.out.mesh(mark.name, [_shown(tree.out, mark.shape)])
        if mark.weights is not None:
            tree.out.weigh(mesh, mark.weights[0].tolist())
    turns = None if mark.angles is None else about_z(mark.angles)
    moves = {"translation": mark.places, "rotation": turns, "scale": mark.scales, "weights": mark.weights}
    number = tree.add(mark.name, parent, mesh, **{path: values for path, values in moves.items() if values is not None})
    for child in mark.children:
        _add_mark(tree, child, number)


class _Tree:
    """The nodes of a file, the first of which is the root, and their animation."""

    def __init__(self, out: _Writer, times: int, name: str) -> None:
        self.out = out
        self.nodes: list[dict[str, Any]] = [{"name": name}]
        self.channels: list[dict[str, Any]] = []
        self.samplers: list[dict[str, Any]] = []
        self._times = times

    def add(self, name: str, parent: int, mesh: int | None = None, **moves: Array) -> int:
        """Add a node and return its number. ``moves``: its translation, rotation and scale (F, 3 or 4), and the weights (F, T) of
        the morph targets of its mesh; only those that change are animated."""
        number = len(self.nodes)
        node: dict[str, Any] = {"name": name} | ({} if mesh is None else {"mesh": mesh})
        self.nodes[parent].setdefault("children", []).append(number)
        self.nodes.append(node)
        for path, values in moves.items():
            if path != "weights":
                node[path] = values[0].tolist()
            if np.any(values != values[0]):
                self.channels.append({"sampler": len(self.samplers), "target": {"node": number, "path": path}})
                output = self.out.accessor(values.ravel() if path == "weights" else values)
                self.samplers.append({"input": self._times, "output": output, "interpolation": "LINEAR"})
        return number


class _Writer:
    """Collects the binary data of a file and their descriptions."""

    def __init__(self) -> None:
        self._binary = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._meshes: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []

    def accessor(self, values: Array, *, target: int | None = None, bounds: bool = False) -> int:
        """The number of a new accessor of values (n,) or (n, width), stored as float32, or as indices if they are integers;
        ``bounds``: with minimum and maximum."""
        values = np.asarray(values)
        if values.dtype.kind in "ui":
            kind = SHORT_TYPE if values.max(initial=0) < 65535 else INT_TYPE  # 65535 itself would restart a strip
            data = values.astype("<u2" if kind == SHORT_TYPE else "<u4")
        else:
            kind, data = FLOAT_TYPE, values.astype("<f4")
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": data.nbytes}
        if target is not None:
            view["target"] = target
        self._binary += data.tobytes()
        self._binary += b"\0" * (-len(self._binary) % 4)  # every view starts at a multiple of four
        width = data.shape[1] if data.ndim > 1 else 1
        entry: dict[str, Any] = {
            "bufferView": len(self._views),
            "componentType": kind,
            "count": len(data),
            "type": ACCESSOR_TYPES[width],
        }
        if bounds:  # of the stored values
            flat = data.reshape(-1, width)
            entry |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        self._views.append(view)
        self._accessors.append(entry)
        return len(self._accessors) - 1

    def weigh(self, mesh: int, weights: list[float]) -> None:
        """Set the initial weights of the morph targets of a mesh."""
        self._meshes[mesh]["weights"] = weights

    def mesh(self, name: str, primitives: list[dict[str, Any]]) -> int:
        self._meshes.append({"name": name, "primitives": primitives})
        return len(self._meshes) - 1

    def material(self, color: tuple[int, ...], *, line: bool = False, both: bool = False) -> int:
        """The number of a material of a colour (0-255); a ``line`` is emissive, for it has no normals; ``both``: double-sided."""
        linear = [round(_linear(c / 255.0), 6) for c in color[:3]]
        look: dict[str, Any] = {
            "pbrMetallicRoughness": {
                "baseColorFactor": [*linear, 1.0],
                "metallicFactor": METALLIC_FACTOR,
                "roughnessFactor": ROUGHNESS_FACTOR,
            }
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


def _primitives(out: _Writer, solid: Mesh) -> Iterator[dict[str, Any]]:
    """The primitives of a solid, one for each colour."""
    for color, chosen, faces in solid.pieces():
        yield _primitive(out, solid.vertices[chosen], solid.normals[chosen], faces, out.material(color))


def _primitive(out: _Writer, vertices: Array, normals: Array, faces: Array, material: int) -> dict[str, Any]:
    return {
        "attributes": {
            "POSITION": out.accessor(vertices, target=VERTEX_BUFFER, bounds=True),
            "NORMAL": out.accessor(normals, target=VERTEX_BUFFER),
        },
        "indices": out.accessor(faces.reshape(-1), target=INDEX_BUFFER),
        "material": material,
    }


def _shown(out: _Writer, shape: MarkShape) -> dict[str, Any]:
    """The primitive of a mark; flat marks are double-sided."""
    material = out.material(shape.color, both=bool(np.ptp(shape.vertices[:, 2]) == 0.0))
    primitive = _primitive(out, shape.vertices, shape.normals, shape.faces, material)
    if shape.targets is not None:
        primitive["targets"] = [{"POSITION": out.accessor(target, target=VERTEX_BUFFER, bounds=True)} for target in shape.targets]
    return primitive


def _rising(time: Real) -> Real:
    """Times of key frames [s], starting at zero as in animations."""
    return np.asarray(time, float) - float(time[0])


def _translations(pose: Real) -> Real:
    return np.column_stack([pose[:, :2], np.zeros(len(pose))])


def _linear(value: float) -> float:
    """A channel of sRGB (0 to 1) as linear light (IEC 61966-2-1)."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
