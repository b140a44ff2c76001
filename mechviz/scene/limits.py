"""Limits of the size of scenes and runs: what would take hours, or more memory than available, is refused beforehand with its
number."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from mechcore.errors import Fault, MechanismError
from mechviz.files import LARGE_VARIABLE

MOST_KEYS = 200_000  # of a scene, which is read in half a minute
MOST_ITEMS = 50_000  # links, joints and loads: checked in a minute or two
MOST_DRAWN = 1_000  # links with solids
MOST_POSES = 10_000_000  # links times frames: each takes up to a kilobyte


def lifted() -> bool:
    """Whether the limits are lifted."""
    return bool(os.environ.get(LARGE_VARIABLE))


def size_faults(data: Mapping[str, Any]) -> list[Fault]:
    """Faults of plain data of a scene that exceed the limits."""
    if lifted():
        return []
    keys = _keys(data)
    if keys > MOST_KEYS:
        return [_too_large("scene", f"it has {keys:,} keys; up to {MOST_KEYS:,} are read", "Divide it")]
    sections = [data.get(key) for key in ("links", "joints", "loads")]
    items = sum(len(section) for section in sections if isinstance(section, Mapping))
    if items > MOST_ITEMS:
        return [_too_large("scene", f"it has {items:,} links, joints and loads; up to {MOST_ITEMS:,} are taken", "Divide it")]
    return []


def check_frames(links: int, frames: int) -> None:
    """Raises `MechanismError` where a run takes more memory than most machines have."""
    most = MOST_POSES // max(links, 1)
    if frames > most and not lifted():
        what = f"{frames:,} frames of {links:,} links are {links * frames:,} poses; up to {MOST_POSES:,} are kept"
        raise MechanismError(_too_large("run.frames", what, f"Give up to {most:,} frames"))


def check_drawn(links: int) -> None:
    """Raises `MechanismError` where the solids of a mechanism take hours to lay out."""
    if links > MOST_DRAWN and not lifted():
        what = f"there are {links:,} links; solids are laid out for up to {MOST_DRAWN:,}"
        raise MechanismError(_too_large("links", what, "Draw a part of it, or export its numbers"))


def _keys(value: object) -> int:
    if isinstance(value, Mapping):
        return len(value) + sum(map(_keys, value.values()))
    return sum(map(_keys, value)) if isinstance(value, list) else 0


def _too_large(path: str, what: str, remedy: str) -> Fault:
    return Fault(path, f"{what}.", f"{remedy}; --large, or {LARGE_VARIABLE}=1 in the environment, lifts this limit.")
