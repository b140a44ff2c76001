"""Colours as the recorder holds them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["packed"]


def packed(colors: Sequence[Sequence[int]]) -> NDArray[np.uint32]:
    """Colours of three or four channels, 0 to 255, each as one number 0xRRGGBBAA: else the recorder takes every list apart anew."""
    return np.array([int.from_bytes(bytes((*c, 255)[:4]), "big") for c in colors], np.uint32)
