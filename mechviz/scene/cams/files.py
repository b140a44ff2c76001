"""Profiles of cams from files: outlines of a DXF drawing, points of a CSV table."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mechcore.errors import Fault, MechanismError

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

_UNITS = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0, 13: 1e-6}  # $INSUNITS -> m
_NAMED = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
_SAME = 1e-7  # points of a table closer than this part of the profile are one
_NEAR = 1e-5  # ends of lines and arcs closer than this part of the drawing are one point


def _bad(message: str, remedy: str) -> MechanismError:
    return MechanismError(Fault("file", message, remedy))


def _rows(text: str) -> Iterator[tuple[int, str]]:
    lines = text.splitlines()
    for code, value in zip(lines[::2], lines[1::2], strict=False):
        if not re.fullmatch(r"\s*-?\d+\s*", code):
            raise _bad("it is no DXF drawing in text form.", "Save it as DXF (ASCII), of any release.")
        yield int(code), value.strip()


def read_dxf(content: bytes) -> tuple[Complex, Real, float | None]:
    """The only closed outline of a DXF drawing: vertices (n), bulges (n), and its unit [m] where the drawing states one.

    Polylines of both kinds with bulges; lines, arcs and circles that join end to end. Raises ``MechanismError`` where there is
    none or more than one.
    """
    rows = list(_rows(content.decode("utf-8", errors="replace")))
    unit = None
    for k, (code, value) in enumerate(rows[:-1]):
        if (code, value) == (9, "$INSUNITS"):
            unit = _UNITS.get(int(float(rows[k + 1][1])))
    starts = [k for k, (code, _) in enumerate(rows) if code == 0] + [len(rows)]
    closed: list[tuple[list[complex], list[float]]] = []
    loose: list[tuple[complex, complex, float]] = []
    current: tuple[list[complex], list[float]] | None = None
    for a, b in pairwise(starts):
        kind, data = rows[a][1], rows[a + 1 : b]
        first = dict(reversed(data))

        def number(code: int, first: dict[int, str] = first) -> float:
            return float(first.get(code, "0"))

        if kind == "LWPOLYLINE":
            z, bulges = _light(data)
            _take(z, bulges, bool(int(number(70)) & 1), closed, loose)
        elif kind == "POLYLINE":
            current = ([], [])
            shut = bool(int(number(70)) & 1)
        elif kind == "VERTEX" and current is not None:
            current[0].append(complex(number(10), number(20)))
            current[1].append(number(42))
        elif kind == "SEQEND" and current is not None:
            _take(*current, shut, closed, loose)
            current = None
        elif kind == "LINE":
            loose.append((complex(number(10), number(20)), complex(number(11), number(21)), 0.0))
        elif kind == "ARC":
            sweep = np.radians((number(51) - number(50)) % 360.0)
            ends = complex(number(10), number(20)) + number(40) * np.exp(1j * np.radians([number(50), number(51)]))
            loose.append((complex(ends[0]), complex(ends[1]), float(np.tan(sweep / 4.0))))
        elif kind == "CIRCLE":
            c, r = complex(number(10), number(20)), number(40)
            closed.append(([c + r, c - r], [1.0, 1.0]))
        elif kind in ("SPLINE", "ELLIPSE"):
            raise _bad(f"it has a {kind.lower()}.", "Save it with polylines of lines and arcs.")
    closed += _chains(loose)
    if len(closed) != 1:
        found = f"{len(closed)} closed outlines" if closed else "no closed outline"
        raise _bad(f"it has {found}.", "Leave the profile of the cam alone in it, closed.")
    return np.array(closed[0][0]), np.array(closed[0][1]), unit


def _light(data: list[tuple[int, str]]) -> tuple[list[complex], list[float]]:
    x: list[float] = []
    y: list[float] = []
    bulges: list[float] = []
    for code, value in data:
        if code == 10:
            x.append(float(value))
            bulges.append(0.0)
        elif code == 20:
            y.append(float(value))
        elif code == 42 and bulges:
            bulges[-1] = float(value)
    return [complex(a, b) for a, b in zip(x, y, strict=True)], bulges


def _take(
    z: list[complex],
    bulges: list[float],
    shut: bool,
    closed: list[tuple[list[complex], list[float]]],
    loose: list[tuple[complex, complex, float]],
) -> None:
    if shut and len(z) > 1:
        closed.append((z, bulges))
    else:
        loose += [(a, b, bulge) for a, b, bulge in zip(z, z[1:], bulges, strict=False)]


def _chains(loose: list[tuple[complex, complex, float]]) -> list[tuple[list[complex], list[float]]]:
    """Lines and arcs put end to end into closed outlines; what does not close is left out."""
    if not loose:
        return []
    near = _NEAR * max(max(abs(a), abs(b)) for a, b, _ in loose)
    rest = [piece for piece in loose if abs(piece[0] - piece[1]) > near or piece[2] != 0.0]
    found = []
    while rest:
        chain = [rest.pop()]
        while abs(chain[-1][1] - chain[0][0]) > near:
            end = chain[-1][1]
            k = next((k for k, (a, b, _) in enumerate(rest) if min(abs(a - end), abs(b - end)) <= near), None)
            if k is None:
                break
            a, b, bulge = rest.pop(k)
            chain.append((a, b, bulge) if abs(a - end) <= near else (b, a, -bulge))
        else:
            found.append(([a for a, _, _ in chain], [bulge for _, _, bulge in chain]))
    return found


def read_points(content: bytes) -> tuple[Complex, float | None]:
    """Points of a profile in order: columns x and y (with their unit in brackets, as "x [mm]"), else the first two of numbers.

    The second answer is the unit [m] where the header states one. Raises ``MechanismError`` where there are no points.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise _bad(f"it cannot be read: {error}.", "Give a table in text form.") from None
    delimiter = ";" if text.count(";") > text.count(",") else "\t" if text.count("\t") > text.count(",") else ","
    rows = [row for row in csv.reader(text.splitlines(), delimiter=delimiter) if any(cell.strip() for cell in row)]
    columns, unit = (0, 1), None
    if rows and not all(_is_number(cell) for cell in rows[0][:2]):
        names = [re.match(r"\s*(\w+)\s*(?:\[(\w+)\])?", cell) for cell in rows[0]]
        places = {m.group(1).lower(): k for k, m in enumerate(names) if m}
        if "x" in places and "y" in places:
            columns = (places["x"], places["y"])
            match = names[columns[0]]
            unit = _NAMED.get((match.group(2) or "") if match else "")
        rows = rows[1:]
    points = []
    for k, row in enumerate(rows):
        cells = [row[c] if c < len(row) else "" for c in columns]
        if not all(_is_number(cell) for cell in cells):
            raise _bad(f"row {k + 1} has no point: {delimiter.join(row)[:40]!r}.", "Give two numbers in every row.")
        points.append(complex(float(cells[0]), float(cells[1])))
    if len(points) < 7:
        raise _bad(f"it has {len(points)} points.", "Give at least 7.")
    z = np.array(points)
    if not np.any(z != z[0]):
        raise _bad(f"its {len(z)} points coincide.", "Give the points once round the cam, in order.")
    near = _SAME * float(np.abs(z - z.mean()).max())  # ends of pieces that are written twice
    z = z[np.abs(z - np.roll(z, 1)) > near] if abs(z[0] - z[-1]) <= near else z[np.abs(np.diff(z, prepend=np.inf)) > near]
    if len(z) < 7:
        raise _bad(f"of its {len(points)} points all but {len(z)} coincide with the one before.", "Give at least 7 that differ.")
    return z, unit


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False
