"""Work-precision diagrams: error against time, both logarithmic, a panel for each dial, as SVG or PNG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from ..files import replacing
from .canvas import Canvas
from .ladder import Point
from .panel import PANEL, draw_key, draw_panel, key_rows

__all__ = ["diagram", "dials_of", "write_diagram"]


def dials_of(points: Sequence[Point]) -> list[str]:
    """The dials in order."""
    return list(dict.fromkeys(p.dial for p in points))


def diagram(
    points: Sequence[Point],
    title: str,
    foot: str,
    target: float | None = None,
    columns: int = 2,
    size: tuple[float, float] = PANEL,
) -> Canvas:
    """A sheet with a panel for each dial; the Pareto front is a band, the current setting a ring, the cheapest a larger one."""
    dials = dials_of(points)
    columns = min(columns, len(dials))
    rows = math.ceil(len(dials) / columns)
    wide = columns * size[0] + 16
    key = key_rows(wide, target)
    sheet = Canvas(wide, 36 + rows * size[1] + 18 * key + 26)
    sheet.text(14, 26, title, size=16 if columns > 1 else 12)
    for k, dial in enumerate(dials):
        x, y = 8 + (k % columns) * size[0], 36 + (k // columns) * size[1]
        own = [p for p in points if p.dial == dial and math.isfinite(p.error)]
        if own:
            draw_panel(sheet, x, y, dial, own, target, size)
        else:
            sheet.text(x + 14, y + 14, f"{dial}: no setting gives numbers", size=13)
    draw_key(sheet, 14, sheet.height - 10 - 18 * key, target)
    sheet.text(14, sheet.height - 10, foot, size=10, color="#666666")
    return sheet


def write_diagram(sheet: Canvas, path: Path) -> None:
    """Write a sheet as .svg or .png, replaced as a whole. Raises `OutputError`."""
    with replacing(path) as temporary:
        if path.suffix.lower() == ".png":
            sheet.png().save(temporary, format="PNG")
        else:
            temporary.write_text(sheet.svg(), encoding="utf-8")
