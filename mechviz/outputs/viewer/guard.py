"""Which messages of browsers the viewer takes: those that its own page sends, by kind, field, size and control. viser believes all.

What is refused is dropped and counted; nothing is kept of it, and it is not answered.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec
import viser

MOST_BYTES = 1 << 16  # of a message
LONGEST_TEXT = 1000
LONGEST_NAME = 300  # of a node, or of a control in the page
LARGEST = 1e15  # of a number: what a slider of whole numbers takes must fit into 64 bits
MOST_PIXELS = 1e5
NEARLY_ONE = 1e-3

Check = Callable[[Any], bool]

log = logging.getLogger("mechviz.outputs.viewer")


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and abs(value) <= LARGEST


def is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= LONGEST_TEXT


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= LONGEST_NAME


def _is_vector(length: int) -> Check:
    return lambda value: isinstance(value, list) and len(value) == length and all(map(is_number, value))


def _is_direction(value: Any) -> bool:
    return _is_vector(3)(value) and any(value)


def _is_turn(value: Any) -> bool:
    return _is_vector(4)(value) and abs(math.hypot(*value) - 1.0) < NEARLY_ONE


def _is_extent(value: Any) -> bool:
    return is_number(value) and 0 <= value <= MOST_PIXELS


def _or_none(check: Check) -> Check:
    return lambda value: value is None or check(value)


def _is_update(value: Any) -> bool:
    return isinstance(value, dict) and set(value) == {"value"}


# by kind, the fields that it has; ``owner`` says whose node it is, and may be missing
KINDS: Mapping[str, Mapping[str, Check]] = {
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
    "TransformControlsUpdateMessage": {"name": _is_name, "owner": _is_name, "wxyz": _is_turn, "position": _is_vector(3)},
    "TransformControlsDragStartMessage": {"name": _is_name, "owner": _is_name},
    "TransformControlsDragEndMessage": {"name": _is_name, "owner": _is_name},
    "LocalStorageGetItemResponseMessage": {"request_uuid": _is_name, "value": _or_none(is_text), "error": _or_none(is_text)},
}


def is_value(control: Any, value: Any) -> bool:
    """Whether a page of ours can give this value to a control. Sliders take numbers beyond their ends, which can be typed."""
    if isinstance(control, viser.GuiSliderHandle):
        return is_number(value)
    if isinstance(control, viser.GuiCheckboxHandle | viser.GuiButtonHandle):
        return isinstance(value, bool)
    if isinstance(control, viser.GuiDropdownHandle | viser.GuiButtonGroupHandle):
        return isinstance(value, str) and value in control.options
    return isinstance(control, viser.GuiTextHandle) and is_text(value)


@dataclass
class Guard:
    """Decides on messages. ``control(uuid)`` and ``node(name)`` give what they are about, None if it is not there;
    ``admitted(control)`` is told before a control gets another value; ``dropped`` counts what was refused, by reason."""

    control: Callable[[str], Any] = lambda uuid: None
    node: Callable[[str], Any] = lambda name: None
    admitted: Callable[[Any], None] = lambda control: None
    dropped: Counter[str] = field(default_factory=Counter)

    def admits(self, data: bytes) -> bool:
        """Whether a message is one that a page of ours can send now."""
        reason = self._reason(data)
        if reason:
            self.dropped[reason] += 1
            count = self.dropped[reason]
            if math.log10(count).is_integer():  # the 1st, 10th, 100th ...: a flood of messages is no flood of lines
                log.warning("refused from a browser: %s (%d so far)", reason, count)
        return not reason

    def _reason(self, data: bytes) -> str:
        """Why a message is refused; empty if it is not."""
        if len(data) > MOST_BYTES:
            return "a message that is too long"
        try:
            message = msgspec.msgpack.decode(data)
        except (msgspec.DecodeError, ValueError, RecursionError):
            return "a message that cannot be read"
        if not isinstance(message, dict) or not isinstance(kind := message.pop("type", None), str) or kind not in KINDS:
            return "a message of a kind that no page of the viewer sends"
        fields = KINDS[kind]
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
