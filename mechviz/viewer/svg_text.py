"""Words in the drawings of the panels."""

from __future__ import annotations

__all__ = ["svg_text"]

HALO = 'stroke="var(--mantine-color-body)" stroke-width="3" paint-order="stroke"'  # of the ground's colour: lines stay behind


def svg_text(
    x: float, y: float, words: str, size: float, *, anchor: str = "middle", color: str = "currentColor", look: str = HALO
) -> str:
    """An SVG element of ``words``, which are markup already, with their middle at a height; ``look``: more of its attributes."""
    place = f'x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" text-anchor="{anchor}" dominant-baseline="central"'
    return f'<text {place} fill="{color}" {look}>{words}</text>'
