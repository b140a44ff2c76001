"""The part of the scene document that makes loads vary: factors by table or polynomial, and what they depend on."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from mechcore.laws.timed import Smoothness

from .fields import Argument, Coordinate, Length, Number, Period, Rate, Speed, Text, Time, describe, fault
from .tables import Table, one_of, refuse

__all__ = ["ARGUMENTS", "FactorPolynomial", "FactorTable"]

ARGUMENTS = ("position", "velocity", "time", "x", "y", "vx", "vy", "speed")
"""What a factor can depend on: coordinate or rate of a pair, the time, place or velocity of a point."""

_OF_PAIRS, _OF_POINTS = ("position", "velocity"), ("x", "y", "vx", "vy", "speed")


def _smooth(value: Any) -> Smoothness:
    if value is True or value is False or value == "spline":
        return value
    raise fault(f"{describe(value)} does not say how the points are joined.", 'Write true, false (straight lines) or "spline".')


Smooth = Annotated[Smoothness, PlainValidator(_smooth), WithJsonSchema({"anyOf": [{"type": "boolean"}, {"const": "spline"}]})]


def _names(of: str, pair: str | None, drive: str | None, point: str | None) -> list[tuple[str, str, str]]:
    """Faults where the name of a pair or point does not go with what the factor depends on."""
    found = []
    if pair is not None and drive is not None:
        found.append(("drive", "pair and drive at once.", "Keep one of them."))
    for key, value in (("pair", pair), ("drive", drive)):
        if value is not None and of not in _OF_PAIRS:
            found.append((key, f"{key} does not go with {of}.", f"Leave out {key}."))
    if of in _OF_POINTS and point is None:
        found.append(("", f"depends on {of}, but of which point?", 'Add point = "link.point".'))
    if of not in _OF_POINTS and point is not None:
        found.append(("point", f"point does not go with {of}.", "Leave out point."))
    return found


class FactorTable(Table):
    """A factor as a function of one of position, velocity, time, x, y, vx, vy, speed."""

    position: Annotated[list[Coordinate], Field(min_length=2)] | None = None
    """Increasing coordinates of a pair, by default of the first drive."""
    velocity: Annotated[list[Rate], Field(min_length=2)] | None = None
    """Increasing rates of the coordinate of a pair."""
    time: Annotated[list[Time], Field(min_length=2)] | None = None
    """Increasing times."""
    x: Annotated[list[Length], Field(min_length=2)] | None = None
    """Increasing x coordinates of a point in the world."""
    y: Annotated[list[Length], Field(min_length=2)] | None = None
    """Increasing y coordinates of a point in the world."""
    vx: Annotated[list[Speed], Field(min_length=2)] | None = None
    """Increasing velocities of a point along x."""
    vy: Annotated[list[Speed], Field(min_length=2)] | None = None
    """Increasing velocities of a point along y."""
    speed: Annotated[list[Speed], Field(min_length=2)] | None = None
    """Increasing speeds of a point, whatever their direction."""
    factor: Annotated[list[Number], Field(min_length=2)]
    """Factors there."""
    period: Period | None = None
    """Position, time: the table repeats after this much; without it the end values hold outside the table."""
    smooth: Smooth = True
    """true: a cubic between any two points that stays between them (monotone, PCHIP); "spline": a cubic spline with continuous
    second derivatives, which may overshoot; false: straight lines."""
    drive: Text | None = None
    """Position, velocity: the driven pair. Default: the first one."""
    pair: Text | None = None
    """Position, velocity: any pair, driven or not."""
    point: Text | None = None
    """x, y, vx, vy, speed: the point, as "link.point"."""

    @property
    def of(self) -> str:
        return next((key for key in ARGUMENTS if getattr(self, key) is not None), "position")

    @model_validator(mode="after")
    def _same_length(self) -> FactorTable:
        refuse(one_of(self, ARGUMENTS, "the table"))
        rows = getattr(self, self.of)
        found = _names(self.of, self.pair, self.drive, self.point)
        if self.sound(self.of, "factor") and len(rows) != len(self.factor):
            plural = f"{self.of}s" if self.of in ("position", "time", "speed") else f"values of {self.of}"
            found.append(("", f"{len(rows)} {plural} and {len(self.factor)} factors.", f"Give one factor for each {self.of}."))
        if self.period is not None and self.of not in ("position", "time"):
            found.append(("period", f"period does not go with {self.of}.", "Leave out period."))
        refuse(found)
        return self


class FactorPolynomial(Table):
    """A factor as a polynomial: the sum of coefficients[k] (argument / per)^k."""

    of: Literal["position", "velocity", "time", "x", "y", "vx", "vy", "speed"]
    """What it depends on: coordinate or rate of a pair, the time, place or velocity of a point."""
    coefficients: Annotated[list[Number], Field(min_length=1)]
    """Coefficients, the constant one first."""
    per: Argument | None = None
    """What the argument is divided by. Default: one of the scene's units."""
    drive: Text | None = None
    """Position, velocity: the driven pair. Default: the first one."""
    pair: Text | None = None
    """Position, velocity: any pair, driven or not."""
    point: Text | None = None
    """x, y, vx, vy, speed: the point, as "link.point"."""

    @model_validator(mode="after")
    def _named(self) -> FactorPolynomial:
        refuse(_names(self.of, self.pair, self.drive, self.point))
        return self
