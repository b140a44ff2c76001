"""Marks on belts run as the pulleys turn, the same in all pictures."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sections import section
from shapely import Point

from mechviz.meshes.kinds.rims import BeltLoop
from mechviz.outputs.exports.gltf import glb_bytes
from mechviz.outputs.presentation import presentation_of
from mechviz.outputs.rerun.plots import main_plots
from mechviz.outputs.rerun.recorded import picture_in, recorded_numbers
from mechviz.outputs.viewer.world.bodies import BodyNodes
from mechviz.picture.build import picture_of
from mechviz.picture.nodes import Body
from mechviz.picture.surface_marks import BELT_MARKS, belt_travel, find_belt_marks
from recordings import Made, made, solids


def drive() -> Made:
    return made("belt-drive")


@pytest.mark.parametrize("crossed", [False, True])
def test_a_loop_is_closed_and_runs_along_itself(crossed):
    loop = BeltLoop("V", "frame", "wheel", (0.1 + 0.2j, 1.3 + 0.9j), (0.3, 0.5), crossed, 0.1)
    way = np.linspace(-1.0, 1.0, 20001) * loop.length
    at, direction = loop.at(way)
    step = np.diff(at) / np.diff(way)
    assert np.abs(np.abs(step) - 1.0).max() < 1e-6 and abs(at[0] - at[-1]) < 1e-12
    assert np.abs(step - np.exp(0.5j * (direction[1:] + direction[:-1]))).max() < 1e-3
    assert np.abs(np.diff(direction)).max() < 1.01 * np.diff(way).max() / min(loop.radii), "no jumps of the direction"
    assert direction[-1] - direction[0] == pytest.approx(0.0 if crossed else 4.0 * np.pi)
    for centre, radius in zip(loop.centres, loop.radii, strict=True):
        assert np.abs(at - centre).min() == pytest.approx(radius)


@pytest.mark.parametrize("joint", ["V", "X"])
def test_a_mark_on_a_pulley_turns_with_it(joint):
    """With the second one, too, whose angle the solver finds and the marks do not look at."""
    (loop,) = [k for k in solids("belt-drive").loops if k.joint == joint]
    motion, second = drive().run.motion, {"V": "drum", "X": "fan"}[joint]
    marks = [m for m in find_belt_marks(drive().run, solids("belt-drive")) if m.name.startswith(joint)]
    assert len(marks) == BELT_MARKS and np.ptp(belt_travel(drive().run, loop)) == pytest.approx(loop.radii[0] * 6.0 * np.pi)
    seen = 0
    for mark in marks:
        at = mark.places()[:, :2] @ [1.0, 1.0j]
        for link, centre, radius in zip(("motor", second), loop.centres, loop.radii, strict=True):
            on = np.abs(np.abs(at - centre) - radius) < 1e-9
            both = on[1:] & on[:-1]  # at two frames one after the other
            turned = np.diff(motion.pose(link)[:, 2])[both]
            went = np.angle((at[1:] - centre) / (at[:-1] - centre))[both]
            assert went == pytest.approx(turned, abs=1e-9)
            assert np.diff(mark.angle)[both] == pytest.approx(turned, abs=1e-9)
            seen += both.sum()
    assert seen > 400


def test_marks_lie_on_the_belts_that_are_drawn():
    solid = solids("belt-drive").links["frame"]
    belts = [part for part, kind in zip(solid.parts, solid.kinds, strict=True) if kind == "belt"]
    for loop, belt in zip(solids("belt-drive").loops, belts, strict=True):
        height = 0.5 * (loop.low + loop.high)
        assert belt.bounds[:, 2] == pytest.approx([loop.low, loop.high])
        shape = section(belt, height)
        for mark in find_belt_marks(drive().run, solids("belt-drive")):
            if mark.name.startswith(loop.joint):
                places = mark.places()
                assert np.all(places[:, 2] == pytest.approx(height))
                assert all(shape.contains(Point(x, y)) for x, y in places[::20, :2])
                corner = mark.vertices[mark.faces]
                normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
                assert np.all((normal * mark.normals[mark.faces[:, 0]]).sum(axis=1) > 0.0)
                assert np.ptp(mark.vertices[:, 1]) > loop.thick and np.ptp(mark.vertices[:, 2]) > loop.high - loop.low


def test_recording_page_viewer_and_glb_show_the_same_marks():
    marks = list(find_belt_marks(drive().run, solids("belt-drive")))
    read = list(picture_in(drive().recording, recorded_numbers(drive().recording)).nodes_of(Body, "belt"))
    assert [(m.key, m.parent) for m in read] == [(f"belt.{m.name}", m.link) for m in marks]
    data = glb_bytes(presentation_of(drive().run))
    size = int.from_bytes(data[12:16], "little")
    document, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    names = [node["name"] for node in document["nodes"]]
    (animation,) = document["animations"]
    for mark, again in zip(marks, read, strict=True):
        size = np.abs(mark.places()).max()
        assert again.poses.places == pytest.approx(mark.places(), abs=1e-6 * size)
        assert again.poses.quaternions == pytest.approx(mark.quaternions(), abs=1e-6)
        number = names.index(mark.title)
        assert number in document["nodes"][names.index("frame")]["children"]
        for path, values in (("translation", mark.places()), ("rotation", mark.quaternions())):
            (channel,) = [c for c in animation["channels"] if c["target"] == {"node": number, "path": path}]
            entry = document["accessors"][animation["samplers"][channel["sampler"]]["output"]]
            start = document["bufferViews"][entry["bufferView"]]["byteOffset"]
            computed = np.frombuffer(binary, "<f4", values.size, start).reshape(values.shape)
            assert computed == pytest.approx(values, abs=1e-6)
    assert len({document["nodes"][names.index(m.title)]["mesh"] for m in marks}) == 1, "one mesh for marks of one size"


def test_pulleys_are_not_called_rockers():
    names = [output.name for output in main_plots(drive().run)]
    assert names == ["Output angle [°]", "Output velocity [rad/s]", "Output acceleration [rad/s²]"]
    assert main_plots(made("kinetostatic-four-bar").run)[0].name == "Rocker angle [°]"


def test_marks_that_look_as_before_keep_their_nodes():
    """Else every step of a slider would send the meshes of all marks again."""
    made_nodes, gone = [], []

    def add_mesh_simple(path, *mesh, visible, **options):
        made_nodes.append(path)
        return SimpleNamespace(name=path, visible=visible, remove=lambda: gone.append(path))

    def shown(bodies):
        return SimpleNamespace(picture=replace(picture, nodes=tuple(bodies)))

    server = SimpleNamespace(scene=SimpleNamespace(add_mesh_simple=add_mesh_simple))
    picture = picture_of(drive().run, solids("belt-drive"))
    marks = tuple(picture.nodes_of(Body, "belt"))
    nodes = BodyNodes(server, shown(marks))
    assert len(made_nodes) == 2 * BELT_MARKS and not gone
    moved = tuple(replace(m, poses=replace(m.poses, places=m.poses.places + np.float32(0.01))) for m in marks)
    nodes.update(shown(moved))
    assert len(made_nodes) == 2 * BELT_MARKS and not gone
    for (_, place, turn), mark in zip(nodes.poses(7), moved, strict=True):
        assert place == pytest.approx(mark.poses.places[7]) and turn == pytest.approx(np.roll(mark.poses.quaternions[7], 1))
    nodes.update(shown(replace(m, mesh=replace(m.mesh, vertices=1.1 * m.mesh.vertices)) for m in moved))
    assert len(made_nodes) == 4 * BELT_MARKS and len(gone) == 2 * BELT_MARKS
    nodes.cut(-1.0)
    assert not any(node.visible for node, _, _ in nodes.poses(0))
