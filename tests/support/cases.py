"""Few cases that stand for many; with MECHVIZ_EVERY_CASE=1 in the environment, as in CI, there are more."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import cycle, islice
from typing import Any

EVERY_CASE = os.environ.get("MECHVIZ_EVERY_CASE") == "1"


def side_by_side(*factors: Sequence[Any]) -> list[tuple[Any, ...]]:
    """Cases in which every value of every factor occurs, and of the longest factor once: not every value with every other."""
    longest = max(map(len, factors))
    return list(zip(*(islice(cycle(values), longest) for values in factors), strict=True))


def examples(count: int) -> int:
    """How many examples a property is tried with."""
    return count if EVERY_CASE else -(-count // 3)
