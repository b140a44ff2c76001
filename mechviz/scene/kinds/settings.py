"""Parts of the scene document that are no items of the mechanism: parameters, accuracy of the run, goals of optimisation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainValidator,
    Tag,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from mechcore.accuracy import DEFAULT, LOOSEST, TIGHTEST, Accuracy, accuracy_for
from mechcore.errors import Fault
from mechcore.records import dataclass
from mechviz.scene.fields import (
    DocumentTable,
    Duration,
    Name,
    Number,
    Size,
    Text,
    describe,
    fault,
    is_complete,
    raise_faults,
    table_or_value,
)

if TYPE_CHECKING:
    from mechviz.scene.convert import Converter
    from mechviz.scene.document import SceneDocument


@dataclass(frozen=True)
class Stated:
    """Marks a plain number, or a text that is a quantity or an expression of any kind; pydantic calls the two methods."""

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self._check)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {
            "type": ["number", "string"],
            "description": "a plain number, a quantity with its unit, or an expression of other parameters",
            "examples": ["30 mm", "2*r + 5 mm", 3],
        }

    def _check(self, value: object) -> float | str:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise fault(f"{describe(value)} where a value is wanted.", "Write it like '30 mm'; a plain number has no unit.")
        return value


StatedValue = Annotated[float | str, Stated()]


class ParameterDocument(DocumentTable):
    """A parameter with its range and tolerance."""

    value: StatedValue
    """Its value: a quantity with its unit, a plain number, or an expression of other parameters."""
    range: Annotated[list[StatedValue], Field(min_length=2, max_length=2)] | None = None
    """Its least and greatest value, for sliders, sweeps and optimisation."""
    tolerance: StatedValue | None = None
    """Manufacturing tolerance: largest deviation to either side."""


ParameterEntry = Annotated[
    Annotated[StatedValue, Tag("<value>")] | Annotated[ParameterDocument, Tag("<table>")], Discriminator(table_or_value)
]


def _target(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not TIGHTEST <= value <= LOOSEST:
        why = f"{describe(value)} is no accuracy."
        raise fault(why, f"Give the wanted relative error, a number from {TIGHTEST:g} to {LOOSEST:g}, such as 1e-6.")
    return float(value)


TargetError = Annotated[
    float, PlainValidator(_target), WithJsonSchema({"type": "number", "minimum": TIGHTEST, "maximum": LOOSEST, "examples": [1e-6]})
]


def _within(low: float, high: float) -> PlainValidator:
    """A plain number between two bounds."""

    def check(value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise fault(f"{describe(value)} is out of range.", f"Give a number from {low:g} to {high:g}.")
        return float(value)

    return PlainValidator(check)


ResidualTolerance = Annotated[float, _within(1e-15, 1e-2), WithJsonSchema({"type": "number", "minimum": 1e-15, "maximum": 1e-2})]
Resolution = Annotated[float, _within(0.0, 0.1), WithJsonSchema({"type": "number", "minimum": 0, "maximum": 0.1})]
EventShare = Annotated[float, _within(1e-14, 1.0), WithJsonSchema({"type": "number", "minimum": 1e-14, "maximum": 1})]


class AccuracyDocument(DocumentTable):
    """Accuracy of the run: a target error from which all settings follow, single settings that override it, or both."""

    target: TargetError | None = None
    """Target error, relative to the mechanism's size and the peak of each quantity; all settings follow from it."""
    position: ResidualTolerance | None = None
    """Residual at which Newton's method stops in groups without a closed form, in sizes of the mechanism. Default 2e-15."""
    interpolation: Literal["hold", "linear", "cubic", "quintic"] | None = None
    """Interpolation between frames, also for readers of the results. Default "cubic", with the rates as slopes."""
    differentiation: Literal["exact", "differences", "graphical"] | None = None
    """Computation of rates: from linear equations (default), by differences of frames, or graphically, as in the lecture."""
    differences: Literal[2, 4, 6] | None = None
    """Order of the differences. Default 4."""
    resolution: Resolution | None = None
    """Graphical: resolution of readings from the drawing, relative to its size. Default 5e-4."""
    nodes: Annotated[int, Field(strict=True, ge=2, le=20)] | None = None
    """Free coordinates: collocation nodes of a window of the integrator, whose order is twice that."""
    window: Duration | None = None
    """Free coordinates: longest window of the integrator."""
    friction: ResidualTolerance | None = None
    """Residual at which Newton's method for normal loads stops, relative to the largest load of the frame. Default 1e-13."""
    event: EventShare | None = None
    """Tolerance of the times of events, in intervals between frames. Default 1e-9."""
    chord: Size | None = None
    """Largest distance between a round shape and its facets. Default: 0.5 % of the radius, or from the target."""
    profile: Annotated[int, Field(strict=True, ge=36, le=100_000)] | None = None
    """Points of a cam's profile in meshes. Default 1080, or from the target."""
    numbers: Literal["float64", "float32"] | None = None
    """Number format of recorded data. Default "float64", or from the target where nothing has to balance."""
    decimation: Annotated[int, Field(strict=True, ge=1, le=10_000)] | None = None
    """Only every n-th frame is recorded. Default 1."""
    pictures: Annotated[int, Field(strict=True, ge=1, le=10_000)] | None = None
    """Arrows are drawn at every n-th of the recorded frames. Default: up to 720 a cycle, or from the target."""


AccuracyEntry = Annotated[
    Annotated[TargetError, Tag("<value>")] | Annotated[AccuracyDocument, Tag("<table>")], Discriminator(table_or_value)
]

ORDERS = {"hold": 0, "linear": 1, "cubic": 3, "quintic": 5}


def accuracy_of(entry: float | AccuracyDocument | None, convert: Converter) -> Accuracy:
    """The accuracy settings of a scene, in SI units; the defaults where it states none."""
    if entry is None:
        return DEFAULT
    if not isinstance(entry, AccuracyDocument):
        return accuracy_for(entry)
    settings = {key: getattr(entry, key) for key in AccuracyDocument.model_fields if getattr(entry, key) is not None}
    target = settings.pop("target", None)
    if "interpolation" in settings:
        settings["interpolation"] = ORDERS[settings["interpolation"]]
    for key, kind in (("chord", "length"), ("window", "time")):
        if key in settings:
            settings[key] = convert.si(settings[key], kind, f"accuracy.{key}")
    return Accuracy(**settings) if target is None else accuracy_for(target, **settings)


def accuracy_faults(document: SceneDocument, free: Mapping[str, Any], convert: Converter) -> Iterator[Fault]:
    """Faults of accuracy settings that are out of range, that the scene does not use, or that contradict it; ``convert`` notes
    values that cannot be converted."""
    entry = document.accuracy
    if not isinstance(entry, AccuracyDocument) or not is_complete(entry):
        return
    for key, kind, low, high in (("chord", "length", 1e-9, 1.0), ("window", "time", 1e-12, 1e12)):
        value = getattr(entry, key)
        if value is not None and not low <= convert.si(value, kind, f"accuracy.{key}") <= high:
            yield Fault(
                f"accuracy.{key}", f"{describe(value)} is out of range.", f"Give a value from {low:g} to {high:g} in SI units."
            )
    if free and entry.differentiation not in (None, "exact"):
        why = f"{next(iter(free))} is free: its rates are what is solved for."
        yield Fault("accuracy.differentiation", why, "Leave it out, or prescribe a drive.")
    if not free:
        for key in ("nodes", "window"):
            if getattr(entry, key) is not None:
                yield Fault(f"accuracy.{key}", "nothing is free: there is nothing to integrate.", "Leave it out.")


def _listed(value: object) -> object:
    return [value] if isinstance(value, str) else value


Measures = Annotated[list[Text], BeforeValidator(_listed, json_schema_input_type=Text | list[Text])]
Coordinates = Annotated[list[Number], Field(min_length=2, max_length=2)]


class LimitDocument(DocumentTable):
    """Bounds between which a quantity has to stay; one of them is enough."""

    least: StatedValue | None = None
    """Its least value: with a unit, or a number in the unit in which the quantity is shown."""
    most: StatedValue | None = None
    """Its greatest value."""

    @model_validator(mode="after")
    def _some(self) -> LimitDocument:
        if self.least is None and self.most is None:
            raise_faults([("least", "a limit without a value.", "Give least, most or both.")])
        return self


class FollowDocument(DocumentTable):
    """A curve that a quantity has to follow: the objective is the root mean square of its deviations."""

    quantity: Text
    """The quantity, such as link.rocker.angle, or one curve of it, link.ram.position[x]."""
    drive: Annotated[list[StatedValue], Field(min_length=2)]
    """Positions of the first drive: with units, or numbers in the scene's unit."""
    values: Annotated[list[StatedValue], Field(min_length=2)]
    """Values that the quantity should have there: with units, or numbers in its own."""

    @model_validator(mode="after")
    def _as_many(self) -> FollowDocument:
        if len(self.drive) != len(self.values):
            raise_faults(
                [("values", f"{len(self.values)} values at {len(self.drive)} places of the drive.", "Give as many of both.")]
            )
        return self


class PathDocument(DocumentTable):
    """A path that a point has to follow: the objective is the root mean square of its distances from places."""

    point: Text
    """The traced point, such as coupler.E."""
    through: Annotated[list[Coordinates], Field(min_length=2)]
    """The places, in the world, in the scene's unit of length."""
    drive: Annotated[list[StatedValue], Field(min_length=2)] | None = None
    """Position of the first drive at each of them: with units, or numbers in the scene's unit. Default: where the point comes
    nearest."""

    @model_validator(mode="after")
    def _as_many(self) -> PathDocument:
        if self.drive is not None and len(self.drive) != len(self.through):
            raise_faults(
                [("drive", f"{len(self.drive)} places of the drive for {len(self.through)} places.", "Give as many of both.")]
            )
        return self


class GoalDocument(DocumentTable):
    """The goal of `mechviz optimise`: parameters that vary, objectives, limits."""

    vary: list[Name] = Field(default=[])
    """Parameters that may vary within their ranges. Default: all that have a range and are not computed from others."""
    minimise: Measures = Field(default=[])
    """Quantities to minimise, such as drive.A.torque:peak, or a list of such."""
    maximise: Measures = Field(default=[])
    """Quantities to maximise."""
    follow: FollowDocument | None = None
    """A curve to follow."""
    path: PathDocument | None = None
    """A path to follow."""
    limits: dict[Text, LimitDocument] = Field(default={})
    """Limits of quantities, by their names with reducers such as "joint.B.reaction:peak"."""
    grashof: Literal["any", "crank-rocker", "double-crank", "double-rocker"] | None = None
    """Grashof's rule for the four-bar loops: of any type, or with crank, frame or coupler as the shortest link."""
    box: tuple[Coordinates, Coordinates] | None = None
    """Two opposite corners, in the scene's unit of length: all points of moving links stay within."""

    @model_validator(mode="after")
    def _some(self) -> GoalDocument:
        if not (self.minimise or self.maximise or self.follow or self.path):
            raise_faults([("minimise", "a goal without an objective.", "Give minimise, maximise, follow or path.")])
        return self
