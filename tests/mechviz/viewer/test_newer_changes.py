"""Changes by browsers while an earlier one is being solved: the newest value wins, and no control goes back under the hand."""

from __future__ import annotations

import asyncio
import threading
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest
from patience import PATIENCE
from viewer_sockets import CAMERA, send, sockets, until, update

import mechviz
from mechviz.editor.laws import TABLE, law_changes
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.viser_adapter import uuid_of
from mechviz.quantities.events import events_of
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
        assert viewer.session.wait(until_idle=True)
        assert text.value == typed and fault in statuses[1].fault and bool(fault) is bool(statuses[1].fault)
        values = value_at(viewer.run.scene.document, LAW).position.values
        assert len(values) == 25 if fault else values == [0, 9, 15, 18, 19.5, 20, 20]
        assert fault in viewer.inspector.controls.message.content
        viewer.session.undo()
        assert viewer.session.wait(until_idle=True)
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
        assert viewer.session.wait(until_idle=True)
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
        assert viewer.session.wait(until_idle=True)
        followed.set()
        until(lambda: has(viewer.run), "what was asked for")
        assert viewer.session.wait(until_idle=True) and box.value == wanted
        viewer.session.undo()
        assert viewer.session.wait(until_idle=True) and box.value != wanted, "it follows again"


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
        assert viewer.session.wait(until_idle=True) and box.value == wanted


def test_at_rest_everything_is_that_of_the_last_change():
    """Also what comes with solids that are quickly made, and sliders of values that were changed elsewhere."""
    with Viewer(run_scene(mechviz.load("slider-crank-compressor"), frames=24), port=0) as viewer:
        session, inspector = viewer.session, viewer.inspector
        for key, value in (("links.piston.mass", 7.0), ("links.crank.points.B[0]", 50.0), ("joints.A.drive.speed", 300.0)):
            (parameter,) = (p for p in session.parameters if p.key == key)
            session.set_value(parameter, value)
            assert session.wait(until_idle=True)
            events = tuple(inspector.timeline._events_by_label.values())
            assert events == events_of(run_scene(session.run.scene)), "in the list"
            assert f"{events[-1].time:.4g} s: {events[-1].item}" in inspector.timeline.strip.content
            assert inspector._followed is inspector._plotted is session.view_model and session.view_model.exact
            assert not inspector.playback._only_server, "browsers play by themselves again"
            assert inspector.controls.sliders[key].value == value


def test_what_is_no_longer_drawn_goes_away():
    with Viewer(run_scene(mechviz.load("crank-rocker"), frames=24), port=0) as viewer:
        session, links = viewer.session, viewer.scene.links
        session.change("looks", lambda draft: draft.with_value(("links", "crank", "looks"), "nothing"))
        assert session.wait(until_idle=True) and not session.status.fault
        assert not links._meshes["crank"] and links._meshes["rocker"]
        session.undo()
        assert session.wait(until_idle=True) and links._meshes["crank"]


def test_a_section_stays_at_its_part_of_the_depth():
    with Viewer(run_scene(mechviz.load("crank-rocker"), frames=24), port=0) as viewer:
        session, section = viewer.session, viewer.switches.section
        section.value = 50.0
        viewer.switches._cut()
        before = viewer.scene.links._height
        (frame,) = (p for p in session.parameters if p.key == "links.frame.points.D[0]")
        session.set_value(frame, 300.0)
        assert session.wait(until_idle=True)
        assert viewer.scene.links._height == pytest.approx(viewer.scene.current.bounds[:, 2].mean()) != before


def test_a_coordinate_that_is_moved_to_zero_keeps_its_slider():
    with Viewer(run_scene(mechviz.load("crank-rocker"), frames=24), port=0) as viewer:
        session, controls = viewer.session, viewer.inspector.controls
        for name, value in (("links.coupler.points.E[1]", 0.0), ("links.coupler.points.E[0]", -20.0)):
            (parameter,) = (p for p in session.parameters if p.key == name)
            session.set_value(parameter, value)
            session.change("effect gravity", lambda draft: draft.with_effect("gravity", "gravity" not in draft.document.effects))
            assert session.wait(until_idle=True) and not session.status.fault
            assert controls.sliders[name].value == value and controls.sliders[name].label == parameter.title
        assert session.run.scene.document.links["coupler"].points["E"] == (-20.0, 0.0)


def test_a_refused_slider_goes_back_also_where_another_change_follows_at_once():
    with Viewer(run_scene(mechviz.load("crank-rocker"), frames=24), port=0) as viewer:
        session, sliders = viewer.session, viewer.inspector.controls.sliders
        coupler, speed = "links.coupler.points.C[0]", "joints.A.drive.speed"
        known = {p.key: p for p in session.parameters}
        sliders[coupler].value = 500.0
        session.set_value(known[coupler], 500.0)
        assert session.wait() and session.status.fault
        session.set_value(known[speed], 70.0)
        assert session.wait(until_idle=True) and not session.status.fault
        viewer.inspector.controls._edited._last[uuid_of(sliders[coupler])] = 500.0  # as after a browser's move
        viewer.inspector.settle()
        assert sliders[coupler].value == 180.0 and sliders[speed].value == 70.0


def test_an_axis_that_a_swinging_drive_does_not_have_is_offered_again():
    with Viewer(run_scene(mechviz.load("crank-rocker"), frames=24), port=0) as viewer:
        session, axes = viewer.session, viewer.plots._against
        (crank,) = (p for p in session.parameters if p.key == "links.crank.points.B[0]")
        before = axes.options
        session.set_value(crank, 140.0)
        assert session.wait(until_idle=True) and axes.options == ("time [s]",) and axes.value == "time [s]"
        session.undo()
        assert session.wait(until_idle=True) and axes.options == before
        viewer.plots.choose_axis(before[0])
        assert axes.value == before[0] == viewer.plots._axis.title


def test_nothing_is_saved_while_a_change_is_solved(tmp_path, monkeypatch):
    """It would be the scene before; and the dialog saves what is shown when its button is pressed."""
    run = run_scene(mechviz.load("crank-rocker"), frames=24)
    with Viewer(run, port=0, folder=tmp_path) as viewer:
        session, client = viewer.session, MagicMock()
        made: dict[str, Any] = {}
        client.gui.add_button = lambda label, **_: made.setdefault(label, MagicMock())
        client.gui.add_text = lambda label, value: made.setdefault(label, SimpleNamespace(value=value))
        client.gui.add_html = lambda text: made.setdefault(text or "warning", SimpleNamespace(content=text))
        viewer.inspector.saver._ask(client, "Scene")

        def press():
            asyncio.run(made["Save"].on_click.call_args.args[0](SimpleNamespace(client=client)))

        go, begun, solve = threading.Event(), threading.Event(), session._solved
        monkeypatch.setattr(session, "_solved", lambda draft: (begun.set(), go.wait(PATIENCE), solve(draft))[-1])
        (crank,) = (p for p in session.parameters if p.key == "links.crank.points.B[0]")
        session.set_value(crank, 50.0)
        assert begun.wait(PATIENCE) and session.busy
        press()
        assert "still being solved" in made["warning"].content and not list(tmp_path.iterdir())
        go.set()
        assert session.wait() and not session.busy
        press()
        (saved,) = tmp_path.iterdir()
        assert mechviz.load(saved).document.links["crank"].points["B"][0] == 50.0
