"""Positions placed by hand: dragged, turned, added and taken away, each time with a four-bar that leads the body through them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from browsers import browser
from browsing import SEEN, SIZE, open_viewer, until

import mechviz
from mechcore.design.burmester import Poses
from mechcore.errors import MechanismError
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.panels.handles import lengthened, moved, shortened
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.runs import run_scene
from mechviz.studies.synthesis.four_bars import motion_choices, motion_solutions, poses_in

__all__ = ["browser"]  # a fixture

POSES = Poses(np.array([0, 0.03 + 0.015j, 0.06 + 0.02j]), np.radians([0, 20, 45]))


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
        tab, session = viewer.inspector.positions, viewer.session
        assert tab is not None and not tab._nodes
        tab.on.value = True
        tab.update(session.show)
        assert len(tab._nodes) == 3
        tab._dragged(1, dragged(0.032 + 0.02j, np.radians(25)))
        assert session.wait(rested=True)
        wanted = moved(POSES, 1, 0.032 + 0.02j, np.radians(25))
        assert poses_in(session.run.scene).places == pytest.approx(wanted.places, abs=1e-12)
        assert poses_in(session.run.scene).angles == pytest.approx(wanted.angles, abs=1e-9)
        assert max(passes(session.run, wanted)) < 2e-3
        assert "1: " in tab.told.content
        tab.ask("one more", lengthened(tab.poses))
        assert session.wait(rested=True)
        assert len(tab.poses.places) == len(tab._nodes) == 4
        tab.ask("one fewer", shortened(tab.poses))
        assert session.wait(rested=True)
        assert len(tab.poses.places) == len(tab._nodes) == 3
        session.undo()
        assert session.wait(rested=True)
        assert len(tab.poses.places) == 4


@pytest.mark.browser
def test_positions_are_shown_added_and_taken_away_in_the_page(browser, solutions):
    with Viewer(run_scene(solutions[0].scene, frames=60), port=0) as viewer:
        page = open_viewer(browser, viewer, SIZE, [link_path("crank")])
        tab, session = viewer.inspector.positions, viewer.session
        page.get_by_label("Show the positions").check()
        page.wait_for_function(SEEN, arg="/positions/3")
        for name, count in (("Add a position", 4), ("Remove the last position", 3)):
            page.get_by_role("button", name=name).click()
            until(page, lambda count=count: session.wait(rested=True) and len(tab.poses.places) == count, name)
        before = session.run.scene.document.links["crank"].points
        uuid = page.locator("label", has_text="Solution").first.get_attribute("for")
        page.locator(f'[id="{uuid}"] ~ div input').fill("2")
        until(page, lambda: session.wait(rested=True) and session.run.scene.document.links["crank"].points != before, "another one")
        page.close()


def test_another_solution_is_another_linkage(solutions):
    with Viewer(run_scene(solutions[0].scene, frames=60), port=0) as viewer:
        tab, session = viewer.inspector.positions, viewer.session
        before = session.run.scene.document.links["crank"].points
        tab.choice.value = 2
        tab.ask("solution", tab.poses)
        assert session.wait(rested=True)
        assert session.run.scene.document.links["crank"].points != before
        assert poses_in(session.run.scene).places == pytest.approx(POSES.places, abs=1e-12)


def test_other_scenes_have_no_positions():
    with Viewer(run_scene(mechviz.load("crank-rocker"), frames=12), port=0) as viewer:
        assert viewer.inspector.positions is None


def test_there_are_two_to_five_positions():
    with pytest.raises(MechanismError, match="fewest"):
        shortened(Poses(POSES.places[:2], POSES.angles[:2]))
    with pytest.raises(MechanismError, match="leave"):
        lengthened(lengthened(lengthened(POSES)))
