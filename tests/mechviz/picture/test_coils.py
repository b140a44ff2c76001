"""Springs as solids that deform: the shape of a coil, and how it is placed in recordings, pages, GLB files and the viewer."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from page_content import content

import mechviz
from mechviz.outputs.exports.gltf import glb_bytes
from mechviz.outputs.page.page import make_page
from mechviz.outputs.presentation import presentation_of
from mechviz.outputs.rerun.recorded import picture_in, recorded_numbers
from mechviz.picture.build import solids_of
from mechviz.picture.nodes import Body
from mechviz.picture.springs import WIRE_SIDES, coil_shell, find_coils
from mechviz.runs import run_scene
from recordings import made


@pytest.mark.parametrize("straight", [False, True])
def test_a_coil_is_a_closed_wire_of_its_length(straight):
    """Volume: the wire's section times the length of its middle line (Pappus); of a tension spring nearly all of it is seen."""
    length, radius, wire, turns = 0.09, 0.006, 0.0016, 8.0
    shell, normals = coil_shell(length, radius, wire, turns, straight=straight)
    mesh = trimesh.Trimesh(shell.vertices, shell.faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0.0
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert mesh.bounds[0, 0] == pytest.approx(0.0, abs=0.5 * wire) and mesh.bounds[1, 0] == pytest.approx(length, abs=0.5 * wire)
    rho = np.hypot(shell.vertices[:, 1], shell.vertices[:, 2])
    assert rho.max() == pytest.approx(radius + 0.5 * wire, rel=1e-3)
    section = 0.5 * WIRE_SIDES * np.sin(2.0 * np.pi / WIRE_SIDES) * (0.5 * wire) ** 2
    rise = length - 2.0 * wire
    along = np.hypot(2.0 * np.pi * radius * turns, rise) + (0.0 if straight else 4.0 * np.pi * radius)
    assert 0.88 < mesh.volume / (section * along) < 1.0  # half turns run out to the axis; ends are ground off
    if not straight:  # flat ends: some of the wire lies in each end's plane, facing outwards
        for end, sign in ((0.0, -1.0), (length, 1.0)):
            flat = np.abs(shell.vertices[:-2, 0] - end) < 1e-15
            assert flat.sum() > 30 and np.all(normals[:-2][flat] == (sign, 0.0, 0.0))


@pytest.mark.parametrize(("name", "load"), [("lamp-arm", "balance"), ("cam-roller", "return_spring")])
def test_springs_reach_from_point_to_point_in_recordings_pages_and_the_viewer(name, load):
    """The far end of the mesh, stretched and placed as recorded, is the spring's second point at every picture."""
    m = made(name, 24)
    spec = next(x for x in m.mechanism.loads if x.name == load)
    a, b = (m.run.motion.point(*end) for end in zip(spec.links, spec.points, strict=True))
    path = ("mechanism", "springs", load)
    vertices = m.recording.static(*path, component="Mesh3D:vertex_positions")
    at, turn, scale = (m.recording.rows(*path, component=f"Transform3D:{c}") for c in ("translation", "quaternion", "scale"))
    assert len(at.values) == m.run.motion.frames
    z, w = np.asarray(turn.values, float)[:, 2:].T
    reach = float(vertices[:, 0].max()) * np.asarray(scale.values, float)[:, 0]
    end = np.asarray(at.values, float)[:, :2] + reach[:, None] * np.column_stack([w * w - z * z, 2.0 * w * z])
    small = 1e-6 * np.abs(np.concatenate([a, b])).max()
    np.testing.assert_allclose(end, b, atol=4.0 * small)
    np.testing.assert_allclose(np.asarray(at.values)[:, :2], a, atol=small)
    np.testing.assert_array_equal(np.asarray(scale.values)[:, 1:], 1.0)
    (coil,) = picture_in(m.recording, recorded_numbers(m.recording)).nodes_of(Body, "springs")
    assert coil.owner == ("load", load)
    np.testing.assert_array_equal(coil.poses.scales, scale.values)
    header, arrays = content(make_page(m.shown)[0])
    (body,) = [x for x in header["bodies"] if x["group"] == "springs"]
    np.testing.assert_allclose(arrays[body["stretch"]], coil.poses.scales[:, 0], rtol=1e-6)
    assert any(g["name"] == "springs" for g in header["groups"])
    drawn, own = np.array(header["drawn"])[:, :2], coil.bounds()
    assert np.all(drawn[0] <= own[0] + small) and np.all(drawn[1] >= own[1] - small), "all of the spring is in the picture"


def test_a_glb_file_stretches_its_springs_and_rolls_its_rollers():
    run = run_scene(mechviz.load("cam-roller"), frames=12)
    data = glb_bytes(presentation_of(run))
    size = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + size])
    binary = data[28 + size :]
    names = [node.get("name") for node in document["nodes"]]
    spring, roller, follower = (names.index(n) for n in ("spring return_spring", "roller K", "follower"))
    assert roller in document["nodes"][follower]["children"]
    (channel,) = [c for c in document["animations"][0]["channels"] if c["target"] == {"node": spring, "path": "scale"}]
    accessor = document["accessors"][document["animations"][0]["samplers"][channel["sampler"]]["output"]]
    start = document["bufferViews"][accessor["bufferView"]]["byteOffset"]
    scales = np.frombuffer(binary, "<f4", 3 * accessor["count"], start).reshape(-1, 3)
    a, b = run.motion.point("follower", "E"), run.motion.point("frame", "H")
    length = np.hypot(*(b - a).T)
    np.testing.assert_allclose(scales[:, 0], length / (0.5 * (length.min() + length.max())), rtol=1e-6)
    assert {c["target"]["path"] for c in document["animations"][0]["channels"] if c["target"]["node"] == roller} == {"rotation"}


def test_a_spring_lies_around_its_stem_where_nothing_is_in_the_way():
    run = run_scene(mechviz.load("cam-roller"), frames=24)
    solids = solids_of(run)
    (coil,) = find_coils(run, solids)
    stem = next(p for k, p in zip(solids.links["follower"].kinds, solids.links["follower"].parts, strict=True) if k == "plate")
    assert coil.height == pytest.approx(stem.bounds[:, 2].mean(), abs=1e-9)
    low, high = coil.bounds()
    assert high[1] == pytest.approx(0.175, abs=0.01) and low[0] == pytest.approx(-high[0])
    assert find_coils(run, solids, {"return_spring": (0.25, 1.5)})[0].height == 0.25
    valve = run_scene(mechviz.load("valve-train"), frames=24)
    shapes = solids_of(valve)
    (around,) = find_coils(valve, shapes)  # wide enough for the guide, in the plane of the stem
    rails = [p.bounds for k, p in zip(shapes.links["frame"].kinds, shapes.links["frame"].parts, strict=True) if k == "rail"]
    inner = np.hypot(*around.vertices[np.abs(around.vertices[:, 0] - 0.015) < 0.005, 1:].T).min()
    assert around.width > 1.0 and inner > max(np.abs(b[:, 0]).max() for b in rails)
    assert rails[0][0, 2] < around.height < rails[0][1, 2]
    lamp = run_scene(mechviz.load("lamp-arm"), frames=24)
    shapes = solids_of(lamp)
    (beside,) = find_coils(lamp, shapes)  # it passes over its arms: before them
    assert beside.height > max(s.mesh.bounds[1, 2] for n, s in shapes.links.items() if n in ("lower", "upper"))
    assert find_coils(run_scene(mechviz.load("crank-rocker"), frames=12), solids) == []
