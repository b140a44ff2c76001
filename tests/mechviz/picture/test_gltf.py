"""The GLB file by the rules of glTF 2.0, read with nothing but the standard library: what moves in it is the motion."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from trimesh import Trimesh
from typer.testing import CliRunner

import mechviz
from mechviz.commands.main import app
from mechviz.outputs.exports.gltf import glb_bytes
from mechviz.outputs.exports.gltf_marks import ARROW_FAMILIES, find_marks
from mechviz.outputs.presentation import presentation_in, presentation_of
from mechviz.outputs.rerun.reader import Recording
from mechviz.outputs.rerun.writer import write_recording
from mechviz.picture.build import picture_of, solids_of
from mechviz.picture.nodes import Body
from mechviz.picture.proportions import ARROW_HEAD_LENGTH, SPIRAL_TURNS
from mechviz.quantities.vectors import VECTOR_FAMILIES
from mechviz.runs import run_scene
from recordings import vectors_of

NAMES = ["ten-link", "cam-roller", "slider-crank-compressor", "belt-drive", "door-closer"]
DTYPES = {5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class Glb:
    """A parsed file."""

    def __init__(self, data: bytes):
        magic, self.version, self.length = struct.unpack_from("<4sII", data)
        assert magic == b"glTF" and self.version == 2 and self.length == len(data)
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON" and size % 4 == 0
        self.document = json.loads(data[20 : 20 + size])
        length, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0" and length % 4 == 0 and 28 + size + length == len(data)
        self.binary = data[28 + size :]

    def __getitem__(self, key: str):
        return self.document[key]

    def values(self, number: int) -> np.ndarray:
        entry = self["accessors"][number]
        view = self["bufferViews"][entry["bufferView"]]
        width, dtype = WIDTHS[entry["type"]], np.dtype(DTYPES[entry["componentType"]])
        flat = np.frombuffer(self.binary, dtype, entry["count"] * width, view["byteOffset"] + entry.get("byteOffset", 0))
        return flat.reshape(-1, width) if width > 1 else flat


@pytest.fixture(scope="module", params=NAMES)
def made(request):
    run = run_scene(mechviz.load(request.param), frames=40)
    solids = solids_of(run)
    return run, solids, Glb(glb_bytes(presentation_of(run)))


def test_accessors_and_views_keep_the_rules(made):
    _, _, glb = made
    assert glb["asset"]["version"] == "2.0" and glb["buffers"] == [{"byteLength": len(glb.binary)}]
    end = 0
    for view in glb["bufferViews"]:
        assert view["byteOffset"] % 4 == 0 and view["byteOffset"] >= end  # no two overlap
        end = view["byteOffset"] + view["byteLength"]
        assert end <= len(glb.binary)
    for number, entry in enumerate(glb["accessors"]):
        view, values = glb["bufferViews"][entry["bufferView"]], glb.values(number)
        assert values.nbytes == view["byteLength"] and np.isfinite(values).all()
        if "min" in entry:
            rows = values.reshape(entry["count"], -1)
            assert np.array_equal(np.float32(entry["min"]), rows.min(axis=0).astype(np.float32))
            assert np.array_equal(np.float32(entry["max"]), rows.max(axis=0).astype(np.float32))


def test_references_and_tracks_keep_the_rules(made):
    """What the Khronos validator looks at beyond single accessors: it finds neither an error nor a warning in these files."""
    _, _, glb = made
    (animation,) = glb["animations"]
    targets = [(c["target"]["node"], c["target"]["path"]) for c in animation["channels"]]
    assert len(set(targets)) == len(targets) and max(n for n, _ in targets) < len(glb["nodes"])
    assert sorted(c["sampler"] for c in animation["channels"]) == list(range(len(animation["samplers"])))
    shapes = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3", "weights": "SCALAR"}
    for channel in animation["channels"]:
        sampler, (node, path) = animation["samplers"][channel["sampler"]], channel["target"].values()
        times, values = (glb["accessors"][sampler[k]] for k in ("input", "output"))
        mesh = glb["meshes"][glb["nodes"][node]["mesh"]] if path == "weights" else {}
        assert values["type"] == shapes[path] and values["count"] == times["count"] * len(mesh.get("weights", [0]))
        assert values["componentType"] == 5126 and "target" not in glb["bufferViews"][values["bufferView"]]
        if path == "rotation":
            assert np.linalg.norm(glb.values(sampler["output"]), axis=1) == pytest.approx(1.0, abs=1e-6)
        if path == "scale":
            assert (glb.values(sampler["output"]) != 0.0).all()
    primitives = [p for mesh in glb["meshes"] for p in mesh["primitives"]]
    assert {n["mesh"] for n in glb["nodes"] if "mesh" in n} == set(range(len(glb["meshes"])))
    assert {p["material"] for p in primitives} == set(range(len(glb["materials"]))), "none is left over"
    used = [n for p in primitives for n in (*p["attributes"].values(), *([p["indices"]] if "indices" in p else []))]
    used += [n for p in primitives for t in p.get("targets", []) for n in t.values()]
    used += [n for s in animation["samplers"] for n in (s["input"], s["output"])]
    assert set(used) == set(range(len(glb["accessors"])))
    for primitive in primitives:
        assert glb["bufferViews"][glb["accessors"][primitive["attributes"]["POSITION"]]["bufferView"]]["target"] == 34962
        if "indices" in primitive:
            assert glb["bufferViews"][glb["accessors"][primitive["indices"]]["bufferView"]]["target"] == 34963


def test_nodes_form_a_tree_with_a_node_for_every_link(made):
    run, _, glb = made
    nodes = glb["nodes"]
    children = [c for node in nodes for c in node.get("children", [])]
    assert sorted(children) == list(range(1, len(nodes))) and glb["scenes"][0]["nodes"] == [0]
    assert [n["name"] for n in nodes[1:]][: len(run.motion.model.links)] == list(run.motion.model.links)


def test_meshes_are_the_solids(made):
    """Solids with what is fixed to them, such as seats of springs."""
    run, solids, glb = made
    bodies = {body.parent: body.mesh for body in picture_of(run, solids).nodes_of(Body, "solids")}
    for node in glb["nodes"]:
        if node["name"] not in bodies:
            continue
        solid, triangles = bodies[node["name"]], []
        for primitive in glb["meshes"][node["mesh"]]["primitives"]:
            places, normals = (glb.values(primitive["attributes"][k]) for k in ("POSITION", "NORMAL"))
            indices = glb.values(primitive["indices"])
            assert len(places) == len(normals) and indices.max() < len(places) and len(indices) % 3 == 0
            assert {"min", "max"} <= set(glb["accessors"][primitive["attributes"]["POSITION"]])
            assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=5e-3)
            triangles.append(places[indices.reshape(-1, 3)])
            color = glb["materials"][primitive["material"]]["pbrMetallicRoughness"]["baseColorFactor"]
            assert len(color) == 4 and all(0.0 <= c <= 1.0 for c in color)
        computed = np.concatenate(triangles)
        assert np.array_equal(np.sort(computed, axis=None), np.sort(solid.vertices[solid.faces], axis=None))
        mesh = Trimesh(solid.vertices.astype(float), solid.faces, process=False)
        volume = np.einsum("ij,ij->i", computed[:, 0], np.cross(computed[:, 1], computed[:, 2])).sum() / 6.0
        assert volume == pytest.approx(mesh.volume, rel=1e-3)  # every triangle once
        assert volume > 0.999 * solids.links[node["name"]].mesh.volume  # and outwards


def test_the_animation_is_the_motion(made):
    """Each vertex of a link, moved by translation and rotation as the specification says, is where the pose puts it."""
    run, _, glb = made
    motion = run.motion
    (animation,) = glb["animations"]
    moving = {name for name in motion.model.links if np.any(motion.pose(name) != motion.pose(name)[0])}
    channels = {(glb["nodes"][c["target"]["node"]]["name"], c["target"]["path"]): c["sampler"] for c in animation["channels"]}
    links = {key for key in channels if key[0] in motion.model.links}  # springs and rollers move too
    poses = {name: motion.pose(name) for name in moving}
    assert links == {(n, "translation") for n, p in poses.items() if np.any(p[:, :2] != p[0, :2])} | {
        (n, "rotation") for n, p in poses.items() if np.any(p[:, 2] != p[0, 2])
    }
    assert any((n, "translation") not in links for n in moving), "a crank's origin stands still"
    for name in motion.model.links:
        pose, node = motion.pose(name), next(n for n in glb["nodes"] if n["name"] == name)
        first = {k: np.array(node[k]) for k in ("translation", "rotation")}
        spot = np.array([0.02, -0.01])
        for frame in range(0, motion.frames, 7):
            state = dict(first)
            for path in [p for p in first if (name, p) in links]:
                sampler = animation["samplers"][channels[name, path]]
                times = glb.values(sampler["input"])
                assert sampler["interpolation"] == "LINEAR" and np.all(np.diff(times) > 0.0) and times[0] == 0.0
                assert {"min", "max"} <= set(glb["accessors"][sampler["input"]])
                assert times == pytest.approx(motion.time - motion.time[0], rel=1e-6)
                state[path] = glb.values(sampler["output"])[frame]
            x, y, z, w = state["rotation"]
            assert x == y == 0.0 and z * z + w * w == pytest.approx(1.0, abs=1e-6)
            turn = np.array([[1 - 2 * z * z, -2 * z * w], [2 * z * w, 1 - 2 * z * z]])
            c, s = np.cos(pose[frame, 2]), np.sin(pose[frame, 2])
            expected = pose[frame, :2] + np.array([[c, -s], [s, c]]) @ spot
            assert state["translation"][:2] + turn @ spot == pytest.approx(expected, abs=1e-6)
        if (name, "rotation") in links:  # the shorter way round between key frames is the way that the link goes
            q = glb.values(animation["samplers"][channels[name, "rotation"]]["output"])
            assert np.all((q[1:] * q[:-1]).sum(axis=1) > 0.0)


def _track(glb: Glb, name: str, path: str, frames: int) -> np.ndarray:
    """What a node does over the frames: its channel, or what it stands at."""
    number, node = next((k, n) for k, n in enumerate(glb["nodes"]) if n["name"] == name)
    for channel in glb["animations"][0]["channels"]:
        if channel["target"] == {"node": number, "path": path}:
            return glb.values(glb["animations"][0]["samplers"][channel["sampler"]]["output"]).astype(float)
    still = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
    return np.tile(np.asarray(node.get(path, still.get(path)), float), (frames, 1))


def test_arrows_reach_from_the_point_of_action_as_far_as_the_force_is_large():
    run = run_scene(mechviz.load("slider-crank-compressor"), frames=40)
    glb = Glb(glb_bytes(presentation_of(run)))
    vectors, _, scales = vectors_of(run, size := solids_of(run).size)
    drawn = picture_of(run, solids_of(run)).by_key
    assert set(ARROW_FAMILIES) & set(vectors) >= {"reaction", "applied", "inertia"}
    for family in set(ARROW_FAMILIES) & set(vectors):
        for item, vector in vectors[family].items():
            name = f"{VECTOR_FAMILIES[family].label}: {item}"
            place, turn, scale = (_track(glb, name, path, run.motion.frames) for path in ("translation", "rotation", "scale"))
            head, shaft = _track(glb, f"{name} head", "translation", 41), _track(glb, f"{name} shaft", "scale", 41)
            assert head[:, 0] == pytest.approx(shaft[:, 0]), "the head sits on the shaft"
            along = scale[:, 0] * (head[:, 0] + ARROW_HEAD_LENGTH * size) * np.exp(2j * np.arctan2(turn[:, 2], turn[:, 3]))
            assert np.all((turn[1:] * turn[:-1]).sum(axis=1) >= 0.0)
            wanted = vector.value @ [1.0, 1.0j] / scales.newtons_per_metre
            assert np.abs(along - wanted).max() < 2e-4 * size, name
            assert place[:, :2] == pytest.approx(drawn[f"{family}.{item}"].origin, abs=1e-6)
    torque = run.forces.effort("A")
    arc = _track(glb, "Drive: moment A", "scale", 41)
    assert arc[:, 1] / np.abs(arc[:, 1]).max() == pytest.approx(torque / np.abs(torque).max(), abs=2e-4)
    assert not any(":" in node["name"] for node in Glb(glb_bytes(presentation_of(run), arrows=()))["nodes"])


def test_struts_and_torsion_springs_go_with_their_ends():
    run = run_scene(mechviz.load("door-closer"), frames=24)
    glb, motion = Glb(glb_bytes(presentation_of(run))), run.motion
    for end, (link, point) in {"cylinder": ("frame", "P"), "rod": ("door", "Q")}.items():
        places = _track(glb, f"damper damper {end}", "translation", motion.frames)
        assert places[:, :2] == pytest.approx(motion.point(link, point), abs=1e-6)
    axis = motion.point("door", "Q") - motion.point("frame", "P")
    turn = _track(glb, "damper damper rod", "rotation", motion.frames)
    assert np.exp(2j * np.arctan2(turn[:, 2], turn[:, 3])) == pytest.approx(axis @ [1, 1j] / np.hypot(*axis.T), abs=1e-6)
    node = next(n for n in glb["nodes"] if n["name"] == "spring spring")
    (primitive,) = glb["meshes"][node["mesh"]]["primitives"]
    weights = _track(glb, "spring spring", "weights", motion.frames).reshape(motion.frames, -1)
    assert weights.shape[1] == len(primitive["targets"]) == len(glb["meshes"][node["mesh"]]["weights"]) <= 8
    base = glb.values(primitive["attributes"]["POSITION"]).astype(float)
    shapes = base + np.einsum("ft,tvk->fvk", weights, np.stack([glb.values(t["POSITION"]) for t in primitive["targets"]]))
    outer = shapes[:, -2:].mean(axis=1) @ [1.0, 1.0j, 0.0]  # in the axes of the inner link: where the outer one is
    wound = motion.pose("frame")[:, 2] - motion.pose("door")[:, 2] + 2.0 * np.pi * SPIRAL_TURNS
    assert np.abs(np.angle(outer * np.exp(-1j * wound))).max() < 0.01 and np.ptp(wound) > 1.0
    assert np.abs(outer) == pytest.approx(np.abs(outer).max(), rel=0.01), "between targets it hardly shrinks"


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    "name", ["slider-crank-compressor", "belt-drive", "door-closer", "tailgate", "engine-mounts", "cam-barrel"]
)
def test_a_recording_gives_the_file_of_its_run(name: str, tmp_path: Path):
    """The same nodes, meshes and channels; numbers to the digits of what is drawn, times to a nanosecond."""
    run = run_scene(mechviz.load(name), frames=12)
    write_recording(run, tmp_path / "a.rrd")
    own = Glb(glb_bytes(presentation_of(run)))
    read = Glb(glb_bytes(presentation_in(Recording(tmp_path / "a.rrd"))))
    for part in ("asset", "scenes", "meshes", "materials", "animations"):
        assert own[part] == read[part], part
    assert [(n["name"], n.get("children"), n.get("mesh")) for n in own["nodes"]] == [
        (n["name"], n.get("children"), n.get("mesh")) for n in read["nodes"]
    ]
    for number, entry in enumerate(own["accessors"]):
        a, b = own.values(number).astype(float), read.values(number).astype(float)
        assert a.shape == b.shape and np.abs(a - b).max(initial=0.0) <= 2e-6 * max(1.0, np.abs(a).max(initial=0.0)), entry


def test_shapes_of_marks_look_outwards():
    run = run_scene(mechviz.load("tailgate"), frames=6)
    seen = 0
    for mark in find_marks(presentation_of(run)):
        for shape in filter(None, [mark.shape, *(child.shape for child in mark.children)]):
            corner = shape.vertices[shape.faces]
            normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
            area = np.linalg.norm(normal, axis=1)
            solid = area > 1e-12 * area.max()
            assert ((normal * shape.normals[shape.faces].mean(axis=1)).sum(axis=1)[solid] > 0.9 * area[solid]).all(), mark.name
            assert np.linalg.norm(shape.normals, axis=1) == pytest.approx(1.0)
            seen += 1
    assert seen >= 6


def test_traced_paths_are_lines(made):
    run, _, glb = made
    lines = {m["name"]: m["primitives"][0] for m in glb["meshes"] if m["primitives"][0].get("mode") == 3}
    assert set(lines) == {f"path of {link}.{point}" for link, point in run.motion.mechanism.traced}
    for link, point in run.motion.mechanism.traced:
        places = glb.values(lines[f"path of {link}.{point}"]["attributes"]["POSITION"])
        assert places[:, :2] == pytest.approx(run.motion.point(link, point), abs=1e-6)


def test_the_command_writes_it_whole_or_not_at_all(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["export", "crank-rocker", "--frames", "12", "--glb", "a.glb"])
    assert result.exit_code == 0 and result.output.strip().endswith("a.glb")
    Glb((tmp_path / "a.glb").read_bytes())
    before = (tmp_path / "a.glb").read_bytes()
    monkeypatch.setattr("mechviz.files.put_in_place", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    result = CliRunner().invoke(app, ["export", "crank-rocker", "--frames", "24", "--glb", "a.glb"])
    assert result.exit_code == 1 and "disk is full" in result.output
    assert (tmp_path / "a.glb").read_bytes() == before and len(list(tmp_path.iterdir())) == 1
    for words in (["--glb", "a.glb", "--arrows", "reactions"], ["--csv", "a.csv", "--arrows", "reaction"]):
        result = CliRunner().invoke(app, ["export", "crank-rocker", *words])
        assert result.exit_code == 2 and "--arrows" in result.output
    result = CliRunner().invoke(app, ["export", "crank-rocker"])
    assert result.exit_code == 2 and "--glb" in result.output


def test_the_command_takes_a_recording(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_recording(run_scene(mechviz.load("crank-rocker"), frames=12), "a.rrd")
    result = CliRunner().invoke(app, ["export", "a.rrd", "--glb", "a.glb", "--arrows", "none"])
    assert result.exit_code == 0 and result.output.strip().endswith("a.glb")
    assert not any(":" in node["name"] for node in Glb((tmp_path / "a.glb").read_bytes())["nodes"])
    for words in (["--csv", "a.csv"], ["--glb", "b.glb", "--frames", "12"], ["--glb", "b.glb", "--dxf", "a.dxf"]):
        result = CliRunner().invoke(app, ["export", "a.rrd", *words])
        assert result.exit_code == 2 and "a.rrd is a recording" in result.output, words
