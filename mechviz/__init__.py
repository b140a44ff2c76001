"""mechviz: a desktop-free 3D inspector and recorder of mechanisms.

``run("crank-rocker")`` solves a gallery scene or a scene file and returns a ``Result``; ``open("a.rrd")`` reads one from a
recording. ``load`` reads a scene; ``Scene.build`` and ``SceneBuilder`` create one in Python; ``scene.mechanism`` is the model that
``mechcore`` computes.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mechviz.facade import Result, open, run
    from mechviz.scene.builder import SceneBuilder
    from mechviz.scene.faults import SceneError
    from mechviz.scene.folder import gallery
    from mechviz.scene.scene import Scene, dump, load, loads


def __getattr__(name: str) -> Any:
    """The public name, imported on first use: ``import mechviz`` alone loads nothing heavy."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(".facade" if name in ("Result", "open", "run") else ".scene", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


__all__ = ["Result", "Scene", "SceneBuilder", "SceneError", "dump", "gallery", "load", "loads", "open", "run"]
