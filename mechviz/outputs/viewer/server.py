"""The viewer's server: on this machine only, guarded against other sites and against messages that no page of ours sends."""

from __future__ import annotations

import contextlib
import io
import logging
import math
import socket
import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import partial
from typing import Any

import msgspec
import numpy as np
import viser
import websockets.asyncio.server
from websockets.typing import Origin

from mechcore.errors import MechanismError
from mechcore.numerics.frames import share_memory
from mechcore.records import dataclass
from mechviz.outputs.viewer.viser_adapter import attribute_replaced, control_of, is_removed, start

HOST = "127.0.0.1"
PORT_ATTEMPTS = 5  # for a free port: another program may take it between the probe and the start

# viser's page contains everything that it needs. Nothing else is loaded, whatever a scene or a recording contains.
CONTENT_POLICY = "; ".join(
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
    """The viewer cannot start. The message states why, and the remedy."""


def start_server(port: int, label: str) -> tuple[viser.ViserServer, Guard]:
    """A server on 127.0.0.1, and its guard. ``port`` 0 takes a free port. Raises `ViewerError` if the port cannot be used."""
    share_memory()
    for _ in range(PORT_ATTEMPTS):
        probed = _probe(port)
        server, guard = _start_guarded(probed, label)
        if server.get_port() == probed:
            return server, guard
        stop_server(server)  # viser took another port, for which the allowed origins are wrong
        if port:
            break
    raise ViewerError(f"Port {port} was taken by another program during the start. Choose another with --port, or --port 0.")


def stop_server(server: viser.ViserServer) -> None:
    """Stop the server without viser's messages on stdout."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def safely(server: viser.ViserServer, changes: ControlChanges, what: str, action: Callable[[Any], None]) -> Callable[[Any], Any]:
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
    """Log a failure, or a refusal with its remedy, and show it as a notification in the client's browser, or in all browsers."""
    if isinstance(error, MechanismError):
        title, words = "Not possible", str(error)
        log.warning("%s is not possible: %s", what, error)
    else:
        title, words = f"{what} failed", f"{type(error).__name__}: {error}"
        log.error(title, exc_info=error)
    for who in [client] if client is not None else list(server.get_clients().values()):
        with contextlib.suppress(Exception):  # the browser may have disconnected; the log has the message
            who.add_notification(title, words[:LONGEST_TEXT], color="red", auto_close_seconds=15.0)


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
    """Start viser with a `Guard`, a list of the origins whose pages may open its web socket (None: a client that is not a browser),
    and a content security policy for its page."""
    origins = [None, Origin(f"http://{HOST}:{port}"), Origin(f"http://localhost:{port}")]
    policy = CONTENT_POLICY.format(host=HOST, port=port)
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
    with _starting, silent, attribute_replaced(websockets.asyncio.server, "serve", guarded):
        server = start(HOST, port, label, guard.admits)
    guard.control, guard.node = partial(control_of, server), server.scene.get_handle_by_name
    return server, guard


# -- messages of browsers ---------------------------------------------------------------------------------------------
MOST_BYTES = 1 << 16  # of a message
LONGEST_TEXT = 1000  # characters of a text of one line
LONGEST_TABLE = 60_000  # characters of a text of several lines
LONGEST_NAME = 300  # characters of the name of a node, or of a control in the page
LARGEST_NUMBER = 1e15  # values of a slider of integers must fit into 64 bits
MOST_PIXELS = 1e5  # width and height of a picture
NORM_TOLERANCE = 1e-3  # tolerance of the norm of a quaternion

FieldCheck = Callable[[Any], bool]


def is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and abs(value) <= LARGEST_NUMBER


def is_text(value: object) -> bool:
    return isinstance(value, str) and len(value) <= LONGEST_TEXT


def _is_name(value: object) -> bool:
    return isinstance(value, str) and len(value) <= LONGEST_NAME


def _is_vector(length: int) -> FieldCheck:
    return lambda value: isinstance(value, list) and len(value) == length and all(map(is_number, value))


def _is_direction(value: Any) -> bool:
    return _is_vector(3)(value) and any(value)


def _is_turn(value: Any) -> bool:
    return _is_vector(4)(value) and abs(math.hypot(*value) - 1.0) < NORM_TOLERANCE


def _is_extent(value: Any) -> bool:
    return is_number(value) and 0 <= value <= MOST_PIXELS


def _or_none(check: FieldCheck) -> FieldCheck:
    return lambda value: value is None or check(value)


def _is_update(value: object) -> bool:
    return isinstance(value, dict) and set(value) == {"value"}


# the fields of each kind of message; ``owner``, whose node it is, may be missing
MESSAGE_FIELDS: Mapping[str, Mapping[str, FieldCheck]] = {
    "ViewerCameraMessage": {
        "wxyz": _is_turn,
        "position": _is_vector(3),
        "look_at": _is_vector(3),
        "up_direction": _is_direction,
        "fov": is_number,
        "near": is_number,
        "far": is_number,
        "image_height": _is_extent,
        "image_width": _is_extent,
    },
    "GuiUpdateMessage": {"uuid": _is_name, "updates": _is_update},
    "CommandTriggerMessage": {"uuid": _is_name},
    "SceneNodeClickMessage": {
        "name": _is_name,
        "owner": _is_name,
        "instance_index": _or_none(is_number),
        "ray_origin": _is_vector(3),
        "ray_direction": _is_direction,
        "screen_pos": _is_vector(2),
        "modifier": _or_none(_is_name),
    },
    "SceneNodeDragMessage": {
        "phase": lambda value: value in ("start", "update", "end"),
        "name": _is_name,
        "owner": _is_name,
        "instance_index": _or_none(is_number),
        "start_position": _is_vector(3),
        "start_screen_pos": _is_vector(2),
        "end_position": _is_vector(3),
        "end_screen_pos": _is_vector(2),
        "button": lambda value: value == "left",
        "modifier": _or_none(_is_name),
    },
    "TransformControlsUpdateMessage": {"name": _is_name, "owner": _is_name, "wxyz": _is_turn, "position": _is_vector(3)},
    "TransformControlsDragStartMessage": {"name": _is_name, "owner": _is_name},
    "TransformControlsDragEndMessage": {"name": _is_name, "owner": _is_name},
    "LocalStorageGetItemResponseMessage": {"request_uuid": _is_name, "value": _or_none(is_text), "error": _or_none(is_text)},
}


def is_value(control: object, value: object) -> bool:
    """Whether our page can give this value to a control. Sliders accept numbers beyond their ends, since values can be typed."""
    if isinstance(control, viser.GuiSliderHandle):
        return is_number(value)
    if isinstance(control, viser.GuiCheckboxHandle | viser.GuiButtonHandle):
        return isinstance(value, bool)
    if isinstance(control, viser.GuiDropdownHandle | viser.GuiButtonGroupHandle):
        return isinstance(value, str) and value in control.options
    if not isinstance(control, viser.GuiTextHandle) or not isinstance(value, str):
        return False
    return len(value) <= (LONGEST_TABLE if control.multiline else LONGEST_TEXT)


@dataclass
class Guard:
    """Accepts or refuses messages of browsers. ``control(uuid)`` and ``node(name)`` return what a message refers to, None if that
    does not exist; ``admitted(control)`` is called before a control takes a new value; ``dropped`` counts refusals by reason."""

    control: Callable[[str], Any] = lambda uuid: None
    node: Callable[[str], Any] = lambda name: None
    admitted: Callable[[Any], None] = lambda control: None
    dropped: Counter[str] = field(default_factory=Counter)

    def admits(self, data: bytes) -> bool:
        """Whether a message is one that our page can send now."""
        reason = self._reason(data)
        if reason:
            self.dropped[reason] += 1
            count = self.dropped[reason]
            if math.log10(count).is_integer():  # the 1st, 10th, 100th ...: many messages do not make many lines of the log
                log.warning("refused from a browser: %s (%d so far)", reason, count)
        return not reason

    def _reason(self, data: bytes) -> str:
        """Why a message is refused; empty if it is accepted."""
        if len(data) > MOST_BYTES:
            return "a message that is too long"
        try:
            message = msgspec.msgpack.decode(data)
        except (msgspec.DecodeError, ValueError, RecursionError):
            return "a message that cannot be read"
        if not isinstance(message, dict) or not isinstance(kind := message.pop("type", None), str) or kind not in MESSAGE_FIELDS:
            return "a message of a kind that no page of the viewer sends"
        fields = MESSAGE_FIELDS[kind]
        missing, unknown = set(fields) - set(message) - {"owner"}, set(message) - set(fields)
        if missing or unknown or not all(fields[name](value) for name, value in message.items()):
            return f"{kind} with fields that no page of the viewer sends"
        if kind == "ViewerCameraMessage" and message["position"] == message["look_at"]:
            return "a camera that looks nowhere"
        if kind == "GuiUpdateMessage":
            control = self.control(message["uuid"])
            if not is_value(control, message["updates"]["value"]):
                return "a value that does not fit its control"
            self.admitted(control)
        if "name" in message and self.node(message["name"]) is None:
            return "a message about something that is not in the picture"
        return ""


# -- callbacks --------------------------------------------------------------------------------------------------------
Callback = Callable[[str, Callable[[Any], None]], Callable[[Any], Any]]
"""``callback(what, action)`` returns a callback for viser that runs ``action(event)``; the name ``what`` is shown with failures."""


def finite(value: Any, low: float, high: float, otherwise: float) -> float:
    """A number from a browser, clipped to [low, high]; anything but a finite number becomes ``otherwise``."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return otherwise
    return float(np.clip(number, low, high)) if np.isfinite(number) else otherwise


WITH_STATE = (viser.GuiCheckboxHandle, viser.GuiSliderHandle, viser.GuiDropdownHandle, viser.GuiTextHandle)


@dataclass(eq=False)
class ControlChange:
    """A control that a browser has set, its value before, and the action of its callback, None until that has run."""

    control: Any
    before: Any
    action: Callable[[], None] | None = None

    def undo(self) -> None:
        """Restore the value, and run the action again; the value of a control that has been removed is ignored."""
        with contextlib.suppress(RuntimeError):
            self.control.value = self.before
        if self.action is not None:
            self.action()


class ControlChanges:
    """Changes of controls by browsers since the last complete drawing. If the callback or the drawing fails, the change is undone,
    so that the next drawing does not fail as well."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: dict[int, ControlChange] = {}  # by control

    def remember(self, control: object) -> None:
        """Note the value of a control before a browser sets it. Of several changes, the value before the first counts; changes of
        removed controls are dropped."""
        if isinstance(control, WITH_STATE):
            with self._lock:
                self._open = {key: change for key, change in self._open.items() if not is_removed(change.control)}
                change = self._open.get(id(control))
                if change is None or change.action is None:
                    self._open[id(control)] = ControlChange(control, control.value)

    def run(self, action: Callable[[Any], None], event: object) -> None:
        """Run the action of a callback; if it fails, undo the change of its control and raise the error again."""
        with self._lock:
            change = self._open.get(id(getattr(event, "target", None)))
            if change is not None:
                change.action = lambda: action(event)
        try:
            action(event)
        except Exception:
            if change is not None:
                self._undo([change])
            raise

    def open(self) -> Sequence[ControlChange]:
        """The changes that the next drawing will show."""
        with self._lock:
            return [change for change in self._open.values() if change.action is not None]

    def accept(self, changes: Sequence[ControlChange]) -> None:
        """Drop changes, which have been drawn."""
        with self._lock:
            for change in changes:
                self._open.pop(id(change.control), None)

    def undo(self) -> bool:
        """Undo the changes that have not been drawn; return whether there were any."""
        changes = self.open()
        self._undo(changes)
        return bool(changes)

    def _undo(self, changes: Sequence[ControlChange]) -> None:
        self.accept(changes)
        for change in reversed(changes):
            try:
                change.undo()
            except Exception as error:
                log.error("undoing a change failed", exc_info=error)
