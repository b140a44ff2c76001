"""From plain data to a scene document, with every fault in words: the valid parts of a faulty scene are read one by one."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import field, replace
from functools import cached_property
from typing import Any, Literal, cast, get_args, get_origin

from annotated_types import MaxLen, MinLen
from pydantic import PlainValidator, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from mechcore.errors import Fault
from mechcore.records import dataclass
from mechviz.scene.annotations import hints_of, inner_types, peel
from mechviz.scene.document import SceneDocument
from mechviz.scene.faults import closest, in_file_order, listing, nearest, path_text
from mechviz.scene.fields import DocumentTable, QuantityMark, UnitName, UnknownName, describe
from mechviz.scene.kinds.joints.document import JOINT_KINDS, JointDocument
from mechviz.scene.kinds.loads.document import LOAD_KINDS as LOADS
from mechviz.scene.names import points_of_joint
from mechviz.scene.reading.formulas import resolve

Loc = tuple[int | str, ...]
_NOTHING = object()
_BRANCHES = frozenset(("<list>", "<name>", "<table>", "<value>"))  # all tags of unions: a name may look like another tag
_adapters: dict[int, tuple[Any, TypeAdapter[Any]]] = {}


class SpellingRepairs(str):
    """A word of the document that replaces a misspelt one."""

    __slots__ = ()


def read_table(cls: type[DocumentTable], raw: object, loc: Loc, faults: list[Fault]) -> DocumentTable:
    """A table of the document from plain data, with stand-ins for what could not be read; faults of form are added to
    ``faults``."""
    if not isinstance(raw, Mapping):
        said = [fault for place, detail in _validated(cls, raw)[1] for fault in words_of(detail, (*loc, *place))]
        faults += [replace(f, remedy=_TABLE[1].replace("key", next(iter(hints_of(cls))))) for f in said]
        return _blank(cls)
    hints, before = hints_of(cls), len(faults)
    values: dict[str, Any] = {}
    missing: set[str] = set()
    repaired = _keys_repaired(cls, raw, loc, faults)
    for key, written in repaired.items():
        own: list[Fault] = []
        values[key], whole = _read(hints[key], raw[written], (*loc, written), own)
        if written != key:  # a value that does not fit may be meant for something else
            own = [fault for fault in own if fault.path != path_text((*loc, written))]
        faults += own
        if not whole:
            missing.add(key)
        if values[key] is _NOTHING:
            del values[key]
    given = set(values)
    for key, info in cls.model_fields.items():
        if info.is_required() and key not in values:
            if key not in missing:
                faults.append(missing_key((*loc, key)))
            values[key] = _stand_in(hints[key], None)
            missing.add(key)
    table = cls.model_construct(_fields_set=given, **values)
    table.mark_invalid(missing)
    guessed = {key for key, written in repaired.items() if written != key}
    faults += _faults_of_the_whole(table, raw, loc, guessed, faulty=len(faults) > before)
    return table


MOST_GUESSED = 200  # unknown keys of a table for which a known one is suggested


def _keys_repaired(cls: type[DocumentTable], raw: Mapping[str, Any], loc: Loc, faults: list[Fault]) -> dict[str, str]:
    """Known key -> the key as it is written. Unknown keys are noted as faults; each replaces a similar known key that its value
    fits."""
    hints = hints_of(cls)
    beside = cls.keys_beside(raw)
    taken = {key: key for key in raw if key in hints and not _is_synonym(str(key), raw, beside, hints, loc)}
    unknown = [written for written in raw if written not in taken]
    for k, written in enumerate(unknown):
        if written in cls.ELSEWHERE:
            faults.append(Fault(path_text(loc), f"'{written}' does not belong here.", cls.ELSEWHERE[written]))
        elif k >= MOST_GUESSED:
            faults.append(unknown_key((*loc, written), beside, ""))
        else:
            candidates = spelling_candidates(str(written), beside)
            fitting = (key for key in candidates if _fits(hints[key], raw[written], (*loc, written)))
            guess = next(fitting, next((key for key in candidates if misspelt(str(written), key)), ""))
            inside = next((key for key in beside if written in _keys_within(hints[key], raw.get(key))), "")
            if guess and guess == _SYNONYMS.get(str(written)):
                inside = ""  # the other word for a key of this table is meant
            faults.append(unknown_key((*loc, written), beside, guess, inside))
            if guess and not inside:
                taken.setdefault(guess, written)
    return taken


def _is_synonym(key: str, raw: Mapping[str, Any], beside: Sequence[str], hints: Mapping[str, Any], loc: Loc) -> bool:
    """Whether a known key has the value of another one for which its name is a synonym, such as `slider` for `prismatic`."""
    meant = _SYNONYMS.get(key, "")
    if meant not in beside or meant in raw:
        return False
    return not _fits(hints[key], raw[key], (*loc, key)) and _fits(hints[meant], raw[key], (*loc, key))


def _keys_within(annotation: object, raw: object) -> Iterable[str]:
    """The keys of a table at a place of this type; none where its value is no table."""
    kind, _ = peel(annotation, raw)
    return hints_of(kind) if isinstance(kind, type) and issubclass(kind, DocumentTable) else ()


def _fits(annotation: object, raw: object, loc: Loc) -> bool:
    """Whether a value is of the kind that its place requires; faults inside it do not count."""
    faults: list[Fault] = []
    _read(annotation, raw, loc, faults)
    place = path_text(loc)
    return not any(fault.path == place for fault in faults)


def _faults_of_the_whole(table: DocumentTable, raw: Mapping[str, Any], loc: Loc, guessed: set[str], *, faulty: bool) -> list[Fault]:
    """Faults that the table's own validators find in keys that do not go together, except in keys that are only ``guessed``. In a
    ``faulty`` table a validator may fail on a stand-in."""
    faults: list[Fault] = []
    for validator in type(table).__pydantic_decorators__.model_validators.values():
        if validator.info.mode == "after":
            try:
                validator.func(table)
            except PydanticCustomError as error:
                reported = [f for f in (error.context or {}).get("faults", ()) if f[0] not in guessed]
                faults += words_of({"type": error.type, "input": raw, "ctx": {"faults": reported}}, loc)
            except (ArithmeticError, AssertionError, LookupError, TypeError, ValueError):
                if not faulty:
                    raise  # not caused by a stand-in
    return faults


def _read(annotation: object, raw: object, loc: Loc, faults: list[Fault]) -> tuple[Any, bool]:
    """A value with stand-ins for what could not be read, and whether it is of the right form as a whole."""
    kind, marks = peel(annotation, raw)
    if isinstance(kind, type) and issubclass(kind, DocumentTable):
        table = read_table(kind, raw, loc, faults)
        return table, table.has_valid()
    valid, details = _validated(annotation, raw)
    if not details:
        return valid, True
    origin, inner = get_origin(kind), get_args(kind)
    leaf = any(isinstance(mark, PlainValidator | QuantityMark | UnitName) for mark in marks)
    held: tuple[type[Any], ...] = {dict: (Mapping,), list: (list, tuple), tuple: (list, tuple)}.get(origin, ())
    if leaf or not isinstance(raw, held):
        faults += [fault for place, detail in details for fault in words_of(detail, (*loc, *place))]
        return _stand_in(annotation, raw), False
    least, most = _length(marks)
    own: list[Any] = [detail for place, detail in details if place == ()]
    if not own and not (0 if least is None else least) <= len(raw) <= (len(raw) if most is None else most):
        own = [{"type": "too_long", "input": raw, "ctx": {"min_length": least, "max_length": most}}]  # else entries hide it
    faults += [fault for detail in own for fault in words_of(detail, loc)]
    if isinstance(raw, Mapping):
        names = [(place, detail) for place, detail in details if place[1:] == ("[key]",)]
        faults += [fault for place, detail in names for fault in words_of(detail, (*loc, *place))]
        return {key: _read(inner[1], value, (*loc, key), faults)[0] for key, value in raw.items()}, not own
    kinds = inner_types(kind, len(raw))
    entries = [_read(each, value, (*loc, k), faults)[0] for k, (each, value) in enumerate(zip(kinds, raw, strict=True))]
    if origin is tuple:
        return (tuple(entries) if not own else _stand_in(annotation, raw)), not own
    if own and least == most is not None:  # a fixed number of entries, of which none is known
        entries = [_stand_in(inner[0], None) for _ in range(most)]
    return entries, not own


def _validated(annotation: Any, raw: Any) -> tuple[Any, list[tuple[Loc, Any]]]:
    """The validated value, or pydantic's errors about it, each with its place without the tags of unions."""
    if id(annotation) not in _adapters:  # by identity: the marks in annotations need not be hashable
        _adapters[id(annotation)] = annotation, TypeAdapter(annotation)
    try:
        return _adapters[id(annotation)][1].validate_python(raw), []
    except ValidationError as error:
        details = error.errors(include_url=False)
    return None, [(tuple(part for part in detail["loc"] if part not in _BRANCHES), detail) for detail in details]


def _length(marks: list[Any]) -> tuple[int | None, int | None]:
    """Least and greatest number of entries that the marks of a list allow."""
    least = next((mark.min_length for mark in marks if isinstance(mark, MinLen)), None)
    most = next((mark.max_length for mark in marks if isinstance(mark, MaxLen)), None)
    return least, most


def _stand_in(annotation: object, raw: object) -> Any:
    """Stand-in for a value that could not be read."""
    kind, marks = peel(annotation, raw)
    origin = get_origin(kind)
    if any(isinstance(mark, UnitName) for mark in marks):
        return _NOTHING
    if any(isinstance(mark, QuantityMark) for mark in marks) or kind in (int, float):
        return math.nan
    if origin is Literal:
        near = closest(raw, [word for word in get_args(kind) if isinstance(word, str)]) if isinstance(raw, str) else ""
        return SpellingRepairs(near) if near else UnknownName(raw if isinstance(raw, str) else "?")
    if kind is bool:
        return raw.lower() not in ("false", "no", "off", "") if isinstance(raw, str) else bool(raw)
    if kind is str:
        return UnknownName(raw if isinstance(raw, str) else "?")
    if isinstance(kind, type) and issubclass(kind, DocumentTable):
        return _blank(kind)
    if origin is tuple:
        return (*(_stand_in(each, None) for each in get_args(kind)),)
    if origin is dict or kind is dict:
        return {}
    if origin is list or kind is list:
        least, most = _length(marks)
        if any(isinstance(mark, PlainValidator) for mark in marks):  # a direction: two numbers
            return [math.nan, math.nan]
        return [_stand_in(get_args(kind)[0], None) for _ in range(most)] if least == most is not None else []
    return _NOTHING


def _blank(cls: type[DocumentTable]) -> DocumentTable:
    """A table of which nothing could be read."""
    hints = hints_of(cls)
    required = {key: _stand_in(hints[key], None) for key, field in cls.model_fields.items() if field.is_required()}
    table = cls.model_construct(_fields_set=set(), **required)
    table.mark_invalid({"*", *cls.model_fields})
    return table


_SECTIONS = ("links", "joints", "sketch", "loads", "watch", "systems", "substitutes", "sections", "pens")


@dataclass
class Reading:
    """A scene as far as it could be read, with stand-ins for the rest.

    ``raw``: the plain data that were read, None where a valid document was changed. ``unreadable`` names the items of each section
    that are not wholly known, "*" where the section itself is not; ``kindless_joints`` holds the joints of which not even the kind
    is known, which the document leaves out.
    """

    document: SceneDocument
    raw: Mapping[str, Any] | None = None
    faults: list[Fault] = field(default_factory=list)
    unreadable: Mapping[str, set[str]] = field(default_factory=lambda: {section: set() for section in _SECTIONS})
    kindless_joints: dict[str, JointDocument] = field(default_factory=dict)

    @cached_property
    def link_names(self) -> dict[str, None]:
        """Names of all links, also of those that are faulty."""
        links = self.document.links if self.raw is None else self.raw.get("links")
        return {str(name): None for name in links} if isinstance(links, dict) else {}

    def in_file_order(self, faults: Iterable[Fault]) -> list[Fault]:
        """Faults without repetitions, in the order of their paths in the scene."""
        return in_file_order(faults, self.document.to_data() if self.raw is None else self.raw)

    @cached_property
    def places(self) -> dict[str, tuple[str, str]]:
        """``"link.point"`` -> link and point."""
        places: dict[str, tuple[str, str]] = {}
        for name, link in self.document.links.items():
            for point in link.points if link.has_valid("points") else ():
                places.setdefault(f"{name}.{point}", (name, point))
        return places

    @cached_property
    def links_with_point(self) -> dict[str, list[str]]:
        """Name of a point -> the links that have it."""
        owners: dict[str, list[str]] = {}
        for name, link in self.document.links.items():
            for point in link.points if link.has_valid("points") else ():
                owners.setdefault(point, []).append(name)
        return owners

    @cached_property
    def pinned(self) -> dict[str, list[Sequence[str]]]:
        """Name of a point -> the pairs of links whose points of this name are joined."""
        pinned: dict[str, list[Sequence[str]]] = {}
        for name, joint in self.document.joints.items():
            if joint.traits.coincide and len(set(points := points_of_joint(name, joint))) == 1:
                pinned.setdefault(points[0], []).append(joint.links)
        return pinned

    @cached_property
    def links_without_points(self) -> list[str]:
        """Links of which the points are not known."""
        return [name for name, link in self.document.links.items() if not link.has_valid("points")]

    @property
    def undriven(self) -> set[str]:
        """Joints of which it is not known whether they are driven."""
        return {name for name, joint in self.kindless_joints.items() if joint.driven or {"drive", "free"} & joint.invalid_keys}


def _ends(path: str) -> list[int]:
    """The indices at which a part of a path may end: names may contain dots."""
    return [*(k for k, letter in enumerate(path) if letter in ".["), len(path)]


def read_document(raw: Mapping[str, Any]) -> Reading:
    """Plain data (as TOML or JSON readers return it) -> what can be read of it, and every fault of form."""
    with suppress(ValidationError):
        if "parameters" not in raw:
            return Reading(SceneDocument.model_validate(dict(raw)), raw)
    resolved = resolve(raw)
    raw = resolved.data
    if not resolved.faults:
        with suppress(ValidationError):
            whole = SceneDocument.model_validate(raw)
            whole.keep_formulas(resolved.formulas)
            return Reading(whole, raw)
    faults: list[Fault] = []
    document = cast(SceneDocument, read_table(SceneDocument, raw, (), faults))
    document.keep_formulas(resolved.formulas)
    faults = [*resolved.faults, *(fault for fault in faults if fault.path not in resolved.unknown)]
    broken: dict[str, set[str]] = {section: set() for section in _SECTIONS}
    faulty = {fault.path[:end] for fault in faults for end in _ends(fault.path)}
    for section in _SECTIONS:
        items = raw.get(section, {})
        if not isinstance(items, Mapping):
            broken[section].add("*")
        else:
            broken[section] |= {name for name in items if f"{section}.{name}" in faulty}
    kindless_joints = {name: joint for name, joint in document.joints.items() if not joint.kinds}
    joints = {name: joint for name, joint in document.joints.items() if joint.kinds}
    known = document.model_copy(update={"joints": joints})
    known.mark_invalid(document.invalid_keys)
    return Reading(known, raw, faults, broken, kindless_joints)


# -- faults of form in words --------------------------------------------------------------------------------------------
# Synonyms from other programs and textbooks.
_SYNONYMS = {
    "bodies": "links", "ground": "frame", "omega": "speed", "velocity": "speed", "rpm": "speed", "motor": "drive",
    "driver": "drive", "com": "centre", "cog": "centre", "J": "inertia", "I": "inertia", "name": "title",
    "description": "learning_goal", "direction": "along", "axis": "along", "mode": "side", "forces": "loads", "steps": "frames",
    "point": "at", "link": "on", "traced": "trace", "nodes": "points", "base_circle": "base",
    "base_radius": "base", "tip": "point", "cam_profile": "profile", "z": "teeth", "r": "radius", "ring": "internal",
    "arm": "carrier", "size": "radius", "sizes": "teeth", "ratio": "teeth", "k": "stiffness", "rate": "stiffness",
    "rest_length": "free_length", "natural_length": "free_length", "length": "free_length", "coefficient": "linear",
    "c": "linear", "damping": "linear", "indicator": "diagram", "diameter": "bore", "function": "table", "otto": "four_stroke",
    "diesel": "four_stroke", "engine": "four_stroke", "compression_ratio": "ratio", "preloaded": "preload",
    "constraints": "joints", "connections": "joints",
    "opposite": "against", "mu": "coefficient", "rolling_resistance": "lever", "rho": "density", "material": "density",
    "diagrams": "polygons", "outputs": "metrics", "counterweight": "point_masses", "balance": "counterweights",
}  # fmt: skip
for _kinds in (JOINT_KINDS, LOADS):
    _SYNONYMS |= {word: keyword for keyword, kind in _kinds.items() for word in kind.synonyms}


_MISSPELT = 0.75
"""Similarity from which a key is a misspelt one even if the value does not fit."""


def spelling_candidates(key: str, known: Sequence[str]) -> list[str]:
    """The known keys that an unknown one may mean, the most probable first."""
    longer = [name for name in known if name.startswith(f"{key}_")]
    candidates = [_SYNONYMS.get(key, ""), *longer, *nearest(key, known, 5)]
    return [name for name in dict.fromkeys(candidates) if name in known]


def misspelt(key: str, known: str) -> bool:
    """Whether an unknown key is a known one but for a letter or two, whatever its value is."""
    return difflib.SequenceMatcher(a=key.casefold(), b=known.casefold()).ratio() >= _MISSPELT


def unknown_key(loc: Loc, known: Sequence[str], guess: str, inside: str = "") -> Fault:
    """The fault of a key that a table does not have; ``guess``: the key that is probably meant, ``inside``: the inner table that
    has it, if any."""
    remedy = f"Did you mean '{guess}'?" if guess else f"Known: {listing(known, most=20)}."
    remedy = f"Write it in {inside}." if inside else remedy
    return Fault(path_text(loc[:-1] or loc), f"unknown key '{loc[-1]}'.", remedy)


def missing_key(loc: Loc) -> Fault:
    """The fault of a key that a table must have and has not."""
    return Fault(path_text(loc[:-1]) or "scene", f"'{loc[-1]}' is missing.", f"Add {loc[-1]} = ...")


def words_of(detail: Any, loc: Loc) -> list[Fault]:
    """One of pydantic's errors about the value at a place -> faults in our words."""
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    if loc and loc[-1] == "[key]":
        loc = loc[:-1] if loc[-2] else loc[:-2]
    path = path_text(loc) or "scene"
    if kind == "scene":
        keys = value if isinstance(value, dict) else {}
        return [
            Fault(path_text((*loc, key)) if key in keys else path, message, remedy) for key, message, remedy in context["faults"]
        ]
    if kind == "literal_error":
        known = re.findall(r"'([^']*)'", context["expected"])
        near = closest(value, known) if isinstance(value, str) else ""
        remedy = f"Did you mean '{near}'?" if near else "Write one of these."
        numbers = context["expected"].replace(" or ", ", ")
        return [Fault(path, f"{describe(value)} is not one of {listing(known) if known else numbers}.", remedy)]
    if kind in ("too_long", "too_short"):
        return [_wrong_length(path, loc, value, context)]
    if kind == "greater_than_equal":
        return [Fault(path, f"{describe(value)} is too small.", f"Give at least {context['ge']}.")]
    if kind == "less_than_equal":
        return [Fault(path, f"{describe(value)} is too large.", f"Give at most {context['le']}.")]
    wanted, remedy = _WANTED.get(kind, ("something else", ""))
    return [Fault(path, f"{describe(value)} where {wanted} is wanted.", remedy)]


_LIST = ("a list", "Write it in brackets: [ ... ].")
_TABLE = ("a table", "Write it in braces, such as { key = ... }.")
_WHOLE = ("a whole number", "Write it like 360.")
_WANTED = {
    "list_type": _LIST,
    "dict_type": _TABLE,
    "model_type": _TABLE,
    "model_attributes_type": _TABLE,
    "string_unicode": ("a text that files can hold", "Write letters, digits or any other character; no lone surrogates."),
    "int_type": _WHOLE,
    "int_from_float": _WHOLE,
    "int_parsing_size": _WHOLE,
}


def _wrong_length(path: str, loc: Loc, value: object, context: Mapping[str, Any]) -> Fault:
    """A list or table with too few or too many entries."""
    n = len(value) if isinstance(value, list | dict) else context.get("actual_length", 0)
    if loc[-1] in JOINT_KINDS:
        what = f"names {n} link{'' if n == 1 else 's'}, a joint joins two."
        if n < 3 or loc[-1] != "revolute":
            return Fault(path, what, 'Write it like ["frame", "crank"].')
        remedy = f'A pin through {n} links is {n - 1} joints with at = "{loc[1]}": the first link with each of the others.'
        return Fault(path, what, remedy)
    what = f"has {n} entr{'y' if n == 1 else 'ies'}." if n else "is empty."
    least, most = context.get("min_length"), context.get("max_length")
    return Fault(path, what, f"Give at most {most}." if most is not None and n > most else f"Give at least {least}.")
