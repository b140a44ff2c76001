"""The frames of a run that a page shows, and numbers packed into its text."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechcore.arrays import Integers, Real
from mechcore.records import dataclass
from mechviz.outputs.presentation import Presentation
from mechviz.outputs.rerun.reader import even_indices

Array = NDArray[Any]

LARGEST_FLOAT = float(np.finfo(np.float32).max)
NO_VALUE = 65535
"""Code of NaN in quantised values."""


class Pack:
    """Arrays for a page. The methods return an array's number, to which the header refers; equal arrays are stored once."""

    def __init__(self) -> None:
        self._entries: list[dict[str, Any]] = []
        self._blobs: list[bytes] = []
        self._known: dict[tuple[str, bytes, str], int] = {}
        self._length = 0

    def floats(self, values: Array) -> int:
        """Values as float32; NaN for values beyond its range, which a damaged recording may contain."""
        flat = np.asarray(values).ravel()
        return self._add("f32", np.where(np.abs(flat) <= LARGEST_FLOAT, flat, np.nan).astype(np.float32))

    def quantised(self, values: Array) -> int:
        """Finite or NaN values, quantised to 16 bits over their range: for drawing, not for readings."""
        flat = np.asarray(values, float).ravel()
        known = np.isfinite(flat)
        low = float(np.min(flat, initial=np.inf, where=known)) if known.any() else 0.0
        high = float(np.max(flat, initial=-np.inf, where=known)) if known.any() else 1.0
        span = (high - low) or 1.0
        steps = np.where(known, np.round((np.where(known, flat, low) - low) / span * (NO_VALUE - 1)), NO_VALUE)
        return self._add("q16", steps.astype(np.uint16), low=low, span=span / (NO_VALUE - 1))

    def directions(self, values: Array) -> int:
        """Components of unit vectors in steps of 1/127; 0 for components beyond 1 or NaN, as in normals of a damaged mesh."""
        flat = np.asarray(values, float).ravel()
        return self._add("i8", np.round(127.0 * np.where(np.abs(flat) <= 1.0 + 1e-6, flat, 0.0)).astype(np.int8))

    def octets(self, values: Array) -> int:
        """Values 0 to 255."""
        return self._add("u8", np.asarray(values, np.uint8).ravel())

    def indices(self, values: Array) -> int:
        """Integers, stored as differences."""
        return self._add("d32", np.diff(np.asarray(values, np.int64).ravel(), prepend=0).astype(np.int32))

    def text(self, header: dict[str, Any]) -> str:
        """Header and arrays as one base64 text."""
        head = json.dumps({**header, "arrays": self._entries}, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
        raw = len(head).to_bytes(4, "little") + head + b"".join(self._blobs)
        return base64.b64encode(zlib.compress(raw, 9)).decode("ascii")

    def _add(self, kind: str, flat: Array, **more: float) -> int:
        # Stored as byte planes: neighbouring values have nearly equal high bytes, which deflate compresses well
        blob = flat.astype(flat.dtype.newbyteorder("<")).view(np.uint8).reshape(-1, flat.itemsize).T.tobytes()
        key = (kind, blob, repr(more))
        if key not in self._known:
            self._known[key] = len(self._entries)
            self._entries.append({"type": kind, "at": self._length, "count": len(flat), **more})
            self._blobs.append(blob)
            self._length += len(blob)
        return self._known[key]


def unpack(text: str) -> tuple[dict[str, Any], list[Array]]:
    """Content of a text of `Pack.text`: the header, and the arrays as floats or integers."""
    raw = zlib.decompress(base64.b64decode(text))
    start = 4 + int.from_bytes(raw[:4], "little")
    header = json.loads(raw[4:start])
    types = {"f32": "<f4", "q16": "<u2", "i8": "i1", "u8": "u1", "d32": "<i4"}
    arrays = []
    for entry in header["arrays"]:
        dtype = np.dtype(types[entry["type"]])
        planes = np.frombuffer(raw, np.uint8, entry["count"] * dtype.itemsize, start + entry["at"])
        flat: Array = np.ascontiguousarray(planes.reshape(dtype.itemsize, -1).T).view(dtype).ravel()
        if entry["type"] == "q16":
            flat = np.where(flat == NO_VALUE, np.nan, entry["low"] + entry["span"] * flat.astype(float))
        elif entry["type"] == "d32":
            flat = np.cumsum(flat, dtype=np.int64)
        elif entry["type"] == "i8":
            flat = flat / 127.0
        arrays.append(flat)
    return header, arrays


PackProgress = Callable[[int, int], None]
"""Called with the number of items done and the total."""

MOST_FRAMES = 1000
"""Default number of frames of a page. The browser interpolates between them."""


def no_progress(done: int, total: int) -> None:
    """Report no progress."""


@dataclass(frozen=True, eq=False)
class ChosenFrames:
    """The chosen frames (n,) of the ``total`` of a run, their ``rows`` (n,) in the presentation, and their ``time`` (n,) [s]."""

    chosen: Integers
    total: int
    rows: Integers
    time: Real


def find_frames(shown: Presentation, most: int, keep: float | None = None) -> ChosenFrames:
    """At most ``most`` frames, evenly spaced over the run, including the first and the last; in addition the frames around the time
    ``keep`` [s]."""
    time, last = shown.picture.time, len(shown.picture.time) - 1
    rows = np.clip(np.searchsorted(shown.chosen, even_indices(shown.total, most)), 0, last)
    if keep is not None:
        k = int(np.searchsorted(time, keep - 1e-9))  # times in a recording are whole nanoseconds
        rows = np.append(rows, np.clip([k - 1, k, k + 1], 0, last))
    rows = np.unique(rows)
    return ChosenFrames(shown.chosen[rows], shown.total, rows, time[rows])
