"""Profiles of cams from files: outlines of a DXF drawing, points of a CSV table."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from io import BytesIO
from itertools import pairwise
from typing import Any

import numpy as np

from mechcore.arrays import Complex, Real
from mechcore.errors import Fault, MechanismError

_UNITS = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0, 13: 1e-6}  # $INSUNITS -> m
_NAMED = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
_POLAR = {"r", "rho", "radius", "phi", "theta", "angle", "polar"}  # names of columns of polar coordinates
_SAME = 1e-7  # points of a table closer than this part of the profile are one
ELLIPSE_ARCS, SPAN_ARCS = 256, 16  # pairs of arcs of a turn of an ellipse, and between two knots of a spline
_NEAR = 1e-5  # ends of lines and arcs closer than this part of the drawing are one point


def _bad(message: str, remedy: str) -> MechanismError:
    return MechanismError(Fault("file", message, remedy))


def read_dxf(content: bytes) -> tuple[Complex, Real, float | None]:
    """The only closed outline of a DXF drawing: vertices (n), bulges (n), and its unit [m] where the drawing states one.

    Polylines of both kinds with bulges and circles; lines, arcs, ellipses and splines that join end to end, also in blocks.
    Ellipses and splines become arcs through their points and tangents, all else is exact. Raises ``MechanismError`` where there is
    no outline or more than one.
    """
    from ezdxf import DXFError, recover

    try:
        document, auditor = recover.read(BytesIO(content))
    except (DXFError, ValueError) as error:
        raise _bad(f"it is no DXF drawing that can be read: {error}", "Save it as DXF again, of any release.") from None
    closed: list[tuple[Complex, Real]] = []
    loose: list[tuple[complex, complex, float]] = []
    for entity in _entities(document.modelspace()):
        z, bulges, shut = _curve(entity)
        if shut and len(z) > 1:
            closed.append((z, bulges))
        else:
            loose += zip(z[:-1].tolist(), z[1:].tolist(), bulges.tolist(), strict=False)
    closed += _chains(loose)
    if len(closed) != 1:
        outlines = f"{len(closed)} closed outlines" if closed else "no closed outline"
        damage = f"; {len(auditor.errors)} of its parts are damaged" if auditor.errors else ""
        raise _bad(f"it has {outlines}{damage}.", "Leave the profile of the cam alone in it, closed.")
    return *closed[0], _UNITS.get(document.units)


def _entities(layout: Iterable[Any]) -> Iterator[Any]:
    """The entities of a layout, those of blocks in their places."""
    for entity in layout:
        if entity.dxftype() == "INSERT":
            yield from _entities(entity.virtual_entities())
        else:
            yield entity


def _curve(entity: Any) -> tuple[Complex, Real, bool]:
    """Vertices (n), bulges (n or n - 1) and whether it is closed; no vertices of what is no curve."""
    kind, dxf = entity.dxftype(), entity.dxf
    if kind == "LINE":
        return _plane([dxf.start, dxf.end]), np.zeros(1), False
    if kind in ("ELLIPSE", "SPLINE"):
        z, bulges = biarcs(*(_ellipse if kind == "ELLIPSE" else _spline)(entity.construction_tool()))
        return z, bulges, False
    if kind == "ARC":
        ends = np.radians([dxf.start_angle, dxf.end_angle])
        z = complex(dxf.center.x, dxf.center.y) + dxf.radius * np.exp(1j * ends)
        bulges, shut = np.tan(np.diff(ends) % (2.0 * np.pi) / 4.0), False
    elif kind == "CIRCLE":
        z = complex(dxf.center.x, dxf.center.y) + dxf.radius * np.array([1.0, -1.0])
        bulges, shut = np.ones(2), True
    elif kind == "LWPOLYLINE" or (kind == "POLYLINE" and entity.is_2d_polyline):
        rows = entity.get_points("xyb") if kind == "LWPOLYLINE" else [v.format("xyb") for v in entity.vertices]
        x, y, bulges = np.array(rows, float).reshape(-1, 3).T
        z, shut = x + 1j * y, bool(entity.is_closed)
    else:
        return np.empty(0, complex), np.empty(0), False
    return (-np.conj(z), -bulges, shut) if dxf.extrusion.z < 0.0 else (z, bulges, shut)  # drawn from behind


def _plane(points: Iterable[Any]) -> Complex:
    return np.array([complex(p.x, p.y) for p in points])


def _ellipse(tool: Any) -> tuple[Complex, Complex]:
    """Points and unit tangents of an arc of an ellipse."""
    at = list(tool.params(ELLIPSE_ARCS + 1))
    return _plane(tool.vertices(at)), _unit(_plane(tool.tangents(at)))


def _spline(tool: Any) -> tuple[Complex, Complex]:
    """Points and unit tangents of a spline, from knot to knot."""
    knots = np.unique(np.clip(tool.knots(), tool.knots()[tool.order - 1], tool.knots()[tool.count]))
    share = np.linspace(0.0, 1.0, SPAN_ARCS + 1)
    points, tangents = [], []
    for a, b in pairwise(knots):
        points.append(_plane(tool.points(a + (b - a) * share)))
        inside = a + (b - a) * np.clip(share, 1e-6, 1.0 - 1e-6)  # one-sided at the knots, where it may have a corner
        tangents.append(_unit(_plane(d[1] for d in tool.derivatives(inside, 1))))
    return np.concatenate(points), np.concatenate(tangents)


def _unit(z: Complex) -> Complex:
    return z / np.abs(z)


def _chains(loose: list[tuple[complex, complex, float]]) -> list[tuple[Complex, Real]]:
    """Lines and arcs put end to end into closed outlines; what does not close is left out."""
    if not loose:
        return []
    near = _NEAR * max(max(abs(a), abs(b)) for a, b, _ in loose)
    rest = [piece for piece in loose if abs(piece[0] - piece[1]) > near or piece[2] != 0.0]
    chains = []
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
            chains.append((np.array([a for a, _, _ in chain]), np.array([bulge for _, _, bulge in chain])))
    return chains


def biarcs(points: Complex, tangents: Complex) -> tuple[Complex, Real]:
    """Points (n) with unit tangents (n) -> vertices (2 n - 1) and bulges (2 n - 2) of two arcs between every two of them.

    The arcs meet tangentially, with equal lengths of the tangents (Bolton 1975). A bulge is the tangent of a quarter of the
    arc's angle, positive to the left.
    """
    p, q, a, b = points[:-1], points[1:], tangents[:-1], tangents[1:]
    v, t = q - p, a + b
    lean = 2.0 * (1.0 - np.real(np.conj(a) * b))
    along, size = np.real(np.conj(v) * t), np.abs(v) ** 2
    straight = lean < 1e-14
    with np.errstate(divide="ignore", invalid="ignore"):
        d = np.where(straight, size / (2.0 * along), (-along + np.sqrt(along**2 + lean * size)) / np.where(straight, 1.0, lean))
    joint = 0.5 * (p + q + d * (a - b))
    first, second = joint - p, q - joint
    bulges = np.empty(2 * len(p))
    bulges[0::2] = np.tan(0.5 * np.angle(first * np.conj(a)))
    bulges[1::2] = np.tan(0.5 * np.angle(b * np.conj(second)))
    vertices = np.empty(2 * len(p) + 1, complex)
    vertices[0:-1:2], vertices[1::2], vertices[-1] = p, joint, q[-1]
    return vertices, bulges


def read_points(content: bytes) -> tuple[Complex, float | None]:
    """Points of a profile in order: columns x and y (with their units in brackets, as "x [mm]"), else the first two columns.

    Also returns the unit [m] of both where the header states one, that of x where they differ. Raises ``MechanismError`` where
    there are no points, or those of more than one curve.
    """
    (x, y), names = read_columns(content, ("x", "y"))
    units = [_NAMED.get(name) for name in names if name is not None]
    unit = None if None in units else next(iter(units), None)
    if unit is not None and None not in names:
        y = [value * (_NAMED[names[1] or ""] / unit) for value in y]
    if len(x) < 7:
        raise _bad(f"it has {len(x)} points.", "Give at least 7.")
    z = np.array(x) + 1j * np.array(y)
    if not np.any(z != z[0]):
        raise _bad(f"its {len(z)} points coincide.", "Give the points once round the cam, in order.")
    near = _SAME * float(np.abs(z - z.mean()).max())  # ends of pieces that are written twice
    z = z[np.abs(z - np.roll(z, 1)) > near] if abs(z[0] - z[-1]) <= near else z[np.abs(np.diff(z, prepend=np.inf)) > near]
    if len(z) < 7:
        raise _bad(f"of its {len(x)} points all but {len(z)} coincide with the one before.", "Give at least 7 that differ.")
    return z, unit


def separator_of(lines: Sequence[str]) -> str:
    """The separator of cells in a table in text form: a semicolon or tab that most lines have (then commas are decimal ones),
    else the comma."""
    return next((mark for mark in ";\t" if 2 * sum(mark in line for line in lines) > len(lines)), ",")


def read_columns(content: bytes, names: tuple[str, ...]) -> tuple[tuple[list[float], list[float]], tuple[str | None, str | None]]:
    """Two columns of a table in text form: those with the two names, else the first two; and their units where the header states
    them in brackets. Raises ``MechanismError`` where a row has no two numbers."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise _bad(f"it cannot be read: {error}.", "Give a table in text form.") from None
    delimiter = separator_of([line for line in text.splitlines() if line.strip()])
    if delimiter != ",":  # then commas are decimal ones
        text = text.replace(",", ".")
    rows = [row for row in csv.reader(text.splitlines(), delimiter=delimiter) if any(cell.strip() for cell in row)]
    columns: tuple[int, int] = (0, 1)
    units: list[str | None] = [None, None]
    if rows and not all(_is_number(cell) for cell in rows[0][:2]):
        heads = [re.match(r"\s*(\w+)\s*(?:\[([^\]]+)\])?", cell) for cell in rows[0]]
        places = {m.group(1).lower(): k for k, m in enumerate(heads) if m}
        if names and set(names) <= places.keys():
            columns = (places[names[0]], places[names[1]])
        elif len(polar := _POLAR & places.keys()) > 1 and names:
            raise _bad(
                f"its columns are {' and '.join(sorted(polar, key=places.__getitem__))}.", f"Give columns {' and '.join(names)}."
            )
        curves = {row[k] for row in rows[1:] if len(row) > k} if names and (k := places.get("curve", -1)) >= 0 else set()
        if len(curves) > 1:
            listed = ", ".join(f"'{curve}'" for curve in sorted(curves)[:4])
            raise _bad(f"it has {len(curves)} curves: {listed}.", "Leave the profile of the cam alone in it.")
        if not names or set(names) <= places.keys():
            units = [m.group(2) if c < len(heads) and (m := heads[c]) else None for c in columns]
        rows = rows[1:]
    numbers: tuple[list[float], list[float]] = ([], [])
    for k, row in enumerate(rows):
        cells = [row[c] if c < len(row) else "" for c in columns]
        if not all(_is_number(cell) for cell in cells):
            raise _bad(f"row {k + 1} has no point: {delimiter.join(row)[:40]!r}.", "Give two numbers in every row.")
        for column, cell in zip(numbers, cells, strict=True):
            column.append(float(cell))
    return numbers, (units[0], units[1])


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False
