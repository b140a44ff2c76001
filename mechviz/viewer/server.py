"""A viser server that only this machine's own pages can talk to, and that stays up when a callback or a client misbehaves.

viser 1.1.1 by itself listens on all interfaces, accepts a web socket from any web site that the user has open, lets any client ask
for a public tunnel, moves on silently to another port, waits for ever on a port that it may not use, and passes on whatever
values a client sends. The guards here reach into that version; the project pins it.
"""

from __future__ import annotations

import contextlib
import functools
import io
import logging
import math
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import viser
import websockets.asyncio.server
from viser import _messages
from websockets.typing import Origin

from .broadcast import sharing

__all__ = ["HOST", "ViewerError", "report", "safely", "start_server", "stop_server"]

HOST = "127.0.0.1"
ATTEMPTS = 5  # for a free port: another program may take it between the probe and the start
LONGEST_TEXT = 1000
MESSAGES_IN_ONE_PIECE = 4096  # poses of one frame must arrive together; viser's own limit is 128

log = logging.getLogger("mechviz.viewer")
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
