"""The viewer's server: on this machine only, guarded against other sites and against messages that no page of ours sends."""

from __future__ import annotations

import contextlib
import io
import logging
import socket
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import viser
import websockets.asyncio.server
from websockets.typing import Origin

from mechviz.outputs.viewer.callbacks import Changes
from mechviz.outputs.viewer.guard import MOST_BYTES, Guard
from mechviz.outputs.viewer.viser_adapter import control_of, replaced, start

HOST = "127.0.0.1"
ATTEMPTS = 5  # for a free port: another program may take it between the probe and the start
LONGEST_TEXT = 1000

# The page of viser holds all that it needs. Nothing else is loaded, whatever a scene or a recording says.
POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:",
        "worker-src 'self' blob:",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data: blob:",
        "font-src 'self' data:",
        "connect-src 'self' data: blob: ws://{host}:{port} ws://localhost:{port}",
        "base-uri 'none'",
        "form-action 'none'",
    )
)

log = logging.getLogger("mechviz.outputs.viewer")
_starting = threading.Lock()


class ViewerError(Exception):
    """The viewer cannot start. Says why, and what to do."""


def start_server(port: int, label: str) -> tuple[viser.ViserServer, Guard]:
    """A server on 127.0.0.1, and what guards it. ``port`` 0 takes a free one. Raises `ViewerError` if the port cannot be had."""
    for _ in range(ATTEMPTS):
        probed = _probe(port)
        server, guard = _start_guarded(probed, label)
        if server.get_port() == probed:
            return server, guard
        stop_server(server)  # it moved to another port, for which the origins are wrong
        if port:
            break
    raise ViewerError(f"Port {port} was taken by another program during the start. Choose another with --port, or --port 0.")


def stop_server(server: viser.ViserServer) -> None:
    """Stop without viser's words on stdout."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def safely(server: viser.ViserServer, changes: Changes, what: str, action: Callable[[Any], None]) -> Callable[[Any], Any]:
    """A callback for viser that runs ``action(event)`` in the order of the events; a failure is logged, shown and undone.

    Events that the program itself causes by setting a value have no client and are ignored.
    """

    async def callback(event: Any) -> None:
        if event.client is None:
            return
        try:
            changes.run(action, event)
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


def _start_guarded(port: int, label: str) -> tuple[viser.ViserServer, Guard]:
    """Start viser with a `Guard`, with a list of the origins whose pages may open its web socket (no origin at all is no browser),
    and with a policy for its page."""
    origins = [None, Origin(f"http://{HOST}:{port}"), Origin(f"http://localhost:{port}")]
    policy = POLICY.format(host=HOST, port=port)
    serve: Any = websockets.asyncio.server.serve

    def guarded(*args: Any, process_request: Any, **options: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            response = process_request(connection, request)
            if response is not None:
                response.headers["Content-Security-Policy"] = policy
            return response

        return serve(*args, process_request=answer, **options | {"origins": origins, "max_size": MOST_BYTES})

    guard = Guard()
    silent = contextlib.redirect_stdout(io.StringIO())  # stdout is the command line's, not for viser's banner
    with _starting, silent, replaced(websockets.asyncio.server, "serve", guarded):
        server = start(HOST, port, label, guard.admits)
    guard.control, guard.node = partial(control_of, server), server.scene.get_handle_by_name
    return server, guard
