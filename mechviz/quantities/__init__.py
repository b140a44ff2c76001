"""The catalogue of numerical results: tables of a run or of a recording, quantities with keys, units and labels, events."""

from mechviz.quantities.catalogue import Axis, Catalogue, Health, Quantity
from mechviz.quantities.numbers import LoadInfo, Numbers, numbers_of

__all__ = ["Axis", "Catalogue", "Health", "LoadInfo", "Numbers", "Quantity", "numbers_of"]
