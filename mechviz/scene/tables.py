"""What all tables of the scene document have in common."""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, PrivateAttr

from .fields import faults

if TYPE_CHECKING:
    from pydantic import GetJsonSchemaHandler
    from pydantic_core import CoreSchema

__all__ = ["Table", "Unknown", "is_whole", "one_of", "refuse"]


class Unknown(str):
    """Stands for a name that could not be read, or that nothing is called by. It equals nothing but itself."""

    __slots__ = ()
    __eq__ = object.__eq__
    __ne__ = object.__ne__
    __hash__ = object.__hash__


class Table(BaseModel):
    """A table of the document: unknown keys are faults, and nothing changes after reading.

    Where a file has faults, its tables are made all the same, so that every check can be run on what is sound. What could
    not be read is replaced: numbers by NaN, names by ``Unknown``; ``unread`` names the keys concerned.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    _unread: frozenset[str] = PrivateAttr(default=frozenset())

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """What stands below each key in the source describes it in the schema. pydantic's own ``use_attribute_docstrings`` reads
        the sources whenever the tables are loaded, which takes a tenth of a second of every command."""
        schema = handler(core)
        entries = handler.resolve_ref_schema(schema)["properties"]
        for base in reversed(cls.__mro__):
            for key, text in _explained(base).items() if issubclass(base, Table) else ():
                field = cls.model_fields[key]
                if field.description is None:
                    entries[field.alias or key]["description"] = text
        return schema

    @property
    def unread(self) -> frozenset[str]:
        """Keys whose values could not be read; "*" where the table itself could not be."""
        return self._unread

    def sound(self, *keys: str) -> bool:
        """Whether all these keys could be read (or are left out)."""
        return self._unread.isdisjoint((*keys, "*"))

    def mark_unread(self, keys: Iterable[str]) -> None:
        """For the reader of faulty scenes: says which keys could not be read."""
        self._unread = frozenset(keys)


def _explained(table: type) -> dict[str, str]:
    """The texts below a class's own annotated names."""
    body = ast.parse(textwrap.dedent(inspect.getsource(table))).body[0]
    assert isinstance(body, ast.ClassDef)
    return {
        line.target.id: inspect.cleandoc(below.value.value)
        for line, below in pairwise(body.body)
        if isinstance(line, ast.AnnAssign)
        and isinstance(line.target, ast.Name)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
        and isinstance(below.value.value, str)
    }


def is_whole(value: Any) -> bool:
    """Whether nothing in a value of the document stands for something that could not be read."""
    if isinstance(value, Table):
        return not value.unread and all(is_whole(getattr(value, key)) for key in type(value).model_fields)
    if isinstance(value, Mapping):
        return all(map(is_whole, value.values()))
    if isinstance(value, list | tuple):
        return all(map(is_whole, value))
    return not isinstance(value, Unknown) and not (isinstance(value, float) and math.isnan(value))


def one_of(table: Table, keys: tuple[str, ...], what: str) -> list[tuple[str, str, str]]:
    """No fault where exactly one of the keys is given, else the fault."""
    given = [key for key in keys if getattr(table, key) is not None]
    names = ", ".join(keys[:-1]) + " or " + keys[-1]
    if not given:
        return [("", f"{what} has none of {names}.", "Give one of them.")]
    return [("", f"{what} has {' and '.join(given)} at once.", f"Keep one of {names}.")] if len(given) > 1 else []


def refuse(found: list[tuple[str, str, str]]) -> None:
    """Raise the faults, if there are any."""
    if found:
        raise faults(found)
