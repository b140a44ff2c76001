"""Contract of recordings, and the faults of a recording that violates it: properties, model, tables, drawn entities.

A recording is checked once, when it is opened. After that, readers can rely on it: no table is missing, widths are those of the
contract, positions are finite and faces refer to existing vertices.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import (
    AfterValidator,
    Base64Bytes,
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    Json,
    NonNegativeInt,
    PositiveFloat,
    ValidationError,
    model_validator,
)

from mechviz.outputs.rerun.entities import entity, parts_of
from mechviz.picture.nodes import FARTHEST_VERTEX
from mechviz.scene.units import MILLIMETRES, Units

if TYPE_CHECKING:
    import pyarrow as pa

    from mechviz.outputs.rerun.reader import Recording

LARGEST_VALUE = 1e150  # of numbers other than coordinates: its square is finite

Positive = Annotated[PositiveFloat, Field(lt=1e300)]
Box = tuple[tuple[FiniteFloat, FiniteFloat, FiniteFloat], tuple[FiniteFloat, FiniteFloat, FiniteFloat]]


def _unique(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(names)) < len(names):
        raise ValueError("a name is there twice")
    return names


UniqueNames = Annotated[tuple[str, ...], AfterValidator(_unique)]


class JsonPart(BaseModel):
    """Base of the JSON models of a recording; unknown fields, which later versions may add, are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class JointPart(JsonPart):
    """A joint of the model: its kind and the links that it joins."""

    type: str
    links: tuple[str, str]


class LoadPart(JsonPart):
    """A load of the model: its kind, the links on which it acts, and for a load between two points these in the links' frames
    [m]."""

    kind: str
    links: Annotated[tuple[str, ...], Field(min_length=1)]
    points: tuple[tuple[float, float], ...] = ()


class RecordedModel(JsonPart):
    """Connectivity: the ``frame`` is the fixed link, ``drives`` are names of joints, ``traced`` names of points."""

    frame: str
    links: UniqueNames
    joints: dict[str, JointPart]
    drives: UniqueNames
    loads: dict[str, LoadPart]
    traced: UniqueNames | None = None

    @model_validator(mode="after")
    def _names_are_there(self) -> RecordedModel:
        for what, name, links in (
            ("frame", self.frame, (self.frame,)),
            *(("joint", name, joint.links) for name, joint in self.joints.items()),
            *(("load", name, load.links) for name, load in self.loads.items()),
        ):
            for link in links:
                if link not in self.links:
                    raise ValueError(f"{what} '{name}' names the link '{link}', which is not among 'links'")
        for name in self.drives:
            if name not in self.joints:
                raise ValueError(f"drive '{name}' is not among 'joints'")
        return self


class NodePart(JsonPart):
    """A node of the picture: its owner, height and entity; ``beside``: offset of an arrow from its line, or radius of an arc
    [m]."""

    key: str
    kind: str
    entity: Annotated[str, Field(min_length=1)]
    owner: tuple[str, str]
    group: str
    height: FiniteFloat
    parent: str = ""
    beside: FiniteFloat | None = None


class QuantityPart(JsonPart):
    """An entry of the catalogue: its key and the entity of its values."""

    key: str
    entity: str


def _known(units: Units) -> Units:
    for kind in vars(units):
        units.factor(kind)
    return units


class Properties(JsonPart):
    """Properties of a recording, with JSON texts parsed. Recordings of older versions lack the properties that may be None, and
    have millimetres and degrees as display units."""

    version: str = ""
    scene: str = ""
    title: str = ""
    frames: NonNegativeInt
    units: Annotated[Json[Units], AfterValidator(_known)] = MILLIMETRES
    tolerance: Positive
    length_scale: Positive | None = None
    cycle: Positive | None = None
    size: Positive | None = None
    bounds: Json[Box] | None = None
    top: FiniteFloat | None = None
    picture: Json[tuple[NodePart, ...]] | None = None
    quantities: Json[tuple[QuantityPart, ...]] = ()
    model: Json[RecordedModel]
    effects: tuple[str, ...] = ()
    skipped: tuple[str, ...] = ()
    power_items: tuple[str, ...] = ()
    newtons_per_metre: Positive
    newton_metres_per_metre: Positive
    mps_per_metre: Positive
    mps2_per_metre: Positive
    wall_seconds: float = 0.0
    duration: Positive | None = None
    accuracy: Json[dict[str, Any]] | None = None
    interpolation: Literal[0, 1, 3, 5] = 3
    files: Json[dict[str, Base64Bytes]] = {}
    marks: bool = True
    complete: bool = True

    @model_validator(mode="after")
    def _owners_are_there(self) -> Properties:
        for node in self.picture or ():
            for link in (node.parent, node.owner[1] if node.owner[0] == "link" else ""):
                if link and link not in self.model.links:
                    raise ValueError(f"picture: '{node.key}' belongs to the link '{link}', which is not in the model")
        return self


def read_properties(values: Mapping[str, Any]) -> tuple[Properties | None, list[str]]:
    """The properties of a recording (None if invalid), and their faults."""
    try:
        return Properties.model_validate(values), []
    except ValidationError as error:
        return None, [f"property {'.'.join(str(k) for k in e['loc'])}: {_words(e)}" for e in error.errors(include_url=False)]


def _words(error: Any) -> str:
    return "it is missing" if error["type"] == "missing" else str(error["msg"]).removeprefix("Value error, ").lower()


# -- entities ---------------------------------------------------------------------------------------------------------


class ComponentKind(NamedTuple):
    """Kind of values in a component. ``leaf``: "number", "whole" (integers), "text" or "truth" (booleans); ``width``: of vectors;
    ``each``: number of values in a row. Numbers are finite with magnitudes up to ``most``; NaN is allowed with ``gaps``, infinite
    values with ``endless``."""

    leaf: str = "number"
    width: int = 0
    each: int | None = None
    most: float = FARTHEST_VERTEX
    gaps: bool = False
    endless: bool = False


COMPONENT_KINDS: Mapping[str, ComponentKind] = {
    "Scalars:scalars": ComponentKind(most=LARGEST_VALUE, gaps=True, endless=True),
    "Transform3D:translation": ComponentKind(width=3, each=1),
    "Transform3D:quaternion": ComponentKind(width=4, each=1),
    "Transform3D:scale": ComponentKind(width=3, each=1),
    "Mesh3D:vertex_positions": ComponentKind(width=3),
    "Mesh3D:vertex_normals": ComponentKind(width=3),
    "Mesh3D:triangle_indices": ComponentKind("whole", 3),
    "Mesh3D:vertex_colors": ComponentKind("whole"),
    "Points3D:positions": ComponentKind(width=3),
    "Points2D:positions": ComponentKind(width=2),
    "Arrows3D:origins": ComponentKind(width=3),
    "Arrows3D:vectors": ComponentKind(width=3),
    "LineStrips3D:strips": ComponentKind(width=3),
    "LineStrips2D:strips": ComponentKind(width=2),
    "StateChange:state": ComponentKind("text", each=1),
    "StateConfiguration:values": ComponentKind("text"),
    "TextDocument:text": ComponentKind("text", each=1),
    "TextLog:text": ComponentKind("text", each=1),
    "TextLog:level": ComponentKind("text", each=1),
    "SeriesLines:names": ComponentKind("text"),
    "item": ComponentKind("text", each=1),
    "message": ComponentKind("text", each=1),
    "title": ComponentKind("text", each=1),
    "unit": ComponentKind("text", each=1),
    "x_title": ComponentKind("text", each=1),
    "y_title": ComponentKind("text", each=1),
    "per_metre": ComponentKind(each=1, most=LARGEST_VALUE),
    "least": ComponentKind(each=1, most=LARGEST_VALUE),
    "turn": ComponentKind(each=1, most=LARGEST_VALUE),
    "ranges": ComponentKind(each=4, most=LARGEST_VALUE),
    "whole": ComponentKind("truth", each=1),
    "equal": ComponentKind("truth", each=1),
}
FIELD_KINDS: Mapping[str, ComponentKind] = {
    "radii": ComponentKind(),
    "colors": ComponentKind("whole"),
    "labels": ComponentKind("text"),
}
"""Kinds of fields that any archetype may have."""

TABLE_UNITS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("data/links/*/pose", ("m, m, rad",)),
    ("data/links/*/velocity", ("m/s, m/s, rad/s",)),
    ("data/links/*/acceleration", ("m/s², m/s², rad/s²",)),
    ("data/links/*/inertia", ("N, N, N m",)),
    ("data/points/*/position", ("m, m",)),
    ("data/points/*/velocity", ("m/s, m/s",)),
    ("data/points/*/acceleration", ("m/s², m/s²",)),
    ("data/joints/*/reaction", ("N, N, N m",)),
    ("data/joints/*/position", ("m, m",)),
    ("data/joints/*/motion", ("rad, rad/s, rad/s²", "m, m/s, m/s²")),
    ("data/joints/*/friction", ("N, N, N m",)),
    ("data/joints/*/friction_loss", ("W",)),
    ("data/loads/gravity/*", ("N, N, N m, m, m",)),
    ("data/loads/*", ("N, N, N m, m, m",)),
    ("data/drive/*/wrench", ("N, N, N m",)),
    ("data/drive/*", ("rad, rad/s, rad/s², N m, W", "m, m/s, m/s², N, W")),
    ("data/cams/*/contact", ("m, m, N, rad, m, m",)),
    ("data/cams/*/normal", ("N",)),
    ("data/energy", ("J, J, J, J",)),
    ("health/error_estimate", ("1, 1, 1, 1, 1",)),
    ("health/*", ("1", "m", "m/s", "m/s²")),
)
"""Allowed units of the numbers in a row, by path of the table; the first pattern that fits counts."""

FINITE_TABLES = tuple(("data", what) for what in ("links", "points", "joints", "loads", "drive", "energy"))
"""Tables without infinite numbers; radii of curvature and conditions may be infinite."""

COMPONENTS_TOGETHER: tuple[tuple[str, ...], ...] = (
    ("Mesh3D:vertex_positions", "Mesh3D:triangle_indices", "Mesh3D:vertex_normals", "Mesh3D:vertex_colors"),
    ("TextLog:text", "TextLog:level"),
    ("item", "message"),
    ("StateConfiguration:values", "StateConfiguration:labels", "StateConfiguration:colors"),
    ("Arrows3D:origins", "Arrows3D:vectors"),
    ("Transform3D:translation", "Transform3D:quaternion"),
    ("per_metre", "title", "unit", "least", "whole"),
    ("ranges", "title", "x_title", "y_title", "equal", "turn"),
    ("TextLog:level", "TextLog:text"),
)
"""If an entity has the first component of a group, it has all of them."""

SAME_COUNT = (
    *("Mesh3D:vertex_normals", "Mesh3D:vertex_colors"),
    *("StateConfiguration:labels", "StateConfiguration:colors"),
    "Arrows3D:vectors",
)
"""Components that have as many values as the first component of their group."""


def units_of(parts: tuple[str, ...]) -> tuple[str, ...]:
    """The allowed units of the numbers in a row of a table; empty for tables that the contract does not specify."""
    for pattern, units in TABLE_UNITS:
        stated = pattern.split("/")
        if len(parts) == len(stated) and all(s in ("*", part) for s, part in zip(stated, parts, strict=True)):
            return units
    return ()


def needed_tables(model: RecordedModel, forces: bool) -> set[str]:
    """The tables that a recording of a model must have; ``forces``: reactions were computed."""
    return {entity(*parts) for parts in _needed(model, forces)}


def missing_tables(recording: Recording) -> list[str]:
    """The tables that a recording must have but lacks."""
    needed = needed_tables(recording.parsed_properties.model, recording.has("data", "energy"))
    return sorted(path for path in needed | {q.entity for q in recording.parsed_properties.quantities} if not recording.has(path))


def _needed(model: RecordedModel, forces: bool) -> Iterator[tuple[str, ...]]:
    for link in model.links:
        yield "data", "links", link, "pose"
    for joint in model.joints:
        yield "data", "joints", joint, "position"
        yield "data", "joints", joint, "motion"
        if forces:
            yield "data", "joints", joint, "reaction"
    for joint in model.drives:
        if forces:
            yield "data", "drive", joint
            yield "data", "drive", joint, "wrench"


def faults_of(recording: Recording) -> Iterator[str]:
    """Faults of the entities of a recording with valid properties."""
    properties, has = recording.parsed_properties, set(recording.entities)
    yield from (f"{path} is missing" for path in missing_tables(recording))
    yield from (f"{node.entity} is missing" for node in properties.picture or () if node.kind == "body" and node.entity not in has)
    poses = {entity("data", "links", link, "pose") for link in properties.model.links}
    time = recording.times(entity("data", "links", properties.model.frame, "pose"))
    if np.any(np.diff(time) <= 0):
        yield "the times of the frames do not increase"
    for path in recording.entities:
        if not path.startswith("/__properties"):
            yield from (f"{path}: {words}" for words in dict.fromkeys(_entity_faults(recording, path, time, path in poses)))


def _entity_faults(recording: Recording, path: str, time: object, pose: bool) -> Iterator[str]:
    """Faults of an entity; ``time``: of the frames; ``pose``: its numbers are poses, with the limits of coordinates."""
    parts = parts_of(path)
    scalars = (
        ComponentKind()
        if pose
        else COMPONENT_KINDS["Scalars:scalars"]._replace(endless=not (units_of(parts) and parts[:2] in FINITE_TABLES))
    )
    counts: dict[str, Any] = {}  # number of instances in each row, by component, over all batches
    names = set()
    for batch, moving in recording.batches(path):
        names |= set(batch.schema.names)
        for name in batch.schema.names:
            kind = scalars if name == "Scalars:scalars" else COMPONENT_KINDS.get(name) or FIELD_KINDS.get(name.rpartition(":")[2])
            if kind is not None:
                try:
                    column = _read_column(batch[name], kind, name, moving)
                except ValueError as error:
                    yield f"its {name} {error}"
                    return
                counts[name] = np.concatenate([counts[name], column]) if name in counts and moving else column
    for first, *others in COMPONENTS_TOGETHER:
        if first in names:
            missing = [name for name in others if name not in names]
            yield from (f"it has {first}, but no {name}" for name in missing)
            paired = [name for name in others if name in SAME_COUNT and name in counts]
            different = [name for name in paired if not np.array_equal(counts[name], counts[first])]
            yield from (f"it has more or fewer {name} than {first}" for name in different)
    if "Mesh3D:triangle_indices" in names and not _faces_fit(recording, path):
        yield "its faces name vertices that it has not"
    if parts[0] in ("data", "health") and recording.has(path):
        yield from _table_faults(recording, path, time, counts.get("Scalars:scalars"))


def _read_column(column: pa.Array, kind: ComponentKind, name: str, moving: bool) -> Any:
    """Number of instances (n,) in each row of an arrow column. Raises ValueError with the fault of an invalid column."""
    import pyarrow as pa

    if not pa.types.is_list(column.type):
        raise ValueError("does not hold lists")
    if column.null_count and (moving or kind.each is not None):
        raise ValueError("has rows without values")
    column = column.drop_null()
    lengths = np.diff(np.asarray(column.offsets))
    if kind.each is not None and np.any(lengths != kind.each):
        raise ValueError(f"has {lengths[lengths != kind.each][0]} values in a row instead of {kind.each}")
    values = column.flatten()
    if pa.types.is_list(values.type) and name.endswith(":strips"):
        values = values.flatten()
    if kind.width:
        if not pa.types.is_fixed_size_list(values.type) or values.type.list_size != kind.width:
            raise ValueError(f"does not hold vectors of {kind.width} numbers")
        values = values.flatten()
    tests = {"number": pa.types.is_floating, "whole": pa.types.is_integer, "text": pa.types.is_string, "truth": pa.types.is_boolean}
    if not tests[kind.leaf](values.type):
        raise ValueError(f"holds {values.type}, not {KIND_WORDS[kind.leaf]}")
    if values.null_count:
        raise ValueError("has values that are not there")
    if kind.leaf == "number":
        numbers = values.to_numpy(zero_copy_only=False)
        allowed = np.isfinite(numbers) | (np.isnan(numbers) & kind.gaps) | (np.isinf(numbers) & kind.endless)
        if not allowed.all():
            raise ValueError("is not finite")
        if float(np.abs(numbers[np.isfinite(numbers)]).max(initial=0.0)) > kind.most:  # beyond the range of float32
            raise ValueError(f"holds numbers beyond {kind.most:g}")
        if name == "Transform3D:scale" and not numbers.all():
            raise ValueError("is zero")
        if name == "Transform3D:quaternion" and not numbers.reshape(-1, 4).any(axis=1).all():
            raise ValueError("is zero")
    return lengths


UNIT_PATTERN = re.compile(r" \[([^\]]*)\]$")  # at the end of a name, such as ``crank.x [m]``
KIND_WORDS = {"number": "numbers", "whole": "whole numbers", "text": "text", "truth": "truth values"}


def _table_faults(recording: Recording, path: str, time: Any, counts: Any) -> Iterator[str]:
    """Faults of a table, in which every frame must have a row, every row the same count of numbers, and every column a name with
    the unit of the contract."""
    if counts is None:
        yield "it has no values"
        return
    names = recording.static(path, component="SeriesLines:names")
    units = ", ".join(unit[1] if (unit := UNIT_PATTERN.search(str(name))) else "1" for name in (() if names is None else names))
    allowed = units_of(parts_of(path)) or (units,)
    width = len(allowed[0].split(", "))
    if np.any(counts != width):
        yield f"it has {counts[counts != width][0]} numbers in a row instead of {width}"
    elif not np.array_equal(recording.times(path), time):
        yield f"its {len(counts)} rows are not at the {len(time)} frames"
    elif units not in allowed:
        yield f"its columns are in '{units}' instead of '{' or '.join(allowed)}'"


def _faces_fit(recording: Recording, path: str) -> bool:
    vertices, faces = (recording.static(path, component=f"Mesh3D:{name}") for name in ("vertex_positions", "triangle_indices"))
    return vertices is not None and faces is not None and len(vertices) > 0 and int(faces.max(initial=0)) < len(vertices)
