"""From plain data to a scene document, with every fault in words.

Where parts of a scene are faulty, everything else is still read, down to single values, so that all checks can be made on
it in the same go.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, cast

from pydantic import ValidationError

from mechcore.errors import Fault

from .document import SceneDocument
from .lenient import read_table
from .pairs import PairDocument

__all__ = ["Reading", "read_document"]

_SECTIONS = ("links", "pairs", "sketch", "loads", "watch", "systems", "substitutes")


@dataclass
class Reading:
    """What could be read of a scene, with stand-ins for what could not (see ``lenient``).

    ``broken`` names the items of each section that are not wholly known, "*" where the section itself is not;
    ``shapeless`` holds the pairs of which not even the kind is known, which the document leaves out.
    """

    document: SceneDocument
    raw: Mapping[str, Any]
    faults: list[Fault] = field(default_factory=list)
    broken: Mapping[str, set[str]] = field(default_factory=lambda: {section: set() for section in _SECTIONS})
    shapeless: dict[str, PairDocument] = field(default_factory=dict)

    @cached_property
    def owners(self) -> dict[str, list[str]]:
        """Name of a point -> the links that have it."""
        found: dict[str, list[str]] = {}
        for name, link in self.document.links.items():
            for point in link.points if link.sound("points") else ():
                found.setdefault(point, []).append(name)
        return found

    @cached_property
    def pointless(self) -> list[str]:
        """Links of which the points are not known."""
        return [name for name, link in self.document.links.items() if not link.sound("points")]

    @property
    def undriven(self) -> set[str]:
        """Pairs of which it is not known whether they are driven."""
        return {name for name, pair in self.shapeless.items() if pair.led or {"drive", "free"} & pair.unread}


def _ends(path: str) -> list[int]:
    """Where the parts of a path end: names may hold dots themselves."""
    return [*(k for k, letter in enumerate(path) if letter in ".["), len(path)]


def read_document(raw: Mapping[str, Any]) -> Reading:
    """Plain data (as TOML or JSON readers return it) -> what can be read of it, and every fault of form."""
    try:
        return Reading(SceneDocument.model_validate(dict(raw)), raw)
    except ValidationError:
        pass
    faults: list[Fault] = []
    document = cast(SceneDocument, read_table(SceneDocument, raw, (), faults))
    broken: dict[str, set[str]] = {section: set() for section in _SECTIONS}
    faulty = {fault.path[:end] for fault in faults for end in _ends(fault.path)}
    for section in _SECTIONS:
        items = raw.get(section, {})
        if not isinstance(items, Mapping):
            broken[section].add("*")
        else:
            broken[section] |= {name for name in items if f"{section}.{name}" in faulty}
    shapeless = {name: pair for name, pair in document.pairs.items() if not pair.kinds}
    pairs = {name: pair for name, pair in document.pairs.items() if pair.kinds}
    known = document.model_copy(update={"pairs": pairs})
    known.mark_unread(document.unread)
    return Reading(known, raw, faults, broken, shapeless)
