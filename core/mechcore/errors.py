"""Errors that a user can act on: each names the item, the value and the remedy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

from mechcore.records import dataclass
from mechcore.texts import Text, UnitSystem

T = TypeVar("T")
MOST_NAMES = 20  # names that an error lists


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong: where (a dotted path such as ``joints.C``), what, and what to do about it.

    Quantities in message and remedy (see `mechcore.texts`) are shown in mm and degrees, or in the units of `in_units`.
    """

    path: str
    message: str
    remedy: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "message", Text.of(self.message))
        object.__setattr__(self, "remedy", Text.of(self.remedy))

    def in_units(self, units: UnitSystem) -> Fault:
        """The same fault with its quantities in other units."""
        return Fault(self.path, Text.of(self.message).in_units(units), Text.of(self.remedy).in_units(units))

    def __str__(self) -> str:
        return f"{self.path}: {self.message}" + (f" {self.remedy}" if self.remedy else "")


class MechanismError(ValueError):
    """A mechanism that cannot be built, assembled or solved as stated; carries every fault found, not only the first."""

    def __init__(self, faults: Sequence[Fault] | Fault):
        self.faults: tuple[Fault, ...] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        super().__init__("; ".join(map(str, self.faults)))


class Named(dict[str, T]):
    """Things of a ``kind`` by name. An unknown name raises a `MechanismError` that lists the known names, ``others`` included."""

    def __init__(self, kind: str, things: Mapping[str, T], others: Iterable[str] = ()):
        super().__init__(things)
        self.kind, self.others = kind, tuple(others)

    def __missing__(self, name: str) -> T:
        names = (*self, *self.others)
        more = ", …" if len(names) > MOST_NAMES else ""
        remedy = f"There are: {', '.join(names[:MOST_NAMES])}{more}." if names else ""
        raise MechanismError(Fault(f"{self.kind} '{name}'", "there is none of this name.", remedy))
