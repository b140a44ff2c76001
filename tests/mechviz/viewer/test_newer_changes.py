"""Changes by browsers while an earlier one is being solved: the newest value wins, and no control goes back under the hand."""

from __future__ import annotations

import threading

import pytest
from patience import PATIENCE
from viewer_sockets import CAMERA, send, sockets, until, update

import mechviz
from mechviz.editor.laws import TABLE, law_changes
from mechviz.outputs.viewer.app import Viewer
from mechviz.runs import run_scene
from mechviz.scene.document import value_at

LAW = ("joints", "K", "profile", "lift", 0, "law")
SEVEN = "0, 0\n60, 9\n90, 15\n100, 18\n110, 19.5\n115, 20\n120, 20"


def arriving(monkeypatch, viewer, browser, control, value):
    """Statuses of changes. Before the first one is told, a browser has sent another value of a control."""
    told, statuses = viewer.inspector.show_status, []
    send(browser, CAMERA)
    until(lambda: len(viewer.server.get_clients()) == 1, "a browser that looks at the picture")

    def late(status):
        statuses.append(status)
        if len(statuses) == 1:
            send(browser, update(control, value))
            until(lambda: control.value == value, "the browser's value")
        told(status)

    monkeypatch.setattr(viewer.session, "_report", late)
    return statuses


@pytest.mark.thorough
@pytest.mark.parametrize(("typed", "fault"), [("1, 2\n3", "2 numbers are wanted"), (SEVEN, "")])
def test_a_text_typed_while_an_earlier_one_is_solved_is_not_lost(typed, fault, monkeypatch):
    scene = mechviz.load("cam-roller")
    run = run_scene(scene.changed(law_changes(scene, LAW, TABLE)), frames=24)
    first = "\n".join(f"{x}, {20.0 * (x / 120.0) ** 2 * (3.0 - x / 60.0)}" for x in range(0, 121, 5))
    with Viewer(run, port=0) as viewer, sockets(viewer.port, 1) as (browser,):
        (text,) = viewer.inspector.controls.texts.values()
        statuses = arriving(monkeypatch, viewer, browser, text, typed)
        send(browser, update(text, first))
        until(lambda: len(statuses) == 2, "both")
        assert viewer.session.wait(rested=True)
        assert text.value == typed and fault in statuses[1].fault and bool(fault) is bool(statuses[1].fault)
        values = value_at(viewer.run.scene.document, LAW).position.values
        assert len(values) == 25 if fault else values == [0, 9, 15, 18, 19.5, 20, 20]
        assert fault in viewer.inspector.controls.message.content
        viewer.session.undo()
        assert viewer.session.wait(rested=True)
        assert viewer.inspector.controls.texts.popitem()[1].value != typed, "it follows again"


def test_a_slider_moved_while_another_change_is_solved_does_not_go_back(monkeypatch):
    with Viewer(run_scene(mechviz.load("crank-rocker"), frames=24), port=0) as viewer, sockets(viewer.port, 1) as (browser,):
        key, slider = next(iter(viewer.inspector.controls.sliders.items()))
        before, wanted = slider.value, slider.value + slider.step
        statuses = arriving(monkeypatch, viewer, browser, slider, wanted)
        viewer.session.change("another", lambda draft: draft)
        until(lambda: len(statuses) == 2, "both")
        assert statuses[1].key == key and not statuses[1].fault and slider.value == wanted
        (parameter,) = (p for p in viewer.session.parameters if p.key == key)
        assert parameter.value == pytest.approx(wanted, rel=1e-9)
        viewer.session.undo()
        assert viewer.session.wait(rested=True)
        assert slider.value == before, "it follows again"


SWITCHED = pytest.mark.parametrize(
    ("control", "wanted", "has"),
    [
        (lambda i: i.effects.effects["gravity"], True, lambda run: "gravity" in run.scene.effects),
        (lambda i: i.effects.loads["P"], False, lambda run: not run.scene.document.loads),
        (lambda i: i.diagrams.asked["polygons", "velocity"], True, lambda run: run.scene.document.polygons == ["velocity"]),
        (lambda i: i.accuracy.wanted, "1e-6", lambda run: run.accuracy.target == 1e-6),
    ],
)


@pytest.mark.thorough
@SWITCHED
def test_what_has_not_been_read_yet_does_not_go_back_when_an_earlier_change_is_shown(control, wanted, has, monkeypatch):
    """A click that arrives while the controls follow an earlier change, and whose callback runs after that."""
    with (
        Viewer(run_scene(mechviz.load("kinetostatic-four-bar"), frames=24), port=0) as viewer,
        sockets(viewer.port, 1) as (browser,),
    ):
        send(browser, CAMERA)
        until(lambda: len(viewer.server.get_clients()) == 1, "a browser that looks at the picture")
        followed, run = threading.Event(), viewer.changes.run
        monkeypatch.setattr(viewer.changes, "run", lambda *what: followed.wait(PATIENCE) and run(*what))
        box = control(viewer.inspector)
        assert box.value != wanted and not has(viewer.run)
        send(browser, update(box, wanted))
        until(lambda: box.value == wanted, "the browser's value")
        viewer.session.change("another", lambda draft: draft)
        assert viewer.session.wait(rested=True)
        followed.set()
        until(lambda: has(viewer.run), "what was asked for")
        assert viewer.session.wait(rested=True) and box.value == wanted
        viewer.session.undo()
        assert viewer.session.wait(rested=True) and box.value != wanted, "it follows again"


@pytest.mark.sample(2)
@SWITCHED
def test_what_is_in_work_does_not_go_back_when_the_solids_of_an_earlier_change_are_shown(control, wanted, has, monkeypatch):
    solved = run_scene(mechviz.load("kinetostatic-four-bar"), frames=24)
    with Viewer(solved, port=0) as viewer, sockets(viewer.port, 1) as (browser,):
        send(browser, CAMERA)
        until(lambda: len(viewer.server.get_clients()) == 1, "a browser that looks at the picture")
        begun, shown, solve = threading.Event(), threading.Event(), viewer.session._solved

        def held(draft):
            begun.set()
            assert shown.wait(PATIENCE)
            return solve(draft)

        monkeypatch.setattr(viewer.session, "_solved", held)
        box = control(viewer.inspector)
        send(browser, update(box, wanted))
        assert begun.wait(PATIENCE)
        viewer.session._present(viewer.session.view_model)
        viewer.inspector.settle()
        assert box.value == wanted and not has(viewer.run)
        shown.set()
        until(lambda: has(viewer.run), "what was asked for")
        assert viewer.session.wait(rested=True) and box.value == wanted
