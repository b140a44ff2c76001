"""Work-precision diagrams: error against time, both logarithmic, a panel for each dial, as SVG or PNG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from .canvas import Canvas
from .ladder import Point
from .panel import PANEL, draw_panel

__all__ = ["diagram", "dials_of", "write_diagram"]


def dials_of(points: Sequence[Point]) -> list[str]:
    """The dials in order."""
    return list(dict.fromkeys(p.dial for p in points))


def diagram(points: Sequence[Point], title: str, foot: str, target: float | None = None, columns: int = 2) -> Canvas:
    """A sheet with a panel for each dial; the Pareto front is a line, the current setting a ring, the cheapest a larger one."""
    dials = dials_of(points)
    columns = min(columns, len(dials))
    rows = math.ceil(len(dials) / columns)
    sheet = Canvas(columns * PANEL[0] + 16, 40 + rows * PANEL[1] + 28)
    sheet.text(14, 26, title, size=16)
    for k, dial in enumerate(dials):
        x, y = 8 + (k % columns) * PANEL[0], 36 + (k // columns) * PANEL[1]
        draw_panel(sheet, x, y, dial, [p for p in points if p.dial == dial and math.isfinite(p.error)], target)
    sheet.text(14, sheet.height - 10, foot, size=10, color="#666666")
    return sheet


def write_diagram(sheet: Canvas, path: Path) -> None:
    """Write a sheet as .svg or .png, replaced as a whole."""
    temporary = path.with_name(f"{path.name}.part")
    if path.suffix.lower() == ".png":
        sheet.png().save(temporary, format="PNG")
    else:
        temporary.write_text(sheet.svg(), encoding="utf-8")
    temporary.replace(path)
