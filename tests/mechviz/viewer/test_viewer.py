"""The viewer without a browser: what is drawn, the clock, the data of plots, the guards of the server."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import gc
import html
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
import viser
import websockets
from patience import PATIENCE

from mechcore.accuracy import Accuracy
from mechcore.errors import Fault, MechanismError
from mechcore.laws.timed import ConstantSpeed
from mechcore.spec.loads import Torque
from mechcore.spec.mechanism import Drive, Gear, Link, Mechanism, Revolute
from mechviz import scene
from mechviz.meshes.solids import build_solids
from mechviz.outputs.exports.tables import plot_file
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.build import build, view_model_of_run
from mechviz.outputs.viewer.panels.effects import plan_graph, plan_svg
from mechviz.outputs.viewer.panels.plots import peak_of
from mechviz.outputs.viewer.panels.timeline import Speeds
from mechviz.outputs.viewer.playback import Curves, padded_range, thinned
from mechviz.outputs.viewer.player import Player
from mechviz.outputs.viewer.server import ViewerError, finite
from mechviz.outputs.viewer.viser_adapter import uuid_of
from mechviz.outputs.viewer.world.arrows import ARC_FACES, arc_vertices, arrow_points, arrows_by_family
from mechviz.outputs.viewer.world.camera import FIELD_OF_VIEW, USUAL_ASPECT, VIEW_PRESETS, fit_view, grid_cell
from mechviz.outputs.viewer.world.constructions import arrow_lines, placed
from mechviz.outputs.viewer.world.marks import hover_values, joint_groups
from mechviz.outputs.viewer.world.solids import link_path, quaternions
from mechviz.picture import overlays
from mechviz.picture.build import solids_of
from mechviz.picture.constructions import drawings_of
from mechviz.picture.overlays import section_nodes
from mechviz.quantities import vectors
from mechviz.runs import Run, run_scene
from mechviz.scene.units import MILLIMETRES, Units
from recordings import vectors_of


@pytest.fixture(scope="module")
def four_bar() -> Run:
    return run_scene(scene.load("kinetostatic-four-bar"))


@pytest.fixture(scope="module")
def compressor() -> Run:
    return run_scene(scene.load("slider-crank-compressor"))


@pytest.fixture(scope="module")
def kinematic() -> Run:
    return run_scene(scene.load("jansen-leg"))


# -- what is drawn ----------------------------------------------------------------------------------------------------
def test_peaks_of_curves_that_go_as_far_up_as_down_are_compared_on_one_side():
    up, down = np.array([-1.0, 1.001]), np.array([-1.2, 1.199])
    assert peak_of(down) == -1.2 and peak_of(up) == 1.001
    assert peak_of(up, peak_of(down)) == -1.0
    assert peak_of(np.array([-0.5, 1.0]), like=-1.0) == 1.0 and np.isnan(peak_of(np.array([np.nan])))


def test_families_follow_what_the_scene_asks_for(four_bar, kinematic):
    assert set(vectors_of(kinematic)[0]) == {"velocity", "acceleration"}
    assert vectors_of(kinematic)[1] == {}
    assert set(vectors_of(four_bar)[0]) == {"reaction", "applied", "inertia", "velocity", "acceleration"}
    assert set(vectors_of(four_bar)[1]["drive"]) == {"A"}


def test_vectors_are_those_of_the_core(compressor):
    computed = vectors_of(compressor)[0]
    forces, motion = compressor.forces, compressor.motion
    assert forces is not None
    np.testing.assert_array_equal(computed["reaction"]["B"].value, forces.reaction("B")[:, :2])
    np.testing.assert_array_equal(computed["reaction"]["B"].origin, motion.joint_position("B"))
    np.testing.assert_array_equal(computed["applied"]["gas"].value, forces.loads["gas"].values[:, :2])
    rod = vectors.centre_name("rod")
    np.testing.assert_array_equal(computed["acceleration"][rod].value, motion.centre_of_mass("rod", 2))


def test_an_inertia_resultant_on_its_line_of_action_has_the_inertia_moment(four_bar):
    resultant = vectors_of(four_bar)[0]["inertia"]["coupler"]
    arm = resultant.origin - four_bar.motion.centre_of_mass("coupler")
    moment = arm[:, 0] * resultant.value[:, 1] - arm[:, 1] * resultant.value[:, 0]
    expected = four_bar.forces.inertia("coupler")[:, 2]
    np.testing.assert_allclose(moment, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_the_largest_force_is_a_third_of_the_size_and_all_forces_share_the_scale(four_bar):
    computed, moments = vectors_of(four_bar)[:2]
    scales = vectors.find_scales(computed, moments, size=0.6)
    forces = [v for f in vectors.FORCE_FAMILIES for v in computed.get(f, {}).values()]
    assert max(v.magnitude.max() for v in forces) / scales.newtons_per_metre == pytest.approx(0.2)
    assert scales.per_metre("reaction") == scales.per_metre("inertia") == scales.newtons_per_metre
    speeds = [v.magnitude.max() for v in computed["velocity"].values()]
    assert max(speeds) / scales.per_metre("velocity") == pytest.approx(0.2)


def test_scales_do_without_forces_and_with_infinite_ones():
    endless = vectors.Vector("reaction", "A", np.zeros((2, 2)), np.array([[3.0, 4.0], [np.inf, 0.0]]))
    assert vectors.find_scales({}, {}, 1.0).newtons_per_metre == 1.0
    assert vectors.find_scales({"reaction": {"A": endless}}, {}, 3.0).newtons_per_metre == pytest.approx(5.0)


def test_arrows_that_viser_would_draw_wrongly_are_left_out():
    origins = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    arrows = np.array([[0.5, 0.0], [0.001, 0.0], [np.nan, 0.0], [0.0, -0.2]])
    points = arrow_points(origins, arrows, z=0.1, least=0.05)
    assert points.shape == (2, 2, 3)
    np.testing.assert_allclose(points[1], [[3.0, 3.0, 0.1], [3.0, 2.8, 0.1]], rtol=1e-6)


@pytest.mark.parametrize("turn", [2.0, -3.0, 0.5])
def test_an_arc_ends_where_the_moment_points(turn):
    corners = arc_vertices(np.array([1.0, 2.0]), turn, radius=0.1, width=0.01, z=0.3)
    assert ARC_FACES.max() == len(corners) - 1
    np.testing.assert_allclose(corners[-1], [1.0 + 0.1 * np.cos(turn), 2.0 + 0.1 * np.sin(turn), 0.3], rtol=1e-6)
    away = np.hypot(corners[:, 0] - 1.0, corners[:, 1] - 2.0)
    assert away.min() > 0.08 and away.max() < 0.12


def test_the_camera_sees_the_whole_box():
    bounds = np.array([[-0.1, 0.3, -0.02], [0.5, 0.5, 0.04]])
    for aspect in (0.3, 0.9, 2.5):
        view = fit_view(bounds, aspect)
        half = view.distance * np.tan(FIELD_OF_VIEW / 2.0)
        y = (bounds[:, 1] - view.look_at[1]) / half  # -1 ... 1 over the picture's height
        x = (bounds[:, 0] - view.look_at[0]) / (half * aspect)
        assert np.all(np.abs(x) < 1.0)
        assert np.all(np.abs(y) < 1.0)
        assert view.position[:2] == pytest.approx(view.look_at[:2])


@pytest.mark.parametrize("preset", VIEW_PRESETS.values(), ids=VIEW_PRESETS)
def test_arrows_leave_the_mechanism_large(preset):
    """However far they reach, all of the mechanism is seen, and it takes two thirds of the height or the width."""
    core, wide = np.array([[0.0, 0.0, 0.0], [1.0, 0.6, 0.1]]), np.array([[-2.0, -0.3, 0.0], [1.1, 4.0, 0.1]])
    for aspect in (0.5, 1.0, 2.0):
        view = fit_view(wide, aspect, preset, core)
        away = (view.position - view.look_at) / view.distance
        right = np.cross([0.0, 1.0, 0.0], away)
        right /= np.linalg.norm(right)
        corners = np.array(np.meshgrid(*core.T)).reshape(3, -1).T - view.look_at
        depth = (view.distance - corners @ away) * np.tan(0.5 * preset.fov)
        x, y = corners @ right / depth / aspect, corners @ np.cross(away, right) / depth
        assert max(np.abs(x).max(), np.abs(y).max()) < 1.0
        assert max(np.ptp(x), np.ptp(y)) > 2.0 * 2.0 / 3.0
    inside = fit_view(core, 1.0, preset, core)
    assert inside.distance == pytest.approx(fit_view(core, 1.0, preset).distance)


def test_the_view_takes_in_the_arrows_that_are_shown_first_and_no_empty_room(four_bar, kinematic):
    for run, wider in ((kinematic, False), (four_bar, True)):
        with Viewer(run, port=0) as shown:
            poses = {link.name: run.motion.pose(link.name) for link in run.motion.mechanism.links}
            solids = build_solids(run.motion.mechanism, poses)
            plain = fit_view(solids.bounds, USUAL_ASPECT)
            distance = shown.server.initial_camera.position[2] - solids.bounds[1, 2]
            assert (distance > plain.distance * 1.001) == wider
            assert distance < plain.distance * 2.0


@pytest.fixture(scope="module")
def constructed() -> Run:
    document = scene.load("plans-four-bar").document.model_dump(exclude_defaults=True)
    more = {"centrodes": ["coupler"], "shaking": {}, "systems": {"loads": {"on": "rocker"}}}
    return run_scene(scene.Scene.build(name="all", **{**document, **more}), frames=24)


def test_arrows_of_plans_are_lines_to_scale_with_heads_at_their_ends():
    start, vector = np.array([1 + 1j, 0j, 2j]), np.array([2 + 0j, 1j * np.nan, 1 + 1j])
    lines = arrow_lines(start, vector, np.array([True, True, False]), 0.1)
    assert lines.shape == (9, 2)
    assert lines[0, 1] - lines[0, 0] == 2.0
    assert lines[1, 0] == lines[1, 1]  # what is not finite is not drawn
    assert np.abs(lines[3] - [3 + 1j, 3 + 1j - 0.1 * np.exp(0.36j)]).max() < 1e-12
    assert lines[5, 0] == lines[5, 1] == 1 + 3j  # no head


def test_drawings_stand_beside_the_mechanism_and_not_over_each_other():
    mechanism = np.array([[0.0, 0.0], [1.0, 0.8]])
    boxes = [np.array([[-0.3, 2.0], [0.5, 2.6]]), np.array([[5.0, 5.0], [6.0, 6.2]]), np.array([[0.0, 0.0], [0.1, 0.1]])]
    moved = [mechanism, *(b + np.array([z.real, z.imag]) for b, z in zip(boxes, placed(mechanism, boxes, 0.1, 0.05), strict=True))]
    for k, a in enumerate(moved):
        for b in moved[:k]:
            assert (a[0] >= b[1]).any() or (b[0] >= a[1]).any()


def test_every_construction_is_drawn_beside_or_on_the_mechanism_and_has_a_switch(constructed):
    with Viewer(constructed, port=0) as viewer:
        names = [
            "Velocity polygon",
            "Acceleration polygon",
            "Force polygon",
            "Force polygon with pole and rays",
            "Shaking force, polar",
        ]
        assert set(viewer.scene.polygons.constructions) == {*names, "Funicular polygon", "Centrodes"}
        assert set(viewer.scene.polygons.constructions) < set(viewer.switches.marks)
        for frame in (0, 13):
            viewer.set_frame(frame)
            for name, d in drawings_of(constructed, viewer.scene.size).items():
                lines = viewer.scene.polygons.constructions[d.title.split(":")[0]].nodes[0].points
                drawn = lines[: len(d.arrows), 1] - lines[: len(d.arrows), 0]
                wanted = np.array([i.vector[frame] for i in d.arrows])
                assert np.abs(drawn[:, 0] + 1j * drawn[:, 1] - wanted).max() <= 1e-5 * viewer.scene.size, name
        assert (viewer.scene.bounds[0, :2] <= viewer.scene.polygons.bounds[0]).all()
        assert (viewer.scene.bounds[1, :2] >= viewer.scene.polygons.bounds[1]).all()
        viewer.scene.switch_mark("Velocity polygon", False)
        nodes = viewer.scene.polygons.constructions["Velocity polygon"].nodes
        viewer.set_frame(5)
        assert not any(node.visible for node in nodes)
        viewer.scene.switch_mark("Velocity polygon", True)
        viewer.set_frame(6)
        assert nodes[0].visible


@pytest.mark.sample(2)
@pytest.mark.parametrize("screen", [(422, 562), (602, 616), (930, 920), (390, 388), (764, 294)])
def test_headings_of_drawings_have_room_in_every_window(constructed, screen):
    """Letters are as large in every window: no title, scale or legend over another one, and none beyond the picture."""
    with Viewer(constructed, port=0) as viewer:
        viewer.scene.fit(0, screen)
        drawn = [n for c in viewer.scene.polygons.constructions.values() for n in c.nodes if isinstance(n, viser.LabelHandle)]
        heads = [node for node in drawn if node.name.split("/")[-1].startswith(("caption", "scale", "legend"))]
        assert len(heads) >= 9 and (min(screen) < 400) != any("legend" in node.name for node in heads)
        view = fit_view(viewer.scene.bounds, screen[0] / screen[1], core=viewer.scene.bounds)
        per_pixel = view.height / screen[1]
        wide = np.array([6.4 * node.font_screen_scale * len(node.text) for node in heads])
        anchors = np.array([0.5 * w if node.anchor == "center-left" else 0.0 for node, w in zip(heads, wide, strict=True)])
        x, y = (np.array([node.position[k] - view.look_at[k] for node in heads]) / per_pixel for k in (0, 1))
        x += anchors
        assert (np.abs(x) + 0.5 * wide < 0.5 * screen[0] + 20.0).all() and (np.abs(y) + 6.0 < 0.5 * screen[1]).all()
        apart = np.abs(x[:, None] - x) - 0.5 * (wide[:, None] + wide), np.abs(y[:, None] - y) - 14.0
        over = np.argwhere((np.maximum(*apart) <= 0.0) & ~np.eye(len(heads), dtype=bool))
        assert not len(over), [(heads[j].text, heads[k].text) for j, k in over]


def test_of_section_forces_the_bending_moments_are_shown_at_first():
    run = run_scene(scene.load("connecting-rod-bending"), frames=24)
    with Viewer(run, port=0) as viewer:
        constructions = viewer.scene.polygons.constructions
        for name, on in (("Bending moments", True), ("Shear forces", False), ("Normal forces", False)):
            assert viewer.switches.marks[name].value == on
            assert all(node.visible == on for node in constructions[name].nodes)
        viewer.scene.switch_mark("Shear forces", True)
        viewer.set_frame(5)
        outline = run.studies.sections["rod"]
        lines = constructions["Shear forces"].nodes[0].points
        assert lines[0, 0, :2] == pytest.approx(run.motion.point("rod", "B")[5], abs=1e-6)
        assert len(lines) > outline.stations.shape[1]


def test_section_forces_next_to_nothing_are_drawn_like_others(monkeypatch):
    run = run_scene(scene.load("connecting-rod-bending"), frames=12)
    solids = solids_of(run)
    lines = next(node for node in section_nodes(run, solids) if node.group == "bending_moment").strips[0]
    diagram = overlays.SECTION_DIAGRAMS["bending_moment"]
    faint = diagram._replace(ordinates=lambda s: 1e-315 * diagram.ordinates(s))
    monkeypatch.setitem(overlays.SECTION_DIAGRAMS, "bending_moment", faint)
    again = next(node for node in section_nodes(run, solids) if node.group == "bending_moment").strips[0]
    np.testing.assert_allclose(again, lines, rtol=1e-5, atol=1e-6)


def test_a_scene_without_constructions_has_none_in_the_viewer(kinematic):
    with Viewer(kinematic, port=0) as viewer:
        assert len(viewer.scene.polygons) == 0
        assert not {"Velocity polygon", "Centrodes"} & set(viewer.switches.marks)


def test_grid_cells_are_round():
    assert [grid_cell(s, MILLIMETRES) for s in (0.26, 1.0, 4.2, 0.0079)] == pytest.approx([0.02, 0.1, 0.2, 0.0005])
    assert grid_cell(0.26, Units(length="in")) == pytest.approx(0.0254)


def test_quaternions_turn_about_z():
    angle = np.array([0.0, 1.0, -4.0])
    w, x, y, z = quaternions(angle).T
    np.testing.assert_allclose(np.exp(1j * angle), (w + 1j * z) ** 2, atol=1e-15)
    assert not x.any() and not y.any()


def test_joints_at_one_place_share_a_label(kinematic):
    joints = {joint.name: kinematic.motion.joint_position(joint.name) for joint in kinematic.motion.mechanism.joints}
    groups = [names for names, _ in joint_groups(joints, 1e-9)]
    assert ["B", "B2"] in groups and ["C", "C2"] in groups
    assert sum(map(len, groups)) == len(kinematic.motion.mechanism.joints)


# -- plots ------------------------------------------------------------------------------------------------------------
def test_every_quantity_has_a_value_in_every_frame_and_a_unique_title(compressor):
    quantities = compressor.catalogue.quantities
    assert len({q.title for q in quantities}) == len(quantities)
    for q in quantities:
        assert q.values().shape == (compressor.motion.frames, len(q.curves)), q.title


def test_plots_start_with_the_driving_torque_and_the_motion_of_the_output(compressor, kinematic):
    assert [q.label for q in compressor.catalogue.initial_quantities[:3]] == [
        "drive A: torque",
        "joint S: displacement",
        "joint S: velocity",
    ]
    torque = compressor.catalogue.initial_quantities[:1][0].values()
    np.testing.assert_array_equal(torque[:, 0], compressor.forces.effort("A"))
    assert [q.label for q in kinematic.catalogue.initial_quantities[:2]] == ["point foot.H: position", "point foot.H: velocity"]
    crank_rocker = run_scene(scene.load("crank-rocker"))
    assert [q.label for q in crank_rocker.catalogue.initial_quantities[:2]] == [
        "link rocker: angle",
        "link rocker: angular velocity",
    ]


def test_every_quantity_can_be_plotted_however_many_curves_it_has(viewer):
    slot = viewer.plots.slots[0]
    before, quantities = slot.quantity.title, viewer.inspector.view_model.quantities
    assert max(len(q.curves) for q in quantities) > 3
    for q in {(len(q.curves), q.unit if q.unit in ("1", "°") else ""): q for q in quantities}.values():
        viewer.plots.choose(slot, q.title)
        assert " 1<" not in slot._readout.content and " °<" not in slot._readout.content
        letters = max(len(f"{end:,.0f}") for end in slot.chart.scales["y"]["range"])
        assert min(17 + 6 * letters, 96) <= slot.chart.axes[1]["size"] <= 96, "numbers do not reach into the title"
        assert len(slot.chart.series) == len(slot.chart.data) == len(q.curves) + 2
        assert all(name in slot._readout.content for name in map(html.escape, q.curves))
    viewer.plots.choose(slot, before)


def test_a_link_that_is_looked_at_is_marked_and_its_neighbours_stay(viewer):
    links, scene = viewer.scene.links, viewer.server.scene
    part = {name: scene.get_handle_by_name(f"{link_path(name)}/part_0") for name in ("crank", "rocker")}
    before = {name: (tuple(mesh.color), mesh.opacity) for name, mesh in part.items()}
    links.pick("crank")
    assert tuple(part["crank"].color) != before["crank"][0] and part["crank"].opacity is None
    assert (tuple(part["rocker"].color), part["rocker"].opacity) == before["rocker"]
    links.pick("")
    assert {name: (tuple(mesh.color), mesh.opacity) for name, mesh in part.items()} == before


def test_paths_arrows_and_constructions_are_read_on_a_dark_page(constructed):
    """Each is as far from the ground, by the light that its colour gives, on a dark page as on a light one."""
    with Viewer(constructed, port=0) as shown:
        plans = shown.scene.polygons.constructions
        lines = [shown.server.scene.get_handle_by_name(name) for name in ("/paths/coupler.P", "/vectors/reaction")]
        lines += [plans["Velocity polygon"].nodes[0], plans["Centrodes"].nodes[0], plans["Funicular polygon"].nodes[0]]
        before = [np.array(line.colors, float) for line in lines]
        shown.scene.darken(True)
        for line, light in zip(lines, before, strict=True):
            assert np.array(line.colors, float).mean() > light.mean() + 15.0, line.name
        shown.scene.polygons.update(shown.scene.current)
        again = shown.scene.polygons.constructions["Velocity polygon"].nodes[0]
        np.testing.assert_array_equal(again.colors, lines[2].colors)  # what is drawn later is dark, too
        shown.scene.darken(False)
        for line, light in zip([*lines[:2], again], before, strict=False):
            np.testing.assert_array_equal(np.array(line.colors, float), light)


def test_comparing_draws_the_curves_of_both_designs_and_says_how_far_their_peaks_differ(viewer, four_bar):
    """The other design has no load, and other frames."""
    plots, slot = viewer.plots, viewer.plots.slots[0]
    document = scene.load("kinetostatic-four-bar").document.model_dump(exclude_defaults=True)
    other_run = run_scene(scene.Scene.build(name="bare", **{**document, "loads": {}}), frames=90)
    plots.compare({"as opened": view_model_of_run(other_run, build(other_run))})
    torque = next(q for q in viewer.inspector.view_model.quantities if q.key == "drive.A.torque")
    plots.choose(slot, torque.title)
    assert len(slot.chart.series) == len(slot.chart.data) == 2 * len(torque.curves) + 2
    x, now, other, _ = slot.chart.data
    k = np.searchsorted(x, 123.0)
    places, values = viewer.inspector.view_model.axes[0].values, other_run.forces.effort("A")
    other_places = np.degrees(other_run.motion.coordinate("A")[:, 0])
    assert now[k] == pytest.approx(np.interp(x[k], places, torque.values()[:, 0]), rel=1e-9)
    assert other[k] == pytest.approx(np.interp(x[k], other_places, values), rel=1e-6)
    peaks = [v[np.argmax(np.abs(v))] for v in (torque.values()[:, 0], values)]
    for part in (*map(words.format_number, peaks), f"{abs(abs(peaks[0] / peaks[1]) - 1.0):.1%}".replace("%", " %")):
        assert part in slot._readout.content
    header, *rows = [line.split(",") for line in plots.file(slot, "CSV").decode().splitlines()]
    assert header[-1] == f"{torque.curves[0]} as opened [{torque.unit}]" and len(rows[0]) == 3
    table = np.array(rows[1:-1], float)  # the other design has fewer frames
    np.testing.assert_allclose(table[:, 2], np.interp(table[:, 0], other_places, values), rtol=1e-6, atol=1e-6)
    assert b"as opened" in plots.file(slot, "SVG") and plots.file(slot, "PNG").startswith(b"\x89PNG")
    plots.compare({})
    assert len(slot.chart.series) == len(torque.curves) + 2 and "opened" not in slot._readout.content


def test_a_plot_is_saved_beside_the_thread_that_all_browsers_wait_for(viewer, monkeypatch):
    """However often its button is pressed: a few presses wait, the others are left."""
    plots, slot = viewer.plots, viewer.plots.slots[0]
    go, sent = threading.Event(), []

    class Client:
        client_id = 7

        def send_file_download(self, name, content, save_immediately):
            sent.append((name.rpartition(".")[2], content))

    def drawn(slot, kind):
        assert go.wait(PATIENCE)
        return b"drawn"

    monkeypatch.setattr(viewer.server, "get_clients", lambda: {Client.client_id: None})
    with monkeypatch.context() as patch:
        patch.setattr(plots, "file", drawn)
        for _ in range(50):
            plots._press(slot, "PNG", Client())
        assert not sent, "the press waits for nothing"
        go.set()
        plots._saver.submit(lambda: None).result(60.0)
    assert sent == [("png", b"drawn")] * 4
    plots._press(slot, "CSV", Client())
    plots._saver.submit(lambda: None).result(60.0)
    assert sent[-1] == ("csv", plots.file(slot, "CSV"))


def test_designs_are_compared_from_the_start_and_curves_have_the_bands_of_their_tolerances():
    """The ram of the press by its closed form, also after an edit; the bands are wider where that is asked for."""
    press = run_scene(scene.load("parametric-press"), frames=24)
    longer = run_scene(scene.load("parametric-press").with_parameters({"stroke": "110 mm"}), frames=24)

    def half(run, throw):
        q, rod = run.catalogue.coordinate("A"), 4.0 * throw
        root = np.sqrt(rod**2 - (throw * np.sin(q)) ** 2)
        return 0.05 * np.abs(np.cos(q) + (4.0 * rod - throw * np.sin(q) ** 2) / root)

    with Viewer(press, port=0, compared={"longer": longer}) as shown:
        plots, slot = shown.plots, shown.plots.slots[0]
        plots.choose(slot, "joint S: displacement [mm]")
        x, now, other, high, low, _ = slot.chart.data
        frame = np.searchsorted(x, shown.inspector.view_model.axes[0].values)
        np.testing.assert_allclose(other[frame], 1.375 * now[frame], rtol=1e-12)
        np.testing.assert_allclose(high[frame] - now[frame], half(press, 40.0), rtol=1e-9)
        np.testing.assert_allclose(low + high, 2.0 * now, rtol=1e-12)
        assert slot.chart.bands[0]["series"] == (3, 4) and "tolerances: ± 0.25 mm" in slot._readout.content
        assert shown.scene.ghosts["longer"].on and not shown.scene.ghosts["as opened"].on
        stroke = next(p for p in shown.session.parameters if p.path[:2] == ("parameters", "stroke"))
        shown.session.set_value(stroke, 110.0)
        assert shown.session.wait(until_idle=True)
        _, now, other, high, _, _ = slot.chart.data
        np.testing.assert_allclose(now[frame], other[frame], rtol=1e-12)
        np.testing.assert_allclose(high[frame] - now[frame], half(longer, 55.0), rtol=1e-9)
        plots.enlarge("10 times")
        np.testing.assert_allclose(slot.chart.data[3][frame] - now[frame], 10.0 * half(longer, 55.0), rtol=1e-9)
        rows = plots.file(slot, "CSV").decode().splitlines()
        assert rows[0].endswith("displacement longer [mm],displacement tolerance ± [mm]")
        assert float(rows[1].split(",")[3]) == pytest.approx(half(longer, 55.0)[0])
        assert b"fill-opacity" in plots.file(slot, "SVG") or b"opacity: 0.22" in plots.file(slot, "SVG")
        shown.session.set_value(stroke, 100.0)  # where another dimension of the scene has a kink
        assert shown.session.wait(until_idle=True)
        assert "does not change smoothly with stroke" in plots._refused.content and len(slot.chart.data) == 4


def test_transmission_angles_and_section_forces_can_be_asked_for_and_plotted(four_bar):
    """By a switch: the quantity is offered then, is that of the metrics, and goes with the switch."""
    with Viewer(four_bar, port=0) as shown:
        for on in (True, False):
            shown.session.change("metrics", lambda draft, on=on: draft.with_named("metrics", "transmission_angle", on))
            assert shown.session.wait(until_idle=True)
            until(lambda on=on: shown.inspector.diagrams.asked["metrics", "transmission_angle"].value is on)
            offered = {q.key: q for q in shown.inspector.view_model.quantities}
            assert ("transmission_angle.D.angle" in offered) is on
            if on:
                computed = offered["transmission_angle.D.angle"]
                rocker, coupler = (four_bar.motion.pose(link)[:, 2] for link in ("rocker", "coupler"))
                between = np.degrees(np.abs(np.angle(np.exp(1j * (rocker - coupler)))))
                np.testing.assert_allclose(computed.values()[:, 0], np.minimum(between, 180.0 - between), atol=1e-9)
                shown.plots.choose(shown.plots.slots[0], computed.title)
                assert shown.plots.slots[0].quantity.title == computed.title
        shown.session.change("sections", lambda draft: draft.with_named("sections", "coupler", True))
        assert shown.session.wait(until_idle=True)
        until(lambda: shown.inspector.diagrams.asked["sections", "coupler"].value)
        offered = {q.key: q for q in shown.inspector.view_model.quantities}
        bending = offered["link.coupler.bending_moment"]
        shown.plots.choose(shown.plots.slots[0], bending.title)
        assert shown.plots.slots[0].quantity.title == bending.title and np.abs(bending.values()).max() > 0.0


def test_plots_are_added_joined_saved_and_removed(viewer):
    plots, known = viewer.plots, {q.key: q for q in viewer.inspector.view_model.quantities}
    count = len(plots.slots)
    plots.add()
    slot = plots.slots[-1]
    assert len(plots.slots) == count + 1 and slot.quantity.title not in {s.quantity.title for s in plots.slots[:-1]}
    first, second, other = known["joint.A.reaction"], known["joint.B.reaction"], known["drive.A.torque"]
    plots.choose(slot, first.title)
    plots.join(slot, second.title)
    assert slot.quantity.curves[:2] == ("joint A: Fx", "joint A: Fy") and slot.quantity.curves[3] == "joint B: Fx"
    np.testing.assert_array_equal(slot.quantity.values(), np.column_stack([first.values(), second.values()]))
    assert len(slot.chart.series) == 6 + 2 and slot.choice.value == first.title and second.title in slot.additions.options
    plots.join(slot, other.title)  # of another unit
    assert [q.key for q in slot.quantity.parts] == ["joint.A.reaction", "joint.B.reaction"]
    assert other.title not in slot.additions.options
    axis = viewer.inspector.view_model.axes[0]
    rows = plot_file("CSV", "a", slot.quantity, axis).decode().splitlines()
    assert rows[0].split(",")[:2] == [axis.title, "joint A: Fx [N]"] and len(rows) == 1 + len(axis.values)
    np.testing.assert_array_equal([float(x) for x in rows[8].split(",")], [axis.values[7], *slot.quantity.values()[7]])
    assert b"joint B: Fx" in plot_file("SVG", "a", slot.quantity, axis)
    assert plot_file("PNG", "a", slot.quantity, axis).startswith(b"\x89PNG")
    gc.collect()
    gc.disable()  # most of what a saved plot was drawn with goes by itself, however many are saved before the next collection
    try:
        plot_file("PNG", "a", slot.quantity, axis)
        assert sum(type(o).__name__ == "Line2D" for o in gc.get_objects()) < 40  # of 75
    finally:
        gc.enable()
    plots.join(slot, second.title)  # once more: taken away
    assert [q.key for q in slot.quantity.parts] == ["joint.A.reaction"]
    plots.remove(slot)
    assert len(plots.slots) == count
    for kept in list(plots.slots):
        plots.remove(kept)
    plots.show(3, playing=False)
    plots.open(first.title)
    assert [s.quantity.title for s in plots.slots] == [first.title]
    for quantity in viewer.inspector.view_model.first:
        plots.add(quantity)
    plots.remove(plots.slots[0])


def test_gears_have_quantities_and_reactions_where_they_mesh():
    frame = Link(name="frame", points={"A": (0.0, 0.0), "B": (0.12, 0.0)})
    wheels = [Link(name=n, points={"c": (0.0, 0.0)}, mass=1.0, inertia=0.01) for n in ("pinion", "gear")]
    pins = [Revolute(name=p, links=("frame", n), points=(p, "c")) for p, n in zip("AB", ("pinion", "gear"), strict=True)]
    mechanism = Mechanism(
        name="gears",
        frame="frame",
        links=(frame, *wheels),
        joints=(*pins, Gear(name="G", links=("pinion", "gear"), carrier="frame", sizes=(20, 40))),
        drives=(Drive(joint="A", law=ConstantSpeed(0.0, 5.0)),),
        loads=(Torque(name="load", link="gear", moment=-3.0),),
    )
    said = SimpleNamespace(run=SimpleNamespace(model_fields_set={"frames"}))
    run = run_scene(
        SimpleNamespace(
            mechanism=mechanism, frames=20, cycles=1, simulation=None, accuracy=Accuracy(), document=said, units=MILLIMETRES
        )
    )
    for q in run.catalogue.quantities:
        assert q.values().shape == (21, len(q.curves)), q.title
    mesh = vectors_of(run)[0]["reaction"]["G"]
    np.testing.assert_allclose(mesh.origin, np.broadcast_to([0.04, 0.0], (21, 2)), atol=1e-12)
    assert set(vectors_of(run)[1]) == {"drive", "applied"}


def test_only_a_drive_that_runs_one_way_can_be_plotted_against(compressor):
    assert [a.label for a in compressor.catalogue.axes] == ["angle of drive A", "time"]
    assert [a.label for a in run_scene(scene.load("elliptic-trammel")).catalogue.axes] == ["time"]


def test_a_cursor_is_a_vertical_line_through_the_curves_at_its_frame():
    x, y = np.linspace(0.0, 10.0, 11), np.linspace(0.0, 1.0, 11)[:, None] ** 2
    curves = Curves(x, y)
    shown_x, shown_y, cursor = curves.at(7)
    here = np.isfinite(cursor)
    assert here.sum() == 2 and len(shown_x) == 13
    np.testing.assert_array_equal(shown_x[here], [7.0, 7.0])
    np.testing.assert_array_equal(cursor[here], curves.range)
    np.testing.assert_allclose(shown_y[here], 0.49)
    assert np.all(np.diff(shown_x) >= 0.0)


def test_plots_against_a_falling_axis_rise():
    x, y = np.linspace(0.0, -6.0, 50), np.arange(50.0)[:, None]
    shown_x, shown_y, cursor = Curves(x, y).at(3)
    assert np.all(np.diff(shown_x) >= 0.0) and np.all(np.diff(shown_y) <= 0.0)
    assert shown_x[np.isfinite(cursor)] == pytest.approx([x[3], x[3]])


def test_long_curves_are_thinned_without_losing_peaks():
    y = np.sin(np.linspace(0.0, 40.0, 50_000))[:, None]
    y[31_234] = 7.0
    kept = thinned(y)
    assert len(kept) < 2500 and {0, 31_234, 49_999} <= set(kept.tolist())


def test_ranges_have_room_also_around_constants_and_nothing():
    assert padded_range(np.array([0.0, 10.0, np.inf, np.nan])) == pytest.approx((-0.6, 10.6))
    low, high = padded_range(np.full(5, 3.0))
    assert low < 3.0 < high
    low, high = padded_range(np.full(5, np.nan))
    assert low < high


# -- words ------------------------------------------------------------------------------------------------------------
def test_texts_of_a_scene_cannot_become_markup():
    text = words.heading(title="<img src=x onerror=alert(1)>", learning_goal="a < b & <b>c</b>")
    assert "<img" not in text and "&lt;img" in text and "a &lt; b &amp; &lt;b&gt;" in text


def test_the_legend_states_round_scales(four_bar):
    scales = vectors_of(four_bar, 0.4)[2]
    text = words.legend(["reaction"], ["P"], scales, factor=2.0, size=0.4, units=MILLIMETRES)
    assert "Reactions" in text and "Path" in text and "Velocity" not in text
    newtons, metres = 50.0, 50.0 / (scales.newtons_per_metre / 2.0)
    assert f"Scale: 50 N = {words.format_number(round(metres * 1e3, 1))} mm" in text and newtons == 50.0


def test_the_plan_says_what_was_left_out_and_why(kinematic):
    text = words.plan_list(kinematic)
    assert "positions" in text and "reactions and drive efforts" in text and "pure kinematics" in text


def test_the_plan_as_a_diagram_has_an_arrow_for_what_is_needed_and_none_for_what_is_left_out(kinematic):
    rough = run_scene(scene.load("slider-crank-friction"), frames=24)
    graph = plan_graph(rough.motion.mechanism, rough.plan)
    arrows = set(graph.arrows)
    assert {("effect inertia", "accelerations"), ("effect gravity", "positions"), ("effect friction", "velocities")} <= arrows
    assert ("effect friction", "reactions and drive efforts") in arrows, "found together with the reactions"
    assert ("accelerations", "reactions and drive efforts") in arrows and all(box.on for box in graph.boxes)
    graph = plan_graph(kinematic.motion.mechanism, kinematic.plan)
    off = {box.name for box in graph.boxes if not box.on}
    assert {"effect inertia", "effect gravity", "effect friction", "reactions and drive efforts"} <= off
    assert not any(off & set(arrow) for arrow in graph.arrows)
    picture = plan_svg(kinematic.motion.mechanism, kinematic.plan)
    assert picture.count('data-on="0"') == len(off) and "pure kinematics" in picture


# -- values from browsers ---------------------------------------------------------------------------------------------
def test_numbers_from_browsers_are_brought_into_range():
    assert finite(9999.0, 0, 360, 5) == 360 and finite(-3, 0, 360, 5) == 0
    assert finite(float("nan"), 0, 360, 5) == 5 and finite("x", 0, 360, 5) == 5 and finite(None, 0, 1, 0.5) == 0.5


def test_speeds_are_wall_time_of_a_cycle():
    speeds = Speeds(cycle=0.1)
    assert speeds.rate("4 s a cycle (0.025×)") == pytest.approx(0.025)
    assert speeds.rate("real time") == 1.0 and speeds.rate("nonsense") == speeds.rate(speeds.first)


# -- the clock --------------------------------------------------------------------------------------------------------
class Screen:
    """Remembers the frames that a player shows."""

    def __init__(self) -> None:
        self.frames: list[int] = []
        self.errors: list[Exception] = []
        self.broken = False

    def show(self, frame: int, playing: bool) -> None:
        if self.broken:
            raise RuntimeError("broken")
        self.frames.append(frame)


def until(condition) -> None:
    """Wait for a condition, generously: what counts is that it comes."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.fixture
def screen():
    return Screen()


@pytest.fixture
def player(screen):
    clock = Player(np.linspace(0.0, 1.0, 101), screen.show, screen.errors.append)
    clock.start()
    assert clock.wait()
    yield clock
    clock.close()


def test_seeking_shows_exactly_that_frame_and_stays_in_range(player, screen):
    for asked, shown in ((40, 40), (-5, 0), (1000, 100)):
        player.seek(asked)
        assert player.wait() and screen.frames[-1] == shown == player.frame


def test_scrubbing_takes_over_from_playing(player):
    player.play()
    player.seek(60)
    assert not player.playing
    player.play()
    player.step(1)
    assert not player.playing


def test_steps_go_over_the_ends_of_a_loop_and_stop_at_them_without(player):
    player.seek(0)
    player.step(-1)
    assert player.frame == 99  # frame 100 is frame 0 of the next cycle
    player.step(2)
    assert player.frame == 1
    player.set_loop(False)
    player.step(-5)
    assert player.frame == 0


def test_playing_follows_the_clock_and_pausing_stops_it(player, screen):
    """Measured against the clock itself: however late the player's thread gets its turn, it is never ahead and catches up."""
    player.set_rate(0.5)
    player.set_loop(False)
    started = time.perf_counter()
    player.play()
    until(lambda: player.frame >= 30)
    latest = 0.5 * (time.perf_counter() - started)  # [s] of the run
    player.pause()
    assert player.wait()
    assert latest >= 0.30 - 0.005, "frame 30 is 0.3 s into the run, which takes 0.6 s at half speed"
    shown = len(screen.frames)
    assert shown >= 1, "however late, it has been drawn"
    time.sleep(0.1)
    assert len(screen.frames) == shown, "nothing is drawn while paused"


def test_a_late_turn_of_the_clock_makes_up_for_the_time(screen):
    clock = Player(np.linspace(0.0, 1.0, 101), screen.show, screen.errors.append, rate=0.5)  # its thread is not started
    clock.play()
    for seconds, frame in ((0.2, 10), (0.6, 40), (1.0, 90), (0.4, 10)):  # the last one over the end of the loop
        clock._advance(seconds)
        assert clock.frame == frame


def test_playing_once_ends_at_the_last_frame(player):
    player.set_loop(False)
    player.set_rate(20.0)
    player.play()
    until(lambda: not player.playing)
    assert not player.playing and player.frame == 100


def test_a_failure_in_drawing_pauses_and_is_told_and_the_clock_lives(player, screen):
    screen.broken = True
    player.play()
    until(lambda: screen.errors)
    assert str(screen.errors[0]) == "broken" and not player.playing
    screen.broken = False
    player.seek(12)
    assert player.wait() and screen.frames[-1] == 12


def test_many_threads_may_ask_at_once(player):
    threads = [threading.Thread(target=lambda k=k: [player.seek(k), player.toggle(), player.step(1)]) for k in range(40)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    player.seek(50)
    assert player.wait() and player.frame == 50


# -- the server -------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def viewer(four_bar):
    with Viewer(four_bar, port=0) as shown:
        yield shown


def test_frames_bring_the_core_poses_to_the_scene(viewer):
    for frame in (0, 77, 360):
        viewer.set_frame(frame)
        for link in ("crank", "coupler", "rocker"):
            x, y, angle = viewer.run.motion.pose(link)[frame]
            node = viewer.server.scene.get_handle_by_name(link_path(link))
            np.testing.assert_allclose(node.position, [x, y, 0.0], atol=1e-12)
            np.testing.assert_allclose(node.wxyz, quaternions(np.array([angle]))[0], atol=1e-12)
        assert viewer.timeline.slider.value == frame


def test_arrows_are_those_of_the_frame_and_families_switch(viewer):
    viewer.set_frame(300)
    node = viewer.server.scene.get_handle_by_name("/vectors/reaction")
    assert node.visible
    force = viewer.run.forces.reaction("D")[300, :2] / viewer.scene.current.scales.newtons_per_metre
    at = viewer.run.motion.joint_position("D")[300]
    drawn = [p for p in node.points if np.allclose(p[0, :2], at, atol=1e-6)]
    assert len(drawn) == 1
    np.testing.assert_allclose(drawn[0][1, :2] - at, force, atol=1e-6)
    viewer.scene.arrows.switch("reaction", False)
    viewer.set_frame(301)
    assert not node.visible
    viewer.scene.arrows.switch("reaction", True)


def test_what_browsers_play_by_themselves_is_what_the_server_would_draw(viewer):
    tracks = viewer.inspector.tracks()
    assert {t.name for t in tracks.poses} >= {link_path(n) for n in ("crank", "coupler", "rocker")}
    steady = [p for p in tracks.points if p.steady is not None]
    assert steady and all(p.steady[:-1].any() and not np.diff(p.counts)[p.steady[:-1]].any() and not p.steady[-1] for p in steady)
    assert tracks.points and tracks.plots and json.loads(tracks.text())["slider"] == uuid_of(viewer.timeline.slider)
    for frame in (0, 123, 300):
        viewer.set_frame(frame)
        for t in tracks.poses:
            node = viewer.server.scene.get_handle_by_name(t.name)
            np.testing.assert_allclose(node.position, t.places[frame], atol=1e-7)
            if t.quaternions is not None:
                np.testing.assert_allclose(node.wxyz, t.quaternions[frame], atol=1e-12)
        for p in tracks.points:
            node, count = viewer.server.scene.get_handle_by_name(p.name), p.counts[frame]
            assert node.visible == (count > 0)
            if count:
                np.testing.assert_allclose(np.ravel(getattr(node, p.prop)), p.values[frame, :count], atol=1e-7)


def test_a_run_that_is_played_elsewhere_goes_along_and_stops_where_it_is(screen):
    said: list[tuple] = []
    remote = SimpleNamespace(
        begin=lambda clock, rate, loop: said.append(("begin", rate)) or True,
        end=lambda frame: said.append(("end", frame)),
        show_remotely=lambda frame: said.append(("glance", frame)),
    )
    made = Player(np.linspace(0.0, 1.0, 101), screen.show, screen.errors.append, rate=0.2, remote=remote)
    made.start()
    try:
        made.play()
        until(lambda: made.is_remote)
        drawn = len(screen.frames)
        until(lambda: made.frame > 5)
        assert len(screen.frames) == drawn, "nothing is drawn here meanwhile"
        made.pause()
        assert made.wait() and said[-1] == ("end", made.frame) and screen.frames[-1] == made.frame
        assert not made.is_remote and said[0] == ("begin", 0.2)
    finally:
        made.close()


def test_a_kinematic_scene_offers_no_forces(kinematic):
    with Viewer(kinematic, port=0) as shown:
        assert {name for name, box in shown.switches.families.items() if box.visible} == {"velocity", "acceleration"}
        assert shown.server.scene.get_handle_by_name("/vectors/reaction") is None


def test_it_listens_on_this_machine_only(viewer):
    assert viewer.server.get_host() == "127.0.0.1" and viewer.url == f"http://127.0.0.1:{viewer.port}/"
    addresses = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for address in addresses - {"127.0.0.1", "127.0.1.1"}:
        with pytest.raises(OSError), socket.create_connection((address, viewer.port), timeout=0.5):
            pass


def test_a_page_of_another_site_is_refused(viewer):
    async def handshake(origin: str | None) -> None:
        url, protocol = f"ws://127.0.0.1:{viewer.port}", f"viser-v{viser.__version__}"
        async with websockets.connect(url, origin=origin, subprotocols=[protocol], max_size=None) as connection:
            await asyncio.wait_for(connection.recv(), 5.0)

    for origin in ("http://example.org", f"http://example.org:{viewer.port}", "null"):
        with pytest.raises(websockets.InvalidStatus) as refused:
            asyncio.run(handshake(origin))
        assert refused.value.response.status_code == 403
    for origin in (f"http://127.0.0.1:{viewer.port}", f"http://localhost:{viewer.port}", None):
        asyncio.run(handshake(origin))


def test_a_taken_port_is_named_with_the_remedy(four_bar, viewer):
    with pytest.raises(ViewerError, match=rf"Port {viewer.port} on 127.0.0.1 cannot be used .*--port"):
        Viewer(four_bar, port=viewer.port)


@pytest.mark.parametrize("port", [-1, 65536, 10**9])
def test_a_port_that_does_not_exist_is_named(four_bar, port):
    with pytest.raises(ViewerError, match=rf"Port {port} does not exist"):
        Viewer(four_bar, port=port)


def test_the_port_is_free_again_after_closing_and_nothing_was_printed(four_bar, capfd):
    with Viewer(four_bar, port=0) as first:
        port = first.port
        first.play()
    first.close()  # twice is harmless
    with Viewer(four_bar, port=port) as second:
        assert second.port == port
    assert capfd.readouterr().out == ""


def test_a_failing_callback_is_logged_and_the_server_lives(viewer, caplog):
    from mechviz.outputs.viewer.server import safely

    def fail(_event):
        raise ValueError("out of order")

    callback = safely(viewer.server, viewer.changes, "Testing", fail)
    asyncio.run(callback(SimpleNamespace(client=None)))  # set by the program itself: not for callbacks
    assert not caplog.records
    told: list[tuple[str, str]] = []
    client = SimpleNamespace(add_notification=lambda title, body, **_: told.append((title, body)))
    asyncio.run(callback(SimpleNamespace(client=client)))
    assert told == [("Testing failed", "ValueError: out of order")]
    assert "Testing failed" in caplog.text and "ValueError" in caplog.text


def test_a_refusal_is_told_with_its_remedy_and_no_traceback(viewer, caplog):
    from mechviz.outputs.viewer.server import safely

    def refuse(_event):
        raise MechanismError(Fault("positions", "there are too many.", "Take one away."))

    told: list[tuple[str, str]] = []
    client = SimpleNamespace(add_notification=lambda title, body, **_: told.append((title, body)))
    asyncio.run(safely(viewer.server, viewer.changes, "Testing", refuse)(SimpleNamespace(client=client)))
    assert told == [("Not possible", "positions: there are too many. Take one away.")]
    assert "Testing is not possible" in caplog.text and "Traceback" not in caplog.text


@pytest.mark.sample(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_serving_ends_cleanly_on_a_signal(number):
    code = (
        "from mechviz import scene; from mechviz.runs import run_scene; from mechviz.outputs.viewer import serve;"
        "serve(run_scene(scene.load('crank-rocker')), port=0)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ}
    )
    try:
        assert process.stdout is not None
        first = process.stdout.readline()
        assert "http://127.0.0.1:" in first
        process.send_signal(number)
        out, err = process.communicate(timeout=PATIENCE)
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
    assert process.returncode == 0 and "The viewer has stopped." in out and err == ""


def test_values_of_arrows_are_told_where_there_are_not_too_many(four_bar, monkeypatch):
    with Viewer(four_bar, port=0) as viewer:
        view_model, arrows = viewer.inspector.view_model, viewer.scene.arrows
        told = hover_values(view_model, arrows)["/vectors/reaction"]
        values = np.frombuffer(base64.b64decode(told["values"]), np.float32).reshape(-1, told["count"])
        names = [arrow.vector.item for arrow in arrows_by_family(view_model)["reaction"]]
        for k, name in enumerate(names):
            np.testing.assert_allclose(values[:, k], np.hypot(*four_bar.forces.reaction(name)[:, :2].T), rtol=1e-5)
        tips = np.frombuffer(base64.b64decode(told["tips"]), np.float32).reshape(len(values), -1, 3)
        for frame in (0, 5):
            np.testing.assert_allclose(
                tips[frame][np.isfinite(tips[frame, :, 0])], arrows.points("reaction", frame)[:, 1], rtol=1e-5
            )
        monkeypatch.setattr("mechviz.outputs.viewer.world.marks.MOST_HOVER_VALUES", 10)
        assert hover_values(view_model, arrows) == {}
