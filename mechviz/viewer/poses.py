"""Poses of many nodes of the scene in one go.

viser's setters take some fifty microseconds a value, most of it to find out whether it is another one. Here all values of a frame
are compared as arrays with what the nodes have, and only nodes that moved get a message. The nodes' own state stays right, and
viser keeps the newest message of each node for browsers that come later, as it does with its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from viser import _messages

__all__ = ["Posed", "place"]

Posed = tuple[viser.SceneNodeHandle, NDArray[Any], NDArray[Any] | None]
"""A node, its place (3,) [m] and its turn (4,) as a quaternion w, x, y, z, None if it does not turn."""

LEAST = 1e-10  # [m, or of a quaternion]: less than this is round-off, and far from being seen


class _Place(_messages.SetPositionMessage):
    """viser's message, which says at once what it consists of."""

    def redundancy_key(self) -> str:
        return f"scene:{self.name}:update:SetPositionMessage"

    def as_serializable_dict(self, binary_buffers: list[memoryview] | None = None) -> dict[str, Any]:
        return {"name": self.name, "position": self.position, "owner": self.owner, "type": "SetPositionMessage"}


class _Turn(_messages.SetOrientationMessage):
    """viser's message, which says at once what it consists of."""

    def redundancy_key(self) -> str:
        return f"scene:{self.name}:update:SetOrientationMessage"

    def as_serializable_dict(self, binary_buffers: list[memoryview] | None = None) -> dict[str, Any]:
        return {"name": self.name, "wxyz": self.wxyz, "owner": self.owner, "type": "SetOrientationMessage"}


def place(server: viser.ViserServer, poses: Iterable[Posed]) -> int:
    """Bring nodes of the server's scene to their poses; the number of messages that this takes."""
    nodes = list(poses)
    turning = [(node, turn) for node, _, turn in nodes if turn is not None]
    messages: list[Any] = [
        _Turn(node._impl.name, values)
        for node, values in _moved([n for n, _ in turning], [n._impl.wxyz for n, _ in turning], [t for _, t in turning])
    ]
    messages += [
        _Place(node._impl.name, values)
        for node, values in _moved([n for n, _, _ in nodes], [n._impl.position for n, _, _ in nodes], [p for _, p, _ in nodes])
    ]
    _queue(server, messages)
    return len(messages)


def _moved(
    nodes: list[viser.SceneNodeHandle], before: list[NDArray[Any]], after: list[NDArray[Any]]
) -> list[tuple[viser.SceneNodeHandle, Any]]:
    """The nodes of which a state is another now, with that as a tuple; the state itself becomes it."""
    if not nodes:
        return []
    new = np.array(after, float)
    moved = (np.abs(new - np.array(before)) > LEAST).any(axis=1)
    values = new.tolist()
    found = []
    for k in np.flatnonzero(moved & np.isfinite(new).all(axis=1)):  # viser draws nothing at all of what is not a number
        if not nodes[k]._impl.removed:
            before[k][:] = values[k]
            found.append((nodes[k], tuple(values[k])))
    return found


def _queue(server: viser.ViserServer, messages: list[Any]) -> None:
    """Queue messages for all browsers as viser's `queue_message` does one by one: with one lock, and one signal, for all."""
    if not messages:
        return
    connections = server._websock_server
    buffer = connections._broadcast_buffer
    with connections._record_lock:
        for handle in connections._record_handles:
            for message in messages:
                handle._insert_message(message)
        with buffer.buffer_lock:
            for message in messages:
                key, owner = message.redundancy_key(), ("scene", message.name)
                number = buffer.message_counter
                buffer.message_counter += 1
                old = buffer.id_from_redundancy_key.get(key)
                states = buffer.ids_from_entity_state_key.setdefault(owner, set())
                if old is not None:
                    buffer.message_from_id.pop(old, None)
                    states.discard(old)
                states.add(number)
                buffer.message_from_id[number] = message
                buffer.id_from_redundancy_key[key] = number
            buffer.message_event.set()
    buffer.atomic_start()
    buffer.atomic_end()  # wakes the thread that talks to the browsers, unless more is to come in the same piece
