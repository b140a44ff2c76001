"""From plain data to a scene document, with every fault in words.

Where parts of a scene are faulty, the rest is still read, so that cross-references can be checked in the same go.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from mechcore.errors import Fault

from .document import LinkDocument, LoadDocument, PairDocument, Pose, RunDocument, SceneDocument, UnitsDocument
from .faults import closest, did_you_mean, listing
from .fields import describe
from .motions import DriveDocument, DriveTable, FactorTable, OscillationDocument, SegmentDocument, ZonesDocument
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
    ("sketch", "*"): Pose,
    ("loads", "*"): LoadDocument,
    ("loads", "*", "table"): FactorTable,
}
_SECTIONS = ("links", "pairs", "sketch", "loads")
_SEPARABLE = {
    ("pairs", "drive"),
    ("loads", "table"),
}  # faulty parts without which the rest of the item still means the same

# What people call things elsewhere.
_SYNONYMS = {
    "joints": "pairs", "bodies": "links", "ground": "frame", "omega": "speed", "velocity": "speed", "rpm": "speed", "motor": "drive",
    "driver": "drive", "com": "centre", "cog": "centre", "J": "inertia", "I": "inertia", "name": "title", "description": "teaches",
    "direction": "along", "axis": "along", "mode": "side", "forces": "loads", "steps": "frames", "point": "at", "link": "on", "moment": "torque",
    "hinge": "revolute", "pin": "revolute", "slider": "prismatic", "traced": "trace", "nodes": "points",
}  # fmt: skip


@dataclass
class Reading:
    """What could be read of a scene. ``broken`` names the items of each section that could not be (or not wholly)."""

    document: SceneDocument
    raw: Mapping[str, Any]
    faults: list[Fault] = field(default_factory=list)
    broken: Mapping[str, set[str]] = field(default_factory=lambda: {section: set() for section in _SECTIONS})
    undriven: set[str] = field(default_factory=set)  # pairs whose drive could not be read


def read_document(raw: Mapping[str, Any]) -> Reading:
    """Plain data (as TOML or JSON readers return it) -> what can be read of it, and every fault of form."""
    data = copy.deepcopy(dict(raw))
    reading = Reading(SceneDocument(), raw)
    first = True
    silent: set[tuple[str, str]] = set()  # items whose further faults would be mere consequences
    while True:
        try:
            reading.document = SceneDocument.model_validate(data)
            return reading
        except ValidationError as error:
            details = error.errors(include_url=False)
        for detail in details:
            loc = tuple(
                part
                for part in detail["loc"]
                if not (isinstance(part, str) and part.startswith("<") and part.endswith(">"))
            )
            item = (str(loc[0]), str(loc[1])) if len(loc) > 1 else (str(loc[0]) if loc else "", "")
            if first or item not in silent:
                reading.faults.extend(_faults(detail, loc, data))
        for detail in details:
            loc = tuple(
                part
                for part in detail["loc"]
                if not (isinstance(part, str) and part.startswith("<") and part.endswith(">"))
            )
            silent |= _prune(data, loc, detail["type"], reading, whole=not first)
        first = False


def _prune(data: dict[str, Any], loc: Loc, kind: str, reading: Reading, *, whole: bool) -> set[tuple[str, str]]:
    """Take the faulty part out of the data; returns the item if what is left of it may be faulty for that reason alone."""
    section, name = str(loc[0]) if loc else "", str(loc[1]) if len(loc) > 1 else ""
    if section not in _SECTIONS or not name or not isinstance(data.get(section), dict):
        data.pop(section, None)
        if section in _SECTIONS:
            reading.broken[section].add("*")
        return set()
    entries = data[section]
    if kind == "extra_forbidden" and not whole:
        table = _inside(data, loc[:-1])
        known = _known_keys(loc[:-1])
        if isinstance(table, dict):
            table.pop(loc[-1], None)
        reading.broken[section].add(name)
        return {(section, name)} if _meant(str(loc[-1]), known) else set()
    if len(loc) > 2 and (section, str(loc[2])) in _SEPARABLE and not whole and isinstance(entries.get(name), dict):
        entries[name].pop(loc[2], None)
        if section == "pairs":
            reading.undriven.add(name)
        return set()
    entries.pop(name, None)
    reading.broken[section].add(name)
    return {(section, name)}


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


def _faults(detail: Any, loc: Loc, data: Mapping[str, Any]) -> list[Fault]:
    """One of pydantic's errors -> faults in our words."""
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    if loc and loc[-1] == "[key]":
        loc = loc[:-2]  # the message names the key
    if kind == "scene":
        return [
            Fault(
                path_text((*loc, key) if key and key in (value if isinstance(value, dict) else {}) else loc) or "scene",
                message,
                remedy,
            )
            for key, message, remedy in context["faults"]
        ]
    path = path_text(loc) or "scene"
    parent = path_text(loc[:-1]) or "scene"
    if kind == "extra_forbidden":
        key, known = str(loc[-1]), _known_keys(loc[:-1])
        meant = _meant(key, known)
        remedy = f"Did you mean '{meant}'?" if meant else f"Known: {listing(known, most=20)}."
        return [Fault(parent, f"unknown key '{key}'.", remedy)]
    if kind == "missing":
        return [Fault(parent, f"'{loc[-1]}' is missing.", f"Add {loc[-1]} = ...")]
    if kind == "literal_error":
        known = [choice.strip("'\"") for choice in context["expected"].replace(" or ", ", ").split(", ")]
        remedy = (
            did_you_mean(value, known) if isinstance(value, str) else f"Write {' or '.join(repr(k) for k in known)}."
        )
        return [Fault(path, f"{describe(value)} is not one of {listing(known)}.", remedy)]
    if kind in ("too_long", "too_short"):
        return [_wrong_length(path, loc, value, context)]
    if kind in ("greater_than_equal", "less_than_equal"):
        least = context.get("ge")
        bound = f"less than {least}" if least is not None else f"more than {context.get('le')}"
        return [
            Fault(
                path,
                f"{describe(value)} is {bound}.",
                f"Give a whole number {'from ' + str(least) if least is not None else 'up to ' + str(context.get('le'))}.",
            )
        ]
    wanted = {
        "list_type": "a list",
        "dict_type": "a table",
        "model_type": "a table",
        "model_attributes_type": "a table",
        "int_type": "a whole number",
        "int_from_float": "a whole number",
    }.get(kind)
    if wanted:
        remedy = {
            "a list": "Write it in brackets: [ ... ].",
            "a table": "Write it in braces: { key = value, ... }.",
        }.get(wanted, "")
        return [Fault(path, f"{describe(value)} where {wanted} is wanted.", remedy)]
    return [Fault(path, f"{describe(value)} is not allowed here.", "")]


def _wrong_length(path: str, loc: Loc, value: Any, context: Mapping[str, Any]) -> Fault:
    """A list or table with too few or too many entries."""
    n = len(value) if isinstance(value, list | dict) else context.get("actual_length", 0)
    entries = f"{n} entr{'y' if n == 1 else 'ies'}" if n else "no entries"
    if loc[-1] in ("revolute", "prismatic"):
        if n > 2:
            name = loc[1] if len(loc) > 1 else "P"
            remedy = f'A pin through {n} links is {n - 1} pairs, each with at = "{name}": join the first link to each of the others.'
            return Fault(path, f"names {n} links, a pair joins two.", remedy)
        return Fault(
            path, f"names {n} link{'' if n == 1 else 's'}, a pair joins two.", 'Write it like ["frame", "crank"].'
        )
    least, most = context.get("min_length"), context.get("max_length")
    if least is not None and most is None:
        return Fault(path, f"has {entries}.", f"Give at least {least}." if least > 1 else "Give at least one.")
    return Fault(path, f"has {entries}, at most {most} are allowed.", f"Leave out {n - int(most or 0)}.")
