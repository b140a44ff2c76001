"""What fails in the viewer is told and undone; what is done next is drawn as ever."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from viewer_sockets import CAMERA, answered, send, sockets, until, update
from websockets.sync.client import ClientConnection

from mechviz import scene
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.panels.plots import PlotSlot
from mechviz.outputs.viewer.world.solids import SolidNodes, link_path
from mechviz.runs import run_scene

CRANK = "links.crank.points.B[0]"


@pytest.fixture()
def viewer() -> Iterator[Viewer]:
    with Viewer(run_scene(scene.load("crank-rocker"), frames=48), port=0) as shown:
        assert shown.session.wait(until_idle=True)
        yield shown


@pytest.fixture()
def browser(viewer: Viewer) -> Iterator[ClientConnection]:
    with sockets(viewer.port, 1) as (socket,):
        send(socket, CAMERA)
        answered(viewer, socket)
        yield socket


def choose(browser: ClientConnection, slot: PlotSlot) -> str:
    """Choose another quantity in a browser; what it is called."""
    title = next(t for t in slot.choice.options if t != slot.choice.value)
    send(browser, update(slot.choice, title))
    return title


def test_a_control_of_which_the_callback_fails_goes_back(viewer, browser, monkeypatch, caplog):
    slot, real = viewer.plots.slots[0], PlotSlot.plot
    before = slot.choice.value

    def fail(self: PlotSlot, quantity: Any, axis: Any, frame: int, compared: Any = None) -> None:
        if quantity.title != before:
            self._read(quantity, axis, compared)
            raise ZeroDivisionError("out of order")
        real(self, quantity, axis, frame, compared)

    monkeypatch.setattr(PlotSlot, "plot", fail)
    choose(browser, slot)
    until(lambda: "out of order" in caplog.text, "the failure is told")
    until(lambda: slot.choice.value == before, "the control goes back")
    answered(viewer, browser)
    assert slot.quantity.title == before and not [r for r in caplog.records if "Drawing" in r.message]
    monkeypatch.undo()
    title = choose(browser, slot)
    until(lambda: slot.quantity.title == title, "the next change holds")
    answered(viewer, browser)


def test_a_control_after_which_the_picture_fails_goes_back(viewer, browser, monkeypatch, caplog):
    slot, real = viewer.plots.slots[0], PlotSlot.show
    before = slot.choice.value

    def fail(self: PlotSlot, frame: int) -> None:
        if self is slot and self.quantity.title != before:
            raise ZeroDivisionError("cannot be drawn")
        real(self, frame)

    monkeypatch.setattr(PlotSlot, "show", fail)
    monkeypatch.setattr(viewer.plots, "choose", lambda slot, title: setattr(slot, "quantity", viewer.plots._quantities[title]))
    title = choose(browser, slot)
    until(lambda: slot.quantity.title == title, "the change is made")
    viewer.player.refresh()
    until(lambda: slot.choice.value == before, "the control goes back")
    answered(viewer, browser)
    assert slot.quantity.title == before and "cannot be drawn" in caplog.text


def test_an_edit_of_which_the_drawing_fails_is_undone(viewer, browser, monkeypatch, caplog):
    slider = viewer.inspector.controls.sliders[CRANK]
    before, shown = slider.value, viewer.run
    real = SolidNodes.update

    def fail(self: SolidNodes, view_model: Any) -> None:
        if view_model.run is not shown:
            raise ZeroDivisionError("no such solids")
        real(self, view_model)

    monkeypatch.setattr(SolidNodes, "update", fail)
    send(browser, update(slider, 1.1 * before))
    until(lambda: "no such solids" in caplog.text, "the failure is told")
    assert viewer.session.wait(until_idle=True)
    assert viewer.run is shown and viewer.inspector.view_model.run is shown and not viewer.session.history.can_undo
    assert "no such solids" in viewer.session.status.fault
    until(lambda: slider.value == before, "the slider goes back")
    answered(viewer, browser)

    monkeypatch.undo()
    send(browser, update(slider, 0.9 * before))
    until(lambda: viewer.run is not shown, "the next edit is solved")
    assert viewer.session.wait(until_idle=True) and not viewer.session.status.fault and viewer.session.history.can_undo
    answered(viewer, browser)
    viewer.set_frame(7)
    angle = viewer.run.motion.pose("rocker")[7, 2]
    node = viewer.server.scene.get_handle_by_name(link_path("rocker"))
    np.testing.assert_allclose(node.wxyz, [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)], atol=1e-9)


def test_what_cannot_be_looked_at_closer_is_left_alone(viewer, monkeypatch):
    closer, real = viewer.inspector.detail, PlotSlot.plot
    before, other = closer.choice.options[:2]
    closer.look_at(before)
    own = closer.slot.quantity.title

    def fail(self: PlotSlot, quantity: Any, axis: Any, frame: int) -> None:
        if quantity.title != own:
            raise ZeroDivisionError("no such plot")
        real(self, quantity, axis, frame)

    monkeypatch.setattr(PlotSlot, "plot", fail)
    with pytest.raises(ZeroDivisionError):
        closer.look_at(other)
    assert (closer.item, closer.choice.value, closer.slot.quantity.title) == (before, before, own)
    viewer.set_frame(9)
    assert not viewer.playing and viewer.timeline.slider.value == 9


def test_a_browser_has_one_dialog_open(viewer, browser):
    buttons = viewer.inspector.saver.buttons
    for name in ("Scene", "Recording") * 4:
        send(browser, update(buttons, name))
    answered(viewer, browser)
    assert len(viewer.inspector.saver._dialogs) == 1
