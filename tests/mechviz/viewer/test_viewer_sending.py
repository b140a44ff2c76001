"""What the viewer sends to browsers: only what moved, in one piece, encoded once for all. Sockets stand for the browsers."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
from patience import PATIENCE
from viewer_sockets import messages, opened, replay, sockets
from viser import _messages

from mechviz import scene
from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.viser_adapter import SharedBuffer, buffer_of, send_now, send_poses, uuid_of
from mechviz.outputs.viewer.world.solids import link_path
from mechviz.runs import run_scene

POSES = ("SetPositionMessage", "SetOrientationMessage")


@pytest.fixture(scope="module")
def viewer() -> Iterator[Viewer]:
    with Viewer(run_scene(scene.load("crank-rocker"), frames=48), port=0) as shown:
        assert shown.session.wait(until_idle=True)
        yield shown


# -- poses ------------------------------------------------------------------------------------------------------------
def test_messages_are_those_of_viser_and_only_of_nodes_that_moved(viewer):
    nodes = [viewer.server.scene.add_frame(f"/test/{k}", show_axes=False) for k in range(3)]
    buffer, still = buffer_of(viewer.server), np.array([1.0, 0.0, 0.0, 0.0])
    turned = np.array([0.6, 0.0, 0.0, 0.8])
    assert send_poses(viewer.server, [(node, np.zeros(3), still) for node in nodes]) == 0, "they stand there already"
    assert send_poses(viewer.server, [(nodes[0], np.array([1, 2, 3]), turned), (nodes[1], np.zeros(3), None)]) == 2
    assert nodes[0].position.tolist() == [1.0, 2.0, 3.0] and nodes[0].wxyz.tolist() == turned.tolist()
    for ours in [buffer.message_from_id[buffer.message_counter - k] for k in (1, 2)]:
        theirs = getattr(_messages, ours.kind)(ours.name, ours.values)
        assert ours.kind in POSES and ours.redundancy_key() == theirs.redundancy_key()
        assert msgspec.msgpack.encode(ours.as_serializable_dict([])) == msgspec.msgpack.encode(theirs.as_serializable_dict([]))
        assert ours.entity_state_key() == theirs.entity_state_key() == ("scene", "/test/0")
    for node in nodes:
        node.remove()
    left = [
        m for m in buffer.message_from_id.values() if getattr(m, "name", "").startswith("/test/") and m.lifecycle_phase != "remove"
    ]
    assert not left, "viser's removal takes our messages with it"
    assert send_poses(viewer.server, [(nodes[0], np.ones(3), still)]) == 0, "of a node that is no more"


def test_what_is_not_a_number_is_not_sent_and_what_follows_is(viewer):
    node = viewer.server.scene.add_frame("/test/lost", show_axes=False)
    assert send_poses(viewer.server, [(node, np.array([1.0, np.nan, 0.0]), None)]) == 0
    assert node.position.tolist() == [0.0, 0.0, 0.0]
    assert send_poses(viewer.server, [(node, np.array([1.0, 1e-14, 0.0]), None)]) == 1
    assert send_poses(viewer.server, [(node, np.array([1.0, 0.0, 0.0]), None)]) == 0, "round-off"
    node.remove()


def test_only_the_newest_pose_of_a_node_is_kept_and_all_of_a_frame_are_queued_under_one_lock(viewer, monkeypatch):
    buffer = buffer_of(viewer.server)
    viewer.set_frame(3)
    kept = len(buffer.message_from_id)
    pushed: list[Any] = []
    real = type(buffer).push
    monkeypatch.setattr(type(buffer), "push", lambda self, message: (pushed.append(message), real(self, message)))
    for frame in range(4, 44):
        viewer.inspector.draw(frame, False)
    assert len(buffer.message_from_id) == kept
    assert pushed and not [m for m in pushed if getattr(m, "kind", "") in POSES]


def test_a_page_that_falls_behind_gets_the_newest_frame_only(viewer):
    """What waits for it is one frame, however many it has missed: sending waits for its socket, and takes what is there then."""
    buffer = buffer_of(viewer.server)
    viewer.set_frame(3)
    reached, missed = buffer.message_counter - 1, []
    for frame in range(4, 44):
        viewer.inspector.draw(frame, False)
        window, last = buffer.take(reached, buffer.message_counter - 1, -1)
        missed.append(len(window))
        assert last == buffer.message_counter - 1
        assert len({message.redundancy_key() for message in window}) == len(window)
    assert buffer.message_counter - 1 - reached > 5 * missed[-1] and missed[-1] <= missed[0] + 5
    place, angle = link_path("crank"), viewer.run.motion.pose("crank")[43, 2]
    (turned,) = [m.values for m in window if getattr(m, "name", "") == place and m.kind == "SetOrientationMessage"]
    assert turned == pytest.approx([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)], abs=1e-9)


# -- sockets ----------------------------------------------------------------------------------------------------------
def test_a_frame_comes_in_one_piece_and_says_only_what_moved(viewer):
    viewer.set_frame(0)
    with sockets(viewer.port, 1) as (socket,):
        viewer.set_frame(12)
        texts = messages(socket)
        moved = {(m["type"], m["name"]) for m in texts if m["type"] in POSES}
        crank, fixed = link_path("crank"), viewer.inspector.view_model.frame
        assert ("SetOrientationMessage", crank) in moved and ("SetOrientationMessage", link_path("coupler")) in moved
        assert ("SetPositionMessage", crank) not in moved, "it turns about the origin"
        assert not [name for _, name in moved if name == link_path(fixed)]
        nodes = {name: viewer.server.scene.get_handle_by_name(name) for _, name in moved}
        for m in (m for m in texts if m["type"] in POSES):
            state = nodes[m["name"]].position if "position" in m else nodes[m["name"]].wxyz
            assert list(m.get("position", m.get("wxyz"))) == state.tolist()


def test_all_browsers_get_the_same_bytes_which_are_made_once(viewer):
    buffer = buffer_of(viewer.server)
    with sockets(viewer.port, 4) as browsers:
        assert send_now(viewer.server, PATIENCE)
        made, sent = buffer.encodings, buffer.sendings
        for frame in (5, 15, 25, 35):
            viewer.set_frame(frame)
            assert send_now(viewer.server, PATIENCE)
            first, *others = [socket.recv(timeout=PATIENCE) for socket in browsers]
            assert all(other == first for other in others)
        assert (buffer.encodings - made, buffer.sendings - sent) == (4, 16)


def test_a_browser_that_comes_later_is_told_where_everything_is_now(viewer):
    viewer.set_frame(7)
    viewer.set_frame(31)
    with opened(viewer.port) as socket:
        messages = replay(socket)
        for link in ("crank", "coupler", "rocker"):
            said = [m for m in messages if m["type"] == "SetOrientationMessage" and m["name"] == link_path(link)]
            angle = viewer.run.motion.pose(link)[31, 2]
            assert len(said) == 1 and said[0]["wxyz"] == pytest.approx([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)], abs=1e-9)
            made = [k for k, m in enumerate(messages) if m["type"] == "FrameMessage" and m["name"] == link_path(link)]
            assert made and made[0] < messages.index(said[0])
        assert [m["type"] for m in messages].index("ReplayDoneMessage") == len(messages) - 1


def test_a_browser_that_comes_after_hours_of_play_does_not_ask_for_each_message_that_has_been_replaced(viewer):
    buffer = buffer_of(viewer.server)
    kept = len(buffer.message_from_id)
    buffer.message_counter += 10**12
    with sockets(viewer.port, 1) as (socket,):
        viewer.set_frame(9)
        assert any(m["type"] == "SetOrientationMessage" and m["name"] == link_path("crank") for m in messages(socket))
        assert abs(len(buffer.message_from_id) - kept) <= 5


def test_who_has_changed_a_value_is_not_told_of_it_and_others_are(viewer):
    buffer, uuid = buffer_of(viewer.server), uuid_of(viewer.timeline.slider)
    with sockets(viewer.port, 2) as browsers:
        own = min(buffer.generator_cursors)
        made = buffer.encodings
        message = _messages.GuiUpdateMessage(uuid, {"value": 17})
        message.excluded_self_client = own
        with viewer.server.atomic():  # else the first might be sent before the second is there
            viewer.server._websock_server.queue_message(message)
            viewer.server._websock_server.queue_message(_messages.GuiUpdateMessage(uuid, {"hint": "for all"}))
        assert send_now(viewer.server, PATIENCE)
        said = [[m["updates"] for m in messages(socket) if m.get("uuid") == uuid] for socket in browsers]
        assert sorted(said, key=len) == [[{"hint": "for all"}], [{"value": 17}, {"hint": "for all"}]]
        assert buffer.encodings - made == 2


def test_nothing_of_a_piece_goes_before_it_is_whole(viewer):
    buffer = buffer_of(viewer.server)
    uuid = uuid_of(viewer.timeline.slider)
    with sockets(viewer.port, 1) as (socket,):
        with viewer.server.atomic():
            viewer.server._websock_server.queue_message(_messages.GuiUpdateMessage(uuid, {"value": 1}))
            assert not send_now(viewer.server, 0.05), "it waits for the rest"
            viewer.server._websock_server.queue_message(_messages.GuiUpdateMessage(uuid, {"hint": "last"}))
        assert send_now(viewer.server, PATIENCE)
        assert [m["updates"] for m in messages(socket)] == [{"value": 1}, {"hint": "last"}]
        assert set(buffer.generator_cursors) and buffer.message_counter - 1 == max(buffer.generator_cursors.values())


def test_nobody_is_waited_for_when_nobody_is_there(viewer):
    with sockets(viewer.port, 2):
        pass
    assert send_now(viewer.server, PATIENCE)


def test_while_it_plays_numbers_change_now_and_then(viewer, monkeypatch):
    timeline, buffer = viewer.timeline, buffer_of(viewer.server)
    monkeypatch.setattr("mechviz.outputs.viewer.panels.timeline.MOVES_A_SECOND", 1e-9)
    viewer.set_frame(2)
    for frame in range(3, 20):
        viewer.inspector.draw(frame, True)
    assert timeline.slider.value == 2 and timeline.buttons.options[2] == "Pause"
    before = buffer.message_counter
    timeline.show(20, True)
    assert buffer.message_counter == before
    timeline.show(20, False)
    assert timeline.slider.value == 20 and timeline.buttons.options[2] == "Play"
    viewer.set_frame(0)


def test_another_server_of_viser_keeps_its_own_way():
    plain = viser.infra.WebsockServer("127.0.0.1", 0, _messages.Message, verbose=False)
    plain.start()
    try:
        assert not isinstance(plain._broadcast_buffer, SharedBuffer)
        with opened(plain._port) as socket:
            plain.queue_message(_messages.GuiUpdateMessage("a", {"value": 3}))
            assert messages(socket)[0]["updates"] == {"value": 3}
    finally:
        plain.stop()


def test_a_message_that_comes_just_when_a_browsers_thread_begins_to_wait_wakes_it(monkeypatch):
    """viser sets the event from the thread that sends, too: between the waiter's look and its waiting nobody would be woken."""

    async def woken() -> bool:
        loop = asyncio.get_running_loop()
        buffer = SharedBuffer(loop, persistent_messages=False)
        event = buffer.message_event

        def about_to_wait() -> Any:
            sender = threading.Thread(target=buffer.push, args=(_messages.SetCameraFovMessage(0.5),))
            sender.start()
            sender.join()
            return loop

        monkeypatch.setattr(event, "_get_loop", about_to_wait)
        done, _ = await asyncio.wait([asyncio.ensure_future(event.wait())], timeout=PATIENCE)
        return bool(done)

    assert asyncio.run(woken())
