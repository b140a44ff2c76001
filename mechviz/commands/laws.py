"""``mechviz laws``: the table of motion laws with their peak factors, and their curves over each other as SVG."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from mechcore.errors import Fault, MechanismError
from mechcore.laws.catalogue import RISES, rise
from mechcore.laws.curve import MotionCurve
from mechcore.laws.factors import peak_factors
from mechviz.commands.common import fail, interruptible
from mechviz.commands.solving import clear_errors
from mechviz.files import check_target, replacing

_COLOURS = ("#1b6ca8", "#c8553d", "#3a7d44", "#7b4b94", "#b08900", "#2a9d8f", "#6c757d", "#d6336c")
_PANELS = ("s", "s'", "s''", "s'''")


def laws(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[LAW]...", help="laws, such as cycloidal or parabolic:skew=0.4 [default: all]")
    ] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="write the curves over each other (.svg)")] = None,
) -> None:
    """Print motion laws with their peak factors Cv, Ca, Cj and the steps of their derivatives; plot them over each other."""
    with clear_errors("laws"):
        chosen = {name: _parse(name) for name in (names or list(RISES))}
        if plot is not None and plot.suffix.lower() != ".svg":
            fail(f"{plot}: curves are written as SVG. Give a name that ends in .svg.")
        if plot is not None:
            check_target(plot)
        print("\n".join(laws_table(chosen)))
        if plot is not None:
            text = laws_svg(chosen)
            with interruptible(), replacing(plot) as temporary:
                temporary.write_text(text, encoding="utf-8")
            print(plot)


def _parse(text: str) -> MotionCurve:
    """``name`` or ``name:key=value,key=value``."""
    name, _, rest = text.partition(":")
    parameters = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        try:
            parameters[key.strip()] = float(value)
        except ValueError:
            raise MechanismError(Fault(f"{name}.{key}", f"'{value}' is no number." if equals else "it has no value.",
                                       "Write it like parabolic:skew=0.4.")) from None  # fmt: skip
    return rise(name, **parameters)


def laws_table(chosen: dict[str, MotionCurve]) -> list[str]:
    """Lines: law, Cv, Ca, Cj, largest |s' s''| (drive torque of inertia), derivatives that step at the ends and inside."""
    words = {1: "velocity", 2: "acceleration", 3: "jerk"}
    width = max(len("law"), *map(len, chosen))
    lines = [f"{'law':<{width}}  {'Cv':>8} {'Ca':>9} {'Cj':>10} {'|v a|':>8}  steps at the ends / inside; what it is"]
    for name, curve in chosen.items():
        f = peak_factors(curve)
        steps = " / ".join(", ".join(words[k] for k in group) or "none" for group in (f.end_steps, f.inner_steps))
        about = RISES[name.partition(":")[0]].about
        lines.append(f"{name:<{width}}  {f.velocity:8.5f} {f.acceleration:9.5f} {f.jerk:10.4f} {f.power:8.5f}  {steps}; {about}")
    lines.append("Peaks for stroke H over the range b at cam speed w: Cv H w/b, Ca H (w/b)^2, Cj H (w/b)^3.")
    return lines


def laws_svg(chosen: dict[str, MotionCurve], width: int = 760, height: int = 190) -> str:
    """Four panels, one over the other: displacement, velocity, acceleration, jerk over the range; a step is a gap in the line."""
    left, top, gap = 64, 34 + 18 * ((len(chosen) + 2) // 3), 26
    colours = [_COLOURS[k % len(_COLOURS)] for k in range(len(chosen))]
    parts = []
    for k, name in enumerate(chosen):
        x, y = left + (k % 3) * (width - left) / 3.0, 30 + 18 * (k // 3)
        parts.append(f'<line x1="{x:.1f}" y1="{y - 4}" x2="{x + 22:.1f}" y2="{y - 4}" stroke="{colours[k]}" stroke-width="2"'
                     f'{_dash(k)}/><text x="{x + 28:.1f}" y="{y}">{name}</text>')  # fmt: skip
    for order, label in enumerate(_PANELS):
        lines, low, high = [], 0.0, 0.0
        for curve in chosen.values():
            strokes = []
            for piece, x0 in zip(curve.pieces, curve.knots, strict=False):
                u = np.linspace(0.0, piece.length, max(int(240 * piece.length / curve.length), 8))
                f = np.empty((1, u.size))
                piece.fill(u, f, order)
                strokes.append((x0 + u, f[0]))
                low, high = min(low, float(f.min())), max(high, float(f.max()))
            lines.append(strokes)
        high = high if high > low else low + 1.0
        y0 = top + order * (height + gap)
        inner = width - left - 16

        def place(x: float, y: float, y0: float = y0, low: float = low, high: float = high, inner: float = inner) -> str:
            return f"{left + inner * x:.2f},{y0 + height * (1.0 - (y - low) / (high - low)):.2f}"

        parts.append(f'<rect x="{left}" y="{y0}" width="{inner}" height="{height}" fill="none" stroke="#cccccc"/>')
        zero = place(0.0, 0.0).split(",")[1]
        parts.append(f'<line x1="{left}" y1="{zero}" x2="{left + inner}" y2="{zero}" stroke="#cccccc"/>')
        parts.append(f'<text x="10" y="{y0 + height / 2:.0f}" font-size="15">{label}</text>')
        for value in (low, high):
            level = place(0.0, value).split(",")[1]
            parts.append(f'<text x="{left - 6}" y="{level}" text-anchor="end" dy="4" font-size="11">{value:.4g}</text>')
        for k, strokes in enumerate(lines):
            for x, y in strokes:
                points = " ".join(place(float(a), float(b)) for a, b in zip(x, y, strict=True))
                parts.append(f'<polyline points="{points}" fill="none" stroke="{colours[k]}" stroke-width="1.6"{_dash(k)}/>')
    total = top + 4 * (height + gap)
    parts.append(f'<text x="{left + (width - left) / 2:.0f}" y="{total - 4}" text-anchor="middle">x = angle / range</text>')
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{total + 6}" font-family="sans-serif" font-size="12">\n'
        f'<rect width="100%" height="100%" fill="#ffffff"/>\n{body}\n</svg>\n'
    )


def _dash(k: int) -> str:
    """Every second round through the colours is dashed, so that no two of sixteen laws look alike."""
    return ' stroke-dasharray="6 3"' if (k // len(_COLOURS)) % 2 else ""
