"""What the panels say, as HTML. Every text of a scene is escaped: browsers run scripts that stand in attributes."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import numpy as np

from ..run import Run
from ..vectors import FAMILIES, FORCE_FAMILIES, Scales, round_value
from .marks3d import PATH
from .quantities import slides
from .stage import grid_cell

__all__ = ["heading", "legend", "number", "place_in_run", "plan_list", "scale"]

TARGET = 0.2  # of the mechanism's size: about how long an arrow the legend gives the value for


def number(value: float) -> str:
    """A value for reading: five significant digits, a true minus."""
    if not np.isfinite(value):
        return "not finite"
    return f"{value:.5g}".replace("-", "−", 1) if value < 0 else f"{value:.5g}"


def heading(run: Run) -> str:
    """Title, and what the scene teaches."""
    return _block(
        f'<div style="font-size:1.12em;font-weight:650;line-height:1.25;padding-bottom:0.3em">{escape(run.scene.title)}</div>'
        f'<div style="font-size:0.85em;line-height:1.4;opacity:0.85">{escape(run.scene.teaches)}</div>'
    )


def legend(families: Iterable[str], paths: Iterable[str], scales: Scales, factor: float, size: float) -> str:
    """What each colour means and how long which value is drawn; ``factor`` is the user's enlargement."""
    families, paths = list(families), list(paths)
    rows = [_swatch(FAMILIES[f].color, 0.42, f"<b>{FAMILIES[f].label}</b>: {FAMILIES[f].meaning}") for f in families]
    if paths:
        rows.append(_swatch(PATH, 0.16, f"<b>Path</b> of {escape(', '.join(paths))}"))
    shown = set(families)
    for unit, some, per_metre in (
        ("N", shown & set(FORCE_FAMILIES), scales.newtons_per_metre),
        ("m/s", shown & {"velocity"}, scales.mps_per_metre),
        ("m/s²", shown & {"acceleration"}, scales.mps2_per_metre),
    ):
        if some and per_metre != 1.0:
            rows.append(f"<div>{scale(unit, per_metre / factor, size)}</div>")
    rows.append(f'<div style="opacity:0.75">Grid: {number(grid_cell(size) * 1e3)} mm</div>')
    return _block("".join(rows), "font-size:0.78em;line-height:1.35")


def plan_list(run: Run) -> str:
    """What was computed, what was left out and why, and the time that it took."""
    done = "".join(f"<li>{escape(step.name)}</li>" for step in run.plan.computed)
    left = "".join(
        f'<li>{escape(step.name)} <span style="opacity:0.65">({escape(step.why)})</span></li>' for step in run.plan.skipped
    )
    seconds = sum(stage.seconds for stage in run.stages)
    style = 'style="margin:0.15em 0 0.5em;padding-left:1.2em"'
    return _block(
        f"<b>Computed</b> for {run.motion.frames} frames in {number(round(seconds * 1e3, 1))} ms<ul {style}>{done}</ul>"
        f"<b>Left out</b><ul {style}>{left or '<li>nothing</li>'}</ul>",
        "font-size:0.78em;line-height:1.35",
    )


def place_in_run(run: Run, frame: int) -> str:
    """Drive positions, time and frame number."""
    motion = run.motion
    parts = [
        f"{escape(d.pair)} <b>{_position(slides(motion, d.pair), float(q[0][frame]))}</b>"
        for d, q in zip(motion.mechanism.drives, motion.drives, strict=True)
    ]
    parts.append(f"time <b>{motion.time[frame]:.4f} s</b>")
    parts.append(f'<span style="opacity:0.7">frame {frame} of {motion.frames - 1}</span>')
    return _block("".join(f"<span>{part}</span>" for part in parts), "display:flex;gap:1.6em;font-variant-numeric:tabular-nums")


def _position(sliding: bool, value: float) -> str:
    text = f"{value * 1e3:.2f} mm" if sliding else f"{np.degrees(value):.1f}°"
    return text.replace("-", "−", 1)


def scale(unit: str, per_metre: float, size: float) -> str:
    """A round value of a ``unit``, of which ``per_metre`` are drawn as a metre, and its length: "500 N = 41 mm"."""
    value = round_value(TARGET * size * per_metre)
    for big, small in (("kN", "N"), ("km/s²", "m/s²")):
        if unit == small and value >= 1000.0:
            return f"Scale: {number(value / 1000.0)} {big} = {number(round(value / per_metre * 1e3, 1))} mm"
    return f"Scale: {number(value)} {unit} = {number(round(value / per_metre * 1e3, 1))} mm"


def _swatch(color: tuple[int, int, int], thickness: float, words: str) -> str:
    red, green, blue = color
    return (
        '<div style="display:flex;gap:0.55em;align-items:baseline;padding-bottom:0.25em">'
        f'<span style="flex:none;width:1.3em;height:{thickness}em;border-radius:0.2em;background:rgb({red},{green},{blue});'
        'transform:translateY(-0.2em)"></span>'
        f"<span>{words}</span></div>"
    )


def _block(content: str, style: str = "") -> str:
    return f'<div style="padding:0.1em 0.85em 0.5em;{style}">{content}</div>'
