"""Quantities of a scene: bare numbers in the scene's units, or texts such as ``"60 rpm"``, to SI units and radians.

Conversions are made in decimal arithmetic and rounded once, so that ``"80 mm"``, ``80`` in a scene in mm and ``0.08``
in a scene in m are the same double. The unit registry is our own and small: an angle is a dimension of its own here,
which keeps turns per minute and cycles per second apart (the usual registries take both for 1/s and are off by 2 pi
without a word).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from typing import Any

from mechcore.texts import shown
from mechviz.scene.faults import closest

QUANTITY_PATTERN = r"^\s*[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?\s*([A-Za-zµμ°(]|1\s*/).*$"
"""A number and a unit. The same pattern goes into the JSON Schema, where it must do without named groups."""

_QUANTITY = re.compile(
    r"\s*(?P<number>[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(?P<unit>(?:[A-Za-zµμ°(]|1\s*/).*?)\s*"
)
_UNIT_TEXT = re.compile(r"[A-Za-zµμ°Ω·*/^()0-9.²³⁻¹\s-]{1,60}")

_DEFINITIONS = """
nano- = 1e-9 = n-
micro- = 1e-6 = µ- = μ- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
deci- = 1e-1 = d-
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
metre = [length] = m = meter
gram = [mass] = g
second = [time] = s = sec
radian = [angle] = rad
turn = 6.28318530717958647692528676655900577 * radian = rev = revolution
degree = turn / 360 = deg = °
arcminute = degree / 60 = arcmin
minute = 60 * second = min
hour = 3600 * second = h
rpm = turn / minute
hertz = 1 / second = Hz
newton = kilogram * metre / second**2 = N
joule = newton * metre = J
watt = joule / second = W
pascal = newton / metre**2 = Pa
bar = 1e5 * pascal
tonne = 1000 * kilogram = t
inch = 0.0254 * metre = in
foot = 0.3048 * metre = ft
pound = 0.45359237 * kilogram = lb
pound_force = 4.4482216152605 * newton = lbf
kilogram_force = 9.80665 * newton = kgf
"""

_SYMBOLS = (
    "m", "mm", "cm", "um", "in", "ft", "rad", "deg", "turn", "rpm", "kg", "g", "lb", "s", "ms", "min", "Hz", "N", "kN",
    "lbf", "J", "Pa", "bar",
)  # fmt: skip
_SPACED = {"Nm": "N m", "Nmm": "N mm", "kNm": "kN m", "kgm^2": "kg m^2", "kgm2": "kg m^2", "kgm²": "kg m^2"}


@dataclass(frozen=True)
class Kind:
    """A kind of quantity: its name in a sentence, its SI unit, and what a bare number of it is counted in.

    ``bare`` is a formula in the names of ``Units``, so that a speed follows the units of length and time.
    """

    words: str
    si: str
    bare: str
    example: str


_STATED: Mapping[str, Kind] = {
    "length": Kind("a length", "m", "{length}", "80 mm"),
    "angle": Kind("an angle", "rad", "{angle}", "30 deg"),
    "mass": Kind("a mass", "kg", "{mass}", "0.4 kg"),
    "time": Kind("a time", "s", "{time}", "0.5 s"),
    "force": Kind("a force", "N", "{force}", "150 N"),
    "torque": Kind("a torque", "N*m", "{torque}", "5 N m"),
    "inertia": Kind("a moment of inertia", "kg*m**2", "{inertia}", "0.001 kg m^2"),
    "density": Kind("a density", "kg/m**3", "kg/m**3", "7850 kg/m^3"),  # never kg/mm^3 by the way
    "frequency": Kind("a frequency", "1/s", "1/({time})", "2 Hz"),
    "linear speed": Kind("a linear speed", "m/s", "({length})/({time})", "20 mm/s"),
    "angular speed": Kind("an angular speed", "rad/s", "({angle})/({time})", "60 rpm"),
    "linear acceleration": Kind("a linear acceleration", "m/s**2", "({length})/({time})**2", "200 mm/s^2"),
    "angular acceleration": Kind("an angular acceleration", "rad/s**2", "({angle})/({time})**2", "2 rad/s^2"),
    "pressure": Kind("a pressure", "Pa", "Pa", "6 bar"),  # whatever the units of force and length
    "stiffness": Kind("a stiffness", "N/m", "({force})/({length})", "2 N/mm"),
    "torsional stiffness": Kind("a torsional stiffness", "N*m/rad", "({torque})/({angle})", "3 N m/rad"),
    "damping": Kind("a damping coefficient", "N*s/m", "({force})*({time})/({length})", "20 N s/m"),
    "torsional damping": Kind("a torsional damping coefficient", "N*m*s/rad", "({torque})*({time})/({angle})", "0.1 N m s/rad"),
    "quadratic damping": Kind(
        "a quadratic damping coefficient", "N*s**2/m**2", "({force})*({time})**2/({length})**2", "5 N s^2/m^2"
    ),
    "quadratic torsional damping": Kind(
        "a quadratic torsional damping coefficient",
        "N*m*s**2/rad**2",
        "({torque})*({time})**2/({angle})**2",
        "0.01 N m s^2/rad^2",
    ),
    "integral gain": Kind("an integral gain", "N/(m*s)", "({force})/(({length})*({time}))", "50 N/(m s)"),
    "torsional integral gain": Kind(
        "a torsional integral gain", "N*m/(rad*s)", "({torque})/(({angle})*({time}))", "20 N m/(rad s)"
    ),
    "power": Kind("a power", "W", "W", "2 kW"),
    "gravity": Kind("a linear acceleration", "m/s**2", "m/s**2", "-9.81 m/s^2"),  # never mm/s^2 by the way
}


_POWERS = {1: ("", ""), 2: (" squared", "**2"), 3: (" cubed", "**3")}


def derivative_kind(coordinate: str, master: str, order: int) -> str:
    """The kind of a derivative of a coordinate ("angle", "length") by a master ("time", "angle", "length")."""
    if order == 0:
        return coordinate
    if master == "time":
        return f"{'angular' if coordinate == 'angle' else 'linear'} {('speed', 'acceleration', 'jerk')[order - 1]}"
    return f"{coordinate} per {master}{_POWERS[order][0]}"


def _derivatives() -> dict[str, Kind]:
    """The kinds of derivatives that are not stated above: jerks, and those by an angle or a length."""
    found, si = {}, {"length": "m", "angle": "rad", "time": "s"}
    for coordinate in ("length", "angle"):
        for master in ("time", "angle", "length"):
            for order, (_, power) in _POWERS.items():
                kind = derivative_kind(coordinate, master, order)
                example = f"2 {'mm' if coordinate == 'length' else 'rad'}/{si[master]}{power.replace('**', '^')}"
                words = f"{'an' if kind[0] == 'a' else 'a'} {kind}"
                formula = "({" + coordinate + "})/({" + master + "})" + power
                found[kind] = Kind(words, f"{si[coordinate]}/{si[master]}{power}", formula, example)
    return {kind: made for kind, made in found.items() if kind not in _STATED}


DERIVATIVES = tuple(derivative_kind(c, m, k) for c in ("angle", "length") for m in ("time", "angle", "length") for k in (1, 2, 3))
"""Kinds of derivatives of a coordinate."""

KINDS: Mapping[str, Kind] = {**_STATED, **_derivatives()}


class QuantityError(ValueError):
    """A text that is no quantity, or one of another kind than wanted. ``remedy`` says what to write instead."""

    def __init__(self, message: str, remedy: str):
        super().__init__(message)
        self.remedy = remedy


@cache
def _registry() -> Any:
    import pint  # a third of a second: only for scenes, not for the gallery's list

    registry: Any = pint.UnitRegistry(None, non_int_type=Decimal)
    registry.load_definitions([line for line in _DEFINITIONS.splitlines() if line])
    return registry


@cache
def _unit(text: str) -> Any:
    """The unit that a text such as ``N m`` or ``kg m^2`` names."""
    plain = re.sub(r"([A-Za-zµμ])([23])\b", r"\1^\2", text)  # people write m2 for m^2
    registry = _registry()
    if _UNIT_TEXT.fullmatch(plain):
        try:
            return registry.parse_units(plain)
        except Exception:  # pint raises errors of half a dozen unrelated classes; all of them mean the same to a reader
            pass
    if text in _SPACED:
        raise QuantityError(f"unknown unit '{text}'.", f"Put a space between the units: '{_SPACED[text]}'.")
    words = re.findall(r"[A-Za-zµμ°]+", text)
    unknown = next((word for word in words if word.lower() == "nan" or word not in registry), text)  # pint takes "nan" for a number
    near = closest(unknown, _SYMBOLS)
    raise QuantityError(
        f"unknown unit '{unknown}'.",
        f"Did you mean '{near}'?" if near else f"Known: {', '.join(_SYMBOLS)}, and their products.",
    )


def _words(unit: Any) -> str:
    """What a unit measures, in words."""
    for kind in KINDS.values():
        if unit.dimensionality == _registry().parse_units(kind.si).dimensionality:
            return kind.words
    return f"of the dimension {unit.dimensionality}"


@cache
def unit_factor(text: str, kind: str) -> Decimal:
    """How many SI units of its kind one unit is; QuantityError where the unit measures something else."""
    unit = _unit(text)
    wanted = KINDS[kind]
    target = _registry().parse_units(wanted.si)
    if unit.dimensionality == target.dimensionality:
        return Decimal(_registry().Quantity(Decimal(1), unit).to(target).magnitude)
    found = _words(unit)
    if (found, kind) == ("a frequency", "angular speed"):
        raise QuantityError(f"{found}, {wanted.words} is wanted.", "Write turns as rpm or turn/s, angles as deg/s or rad/s.")
    raise QuantityError(f"{found}, {wanted.words} is wanted.", f"Write it like '{wanted.example}'.")


def split(text: str) -> tuple[str, str]:
    """A text such as ``"80 mm"`` -> number and unit, both as text."""
    match = _QUANTITY.fullmatch(text)
    if match and math.isfinite(float(match["number"])):
        return match["number"], match["unit"]
    try:
        bare = float(match["number"] if match else text)
    except ValueError:
        comma = re.match(r"\s*[+-]?[0-9]+,[0-9]", text)
        hint = "Write a decimal point instead of the comma." if comma else "Write a number, or a number with its unit."
        raise QuantityError(f"'{text}' is not a number with a unit.", hint) from None
    if not math.isfinite(bare):
        raise QuantityError(f"'{text}' is not a finite number.", "Give a finite one.")
    raise QuantityError(
        f"'{text}' has no unit.", f"Write {text.strip()} without quotes to have it in the scene's units, or add a unit."
    )


def magnitude(value: float | str) -> float:
    """The number of a quantity, whatever its unit: enough to know its sign."""
    return float(split(value)[0]) if isinstance(value, str) else value


def parse(text: str, kind: str) -> float:
    """A text with its own unit -> SI."""
    number, unit = split(text)
    try:
        return float(Decimal(number) * unit_factor(unit, kind))
    except QuantityError as error:
        verb = "is" if str(error).endswith("is wanted.") else "has an"
        raise QuantityError(f"'{text}' {verb} {error}", error.remedy) from None


def symbol_of(unit: str) -> str:
    """A unit of a scene, or a formula of such units, as it is written for people: "mm/s", "°", "kg m²"."""
    text = re.sub(r"(?<!/)\(([^()/]*)\)", r"\1", re.sub(r"/\(([^()/ *]*)\)", r"/\1", unit))  # not of N m/(rad s)
    text = re.sub(r"\bdeg(rees?)?\b", "°", text).replace("**", "^").replace("*", " ")
    return text.replace("^2", "²").replace("^3", "³")


@dataclass(frozen=True)
class Units:
    """The units that bare numbers of a scene are counted in."""

    length: str = "m"
    angle: str = "rad"
    mass: str = "kg"
    time: str = "s"
    force: str = "N"
    torque: str = "N m"
    inertia: str = "kg m^2"

    def factor(self, kind: str) -> Decimal:
        """SI units in one unit of a bare number of this kind."""
        return unit_factor(KINDS[kind].bare.format(**vars(self)), kind)

    def symbol(self, kind: str) -> str:
        """The unit of a bare number of this kind, as it is written for people: "mm/s", "°", "kg m²"."""
        return symbol_of(KINDS[kind].bare.format(**vars(self)))

    def show(self, value: float, kind: str, digits: int = 6) -> str:
        """A quantity [SI] in the scene's units: its number, with so many digits, and unit."""
        return shown(value / float(self.factor(kind)), self.symbol(kind), digits)

    def si(self, value: float | str, kind: str) -> float:
        """A number or a text of a scene -> SI."""
        if isinstance(value, str):
            return parse(value, kind)
        return float(Decimal(repr(float(value))) * self.factor(kind))
