"""The numbers of a mechanism's description, by where they are; and descriptions with other ones in their places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

T = TypeVar("T")
Place = tuple[Any, ...]
"""Names of fields and numbers of entries, from outside inwards."""


def numbers_in(thing: Any, place: Place = ()) -> list[tuple[Place, float]]:
    """The numbers of a dataclass or tuple, each with its place; those that other objects keep to themselves left out."""
    if isinstance(thing, float):
        return [(place, thing)]
    if isinstance(thing, tuple):
        return [number for k, inner in enumerate(thing) for number in numbers_in(inner, (*place, k))]
    if is_dataclass(thing):
        return [number for f in fields(thing) for number in numbers_in(getattr(thing, f.name), (*place, f.name))]
    return []


def with_numbers(thing: T, numbers: Mapping[Place, Any]) -> T:
    """A dataclass or tuple with something else in place of some numbers: arrays of designs, or traced numbers; unchecked."""
    if not numbers:
        return thing
    if () in numbers:
        same: T = numbers[()]
        return same
    below: dict[Any, dict[Place, Any]] = {}
    for (first, *rest), number in numbers.items():
        below.setdefault(first, {})[tuple(rest)] = number
    changed: Any
    if isinstance(thing, tuple):
        changed = tuple(with_numbers(inner, below.get(k, {})) for k, inner in enumerate(thing))
    else:
        changed = object.__new__(type(thing))
        changed.__dict__.update(thing.__dict__)
        for name, own in below.items():
            object.__setattr__(changed, name, with_numbers(getattr(thing, name), own))
    return changed  # type: ignore[no-any-return]
