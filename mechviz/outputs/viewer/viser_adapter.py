"""All that the viewer needs of viser 1.1.1 beyond its public interface, and the reason for each.

* What goes to all browsers is encoded once and sent to all of them in the same turn of viser's thread (`SharedBuffer`): viser
  encodes each message anew for every browser, and each browser waits with tasks and timers of its own. The bytes that arrive are
  those that viser would send, but for a time stamp; slow browsers still skip what has been replaced, later ones still get the
  newest of everything.
* Poses of a frame are queued under one lock (`send_poses`): viser takes 60 us a body and frame for it.
* Messages of browsers pass a check before viser looks at them (`start`): viser believes all of them.
* Scripts run in the page (`run_script`), and controls have names there (`uuid_of`): viser has no call for either.

The project pins viser. The message types of `viser.infra` are public; so are their names on the wire.
"""

from __future__ import annotations

import asyncio
import contextlib
import operator
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Literal, TypeAlias

import msgspec
import numpy as np
import viser
import zstandard
from numpy.typing import NDArray
from viser import infra
from viser.infra import _infra

from mechcore.records import dataclass

KEPT_WINDOWS = 4  # encoded windows: browsers that are not in the same turn
SPARSE_RATIO = 4  # from so many numbers a message on, those that are there are listed
COMPRESSION_LEVEL = 1  # of compression, as viser's
MOST_WAITING = 1000  # messages for one browser that does not read; then the oldest are given up
LEAST_SWEPT = 2000  # messages to all browsers: what has been removed is swept when there are twice as many as after the last sweep
MESSAGES_IN_ONE_PIECE = 4096  # poses of one frame must arrive together; viser's own limit is 128
LEAST_MOVE = 1e-10  # [m, or of a quaternion]: less than this is round-off, and far from being seen

Posed = tuple[viser.SceneNodeHandle, NDArray[Any], NDArray[Any] | None]
"""A node, its place (3,) [m] and its turn (4,) as a quaternion w, x, y, z, None if it does not turn."""
MessageTarget: TypeAlias = "viser.ViserServer | viser.ClientHandle"
"""All browsers, now and later, or one."""


# -- messages ---------------------------------------------------------------------------------------------------------
@dataclass(eq=False)
class RunJavascriptMessage(infra.Message):
    """A script for the page. Of those with one ``key`` only the newest is kept."""

    source: str
    key: str

    def redundancy_key(self) -> str:
        return self.key

    def as_serializable_dict(self, binary_buffers: list[memoryview] | None = None) -> dict[str, Any]:
        return {"source": self.source, "type": "RunJavascriptMessage"}


@dataclass(eq=False)
class _PoseMessage(infra.Message):
    """Where a node is, or how it is turned; says at once what it consists of."""

    name: str
    values: tuple[float, ...]
    entity_type = "scene"
    lifecycle_phase = "update_simple"
    entity_id_field = "name"
    kind = field = ""

    def redundancy_key(self) -> str:
        return f"scene:{self.name}:update:{self.kind}"

    def as_serializable_dict(self, binary_buffers: list[memoryview] | None = None) -> dict[str, Any]:
        return {"name": self.name, self.field: self.values, "owner": "", "type": self.kind}


class PositionMessage(_PoseMessage):
    kind, field = "SetPositionMessage", "position"


class OrientationMessage(_PoseMessage):
    kind, field = "SetOrientationMessage", "wxyz"


# -- sending ----------------------------------------------------------------------------------------------------------
class _Turns:
    """The moments at which all browsers look for messages: a while after one has come, so that those that belong together go
    together, or at once. Only the thread of the loop deals with it."""

    def __init__(self, loop: asyncio.AbstractEventLoop, pause: float):
        self._loop, self._pause = loop, pause
        self._came = asyncio.Event()
        self._timer: asyncio.TimerHandle | None = None
        self.thread = -1  # that of the loop, from the first wait on

    def soon(self) -> None:
        """A message has come."""
        if threading.get_ident() == self.thread and self._timer is None:
            self._timer = self._loop.call_later(self._pause, self.now)

    def now(self) -> None:
        """Let all look."""
        if threading.get_ident() == self.thread:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            self._came.set()
            self._came.clear()

    async def wait(self) -> None:
        """Until the next one."""
        self.thread = threading.get_ident()
        await self._came.wait()


class _Signal:
    """In place of an event of viser's: setting it causes a turn."""

    def __init__(self, set_: Any):
        self.set = set_


class _OwnEvent(asyncio.Event):
    """An event that only the thread which waits for it sets. viser sets it from any thread, and then once more from that one: the
    first in the midst of a wait wakes nobody and lets the second do nothing, so that a browser would hear no more."""

    _thread = -1

    async def wait(self) -> Literal[True]:
        self._thread = threading.get_ident()
        return await super().wait()

    def set(self) -> None:
        if self._thread in (-1, threading.get_ident()):
            super().set()


class SharedBuffer(_infra.AsyncMessageBuffer):
    """viser's buffer of messages, to all browsers or to one. It stays bounded: what waits for one browser by number, what is kept
    for all by sweeping out what has been removed. ``encodings`` counts what was encoded for all, ``sendings`` what was sent."""

    def __init__(self, event_loop: asyncio.AbstractEventLoop, persistent_messages: bool):
        super().__init__(event_loop, persistent_messages)
        if not persistent_messages:  # for one browser only: sending stays viser's
            own: Any = _OwnEvent()
            self.message_event = own
            return
        self.max_window_size = MESSAGES_IN_ONE_PIECE
        self.turns = _Turns(event_loop, self.window_duration_sec)
        self.message_event = _Signal(self.turns.soon)  # all that viser does to them is to set them
        self.flush_event = _Signal(self.turns.now)
        self.encodings = self.sendings = 0
        self.sweep: Callable[[], None] | None = None
        self._swept = LEAST_SWEPT
        self._compressor = zstandard.ZstdCompressor(level=COMPRESSION_LEVEL)
        self._encoded: deque[tuple[list[Any], bytes]] = deque(maxlen=KEPT_WINDOWS)  # the newest first
        self._sent = threading.Condition()
        self._reached: dict[int, int] = {}  # the last message that was sent to each browser

    def push(self, message: infra.Message) -> None:
        super().push(message)
        if not self.persistent_messages:
            with self.buffer_lock:
                while len(self.message_from_id) > MOST_WAITING:
                    self.pop_message_locked(next(iter(self.message_from_id)))
        elif self.sweep is not None and len(self.message_from_id) > 2 * self._swept:
            self.sweep()
            self._swept = max(len(self.message_from_id), LEAST_SWEPT)

    def push_poses(self, messages: Iterable[_PoseMessage]) -> None:
        """`push` for many poses, with one lock and one signal for all."""
        with self.buffer_lock:
            for message in messages:
                key, owner = message.redundancy_key(), ("scene", message.name)
                number = self.message_counter
                self.message_counter += 1
                old = self.id_from_redundancy_key.get(key)
                states = self.ids_from_entity_state_key.setdefault(owner, set())
                if old is not None:
                    self.message_from_id.pop(old, None)
                    states.discard(old)
                states.add(number)
                self.message_from_id[number] = message
                self.id_from_redundancy_key[key] = number
            self.message_event.set()
        self.atomic_start()
        self.atomic_end()  # wakes the thread that talks to the browsers, unless more is to come in the same piece

    def take(self, after: int, up_to: int, client: int) -> tuple[list[Any], int]:
        """The messages for a browser after one and up to another, no more than fit into a window, and the number of the last."""
        window: list[Any] = []
        numbers: Sequence[int] = range(after + 1, up_to + 1)
        if len(numbers) > SPARSE_RATIO * (len(self.message_from_id) + 1):  # after hours of play nearly all have been replaced
            with self.buffer_lock:
                numbers = [number for number in self.message_from_id if after < number <= up_to]
        for number in numbers:
            if len(window) >= self.max_window_size or self.atomic_counter:
                return window, after
            after = number
            message = self.message_from_id.get(number)
            if message is not None and message.excluded_self_client != client:
                window.append(message)
        return window, up_to if self.atomic_counter == 0 else after

    def encode(self, window: list[Any]) -> bytes:
        """Messages as viser's pages expect them; the same ones again are not encoded again."""
        for known, data in self._encoded:
            if len(known) == len(window) and all(map(operator.is_, known, window)):
                return data
        arrays: list[memoryview] = []
        messages = [message.as_serializable_dict(arrays) for message in window]
        inner = msgspec.msgpack.encode(
            {"messages": messages, "timestampSec": time.perf_counter(), "binaryBufferLengths": [b.nbytes for b in arrays]}
        )
        compressed = self._compressor.compress(inner)
        parts: list[Any] = [len(inner).to_bytes(8, "little"), len(compressed).to_bytes(8, "little"), compressed]
        size = 16 + len(compressed)
        for array in arrays:
            padding = -size % 8  # each begins at a multiple of 8 bytes
            parts += [bytes(padding), array]
            size += padding + array.nbytes
        data = b"".join(parts)
        self._encoded.appendleft((window, data))
        self.encodings += 1
        return data

    async def serve(self, socket: Any, client: int, backlog_done: Any) -> None:
        """Send to a browser what is there, then ``backlog_done``, then what comes, until the server stops."""
        backlog, last = self.message_counter - 1, -1
        self.generator_cursors[client] = last  # what viser's collection of garbage heeds
        self._reached[client] = last
        try:
            while not self.done:
                newest = self.message_counter - 1 if backlog_done is None else min(self.message_counter - 1, backlog)
                window, last = self.take(last, newest, client)
                self.generator_cursors[client] = last
                if backlog_done is not None and last >= backlog and self.atomic_counter == 0:
                    window.append(backlog_done)
                    backlog_done = None
                if window:
                    await socket.send(self.encode(window))
                    self.sendings += 1
                with self._sent:
                    self._reached[client] = last
                    self._sent.notify_all()
                if last >= self.message_counter - 1 or self.atomic_counter:
                    await self.turns.wait()
        finally:
            self.generator_cursors.pop(client, None)
            with self._sent:
                self._reached.pop(client, None)
                self._sent.notify_all()

    def wait(self, timeout: float) -> bool:
        """Until all browsers have been sent what there is now; False if that takes longer than ``timeout`` [s]."""
        newest = self.message_counter - 1
        with self._sent:
            return self._sent.wait_for(lambda: self.done or all(n >= newest for n in self._reached.values()), timeout)


async def _produce(websocket: object, buffer: object, client_id: int, backlog_done_message: object = None) -> None:
    """In place of viser's function of this purpose, which it still is for all other buffers."""
    if isinstance(buffer, SharedBuffer) and buffer.persistent_messages:
        await buffer.serve(websocket, client_id, backlog_done_message)
    else:
        await _viser_produce(websocket, buffer, client_id, backlog_done_message)


_viser_produce, _infra._message_producer = _infra._message_producer, _produce  # viser looks it up whenever a browser comes


# -- starting ---------------------------------------------------------------------------------------------------------
class _Checked:
    """Reads messages of browsers in place of viser's ``kinds``: those that ``admits(data)`` refuses become nothing, of which viser
    has no handler."""

    def __init__(self, kinds: type[infra.Message], admits: Callable[[bytes], bool]):
        self._kinds, self._admits = kinds, admits

    def deserialize(self, data: bytes) -> infra.Message | None:
        return self._kinds.deserialize(data) if self._admits(data) else None


@contextlib.contextmanager
def attribute_replaced(owner: object, name: str, value: object) -> Iterator[None]:
    """Within it an attribute of a module has another value. Not for several threads at once."""
    before = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)


def start(host: str, port: int, label: str, admits: Callable[[bytes], bool]) -> viser.ViserServer:
    """A server of viser with a `SharedBuffer`, which gets only messages that ``admits(data)`` accepts."""
    plain = infra.WebsockServer

    def checked(*args: object, message_class: type[infra.Message], **options: object) -> infra.WebsockServer:
        reader: Any = _Checked(message_class, admits)
        return plain(*args, message_class=reader, **options)

    with attribute_replaced(infra, "WebsockServer", checked), attribute_replaced(_infra, "AsyncMessageBuffer", SharedBuffer):
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    buffer_of(server).sweep = server._run_garbage_collector
    return server


def control_of(server: viser.ViserServer, uuid: str) -> Any:
    """The control with the name ``uuid`` in pages, of all browsers or of one; None if there is none."""
    for gui in (server.gui, *(client.gui for client in server.get_clients().values())):
        if uuid in gui._gui_input_handle_from_uuid:
            return gui._gui_input_handle_from_uuid[uuid]
    return None


# -- what the viewer does with it -------------------------------------------------------------------------------------
def uuid_of(control: Any) -> str:
    """The name that a control has in pages."""
    return str(control._impl.uuid)


def is_removed(control: Any) -> bool:
    """Whether a control has been taken out of the page."""
    return bool(control._impl.removed)


def _queue_of(target: MessageTarget) -> infra.WebsockMessageHandler:
    return target._websock_server if isinstance(target, viser.ViserServer) else target._websock_connection


def buffer_of(server: viser.ViserServer) -> SharedBuffer:
    """Messages that wait for, and are kept for, all browsers of a server."""
    buffer = _queue_of(server).get_message_buffer()
    assert isinstance(buffer, SharedBuffer)
    return buffer


def run_script(target: MessageTarget, source: str, key: str) -> None:
    """Run a script in the page of one browser, or of all, now and later. ``key`` names its purpose: of those for one purpose that
    wait or are kept, only the newest counts."""
    _queue_of(target).queue_message(RunJavascriptMessage(source, f"mechviz {key}"))


def send_now(server: viser.ViserServer, timeout: float) -> bool:
    """Send what has been queued for all browsers at once, and wait until it is on its way; False if that takes longer than
    ``timeout`` [s]. While somebody waits, the thread that talks to the browsers has Python for itself."""
    server.flush()
    return buffer_of(server).wait(timeout)


def send_poses(server: viser.ViserServer, poses: Iterable[Posed]) -> int:
    """Bring nodes of the server's scene to their poses; the number of messages that this takes."""
    states = [(node._impl, position, turn) for node, position, turn in poses]
    turning = [(state, turn) for state, _, turn in states if turn is not None]
    messages: list[_PoseMessage] = [
        OrientationMessage(state.name, values)
        for state, values in _moved([s for s, _ in turning], [s.wxyz for s, _ in turning], [t for _, t in turning])
    ]
    messages += [
        PositionMessage(state.name, values)
        for state, values in _moved([s for s, _, _ in states], [s.position for s, _, _ in states], [p for _, p, _ in states])
    ]
    if messages:
        buffer_of(server).push_poses(messages)
    return len(messages)


def _moved(states: list[Any], before: list[NDArray[Any]], after: list[NDArray[Any]]) -> list[tuple[Any, tuple[float, ...]]]:
    """The nodes that are elsewhere now, with where; their states become that."""
    if not states:
        return []
    new = np.array(after, float)
    moved = (np.abs(new - np.array(before)) > LEAST_MOVE).any(axis=1)
    values = new.tolist()
    changed = []
    for k in np.flatnonzero(moved & np.isfinite(new).all(axis=1)):  # viser draws nothing at all of what is not a number
        if not states[k].removed:
            before[k][:] = values[k]
            changed.append((states[k], tuple(values[k])))
    return changed
