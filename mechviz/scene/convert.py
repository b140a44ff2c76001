"""Conversion of a scene's values to SI units, and reading of its files. Failures are noted as faults; the conversion continues."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING

from mechcore.errors import Fault
from mechcore.records import dataclass
from mechviz.scene.folder import SceneFolder
from mechviz.scene.units import UNIT_KINDS, QuantityError, Units, magnitude, parse

if TYPE_CHECKING:
    from mechcore.laws.curve import MotionCurve
    from mechviz.scene.document import UnitsDocument
    from mechviz.scene.fields import DocumentTable


LARGEST_VALUE = 1e30
"""Largest magnitude of any value in SI: far beyond any machine, short of where squares and cubes of it overflow."""

LARGEST_ANGLE = 1e7
"""Largest angle [rad]: beyond it rounding exceeds 1e-9 rad, which closure errors show."""

SMALLEST_VALUE = 1e-30
"""Smallest magnitude, apart from zero, of values that serve as divisors."""

_DIVISORS = ("time", "frequency", "linear speed", "angular speed")


@dataclass(frozen=True)
class JoinedSegments:
    """Segments of a motion joined to one curve, the range of each segment (``overs``), and the kinds of the coordinate and of its
    master."""

    curve: MotionCurve
    overs: Sequence[float]
    coordinate: str
    master: str


@dataclass
class Converter:
    """Values in a scene's units -> SI. A value of the wrong kind is noted as a fault and comes back as NaN.

    ``kinds``: path -> kind of quantity as which a value was read; ``curves``: path of segments -> their joined curve.
    """

    units: Units
    faults: list[Fault] = field(default_factory=list)
    unknown: frozenset[str] = frozenset()  # kinds whose unit could not be read: bare numbers are in an unknown one
    folder: SceneFolder = field(default_factory=SceneFolder)
    kinds: dict[str, str] = field(default_factory=dict)
    curves: dict[str, JoinedSegments] = field(default_factory=dict)

    @classmethod
    def of(cls, units: UnitsDocument, folder: SceneFolder) -> Converter:
        return cls(Units(**units.model_dump()), unknown=units.invalid_keys, folder=folder)

    def has_known_unit(self, kind: str) -> bool:
        """Whether values of this kind can be compared. They cannot where the scene's unit is unknown, since some may have units of
        their own."""
        return self.unknown.isdisjoint((kind, "*"))

    def note(self, path: str, message: str, remedy: str = "") -> None:
        """Notes a fault, its quantities (see `mechcore.texts`) in the scene's units."""
        self.faults.append(Fault(path, message, remedy).in_units(self.units))

    def si(self, value: float | str, kind: str, path: str) -> float:
        if isinstance(value, float) and math.isnan(value):  # stand-in for a value that could not be read
            return math.nan
        self.kinds[path] = kind
        try:
            number = self.units.si(value, kind)
        except QuantityError as error:
            self.note(path, str(error), error.remedy)
            return math.nan
        if not abs(number) <= LARGEST_VALUE:
            self.note(path, f"{number:g} {UNIT_KINDS[kind].si} is beyond {LARGEST_VALUE:g}.", "Check the number and its unit.")
            return math.nan
        if kind == "angle" and abs(number) > LARGEST_ANGLE:
            said = (
                f"{number / (2.0 * math.pi):.3g} turns are beyond {LARGEST_ANGLE / (2.0 * math.pi):.3g}: places would be rounded."
            )
            self.note(path, said, "Leave out whole turns, or check the number and its unit.")
            return math.nan
        if kind in _DIVISORS and abs(number) < SMALLEST_VALUE and magnitude(value) != 0.0:
            self.note(path, f"{number:g} {UNIT_KINDS[kind].si} is below {SMALLEST_VALUE:g}.", "Check the number and its unit.")
            return math.nan
        return number

    def file(self, name: str, path: str) -> bytes | None:
        """The content of a file that the scene names; None, and a fault, where it cannot be read."""
        try:
            return self.folder.read(name)
        except (FileNotFoundError, NotADirectoryError, ValueError):  # no path at all raises ValueError
            why = f"there is no file '{name}' in '{self.folder.path}'."
            self.note(path, why, "Give its path from the folder of the scene file.")
        except OSError as error:
            why = f"'{name}' in '{self.folder.path}' cannot be read: {(error.strerror or str(error)).lower()}."
            self.note(path, why, "Check the path and its permissions.")
        return None

    def vector(self, value: Sequence[float | str], kind: str, path: str) -> tuple[float, float]:
        return self.si(value[0], kind, f"{path}[0]"), self.si(value[1], kind, f"{path}[1]")

    def row(self, values: Sequence[float | str], kind: str, path: str) -> tuple[float, ...]:
        return tuple(self.si(value, kind, f"{path}[{k}]") for k, value in enumerate(values))

    def increasing(self, values: Sequence[float], path: str) -> bool:
        """Whether the argument of a table is known and increasing; the first place where it does not increase is noted as a
        fault."""
        for k in range(1, len(values)):
            if values[k] - values[k - 1] < SMALLEST_VALUE:  # not where one of them is NaN
                self.note(
                    f"{path}[{k}]",
                    "does not grow from the value before it.",
                    "Put the rows in increasing order, each argument once.",
                )
                return False
        return not any(map(math.isnan, values))


def probable_coordinate(table: DocumentTable) -> str:
    """The probable coordinate of a drive whose joint is unknown: "length" if a text in its table has a unit of length or linear
    speed, else "angle"."""
    for text in _texts(table.model_dump(exclude_none=True, warnings=False)):
        for kind in ("length", "linear speed"):
            try:
                parse(text, kind)
            except QuantityError:
                continue
            return "length"
    return "angle"


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for inner in value.values():
            yield from _texts(inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from _texts(inner)
