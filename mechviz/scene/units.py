"""Quantities of a scene, bare numbers in the scene's units or texts such as ``"60 rpm"``: conversion to SI units and radians.

Conversions use decimal arithmetic and are rounded once, so that ``"80 mm"``, ``80`` in a scene in mm and ``0.08`` in a scene in m
are the same double. The table of units is our own and small: angle is a dimension of its own, which distinguishes turns per minute
from cycles per second (common registries of units treat both as 1/s, which is silently off by 2 pi).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from decimal import Decimal
from functools import cache

from mechcore.records import dataclass
from mechcore.texts import shown
from mechviz.scene.faults import closest

QUANTITY_PATTERN = r"^\s*[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?\s*([A-Za-zµμ°(]|1\s*/).*$"
"""A number and a unit. The same pattern goes into the JSON Schema, where it must do without named groups."""
EXPRESSION_PATTERN = r"^\s*[-+]?\s*[^\W\d]\w*\s*$|[*/^(]|[^eE\s]\s*[-+]"
"""A name, or a text with an operator: what may be an expression of parameters. For the JSON Schema; the parser decides."""

_QUANTITY = re.compile(
    r"\s*(?P<number>[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(?P<unit>(?:[A-Za-zµμ°(]|1\s*/).*?)\s*"
)
_TOKEN = re.compile(r"\s*(?:(?P<name>[A-Za-zµμ°Ω]+)|(?P<power>[⁻¹²³]+)|(?P<number>-?[0-9]+)|(?P<sign>\*\*|[*·/^()]))\s*")
_LONGEST = 60  # characters of a unit

_PREFIXES = {
    "nano": -9, "n": -9, "micro": -6, "µ": -6, "μ": -6, "u": -6, "milli": -3, "m": -3, "centi": -2, "c": -2, "deci": -1, "d": -1,
    "kilo": 3, "k": 3, "mega": 6, "M": 6, "giga": 9, "G": 9,
}  # fmt: skip

_BASES = ("[angle]", "[length]", "[mass]", "[time]")

_TURN = "6.28318530717958647692528676655900577"
_DEFINITIONS = (  # names, factor, unit; the first four are units of one dimension each
    ("radian rad", "1", "[angle]"),
    ("metre m meter", "1", "[length]"),
    ("gram g", "1e-3", "[mass]"),  # factors are those to SI units
    ("second s sec", "1", "[time]"),
    ("turn rev revolution", _TURN, "rad"),
    ("degree deg °", Decimal(_TURN) / 360, "rad"),
    ("arcminute arcmin", Decimal(_TURN) / 21600, "rad"),
    ("minute min", "60", "s"),
    ("hour h", "3600", "s"),
    ("rpm", "1", "turn/min"),
    ("hertz Hz", "1", "1/s"),
    ("newton N", "1", "kg m/s^2"),
    ("joule J", "1", "N m"),
    ("watt W", "1", "J/s"),
    ("pascal Pa", "1", "N/m^2"),
    ("bar", "1e5", "Pa"),
    ("tonne t", "1000", "kg"),
    ("inch in", "0.0254", "m"),
    ("foot ft", "0.3048", "m"),
    ("pound lb lbm", "0.45359237", "kg"),
    ("lbf", "4.4482216152605", "N"),
    ("slug", "1", "lbf s^2/ft"),
    ("kgf", "9.80665", "N"),
)

_SYMBOLS = (
    "m", "mm", "cm", "um", "in", "ft", "rad", "deg", "turn", "rpm", "kg", "g", "lb", "s", "ms", "min", "Hz", "N", "kN",
    "lbf", "J", "Pa", "bar",
)  # fmt: skip
_SPACED = {"Nm": "N m", "Nmm": "N mm", "kNm": "kN m", "kgm^2": "kg m^2", "kgm2": "kg m^2", "kgm²": "kg m^2"}


@dataclass(frozen=True)
class UnitKind:
    """A kind of quantity: its name in a sentence, its SI unit, the unit of a bare number, and an example.

    ``bare`` is a formula in the names of ``Units``, so that a speed follows the units of length and time.
    """

    words: str
    si: str
    bare: str
    example: str


_STATED: Mapping[str, UnitKind] = {
    "length": UnitKind("a length", "m", "{length}", "80 mm"),
    "angle": UnitKind("an angle", "rad", "{angle}", "30 deg"),
    "mass": UnitKind("a mass", "kg", "{mass}", "0.4 kg"),
    "time": UnitKind("a time", "s", "{time}", "0.5 s"),
    "force": UnitKind("a force", "N", "{force}", "150 N"),
    "torque": UnitKind("a torque", "N*m", "{torque}", "5 N m"),
    "inertia": UnitKind("a moment of inertia", "kg*m**2", "{inertia}", "0.001 kg m^2"),
    "density": UnitKind("a density", "kg/m**3", "kg/m**3", "7850 kg/m^3"),  # never kg/mm^3 unintentionally
    "frequency": UnitKind("a frequency", "1/s", "1/({time})", "2 Hz"),
    "linear speed": UnitKind("a linear speed", "m/s", "({length})/({time})", "20 mm/s"),
    "angular speed": UnitKind("an angular speed", "rad/s", "({angle})/({time})", "60 rpm"),
    "linear acceleration": UnitKind("a linear acceleration", "m/s**2", "({length})/({time})**2", "200 mm/s^2"),
    "angular acceleration": UnitKind("an angular acceleration", "rad/s**2", "({angle})/({time})**2", "2 rad/s^2"),
    "pressure": UnitKind("a pressure", "Pa", "Pa", "6 bar"),  # independent of the units of force and length
    "stiffness": UnitKind("a stiffness", "N/m", "({force})/({length})", "2 N/mm"),
    "torsional stiffness": UnitKind("a torsional stiffness", "N*m/rad", "({torque})/({angle})", "3 N m/rad"),
    "damping": UnitKind("a damping coefficient", "N*s/m", "({force})*({time})/({length})", "20 N s/m"),
    "torsional damping": UnitKind("a torsional damping coefficient", "N*m*s/rad", "({torque})*({time})/({angle})", "0.1 N m s/rad"),
    "quadratic damping": UnitKind(
        "a quadratic damping coefficient", "N*s**2/m**2", "({force})*({time})**2/({length})**2", "5 N s^2/m^2"
    ),
    "quadratic torsional damping": UnitKind(
        "a quadratic torsional damping coefficient",
        "N*m*s**2/rad**2",
        "({torque})*({time})**2/({angle})**2",
        "0.01 N m s^2/rad^2",
    ),
    "integral gain": UnitKind("an integral gain", "N/(m*s)", "({force})/(({length})*({time}))", "50 N/(m s)"),
    "torsional integral gain": UnitKind(
        "a torsional integral gain", "N*m/(rad*s)", "({torque})/(({angle})*({time}))", "20 N m/(rad s)"
    ),
    "power": UnitKind("a power", "W", "W", "2 kW"),
    "gravity": UnitKind("a linear acceleration", "m/s**2", "m/s**2", "-9.81 m/s^2"),  # never mm/s^2 unintentionally
}


_POWERS = {1: ("", ""), 2: (" squared", "**2"), 3: (" cubed", "**3")}


def derivative_kind(coordinate: str, master: str, order: int) -> str:
    """The kind of a derivative of a coordinate ("angle", "length") by a master ("time", "angle", "length")."""
    if order == 0:
        return coordinate
    if master == "time":
        return f"{'angular' if coordinate == 'angle' else 'linear'} {('speed', 'acceleration', 'jerk')[order - 1]}"
    return f"{coordinate} per {master}{_POWERS[order][0]}"


def _derivatives() -> dict[str, UnitKind]:
    """The kinds of derivatives that are not stated above: jerks, and those by an angle or a length."""
    kinds, si = {}, {"length": "m", "angle": "rad", "time": "s"}
    for coordinate in ("length", "angle"):
        for master in ("time", "angle", "length"):
            for order, (_, power) in _POWERS.items():
                kind = derivative_kind(coordinate, master, order)
                example = f"2 {'mm' if coordinate == 'length' else 'rad'}/{si[master]}{power.replace('**', '^')}"
                words = f"{'an' if kind[0] == 'a' else 'a'} {kind}"
                formula = "({" + coordinate + "})/({" + master + "})" + power
                kinds[kind] = UnitKind(words, f"{si[coordinate]}/{si[master]}{power}", formula, example)
    return {kind: made for kind, made in kinds.items() if kind not in _STATED}


DERIVATIVES = tuple(derivative_kind(c, m, k) for c in ("angle", "length") for m in ("time", "angle", "length") for k in (1, 2, 3))
"""Kinds of derivatives of a coordinate."""

UNIT_KINDS: Mapping[str, UnitKind] = {**_STATED, **_derivatives()}


class QuantityError(ValueError):
    """A text is no quantity, or a quantity of another kind than required. ``remedy`` says what to write instead."""

    def __init__(self, message: str, remedy: str):
        super().__init__(message)
        self.remedy = remedy


@dataclass(frozen=True)
class Unit:
    """A unit: its factor to SI, and its powers of angle, length, mass and time."""

    factor: Decimal = Decimal(1)
    powers: tuple[int, ...] = (0, 0, 0, 0)

    def times(self, other: Unit, power: int = 1) -> Unit:
        """The product with a power of another unit."""
        powers = tuple(a + power * b for a, b in zip(self.powers, other.powers, strict=True))
        return Unit(self.factor * other.factor**power, powers)


@cache
def _definitions() -> dict[str, Unit]:
    """The units without prefixes, by each of their names."""
    units: dict[str, Unit] = {}
    for names, number, of in _DEFINITIONS:
        unit = Unit(powers=tuple(int(base == of) for base in _BASES)) if of in _BASES else _product(of, units)
        units |= dict.fromkeys(names.split(), Unit().times(unit).times(Unit(Decimal(number))))
    return units


def _named(name: str, known: Mapping[str, Unit]) -> Unit | None:
    """The unit of a name, perhaps with a prefix or in the plural; None where there is none."""
    for word in (name, name.removesuffix("s") if len(name) > 2 else name):
        if word in known:
            return known[word]
        for prefix, power in _PREFIXES.items():
            unit = known.get(word.removeprefix(prefix)) if word.startswith(prefix) else None
            if unit is not None:
                return unit.times(Unit(Decimal(10) ** power))
    return None


def _product(text: str, known: Mapping[str, Unit]) -> Unit:
    """The unit of a formula such as ``kg m^2/s`` or ``N m/(rad s)``: products and quotients from left to right, integer powers
    first. Raises `ValueError` where it is no such formula."""
    place, tokens = 0, []
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None or place > _LONGEST:
            raise ValueError(text)
        tokens.append((str(match.lastgroup), match[str(match.lastgroup)]))
        place = match.end()
    tokens = [("sign", "/") if token == ("name", "per") else token for token in tokens]

    def factor() -> Unit:
        kind, token = tokens.pop(0)
        if token == "(":
            unit: Unit | None = product()
            if not tokens or tokens.pop(0)[1] != ")":
                raise ValueError(text)
        else:
            unit = _named(token, known) if kind == "name" else Unit() if token == "1" else None
        if unit is None:
            raise ValueError(text)
        power = 1
        if tokens and tokens[0][0] == "power":
            power = int(tokens.pop(0)[1].translate(str.maketrans("⁻¹²³", "-123")))
        elif len(tokens) > 1 and tokens[0][1] in ("^", "**"):
            power = int(tokens[1][1])
            del tokens[:2]
        return Unit().times(unit, power)

    def product() -> Unit:
        unit = factor()
        while tokens and tokens[0][1] != ")":
            sign = tokens.pop(0)[1] if tokens[0][1] in ("*", "·", "/") else "*"
            if not tokens:
                raise ValueError(text)
            unit = unit.times(factor(), -1 if sign == "/" else 1)
        return unit

    if not tokens:
        raise ValueError(text)
    unit = product()
    if tokens:
        raise ValueError(text)
    return unit


def is_unit(word: str) -> bool:
    """Whether a word is the name of a unit, perhaps with a prefix or in the plural."""
    return _named(word, _definitions()) is not None


@cache
def unit_of(text: str) -> Unit:
    """The unit that a text such as ``N m`` or ``kg m^2`` names. Raises `QuantityError`."""
    try:
        return _product(re.sub(r"([A-Za-zµμ])([23])\b", r"\1^\2", text), _definitions())  # people write m2 for m^2
    except (ValueError, ArithmeticError):  # a power of many digits is no unit either
        pass
    if text in _SPACED:
        raise QuantityError(f"unknown unit '{text}'.", f"Put a space between the units: '{_SPACED[text]}'.")
    words = re.findall(r"[A-Za-zµμ°]+", text)
    unknown = next((word for word in words if _named(word, _definitions()) is None), text)
    near = closest(unknown, _SYMBOLS)
    raise QuantityError(
        f"unknown unit '{unknown}'.",
        f"Did you mean '{near}'?" if near else f"Known: {', '.join(_SYMBOLS)}, and their products.",
    )


def measured(unit: Unit) -> str:
    """Quantity that a unit measures, in words."""
    for kind in UNIT_KINDS.values():
        if unit.powers == unit_of(kind.si).powers:
            return kind.words
    named = {base: f"{base} ** {abs(n)}" if abs(n) > 1 else base for base, n in zip(_BASES, unit.powers, strict=True)}
    above = [named[base] for base, n in zip(_BASES, unit.powers, strict=True) if n > 0]
    below = [named[base] for base, n in zip(_BASES, unit.powers, strict=True) if n < 0]
    return f"of the dimension {' / '.join([' * '.join(above) or '1', *below])}"


@cache
def unit_factor(text: str, kind: str) -> Decimal:
    """The factor of a unit to the SI unit of its kind. Raises `QuantityError` where the unit measures another kind."""
    unit = unit_of(text)
    wanted = UNIT_KINDS[kind]
    if unit.powers == unit_of(wanted.si).powers:  # the factor of SI units is 1
        return unit.factor
    actual = measured(unit)
    if (actual, kind) == ("a frequency", "angular speed"):
        raise QuantityError(f"{actual}, {wanted.words} is wanted.", "Write turns as rpm or turn/s, angles as deg/s or rad/s.")
    remedy = f"Write it like '{wanted.example}'."
    if (actual, kind) == ("a mass", "force"):
        remedy = f"{remedy[:-1]}; pounds and kilograms of force are lbf and kgf."
    raise QuantityError(f"{actual}, {wanted.words} is wanted.", remedy)


def split(text: str) -> tuple[str, str]:
    """A text such as ``"80 mm"`` -> number and unit, both as text. Raises `QuantityError`."""
    match = _QUANTITY.fullmatch(text)
    if match and math.isfinite(float(match["number"])):
        return match["number"], match["unit"]
    try:
        bare = float(match["number"] if match else text)
    except ValueError:
        comma = re.match(r"\s*[+-]?[0-9]+,[0-9]", text)
        hint = "Write a decimal point instead of the comma." if comma else "Write a number, or a number with its unit."
        hint = "Write the minus sign as a hyphen, '-'." if text.strip()[:1] in "\u2212\u2013" else hint
        raise QuantityError(f"'{text}' is not a number with a unit.", hint) from None
    if not math.isfinite(bare):
        raise QuantityError(f"'{text}' is not a finite number.", "Give a finite one.")
    raise QuantityError(
        f"'{text}' has no unit.", f"Write {text.strip()} without quotes to have it in the scene's units, or add a unit."
    )


def magnitude(value: float | str) -> float:
    """The number of a quantity, regardless of its unit: enough to know its sign."""
    return float(split(value)[0]) if isinstance(value, str) else value


def parse(text: str, kind: str) -> float:
    """A text with its own unit -> value in SI units. Raises `QuantityError`."""
    number, unit = split(text)
    try:
        return float(Decimal(number) * unit_factor(unit, kind))
    except QuantityError as error:
        verb = "is" if str(error).endswith("is wanted.") else "has an"
        raise QuantityError(f"'{text}' {verb} {error}", error.remedy) from None


def symbol_of(unit: str) -> str:
    """The display symbol of a unit of a scene, or of a formula of such units: "mm/s", "°", "kg m²"."""
    text = re.sub(r"(?<!/)\(([^()/]*)\)", r"\1", re.sub(r"/\(([^()/ *]*)\)", r"/\1", unit))  # not of N m/(rad s)
    text = re.sub(r"\bdeg(rees?)?\b", "°", re.sub(r"\bum\b", "µm", text)).replace("**", "^").replace("*", " ")
    return text.replace("^2", "²").replace("^3", "³")


@dataclass(frozen=True)
class Units:
    """The units of the bare numbers of a scene."""

    length: str = "m"
    angle: str = "rad"
    mass: str = "kg"
    time: str = "s"
    force: str = "N"
    torque: str = "N m"
    inertia: str = "kg m^2"

    def factor(self, kind: str) -> Decimal:
        """The factor to SI units of a bare number of this kind."""
        return unit_factor(UNIT_KINDS[kind].bare.format(**vars(self)), kind)

    def of(self, powers: tuple[int, ...]) -> str:
        """The unit with these powers of angle, length, mass and time, as a scene writes it: one of the scene's units, or a product
        of them."""
        own = next((unit for unit in vars(self).values() if unit_of(unit).powers == powers), None)
        bases = zip((self.angle, self.length, self.mass, self.time), powers, strict=True)
        return own or " ".join(unit if n == 1 else f"{unit}^{n}" for unit, n in bases if n)

    def symbol(self, kind: str) -> str:
        """The display symbol of the unit of a bare number of this kind: "mm/s", "°", "kg m²"."""
        return symbol_of(UNIT_KINDS[kind].bare.format(**vars(self)))

    def show(self, value: float, kind: str, digits: int = 6) -> str:
        """A quantity [SI] as text in the scene's units: its number, with ``digits`` significant digits, and its unit. A ``kind``
        that scenes do not know is taken for an SI unit, as in `text`."""
        if kind not in UNIT_KINDS:
            return self.text(value, kind, digits)
        return shown(value / float(self.factor(kind)), self.symbol(kind), digits)

    def si(self, value: float | str, kind: str) -> float:
        """The value in SI units of a number or a text of a scene."""
        if isinstance(value, str):
            return parse(value, kind)
        return float(Decimal(repr(float(value))) * self.factor(kind))

    def display_unit(self, si: str, *, small: bool = False) -> tuple[str, float]:
        """The display unit of values in an SI unit, such as "m", "N m" or "rad/s^2", and its factor from SI: ("mm", 1000.0).

        Lengths, angles, masses, forces, torques and moments of inertia have the scene's units. Units composed of them do, too, but
        with radians, as formulas require, and with metres where lengths are metric: "m/s", "rad/s". Pressures are in MPa where
        forces are metric. ``small``: residuals of lengths and angles, which have the units of rates.
        """
        return _display_unit(self, si, small)

    def text(self, value: float, si: str, digits: int = 5) -> str:
        """A quantity [``si``] as text in its display unit: its number, with ``digits`` significant digits, and the unit."""
        unit, factor = self.display_unit(si)
        return shown(value * factor, unit, digits)

    def decimals(self, si: str) -> int:
        """Number of decimals of a displayed coordinate: it resolves about a hundredth of a millimetre ("m", at least 2 decimals) or
        a tenth of a degree ("rad", at least 1)."""
        least, fewest = {"m": (1e-5, 2), "rad": (math.pi / 1800.0, 1)}[si]
        return max(fewest, round(-math.log10(least * self.display_unit(si)[1])))


@cache
def _display_unit(units: Units, si: str, small: bool) -> tuple[str, float]:
    alone = {} if small else {"m": units.length, "rad": units.angle}
    length = "m" if _is_decimal(units.length) else units.length
    parts = {"kg m^2": units.inertia, "N m": units.torque, "kg": units.mass, "N": units.force, "m": length}
    pressure = "MPa" if _is_decimal(units.force) else f"{units.force}/{units.length}^2"
    si = si.replace("²", "^2").replace("³", "^3")
    made = pressure if si == "Pa" else re.sub(r"kg m\^2|N m\b|\bkg\b|\bN\b|\bm\b", lambda m: parts[m[0]], si)
    unit = alone.get(si, made)
    return (symbol_of(unit), float(1 / unit_of(unit).factor)) if unit else ("", 1.0)


def _is_decimal(unit: str) -> bool:
    """Whether a unit is a power of ten of SI units."""
    return unit_of(unit).factor.normalize().as_tuple().digits == (1,)


MILLIMETRES = Units(length="mm", angle="deg")
"""Display units of values that belong to no scene."""
