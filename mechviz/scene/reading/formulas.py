"""Parameters and expressions of a scene's plain data: every expression replaced by its value, every fault with its place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import field
from decimal import Decimal
from typing import Any

import numpy as np

from mechcore.arrays import Flags, Real
from mechcore.errors import Fault
from mechcore.records import dataclass
from mechviz.scene.annotations import Leaf, Place, leaf_at, raw_leaves
from mechviz.scene.document import SceneDocument, with_values
from mechviz.scene.expressions import (
    PLAIN,
    Amount,
    Expression,
    angle_remedy,
    is_plain,
    name_fault,
    parse_expression,
    powers_of_kind,
)
from mechviz.scene.faults import did_you_mean, path_text
from mechviz.scene.fields import QuantityMark
from mechviz.scene.units import UNIT_KINDS, QuantityError, Units

RANGE_ROUNDING = 1e-12  # relative to an end of a range: how far a value may lie beyond it


@dataclass(frozen=True)
class ParameterValue:
    """A parameter in SI units: its value, its range and its tolerance; ``is_independent``: its value is not computed from other
    parameters."""

    name: str
    amount: Amount
    low: float = -math.inf
    high: float = math.inf
    tolerance: float = 0.0
    is_independent: bool = True

    def allows(self, numbers: Real) -> Flags:
        """Which numbers (...) lie in its range, up to rounding."""
        low, high = (end + sign * RANGE_ROUNDING * abs(end) for end, sign in ((self.low, -1.0), (self.high, 1.0)))
        return np.asarray((numbers >= low) & (numbers <= high))


@dataclass
class Resolved:
    """Plain data in which expressions are replaced by their values. ``formulas``: the expressions by their places; ``unknown``:
    paths of those without a value."""

    data: dict[str, Any]
    parameters: dict[str, ParameterValue] = field(default_factory=dict)
    formulas: dict[Place, str] = field(default_factory=dict)
    unknown: set[str] = field(default_factory=set)
    faults: list[Fault] = field(default_factory=list)

    @contextmanager
    def record_faults(self, path: str) -> Iterator[None]:
        """Context that records a `QuantityError` as a fault at a path."""
        try:
            yield
        except QuantityError as error:
            self.faults.append(Fault(path, str(error), error.remedy))
            self.unknown.add(path)


def resolve(raw: Mapping[str, Any]) -> Resolved:
    """The plain data of a scene with its expressions replaced by their values, in the scene's units."""
    result = Resolved(dict(raw))
    entries = raw.get("parameters", {})
    if isinstance(entries, Mapping):
        _parameters(entries, result)
    known = {name: parameter.amount for name, parameter in result.parameters.items()}
    faulty = set(entries) - set(known) if isinstance(entries, Mapping) else set()
    units = _units(raw.get("units"))
    values: dict[Place, Any] = {}
    for leaf in raw_leaves(raw, SceneDocument):
        if not isinstance(leaf.value, str) or leaf.path[0] in ("parameters", "units") or not _takes_expression(leaf):
            continue
        if is_plain(leaf.value) or (not entries and not _has_operator(leaf.value)):
            continue
        path = path_text(leaf.path)
        values[leaf.path] = math.nan
        with result.record_faults(path):
            expression = parse_expression(leaf.value)
            if faulty.intersection(expression.names):
                result.unknown.add(path)
            else:
                values[leaf.path] = _value_at(leaf, expression, known, units)
                result.formulas[leaf.path] = expression.text
    if values:
        result.data = with_values(result.data, values)
    return result


def reevaluate(document: SceneDocument, changes: Mapping[Place, Any]) -> tuple[dict[Place, Any], list[Fault]]:
    """The values of a document's expressions after a change of its parameters, in the scene's units, and their faults."""
    result = Resolved(with_values({"parameters": document.parameters_data}, changes))
    _parameters(result.data["parameters"], result)
    known = {name: parameter.amount for name, parameter in result.parameters.items()}
    units = _units(document.units.model_dump())
    values: dict[Place, Any] = {}
    for place, text in document.formulas.items():
        with result.record_faults(path_text(place)):
            values[place] = _value_at(leaf_at(document, place), parse_expression(text), known, units)
    return values, result.faults


def parameter_changes(document: SceneDocument, values: Mapping[str, float | str]) -> tuple[dict[Place, Any], list[Fault]]:
    """The changes of a document that give parameters other values, and the faults of these values."""
    entries = document.parameters_data
    known = resolve({"parameters": entries}).parameters
    changes: dict[Place, Any] = {}
    faults = []
    for name, value in values.items():
        path = f"parameters.{name}"
        if name not in known:
            what = did_you_mean(name, known, what="There are") or "The scene has none: write them under [parameters]."
            faults.append(Fault(path, f"there is no parameter '{name}'.", what))
            continue
        given = _expression_or_none(value)
        amounts = {other: parameter.amount for other, parameter in known.items()}
        if given is not None and set(given.names) <= set(known):
            amount, before = given.value(amounts), known[name].amount
            if amount.powers != before.powers:
                faults.append(Fault(path, f"'{value}' is {amount.words}, {name} is {before.words}.", "Give a value of that kind."))
        changes["parameters", name, *(["value"] if isinstance(entries[name], Mapping) else [])] = value
    return changes, faults


def parameter_arrays(document: SceneDocument, values: Mapping[str, Real]) -> dict[str, Amount]:
    """All parameters of many designs in SI units: the ``values`` (D,) of some, and the others evaluated from them."""
    entries = document.parameters_data
    known = resolve({"parameters": entries}).parameters
    amounts = {name: Amount(own, known[name].amount.powers) for name, own in values.items()}
    waiting = {
        name: _expression(e.get("value") if isinstance(e, Mapping) else e) for name, e in entries.items() if name not in amounts
    }
    while waiting:
        for name in [name for name, e in waiting.items() if amounts.keys() >= set(e.names)]:
            amounts[name] = waiting.pop(name).value(amounts)
    return amounts


def formula_values(document: SceneDocument, amounts: Mapping[str, Amount], places: Iterable[Place]) -> dict[Place, Real]:
    """The values (D,) in SI units of the expressions at some places, for parameters of many designs."""
    return {place: np.asarray(parse_expression(document.formulas[place]).value(amounts).number, float) for place in places}


def parameters_behind(document: SceneDocument, place: Place) -> set[str]:
    """The parameters on which the expression at a place depends, directly or through others."""
    entries = document.parameters_data
    names: set[str] = set()
    waiting = list(parse_expression(document.formulas[place]).names)
    while waiting:
        name = waiting.pop()
        if name not in names:
            names.add(name)
            entry = entries[name]
            waiting += _expression(entry.get("value") if isinstance(entry, Mapping) else entry).names
    return names


def parameter_words(document: SceneDocument) -> list[str]:
    """Each parameter of a document with its value, range and tolerance, as text: ``throw = stroke/2 = 40 mm``."""
    entries = document.parameters_data
    units = _units(document.units.model_dump())
    lines = []
    for name, known in resolve({"parameters": entries}).parameters.items():
        entry = entries[name]
        table = entry if isinstance(entry, Mapping) else {"value": entry}
        kind = next((kind for kind in UNIT_KINDS if powers_of_kind(kind) == known.amount.powers), None)
        number = float(known.amount.number)
        value = f"{number:.6g}" if kind is None or known.amount.powers == PLAIN else units.show(number, kind)
        words = f"{name} = {table['value']}" + ("" if known.is_independent else f" = {value}")
        words += f", from {table['range'][0]} to {table['range'][1]}" if "range" in table else ""
        lines.append(words + (f", ± {table['tolerance']}" if "tolerance" in table else ""))
    return lines


def _expression_or_none(value: object) -> Expression | None:
    with suppress(QuantityError):
        return _expression(value)
    return None


def _units(raw: object) -> Units:
    """The scene's units, as far as they can be read."""
    try:
        units = Units(**raw) if isinstance(raw, Mapping) else Units()
        for kind in vars(units):
            units.factor(kind)
    except (TypeError, AttributeError, QuantityError):
        return Units()
    return units


def _takes_expression(leaf: Leaf) -> bool:
    quantity = leaf.mark(QuantityMark)
    if quantity is not None:
        return not quantity.word or leaf.value != quantity.word
    return leaf.kind in (int, float)


def _has_operator(text: str) -> bool:
    """Whether a text of a scene without parameters is meant as an expression."""
    return any(sign in text for sign in "*(") or " + " in text or " - " in text


def _value_at(leaf: Leaf, expression: Expression, known: Mapping[str, Amount], units: Units) -> float | int:
    """The value of an expression as a bare number of its place. Raises `QuantityError` where it is of another kind."""
    amount = expression.value(known)
    number = float(amount.number)
    quantity = leaf.mark(QuantityMark)
    if quantity is None:
        if any(amount.powers):
            raise QuantityError(
                f"'{expression.text}' is {amount.words}, a plain number is wanted.", "Divide it by one of its kind."
            )
        if leaf.kind is float:
            return number
        if abs(number - round(number)) > 1e-9 * max(1.0, abs(number)):
            raise QuantityError(f"'{expression.text}' is {number:g}, a whole number is wanted.", "Choose the parameters so.")
        return round(number)
    kind = next((kind for kind in quantity.kinds if powers_of_kind(kind) == amount.powers), None)
    if kind is None:
        words = " or ".join(UNIT_KINDS[each].words for each in quantity.kinds)
        remedy = f"Multiply a plain number by its unit, such as 1 {units.symbol(quantity.kinds[0])}."
        remedy = remedy if not any(amount.powers) else "Check its parameters and units."
        remedy = angle_remedy(amount.powers, powers_of_kind(quantity.kinds[0]), remedy)
        raise QuantityError(f"'{expression.text}' is {amount.words}, {words} is wanted.", remedy)
    return float(Decimal(repr(number)) / units.factor(kind))


# -- parameters -------------------------------------------------------------------------------------------------------
def _parameters(entries: Mapping[str, Any], result: Resolved) -> None:
    """Evaluate the parameters into ``result``, each after those that it names."""
    expressions: dict[str, Expression] = {}
    for name, entry in entries.items():
        wrong = name_fault(str(name))
        if wrong is not None:
            result.faults.append(Fault(f"parameters.{name}", *wrong))
            continue
        value = entry.get("value") if isinstance(entry, Mapping) else entry
        path = f"parameters.{name}.value" if isinstance(entry, Mapping) else f"parameters.{name}"
        with result.record_faults(path):
            expressions[name] = _expression(value)
    amounts: dict[str, Amount] = {}
    waiting = dict(expressions)
    while waiting:
        ready = [name for name, e in waiting.items() if not waiting.keys() & set(e.names)]
        if not ready:
            _note_cycles(waiting, result)
            break
        for name in sorted(ready, key=lambda name: bool(waiting[name].names)):
            expression = waiting.pop(name)
            if all(inner in amounts or inner not in entries for inner in expression.names):
                with result.record_faults(f"parameters.{name}"):
                    amounts[name] = expression.value(amounts)
    for name in entries:
        if name in amounts:
            _bounds(name, entries[name], expressions[name], amounts, result)


def _expression(value: object) -> Expression:
    """The expression of a parameter's value, which may be a number. Raises `QuantityError` where it is invalid."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise QuantityError("a parameter without a value.", "Write it like r = '30 mm'; a plain number has no unit.")
    if isinstance(value, str):
        return parse_expression(value.strip())
    number = Amount(float(value))
    if not np.isfinite(number.number):
        raise QuantityError(f"{value} is not a finite number.", "Give a finite one.")
    return Expression(repr(value), (), lambda _: number)


def _note_cycles(waiting: Mapping[str, Expression], result: Resolved) -> None:
    """Note each cycle of parameters that depend on each other; parameters that only depend on one of a cycle give no fault."""
    named: set[str] = set()
    for first in waiting:
        chain = [first]
        while True:
            after = next((name for name in waiting[chain[-1]].names if name in waiting), None)
            if after is None or after in chain:
                break
            chain.append(after)
        circle = chain[chain.index(after) :] if after in chain else []
        if circle and first in circle and not named.intersection(circle):
            named.update(circle)
            words = " -> ".join([*circle, circle[0]])
            said = f"follows from itself: {words}." if len(circle) > 1 else f"'{waiting[first].text}' names itself."
            result.faults.append(Fault(f"parameters.{first}", said, "Give one of them a value of its own."))


def _bounds(name: str, entry: object, expression: Expression, amounts: Mapping[str, Amount], result: Resolved) -> None:
    """Add a parameter with its range and tolerance, which must be of its kind, to ``result``."""
    amount, path = amounts[name], f"parameters.{name}"
    numbers: dict[str, float] = {}
    stated = entry if isinstance(entry, Mapping) else {}
    limits = stated.get("range")
    pair = limits if isinstance(limits, list | tuple) and len(limits) == 2 else (None, None)
    for key, value in (("range[0]", pair[0]), ("range[1]", pair[1]), ("tolerance", stated.get("tolerance"))):
        if value is not None:
            with result.record_faults(f"{path}.{key}"):
                known = {inner: amounts[inner] for inner in amounts if inner != name or key == "tolerance"}
                other = _expression(value).value(known)
                if other.powers != amount.powers:
                    raise QuantityError(f"{value!r} is {other.words}, {name} is {amount.words}.", "Give it a unit of that kind.")
                numbers[key] = float(other.number)
    low, high = numbers.get("range[0]", -math.inf), numbers.get("range[1]", math.inf)
    own = not expression.names
    if low >= high:
        result.faults.append(Fault(f"{path}.range", "begins where it ends, or above.", "Give the smaller value first."))
    elif not low * (1.0 - 1e-12 * np.sign(low)) <= float(amount.number) <= high * (1.0 + 1e-12 * np.sign(high)):
        result.faults.append(Fault(path, f"'{expression.text}' is outside of its range.", "Change the value, or widen its range."))
    if numbers.get("tolerance", 0.0) < 0.0:
        result.faults.append(Fault(f"{path}.tolerance", "is negative.", "It counts either way: give it without a sign."))
    result.parameters[name] = ParameterValue(name, amount, low, high, abs(numbers.get("tolerance", 0.0)), own)
