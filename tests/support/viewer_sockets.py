"""Browsers of which only the sockets are there, and messages such as pages, or somebody else, send."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from patience import PATIENCE
from websockets.sync.client import ClientConnection, connect

from mechviz.outputs.viewer.app import Viewer
from mechviz.outputs.viewer.viser_adapter import uuid_of
from mechviz.outputs.viewer.world.solids import link_path

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, 0.0, 3.0],
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 1.0, 0.0],
    "fov": 0.3,
    "near": 0.01,
    "far": 100.0,
    "image_height": 700,
    "image_width": 1100,
}


def opened(port: int) -> contextlib.AbstractContextManager[ClientConnection]:
    """A socket as a page opens it."""
    protocol: Any = f"viser-v{viser.__version__}"
    return connect(f"ws://127.0.0.1:{port}", subprotocols=[protocol], max_size=None, close_timeout=0.5)


@contextlib.contextmanager
def sockets(port: int, count: int) -> Iterator[list[ClientConnection]]:
    """Browsers of which only the sockets are there, after all that was before them."""
    with contextlib.ExitStack() as stack:
        result = [stack.enter_context(opened(port)) for _ in range(count)]
        for socket in result:
            replay(socket)
        yield result


def replay(socket: ClientConnection) -> list[dict[str, Any]]:
    """All that a page is told when it opens."""
    result: list[dict[str, Any]] = []
    while "ReplayDoneMessage" not in types(result):
        result += messages(socket)
    return result


def messages(socket: ClientConnection) -> list[dict[str, Any]]:
    """The next messages that a browser gets."""
    return decoded(socket.recv(timeout=PATIENCE))


def decoded(data: Any) -> list[dict[str, Any]]:
    size, packed = (int.from_bytes(data[k : k + 8], "little") for k in (0, 8))
    inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=size)
    return list(msgspec.msgpack.decode(inner)["messages"])


def types(result: list[dict[str, Any]]) -> set[str]:
    return {m["type"] for m in result}


def send(socket: ClientConnection, message: Any) -> None:
    """What a page, or somebody else, sends: a message, or bytes as they are."""
    socket.send(message if isinstance(message, bytes) else msgspec.msgpack.encode(message))


def update(control: Any, value: Any) -> dict[str, Any]:
    return {"type": "GuiUpdateMessage", "uuid": uuid_of(control), "updates": {"value": value}}


def answered(viewer: Viewer, browser: ClientConnection) -> None:
    """Wait until all that was sent has been read, and the picture follows the slider."""
    slider = viewer.timeline.slider
    frame = 5 if slider.value != 5 else 6
    send(browser, update(slider, frame))
    until(lambda: viewer.frame == frame, "the slider")
    assert viewer.player.wait() and slider.value == frame
    node = viewer.server.scene.get_handle_by_name(link_path("crank"))
    angle = viewer.run.motion.pose("crank")[frame, 2]
    np.testing.assert_allclose(node.wxyz, [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)], atol=1e-9)


def until(condition: Any, what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, what
        time.sleep(0.002)
