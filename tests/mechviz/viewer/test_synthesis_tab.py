"""Positions placed, turned, added and taken away by hand, and a curve drawn with the mouse: each time a four-bar follows."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from browsers import browser
from browsing import CAMERA, CANVAS, SEEN, SIZE, camera_rests, next_frames, open_tab, open_viewer, until

import mechviz
from mechcore.design.burmester import BodyPositions
from mechcore.errors import MechanismError
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.panels.synthesis import lengthened, sheet_place, shortened, with_moved_pose
from mechviz.outputs.viewer.world.camera import fit_view
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.runs import run_scene
from mechviz.studies.synthesis.four_bars import motion_choices, motion_solutions, poses_in
from mechviz.studies.synthesis.paths import drawn_points

__all__ = ["browser"]  # a fixture

POSES = BodyPositions(np.array([0, 0.03 + 0.015j, 0.06 + 0.02j]), np.radians([0, 20, 45]))


@pytest.fixture(scope="module")
def solutions():
    return motion_solutions(POSES, motion_choices(POSES))


def passes(run, poses):
    """Distances of the coupler point from the places [m], at its nearest frames."""
    x, y = run.catalogue["point.coupler.E.position"].values().T / 1e3
    return [abs(x + 1j * y - place).min() for place in poses.places]


def dragged(place, angle, phase="end"):
    node = SimpleNamespace(position=(place.real, place.imag, 0.01), wxyz=(np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)))
    return SimpleNamespace(phase=phase, target=node)


def test_a_scene_says_its_positions(solutions):
    for one in solutions[:2]:
        again = poses_in(mechviz.loads(one.scene.to_toml()))
        assert again.places == pytest.approx(POSES.places, abs=1e-15)
        assert again.angles == pytest.approx(POSES.angles, abs=1e-12)
    assert poses_in(mechviz.load("crank-rocker")) is None


def test_positions_are_dragged_added_and_taken_away(solutions):
    with Viewer(run_scene(solutions[0].scene, frames=120), port=0) as viewer:
        tab, session = viewer.inspector.synthesis.positions, viewer.session
        assert not tab._nodes
        tab.on.value = True
        tab.update(session.view_model)
        assert len(tab._nodes) == 3
        tab._dragged(1, dragged(0.032 + 0.02j, np.radians(25)))
        assert session.wait(until_idle=True)
        wanted = with_moved_pose(POSES, 1, 0.032 + 0.02j, np.radians(25))
        assert poses_in(session.run.scene).places == pytest.approx(wanted.places, abs=1e-12)
        assert poses_in(session.run.scene).angles == pytest.approx(wanted.angles, abs=1e-9)
        assert max(passes(session.run, wanted)) < 2e-3
        assert "1: " in tab.report.content
        tab.ask("one more", lengthened(tab.poses))
        assert session.wait(until_idle=True)
        assert len(tab.poses.places) == len(tab._nodes) == 4
        tab.ask("one fewer", shortened(tab.poses))
        assert session.wait(until_idle=True)
        assert len(tab.poses.places) == len(tab._nodes) == 3
        session.undo()
        assert session.wait(until_idle=True)
        assert len(tab.poses.places) == 4


@pytest.mark.browser
def test_handles_may_be_hidden_while_an_edit_is_shown(solutions):
    """The session and the browsers have threads of their own."""
    with Viewer(run_scene(solutions[0].scene, frames=12), port=0) as viewer, ThreadPoolExecutor(2) as threads:
        tab, view_model = viewer.inspector.synthesis.positions, viewer.session.view_model

        def show(on):
            for _ in range(300):
                tab.on.value = on
                tab._place(view_model)

        for done in [threads.submit(show, on) for on in (True, False)]:
            done.result()
        tab.on.value = True
        tab._place(view_model)
        assert len(tab._nodes) == 3


@pytest.mark.thorough
def test_positions_are_shown_added_and_taken_away_in_the_page(browser, solutions):
    with Viewer(run_scene(solutions[0].scene, frames=60), port=0) as viewer:
        page = open_viewer(browser, viewer, SIZE, [link_path("crank")])
        tab, session = viewer.inspector.synthesis.positions, viewer.session
        open_tab(page, "Synthesis")
        page.get_by_label("Show the positions").check()
        page.wait_for_function(SEEN, arg="/positions/3")
        for name, count in (("Add a position", 4), ("Remove the last position", 3)):
            page.get_by_role("button", name=name).click()
            until(page, lambda count=count: session.wait(until_idle=True) and len(tab.poses.places) == count, name)
        before = session.run.scene.document.links["crank"].points
        uuid = page.locator("label", has_text="Solution").first.get_attribute("for")
        page.locator(f'[id="{uuid}"] ~ div input').fill("2")
        until(
            page,
            lambda: session.wait(until_idle=True) and session.run.scene.document.links["crank"].points != before,
            "another one",
        )
        page.close()


def test_another_solution_is_another_linkage(solutions):
    with Viewer(run_scene(solutions[0].scene, frames=60), port=0) as viewer:
        tab, session = viewer.inspector.synthesis.positions, viewer.session
        before = session.run.scene.document.links["crank"].points
        tab.choice.value = 2
        tab.ask("solution", tab.poses)
        assert session.wait(until_idle=True)
        assert session.run.scene.document.links["crank"].points != before
        assert poses_in(session.run.scene).places == pytest.approx(POSES.places, abs=1e-12)


def test_what_is_listed_are_the_four_bars_for_the_positions_that_are_shown(solutions):
    with Viewer(run_scene(solutions[0].scene, frames=24), port=0) as viewer:
        tab, session = viewer.inspector.synthesis.positions, viewer.session
        tab.ask("solution", tab.poses)
        assert session.wait(until_idle=True) and "1: " in tab.report.content
        own = tab.report.content
        tab.ask("number 2", with_moved_pose(tab.poses, 1, 0.032 + 0.02j, np.radians(25)))
        assert session.wait(until_idle=True) and "1: " in tab.report.content and tab.report.content != own
        session.undo()
        assert session.wait(until_idle=True) and tab.report.content == ""
        tab.ask("solution", tab.poses)
        assert session.wait(until_idle=True) and tab.report.content == own


def test_any_four_bar_begins_with_its_own_positions():
    with Viewer(run_scene(mechviz.load("crank-rocker"), frames=121), port=0) as viewer:
        tab, session = viewer.inspector.synthesis.positions, viewer.session
        x, y = session.run.catalogue["point.coupler.E.position"].values()[[0, 15, 30]].T / 1e3
        assert tab.poses.places == pytest.approx(x + 1j * y, abs=1e-12)
        wanted = with_moved_pose(tab.poses, 2, tab.poses.places[2] + 0.01, tab.poses.angles[2])
        tab.ask("number 3", wanted)
        assert session.wait(until_idle=True)
        assert poses_in(session.run.scene).places == pytest.approx(wanted.places, abs=1e-12)
        assert max(passes(session.run, wanted)) < 2e-3
    with Viewer(run_scene(mechviz.load("slider-crank-engine"), frames=12), port=0) as viewer:
        assert viewer.inspector.synthesis is None


def test_there_are_two_to_five_positions():
    with pytest.raises(MechanismError, match="fewest"):
        shortened(BodyPositions(POSES.places[:2], POSES.angles[:2]))
    with pytest.raises(MechanismError, match="leave"):
        lengthened(lengthened(lengthened(POSES)))


# -- a curve ----------------------------------------------------------------------------------------------------------
TURNS = np.linspace(0.0, 2.0 * np.pi, 60)
OVAL = 0.02 + 0.05j + 0.06 * np.cos(TURNS) + 0.02j * np.sin(TURNS)  # [m]


def far_from_path(run, curve):
    """Greatest distance of places (K,) [m] from the path of the coupler point."""
    x, y = run.catalogue["point.coupler.E.position"].values().T / 1e3
    return max(abs(x + 1j * y - place).min() for place in curve)


def stroke(eye, curve):
    """What the page sends while the mouse goes along a curve (K,) [m] that is seen from somewhere on the sheet at height 0.01 m."""
    client = SimpleNamespace(camera=SimpleNamespace(position=eye, look_at=0.0 * eye), client_id=0)
    start = np.array([curve[0].real, curve[0].imag, 0.01])
    for k, place in enumerate(curve):
        phase = "start" if k == 0 else "end" if k == len(curve) - 1 else "update"
        on = np.array([place.real, place.imag, 0.01])
        seen = eye + 0.9 * (on - eye)  # nearer to the eye than the sheet
        yield SimpleNamespace(phase=phase, start_position=tuple(start), end_position=tuple(seen), client=client)


def test_a_drawn_curve_is_followed_and_undone():
    with Viewer(run_scene(mechviz.load("crank-rocker"), frames=361), port=0) as viewer:
        tab, session = viewer.inspector.synthesis.drawing, viewer.session
        before, link = session.run.scene.to_toml(), session.run.scene.document.links["crank"].points
        tab.on.value = True
        tab.update(session.view_model)
        for event in stroke(np.array([0.3, -0.8, 1.5]), OVAL):
            tab._drawn(event)
        assert session.wait(until_idle=True) and not session.status.fault
        assert far_from_path(session.run, OVAL) < 1e-3  # an ellipse is nearly a coupler curve
        assert len(tab.wanted) == 20 and abs(tab.wanted[-1] - tab.wanted[0]) == 0.0
        assert far_from_path(session.run, tab.wanted) < 1e-3
        assert "1: " in tab.report.content
        first = session.run.scene.document.links["crank"].points
        tab.choice.value = 2
        tab._choose()
        assert session.wait(until_idle=True)
        assert session.run.scene.document.links["crank"].points != first
        assert far_from_path(session.run, OVAL) < 5e-3
        session.undo()
        assert session.wait(until_idle=True)
        assert session.run.scene.document.links["crank"].points in (first, link)
        session.undo()
        assert session.wait(until_idle=True)
        assert session.run.scene.to_toml() == before and not len(tab.wanted)


def test_what_is_drawn_becomes_points_at_equal_distances():
    arc = np.exp(1j * np.linspace(0.0, 3.0, 400) ** 1.5 / 2.0)
    points = drawn_points(arc)
    steps = np.abs(np.diff(points))
    assert len(points) == 20 and np.ptp(steps) < 5e-3 * steps.mean()
    assert abs(points[0] - arc[0]) < 1e-3 and abs(points[-1] - arc[-1]) < 1e-3
    with pytest.raises(MechanismError, match="no length"):
        drawn_points(np.array([1j, 1j, 1j]))
    assert sheet_place((0, 0, 1), (1, 0, 1), 0.0) is None  # along the sheet


@pytest.mark.thorough
@pytest.mark.browser
def test_a_curve_is_drawn_with_the_mouse(browser):
    with Viewer(run_scene(mechviz.load("crank-rocker"), frames=120), port=0) as viewer:
        page = open_viewer(browser, viewer, SIZE, [link_path("crank")])
        tab, session = viewer.inspector.synthesis.drawing, viewer.session
        open_tab(page, "Synthesis")
        page.get_by_label("Draw a curve").check()
        page.wait_for_function(SEEN, arg="/path/sheet")
        camera_rests(page)
        page.mouse.move(550, 300)
        page.mouse.wheel(0, 400)
        camera_rests(page)
        looked = page.evaluate(CAMERA)
        left, top, width, height = page.evaluate(CANVAS)
        across = left + 0.5 * width + 0.2 * height * np.cos(TURNS), top + 0.5 * height + 0.08 * height * np.sin(TURNS)
        page.mouse.move(across[0][0], across[1][0])
        page.mouse.down()
        for x, y in zip(*(places[::2] for places in across), strict=True):
            page.mouse.move(x, y)
            next_frames(page, 2)
        assert page.evaluate(CAMERA) == looked  # the mouse has drawn, not turned the view
        page.mouse.up()
        until(page, lambda: session.wait(until_idle=True) and len(tab.wanted), "a four-bar for the curve")
        drawn = tab.wanted
        extent = np.ptp(drawn.real), np.ptp(drawn.imag)
        assert extent[0] / extent[1] == pytest.approx(2.5, rel=0.1)  # as on the page
        assert far_from_path(session.run, drawn) < 0.02 * extent[0]
        page.get_by_text("Four-bar through 20 points").wait_for()  # no longer what the scene was
        fitted = fit_view(viewer.inspector.scene.bounds, width / height).distance
        until(page, lambda: page.evaluate(CAMERA)[2] == pytest.approx(-fitted, rel=0.05), "all of it in view, though it was moved")
        first = session.run.scene.document.links["crank"].points
        uuid = page.locator("label", has_text="Four-bar").first.get_attribute("for")
        page.locator(f'[id="{uuid}"] ~ div input').fill("2")
        until(
            page,
            lambda: session.wait(until_idle=True) and session.run.scene.document.links["crank"].points != first,
            "the next one",
        )
        page.close()
