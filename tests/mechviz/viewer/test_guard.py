"""Messages that no page of the viewer sends change nothing, are not kept, and are counted; the picture goes on."""

from __future__ import annotations

import gc
import threading
import time
import urllib.request
import weakref
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import hostile_messages
import pytest
import viser
from budget import Tally
from patience import PATIENCE
from viewer_sockets import CAMERA, answered, opened, send, sockets, until, update
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from mechviz import scene
from mechviz.editor.worker import OFTEN, release_garbage
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.panels.plots import MOST_PLOTS, REMOVE_LABEL, Plots
from mechviz.outputs.viewer.server import is_value
from mechviz.outputs.viewer.viser_adapter import MOST_WAITING, RunJavascriptMessage, SharedBuffer, buffer_of, uuid_of
from mechviz.runs import run_scene

SLIDER_VALUES = (
    float("nan"),
    float("inf"),
    1e300,
    -(2**62),
    [1.0, 2.0],
    [[]],
    "no number",
    "5",
    None,
    {"a": 1},
    "x" * 9000,
    True,
    b"1",
)
UPDATES = ({"max": 5.0}, {"removed": True}, {"value": 7, "max": 9}, {}, [], None, 5)


@pytest.fixture(scope="module")
def viewer() -> Iterator[Viewer]:
    with Viewer(run_scene(scene.load("crank-rocker"), frames=48), port=0) as shown:
        assert shown.session.wait(until_idle=True)
        yield shown


@pytest.fixture()
def browser(viewer: Viewer) -> Iterator[ClientConnection]:
    with sockets(viewer.port, 1) as (socket,):
        send(socket, CAMERA)
        yield socket


def refused(viewer: Viewer) -> int:
    return sum(viewer.guard.dropped.values())


def test_a_page_of_ours_is_believed(viewer, browser):
    before = refused(viewer)
    answered(viewer, browser)
    mesh = next(m.name for m in buffer_of(viewer.server).message_from_id.values() if m.__class__.__name__ == "MeshMessage")
    send(browser, {"type": "SceneNodeClickMessage", "name": mesh, "instance_index": None, "owner": "", "modifier": None,
                   "ray_origin": [0.0, 0.0, 3.0], "ray_direction": [0.0, 0.0, -1.0], "screen_pos": [0.5, 0.5]})  # fmt: skip
    send(browser, {"type": "CommandTriggerMessage", "uuid": "none"})
    send(browser, update(viewer.switches.dark, True))
    send(browser, update(viewer.plots.slots[0].choice, viewer.plots.slots[0].choice.options[1]))
    until(lambda: viewer.switches.dark.value, "the checkbox")
    answered(viewer, browser)
    assert refused(viewer) == before


@pytest.mark.parametrize("value", SLIDER_VALUES, ids=repr)
def test_values_that_do_not_fit_a_slider_change_nothing(viewer, browser, value):
    before, slider = refused(viewer), viewer.timeline.slider
    answered(viewer, browser)
    shown = slider.value
    send(browser, update(slider, value))
    until(lambda: refused(viewer) == before + 1, "counted")
    assert slider.value == shown
    answered(viewer, browser)


def test_a_typed_value_that_cannot_be_had_goes_back_and_its_refusal_stays(viewer, browser):
    controls = viewer.inspector.controls
    slider = controls.sliders["links.crank.points.B[0]"]
    before = slider.value, slider.max
    send(browser, update(slider, -3.0))
    until(lambda: "-3 mm is not possible" in controls.message.content, "the refusal")
    assert viewer.session.wait(until_idle=True)
    until(lambda: slider.value == before[0], "the last good value")
    assert "-3 mm is not possible" in controls.message.content and slider.min >= 0.0
    answered(viewer, browser)


@pytest.mark.parametrize("updates", UPDATES, ids=repr)
def test_only_the_value_of_a_control_can_be_set(viewer, browser, updates):
    before, slider = refused(viewer), viewer.timeline.slider
    send(browser, {"type": "GuiUpdateMessage", "uuid": uuid_of(slider), "updates": updates})
    until(lambda: refused(viewer) == before + 1, "counted")
    assert slider.max == 48
    answered(viewer, browser)


def test_each_kind_of_control_takes_its_own_values_only(viewer, browser):
    controls: list[tuple[Any, tuple[Any, ...]]] = [
        (viewer.plots.slots[0].choice, ("no such quantity", 3, True, None)),
        (viewer.timeline.buttons, ("Explode", 0, True)),
        (viewer.switches.dark, (1, "true", None, 0.0)),
        (viewer.inspector.detail.choice, ("link nobody", b"link crank")),
    ]
    before, kept = refused(viewer), [control.value for control, _ in controls]
    for control, values in controls:
        for value in values:
            send(browser, update(control, value))
    answered(viewer, browser)
    assert refused(viewer) == before + sum(len(values) for _, values in controls)
    assert [control.value for control, _ in controls] == kept


def upload(uuid: str, transfer: str) -> dict[str, Any]:
    return {"type": "FileTransferStartUpload", "source_component_uuid": uuid, "transfer_uuid": transfer, "filename": "a.bin",
            "mime_type": "", "part_count": 0, "size_bytes": 0}  # fmt: skip


def test_no_control_takes_a_file(viewer, browser):
    choice = viewer.plots.slots[0].choice
    kept = choice.value
    send(browser, upload(uuid_of(choice), "t"))
    send(browser, upload(uuid_of(choice), "u") | {"part_count": 2, "size_bytes": 60_000})
    send(browser, {"type": "FileTransferPart", "source_component_uuid": uuid_of(choice), "transfer_uuid": "u", "part_index": 0,
                   "content": bytes(30_000)})  # fmt: skip
    answered(viewer, browser)
    assert choice.value == kept


def test_no_client_can_ask_for_a_public_tunnel(viewer, browser, monkeypatch):
    asked: list[Any] = []
    for name in ("request_share_url", "disconnect_share_url"):
        monkeypatch.setattr(viewer.server, name, lambda *_: asked.append(1))
    send(browser, {"type": "ShareUrlRequest"})
    send(browser, {"type": "ShareUrlDisconnect"})
    answered(viewer, browser)
    time.sleep(0.05)  # viser would ask from a thread of a pool
    assert not asked


def test_what_is_refused_is_neither_kept_nor_sent_to_others(viewer, browser):
    buffer, before = buffer_of(viewer.server), refused(viewer)
    answered(viewer, browser)
    kept = len(buffer.message_from_id)
    for k in range(500):
        send(browser, {"type": "GuiFormDirtyMessage", "uuid": f"{k}"})
    answered(viewer, browser)
    assert refused(viewer) == before + 500 and len(buffer.message_from_id) == kept


def test_bytes_that_are_no_message_are_counted(viewer, browser):
    before = refused(viewer)
    junk = (b"", b"\xc1", b"\x93" * 9000, b"\x80", b"\xa1x", bytes(300))
    for data in junk:
        send(browser, data)
    for message in (
        [],
        {"type": None},
        {"type": ["x"]},
        {"type": "Message"},
        {1: 2},
        CAMERA | {"fov": None},
        CAMERA | {"owner": ""},
    ):
        send(browser, message)
    send(browser, CAMERA | {"look_at": CAMERA["position"]})
    send(browser, {k: v for k, v in CAMERA.items() if k != "far"})
    answered(viewer, browser)
    assert refused(viewer) == before + len(junk) + 9


def test_a_message_that_is_too_long_ends_its_own_connection(viewer, browser):
    with opened(viewer.port) as hostile:
        send(hostile, bytes(1_000_000))
        with pytest.raises(ConnectionClosed):
            while True:
                hostile.recv(timeout=PATIENCE)
    answered(viewer, browser)


def test_a_flood_is_no_flood_of_lines(viewer, browser, caplog):
    for _ in range(300):
        send(browser, {"type": "GuiFormSubmitMessage", "uuid": "x"})
    answered(viewer, browser)
    assert len(caplog.records) <= 3


def test_what_waits_for_a_browser_that_does_not_read_is_bounded(viewer):
    buffer = SharedBuffer(viewer.server.get_event_loop(), persistent_messages=False)
    for k in range(3 * MOST_WAITING):
        buffer.push(RunJavascriptMessage("", f"{k}"))
    assert [m.key for m in buffer.message_from_id.values()] == [f"{k}" for k in range(2 * MOST_WAITING, 3 * MOST_WAITING)]
    for k in range(3 * MOST_WAITING):
        buffer.push(RunJavascriptMessage(f"{k}", "one purpose"))
    assert len(buffer.message_from_id) == MOST_WAITING and buffer.message_from_id.popitem()[1].source == f"{3 * MOST_WAITING - 1}"


def test_what_was_removed_is_not_kept_for_ever(viewer, browser):
    buffer = buffer_of(viewer.server)
    sizes = []
    for k in range(12_000):
        viewer.server.gui.add_html(f"{k}").remove()
        if k % 500 == 0:
            answered(viewer, browser)
            sizes.append(len(buffer.message_from_id))
    assert max(sizes) < 8_000


def test_plots_are_so_many_at_most_and_those_taken_away_are_not_kept(viewer, browser):
    plots = viewer.plots
    kept = list(plots.slots)
    while len(plots.slots) < MOST_PLOTS:
        send(browser, update(plots.more, True))
        answered(viewer, browser)
    send(browser, update(plots.more, True))
    answered(viewer, browser)
    assert len(plots.slots) == MOST_PLOTS and plots.more.disabled
    gone = []
    for slot in plots.slots[len(kept) :]:
        send(browser, update(slot.choice, slot.choice.value))  # of which nothing follows
        send(browser, update(slot.buttons, REMOVE_LABEL))
        gone.append(weakref.ref(slot))
    del slot
    answered(viewer, browser)
    assert plots.slots == kept and not plots.more.disabled
    send(browser, update(viewer.switches.dark, not viewer.switches.dark.value))
    answered(viewer, browser)
    gc.collect()
    assert not [slot for slot in gone if slot() is not None]


def test_a_plot_is_not_sent_to_a_browser_that_has_gone(viewer, monkeypatch):
    ended = threading.Event()
    sent: list[int] = []

    def file(self: Plots, slot: Any, kind: str) -> bytes:
        until(lambda: not viewer.server.get_clients(), "that it has gone")
        return b"a"

    monkeypatch.setattr(Plots, "file", file)
    monkeypatch.setattr(viser.ClientHandle, "send_file_download", lambda *_, **__: sent.append(1))
    monkeypatch.setattr("mechviz.outputs.viewer.panels.plots.release_garbage", ended.set)
    with sockets(viewer.port, 1) as (browser,):
        send(browser, CAMERA)
        send(browser, update(viewer.plots.slots[0].buttons, "PNG"))
        answered(viewer, browser)
    assert ended.wait(PATIENCE) and not sent


class Ring:
    """Refers to itself: only a collection frees it."""

    def __init__(self) -> None:
        self.me = self


def test_texts_of_several_lines_hold_tables_and_no_more(viewer):
    table, line = (viewer.server.gui.add_text("a", "", multiline=lines) for lines in (True, False))
    try:
        assert [[is_value(text, "x" * n) for n in (1000, 1001, 60_000, 60_001)] for text in (line, table)] == [
            [True, False, False, False],
            [True, True, True, False],
        ]
        assert not is_value(table, 5)
    finally:
        table.remove()
        line.remove()


def test_what_is_left_over_is_collected_before_it_is_much(viewer, monkeypatch):
    told: list[int] = []
    monkeypatch.setattr("mechviz.outputs.viewer.app.release_garbage", lambda: told.append(1))  # others may still be leaving
    rings = []
    gc.disable()  # what is collected is collected by us
    begun = weakref.ref(Ring())
    until(lambda: gc.collect() >= 0 and begun() is None, "that no thread is collecting")
    try:
        for _ in range(3 * OFTEN):
            rings.append(weakref.ref(Ring()))
            release_garbage()
            assert sum(ring() is not None for ring in rings) <= OFTEN
    finally:
        gc.enable()
    until(lambda: not viewer.server.get_clients(), "that all have gone")
    told.clear()
    with sockets(viewer.port, 1) as (browser,):
        send(browser, CAMERA)
        until(lambda: viewer.server.get_clients(), "the browser")
    until(lambda: told, "that it has gone")


def test_the_page_loads_nothing_from_elsewhere(viewer):
    with urllib.request.urlopen(viewer.url, timeout=PATIENCE) as answer:
        policy = dict(part.split(" ", 1) for part in answer.headers["Content-Security-Policy"].split("; "))
    assert policy["default-src"] == "'none'" and policy["img-src"] == "'self' data: blob:"
    assert not [value for name, value in policy.items() if "http" in value or "*" in value]
    assert f"ws://127.0.0.1:{viewer.port}" in policy["connect-src"]


@pytest.mark.thorough
def test_a_sample_of_hostile_messages_of_all_kinds():
    """tests/torture/hostile_messages.py sends a million of them, edits among them."""
    with hostile_messages.viewer() as (port, process):
        sizes = []
        for seed, count in enumerate((10_000, 3000, 3000)):
            hostile_messages.attack(port, process, Tally(count, 3600.0), seed=seed, share=0.0)
            hostile_messages.draws(port)
            sizes.append(hostile_messages.memory(process))
    assert min(b - a for a, b in pairwise(sizes)) < 15e6, "each time: what is taken once is no leak"
