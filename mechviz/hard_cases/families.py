"""The families of hard cases; apart, so that the command line knows them without numpy."""

from __future__ import annotations

from typing import Literal

Family = Literal["linkages", "cams", "friction", "dynamics", "input"]
FAMILIES: tuple[Family, ...] = ("linkages", "cams", "friction", "dynamics", "input")
