"""Texts that contain quantities: stored in SI units, shown in the units of the reader.

`as_length` and its relatives put a quantity into a text, for example an f-string; `Text` shows it. `Fault` and `Event` make a
`Text` of their words, so that a caller with other units (a scene in inches) shows the same words in these.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import pi
from typing import Literal, Protocol

QuantityKind = Literal[
    "length",
    "angle",
    "linear speed",
    "angular speed",
    "force",
    "torque",
    "stiffness",
    "torsional stiffness",
    "Pa",
    "1/m",
    "m/rad",
    "rad/m",
    "rad/m^2",
]
"""Kinds of quantities; a kind for which scenes have no unit of their own is named by its SI unit."""


class UnitSystem(Protocol):
    """Units in which quantities are shown."""

    def show(self, value: float, kind: str, digits: int) -> str:
        """A quantity [SI] of a kind (see `QuantityKind`) as a number with so many significant digits, and its unit."""


def shown(number: float, symbol: str, digits: int) -> str:
    """A number with so many significant digits and its unit; no space before a degree sign, no minus sign before zero."""
    return f"{number + 0.0:.{digits}g}{'' if symbol == '°' else ' '}{symbol}"


class _MillimetresAndDegrees:
    """The default units of texts."""

    _UNITS: Mapping[str, tuple[float, str]] = {
        "length": (1e-3, "mm"),
        "angle": (pi / 180.0, "°"),
        "linear speed": (1.0, "m/s"),
        "angular speed": (1.0, "rad/s"),
        "force": (1.0, "N"),
        "torque": (1.0, "N m"),
        "stiffness": (1.0, "N/m"),
        "torsional stiffness": (1.0, "N m/rad"),
        "Pa": (1e6, "MPa"),
        "1/m": (1.0, "1/m"),
        "m/rad": (1.0, "m/rad"),
        "rad/m": (1.0, "rad/m"),
        "rad/m^2": (1.0, "rad/m²"),
    }

    def show(self, value: float, kind: str, digits: int) -> str:
        factor, symbol = self._UNITS[kind]
        return shown(value / factor, symbol, digits)


_PLAIN = _MillimetresAndDegrees()
_MARK = "\x1f"  # separates units of text; no name of a scene holds it
_QUANTITY = re.compile(f"{_MARK}([^{_MARK}]*){_MARK}([^{_MARK}]*){_MARK}([^{_MARK}]*){_MARK}")


def as_quantity(value: float, kind: QuantityKind, digits: int = 6) -> str:
    """A quantity [SI] as a part of a text that becomes a `Text`, with so many significant digits."""
    return f"{_MARK}{kind}{_MARK}{float(value)!r}{_MARK}{digits}{_MARK}"


def as_length(value: float, digits: int = 6) -> str:
    """A length [m] as a part of a text."""
    return as_quantity(value, "length", digits)


def as_angle(value: float, digits: int = 6) -> str:
    """An angle [rad] as a part of a text."""
    return as_quantity(value, "angle", digits)


def as_force(value: float, digits: int = 6) -> str:
    """A force [N] as a part of a text."""
    return as_quantity(value, "force", digits)


def as_torque(value: float, digits: int = 6) -> str:
    """A torque [N m] as a part of a text."""
    return as_quantity(value, "torque", digits)


def as_pressure(value: float, digits: int = 6) -> str:
    """A pressure [Pa] as a part of a text."""
    return as_quantity(value, "Pa", digits)


def as_coordinate(value: float, *, rotary: bool, digits: int = 6) -> str:
    """The coordinate of a joint as a part of a text: an angle [rad] of a rotary joint, else a length [m]."""
    return as_quantity(value, "angle" if rotary else "length", digits)


class Text(str):
    """A string whose quantities are shown in millimetres and degrees, or in the units of `in_units`.

    It is made from words that contain the results of `as_length` and its relatives, or from another `Text`.
    """

    source: str
    """The words with their quantities in SI units, as `as_quantity` marks them."""

    def __new__(cls, source: str, units: UnitSystem = _PLAIN) -> Text:
        raw = source.source if isinstance(source, Text) else source
        shown = _QUANTITY.sub(lambda m: units.show(float(m[2]), m[1], int(m[3])), raw) if _MARK in raw else raw
        text = super().__new__(cls, shown)
        text.source = raw
        return text

    @classmethod
    def of(cls, words: str) -> Text:
        """A `Text` of these words; a `Text` is returned unchanged, with its units."""
        return words if isinstance(words, Text) else cls(words)

    def in_units(self, units: UnitSystem) -> Text:
        """The same words with their quantities in other units."""
        return Text(self, units)
