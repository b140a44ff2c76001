"""Names of entities, and their parts escaped as rerun does."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Single


@lru_cache(maxsize=8192)
def entity(*parts: str) -> str:
    """An entity path from its unescaped parts."""
    import rerun as rr

    return rr.new_entity_path(list(parts))


def parts_of(path: str) -> tuple[str, ...]:
    """The unescaped parts of an entity path."""
    parts, part, escaped = [], "", False
    for letter in path.removeprefix("/"):
        if escaped:
            part, escaped = part + letter, False
        elif letter == "\\":
            escaped = True
        elif letter == "/":
            parts.append(part)
            part = ""
        else:
            part += letter
    return (*parts, part)


def packed(colors: Sequence[Sequence[int]]) -> NDArray[np.uint32]:
    """Colours of three or four channels, 0 to 255, each as one number 0xRRGGBBAA: else the recorder takes every list apart anew."""
    return np.array([int.from_bytes(bytes((*c, 255)[:4]), "big") for c in colors], np.uint32)


def line_strips(parts: Sequence[Single]) -> Any:
    """Strips (n, points, 3) of each of some items at n frames -> an arrow array of all strips, those of the first frame first."""
    import pyarrow as pa
    import rerun as rr

    frames = len(parts[0]) if parts else 0
    points = np.concatenate(parts, axis=1).reshape(-1, 3) if frames else np.zeros((0, 3), np.float32)
    offsets = np.concatenate([[0], np.cumsum(np.tile([p.shape[1] for p in parts], frames))]).astype(np.int32)
    kind = rr.components.LineStrip3DBatch([]).as_arrow_array().type
    flat = rr.components.Position3DBatch(np.ascontiguousarray(points)).as_arrow_array()
    return pa.ListArray.from_arrays(pa.array(offsets), flat, type=kind)
