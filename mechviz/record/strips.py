"""Line strips of many frames as one array for the recorder, which would else turn every strip into an array by itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["line_strips"]


def line_strips(parts: Sequence[NDArray[np.float32]]) -> Any:
    """Strips (n, points, 3) of each of some items at n frames -> an arrow array of all strips, those of the first frame first."""
    import pyarrow as pa
    import rerun as rr

    frames = len(parts[0]) if parts else 0
    points = np.concatenate(parts, axis=1).reshape(-1, 3) if frames else np.zeros((0, 3), np.float32)
    offsets = np.concatenate([[0], np.cumsum(np.tile([p.shape[1] for p in parts], frames))]).astype(np.int32)
    kind = rr.components.LineStrip3DBatch([]).as_arrow_array().type
    flat = rr.components.Position3DBatch(np.ascontiguousarray(points)).as_arrow_array()
    return pa.ListArray.from_arrays(pa.array(offsets), flat, type=kind)
