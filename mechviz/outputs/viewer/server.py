"""What goes to all browsers is encoded once, and sent to all of them in the same turn of the thread that talks to them.

viser 1.1.1 encodes each message anew for every browser, and each browser waits for messages with tasks and timers of its own. Here
the browsers of a server share both. What arrives is what viser would send, byte for byte but for a time stamp; slow browsers still
skip what has been replaced, later ones still get the newest of everything. The project pins viser, into which this reaches.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import io
import logging
import math
import operator
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import msgspec
import viser
import websockets.asyncio.server
import zstandard
from viser import _messages
from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.typing import Origin

KEPT = 4  # encoded windows: browsers that are not in the same turn
SPARSE = 4  # from so many numbers a message on, those that are there are listed
LEVEL = 1  # of compression, as viser's


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


class SharedBuffer(AsyncMessageBuffer):
    """viser's buffer of messages to all browsers. ``encodings`` counts what was encoded, ``sendings`` what was sent."""

    def __init__(self, event_loop: asyncio.AbstractEventLoop, persistent_messages: bool):
        super().__init__(event_loop, persistent_messages)
        if not persistent_messages:  # for one browser only: it stays viser's
            return
        self.turns = _Turns(event_loop, self.window_duration_sec)
        self.message_event = _Signal(self.turns.soon)  # all that viser does to them is to set them
        self.flush_event = _Signal(self.turns.now)
        self.encodings = self.sendings = 0
        self._compressor = zstandard.ZstdCompressor(level=LEVEL)
        self._encoded: deque[tuple[list[Any], bytes]] = deque(maxlen=KEPT)  # the newest first
        self._sent = threading.Condition()
        self._reached: dict[int, int] = {}  # the last message that was sent to each browser

    def take(self, after: int, up_to: int, client: int) -> tuple[list[Any], int]:
        """The messages for a browser after one and up to another, no more than fit into a window, and the number of the last."""
        window: list[Any] = []
        numbers: Sequence[int] = range(after + 1, up_to + 1)
        if len(numbers) > SPARSE * (len(self.message_from_id) + 1):  # after hours of play nearly all have been replaced
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
        buffers: list[memoryview] = []
        messages = [message.as_serializable_dict(buffers) for message in window]
        inner = msgspec.msgpack.encode(
            {"messages": messages, "timestampSec": time.perf_counter(), "binaryBufferLengths": [b.nbytes for b in buffers]}
        )
        compressed = self._compressor.compress(inner)
        parts: list[Any] = [len(inner).to_bytes(8, "little"), len(compressed).to_bytes(8, "little"), compressed]
        _infra._append_aligned_buffers(parts, buffers, 16 + len(compressed))
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


async def _produce(websocket: Any, buffer: Any, client_id: int, backlog_done_message: Any = None) -> None:
    """In place of viser's function of this purpose, which it still is for all other buffers."""
    if isinstance(buffer, SharedBuffer) and buffer.persistent_messages:
        await buffer.serve(websocket, client_id, backlog_done_message)
    else:
        await _viser_produce(websocket, buffer, client_id, backlog_done_message)


@contextlib.contextmanager
def sharing() -> Iterator[None]:
    """Servers that start within it have a `SharedBuffer`. Not for several threads at once."""
    plain = _infra.AsyncMessageBuffer
    _infra.AsyncMessageBuffer = SharedBuffer  # where viser's servers find it
    try:
        yield
    finally:
        _infra.AsyncMessageBuffer = plain


def send_now(server: viser.ViserServer, timeout: float) -> bool:
    """Send what has been queued for all browsers at once, and wait until it is on its way; False if that takes longer than
    ``timeout`` [s]. While somebody waits, the thread that talks to the browsers has Python for itself."""
    server.flush()
    buffer = server._websock_server._broadcast_buffer
    return not isinstance(buffer, SharedBuffer) or buffer.wait(timeout)


_viser_produce = _infra._message_producer
_infra._message_producer = _produce  # viser looks it up whenever a browser comes


HOST = "127.0.0.1"
ATTEMPTS = 5  # for a free port: another program may take it between the probe and the start
LONGEST_TEXT = 1000
MESSAGES_IN_ONE_PIECE = 4096  # poses of one frame must arrive together; viser's own limit is 128

log = logging.getLogger("mechviz.outputs.viewer")
_starting = threading.Lock()


class ViewerError(Exception):
    """The viewer cannot start. Says why, and what to do."""


def start_server(port: int, label: str) -> viser.ViserServer:
    """A guarded server on 127.0.0.1. ``port`` 0 takes a free one. Raises `ViewerError` if the port cannot be had."""
    for _ in range(ATTEMPTS):
        probed = _probe(port)
        server = _start_guarded(probed, label)
        if server.get_port() == probed:
            _close_tunnel(server)
            _check_values(server)
            server._websock_server._broadcast_buffer.max_window_size = MESSAGES_IN_ONE_PIECE
            return server
        stop_server(server)  # it moved to another port, for which the origins are wrong
        if port:
            break
    raise ViewerError(f"Port {port} was taken by another program during the start. Choose another with --port, or --port 0.")


def stop_server(server: viser.ViserServer) -> None:
    """Stop without viser's words on stdout."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def safely(server: viser.ViserServer, what: str, action: Callable[[Any], None]) -> Callable[[Any], Any]:
    """A callback for viser that runs ``action(event)`` in the order of the events; a failure is logged and shown to the user.

    Events that the program itself causes by setting a value have no client and are ignored.
    """

    async def callback(event: Any) -> None:
        if event.client is None:
            return
        try:
            action(event)
        except Exception as error:
            report(server, what, error, event.client)

    return callback


def report(server: viser.ViserServer, what: str, error: Exception, client: viser.ClientHandle | None = None) -> None:
    """Log a failure and show it as a notification in the client's browser, or in all."""
    log.error("%s failed", what, exc_info=error)
    words = f"{type(error).__name__}: {error}"[:LONGEST_TEXT]
    for who in [client] if client is not None else list(server.get_clients().values()):
        with contextlib.suppress(Exception):  # the browser may have gone; the log has it all
            who.add_notification(f"{what} failed", words, color="red", auto_close_seconds=15.0)


def _probe(port: int) -> int:
    """The number of a port that can be bound now."""
    if not 0 <= port <= 65535:
        raise ViewerError(f"Port {port} does not exist. Choose one from 1024 to 65535 with --port, or --port 0 for a free one.")
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does: a port that was just freed will do
        try:
            probe.bind((HOST, port))
            probe.listen(1)
        except PermissionError:
            raise ViewerError(
                f"Port {port} on {HOST} needs privileges. Choose one from 1024 to 65535 with --port, or --port 0 for a free one."
            ) from None
        except OSError as error:
            raise ViewerError(
                f"Port {port} on {HOST} cannot be used ({error.strerror or error}): another program, perhaps another "
                "mechviz view, has it. Stop that program, or choose another port with --port, or --port 0 for a free one."
            ) from None
        return int(probe.getsockname()[1])


def _start_guarded(port: int, label: str) -> viser.ViserServer:
    """Start viser with a list of the origins whose pages may open its web socket; no origin at all is no browser."""
    origins = [None, Origin(f"http://{HOST}:{port}"), Origin(f"http://localhost:{port}")]
    with _starting, sharing(), contextlib.redirect_stdout(io.StringIO()):  # stdout is the command line's, not for viser's banner
        serve = websockets.asyncio.server.serve
        websockets.asyncio.server.serve = functools.partial(serve, origins=origins)  # type: ignore[misc,assignment]
        try:
            return viser.ViserServer(host=HOST, port=port, label=label, verbose=False)
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]


def _close_tunnel(server: viser.ViserServer) -> None:
    """No client may open a public tunnel to this machine."""
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(message)


def _check_values(server: viser.ViserServer) -> None:
    """Let clients set nothing but the values of controls, and only to values that make sense as such."""
    handlers = server._websock_server._incoming_handlers
    accepted = handlers[_messages.GuiUpdateMessage]

    def checked(handler: Callable[[int, Any], Any]) -> Callable[[int, Any], Any]:
        async def handle(client_id: int, message: Any) -> None:
            if set(message.updates) == {"value"} and all(map(_sane, _leaves(message.updates["value"]))):
                try:
                    await handler(client_id, message)
                except (TypeError, ValueError, OverflowError) as error:  # a value that does not fit its control
                    log.warning("refused a value from client %s: %s", client_id, error)
            else:
                log.warning("refused an update from client %s: %.100r", client_id, message.updates)

        return handle

    handlers[_messages.GuiUpdateMessage] = [checked(handler) for handler in accepted]


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, list | tuple):
        for item in value:
            yield from _leaves(item)
    else:
        yield value


def _sane(value: Any) -> bool:
    if isinstance(value, str):
        return len(value) <= LONGEST_TEXT
    return isinstance(value, bool) or (isinstance(value, int | float) and math.isfinite(value))
