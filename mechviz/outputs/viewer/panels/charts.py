"""Diagrams of one quantity over another in the browser: axes with ticks, curves, and a dot at the present frame.

They are the same as in a recording: indicator diagrams, phase diagrams, polar plots of bearing forces, torques of all revolutions
overlaid.
"""

from __future__ import annotations

from functools import lru_cache
from html import escape

import numpy as np

from mechviz.outputs.drawings import DRAWING_HEIGHT, DRAWING_WIDTH, TICK_COUNT, Diagram, round_ticks
from mechviz.outputs.rerun.plots import CURVE_PALETTE
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.world.constructions import readable_color

HALO_STYLE = 'stroke="var(--mantine-color-body)" stroke-width="3" paint-order="stroke"'  # in the background colour


def svg_words(
    x: float, y: float, words: str, size: float, *, anchor: str = "middle", color: str = "currentColor", look: str = HALO_STYLE
) -> str:
    """An SVG text element of ``words``, which are already markup, centred vertically at y; ``look``: further attributes."""
    place = f'x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" text-anchor="{anchor}" dominant-baseline="central"'
    return f'<text {place} fill="{color}" {look}>{words}</text>'


AXES_LEFT, AXES_TOP, AXES_WIDTH, AXES_HEIGHT = 46.0, 20.0, 274.0, 236.0  # of the axes [px]
EQUAL_AXES_HEIGHT = AXES_WIDTH * DRAWING_HEIGHT / DRAWING_WIDTH  # height of the axes with equal scales [px]
PICTURE_WIDTH, WORDS_HEIGHT = 330.0, 44.0  # width of the picture, and height of the text below the axes [px]
MOST_STRIP_POINTS = 400  # largest number of points of a curve without gaps


def moving_diagram_svg(diagram: Diagram, frame: int) -> str:
    """A diagram at a frame, as SVG."""
    parts = []
    for k, curve in enumerate(diagram.curves):
        place = diagram.place(curve.x[frame : frame + 1], curve.y[frame : frame + 1])[0]
        if np.isfinite(place).all():
            x, y = _pixels(diagram, *place)
            if diagram.equal:  # a ray from the origin, as long as the value
                x0, y0 = _pixels(diagram, *diagram.place(np.zeros(1), np.zeros(1))[0])
                parts.append(f'<path d="M{x0:.1f},{y0:.1f} L{x:.1f},{y:.1f}" stroke="{_color(k)}" stroke-width="1.4"/>')
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{_color(k)}"/>')
    high = AXES_TOP + _up(diagram) + WORDS_HEIGHT
    return (
        f'<svg role="img" aria-label="{escape(diagram.title)}" viewBox="0 0 {PICTURE_WIDTH:g} {high:g}" '
        f'style="display:block;width:100%;max-height:{high:g}px;overflow:hidden">{_backdrop(diagram)}{"".join(parts)}</svg>'
    )


@lru_cache(maxsize=8)
def _backdrop(diagram: Diagram) -> str:
    """Fixed part of a diagram: axes, ticks, curves. The cache distinguishes diagrams by identity, not by content."""
    x0, x1, y0, y1 = diagram.ranges
    up = _up(diagram)
    xs = np.arange(0.0, 361.0, 90.0) if diagram.turn == 360.0 else round_ticks(x0, x1, TICK_COUNT)
    parts = []
    for values, across in ((xs, True), (round_ticks(y0, y1, TICK_COUNT), False)):
        for value in values:
            ends = (np.array([value, value]), np.array([y0, y1])) if across else (np.array([x0, x1]), np.array([value, value]))
            (ax, ay), (bx, by) = (_pixels(diagram, *point) for point in diagram.place(*ends))
            strength = 0.5 if value == 0.0 else 0.15
            parts.append(f'<path d="M{ax:.1f},{ay:.1f} L{bx:.1f},{by:.1f}" stroke="currentColor" opacity="{strength}"/>')
            point = (ax, AXES_TOP + up + 11.0) if across else (AXES_LEFT - 5.0, ay)
            parts.append(_text(*point, words.format_number(float(f"{value:.4g}")), "middle" if across else "end"))
    box = f'x="{AXES_LEFT:g}" y="{AXES_TOP:g}" width="{AXES_WIDTH:g}" height="{up:g}"'
    parts.append(f'<rect {box} fill="none" stroke="currentColor" opacity="0.5"/>')
    parts.append(_text(AXES_LEFT + AXES_WIDTH / 2.0, AXES_TOP + up + 28.0, diagram.x_title, "middle"))
    parts.append(_text(AXES_LEFT, AXES_TOP - 9.0, diagram.y_title, "middle"))
    for k, curve in enumerate(diagram.curves):
        for piece in diagram.pieces(curve):
            some = (
                piece
                if len(piece) <= MOST_STRIP_POINTS
                else piece[np.linspace(0, len(piece) - 1, MOST_STRIP_POINTS).round().astype(int)]
            )
            points = " ".join("{:.1f},{:.1f}".format(*_pixels(diagram, *point)) for point in some)
            parts.append(f'<polyline points="{points}" fill="none" stroke="{_color(k)}" stroke-width="1.5" opacity="0.8"/>')
        if len(diagram.curves) > 1:
            parts.append(_text(AXES_LEFT + AXES_WIDTH - 6.0, AXES_TOP + 11.0 + 13.0 * k, curve.name, "end", _color(k)))
    return "".join(parts)


def _up(diagram: Diagram) -> float:
    """Height of the axes [px]."""
    return EQUAL_AXES_HEIGHT if diagram.equal else AXES_HEIGHT


def _pixels(diagram: Diagram, x: float, y: float) -> tuple[float, float]:
    """A point of the drawing, whose y runs from -`DRAWING_HEIGHT` at the top to 0, in the picture [px]."""
    return AXES_LEFT + AXES_WIDTH * float(x) / DRAWING_WIDTH, AXES_TOP + _up(diagram) * (1.0 + float(y) / DRAWING_HEIGHT)


def _color(k: int) -> str:
    return readable_color(CURVE_PALETTE[k % len(CURVE_PALETTE)])


def _text(x: float, y: float, text: str, anchor: str, color: str = "currentColor") -> str:
    return svg_words(x, y, escape(text), 10.5, anchor=anchor, color=color)
