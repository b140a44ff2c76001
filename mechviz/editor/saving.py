"""Saving of an edited scene into the text from which it was read: only values that differ are written, comments and layout stay.

The result is read back and accepted only if it is equal to the edited scene.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import tomlkit
from tomlkit.container import Container
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Comment, InlineTable, Item, Null, Table, Whitespace

from mechviz.scene.faults import SceneError
from mechviz.scene.reading.text import toml_text, value_text
from mechviz.scene.scene import Scene, loads


class _MissingError(Exception):
    """A value is not where it should be in the text."""


def updated_text(opened: Scene, scene: Scene) -> str | None:
    """The text of ``opened`` with the values of ``scene``, an edited copy of it; None where that text cannot express them."""
    if not opened.text:
        return None
    before, after = (_as_written(opened, s) for s in (opened, scene))
    text = patched(opened.text, before, after)
    try:
        return text if text is not None and loads(text, scene.name, scene.folder) == scene else None
    except SceneError:
        return None


def saved_scene(opened: Scene, scene: Scene) -> tuple[Scene, bool]:
    """An edited scene with the text to be saved, and whether that is the text of ``opened`` with other values. The text has been
    read back, so that it is known to be a valid scene."""
    text = updated_text(opened, scene)
    if text is None:
        loads(scene.to_toml(), scene.name, scene.folder)
    return replace(scene, source=text), text is not None


def _as_written(opened: Scene, scene: Scene) -> dict[str, Any]:
    """The document of a scene as plain data, with the names of keys in the text of ``opened``."""
    return {opened.former_keys.get(key, key): value for key, value in scene.document.to_data().items()}


def patched(text: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> str | None:
    """TOML ``text`` of the data ``before``, changed to express ``after``; None where a changed value cannot be found in it."""
    try:
        document = tomlkit.parse(text)
        _change_table(document, before, after)
        return tomlkit.dumps(document)
    except (_MissingError, TOMLKitError):
        return None


def _change_table(table: Any, before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
    """Write the differences in a table: changed values in their places, new ones after the last."""
    for key, old in before.items():
        if key in after and after[key] == old:
            continue
        if key not in table:
            raise _MissingError(key)
        if key in after:
            _change_value(table, key, old, after[key])
        else:
            _remove(table, key)
    new = {key: value for key, value in after.items() if key not in before}
    sections = {key: value for key, value in new.items() if isinstance(table, Container) and isinstance(value, Mapping)}
    for key, value in new.items():
        if key not in sections:
            _add(table, key, value)
    if sections:  # tables of the scene, with headers of their own
        tail = Whitespace(("" if tomlkit.dumps(table).endswith("\n") else "\n") + "\n" + toml_text(sections))
        table.append(None, tail)


def _change_value(table: Any, key: Any, before: Any, after: Any) -> None:
    """Write the differences in the value of a key, or of a place in an array."""
    item = table[key]
    if isinstance(before, Mapping) and isinstance(after, Mapping) and isinstance(item, Mapping):
        _change_table(item, before, after)
    elif isinstance(before, list | tuple) and isinstance(after, list | tuple) and isinstance(item, list):
        if len(before) == len(after) == len(item):
            for k, (old, value) in enumerate(zip(before, after, strict=True)):
                if old != value:
                    _change_value(item, k, old, value)
        elif isinstance(item, AoT):
            raise _MissingError(key)
        else:
            table[key] = tomlkit.value(value_text(after))
    elif isinstance(item, Table | AoT):
        raise _MissingError(key)
    else:
        table[key] = tomlkit.value(value_text(after))


def _body(table: object) -> list[tuple[Any, Item]]:
    """The entries of a table with their comments. Raises `_MissingError` where its parts are separate in the text."""
    if isinstance(table, Container):
        return table.body
    if isinstance(table, Table | InlineTable):
        return table.value.body
    raise _MissingError


def _take_tail(body: list[tuple[Any, Item]]) -> str:
    """Remove the comments and blank lines at the end of some entries, which belong to what follows, and return them."""
    tail = ""
    for k in range(len(body) - 1, -1, -1):
        key, item = body[k]
        if key is not None:
            inner = item[-1] if isinstance(item, AoT) else item
            return (_take_tail(inner.value.body) if isinstance(inner, Table) else "") + tail
        if isinstance(item, Comment | Whitespace):
            tail = item.as_string() + tail
            body[k] = (None, Null())
    return tail


def _remove(table: Any, key: str) -> None:
    """Remove a key: its line, its part of an inline table, or all its sections."""
    item, body = table[key], _body(table)
    place = next((k for k, (name, _) in enumerate(body) if name is not None and name.key == key), None)
    if place is None:
        raise _MissingError(key)
    tail = _take_tail(body[: place + 1]) if isinstance(item, Table | AoT) else ""
    table.remove(key)
    if tail:
        body[place] = (None, Whitespace(tail))
    elif isinstance(table, InlineTable) and place and isinstance(body[place - 1][1], Whitespace):
        body[place - 1] = (None, Null())


def _add(table: Any, key: str, value: Any) -> None:
    """Write a new key after the last plain one of a table."""
    item, body = tomlkit.value(value_text(value)), _body(table)
    if isinstance(table, InlineTable):
        blank = body.pop() if body and isinstance(body[-1][1], Whitespace) else None
        table.append(key, item)
        body += [blank] if blank else []
        return
    first = next((k for k, (_, item) in enumerate(body) if isinstance(item, Table | AoT)), len(body))
    entries = body[:first]
    item.trivia.trail = "\n" + _take_tail(entries)
    body[:first] = entries
    table.append(key, item)
