"""Faults of form in words: keys that a table does not have or lacks, and pydantic's errors about values."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Any

from mechcore.errors import Fault
from mechviz.scene.faults import closest, listing, nearest, path_text
from mechviz.scene.fields import describe
from mechviz.scene.kinds.joints.document import KINDS
from mechviz.scene.kinds.loads.document import KINDS as LOADS

Loc = tuple[int | str, ...]

# What people call things elsewhere.
_SYNONYMS = {
    "bodies": "links", "ground": "frame", "omega": "speed", "velocity": "speed", "rpm": "speed", "motor": "drive",
    "driver": "drive", "com": "centre", "cog": "centre", "J": "inertia", "I": "inertia", "name": "title",
    "description": "teaches", "direction": "along", "axis": "along", "mode": "side", "forces": "loads", "steps": "frames",
    "point": "at", "link": "on", "traced": "trace", "nodes": "points", "base_circle": "base",
    "base_radius": "base", "tip": "point", "cam_profile": "profile", "z": "teeth", "r": "radius", "ring": "internal",
    "arm": "carrier", "size": "radius", "sizes": "teeth", "ratio": "teeth", "k": "stiffness", "rate": "stiffness",
    "rest_length": "free_length", "natural_length": "free_length", "length": "free_length", "coefficient": "linear",
    "c": "linear", "damping": "linear", "indicator": "diagram", "diameter": "bore", "function": "table", "otto": "four_stroke",
    "diesel": "four_stroke", "engine": "four_stroke", "compression_ratio": "ratio", "preloaded": "preload",
    "opposite": "against", "mu": "coefficient", "rolling_resistance": "lever", "rho": "density", "material": "density",
    "diagrams": "plans", "polygons": "plans", "centrodes": "polodes", "counterweight": "lumps", "balance": "counterweights",
    "point_masses": "lumps",
}  # fmt: skip
for _kinds in (KINDS, LOADS):
    _SYNONYMS |= {word: keyword for keyword, kind in _kinds.items() for word in kind.synonyms}


_MISSPELT = 0.75
"""Similarity from which a key is a misspelt one even if the value does not fit."""


def meant_keys(key: str, known: Sequence[str]) -> list[str]:
    """The known keys that an unknown one may stand for, the most probable first."""
    longer = [name for name in known if name.startswith(f"{key}_")]
    found = [_SYNONYMS.get(key, ""), *longer, *nearest(key, known, 5)]
    return [name for name in dict.fromkeys(found) if name in known]


def misspelt(key: str, meant: str) -> bool:
    """Whether an unknown key is a known one but for a letter or two, whatever its value is."""
    return difflib.SequenceMatcher(a=key.casefold(), b=meant.casefold()).ratio() >= _MISSPELT


def unknown_key(loc: Loc, known: Sequence[str], meant: str) -> Fault:
    """The fault of a key that a table does not have; ``meant``: the one that it probably stands for, if any."""
    remedy = f"Did you mean '{meant}'?" if meant else f"Known: {listing(known, most=20)}."
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
_TABLE = ("a table", "Write it in braces: { key = value, ... }.")
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


def _wrong_length(path: str, loc: Loc, value: Any, context: Mapping[str, Any]) -> Fault:
    """A list or table with too few or too many entries."""
    n = len(value) if isinstance(value, list | dict) else context.get("actual_length", 0)
    if loc[-1] in KINDS:
        found = f"names {n} link{'' if n == 1 else 's'}, a joint joins two."
        if n < 3 or loc[-1] != "revolute":
            return Fault(path, found, 'Write it like ["frame", "crank"].')
        remedy = f'A pin through {n} links is {n - 1} joints with at = "{loc[1]}": the first link with each of the others.'
        return Fault(path, found, remedy)
    found = f"has {n} entr{'y' if n == 1 else 'ies'}." if n else "is empty."
    least, most = context.get("min_length"), context.get("max_length")
    return Fault(path, found, f"Give at most {most}." if most is not None and n > most else f"Give at least {least}.")
