"""Measured ladders kept by scene, version and machine, so that looking again costs nothing."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mechcore
from mechviz.runs import package_version
from mechviz.studies.precision.ladder import Point
from mechviz.studies.precision.timing import machine

if TYPE_CHECKING:
    from mechviz.scene.scene import Scene


SHARED = 0.8  # below this share others have used the processor too


@dataclass(frozen=True)
class Measured:
    """A ladder with what it belongs to.

    ``rough``: with few repeats; ``share``: of the time that passed the program had the processor for so much (0 to 1).
    """

    scene: str
    machine: str
    day: str
    points: tuple[Point, ...]
    rough: bool = False
    share: float = 1.0

    @property
    def foot(self) -> str:
        """When, where and how it was measured, in a line."""
        words = f"measured {self.day} on {self.machine}; one thread, medians"
        words += " of few repeats" if self.rough else ""
        if self.share < SHARED:
            words += f"; rough: others had {100.0 * (1.0 - self.share):.0f} % of the time on this processor"
        return words


def _folder() -> Path:
    base = os.environ.get("MECHVIZ_CACHE") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "mechviz" / "accuracy"


def _file(scene: Scene, target: float | None) -> Path:
    files = {name: hashlib.sha256(data).hexdigest() for name, data in scene.files.items()}
    text = json.dumps([scene.to_toml(), files, package_version(), machine(), target, _code()])
    return _folder() / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}.json"


def _code() -> float:
    """When the program was last changed: a ladder of another state of it is not this one's."""
    roots = [Path(mechcore.__file__).parent, Path(__file__).parents[2]]
    return max(f.stat().st_mtime for root in roots for f in root.rglob("*.py"))


def kept(scene: Scene, target: float | None, rough: bool = True) -> Measured | None:
    """The ladder of this scene on this machine, if it was measured before; ``rough``: one with few repeats will do."""
    try:
        data: dict[str, Any] = json.loads(_file(scene, target).read_text(encoding="utf-8"))
        points = tuple(Point(**p) for p in data["points"])
        found = Measured(data["scene"], data["machine"], data["day"], points, data["rough"], data["share"])
    except (OSError, ValueError, KeyError, TypeError):  # not there, or of another form
        return None
    return found if rough or not found.rough else None


def keep(scene: Scene, target: float | None, points: list[Point], rough: bool = False, share: float = 1.0) -> Measured:
    """Keep a ladder; where the folder cannot be written nothing is kept."""
    found = Measured(scene.name, machine(), date.today().isoformat(), tuple(points), rough, share)
    data = {**asdict(found), "points": [p.as_dict() for p in points]}
    try:
        path = _file(scene, target)
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(".part")
        temporary.write_text(json.dumps(data, indent=1).replace("Infinity", "1e999"), encoding="utf-8")
        temporary.replace(path)
    except OSError:
        pass  # it is measured again next time
    return found
