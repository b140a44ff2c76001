"""Reading what is sound of a faulty scene: part by part, each fault noted where it is, a stand-in in its place.

A number that could not be read becomes NaN, a name ``Unknown``; every check that meets them passes over them. A key that
is misspelt counts as the one that was meant, and a word as the nearest known one, so that nothing looks missing that is
only misspelt.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from annotated_types import MaxLen, MinLen
from pydantic import Discriminator, PlainValidator, Tag, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from mechcore.errors import Fault

from .faults import closest
from .fields import Quantity, UnitName
from .tables import Table, Unknown
from .wording import Loc, meant_keys, missing_key, misspelt, path_text, unknown_key, words_of

__all__ = ["Meant", "read_table"]

_NOTHING = object()
_BRANCHES = frozenset(("<list>", "<name>", "<table>", "<value>"))  # all tags of the document: other names may look like them
_adapters: dict[int, tuple[Any, TypeAdapter[Any]]] = {}
_hints: dict[type[Table], dict[str, Any]] = {}


class Meant(str):
    """A word of the document in place of a misspelt one."""

    __slots__ = ()


def read_table(cls: type[Table], raw: Any, loc: Loc, faults: list[Fault]) -> Table:
    """A table of the document from plain data, with stand-ins for what could not be read; the faults of form are noted."""
    if not isinstance(raw, Mapping):
        faults += _complaints(cls, raw, loc)
        return _blank(cls)
    hints, before = _hints_of(cls), len(faults)
    values: dict[str, Any] = {}
    unread: set[str] = set()
    meant = _keys_as_meant(raw, hints, loc, faults)
    for key, written in meant.items():
        own: list[Fault] = []
        values[key], whole = _read(hints[key], raw[written], (*loc, written), own)
        if written != key:  # a value that does not fit may be meant for something else
            own = [fault for fault in own if fault.path != path_text((*loc, written))]
        faults += own
        if not whole:
            unread.add(key)
        if values[key] is _NOTHING:
            del values[key]
    given = set(values)
    for key, field in cls.model_fields.items():
        if field.is_required() and key not in values:
            if key not in unread:
                faults.append(missing_key((*loc, key)))
            values[key] = _stand_in(hints[key], None)
            unread.add(key)
    table = cls.model_construct(_fields_set=given, **values)
    table.mark_unread(unread)
    whole_table = _faults_of_the_whole(table, raw, loc, faulty=len(faults) > before)
    guessed = {key for key, written in meant.items() if written != key} & given
    if guessed and whole_table:  # only what holds without the guesses, too
        left = {key: value for key, value in values.items() if key not in guessed or cls.model_fields[key].is_required()}
        without = cls.model_construct(_fields_set=given - guessed, **left)
        without.mark_unread(unread | guessed)
        known = _faults_of_the_whole(without, raw, loc, faulty=True)
        whole_table = [fault for fault in whole_table if fault in known]
    faults += whole_table
    return table


def _keys_as_meant(raw: Mapping[str, Any], hints: Mapping[str, Any], loc: Loc, faults: list[Fault]) -> dict[str, str]:
    """Known key -> the key as it is written. Unknown keys are noted; they stand for one that their value fits."""
    taken = {key: key for key in raw if key in hints}
    known = list(hints)
    for written in raw:
        if written not in hints:
            likely = meant_keys(str(written), known)
            fitting = (key for key in likely if _fits(hints[key], raw[written], (*loc, written)))
            meant = next(fitting, next((key for key in likely if misspelt(str(written), key)), ""))
            faults.append(unknown_key((*loc, written), known, meant))
            if meant:
                taken.setdefault(meant, written)
    return taken


def _fits(annotation: Any, raw: Any, loc: Loc) -> bool:
    """Whether a value is of the kind that is wanted at a place, whatever is wrong inside it."""
    faults: list[Fault] = []
    _read(annotation, raw, loc, faults)
    place = path_text(loc)
    return not any(fault.path == place for fault in faults)


def _faults_of_the_whole(table: Table, raw: Mapping[str, Any], loc: Loc, *, faulty: bool) -> list[Fault]:
    """What the table's own validators say about parts that do not go together, as far as ``faulty`` parts let them."""
    found: list[Fault] = []
    for validator in type(table).__pydantic_decorators__.model_validators.values():
        if validator.info.mode == "after":
            try:
                validator.func(table)
            except PydanticCustomError as error:
                found += words_of({"type": error.type, "input": raw, "ctx": error.context or {}}, loc)
            except (ArithmeticError, AssertionError, LookupError, TypeError, ValueError):
                if not faulty:
                    raise  # not a stand-in's doing
    return found


def _read(annotation: Any, raw: Any, loc: Loc, faults: list[Fault]) -> tuple[Any, bool]:
    """A value with stand-ins for what could not be read, and whether it is of the right form as a whole."""
    kind, marks = _peel(annotation, raw)
    if isinstance(kind, type) and issubclass(kind, Table):
        table = read_table(kind, raw, loc, faults)
        return table, table.sound()
    try:
        return _adapter(annotation).validate_python(raw), True
    except ValidationError as error:
        details = [(_plain(detail["loc"]), detail) for detail in error.errors(include_url=False)]
    origin, inner = get_origin(kind), get_args(kind)
    leaf = any(isinstance(mark, PlainValidator | Quantity | UnitName) for mark in marks)
    if leaf or not ((origin is dict and isinstance(raw, Mapping)) or (origin in (list, tuple) and isinstance(raw, list | tuple))):
        for place, detail in details:
            faults += words_of(detail, (*loc, *place))
        return _stand_in(annotation, raw), False
    least, most = _length(marks)
    own: list[Any] = [detail for place, detail in details if place == ()]
    if not own and not (0 if least is None else least) <= len(raw) <= (len(raw) if most is None else most):
        own = [{"type": "too_long", "input": raw, "ctx": {"min_length": least, "max_length": most}}]  # hidden behind its entries
    for detail in own:
        faults += words_of(detail, loc)
    if isinstance(raw, Mapping):
        for place, detail in details:
            if place[1:] == ("[key]",):
                faults += words_of(detail, (*loc, *place))
        return {key: _read(inner[1], value, (*loc, key), faults)[0] for key, value in raw.items()}, not own
    row = origin is list or inner[1:] == (...,)
    kinds = [inner[0]] * len(raw) if row else [inner[min(k, len(inner) - 1)] for k in range(len(raw))]
    entries = [_read(each, value, (*loc, k), faults)[0] for k, (each, value) in enumerate(zip(kinds, raw, strict=True))]
    if origin is tuple:
        return (tuple(entries) if not own else _stand_in(annotation, raw)), not own
    if own and least == most is not None:  # as many entries as wanted, but nothing is known of them
        entries = [_stand_in(inner[0], None) for _ in range(most)]
    return entries, not own


def _complaints(annotation: Any, raw: Any, loc: Loc) -> list[Fault]:
    try:
        _adapter(annotation).validate_python(raw)
    except ValidationError as error:
        return [fault for detail in error.errors(include_url=False) for fault in words_of(detail, (*loc, *_plain(detail["loc"])))]
    return []


def _plain(loc: Loc) -> Loc:
    """A place without the marks of the branches that unions took."""
    return tuple(part for part in loc if part not in _BRANCHES)


def _adapter(annotation: Any) -> TypeAdapter[Any]:
    """The validator of a type. By identity: the marks in annotations need not be hashable."""
    if id(annotation) not in _adapters:
        _adapters[id(annotation)] = annotation, TypeAdapter(annotation)
    return _adapters[id(annotation)][1]


def _hints_of(cls: type[Table]) -> dict[str, Any]:
    if cls not in _hints:
        hints = get_type_hints(cls, include_extras=True)
        _hints[cls] = {key: hints[key] for key in cls.model_fields}
    return _hints[cls]


def _peel(annotation: Any, raw: Any) -> tuple[Any, list[Any]]:
    """The type under ``Annotated``, ``| None`` and unions that the value decides, and the marks on the way."""
    marks: list[Any] = []
    while True:
        origin = get_origin(annotation)
        if origin is Annotated:
            annotation, *own = get_args(annotation)
            marks += own
            choice = next((mark for mark in own if isinstance(mark, Discriminator)), None)
            if choice is not None and callable(choice.discriminator):
                tag = choice.discriminator(raw)
                branches = get_args(annotation)
                annotation = next((m for m in branches if Tag(str(tag)) in get_args(m)[1:]), branches[0])
        elif origin in (Union, UnionType) and len(members := [m for m in get_args(annotation) if m is not NoneType]) == 1:
            annotation = members[0]
        else:
            return annotation, marks


def _length(marks: list[Any]) -> tuple[int | None, int | None]:
    """Least and greatest number of entries that the marks of a list allow."""
    flat = [inner for mark in marks for inner in (mark.metadata if isinstance(mark, FieldInfo) else (mark,))]
    least = next((mark.min_length for mark in flat if isinstance(mark, MinLen)), None)
    most = next((mark.max_length for mark in flat if isinstance(mark, MaxLen)), None)
    return least, most


def _stand_in(annotation: Any, raw: Any) -> Any:
    """What stands for a value that could not be read."""
    kind, marks = _peel(annotation, raw)
    origin = get_origin(kind)
    if any(isinstance(mark, UnitName) for mark in marks):
        return _NOTHING
    if any(isinstance(mark, Quantity) for mark in marks) or kind in (int, float):
        return math.nan
    if origin is Literal:
        near = closest(raw, [word for word in get_args(kind) if isinstance(word, str)]) if isinstance(raw, str) else ""
        return Meant(near) if near else Unknown(raw if isinstance(raw, str) else "?")
    if kind is bool:
        return raw.lower() not in ("false", "no", "off", "") if isinstance(raw, str) else bool(raw)
    if kind is str:
        return Unknown(raw if isinstance(raw, str) else "?")
    if isinstance(kind, type) and issubclass(kind, Table):
        return _blank(kind)
    if origin is tuple:
        return (*(_stand_in(each, None) for each in get_args(kind)),)
    if origin is dict or kind is dict:
        return {}
    if origin is list or kind is list:
        least, most = _length(marks)
        if any(isinstance(mark, PlainValidator) for mark in marks):  # a direction: two numbers
            return [math.nan, math.nan]
        return [_stand_in(get_args(kind)[0], None) for _ in range(most)] if least == most is not None else []
    return _NOTHING


def _blank(cls: type[Table]) -> Table:
    """A table of which nothing could be read."""
    hints = _hints_of(cls)
    required = {key: _stand_in(hints[key], None) for key, field in cls.model_fields.items() if field.is_required()}
    table = cls.model_construct(_fields_set=set(), **required)
    table.mark_unread({"*", *cls.model_fields})
    return table
