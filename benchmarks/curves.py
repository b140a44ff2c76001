"""Work-precision diagrams of a report: error against time of everybody's settings, both logarithmic, one sheet for a table."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Curve", "draw_curves", "precision_curves", "slug"]

LEFT, TOP, WIDTH, HEIGHT, NAMES = 76.0, 48.0, 480.0, 330.0, 22.0
OURS = ("#c8553d", "#e08e45", "#8c2f39", "#d6336c")
PACKAGES = {  # the same colour in all diagrams
    "exudyn": "#1b6ca8", "MuJoCo": "#3a7d44", "Pinocchio": "#7b4b94", "pylinkage": "#b08900", "mechanism": "#2a9d8f",
    "sympy": "#4361ee", "scipy": "#495057", "python-solvespace": "#7f5539", "Drake": "#0b525b", "OpenSim": "#6a994e",
}  # fmt: skip
OTHERS = ("#9d4edd", "#c77dff", "#5e548e")
BY_HAND = ("#868e96", "#adb5bd")
FRONT = "#c9ced6"
LEAST, MOST = 1e-16, 1e2  # errors that are drawn: what is smaller is rounding, what is larger is no result


@dataclass(frozen=True)
class Curve:
    """The settings of one way to solve a problem, in the order of its dial: times [s] and errors."""

    who: str
    settings: tuple[str, ...]
    seconds: tuple[float, ...]
    errors: tuple[float, ...]

    @property
    def ours(self) -> bool:
        return self.who.startswith(("mechviz", "mechcore"))


def precision_curves(rows: Sequence[Sequence[str]]) -> list[Curve]:
    """The curves of a table of who, setting, time [ms], error. What gave no number is left out; settings of mechviz that begin with
    a word, such as ``gauss 1e-06``, are a curve for each of these words."""
    found: dict[str, list[tuple[str, float, float]]] = {}
    for who, setting, time, error, *_ in rows:
        try:
            seconds, off = 1e-3 * float(time.replace(",", "")), float(error)
        except ValueError:
            continue
        method = re.match(r"(energy|gauss|radau) ", setting)
        if seconds > 0.0 and off <= MOST:
            found.setdefault(f"{who}, {method[1]}" if method else who, []).append((setting, seconds, max(off, LEAST)))
    return [Curve(who, *(tuple(column) for column in zip(*points, strict=True))) for who, points in found.items()]


def slug(title: str) -> str:
    """A title as a file name."""
    return "-".join(re.findall(r"[a-z0-9]+", title.lower()))


def draw_curves(title: str, error: str, curves: Sequence[Curve], path: Path) -> Path:
    """Draw curves and points, with the Pareto front below them and their names beside them; ``error``: what it is relative to."""
    from mechviz.accuracy.diagram import Canvas, decades, seconds_words, time_ticks

    seconds, errors = ([v for c in curves for v in getattr(c, name)] for name in ("seconds", "errors"))
    ticks, (low, high) = time_ticks(seconds), decades(errors)
    sheet = Canvas(LEFT + WIDTH + 330, max(TOP + HEIGHT + 52, TOP + 17 * len(curves) + 60))

    def place(time: float, off: float) -> tuple[float, float]:
        u = math.log(time / ticks[0]) / math.log(ticks[-1] / ticks[0])
        return LEFT + WIDTH * u, TOP + HEIGHT * (high - math.log10(off)) / (high - low)

    sheet.text(14, 22, title, size=14)
    for tick in ticks:
        x, y = place(tick, 10.0**low)
        sheet.line([(x, TOP), (x, y)], "#e3e6ea")
        sheet.text(x, y + 16, seconds_words(tick), size=10.5, anchor="middle")
    for decade in range(low, high + 1, max(1, math.ceil((high - low) / 8))):
        x, y = place(ticks[0], 10.0**decade)
        sheet.line([(x, y), (x + WIDTH, y)], "#e3e6ea")
        sheet.text(x - 7, y + 4, f"1e{decade}", size=10.5, anchor="end")
    sheet.text(14, TOP - 9, error, size=11)
    sheet.text(LEFT + 0.5 * WIDTH, TOP + HEIGHT + 38, "time", size=11, anchor="middle")
    front = [place(t, e) for t, e in _front(curves)]
    sheet.line(front, FRONT, 8.0)
    for x, y in front:
        sheet.dot(x, y, 8.0, FRONT)
    below = _coloured(curves)
    for curve, color in reversed(below):  # ours above all others
        points = [place(t, e) for t, e in zip(curve.seconds, curve.errors, strict=True)]
        sheet.line(points, color, 2.2 if curve.ours else 1.4)
        for (x, y), setting, time, off in zip(points, curve.settings, curve.seconds, curve.errors, strict=True):
            words = f"{curve.who}, {setting}: {off:.1e} in {1e3 * time:.3g} ms"
            sheet.dot(x, y, 4.6 if len(points) == 1 else 3.4, color, title=words)
    at = LEFT + WIDTH + NAMES
    for k, (curve, color) in enumerate(below):
        y = TOP + 8 + 17 * k
        if len(curve.settings) > 1:
            sheet.line([(at, y - 4), (at + 20, y - 4)], color, 2.2 if curve.ours else 1.4)
        sheet.dot(at + 10, y - 4, 4.0, color)
        sheet.text(at + 27, y, curve.who, size=11)
    y = TOP + 8 + 17 * len(below) + 8
    sheet.line([(at, y - 4), (at + 20, y - 4)], FRONT, 8.0)
    sheet.text(at + 27, y, "nothing is quicker and more exact", size=11)
    path.write_text(sheet.svg(), encoding="utf-8")
    return path


def _coloured(curves: Sequence[Curve]) -> list[tuple[Curve, str]]:
    """The curves with their colours: ours, those of packages, those by hand."""
    ours, others, hand = itertools.cycle(OURS), itertools.cycle(OTHERS), itertools.cycle(BY_HAND)
    out = []
    taken: set[str] = set()
    for curve in sorted(curves, key=lambda c: (not c.ours, c.who.startswith("by hand"))):
        known = next((color for name, color in PACKAGES.items() if curve.who.startswith(name) and color not in taken), None)
        color = next(ours) if curve.ours else next(hand) if curve.who.startswith("by hand") else known or next(others)
        taken.add(color)
        out.append((curve, color))
    return out


def _front(curves: Sequence[Curve]) -> list[tuple[float, float]]:
    """The settings than which no other is at once quicker and more exact, the quickest first."""
    front: list[tuple[float, float]] = []
    for time, error in sorted((t, e) for c in curves for t, e in zip(c.seconds, c.errors, strict=True)):
        if not front or error < front[-1][1]:
            front.append((time, error))
    return front
