"""Designs of a study: variations of parameters, grids of them, and samples that fill their ranges."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from mechcore.arrays import Real
from mechcore.errors import Fault, MechanismError
from mechcore.records import dataclass
from mechviz.scene.faults import did_you_mean
from mechviz.scene.scene import Scene
from mechviz.scene.units import QuantityError, split, unit_of

MOST_DESIGNS = 10_000_000
_SHAPE = re.compile(r"\s*(?P<name>[^\W\d][^=:]*?)\s*(?:=\s*(?P<what>[^:]+?))?\s*(?::\s*(?P<count>\d+))?\s*")


@dataclass(frozen=True)
class Variation:
    """A parameter that varies over a list of ``values``, or from ``low`` to ``high``, in ``unit`` ("" for plain numbers).
    ``count``: number of values of a range in a grid, 0 where it is not given."""

    name: str
    unit: str
    values: tuple[float, ...] = ()
    low: float = math.nan
    high: float = math.nan
    count: int = 0

    @property
    def title(self) -> str:
        """Name and unit, the heading of the parameter's column in tables."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def factor(self) -> float:
        """Value of its unit in SI units."""
        return float(unit_of(self.unit).factor) if self.unit else 1.0

    def stated(self, value: float) -> float | str:
        """A value as a scene states it."""
        return f"{value!r} {self.unit}" if self.unit else value


def parse_variation(scene: Scene, text: str) -> Variation:
    """The variation that a text such as ``r=30..60mm:31``, ``speed=60rpm,120rpm`` or ``r:31`` names. Raises `MechanismError`."""
    match = _SHAPE.fullmatch(text)
    if match is None:
        raise _wrong(text, "is no variation.", "Write it like r=30..60mm:31, r=30mm,40mm,55mm or r:31.")
    name, what, count = match["name"], match["what"], int(match["count"] or 0)
    known = scene.parameters.get(name)
    if known is None:
        words = did_you_mean(name, scene.parameters, what="There are") or "Name the values that vary under [parameters]."
        if "." in name:
            words = f"Name its value under [parameters], as r = '40 mm', write \"r\" at {name}, and vary r."
            raise _wrong(text, f"'{name}' is no parameter, and only those vary in sweeps.", words)
        raise _wrong(text, f"the scene has no parameter '{name}'.", words)
    if what is None:
        low, high, unit = _own_range(scene, text, name)
        return Variation(name, unit, low=low, high=high, count=count)
    ends = what.split("..")
    parts = [part.strip() for part in (ends if len(ends) == 2 else what.split(","))]
    try:
        pairs = [_number(part) for part in parts]
    except (QuantityError, ValueError):
        raise _wrong(text, f"'{what}' holds what is no number.", "Write it like 30..60mm, or 30mm,40mm,55mm.") from None
    units = [unit for _, unit in pairs]
    shared = units[-1]
    for unit in filter(None, units):
        if unit_of(unit).powers != known.amount.powers:
            raise _wrong(text, f"'{unit}' is no unit of {name}, which is {known.amount.words}.", "Give values of that kind.")
    if not shared and any(known.amount.powers):
        raise _wrong(text, f"{name} is {known.amount.words}, and the values have no unit.", "Write it behind the last: 30..60mm.")
    values = [number if unit in ("", shared) else number * _per(unit, shared) for number, unit in pairs]
    if len(ends) != 2:
        if count:
            raise _wrong(text, "a list has its own number of values.", "Leave out the number behind the colon.")
        return Variation(name, shared, values=tuple(values))
    if not values[0] < values[1]:
        raise _wrong(text, "the range begins where it ends, or above.", "Give the smaller value first.")
    return Variation(name, shared, low=values[0], high=values[1], count=count)


def _wrong(text: str, message: str, remedy: str) -> MechanismError:
    return MechanismError(Fault(f"--vary {text}", message, remedy))


def _number(text: str) -> tuple[float, str]:
    """Number and unit of a text. Raises `QuantityError` or `ValueError`."""
    try:
        value = float(text)
    except ValueError:
        number, unit = split(text)
        unit_of(unit)
        return float(number), unit
    if not math.isfinite(value):
        raise ValueError(text)
    return value, ""


def _per(unit: str, other: str) -> float:
    return float(unit_of(unit).factor / unit_of(other).factor)


def _own_range(scene: Scene, text: str, name: str) -> tuple[float, float, str]:
    """The range that the scene gives a parameter, in the unit of its upper end."""
    entry = scene.document.to_data()["parameters"][name]
    stated = entry.get("range") if isinstance(entry, dict) else None
    if stated is None:
        raise _wrong(text, f"'{name}' has no range in the scene.", f"Give one here: {name}=30..60mm.")
    known = scene.parameters[name]
    unit = ""
    if any(known.amount.powers):
        try:
            unit = split(str(stated[1]))[1]
            per = float(unit_of(unit).factor)
        except QuantityError:
            raise _wrong(text, f"the range of '{name}' is an expression.", f"Give one here: {name}=30..60mm.") from None
    else:
        per = 1.0
    return float(f"{known.low / per:.15g}"), float(f"{known.high / per:.15g}"), unit


def grid(variations: Sequence[Variation]) -> Real:
    """All combinations (D, n) of the values of n variations; the last one varies fastest. Raises `MechanismError`."""
    axes = []
    for v in variations:
        if not v.values and v.count < 1:
            remedy = f"Write {v.name}={v.low:g}..{v.high:g}{v.unit}:31, or sample the ranges with --sample."
            raise MechanismError(Fault(f"--vary {v.name}", "a grid needs to know how many values it takes.", remedy))
        axes.append(np.asarray(v.values) if v.values else np.linspace(v.low, v.high, v.count))
    total = math.prod(len(axis) for axis in axes)
    if total > MOST_DESIGNS:
        raise MechanismError(Fault("--vary", f"{total} designs are more than {MOST_DESIGNS}.", "Take fewer values of each."))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


@dataclass(frozen=True)
class Sample:
    """A sample of ``count`` designs that fill the ranges: ``lhs`` Latin hypercube, ``sobol`` scrambled Sobol points (a power of
    two)."""

    method: str
    count: int
    seed: int = 0


def parse_sample(text: str, seed: int) -> Sample:
    """The sample that a text such as ``lhs:200`` names. Raises `MechanismError`."""
    method, _, count = text.partition(":")
    if method not in ("lhs", "sobol") or not count.isdecimal() or not 0 < int(count) <= MOST_DESIGNS:
        raise MechanismError(Fault(f"--sample {text}", "is no sample.", "Write lhs:200, or sobol:256."))
    number = int(count)
    if method == "sobol" and number & (number - 1):
        below = 1 << (number.bit_length() - 1)
        raise MechanismError(
            Fault(f"--sample {text}", "Sobol points are balanced for powers of two only.", f"Take {below} or {2 * below}.")
        )
    return Sample(method, number, seed)


def unit_sample(sample: Sample, dimensions: int) -> Real:
    """Points (D, n) of a sample in the unit cube."""
    from scipy.stats import qmc

    if sample.method == "lhs":
        points = qmc.LatinHypercube(d=dimensions, seed=sample.seed).random(sample.count)
    else:
        points = qmc.Sobol(d=dimensions, scramble=True, seed=sample.seed).random(sample.count)
    return np.asarray(points, float)


def sampled(variations: Sequence[Variation], sample: Sample) -> Real:
    """Designs (D, n) that fill the ranges of n variations. Raises `MechanismError`."""
    for v in variations:
        if v.values or v.count:
            raise MechanismError(Fault(f"--vary {v.name}", "a sample fills ranges.", f"Write {v.name}=LOW..HIGH without a number."))
    low, high = (np.array([getattr(v, end) for v in variations]) for end in ("low", "high"))
    return np.asarray(low + (high - low) * unit_sample(sample, len(variations)))
