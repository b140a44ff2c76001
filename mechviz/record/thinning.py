"""Rows of a recording at some of its frames only: what a page of a long run needs, in a tenth of the memory."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["evenly", "rows_at_or_before", "ticks", "times_of"]

Index = NDArray[np.int64]


def evenly(total: int, most: int) -> Index:
    """At most ``most`` of ``total`` frames, spread evenly, the first and the last among them."""
    return np.unique(np.round(np.linspace(0, total - 1, min(total, most))).astype(np.int64))


def times_of(chunks: Iterable[Any], path: str) -> Index:
    """The times [ns] of all rows of an entity, sorted."""
    found = [ticks(chunk.to_record_batch()["time"]) for chunk in chunks if str(chunk.entity_path) == path and not chunk.is_static]
    return np.sort(np.concatenate(found)) if found else np.zeros(0, np.int64)


def rows_at_or_before(batch: Any, times: Index) -> Any:
    """Of an arrow batch its first row and the last one at or before each of some times [ns]: a row holds until the next."""
    import pyarrow as pa

    own = ticks(batch["time"])
    if not len(own):
        return batch
    order = np.argsort(own, kind="stable")  # rerun may sort rows by a drive that runs backwards
    places = np.clip(np.searchsorted(own[order], times, side="right") - 1, 0, None)
    rows = np.unique(order[np.append(places, 0)])
    return batch if len(rows) == len(own) else batch.take(pa.array(rows))


def ticks(column: Any) -> Index:
    """A column of times as whole numbers."""
    import pyarrow as pa

    found: Index = column.cast(pa.int64()).to_numpy(zero_copy_only=False)
    return found
