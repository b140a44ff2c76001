"""The goal of a scene: which parameters may vary, what is to become least or greatest, and within which limits."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from mechviz.scene.fields import Name, Number, Table, Text, refuse
from mechviz.scene.kinds.settings import Value


def _listed(value: object) -> object:
    return [value] if isinstance(value, str) else value


Measures = Annotated[list[Text], BeforeValidator(_listed)]
Coordinates = Annotated[list[Number], Field(min_length=2, max_length=2)]


class LimitDocument(Table):
    """Between which values a quantity has to stay; one of them is enough."""

    least: Value | None = None
    """Its least value: with a unit, or a number in the unit in which the quantity is shown."""
    most: Value | None = None
    """Its greatest value."""

    @model_validator(mode="after")
    def _some(self) -> LimitDocument:
        if self.least is None and self.most is None:
            refuse([("least", "a limit without a value.", "Give least, most or both.")])
        return self


class FollowDocument(Table):
    """A curve that a quantity has to follow: the objective is the root mean square of its deviations."""

    quantity: Text
    """The quantity, such as link.rocker.angle, or one curve of it, link.ram.position[x]."""
    drive: Annotated[list[Value], Field(min_length=2)]
    """Where the first drive is: with units, or numbers in degrees or mm."""
    values: Annotated[list[Value], Field(min_length=2)]
    """What the quantity is to be there: with units, or numbers in its own."""

    @model_validator(mode="after")
    def _as_many(self) -> FollowDocument:
        if len(self.drive) != len(self.values):
            refuse([("values", f"{len(self.values)} values at {len(self.drive)} places of the drive.", "Give as many of both.")])
        return self


class PathDocument(Table):
    """A path that a point has to take: the objective is the root mean square of its distances from places."""

    point: Text
    """The traced point, such as coupler.E."""
    through: Annotated[list[Coordinates], Field(min_length=2)]
    """The places, in the world, in the scene's unit of length."""
    drive: Annotated[list[Value], Field(min_length=2)] | None = None
    """Where the first drive is at each of them: with units, or numbers in degrees or mm. Default: wherever it comes nearest."""

    @model_validator(mode="after")
    def _as_many(self) -> PathDocument:
        if self.drive is not None and len(self.drive) != len(self.through):
            refuse([("drive", f"{len(self.drive)} places of the drive for {len(self.through)} places.", "Give as many of both.")])
        return self


class GoalDocument(Table):
    """What `mechviz optimise` looks for."""

    vary: list[Name] = Field(default=[])
    """Parameters that may vary within their ranges. Default: all that stand for themselves and have a range."""
    minimise: Measures = Field(default=[])
    """Quantities that are to be small, such as drive.A.torque:peak, or a list of such."""
    maximise: Measures = Field(default=[])
    """Quantities that are to be great."""
    follow: FollowDocument | None = None
    """A curve to follow."""
    path: PathDocument | None = None
    """A path to take."""
    limits: dict[Text, LimitDocument] = Field(default={})
    """Limits of quantities, by their names with reducers such as "joint.B.reaction:peak"."""

    @model_validator(mode="after")
    def _some(self) -> GoalDocument:
        if not (self.minimise or self.maximise or self.follow or self.path):
            refuse([("minimise", "a goal without an objective.", "Give minimise, maximise, follow or path.")])
        return self
