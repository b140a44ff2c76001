"""Diagrams of one quantity against another in the browser: axes with ticks, curves, and a dot where the run is.

They are those of a recording: indicator diagrams, phase diagrams, polar plots of bearing forces, torques of all turns overlaid.
"""

from __future__ import annotations

from functools import lru_cache
from html import escape

import numpy as np

from mechviz.outputs.drawings import HEIGHT, TICKS, WIDTH, Diagram, round_ticks
from mechviz.outputs.rerun.plots import PALETTE
from mechviz.outputs.viewer import words
from mechviz.outputs.viewer.world.constructions import readable_color

HALO = 'stroke="var(--mantine-color-body)" stroke-width="3" paint-order="stroke"'  # of the ground's colour: lines stay behind


def svg_text(
    x: float, y: float, words: str, size: float, *, anchor: str = "middle", color: str = "currentColor", look: str = HALO
) -> str:
    """An SVG element of ``words``, which are markup already, with their middle at a height; ``look``: more of its attributes."""
    place = f'x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" text-anchor="{anchor}" dominant-baseline="central"'
    return f'<text {place} fill="{color}" {look}>{words}</text>'


LEFT, TOP, ACROSS, UP = 46.0, 20.0, 274.0, 236.0  # of the axes [px]
EQUAL = ACROSS * HEIGHT / WIDTH  # height of the axes where a unit is as long upwards as across [px]
WIDE, BELOW = 330.0, 44.0  # of the picture, and of the words below the axes [px]
POINTS = 400  # of a strip, at most


def chart_svg(diagram: Diagram, frame: int) -> str:
    """The picture of a diagram at a frame."""
    parts = []
    for k, curve in enumerate(diagram.curves):
        place = diagram.place(curve.x[frame : frame + 1], curve.y[frame : frame + 1])[0]
        if np.isfinite(place).all():
            x, y = _pixels(diagram, *place)
            if diagram.equal:  # a ray from the origin, as long as the value
                x0, y0 = _pixels(diagram, *diagram.place(np.zeros(1), np.zeros(1))[0])
                parts.append(f'<path d="M{x0:.1f},{y0:.1f} L{x:.1f},{y:.1f}" stroke="{_color(k)}" stroke-width="1.4"/>')
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{_color(k)}"/>')
    high = TOP + _up(diagram) + BELOW
    return (
        f'<svg role="img" aria-label="{escape(diagram.title)}" viewBox="0 0 {WIDE:g} {high:g}" '
        f'style="display:block;width:100%;max-height:{high:g}px;overflow:hidden">{_backdrop(diagram)}{"".join(parts)}</svg>'
    )


@lru_cache(maxsize=8)
def _backdrop(diagram: Diagram) -> str:
    """Fixed part of a diagram: axes, ticks, curves. Diagrams are distinguished by identity, not by content."""
    x0, x1, y0, y1 = diagram.ranges
    up = _up(diagram)
    xs = np.arange(0.0, 361.0, 90.0) if diagram.turn == 360.0 else round_ticks(x0, x1, TICKS)
    parts = []
    for values, across in ((xs, True), (round_ticks(y0, y1, TICKS), False)):
        for value in values:
            ends = (np.array([value, value]), np.array([y0, y1])) if across else (np.array([x0, x1]), np.array([value, value]))
            (ax, ay), (bx, by) = (_pixels(diagram, *spot) for spot in diagram.place(*ends))
            strength = 0.5 if value == 0.0 else 0.15
            parts.append(f'<path d="M{ax:.1f},{ay:.1f} L{bx:.1f},{by:.1f}" stroke="currentColor" opacity="{strength}"/>')
            spot = (ax, TOP + up + 11.0) if across else (LEFT - 5.0, ay)
            parts.append(_text(*spot, words.number(float(f"{value:.4g}")), "middle" if across else "end"))
    parts.append(
        f'<rect x="{LEFT:g}" y="{TOP:g}" width="{ACROSS:g}" height="{up:g}" fill="none" stroke="currentColor" opacity="0.5"/>'
    )
    parts.append(_text(LEFT + ACROSS / 2.0, TOP + up + 28.0, diagram.x_title, "middle"))
    parts.append(_text(LEFT, TOP - 9.0, diagram.y_title, "middle"))
    for k, curve in enumerate(diagram.curves):
        for piece in diagram.pieces(curve):
            some = piece if len(piece) <= POINTS else piece[np.linspace(0, len(piece) - 1, POINTS).round().astype(int)]
            spots = " ".join("{:.1f},{:.1f}".format(*_pixels(diagram, *spot)) for spot in some)
            parts.append(f'<polyline points="{spots}" fill="none" stroke="{_color(k)}" stroke-width="1.5" opacity="0.8"/>')
        if len(diagram.curves) > 1:
            parts.append(_text(LEFT + ACROSS - 6.0, TOP + 11.0 + 13.0 * k, curve.name, "end", _color(k)))
    return "".join(parts)


def _up(diagram: Diagram) -> float:
    """Height of the axes [px]."""
    return EQUAL if diagram.equal else UP


def _pixels(diagram: Diagram, x: float, y: float) -> tuple[float, float]:
    """A place of the drawing, whose y runs from -`HEIGHT` at the top to 0, in the picture [px]."""
    return LEFT + ACROSS * float(x) / WIDTH, TOP + _up(diagram) * (1.0 + float(y) / HEIGHT)


def _color(k: int) -> str:
    return readable_color(PALETTE[k % len(PALETTE)])


def _text(x: float, y: float, text: str, anchor: str, color: str = "currentColor") -> str:
    return svg_text(x, y, escape(text), 10.5, anchor=anchor, color=color)
