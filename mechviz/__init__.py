"""mechviz: a desktop-free 3D inspector and recorder of mechanisms.

``mechviz.load("crank-rocker")`` reads a scene of the gallery or a file; ``mechviz.Scene.build`` and
``mechviz.SceneBuilder`` make one in Python; ``scene.mechanism`` is what ``mechcore`` computes.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mechviz.scene.builder import SceneBuilder
    from mechviz.scene.faults import SceneError
    from mechviz.scene.folder import gallery
    from mechviz.scene.scene import Scene, dump, load, loads


def __getattr__(name: str) -> Any:
    """Names on first use: ``import mechviz`` alone loads nothing heavy."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(".scene", __name__), name)


__all__ = ["Scene", "SceneBuilder", "SceneError", "dump", "gallery", "load", "loads"]
