"""Texts of which scenes of machines are written: tables, quoted words, places."""

from __future__ import annotations

import numpy as np

from mechcore.arrays import Real


def csv_table(header: str, length: float, values: Real) -> bytes:
    """A CSV table of periodic values (N,) at even steps over a length; the last row is the first one again."""
    places = length * np.arange(len(values) + 1) / len(values)
    rows = (f"{a:.12g},{b:.7f}" for a, b in zip(places, np.append(values, values[0]), strict=True))
    return (header + "\n" + "\n".join(rows) + "\n").encode()


def quoted(words: str) -> str:
    """A text of TOML."""
    return '"' + words.replace("\\", "\\\\").replace('"', '\\"') + '"'


def place(z: complex) -> str:
    """A point in millimetres."""
    return f"[{1e3 * z.real:.9g}, {1e3 * z.imag:.9g}]"
