"""The published and recomputed cases of design."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from mechcore.arrays import Complex


@cache
def _cases() -> dict[str, Any]:
    text = (Path(__file__).parents[1] / "reference" / "design.json").read_text()
    return {case["id"]: case for case in json.loads(text)["cases"]}


def design_case(name: str) -> tuple[Any, Any]:
    """Inputs and expected values of a case."""
    return _cases()[name]["inputs"], _cases()[name]["expected"]


def plane(pairs: Any) -> Complex:
    """Pairs of numbers as plane vectors."""
    return np.asarray(pairs, float)[..., 0] + 1j * np.asarray(pairs, float)[..., 1]


def time_ratio(pin: np.ndarray) -> float:
    """Slow over fast of an output (F,) over one turn of a crank at constant speed, ends of the turn once; found between samples."""
    high, low = int(pin.argmax()), int(pin.argmin())

    def place(k: int) -> float:
        before, at, after = pin[k - 1], pin[k], pin[(k + 1) % len(pin)]
        return float(k + 0.5 * (before - after) / (before - 2.0 * at + after))

    part = (place(high) - place(low)) % len(pin) / len(pin)
    return float(max(part, 1.0 - part) / min(part, 1.0 - part))
