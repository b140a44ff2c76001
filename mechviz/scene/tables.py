"""What all tables of the scene document have in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from .fields import faults

__all__ = ["Table", "one_of", "refuse"]


class Table(BaseModel):
    """A table of the document: unknown keys are faults, and nothing changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


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
