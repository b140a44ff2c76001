"""``dataclass`` as of the standard library, for classes of which a run uses few: its methods are written when first needed.

The library writes and compiles the methods of a class where the class is defined, about half a millisecond each: for all kinds of
joints, loads, cams and steps together a third of the time of a short command. Also the numbers in
such records, by where they are, and records with other ones in their places.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from threading import RLock, active_count
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls: type | None = None, /, **options: object) -> Any:
        """The class as a dataclass with these options, which is completed by its first instance, or whoever asks for its fields."""
        if cls is None:
            return lambda owner: dataclass(owner, **options)
        if {"__init__", "__setstate__", "__reduce__", "__slots__"} & cls.__dict__.keys() or options.keys() - OPTIONS:
            return dataclasses.dataclass(**options)(cls)
        lazy = _Lazy(cls, options)
        cls.__dataclass_fields__ = lazy
        cls.__init__ = lazy.stand_in(lambda owner: owner.__init__)
        cls.__setstate__ = lazy.stand_in(lambda owner: _restore)  # unpickled: made without ``__init__``
        return cls


OPTIONS = {"frozen", "eq", "kw_only"}
_lock = RLock()


class _Lazy:
    """A class that is to become a dataclass; in the place of its fields, which complete it when they are asked for."""

    def __init__(self, cls: Any, options: dict[str, Any]):
        self.cls, self.options, self.done = cls, options, False

    def __get__(self, instance: object, owner: type) -> Any:
        self.complete()
        return self.cls.__dataclass_fields__

    def stand_in(self, method: Any) -> Any:
        """A method that completes the class, then calls the method of that name."""

        def first(this: Any, *args: Any, **given: Any) -> None:
            self.complete()
            method(self.cls)(this, *args, **given)

        return first

    def complete(self) -> None:
        """Completes the class. Where other threads run, the stand-in for ``__init__`` stays until there is another."""
        with _lock:
            if self.done:
                return
            del self.cls.__dataclass_fields__
            if active_count() == 1:
                del self.cls.__init__
                dataclasses.dataclass(**self.options)(self.cls)
            else:
                dataclasses.dataclass(init=False, **self.options)(self.cls)
                heir: Any = type(self.cls)("heir", (self.cls,), {"__doc__": ""})
                heir = dataclasses.dataclass(**{**self.options, "eq": False}, repr=False)(heir)
                heir.__init__.__qualname__ = f"{self.cls.__qualname__}.__init__"
                self.cls.__init__ = heir.__init__
            del self.cls.__setstate__
            self.done = True


def _restore(this: object, state: dict[str, Any]) -> None:
    """Restore the state, as ``pickle`` and ``copy`` do by themselves."""
    this.__dict__.update(state)


T = TypeVar("T")
NumberPlace = tuple[Any, ...]
"""Names of fields and numbers of entries, from outside inwards."""


def numbers_in(thing: object, place: NumberPlace = ()) -> list[tuple[NumberPlace, float]]:
    """The numbers of a dataclass or tuple, each with its place; those that other objects keep to themselves left out."""
    return [(at, number) for at, number, kept in _numbers(thing, place, False) if not kept]


def kept_numbers(thing: object, place: NumberPlace = ()) -> list[tuple[NumberPlace, float]]:
    """The numbers that `numbers_in` leaves out: of objects such as tables that make something of them once and for all, so that
    other numbers in their places would change nothing."""
    return [(at, number) for at, number, kept in _numbers(thing, place, False) if kept]


def _numbers(thing: object, place: NumberPlace, kept: bool) -> Iterator[tuple[NumberPlace, float, bool]]:
    if isinstance(thing, float):
        yield place, thing, kept
    elif isinstance(thing, tuple):
        for k, inner in enumerate(thing):
            yield from _numbers(inner, (*place, k), kept)
    elif is_dataclass(thing):
        own = fields(thing)
        kept = kept or not all(f.init for f in own)
        for f in own:
            if f.init:
                yield from _numbers(getattr(thing, f.name), (*place, f.name), kept)


def with_numbers(thing: T, numbers: Mapping[NumberPlace, Any]) -> T:
    """A dataclass or tuple with something else in place of some numbers: arrays of designs, or traced numbers; unchecked."""
    if not numbers:
        return thing
    if () in numbers:
        same: T = numbers[()]
        return same
    below: dict[Any, dict[NumberPlace, Any]] = {}
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
    return changed  # type: ignore[no-any-return]  # of the type of thing, whichever that is
