"""Measured ladders kept by scene, version and machine, so that looking again costs nothing."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .ladder import Point
from .timing import machine

if TYPE_CHECKING:
    from ..scene import Scene

__all__ = ["Measured", "keep", "kept"]


@dataclass(frozen=True)
class Measured:
    """A ladder with what it belongs to."""

    scene: str
    machine: str
    day: str
    points: tuple[Point, ...]


def _folder() -> Path:
    base = os.environ.get("MECHVIZ_CACHE") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "mechviz" / "accuracy"


def _file(scene: Scene, target: float | None) -> Path:
    from ..record.describe import package_version

    text = json.dumps([scene.to_toml(), package_version(), machine(), target, _code()])
    return _folder() / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}.json"


def _code() -> float:
    """When the program was last changed: a ladder of another state of it is not this one's."""
    import mechcore
    import mechviz

    roots = [Path(p.__file__ or ".").parent for p in (mechcore, mechviz)]
    return max(f.stat().st_mtime for root in roots for f in root.rglob("*.py"))


def kept(scene: Scene, target: float | None) -> Measured | None:
    """The ladder of this scene on this machine, if it was measured before."""
    try:
        data: dict[str, Any] = json.loads(_file(scene, target).read_text(encoding="utf-8"))
        points = tuple(Point(**p) for p in data["points"])
        return Measured(data["scene"], data["machine"], data["day"], points)
    except (OSError, ValueError, KeyError, TypeError):  # not there, or of another form
        return None


def keep(scene: Scene, target: float | None, points: list[Point]) -> Measured:
    """Keep a ladder; where the folder cannot be written nothing is kept."""
    found = Measured(scene.name, machine(), date.today().isoformat(), tuple(points))
    data = {"scene": found.scene, "machine": found.machine, "day": found.day, "points": [p.as_dict() for p in points]}
    try:
        path = _file(scene, target)
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(".part")
        temporary.write_text(json.dumps(data, indent=1).replace("Infinity", "1e999"), encoding="utf-8")
        temporary.replace(path)
    except OSError:
        pass  # it is measured again next time
    return found
