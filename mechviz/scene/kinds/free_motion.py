"""The part of the scene document that leaves a motion to the forces: free coordinates, end stops, values to look out for."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import PlainValidator, WithJsonSchema, model_validator

from mechviz.scene.fields import (
    Angle,
    AngularSpeed,
    Coordinate,
    Flag,
    Length,
    Name,
    Quantity,
    Rate,
    Speed,
    Table,
    Text,
    describe,
    fault,
    refuse,
)
from mechviz.scene.names import PointName, Reference

Method = Literal["auto", "energy", "gauss", "radau"]
TOLERANCE = 1e-9
"""Where the scene states none."""


def _restitution(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
        remedy = "Give a number from 0 (it stays there) to 1 (it loses nothing)."
        raise fault(f"{describe(value)} is no coefficient of restitution.", remedy)
    return float(value)


def _tolerance(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1e-14 <= value <= 0.1:
        raise fault(f"{describe(value)} is no tolerance.", "Give a number from 1e-14 to 0.1, such as 1e-9.")
    return float(value)


Restitution = Annotated[float, PlainValidator(_restitution), WithJsonSchema({"type": "number", "minimum": 0, "maximum": 1})]
Tolerance = Annotated[float, PlainValidator(_tolerance), WithJsonSchema({"type": "number", "minimum": 1e-14, "maximum": 0.1})]
Level = Annotated[float | str, Quantity(("angle", "length", "angular speed", "linear speed"))]


class FreeDocument(Table):
    """A free coordinate: forces decide its motion. This is its start."""

    position: Coordinate | None = None
    """Position at the start. Default: as drawn, or 0."""
    speed: Rate = 0.0
    """Speed at the start."""
    x: Length | None = None
    """Planar joint: place of the second link's point in the first link's frame at the start. Default: as drawn, or 0."""
    y: Length | None = None
    """Planar joint: the same across."""
    angle: Angle | None = None
    """Planar joint: angle from the first link's frame to the second's at the start. Default: as drawn, or 0."""
    vx: Speed = 0.0
    """Planar joint: rate of x at the start."""
    vy: Speed = 0.0
    """Planar joint: rate of y at the start."""
    omega: AngularSpeed = 0.0
    """Planar joint: rate of the angle at the start."""

    def strangers(self, planar: bool) -> list[str]:
        """Keys that do not go with a planar joint, or with any other one."""
        own = {"x", "y", "angle", "vx", "vy", "omega"}
        return sorted(self.model_fields_set - own if planar else self.model_fields_set & own)


class StopDocument(Table):
    """An end stop of a joint, which its coordinate cannot pass."""

    at: Coordinate
    """Position of the stop."""
    side: Literal["upper", "lower"]
    """"upper": the coordinate stays below it; "lower": above it."""
    restitution: Restitution = 0.0
    """Newton's coefficient of restitution: speed after the impact over that before. Default 0: it stays there."""
    name: Name | None = None
    """Its name in events and loads. Default: the joint's name and the side."""


class LiftoffDocument(Table):
    """A follower that is only pressed on its cam may leave it."""

    restitution: Restitution = 0.0
    """Newton's coefficient of restitution when it comes back: speed after the impact over that before. Default 0: it stays."""


class WatchDocument(Table):
    """A value to look out for while the motion is found: an event where it is passed, and the end of the run if wanted."""

    joint: Annotated[Text, Reference("joint")] | None = None
    """The joint whose position or velocity is watched. Give this or point."""
    point: PointName | None = None
    """The point, "link.point", whose x or y is watched."""
    of: Literal["position", "velocity", "x", "y"] | None = None
    """What is watched: "position" (default) or "velocity" of a joint, "x" (default) or "y" of a point."""
    at: Level = 0.0
    """The value."""
    rising: Flag | None = None
    """true or false: only where it is passed upwards or downwards. Default: both ways."""
    ends: Flag = False
    """Whether the motion ends there."""

    @model_validator(mode="after")
    def _one_thing(self) -> WatchDocument:
        found = []
        if (self.joint is None) == (self.point is None):
            what = "neither a joint nor a point" if self.joint is None else "a joint and a point at once"
            found.append(("", f"{what} to watch.", 'Give one of them, such as joint = "A".'))
        elif self.of is not None and (self.of in ("x", "y")) != (self.point is not None):
            sort = '"x" or "y"' if self.point is not None else '"position" or "velocity"'
            found.append(("of", f"'{self.of}' of a {'point' if self.point is not None else 'joint'}.", f"Write {sort}."))
        refuse(found)
        return self

    @property
    def what(self) -> Literal["position", "velocity", "x", "y"]:
        return self.of or ("position" if self.point is None else "x")
