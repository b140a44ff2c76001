"""Strokes of a drawing: read from SVG or written in a single-stroke font, scaled to a sheet, ordered."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mechcore.arrays import Complex
from mechcore.errors import Fault, MechanismError
from mechviz.files import OutputError, open_regular

EXTRA = "Install it: pip install 'mechviz[draw]'"
_CORNER = math.radians(55.0)  # a polyline of a font turns less where it represents a curve
_STEP = 8  # points between two of a font's
_FLAT = 400  # chords of flattened curves are the drawing's larger side over this
_CAPITAL = 0.7  # height of capitals over the size of a font
_MOST = 200_000  # points of a drawing
_ROUNDS = 40  # of improvement of the order of strokes


def svg_strokes(path: Path | str, font: str = "scripts") -> list[Complex]:
    """The strokes of an SVG drawing, one for each part of a path, (n,) points in its own unit with y upwards.

    Curves are flattened. Fills are represented by their outlines. Texts are written in a Hershey ``font`` of single strokes. Raises
    `OutputError` where the file cannot be read or has nothing to draw.
    """
    try:
        from svgelements import SVG, Move, Shape, Text
        from svgelements import Path as Trail
    except ImportError:
        raise OutputError("svgelements reads SVG drawings and is missing here.", EXTRA) from None
    try:
        with open_regular(path) as file:
            drawing = SVG.parse(file, reify=True)
    except OSError as error:
        raise OutputError(f"'{path}' cannot be read: {(error.strerror or str(error)).lower()}.", "Name an SVG file.") from None
    except Exception as error:  # whatever the parser meets in a file that is none
        raise OutputError(f"'{path}' is no SVG drawing: {error}.", "Save it as plain SVG.") from None
    trails = [Trail(part) for shape in drawing.elements() if isinstance(shape, Shape) for part in Trail(shape).as_subpaths()]
    boxes = [box for trail in trails if (box := trail.bbox()) is not None]
    lines = [s for e in drawing.elements() if isinstance(e, Text) and e.text and e.text.strip() for s in _written(e, font)]
    if not boxes and not lines:
        raise OutputError(f"'{path}' has no paths, shapes or texts to draw.", "Leave out images.")
    low, high = (np.min(boxes, axis=0)[:2], np.max(boxes, axis=0)[2:]) if boxes else (np.zeros(2), np.ones(2))
    chord, count = float(max(high - low)) / _FLAT, 0
    for trail in trails:
        points: list[complex] = []
        for segment in trail:
            if isinstance(segment, Move):
                continue
            n = 1 if type(segment).__name__ in ("Line", "Close") else max(2, math.ceil(segment.length(error=1e-3) / chord))
            places = [segment.point(k / n) for k in range(0 if not points else 1, n + 1)]
            points += [complex(p.x, -p.y) for p in places if p is not None]
            count += n
            if count > _MOST:
                raise OutputError(f"'{path}' has more than {_MOST} points.", "Draw fewer or shorter lines.")
        if len(points) > 1:
            lines.append(np.array(points))
    strokes = _cleaned(lines)
    if not strokes:
        raise OutputError(f"'{path}' has no line of any length.", "Draw at least one.")
    return strokes


def _written(text: Any, font: str) -> list[Complex]:
    """The strokes of a text of a drawing, y upwards, its capitals as high as usual in its size."""
    strokes, capital = text_strokes(text.text.strip(), font), np.concatenate(text_strokes("H", font)).imag
    scale = _CAPITAL * float(text.font_size) / float(np.ptp(capital))
    ends = np.concatenate(strokes).real
    start = {"middle": 0.5 * (ends.min() + ends.max()), "end": ends.max()}.get(text.anchor, 0.0)
    m = text.transform
    placed = [scale * (stroke - complex(start, capital.min())) for stroke in strokes]  # on its line
    flat = [complex(text.x, text.y) + stroke.conj() for stroke in placed]
    return [(m.a * z.real + m.c * z.imag + m.e) - 1j * (m.b * z.real + m.d * z.imag + m.f) for z in flat]


def text_strokes(text: str, font: str = "scripts") -> list[Complex]:
    """A text in a Hershey font of single strokes: (n,) points each in the font's unit, corners kept and the rest rounded.

    Raises `OutputError` where the font or the letters are not known.
    """
    try:
        from HersheyFonts import HersheyFonts
    except ImportError:
        raise OutputError("Hershey-Fonts has the letters of --text and is missing here.", EXTRA) from None
    pen = HersheyFonts()
    if font not in pen.default_font_names:
        raise OutputError(f"There is no font '{font}'.", f"Fonts: {', '.join(sorted(pen.default_font_names))}.")
    pen.load_default_font(font)
    unknown = [letter for letter in dict.fromkeys(text) if not letter.isspace() and not list(pen.strokes_for_text(letter))]
    if unknown:
        why = f"The font '{font}' has no {', '.join(unknown)}."
        raise OutputError(why, "Write letters without accents, digits or signs, or draw the word as paths.")
    strokes = [np.array([complex(x, -y) for x, y in stroke]) for stroke in pen.strokes_for_text(text)]
    strokes = _cleaned(strokes)
    if not strokes:
        raise OutputError(f"'{text}' has no letters that the font '{font}' knows.", "Write letters, digits or signs.")
    return [_rounded(stroke) for stroke in strokes]


def fit_to_sheet(strokes: Sequence[Complex], width: float) -> list[Complex]:
    """The strokes scaled so that the larger side of the box around them is ``width`` [m], the middle of the box at the origin."""
    every = np.concatenate(list(strokes))
    low, high = complex(every.real.min(), every.imag.min()), complex(every.real.max(), every.imag.max())
    size = max((high - low).real, (high - low).imag)
    if not size > 0.0:
        raise MechanismError(Fault("strokes", "all points of the drawing lie at one place.", "Draw a line."))
    return [(stroke - 0.5 * (low + high)) * (width / size) for stroke in strokes]


def ordered_strokes(strokes: Sequence[Complex], near: float) -> list[Complex]:
    """The strokes in an order, and each in a direction, with short travel between them: the nearest next, then improved by
    reversing parts of the order (2-opt). Strokes are joined as by `joined_strokes`."""
    rest, ordered = list(strokes), []
    at = min(rest, key=lambda s: s[0].real)[0]
    while rest:
        distances = [min(abs(s[0] - at), abs(s[-1] - at)) for s in rest]
        stroke = rest.pop(int(np.argmin(distances)))
        if abs(stroke[-1] - at) < abs(stroke[0] - at):
            stroke = stroke[::-1]
        ordered.append(stroke)
        at = stroke[-1]
    for _ in range(_ROUNDS):
        if not _improved(ordered):
            break
    return joined_strokes(ordered, near)


def joined_strokes(strokes: Sequence[Complex], near: float) -> list[Complex]:
    """The strokes in their order; successive ones whose ends are at most ``near`` apart are joined to one."""
    joined = [strokes[0]]
    for stroke in strokes[1:]:
        if abs(stroke[0] - joined[-1][-1]) <= near:
            joined[-1] = np.concatenate([joined[-1], stroke[1:]])
        else:
            joined.append(stroke)
    return joined


def _improved(order: list[Complex]) -> bool:
    """Reverse one part of the order if that shortens the travel between strokes; False where none does."""
    n = len(order)
    starts, ends = np.array([s[0] for s in order]), np.array([s[-1] for s in order])
    for i in range(n):
        before = ends[i - 1]  # the last one leads back to the first: a machine repeats the drawing
        j = np.arange(i, n if i else n - 1)
        after = starts[(j + 1) % n]
        gain = abs(starts[i] - before) + abs(after - ends[j]) - abs(ends[j] - before) - abs(after - starts[i])
        k = int(np.argmax(gain)) if len(j) else 0
        if len(j) and gain[k] > 1e-9 * (1.0 + abs(before)):
            last = int(j[k])
            order[i : last + 1] = [s[::-1] for s in reversed(order[i : last + 1])]
            return True
    return False


def _cleaned(strokes: Sequence[Complex]) -> list[Complex]:
    """The strokes without points that repeat the one before, and without strokes of one point."""
    cleaned = []
    size = max((float(np.ptp(s.real) + np.ptp(s.imag)) for s in strokes if len(s)), default=0.0)
    for stroke in strokes:
        if len(stroke) > 1:
            kept = stroke[np.concatenate([[True], abs(np.diff(stroke)) > 1e-9 * size])]
            if len(kept) > 1:
                cleaned.append(kept)
    return cleaned


def _rounded(z: Complex) -> Complex:
    """Cubic curves through the points of a polyline (centripetal Catmull-Rom) between its corners."""
    d = np.diff(z)
    turn = np.abs(np.angle(d[1:] / d[:-1]))
    corners = [0, *(np.flatnonzero(turn > _CORNER) + 1).tolist(), len(z) - 1]
    parts = [_through(z[a : b + 1]) for a, b in pairwise(corners)]
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def _through(z: Complex) -> Complex:
    if len(z) < 3:
        return z
    p = np.concatenate([[2.0 * z[0] - z[1]], z, [2.0 * z[-1] - z[-2]]])
    k = np.sqrt(np.abs(np.diff(p)))
    pieces = [z[:1]]
    u = np.arange(1, _STEP + 1) / _STEP
    for i in range(1, len(p) - 2):
        a, b, c = k[i - 1], k[i], k[i + 1]
        first = b * ((p[i] - p[i - 1]) / a - (p[i + 1] - p[i - 1]) / (a + b) + (p[i + 1] - p[i]) / b)
        last = b * ((p[i + 1] - p[i]) / b - (p[i + 2] - p[i]) / (b + c) + (p[i + 2] - p[i + 1]) / c)
        h = u[:, None] ** np.arange(4) @ np.array([[1, 0, 0, 0], [0, 1, 0, 0], [-3, -2, 3, -1], [2, 1, -2, 1]], float)
        pieces.append(h @ np.array([p[i], first, p[i + 1], last]))
    return np.concatenate(pieces)
