"""The one catalogue of numbers: tables of a run or of a recording, quantities with keys, units and labels, events."""

from __future__ import annotations

from .catalogue import Axis, Catalogue, Health, Quantity
from .numbers import LoadInfo, Numbers, numbers_of

__all__ = ["Axis", "Catalogue", "Health", "LoadInfo", "Numbers", "Quantity", "numbers_of"]
