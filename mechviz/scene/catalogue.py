"""The gallery of scenes that come with mechviz. Light: nothing here loads the machinery that reads scenes."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

__all__ = ["GALLERY_FOLDER", "GalleryEntry", "gallery", "gallery_names"]

GALLERY_FOLDER = Path(__file__).resolve().parent.parent / "gallery"


@dataclass(frozen=True)
class GalleryEntry:
    """One scene of the gallery."""

    name: str
    title: str
    teaches: str
    path: Path


def gallery_names() -> list[str]:
    """Names of all scenes of the gallery, in order, without reading them."""
    return sorted(path.stem for path in GALLERY_FOLDER.glob("*.toml"))


@cache
def _entries() -> tuple[GalleryEntry, ...]:
    entries = []
    for name in gallery_names():
        path = GALLERY_FOLDER / f"{name}.toml"
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        entries.append(GalleryEntry(name, data["title"], data["teaches"], path))
    return tuple(entries)


def gallery() -> list[GalleryEntry]:
    """All scenes of the gallery with title and lesson, in order of their names."""
    return list(_entries())
