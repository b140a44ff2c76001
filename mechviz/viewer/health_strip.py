"""The strip under the timeline: where the run is healthy, where not, and what happens when. An inline picture (SVG)."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from mechcore.events import Event

from ..quantities import Health

__all__ = ["columns", "health_svg", "in_words", "shade"]

Real = NDArray[np.float64]

COLUMNS = 240
STEPS = 20  # of shades from green to red
WIDTH, ROW, GAP, EVENTS = 1000.0, 11.0, 3.0, 15.0
NAMES, BOX = 103, 55  # [px] left and right of the track of the slider above
GOOD, FAIR, BAD = (46, 160, 96), (230, 168, 23), (208, 48, 48)


def shade(trouble: float) -> str:
    """Green where all is well (0) over amber to red (1)."""
    part = min(max(trouble, 0.0), 1.0) * 2.0
    low, high = (GOOD, FAIR) if part <= 1.0 else (FAIR, BAD)
    part = part if part <= 1.0 else part - 1.0
    return "#" + "".join(f"{round(a + (b - a) * part):02x}" for a, b in zip(low, high, strict=True))


def columns(trouble: Real, count: int = COLUMNS) -> Real:
    """The worst of each of ``count`` equal stretches of frames: a single bad frame is seen."""
    edges = np.linspace(0, len(trouble), min(count, len(trouble)) + 1).astype(int)
    return np.maximum.reduceat(trouble, edges[:-1])


def health_svg(health: Sequence[Health], events: Sequence[Event], time: Real) -> str:
    """A row for each quantity, and below them a mark for every event, with words for the mouse and for screen readers.

    The rows lie below the track of the timeline's slider, so that a place in them is a place of the slider.
    """
    start, length = float(time[0]), max(float(time[-1] - time[0]), 1e-300)
    height = len(health) * (ROW + GAP) + EVENTS
    rows, names = [], []
    for k, h in enumerate(health):
        said = in_words(h)
        y = k * (ROW + GAP)
        row = [f"<title>{escape(said)}</title>"]
        steps = np.round(columns(h.trouble) * STEPS).astype(int)
        starts = np.flatnonzero(np.diff(steps, prepend=-1))
        per = WIDTH / len(steps)
        for first, after in zip(starts, [*starts[1:], len(steps)], strict=True):
            left, wide, fill = per * first, per * (after - first), shade(steps[first] / STEPS)
            row.append(f'<rect x="{left:.1f}" y="{y:g}" width="{wide + 0.4:.1f}" height="{ROW:g}" fill="{fill}"/>')
        rows.append(f"<g>{''.join(row)}</g>")
        names.append(f'<div title="{escape(said)}" style="height:{ROW + GAP:g}px;white-space:nowrap">{escape(h.name)}</div>')
    base = len(health) * (ROW + GAP)
    for e in events:
        x = WIDTH * float(np.clip((e.time - start) / length, 0.0, 1.0))
        color = "#d03030" if e.level == "WARN" else "#2563c9"
        said = escape(f"{e.time:.4g} s: {e.item}: {e.text}")
        rows.append(f'<g><title>{said}</title><path d="M{x:.1f},{base + 1:g} l9,12 h-18 z" fill="{color}"/></g>')
    names.append(f'<div style="height:{EVENTS:g}px">{len(events)} event{"" if len(events) == 1 else "s"}</div>')
    words = "Health of the run: " + "; ".join([*map(in_words, health), f"{len(events)} events"])
    return (
        '<div style="display:flex;font-size:0.74em;line-height:1.15;align-items:flex-start">'
        f'<div style="flex:none;width:{NAMES}px;opacity:0.75;overflow:hidden">{"".join(names)}</div>'
        f'<svg class="mechviz-health" role="img" aria-label="{escape(words)}" viewBox="0 0 {WIDTH:g} {height:g}" '
        f'preserveAspectRatio="none" style="flex:1;min-width:0;height:{height:g}px;overflow:visible;margin-right:{BOX}px">'
        f'{"".join(rows)}<line class="mechviz-now" x1="0" x2="0" y1="-2" y2="{height:g}" stroke="#c2255c" stroke-width="3.5"/>'
        "</svg></div>"
    )


def in_words(h: Health) -> str:
    """The worst of a run: "closure: at most 3e-17 m"."""
    worst = float(np.max(np.abs(h.values), initial=0.0, where=np.isfinite(h.values)))
    lost = int((~np.isfinite(h.values)).sum())
    unit = "" if h.unit == "1" else f" {h.unit}"
    return f"{h.name}: at most {worst:.2g}{unit}" + (f", {lost} frames without a finite value" if lost else "")
