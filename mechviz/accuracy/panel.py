"""One panel of a work-precision diagram: error against time of the settings of a dial, both logarithmic."""

from __future__ import annotations

import math
from collections.abc import Callable

from .canvas import Canvas
from .ladder import Point, cheapest, pareto

__all__ = ["COLOURS", "PANEL", "draw_panel"]

COLOURS = ("#1b6ca8", "#c8553d", "#3a7d44", "#7b4b94", "#b08900", "#2a9d8f", "#6c757d", "#d6336c")
PANEL = (430.0, 320.0)
LEFT, TOP, RIGHT, BOTTOM = 62.0, 66.0, 14.0, 44.0
GRID = "#e3e6ea"

Place = Callable[[float, float], tuple[float, float]]
"""Where a time [s] and an error lie on the sheet."""


def draw_panel(sheet: Canvas, x0: float, y0: float, dial: str, points: list[Point], target: float | None) -> Place:
    """Draw the finite points of a dial with its upper left corner at (x0, y0); where a time and an error lie."""
    width, height = PANEL[0] - LEFT - RIGHT, PANEL[1] - TOP - BOTTOM
    ticks = _ticks([p.seconds for p in points])
    low_e, high_e = _decades([p.error for p in points])

    def place(t: float, e: float) -> tuple[float, float]:
        u = math.log(t / ticks[0]) / math.log(ticks[-1] / ticks[0])
        v = (math.log10(e) - low_e) / (high_e - low_e)
        return x0 + LEFT + width * min(max(u, 0.0), 1.0), y0 + TOP + height * (1.0 - min(max(v, 0.0), 1.0))

    sheet.text(x0 + LEFT, y0 + 14, dial, size=13)
    for tick in ticks:
        x, _ = place(tick, 10.0**low_e)
        sheet.line([(x, y0 + TOP), (x, y0 + TOP + height)], GRID)
        sheet.text(x, y0 + TOP + height + 15, seconds_words(tick), size=10, anchor="middle")
    for decade in range(low_e, high_e + 1, max(1, math.ceil((high_e - low_e) / 6))):
        _, y = place(ticks[0], 10.0**decade)
        sheet.line([(x0 + LEFT, y), (x0 + LEFT + width, y)], GRID)
        sheet.text(x0 + LEFT - 6, y + 4, f"1e{decade}", size=10, anchor="end")
    sheet.text(x0 + LEFT + width / 2, y0 + PANEL[1] - 12, "time", size=11, anchor="middle")
    sheet.text(x0 + LEFT - 6, y0 + TOP - 8, "error", size=11, anchor="end")
    if target is not None and low_e < math.log10(target) < high_e:
        _, y = place(ticks[0], target)
        sheet.line([(x0 + LEFT, y), (x0 + LEFT + width, y)], "#222222", dash=True)
        sheet.text(x0 + LEFT + 4, y - 4, f"wanted {target:g}", size=10)
    sheet.line([place(p.seconds, p.error) for p in pareto(points)], "#c9ced6", width=7.0)
    _curves(sheet, x0, y0, points, place)
    for p in points:
        if p.current:
            sheet.dot(*place(p.seconds, p.error), 7.0, "#111111", filled=False)
    best = cheapest(points, target) if target is not None else None
    if best is not None:
        sheet.dot(*place(best.seconds, best.error), 10.0, "#d6336c", filled=False)
    return place


def _curves(sheet: Canvas, x0: float, y0: float, points: list[Point], place: Place) -> None:
    """The settings of each method, joined in the order of the ladder, and their names; fitted ones stand by themselves."""
    at, row = x0 + LEFT, y0 + 30
    for k, method in enumerate(dict.fromkeys(p.method for p in points)):
        color = COLOURS[k % len(COLOURS)]
        own = [p for p in points if p.method == method]
        joined = [p for p in own if not p.note.startswith("fitted") and p.value != "as it is"]
        sheet.line([place(p.seconds, p.error) for p in joined], color, width=1.3)
        for p in own:
            sheet.dot(*place(p.seconds, p.error), 3.2, color)
        if at + 16 + 5.2 * len(method) > x0 + PANEL[0] - 4:
            at, row = x0 + LEFT, row + 15
        sheet.dot(at + 4, row - 4, 3.5, color)
        sheet.text(at + 11, row, method, size=9.5)
        at += 22 + 5.2 * len(method)


def _decades(errors: list[float]) -> tuple[int, int]:
    """Powers of ten around some errors."""
    a, b = math.floor(math.log10(min(errors))), math.ceil(math.log10(max(errors)))
    return a, max(b, a + 1)


def _ticks(times: list[float]) -> list[float]:
    """Round times around some: of the series 1, 2, 5, or over more than two decades powers of ten."""
    first, last = math.floor(math.log10(min(times))) - 1, math.ceil(math.log10(max(times))) + 1
    for steps in ((1, 2, 5), (1,)):
        series = [step * 10.0**decade for decade in range(first, last + 1) for step in steps]
        below = max(k for k, t in enumerate(series) if t <= min(times) * 1.0001)
        above = min(k for k, t in enumerate(series) if t >= max(times) * 0.9999)
        found = series[below : max(above, below + 1) + 1]
        if len(found) <= 7:
            return found
    step = math.ceil(len(found) / 7)
    return [*found[:-1:step], found[-1]] if (len(found) - 1) % step else found[::step]


def seconds_words(time: float) -> str:
    """A round time in words."""
    for factor, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns")):
        if time >= 0.999 * factor:
            return f"{time / factor:.4g} {unit}"
    return f"{time:g} s"
