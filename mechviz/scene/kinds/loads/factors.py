"""Factors of loads: functions of time, or of the motion of a joint or a point, that multiply a value."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from mechcore.errors import Fault
from mechcore.laws.timed import Table
from mechcore.spec.loads import Factor, Polynomial
from mechviz.scene.convert import LARGEST, likely_sort
from mechviz.scene.kinds.loads.base import LoadMaker
from mechviz.scene.kinds.signals import SIGNALS, FactorPolynomial, FactorTable, signal_of
from mechviz.scene.names import (
    known_drive,
    known_joint,
    known_place,
    split_point,
)

if TYPE_CHECKING:
    from mechviz.scene.kinds.loads.document import LoadDocument
    from mechviz.scene.reading.recovery import Reading


FACTORS = ("table", "polynomial", *SIGNALS)
"""Keys by which a load is multiplied by a factor: one of them at most."""

_ARGUMENT_KINDS = {
    "time": "time",
    "x": "length",
    "y": "length",
    "vx": "linear speed",
    "vy": "linear speed",
    "speed": "linear speed",
}
_RATES = {"angle": "angular speed", "length": "linear speed"}


def factor_of(m: LoadMaker) -> Factor | None:
    """The factor of a load, None where there is none or a fault was noted."""
    for key in SIGNALS:
        if (signal := getattr(m.load, key)) is not None:
            found = signal_of(key, signal, m.convert, f"{m.path}.{key}")
            return None if found is None else Factor(function=found, of="time")
    given: FactorTable | FactorPolynomial | None = m.load.table or m.load.polynomial
    if given is None:
        return None
    joint = given.joint or given.drive
    point = None if given.point is None else split_point(m.reading, given.point)
    kind = _argument_kind(m, given.of, joint) or _likely_kind(given)
    if isinstance(given, FactorTable):
        function: Table | Polynomial | None = _table(m, given, kind)
    else:
        path = f"{m.path}.polynomial"
        per = m.convert.si(1.0 if given.per is None else given.per, kind, f"{path}.per")
        function = (
            Polynomial(tuple(given.coefficients), per=per) if _moderate(m, given.coefficients, f"{path}.coefficients") else None
        )
    if function is None or (given.point is not None and point is None):
        return None
    return Factor(function=function, of=given.of, joint=joint, point=point)  # type: ignore[arg-type] # one of ARGUMENTS


def _argument_kind(m: LoadMaker, of: str, joint: str | None) -> str | None:
    """The kind of quantity that a factor depends on; None where its joint is not there."""
    if of in _ARGUMENT_KINDS:
        return _ARGUMENT_KINDS[of]
    first = m.lead or next((name for name, p in m.document.joints.items() if p.led), None)
    found = m.document.joints.get(joint or first or "")
    if found is None or len(found.kinds) > 1:
        return None
    sort = "length" if found.kind in ("prismatic", "pin_slot", "rolling", "cylinder") else "angle"
    return sort if of == "position" else _RATES[sort]


def _likely_kind(given: FactorTable | FactorPolynomial) -> str:
    """The kind where the joint is not known: that of the values as they are written."""
    sort = likely_sort(given)
    return sort if given.of == "position" else _RATES.get(sort, "time")


def _moderate(m: LoadMaker, values: list[float], path: str) -> bool:
    """Notes the first number that is beyond all measure."""
    for k, value in enumerate(values):
        if abs(value) > LARGEST:
            m.convert.note(f"{path}[{k}]", f"{value:g} is beyond {LARGEST:g}.", "Check the number.")
            return False
    return True


def _table(m: LoadMaker, given: FactorTable, kind: str) -> Table | None:
    convert, path = m.convert, f"{m.path}.table"
    x, y = convert.row(getattr(given, given.of) or (), kind, f"{path}.{given.of}"), tuple(given.factor)
    moderate, increasing = _moderate(m, given.factor, f"{path}.factor"), convert.increasing(x, f"{path}.{given.of}")
    period = None if given.period is None else convert.si(given.period, kind, f"{path}.period")
    if not increasing or not given.sound(given.of) or not x:
        return None
    span = x[-1] - x[0]
    if period is not None and span > period * (1.0 + 1e-12) and convert.certain(kind):
        why = f"is shorter than the range of the {given.of}s."
        convert.note(f"{path}.period", why, "Give a longer period, or fewer rows.")
        return None
    if not moderate or len(x) != len(y) or any(map(math.isnan, (*y, period or 0.0))):
        return None
    if period is not None and math.isclose(span, period, rel_tol=1e-12):  # the closing row is a repetition of the first one
        if y[-1] != y[0]:
            convert.note(
                f"{path}.factor[{len(y) - 1}]",
                f"differs from the first factor, {y[0]:g}, one period before.",
                "Give both the same factor, or leave out the last row.",
            )
            return None
        x, y = x[:-1], y[:-1]
    return m.spline(x, y, f"{path}.{given.of}", period, given.smooth)


def check_factor(reading: Reading, load: LoadDocument, path: str) -> Iterator[Fault]:
    """Faults of the names that a load's factor refers to."""
    for key in ("table", "polynomial"):
        given = getattr(load, key)
        if given is not None:
            yield from known_drive(reading, f"{path}.{key}.drive", given.drive)
            yield from known_joint(reading, f"{path}.{key}.joint", given.joint)
            if given.point is not None:
                yield from known_place(reading, f"{path}.{key}.point", given.point)
