"""How large mechanisms are in the viewer, and where their marks are: through the camera that a browser is given."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from filled import SCENES, arrows_box, solid_points
from patience import PATIENCE
from viewer_sockets import CAMERA, messages, opened, replay, send
from websockets.sync.client import ClientConnection

from mechcore.arrays import Real
from mechcore.joints.registry import build_joints
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.world import camera
from mechviz.outputs.viewer.world.camera import USUAL_ASPECT, VIEW_PRESETS, Preset, View, fit_view
from mechviz.picture.build import joint_nodes, solid_nodes
from mechviz.picture.nodes import Mesh
from recordings import ran, solids

FREE = {"1600x1000": 930 / 920, "1280x720": 602 / 602, "390x844": 390 / 388, "844x390": 764 / 294}
"""Width over height of what panels and the timeline leave of a window."""
HIGH = 920  # pixels of it in the largest window
AROUND = np.array([0.0, *(0.01 * np.exp(0.25j * np.pi * np.arange(8)))])  # of a joint, in sizes: its own hole or edge may be there


def projected(points: Real, view: View, preset: Preset, aspect: float) -> tuple[Real, Real]:
    """Places (n, 3) [m] in the picture (n,) each, from its middle to its edges -1 to 1."""
    away = (view.position - view.look_at) / view.distance
    right = np.cross([0.0, 1.0, 0.0], away)
    right /= np.linalg.norm(right)
    local = points - view.look_at
    depth = (view.distance - local @ away) * np.tan(0.5 * preset.fov)
    return local @ right / depth / aspect, local @ np.cross(away, right) / depth


@pytest.mark.parametrize("name", SCENES)
def test_a_mechanism_fills_two_thirds_of_the_height_or_width_and_no_part_is_cut_off(name):
    points, arrows, core = solid_points(name), arrows_box(name), np.asarray(solids(name).bounds, float)
    for window, aspect in FREE.items():
        for preset in (VIEW_PRESETS["front"], VIEW_PRESETS["isometric"]):
            x, y = projected(points, fit_view(arrows, aspect, preset, core), preset, aspect)
            assert max(np.abs(x).max(), np.abs(y).max()) < 1.0, (window, preset.label)
            least = 2.0 / 3.0 if preset.label == "Front" else 0.5  # a box that is seen at an angle is not filled to its corners
            assert max(np.ptp(x), np.ptp(y)) > 2.0 * least, (window, preset.label)


def test_a_page_that_begins_late_or_comes_back_is_fitted_nevertheless():
    """A busy page goes to the first view that it has heard of last when it comes to that: here after it was given a fitted one.

    One that has lost its connection comes back with the view that it had."""
    with Viewer(ran("crank-rocker"), port=0) as shown, opened(shown.server.get_port()) as browser:
        core = np.asarray(shown.scene.current.bounds, float)
        boxes = [shown.scene.bounds, *(core + wider * shown.scene.size * np.array([[-1.0], [1.0]]) for wider in (0.3, 0.6))]
        replay(browser)
        firsts = [fit_view(box, USUAL_ASPECT, core=core) for box in boxes]
        reports(browser, firsts[0])
        arrives(browser, fit_view(boxes[0], CAMERA["image_width"] / CAMERA["image_height"], core=core))
        for box in boxes[1:]:
            shown.scene.cameras.set_bounds(box, core)
            best = fit_view(box, CAMERA["image_width"] / CAMERA["image_height"], core=core)
            arrives(browser, best)
        for first in firsts:
            reports(browser, first)
            arrives(browser, best)
        browser.close()
        with opened(shown.server.get_port()) as again:  # the same page, whose window has another shape now
            replay(again)
            reports(again, best, image_width=500)
            arrives(again, fit_view(box, 500 / CAMERA["image_height"], core=core))


def test_what_browsers_report_does_not_come_between_the_steps_of_moving_a_camera(monkeypatch):
    """viser sends nothing to a camera that is there already, by what its browser has said last: said in the midst of the steps, the
    last one would be left out, and the camera would stay where an earlier one has put it."""
    threads: list[int] = []

    def noted(client: Any, view: View) -> None:
        threads.append(threading.get_ident())
        moved(client, view)

    moved = camera.move_to
    with Viewer(ran("crank-rocker"), port=0) as shown, opened(shown.server.get_port()) as browser:
        monkeypatch.setattr(camera, "move_to", noted)
        core = np.asarray(shown.scene.current.bounds, float)
        replay(browser)
        reports(browser, fit_view(shown.scene.bounds, USUAL_ASPECT, core=core))
        arrives(browser, fit_view(shown.scene.bounds, CAMERA["image_width"] / CAMERA["image_height"], core=core))
        box = core + 0.5 * shown.scene.size * np.array([[-1.0], [1.0]])
        shown.scene.cameras.set_bounds(box, core)
        arrives(browser, fit_view(box, CAMERA["image_width"] / CAMERA["image_height"], core=core))
        (client,) = shown.server.get_clients().values()
        shown.scene.cameras.set_preset(client, "side")
        arrives(browser, fit_view(box, CAMERA["image_width"] / CAMERA["image_height"], VIEW_PRESETS["side"], core))
        of_viser: list[int] = []
        told = threading.Event()
        shown.server.get_event_loop().call_soon_threadsafe(lambda: (of_viser.append(threading.get_ident()), told.set()))
        assert told.wait(PATIENCE)
    assert len(threads) == 3 and {*threads} == {*of_viser}


def reports(browser: ClientConnection, view: View, **more: object) -> None:
    """A browser says that its camera is at a view."""
    send(browser, {**CAMERA, "position": view.position.tolist(), "look_at": view.look_at.tolist(), "fov": view.fov, **more})


def arrives(browser: ClientConnection, view: View) -> None:
    """Wait until a browser is told to bring its camera to a view."""
    told = [0.0, 0.0, 0.0]
    while not np.allclose(told, view.position, rtol=1e-6, atol=0.0):
        for message in messages(browser):
            if message["type"] == "SetCameraPositionMessage" and not message["initial"]:
                told = message["position"]


@pytest.mark.sample(5)
@pytest.mark.parametrize("name", SCENES)
def test_every_joint_has_its_mark_within_two_pixels_in_every_view(name):
    """Of the place where the joint is, at the front of one of the links that meet there."""
    run, shapes = ran(name), solids(name)
    meshes = {body.parent: body.mesh for body in solid_nodes(run, shapes)}
    places = {joint: run.motion.joint_position(joint) for joint in run.numbers.joints}
    parts = {joint.name: joint.links for joint in (*run.motion.mechanism.joints, *build_joints(run.motion.mechanism).joints)}
    views = [(preset, fit_view(arrows_box(name), FREE["1600x1000"], preset, shapes.bounds)) for preset in VIEW_PRESETS.values()]
    for node in joint_nodes(run, shapes):
        for k in (0, run.motion.frames // 3):
            at = places[node.owner[1]][k]
            here = [joint for joint, place in places.items() if np.abs(place[k] - at).max() < 1e-6 * shapes.size]
            links = {link for joint in here for link in parts[joint]}
            fronts = [front(meshes[link], run.motion.pose(link)[k], at, shapes.size) for link in links if link in meshes]
            joint = np.array([[*at, z] for z in fronts if np.isfinite(z)])
            for preset, view in views:
                wide = FREE["1600x1000"]
                (x, y), (mark_x, mark_y) = (projected(xyz, view, preset, wide) for xyz in (joint, node.places[k]))
                assert 0.5 * HIGH * np.hypot(wide * (x - mark_x), y - mark_y).min() < 2.0, (node.owner[1], preset.label)


def front(mesh: Mesh, pose: Real, at: Real, size: float) -> float:
    """The greatest height [m] of a link at a place of the plane or close to it, -inf where it has nothing."""
    x, y, angle = pose
    corners = mesh.vertices[mesh.faces].astype(float)
    best = -np.inf
    for spot in AROUND * size:
        z = corners[..., 0] + 1j * corners[..., 1] - (complex(*at) + spot - complex(x, y)) * np.exp(-1j * angle)
        areas = (np.roll(z, -1, axis=1).conj() * np.roll(z, -2, axis=1)).imag  # opposite each corner
        whole = areas.sum(axis=1)
        seen = whole != 0.0  # not from its edge
        weights = areas[seen] / whole[seen, None]
        inside = (weights >= -1e-9).all(axis=1)
        best = max(best, float((weights * corners[seen][..., 2]).sum(axis=1)[inside].max(initial=-np.inf)))
    return best
