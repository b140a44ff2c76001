"""A lazy ``dataclass``: the methods of a class are generated when its first instance is made. Also the numbers in such records.

The standard library generates and compiles the methods where a class is defined, in about half a millisecond per class: for all
kinds of joints, loads, cams and steps together a third of the time of a short command, which uses few of them. `numbers_in` lists
the numbers in a record with their places, `with_numbers` makes a copy with other numbers in these places.
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
        """The class as a dataclass with these options; its methods are generated when an instance is made or its fields are read.

        Classes with methods or options that this does not cover become dataclasses at once.
        """
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
    """A class that is to become a dataclass: a descriptor in place of its fields, which completes the class when they are read."""

    def __init__(self, cls: Any, options: dict[str, Any]):
        self.cls, self.options, self.done = cls, options, False

    def __get__(self, instance: object, owner: type) -> Any:
        self.complete()
        return self.cls.__dataclass_fields__

    def stand_in(self, method: Any) -> Any:
        """A method that completes the class, then calls ``method(class)`` with its own arguments."""

        def first(this: Any, *args: Any, **given: Any) -> None:
            self.complete()
            method(self.cls)(this, *args, **given)

        return first

    def complete(self) -> None:
        """Generate the methods of the class. While other threads run, the stand-in stays until it is replaced by ``__init__``."""
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
    """Restore the state as ``pickle`` and ``copy`` do for a class without ``__setstate__``."""
    this.__dict__.update(state)


T = TypeVar("T")
NumberPlace = tuple[Any, ...]
"""Names of fields and indices of entries, the outermost first."""


def numbers_in(thing: object, place: NumberPlace = ()) -> list[tuple[NumberPlace, float]]:
    """The numbers of a dataclass or tuple, each with its place, without those of `kept_numbers`."""
    return [(at, number) for at, number, kept in _numbers(thing, place, False) if not kept]


def kept_numbers(thing: object, place: NumberPlace = ()) -> list[tuple[NumberPlace, float]]:
    """The numbers that `numbers_in` leaves out, each with its place: those of objects such as tables that compute other fields
    from them when they are made, so that other numbers in these places would change nothing."""
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
    """A copy of a dataclass or tuple with some numbers replaced, by arrays of designs or traced numbers; nothing is checked."""
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
