"""Parameters of a scene as its document holds them: named numbers with units, from which other values follow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Discriminator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, Tag
from pydantic_core import CoreSchema, core_schema

from mechviz.scene.fields import Table, describe, fault


@dataclass(frozen=True)
class Stated:
    """Marks a plain number, or a text that is a quantity or an expression of any kind; pydantic calls the two methods."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self._check)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {
            "type": ["number", "string"],
            "description": "a plain number, a quantity with its unit, or an expression of other parameters",
            "examples": ["30 mm", "2*r + 5 mm", 3],
        }

    def _check(self, value: Any) -> float | str:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise fault(f"{describe(value)} where a value is wanted.", "Write it like '30 mm'; a plain number has no unit.")
        return value


Value = Annotated[float | str, Stated()]


class ParameterDocument(Table):
    """A parameter with what it may be."""

    value: Value
    """Its value: a quantity with its unit, a plain number, or an expression of other parameters."""
    range: Annotated[list[Value], Field(min_length=2, max_length=2)] | None = None
    """Its least and greatest value: of sliders, sweeps and optimisation."""
    tolerance: Value | None = None
    """How far it may be off either way as made."""


def _is_table(value: Any) -> str:
    return "<table>" if isinstance(value, dict | ParameterDocument) else "<value>"


ParameterEntry = Annotated[
    Annotated[Value, Tag("<value>")] | Annotated[ParameterDocument, Tag("<table>")], Discriminator(_is_table)
]
