"""Work-precision diagrams of a report: error against time of everybody's settings, both logarithmic, one sheet for a table."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Curve", "draw_curves", "precision_curves", "slug"]

OURS = ("#c8553d", "#e08e45", "#8c2f39", "#d6336c")
PACKAGES = {  # the same colour in all diagrams
    "exudyn": "#1b6ca8", "MuJoCo": "#3a7d44", "Pinocchio": "#7b4b94", "pylinkage": "#b08900", "mechanism": "#2a9d8f",
    "sympy": "#4361ee", "scipy": "#495057", "python-solvespace": "#7f5539", "Drake": "#0b525b", "OpenSim": "#6a994e",
}  # fmt: skip
OTHERS = ("#9d4edd", "#c77dff", "#5e548e")
BY_HAND = ("#868e96", "#adb5bd")
LEAST, MOST = 1e-16, 1e2  # errors that are drawn: what is smaller is rounding, what is larger is no result


@dataclass(frozen=True)
class Curve:
    """The settings of one way to solve a problem, in the order of its parameter: times [s] and errors."""

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
    result: dict[str, list[tuple[str, float, float]]] = {}
    for who, setting, time, error, *_ in rows:
        try:
            seconds, off = 1e-3 * float(time.replace(",", "")), float(error)
        except ValueError:
            continue
        method = re.match(r"(energy|gauss|radau) ", setting)
        if seconds > 0.0 and off <= MOST:
            result.setdefault(f"{who}, {method[1]}" if method else who, []).append((setting, seconds, max(off, LEAST)))
    return [Curve(who, *(tuple(column) for column in zip(*points, strict=True))) for who, points in result.items()]


def slug(title: str) -> str:
    """A title as a file name."""
    return "-".join(re.findall(r"[a-z0-9]+", title.lower()))


def draw_curves(title: str, error: str, curves: Sequence[Curve], path: Path) -> Path:
    """Draw curves and points, with the Pareto front below them and their names beside them; ``error``: what it is relative to."""
    from mechviz.figures import chart, save_chart
    from mechviz.studies.precision_diagram import FRONT, precision_axes

    words: dict[str, str] = {}
    with chart(9.4, max(4.4, 0.6 + 0.22 * len(curves))) as figure:
        axes = figure.subplots()
        precision_axes(axes, [t for c in curves for t in c.seconds])
        axes.set(title=title, ylabel=error, xlabel="time")
        for k, (curve, color) in enumerate(_coloured(curves)):
            above = {"color": color, "zorder": 4.0 - 0.01 * k}  # ours above all others
            points = list(zip(curve.seconds, curve.errors, strict=True))
            width, line = (2.2 if curve.ours else 1.3), "o-" if len(points) > 1 else "o"
            axes.plot([], [], line, **above, linewidth=width, markersize=5.0, label=curve.who)
            axes.plot(curve.seconds, curve.errors, **above, linewidth=width)
            for (time, off), setting in zip(points, curve.settings, strict=True):
                gid = f"setting-{len(words)}"
                words[gid] = f"{curve.who}, {setting}: {off:.1e} in {1e3 * time:.3g} ms"
                axes.plot(time, off, "o", **above, markersize=6.0 if len(points) == 1 else 4.5, gid=gid)
        front = {"color": FRONT, "linewidth": 7.0, "marker": "o", "markersize": 9.0, "label": "nothing is quicker and more exact"}
        axes.plot(*zip(*_front(curves), strict=True), **front, zorder=2.0)
        figure.legend(loc="outside right upper")
    save_chart(figure, path, words)
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
