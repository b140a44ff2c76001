"""Segments of motions, their laws, and programs of segments: for cams, and for drives over time or a master angle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, GetJsonSchemaHandler, Tag, model_validator
from pydantic_core import CoreSchema

from mechcore.errors import MechanismError
from mechcore.laws.catalogue import FORMER_NAMES, rise
from mechcore.records import dataclass
from mechviz.scene.fields import (
    Angle,
    Coordinate,
    Distance,
    DocumentTable,
    Duration,
    Extent,
    Flag,
    Number,
    QuantityMark,
    Rate,
    Text,
    one_of,
    raise_faults,
    table_or_value,
    value_or_list,
)
from mechviz.scene.names import FileName
from mechviz.scene.units import DERIVATIVES, UNIT_KINDS

FREE = "free"


@dataclass(frozen=True)
class StateQuantity(QuantityMark):
    """Marks an entry of a state: a position or a derivative of it by time, angle or length."""

    kinds: tuple[str, ...] = ("angle", "length", *DERIVATIVES)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**super().__get_pydantic_json_schema__(schema, handler), "examples": [UNIT_KINDS["length"].example, "20 mm/rad"]}

    @property
    def _words(self) -> str:
        return "a position or a derivative of it"


StateEntry = Annotated[float | str, StateQuantity(word=FREE)]
Slope = Annotated[float | str, StateQuantity()]
KnotPlace = Annotated[float | str, QuantityMark(("angle", "length", "time"), "zero")]
_MOST_ENTRIES = 4
StateDocument = Annotated[
    Annotated[Coordinate, Tag("<value>")]
    | Annotated[Annotated[list[StateEntry], Field(min_length=1, max_length=_MOST_ENTRIES)], Tag("<list>")],
    Discriminator(value_or_list),
]
"""A position, or [position, velocity, acceleration, jerk], derivatives with respect to the master of the law."""


class HarmonicDocument(DocumentTable):
    """One harmonic of a segment's range."""

    order: Number = 1.0
    """Number of waves in the range."""
    sine: Slope = 0.0
    """Amplitude of the sine."""
    cosine: Slope = 0.0
    """Amplitude of the cosine."""


class CurveDocument(DocumentTable):
    """A function over the range of a segment: points, or a mean value and harmonics."""

    at: Annotated[list[KnotPlace], Field(min_length=2)] | None = None
    """Distances from the start of the segment; the same one twice is a jump."""
    values: Annotated[list[Slope], Field(min_length=2)] | None = None
    """Values there, joined by straight lines."""
    steps: Flag = False
    """Each value holds up to the next place, without interpolation."""
    mean: Slope | None = None
    """Mean value, beside harmonics."""
    harmonics: Annotated[list[HarmonicDocument], Field(min_length=1)] | None = None
    """Sines and cosines over the range."""

    @model_validator(mode="after")
    def _one_form(self) -> CurveDocument:
        wrong = one_of(self, ("at", "harmonics"), "the function")
        if self.harmonics is None and self.mean is not None:
            wrong.append(("mean", "a mean value without harmonics.", "Leave it out."))
        for key in ("values", "steps"):
            if self.at is None and key in self.model_fields_set and self.has_valid("at"):
                wrong.append((key, f"{key} without the places.", "Give at = [...], or leave it out."))
        if self.at is not None and self.has_valid("at", "values") and len(self.at) != len(self.values or ()):
            wrong.append(("", f"{len(self.at)} places and {len(self.values or ())} values.", "Give one value for each place."))
        raise_faults(wrong)
        return self


class PositionTable(DocumentTable):
    """Measured positions over the range of a segment, joined by a quintic spline."""

    at: Annotated[list[KnotPlace], Field(min_length=6)] | None = None
    """Places, at least six, which span the range of the segment."""
    values: Annotated[list[Coordinate], Field(min_length=6)] | None = None
    """Positions there."""
    file: FileName | None = None
    """Instead of both: a CSV table of two columns whose header states the units, as "angle [deg], lift [mm]". Path from the folder
    of the scene file."""
    tolerance: Annotated[float | str, QuantityMark(("angle", "length"), "zero")] = 0.0
    """Root mean square distance at which the spline may pass the points."""
    periodic: Flag = False
    """The last row is the end of the cycle, which continues smoothly into the next."""
    rest: Flag = False
    """The motion goes from rest to rest: velocity and acceleration are zero at both ends."""

    @model_validator(mode="after")
    def _one_form(self) -> PositionTable:
        wrong = one_of(self, ("at", "file"), "the table")
        wrong += [
            ("rest", f"rest beside {key}.", "Keep one of them.")
            for key in ("periodic", "tolerance")
            if self.rest and getattr(self, key)
        ]
        if self.at is not None and self.has_valid("at", "values") and len(self.at) != len(self.values or ()):
            wrong.append(("", f"{len(self.at)} places and {len(self.values or ())} values.", "Give one value for each place."))
        if self.file is not None and self.values is not None:
            wrong.append(("values", "values beside a file.", "Keep one of them."))
        raise_faults(wrong)
        return self


class PointDocument(DocumentTable):
    """A point that a law passes through."""

    at: KnotPlace
    """Distance from the start of the segment."""
    to: StateDocument
    """Position there, or [position, velocity, acceleration, jerk]; derivatives that are left out are free."""


DerivativeOrder = Literal["velocity", "acceleration", "jerk", "snap"]
ORDERS: dict[DerivativeOrder, int] = {"velocity": 1, "acceleration": 2, "jerk": 3, "snap": 4}
KINDS_OF_LAW = ("acceleration", "velocity", "position", "polynomial", "spline", "least")


class LawDocument(DocumentTable):
    """A law that is not in the catalogue: exactly one of acceleration, velocity, position, polynomial, spline or least."""

    acceleration: CurveDocument | None = None
    """Given acceleration, integrated twice. The positions at both ends decide the velocity at the start; without `to` the
    segment ends where it starts."""
    velocity: CurveDocument | None = None
    """Given velocity, integrated once. It decides where the segment ends; with `to` its size follows from that."""
    scaled: Flag = False
    """Acceleration: only its shape is given. The segment starts with the velocity of the one before it, and the size follows from
    `to`."""
    balanced: Flag = False
    """Acceleration: only its shape is given. The segment starts with the velocity of the one before it and ends at rest; the sizes
    of its positive and of its negative part follow from that and from `to`."""
    position: PositionTable | None = None
    """Measured positions."""
    polynomial: Annotated[list[PointDocument], Field(min_length=1)] | None = None
    """A polynomial through both ends and these points; its degree follows from the number of conditions."""
    powers: list[Annotated[int, Field(strict=True, ge=0, le=60)]] | None = None
    """Polynomial: the exponents, as many as conditions, instead of 0, 1, 2 ..."""
    spline: Annotated[list[PointDocument], Field(min_length=1)] | None = None
    """A B-spline through both ends and these points."""
    degree: Annotated[int, Field(strict=True, ge=2, le=9)] = 5
    """Spline: its degree."""
    least: DerivativeOrder | None = None
    """The law with the least peak of this derivative."""
    limits: dict[DerivativeOrder, Number] = Field(default_factory=dict)
    """Least: largest magnitudes of other derivatives, as the factors Cv, Ca, Cj that `mechviz laws` lists."""
    smooth: DerivativeOrder | None = None
    """Least: the derivative that is constant over each step; all below it are continuous. Default: that of least itself."""
    steps: Annotated[int, Field(strict=True, ge=4, le=256)] = 64
    """Least: number of equal steps."""

    @model_validator(mode="after")
    def _one_law(self) -> LawDocument:
        wrong = one_of(self, KINDS_OF_LAW, "the law")
        owners = {"scaled": "acceleration", "balanced": "acceleration", "powers": "polynomial", "degree": "spline"} | dict.fromkeys(
            ("limits", "smooth", "steps"), "least"
        )
        for key, owner in owners.items():
            if key in self.model_fields_set and getattr(self, owner) is None and self.has_valid(owner):
                wrong.append((key, f"{key} goes with {owner}.", "Leave it out."))
        if self.scaled and self.balanced:
            wrong.append(("balanced", "balanced beside scaled.", "Keep one of them."))
        for key, factor in self.limits.items():
            if factor <= 0.0:
                wrong.append(("limits", f"{factor:g} is no limit of the {key}.", "Give a positive factor."))
        raise_faults(wrong)
        return self

    @property
    def kind(self) -> str:
        """The key that says which law it is."""
        return next((key for key in KINDS_OF_LAW if getattr(self, key) is not None), "")

    @property
    def needs_end(self) -> bool:
        """Whether the segment has to state its end."""
        return self.kind in ("polynomial", "spline", "least") or self.scaled or self.balanced

    @property
    def meets(self) -> bool:
        """Whether it can satisfy velocities and accelerations at the ends of its segment."""
        return self.kind in ("polynomial", "spline", "least")


_LAW_TABLES = {
    "acceleration": "{ acceleration = { at = [0, 60, 60, 120], values = [1, 1, -1, -1] } }",
    "velocity": "{ velocity = { at = [0, 30, 90, 120], values = [0, 1, 1, 0] } }",
    "position": '{ position = { file = "lift.csv" } }',
    "polynomial": "{ polynomial = [{ at = 60, to = 14 }] }",
    "spline": "{ spline = [{ at = 60, to = 14 }] }",
    "least": '{ least = "acceleration" }',
}
"""Each law that is a table, as it may stand in a scene."""

LawEntry = Annotated[Annotated[Text, Tag("<value>")] | Annotated[LawDocument, Tag("<table>")], Discriminator(table_or_value)]


class SegmentTable(DocumentTable):
    """The end of a segment and the law that leads there."""

    ELSEWHERE: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(LawDocument.model_fields, "It is a key of the law: law = { ... }."),
        **{key: f"It is a law: write law = {law}." for key, law in _LAW_TABLES.items()},
    }
    usual: ClassVar[str] = "cycloidal"

    to: StateDocument | None = None
    """Its end: a position, or [position, velocity, acceleration, jerk]. Derivatives that are "free" follow from the neighbouring
    segment; those that are left out are zero. Without it: a dwell, or the end that the law determines."""
    law: LawEntry | None = None
    """Law of motion: one of those that `mechviz laws` lists, "polynomial" (of the degree that the end conditions require), or a
    table. Default: cycloidal; polynomial for a segment over time, or with derivatives at its end."""
    parameters: dict[Text, Number] = Field(default_factory=dict)
    """Parameters of the law, such as { skew = 0.4 }."""
    mirrored: Flag = False
    """Run the law with acceleration and deceleration exchanged."""

    @property
    def law_name(self) -> str | None:
        """The name of its law; None of a table."""
        if self.law is None:
            return "polynomial" if isinstance(self.to, list) else self.usual
        return None if isinstance(self.law, LawDocument) else self.law

    @property
    def asks_too_much(self) -> bool:
        """Whether its end states derivatives that its law, of a fixed shape, cannot satisfy."""
        free = self.law.meets or self.law.invalid_keys if isinstance(self.law, LawDocument) else self.law_name == "polynomial"
        return not free and isinstance(self.to, list) and any(v != FREE for v in self.to[1:])

    @model_validator(mode="after")
    def _known_law(self) -> SegmentTable:
        wrong: list[tuple[str, str, str]] = []
        name = self.law_name
        shaped = name is not None and name != "polynomial"
        if shaped and name in _LAW_TABLES:
            wrong.append(("law", f"'{name}' alone does not say which law.", f"Write it like law = {_LAW_TABLES[name]}."))
        elif shaped and self.has_valid("law", "parameters"):
            try:
                rise(str(name), **self.parameters)
            except MechanismError as error:
                wrong += [("law" if f.path == "law" else "parameters", f.message, f.remedy) for f in error.faults]
        if not shaped:
            for key in ("parameters", "mirrored"):
                if key in self.model_fields_set:
                    wrong.append(
                        (key, f"{key} does not go with this law.", "It goes with a law that `mechviz laws` lists: leave it out.")
                    )
        if isinstance(self.law, LawDocument):
            if self.to is None and self.has_valid("to", "law") and not self.law.invalid_keys and self.law.needs_end:
                wrong.append(("law", "a law that does not say where the segment ends.", "Add to = ..."))
        elif self.to is None and self.has_valid("to") and "law" in self.model_fields_set:
            wrong.append(("law", "a law for a dwell, which says no end.", "Add to = ..., or leave out the law."))
        if self.asks_too_much:
            why = "a law of its own shape cannot meet a velocity or an acceleration."
            wrong.append(("to", why, 'Write "free" for them, or take law = "polynomial".'))
        raise_faults(wrong)
        return self


class _Lasting(DocumentTable):
    duration: Duration
    """Time that the segment takes."""


class TimeSegment(SegmentTable, _Lasting):
    """A segment of a motion over time."""

    usual: ClassVar[str] = "polynomial"


Turn = Annotated[float | str, QuantityMark(("angle",), "above zero")]


class _OverMaster(DocumentTable):
    over: Turn | None = None
    """Range of the master angle; left out beside `knots`."""


class ProgramSegment(SegmentTable, _OverMaster):
    """A rise, return or dwell over a range of the master angle."""


class ProgramDocument(DocumentTable):
    """A motion program over a master angle; several drives may follow one master."""

    speed: Rate | None = None
    """Speed of a master shaft of its own. Give this, master or knots."""
    master: Text | None = None
    """The driven revolute joint whose angle is the master. Give this, speed or knots."""
    knots: Text | None = None
    """The driven joint whose segments, over time or a master angle, also determine the ranges of this program: axes in step."""
    phase: Angle = 0.0
    """Added to the master angle: the program runs earlier by this much."""
    segments: Annotated[list[ProgramSegment], Field(min_length=1)]
    """Segments one after the other; the program repeats after their total range."""

    @model_validator(mode="after")
    def _one_master(self) -> ProgramDocument:
        wrong = one_of(self, ("speed", "master", "knots"), "the program")
        if not wrong and self.knots is not None and "phase" in self.model_fields_set:
            wrong.append(("phase", "a phase beside the knots of another axis.", "Leave it out, or state it there."))
        raise_faults(wrong)
        return self


class _OverCam(DocumentTable):
    over: Distance
    """Range of the cam's angle; of a wedge, of its travel, a length."""


class LiftSegment(SegmentTable, _OverCam):
    """A rise, return or dwell of the follower over a range of the cam."""

    to: StateDocument | None = None
    """Lift at its end above the base circle: a length, of an oscillating follower an angle; or [lift, velocity, acceleration, jerk]
    by the cam's angle. Without it: a dwell, or the end that the law determines."""


class _OverPolarAngle(DocumentTable):
    over: Angle
    """Range of the polar angle in the cam's link."""


class RadiusSegment(SegmentTable, _OverPolarAngle):
    """Change of a profile's radius over a range of its polar angle."""

    to: Extent | None = None
    """Radius at its end. Without it an arc about the axis."""


def former_laws(value: object, path: str = "") -> Iterator[tuple[str, str, str]]:
    """Laws in a document (or in a part of it) with former names: place, former name, present name."""
    if isinstance(value, SegmentTable) and isinstance(value.law, str) and value.law in FORMER_NAMES:
        yield f"{path}.law", value.law, FORMER_NAMES[value.law]
    elif isinstance(value, DocumentTable):
        for key in type(value).model_fields:
            yield from former_laws(getattr(value, key), f"{path}.{key}".lstrip("."))
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from former_laws(item, f"{path}.{key}")
    elif isinstance(value, list):
        for k, item in enumerate(value):
            yield from former_laws(item, f"{path}[{k}]")
