"""``dataclass`` as of the standard library, for classes of which a run uses few: its methods are written when first needed.

The library writes and compiles the methods of a class where the class is defined, about half a millisecond each: for all kinds of
joints, loads, cams and steps together a third of the time of a short command.
"""

from __future__ import annotations

import dataclasses
from threading import RLock, active_count
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls: type | None = None, /, **options: Any) -> Any:
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
        """What completes the class and then calls a method of it."""

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


def _restore(this: Any, state: dict[str, Any]) -> None:
    """What ``pickle`` and ``copy`` do by themselves."""
    this.__dict__.update(state)
