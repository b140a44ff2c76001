"""Scenes of the gallery in other units: what they state stays what it is."""

from __future__ import annotations

import re
import tomllib
from importlib.resources import files
from typing import Any

from mechviz.scene.scene import Scene, load
from mechviz.scene.units import Units

METRES = {"length": "m", "angle": "rad"}
INCHES = {"length": "in", "angle": "deg", "force": "lbf", "torque": "lbf in", "mass": "lb", "inertia": "lb in^2"}


def retold(name: str, **units: str) -> Scene:
    """A scene of the gallery whose bare numbers have become texts with their units, and which states other units for itself."""
    scene = load(name)
    document = tomllib.loads(files("mechviz").joinpath("gallery", f"{name}.toml").read_text(encoding="utf-8"))
    for path, kind in scene.kinds.items():
        keys = [int(k) if k.isdigit() else k for k in re.findall(r"[^.\[\]]+", path)]
        value = _at(document, keys)
        if isinstance(value, int | float):
            _at(document, keys[:-1])[keys[-1]] = f"{value!r} {_bare(scene.units, kind)}"
    document["units"] = document.get("units", {}) | units
    return Scene.build(name=name, folder=scene.folder, **document)


def _at(value: Any, keys: list[str | int]) -> Any:
    """What stands at a place of a document; None where it is a default."""
    for key in keys:
        try:
            value = value[key]
        except (KeyError, IndexError, TypeError):
            return None
    return value


def _bare(units: Units, kind: str) -> str:
    return units.symbol(kind).replace("°", "deg")
