"""What callbacks of controls share: how they are wrapped, and numbers from browsers brought into range."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Callback = Callable[[str, Callable[[Any], None]], Callable[[Any], Any]]
"""``callback(what, action)``: an action for viser of which failures are told to the user under the name ``what``."""


def finite(value: Any, low: float, high: float, otherwise: float) -> float:
    """A number from a browser brought into its range; what is not a finite number becomes ``otherwise``."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return otherwise
    return float(np.clip(number, low, high)) if np.isfinite(number) else otherwise
