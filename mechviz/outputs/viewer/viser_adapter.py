"""Everything that the viewer uses of viser 1.1.1 beyond its public interface, and the reason for each.

* Messages to all browsers are encoded once and sent to all of them in the same turn of viser's thread (`SharedBuffer`): viser
  encodes each message anew for every browser, and each browser has its own tasks and timers. The bytes that arrive are those that
  viser would send, except for a time stamp. As with viser, slow browsers skip messages that have been replaced, and browsers that
  connect later get the newest state of everything.
* Poses of a frame are queued under one lock (`send_poses`): viser takes 60 us per body and frame.
* Messages of browsers are checked before viser reads them (`start`): viser trusts all of them.
* Scripts run in the page (`run_script`), and controls have names there (`uuid_of`): viser has no public function for either.

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

KEPT_WINDOWS = 4  # encoded windows that are kept, for browsers that are not in the same turn
SPARSE_RATIO = 4  # above so many message numbers per existing message, `SharedBuffer.take` lists the existing messages instead
COMPRESSION_LEVEL = 1  # of zstandard, as in viser
MOST_WAITING = 1000  # messages for one browser that does not read; beyond that the oldest are dropped
LEAST_SWEPT = 2000  # messages to all browsers: removed nodes are swept out when there are twice as many as after the last sweep
MESSAGES_IN_ONE_PIECE = 4096  # poses of one frame must arrive together; viser's own limit is 128
LEAST_MOVE = 1e-10  # [m, or in components of a quaternion]: smaller changes are round-off, and invisible

NodePose = tuple[viser.SceneNodeHandle, NDArray[Any], NDArray[Any] | None]
"""A node, its position (3,) [m] and its orientation (4,) as a quaternion w, x, y, z, None if it does not rotate."""
MessageTarget: TypeAlias = "viser.ViserServer | viser.ClientHandle"
"""All browsers, present and future, or one."""


# -- messages ---------------------------------------------------------------------------------------------------------
@dataclass(eq=False)
class RunJavascriptMessage(infra.Message):
    """A script for the page. Of several scripts with the same ``key`` only the newest is kept."""

    source: str
    key: str

    def redundancy_key(self) -> str:
        return self.key

    def as_serializable_dict(self, binary_buffers: list[memoryview] | None = None) -> dict[str, Any]:
        return {"source": self.source, "type": "RunJavascriptMessage"}


@dataclass(eq=False)
class _PoseMessage(infra.Message):
    """Position or orientation of a node; `as_serializable_dict` is written out for speed."""

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
    """The turns in which the tasks of all browsers look for messages: ``pause`` [s] after the first new message, so that messages
    that belong together are sent together, or at once. Only the thread of the event loop triggers turns."""

    def __init__(self, loop: asyncio.AbstractEventLoop, pause: float):
        self._loop, self._pause = loop, pause
        self._came = asyncio.Event()
        self._timer: asyncio.TimerHandle | None = None
        self.thread = -1  # that of the loop, from the first wait on

    def soon(self) -> None:
        """Schedule a turn: a message has arrived."""
        if threading.get_ident() == self.thread and self._timer is None:
            self._timer = self._loop.call_later(self._pause, self.now)

    def now(self) -> None:
        """Start a turn at once."""
        if threading.get_ident() == self.thread:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            self._came.set()
            self._came.clear()

    async def wait(self) -> None:
        """Wait for the next turn."""
        self.thread = threading.get_ident()
        await self._came.wait()


class _Signal:
    """Replaces an event of viser: setting it causes a turn."""

    def __init__(self, set_: Any):
        self.set = set_


class _OwnEvent(asyncio.Event):
    """An event that can be set only from the thread that waits for it.

    viser sets it from any thread, and then again from the waiting thread. If the first call comes during the wait, it wakes no task
    and makes the second call ineffective, so that the browser would receive nothing more.
    """

    _thread = -1

    async def wait(self) -> Literal[True]:
        self._thread = threading.get_ident()
        return await super().wait()

    def set(self) -> None:
        if self._thread in (-1, threading.get_ident()):
            super().set()


class SharedBuffer(_infra.AsyncMessageBuffer):
    """viser's buffer of messages, to all browsers or to one. Its size is bounded: messages waiting for one browser by their number,
    messages kept for all browsers by sweeping out those of removed nodes. ``encodings`` counts the windows encoded for all,
    ``sendings`` the windows sent."""

    def __init__(self, event_loop: asyncio.AbstractEventLoop, persistent_messages: bool):
        super().__init__(event_loop, persistent_messages)
        if not persistent_messages:  # for one browser only: viser does the sending
            own: Any = _OwnEvent()
            self.message_event = own
            return
        self.max_window_size = MESSAGES_IN_ONE_PIECE
        self.turns = _Turns(event_loop, self.window_duration_sec)
        self.message_event = _Signal(self.turns.soon)  # viser only calls their ``set``
        self.flush_event = _Signal(self.turns.now)
        self.encodings = self.sendings = 0
        self.sweep: Callable[[], None] | None = None
        self._swept = LEAST_SWEPT
        self._compressor = zstandard.ZstdCompressor(level=COMPRESSION_LEVEL)
        self._encoded: deque[tuple[list[Any], bytes]] = deque(maxlen=KEPT_WINDOWS)  # the newest first
        self._sent = threading.Condition()
        self._reached: dict[int, int] = {}  # number of the last message that was sent, by browser

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
        self.atomic_end()  # wakes the thread that sends to the browsers, unless an outer atomic block is open

    def take(self, after: int, up_to: int, client: int) -> tuple[list[Any], int]:
        """Messages for a browser with numbers above ``after`` up to ``up_to``, at most a window full, and the number reached."""
        window: list[Any] = []
        numbers: Sequence[int] = range(after + 1, up_to + 1)
        if len(numbers) > SPARSE_RATIO * (len(self.message_from_id) + 1):  # after hours of playing nearly all have been replaced
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
        """Messages in the format of viser's pages; a window that was encoded recently is taken from the cache."""
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
        """Send to a browser the existing messages, then ``backlog_done``, then new messages, until the server stops."""
        backlog, last = self.message_counter - 1, -1
        self.generator_cursors[client] = last  # viser's garbage collection reads it
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
        """Wait until all present messages have been sent to all browsers; False if that takes longer than ``timeout`` [s]."""
        newest = self.message_counter - 1
        with self._sent:
            return self._sent.wait_for(lambda: self.done or all(n >= newest for n in self._reached.values()), timeout)


async def _produce(websocket: object, buffer: object, client_id: int, backlog_done_message: object = None) -> None:
    """Replaces viser's function of the same purpose for persistent `SharedBuffer`; viser's own still serves all other buffers."""
    if isinstance(buffer, SharedBuffer) and buffer.persistent_messages:
        await buffer.serve(websocket, client_id, backlog_done_message)
    else:
        await _viser_produce(websocket, buffer, client_id, backlog_done_message)


_viser_produce, _infra._message_producer = _infra._message_producer, _produce  # viser looks it up whenever a browser connects


# -- starting ---------------------------------------------------------------------------------------------------------
class _Checked:
    """Reads messages of browsers in place of viser's ``kinds``: messages that ``admits(data)`` refuses become None, for which viser
    has no handler."""

    def __init__(self, kinds: type[infra.Message], admits: Callable[[bytes], bool]):
        self._kinds, self._admits = kinds, admits

    def deserialize(self, data: bytes) -> infra.Message | None:
        return self._kinds.deserialize(data) if self._admits(data) else None


@contextlib.contextmanager
def attribute_replaced(owner: object, name: str, value: object) -> Iterator[None]:
    """A context in which an attribute of a module has another value. Not thread-safe."""
    before = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)


def start(host: str, port: int, label: str, admits: Callable[[bytes], bool]) -> viser.ViserServer:
    """A viser server with a `SharedBuffer`; it receives only messages that ``admits(data)`` accepts."""
    plain = infra.WebsockServer

    def checked(*args: object, message_class: type[infra.Message], **options: object) -> infra.WebsockServer:
        reader: Any = _Checked(message_class, admits)
        return plain(*args, message_class=reader, **options)

    with attribute_replaced(infra, "WebsockServer", checked), attribute_replaced(_infra, "AsyncMessageBuffer", SharedBuffer):
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    buffer_of(server).sweep = server._run_garbage_collector
    return server


def control_of(server: viser.ViserServer, uuid: str) -> Any:
    """The control named ``uuid`` in the page, of all browsers or of one; None if there is none."""
    for gui in (server.gui, *(client.gui for client in server.get_clients().values())):
        if uuid in gui._gui_input_handle_from_uuid:
            return gui._gui_input_handle_from_uuid[uuid]
    return None


# -- functions for the viewer -----------------------------------------------------------------------------------------
def uuid_of(control: Any) -> str:
    """The name of a control in the page."""
    return str(control._impl.uuid)


def is_removed(control: Any) -> bool:
    """Whether a control has been removed from the page."""
    return bool(control._impl.removed)


def _queue_of(target: MessageTarget) -> infra.WebsockMessageHandler:
    return target._websock_server if isinstance(target, viser.ViserServer) else target._websock_connection


def buffer_of(server: viser.ViserServer) -> SharedBuffer:
    """The buffer of messages that wait or are kept for all browsers of a server."""
    buffer = _queue_of(server).get_message_buffer()
    assert isinstance(buffer, SharedBuffer)
    return buffer


def run_script(target: MessageTarget, source: str, key: str) -> None:
    """Run a script in the page of one browser, or of all browsers, present and future. ``key`` names its purpose: of several
    waiting or kept scripts with the same key, only the newest runs."""
    _queue_of(target).queue_message(RunJavascriptMessage(source, f"mechviz {key}"))


def send_now(server: viser.ViserServer, timeout: float) -> bool:
    """Send the messages queued for all browsers at once, and wait until they are sent; False if that takes longer than ``timeout``
    [s]. Waiting lets the sending thread have the Python interpreter."""
    server.flush()
    return buffer_of(server).wait(timeout)


def send_poses(server: viser.ViserServer, poses: Iterable[NodePose]) -> int:
    """Send the poses of nodes of the server's scene to all browsers; return the number of messages."""
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
    """The nodes whose values changed by more than `LEAST_MOVE`, with the new values; the stored states ``before`` are updated."""
    if not states:
        return []
    new = np.array(after, float)
    moved = (np.abs(new - np.array(before)) > LEAST_MOVE).any(axis=1)
    values = new.tolist()
    changed = []
    for k in np.flatnonzero(moved & np.isfinite(new).all(axis=1)):  # viser draws nothing of a pose with NaN
        if not states[k].removed:
            before[k][:] = values[k]
            changed.append((states[k], tuple(values[k])))
    return changed
