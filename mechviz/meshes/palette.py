"""Colours of parts: one calm colour per link, neutral greys for the frame and for pins."""

from __future__ import annotations

__all__ = ["BELT", "FRAME", "PIN", "Color", "link_colors"]

Color = tuple[int, int, int, int]  # red, green, blue, alpha, each 0-255

FRAME: Color = (112, 119, 128, 255)
PIN: Color = (196, 200, 206, 255)
BELT: Color = (62, 64, 69, 255)

# Ten muted hues. Neighbours in the list differ in lightness as well as in hue, so that they stay apart for colour-blind
# viewers and in print; none is a saturated red or green, which force arrows use.
_LINKS: tuple[Color, ...] = (
    (68, 114, 166, 255),  # blue
    (232, 163, 82, 255),  # amber
    (86, 160, 140, 255),  # teal
    (190, 99, 96, 255),  # brick
    (139, 121, 180, 255),  # violet
    (221, 196, 98, 255),  # straw
    (122, 177, 212, 255),  # sky
    (150, 112, 84, 255),  # brown
    (214, 156, 184, 255),  # rose
    (122, 140, 78, 255),  # olive
)


def link_colors(names: tuple[str, ...], frame: str) -> dict[str, Color]:
    """Colour of every link, by its place in the scene; the frame is grey and uses up no colour."""
    moving = [name for name in names if name != frame]
    colors = {name: _LINKS[k % len(_LINKS)] for k, name in enumerate(moving)}
    colors[frame] = FRAME
    return colors
