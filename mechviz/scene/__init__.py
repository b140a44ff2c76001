"""Scenes: a declarative description of a mechanism, read with every fault at once.

``load`` reads a gallery name or a file, ``loads`` a text, ``Scene.build`` and ``SceneBuilder`` take Python values. All
go through the same validation and give a ``Scene``, whose ``mechanism`` the core computes.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mechviz.scene.builder import SceneBuilder
    from mechviz.scene.faults import SceneError
    from mechviz.scene.folder import GalleryEntry, gallery, gallery_names
    from mechviz.scene.scene import Scene, dump, json_schema, load, loads


_HOMES = {
    "GalleryEntry": "folder",
    "Scene": "scene",
    "SceneBuilder": "builder",
    "SceneError": "faults",
    "dump": "scene",
    "gallery": "folder",
    "gallery_names": "folder",
    "json_schema": "scene",
    "load": "scene",
    "loads": "scene",
}


def __getattr__(name: str) -> Any:
    """The public name, imported on first use: listing the gallery must not load the machinery that reads scenes."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)


__all__ = [
    "GalleryEntry",
    "Scene",
    "SceneBuilder",
    "SceneError",
    "dump",
    "gallery",
    "gallery_names",
    "json_schema",
    "load",
    "loads",
]
