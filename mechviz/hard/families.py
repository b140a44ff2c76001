"""The families of hard cases; apart, so that the command line knows them without numpy."""

from typing import Literal

__all__ = ["FAMILIES", "Family"]

Family = Literal["linkages", "cams", "friction", "dynamics", "input"]
FAMILIES: tuple[Family, ...] = ("linkages", "cams", "friction", "dynamics", "input")
