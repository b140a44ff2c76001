"""Traversal of documents: their values together with the types of these and the marks of the types."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, NamedTuple, TypeVar, Union, get_args, get_origin

from pydantic import Discriminator, Tag
from pydantic.fields import FieldInfo

from mechviz.scene.fields import DocumentTable

Place = tuple[str | int, ...]
"""A place in a document: keys of tables, indices of lists."""

T = TypeVar("T")


class Leaf(NamedTuple):
    """A value of a document that holds no others: its place, the value, its type (``kind``), and the marks of the type."""

    path: Place
    value: Any
    kind: Any
    marks: list[Any]

    def mark(self, mark_type: type[T]) -> T | None:
        """The first of its marks of a type; None where there is none."""
        return next((mark for mark in self.marks if isinstance(mark, mark_type)), None)


@cache
def hints_of(cls: type[DocumentTable]) -> dict[str, Any]:
    """The types of the keys of a table, with their marks."""
    return {
        key: Annotated[info.annotation, *info.metadata] if info.metadata else info.annotation
        for key, info in cls.model_fields.items()
    }


def peel(annotation: object, value: object) -> tuple[Any, list[Any]]:
    """The type under ``Annotated``, ``| None`` and unions, and the marks on the way. The value, plain or validated, selects the
    branch of a union."""
    marks: list[Any] = []
    while True:
        origin = get_origin(annotation)
        if origin is Annotated:
            annotation, *own = get_args(annotation)
            marks += [inner for mark in own for inner in (mark.metadata if isinstance(mark, FieldInfo) else (mark,))]
            choice = next((mark for mark in own if isinstance(mark, Discriminator)), None)
            if choice is not None and callable(choice.discriminator):
                tag = choice.discriminator(value)
                branches = get_args(annotation)
                annotation = next((m for m in branches if Tag(str(tag)) in get_args(m)[1:]), branches[0])
        elif origin in (Union, UnionType) and len(members := [m for m in get_args(annotation) if m is not NoneType]) == 1:
            annotation = members[0]
        else:
            return annotation, marks


def inner_types(kind: object, count: int) -> list[Any]:
    """The types of ``count`` entries of a list or tuple type."""
    inner = get_args(kind) or (Any,)
    row = get_origin(kind) is list or inner[1:] == (...,)
    return [inner[0 if row else min(k, len(inner) - 1)] for k in range(count)]


def stated_keys(table: DocumentTable, among: Iterable[str] | None = None) -> Iterable[str]:
    """The keys of a table, or those ``among`` some, that are stated and not None."""
    stated = table.model_fields_set
    return [
        key for key in (type(table).model_fields if among is None else among) if key in stated and getattr(table, key) is not None
    ]


def leaves(
    value: object, keys: Callable[[DocumentTable], Iterable[str]] = stated_keys, annotation: object = None, path: Place = ()
) -> Iterator[Leaf]:
    """The leaves of a document, or of one of its tables, in order; ``keys`` selects the keys of a table that are visited."""
    kind, marks = peel(annotation, value)
    if isinstance(value, DocumentTable):
        for key in keys(value):
            yield from leaves(getattr(value, key), keys, hints_of(type(value))[key], (*path, key))
    elif isinstance(value, Mapping):
        for name, item in value.items():
            yield from leaves(item, keys, get_args(kind)[1], (*path, name))
    elif isinstance(value, list | tuple):
        for k, (item, each) in enumerate(zip(value, inner_types(kind, len(value)), strict=True)):
            yield from leaves(item, keys, each, (*path, k))
    else:
        yield Leaf(path, value, kind, marks)


def leaf_at(value: Any, place: Place) -> Leaf:
    """The value at a place of a document."""
    annotation: Any = None
    for part in place:
        kind, _ = peel(annotation, value)
        if isinstance(value, DocumentTable):
            annotation, value = hints_of(type(value))[str(part)], getattr(value, str(part))
        else:
            annotation = get_args(kind)[1] if isinstance(value, Mapping) else inner_types(kind, len(value))[int(part)]
            value = value[part]
    return Leaf(place, value, *peel(annotation, value))


def raw_leaves(raw: object, annotation: object, path: Place = ()) -> Iterator[Leaf]:
    """The leaves of plain data that is to be read as a type; values for which the type has no place are left out."""
    kind, marks = peel(annotation, raw)
    origin = get_origin(kind)
    if isinstance(raw, Mapping) and isinstance(kind, type) and issubclass(kind, DocumentTable):
        hints = hints_of(kind)
        for key in raw.keys() & hints.keys():
            yield from raw_leaves(raw[key], hints[key], (*path, key))
    elif isinstance(raw, Mapping) and origin is dict:
        for name, item in raw.items():
            yield from raw_leaves(item, get_args(kind)[1], (*path, name))
    elif isinstance(raw, list | tuple) and origin in (list, tuple):
        for k, (item, each) in enumerate(zip(raw, inner_types(kind, len(raw)), strict=True)):
            yield from raw_leaves(item, each, (*path, k))
    elif not isinstance(raw, Mapping | list | tuple):
        yield Leaf(path, raw, kind, marks)


def stated_value(value: Any, path: Iterable[str | int]) -> Any:
    """The value that is stated at a place of a document or of plain data, None where there is none."""
    for part in path:
        if isinstance(value, DocumentTable):
            value = getattr(value, str(part)) if part in value.model_fields_set else None
        elif isinstance(value, Mapping):
            value = value.get(part)
        elif isinstance(value, list | tuple) and isinstance(part, int) and part < len(value):
            value = value[part]
        else:
            return None
    return value


def replaced(value: Any, changes: Mapping[Place, Any]) -> Any:
    """A document, or a part of it, with other values at some places; nothing is validated."""
    if () in changes:
        return changes[()]
    inner: dict[str | int, dict[Place, Any]] = {}
    for place, new in changes.items():
        inner.setdefault(place[0], {})[place[1:]] = new
    if isinstance(value, DocumentTable):
        copy = value.model_copy(update={str(key): replaced(getattr(value, str(key)), change) for key, change in inner.items()})
        copy.mark_invalid(value.invalid_keys)
        return copy
    if isinstance(value, Mapping):
        return {**value, **{key: replaced(value[key], change) for key, change in inner.items()}}
    return [replaced(item, inner[k]) if k in inner else item for k, item in enumerate(value)]
