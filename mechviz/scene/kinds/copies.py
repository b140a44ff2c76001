"""Copies of links with their joints and loads, rotated about their shaft by a phase and offset along it."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Annotated, Any

from pydantic import Field, ValidationError

from mechviz.scene.fields import Angle, DocumentTable, Length
from mechviz.scene.names import LinkName
from mechviz.scene.units import UNIT_KINDS, QuantityError, Units

_POINTS = ("at", "point", "along", "centre", "side", "law")
"""Keys whose texts are points or words, even where a link or joint has the same name."""


class CopyDocument(DocumentTable):
    """Copies of links, with the joints and loads that refer to them."""

    of: Annotated[list[LinkName], Field(min_length=1)]
    """The links that are copied. A copy of the link "rod" is called "rod 2", the next one "rod 3"; so are joints and loads."""
    count: Annotated[int, Field(strict=True, ge=1, le=200)] = 1
    """Number of copies beside the original."""
    phase: Angle = 0.0
    """Phase lead of each copy over the one before: cams that are not copied get it as their phase, copied cranks are welded to the
    first one at this angle."""
    offset: Length = 0.0
    """Distance of each copy from the one before along the shaft, towards the viewer."""


def with_copies(raw: Mapping[str, Any], known: Mapping[str, Any]) -> dict[str, Any]:
    """Plain data of a scene with all its copies written out; unchanged where that cannot be done, so that the document reports the
    reason.

    ``known``: the same data with values for expressions, from which phases and offsets are taken.
    """
    given = known.get("copies")
    sections = [raw.get(key) for key in ("links", "joints")]
    if not isinstance(given, list) or not all(isinstance(s, Mapping) for s in sections):
        return dict(raw)
    try:
        copies = [CopyDocument.model_validate(entry) for entry in given]
        units = Units(**raw.get("units", {}))
    except (ValidationError, TypeError, QuantityError):
        return dict(raw)
    if any(name not in raw["links"] or not isinstance(raw["links"][name], Mapping) for entry in copies for name in entry.of):
        return dict(raw)
    completed: dict[str, Any] = deepcopy({key: value for key, value in raw.items() if key != "copies"})
    for entry in copies:
        before = deepcopy(completed)
        for number in range(1, entry.count + 1):
            _Copy(before, completed, entry, number, units).made()
    return completed


class _Copy:
    """One copy of some links of a scene ``before`` in plain data, which ``made`` adds to ``completed``."""

    def __init__(self, before: dict[str, Any], completed: dict[str, Any], entry: CopyDocument, number: int, units: Units):
        self.before, self.completed, self.entry, self.number, self.units = before, completed, entry, number, units
        joints = {name: joint for name, joint in before["joints"].items() if isinstance(joint, Mapping)}
        self.joints = {name: joint for name, joint in joints.items() if any(link in entry.of for link in _links(joint))}
        self.names = {name: f"{name} {number + 1}" for name in (*entry.of, *self.joints)}

    def made(self) -> None:
        for name in self.entry.of:
            link = dict(self.before["links"][name])
            if self.entry.offset:
                link["plane"] = self._sum(link.get("plane", 0.0), self.entry.offset, "length")
            self.completed["links"][self.names[name]] = link
        for name, joint in self.joints.items():
            self.completed["joints"][self.names[name]] = self._joint(name, joint)
        for section in ("loads", "pens"):
            for name, item in self.before.get(section, {}).items():
                new = self._renamed(item)
                if new != item:
                    self.completed[section][f"{name} {self.number + 1}"] = new

    def _joint(self, name: str, joint: Mapping[str, Any]) -> dict[str, Any]:
        links = _links(joint)
        new: dict[str, Any] = self._renamed(joint)
        placed = not {"cam", "gear", "belt", "chain", "rack", "planar"} & joint.keys()
        if placed and "at" not in joint:
            new["at"] = name  # the points keep their names
        if "drive" in joint and "program" not in joint["drive"]:
            moved = next(link for link in links if link in self.entry.of)
            at = joint.get("at", name)
            point = at if isinstance(at, str) else at[links.index(moved)]
            return {"weld": [moved, self.names[moved]], "at": point, "angle": self._sum(0.0, self.entry.phase, "angle")}
        if "cam" in joint and links[0] not in self.entry.of:
            profile = dict(new.get("profile", {}))
            new["profile"] = {**profile, "phase": self._sum(profile.get("phase", 0.0), self.entry.phase, "angle")}
        if "drive" in joint:
            program = dict(new["drive"]["program"])
            if "knots" not in program:
                program["phase"] = self._sum(program.get("phase", 0.0), self.entry.phase, "angle")
            new["drive"] = {**new["drive"], "program": program}
        return new

    def _renamed(self, value: object) -> Any:
        """A value in which the names of copied parts, and of their points, are replaced by those of the copy."""
        if isinstance(value, str):
            if value in self.names:
                return self.names[value]
            link, dot, point = value.rpartition(".")
            return f"{self.names[link]}.{point}" if dot and link in self.entry.of else value
        if isinstance(value, Mapping):
            return {key: item if key in _POINTS and _plain(item) else self._renamed(item) for key, item in value.items()}
        return [self._renamed(item) for item in value] if isinstance(value, list) else value

    def _sum(self, value: Any, step: Any, kind: str) -> Any:
        """A value of the scene plus ``number`` times a step, as a text with its unit; for expressions an expression."""
        try:
            total = self.units.si(value, kind) + self.number * self.units.si(step, kind)
        except QuantityError:  # of expressions
            with_unit = [v if isinstance(v, str) else f"{v!r} {getattr(self.units, kind)}" for v in (value, step)]
            return f"({with_unit[0]}) + {self.number}*({with_unit[1]})"
        return f"{total!r} {UNIT_KINDS[kind].si}"


def _plain(value: object) -> bool:
    """Whether it names points without their links."""
    return not isinstance(value, str) or "." not in value


def _links(joint: Mapping[str, Any]) -> list[str]:
    """The two links of a joint in plain data."""
    pairs = (value for key, value in joint.items() if key != "at" and isinstance(value, list) and len(value) == 2)
    return next(([a, b] for a, b in pairs if isinstance(a, str) and isinstance(b, str)), [])
