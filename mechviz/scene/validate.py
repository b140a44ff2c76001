"""From plain data to a scene document, with every fault in words.

Where parts of a scene are faulty, the rest is still read, so that cross-references can be checked in the same go.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from mechcore.errors import Fault

from .bodies import BossDocument, HoleDocument, LumpDocument, MassDocument
from .document import LinkDocument, LoadDocument, Pose, RunDocument, SceneDocument, UnitsDocument
from .factors import FactorPolynomial, FactorTable
from .faults import closest, listing
from .fields import describe
from .load_documents import CompressorDocument, DiagramDocument, FourStrokeDocument
from .motions import DriveDocument, DriveTable, OscillationDocument, SegmentDocument, ZonesDocument
from .pairs import KINDS, PairDocument
from .programs import ProgramDocument, ProgramSegment
from .studies import CounterweightsDocument, ShakingDocument, SubstituteDocument, SubstituteMassDocument, SystemDocument
from .tables import Table

__all__ = ["Reading", "read_document"]

Loc = tuple[int | str, ...]

_TABLES: Mapping[tuple[str, ...], type[Table]] = {
    (): SceneDocument,
    ("units",): UnitsDocument,
    ("run",): RunDocument,
    ("links", "*"): LinkDocument,
    ("pairs", "*"): PairDocument,
    ("pairs", "*", "drive"): DriveDocument,
    ("pairs", "*", "drive", "zones"): ZonesDocument,
    ("pairs", "*", "drive", "oscillation"): OscillationDocument,
    ("pairs", "*", "drive", "segments", "*"): SegmentDocument,
    ("pairs", "*", "drive", "table"): DriveTable,
    ("pairs", "*", "drive", "program"): ProgramDocument,
    ("pairs", "*", "drive", "program", "segments", "*"): ProgramSegment,
    ("sketch", "*"): Pose,
    ("loads", "*"): LoadDocument,
    ("loads", "*", "table"): FactorTable,
    ("loads", "*", "polynomial"): FactorPolynomial,
    ("loads", "*", "compressor"): CompressorDocument,
    ("loads", "*", "four_stroke"): FourStrokeDocument,
    ("loads", "*", "diagram"): DiagramDocument,
    ("links", "*", "mass"): MassDocument,
    ("links", "*", "mass", "holes", "*"): HoleDocument,
    ("links", "*", "mass", "bosses", "*"): BossDocument,
    ("links", "*", "lumps", "*"): LumpDocument,
    ("shaking",): ShakingDocument,
    ("shaking", "counterweights"): CounterweightsDocument,
    ("systems", "*"): SystemDocument,
    ("substitutes", "*"): SubstituteDocument,
    ("substitutes", "*", "masses", "*"): SubstituteMassDocument,
}
_SECTIONS = ("links", "pairs", "sketch", "loads", "systems", "substitutes")
_SEPARABLE = {  # faulty parts without which the rest of the item still means the same
    ("pairs", "drive"), ("pairs", "side"), ("pairs", "assembly"), ("pairs", "branch"), ("pairs", "along"),
    ("pairs", "guide"), ("pairs", "angle"), ("pairs", "pressure_angle"), ("pairs", "crossed"),
    ("loads", "table"), ("loads", "axes"), ("loads", "polynomial"), ("loads", "preload"), ("loads", "free_angle"),
    ("loads", "head"), ("loads", "back"), ("loads", "fires"), ("loads", "use"), ("links", "gravity"),
}  # fmt: skip
_STANDS_FOR: Mapping[tuple[str, str], Any] = {  # sound values in place of faulty ones, so that the rest can be checked
    ("links", "mass"): 1.0,
    ("links", "inertia"): 1.0,
    ("links", "centre"): [0.0, 0.0],
    ("pairs", "radius"): 1.0,
    ("loads", "force"): [1.0, 0.0],
    ("loads", "torque"): 1.0,
    ("loads", "stiffness"): 1.0,
    ("loads", "free_length"): 0.0,
    ("loads", "linear"): 1.0,
    ("loads", "quadratic"): 1.0,
    ("loads", "bore"): 1.0,
}

# What people call things elsewhere.
_SYNONYMS = {
    "joints": "pairs", "bodies": "links", "ground": "frame", "omega": "speed", "velocity": "speed", "rpm": "speed",
    "motor": "drive", "driver": "drive", "com": "centre", "cog": "centre", "J": "inertia", "I": "inertia",
    "name": "title", "description": "teaches", "direction": "along", "axis": "along", "mode": "side",
    "forces": "loads", "steps": "frames", "point": "at", "link": "on", "moment": "torque", "hinge": "revolute",
    "pin": "revolute", "traced": "trace", "nodes": "points", "gears": "gear", "belts": "belt", "pulleys": "belt",
    "sprockets": "chain", "pinion": "rack", "actuator": "cylinder", "piston": "cylinder", "slot": "pin_slot",
    "fixed": "weld", "rigid": "weld", "wheel": "rolling", "z": "teeth", "r": "radius", "planet": "gear",
    "ring": "internal", "arm": "carrier", "size": "radius", "sizes": "teeth", "ratio": "teeth",
    "k": "stiffness", "rate": "stiffness", "rest_length": "free_length", "natural_length": "free_length", "length": "free_length",
    "dashpot": "damper", "coefficient": "linear", "c": "linear", "damping": "linear", "pressure": "gas", "indicator": "diagram",
    "diameter": "bore", "function": "table", "otto": "four_stroke", "diesel": "four_stroke", "engine": "four_stroke",
    "compression_ratio": "ratio", "preloaded": "preload", "opposite": "against", "friction": "viscous", "air": "drag",
    "rho": "density", "material": "density", "diagrams": "plans", "polygons": "plans", "centrodes": "polodes",
    "counterweight": "lumps", "balance": "counterweights", "point_masses": "lumps",
}  # fmt: skip


@dataclass
class Reading:
    """What could be read of a scene. ``broken`` names the items of each section that could not be (or not wholly)."""

    document: SceneDocument
    raw: Mapping[str, Any]
    faults: list[Fault] = field(default_factory=list)
    broken: Mapping[str, set[str]] = field(default_factory=lambda: {section: set() for section in _SECTIONS})
    undriven: set[str] = field(default_factory=set)  # pairs whose drive could not be read
    invented: int = 0  # number of places that stand for faulty ones


def read_document(raw: Mapping[str, Any]) -> Reading:
    """Plain data (as TOML or JSON readers return it) -> what can be read of it, and every fault of form.

    A faulty part is taken out and the rest read again, until the rest is sound. What shows only then counts too, unless
    it may be a mere consequence of what was taken out.
    """
    data = copy.deepcopy(dict(raw))
    reading = Reading(SceneDocument(), raw)
    silent: set[tuple[str, str]] = set()
    first = True
    while True:
        try:
            reading.document = SceneDocument.model_validate(data)
            return reading
        except ValidationError as error:
            details = error.errors(include_url=False)
        for detail in details:
            loc = _loc(detail["loc"])
            if _item(loc) not in silent:
                reading.faults.extend(_faults(detail, loc))
        for detail in details:
            loc = _loc(detail["loc"])
            if _take_out(data, loc, detail["type"], reading, whole=not first):
                silent.add(_item(loc))
        first = False


def _loc(loc: Loc) -> Loc:
    """A place without the marks of the branches that unions took."""
    return tuple(part for part in loc if not (isinstance(part, str) and part.startswith("<") and part.endswith(">")))


def _item(loc: Loc) -> tuple[str, str]:
    """Section and name of the link, pair, load ... that a place is in; a top-level key has no name."""
    section = str(loc[0]) if loc else ""
    return (section, str(loc[1])) if section in _SECTIONS and len(loc) > 1 else (section, "")


def _take_out(data: dict[str, Any], loc: Loc, kind: str, reading: Reading, *, whole: bool) -> bool:
    """Remove the faulty part from the data; true if what is left of its item may seem faulty for that reason alone."""
    section, name = _item(loc)
    entries = data.get(section)
    if not name or not isinstance(entries, dict):
        data.pop(section, None)
        if section in _SECTIONS:
            reading.broken[section].add("*")
        return False
    if kind == "extra_forbidden" and not whole:
        table = _inside(data, loc[:-1])
        if isinstance(table, dict):
            table.pop(loc[-1], None)
        reading.broken[section].add(name)
        return bool(_meant(str(loc[-1]), _known_keys(loc[:-1])))
    entry, key = entries.get(name), str(loc[2]) if len(loc) > 2 else ""
    if not whole and isinstance(entry, dict):
        if (section, key) in _SEPARABLE:
            entry.pop(key, None)
            if key == "drive":
                reading.undriven.add(name)
            return False
        if (section, key) in _STANDS_FOR:
            entry[key] = _STANDS_FOR[section, key]
            return False
        if (section, key) == ("links", "points") and len(loc) > 3 and loc[-1] != "[key]":
            entry[key][loc[3]] = _somewhere(reading)
            return False
    if section == "sketch" and not whole:
        entries[name] = _somewhere(reading)
        return False
    entries.pop(name, None)
    reading.broken[section].add(name)
    return True


def _somewhere(reading: Reading) -> list[float]:
    """A place for a point whose own could not be read: no two of them at the same place."""
    reading.invented += 1
    return [1.0 + 0.1 * reading.invented, 0.7 * reading.invented]


def _inside(data: Any, loc: Iterable[int | str]) -> Any:
    """The value at a place of the data, or None."""
    for part in loc:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _known_keys(loc: Loc) -> list[str]:
    """The keys of the table at a place of the document."""
    for pattern, table in _TABLES.items():
        if len(pattern) == len(loc) and all(p in ("*", part) for p, part in zip(pattern, loc, strict=True)):
            return list(table.model_fields)
    return []


def _meant(key: str, known: list[str]) -> str:
    """The known key that an unknown one probably stands for, or an empty text."""
    synonym = _SYNONYMS.get(key, "")
    return synonym if synonym in known else closest(key, known)


def path_text(loc: Iterable[int | str]) -> str:
    """A place as it is written in faults: ``links.crank.points.B[0]``."""
    text = ""
    for part in loc:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def _faults(detail: Any, loc: Loc) -> list[Fault]:
    """One of pydantic's errors -> faults in our words."""
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    if loc and loc[-1] == "[key]":
        loc = loc[:-1] if loc[-2] else loc[:-2]
    path, parent = path_text(loc) or "scene", path_text(loc[:-1]) or "scene"
    if kind == "scene":
        keys = value if isinstance(value, dict) else {}
        return [
            Fault(path_text((*loc, key)) if key in keys else path, message, remedy) for key, message, remedy in context["faults"]
        ]
    if kind == "extra_forbidden":
        known = _known_keys(loc[:-1])
        meant = _meant(str(loc[-1]), known)
        remedy = f"Did you mean '{meant}'?" if meant else f"Known: {listing(known, most=20)}."
        return [Fault(parent if len(loc) > 1 else path, f"unknown key '{loc[-1]}'.", remedy)]
    if kind == "missing":
        return [Fault(parent, f"'{loc[-1]}' is missing.", f"Add {loc[-1]} = ...")]
    if kind == "literal_error":
        known = re.findall(r"'([^']*)'", context["expected"])
        near = closest(value, known) if isinstance(value, str) else ""
        remedy = f"Did you mean '{near}'?" if near else "Write one of these."
        return [Fault(path, f"{describe(value)} is not one of {listing(known)}.", remedy)]
    if kind in ("too_long", "too_short"):
        return [_wrong_length(path, loc, value, context)]
    if kind == "greater_than_equal":
        return [Fault(path, f"{describe(value)} is too small.", f"Give at least {context['ge']}.")]
    if kind == "less_than_equal":
        return [Fault(path, f"{describe(value)} is too large.", f"Give at most {context['le']}.")]
    wanted, remedy = _WANTED.get(kind, ("something else", ""))
    return [Fault(path, f"{describe(value)} where {wanted} is wanted.", remedy)]


_LIST = ("a list", "Write it in brackets: [ ... ].")
_TABLE = ("a table", "Write it in braces: { key = value, ... }.")
_WHOLE = ("a whole number", "Write it like 360.")
_WANTED = {
    "list_type": _LIST,
    "dict_type": _TABLE,
    "model_type": _TABLE,
    "model_attributes_type": _TABLE,
    "int_type": _WHOLE,
    "int_from_float": _WHOLE,
    "int_parsing_size": _WHOLE,
}


def _wrong_length(path: str, loc: Loc, value: Any, context: Mapping[str, Any]) -> Fault:
    """A list or table with too few or too many entries."""
    n = len(value) if isinstance(value, list | dict) else context.get("actual_length", 0)
    if loc[-1] in KINDS:
        found = f"names {n} link{'' if n == 1 else 's'}, a pair joins two."
        if n < 3 or loc[-1] != "revolute":
            return Fault(path, found, 'Write it like ["frame", "crank"].')
        remedy = f'A pin through {n} links is {n - 1} pairs with at = "{loc[1]}": the first link with each of the others.'
        return Fault(path, found, remedy)
    found = f"has {n} entr{'y' if n == 1 else 'ies'}." if n else "is empty."
    least, most = context.get("min_length"), context.get("max_length")
    return Fault(path, found, f"Give at most {most}." if most is not None and n > most else f"Give at least {least}.")
