"""The folder of a scene: where the files that it names are found, and their contents when they were read."""

from __future__ import annotations

import errno
import tomllib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from mechviz.files import OutputError, check_target, read_regular, replacing

LARGEST_FILE = 200_000_000
"""Largest file that a scene names [bytes]."""


def _working_folder() -> Path:
    with suppress(OSError):  # it may be gone
        return Path.cwd()
    return Path()


@dataclass(frozen=True, eq=False)
class SceneFolder:
    """The folder at which the paths of files in a scene start, and the files that were read so far.

    Scenes derived from one scene share it. A file is read once: whatever is made of the scene later (other values or frames, a
    recording) uses the same bytes. A recording contains the files of its scene. ``foreign``: the author of the scene is unknown, so
    that it may name no files outside of the folder.
    """

    path: Path = field(default_factory=_working_folder)
    contents: dict[str, bytes] = field(default_factory=dict, repr=False)  # by the names in the scene
    foreign: bool = False

    @classmethod
    def of(cls, given: SceneFolder | Path | str | None) -> SceneFolder:
        """A folder, from its path; without one the working folder."""
        if isinstance(given, SceneFolder):
            return given
        return cls() if given is None else cls(_working_folder() / given)

    def read(self, name: str) -> bytes:
        """The content of a file by its name in the scene. Raises `OSError`, or `ValueError` where that is no path."""
        if name not in self.contents:
            place = self.path / name
            if self.foreign and not place.resolve().is_relative_to(self.path.resolve()):
                why = "it is outside of that folder, where the scene of a recording may not look"
                raise PermissionError(errno.EACCES, why, name)
            self.contents[name] = read_regular(place, LARGEST_FILE)
        return self.contents[name]


def copy_files(files: Mapping[str, bytes], folder: Path) -> list[Path]:
    """Write the files that a scene names to where a scene in ``folder`` finds them; returns the paths that were written.

    Raises `OutputError`, before anything is written, where a different file is at such a path, or the path is not below the folder.
    """
    missing: dict[Path, bytes] = {}
    for name, data in files.items():
        place = folder / name
        differs = OutputError(
            f"'{place}' is another file than the '{name}' that the scene has read; it may have changed since.",
            "Save the scene into another folder.",
        )
        try:
            if read_regular(place, len(data)) == data:
                continue
            raise differs
        except FileNotFoundError:
            pass
        except OSError as error:
            if error.errno == errno.EFBIG:
                raise differs from None
            raise OutputError(f"'{place}' cannot be read: {(error.strerror or str(error)).lower()}.", "Save elsewhere.") from None
        if not place.resolve().is_relative_to(folder.resolve()):
            why = f"the scene names '{name}', which from there is '{place}' and does not exist."
            raise OutputError(f"A scene in '{folder}' would not find its files: {why}", "Copy that file to its place first.")
        missing[place] = data
    for place in missing:
        with suppress(OSError):
            place.parent.mkdir(parents=True, exist_ok=True)
        check_target(place)
    for place, data in missing.items():
        with replacing(place) as temporary:
            temporary.write_bytes(data)
    return list(missing)


TOPICS = (
    "Linkages and their motion",
    "Gears, belts and rolling",
    "Cams",
    "Forces that a motion needs",
    "Reduction and balancing",
    "Dry friction",
    "Motion under forces",
)
"""Topics of the gallery in the order of a course."""

GALLERY_FOLDER = Path(__file__).resolve().parent.parent / "gallery"


@dataclass(frozen=True)
class GalleryEntry:
    """One scene of the gallery; its topic is one of `TOPICS`."""

    name: str
    title: str
    learning_goal: str
    topic: str
    path: Path

    def about(self, words: Iterable[str]) -> bool:
        """Whether every word occurs in its name, title, learning goal or topic, regardless of case."""
        text = f"{self.name} {self.title} {self.learning_goal} {self.topic}".casefold()
        return all(word.casefold() in text for word in words)


def gallery_names() -> list[str]:
    """Names of all scenes of the gallery, in order, without reading them."""
    return sorted(path.stem for path in GALLERY_FOLDER.glob("*.toml"))


def _topic(data: Mapping[str, Any]) -> str:
    """The topic of a scene's data, from the first of these that it contains: free coordinates, cams, friction, reduction or
    balancing, gears and belts, loads or effects; else linkages."""
    keys = {key for joint in data.get("joints", {}).values() for key in joint}
    linkages, gears, cams, forces, reduction, friction, motion = TOPICS
    if "free" in keys:
        return motion
    if "cam" in keys:
        return cams
    if "friction" in keys or "friction" in data:
        return friction
    if data.keys() & {"systems", "substitutes", "reduced", "shaking", "sections"} or (not data["joints"] and "effects" in data):
        return reduction
    if keys & {"gear", "belt", "rack", "rolling"}:
        return gears
    return forces if data.get("loads") or data.get("effects") else linkages


@cache
def _entries() -> tuple[GalleryEntry, ...]:
    entries = []
    for name in gallery_names():
        path = GALLERY_FOLDER / f"{name}.toml"
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        entries.append(GalleryEntry(name, data["title"], data["learning_goal"], _topic(data), path))
    return tuple(entries)


def gallery() -> list[GalleryEntry]:
    """All scenes of the gallery with title and learning goal, in order of their names."""
    return list(_entries())
