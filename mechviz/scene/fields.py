"""The types of the values in a scene: names, numbers, and quantities that may carry their own unit.

Each type checks its own value and reports a fault in one sentence; pydantic's unions would report one for each branch.
"""

from __future__ import annotations

import ast
import inspect
import math
import re
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from itertools import pairwise
from threading import RLock
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainValidator,
    PrivateAttr,
    Tag,
    WithJsonSchema,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from mechcore.records import dataclass
from mechviz.scene.units import EXPRESSION_PATTERN, QUANTITY_PATTERN, UNIT_KINDS, QuantityError, magnitude, parse, unit_factor


def fault(message: str, remedy: str = "") -> PydanticCustomError:
    """An error that reaches the user word for word."""
    return faults([("", message, remedy)])


def faults(every: list[tuple[str, str, str]]) -> PydanticCustomError:
    """Several errors of one table at once, each (key, message, remedy); the key "" means the table itself.

    They travel in the context of a single pydantic error, since a validator can raise only one.
    """
    return PydanticCustomError("scene", "faults of a scene", {"faults": every})


def describe(value: object) -> str:
    """A value of a scene as a user wrote it, short."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"'{value}'" if len(value) <= 40 else f"'{value[:37]}...'"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return f"a list of {len(value)}" if len(str(value)) > 40 else str(value).replace("'", '"')
    if isinstance(value, int) and value.bit_length() > 200:
        return f"an integer of about {value.bit_length() * 0.30103:.0f} digits"  # Python refuses to print the longest
    text = str(value)
    if isinstance(value, float) and len(text) > 14:
        text = f"{value:.6g}"  # a result of a formula
    return text if len(text) <= 40 else f"{text[:37]}..."


def _finite(value: object, wanted: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise fault(f"{describe(value)} where {wanted} is wanted.", "Write a number without quotes, such as 0.5.")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise fault(f"{describe(value)} is not a finite number.", "Give a finite one.")
    return number + 0.0  # -0.0 has no meaning, and would be lost where zero is the default


def _number(value: object) -> float:
    return _finite(value, "a plain number")


@dataclass(frozen=True)
class QuantityMark:
    """Marks a number in the scene's units, or a text with a unit of one of the ``kinds``. ``least`` bounds it from below; ``word``
    is a text that is accepted in place of a value that follows from others.

    Of several kinds, the driven joint determines the one that applies, and its conversion checks the unit. Pydantic calls the two
    methods.
    """

    kinds: tuple[str, ...]
    least: Literal["", "zero", "above zero"] = ""
    word: str = ""

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self._check)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        bound = {"zero": {"minimum": 0}, "above zero": {"exclusiveMinimum": 0}}.get(self.least, {})
        words = [{"const": self.word}] if self.word else []
        pattern = f"{QUANTITY_PATTERN}|{EXPRESSION_PATTERN}"
        return {
            "anyOf": [*words, {"type": "number", **bound}, {"type": "string", "pattern": pattern}],
            "description": f"{self._words}: a number in the scene's units, a text with its own unit, or an expression",
            "examples": [UNIT_KINDS[kind].example for kind in self.kinds],
        }

    @property
    def _words(self) -> str:
        return " or ".join(UNIT_KINDS[kind].words for kind in self.kinds)

    def _check(self, value: object) -> float | str:
        if self.word and value == self.word:
            return self.word
        if not isinstance(value, str):
            if isinstance(value, bool) or not isinstance(value, int | float):
                remedy = f"Write a number, or a text such as '{UNIT_KINDS[self.kinds[0]].example}'."
                raise fault(f"{describe(value)} where {self._words} is wanted.", remedy)
            number = _finite(value, self._words)
            self._bounded(number, value)
            return number
        try:
            self._bounded(magnitude(value), value)
            if len(self.kinds) == 1 and not math.isfinite(parse(value, self.kinds[0])):
                raise QuantityError(f"'{value}' is too large.", "Give a finite value.")
        except QuantityError as error:
            raise fault(str(error), error.remedy) from None
        return value.strip()

    def _bounded(self, number: float, value: float | str) -> None:
        if self.least and number < 0.0:
            raise fault(f"{describe(value)} is negative.", "Give a positive value.")
        if self.least == "above zero" and number == 0.0:
            raise fault(f"{describe(value)} is zero.", "Give a positive value.")


def value_or_list(value: object) -> str:
    return "<list>" if isinstance(value, list | tuple) else "<value>"


Length = Annotated[float | str, QuantityMark(("length",))]
Size = Annotated[float | str, QuantityMark(("length",), "above zero")]
Angle = Annotated[float | str, QuantityMark(("angle",))]
Mass = Annotated[float | str, QuantityMark(("mass",), "zero")]
SignedMass = Annotated[float | str, QuantityMark(("mass",))]
Density = Annotated[float | str, QuantityMark(("density",), "above zero")]
Time = Annotated[float | str, QuantityMark(("time",))]
Duration = Annotated[float | str, QuantityMark(("time",), "above zero")]
Force = Annotated[float | str, QuantityMark(("force",))]
Torque = Annotated[float | str, QuantityMark(("torque",))]
Inertia = Annotated[float | str, QuantityMark(("inertia",), "zero")]
Extent = Annotated[float | str, QuantityMark(("length",), "zero")]
Speed = Annotated[float | str, QuantityMark(("linear speed",))]
Pressure = Annotated[float | str, QuantityMark(("pressure",), "above zero")]
Power = Annotated[float | str, QuantityMark(("power",), "above zero")]
AngularSpeed = Annotated[float | str, QuantityMark(("angular speed",))]
TorsionalGain = Annotated[float | str, QuantityMark(("torsional damping",), "above zero")]
Effort = Annotated[float | str, QuantityMark(("torque", "force"), "zero")]
Frequency = Annotated[float | str, QuantityMark(("frequency",), "above zero")]
Gravity = Annotated[float | str, QuantityMark(("gravity",))]
# of a revolute joint or of a prismatic one
Coordinate = Annotated[float | str, QuantityMark(("angle", "length"))]
Distance = Annotated[float | str, QuantityMark(("angle", "length"), "above zero")]
Range = Annotated[float | str, QuantityMark(("angle", "length"), "zero")]
Rate = Annotated[float | str, QuantityMark(("angular speed", "linear speed"))]
Period = Annotated[float | str, QuantityMark(("angle", "length", "time"), "above zero")]
Argument = Annotated[float | str, QuantityMark(("time", "angle", "length", "angular speed", "linear speed"), "above zero")]
# of a spring, damper ... between points, or of one that turns
Stiffness = Annotated[float | str, QuantityMark(("stiffness", "torsional stiffness"), "zero")]
Coefficient = Annotated[float | str, QuantityMark(("damping", "torsional damping"), "zero")]
_Three = Field(min_length=3, max_length=3)
# of a bushing, in x, y and angle
Stiffnesses = Annotated[
    Annotated[Stiffness, Tag("<value>")] | Annotated[Annotated[list[Stiffness], _Three], Tag("<list>")],
    Discriminator(value_or_list),
]
Coefficients = Annotated[
    Annotated[Coefficient, Tag("<value>")] | Annotated[Annotated[list[Coefficient], _Three], Tag("<list>")],
    Discriminator(value_or_list),
]
IntegralGain = Annotated[float | str, QuantityMark(("integral gain", "torsional integral gain"), "zero")]
QuadraticCoefficient = Annotated[float | str, QuantityMark(("quadratic damping", "quadratic torsional damping"), "zero")]
Condition = Annotated[
    float | str,
    QuantityMark(("angle", "length", "angular speed", "linear speed", "angular acceleration", "linear acceleration")),
]
Number = Annotated[float, PlainValidator(_number), WithJsonSchema({"type": "number"})]


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise fault(f"{describe(value)} where a text is wanted.", "Put it in quotes.")
    try:
        value.encode()
    except UnicodeEncodeError:
        raise fault("a text with characters that no file can hold (lone surrogates).", "Write other ones.") from None
    bad = _NO_TEXT.search(value)
    if bad:
        raise fault(f"a text with the character {bad[0]!a}, which drawings and terminals do not show.", "Leave it out.")
    return value


_NO_TEXT = re.compile("[^\t\n\r -\x7e\xa0-\ufffd\U00010000-\U0010ffff]")
"""Control characters and those that no XML may contain."""


def _flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise fault(f"{describe(value)} where true or false is wanted.", "Write true or false, without quotes.")
    return value


def _colour(value: str) -> str:
    if not re.fullmatch(_COLOUR, value):
        raise fault(f"{describe(value)} where a colour is wanted.", 'Write red, green and blue as in "#d9534f".')
    return value.lower()


_COLOUR = "#[0-9a-fA-F]{6}"


def _name(value: str) -> str:
    """A valid name: names become parts of paths in recordings and of file names."""
    if not value:
        raise fault("an empty name.", "Give it a name.")
    if len(value) > 100:
        raise fault(f"a name of {len(value)} characters.", "Keep it under 100.")
    if value != value.strip():
        raise fault(f"the name '{value}' begins or ends with a space.", f"Write '{value.strip()}'.")
    if value.startswith("__"):
        raise fault(
            f"the name '{value}' begins with two underscores, which recordings keep for themselves.",
            f"Write '{value.lstrip('_')}'.",
        )
    if value in (".", ".."):
        raise fault(f"the name '{value}' means a folder in paths.", "Use letters or digits.")
    bad = next((c for c in value if c in '/\\"' or not c.isprintable()), "")
    if bad:
        raise fault(f"the name {describe(value)} contains {bad!r}, which breaks paths.", f"Write '{value.replace(bad, '_')}'.")
    odd = next((c for c in value if not c.isascii() and not c.isalnum()), "")
    if odd:  # rerun writes them as numbers, which readers of recordings do not know to undo
        raise fault(
            f"the name {describe(value)} contains {odd!r}, which recordings cannot keep as it is.",
            "Use letters of any language, digits, spaces and signs of ASCII.",
        )
    return value


Text = Annotated[str, BeforeValidator(_text)]
Colour = Annotated[Text, AfterValidator(_colour), Field(json_schema_extra={"pattern": f"^{_COLOUR}$"})]
TwoNames = Annotated[list[Text], Field(min_length=2, max_length=2)]
OneOrTwoNames = Annotated[Annotated[Text, Tag("<value>")] | Annotated[TwoNames, Tag("<list>")], Discriminator(value_or_list)]
Flag = Annotated[bool, PlainValidator(_flag), WithJsonSchema({"type": "boolean"})]
Name = Annotated[Text, AfterValidator(_name), Field(json_schema_extra={"pattern": r'^(?!__)[^/\\"]{1,100}$'})]


@dataclass(frozen=True)
class UnitName:
    """Marks a text as the name of a unit of a kind; pydantic calls the two methods."""

    kind: str

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self._check)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"type": "string", "examples": [self._example]}

    @property
    def _example(self) -> str:
        return UNIT_KINDS[self.kind].example.split(" ", 1)[1]

    def _check(self, value: object) -> str:
        if not isinstance(value, str):
            raise fault(f"{describe(value)} where the name of a unit is wanted.", f"Write it like '{self._example}'.")
        try:
            unit_factor(value.strip(), self.kind)
        except QuantityError as error:
            if str(error).endswith("is wanted."):
                remedy = error.remedy.replace(UNIT_KINDS[self.kind].example, self._example)
                raise fault(f"'{value}' is the unit of {error}", remedy) from None
            raise fault(str(error), error.remedy) from None
        return value.strip()


def _exactly_two(value: object) -> Any:
    if not isinstance(value, list | tuple):
        raise fault(f"{describe(value)} where a pair of numbers is wanted.", "Write it like [x, y].")
    if len(value) != 2:
        entries = "1 entry" if len(value) == 1 else f"{len(value)} entries"
        raise fault(f"{describe(value)} has {entries}, two are wanted.", "Write it like [x, y].")
    return value


def _direction(value: object) -> list[float] | list[str]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise fault(
            f"{describe(value)} where a direction is wanted.",
            "Write it like [1, 0], or name two points of the guide's link.",
        )
    if all(isinstance(v, str) for v in value):
        return list(value)
    numbers = [_number(v) for v in value]
    if numbers == [0.0, 0.0]:
        raise fault("a direction of length zero.", "Write it like [1, 0].")
    if not 1e-30 < math.hypot(*numbers) < 1e30:
        raise fault(f"{describe(value)} is out of all proportion for a direction.", "Write it like [1, 0].")
    return numbers


_PAIR = BeforeValidator(_exactly_two)
Point = Annotated[tuple[Length, Length], _PAIR]
ForceVector = Annotated[tuple[Force, Force], _PAIR]
GravityVector = Annotated[tuple[Gravity, Gravity], _PAIR]
Direction = Annotated[
    list[float] | list[str],
    PlainValidator(_direction),
    WithJsonSchema(
        {
            "type": "array",
            "minItems": 2,
            "maxItems": 2,
            "items": {"type": ["number", "string"]},
            "description": "a direction [x, y], or the names of two points of the guide's link",
        }
    ),
]


class UnknownName(str):
    """Stand-in for a name that could not be read or does not exist. It equals only itself."""

    __slots__ = ()
    __eq__ = object.__eq__
    __ne__ = object.__ne__
    __hash__ = object.__hash__


class _Building:
    """The table whose validator is being built; the lock admits one at a time."""

    def __init__(self) -> None:
        self.table: type[DocumentTable] | None = None
        self.lock = RLock()

    def __enter__(self) -> None:
        self.lock.acquire()

    def __exit__(self, *error: object) -> None:
        self.lock.release()


_building = _Building()


class DocumentTable(BaseModel):
    """A table of the document. Unknown keys are faults, and a table does not change after it is read.

    Tables are also made where a file has faults, so that every check can be run on the valid parts. Values that could not be read
    are replaced: numbers by NaN, names by ``UnknownName``; ``invalid_keys`` names the keys concerned.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    ELSEWHERE: ClassVar[Mapping[str, str]] = {}  # key of another table -> remedy: where it belongs

    _invalid_keys: frozenset[str] = PrivateAttr(default=frozenset())

    @classmethod
    def model_rebuild(cls, **how: Any) -> bool | None:
        """Build the validator of this table. This is done when the first one is read, since a scene has few kinds of tables. Inner
        tables build their own."""
        with _building:
            own, _building.table = _building.table, cls
            try:
                return super().model_rebuild(**how)
            finally:
                _building.table = own

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        if _building.table is cls:
            return handler(source)
        return core_schema.no_info_plain_validator_function(
            cls.model_validate, ref=f"{cls.__module__}.{cls.__qualname__}:{id(cls)}"
        )

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """The schema of the table, in which the text below each key in the source becomes its description. pydantic's own
        ``use_attribute_docstrings`` reads the sources whenever the tables are loaded, which costs every command a tenth of a
        second."""
        if core["type"] == "function-plain":
            cls.model_rebuild()
            core = cls.__pydantic_core_schema__
        schema = handler(core)
        entries = handler.resolve_ref_schema(schema)["properties"]
        for base in reversed(cls.__mro__):
            for key, text in _explained(base).items() if issubclass(base, DocumentTable) else ():
                field = cls.model_fields[key]
                if field.description is None:
                    entries[field.alias or key]["description"] = text
        return schema

    @classmethod
    def keys_beside(cls, raw: Mapping[str, Any]) -> list[str]:
        """The keys that a table of plain data may have: all, unless some of them determine its kind."""
        return list(cls.model_fields)

    @property
    def invalid_keys(self) -> frozenset[str]:
        """Keys whose values could not be read; "*" where the table itself could not be."""
        return self._invalid_keys

    def has_valid(self, *keys: str) -> bool:
        """Whether all these keys could be read (or are left out)."""
        return self._invalid_keys.isdisjoint((*keys, "*"))

    def mark_invalid(self, keys: Iterable[str]) -> None:
        """Store which keys could not be read; called by the reader of faulty scenes."""
        self._invalid_keys = frozenset(keys)


def table_or_value(value: object) -> str:
    """Tag of an entry that is a table or a plain value: as read, or as validated."""
    return "<table>" if isinstance(value, dict | DocumentTable) else "<value>"


def name_or_list(value: object) -> str:
    """Tag of an entry that is a name or a list, as a point is."""
    return "<name>" if isinstance(value, str) else "<list>"


@cache
def _explained(table: type) -> dict[str, str]:
    """The texts below a class's own annotated names, by name."""
    body = _classes(table.__module__)[table.__name__]
    return {
        line.target.id: inspect.cleandoc(below.value.value)
        for line, below in pairwise(body.body)
        if isinstance(line, ast.AnnAssign)
        and isinstance(line.target, ast.Name)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
        and isinstance(below.value.value, str)
    }


@cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    """The classes of a module by name. Its source is parsed once: `inspect.getsource` would parse it for every class."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}


def is_complete(value: object) -> bool:
    """Whether a value of the document contains no stand-in for a value that could not be read."""
    if isinstance(value, DocumentTable):
        return not value.invalid_keys and all(is_complete(getattr(value, key)) for key in type(value).model_fields)
    if isinstance(value, Mapping):
        return all(map(is_complete, value.values()))
    if isinstance(value, list | tuple):
        return all(map(is_complete, value))
    return not isinstance(value, UnknownName) and not (isinstance(value, float) and math.isnan(value))


def one_of(table: DocumentTable, keys: tuple[str, ...], what: str) -> list[tuple[str, str, str]]:
    """The fault (key, message, remedy) of a table that does not have exactly one of the keys, in a list that is otherwise empty;
    ``what``: the table in a sentence."""
    given = [key for key in keys if getattr(table, key) is not None]
    names = ", ".join(keys[:-1]) + " or " + keys[-1]
    if not given:
        return [("", f"{what} has none of {names}.", "Give one of them.")]
    return [("", f"{what} has {' and '.join(given)} at once.", f"Keep one of {names}.")] if len(given) > 1 else []


def raise_faults(every: list[tuple[str, str, str]]) -> None:
    """Raise the faults, if there are any."""
    if every:
        raise faults(every)
