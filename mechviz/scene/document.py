"""The scene document: the keys of a scene file. The JSON Schema for editors is made from it.

Values stay as the user wrote them (``"60 rpm"`` remains a text); ``assemble`` converts units and resolves cross-references.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Discriminator, Field, PrivateAttr, Tag, model_validator

from mechcore.spec.mechanism import EFFECTS, METRICS
from mechviz.scene.annotations import Place
from mechviz.scene.fields import (
    Angle,
    Colour,
    DocumentTable,
    Duration,
    Flag,
    GravityVector,
    Inertia,
    Length,
    Name,
    Point,
    Text,
    UnitName,
    describe,
    fault,
    name_or_list,
    raise_faults,
)
from mechviz.scene.kinds.bodies import MassDocument, MassEntry, PointMassDocument
from mechviz.scene.kinds.copies import CopyDocument
from mechviz.scene.kinds.drives import Method, Tolerance, WatchDocument
from mechviz.scene.kinds.friction import FrictionDefaults
from mechviz.scene.kinds.joints.document import JointDocument
from mechviz.scene.kinds.loads.document import LoadDocument
from mechviz.scene.kinds.settings import AccuracyEntry, GoalDocument, ParameterEntry
from mechviz.scene.kinds.studies import (
    PenDocument,
    PolygonName,
    SectionsDocument,
    ShakingDocument,
    SubstituteDocument,
    SystemDocument,
)
from mechviz.scene.names import LinkName
from mechviz.scene.units import Units

EffectName = Literal["inertia", "gravity", "friction"]
MetricName = Literal["transmission_angle", "velocity_ratio", "mechanical_advantage", "instant_centre", "curvature"]
if set(get_args(MetricName)) != set(METRICS):
    raise ImportError("mechviz.scene.document.MetricName and mechcore.spec.mechanism.METRICS name different metrics")
if set(get_args(EffectName)) != set(EFFECTS):  # a Literal must be spelled out; this keeps it equal to the core's list
    raise ImportError("mechviz.scene.document.EffectName and mechcore.spec.mechanism.EFFECTS name different effects")


class UnitsDocument(DocumentTable):
    """The units of bare numbers."""

    length: Annotated[str, UnitName("length")] = "m"
    """Unit of lengths, also of those inside speeds and accelerations."""
    angle: Annotated[str, UnitName("angle")] = "rad"
    """Unit of angles, also of those inside angular speeds and accelerations."""
    mass: Annotated[str, UnitName("mass")] = "kg"
    """Unit of masses."""
    time: Annotated[str, UnitName("time")] = "s"
    """Unit of times, also of those inside speeds, accelerations and frequencies."""
    force: Annotated[str, UnitName("force")] = "N"
    """Unit of forces."""
    torque: Annotated[str, UnitName("torque")] = "N m"
    """Unit of torques. It does not follow the unit of length."""
    inertia: Annotated[str, UnitName("inertia")] = "kg m^2"
    """Unit of moments of inertia. It does not follow the units of mass and length."""


class RunDocument(DocumentTable):
    """How much of the motion is computed."""

    frames: Annotated[int, Field(strict=True, ge=2, le=10_000_000)] = 360
    """Number of frames."""
    cycles: Annotated[int, Field(strict=True, ge=1, le=100_000)] = 1
    """Number of cycles of the drive."""
    duration: Duration | None = None
    """Free coordinates, or a mechanism at rest: duration of the run. At rest without it one frame."""
    steady: Annotated[int, Field(strict=True, ge=1, le=1000)] | None = None
    """One free crank: the run starts in the steady state whose cycle is this many turns; without a duration it lasts one cycle."""
    tolerance: Tolerance | None = None
    """Free coordinates: local error of the motion, relative to one radian or the mechanism's size. Default 1e-9."""
    method: Method | None = None
    """Free coordinates: how the motion is found. Default "auto"; "radau" for stiff forces."""


def _is_list(value: object) -> str:
    return "<list>" if isinstance(value, list | tuple) else "<table>"


def _point_table(value: object) -> Any:
    if not isinstance(value, dict):
        hint = 'Write them like { A = [0, 0], B = [60, 0] }, or ["A", "B"] for points of the sketch.'
        raise fault(f"{describe(value)} where points are wanted.", hint)
    return value


PointTable = Annotated[dict[Name, Point], Field(min_length=1), BeforeValidator(_point_table)]
PointNames = Annotated[list[Name], Field(min_length=1)]
LinkPoints = Annotated[Annotated[PointTable, Tag("<table>")] | Annotated[PointNames, Tag("<list>")], Discriminator(_is_list)]
Centre = Annotated[Annotated[Point, Tag("<list>")] | Annotated[Text, Tag("<name>")], Discriminator(name_or_list)]


FixtureLook = Literal["flywheel", "fan", "spindle", "nothing"]
LookEntry = Annotated[
    Annotated[list[FixtureLook], Tag("<list>")] | Annotated[FixtureLook, Tag("<name>")], Discriminator(name_or_list)
]


class LinkDocument(DocumentTable):
    """A rigid link."""

    points: LinkPoints
    """Named points: a table of coordinates in the link's own frame, or a list of names that the sketch places."""
    mass: MassEntry | None = None
    """Mass, or a table that derives mass, centre and inertia from a shape. It acts only where something needs it."""
    centre: Centre | None = None
    """Centre of mass: coordinates in the link's frame, or the name of one of its points."""
    inertia: Inertia | None = None
    """Moment of inertia about the centre of mass."""
    gravity: GravityVector | None = None
    """Acceleration of gravity for this link alone, where it differs from the scene's."""
    shape: Literal["bar", "point"] | None = None
    """Instead of centre and inertia: "bar", slender between the first two points, or "point", all at the first."""
    plane: Length = 0.0
    """Parallel planes: least distance along the shaft by which it lies in front of the other links. Drawn, not computed."""
    outline: Annotated[list[Point], Field(min_length=3)] | None = None
    """Outline of its drawn plate, beside the material that its pins need: corners in the link's axes, or in those of the sketch if
    the sketch places its points. Drawn, not computed."""
    colour: Colour | None = None
    """Its colour, red, green and blue as in "#d9534f", instead of the automatic one. Drawn, not computed."""
    point_masses: list[PointMassDocument] = Field(default=[])
    """Point masses fixed to the link: counterweights, or all of its mass (a lumped model)."""
    looks: LookEntry | None = None
    """Additional drawing: "flywheel" or "fan" on its shaft on the ground; "spindle": of the ground, a rod as its guide; "nothing":
    the link is not drawn."""

    @model_validator(mode="after")
    def _shape_fits(self) -> LinkDocument:
        faults = []
        if self.has_valid("points") and isinstance(self.points, list) and len(set(self.points)) < len(self.points):
            faults.append(("points", "a point is listed twice.", "Name each point once."))
        if isinstance(self.mass, MassDocument):
            for key in ("shape", "inertia") if self.mass.solid else ("shape", "centre", "inertia"):
                if getattr(self, key) is not None:
                    faults.append((key, f"stands beside a mass with a shape, which decides the {key}.", f"Leave out {key}."))
        for key in ("centre", "inertia"):
            if self.shape and getattr(self, key) is not None:
                faults.append(
                    (
                        key,
                        f"stands beside shape = '{self.shape}', which decides the {key}.",
                        f"Leave out shape or {key}.",
                    )
                )
        if self.has_valid("points") and self.shape == "bar" and len(self.points) < 2:
            faults.append(("shape", "a bar needs two points, this link has one.", "Add a point, or write shape = 'point'."))
        if self.shape and self.mass is None:
            faults.append(("shape", f"shape = '{self.shape}' without a mass.", "Add mass = ..., or leave out shape."))
        raise_faults(faults)
        return self


class Pose(DocumentTable):
    """The approximate pose of a link's frame at the start."""

    at: Point
    """World coordinates of the origin of the link's frame."""
    angle: Angle = 0.0
    """Angle of the link's frame."""


def _is_table(value: object) -> str:
    return "<table>" if isinstance(value, dict | Pose) else "<list>"  # also called with the validated pose, when a scene is written


SketchEntry = Annotated[Annotated[Point, Tag("<list>")] | Annotated[Pose, Tag("<table>")], Discriminator(_is_table)]


class SceneDocument(DocumentTable):
    """A mechviz scene: a mechanism, its drives and loads, and what to compute."""

    title: Text = ""
    """Title of the scene, a few words. Default: the name of the file."""
    learning_goal: Text = ""
    """One sentence: what can be learned from it."""
    units: UnitsDocument = UnitsDocument()
    """Units of bare numbers. Any value may carry its own unit as a text, such as "80 mm" or "60 rpm"."""
    parameters: dict[Name, ParameterEntry] = Field(default={})
    """Named numbers. Any number of the scene may be an expression of them as a text, such as "2*r + 5 mm"."""
    effects: list[EffectName] = Field(default=[])
    """Effects to compute. None: pure kinematics, unless there are loads."""
    frame: Text = "frame"
    """Name of the fixed link, whose frame is the world."""
    gravity: GravityVector = (0.0, -9.81)
    """Acceleration of gravity [m/s^2], used only where effects names gravity."""
    trace: list[Text] = Field(default=[])
    """Points whose paths are traced: "E", or "coupler.E" where several links have a point of that name."""
    marks: Flag = True
    """Whether names of joints and arrows are shown at first; machines for children look better without. Drawn, not computed."""
    metrics: list[MetricName] = Field(default=[])
    """Kinematic metrics to record, with events at their extremes."""
    polygons: list[PolygonName] = Field(default=[])
    """Graphical constructions to draw."""
    centrodes: list[LinkName] = Field(default=[])
    """Links whose fixed and moving centrodes are drawn."""
    instant_centres: list[LinkName] = Field(default=[])
    """Links of which all instant centres are drawn, with Kennedy's lines in which they are found; the fixed one may be among
    them."""
    evolutes: list[Text] = Field(default=[])
    """Points such as "coupler.E" of whose paths the centre of curvature, the osculating circle and the evolute are drawn."""
    inflection: list[LinkName] = Field(default=[])
    """Links whose inflection circle is drawn, with Bobillier's construction of the pole tangent."""
    percussion: list[Text] = Field(default=[])
    """Points such as "rod.A" about which links turn: their centre of percussion and the line of the inertia resultant are drawn."""
    inversion: list[Text] = Field(default=[])
    """Disc cams and wedges whose synthesis by inversion is drawn: guide and follower turned back step by step, and the profile."""
    equivalent: list[Text] = Field(default=[])
    """Cams, gears, racks and pins in slots beside which their equivalent linkage of lower pairs is drawn."""
    reduced: list[Text] = Field(default=[])
    """Links, or points such as "rocker.D", to which the mass of the whole mechanism and the forces on it are reduced."""
    shaking: ShakingDocument | None = None
    """Shaking force and moment on the frame."""
    friction: FrictionDefaults | None = None
    """Default friction of all revolute, sliding and slot joints, used only where effects names friction."""
    run: RunDocument = RunDocument()
    """How much of the motion is computed."""
    accuracy: AccuracyEntry | None = None
    """Target relative error, such as 1e-6, from which all settings of accuracy follow; or a table of settings."""
    links: dict[Name, LinkDocument] = Field(default={})
    """The links by name, the fixed one among them."""
    joints: dict[Name, JointDocument] = Field(default={})
    """The joints (kinematic pairs) by name. A joint joins the points of its two links that have its own name, unless `at` names
    others."""
    sketch: dict[Name, SketchEntry] = Field(default={})
    """A rough start position: world coordinates of points, or poses of links."""
    loads: dict[Name, LoadDocument] = Field(default={})
    """Forces, torques, springs, dampers, drag, gas pressure by name."""
    watch: dict[Name, WatchDocument] = Field(default={})
    """Values to watch by name, where something is free."""
    systems: dict[Name, SystemDocument] = Field(default={})
    """Force systems by name: the loads on a link, reduced and drawn."""
    substitutes: dict[Name, SubstituteDocument] = Field(default={})
    """Substitute masses, by the name of the link that they replace."""
    sections: dict[Name, SectionsDocument] = Field(default={})
    """Section forces along links, by the name of the link."""
    goal: GoalDocument | None = None
    """The problem of `mechviz optimise`: parameters that vary, objectives, limits."""
    copies: list[CopyDocument] = Field(default=[])
    """Copies of links with their joints and loads, rotated about their shaft by a phase and offset along it."""
    pens: dict[Name, PenDocument] = Field(default={})
    """Points that draw, by the name of the drawing."""

    _formulas: Mapping[Place, str] = PrivateAttr(default={})

    @property
    def formulas(self) -> Mapping[Place, str]:
        """Expressions by the places of the values that are computed from them."""
        return self._formulas

    def keep_formulas(self, formulas: Mapping[Place, str]) -> None:
        """Store which values are computed from which expressions; called by the reader of scenes."""
        self._formulas = formulas

    @property
    def unit_system(self) -> Units:
        """The units of bare numbers, for conversions."""
        return Units(**self.units.model_dump())

    @property
    def parameters_data(self) -> dict[str, Any]:
        """The parameters as plain data, as a scene file states them."""
        return dict(self.model_dump(include={"parameters"}, exclude_unset=True).get("parameters", {}))

    def to_data(self, *, defaults: bool = True) -> dict[str, Any]:
        """The stated values as plain data of a scene file, with expressions in their places; ``defaults``: include stated values
        that equal the default."""
        stated = self.model_dump(exclude_unset=True)
        data = stated if defaults else self.model_dump(exclude_defaults=True)
        changes: dict[Place, Any] = {}
        for place, text in self._formulas.items():
            end = next(k for k in range(1, len(place) + 1) if k == len(place) or _missing(data, place[:k]))
            if end < len(place):  # a list or table of defaults, which was left out
                data = with_values(data, {place[:end]: value_at(stated, place[:end])})
            changes[place] = text
        return dict(with_values(data, changes)) if changes else data


def _missing(data: object, place: Place) -> bool:
    try:
        value_at(data, place)
    except LookupError:
        return True
    return False


FORMER = {
    "pairs": "joints",
    "answers": "metrics",
    "plans": "polygons",
    "polodes": "centrodes",
    "teaches": "learning_goal",
}
"""Former names of keys of a scene -> present names. Both are read."""
FORMER_INNER = {"pair": "joint"}
"""The same within the entries of watch and loads."""
FORMER_OF_LINKS = {"lumps": "point_masses"}
"""The same of a link."""


def value_at(value: Any, path: Place) -> Any:
    """The value at a place of a document, or of plain data. Raises `LookupError` or `AttributeError` where there is none."""
    for part in path:
        value = getattr(value, str(part)) if isinstance(value, DocumentTable) else value[part]
    return value


def stated(table: DocumentTable) -> dict[str, Any]:
    """The stated keys of a table with their values; inner tables stay tables of the document, not plain data."""
    return {key: getattr(table, key) for key in type(table).model_fields if key in table.model_fields_set}


def with_values(value: Any, changes: Mapping[Place, Any]) -> Any:
    """A document (or a part of it, or plain data) with the values at some places replaced; None removes a key.

    A change inside a list of the scene that is not stated, such as gravity, is applied to the default of that list. Raises
    pydantic's `ValidationError` where a table of the document would become invalid, and `ValueError` where the list no longer
    exists.
    """
    if () in changes:
        return changes[()]
    inner: dict[str | int, dict[Place, Any]] = {}
    for path, new in changes.items():
        inner.setdefault(path[0], {})[path[1:]] = new
    if isinstance(value, list | tuple):
        items = list(value)
        for k, change in inner.items():
            items[int(k)] = with_values(items[int(k)], change)
        return items
    entries = stated(value) if isinstance(value, DocumentTable) else dict(value or {})
    for key, change in inner.items():
        old = getattr(value, str(key)) if isinstance(value, DocumentTable) else entries.get(str(key))
        if old is None and () not in change and any(isinstance(path[0], int) for path in change):
            if str(key) not in SceneDocument.model_fields:
                raise ValueError(f"{key} is no longer in the scene: there is nothing to change.")
            old = SceneDocument.model_fields[str(key)].default
        new = with_values(old, change)
        if new is None:
            entries.pop(str(key), None)
        else:
            entries[str(key)] = new
    return type(value).model_validate(entries) if isinstance(value, DocumentTable) else entries
