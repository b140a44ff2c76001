"""Expressions of quantities, such as ``2*r + 5 mm``: a parser that knows units and does not use Python's.

A unit directly follows a number or a bracket (``5 mm``, ``(n + 1) mm``); names after an operator are parameters. Angles count as a
dimension: ``v/r`` is no angular speed, ``v/r * 1 rad`` is one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from decimal import Decimal
from functools import lru_cache

import numpy as np

from mechcore.arrays import Real
from mechcore.records import dataclass
from mechviz.scene.faults import did_you_mean
from mechviz.scene.units import UNIT_KINDS, QuantityError, Unit, is_unit, measured, split, unit_of

NumberOrArray = float | Real
Powers = tuple[int, ...]

PLAIN: Powers = (0, 0, 0, 0)
ANGLE: Powers = (1, 0, 0, 0)
LONGEST_EXPRESSION = 500  # characters of an expression
DEEPEST_NESTING = 40  # brackets inside each other

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(?P<name>[^\W\d]\w*|°)|(?P<sign>\*\*|[-+*·/^(),]))"
)
_NAME = re.compile(r"[^\W\d]\w*")
_BRACKET = re.compile(r"/\s*\(([\w°Ω^*·/ ⁻¹²³-]+)\)")


class ExpressionError(QuantityError):
    """An expression is invalid; ``remedy`` says what to write instead."""


@dataclass(frozen=True)
class Amount:
    """A number in SI units with its powers of angle, length, mass and time; for many designs an array (D,)."""

    number: NumberOrArray
    powers: Powers = PLAIN

    @property
    def words(self) -> str:
        """Quantity that it measures, in words."""
        return "a plain number" if self.powers == PLAIN else measured(Unit(powers=self.powers))


AmountFunction = Callable[[Mapping[str, Amount]], Amount]


@dataclass(frozen=True)
class Expression:
    """An expression: its text, the names of the parameters in it, and the function that evaluates it."""

    text: str
    names: tuple[str, ...]
    _evaluate: AmountFunction

    def value(self, known: Mapping[str, Amount]) -> Amount:
        """Its value. Raises `ExpressionError` where a name is unknown, units are incompatible or a single value is not finite;
        values in an array (D,) need not be finite."""
        for name in self.names:
            if name not in known:
                what = did_you_mean(name, [*known, *FUNCTIONS, "pi"], what="Parameters and functions")
                raise ExpressionError(f"unknown parameter '{name}'" + (f" in '{self.text}'." if name != self.text else "."), what)
        with np.errstate(all="ignore"):
            amount = self._evaluate(known)
        if not np.all(np.isfinite(amount.number)) and np.ndim(amount.number) == 0:
            raise ExpressionError(f"'{self.text}' has no finite value.", "It divides by zero, or takes the root of a negative.")
        return amount


def is_plain(text: str) -> bool:
    """Whether a text is a number with a unit, and no expression."""
    try:
        unit_of(split(text)[1])
    except QuantityError:
        return False
    return True


def name_fault(name: str) -> tuple[str, str] | None:
    """Why a parameter cannot have a name, and the remedy; None where it can."""
    if not _NAME.fullmatch(name):
        return f"'{name}' cannot stand in an expression.", "Use letters, digits and underscores, a letter first."
    if name in FUNCTIONS or name == "pi":
        return f"'{name}' has its own meaning in expressions.", f"Call it otherwise, such as '{name}_1'."
    if is_unit(name):
        return f"'{name}' is the symbol of a unit.", f"Call it otherwise, such as '{name}_1'."
    return None


def angle_remedy(powers: Powers, required: Powers, remedy: str) -> str:
    """Remedy for a value whose powers are not those required: a factor of radians where they differ only in the angle, else
    ``remedy``."""
    if powers[1:] != required[1:]:
        return remedy
    turns = required[0] - powers[0]
    power = "" if abs(turns) == 1 else f"^{abs(turns)}"
    return f"Angles count as a dimension: {'multiply' if turns > 0 else 'divide'} by 1 rad{power}."


# -- functions --------------------------------------------------------------------------------------------------------
def _of_angle(function: Callable[[NumberOrArray], NumberOrArray]) -> Callable[[str, list[Amount]], Amount]:
    def called(text: str, values: list[Amount]) -> Amount:
        if values[0].powers != ANGLE:
            raise ExpressionError(f"'{text}' is of {values[0].words}, not of an angle.", "Give it an angle, such as 30 deg.")
        return Amount(function(values[0].number))

    return called


def _to_angle(function: Callable[[NumberOrArray], NumberOrArray]) -> Callable[[str, list[Amount]], Amount]:
    def called(text: str, values: list[Amount]) -> Amount:
        if values[0].powers != PLAIN:
            raise ExpressionError(f"'{text}' is of {values[0].words}, not of a plain number.", "Divide it by one of its kind.")
        return Amount(function(values[0].number), ANGLE)

    return called


def _root(text: str, values: list[Amount]) -> Amount:
    (value,) = values
    if any(power % 2 for power in value.powers):
        raise ExpressionError(f"'{text}' is the root of {value.words}, which measures nothing.", "Take the root of a square.")
    return Amount(np.sqrt(value.number), tuple(power // 2 for power in value.powers))


def _one_of(function: Callable[[NumberOrArray, NumberOrArray], NumberOrArray]) -> Callable[[str, list[Amount]], Amount]:
    def called(text: str, values: list[Amount]) -> Amount:
        result = values[0]
        for value in values[1:]:
            _alike(text, result, value, "compares")
            result = Amount(function(result.number, value.number), result.powers)
        return result

    return called


def _alike(text: str, first: Amount, second: Amount, verb: str) -> None:
    if first.powers != second.powers:
        plain = PLAIN in (first.powers, second.powers)
        remedy = "Give the plain number a unit, such as 5 mm." if plain else "Check the units."
        raise ExpressionError(f"'{text}' {verb} {first.words} and {second.words}.", remedy)


FUNCTIONS: Mapping[str, tuple[int | None, Callable[[str, list[Amount]], Amount]]] = {
    "sin": (1, _of_angle(np.sin)),
    "cos": (1, _of_angle(np.cos)),
    "tan": (1, _of_angle(np.tan)),
    "asin": (1, _to_angle(np.arcsin)),
    "acos": (1, _to_angle(np.arccos)),
    "atan": (1, _to_angle(np.arctan)),
    "sqrt": (1, _root),
    "abs": (1, lambda _, values: Amount(np.abs(values[0].number), values[0].powers)),
    "min": (None, _one_of(np.minimum)),
    "max": (None, _one_of(np.maximum)),
}
"""Functions by name: their number of arguments (None: one or more), and their evaluation."""


# -- parsing ----------------------------------------------------------------------------------------------------------
@lru_cache(maxsize=4096)
def parse_expression(text: str) -> Expression:
    """The expression of a text. Raises `ExpressionError` where it is none."""
    if len(text) > LONGEST_EXPRESSION:
        raise ExpressionError(f"an expression of {len(text)} characters.", f"Keep it under {LONGEST_EXPRESSION}.")
    return _Parser(text).whole()


class _Parser:
    """Recursive descent: sums of products of powers of numbers, parameters, functions and brackets."""

    def __init__(self, text: str):
        self.text, self.names, self.depth = text, dict[str, None](), 0
        self.tokens: list[tuple[str, str, int, int]] = []  # kind, token, start, end
        place, end = 0, len(text.rstrip())
        while place < end:
            match = _TOKEN.match(text, place)
            if match is None:
                comma = "Write a decimal point instead of the comma." if re.search(r"\d,\d", text) else ""
                sign = text[place:].lstrip()[0]
                raise ExpressionError(f"'{text}' holds '{sign}', which has no meaning there.", comma or "See docs/scenes.md.")
            kind = str(match.lastgroup)
            self.tokens.append((kind, match[kind], match.start(kind), match.end()))
            place = match.end()
        self.at = 0

    def whole(self) -> Expression:
        evaluate = self.sum()
        if self.at < len(self.tokens):
            raise self.wrong()
        return Expression(self.text.strip(), tuple(self.names), evaluate)

    def wrong(self) -> ExpressionError:
        """The fault of the present token, or of the end."""
        said = f"'{self.text}' is no expression"
        if self.at >= len(self.tokens):
            return ExpressionError(f"{said}: it ends too early.", "Something is missing at its end.")
        token = self.tokens[self.at][1]
        if token == "," and re.search(r"\d,\d", self.text):
            return ExpressionError(f"{said}: ',' stands where nothing can.", "Write a decimal point instead of the comma.")
        return ExpressionError(f"{said}: '{token}' stands where it cannot.", "Write products with *, such as 2*r.")

    def peek(self, ahead: int = 0) -> str:
        """The next sign or name, "" at the end or before a number."""
        place = self.at + ahead
        return self.tokens[place][1] if place < len(self.tokens) and self.tokens[place][0] != "number" else ""

    def kind(self, ahead: int = 0) -> str:
        place = self.at + ahead
        return self.tokens[place][0] if place < len(self.tokens) else ""

    def take(self) -> str:
        self.at += 1
        return self.tokens[self.at - 1][1]

    def expect(self, sign: str) -> None:
        if self.peek() != sign:
            raise self.wrong()
        self.at += 1

    def since(self, start: int) -> str:
        """The text from a token to the last one taken."""
        return self.text[self.tokens[start][2] : self.tokens[self.at - 1][3]]

    def sum(self) -> AmountFunction:
        self.depth += 1
        if self.depth > DEEPEST_NESTING:
            raise ExpressionError(f"'{self.text[:40]}...' nests brackets too deep.", "Name a part of it as a parameter.")
        start, total = self.at, self.product()
        while self.peek() in ("+", "-"):
            sign = 1.0 if self.take() == "+" else -1.0
            total = _added(total, self.product(), sign, self.since(start))
        self.depth -= 1
        return total

    def product(self) -> AmountFunction:
        result = self.signed()
        while self.peek() in ("*", "·", "/"):
            result = _multiplied(result, self.take() != "/", self.signed())
        return result

    def signed(self) -> AmountFunction:
        if self.peek() in ("+", "-"):
            negative = self.take() == "-"
            inner = self.signed()
            return _negated(inner) if negative else inner
        return self.power()

    def power(self) -> AmountFunction:
        start, base = self.at, self.with_unit()
        if self.peek() not in ("^", "**"):
            return base
        self.take()
        negative = self.peek() == "-"
        self.at += negative
        exponent = self.primary()
        return _raised(base, _negated(exponent) if negative else exponent, self.since(start))

    def with_unit(self) -> AmountFunction:
        start, value = self.at, self.primary()
        if self.kind() != "name":
            return value
        unit = self.unit()
        if self.tokens[start][0] == "number":  # exact, as for values that are no expressions
            stated = Amount(float(Decimal(self.tokens[start][1]) * unit.factor), unit.powers)
            return lambda _: stated
        return lambda known: _product(value(known), Amount(float(unit.factor), unit.powers), True)

    def primary(self) -> AmountFunction:
        kind, start = self.kind(), self.at
        if kind == "number":
            number = Amount(float(self.take()))
            return lambda _: number
        if self.peek() == "(":
            self.at += 1
            inner = self.sum()
            self.expect(")")
            return inner
        if kind != "name":
            raise self.wrong()
        name = self.take()
        if self.peek() == "(":
            return self.call(name, start)
        if name == "pi":
            return lambda _: Amount(np.pi)
        self.names[name] = None
        return lambda known: known[name]

    def call(self, name: str, start: int) -> AmountFunction:
        if name not in FUNCTIONS:
            what = did_you_mean(name, FUNCTIONS, what="Functions")
            raise ExpressionError(f"'{self.text}' calls '{name}', which is no function.", what)
        self.expect("(")
        values = [self.sum()]
        while self.peek() == ",":
            self.at += 1
            values.append(self.sum())
        self.expect(")")
        count, function = FUNCTIONS[name]
        text = self.since(start)
        if count is not None and len(values) != count:
            raise ExpressionError(f"'{text}' has {len(values)} values, {name} takes {count}.", f"Write it like {name}(...).")
        return lambda known: function(text, [value(known) for value in values])

    def unit(self) -> Unit:
        """The unit that begins here: names side by side, and products and quotients with other names of units."""
        start = self.at
        self.unit_factor()
        while True:
            if self.kind() == "name":
                self.unit_factor()
            elif self.peek() in ("*", "·", "/") and is_unit(_bare(self.peek(1))) and self.peek(2) != "(":
                self.at += 1
                self.unit_factor()
            else:
                end = self.tokens[self.at - 1][3]
                bracket = _BRACKET.match(self.text, self.tokens[self.at][2]) if self.peek() == "/" else None
                words = re.findall(r"[^\W\d]+|°", bracket[1]) if bracket else []
                if bracket is None or not words or not all(is_unit(_bare(word)) for word in words):
                    break
                end = bracket.end()
                while self.at < len(self.tokens) and self.tokens[self.at][2] < end:
                    self.at += 1
                break
        return unit_of(self.text[self.tokens[start][2] : end])

    def unit_factor(self) -> None:
        word = self.take()
        if not is_unit(_bare(word)):
            self.at -= 1
            raise ExpressionError(
                f"'{word}' in '{self.text}' stands directly after a value and is no unit.", f"Write *{word} if it is a factor."
            )
        if self.peek() in ("^", "**") and self.kind(1 + (self.peek(1) == "-")) == "number":
            self.at += 2 + (self.peek(1) == "-")


def _bare(word: str) -> str:
    """The name of a unit without its power in superscript digits."""
    return word.rstrip("⁻¹²³")


# -- evaluation -------------------------------------------------------------------------------------------------------
def _added(first: AmountFunction, second: AmountFunction, sign: float, text: str) -> AmountFunction:
    def evaluate(known: Mapping[str, Amount]) -> Amount:
        a, b = first(known), second(known)
        _alike(text, a, b, "adds" if sign > 0 else "subtracts")
        return Amount(a.number + sign * b.number, a.powers)

    return evaluate


def _product(a: Amount, b: Amount, times: bool) -> Amount:
    sign = 1 if times else -1
    number = a.number * b.number if times else np.divide(a.number, b.number)
    return Amount(number, tuple(x + sign * y for x, y in zip(a.powers, b.powers, strict=True)))


def _multiplied(first: AmountFunction, times: bool, second: AmountFunction) -> AmountFunction:
    return lambda known: _product(first(known), second(known), times)


def _negated(inner: AmountFunction) -> AmountFunction:
    def evaluate(known: Mapping[str, Amount]) -> Amount:
        value = inner(known)
        return Amount(-value.number, value.powers)

    return evaluate


def _raised(base: AmountFunction, exponent: AmountFunction, text: str) -> AmountFunction:
    def evaluate(known: Mapping[str, Amount]) -> Amount:
        value, power = base(known), exponent(known)
        if power.powers != PLAIN:
            raise ExpressionError(f"'{text}' has {power.words} as its power.", "Powers are plain numbers.")
        if value.powers == PLAIN:
            return Amount(np.power(value.number, power.number))
        whole = float(np.ravel(power.number)[0])
        if np.ndim(power.number) or not whole.is_integer() or abs(whole) > 12:
            raise ExpressionError(f"'{text}' is no whole power of {value.words}.", "Give a whole power, or use sqrt(...).")
        return Amount(np.power(value.number, whole), tuple(int(whole) * p for p in value.powers))

    return evaluate


def powers_of_kind(kind: str) -> Powers:
    """The powers of angle, length, mass and time of a kind of quantity."""
    return unit_of(UNIT_KINDS[kind].si).powers
