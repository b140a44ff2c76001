"""Other values in a scene document: only the tables on the way to them are made and validated anew."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .document import SceneDocument
from .tables import Table

__all__ = ["Place", "stated", "value_at", "with_values"]

Place = tuple[str | int, ...]
"""A place in a document: keys of tables, indices of lists."""


def value_at(value: Any, path: Place) -> Any:
    """The value at a place of a document, or of plain data. Raises `LookupError` or `AttributeError` where there is none."""
    for part in path:
        value = getattr(value, str(part)) if isinstance(value, Table) else value[part]
    return value


def stated(table: Table) -> dict[str, Any]:
    """The keys of a table that are stated, with their values as they are; the document's tables, not plain data."""
    return {key: getattr(table, key) for key in type(table).model_fields if key in table.model_fields_set}


def with_values(value: Any, changes: Mapping[Place, Any]) -> Any:
    """A document (or a part of it, or plain data) with other values at some places; None leaves a key out.

    A list of the scene that is not stated, such as gravity, is the default one with one value changed. Raises pydantic's
    `ValidationError` where a table of the document would not be valid.
    """
    if () in changes:
        return changes[()]
    inner: dict[str | int, dict[Place, Any]] = {}
    for path, new in changes.items():
        inner.setdefault(path[0], {})[path[1:]] = new
    if isinstance(value, list | tuple):
        items = list(value)
        for k, change in inner.items():
            items[int(k)] = with_values(items[int(k)], change)
        return items
    entries = stated(value) if isinstance(value, Table) else dict(value or {})
    for key, change in inner.items():
        old = getattr(value, str(key)) if isinstance(value, Table) else entries.get(str(key))
        if old is None and () not in change and any(isinstance(path[0], int) for path in change):
            old = SceneDocument.model_fields[str(key)].default
        new = with_values(old, change)
        if new is None:
            entries.pop(str(key), None)
        else:
            entries[str(key)] = new
    return type(value).model_validate(entries) if isinstance(value, Table) else entries
