"""Scenes of the gallery that together have every kind of thing that any scene of it has: what the others have is proved by these.

With MECHVIZ_EVERY_CASE=1 in the environment they are all scenes.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from typing import Any

from cases import EVERY_CASE

from mechviz.scene.folder import GALLERY_FOLDER

NAMED = ["links", "joints", "points", "parameters", "loads", "sketch", "systems", "substitutes", "sections", "watch", "pens"]
"""Tables whose keys are names of a scene's own."""
KINDS = ["law", "effects", "shape", "side"]
"""Keys whose texts are words of the format."""


def kinds_of(value: Any, path: str = "", key: str = "") -> Iterator[str]:
    """Paths of all keys of a document without the names of its items; words of the format after them."""
    yield f"{path} = {value}" if isinstance(value, bool) or (isinstance(value, str) and key in KINDS) else path
    if isinstance(value, dict):
        for k, inner in value.items():
            yield from kinds_of(inner, f"{path}.*" if key in NAMED else f"{path}.{k}", "" if key in NAMED else k)
    elif isinstance(value, list):
        for inner in value:
            yield from kinds_of(inner, path, key)


def covering(names: Sequence[str]) -> list[str]:
    """Few of the scenes that have all kinds of things that these have: time and again the one with most that are still missing."""
    if EVERY_CASE:
        return list(names)
    left = {name: set(kinds_of(tomllib.loads((GALLERY_FOLDER / f"{name}.toml").read_text("utf-8")))) for name in names}
    missing, taken = set().union(*left.values()), []
    while missing:
        taken.append(max(names, key=lambda name: len(left[name] & missing)))
        missing -= left[taken[-1]]
    return sorted(taken)
